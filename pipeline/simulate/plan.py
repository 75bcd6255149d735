"""The test plan that goes with a simulated recording: ready to run, and commented."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.formats.text import TIME_COLUMN
from pipeline.simulate.streams import RecordedStream

Value = str | int | float | bool


@dataclass(frozen=True, slots=True)
class Limit:
    """One limit of a test plan, with the reason for it; the values are in the figure's unit."""

    metric: str
    channel: str
    upper: float
    marginal_upper: float | None = None
    reason: str = ""


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
        What the figures must not exceed.
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


def plan_text(streams: Sequence[RecordedStream], processing: Processing) -> str:
    """The test plan, as TOML.

    Parameters
    ----------
    streams : sequence of RecordedStream
        What was recorded.
    processing : Processing
        How it is to be processed.
    """
    text = not any(stream.topic for stream in streams)
    lines = [
        "# Test plan of a simulated recording; its truth is in the .truth.json beside it.",
        'procedure = "coning"',
        f"title = {_toml(processing.title)}",
        "",
        "[stand]",
        f"name = {_toml(processing.stand)}",
        "",
        "[time]",
        *([f"field = {_toml(TIME_COLUMN)}", 'unit = "s"'] if text else ['clock = "header_stamp"']),
    ]
    for stream in streams:
        lines += ["", f"[streams.{stream.name}]"]
        if not text:
            lines.append(f"topic = {_toml(stream.topic)}")
        lines.append(f"quantity = {_toml(stream.quantity)}")
        for channel, path in stream.fields.items():
            lines.append(f"channels.{channel} = {{ field = {_toml(path)}, unit = {_toml(stream.unit)} }}")
    for stage, settings in processing.stages.items():
        lines += ["", f"[{stage}]"]
        lines += [f"{key} = {_toml(value)}" for key, value in settings.items()]
    for limit in processing.limits:
        lines += ["", f"# {limit.reason}"] if limit.reason else [""]
        lines += [
            "[[limits]]",
            f"metric = {_toml(limit.metric)}",
            f"channel = {_toml(limit.channel)}",
            f"upper = {_toml(limit.upper)}",
        ]
        if limit.marginal_upper is not None:
            lines.append(f"marginal_upper = {_toml(limit.marginal_upper)}")
    return "\n".join(lines) + "\n"


def _toml(value: Value) -> str:
    """A TOML value: JSON's strings, booleans and numbers are TOML's."""
    return json.dumps(value, ensure_ascii=False)
