"""Whether a filter of navigation is as wrong as it says: errors and innovations over their covariances.

If the model is true, the squared error over its covariance (NEES) is chi-squared with as many degrees of
freedom as there are states, and the squared innovation over its covariance (NIS) with as many as there are
components. NEES takes the truth, which a simulation has; innovations of a consistent filter are white
besides, so that their NIS may be averaged over time as well (Y. Bar-Shalom, X.-R. Li, T. Kirubarajan,
*Estimation with Applications to Tracking and Navigation*, 2001, 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.models.ellipsoid import metres_between
from pipeline.models.navigation_problem import Navigation
from pipeline.numerics.rotation import (
    quaternion_conjugate,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]
Integer = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Truth:
    """What is true at the instants of a navigation.

    Attributes
    ----------
    position, velocity : ndarray, shape (N + 1, 3)
    attitude : ndarray, shape (N + 1, 4)
    gyro_bias, accelerometer_bias : ndarray, shape (N + 1, 3) or (3,)
        Each as in `Navigation`.
    """

    position: Float
    velocity: Float
    attitude: Float
    gyro_bias: Float
    accelerometer_bias: Float


def errors(navigation: Navigation, truth: Truth) -> Float:
    """True less estimated, shape (N + 1, 15), in the order of the filter's last fifteen states.

    Gyro bias [rad/s] and accelerometer bias [m/s^2] in body axes; attitude [rad], velocity [m/s] and
    position [m] in N, E, D.
    """
    turned = quaternion_multiply(truth.attitude, quaternion_conjugate(navigation.attitude))
    parts = (
        truth.gyro_bias - navigation.gyro_bias,
        truth.accelerometer_bias - navigation.accelerometer_bias,
        rotation_vector_from_quaternion(turned),
        truth.velocity - navigation.velocity,
        metres_between(navigation.position, truth.position),
    )
    return np.concatenate(parts, axis=1)


def normalised_squares(error: Float, factor: Float) -> Float:
    """NEES: squared error over its covariance.

    Parameters
    ----------
    error : ndarray, shape (K, m)
        At K nodes of a filter or smoother, of either sign; of `errors` m is 15.
    factor : ndarray, shape (K, n, >= m)
        Of the covariance there, by columns, of which those of the m errors are the last.

    Returns
    -------
    ndarray, shape (K,)
    """
    # F^T = Q R, P = F F^T = R^T R, e^T P^-1 e = |R^-T e|^2
    R = np.linalg.qr(factor[:, :, -error.shape[1] :]).R
    y = np.linalg.solve(R.transpose(0, 2, 1), error[:, :, np.newaxis])[:, :, 0]
    return np.asarray(np.sum(y * y, axis=1), dtype=np.float64)


def mean_band(degrees_of_freedom: int, count: int, probability: float = 0.95) -> tuple[float, float]:
    """Between which bounds the mean of ``count`` independent normalised squares lies with a probability."""
    tail = (1 - probability) / 2
    low, high = (float(chi2.ppf(p, degrees_of_freedom * count)) / count for p in (tail, 1 - tail))
    return low, high
