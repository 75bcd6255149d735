"""The errors of a navigation against the truth that was recorded, at the instants of the navigation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.models.ellipsoid import metres_between, radii
from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll, yaw_pitch_roll
from pipeline.numerics.rotation import (
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
    wrapped,
)
from pipeline.numerics.time_grid import advancing
from pipeline.stages._navigation_problem import columns
from pipeline.stages._navigation_streams import ATTITUDE, POSITION, VELOCITY
from pipeline.stages.base import Tables

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]

_GAP = 3.0
"""Usual intervals of the truth from which on nothing is interpolated."""


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of a truth that are finite and advance in time, of at least one."""

    time: Time
    value: Float

    def around(self, time: Time) -> tuple[NDArray[np.int64], Float, Float, Mask]:
        """Index of the sample before each time, the part of its interval, that [s], and whether known."""
        if len(self.time) < 2:
            place = np.zeros(len(time), dtype=np.int64)
            return place, np.zeros(len(time)), np.ones(len(time)), time == self.time[0]
        last = len(self.time) - 2
        place = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, last).astype(np.int64)
        length = np.asarray((self.time[place + 1] - self.time[place]) / 1e9, dtype=np.float64)
        part = (time - self.time[place]) / 1e9 / length
        known = (part >= 0) & (part <= 1)
        known &= length <= _GAP * float(np.median(np.diff(self.time))) / 1e9
        return place, np.asarray(part, dtype=np.float64), length, known

    def after(self, place: NDArray[np.int64]) -> Float:
        """The value of the sample after each."""
        return self.value[np.minimum(place + 1, len(self.time) - 1)]


@dataclass(frozen=True, slots=True)
class Truth:
    """What is known of the true motion."""

    position: Samples | None
    velocity: Samples | None
    attitude: Samples | None

    def __bool__(self) -> bool:
        """Whether anything is."""
        return any(one is not None for one in (self.position, self.velocity, self.attitude))


def truth_of(tables: Tables) -> Truth:
    """The truth among the tables of the streams; attitudes as quaternions."""
    attitude = _samples(tables, "truth_attitude", ATTITUDE)
    if attitude is not None:
        attitude = Samples(attitude.time, quaternion_from_yaw_pitch_roll(attitude.value))
    position = _samples(tables, "truth_position", POSITION)
    if position is not None:
        unwound = position.value.copy()
        unwound[:, 1] = np.unwrap(unwound[:, 1])
        position = Samples(position.time, unwound)
    return Truth(position, _samples(tables, "truth_velocity", VELOCITY), attitude)


def _samples(tables: Tables, name: str, names: tuple[str, ...]) -> Samples | None:
    if name not in tables:
        return None
    table: pa.Table = tables[name]
    time, values = table.column("time").to_numpy(), columns(table, names)
    finite = np.isfinite(values).all(axis=1)
    time, values = time[finite], values[finite]
    kept = advancing(time).kept
    return Samples(time[kept], values[kept]) if kept.any() else None


@dataclass(frozen=True, slots=True)
class Errors:
    """Navigated less true, at n instants; NaN where the truth is not known.

    Attributes
    ----------
    position : ndarray, shape (n, 3)
        N, E, D [m].
    velocity : ndarray, shape (n, 3)
        N, E, D [m/s].
    rotation : ndarray, shape (n, 3)
        Rotation vector that turns the true attitude to the navigated one, about N, E, D [rad].
    angles : ndarray, shape (n, 3)
        Yaw, pitch, roll [rad].
    """

    position: Float
    velocity: Float
    rotation: Float
    angles: Float


def errors_of(time: Time, state: Mapping[str, Float], truth: Truth) -> Errors:
    """Errors of one method.

    Parameters
    ----------
    time : ndarray of int64, shape (n,)
        [ns].
    state : mapping of str to ndarray, each of shape (n, 3)
        ``position`` (latitude, longitude [rad], height [m]), ``velocity`` (N, E, D), ``attitude`` (yaw,
        pitch, roll).
    truth : Truth
    """
    unknown = np.full((len(time), 3), np.nan)
    position, velocity, rotation, angles = (unknown.copy() for _ in range(4))
    if truth.position is not None:
        position = metres_between(_position_at(truth, truth.position, time), state["position"])
    if truth.velocity is not None:
        place, part, _, known = truth.velocity.around(time)
        before, after = truth.velocity.value[place], truth.velocity.after(place)
        velocity = state["velocity"] - _where(known, before + part[:, np.newaxis] * (after - before))
    if truth.attitude is not None:
        place, part, _, known = truth.attitude.around(time)
        before = truth.attitude.value[place]
        turn = rotation_vector_from_quaternion(
            quaternion_multiply(quaternion_conjugate(before), truth.attitude.after(place))
        )
        true = quaternion_multiply(before, quaternion_from_rotation_vector(part[:, np.newaxis] * turn))
        navigated = quaternion_from_yaw_pitch_roll(state["attitude"])
        error = quaternion_multiply(navigated, quaternion_conjugate(true))
        rotation = _where(known, rotation_vector_from_quaternion(error))
        angles = _where(known, wrapped(state["attitude"] - yaw_pitch_roll(true)))
    return Errors(position, velocity, rotation, angles)


def _where(known: Mask, value: Float) -> Float:
    return np.where(known[:, np.newaxis], value, np.nan)


def _position_at(truth: Truth, samples: Samples, time: Time) -> Float:
    """The true position: between two samples a cubic with their velocities, else a line."""
    place, part, length, known = samples.around(time)
    before, after = samples.value[place], samples.after(place)
    u = part[:, np.newaxis]
    line = before + u * (after - before)
    if truth.velocity is None or not np.array_equal(truth.velocity.time, samples.time):
        return _where(known, line)
    rates = _rates(samples.value, truth.velocity.value)
    after_rates = rates[np.minimum(place + 1, len(rates) - 1)]
    h = length[:, np.newaxis]
    rise = after - before
    # Hermite: the line, and what the slopes at both ends leave of it.
    bend = u * (1 - u) * ((1 - u) * (h * rates[place] - rise) - u * (h * after_rates - rise))
    return _where(known, line + bend)


def _rates(position: Float, velocity: Float) -> Float:
    """Rates of latitude, longitude [rad/s] and height [m/s]."""
    meridian, prime_vertical = radii(position[:, 0], position[:, 2])
    north, east, down = velocity.T
    return np.stack([north / meridian, east / (prime_vertical * np.cos(position[:, 0])), -down], axis=-1)
