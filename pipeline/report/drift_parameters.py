"""The identified parameters with error bars, the methods beneath each other for the eye to compare."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import BasicTicker, ColumnDataSource
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Section, Tables
from pipeline.report.drift_runs import DRIFT, METHODS, SURE, filled, symbol
from pipeline.report.formatting import measured, number
from pipeline.report.style import BLUE, PALE

_SIGMAS = 2.0
_ROW = 22  # pixels
_COLUMNS = 3
_BLURRED = 12.0  # times the first error bar: a larger one does not set the scale
_BIASED = 3.0  # times the largest error bar that sets the scale: a value further off does not
_ARCMIN = np.pi / 180 / 60
_FINEST = 1e-9  # of the value: a scale that a screen can still label
_NOTHING = 1e-9  # rad: a component of epsilon along u, which is zero, shows as rounding
_STATES = {
    "determined": "determined by the record alone",
    "combined": "determined only in combination with others",
    "undetermined": "not determined by the record",
    "given": "given, not estimated",
}


class Bar(NamedTuple):
    """One estimate: its row, value and standard error in the panel's unit, prior likewise, and its state."""

    row: int
    value: float
    error: float
    prior: float | None
    state: str


class Row(NamedTuple):
    """One row of every panel: a method, at the end of the transient or (``_0``) at its start."""

    method: str
    ending: str

    @property
    def label(self) -> str:
        """As it stands beside the panels."""
        return METHODS[self.method] + (", at the start" if self.ending else "")


def drift(tables: Tables) -> Section | None:
    """The drift parameters, one panel each."""
    wanted = [(name, None) for name in DRIFT]
    text = "The six drift parameters by every method"
    return _section(_told(tables), wanted, "deg/h", "Drift parameters", text)


def installation(tables: Tables) -> Section | None:
    """The tilt of the rotor and the misalignment of the base in each run, one panel each."""
    rows = _told(tables)
    wanted = {
        (row["parameter"], row["run"])
        for row in rows
        if row["parameter"].startswith(("theta", "epsilon"))
        and max(abs(row["value"]), row["standard_error"] or 0.0) > _NOTHING
    }
    order = sorted(wanted, key=lambda p: (p[0].startswith("epsilon"), p[1] or 0, p[0]))
    text = "Tilt θ of the rotor, and misalignment ε = u × Δχ of the base, by every method"
    return _section(rows, order, "arcmin", "Installation errors", text)


def _told(tables: Tables) -> list[dict[str, Any]]:
    """The rows that have a value."""
    table = filled(tables, "drift_parameters")
    return [] if table is None else [row for row in table.to_pylist() if row["value"] is not None]


def _section(
    rows: Sequence[dict[str, Any]], wanted: Sequence[tuple[str, int | None]], unit: str, title: str, text: str
) -> Section | None:
    """One panel a parameter, each with a scale of its own and with the same rows as the others."""
    names = {name for name, _ in wanted}
    mine = [row for row in rows if row["parameter"].removesuffix("_0") in names]
    lanes = [
        Row(method, ending)
        for method in METHODS
        for ending in ("", "_0")
        if any(r["method"] == method and r["parameter"].endswith("_0") == bool(ending) for r in mine)
    ]
    if not lanes:
        return None
    several = len({run for _, run in wanted if run is not None}) > 1
    panels = []
    for place, (name, run) in enumerate(wanted):
        bars = _bars(mine, lanes, name, run, unit)
        label = symbol(name, run if several else None)
        panels.append(_panel(label, unit, lanes, bars, named=place % _COLUMNS == 0))
    starred = any(row["state"] not in SURE for row in mine)
    note = " Pale and with an asterisk: not determined by the record alone." if starred else ""
    return Section(
        title,
        f"{text}, with bars of two standard errors. What lies beyond a panel is an arrow at its edge.{note}",
        style.grid([panels[i : i + _COLUMNS] for i in range(0, len(panels), _COLUMNS)]),
    )


def _bars(
    rows: Sequence[dict[str, Any]], lanes: Sequence[Row], name: str, run: int | None, unit: str
) -> list[Bar]:
    return [
        _bar(place, row, unit)
        for place, lane in enumerate(lanes)
        for row in rows
        if (row["method"], row["parameter"], row["run"]) == (lane.method, name + lane.ending, run)
    ]


def _bar(place: int, row: dict[str, Any], unit: str) -> Bar:
    if unit == "deg/h":
        value, error = row["drift"], row["drift_standard_error"]
        factor = value / row["value"] if row["value"] else 1.0
    else:
        factor = 1 / _ARCMIN
        value, error = row["value"] * factor, (row["standard_error"] or 0.0) * factor
    prior = None if row["prior"] is None else abs(row["prior"] * factor)
    return Bar(place, value, error or 0.0, prior, row["state"])


def _limits(bars: Sequence[Bar]) -> tuple[float, float]:
    """The scale of a panel: about its first value, as wide as the bars that are worth comparing.

    A bar of 0.1 deg/h beside one of 1e-5 would leave the latter a dot, and so would a biased value.
    """
    if not bars:
        return -1.0, 1.0
    centre = bars[0].value
    halves = np.array([_SIGMAS * bar.error for bar in bars])
    away = np.abs([bar.value - centre for bar in bars])
    sharp = (halves <= _BLURRED * halves[0]) | (halves[0] == 0.0)
    close = sharp & ((away <= _BIASED * halves[sharp].max()) | (halves[0] == 0.0))
    reach = float((away + halves)[close].max(initial=0.0)) or 0.1 * abs(centre) or 1.0
    reach = max(1.12 * reach, _FINEST * abs(centre))
    return centre - reach, centre + reach


def _interval(low: float, high: float) -> float:
    """The largest of 1, 2, 5 times a power of ten of which two multiples lie between two values."""
    top = math.floor(math.log10(high - low)) + 1
    steps = (mantissa * 10.0 ** (top - down) for down in range(3) for mantissa in (5, 2, 1))
    return next(step for step in steps if math.floor(high / step) - math.ceil(low / step) >= 1)


def _panel(label: str, unit: str, lanes: Sequence[Row], bars: Sequence[Bar], *, named: bool) -> figure:
    unsure = any(bar.state not in SURE for bar in bars)
    low, high = _limits(bars)
    made = style.panel(
        "",
        style.span(low, high),
        height=_ROW * len(lanes) + 14,
        x_label=f"{label}{' *' if unsure else ''} [{unit}]",
    )
    # few, as their figures may be long, but two at least
    made.xaxis.ticker = BasicTicker(desired_num_ticks=2, max_interval=_interval(low, high))
    made.xaxis.major_label_text_font_size = "11px"
    figures = {bar.row: measured(bar.value, bar.error) for bar in bars}
    names = [lane.label if named else "" for lane in lanes]
    style.rows(made, names, [figures.get(i, "–") for i in range(len(lanes))])
    made.min_border_left = 14
    _draw(made, lanes, bars, low, high)
    return made


def _draw(made: figure, lanes: Sequence[Row], bars: Sequence[Bar], low: float, high: float) -> None:
    for sure in (True, False):
        chosen = [bar for bar in bars if (bar.state in SURE) == sure]
        if not chosen:
            continue
        beyond = [int(bar.value > high) - int(bar.value < low) for bar in chosen]
        edge = 0.025 * (high - low)
        source = ColumnDataSource(
            {
                "row": [bar.row for bar in chosen],
                "shown": [min(max(bar.value, low + edge), high - edge) for bar in chosen],
                "left": [bar.value - _SIGMAS * bar.error for bar in chosen],
                "right": [bar.value + _SIGMAS * bar.error for bar in chosen],
                "shape": [
                    "triangle" if side else "diamond" if bar.state == "given" else "circle"
                    for bar, side in zip(chosen, beyond, strict=True)
                ],
                "angle": [-side * np.pi / 2 for side in beyond],
                "method": [lanes[bar.row].label for bar in chosen],
                "figures": [measured(bar.value, bar.error) for bar in chosen],
                "prior": ["unknown" if bar.prior is None else f"± {number(bar.prior)}" for bar in chosen],
                "state": [_STATES[bar.state] for bar in chosen],
            }
        )
        colour = BLUE if sure else PALE
        made.segment("left", "row", "right", "row", source=source, line_color=colour, line_width=2.5)
        drawn = made.scatter(
            "shown",
            "row",
            source=source,
            marker="shape",
            angle="angle",
            size=9,
            fill_color=colour if sure else "white",
            line_color=colour,
            line_width=1.8,
        )
        fields = [
            ("method", "method"),
            ("estimate", "figures"),
            ("before the run", "prior"),
            ("state", "state"),
        ]
        style.hover(made, drawn, fields)
