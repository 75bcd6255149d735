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

from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
import pyarrow as pa
from pydantic import Field, field_validator, model_validator

from pipeline import formats
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._file_findings import contradicted_units, losses, uncertain_times
from pipeline.stages._navigation_streams import TABLES as NAVIGATION
from pipeline.stages._runs import Run, further_recordings, inside, listed, run_faults, runs_table
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
    *NAVIGATION,
    "findings",
)
METRICS: tuple[str, ...] = ()


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
        ``runs``, and those of a navigation, as far as the plan maps them; ``findings``: losses and what was
        missing.

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
            table, columns = columns_of(samples)
            tables[table] = stream_table(table, samples, columns)
        findings += samples.findings
    return {**tables, "findings": rows("findings", findings)}


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
    return samples, findings


def _gimbal(
    recording: Path, own: Samples, settings: Settings, runs: Sequence[Run]
) -> tuple[pa.Table, Findings]:
    """The angles of all runs, run by run, and the findings about further recordings."""
    recorded: dict[str | None, Samples] = {None: own}
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
        table, columns = columns_of(part)
        pieces.append(stream_table(table, part, {"run": np.full(len(part.time), number), **columns}))
    for source, samples in recorded.items():
        samples.say("outside the runs", "info", "outside all runs: left out", outside[source])
        if source is not None:
            findings += _said_of(source, samples.findings)
    return pa.concat_tables(pieces), findings


def _said_of(recording: str, findings: Findings) -> Findings:
    """The same findings with the further recording that they are about."""
    return [{**row, "detail": f"{recording!r}: {row['detail']}"} for row in findings]
