"""Flights whose truth is the strapdown equations' own, with errors drawn from the filter's own model.

The increments of an error-free inertial unit are made from a wished course; their exact integral is the
truth. So the only difference between the filter and what it navigates is its model of errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models import ellipsoid
from pipeline.models._kernels_strapdown import navigate
from pipeline.models.navigation_filter_settings import FilterSettings, GaussMarkov
from pipeline.models.navigation_problem import EarthField, Fixes, Imu, Mask, Problem, Start
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]

FIELD = EarthField(strength=52e-6, dip=np.radians(71.0), declination=np.radians(11.0))
LATITUDE, LONGITUDE, HEIGHT, SPEED, YAW = np.radians(58.05), np.radians(38.8), 100.0, 40.0, np.radians(55.0)


@dataclass(frozen=True)
class Flight:
    """Truth at the instants of the error-free increments, and those."""

    imu: Imu
    position: Float
    velocity: Float
    attitude: Float


def flight(duration: float, dt: float = 0.01, turns: float = 0.0) -> Flight:
    """A flight at 40 m/s; ``turns`` is the amplitude [rad] of a weave of the course with a period of 60 s.

    It banks into the weave and climbs and descends a little with it; without it it is straight.
    """
    time = np.arange(round(duration / dt) + 1) * dt
    phase = 2 * np.pi * time / 60
    yaw, pitch = YAW + turns * np.sin(phase), 0.1 * turns * np.sin(phase / 2)
    roll = np.arctan(SPEED / 9.8 * turns * 2 * np.pi / 60 * np.cos(phase))
    q = _quaternion(yaw, pitch, roll)
    nose = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=-1)
    velocity = SPEED * nose
    middle = (velocity[1:] + velocity[:-1]) / 2
    earth = ellipsoid.earth_rate_ned(LATITUDE)
    transport = ellipsoid.transport_rate(LATITUDE, HEIGHT, middle)
    gravity = np.array([0.0, 0.0, ellipsoid.gravity(LATITUDE, HEIGHT)])
    force = np.diff(velocity, axis=0) + dt * (np.cross(2 * earth + transport, middle) - gravity)
    increment = np.einsum("iba,ib->ia", matrix_from_quaternion(q[:-1]), force)
    turned = quaternion_multiply(quaternion_from_rotation_vector(dt * (earth + transport)), q[1:])
    rotation = rotation_vector_from_quaternion(quaternion_multiply(quaternion_conjugate(q[:-1]), turned))
    n = len(time) - 1
    imu = Imu(time, rotation, increment, np.zeros(n, dtype=np.bool_))
    path = (np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 4)))
    path[0][0], path[1][0], path[2][0] = (LATITUDE, LONGITUDE, HEIGHT), velocity[0], q[0]
    assert navigate(np.full(n, dt), rotation, increment, *path) == -1
    return Flight(imu, *path)


def _quaternion(yaw: Float, pitch: Float, roll: Float) -> Float:
    zero = np.zeros_like(yaw)
    parts = ([zero, zero, yaw], [zero, pitch, zero], [roll, zero, zero])
    a, b, c = (quaternion_from_rotation_vector(np.stack(part, axis=-1)) for part in parts)
    return quaternion_multiply(quaternion_multiply(a, b), c)


@dataclass(frozen=True)
class Drawn:
    """A problem and the true values of what the filter estimates beside the path."""

    problem: Problem
    gyro_bias: Float
    accelerometer_bias: Float
    wind: Float
    barometer_bias: float


def drawn(
    truth: Flight,
    settings: FilterSettings,
    aids: dict[str, float],
    rng: np.random.Generator,
    outage: tuple[float, float] = (np.inf, np.inf),
) -> Drawn:
    """Errors of start, inertial unit and aids drawn from the settings; ``aids``: interval of each [s].

    Biases are constant where their noise is zero. GNSS is not usable within the outage.
    """
    time, dt = truth.imu.time, float(truth.imu.time[1])
    start, noise = settings.start, settings.noise
    n = len(truth.imu)

    def walk(sigma: float, step: float, size: int) -> Float:
        steps = step * np.sqrt(dt) * rng.standard_normal((n, size))
        return np.vstack([np.zeros(size), np.cumsum(steps, axis=0)]) + sigma * rng.standard_normal(size)

    gyro, accelerometer = (
        walk(start.gyro_bias, noise.gyro_bias, 3),
        walk(start.accelerometer_bias, noise.accelerometer_bias, 3),
    )
    wind, barometer = walk(start.wind, noise.wind, 2), walk(start.barometer_bias, noise.barometer_bias, 1)
    rotation = (
        truth.imu.rotation + dt * gyro[:-1] + noise.attitude * np.sqrt(dt) * rng.standard_normal((n, 3))
    )
    # an inertial unit turns its increments by the rotation that it saw within the step
    increment = truth.imu.velocity + 0.5 * np.cross(rotation - truth.imu.rotation, truth.imu.velocity)
    increment += dt * (accelerometer[:-1] + 0.5 * np.cross(rotation, accelerometer[:-1]))
    increment += noise.velocity * np.sqrt(dt) * rng.standard_normal((n, 3))
    tilt = np.array([start.tilt, start.tilt, start.yaw]) * rng.standard_normal(3)
    position = ellipsoid.displaced(truth.position[0], start.position * rng.standard_normal(3))
    begun = Start(
        latitude=position[0],
        longitude=position[1],
        height=position[2],
        velocity=truth.velocity[0] + start.velocity * rng.standard_normal(3),
        attitude=quaternion_multiply(quaternion_from_rotation_vector(tilt), truth.attitude[0]),
    )
    out = (time >= outage[0]) & (time < outage[1])
    fixes = {
        aid: _fixes(aid, interval, truth, settings, wind, barometer, rng, out)
        for aid, interval in aids.items()
    }
    imu = replace(truth.imu, rotation=rotation, velocity=increment)
    return Drawn(Problem(imu, begun, fixes, FIELD), gyro, accelerometer, wind, barometer[:, 0])


def gauss_markov(
    error: GaussMarkov, interval: float, count: int, size: int, rng: np.random.Generator
) -> Float:
    """Samples of Gauss-Markov errors, shape (count, size)."""
    kept = np.exp(-interval / error.time_constant)
    x = error.sigma * rng.standard_normal((count, size))
    for i in range(1, count):
        x[i] = kept * x[i - 1] + np.sqrt(1 - kept**2) * x[i]
    return x


def _fixes(
    aid: str,
    interval: float,
    truth: Flight,
    settings: FilterSettings,
    wind: Float,
    barometer: Float,
    rng: np.random.Generator,
    out: Mask,
) -> Fixes:
    stride = round(interval / truth.imu.time[1])
    at = np.arange(stride, len(truth.imu.time), stride)
    sigma = getattr(settings.measurement, aid)
    white = sigma * rng.standard_normal((len(at), 3))
    colour = settings.coloured
    usable = np.ones(len(at), dtype=np.bool_)
    if aid == "position":
        if colour is not None:
            white = white + gauss_markov(colour.position, interval, len(at), 3, rng)
        value, usable = ellipsoid.displaced(truth.position[at], white), ~out[at]
    elif aid == "velocity":
        value, usable = truth.velocity[at] + white, ~out[at]
    elif aid == "airspeed":
        air = truth.velocity[at].copy()
        air[:, :2] -= wind[at]
        if colour is not None:
            air[:, :2] -= gauss_markov(colour.gust, interval, len(at), 2, rng)
        value = np.linalg.norm(air, axis=1) + white[:, 0]
    elif aid == "altitude":
        value = truth.position[at, 2] + barometer[at, 0] + white[:, 0]
    elif aid == "magnetic_field":
        body = matrix_from_quaternion(truth.attitude[at]).transpose(0, 2, 1) @ FIELD.ned
        iron = colour.hard_iron if colour is not None else 0.0
        value = body + white + iron * rng.standard_normal(3)
    else:
        value = quaternion_multiply(quaternion_from_rotation_vector(white), truth.attitude[at])
    return Fixes(truth.imu.time[at], value, usable)
