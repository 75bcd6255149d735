"""Which random error a static record shows: fits by the debiased Whittle likelihood, chosen by BIC.

The candidates are white noise alone and white noise with noise 1, 2 or 3 (`pipeline.models.random_error`).
Their parameters are fitted as logarithms, whose uncertainty is symmetric. Schwarz' criterion ``-2 ln L + p ln
n`` chooses: Akaike's sees colour in every second white record.

The samples are rates at instants; means over a step (angle increments) are the same where mu and lambda are
small against 1/step. A rate random walk is no candidate: in a record that is shorter than the time constant
noise 1 is one, of ``K = sigma sqrt(2 mu)``, and then sigma and mu apart are not determined: `Candidate.slow`.
K of such a record is known to a third at best, whatever its standard error says, for the record's ends are
in every ordinate: Allan's deviation tells it better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models import _random_error_starts as search
from pipeline.models.random_error import Noise, Noise1, Noise2, Noise3, RandomError, White
from pipeline.numerics import whittle

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

FORMS: dict[str, type[Noise1] | type[Noise2] | type[Noise3] | None] = {
    "white": None,
    "noise1": Noise1,
    "noise2": Noise2,
    "noise3": Noise3,
}
"""The coloured term of each candidate, beside white noise."""

FEWEST_SAMPLES = 64
"""Below so many no colour can be told from white noise."""

_SLOW = 20.0
"""Time constants in a record below which noise 1 cannot be told from a rate random walk: one walk in a
hundred shows more (Dickey & Fuller, *J. Am. Stat. Assoc.* 74 (1979) 427-431: 20.7)."""
_DETERMINED = 1e-10
"""Smallest eigenvalue of the information, scaled to a unit diagonal, of parameters that are determined."""
_HIDDEN = 1e-6
"""Part of a figure's slope along undetermined directions from which it counts: they are so exact."""
_DIFFERENCE = 1e-4
"""Step of a parameter's logarithm for derivatives: their error is its square."""


class RandomErrorFitError(GyrostandError):
    """A record that holds no random error to identify."""

    exit_code = ExitCode.INPUT


@dataclass(frozen=True, slots=True)
class Candidate:
    """One form of random error, fitted.

    Attributes
    ----------
    form : str
        A key of `FORMS`.
    theta : ndarray, shape (k,)
        Logarithms of the parameters, in the order of `names`.
    information : ndarray, shape (k, k)
        Whittle's Fisher matrix of theta.
    bic : float
        Smaller is better.
    deviance : float
        -2 ln L.
    whiteness : float
        Probability of a residual periodogram as far from white noise's.
    slow : bool
        The record has fewer than twenty time constants of the colour: it cannot be told from a rate random
        walk.
    converged : bool
    """

    form: str
    theta: Float
    information: Float
    bic: float
    deviance: float
    whiteness: float
    slow: bool
    converged: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters: sigma, mu, lambda, N."""
        return _names(self.form)

    @property
    def model(self) -> RandomError:
        """The random error."""
        return model_of(self.form, self.theta)

    @property
    def parameters(self) -> dict[str, float]:
        """Name to value, in SI units."""
        return {name: float(np.exp(x)) for name, x in zip(self.names, self.theta, strict=True)}

    @property
    def standard_errors(self) -> dict[str, float]:
        """Name to standard error, in SI units; infinite where the record does not determine it."""
        spread = np.exp(self.theta) * self._spread(np.eye(len(self.theta)))
        return {name: float(error) for name, error in zip(self.names, spread, strict=True)}

    def standard_error(self, figure: Callable[[RandomError], Float]) -> Float:
        """Standard error of any figure of the model, by its derivatives.

        Parameters
        ----------
        figure : callable
            E.g. ``lambda model: np.log(model.psd(omega))``.

        Returns
        -------
        ndarray
            Of the figure's shape. Infinite where the figure depends on what the record does not determine.
        """
        return self._spread(np.stack([self._slope(figure, k) for k in range(len(self.theta))]))

    def _spread(self, slopes: Float) -> Float:
        """Standard errors of figures whose slopes by theta are given, shape (k, ...)."""
        size = np.sqrt(np.diag(self.information))
        scaled = self.information / np.outer(size, size)
        value, direction = np.linalg.eigh(scaled)
        along = np.tensordot(direction / size[:, np.newaxis], slopes, axes=(0, 0))
        known = value > _DETERMINED
        square = np.tensordot(1 / value[known], along[known] ** 2, axes=1)
        hidden = np.sum(along[~known] ** 2, axis=0) > _HIDDEN * np.sum(along**2, axis=0)
        return np.asarray(np.sqrt(np.where(hidden, np.inf, square)), dtype=np.float64)

    def _slope(self, figure: Callable[[RandomError], Float], k: int) -> Float:
        step = np.zeros(len(self.theta))
        step[k] = _DIFFERENCE
        above, below = (figure(model_of(self.form, self.theta + s)) for s in (step, -step))
        return np.asarray((above - below) / (2 * _DIFFERENCE), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Identified:
    """What a record's random error is.

    Attributes
    ----------
    candidates : tuple of Candidate
        In the order of `FORMS`.
    samples : int
        That counted.
    """

    candidates: tuple[Candidate, ...]
    samples: int

    @property
    def chosen(self) -> Candidate:
        """The candidate of the smallest BIC."""
        return min(self.candidates, key=lambda one: one.bic)


def identify(rate: Float, step: float, observed: Mask | None = None) -> Identified:
    """Fit every candidate to a static record.

    Parameters
    ----------
    rate : ndarray, shape (n,)
        Rates every step, in the sensor's unit; of any mean. Anything where not observed.
    step : float
        [s].
    observed : ndarray of bool, shape (n,), optional
        False in gaps: they are taken into account, not bridged.

    Returns
    -------
    Identified

    Raises
    ------
    RandomErrorFitError
        If there are too few samples, or all are equal.
    """
    present = rate if observed is None else rate[observed]
    if present.size < FEWEST_SAMPLES or np.ptp(present) == 0:
        raise RandomErrorFitError(
            "random error of a record",
            expected=f"at least {FEWEST_SAMPLES} samples that are not all equal",
            found=f"{present.size} samples"
            + (", all equal" if present.size and np.ptp(present) == 0 else ""),
            remedy="record longer, or with a finer resolution",
        )
    spectrum = whittle.periodogram(rate, observed)
    return Identified(tuple(fit_form(spectrum, step, form) for form in FORMS), spectrum.samples)


def fit_form(spectrum: whittle.Periodogram, step: float, form: str) -> Candidate:
    """Fit one candidate.

    Parameters
    ----------
    spectrum : Periodogram
        Of a record.
    step : float
        Its step [s].
    form : str
        A key of `FORMS`.

    Returns
    -------
    Candidate
    """
    lower, upper = search.bounds(spectrum, form)
    begin = search.starts(spectrum, form)
    fit = whittle.fit(spectrum, lambda theta: exponentials(form, theta, 1.0), begin, lower, upper)
    f, _ = whittle.expected(spectrum, exponentials(form, fit.theta, 1.0))
    k = len(fit.theta)
    # From samples to seconds: mu and lambda are rates, N a density
    scale = {"sigma": 0.0, "mu": -np.log(step), "lambda": -np.log(step), "N": np.log(step)}
    theta = fit.theta + np.array([scale[name] for name in _names(form)])
    return Candidate(
        form,
        theta,
        fit.information,
        fit.value + k * float(np.log(spectrum.samples)),
        fit.value,
        whittle.band_whiteness(spectrum, f, k)[1],
        k > 1 and float(np.exp(fit.theta[1])) * spectrum.length < _SLOW,
        fit.converged,
    )


def exponentials(form: str, theta: Float, step: float) -> whittle.Exponentials:
    """The autocorrelation of samples every step, and its derivatives by the logarithms of the parameters.

    Parameters
    ----------
    form : str
        A key of `FORMS`.
    theta : ndarray, shape (k,)
    step : float
        [s].

    Returns
    -------
    Exponentials
        ``white = N / step``, c of `pipeline.models.random_error`, p times the step.
    """
    k = len(theta)
    white = float(np.exp(theta[-1])) / step
    d_white = np.zeros(k)
    d_white[-1] = white
    noise = _noise(form, theta)
    if noise is None:
        none = np.zeros((k, 0), dtype=np.complex128)
        return whittle.Exponentials(white, none[0], none[0], d_white, none, none)
    c, p = noise.amplitude, noise.decay * step
    d_c, d_p = np.zeros((k, 1), dtype=np.complex128), np.zeros((k, 1), dtype=np.complex128)
    d_c[0], d_p[1] = 2 * c, p.real
    if k > 3:
        d_c[1], d_c[2], d_p[2] = 1j * c.imag, -1j * c.imag, 1j * p.imag
    return whittle.Exponentials(white, np.array([c]), np.array([p]), d_white, d_c, d_p)


def model_of(form: str, theta: Float) -> RandomError:
    """The random error of one form at the logarithms of its parameters."""
    noise = _noise(form, theta)
    white = White(float(np.exp(theta[-1])))
    return RandomError((white,) if noise is None else (noise, white))


def _noise(form: str, theta: Float) -> Noise | None:
    kind = FORMS[form]
    return None if kind is None else kind(*(float(value) for value in np.exp(theta[:-1])))


def _names(form: str) -> tuple[str, ...]:
    if form == "white":
        return ("N",)
    return ("sigma", "mu", "N") if form == "noise1" else ("sigma", "mu", "lambda", "N")
