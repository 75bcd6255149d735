"""The Earth rate that gimbal angles imply: whether they can be what the test plan says they are.

A free rotor stays fixed to the stars but for its drift, so that the gimbal turns with the Earth. With the
linear model of Gubarenko & Kuzmenko (1995), (6.1), and a factor s to the Earth rate,

    alpha' = s c(alpha) + F(alpha) m,

the angles themselves tell s: 1, unless they are in another unit, or the base does not stand as the plan
says. Angles in degrees that are taken for radians turn 57 times too fast: s is then far from 1, or no s
fits. Near the pole the model is linear in the angles and hides their unit; there only the
misfit can tell, and where the angles are small nothing can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import DEGREES_PER_HOUR, Base
from pipeline.models.gyro_drift import DRIFT, PARAMETERS, linear_model
from pipeline.numerics.least_squares import Solution, solve
from pipeline.numerics.local_polynomial import LocalPolynomial
from pipeline.numerics.sampling import MAD_TO_SIGMA
from pipeline.numerics.steps import without_large_spikes

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]
Cause = Literal["degrees", "radians"]

FACTORS: dict[Cause, float] = {"degrees": np.pi / 180, "radians": 180 / np.pi}
"""What turns declared radians into true ones, if the numbers are degrees that the plan calls radians, or
radians that it calls degrees."""

_NODES = 2000
"""Samples at which the model is evaluated: over 24 h one in 0.003 rad of the Earth's rotation."""

_SEGMENT = 10
"""Steps between nodes a row: 200 rows, of which an outlier spoils one or two."""

_FEWEST_ROWS = 10

_DRIFT_SIGMA = 0.1
"""1 sigma of the drift before the record, 1.5 deg/h: more would let it stand in for the Earth rate."""

_EARTH_SIGMA = 1e3
"""1 sigma of s before the record: so wide that it only keeps an undetermined s finite."""

_INSTALLATION_SIGMA = 0.02
"""1 sigma of tilt and misalignment, 1.1 degrees [rad]: it keeps what the record does not tell near 0."""

_FINEST = 1e-6
"""Noise of a rate below which no better parameters are wanted."""

_MODEL = 0.02
"""Part of the rate that the linear model leaves out (tilt, misalignment, a transient) and that drifts."""

_QUIET = 0.1
"""Rate below which drift may be as large as the rate itself: near the pole."""

_OUTLYING = 5.0
"""Robust standard deviations of a row that is left out: a jump."""

_OFF = 0.3
"""|s - 1| above which the Earth rate is not the Earth's: the drift's prior makes it up to 0.1."""

_DOUBTFUL, _FITS = 0.2, 0.1
"""Misfit above which a hypothesis is doubted, and up to which one is believed."""

_CLEAR = 0.05
"""Misfit up to which another unit is named: the right one leaves what the linear model does, 0.02."""

_BETTER = 5.0
"""How many times smaller the misfit in another unit must be where the misfit alone decides."""

_LONGEST_SPIKE = 5
"""Samples of a spike that spoils no row."""

_CHUNK = 1 << 16
"""Samples at a time: F takes 176 bytes for each."""


@dataclass(frozen=True, slots=True)
class Implied:
    """The Earth rate that angles imply.

    Attributes
    ----------
    scale, standard_error : float
        s, in units of the Earth rate, and its standard error: the part of the drift that can stand in for
        it included.
    misfit : float
        Root mean square of the rates that the fit leaves, without that of noise, over the rates.
    """

    scale: float
    standard_error: float
    misfit: float

    @property
    def off(self) -> bool:
        """Whether s is not that of the Earth, beyond what drift explains."""
        return abs(self.scale - 1) > max(_OFF, 3 * self.standard_error)

    @property
    def believed(self) -> bool:
        """Whether angles of a sound record may give this."""
        return abs(self.scale - 1) <= _OFF and self.misfit <= _FITS

    @property
    def deg_h(self) -> float:
        """The Earth rate implied [deg/h]."""
        return self.scale * DEGREES_PER_HOUR

    def __str__(self) -> str:
        """In the words of a finding."""
        return f"{self.deg_h:.4g} deg/h ({self.misfit:.2%} of the motion unexplained)"


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the angles of a run say of the plan.

    Attributes
    ----------
    declared : Implied
        With the unit that the plan declares.
    doubtful : bool
        Whether the angles contradict the plan.
    cause : {"degrees", "radians"}, optional
        What the numbers are instead of what is declared, where that explains it.
    otherwise : Implied, optional
        With that unit.
    """

    declared: Implied
    doubtful: bool
    cause: Cause | None = None
    otherwise: Implied | None = None


def judge(tau: Float, alpha: Float, base: Base) -> Judgement | None:
    """Hold the angles of a run against the plan's unit, and against the units it may have been confused with.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time in units of the Earth rate, ascending, with or without gaps.
    alpha : ndarray, shape (n, 2)
        Gimbal angles as declared, wrapped or not [rad].
    base : Base
        The base as it is meant to stand.

    Returns
    -------
    Judgement or None
        None where the record is too short to say anything.
    """
    if len(tau) < 2 * _FEWEST_ROWS:
        return None
    smooth = without_large_spikes(unwrapped(alpha), _LONGEST_SPIKE)
    declared = implied_earth_rate(tau, smooth, base)
    if declared is None:
        return None
    singular = np.mean(np.abs(smooth[:, 1]) >= np.pi / 2) > 0.01
    doubtful = bool(singular) or declared.off or declared.misfit > _DOUBTFUL
    for cause, factor in FACTORS.items():
        other = implied_earth_rate(tau, without_large_spikes(unwrapped(alpha * factor), _LONGEST_SPIKE), base)
        if other is None or not other.believed or other.misfit > _CLEAR:
            continue
        better = declared.misfit > _FITS / 2 and declared.misfit > _BETTER * other.misfit
        if singular or declared.off or better:
            return Judgement(declared, True, cause, other)
    return Judgement(declared, doubtful)


def unwrapped(alpha: Float) -> Float:
    """Angles without steps of whole turns; the inner one, which has no whole turns, about 0.

    Parameters
    ----------
    alpha : ndarray, shape (n, 2)
        [rad]

    Returns
    -------
    ndarray, shape (n, 2)
    """
    turned = np.unwrap(alpha, axis=0)
    turned[:, 1] -= 2 * np.pi * np.round(np.median(turned[:, 1]) / (2 * np.pi))
    return turned


def implied_earth_rate(tau: Float, alpha: Float, base: Base) -> Implied | None:
    """Fit ``Delta alpha = s int c + int F m`` to stretches of a run, in spite of jumps.

    Rows are weighted by noise and by what the model leaves out; that part does not average out over the
    record, so that all rows together tell no more than one with it.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time in units of the Earth rate, ascending.
    alpha : ndarray, shape (n, 2)
        Gimbal angles, unwrapped [rad].
    base : Base
        The base as it is meant to stand.

    Returns
    -------
    Implied or None
        None where there are fewer than ten stretches.
    """
    design, rates = _rows(tau, alpha, base)
    if len(rates) < _FEWEST_ROWS:
        return None
    typical = float(np.median(np.hypot(rates[:, 0], rates[:, 1])))
    if typical == 0:
        return None
    noise = _noise(rates)
    sigma = float(np.hypot(_MODEL * max(typical, _QUIET) * np.sqrt(rates.size), noise))
    columns = 1 + len(DRIFT)
    prior = np.array([_EARTH_SIGMA, *[_DRIFT_SIGMA] * len(DRIFT)])
    found, kept = _robust(design[:, :, :columns], rates, prior, sigma, _MODEL * typical)
    residual = (rates - design[:, :, :columns] @ found.estimate)[kept]
    misfit = np.sqrt(max(float(np.mean(residual**2)) - noise**2, 0.0)) / typical
    error = float(np.sqrt(found.covariance[0, 0]))
    return Implied(float(found.estimate[0]), error, float(misfit))


def nominal_parameters(tau: Float, alpha: Float, base: Base) -> Float:
    """Parameters p with which the linear model follows the angles best; to predict a step, no more.

    Parameters
    ----------
    tau, alpha, base
        As `implied_earth_rate`.

    Returns
    -------
    ndarray, shape (11,)
        In the order of `PARAMETERS`; 0 where there are too few samples.
    """
    design, rates = _rows(tau, alpha, base)
    if len(rates) < _FEWEST_ROWS:
        return np.zeros(len(PARAMETERS))
    prior = np.repeat([_DRIFT_SIGMA, _INSTALLATION_SIGMA], [len(DRIFT), len(PARAMETERS) - len(DRIFT)])
    sigma = max(_noise(rates), _FINEST)
    return _robust(design[:, :, 1:], rates - design[:, :, 0], prior, sigma, sigma)[0].estimate


def _robust(A: Float, b: Float, prior: Float, sigma: float, least: float) -> tuple[Solution, Mask]:
    """Solve rows (n, 2, k) without those that are outlying, by more than ``least``; which were kept."""
    kept = np.ones(len(b), dtype=np.bool_)
    names = [str(k) for k in range(A.shape[2])]
    for _ in range(3):
        found = solve(A[kept].reshape(-1, A.shape[2]), b[kept].ravel(), names, prior=prior, sigma=sigma)
        left = np.abs(b - A @ found.estimate).max(axis=1)
        used = kept
        kept = left <= max(_OUTLYING * MAD_TO_SIGMA * float(np.median(left[used])), least)
    return found, used


def _noise(rates: Float) -> float:
    """Standard deviation of the mean rate over a stretch, from how it bends from one to the next."""
    bends = np.abs(np.diff(rates, n=2, axis=0))
    return MAD_TO_SIGMA * float(np.median(bends)) / math.sqrt(6)


def _rows(tau: Float, alpha: Float, base: Base) -> tuple[Float, Float]:
    """Mean of (c, F) and mean rate over stretches: shapes (rows, 2, 12) and (rows, 2)."""
    nodes = np.unique(np.linspace(0, len(tau) - 1, min(len(tau), _NODES)).astype(np.int64))
    t, a = tau[nodes], alpha[nodes]
    c, F = linear_model(a, base)
    model = np.concatenate([c[:, :, np.newaxis], F], axis=2)
    if len(t) < 2 * _FEWEST_ROWS:
        return model[:0], a[:0]
    steps = LocalPolynomial(t, model.reshape(len(t), -1), 3).sample(t)[1][1:].reshape(-1, *model.shape[1:])
    length = max(1, min(_SEGMENT, len(steps) // _FEWEST_ROWS))
    ends = np.arange(0, len(t), length)
    span = np.diff(t[ends])
    integral = np.add.reduceat(steps[: ends[-1]], ends[:-1], axis=0)
    whole = span <= 3 * np.median(span)  # over a gap the integral says nothing
    rates = np.diff(a[ends], axis=0) / span[:, np.newaxis]
    return (integral / span[:, np.newaxis, np.newaxis])[whole], rates[whole]


def unexplained_steps(tau: Float, alpha: Float, at: Float, base: Base, p: Float) -> Float:
    """How far the angles move from sample to sample beyond what the linear model says.

    ``Delta alpha - int (c + F p)``, integrated by the local cubic: what the platform turns against the stars,
    about the gimbal's axes.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time in units of the Earth rate, ascending; at least four.
    alpha : ndarray, shape (n, 2)
        Gimbal angles, unwrapped [rad].
    at : ndarray, shape (n, 2)
        The same without spikes: where the model is evaluated.
    base : Base
        The base as it is meant to stand.
    p : ndarray, shape (11,)
        As far as it is known; see `nominal_parameters`.

    Returns
    -------
    ndarray, shape (n - 1, 2)
        [rad]; noise, spikes and jumps stand out from what is not known of p.
    """
    rates = np.empty_like(at)
    for k in range(0, len(at), _CHUNK):
        c, F = linear_model(at[k : k + _CHUNK], base)
        rates[k : k + _CHUNK] = c + F @ p
    _, turned = LocalPolynomial(tau, rates, 3).sample(tau)
    return np.asarray(np.diff(alpha, axis=0) - turned[1:], dtype=np.float64)
