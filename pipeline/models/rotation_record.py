"""The random error of a gyro on a turning table, held against what its model predicts of the integral.

Integrated along the axes of the room over whole turns the error is ``U = sum step x exp(i theta)``, theta the
table's angle. Over m windows of the length T::

    sum |U - mean U|^2 / (m - 1)  about  Var(T, omega),     times 2 (m - 1)/Var chi-square of 2 (m - 1)

Var of `pipeline.models.random_error_growth`: windows longer than the error's time constants are independent,
and over whole turns both components alike. What the Earth's rate and tilt do is a line at omega, and what the
table's errors do lines at its multiples: a constant and harmonics 1 to 3 of theta are taken out before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.models.random_error import RandomError
from pipeline.models.random_error_growth import variance

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

HARMONICS = 3
WINDOW = 600.0
"""Length of a window [s], to the nearest whole turn."""

_FEWEST_WINDOWS = 5
_FILLED = 0.98
"""Part of a window that must have samples: its variance is lowered by as much at most."""
_EVEN = 0.02
"""Part by which the rate of a window may differ from the mean one."""


@dataclass(frozen=True, slots=True)
class Demodulation:
    """The test of a model on a turning table.

    Attributes
    ----------
    rate : float
        Mean rate of the table [rad/s].
    windows : int
        m.
    length : float
        T [s].
    observed, predicted : float
        ``sum |U - mean U|^2 / (m - 1)`` and ``Var(T, omega)``, in the square of the error's unit times s^2.
    """

    rate: float
    windows: int
    length: float
    observed: float
    predicted: float

    @property
    def ratio(self) -> float:
        """Observed over predicted."""
        return self.observed / self.predicted

    @property
    def ratio_error(self) -> float:
        """Standard error of the ratio if the model is right."""
        return float(1 / np.sqrt(self.windows - 1))

    @property
    def probability(self) -> float:
        """Probability of a ratio as far from 1, on either side, if the model is right."""
        freedom = 2 * (self.windows - 1)
        below = float(chi2.cdf(freedom * self.ratio, freedom))
        return 2 * min(below, 1 - below)


def without_harmonics(rate: Float, angle: Float, observed: Mask, harmonics: int = HARMONICS) -> Float:
    """A rate without a constant and harmonics of the table's angle.

    Parameters
    ----------
    rate, angle : ndarray, shape (n,)
        The angle in rad, not wrapped.
    observed : ndarray of bool, shape (n,)
        Where there is a sample.
    harmonics : int
        Highest.

    Returns
    -------
    ndarray, shape (n,)
        0 where not observed.
    """
    k = np.arange(1, harmonics + 1)[:, np.newaxis]
    turns = k * angle[observed]
    A = np.vstack([np.ones((1, turns.shape[1])), np.cos(turns), np.sin(turns)])
    left = np.zeros(len(rate))
    x = rate[observed]
    left[observed] = x - np.linalg.solve(A @ A.T, A @ x) @ A
    return left


def demodulate(
    model: RandomError, error: Float, angle: Float, step: float, observed: Mask
) -> Demodulation | None:
    """Hold the error on a turning table against its model.

    Parameters
    ----------
    model : RandomError
    error : ndarray, shape (n,)
        Every step [s], `without_harmonics`; 0 where not observed.
    angle : ndarray, shape (n,)
        Of the table [rad], not wrapped.
    step : float
    observed : ndarray of bool, shape (n,)

    Returns
    -------
    Demodulation or None
        None where the table does not turn evenly for five windows or more.
    """
    rate = float((angle[-1] - angle[0]) / (step * (len(angle) - 1)))
    if rate == 0:
        return None
    turn = 2 * np.pi / abs(rate)
    window = max(1, round(WINDOW / turn)) * turn
    size = round(window / step)
    count = len(error) // size
    if count < _FEWEST_WINDOWS:
        return None
    shape = (count, size)
    turned = np.diff(angle[: count * size].reshape(shape)[:, [0, -1]], axis=1)[:, 0] / (step * (size - 1))
    if np.abs(turned / rate - 1).max() > _EVEN:
        return None
    U = step * (error * np.exp(1j * angle))[: count * size].reshape(shape).sum(axis=1)
    used = observed[: count * size].reshape(shape).mean(axis=1) >= _FILLED
    m = int(np.count_nonzero(used))
    if m < _FEWEST_WINDOWS:
        return None
    spread = float(np.sum(np.abs(U[used] - U[used].mean()) ** 2) / (m - 1))
    predicted = float(variance(model, np.array(size * step), rate))
    # of the readings between the first and the last e^(i theta) leaves what it turns by in a step
    predicted += (size - 1) * (2 * model.Q * np.sin(0.5 * rate * step)) ** 2
    return Demodulation(rate, m, size * step, spread, predicted)
