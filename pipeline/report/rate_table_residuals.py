"""What the observations of a calibration tell beside its model: by the rate, in time, by temperature."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, LayoutDOM
from bokeh.models.annotations import Span
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Clock, Section, Tables
from pipeline.report.formatting import measured, number
from pipeline.report.rate_table_runs import (
    ABREAST,
    BORDER,
    CELSIUS,
    CHANNELS,
    DEG_S,
    Floats,
    Row,
    main_fit,
    parts_per_million,
    rows_of,
    run_names,
    single_axis,
)
from pipeline.report.style import BLACK, BLUE, GREEN, PALE, VERMILION, Drawn

_HEIGHT = 230
_LOW = 150
_MARGIN = 0.08  # of the rates, at either end of a scale
_POINTS = 241  # of the model's curve
_STEADY = 0.1  # K: a temperature that varies less is one
_ZERO = 1e-9  # of the largest rate, below which the table stands
_EARTH = 8e-5  # rad/s, of which the Earth's 7.3e-5 is in the rate of a table that stands
_LOOKS = tuple(
    (colour, shape) for shape in ("circle", "square", "diamond") for colour in (BLUE, VERMILION, GREEN, BLACK)
)
"""Of the runs, one after the other."""

_TURNING = {"turning +": BLUE, "turning −": VERMILION, "at rest": BLACK}
_APPROACH = {"from below": "triangle", "from above": "inverted_triangle", "": "circle"}

Items = dict[str, list[Drawn]]


class Dots(NamedTuple):
    """Points with bars of one standard deviation [ppm], and what the pointer shows of each."""

    x: Floats
    y: Floats
    error: Floats
    words: list[str]


# ------------------------------------------------------------------------------------------- by the rate


def by_rate(tables: Tables) -> Section | None:
    """Two panels a gyro against the rate about its axis: off a straight line, and off the model."""
    rows = rows_of(tables, "calibration_residuals")
    names = run_names(tables)
    of = {channel: mine for channel in CHANNELS if (mine := single_axis(rows, channel))}
    if not of:
        return None
    items: Items = {}
    upper, lower = [], []
    for place, (channel, mine) in enumerate(of.items()):
        factor = parts_per_million(mine)
        rate = DEG_S * np.array([row["rate"] for row in mine])
        x_range = style.span(*_ends(rate))
        labels = ("off a straight line [ppm]", "off the model [ppm]")
        panels = [
            style.panel(
                label if place == 0 else "",
                x_range,
                height=_HEIGHT,
                x_label="rate [deg/s]" if below else None,
                ticks=5,
            )
            for below, label in enumerate(labels)
        ]
        model = _model(tables, mine)
        for panel, value in zip(panels, _values(mine, model), strict=True):
            panel.min_border_left = BORDER
            _zero(panel)
            _draw_by_rate(panel, mine, value, factor, names, items)
        if model is not None:
            w = np.linspace(rate.min(), rate.max(), _POINTS)
            drawn = style.curve(panels[0], w, factor * model(w / DEG_S), BLACK, width=1.2)
            items.setdefault("model", []).append(drawn)
        style.heading(panels[0], f"{channel}: full scale {number(float(f'{_full_scale(mine):.4g}'))} deg/s")
        upper.append(panels[0])
        lower.append(panels[1])
    rows_ = [row[i : i + ABREAST] for i in range(0, len(upper), ABREAST) for row in (upper, lower)]
    return Section(
        "Calibration residuals",
        "Each step against the rate about the gyro's own axis, in parts per million of the output at the "
        "largest rate, with bars of one standard deviation. Above, less a straight line and what temperature "
        "does by the model: a kink at 0 is an asymmetry, a bend a nonlinearity. Below, less the model: what "
        "remains should scatter as the bars say. ▲ the rate before was lower, ▼ it was higher: two that lie "
        "apart at one rate are hysteresis, or a bias that wandered.",
        _with_legend(items, rows_),
    )


def _values(rows: Sequence[Row], model: Callable[[Floats], Floats] | None) -> tuple[Floats, Floats]:
    """Outputs less the straight line and what temperature does, and less the model [rad/s]."""
    deviation, residual, rate = (
        np.array([row[name] for row in rows], dtype=np.float64) for name in ("deviation", "residual", "rate")
    )
    return (deviation if model is None else model(rate) + residual), residual


def _ends(rate: Floats) -> tuple[float, float]:
    low, high = float(rate.min()), float(rate.max())
    margin = _MARGIN * ((high - low) or abs(high) or 1.0)
    return low - margin, high + margin


def _full_scale(rows: Sequence[Row]) -> float:
    """Largest input rate [deg/s]."""
    return float(DEG_S * max(abs(row["rate"]) for row in rows))


def _draw_by_rate(
    panel: figure,
    rows: Sequence[Row],
    value: Floats,
    factor: float,
    names: Mapping[int | None, str],
    items: Items,
) -> None:
    """One glyph for each way of turning, so that the legend can hide it."""
    approaches = _approaches(rows)
    largest = max(abs(row["rate"]) for row in rows)
    turning = [_way(row["rate"], largest) for row in rows]
    for way, colour in _TURNING.items():
        chosen = [i for i, word in enumerate(turning) if word == way]
        if not chosen:
            continue
        mine = [rows[i] for i in chosen]
        dots = Dots(
            DEG_S * np.array([row["rate"] for row in mine]),
            factor * value[chosen],
            factor * np.array([row["residual_error"] for row in mine]),
            [_words(row, names) for row in mine],
        )
        shapes = [_APPROACH[approaches[i]] for i in chosen]
        items.setdefault(way, []).extend(_dots(panel, dots, colour, shapes, "rate [deg/s]"))


def _way(rate: float, largest: float) -> str:
    """Which way the table turned. The Earth's rate is no turning of a table."""
    if abs(rate) <= max(_EARTH, _ZERO * largest):
        return "at rest"
    return "turning +" if rate > 0 else "turning −"


def _approaches(rows: Sequence[Row]) -> list[str]:
    """Where the rate came from in each step, by the step before it of its run."""
    order = sorted(range(len(rows)), key=lambda i: (rows[i]["run"] or 0, rows[i]["start"]))
    found = [""] * len(rows)
    for before, now in pairwise(order):
        if rows[before]["run"] == rows[now]["run"] and rows[before]["rate"] != rows[now]["rate"]:
            found[now] = "from below" if rows[before]["rate"] < rows[now]["rate"] else "from above"
    return found


def _model(tables: Tables, rows: Sequence[Row]) -> Callable[[Floats], Floats] | None:
    """The model less the straight line that the deviations are from, over the rate, both in rad/s.

    ``K {w + a |w| / 2 + sum_k c_k w_m (w / w_m)^k} + b`` at the reference temperature; None where the model
    is a line itself, at any temperature.
    """
    told = {
        row["parameter"]: row["value"]
        for row in rows_of(tables, "calibration")
        if row["gyro"] == rows[0]["channel"]
    }
    terms = {
        int(name.rpartition("_")[2]): value
        for name, value in told.items()
        if name.startswith("scale_factor_nonlinearity_")
    }
    asymmetry = told.get("scale_factor_asymmetry", 0.0)
    if not terms and not asymmetry and not any("temperature" in name for name in told):
        return None
    rate = np.array([row["rate"] for row in rows])
    line = np.array([row["output"] - row["deviation"] for row in rows])
    slope, offset = np.polyfit(rate, line, 1)
    largest = float(np.abs(rate).max())

    def less_line(w: Floats) -> Floats:
        bent = asymmetry * np.abs(w) / 2 + sum(c * largest * (w / largest) ** k for k, c in terms.items())
        return np.asarray(told["scale_factor"] * (w + bent) + told["bias"] - offset - slope * w)

    return less_line


# ------------------------------------------------------------------------------ in time and by temperature


def in_time(tables: Tables) -> Section | None:
    """One panel a gyro, as wide as the page: the residuals in the order in which they were recorded."""
    rows = main_fit(rows_of(tables, "calibration_residuals"))
    if not rows:
        return None
    start = min(row["start"] for row in rows)
    clock = Clock(start, (max(row["stop"] for row in rows) - start) * 1e-9)
    unit, word = next((u for u in ((3600.0, "h"), (60.0, "min")) if clock.duration > 3 * u[0]), (1.0, "s"))
    x_range = style.span(*_ends(np.array([0.0, clock.duration / unit])))
    channels = [channel for channel in CHANNELS if any(row["channel"] == channel for row in rows)]
    label = f"time from the first observation [{word}]"
    items: Items = {}
    made = []
    for channel in channels:
        last = channel == channels[-1]
        panel = style.panel(f"{channel} [ppm]", x_range, height=_LOW, x_label=label if last else None)
        _zero(panel)
        mine = [row for row in rows if row["channel"] == channel]
        middle = np.array([clock.seconds(np.array([row["start"], row["stop"]])).mean() for row in mine])
        _draw_by_run(tables, panel, mine, middle / unit, items, "time")
        made.append(panel)
    turned = any(row["kind"] == "turn" for row in rows)
    turns = " What a turn's own unknown angle and axis explain is no residual." if turned else ""
    whole = "the triad" if rows[0]["fit"] == "triad" else "each gyro by its own axis"
    return Section(
        "Residuals in time",
        f"Observations less the model of {whole}, in parts per million of full scale, with bars of one "
        f"standard deviation: a trend is a bias or a scale factor that wanders.{turns}",
        _with_legend(items, [[panel] for panel in made], border=112),
    )


def by_temperature(tables: Tables) -> Section | None:
    """One panel a gyro, where a temperature was recorded that varied."""
    rows = main_fit(rows_of(tables, "calibration_residuals"))
    warm = [row for row in rows if row["temperature"] is not None]
    if not warm or np.ptp([row["temperature"] for row in warm]) < _STEADY:
        return None
    x_range = style.span(*_ends(np.array([row["temperature"] - CELSIUS for row in warm])))
    channels = [channel for channel in CHANNELS if any(row["channel"] == channel for row in warm)]
    items: Items = {}
    made = []
    for place, channel in enumerate(channels):
        label = "off the model [ppm]" if place == 0 else ""
        panel = style.panel(label, x_range, height=_HEIGHT, x_label="temperature [°C]", ticks=5)
        panel.min_border_left = BORDER
        _zero(panel)
        style.heading(panel, channel)
        mine = [row for row in warm if row["channel"] == channel]
        _draw_by_run(
            tables, panel, mine, np.array([row["temperature"] - CELSIUS for row in mine]), items, "°C"
        )
        made.append(panel)
    return Section(
        "Residuals against temperature",
        "The same against the temperature: a slope asks for a term of the bias, a fan for one of the scale "
        "factor.",
        _with_legend(items, [made]),
    )


def _draw_by_run(
    tables: Tables, panel: figure, rows: Sequence[Row], x: Floats, items: Items, label: str
) -> None:
    """One glyph a run; where there are no runs, one a kind of observation."""
    names = run_names(tables)
    groups = [f"run {names[row['run']]}" if row["run"] in names else row["kind"] for row in rows]
    factor = parts_per_million(rows)
    for name in dict.fromkeys(groups):
        colour, shape = _LOOKS[_place(name, groups, items) % len(_LOOKS)]
        chosen = [i for i, group in enumerate(groups) if group == name]
        mine = [rows[i] for i in chosen]
        dots = Dots(
            x[chosen],
            np.array([row["residual_ppm"] for row in mine]),
            factor * np.array([row["residual_error"] for row in mine]),
            [_words(row, names) for row in mine],
        )
        items.setdefault(name, []).extend(_dots(panel, dots, colour, shape, label))


def _place(name: str, groups: Iterable[str], items: Items) -> int:
    return list(dict.fromkeys([*items, *groups])).index(name)


# --------------------------------------------------------------------------------------------- what is shared


def _dots(
    panel: figure, dots: Dots, colour: str, shapes: str | Sequence[str], label: str
) -> tuple[Drawn, Drawn]:
    """Points and bars; ``shapes`` is one for all, or one each."""
    source = ColumnDataSource(
        {
            "x": dots.x,
            "y": dots.y,
            "low": dots.y - dots.error,
            "high": dots.y + dots.error,
            **({} if isinstance(shapes, str) else {"shape": list(shapes)}),
            "what": dots.words,
            "figure": [f"{measured(y, error)} ppm" for y, error in zip(dots.y, dots.error, strict=True)],
        }
    )
    bars = panel.segment("x", "low", "x", "high", source=source, line_color=colour, line_width=1.3)
    drawn = panel.scatter(
        "x",
        "y",
        source=source,
        marker=shapes if isinstance(shapes, str) else "shape",
        size=7,
        fill_color="white",
        line_color=colour,
        line_width=1.6,
    )
    style.hover(panel, drawn, [("observation", "what"), (label, "x"), ("residual", "figure")])
    return drawn, bars


def _words(row: Row, names: Mapping[int | None, str]) -> str:
    run = f" of run {names[row['run']]}" if row["run"] in names else ""
    return f"{row['kind']} {row['observation']}{run} at {number(DEG_S * row['rate'])} deg/s"


def _zero(panel: figure) -> None:
    panel.add_layout(Span(location=0.0, dimension="width", line_color=PALE, line_width=1, level="underlay"))


def _with_legend(items: Items, rows: Sequence[Sequence[figure | None]], *, border: int = BORDER) -> LayoutDOM:
    """Panels in rows under a legend over the whole width, if there is anything to tell apart."""
    if len(items) < 2:
        return style.grid(rows)
    strip = style.strip(items, border)
    return column([strip, style.grid(rows)], sizing_mode="stretch_width", spacing=0)
