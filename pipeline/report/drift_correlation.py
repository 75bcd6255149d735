"""The correlation of the identified parameters as a map of colours."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models import ColumnDataSource, FixedTicker, LinearColorMapper
from bokeh.models.annotations import ColorBar
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Section, Tables
from pipeline.report.drift_runs import IDENTIFIED, METHODS, Floats, filled, primary, symbol
from pipeline.report.style import BLUE, VERMILION

_CELL = 34  # pixels, the height of a row
_UPRIGHT = 14  # names that fit beside each other
_SHADES = 41
_DARK = 0.6  # of a correlation, from which its figure is white


Key = tuple[str, int | None]
"""A parameter and its run."""


class Matrix(NamedTuple):
    """Names of the parameters, (k,), and their correlation, (k, k); NaN where the table has no pair."""

    names: list[str]
    values: Floats


def correlation(tables: Tables) -> Section | None:
    """The matrix of the primary method, or of the first that has one."""
    table = filled(tables, "correlation")
    if table is None:
        return None
    there = set(table["method"].unique().to_pylist())
    method = min(there, key=lambda name: (name != primary(tables), list(METHODS).index(name)))
    matrix = read(table.filter(pc.equal(table["method"], method)), _given(tables, method))
    if not matrix.names:
        return None
    return Section(
        "Correlation of the parameters",
        f"Coefficients of correlation by {METHODS[method]}. Near ±1 only a sum or a difference is known.",
        style.grid([[_map(matrix)]]),
    )


def _given(tables: Tables, method: str) -> set[Key]:
    """The parameters that a method takes as given: their correlation is rounding."""
    table = filled(tables, "drift_parameters")
    rows = [] if table is None else table.to_pylist()
    return {(r["parameter"], r["run"]) for r in rows if r["method"] == method and r["state"] == "given"}


def read(table: pa.Table, without: Collection[Key] = ()) -> Matrix:
    """The matrix from its pairs, each given once or twice, of the parameters that are identified."""
    pairs = [
        ((row["parameter_a"], row["run_a"]), (row["parameter_b"], row["run_b"]), row["correlation"])
        for row in table.to_pylist()
    ]
    keys = [
        key
        for key in dict.fromkeys(pair[which] for which in (0, 1) for pair in pairs)
        if key[0].startswith(IDENTIFIED) and key not in without
    ]
    runs = {run for _, run in keys if run is not None}
    place = {key: i for i, key in enumerate(keys)}
    values = np.full((len(keys), len(keys)), np.nan)
    np.fill_diagonal(values, 1.0)
    for a, b, value in pairs:
        if a in place and b in place:
            values[place[a], place[b]] = values[place[b], place[a]] = value
    return Matrix([symbol(name, run if len(runs) > 1 else None) for name, run in keys], values)


def _map(matrix: Matrix) -> figure:
    count = len(matrix.names)
    row, column = (index.ravel() for index in np.indices((count, count)))
    known = np.isfinite(matrix.values).ravel() & (row >= column)
    row, column, value = row[known], column[known], matrix.values.ravel()[known]
    made = style.panel("", style.span(-0.5, count - 0.5), height=_CELL * count + 10, x_label=" ")
    style.rows(made, matrix.names)
    made.y_range = style.span(count - 0.5, -0.5)
    made.xaxis.ticker = FixedTicker(ticks=list(range(count)))
    made.xaxis.major_label_overrides = {i: style.plain(name) for i, name in enumerate(matrix.names)}
    made.grid.visible = False
    if count > _UPRIGHT:
        made.xaxis.major_label_orientation = np.pi / 4
        style.make_room(made, 40)
    mapper = LinearColorMapper(palette=_diverging(), low=-1.0, high=1.0)
    source = ColumnDataSource(
        {
            "row": row,
            "column": column,
            "value": value,
            "pair": [f"{matrix.names[i]}, {matrix.names[j]}" for i, j in zip(row, column, strict=True)],
            "figures": [
                f"{v:.2f}".replace("-", "−") if i != j else "1"
                for v, i, j in zip(value, row, column, strict=True)
            ],
            "ink": np.where(np.abs(value) > _DARK, "white", style.INK).tolist(),
        }
    )
    cells = made.rect(
        "column",
        "row",
        source=source,
        width=1.0,
        height=1.0,
        fill_color={"field": "value", "transform": mapper},
        line_color="white",
    )
    style.hover(made, cells, [("parameters", "pair"), ("correlation", "value")])
    style.words(made, source, "column", "row", "figures", colour="ink", align="center")
    made.add_layout(
        ColorBar(
            color_mapper=mapper,
            width=12,
            ticker=FixedTicker(ticks=[-1, -0.5, 0, 0.5, 1]),
            background_fill_color=None,
            major_label_text_font=style.FONT,
            major_label_text_font_size="12px",
            major_label_text_color=style.INK,
        ),
        "right",
    )
    return made


def _diverging() -> list[str]:
    """Vermilion for -1 over white to blue for +1."""
    ends = [np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) for colour in (VERMILION, BLUE)]
    shades = []
    for step in np.linspace(-1.0, 1.0, _SHADES):
        rgb = 255 + abs(step) * (ends[int(step > 0)] - 255)
        shades.append("#" + "".join(f"{round(channel):02x}" for channel in rgb))
    return shades
