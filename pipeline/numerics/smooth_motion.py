"""The smooth motion ``a t + b`` before a vibration begins, carried on beyond it.

Source: Godorov & Lutmanov, *Problems of Mechanics and Control* 48 (2016), section 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.noise_model import ordinary_least_squares
from pipeline.numerics.trend import Trend, harmonic
from pipeline.numerics.vibration import harmonic_design

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SmoothMotion:
    """A straight line ``a t + b``, and how well it is known.

    Attributes
    ----------
    a, b : float
        Slope, rad/s, and value at t = 0, rad.
    end : float
        Time at which it stops being the whole motion, s.
    a_standard_error : float
        Of the slope, rad/s.
    end_standard_error : float
        Of the line at ``end``, against the random walk there, rad.
    """

    a: float
    b: float
    end: float
    a_standard_error: float
    end_standard_error: float

    def __call__(self, t: Vector) -> Vector:
        """Value at the times t, rad."""
        return self.a * t + self.b

    def standard_error(self, t: float) -> float:
        """Standard error of the value at a time not before ``end``, rad."""
        return float(np.hypot(self.end_standard_error, self.a_standard_error * (t - self.end)))


def fit_smooth_motion(t: Vector, y: Vector, end: float, block: int) -> SmoothMotion:
    """The straight line of least squares, with standard errors by the noise of its residual.

    Parameters
    ----------
    t : (n,) array
        Uniform times before ``end``, s.
    y : (n,) array
        The angle, rad.
    end : float
        Time at which the vibration begins, s.
    block : int
        As `trend.harmonic`.

    Returns
    -------
    SmoothMotion

    Raises
    ------
    pipeline.numerics.trend.TooFewRowsError
        As `trend.harmonic`.
    """
    since = t - t[0]
    b, a = ordinary_least_squares(harmonic_design(since, None, 0), y)
    noise = harmonic(since, y, None, 0, block)
    slope_error, end_error = _standard_errors(since, end - t[0], noise)
    return SmoothMotion(float(a), float(b - a * t[0]), end, slope_error, end_error)


def _standard_errors(t: Vector, end: float, noise: Trend) -> tuple[float, float]:
    """Standard errors of the slope, and of the line at ``end`` against the random walk there.

    The line is linear in the rows. A step of the random walk at row i moves every row from i on, and the
    walk at ``end``.
    """
    weights = np.linalg.pinv(harmonic_design(t, None, 0))  # (2, n): b, a
    slope, value = weights[1], weights[0] + end * weights[1]
    slope_steps = np.cumsum(slope[::-1])[::-1][1:]
    value_steps = np.cumsum(value[::-1])[::-1][1:] - 1.0
    white = noise.white_angle_noise**2
    walk = noise.angle_random_walk**2 * t[1]
    slope_variance = white * (slope @ slope) + walk * (slope_steps @ slope_steps)
    value_variance = white * (value @ value) + walk * (value_steps @ value_steps)
    return float(np.sqrt(slope_variance)), float(np.sqrt(value_variance))
