"""Ingest: the one door. It alone opens the recording, and converts to SI and radians, once.

The channel map of the test plan (`channel_map`) says which topic or column feeds which channel, in which
unit and by which clock. Samples stay in the order of the file, under the time that was recorded; a sample
without time cannot be kept. What could not be read, and what was missing in it, becomes findings.

A stream's table holds the messages in which at least one of its channels is present: a text file holds all
streams in one, with empty cells where one of them has no sample. The columns of a gyro's channel that the
plan does not map are null. Rates are corrected by the calibration that the plan names (`_calibrated_rates`).

Gimbal angles, or what a rate table and the gyro on it recorded, are parted into the runs of the plan
(`_runs`, `_mountings`), which may lie in further recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np
import pyarrow as pa
from pydantic import Field, field_validator, model_validator

from pipeline import formats
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._calibrated_rates import calibration_faults, corrected
from pipeline.stages._calibration_file import read as read_calibration
from pipeline.stages._file_findings import contradicted_units, losses, uncertain_times
from pipeline.stages._mountings import ON_TABLE, mountings_table, run_stream_faults
from pipeline.stages._navigation_streams import TABLES as NAVIGATION
from pipeline.stages._runs import (
    Run,
    further_recordings,
    inside,
    listed,
    neighbour,
    run_faults,
    runs_table,
    within,
)
from pipeline.stages._samples import Findings, Samples, read_samples, request
from pipeline.stages._stream_tables import columns_of, stream_table
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand, rows
from pipeline.stages.channel_map import NO_CLOCK, Clock, Stream, Text, channel_faults
from pipeline.stages.quantities import StreamName

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES = (
    "gyro",
    "gyro_increments",
    "reference",
    "turntable",
    "temperature",
    "gimbal",
    "runs",
    "mountings",
    *NAVIGATION,
    "findings",
)
METRICS: tuple[str, ...] = ()


class Settings(_Settings):
    """The channel map: at the top level of the test plan, as [time], [streams.…], [[runs]] and [text]."""

    time: Clock | None = Field(None, description="clock of every stream that has none of its own")
    streams: dict[StreamName, Stream] = Field(min_length=1, description="what the recording holds")
    runs: tuple[Run, ...] = Field(
        (),
        description="runs of one gyro in a gimbal, or on a rate table; none: the whole recording is one run",
    )
    text: Text = Field(
        default_factory=Text, description="layout of a text file, where it should not be found out by itself"
    )

    @field_validator("streams")
    @classmethod
    def _streams_are_whole(cls, streams: dict[StreamName, Stream]) -> dict[StreamName, Stream]:
        faults = [fault for name, stream in streams.items() for fault in channel_faults(name, stream)]
        faults += calibration_faults(streams)
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
        faults += run_stream_faults(self.runs, self.streams)
        if faults:
            refuse(faults)
        return self

    def clock(self, name: StreamName) -> Clock:
        """The clock of a stream: its own, else the default."""
        clock = self.streams[name].time or self.time
        assert clock is not None, "checked when the settings were made"
        return clock

    def calibration_beside(self, recording: Path) -> Path | None:
        """The calibration file beside a recording that corrects its gyro, whether it is there or not."""
        name = self.streams["gyro"].calibration if "gyro" in self.streams else None
        return None if name is None else neighbour(recording, name)


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
        ``gyro`` or ``gyro_increments``, ``reference``, ``turntable``, ``temperature``, and ``gimbal`` with
        ``runs``, and those of a navigation, as far as the plan maps them; ``mountings`` where it lists runs
        of a gyro; ``findings``: losses and what was missing.

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
    parted = _parted(settings)
    if "gimbal" in parted:
        tables["runs"] = runs_table(listed(settings.runs), stand)
    elif parted:
        tables["mountings"] = mountings_table(settings.runs)
    if parted:
        own = {name: streams[name] for name in parted}
        of_runs, further = _by_runs(recording, own, settings)
        tables |= of_runs
        findings += further
    for name, samples in streams.items():
        if name not in parted:
            table, columns = columns_of(samples)
            tables[table] = stream_table(table, samples, columns)
        findings += samples.findings
    return {**tables, "findings": rows("findings", findings)}


def _parted(settings: Settings) -> tuple[StreamName, ...]:
    """The streams that are parted into runs; first the one from whose first sample runs are counted."""
    if "gimbal" in settings.streams:
        return ("gimbal",)
    return tuple(name for name in ON_TABLE if name in settings.streams) if settings.runs else ()


def _read(recording: Path, settings: Settings) -> tuple[dict[StreamName, Samples], Findings]:
    """The streams of a recording, and the findings about the file."""
    requests = [request(stream, settings.clock(name)) for name, stream in settings.streams.items()]
    read = formats.read(recording, requests, settings.text.layout)
    clocks = {name: settings.clock(name) for name in settings.streams}
    findings = [
        *losses(read.losses, settings.streams, clocks),
        *uncertain_times(read.losses, settings.streams, clocks),
    ]
    samples = {}
    for name, stream in settings.streams.items():
        samples[name] = read_samples(recording, name, stream, clocks[name], read.tables[stream.topic])
        findings += contradicted_units(name, stream, clocks[name], read.units)
    calibration = settings.calibration_beside(recording)
    if calibration is not None:
        of_gyro = read_calibration(calibration)
        samples["gyro"] = corrected(samples["gyro"], of_gyro, samples.get("temperature"))
    return samples, findings


def _by_runs(
    recording: Path, own: Mapping[StreamName, Samples], settings: Settings
) -> tuple[dict[str, pa.Table], Findings]:
    """The streams that are parted, run by run, and the findings about further recordings."""
    runs = listed(settings.runs)
    recorded: dict[str | None, Mapping[StreamName, Samples]] = {None: own}
    findings: Findings = []
    alone = settings.model_copy(update={"streams": {name: of.stream for name, of in own.items()}})
    for name, path in further_recordings(recording, runs).items():
        recorded[name], of_file = _read(path, alone)
        findings += _said_of(name, of_file)
    outside = {
        source: {name: np.ones(len(of.time), dtype=np.bool_) for name, of in streams.items()}
        for source, streams in recorded.items()
    }
    pieces: dict[str, list[pa.Table]] = {}
    for number, one in enumerate(runs):
        streams = recorded[one.recording]
        leading = streams[next(iter(own))]
        first = int(leading.time[0])
        for name, samples in streams.items():
            own_part = (
                inside(one, samples.time, samples.where)
                if samples is leading
                else within(one, samples.time, first)
            )
            outside[one.recording][name] &= ~own_part
            part = samples.only(own_part)
            table, columns = columns_of(part)
            numbered = {"run": np.full(len(part.time), number), **columns}
            pieces.setdefault(table, []).append(stream_table(table, part, numbered))
    for source, streams in recorded.items():
        for name, samples in streams.items():
            samples.say("outside the runs", "info", "outside all runs: left out", outside[source][name])
            if source is not None:
                findings += _said_of(source, samples.findings)
    return {table: pa.concat_tables(parts) for table, parts in pieces.items()}, findings


def _said_of(recording: str, findings: Findings) -> Findings:
    """The same findings with the further recording that they are about."""
    return [{**row, "detail": f"{recording!r}: {row['detail']}"} for row in findings]
