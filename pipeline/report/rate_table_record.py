"""The rate of the table and each gyro over time, what of it was used, and how their clocks stand."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure

from pipeline.report import series, style
from pipeline.report.base import Section, Tables
from pipeline.report.formatting import measured, number
from pipeline.report.parts import html_table
from pipeline.report.rate_table_runs import (
    ABREAST,
    BORDER,
    CHANNELS,
    COLUMNS,
    DEG_S,
    Floats,
    Row,
    Run,
    main_fit,
    of_run,
    rows_of,
    runs,
)
from pipeline.report.series import Series
from pipeline.report.style import BLACK, BLUE, GREEN, PALE
from pipeline.report.style import COLUMNS as WIDE

_HEIGHT = 110
_SHADES = {"step": PALE, "turn": BLUE, "rest": PALE, "position": GREEN}
_WORDS = {"step": "steps", "turn": "turns (blue)", "rest": "rests (grey)", "position": "positions (green)"}


def record(tables: Tables) -> Section | None:
    """One column of panels a run: the table above, the gyros below."""
    found = runs(tables)
    if not found:
        return None
    used = _used(tables)
    blocks = [_panels(tables, run, used, alone=len(found) == 1) for run in found]
    words = [_WORDS[word] for word in _WORDS if any(word == row["kind"] for row in used)]
    shaded = f" Shaded: the {' and '.join(words)} that were used." if words else ""
    table = "The rate of the table, and the gyros" if _turntable(tables) else "The gyros"
    return Section(
        "The record",
        f"{table} as recorded.{shaded}",
        style.grid(_in_rows(blocks)),
        _clocks(tables, found),
    )


def _turntable(tables: Tables) -> bool:
    table = tables.get("turntable")
    return table is not None and table.num_rows > 0


def _used(tables: Tables) -> list[Row]:
    """The stretches that the calibration is made of, or the steps where there is none."""
    rows = main_fit(rows_of(tables, "calibration_residuals"))
    return rows or [row | {"kind": "step"} for row in rows_of(tables, "rate_steps")]


def _in_rows(blocks: Sequence[Sequence[figure]]) -> list[list[figure | None]]:
    """Runs side by side, as many as go abreast, their panels below each other."""
    wide = min(len(blocks), ABREAST)
    arranged: list[list[figure | None]] = []
    for first in range(0, len(blocks), wide):
        group = list(blocks[first : first + wide])
        height = max(map(len, group))
        for place in range(height):
            row: list[figure | None] = [block[place] if place < len(block) else None for block in group]
            arranged.append(row + [None] * (wide - len(group)))
    return arranged


def _panels(tables: Tables, run: Run, used: Sequence[Row], *, alone: bool) -> list[figure]:
    curves = _curves(tables, run, WIDE if alone else COLUMNS)
    x_range = style.span(0.0, run.clock.duration)
    time = f"time from the {'record' if run.number is None else 'run'}'s start [s]"
    made = []
    for place, (label, colour, curve) in enumerate(curves):
        last = place == len(curves) - 1
        panel = style.panel(
            f"{label} [deg/s]",
            x_range,
            height=_HEIGHT,
            x_label=time if last else None,
            ticks=10 if alone else 5,
        )
        if not alone:
            panel.min_border_left = BORDER
        _shade(panel, run, used)
        drawn = style.curve(
            panel,
            curve.time,
            DEG_S * curve.values["value"],
            colour,
            gap=curve.gap,
            width=1.6 if label == "table" else 1.0,
            columns=WIDE if alone else COLUMNS,
        )
        style.hover(panel, drawn, [("time [s]", "x"), ("rate [deg/s]", "y")])
        made.append(panel)
    if made and run.title:
        style.heading(made[0], run.title)
    return made


def _curves(tables: Tables, run: Run, columns: int) -> list[tuple[str, str, Series]]:
    """What is drawn of a run: name, colour, and the curve [rad/s] under the name ``value``."""
    parts = {name: of_run(tables[name], run.number) for name in ("gyro", "turntable") if name in tables}
    curves = []
    for name, label, colour in (
        *(("turntable", label, BLACK) for label in ("rate", "angle")),
        *(("gyro", channel, BLUE) for channel in CHANNELS),
    ):
        if name in parts and parts[name].column(label).null_count < parts[name].num_rows:
            curve = series.read(parts, name, run.clock, [label])
            if curve is not None:
                value = curve.values[label]
                if label == "angle":
                    curves.append(("table", colour, _mean_rate(curve.time, value, columns)))
                else:
                    shown = Series(curve.time, {"value": value}, curve.interval)
                    curves.append(("table" if name == "turntable" else label, colour, shown))
    return curves


def _mean_rate(time: Floats, angle: Floats, columns: int) -> Series:
    """The mean rate in each column of pixels, of a table whose angle was recorded."""
    there = np.isfinite(angle) & np.append(True, np.diff(time) > 0)
    time, angle = time[there], angle[there]
    kept = np.unique(np.linspace(0, len(time) - 1, columns + 1).round().astype(np.int64))
    t, length = time[kept], np.diff(time[kept])
    return Series((t[1:] + t[:-1]) / 2, {"value": np.diff(angle[kept]) / length}, float(np.median(length)))


def _shade(panel: figure, run: Run, used: Sequence[Row]) -> None:
    mine = {(row["start"], row["stop"], row["kind"]) for row in used if row["run"] == run.number}
    for word, colour in _SHADES.items():
        ends = np.array(sorted((start, stop) for start, stop, kind in mine if kind == word), dtype=np.int64)
        if len(ends):
            seconds = run.clock.seconds(ends)
            source = ColumnDataSource({"start": seconds[:, 0], "stop": seconds[:, 1]})
            panel.vstrip(
                x0="start",
                x1="stop",
                source=source,
                fill_color=colour,
                fill_alpha=0.28 if colour == PALE else 0.14,
                line_color=colour,
                line_alpha=0.5,
                level="underlay",
            )


def _clocks(tables: Tables, found: Sequence[Run]) -> str:
    """The steps and the time offset of each run."""
    told: dict[tuple[str, str], Row] = {
        (row["channel"], row["name"]): row for row in rows_of(tables, "metrics") if row["stage"] == "steps"
    }
    names = {row["run"]: row["name"] for row in rows_of(tables, "mountings")}
    body = ""
    for run in found:
        channel = "" if run.number is None else names[run.number]
        offset, steps = (told.get((channel, name)) for name in ("time_offset", "step_count"))
        if not steps or not steps["value"]:
            continue
        body += (
            f"<tr><td>{escape(run.title or 'the recording')}</td><td class=num>{number(steps['value'])}</td>"
            f"<td class=num>{_milliseconds(offset)}</td></tr>"
        )
    heads = ("run", "steps", "the gyro's clock minus the table's [ms]")
    return html_table(heads, body, (1, 2), "matrix") if body else ""


def _milliseconds(row: dict[str, Any] | None) -> str:
    if row is None or row["value"] is None:
        return "not estimated"
    error = row["standard_error"]
    return measured(1e3 * row["value"], None if error is None else 1e3 * error)
