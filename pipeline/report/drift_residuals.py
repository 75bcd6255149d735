"""Measured less predicted angles of the primary method, and how well it foretells what it has not seen."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, DataRange1d
from bokeh.models.annotations import BoxAnnotation
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Section, Tables
from pipeline.report.drift_runs import HOURS, METHODS, Fit, Floats, Run, fit, primary, runs
from pipeline.report.drift_trajectory import ANGLES, side_by_side
from pipeline.report.formatting import number, plural
from pipeline.report.style import BLACK, BLUE, PALE, VERMILION, Drawn

ARCSEC = np.pi / 180 / 3600
_COLUMNS = 1000  # of the page's width; half as many where two runs share it
_BEYOND = 1.15  # times the largest value of the curves: where an outlier leaves the panel
_PLAIN = (1e-3, 999.5)  # arcsec, shown in three digits whatever they are
_OUTLIERS = 500  # marked samples drawn of one panel, the largest


def residuals(tables: Tables) -> Section | None:
    """Residuals of both angles, one column of panels a run."""
    method, found = primary(tables), runs(tables)
    blocks = [block for run in found if (block := _run(tables, run, method, alone=len(found) == 1))]
    if not blocks or method is None:
        return None
    foretold = any(fit(tables, method, run, held_out=True) for run in found)
    rest = (
        " Each shaded part was also predicted with parameters from the parts that are not shaded; the error "
        "of that prediction is drawn over it."
        if foretold
        else ""
    )
    return Section(
        "Residuals",
        f"Measured less predicted angles, parameters by {METHODS[method]}.{rest}",
        side_by_side(blocks),
    )


def _run(tables: Tables, run: Run, method: str | None, *, alone: bool) -> list[figure]:
    model, foretold = fit(tables, method, run), fit(tables, method, run, held_out=True)
    if model is None and foretold is None:
        return []
    panels = []
    for axis, name in enumerate(ANGLES):
        last = axis == len(ANGLES) - 1
        made = style.panel(
            f"{name} [arcsec]",
            run.x_range,
            height=170,
            x_label=HOURS if last else None,
            ticks=10 if alone else 6,
        )
        made.y_range = DataRange1d(only_visible=True)  # a click on the legend lets the rest have the scale
        style.legend(made, _draw(made, model, foretold, axis, _COLUMNS if alone else _COLUMNS // 2))
        panels.append(made)
    if not alone:
        style.heading(panels[0], run.title)
    return panels


def _draw(
    made: figure, model: Fit | None, foretold: Fit | None, axis: int, columns: int
) -> list[tuple[str, list[Drawn]]]:
    """The curves of one angle, and what the legend says of each."""
    items: list[tuple[str, list[Drawn]]] = []
    largest = 0.0
    if foretold is not None:
        for first, last in _stretches(foretold):
            made.add_layout(
                BoxAnnotation(left=first, right=last, fill_color=PALE, fill_alpha=0.22, level="underlay")
            )
    if model is not None:
        value = model.residual[:, axis] / ARCSEC
        used = np.where(model.outlier | model.bridged, np.nan, value)
        line = style.curve(made, model.hours, used, BLUE, gap=model.gap, width=1.0, columns=columns)
        items.append((f"residual, RMS {_rms(used)}", [line]))
        largest = float(np.nanmax(np.abs(used), initial=0.0))
    if foretold is not None:
        error = foretold.residual[:, axis] / ARCSEC
        line = style.curve(
            made, foretold.hours, error, VERMILION, gap=foretold.gap, width=1.0, columns=columns
        )
        items.append((f"prediction, RMS {_rms(error)}", [line]))
        largest = max(largest, float(np.abs(error).max()))
    if model is not None and model.outlier.any():
        items.append(
            (plural(int(model.outlier.sum()), "outlier"), [_outliers(made, model, value, _BEYOND * largest)])
        )
    return items


def _stretches(foretold: Fit) -> list[tuple[float, float]]:
    """First and last hour of each stretch that was held out: of every arc the last part."""
    breaks = np.flatnonzero(np.diff(foretold.hours) > foretold.gap) + 1
    return [(float(part[0]), float(part[-1])) for part in np.split(foretold.hours, breaks)]


def _rms(value: Floats) -> str:
    there = value[np.isfinite(value)]
    rms = float(np.sqrt(np.mean(there**2))) if len(there) else 0.0
    return f"{rms:#.3g}″" if _PLAIN[0] <= rms < _PLAIN[1] else f"{number(rms)}″"


def _outliers(made: figure, model: Fit, value: Floats, edge: float) -> Drawn:
    """Marked samples as circles; those beyond the edge as triangles at it: the rest keeps its scale."""
    marked = np.flatnonzero(model.outlier)
    kept = np.sort(marked[np.argsort(-np.abs(value[marked]), kind="stable")[:_OUTLIERS]])
    size = value[kept]
    beyond = np.abs(size) > edge if edge > 0.0 else np.zeros(len(size), dtype=np.bool_)
    source = ColumnDataSource(
        {
            "x": model.hours[kept],
            "y": np.where(beyond, np.sign(size) * edge, size),
            "residual": size,
            "shape": np.where(beyond, np.where(size > 0, "triangle", "inverted_triangle"), "circle").tolist(),
        }
    )
    drawn: Drawn = made.scatter(
        "x",
        "y",
        source=source,
        marker="shape",
        size=7,
        fill_color="white",
        line_color=BLACK,
        line_width=1.3,
    )
    style.hover(made, drawn, [("time [h]", "x"), ("residual [arcsec]", "residual")])
    return drawn
