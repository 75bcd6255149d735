"""What rotation of the platform does to each channel: growth against its rate, and the error against time."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models.annotations import BoxAnnotation
from numpy.typing import NDArray

from pipeline.report import scale, style
from pipeline.report.base import Section, Tables, column
from pipeline.report.static_panels import (
    DEG_ROOT_H,
    DEG_S,
    FAINT,
    Floats,
    Panel,
    Panels,
    band,
    by_channel,
    line,
    log_span,
    mark,
    panels,
    plainly,
    rate_in_words,
    recommended,
)
from pipeline.report.style import BLACK, BLUE, GREEN, VERMILION

_FAR = 1e-3  # of the scale's end: as far as anybody will move a panel


def growth_by_rate(tables: Tables) -> Section | None:
    """One panel a channel: the growth coefficient against the rate of rotation."""
    channels = by_channel(tables, "modulation", "rotation_rate")
    if not channels:
        return None
    whole, rates = tables["modulation"], recommended(tables)
    names = ("growth", "reversing_growth")
    made = panels(
        plainly(channels),
        log_span([column(whole, "rotation_rate") * DEG_S, *(np.array([r * DEG_S]) for r in rates.values())]),
        log_span([np.sqrt(column(whole, name)) * DEG_ROOT_H for name in names]),
        "rotation rate [deg/s]",
        "√S [deg/√h]",
    )
    for channel, table in channels.items():
        _draw_growth(made, channel, table)
        if rates.get(channel, 0.0) > 0.0:
            mark(made.of[channel], rates[channel] * DEG_S, rate_in_words(rates[channel]))
    worse = pc.any(whole["worse"]).as_py()
    return Section(
        "What rotation does",
        "S is the variance that the integrated error gains a second while the platform turns, √S the angle "
        "random walk that remains, with the 95 % interval that the model's errors give."
        + _advice(tables, channels)
        + (" Shaded: rates at which the error grows faster than without rotation." if worse else ""),
        made.arranged(),
    )


def _advice(tables: Tables, channels: dict[str, pa.Table]) -> str:
    """The recommended rates in words."""
    rates = {channel: rate for channel, rate in recommended(tables).items() if channel in channels}
    turning = [f"{rate_in_words(rate)} for {channel}" for channel, rate in rates.items() if rate > 0.0]
    still = [channel for channel, rate in rates.items() if rate == 0.0]
    advice = [f" Recommended: {', '.join(turning)}."] if turning else []
    if still:
        advice.append(f" No rotation is needed for {', '.join(still)}.")
    return "".join(advice)


def _draw_growth(made: Panels, channel: str, table: pa.Table) -> None:
    panel, rate = made.of[channel], column(table, "rotation_rate") * DEG_S
    growth, low, high, reversing, schuler = (
        np.sqrt(column(table, name)) * DEG_ROOT_H
        for name in ("growth", "lower", "upper", "reversing_growth", "schuler_growth")
    )
    _shade(panel, rate, column(table, "worse") > 0.0)
    shaded = band(panel, rate, low, high, BLUE)
    curve = line(panel, rate, growth, BLUE, width=2.0)
    made.note("constant rotation", curve, shaded)
    if np.isfinite(reversing).any():
        made.note("to and fro, one turn each way", line(panel, rate, reversing, GREEN, dash="6 3"))
    if np.isfinite(schuler).any():
        made.note("beyond Schuler's period", line(panel, rate, schuler, FAINT, width=1.2))
    style.hover(panel.figure, curve, [("rotation rate [deg/s]", "x"), ("√S [deg/√h]", "y")])
    if rate[0] == 0.0 and np.isfinite(growth[0]):
        ends = np.array(panel.x)
        made.note("without rotation", line(panel, ends, np.full(2, growth[0]), BLACK, width=1.2, dash="2 3"))


def _shade(panel: Panel, rate: Floats, worse: NDArray[np.bool_]) -> None:
    """Shade the rates at which rotation makes worse, up to halfway to the next rate that does not."""
    halfway = np.sqrt(rate[1:] * rate[:-1])
    bounds = np.concatenate([[0.0], halfway, [np.inf]]).clip(_FAR * panel.x[0], panel.x[1] / _FAR).tolist()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], worse, [False]])))
    for first, end in edges.reshape(-1, 2).tolist():
        made = BoxAnnotation(
            left=bounds[first],
            right=bounds[end],
            fill_color=VERMILION,
            fill_alpha=0.1,
            line_color=None,
            level="underlay",
        )
        panel.figure.add_layout(made)


def angle_error(tables: Tables) -> Section | None:
    """One panel a channel: standard deviation of the angle against time, at rest and turning."""
    channels = by_channel(tables, "growth", "duration")
    if not channels:
        return None
    whole = tables["growth"]
    curves = [column(whole, name) for name in ("without_rotation", "with_rotation")]
    factor, unit = scale.angle(curves)
    made = panels(
        {channel: _turning(channel, table) for channel, table in channels.items()},
        log_span([column(whole, "duration")], 1.1),
        log_span([curve / factor for curve in curves], 2.0),
        "time of integration [s]",
        f"standard deviation [{unit}]",
    )
    for channel, table in channels.items():
        _draw_error(made, channel, table, factor)
    return Section(
        "Growth of the angle error",
        "Standard deviation of the integrated rate's error, with the platform at rest and turning at the "
        "rate given above each panel, with the 95 % interval that the model's errors give.",
        made.arranged(),
    )


def _turning(channel: str, table: pa.Table) -> str:
    rates = np.unique(column(table, "rotation_rate")).tolist()
    return f"channel {channel}, turning at {', '.join(map(rate_in_words, rates))}"


def _draw_error(made: Panels, channel: str, table: pa.Table, factor: float) -> None:
    panel, fields = made.of[channel], [("time of integration [s]", "x"), ("standard deviation", "y")]
    for rate in table["rotation_rate"].unique():
        mine = table.filter(pc.equal(table["rotation_rate"], rate))
        time = column(mine, "duration")
        rest, turning, low, high = (
            column(mine, name) / factor for name in ("without_rotation", "with_rotation", "lower", "upper")
        )
        still = line(panel, time, rest, BLACK, width=1.4, dash="2 3")
        shaded = band(panel, time, low, high, BLUE)
        curve = line(panel, time, turning, BLUE, width=2.0)
        made.note("without rotation", still)
        made.note("with rotation", curve, shaded)
        style.hover(panel.figure, still, fields)
        style.hover(panel.figure, curve, fields)
