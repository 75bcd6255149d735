"""The time offset between a gyro and the table it turns on.

Over the intervals [t_k, t_k+1] of the table's record the two tell the same angle ::

    y_k(tau) = K x_k + b Dt_k + e_k,      y_k(tau) = S(t_k+1 + tau) - S(t_k + tau)

x_k is the table's angle, S the integral of the gyro's output, tau the gyro's clock (and delay) minus the
table's. First guess: the lag with the greatest correlation. Estimate: instrumental variables made of the
table's record alone, ``z = (x', x, Dt)``, because the noise that interpolation leaves in y(tau) depends on
tau and makes half-sample offsets look better than they are to plain least squares (as
`pipeline.numerics.alignment_fit` has it). The residuals are whitened by an autoregression; the covariance is
``s^2 H^-1 (Z^T Z) H^-T``, ``H = Z^T A``.

Only where the rate changes is there anything to tell tau by: the ramps between steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import correlate, correlation_lags

from pipeline.models.rate_table_steps import Motion, RateTableError
from pipeline.numerics.whiteness import AutoRegression, fit_autoregression

Float = NDArray[np.float64]

_ITERATIONS = 30
_CONVERGED = 1e-3
"""Of the standard error: smaller steps do not matter."""
_FEWEST = 20
"""Intervals, for three unknowns and an autoregression."""
_FAINT = 3.0
"""Standard errors that the scale factor must come to, or the gyro did not follow this table."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How much later the gyro is than the table.

    Attributes
    ----------
    offset, standard_error : float
        The gyro's clock minus the table's [s].
    gain, gain_standard_error : float
        K, by the whole record, ramps included [out s/rad].
    """

    offset: float
    standard_error: float
    gain: float
    gain_standard_error: float


def time_offset(motion: Motion, time: Float, gyro: Float, *, longest: float) -> TimeOffset:
    """Estimate the offset from the whole record.

    Parameters
    ----------
    motion : Motion
        Of the table.
    time : ndarray, shape (n,)
        Of the gyro, strictly increasing, without a gap [s]; n at least 4.
    gyro : ndarray, shape (n,)
        The channel whose input axis is nearest to the table's axis.
    longest : float
        Largest offset that is looked for, either way [s].

    Raises
    ------
    RateTableError
        If the records overlap too little, the rate never changes, or the gyro does not follow the table.
    """
    cumulative = make_interp_spline(time, gyro, k=3).antiderivative()
    # The best crest may lie one interval beyond, and the spline needs its neighbours.
    margin = longest + 2 * float(np.median(np.diff(motion.time)) + np.median(np.diff(time)))
    inside = (motion.time >= time[0] + margin) & (motion.time <= time[-1] - margin)
    t, x = motion.time[inside], np.diff(motion.angle[inside])
    if len(t) <= _FEWEST:
        raise _untold(
            f"an overlap of {max(len(t) - 1, 0)} intervals", f"at least {_FEWEST} beside the offset"
        )
    length = np.diff(t)
    slope = np.gradient(x / length, (t[1:] + t[:-1]) / 2) * length
    if np.ptp(x / length) <= 1e-9 * np.abs(x / length).max():
        raise _untold("a constant rate", "a rate that changes")
    Z = np.stack([slope, x, length], axis=1)
    tau = _first_guess(t, x, time, gyro, longest)
    colour: AutoRegression | None = None
    for _ in range(_ITERATIONS):
        step, K, covariance, residual = _solved(t, x, Z, cumulative, tau, colour)
        tau = float(np.clip(tau + step, -longest, longest))
        colour = fit_autoregression([residual])
        errors = np.sqrt(np.diag(covariance))
        if abs(step) <= _CONVERGED * errors[0]:
            break
    else:
        raise _untold("an estimate that does not converge", "ramps that tell the offset")
    if not abs(K) > _FAINT * errors[1]:
        raise _untold(f"a gain of {K:.3g} with a standard error of {errors[1]:.3g}", "a gyro that follows it")
    return TimeOffset(tau, float(errors[0]), K, float(errors[1]))


def _solved(
    t: Float, x: Float, Z: Float, cumulative: BSpline, tau: float, colour: AutoRegression | None
) -> tuple[float, float, Float, Float]:
    """Step of tau, K, covariance of (tau, K, b), and the residual at tau."""
    length = np.diff(t)
    y = np.asarray(np.diff(cumulative(t + tau)), dtype=np.float64)
    turned = np.asarray(np.diff(cumulative(t + tau, 1)), dtype=np.float64)
    if not turned.any():
        raise _untold("an output that never changes", "a gyro that follows it")
    A = np.stack([-turned, x, length], axis=1)
    size = np.sqrt(np.sum(Z**2, axis=0))
    z, a, e = ((v if colour is None else colour.whiten(v)) for v in (Z / size, A / size, y))
    H = z.T @ a
    p = np.linalg.solve(H, z.T @ e)
    white = e - a @ p
    variance = float(white @ white) / (len(white) - 3)
    half = np.linalg.solve(H, z.T)
    covariance = variance * (half @ half.T) / np.outer(size, size)
    p = p / size
    return float(p[0]), float(p[1]), covariance, y - A @ p


def _first_guess(t: Float, x: Float, time: Float, gyro: Float, longest: float) -> float:
    """The lag of the greatest correlation, either sign of it [s]."""
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1], step)
    rate = np.interp(grid, (t[1:] + t[:-1]) / 2, x / np.diff(t))
    wide = np.arange(max(time[0], t[0] - longest), min(time[-1], t[-1] + longest), step)
    output = np.interp(wide, time, gyro)
    value = correlate(output - output.mean(), rate - rate.mean(), method="fft")
    lag = correlation_lags(len(output), len(rate)) * step + (wide[0] - grid[0])
    near = np.abs(lag) <= longest
    return float(lag[near][np.argmax(np.abs(value[near]))])


def _untold(found: str, expected: str) -> RateTableError:
    return RateTableError(
        "time offset",
        expected=expected,
        found=found,
        remedy="record ramps between the steps, or state the offset in the test plan",
    )
