"""The test plan that goes with a simulated recording: ready to run, and commented."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.formats.text import TIME_COLUMN
from pipeline.simulate.streams import RecordedStream

Value = str | int | float | bool | Sequence[str] | Sequence[float] | Sequence[Mapping[str, str | int | float]]


@dataclass(frozen=True, slots=True)
class Limit:
    """One limit of a test plan, with the reason for it; the values are in the figure's unit."""

    metric: str
    channel: str
    upper: float | None = None
    marginal_upper: float | None = None
    reason: str = ""
    lower: float | None = None


@dataclass(frozen=True, slots=True)
class Processing:
    """How a recording is to be processed, and judged.

    Attributes
    ----------
    title, stand : str
        Of the run, and of the stand.
    stages : mapping
        Settings by stage; those left out have their defaults.
    limits : sequence of Limit
        What the figures must be.
    """

    title: str = "Simulated coning"
    stand: str = "simulated vibration stand"
    stages: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    limits: Sequence[Limit] = ()


def paper_stages(oversampling: int) -> dict[str, Mapping[str, Value]]:
    """Settings as in Godorov & Lutmanov (2016): local cubic interpolation, trend by extremes.

    Parameters
    ----------
    oversampling : int
        Grid steps per sample interval; theirs, of 400 Hz, is 50.
    """
    return {
        "interpolate": {"method": "local_polynomial", "degree": 3, "oversampling": oversampling},
        "detrend": {"method": "extremes"},
    }


def plan_text(
    procedure: str,
    streams: Sequence[RecordedStream],
    processing: Processing,
    stand: Mapping[str, Value] | None = None,
    runs: Sequence[Mapping[str, Value]] = (),
) -> str:
    """The test plan, as TOML.

    Parameters
    ----------
    procedure : str
        Name of the procedure.
    streams : sequence of RecordedStream
        What was recorded.
    processing : Processing
        How it is to be processed.
    stand : mapping, optional
        What the plan says of the stand beside its name.
    runs : sequence of mapping, optional
        What it says of each run, where there are several.
    """
    text = not any(stream.topic for stream in streams)
    lines = [
        "# Test plan of a simulated recording; its truth is in the .truth.json beside it.",
        f"procedure = {_toml(procedure)}",
        f"title = {_toml(processing.title)}",
        "",
        "[stand]",
        *_keys({"name": processing.stand} | dict(stand or {})),
        "",
        "[time]",
        *([f"field = {_toml(TIME_COLUMN)}", 'unit = "s"'] if text else ['clock = "header_stamp"']),
    ]
    for stream in streams:
        lines += ["", *_stream(stream)]
    for run in runs:
        lines += ["", "[[runs]]", *_keys(run)]
    for stage, settings in processing.stages.items():
        lines += ["", f"[{stage}]", *_keys(settings)]
    for limit in processing.limits:
        lines += ["", *_limit(limit)]
    return "\n".join(lines) + "\n"


def _stream(stream: RecordedStream) -> list[str]:
    topic = [f"topic = {_toml(stream.topic)}"] if stream.topic else []
    scale = "" if stream.scale == 1 else f", scale = {_toml(stream.scale)}"
    wraps = "" if stream.wraps_at is None else f", wraps_at = {_toml(stream.wraps_at)}"
    channels = []
    for channel, path in stream.fields.items():
        unit = _toml(stream.units[channel])
        channels.append(f"channels.{channel} = {{ field = {_toml(path)}, unit = {unit}{scale}{wraps} }}")
    return [f"[streams.{stream.name}]", *topic, f"quantity = {_toml(stream.quantity)}", *channels]


def _limit(limit: Limit) -> list[str]:
    bounds = {"lower": limit.lower, "upper": limit.upper, "marginal_upper": limit.marginal_upper}
    return [
        *([f"# {limit.reason}"] if limit.reason else []),
        "[[limits]]",
        *_keys({"metric": limit.metric, "channel": limit.channel}),
        *_keys({key: bound for key, bound in bounds.items() if bound is not None}),
    ]


def _keys(values: Mapping[str, Value]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in values.items()]


def _toml(value: Value) -> str:
    """A TOML value: JSON's strings, booleans, numbers and lists of them are TOML's."""
    tables = [one for one in value if isinstance(one, Mapping)] if isinstance(value, Sequence) else []
    if tables:
        return "[\n" + "".join(f"    {{ {', '.join(_keys(one))} }},\n" for one in tables) + "]"
    return json.dumps(value, ensure_ascii=False)
