"""The states of the error-state filter of navigation: which there are, where they stand, how each moves.

The error is true less estimated: ``true position = estimate displaced by p``, ``v_true = v + δv``,
``C_true = exp([φ x]) C``, biases and the rest likewise. The last fifteen states are always there: gyro bias,
accelerometer bias (body axes), φ, δv, δp (N, E, D). Before them stand those that nothing but their own noise
moves; constants first, because the factor of the covariance then has fewer elements to turn.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.navigation_filter_settings import ColouredErrors, FilterSettings, GaussMarkov
from pipeline.models.navigation_problem import AidName

Float = NDArray[np.float64]
Integer = NDArray[np.int64]

SLOTS = (
    "hard_iron",
    "airspeed_scale",
    "airspeed_bias",
    "attitude_bias",
    "barometer_bias",
    "wind",
    "wind_change",
    "gust",
    "position_colour",
    "attitude_colour",
)
"""Groups of states that may stand before the fifteen, in this order."""

FIFTEEN = ("gyro_bias", "accelerometer_bias", "attitude", "velocity", "position")
"""The last fifteen states: groups of three."""


@dataclass(frozen=True, slots=True)
class Group:
    """States of one kind.

    Attributes
    ----------
    size : int
    sigma : float
        At the start.
    walk : float
        Standard deviation gathered in a second; 0 where the state is constant.
    time_constant : float
        Of a Gauss-Markov state [s], else infinite.
    """

    size: int
    sigma: float
    walk: float = 0.0
    time_constant: float = math.inf


@dataclass(frozen=True, slots=True)
class States:
    """Where the states stand and how those before the fifteen move.

    Attributes
    ----------
    groups : dict of str to slice
        All groups of states, in the order in which they stand.
    slots : ndarray of int, shape (10,)
        First state of each of `SLOTS`; -1 where there is none.
    start : ndarray, shape (n,)
        Standard deviations of all n states at the start.
    walk, stationary, rate : ndarray, shape (n - 9,)
        Of the states before φ: standard deviation that a random walk gathers in a second; that of a
        Gauss-Markov state; and the inverse of its time constant [1/s].
    """

    groups: dict[str, slice]
    slots: Integer
    start: Float
    walk: Float
    stationary: Float
    rate: Float

    def __len__(self) -> int:
        """How many states."""
        return len(self.start)


def states_of(settings: FilterSettings, aids: Collection[AidName]) -> States:
    """The states that the settings ask for and the aids need."""
    before = _before(settings, settings.coloured or ColouredErrors(), aids)
    start, noise = settings.start, settings.noise
    last = {
        "gyro_bias": Group(3, start.gyro_bias, noise.gyro_bias),
        "accelerometer_bias": Group(3, start.accelerometer_bias, noise.accelerometer_bias),
        "attitude": Group(3, start.tilt),
        "velocity": Group(3, start.velocity),
        "position": Group(3, start.position),
    }
    groups = {name: before[name] for name in SLOTS if name in before} | last
    ends = np.cumsum([group.size for group in groups.values()])
    where = {n: slice(int(e) - g.size, int(e)) for (n, g), e in zip(groups.items(), ends, strict=True)}
    own = [group for name, group in groups.items() if name not in ("attitude", "velocity", "position")]
    sigma = np.repeat([g.sigma for g in groups.values()], [g.size for g in groups.values()])
    sigma[where["attitude"].stop - 1] = start.yaw
    sizes = [group.size for group in own]
    return States(
        groups=where,
        slots=np.array([where[name].start if name in where else -1 for name in SLOTS], dtype=np.int64),
        start=sigma,
        walk=np.repeat([group.walk for group in own], sizes),
        stationary=np.repeat([g.sigma if math.isfinite(g.time_constant) else 0.0 for g in own], sizes),
        rate=np.repeat([1 / group.time_constant for group in own], sizes),
    )


def _before(settings: FilterSettings, c: ColouredErrors, aids: Collection[AidName]) -> dict[str, Group]:
    """Groups that stand before the fifteen."""
    start, noise = settings.start, settings.noise
    groups: dict[str, Group] = {}
    if settings.states == 18:
        groups["barometer_bias"] = Group(1, start.barometer_bias, noise.barometer_bias)
        groups["wind"] = Group(2, start.wind, noise.wind)
    if "magnetic_field" in aids and c.hard_iron > 0:
        groups["hard_iron"] = Group(3, c.hard_iron)
    if "airspeed" in aids:
        if c.airspeed_scale > 0:
            groups["airspeed_scale"] = Group(1, c.airspeed_scale)
        if c.airspeed_bias > 0:
            groups["airspeed_bias"] = Group(1, c.airspeed_bias)
        _add_gauss_markov(groups, "wind_change", 2, c.wind)
        _add_gauss_markov(groups, "gust", 2, c.gust)
    if "position" in aids:
        _add_gauss_markov(groups, "position_colour", 3, c.position)
    if "attitude" in aids:
        _add_gauss_markov(groups, "attitude_colour", 3, c.attitude)
        if c.attitude_bias > 0:
            groups["attitude_bias"] = Group(3, c.attitude_bias)
    return groups


def _add_gauss_markov(groups: dict[str, Group], name: str, size: int, error: GaussMarkov) -> None:
    if error.sigma > 0:
        groups[name] = Group(size, error.sigma, time_constant=error.time_constant)
