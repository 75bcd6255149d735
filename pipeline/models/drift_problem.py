"""What every method of identification is given, and what it gives back.

A `Problem` holds the runs of one gyro: the drift m and the tilt theta of the rotor are the same in all of
them, the misalignment of the base is each run's own. A run whose record is interrupted is several arcs, each
with its own initial angles. An `Estimate` holds the parameters under their names, with their covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import Base

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Parameter(NamedTuple):
    """A parameter: its name as in `gyro_drift.PARAMETERS`, and its run where it belongs to one.

    ``epsilon1`` to ``epsilon3`` are each run's own; ``m..`` and ``theta..`` have no run.
    """

    name: str
    run: int | None = None


class Prior(NamedTuple):
    """What is known of a parameter before the run: mean and standard deviation, in its SI unit."""

    mean: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Arc:
    """An uninterrupted stretch of a run on an even grid.

    Attributes
    ----------
    run : int
        Index of its run.
    tau : ndarray, shape (n,)
        Time from the run's first sample in units of the Earth rate, evenly spaced.
    alpha : ndarray, shape (n, 2)
        Gimbal angles, unwrapped [rad].
    measured : ndarray of bool, shape (n,)
        False where an angle was bridged or marked as an outlier: it serves to evaluate the model, and is no
        observation.
    neglected : ndarray, shape (n, 2), optional
        What the linear model lacks of the exact rates, where it is known: see `drift_relinearised`.
    """

    run: int
    tau: Float
    alpha: Float
    measured: Mask
    neglected: Float | None = None

    @property
    def step(self) -> float:
        """Interval of the grid, in units of the Earth rate."""
        return float((self.tau[-1] - self.tau[0]) / (len(self.tau) - 1))


@dataclass(frozen=True, slots=True)
class Problem:
    """The runs of one gyro.

    Attributes
    ----------
    bases : tuple of Base
        One a run: how the base is meant to stand.
    arcs : tuple of Arc
        In order of run and time.
    priors : mapping of str to Prior
        By the parameter's name, without run: m11 to mc2, theta1, theta2, and ``epsilon`` for the misalignment
        of each run, of mean 0 and the same in all directions (of Delta chi, and so of epsilon across u). A
        parameter that is not in it has no prior.
    installation : bool
        Whether the installation errors theta and epsilon are unknown; else they are taken as zero.
    """

    bases: tuple[Base, ...]
    arcs: tuple[Arc, ...]
    priors: Mapping[str, Prior] = field(default_factory=dict)
    installation: bool = True


@dataclass(frozen=True, slots=True)
class Estimate:
    """Parameters with their uncertainty, and the trajectory that they predict.

    Attributes
    ----------
    method : str
        As in the test plan.
    parameters : tuple of Parameter
        In the order of ``value``.
    value : ndarray, shape (k,)
        m in units of the Earth rate [1], angles [rad].
    covariance : ndarray, shape (k, k)
        Singular where parameters are bound to each other: ``u.epsilon = 0``.
    sigma : float
        Standard deviation of one angle [rad], as given or from the residuals.
    predicted : tuple of ndarray, each of shape (n, 2)
        Angles of each arc by the model with these parameters [rad].
    figures : mapping of str to float
        What else the method tells: ``condition``, ``iterations``, ``decay`` ...
    notes : tuple of str
        What is to be said of it: that it did not converge, and why.
    """

    method: str
    parameters: tuple[Parameter, ...]
    value: Float
    covariance: Float
    sigma: float
    predicted: tuple[Float, ...]
    figures: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def standard_errors(self) -> Float:
        """Of each parameter, shape (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def of(self, names: Sequence[str], run: int | None = None) -> Float:
        """Values of parameters by name; those of a run for the names that are a run's own."""
        index = {p: k for k, p in enumerate(self.parameters)}
        own = ("epsilon", "delta_chi")
        return np.array([self.value[index[Parameter(n, run if n.startswith(own) else None)]] for n in names])
