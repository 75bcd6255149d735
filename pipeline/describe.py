"""What a recording holds, for a person and for a program: topics, types, counts, rates, clocks, duration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline.formats.base import Inspection, Topic


def as_dict(inspection: Inspection) -> dict[str, Any]:
    """The inspection as plain values, ready for JSON; times in nanoseconds, durations in seconds."""
    return {
        "recording": str(inspection.path),
        "format": inspection.format,
        "duration": _duration(inspection),
        "topics": [_topic(t) for t in inspection.topics],
        "losses": [
            {"topic": loss.topic, "detail": loss.detail, "count": loss.count, "unit": loss.unit}
            for loss in inspection.losses
        ],
    }


def as_text(inspection: Inspection) -> str:
    """The inspection as lines for a terminal; every text from the recording is made printable."""
    return "\n".join(_lines(inspection))


def _topic(topic: Topic) -> dict[str, Any]:
    return {
        "name": topic.name,
        "type": topic.message_type,
        "encoding": topic.encoding,
        "count": topic.count,
        "clocks": {
            clock: {"first": first, "last": last, "rate": _rate(topic.count, first, last)}
            for clock, (first, last) in topic.clocks.items()
        },
        "fields": [{"path": f.path, "type": f.type, "unit": f.unit} for f in topic.fields],
        "problem": topic.problem,
    }


def _lines(inspection: Inspection) -> Iterator[str]:
    duration = _duration(inspection)
    length = "no clock" if duration is None else f"{duration:.6g} s"
    path = _printable(str(inspection.path))
    yield f"{path}: {inspection.format}, {len(inspection.topics)} topics, {length}"
    for topic in inspection.topics:
        name = _printable(topic.name) or "(the file)"
        yield f"{name}  {_printable(topic.message_type)}  {topic.encoding}  {topic.count} samples"
        for clock, (first, last) in topic.clocks.items():
            rate = _rate(topic.count, first, last)
            mean = "" if rate is None else f", mean {rate:.6g} Hz"
            yield f"    {clock:13} {first} … {last} ns, {(last - first) * 1e-9:.6g} s{mean}"
        for f in topic.fields:
            yield f"    {_printable(f.path)}  {f.type}{'  ' + _printable(f.unit) if f.unit else ''}"
        if topic.problem:
            yield f"    cannot be decoded: {_printable(topic.problem)}"
    for loss in inspection.losses:
        yield f"lost: {_printable(loss.topic)}: {_printable(loss.detail)} ({loss.count} {loss.unit})"


def _duration(inspection: Inspection) -> float | None:
    """The longest span of any topic by the log time where there is one, else by any clock [s]."""
    spans = [
        last - first for t in inspection.topics for c, (first, last) in t.clocks.items() if c == "log_time"
    ]
    spans = spans or [last - first for t in inspection.topics for first, last in t.clocks.values()]
    return max(spans) * 1e-9 if spans else None


def _rate(count: int, first: int, last: int) -> float | None:
    return (count - 1) / ((last - first) * 1e-9) if count > 1 and last > first else None


def _printable(text: str) -> str:
    """The text on one line, control characters shown as escapes."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
