"""The time offset between a gyro and the table it turns on.

Over the intervals [t_k, t_k+1] of the table's record the two tell the same angle ::

    y_k(tau) = f(r_k) Dt_k + e_k,      y_k(tau) = S(t_k+1 + tau) - S(t_k + tau)

r_k is the table's mean rate, S the integral of the gyro's output, tau the gyro's clock (and delay) minus the
table's, and f what a gyro makes of a rate: a bias that may drift, a scale factor, its asymmetry, and terms of
second and third order. First guess: the lag with the greatest correlation. Estimate: an instrumental variable
made of the table's record alone, z = r' less its projection on the columns of f, for which ::

    sum z_k y_k(tau) = 0

because the noise that interpolation leaves in y(tau) depends on tau and makes half-sample offsets look better
than they are to plain least squares (as `pipeline.numerics.alignment_fit` has it). By an autoregression of
the residuals the variance is ``|G^T z|^2 s^2 / (sum z y')^2``, G the response of noise to the white noise
behind it.

Only where the rate changes is there anything to tell tau by: the ramps between steps. What samples tell of
the rate between them is exact on a ramp, and wrong about its corners by much more than the noise, though by
nearly as much in either direction. So corners are left out, as gaps are: the intervals that an interpolation
across a corner reaches. Where ramps are so short that it reaches all of them, they are left in, and what may
be missed of each is counted: of its angle ``J h^2 B_2(theta) / 2``, as the trapezoidal rule of step h misses
of a function whose slope changes by J at the part theta of a step, any theta as likely as another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PPoly
from scipy.signal import correlate, correlation_lags, lfilter

from pipeline.models.rate_table_steps import Motion, RateTableError
from pipeline.numerics.sampling import MAD_TO_SIGMA
from pipeline.numerics.whiteness import AutoRegression, fit_autoregression

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ITERATIONS = 30
_CONVERGED = 1e-9
"""Of a nominal interval of the gyro: smaller steps do not matter."""
_FEWEST = 20
"""Intervals, for the columns of f, the offset and an autoregression."""
_FAINT = 3.0
"""Standard errors that the scale factor must come to, or the gyro did not follow this table."""
_LONGEST = 3.0
"""Nominal intervals; a longer one is a gap."""
_REACH = 3.0
"""Nominal intervals of the gyro, to either side: two that an interpolation takes, and what a mean is over."""
_BENT = 6.0
"""Standard deviations of the change of acceleration from which on it is a corner."""
_RAMP = 0.1
"""Of the largest acceleration: that of a ramp is more."""
_MISSED = 720**-0.5
"""Root mean square of B_2(theta) / 2 over theta from 0 to 1."""
_ROUNDING = 1e-9
"""Of the largest acceleration, or of a column: what is less is none."""
_PASSES = 2
"""By the first the offset is known to less than an interval, by which what is left out is found again."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How much later the gyro is than the table.

    Attributes
    ----------
    offset, standard_error : float
        The gyro's clock minus the table's [s].
    gain, gain_standard_error : float
        Slope of f by the whole record, ramps included [out s/rad].
    """

    offset: float
    standard_error: float
    gain: float
    gain_standard_error: float


def time_offset(motion: Motion, time: Float, gyro: Float, *, longest: float) -> TimeOffset:
    """Estimate the offset from the whole record, gaps of either side left out.

    Parameters
    ----------
    motion : Motion
        Of the table.
    time : ndarray, shape (n,)
        Of the gyro, strictly increasing [s]; n at least 4.
    gyro : ndarray, shape (n,)
        The channel whose input axis is nearest to the table's axis.
    longest : float
        Largest offset that is looked for, either way [s].

    Raises
    ------
    RateTableError
        If the records overlap too little, the rate never changes, or the gyro does not follow the table.
    """
    step = float(np.median(np.diff(time)))
    turns = _Turns.of(motion, time, longest + 2 * step)
    output = CubicHermiteSpline(time, gyro, np.gradient(gyro, time)).antiderivative()
    long = np.flatnonzero(np.diff(time) > _LONGEST * step)
    gaps = np.stack([time[long], time[long + 1]], axis=1)
    tau = _first_guess(turns, time, gyro, longest)
    for _ in range(_PASSES):
        clear = turns.whole & ~turns.touched(gaps - tau, _REACH * step)
        smooth = clear & ~turns.touched(turns.corners, _REACH * step)
        chosen = [kept for kept in (smooth, clear) if np.count_nonzero(kept) > _FEWEST]
        told = [one for one in (_estimated(turns, kept, output, tau, longest) for kept in chosen) if one]
        if not told:
            raise _untold("an estimate that does not converge", "ramps that tell the offset")
        best = min(told, key=lambda one: one.standard_error)
        tau = best.offset
    if not abs(best.gain) > _FAINT * best.gain_standard_error:
        found = f"a gain of {best.gain:.3g} with a standard error of {best.gain_standard_error:.3g}"
        raise _untold(found, "a gyro that follows it")
    return best


@dataclass(frozen=True, slots=True)
class _Turns:
    """The table's record by intervals.

    Attributes
    ----------
    start, stop : ndarray, shape (n,)
        [s].
    angle, slope : ndarray, shape (n,)
        By which it turned [rad], and the change of that with time [rad/s].
    whole : ndarray of bool, shape (n,)
        No gap.
    bend : ndarray, shape (n,)
        Change of the acceleration, 0 where it is the noise of a rate held [rad/s^2].
    corner : ndarray of bool, shape (n,)
        Where it is more than the noise on ramps too.
    """

    start: Float
    stop: Float
    angle: Float
    slope: Float
    whole: Mask
    bend: Float
    corner: Mask

    @classmethod
    def of(cls, motion: Motion, time: Float, margin: float) -> Self:
        """The intervals that a gyro's record covers at any offset within the margin [s]."""
        # The best crest may lie one interval beyond.
        margin += 2 * float(np.median(np.diff(motion.time)))
        inside = (motion.time >= time[0] + margin) & (motion.time <= time[-1] - margin)
        t, angle = motion.time[inside], np.diff(motion.angle[inside])
        if len(t) <= _FEWEST:
            found = f"an overlap of {max(len(t) - 1, 0)} intervals"
            raise _untold(found, f"at least {_FEWEST} beside the offset")
        length, middle = np.diff(t), (t[1:] + t[:-1]) / 2
        rate = angle / length
        if np.ptp(rate) <= _ROUNDING * np.abs(rate).max():
            raise _untold("a constant rate", "a rate that changes")
        return cls(
            t[:-1],
            t[1:],
            angle,
            np.gradient(rate, middle) * length,
            length <= _LONGEST * float(np.median(length)),
            *_bends(rate, middle),
        )

    @property
    def length(self) -> Float:
        """Of each interval [s]."""
        return self.stop - self.start

    @property
    def corners(self) -> Float:
        """Start and stop of the intervals with a corner, shape (m, 2) [s]."""
        return np.stack([self.start[self.corner], self.stop[self.corner]], axis=1)

    @property
    def columns(self) -> Float:
        """Those of f, shape (n, 6), each of unit size at its largest."""
        rate, length = self.angle / self.length, self.length
        rate = rate / np.abs(rate).max()
        late = np.linspace(-1.0, 1.0, len(rate))
        parts = [np.ones_like(rate), late, rate, late * rate, np.abs(rate), rate**2, rate**3]
        of_unit_rate = length / length.max()
        return np.asarray(np.stack(parts, axis=1) * of_unit_rate[:, np.newaxis], dtype=np.float64)

    def touched(self, stretches: Float, reach: float) -> Mask:
        """Which intervals come within reach of any of the stretches, shape (n,).

        Parameters
        ----------
        stretches : ndarray, shape (m, 2)
            Start and stop, in order, none within another [s].
        reach : float
            [s].
        """
        begun = np.searchsorted(stretches[:, 0], self.stop + reach, side="left")
        over = np.searchsorted(stretches[:, 1], self.start - reach, side="right")
        return np.asarray(begun > over, dtype=np.bool_)


def _estimated(turns: _Turns, kept: Mask, output: PPoly, tau: float, longest: float) -> TimeOffset | None:
    """The offset by some of the intervals; None where it does not converge."""
    basis = _orthonormal(turns.columns[kept])
    z = _less(turns.slope[kept], basis)
    start, stop = turns.start[kept], turns.stop[kept]
    step = float(np.median(np.diff(output.x)))
    for _ in range(_ITERATIONS):
        turned = output(stop + tau, 1) - output(start + tau, 1)
        if not turned.any():
            raise _untold("an output that never changes", "a gyro that follows it")
        y = np.asarray(output(stop + tau) - output(start + tau), dtype=np.float64)
        before, pull = tau, float(z @ turned)
        if not abs(pull) > _ROUNDING * float(np.linalg.norm(z) * np.linalg.norm(turned)):
            return None
        tau = float(np.clip(tau - (z @ y) / pull, -longest, longest))
        if abs(tau - before) <= _CONVERGED * step:
            break
    else:
        return None
    e = np.zeros(len(kept))
    e[kept] = _less(y, basis)
    colour = fit_autoregression([e], [kept])
    white = e[kept] if colour is None else colour.whiten(e, kept)
    freedom = 1 - (basis.shape[1] + 1) / len(y)
    sigma = float(np.sqrt(white @ white / max(len(white), 1) / freedom))
    whole = np.zeros(len(kept))
    whole[kept] = z
    x, length = turns.angle[kept], turns.length[kept]
    by_turn = _less(x, length[:, np.newaxis] / np.linalg.norm(length))
    power = float(by_turn @ x)
    gain = float(by_turn @ y) / power
    missed = abs(gain) * _MISSED * step**2 * float(np.linalg.norm(_nearby(whole) * turns.bend * kept))
    return TimeOffset(
        tau,
        float(np.hypot(sigma * _response(z, kept, colour), missed)) / abs(pull),
        gain,
        sigma * _response(by_turn, kept, colour) / power,
    )


def _bends(rate: Float, middle: Float) -> tuple[Float, Mask]:
    """Change of the acceleration, and where it is a corner, each of shape (n,)."""
    acceleration = np.diff(rate) / np.diff(middle)
    bend, size = np.abs(np.diff(acceleration)), np.abs(acceleration[1:])
    least = _ROUNDING * float(size.max())
    # An encoder in counts may have no noise at all at a rate held, and have it on ramps.
    held, ramp = (float(np.median(part)) for part in (bend, bend[size > _RAMP * size.max()]))
    beyond = [bend > max(_BENT * MAD_TO_SIGMA * usual, least) for usual in (held, max(held, ramp))]
    return np.pad(np.where(beyond[0], bend, 0.0), 1), np.pad(beyond[1], 1)


def _nearby(z: Float) -> Float:
    """The largest size in an interval and its neighbours, shape (n,)."""
    size = np.pad(np.abs(z), 1)
    return np.asarray(np.maximum(np.maximum(size[:-2], size[2:]), size[1:-1]), dtype=np.float64)


def _response(z: Float, kept: Mask, colour: AutoRegression | None) -> float:
    """``|G^T z|``: standard deviation of ``sum z e`` for white noise of unit variance behind e."""
    if colour is None:
        return float(np.linalg.norm(z))
    # G^T runs backwards in time, and on before the first interval until what is left of it does not matter.
    whole = np.zeros(len(kept) + colour.memory)
    whole[colour.memory :][kept] = z
    return float(np.linalg.norm(lfilter([1.0], np.concatenate([[1.0], -colour.coefficients]), whole[::-1])))


def _orthonormal(columns: Float) -> Float:
    """Of the space of the columns, shape (n, r)."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, s > _ROUNDING * s[0]], dtype=np.float64)


def _less(values: Float, basis: Float) -> Float:
    """The values less their projection on orthonormal columns."""
    return np.asarray(values - basis @ (basis.T @ values), dtype=np.float64)


def _first_guess(turns: _Turns, time: Float, gyro: Float, longest: float) -> float:
    """The lag of the greatest correlation, either sign of it [s]."""
    first, last = float(turns.start[0]), float(turns.stop[-1])
    step = float(np.median(turns.length))
    grid = np.arange(first, last, step)
    rate = np.interp(grid, (turns.start + turns.stop) / 2, turns.angle / turns.length)
    wide = np.arange(max(time[0], first - longest), min(time[-1], last + longest), step)
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
