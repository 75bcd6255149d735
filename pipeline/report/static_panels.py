"""What the pictures of a static record share: logarithmic panels, one a channel, under one legend."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, FixedTicker, LayoutDOM
from bokeh.models.annotations import Label, Span
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline import units
from pipeline.report import style
from pipeline.report.base import Tables
from pipeline.report.decimate import min_max
from pipeline.report.formatting import number
from pipeline.report.style import BLACK, INK, Drawn

Floats = NDArray[np.float64]
Ends = tuple[float, float]
"""The ends of a scale."""

DEG_S = np.degrees(1.0)
"""A rate in rad/s to deg/s, and an angle in rad to deg."""
DEG_H = DEG_S * 3600
"""A rate in rad/s to deg/h."""
DEG_ROOT_H = DEG_S * 60
"""An angle random walk in rad/sqrt(s), the root of a density in rad^2/s, to deg/sqrt(h)."""

FAINT = "#98a0ab"
"""The colour of a curve that is not the main one."""

_ABREAST = 3  # panels
_COLUMNS = 400  # of pixels in one of them
_BORDER = 70  # pixels left of a frame
_HEIGHT = 300
_HIGHEST = 8  # decades of a scale: beyond, a panel shows nothing any more
_FEW = 3.0  # decades: with fewer a scale has ticks between them


@dataclass(frozen=True, slots=True)
class Panel:
    """A figure with the ends of its two scales."""

    figure: figure
    x: Ends
    y: Ends


@dataclass(frozen=True, slots=True)
class Panels:
    """One panel a channel, all with the same two scales, and what the legend says of their curves."""

    of: Mapping[str, Panel]
    items: dict[str, list[Drawn]] = field(default_factory=dict)

    def note(self, word: str, *drawn: Drawn) -> None:
        """Name curves in the legend; those of one name in all panels are shown and hidden together."""
        self.items.setdefault(word, []).extend(drawn)

    def arranged(self) -> LayoutDOM:
        """The panels side by side, and above them the legend over the whole width."""
        made = [panel.figure for panel in self.of.values()]
        rows = [made[i : i + _ABREAST] for i in range(0, len(made), _ABREAST)]
        strip = style.strip(self.items, _BORDER)
        return column([strip, style.grid(rows)], sizing_mode="stretch_width", spacing=0)


def by_channel(tables: Tables, name: str, by: str) -> dict[str, pa.Table]:
    """The rows of each channel sorted by a column, p before q before r; nothing where there is no row."""
    table = tables.get(name)
    if table is None:
        return {}
    table = table.sort_by(by)
    channels = sorted(table["channel"].unique().to_pylist())
    return {channel: table.filter(pc.equal(table["channel"], channel)) for channel in channels}


def plainly(channels: Iterable[str]) -> dict[str, str]:
    """Headings of panels that need no more than the channel's name."""
    return {channel: f"channel {channel}" for channel in channels}


def panels(headings: Mapping[str, str], x: Ends, y: Ends, x_label: str, y_label: str) -> Panels:
    """Empty panels on logarithmic scales, one for each channel, with a few words above it."""
    x_range, y_range = style.span(*x), style.span(*y)
    of = {}
    for place, (channel, words) in enumerate(headings.items()):
        made = style.panel(
            y_label if place % _ABREAST == 0 else "",
            x_range,
            height=_HEIGHT,
            x_label=x_label,
            logarithmic=True,
            x_logarithmic=True,
        )
        made.y_range = y_range
        _tick(made, y)
        made.min_border_left = _BORDER
        style.heading(made, words)
        of[channel] = Panel(made, x, y)
    return Panels(of)


def _tick(made: figure, y: Ends) -> None:
    """Ticks at 1, 2 and 5 on a scale of few decades: it is never zoomed, Bokeh's leave half of it bare."""
    low, high = map(math.log10, y)
    if high - low < _FEW:
        decades = range(math.floor(low), math.ceil(high))
        ticks = [float(f"{digit}e{decade}") for decade in decades for digit in (1, 2, 5)]
        made.yaxis.ticker = FixedTicker(ticks=ticks)
        made.yaxis.major_label_overrides = {tick: style.plain(number(tick)) for tick in ticks}


def log_span(values: Iterable[Floats], margin: float = 1.25) -> Ends:
    """A scale for all positive values, wider by a factor at either end."""
    there = np.concatenate([np.empty(0), *values])
    there = there[np.isfinite(there) & (there > 0.0)]
    if not len(there):
        return 0.1, 10.0
    low, high = float(there.min()), float(there.max())
    return max(low, high * 10.0**-_HIGHEST) / margin, high * margin


def line(
    panel: Panel, x: Floats, y: Floats, colour: str, *, width: float = 1.6, dash: str = "solid"
) -> Drawn:
    """A curve over a logarithmic scale, thinned to the panel; what has no logarithm interrupts it."""
    there = x > 0.0
    shown, y = min_max(np.log(x[there]), np.where(y > 0.0, y, np.nan)[there], _COLUMNS)
    source = ColumnDataSource({"x": np.exp(shown), "y": y})
    return panel.figure.line("x", "y", source=source, line_color=colour, line_width=width, line_dash=dash)


def band(panel: Panel, x: Floats, low: Floats, high: Floats, colour: str, *, alpha: float = 0.18) -> Drawn:
    """What lies between two curves; a lower one of 0 goes below the panel."""
    there = (x > 0.0) & np.isfinite(low) & (high > 0.0)
    floor = 1e-3 * panel.y[0]
    source = ColumnDataSource({"x": x[there], "low": np.maximum(low[there], floor), "high": high[there]})
    return panel.figure.varea("x", "low", "high", source=source, fill_color=colour, fill_alpha=alpha)


def mark(panel: Panel, x: float, words: str) -> None:
    """A vertical line, with words beside its upper end on the side that has room."""
    panel.figure.add_layout(
        Span(location=x, dimension="height", line_color=BLACK, line_width=1, line_dash="4 3")
    )
    right = x > math.sqrt(panel.x[0] * panel.x[1])
    panel.figure.add_layout(
        Label(
            x=x,
            y=panel.y[1],
            x_offset=-6 if right else 6,
            y_offset=-6,
            text_baseline="top",
            text=style.plain(words),
            text_align="right" if right else "left",
            text_font=style.FONT,
            text_font_size="12px",
            text_color=INK,
        )
    )


def recommended(tables: Tables) -> dict[str, float]:
    """The recommended rotation rate of each channel that has one [rad/s]; 0 is: do not rotate."""
    table = tables.get("metrics")
    rates: dict[str, float] = {}
    for row in [] if table is None else table.to_pylist():
        factor = units.factor(row["unit"], "angular rate")
        if row["name"] == "recommended_rate" and row["value"] is not None and factor is not None:
            rates.setdefault(row["channel"], row["value"] * factor)
    return rates


def rate_in_words(rate: float) -> str:
    """A rotation rate as a picture says it: ``3.2 deg/s``."""
    return f"{number(float(f'{rate * DEG_S:.4g}'))} deg/s"
