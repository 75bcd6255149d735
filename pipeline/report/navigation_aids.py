"""What aids the methods, and when: the flags that the data themselves gave."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline.report import style
from pipeline.report.base import Section, Tables
from pipeline.report.navigation_panels import TIME, Board, Rows, methods
from pipeline.report.series import Floats
from pipeline.report.style import INK, Drawn

_AIDS = {
    "used_position": "position",
    "used_velocity": "velocity",
    "used_airspeed": "air speed",
    "used_altitude": "height",
    "used_magnetic_field": "magnetic field",
    "used_attitude": "attitude",
}
_INERTIAL = "inertial samples"
_LANE = 24  # pixels
_SHOWN = ("loops", "filter")


def aids(tables: Tables) -> Section | None:
    """One lane an aid, in which each method has a bar while it uses it."""
    found, board = [rows for rows in methods(tables, "navigation") if rows.method in _SHOWN], Board.of(tables)
    if not found or board is None:
        return None
    flags = {name: [rows.table[name].to_numpy() for rows in found] for name in _AIDS}
    there = [name for name, used in flags.items() if any(one.any() for one in used)]
    lanes = [_INERTIAL, *(_AIDS[name] for name in there)]
    made = style.panel("", board.x_range, height=_LANE * len(lanes) + 16, x_label=TIME)
    style.rows(made, lanes)
    bars: dict[str, list[Drawn]] = {rows.method: [] for rows in found}
    shares = ["" for _ in lanes]
    for place, name in enumerate(there, start=1):
        for below, (rows, used) in enumerate(zip(found, flags[name], strict=True)):
            bars[rows.method].append(_bar(made, rows, used, place, below, len(found)))
        shares[place] = " · ".join(f"{100 * used.mean():.0f} %" for used in flags[name])
    recorded = ~found[0].table["coasted"].to_numpy().astype(np.bool_)
    _bar(made, found[0], recorded, 0, 0, 1, INK)
    shares[0] = f"{100 * recorded.mean():.0f} %"
    style.rows(made, lanes, shares)
    style.legend(made, list(bars.items()))
    return Section(
        "What aids",
        "A bar while an aid is used: its last measurement is usable, was not refused and is not stale. A gap "
        "among the inertial samples was bridged. At the right: the share of the record.",
        made,
    )


def _bar(
    made: figure,
    rows: Rows,
    used: NDArray[np.bool_],
    place: int,
    below: int,
    of: int,
    colour: str | None = None,
) -> Drawn:
    """The stretches in which a flag is true, in the lane's part that is this method's."""
    start, end = _stretches(rows.time, used)
    thick = 0.62 / of
    top = np.full(len(start), place - 0.31 + below * thick)
    source = ColumnDataSource({"x": start, "y": end, "top": top, "bottom": top + 0.85 * thick})
    return made.quad(
        left="x",
        right="y",
        top="top",
        bottom="bottom",
        source=source,
        fill_color=colour or rows.colour,
        line_color=None,
        fill_alpha=0.8,
    )


def _stretches(time: Floats, used: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Where a flag begins to be true, and where it ends [s]."""
    edges = np.diff(np.concatenate([[0], used.astype(np.int8), [0]]))
    return time[edges[:-1] > 0], time[np.minimum(np.flatnonzero(edges < 0), len(time) - 1)]
