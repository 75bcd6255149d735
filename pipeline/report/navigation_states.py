"""Velocity and attitude over time, by every method, beside what satellites or truth say."""

from __future__ import annotations

import numpy as np
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Clock, Section, Tables, column, times
from pipeline.report.navigation_panels import ANGLES, FIX, HALF, NED, Board, Rows, drawn, extent, methods
from pipeline.report.series import Floats
from pipeline.report.style import BLACK, Drawn

_DEGREE = np.pi / 180
_DOTS = 100  # measured velocities that can be told apart in half a page


def states(tables: Tables) -> Section | None:
    """Velocities north, east, down and the three angles."""
    found, board = methods(tables, "navigation"), Board.of(tables)
    if not found or board is None:
        return None
    for place, (axis, angle) in enumerate(zip(NED, ANGLES, strict=True)):
        lowest = place == len(NED) - 1
        left = board.panel(f"{axis} [m/s]", heading="" if place else "velocity", x_label=lowest)
        right = board.panel(f"{angle} [°]", heading="" if place else "attitude", x_label=lowest)
        _velocity(left, board, found, tables, axis)
        _angle(right, board, found, tables, angle)
        board.row(left, right)
    return Section(
        "Velocity and attitude",
        "By each method. A scale holds the methods that are corrected; strapdown may leave its panel.",
        board.arranged(),
    )


def _velocity(made: figure, board: Board, found: list[Rows], tables: Tables, axis: str) -> None:
    shown = []
    measured = _others(tables, "gnss_velocity", axis, board.clock)
    if measured is not None:
        time, value = measured
        kept = np.unique(np.linspace(0, len(time) - 1, min(len(time), _DOTS)).round().astype(np.int64))
        board.note("fixes", style.dots(made, time[kept], value[kept], FIX, size=4))
        shown.append(value)
    for rows in found:
        value = rows[f"v_{axis}"]
        board.note(rows.method, drawn(made, rows, value, columns=HALF))
        shown += [value] if _sets_scale(rows, found) else []
    true = _others(tables, "truth_velocity", axis, board.clock)
    if true is not None:
        board.note("truth", _truth(made, *true))
    made.y_range = style.span(*extent(shown))


def _angle(made: figure, board: Board, found: list[Rows], tables: Tables, name: str) -> None:
    shown = []
    for rows in found:
        value = _broken(rows[name] / _DEGREE)
        board.note(rows.method, drawn(made, rows, value, columns=HALF))
        shown += [value] if _sets_scale(rows, found) else []
    true = _others(tables, "truth_attitude", name, board.clock)
    if true is not None:
        board.note("truth", _truth(made, true[0], _broken(true[1] / _DEGREE)))
    made.y_range = style.span(*extent(shown))


def _sets_scale(rows: Rows, found: list[Rows]) -> bool:
    return rows.method != "strapdown" or len(found) == 1


def _others(tables: Tables, name: str, channel: str, clock: Clock) -> tuple[Floats, Floats] | None:
    """A stream's channel while the navigation lasts, in the order of its times; None where it has none."""
    table = tables.get(name)
    if table is None or not table.num_rows:
        return None
    time, value = clock.seconds(times(table)), column(table, channel)
    kept = (time >= 0.0) & (time <= clock.duration) & np.isfinite(value)
    order = np.argsort(time[kept], kind="stable")
    return (time[kept][order], value[kept][order]) if kept.any() else None


def _truth(made: figure, time: Floats, value: Floats) -> Drawn:
    return style.curve(made, time, value, BLACK, width=1.0, dash="2 3", columns=HALF)


def _broken(angle: Floats) -> Floats:
    """An angle [deg] that begins anew at a half turn, interrupted there."""
    jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180.0) + 1
    whole = angle.copy()
    whole[jumps] = np.nan
    return whole
