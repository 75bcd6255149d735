"""The samples of one stream: the rows of its topic, in SI and with their time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import units
from pipeline.errors import ExitCode
from pipeline.formats.base import Request, TimeField
from pipeline.stages._sample_time import numbers, refuse_idle_stamps, sample_times, valid
from pipeline.stages.base import Severity, StageError, counted, finding
from pipeline.stages.channel_map import Clock, Stream
from pipeline.stages.quantities import QUANTITIES, StreamName

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]
Findings = list[dict[str, Any]]


@dataclass(slots=True)
class Samples:
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
        One column a channel of the plan, in the order of `QUANTITIES`, in SI; NaN where a value is missing.
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
        """Those of the plan, in the order of `QUANTITIES`."""
        return tuple(c for c in QUANTITIES[self.stream.quantity] if c in self.stream.channels)

    def only(self, some: Mask) -> Samples:
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


def request(stream: Stream, clock: Clock) -> Request:
    """The fields of a topic that a stream and its clock need."""
    fields = [channel.field for channel in stream.channels.values()]
    if clock.counter is not None:
        fields.append(clock.counter)
    times = (
        (TimeField(clock.field, clock.unit),) if clock.field is not None and clock.unit is not None else ()
    )
    return Request(stream.topic, tuple(dict.fromkeys(fields)), times)


def read_samples(recording: Path, name: StreamName, stream: Stream, clock: Clock, topic: pa.Table) -> Samples:
    """The rows of a topic that are samples of the stream, in SI and with their time."""
    where = f"{recording}, stream {name!r}"
    channels = {c: stream.channels[c] for c in QUANTITIES[stream.quantity] if c in stream.channels}
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
    with np.errstate(all="ignore"):  # infinities that were recorded
        values = [
            in_si(c.sign * (c.scale * numbers(topic.column(c.field))[kept] + c.offset), c.unit, of)
            for (c, of) in ((channels[k], QUANTITIES[stream.quantity][k]) for k in channels)
        ]
    samples = Samples(where, name, stream, topic.filter(pa.array(kept)), time[kept], np.column_stack(values))
    refuse_idle_stamps(samples.time, samples.table, clock, where)
    if stream.delay_s:
        samples = replace(samples, time=samples.time - round(Fraction(stream.delay_s) * 10**9))
        detail = f"time is {stream.delay_s:g} s before the stamps, which are late by the test plan"
        samples.findings.append(finding("ingest", name, "delay", "info", detail, count=len(samples.time)))
    for channel, there in present.items():
        detail = f"without a value of {channels[channel].field!r}, which becomes NaN"
        samples.say("missing value", "warning", detail, ~there[kept], channel)
    untimed = int((is_sample & ~timed).sum())
    if untimed:
        detail = f"{counted(untimed, 'sample')} without a time by the clock of the test plan: left out"
        samples.findings.append(finding("ingest", name, "missing time", "error", detail, count=untimed))
    return samples


def in_si(value: Float, unit: str, of: str) -> Float:
    """Values in SI, of a unit that the plan's check has passed."""
    return value * units.FACTORS[of][units.canonical(unit)] + units.zero(unit)
