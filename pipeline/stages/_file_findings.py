"""What ingest finds about a file as a whole: what could not be read, and units that it states otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pipeline import units
from pipeline.formats.base import Loss
from pipeline.stages.base import counted, finding
from pipeline.stages.channel_map import Clock, Stream
from pipeline.stages.quantities import StreamName

Streams = Mapping[StreamName, Stream]
Clocks = Mapping[StreamName, Clock]


def losses(lost: Sequence[Loss], streams: Streams, clocks: Clocks) -> Iterator[dict[str, Any]]:
    """Findings of what could not be read; of the one stream of the topic, else of the recording."""
    topics: dict[str, list[StreamName]] = {}
    for name, stream in streams.items():
        topics.setdefault(stream.topic, []).append(name)
    for loss in lost:
        concerned = topics.get(loss.topic, [])
        about_stream = concerned[0] if len(concerned) == 1 else None
        logged = about_stream is not None and clocks[about_stream].clock == "log_time"
        about = f" of topic {loss.topic!r}" if loss.topic else ""
        detail = f"{counted(loss.count, loss.unit.removesuffix('s'))}{about}: {loss.detail}"
        if loss.start is not None and loss.end is not None and not logged:
            detail += f" (log time {loss.start} … {loss.end} ns)"
        yield finding(
            "ingest",
            about_stream or "recording",
            "loss",
            "error",
            detail,
            start=loss.start if logged else None,
            end=loss.end if logged else None,
            count=loss.count,
        )


def uncertain_times(lost: Sequence[Loss], streams: Streams, clocks: Clocks) -> Iterator[dict[str, Any]]:
    """Findings of streams that are timed by their place in the file, of which something is lost."""
    for name, stream in streams.items():
        clock = clocks[name]
        count = sum(loss.topic in ("", stream.topic) for loss in lost)
        if clock.rate is not None and clock.counter is None and count:
            detail = (
                f"samples are timed by their place in the file at {clock.rate:g} Hz; behind each loss they "
                "stand too early by what was lost, unless the plan names a counter"
            )
            yield finding("ingest", name, "uncertain time", "warning", detail, count=count)


def contradicted_units(
    name: StreamName, stream: Stream, clock: Clock, stated: Mapping[str, str]
) -> Iterator[dict[str, Any]]:
    """Findings of fields whose unit the file states otherwise than the plan; a scale may be why it does."""
    planned: list[tuple[str, str, str | None]] = [
        (c.field, c.unit, channel) for channel, c in stream.channels.items() if c.scale == 1
    ]
    if clock.field is not None and clock.unit is not None:
        planned.append((clock.field, clock.unit, None))
    for path, unit, channel in planned:
        of = units.dimension(stated.get(path, ""))
        if of is not None and units.canonical(stated[path]) != units.canonical(unit):
            detail = (
                f"the file states {stated[path]!r} for {path!r}, the test plan {unit!r}, which is followed"
            )
            yield finding("ingest", name, "contradicted unit", "warning", detail, channel=channel)
