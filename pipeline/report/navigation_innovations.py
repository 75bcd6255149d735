"""Innovations of the filter over the standard deviation that they should have, and what was refused."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline.report import style
from pipeline.report.base import Clock, Section, Tables, column, times
from pipeline.report.formatting import number
from pipeline.report.navigation_panels import METHODS, Board, level
from pipeline.report.series import Floats
from pipeline.report.style import INK, SEVERITY, Drawn

_AIDS = {
    "position": "position",
    "velocity": "velocity",
    "magnetic_field": "magnetic field",
    "attitude": "attitude",
    "airspeed": "air speed",
    "altitude": "height",
}
_ABREAST = 3
_DOTS = 600  # that can be told apart in a panel; of more an even selection is drawn
_SIGMAS = 2.0
_HIGHEST = 6.0  # sigma, beyond which a dot stands at the edge
_LOWEST = 3.0


def innovations(tables: Tables) -> Section | None:
    """One panel a component of each aid."""
    board, table = Board.of(tables), tables.get("innovations")
    if board is None or table is None:
        return None
    table = table.filter(pc.and_(pc.equal(table["method"], "filter"), pc.is_valid(table["sigma"])))
    cells = [
        (aid, component)
        for aid in _AIDS
        for component in pc.unique(table.filter(pc.equal(table["aid"], aid))["component"]).to_pylist()
    ]
    if not cells:
        return None
    # All in a row have the axis's words, or none: their frames are equally high.
    lowest = len(cells) // _ABREAST - 1
    panels = [
        _panel(board, table, aid, component, tables, lowest=place // _ABREAST >= lowest)
        for place, (aid, component) in enumerate(cells)
    ]
    for first in range(0, len(panels), _ABREAST):
        row = panels[first : first + _ABREAST]
        board.row(*row, *[None] * (_ABREAST - len(row)))
    return Section(
        "Innovations",
        "Measured less predicted, over its standard deviation by the filter; dashed: ±2σ, within which 95 % "
        "lie. In brackets the mean square of the aid: 1 if the filter is told the true noise, less if it is "
        f"told more. Of many dots an even selection; beyond {_HIGHEST:.0f}σ one is at the edge.",
        board.arranged(),
    )


def _panel(
    board: Board, table: pa.Table, aid: str, component: str, tables: Tables, *, lowest: bool
) -> figure:
    mine = table.filter(pc.and_(pc.equal(table["aid"], aid), pc.equal(table["component"], component)))
    mine = mine.sort_by("time")
    time, ratio = _normalised(mine, board.clock)
    accepted = mine["accepted"].to_numpy().astype(np.bool_)
    bound = _scale(ratio[accepted])
    made = board.panel("", heading=_heading(tables, aid, component, accepted), height=105, x_label=lowest)
    made.y_range = style.span(-bound, bound)
    for sign in (-1, 1):
        board.note("±2σ", level(made, board, sign * _SIGMAS, dash="4 4", colour=INK))
    board.note("used", _dots(made, time[accepted], ratio[accepted], bound, METHODS["filter"], "circle", 3))
    if not accepted.all():
        refused = _dots(made, time[~accepted], ratio[~accepted], bound, SEVERITY["error"], "x", 7)
        board.note("refused", refused)
    return made


def _normalised(table: pa.Table, clock: Clock) -> tuple[Floats, Floats]:
    sigma = column(table, "sigma")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sigma > 0.0, column(table, "value") / sigma, np.nan)
    return clock.seconds(times(table)), np.asarray(ratio, dtype=np.float64)


def _scale(ratio: Floats) -> float:
    largest = float(np.nanmax(np.abs(ratio), initial=0.0))
    return 1.08 * min(max(largest, _LOWEST), _HIGHEST)


def _dots(
    made: figure, time: Floats, ratio: Floats, bound: float, colour: str, shape: str, size: int
) -> Drawn:
    """Dots, of many an even selection; what is beyond the panel stands at its edge."""
    kept = np.unique(np.linspace(0, len(time) - 1, min(len(time), _DOTS)).round().astype(np.int64))
    x, y = time[kept], ratio[kept]
    source = ColumnDataSource({"x": x, "y": np.clip(y, -0.96 * bound, 0.96 * bound)})
    return made.scatter(
        "x",
        "y",
        source=source,
        marker=shape,
        size=size,
        fill_color=colour,
        line_color=colour if shape == "x" else None,
        line_width=1.6,
        fill_alpha=0.6,
    )


def _heading(tables: Tables, aid: str, component: str, accepted: NDArray[np.bool_]) -> str:
    word = _AIDS[aid]
    part = "" if component == aid else f" {component}"
    mean = next(
        (
            row["value"]
            for row in tables["metrics"].to_pylist()
            if (row["name"], row["channel"]) == ("normalised_innovations", f"filter.{aid}")
        ),
        None,
    )
    square = "" if mean is None else f" ({number(float(f'{mean:.2g}'))})"
    refused = int(np.count_nonzero(~accepted))
    told = f", {number(refused)} refused" if refused else ""
    return f"{word}{part}{square}{told}"
