"""What the sensors of a simulated vehicle measure: inertial samples, aids, and the air they fly in.

Each random effect of each sensor has a generator of its own, see `pipeline.simulate.imperfections.generator`,
so that the errors of one are the same whatever the others are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.ellipsoid import displaced
from pipeline.models.navigation_problem import AidName
from pipeline.models.random_error import Noise1
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_from_rotation_vector,
    quaternion_multiply,
)
from pipeline.simulate.imperfections import generator
from pipeline.simulate.navigation_flight import Flight, Motion
from pipeline.simulate.navigation_settings import (
    AIDS,
    COMPONENTS,
    Aid,
    Air,
    GaussMarkov,
    NavigationSettings,
)

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Wind:
    """The velocity of the air along a flight, at the instants of the inertial samples.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s].
    wind : ndarray, shape (n, 2)
        Mean wind and its wandering, N, E [m/s].
    gusts : ndarray, shape (n, 3)
        Turbulence N, E, D [m/s].
    """

    time: Float
    wind: Float
    gusts: Float

    def at(self, t: Float) -> Float:
        """Velocity of the air N, E, D [m/s] at times [s]; shape (m, 3)."""
        total = self.gusts.copy()
        total[:, :2] += self.wind
        return np.column_stack([np.interp(t, self.time, total[:, axis]) for axis in range(3)])


def wind_along(air: Air, mean: tuple[float, float], t: Float, seed: int) -> Wind:
    """Draw the motion of the air.

    Parameters
    ----------
    air : Air
    mean : tuple of float
        Mean wind N, E [m/s].
    t : ndarray, shape (n,)
        Even instants [s].
    seed : int
    """
    wander = [_process(air.wander, t, seed, "air", axis) for axis in (1, 2)]
    gusts = [
        _process(gust, t, seed, "air", axis)
        for axis, gust in ((3, air.gust), (4, air.gust), (5, air.vertical_gust))
    ]
    return Wind(t, np.column_stack(wander) + mean, np.column_stack(gusts))


@dataclass(frozen=True, slots=True)
class InertialSamples:
    """The inertial sensors' output and the biases in it.

    Attributes
    ----------
    values : ndarray, shape (n, 6)
        Rates [rad/s] and specific forces [m/s^2], or angle [rad] and velocity [m/s] increments.
    gyro_bias, accelerometer_bias : ndarray, shape (n, 3)
        [rad/s], [m/s^2].
    """

    values: Float
    gyro_bias: Float
    accelerometer_bias: Float


def inertial(
    settings: NavigationSettings, flight: Flight, motion: Motion, t: Float, seed: int
) -> InertialSamples:
    """The inertial sensors' output.

    Parameters
    ----------
    settings : NavigationSettings
    flight : Flight
    motion : Motion
        At the instants.
    t : ndarray, shape (n,)
        Even instants [s].
    seed : int
    """
    errors = settings.errors
    exact = np.column_stack((motion.rate, motion.force))
    scale = 1.0
    if settings.output == "increments":
        scale = 1 / settings.rate
        exact = np.column_stack(flight.integrals(np.concatenate(([t[0] - scale], t))))
    biases = []
    for first, bias, wander in (
        (1, errors.gyro_bias, errors.gyro_wander),
        (4, errors.accelerometer_bias, errors.accelerometer_wander),
    ):
        drawn = [_process(wander, t, seed, "inertial wander", first + axis) for axis in range(3)]
        biases.append(np.column_stack(drawn) + bias)
    spoilt = exact + scale * np.column_stack(biases)
    for first, sigma in ((0, errors.gyro_noise), (3, errors.accelerometer_noise)):
        if sigma:
            noise = generator(seed, "inertial noise", first + 1).standard_normal((len(t), 3))
            spoilt[:, first : first + 3] += scale * sigma * noise
    return InertialSamples(spoilt, biases[0], biases[1])


def measured(
    name: AidName, aid: Aid, settings: NavigationSettings, t: Float, motion: Motion, wind: Wind, seed: int
) -> Float:
    """What an aid measures.

    Parameters
    ----------
    name : str
    aid : Aid
    settings : NavigationSettings
    t : ndarray, shape (n,)
        Even instants [s].
    motion : Motion
        At them.
    wind : Wind
    seed : int

    Returns
    -------
    ndarray, shape (n, k)
        As in `pipeline.models.navigation_problem.Fixes`.
    """
    if name == "position":
        return displaced(motion.position, _error(name, aid, t, seed))
    if name == "attitude":
        turned = quaternion_from_rotation_vector(_error(name, aid, t, seed))
        return quaternion_multiply(turned, motion.attitude)
    if name == "velocity":
        exact = motion.velocity
    elif name == "airspeed":
        exact = np.linalg.norm(motion.velocity - wind.at(t), axis=1)[:, np.newaxis]
    elif name == "altitude":
        exact = motion.position[:, 2:]
    else:
        exact = np.einsum("nji,j->ni", matrix_from_quaternion(motion.attitude), settings.earth_field.ned)
    return np.asarray((1 + aid.scale) * exact + _error(name, aid, t, seed), dtype=np.float64)


def bias_of(name: AidName, aid: Aid, seed: int) -> Float:
    """What is constant in the error of an aid, with that part of it which is drawn, by component."""
    drawn = generator(seed, "aid bias", AIDS.index(name) + 1).standard_normal(COMPONENTS[name])
    return np.asarray(aid.bias + aid.drawn_bias * drawn, dtype=np.float64)


def _error(name: AidName, aid: Aid, t: Float, seed: int) -> Float:
    """Bias, wander and noise of an aid, shape (n, k)."""
    number, k = AIDS.index(name) + 1, COMPONENTS[name]
    noise = aid.noise * generator(seed, "aid noise", number).standard_normal((len(t), k))
    wander = [_process(aid.wander, t, seed, "aid wander", number, axis) for axis in range(1, k + 1)]
    total = bias_of(name, aid, seed) + noise + np.column_stack(wander)
    return np.asarray(total, dtype=np.float64)


def _process(process: GaussMarkov | None, t: Float, seed: int, effect: str, *part: int) -> Float:
    """A stationary Gauss-Markov process at even instants, shape (n,)."""
    if process is None or not process.sigma or len(t) < 2:
        return np.zeros(len(t))
    step = float(t[-1] - t[0]) / (len(t) - 1)
    return Noise1(process.sigma, 1 / process.time).generate(len(t), step, generator(seed, effect, *part))
