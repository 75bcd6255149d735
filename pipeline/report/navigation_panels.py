"""What the pictures of a navigation share: methods and their colours, outages, panels over one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.layouts import column as stacked
from bokeh.models import ColumnDataSource, LayoutDOM, Range1d
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Clock, Tables, column, record_clock, times
from pipeline.report.decimate import min_max
from pipeline.report.series import Floats
from pipeline.report.style import BLACK, BLUE, GREEN, VERMILION, Drawn

METHODS: Mapping[str, str] = MappingProxyType(
    {"strapdown": "#98a0ab", "loops": VERMILION, "filter": BLUE, "smoother": GREEN}
)
"""The methods in their order, each with its colour in every picture."""

NED = ("north", "east", "down")
AXES = ("x", "y", "z")
ANGLES = ("yaw", "pitch", "roll")
PHASES = ("aided", "outage", "reacquired")
TIME = "time [s]"
LOST = "satellites lost"

AMBER, FIX = "#e0a030", "#6d7580"
"""Colours of an outage and of what satellites measure."""

BORDER = 76  # pixels left of a frame
NARROW, HALF = 260, 400
"""Columns of pixels of a curve in a panel that has a third of the page, or a half."""

_GAP = 5.0  # rows; a longer pause interrupts a curve

Ends = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of one method: its name, the time [s] of each (n,), and its table."""

    method: str
    time: Floats
    table: pa.Table

    @property
    def colour(self) -> str:
        """Its colour."""
        return METHODS[self.method]

    @property
    def gap(self) -> float:
        """The pause [s] that interrupts its curves."""
        return _GAP * float(np.median(np.diff(self.time)))

    def __getitem__(self, name: str) -> Floats:
        """A column (n,); null is NaN."""
        return column(self.table, name)

    def has(self, name: str) -> bool:
        """Whether the method gives this at all."""
        return bool(self.table[name].null_count < self.table.num_rows)


def methods(tables: Tables, name: str) -> list[Rows]:
    """The methods of a table that have at least two rows, each in the order of its times."""
    table, clock = tables.get(name), record_clock(tables)
    if table is None or clock is None:
        return []
    found = []
    for method in METHODS:
        mine = table.filter(pc.equal(table["method"], method)).sort_by("time")
        if mine.num_rows > 1:
            found.append(Rows(method, clock.seconds(times(mine)), mine))
    return found


def outages(tables: Tables) -> list[Ends]:
    """From when to when [s] there are no satellites, as `navigation` says; touching ones are one."""
    found = methods(tables, "navigation")
    if not found:
        return []
    lost = np.array(found[0].table["phase"].to_pylist()) == "outage"
    time = found[0].time
    edges = np.diff(np.concatenate([[False], lost, [False]]).astype(np.int8))
    ends = np.minimum(np.flatnonzero(edges < 0), len(time) - 1)
    return [(float(time[i]), float(time[j])) for i, j in zip(np.flatnonzero(edges > 0), ends, strict=True)]


@dataclass(frozen=True, slots=True)
class Board:
    """Panels in rows over the record's time, the outages shaded in each, under one legend."""

    clock: Clock
    x_range: Range1d
    lost: list[Ends]
    rows: list[list[figure | None]] = field(default_factory=list)
    items: dict[str, list[Drawn]] = field(default_factory=dict)

    @classmethod
    def of(cls, tables: Tables) -> Board | None:
        """An empty board; None where nothing has a time."""
        clock = record_clock(tables)
        return None if clock is None else cls(clock, style.span(0.0, clock.duration), outages(tables))

    def panel(
        self, label: str, *, heading: str = "", height: int = 130, x_label: bool, logarithmic: bool = False
    ) -> figure:
        """An empty panel; where it stands is told to `row`."""
        made = style.panel(
            label,
            self.x_range,
            height=height,
            x_label=TIME if x_label else None,
            ticks=6,
            logarithmic=logarithmic,
        )
        made.min_border_left = BORDER
        if heading:
            style.heading(made, heading)
        if self.lost:
            self.note(LOST, shaded(made, self.lost))
        return made

    def row(self, *panels: figure | None) -> None:
        """Panels beside each other, below those that are there."""
        self.rows.append(list(panels))

    def note(self, word: str, *drawn: Drawn) -> None:
        """Name what is drawn in the legend; what has one name is shown and hidden together."""
        self.items.setdefault(word, []).extend(drawn)

    def arranged(self, above: LayoutDOM | None = None) -> LayoutDOM:
        """The panels, below another picture where there is one, and above all the legend: outages last."""
        items = {word: drawn for word, drawn in self.items.items() if word != LOST}
        items |= {LOST: self.items[LOST]} if LOST in self.items else {}
        parts: list[LayoutDOM] = [style.strip(items, BORDER)] if items else []
        parts += [above] if above is not None else []
        return stacked([*parts, style.grid(self.rows)], sizing_mode="stretch_width", spacing=0)


def shaded(made: figure, lost: list[Ends]) -> Drawn:
    """Tint the outages, under all else."""
    source = ColumnDataSource({"x": [start for start, _ in lost], "y": [end for _, end in lost]})
    # Columns x and y hold the two ends: a legend's sample of any glyph has these two names.
    return made.vstrip(
        x0="x",
        x1="y",
        source=source,
        fill_color=AMBER,
        fill_alpha=0.16,
        line_color=None,
        level="underlay",
    )


def drawn(
    made: figure,
    rows: Rows,
    value: Floats,
    *,
    width: float = 1.4,
    columns: int,
    dash: str = "solid",
) -> Drawn:
    """The curve of a method in its colour."""
    return style.curve(
        made, rows.time, value, rows.colour, gap=rows.gap, width=width, dash=dash, columns=columns
    )


def band(made: figure, rows: Rows, middle: Floats, half: Floats, *, columns: int) -> Drawn | None:
    """What lies within a half width about a curve; None where the method has no such width.

    The band is drawn through the extremes of its width in each column of pixels, so that its edges go as far
    as they do.
    """
    known = np.isfinite(middle) & np.isfinite(half)
    if np.count_nonzero(known) < 2:
        return None
    time, middle, half = rows.time[known], middle[known], half[known]
    x, width = min_max(time, half, columns)
    centre = np.interp(x, time, middle)
    source = ColumnDataSource({"x": x, "low": centre - width, "high": centre + width})
    return made.varea("x", "low", "high", source=source, fill_color=rows.colour, fill_alpha=0.15)


def level(made: figure, board: Board, value: float, *, dash: str = "5 4", colour: str = BLACK) -> Drawn:
    """A horizontal line over the whole of the record."""
    ends = np.array([0.0, board.clock.duration])
    return style.curve(made, ends, np.full(2, value), colour, width=1.1, dash=dash)


def extent(values: list[Floats], margin: float = 0.08) -> Ends:
    """A scale for all finite values, a little wider than they are."""
    there = np.concatenate([np.empty(0), *values])
    there = there[np.isfinite(there)]
    if not len(there):
        return -1.0, 1.0
    low, high = float(there.min()), float(there.max())
    room = margin * (high - low) or margin * abs(high) or 1.0
    return low - room, high + room
