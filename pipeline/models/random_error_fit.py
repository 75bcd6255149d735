"""Which random error a static record shows: fits by the debiased Whittle likelihood, chosen by BIC.

The candidates are the forms of `pipeline.models.random_error_forms`: white noise, alone and with noise 1, 2
or 3, each with and without a rate random walk and quantisation. Schwarz' criterion ``-2 ln L + p ln n``
chooses: Akaike's sees colour in every second white record.

The samples are rates at instants; means over a step (angle increments) are the same where mu and lambda are
small against 1/step. Of white noise, a walk and quantisation the likelihood is exact but for the two ends
of the quantisation (`pipeline.numerics.whittle`). A noise 1 that is slower than the record is a walk of ``K
= sigma sqrt(2 mu)``: the criterion takes the walk, which has a parameter less. A walk is no candidate where
gaps are so dense that the record has no runs; there `Candidate.slow` says that noise 1 may be one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models import _random_error_starts as search
from pipeline.models.random_error import RandomError
from pipeline.models.random_error_forms import (
    FORMS,
    colour_of,
    in_seconds,
    model_of,
    names,
    process,
    terms_of,
)
from pipeline.numerics import cosine_spectrum, whittle

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEWEST_SAMPLES = 64
"""Below so many no colour can be told from white noise."""

UNLIKELY = 1e-3
"""Probability of a residual periodogram below which a model does not describe the record."""

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
        Of `FORMS`.
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
        The record has fewer than twenty time constants of the colour: it can hardly be told from a line, or
        from a rate random walk.
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
        """Of the parameters: sigma, mu, lambda, K, Q, N."""
        return names(self.form)

    @property
    def model(self) -> RandomError:
        """The random error."""
        return model_of(self.form, self.theta)

    @property
    def parameters(self) -> dict[str, float]:
        """Name to value, in SI units."""
        return {name: float(np.exp(x)) for name, x in zip(self.names, self.theta, strict=True)}

    @property
    def fits(self) -> bool:
        """Whether the record may be of this form."""
        return self.whiteness >= UNLIKELY

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
    spectrum = cosine_spectrum.periodogram(rate, observed)
    return Identified(fit_forms(spectrum, step, FORMS), spectrum.samples)


def fit_forms(
    spectrum: cosine_spectrum.Periodogram, step: float, forms: Sequence[str]
) -> tuple[Candidate, ...]:
    """Fit candidates, each beginning where the smaller ones ended.

    Parameters
    ----------
    spectrum : Periodogram
        Of a record.
    step : float
        Its step [s].
    forms : sequence of str
        Of `FORMS`; those with a walk are left out where the spectrum has none.

    Returns
    -------
    tuple of Candidate
        In the order of the forms.
    """
    fits: dict[str, whittle.Fit] = {}
    possible = [form for form in forms if spectrum.walks or "rate_random_walk" not in terms_of(form)]
    return tuple(_candidate(spectrum, step, form, _fitted(spectrum, form, fits)) for form in possible)


def fit_form(spectrum: cosine_spectrum.Periodogram, step: float, form: str) -> Candidate:
    """Fit one candidate, as `fit_forms` does."""
    (candidate,) = fit_forms(spectrum, step, (form,))
    return candidate


def _fitted(spectrum: cosine_spectrum.Periodogram, form: str, fits: dict[str, whittle.Fit]) -> whittle.Fit:
    """The fit of a form, in units of samples, which is kept in ``fits`` with those that it begins from."""
    if form not in fits:
        smaller = {part: _fitted(spectrum, part, fits).theta for part in search.parts(form)}
        lower, upper = search.bounds(spectrum, form)
        begin = search.starts(spectrum, form, smaller)
        fits[form] = whittle.fit(spectrum, lambda theta: process(form, theta, 1.0), begin, lower, upper)
    return fits[form]


def _candidate(spectrum: cosine_spectrum.Periodogram, step: float, form: str, fit: whittle.Fit) -> Candidate:
    f, _ = whittle.expected(spectrum, process(form, fit.theta, 1.0))
    k = len(fit.theta)
    return Candidate(
        form,
        in_seconds(form, fit.theta, step),
        fit.information,
        fit.value + k * float(np.log(spectrum.samples)),
        fit.value,
        whittle.band_whiteness(spectrum, f, k)[1],
        colour_of(form) is not None and float(np.exp(fit.theta[1])) * spectrum.length < _SLOW,
        fit.converged,
    )
