"""The problem of a navigation from its stream tables: increments and aids by one clock.

The clock is that of the gyro; seconds count from its first sample. The accelerometers are brought to the
gyro's instants where they have others. An aid has its own rate. Where the inertial sensors and an aid have no
common time nothing can be navigated: both spans are said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models.navigation_problem import AidName, EarthField, Fixes, Imu
from pipeline.models.strapdown import from_increments, increments, quaternion_from_yaw_pitch_roll
from pipeline.numerics.sample_faults import frozen_runs
from pipeline.numerics.sampling import intervals
from pipeline.numerics.time_grid import advancing
from pipeline.stages._navigation_settings import Settings
from pipeline.stages._navigation_streams import CHANNELS
from pipeline.stages._streams import channels as gyro_channels
from pipeline.stages.base import StageError, Tables, counted, finding

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]
Findings = list[dict[str, Any]]

AID_TABLES: Mapping[AidName, str] = MappingProxyType(
    {
        "position": "gnss_position",
        "velocity": "gnss_velocity",
        "airspeed": "airspeed",
        "altitude": "barometer",
        "magnetic_field": "magnetometer",
        "attitude": "external_attitude",
    }
)
"""The table that each aid is from."""

_GAP = 1.8
"""Intervals of the accelerometers from which on nothing is interpolated between two of their samples."""

_FEWEST = 0.5
"""Part of the stamps that increments of gyros and accelerometers must share."""


@dataclass(frozen=True, slots=True)
class Inertial:
    """Samples of the inertial sensors at common instants.

    Attributes
    ----------
    stamps : ndarray of int64, shape (n,)
        Strictly increasing [ns].
    rate, force : ndarray, shape (n, 3)
        Angular rate [rad/s] and specific force [m/s^2]; of sensors that integrate, their increments
        [rad], [m/s] since the sample before. NaN where there is none.
    integrated : bool
        Whether they are increments.
    """

    stamps: Time
    rate: Float
    force: Float
    integrated: bool

    @property
    def origin(self) -> int:
        """What seconds count from [ns]."""
        return int(self.stamps[0])

    @property
    def seconds(self) -> Float:
        """The stamps [s]."""
        return np.asarray((self.stamps - self.origin) / 1e9, dtype=np.float64)

    @property
    def may_begin(self) -> Mask:
        """The instants at which a usable sample, or an interval of increments, begins."""
        usable: Mask = np.asarray(np.isfinite(np.hstack([self.rate, self.force])).all(axis=1))
        begins = np.append(usable[1:], False) if self.integrated else usable
        return np.asarray(begins, dtype=np.bool_)

    def imu(self, begin: float, max_coast: float) -> Imu:
        """Increments from an instant on [s]."""
        t = self.seconds
        kept = t >= begin
        if np.count_nonzero(kept) < 2:
            raise StageError(
                "stage navigate",
                expected="inertial samples after the start of navigation",
                found=f"{np.count_nonzero(kept)} after {begin:.3f} s, where position, velocity and attitude "
                "are first known",
                remedy="record longer, or state the start in [navigate.start]",
            )
        rate, force = self.rate[kept], self.force[kept]
        if self.integrated:
            return from_increments(t[kept], rate[1:], force[1:], max_coast=max_coast)
        return increments(t[kept], rate, force, max_coast=max_coast)

    def mean(self, begin: float, end: float) -> tuple[Float, Float, Float]:
        """Means of rate and specific force over a time [s], and the scatter of the force, each shape (3,)."""
        t = self.seconds
        kept = (t >= begin) & (t <= end) & np.isfinite(self.rate).all(axis=1)
        kept &= np.isfinite(self.force).all(axis=1)
        kept[0] &= not self.integrated
        if not kept.any():
            nan = np.full(3, np.nan)
            return nan, nan, nan
        if self.integrated:
            step = np.diff(t, prepend=0.0)[kept][:, np.newaxis]
            rate, force = self.rate[kept] / step, self.force[kept] / step
        else:
            rate, force = self.rate[kept], self.force[kept]
        return rate.mean(axis=0), force.mean(axis=0), force.std(axis=0)


def inertial(tables: Tables) -> tuple[Inertial, Findings]:
    """Gyros and accelerometers at common instants.

    Raises
    ------
    StageError
        If one of them is missing, one integrates and the other does not, or they share no time.
    """
    gyro = _table_of(tables, "gyro", "streams.gyro")
    accelerometer = _table_of(tables, "accelerometer", "streams.accelerometer")
    if gyro.endswith("increments") != accelerometer.endswith("increments"):
        raise StageError(
            "stage navigate",
            expected="rates and specific forces, or increments of both",
            found=f"the tables {gyro} and {accelerometer}",
            remedy="let both streams record the same kind of quantity",
            exit_code=ExitCode.USAGE,
        )
    time, rate = _in_order(tables[gyro], gyro_channels(tables[gyro], gyro))
    own, force = _in_order(tables[accelerometer], columns(tables[accelerometer], CHANNELS[accelerometer]))
    if len(time) < 2 or len(own) < 2:
        raise StageError(
            "stage navigate",
            expected="at least two samples of gyro and accelerometer whose stamps advance",
            found=f"{len(time)} and {len(own)}",
            remedy="choose another clock, or check the recording",
            exit_code=ExitCode.INPUT,
        )
    require_common(time, own, "gyro", "accelerometer")
    if gyro.endswith("increments"):
        return _joined(time, rate, own, force), []
    if np.array_equal(time, own):
        return Inertial(time, rate, force, integrated=False), []
    within = (time >= own[0]) & (time <= own[-1])
    time, rate = time[within], rate[within]
    detail = f"interpolated to the instants of the gyro, {counted(int(within.sum()), 'sample')}"
    said = finding("navigate", "accelerometer", "resampled", "info", detail, count=int(within.sum()))
    return Inertial(time, rate, _at(time, own, force), integrated=False), [said]


def _table_of(tables: Tables, name: str, stream: str) -> str:
    found = next((table for table in (name, f"{name}_increments") if table in tables), None)
    if found is None:
        raise StageError(
            "stage navigate",
            expected=f"{stream}, for the procedure 'navigation'",
            found=f"the tables {', '.join(sorted(tables))}",
            remedy=f"add [{stream}] to the test plan",
            exit_code=ExitCode.USAGE,
        )
    return found


def columns(table: pa.Table, names: tuple[str, ...]) -> Float:
    """Columns of a table, shape (n, k), NaN where one is null."""
    return np.stack([table.column(n).to_numpy().astype(np.float64) for n in names], axis=1)


def _in_order(table: pa.Table, values: Float) -> tuple[Time, Float]:
    """Stamps and values of the samples whose stamps advance."""
    time = table.column("time").to_numpy()
    kept = advancing(time).kept
    return time[kept], values[kept]


def _joined(time: Time, rate: Float, own: Time, force: Float) -> Inertial:
    """Increments of both sensors: of an interval that one of them lacks there are none."""
    shared = np.intersect1d(time, own)
    if len(shared) < _FEWEST * max(len(time), len(own)):
        raise StageError(
            "stage navigate, increments of gyro and accelerometer",
            expected="the same stamps in both: increments cannot be interpolated",
            found=f"{len(shared)} shared of {len(time)} and {len(own)}",
            remedy="record both under one clock, or record rates and specific forces",
        )
    stamps = np.union1d(time, own)
    values = []
    for at, recorded in ((time, rate), (own, force)):
        everywhere = np.full((len(stamps), 3), np.nan)
        everywhere[np.searchsorted(stamps, at)] = recorded
        values.append(everywhere)
    return Inertial(stamps, values[0], values[1], integrated=True)


def _at(time: Time, own: Time, values: Float) -> Float:
    """Values at other instants, linearly; NaN beside a missing value or in a gap."""
    place = np.clip(np.searchsorted(own, time, side="right") - 1, 0, len(own) - 2)
    length = (own[place + 1] - own[place]).astype(np.float64)
    part = ((time - own[place]) / length)[:, np.newaxis]
    between = values[place] + part * (values[place + 1] - values[place])
    # A sample that coincides needs no neighbour.
    between = np.where(part == 0, values[place], np.where(part == 1, values[place + 1], between))
    gap = (length > _GAP * intervals(own).nominal * 1e9) & (part[:, 0] > 0) & (part[:, 0] < 1)
    between[gap] = np.nan
    return np.asarray(between, dtype=np.float64)


def require_common(time: Time, other: Time, name: str, other_name: str) -> None:
    """Refuse two streams without a common time, and say both spans.

    Raises
    ------
    StageError
    """
    if max(time.min(), other.min()) <= min(time.max(), other.max()):
        return
    raise StageError(
        f"streams {name!r} and {other_name!r}",
        expected="stamps that overlap",
        found=f"{span(time)} and {span(other)}",
        remedy=f"choose the same clock for both ([streams.{other_name}.time]), or remove the stream",
    )


def span(time: Time) -> str:
    """First and last stamp in seconds."""
    return f"{time.min() / 1e9:.3f} to {time.max() / 1e9:.3f} s"


def aids(tables: Tables, sensors: Inertial, settings: Settings) -> tuple[dict[AidName, Fixes], Findings]:
    """The aids that the plan has and wants, by the clock of the gyro.

    Returns
    -------
    dict
        Also those of which nothing is usable.
    list
        Findings: stamps that do not advance, what is not usable and why.

    Raises
    ------
    StageError
        If an aid that is wanted has no stream, or shares no time with the gyro.
    """
    there = tuple(aid for aid, name in AID_TABLES.items() if name in tables)
    wanted = settings.aids if settings.aids is not None else there
    found: dict[AidName, Fixes] = {}
    said: Findings = []
    for aid in wanted:
        name = AID_TABLES[aid]
        if name not in tables:
            raise StageError(
                "test plan, key navigate.aids",
                expected=f"streams.{name}, which {aid!r} is from",
                found="none",
                remedy=f"add [streams.{name}], or take {aid!r} out",
                exit_code=ExitCode.USAGE,
            )
        table = tables[name]
        require_common(sensors.stamps, table.column("time").to_numpy(), "gyro", name)
        found[aid], findings = _fixes(aid, table, sensors, settings)
        said += findings
    return found, said


def _fixes(aid: AidName, table: pa.Table, sensors: Inertial, settings: Settings) -> tuple[Fixes, Findings]:
    name = AID_TABLES[aid]
    stamps = table.column("time").to_numpy()
    kept = advancing(stamps).kept
    inside = (stamps >= sensors.stamps[0]) & (stamps <= sensors.stamps[-1])
    said = []
    left_out = int(np.count_nonzero(~kept))
    if left_out:
        detail = f"{counted(left_out, 'measurement')} whose stamps do not advance: left out"
        said.append(finding("navigate", name, "stamp", "warning", detail, count=left_out))
    beyond = kept & ~inside
    if beyond.any():
        at, count = stamps[beyond], int(beyond.sum())
        detail = f"{counted(count, 'measurement')} before or after the inertial sensors record: not used"
        said.append(
            finding(
                "navigate", name, "outside the record", "info", detail,
                start=int(at.min()), end=int(at.max()), count=count,
            )
        )  # fmt: skip
    values = columns(table, CHANNELS[name])
    why = _unusable(aid, table, values, settings)
    usable = np.ones(len(stamps), dtype=np.bool_)
    for reason, mask in why.items():
        new = mask & usable & kept & inside
        usable &= ~mask
        if new.any():
            at = stamps[new]
            detail = f"{counted(int(new.sum()), 'measurement')} {reason}: not used"
            said.append(
                finding(
                    "navigate", name, "not usable", "warning", detail,
                    start=int(at.min()), end=int(at.max()), count=int(new.sum()),
                )
            )  # fmt: skip
    kept &= inside
    seconds = (stamps[kept] - sensors.origin) / 1e9
    value = values[kept]
    if aid == "attitude":
        value = quaternion_from_yaw_pitch_roll(value)
    return Fixes(np.asarray(seconds, dtype=np.float64), value, usable[kept]), said


def _unusable(aid: AidName, table: pa.Table, values: Float, settings: Settings) -> dict[str, Mask]:
    """By reason, in words: where the data themselves say that a measurement is none."""
    finite = np.isfinite(values).all(axis=1)
    why: dict[str, Mask] = {"without a finite value": np.asarray(~finite, dtype=np.bool_)}
    if aid == "position":
        fix = table.column("fix").to_numpy().astype(np.float64)
        if table.column("fix").null_count < table.num_rows:
            why[f"whose kind of fix is below {settings.min_fix:g}"] = np.asarray(
                ~(fix >= settings.min_fix), dtype=np.bool_
            )
        with np.errstate(invalid="ignore"):
            beyond = np.abs(values[:, 0]) > np.pi / 2
        why["with a latitude beyond a pole"] = np.asarray(beyond, dtype=np.bool_)
        nowhere = (values[:, :2] == 0).all(axis=1)
        why["of latitude and longitude 0, as receivers write where they have no fix"] = np.asarray(
            nowhere, dtype=np.bool_
        )
    if aid == "airspeed":
        why["below zero"] = np.asarray(values[:, 0] < 0, dtype=np.bool_)
    if aid == "magnetic_field":
        why["of no field at all"] = np.asarray((values == 0).all(axis=1), dtype=np.bool_)
    index = np.flatnonzero(finite)
    frozen = np.zeros(len(values), dtype=np.bool_)
    if len(index):
        held = frozen_runs(values[index], settings.frozen_fixes)
        for start, stop in zip(held.start, held.stop, strict=True):
            frozen[index[start + 1 : stop]] = True  # what was seen first may be sound
    many = settings.frozen_fixes
    why[f"that repeat the one before bit for bit, {many} or more in a row (key frozen_fixes)"] = frozen
    return why


def earth_field(found: Mapping[AidName, Fixes], settings: Settings) -> EarthField | None:
    """The magnetic field of the plan.

    Raises
    ------
    StageError
        If there is a magnetometer and the plan does not state the field.
    """
    if settings.earth_field is not None:
        return settings.earth_field.field
    if "magnetic_field" in found:
        raise StageError(
            "test plan, key navigate.earth_field",
            expected="strength_ut, dip_deg and declination_deg, which a magnetometer needs",
            found="none",
            remedy="add [navigate.earth_field], or leave 'magnetic_field' out of navigate.aids",
            exit_code=ExitCode.USAGE,
        )
    return None
