"""The state at which a navigation starts: from the plan, what was measured, or truth; never guessed.

What is measured begins at its own time. Navigation starts at the first inertial sample at which position,
velocity and attitude are all known; what lies before is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models.ellipsoid import POLAR_LIMIT, displaced, gravity, metres_between
from pipeline.models.levelling import pitch_and_roll, yaw_of_field
from pipeline.models.navigation_problem import AidName, Fixes, Start
from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll
from pipeline.numerics.rotation import (
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
    wrapped,
)
from pipeline.numerics.time_grid import advancing
from pipeline.stages._navigation_problem import Findings, Inertial, columns, earth_field
from pipeline.stages._navigation_settings import Settings
from pipeline.stages._navigation_streams import CHANNELS
from pipeline.stages.base import StageError, Tables, finding

Float = NDArray[np.float64]

_RESTING_RATE = float(np.deg2rad(1.0))
"""Mean rate above which a body does not rest [rad/s]: biases and the Earth's 15 deg/h lie below."""

_RESTING_FORCE = 0.5
"""Mean specific force away from gravity, and its scatter along an axis, above which a body does not rest
[m/s^2]: three times the bias of cheap accelerometers."""

_JUDGED = 11
"""Positions by satellites, the middle one of which is held against a start that is not from them."""

_FAR, _FASTEST = 10e3, 1000.0
"""No start is so wrong [m], and no vehicle so fast [m/s]."""


@dataclass(frozen=True, slots=True)
class Known:
    """A part of the state, as it is known in time.

    Attributes
    ----------
    time : ndarray, shape (m,)
        [s]; empty where it is of the first instant, whichever that is.
    value : ndarray, shape (m, k) or (1, k)
    """

    time: Float
    value: Float

    @property
    def first(self) -> float:
        """From when on it is known [s]."""
        return float(self.time[0]) if len(self.time) else -np.inf


def start_of(
    tables: Tables, sensors: Inertial, found: Mapping[AidName, Fixes], settings: Settings
) -> tuple[float, Start, Findings]:
    """When navigation starts, and from which state.

    Returns
    -------
    begin : float
        [s].
    start : Start
    findings : list
        What of the record lies before.

    Raises
    ------
    StageError
        If a source is not there, has nothing usable, or the body does not rest where it is to be levelled.
    """
    attitude_from = _attitude_source(settings)
    position = _position(tables, sensors, found, settings)
    velocity = _velocity(tables, sensors, found, settings)
    attitude = None if attitude_from == "levelled" else _attitude(tables, sensors, attitude_from, settings)
    earliest = max(one.first for one in (position, velocity, attitude) if one is not None)
    t = sensors.seconds
    later = np.flatnonzero((t >= earliest) & sensors.may_begin)
    begin = float(t[later[0]]) if len(later) else float(earliest)
    _, moving = _latest(velocity, begin)
    known_at, at = _latest(position, begin)
    place = displaced(at, moving * (begin - known_at))
    if attitude is None:
        quaternion = quaternion_from_yaw_pitch_roll(_levelled(sensors, found, settings, begin, place))
    else:
        quaternion = _attitude_at(attitude, begin)
    latitude, longitude, height = (float(x) for x in place)
    _refuse_pole(latitude)
    start = Start(latitude, longitude, height, moving, quaternion)
    return begin, start, list(_left_out(sensors, begin))


def contradiction(begin: float, start: Start, fixes: Fixes | None, settings: Settings) -> str | None:
    """How the first positions by satellites contradict a start that is not from them; None where they do not.

    Each method would believe the start or the satellites, and jump, without a word.
    """
    if settings.start_position == "gnss" or fixes is None:
        return None
    first = np.flatnonzero(fixes.usable)[:_JUDGED]
    here, found = np.array([start.latitude, start.longitude, start.height]), fixes.value[first]
    allowed = _FAR + _FASTEST * (float(np.median(fixes.time[first])) - begin)
    away = float(np.median(_horizontally(here, found)))
    if away <= allowed:
        return None
    exchanged = float(np.median(_horizontally(here, found[:, [1, 0, 2]])))
    return f"the first positions by satellites are {away / 1e3:.0f} km from the start of the plan: " + (
        "latitude and longitude exchanged?" if exchanged <= allowed else "wrong start, wrong columns or unit?"
    )


def _horizontally(here: Float, there: Float) -> Float:
    """Distances along the ground [m]."""
    return np.asarray(np.linalg.norm(metres_between(here, there)[:, :2], axis=1), dtype=np.float64)


def _left_out(sensors: Inertial, begin: float) -> Findings:
    if begin <= 0:
        return []
    detail = f"{begin:.3f} s before position, velocity and attitude are first known: left out"
    end = sensors.origin + round(begin * 1e9)
    return [finding("navigate", "gyro", "before the start", "info", detail, start=sensors.origin, end=end)]


def _refuse_pole(latitude: float) -> None:
    if abs(latitude) > POLAR_LIMIT:
        limit = np.degrees(POLAR_LIMIT)
        raise StageError(
            "stage navigate, latitude at the start",
            expected=f"one within {limit:g} degrees: at a pole north and east have no meaning",
            found=f"{np.degrees(latitude):.6g} deg",
            remedy="check the unit and the order of latitude and longitude, or leave that stretch out",
        )


def _attitude_source(settings: Settings) -> str:
    """Where the attitude is from; the plan's own where it states it and names no other.

    Raises
    ------
    StageError
        If the plan says neither.
    """
    if settings.start_attitude is not None:
        return settings.start_attitude
    stated = settings.start
    if stated.yaw_deg is not None and stated.pitch_deg is not None and stated.roll_deg is not None:
        return "plan"
    raise StageError(
        "test plan, key navigate.start_attitude",
        expected="where the attitude at the start is from",
        found="none, and no yaw_deg, pitch_deg and roll_deg in [navigate.start]",
        remedy='state them, or choose start_attitude = "levelled", "external_attitude" or "truth"',
        exit_code=ExitCode.USAGE,
    )


def _position(tables: Tables, sensors: Inertial, found: Mapping[AidName, Fixes], settings: Settings) -> Known:
    stated = settings.start
    if settings.start_position == "plan":
        degrees = np.deg2rad(np.array([stated.latitude_deg, stated.longitude_deg], dtype=np.float64))
        return _stated(np.append(degrees, stated.height_m or 0.0))
    if settings.start_position == "truth":
        return _of_table(tables, sensors, "truth_position", "start_position")
    return _of_aid(found, "position", "start_position", "a usable position by satellites")


def _velocity(tables: Tables, sensors: Inertial, found: Mapping[AidName, Fixes], settings: Settings) -> Known:
    if settings.start_velocity == "rest":
        return _stated(np.zeros(3))
    if settings.start_velocity == "plan":
        return _stated(np.array(settings.start.velocity_m_s, dtype=np.float64))
    if settings.start_velocity == "truth":
        return _of_table(tables, sensors, "truth_velocity", "start_velocity")
    return _of_aid(found, "velocity", "start_velocity", "a usable velocity by satellites")


def _attitude(tables: Tables, sensors: Inertial, source: str, settings: Settings) -> Known:
    """Quaternions in time, or the one of the plan."""
    stated = settings.start
    if source == "plan":
        angles = np.array([stated.yaw_deg, stated.pitch_deg, stated.roll_deg], dtype=np.float64)
        return _stated(quaternion_from_yaw_pitch_roll(np.deg2rad(angles)))
    name = "truth_attitude" if source == "truth" else "external_attitude"
    known = _of_table(tables, sensors, name, "start_attitude")
    return Known(known.time, quaternion_from_yaw_pitch_roll(known.value))


def _stated(value: Float) -> Known:
    return Known(np.zeros(0), value[np.newaxis])


def _of_aid(found: Mapping[AidName, Fixes], aid: AidName, key: str, what: str) -> Known:
    fixes = found.get(aid)
    usable = None if fixes is None else fixes.usable & (fixes.time >= 0)
    if fixes is None or usable is None or not usable.any():
        raise StageError(
            f"test plan, key navigate.{key}",
            expected=what,
            found="no such aid" if fixes is None else f"none among {len(fixes.time)}",
            remedy=("" if fixes is None else "check its unit, columns and min_fix, or ")
            + f'state it in [navigate.start] and choose {key} = "plan"',
            exit_code=ExitCode.USAGE,
        )
    return Known(fixes.time[usable], fixes.value[usable])


def _of_table(tables: Tables, sensors: Inertial, name: str, key: str) -> Known:
    """The finite samples of a table from the first inertial sample on."""
    if name not in tables:
        raise StageError(
            f"test plan, key navigate.{key}",
            expected=f"streams.{name}, which it names",
            found="none",
            remedy=f"add [streams.{name}], or choose another source",
            exit_code=ExitCode.USAGE,
        )
    table: pa.Table = tables[name]
    stamps, values = table.column("time").to_numpy(), columns(table, CHANNELS[name])
    kept = advancing(stamps).kept & np.isfinite(values).all(axis=1)
    kept &= (stamps >= sensors.stamps[0]) & (stamps <= sensors.stamps[-1])
    if not kept.any():
        raise StageError(
            f"test plan, key navigate.{key}",
            expected=f"a sample of {name} while the inertial sensors record",
            found=f"none of {table.num_rows}",
            remedy="check its clock, or choose another source",
        )
    seconds = (stamps[kept] - sensors.origin) / 1e9
    return Known(np.asarray(seconds, dtype=np.float64), values[kept])


def _latest(known: Known, time: float) -> tuple[float, Float]:
    """The latest value up to a time, and when it was; a stated one is of that very time."""
    if not len(known.time):
        return time, known.value[0]
    place = max(int(np.searchsorted(known.time, time, side="right")) - 1, 0)
    return float(known.time[place]), known.value[place]


def _attitude_at(known: Known, time: float) -> Float:
    """The attitude at a time, by an even turn from the sample before to the one after."""
    before, attitude = _latest(known, time)
    after = int(np.searchsorted(known.time, time, side="right"))
    if before >= time or after >= len(known.time):
        return attitude
    turn = rotation_vector_from_quaternion(
        quaternion_multiply(quaternion_conjugate(attitude), known.value[after])
    )
    part = (time - before) / (known.time[after] - before)
    return quaternion_multiply(attitude, quaternion_from_rotation_vector(part * turn))


def _levelled(
    sensors: Inertial, found: Mapping[AidName, Fixes], settings: Settings, begin: float, place: Float
) -> Float:
    """Yaw, pitch and roll of a body that rests at the start.

    Raises
    ------
    StageError
        If it does not rest, or nothing tells its yaw.
    """
    end = begin + settings.level_s
    rate, force, scatter = sensors.mean(begin, end)
    g = float(gravity(place[0], place[2]))
    turning, excess = float(np.linalg.norm(rate)), abs(float(np.linalg.norm(force)) - g)
    resting = turning < _RESTING_RATE and excess < _RESTING_FORCE and float(scatter.max()) < _RESTING_FORCE
    if not resting:
        when = (
            f"the first {settings.level_s:g} s"
            if begin < 1
            else f"{settings.level_s:g} s from {begin:.3g} s on"
        )
        still = float(scatter.max()) < _RESTING_FORCE
        raise StageError(
            "test plan, key navigate.start_attitude",
            expected=f"rest over {when}, where it is 'levelled'",
            found=f"{np.degrees(turning):.3g} deg/s, a specific force {excess:.3g} m/s^2 away from gravity "
            f"that scatters by {float(scatter.max()):.3g} m/s^2",
            remedy=("check the units of gyro and accelerometer, " if still else "")
            + "lower level_s, record longer rest, or state the attitude in [navigate.start]",
        )
    pitch, roll = pitch_and_roll(force)
    field = found.get("magnetic_field")
    earth = earth_field(found, settings)
    if field is not None and earth is not None:
        within = field.usable & (field.time >= begin) & (field.time <= end)
        if within.any():
            yaw = yaw_of_field(field.value[within].mean(axis=0), pitch, roll, earth.declination)
            return np.array([float(wrapped(yaw)), pitch, roll])
    if settings.start.yaw_deg is None:
        raise StageError(
            "test plan, key navigate.start_attitude",
            expected="a magnetometer, or yaw_deg in [navigate.start]: gravity tells no yaw",
            found="neither" if field is None else f"no usable field within the first {settings.level_s:g} s",
            remedy="add yaw_deg to [navigate.start], or the stream magnetometer",
            exit_code=ExitCode.USAGE,
        )
    return np.array([np.deg2rad(settings.start.yaw_deg), pitch, roll])
