"""Records of a rate table with known truth: trapezoids of rate, a gyro on it, noise white and coloured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.rate_table_steps import Motion

Float = NDArray[np.float64]

DEGREE = np.pi / 180
RAMP = 5.0
TO_CASE = {
    1: np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    2: np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    3: np.eye(3),
}
"""From rotor to case, with axis 1, 2 or 3 of the case along the table's axis."""


def corners(rates: Float, hold: float, ramp: float = RAMP) -> Float:
    """Corners (time, rate) of a record that begins at rest, ramps to each rate and holds it, shape (k, 2)."""
    begin = (hold + ramp) * np.arange(len(rates)) + ramp
    inner = np.stack([np.stack([begin, rates], 1), np.stack([begin + hold, rates], 1)], 1).reshape(-1, 2)
    return np.concatenate([[[0.0, 0.0]], inner])


def table(at: Float, step: float) -> tuple[Float, Float, Float]:
    """Time, rate and angle of the table; the angle is exact where the corners fall on samples."""
    time = np.arange(0.0, at[-1, 0], step)
    rate = np.interp(time, at[:, 0], at[:, 1])
    return time, rate, Motion.of_rate(time, rate).angle


def white(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> Float:
    return sigma * rng.standard_normal(shape)


def coloured(
    rng: np.random.Generator, shape: tuple[int, ...], sigma: float, correlation_time: float, step: float
) -> Float:
    """Exponentially correlated along axis 0, stationary from the first sample: an exact AR(1)."""
    phi = np.exp(-step / correlation_time)
    drive = white(rng, shape, sigma * np.sqrt(1 - phi**2))
    drive[0] /= np.sqrt(1 - phi**2)
    return np.asarray(lfilter([1.0], [1.0, -phi], drive, axis=0))
