"""Runs of a gyro whose truth is the linear model, as the problems of identification."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_problem import Arc, Estimate, Prior, Problem
from pipeline.models.drift_trajectory import Transient, linear_trajectory
from pipeline.models.earth import RATE, Base, Scheme, mounting_angles, rotation_vector_from_increments
from pipeline.models.gyro_drift import DRIFT

Float = NDArray[np.float64]

SCHEMES: tuple[Scheme, ...] = ("polar", "equatorial", "horizontal", "vertical")
LATITUDE, ARCMIN, ARCSEC = np.deg2rad(55.75), np.deg2rad(1 / 60), np.deg2rad(1 / 3600)
DEG_H = float(np.rad2deg(RATE) * 3600)
STARTS = {"polar": (0.6, 0.5), "equatorial": (0.0, 0.6), "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)}
PRIORS = {
    **dict.fromkeys(DRIFT, Prior(0.0, 0.1)),
    "theta1": Prior(0.0, 15 * ARCMIN),
    "theta2": Prior(0.0, 15 * ARCMIN),
    "epsilon": Prior(0.0, 1.5 * ARCMIN),
}


def hours(count: float, minutes: float = 1.0) -> Float:
    """An even grid in units of the Earth rate."""
    return np.arange(round(count * 60 / minutes) + 1) * (60 * minutes * RATE)


def truth(scheme: Scheme) -> Float:
    """All m = 0.01, theta = 10', Delta chi = 1' increments of the angles, in the order of `PARAMETERS`."""
    vector = rotation_vector_from_increments((ARCMIN, ARCMIN, ARCMIN), mounting_angles(scheme, LATITUDE))
    epsilon = np.cross(Base.mounted(scheme, LATITUDE).u, vector)
    return np.concatenate([np.full(6, 0.01), [10 * ARCMIN] * 2, epsilon])


@cache
def day(scheme: Scheme, minutes: float = 1.0, e_fold: float | None = None) -> Float:
    """Angles of a day; with an e-fold [h] m begins at 0.05. Do not write to it."""
    transient = None if e_fold is None else Transient(np.full(6, 0.05), decay(e_fold))
    base = Base.mounted(scheme, LATITUDE)
    return linear_trajectory(truth(scheme), base, np.array(STARTS[scheme]), hours(24, minutes), transient)


def decay(e_fold: float) -> float:
    """k in units of the Earth rate of an e-fold in hours."""
    return float(1 / (e_fold * 3600 * RATE))


def noisy(alpha: Float, seed: int, sigma: float = ARCSEC) -> Float:
    """The angles with white noise."""
    return alpha + sigma * np.random.default_rng(seed).standard_normal(alpha.shape)


def one_run(scheme: Scheme, alpha: Float, tau: Float, *, installation: bool = True) -> Problem:
    """A run of one arc, with the usual priors."""
    arc = Arc(0, tau, alpha, np.ones(len(tau), dtype=np.bool_))
    return Problem((Base.mounted(scheme, LATITUDE),), (arc,), PRIORS, installation)


def without_priors(problem: Problem) -> Problem:
    """The same record, nothing known beforehand."""
    return replace(problem, priors={})


def observable(estimate: Estimate, by_the_data_alone: Estimate) -> NDArray[np.bool_]:
    """Parameters that the data tell: the priors take 2 % of the standard error at most."""
    known, alone = estimate.standard_errors, by_the_data_alone.standard_errors
    # what is known exactly, epsilon along u, is no parameter
    return (known > 0.98 * alone) & (known > 1e-12)
