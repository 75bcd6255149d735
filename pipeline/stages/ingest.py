"""Ingest: the one door. It alone opens the recording, and converts to SI and radians, once.

The channel map of the test plan (`channel_map`) says which topic or column feeds which channel, in which
unit and by which clock. Samples stay in the order of the file, under the time that was recorded; a sample
without time cannot be kept. What could not be read, and what was missing in it, becomes findings.

A stream's table holds the messages in which at least one of its channels is present: a text file holds all
streams in one, with empty cells where one of them has no sample. The columns of a gyro's channel that the
plan does not map are null.

Gimbal angles are parted into the runs of the plan (`_runs`), which may lie in further recordings.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from pipeline import contracts, formats, units
from pipeline.errors import ExitCode
from pipeline.formats.base import CLOCKS, Request, TimeField
from pipeline.numerics.rotation import (
    euler_krylov_from_quaternion,
    quaternion_conjugate,
    quaternion_from_euler_krylov,
    quaternion_from_matrix,
    quaternion_multiply,
)
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._file_findings import contradicted_units, losses, uncertain_times
from pipeline.stages._runs import Run, further_recordings, inside, listed, run_faults, runs_table, unwrapped
from pipeline.stages._sample_time import numbers, refuse_idle_stamps, sample_times, valid
from pipeline.stages.base import ANGLES, Severity, StageError, Stand, counted, finding, rows
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.channel_map import (
    CHANNELS,
    DIMENSIONS,
    NO_CLOCK,
    Clock,
    Stream,
    StreamName,
    Text,
    channel_faults,
)

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES = ("gyro", "gyro_increments", "reference", "turntable", "gimbal", "runs", "findings")
METRICS: tuple[str, ...] = ()

UNIT_NORM = 1e-3
"""A quaternion whose norm is farther from 1 than this is marked: single precision and four decimals are
nearer, a wrong column or scale is not."""

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]
Findings = list[dict[str, Any]]


class Settings(_Settings):
    """The channel map: at the top level of the test plan, as [time], [streams.…], [[runs]] and [text]."""

    time: Clock | None = Field(None, description="clock of every stream that has none of its own")
    streams: dict[StreamName, Stream] = Field(min_length=1, description="what the recording holds")
    runs: tuple[Run, ...] = Field(
        (), description="runs of one gyro in a gimbal; none: the whole recording is one run"
    )
    text: Text = Field(
        default_factory=Text, description="layout of a text file, where it should not be found out by itself"
    )

    @field_validator("streams")
    @classmethod
    def _streams_are_whole(cls, streams: dict[StreamName, Stream]) -> dict[StreamName, Stream]:
        faults = [fault for name, stream in streams.items() for fault in channel_faults(name, stream)]
        if faults:
            refuse(faults)
        return streams

    @field_validator("runs")
    @classmethod
    def _runs_are_told_apart(cls, runs: tuple[Run, ...]) -> tuple[Run, ...]:
        faults = list(run_faults(runs))
        if faults:
            refuse(faults)
        return runs

    @model_validator(mode="after")
    def _streams_have_a_clock_and_runs_a_stream(self) -> Self:
        faults = []
        timeless = [name for name, stream in self.streams.items() if stream.time is None]
        if self.time is None and timeless:
            expected = f"a clock for {', '.join(timeless)}"
            faults.append(Fault(("streams", timeless[0]), expected, "none", NO_CLOCK))
        if self.runs and "gimbal" not in self.streams:
            expected = "[[runs]] only beside the stream gimbal"
            remedy = "add [streams.gimbal], or remove [[runs]]"
            faults.append(Fault(("runs",), expected, f"the streams {', '.join(self.streams)}", remedy))
        if faults:
            refuse(faults)
        return self

    def clock(self, name: StreamName) -> Clock:
        """The clock of a stream: its own, else the default."""
        clock = self.streams[name].time or self.time
        assert clock is not None, "checked when the settings were made"
        return clock


@dataclass(slots=True)
class _Samples:
    """The samples of one stream.

    Attributes
    ----------
    where : str
        Recording and stream, for errors.
    name : str
    stream : Stream
    table : pyarrow.Table
        The topic's columns, one row a sample.
    time : ndarray of int64, shape (n,)
        By the clock of the plan [ns].
    values : ndarray, shape (n, k)
        One column a channel of the plan, in the order of `CHANNELS`, in SI; NaN where a value is missing.
    findings : list
        What is to be said of them.
    """

    where: str
    name: StreamName
    stream: Stream
    table: pa.Table
    time: Time
    values: Float
    findings: Findings = field(default_factory=list)

    @property
    def channels(self) -> tuple[str, ...]:
        """Those of the plan, in the order of `CHANNELS`."""
        return tuple(c for c in CHANNELS[self.name][self.stream.quantity] if c in self.stream.channels)

    def only(self, some: Mask) -> _Samples:
        """Some of the samples."""
        table = self.table.filter(pa.array(some))
        return replace(self, table=table, time=self.time[some], values=self.values[some])

    def say(
        self, kind: str, severity: Severity, detail: str, where: Mask, channel: str | None = None
    ) -> None:
        """Add a finding about some of the samples, if there are any; ``detail`` follows their number."""
        time = self.time[where]
        if time.size:
            self.findings.append(
                finding(
                    "ingest",
                    self.name,
                    kind,
                    severity,
                    f"{counted(time.size, 'sample')} {detail}",
                    channel=channel,
                    start=int(time.min()),
                    end=int(time.max()),
                    count=int(time.size),
                )
            )


def run(recording: Path, settings: Settings, stand: Stand) -> dict[str, pa.Table]:
    """Read a recording into SI, body axes and the clock of the plan.

    Parameters
    ----------
    recording : Path
        A file or a rosbag2 folder.
    settings : Settings
        The channel map.
    stand : Stand
        How the base of a gimbal is mounted.

    Returns
    -------
    dict
        ``gyro`` or ``gyro_increments``, ``reference``, ``turntable``, and ``gimbal`` with ``runs``, as far as
        the plan maps them; ``findings``: losses and what was missing.

    Raises
    ------
    RecordingError
        If a recording cannot be read (exit code 3), or lacks a topic or field of the plan (exit code 2).
    StageError
        If the chosen clock is not there or stands still at 0, an encoder's turn is not what the plan says, a
        run has no sample, or how it is mounted is not said (exit code 2); or a stream has no sample (3).
    """
    streams, findings = _read(recording, settings)
    tables: dict[str, pa.Table] = {}
    for samples in streams.values():
        if samples.name == "gimbal":
            runs = listed(settings.runs)
            tables["runs"] = runs_table(runs, stand)
            tables["gimbal"], further = _gimbal(recording, samples, settings, runs)
            findings += further
        else:
            table, columns = _columns(samples)
            tables[table] = _table(table, samples, columns)
        findings += samples.findings
    return {**tables, "findings": rows("findings", findings)}


def _read(recording: Path, settings: Settings) -> tuple[dict[StreamName, _Samples], Findings]:
    """The streams of a recording, and the findings about the file."""
    requests = [_request(stream, settings.clock(name)) for name, stream in settings.streams.items()]
    read = formats.read(recording, requests, settings.text.layout)
    clocks = {name: settings.clock(name) for name in settings.streams}
    findings = [
        *losses(read.losses, settings.streams, clocks),
        *uncertain_times(read.losses, settings.streams, clocks),
    ]
    samples = {}
    for name, stream in settings.streams.items():
        samples[name] = _samples(recording, name, stream, clocks[name], read.tables[stream.topic])
        findings += contradicted_units(name, stream, clocks[name], read.units)
    return samples, findings


def _gimbal(
    recording: Path, own: _Samples, settings: Settings, runs: Sequence[Run]
) -> tuple[pa.Table, Findings]:
    """The angles of all runs, run by run, and the findings about further recordings."""
    recorded: dict[str | None, _Samples] = {None: own}
    findings: Findings = []
    alone = settings.model_copy(update={"streams": {"gimbal": own.stream}})
    for name, path in further_recordings(recording, runs).items():
        streams, of_file = _read(path, alone)
        recorded[name] = streams["gimbal"]
        findings += _said_of(name, of_file)
    outside = {name: np.ones(len(samples.time), dtype=np.bool_) for name, samples in recorded.items()}
    pieces = []
    for number, one in enumerate(runs):
        samples = recorded[one.recording]
        within = inside(one, samples.time, samples.where)
        outside[one.recording] &= ~within
        part = samples.only(within)
        table, columns = _columns(part)
        pieces.append(_table(table, part, {"run": np.full(len(part.time), number), **columns}))
    for source, samples in recorded.items():
        samples.say("outside the runs", "info", "outside all runs: left out", outside[source])
        if source is not None:
            findings += _said_of(source, samples.findings)
    return pa.concat_tables(pieces), findings


def _said_of(recording: str, findings: Findings) -> Findings:
    """The same findings with the further recording that they are about."""
    return [{**row, "detail": f"{recording!r}: {row['detail']}"} for row in findings]


def _request(stream: Stream, clock: Clock) -> Request:
    fields = [channel.field for channel in stream.channels.values()]
    if clock.counter is not None:
        fields.append(clock.counter)
    times = (
        (TimeField(clock.field, clock.unit),) if clock.field is not None and clock.unit is not None else ()
    )
    return Request(stream.topic, tuple(dict.fromkeys(fields)), times)


def _samples(recording: Path, name: StreamName, stream: Stream, clock: Clock, topic: pa.Table) -> _Samples:
    """The rows of a topic that are samples of the stream, in SI and with their time."""
    where = f"{recording}, stream {name!r}"
    channels = {c: stream.channels[c] for c in CHANNELS[name][stream.quantity] if c in stream.channels}
    present = {channel: valid(topic.column(c.field)) for channel, c in channels.items()}
    is_sample = np.logical_or.reduce(list(present.values()))
    time, timed = sample_times(topic, clock, where)
    kept = is_sample & timed
    if not kept.any():
        raise StageError(
            where,
            expected="samples",
            found=f"none with a time, of {is_sample.sum()}" if is_sample.any() else "none",
            remedy="check the recording, and the stream's fields and clock in the test plan",
            exit_code=ExitCode.INPUT,
        )
    of = DIMENSIONS[stream.quantity]
    with np.errstate(all="ignore"):  # infinities that were recorded
        values = [
            c.sign * (c.scale * numbers(topic.column(c.field))[kept] + c.offset) * _factor(c.unit, of)
            for c in channels.values()
        ]
    samples = _Samples(where, name, stream, topic.filter(pa.array(kept)), time[kept], np.column_stack(values))
    refuse_idle_stamps(samples.time, samples.table, clock, where)
    for channel, there in present.items():
        detail = f"without a value of {channels[channel].field!r}, which becomes NaN"
        samples.say("missing value", "warning", detail, ~there[kept], channel)
    untimed = int((is_sample & ~timed).sum())
    if untimed:
        detail = f"{counted(untimed, 'sample')} without a time by the clock of the test plan: left out"
        samples.findings.append(finding("ingest", name, "missing time", "error", detail, count=untimed))
    return samples


@np.errstate(all="ignore")  # infinities that were recorded
def _columns(samples: _Samples) -> tuple[str, Mapping[str, Float]]:
    """The table that the stream becomes, and its channels in body and reference axes."""
    match samples.stream.quantity:
        case "angular_rate":
            return "gyro", _named(samples.channels, _in_body_axes(samples))
        case "angle_increment":
            names = (f"increment_{channel}" for channel in samples.channels)
            return "gyro_increments", _named(names, _in_body_axes(samples))
        case "euler_krylov":
            return "reference", _named(ANGLES, _euler_krylov(samples))
        case "table_angle" | "table_rate":
            return "turntable", _named(samples.channels, _without_wraps(samples))
        case "gimbal_angles":
            angles = _without_wraps(samples)
            # Within a quarter turn of 0 wherever the gimbal can serve, so 350 deg is -10.
            if samples.stream.channels["alpha2"].wraps_at is not None:
                angles[:, 1] -= _whole_turns(angles[:, 1])
            return "gimbal", _named(samples.channels, angles)
        case "quaternion":
            angles = euler_krylov_from_quaternion(_turned(_unit_quaternions(samples), samples.stream))
            return "reference", _named(ANGLES, angles)


def _without_wraps(samples: _Samples) -> Float:
    """Angles of encoders, the beginnings of a count undone where the plan says that it wraps."""
    values = samples.values.copy()
    of = DIMENSIONS[samples.stream.quantity]
    for k, name in enumerate(samples.channels):
        channel = samples.stream.channels[name]
        if channel.wraps_at is not None:
            period = channel.wraps_at * abs(channel.scale) * _factor(channel.unit, of)
            values[:, k] = unwrapped(values[:, k], samples.time, period, f"{samples.where}, channel {name!r}")
    return values


def _whole_turns(angle: Float) -> float:
    """The whole turns by which an angle lies away from 0, judged by its median [rad]."""
    finite = angle[np.isfinite(angle)]
    return float(2 * np.pi * np.rint(np.median(finite) / (2 * np.pi))) if finite.size else 0.0


def _in_body_axes(samples: _Samples) -> Float:
    """``v_body = R v_sensor``, R the stream's rotation."""
    R = samples.stream.rotation
    return samples.values if R is None else samples.values @ np.array(R).T


def _euler_krylov(samples: _Samples) -> Float:
    """The angles as recorded, unless axes are to be turned: then through quaternions."""
    if samples.stream.rotation is None and samples.stream.reference_rotation is None:
        return samples.values
    quaternion = quaternion_from_euler_krylov(samples.values)
    return euler_krylov_from_quaternion(_turned(quaternion, samples.stream))


def _turned(quaternion: Float, stream: Stream) -> Float:
    """From what the reference reports to body and reference axes: ``R_ref A R_body^T``, as quaternions."""
    if stream.reference_rotation is not None:
        quaternion = quaternion_multiply(quaternion_from_matrix(stream.reference_rotation), quaternion)
    if stream.rotation is not None:
        to_sensor = quaternion_conjugate(quaternion_from_matrix(stream.rotation))
        quaternion = quaternion_multiply(quaternion, to_sensor)
    return quaternion


def _unit_quaternions(samples: _Samples) -> Float:
    """The quaternions at norm 1; what had to be bent for it is said."""
    norm = np.sqrt(np.sum(samples.values**2, axis=1))
    usable = np.isfinite(norm) & (norm > 0)
    off = usable & (np.abs(norm - 1) > UNIT_NORM)
    unit = np.where(usable[:, np.newaxis], samples.values / norm[:, np.newaxis], np.nan)
    if off.any():
        detail = f"whose quaternion has a norm of {norm[off].min():.6g} to {norm[off].max():.6g}: normalised"
        samples.say("quaternion norm", "warning", detail, off)
    detail = "whose quaternion is zero, which is no attitude: it becomes NaN"
    samples.say("zero quaternion", "warning", detail, norm == 0)
    return unit


def _table(name: str, samples: _Samples, columns: Mapping[str, Float]) -> pa.Table:
    """The table of a stream; a clock or channel that it does not have is null throughout."""
    clocks = {c: samples.table.column(c) for c in CLOCKS if c in samples.table.column_names}
    absent = dict.fromkeys(contracts.contract(name).schema.names, pa.nulls(samples.table.num_rows))
    return contracts.table(name, {**absent, "time": samples.time, **clocks, **columns})


def _named(names: Iterable[str], values: Float) -> dict[str, Float]:
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))


def _factor(unit: str, of: str) -> float:
    """Factor to SI of a unit that the plan's check has passed."""
    return units.FACTORS[of][units.canonical(unit)]
