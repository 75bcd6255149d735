"""Clock offset and mounting rotation between two sensors of one rotation.

A gyro in a case measures the rate y in case axes by its own clock; a reference gives the attitude in body
axes. Over the interval [t_k, t_k+1] of the reference the two tell the same rotation::

    x_k = C y_k(tau) + b Dt_k + e_k,      y_k(tau) = S(t_k+1 + tau) - S(t_k + tau)

x_k is the integral of the body rate that the reference's attitudes imply, S the cumulative angle of the gyro,
tau the gyro's clock minus the reference's, C = Exp(rho) the rotation from case to body axes, b a constant
rate that only the gyro has. Comparing integrals, no recorded rate is differentiated and no attitude.

First guess: the lag with the greatest normalised correlation. Where C is known, its size is the trace of the
cross-correlation matrix B(tau) = sum x y(tau)^T; where it is not, the greatest value of tr(C^T B) over all
rotations, Wahba's problem. With q the quaternion of C that is q^T K q (Davenport; Markley, *Journal of the
Astronautical Sciences* 36, 245, 1988), and its maximum the greatest eigenvalue of ::

    K = | tr B   z^T             |      z = (B32 - B23, B13 - B31, B21 - B12)
        | z      B + B^T - tr B  |

Estimate: `pipeline.numerics.alignment_fit`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import BSpline, make_interp_spline

from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Increments:
    """Integrals of the rate from ``start`` to ``stop`` [s], shapes (n,).

    ``angle`` [rad], shape (n, 3), is in body axes; ``axes``, shape (n, 3, 3), takes it to the reference axes.
    """

    start: Float
    stop: Float
    angle: Float
    axes: Float

    @property
    def length(self) -> Float:
        """Length of each interval [s]."""
        return self.stop - self.start

    def only(self, mask: Bool) -> Increments:
        """The intervals where the mask is true."""
        return Increments(self.start[mask], self.stop[mask], self.angle[mask], self.axes[mask])


def integrals_of_rate(time: Float, quaternion: Float) -> Increments:
    """Integrals of the body rate from each attitude to the next.

    The rotation vector phi_k of an interval exceeds the integral by ``1/2 int alpha × w dt`` (Bortz, *IEEE
    Transactions on Aerospace and Electronic Systems* 7(1), 1971), which for a linear rate is
    ``phi_k × (phi_k+1 - phi_k-1) / 24``. Left in, it turns the mounting by some 1e-5 rad.

    Parameters
    ----------
    time : ndarray, shape (n + 1,)
        Strictly increasing [s], n at least 2.
    quaternion : ndarray, shape (n + 1, 4)
        Body to reference.
    """
    between = quaternion_multiply(quaternion_conjugate(quaternion[:-1]), quaternion[1:])
    turn = rotation_vector_from_quaternion(between)
    middle = quaternion_multiply(quaternion[:-1], quaternion_from_rotation_vector(turn / 2))
    angle = np.asarray(turn - np.cross(turn, np.gradient(turn, axis=0)) / 12, dtype=np.float64)
    return Increments(time[:-1], time[1:], angle, matrix_from_quaternion(middle))


@dataclass(frozen=True, slots=True)
class Cumulative:
    """The cumulative angle S of a gyro as a quintic spline, with its derivative, and the raw nodes."""

    time: Float
    """Strictly increasing [s], shape (m,)."""
    angle: Float
    """S at the nodes [rad], shape (m, 3)."""
    spline: BSpline

    @staticmethod
    def of_rates(time: Float, rates: Float) -> Cumulative:
        """From rates (m, 3) [rad/s], m at least 6."""
        spline = make_interp_spline(time, rates, k=5).antiderivative()
        return Cumulative(time, np.asarray(spline(time), dtype=np.float64), spline)

    @staticmethod
    def of_increments(time: Float, increments: Float) -> Cumulative:
        """From the angles turned since the sample before (m, 3) [rad], m at least 6."""
        angle = np.cumsum(increments, axis=0)
        return Cumulative(time, angle, make_interp_spline(time, angle, k=5))

    def over(self, start: Float, stop: Float) -> Float:
        """S(stop) - S(start), shape (n, 3)."""
        return np.asarray(self.spline(stop) - self.spline(start), dtype=np.float64)

    def rate_change(self, start: Float, stop: Float) -> Float:
        """S'(stop) - S'(start), shape (n, 3)."""
        return np.asarray(self.spline(stop, 1) - self.spline(start, 1), dtype=np.float64)


def covered(reference: Increments, time: Float, offset: float, longest: float, margin: float) -> Bool:
    """Intervals of the reference over which the gyro, ``offset`` later, has samples without a gap.

    Parameters
    ----------
    reference : Increments
        Intervals [s].
    time : ndarray, shape (m,)
        The gyro's samples [s].
    offset, longest, margin : float
        The gyro's clock minus the reference's; the longest interval of either that is no gap; the distance to
        be kept from gaps and ends, where a spline is poor [s].
    """
    begin, end = reference.start + offset - margin, reference.stop + offset + margin
    first = np.searchsorted(time, begin, side="right") - 1
    last = np.searchsorted(time, end, side="left")
    inside = (first >= 0) & (last < len(time))
    gaps_before = np.concatenate([[0], np.cumsum(np.diff(time) > longest)])
    first, last = np.maximum(first, 0), np.minimum(last, len(time) - 1)
    whole: Bool = inside & (gaps_before[first] == gaps_before[last]) & (reference.length <= longest)
    return whole


@dataclass(frozen=True, slots=True)
class Correlation:
    """Normalised correlation of reference and gyro at each lag [s] of the gyro's clock."""

    lag: Float
    value: Float
    """In [-1, 1]; -1 where the records overlap too little."""

    @property
    def best(self) -> int:
        """Index of the greatest value."""
        return int(np.argmax(self.value))

    def within(self, longest: float) -> Correlation:
        """The lags up to ``longest`` either way [s]."""
        near = np.abs(self.lag) <= longest
        return Correlation(self.lag[near], self.value[near])

    def crests(self, share: float) -> Float:
        """Lags of the crests of at least ``share`` of the greatest value [s].

        Their heights are those of the parabola through three lags, since a crest seldom falls on a lag.
        """
        v = self.value
        at = np.flatnonzero((v[1:-1] >= v[:-2]) & (v[1:-1] > v[2:]) & (v[:-2] > -1) & (v[2:] > -1)) + 1
        slope, bend = (v[at + 1] - v[at - 1]) / 2, 2 * v[at] - v[at + 1] - v[at - 1]
        height = v[at] + slope**2 / (2 * bend)
        lags: Float = self.lag[at[height >= share * height.max(initial=-1.0)]]
        return lags


def correlation(reference: Increments, gyro: Cumulative, longest: float, *, rotated: bool) -> Correlation:
    """Correlate at every lag that leaves the records a quarter of the shorter one in common.

    Parameters
    ----------
    reference, gyro
        The two records; without a gap, or with gaps in which both are taken to stand still.
    longest : float
        The largest lag wanted either way [s].
    rotated : bool
        Whether the gyro's axes are turned by an unknown rotation (Wahba's gain in place of the trace).
    """
    step = float(np.median(reference.length))
    begin = min(reference.start[0], gyro.time[0])
    count = int(np.ceil((max(reference.stop[-1], gyro.time[-1]) - begin) / step)) + 1
    grid = begin + step * np.arange(count + 1)
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(reference.angle, axis=0)])
    x, in_x = _on_grid(grid, np.append(reference.start, reference.stop[-1]), turned)
    y, in_y = _on_grid(grid, gyro.time, gyro.angle)
    reach = min(int(np.ceil(longest / step)) + 1, count - 1)
    size = next_fast_len(count + reach + 1, real=True)

    def crossed(u: Float, v: Float) -> Float:
        product = np.conj(rfft(u, size, axis=0))[:, :, None] * rfft(v, size, axis=0)[:, None, :]
        whole = irfft(product, size, axis=0)
        return np.asarray(np.concatenate([whole[size - reach :], whole[: reach + 1]]), dtype=np.float64)

    matrix = crossed(x, y)  # B(lag) = sum x y(lag)^T
    ones_x, ones_y = in_x[:, None].astype(np.float64), in_y[:, None].astype(np.float64)
    power_x = crossed(np.sum(x * x, axis=1, keepdims=True), ones_y)[:, 0, 0]
    power_y = crossed(ones_x, np.sum(y * y, axis=1, keepdims=True))[:, 0, 0]
    common = crossed(ones_x, ones_y)[:, 0, 0]
    usable = (common > 0.25 * min(in_x.sum(), in_y.sum())) & (power_x > 0) & (power_y > 0)
    trace = np.trace(matrix, axis1=1, axis2=2)
    gain = np.linalg.eigvalsh(_davenport(matrix))[:, 3] if rotated else trace
    value = np.full(len(gain), -1.0)
    value[usable] = gain[usable] / np.sqrt(power_x[usable] * power_y[usable])
    return Correlation(step * np.arange(-reach, reach + 1, dtype=np.float64), value)


def _on_grid(grid: Float, time: Float, angle: Float) -> tuple[Float, Bool]:
    """Increments on a uniform grid less their mean, 0 outside the record; and where the record is."""
    at = np.stack([np.interp(grid, time, angle[:, axis]) for axis in range(3)], axis=1)
    inside = (grid[:-1] >= time[0] - 1e-9) & (grid[1:] <= time[-1] + 1e-9)
    steps = np.diff(at, axis=0)
    return np.where(inside[:, None], steps - steps[inside].mean(axis=0), 0.0), inside


def _davenport(matrix: Float) -> Float:
    """K of each B, shape (..., 4, 4)."""
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    transposed = np.swapaxes(matrix, -1, -2)
    k = np.empty((*matrix.shape[:-2], 4, 4))
    k[..., 0, 0] = trace
    k[..., 1:, 1:] = matrix + transposed - trace[..., None, None] * np.eye(3)
    k[..., 0, 1:] = k[..., 1:, 0] = (matrix - transposed)[..., [2, 0, 1], [1, 2, 0]]
    return k


def wahba(matrix: Float) -> Float:
    """The quaternion of the rotation C that takes y to x best, for B = sum x y^T, shape (3, 3).

    Raises
    ------
    ValueError
        If the two greatest eigenvalues of K agree: all rotation is about one axis, or opposite about two.
    """
    value, vector = np.linalg.eigh(_davenport(matrix))
    if not value[3] - value[2] > 1e-9 * value[3]:
        raise ValueError("all rotation is about one axis")
    best: Float = vector[:, 3]
    return best


def gain(reference: Increments, gyro: Cumulative) -> tuple[float, float]:
    """How large the gyro's rotation is against the reference's, whatever the axes of its case.

    Fits ``y = M x`` by least squares with any 3 by 3 matrix M.

    Returns
    -------
    gain : float
        Root mean square of M x over that of x.
    determined : float
        Part of the gyro's mean square that M x explains: near 0 when noise or a bias is all there is.
    """
    y, x = gyro.over(reference.start, reference.stop), reference.angle
    fitted = x @ np.linalg.lstsq(x, y, rcond=1e-6)[0]
    power = [float(np.sum(v * v)) for v in (fitted, x, y)]
    if power[1] == 0.0 or power[2] == 0.0:
        return float("nan"), 0.0
    return float(np.sqrt(power[0] / power[1])), power[0] / power[2]
