"""Findings on the time line: one lane a kind, in the colour of the severity."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import pyarrow as pa
from bokeh.models import ColumnDataSource, Range1d
from bokeh.plotting import figure

from pipeline.report.base import Clock
from pipeline.report.formatting import number, plural
from pipeline.report.style import COLUMNS, SEVERITY, hover, panel, plain, span

_LANES = 12
_LANE_HEIGHT = 24  # pixels
_LABEL = 15  # letters that fit beside a lane
_RANK = tuple(SEVERITY)  # gravest first
_REST = "other kinds"

Mark = dict[str, Any]


def marks(findings: pa.Table, clock: Clock, streams: Collection[str] | None = None) -> list[Mark]:
    """What to draw: findings that have a time, those of one kind within a column of pixels taken together.

    Parameters
    ----------
    findings : pyarrow.Table
        As its contract says.
    clock : Clock
        The record's time; what lies outside is drawn at its edge.
    streams : collection of str, optional
        Only the findings in these.

    Returns
    -------
    list of dict
        ``kind``, ``severity``, ``start`` and ``end`` [s], ``number`` of findings taken together, and
        ``stream`` and ``detail`` of the first, by lanes in the order in which they begin.
    """
    timed = [
        row
        for row in findings.to_pylist()
        if row["start"] is not None and (streams is None or row["stream"] in streams)
    ]
    lanes: dict[str, list[Mark]] = {}
    for row in sorted(timed, key=lambda row: row["start"]):
        start, end = _span(row, clock)
        kind = row["kind"] if row["kind"] in lanes or len(lanes) < _LANES - 1 else _REST
        lane = lanes.setdefault(kind, [])
        if lane and start <= lane[-1]["end"] + clock.duration / COLUMNS:
            last = lane[-1]
            last["end"] = max(last["end"], end)
            last["severity"] = min(last["severity"], row["severity"], key=_RANK.index)
            last["number"] += 1
        else:
            lane.append(
                {
                    "kind": kind,
                    "severity": row["severity"],
                    "start": start,
                    "end": end,
                    "number": 1,
                    "stream": row["stream"],
                    "detail": row["detail"],
                }
            )
    return [mark for lane in lanes.values() for mark in lane]


def lanes(drawn: list[Mark], x_range: Range1d, x_label: str) -> figure:
    """The strip of lanes that stands below the curves."""
    kinds = list(dict.fromkeys(mark["kind"] for mark in drawn))
    made = panel("findings", x_range, height=_LANE_HEIGHT * len(kinds) + 12, x_label=x_label)
    made.y_range = span(len(kinds) - 0.4, -0.6)
    made.yaxis.ticker = list(range(len(kinds)))
    made.yaxis.major_label_overrides = {lane: plain(_short(kind)) for lane, kind in enumerate(kinds)}
    made.yaxis.axis_label = None
    made.ygrid.grid_line_color = None
    rows = [kinds.index(mark["kind"]) for mark in drawn]
    source = ColumnDataSource(
        {
            "start": [mark["start"] for mark in drawn],
            "end": [mark["end"] for mark in drawn],
            "top": [row - 0.3 for row in rows],
            "bottom": [row + 0.3 for row in rows],
            "colour": [SEVERITY[mark["severity"]] for mark in drawn],
            "what": [_what(mark) for mark in drawn],
            "when": [_when(mark) for mark in drawn],
            "detail": [mark["detail"] for mark in drawn],
        }
    )
    drawn_marks = made.quad(
        left="start",
        right="end",
        top="top",
        bottom="bottom",
        source=source,
        fill_color="colour",
        line_color="colour",
        line_width=2,  # a single sample is seen too
    )
    hover(made, drawn_marks, [("finding", "what"), ("time", "when"), ("detail", "detail")])
    return made


def shade(made: figure, drawn: list[Mark]) -> None:
    """Tint the curves where a warning or an error lies."""
    grave = [mark for mark in drawn if mark["severity"] != "info"]
    if not grave:
        return
    source = ColumnDataSource(
        {
            "start": [mark["start"] for mark in grave],
            "end": [mark["end"] for mark in grave],
            "colour": [SEVERITY[mark["severity"]] for mark in grave],
        }
    )
    made.vstrip(
        x0="start",
        x1="end",
        source=source,
        fill_color="colour",
        fill_alpha=0.10,
        line_color="colour",
        line_alpha=0.35,
        level="underlay",
    )


def _span(row: Mark, clock: Clock) -> tuple[float, float]:
    end = row["start"] if row["end"] is None else row["end"]
    first, last = sorted(
        min(max((t - clock.origin) * 1e-9, 0.0), clock.duration) for t in (row["start"], end)
    )
    return first, last


def _short(kind: str) -> str:
    return kind if len(kind) <= _LABEL else kind[: _LABEL - 1] + "…"


def _what(mark: Mark) -> str:
    together = "" if mark["number"] == 1 else f", {plural(mark['number'], 'finding')} taken together"
    return f"{mark['severity']}: {mark['kind']} in {mark['stream']}{together}"


def _when(mark: Mark) -> str:
    if mark["start"] == mark["end"]:
        return f"{number(mark['start'])} s"
    return f"{number(mark['start'])} s to {number(mark['end'])} s"
