"""The gimbal angles of a run, measured and by the model: over time, and against each other."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import pyarrow.compute as pc
from bokeh.models import ColumnDataSource, GridPlot
from bokeh.plotting import figure

from pipeline.report import scale, style
from pipeline.report.base import Section, Tables, column, times
from pipeline.report.drift_runs import HOURS, METHODS, Fit, Floats, Run, filled, fit, primary, runs, symbol
from pipeline.report.formatting import measured as with_error
from pipeline.report.parts import html_table
from pipeline.report.style import BLACK, BLUE, PALE, VERMILION, Drawn

ANGLES = ("α1", "α2")
_COLUMNS = 600  # a smooth curve needs no more
_POINTS = 72  # measured points of a sky plane that can be told apart
_LINE = 1500
_FLAT = 5.0  # times wider than high: equal scales would show a line
_DEGREE = np.pi / 180
_SPIRAL = {
    **dict.fromkeys(("alpha_c1", "alpha_c2", "r"), (_DEGREE / 60, " [arcmin]")),
    **dict.fromkeys(("lambda", "nu"), (1.0, "")),
    "psi": (_DEGREE, " [°]"),
}


class Measured(NamedTuple):
    """The trajectory of a run: hours (n,), angles (n, 2) [rad], and the pause [h] that interrupts a curve."""

    hours: Floats
    alpha: Floats
    gap: float


def measured(tables: Tables, run: Run) -> Measured | None:
    """The measured points of a run, without those that were bridged."""
    table = filled(tables, "trajectory")
    if table is None:
        return None
    table = table.filter(pc.and_(pc.equal(table["run"], run.number), table["measured"]))
    if table.num_rows < 2:
        return None
    hours = run.hours(times(table))
    alpha = np.column_stack([column(table, name) for name in ("alpha1", "alpha2")])
    return Measured(hours, alpha, 3 * float(np.median(np.diff(hours))))


def trajectory(tables: Tables) -> Section | None:
    """Both angles of every run over its time, with the prediction of the primary method."""
    method, found = primary(tables), runs(tables)
    blocks = [_angles(tables, run, method, alone=len(found) == 1) for run in found]
    drawn = [block for block in blocks if block]
    if not drawn:
        return None
    by = (
        "" if method is None else f", and as the model predicts them with the parameters by {METHODS[method]}"
    )
    return Section("The trajectory", f"Angles of the two gimbals as measured{by}.", side_by_side(drawn))


def side_by_side(blocks: list[list[figure]]) -> GridPlot:
    """Blocks of panels, one a run, two beside each other."""
    pairs = [blocks[i : i + 2] for i in range(0, len(blocks), 2)]
    rows: list[list[figure | None]] = []
    for pair in pairs:
        block = [*pair, *[[None] * len(pair[0])] * (min(len(blocks), 2) - len(pair))]
        rows += [list(row) for row in zip(*block, strict=True)]
    return style.grid(rows)


def _angles(tables: Tables, run: Run, method: str | None, *, alone: bool) -> list[figure]:
    points, model = measured(tables, run), fit(tables, method, run)
    if points is None:
        return []
    panels, lines = [], []
    for axis, name in enumerate(ANGLES):
        factor, unit = scale.angle([points.alpha[:, axis]])
        last = axis == len(ANGLES) - 1
        made = style.panel(
            f"{name} [{unit}]", run.x_range, x_label=HOURS if last else None, ticks=10 if alone else 6
        )
        drawn = {
            "measured": style.curve(
                made,
                points.hours,
                points.alpha[:, axis] / factor,
                PALE,
                gap=points.gap,
                width=5.0,
                columns=_COLUMNS,
            )
        }
        if model is not None:
            drawn["predicted"] = style.curve(
                made, model.hours, model.predicted[:, axis] / factor, BLUE, gap=model.gap, columns=_COLUMNS
            )
        panels.append(made)
        lines.append(drawn)
    style.legend(panels[0], [(word, [drawn[word] for drawn in lines]) for word in lines[0]])
    if not alone:
        style.heading(panels[0], run.title)
    return panels


# -------------------------------------------------------------------------------------------- sky plane


def sky_plane(tables: Tables) -> Section | None:
    """The way of the rotor's axis over the sky: one angle against the other, one panel a run."""
    method, found = primary(tables), runs(tables)
    planes = [plane for run in found if (plane := _plane(tables, run, method, alone=len(found) == 1))]
    if not planes:
        return None
    equal = all(plane.match_aspect for plane in planes)
    scales = "both on one scale" if equal else "each on a scale of its own where the path is flat"
    return Section(
        "The sky plane",
        f"The inner angle against the outer one, {scales}: the way of the rotor's axis over the sky.",
        side_by_side([[plane] for plane in planes]),
        _spiral_figures(tables),
    )


def _plane(tables: Tables, run: Run, method: str | None, *, alone: bool) -> figure | None:
    points = measured(tables, run)
    if points is None:
        return None
    factor, unit = scale.angle([points.alpha - points.alpha.mean(axis=0)])
    width, height = np.ptp(points.alpha, axis=0)
    equal = bool(width <= _FLAT * height and height <= _FLAT * width)
    made = style.plane(
        f"{ANGLES[0]} [{unit}]", f"{ANGLES[1]} [{unit}]", height=560 if equal else 320, equal=equal
    )
    items: list[tuple[str, list[Drawn]]] = [
        ("measured", [_points(made, points.alpha[_thin(len(points.alpha), _POINTS)] / factor)])
    ]
    for name in dict.fromkeys((method, "spiral")):
        model = fit(tables, name, run)
        if model is not None and name is not None:
            look = (BLUE, "solid") if name == method else (VERMILION, "6 3")
            items.append((METHODS[name], [_path(made, model, factor, *look)]))
    centre = _centre(tables, run)
    if centre is not None:
        items.append(("its centre", [_mark(made, centre / factor, "x", VERMILION)]))
    _ends(made, points.alpha / factor)
    style.legend(made, items)
    if not alone:
        style.heading(made, run.title)
    return made


def _thin(count: int, most: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Places of at most so many of the points, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _points(made: figure, alpha: Floats) -> Drawn:
    source = ColumnDataSource({"x": alpha[:, 0], "y": alpha[:, 1]})
    return made.scatter("x", "y", source=source, size=8, fill_color=PALE, line_color=None)


def _path(made: figure, model: Fit, factor: float, colour: str, dash: str) -> Drawn:
    """The path by a model, interrupted where the record is."""
    kept = _thin(len(model.hours), _LINE)
    x, y = (model.predicted[kept] / factor).T
    pause = np.flatnonzero(np.diff(model.hours) > model.gap) + 1
    broken = np.unique(np.searchsorted(kept, pause))
    source = ColumnDataSource({"x": np.insert(x, broken, np.nan), "y": np.insert(y, broken, np.nan)})
    return made.line("x", "y", source=source, line_color=colour, line_width=1.6, line_dash=dash)


def _ends(made: figure, alpha: Floats) -> None:
    """Start and end of the path; their words stand towards its middle, and clear of each other."""
    middle = (alpha[:, 0].min() + alpha[:, 0].max()) / 2
    for row, other, word, shape in ((0, -1, "start", "circle"), (-1, 0, "end", "square")):
        _mark(made, alpha[row], shape, BLACK)
        source = ColumnDataSource({"x": alpha[[row], 0], "y": alpha[[row], 1], "word": [word]})
        side: Literal["left", "right"] = "right" if alpha[row, 0] > middle else "left"
        drop = -8 if alpha[row, 1] > alpha[other, 1] else 8
        style.words(made, source, "x", "y", "word", align=side, drop=drop)


def _mark(made: figure, place: Floats, shape: str, colour: str) -> Drawn:
    source = ColumnDataSource({"x": place[:1], "y": place[1:]})
    fill = "white" if shape == "circle" else colour
    return made.scatter(
        "x",
        "y",
        source=source,
        marker=shape,
        size=11 if shape == "circle" else 10,
        fill_color=fill,
        line_color=colour,
        line_width=2.2,
    )


def _centre(tables: Tables, run: Run) -> Floats | None:
    values = [
        _spiral_rows(tables, run.number).get(name, {}).get("value") for name in ("alpha_c1", "alpha_c2")
    ]
    return None if None in values else np.array(values, dtype=np.float64)


def _spiral_rows(tables: Tables, run: int) -> dict[str, dict[str, Any]]:
    """The rows of the method ``spiral`` that are a run's, or of none in particular, by parameter."""
    table = filled(tables, "drift_parameters")
    rows = [] if table is None else table.filter(pc.equal(table["method"], "spiral")).to_pylist()
    return {row["parameter"]: row for row in rows if row["run"] in (run, None)}


def _spiral_figures(tables: Tables) -> str:
    """The spiral in numbers, one row a run."""
    body = ""
    for run in runs(tables):
        rows = _spiral_rows(tables, run.number)
        if any(rows.get(name, {}).get("value") is not None for name in _SPIRAL):
            cells = (_cell(rows.get(name, {}), factor) for name, (factor, _) in _SPIRAL.items())
            body += f"<tr><td>run {run.number}</td>{''.join(cells)}</tr>"
    heads = [f"{symbol(name)}{unit}" for name, (_, unit) in _SPIRAL.items()]
    return html_table(("spiral", *heads), body, range(1, len(heads) + 1), "matrix") if body else ""


def _cell(row: dict[str, Any], factor: float) -> str:
    value, error = row.get("value"), row.get("standard_error")
    shown = with_error(*(None if v is None else v / factor for v in (value, error)))
    return f"<td class=num>{shown}</td>"
