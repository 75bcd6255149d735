"""The runs on which the figures of Gubarenko & Kuzmenko (1995) are computed: a day at 55.75 degrees north."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_trajectory import linear_trajectory, trajectory
from pipeline.models.earth import (
    DEGREES_PER_HOUR,
    RATE,
    Base,
    Scheme,
    mounting_angles,
    rotation_vector_from_increments,
)
from pipeline.models.gyro_drift import Gyro

Float = NDArray[np.float64]
Start = tuple[float, float]

SOURCE = "Gubarenko & Kuzmenko, Mechanics of Solids (1995)"

SCHEMES: tuple[Scheme, ...] = get_args(Scheme)
LATITUDE = float(np.deg2rad(55.75))
DAY = RATE * 86_400
ARCMIN, ARCSEC = float(np.deg2rad(1 / 60)), float(np.deg2rad(1 / 3600))

M = np.full(6, 0.01)
THETA = np.full(2, 10 * ARCMIN)
STARTS: Mapping[Scheme, Start] = MappingProxyType(
    {"polar": (0.6, 0.5), "equatorial": (0.0, 0.6), "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)}
)
"""Initial angles [rad] from which the parameters are well determined."""


def instants(minutes: float, hours: float = 24.0) -> Float:
    """Even instants in units of the Earth rate."""
    return np.linspace(0.0, RATE * 3600 * hours, round(60 * hours / minutes) + 1)


def misalignment(scheme: Scheme) -> Float:
    """Delta chi [rad] of increments of 1' of each angle chi."""
    return rotation_vector_from_increments((ARCMIN,) * 3, mounting_angles(scheme, LATITUDE))


def parameters(scheme: Scheme) -> Float:
    """All that the linear model knows, shape (11,): m, theta, epsilon = u x Delta chi."""
    return np.concatenate([M, THETA, np.cross(Base.mounted(scheme, LATITUDE).u, misalignment(scheme))])


@cache
def linear_run(scheme: Scheme, start: Start, hours: float = 24.0, *, errors: bool = True) -> Float:
    """Angles each minute by the linear model, with or without the installation errors, shape (n, 2) [rad]."""
    p = parameters(scheme) if errors else np.concatenate([M, np.zeros(5)])
    return linear_trajectory(p, Base.mounted(scheme, LATITUDE), np.array(start), instants(1, hours))


@cache
def exact_run(scheme: Scheme, start: Start, *, tilted: bool, misaligned: bool) -> Float:
    """Angles each minute by the exact model, with either of the installation errors, shape (n, 2) [rad]."""
    base = Base.mounted(scheme, LATITUDE)
    standing = base.misaligned(misalignment(scheme)) if misaligned else base
    gyro = Gyro(M, THETA if tilted else np.zeros(2))
    return trajectory(gyro, standing, np.array(start), instants(1))


def largest_error(m: Float, truth: Float = M) -> float:
    """Largest error of the drift parameters [deg/h]."""
    return float(np.abs(m - truth).max()) * DEGREES_PER_HOUR
