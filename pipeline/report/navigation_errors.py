"""Errors of the methods against truth: how large they are, and whether they are as large as a method says."""

from __future__ import annotations

import numpy as np
from bokeh.models import LayoutDOM
from bokeh.plotting import figure

from pipeline.report import scale, style
from pipeline.report.base import Section, Tables
from pipeline.report.formatting import number
from pipeline.report.navigation_panels import (
    HALF,
    METHODS,
    NARROW,
    NED,
    PHASES,
    Board,
    Rows,
    band,
    drawn,
    methods,
)
from pipeline.report.parts import html_table
from pipeline.report.series import Floats

_DEGREE = np.pi / 180
_WINDOWS = 100  # of the record: over one of them an error's size is taken
_TRANSIENT = 0.1  # of the record, in which what a filter says of its start does not set a scale
_BEYOND = 2.0  # times what the filter's errors need, to which a method without sigma may widen a scale
_MOST = 5.0  # decades of a logarithmic scale
_SIGMAS = 3.0

_FIGURES = {
    "horizontal_position_rms": "position rms [m]",
    "horizontal_position_max": "max [m]",
    "height_rms": "height rms [m]",
    "velocity_rms": "velocity rms [m/s]",
    "velocity_max": "max [m/s]",
    "tilt_rms": "tilt rms [°]",
    "yaw_rms": "yaw rms [°]",
}
"""Metrics of a phase that have a column, and its head; position and velocity are horizontal."""

_SIZES = (
    ("horizontal position [m]", ("position_north", "position_east"), ("sigma_north", "sigma_east"), 1.0, 1.0),
    (
        "horizontal velocity [m/s]",
        ("velocity_north", "velocity_east"),
        ("sigma_v_north", "sigma_v_east"),
        1.0,
        1.0,
    ),
    ("tilt [°]", ("pitch", "roll"), ("sigma_phi_north", "sigma_phi_east"), _DEGREE, 2.0),
    ("yaw [°]", ("yaw",), ("sigma_phi_down",), _DEGREE, 1.0),
)
"""Label, components, their sigmas, unit, and of how many components the mean square is taken."""


def sizes(tables: Tables) -> Section | None:
    """How large the errors of every method are, on logarithmic scales, with what a method says of its own."""
    found, board = methods(tables, "navigation_errors"), Board.of(tables)
    if not found or board is None:
        return None
    panels = []
    for place, (label, names, sigmas, size_of, share) in enumerate(_SIZES):
        made = board.panel(label, height=200, x_label=place >= 2, logarithmic=True)
        near: list[Floats] = []
        far: list[Floats] = []
        for rows in found:
            square = sum(rows[name] ** 2 for name in names) / (share * size_of**2)
            size = _moving_rms(rows.time, np.asarray(square, dtype=np.float64))
            board.note(rows.method, drawn(made, rows, size, width=1.7, columns=HALF))
            (far if rows.method == "strapdown" else near).append(size)
            if all(rows.has(name) for name in sigmas):
                variance = sum(rows[name] ** 2 for name in sigmas) / (share * size_of**2)
                said = np.sqrt(np.asarray(variance, dtype=np.float64))
                board.note(rows.method, drawn(made, rows, said, width=1.0, dash="3 3", columns=HALF))
                near.append(said)
        made.y_range = style.span(*_decades(near, far))
        panels.append(made)
    board.row(*panels[:2])
    board.row(*panels[2:])
    return Section(
        "How large the errors are",
        f"Root mean square over 1/{_WINDOWS} of the record, on logarithmic scales. Dotted: the standard "
        "deviation that a method states of itself. Below: by phase, position and velocity horizontal.",
        board.arranged(),
        _by_phase(tables),
    )


def _moving_rms(time: Floats, square: Floats) -> Floats:
    """Root of the mean of a square about each instant; NaN where it is not known."""
    known = np.isfinite(square)
    half = (time[-1] - time[0]) / (2 * _WINDOWS)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, square, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    first, end = np.searchsorted(time, time - half), np.searchsorted(time, time + half, side="right")
    mean = (total[end] - total[first]) / np.maximum(count[end] - count[first], 1)
    # A sum of differences can come out below zero by its rounding.
    return np.where(known, np.sqrt(np.maximum(mean, 0.0)), np.nan)


def _by_phase(tables: Tables) -> str:
    """The figures of the score, one row a phase and method: the methods of a phase stand together."""
    values: dict[str, dict[str, float | None]] = {}
    for row in tables["metrics"].to_pylist():
        if row["name"] in _FIGURES:
            values.setdefault(row["channel"], {})[row["name"]] = row["value"]
    body = ""
    for phase in PHASES:
        there = [method for method in METHODS if f"{method}.{phase}" in values]
        for method in there:
            cells = "".join(_cell(values[f"{method}.{phase}"].get(name)) for name in _FIGURES)
            body += f"<tr><td>{phase if method == there[0] else ''}</td><td>{method}</td>{cells}</tr>"
    heads = ("phase", "method", *_FIGURES.values())
    return html_table(heads, body, range(2, len(heads)), "matrix") if body else ""


def _cell(value: float | None) -> str:
    return f"<td class=num title={value!r}>{number(value)}</td>"


def _decades(near: list[Floats], far: list[Floats]) -> tuple[float, float]:
    """A logarithmic scale: what runs away leaves it where it would take too many decades."""
    low, high = _least_and_most(near or far)
    farthest = _least_and_most(far or near)[1]
    return low / 1.5, 1.5 * max(high, min(farthest, low * 10.0**_MOST))


def _least_and_most(sizes: list[Floats]) -> tuple[float, float]:
    there = np.concatenate(sizes)
    there = there[np.isfinite(there) & (there > 0.0)]
    if not len(there):
        return 0.1, 10.0
    high = float(there.max())
    # An error that passes through nothing, as at a true start, would take half the scale.
    return max(float(np.quantile(there, 0.01)), high * 10.0**-_MOST), high


def errors(tables: Tables) -> Section | None:
    """Position, velocity and attitude, component by component, with the band of three sigma."""
    found, board = methods(tables, "navigation_errors"), Board.of(tables)
    if not found or board is None:
        return None
    return Section(
        "Errors by component",
        f"Navigated less true; band: ±{_SIGMAS:.0f}σ that a method states of itself. A method that has none "
        "leaves the panel where it is far off.",
        _components(found, board),
    )


def _components(found: list[Rows], board: Board) -> LayoutDOM:
    angles = [rows[f"phi_{axis}"] for rows in found if rows.method != "strapdown" for axis in NED]
    factor, unit = scale.angle(angles or [rows["phi_north"] for rows in found])
    columns = (
        ("position", "m", "position", "sigma", 1.0),
        ("velocity", "m/s", "velocity", "sigma_v", 1.0),
        ("attitude", unit, "phi", "sigma_phi", factor),
    )
    for axis in NED:
        row = []
        for word, of, error, sigma, size in columns:
            made = board.panel(
                f"{axis} [{of}]",
                heading=word if axis == NED[0] else "",
                x_label=axis == NED[-1],
            )
            _draw(made, board, found, f"{error}_{axis}", f"{sigma}_{axis}", size)
            row.append(made)
        board.row(*row)
    return board.arranged()


def _draw(made: figure, board: Board, found: list[Rows], error: str, sigma: str, unit: float) -> None:
    sure: list[tuple[str, float]] = []
    unsure: list[tuple[str, float]] = []
    for rows in found:
        value, said = rows[error] / unit, _SIGMAS * rows[sigma] / unit
        shade = band(made, rows, np.zeros(len(said)), said, columns=NARROW)
        board.note(rows.method, drawn(made, rows, value, columns=NARROW), *([shade] if shade else []))
        settled = rows.time >= _TRANSIENT * board.clock.duration
        reach = np.fmax(np.abs(value), np.where(settled, said, np.nan))[settled]
        (sure if shade else unsure).append((rows.method, float(np.nanmax(reach, initial=0.0))))
    made.y_range = style.span(*_reach(sure, unsure))


def _reach(sure: list[tuple[str, float]], unsure: list[tuple[str, float]]) -> tuple[float, float]:
    """A scale about zero: by the methods that state a sigma, and a little wider for those that do not."""
    best = max((reach for _, reach in sure), default=0.0)
    corrected = [reach for method, reach in unsure if method != "strapdown"]
    others = max(corrected or [reach for _, reach in unsure], default=0.0)
    widest = max(best, min(others, _BEYOND * best)) if sure else others
    return -1.1 * widest or -1.0, 1.1 * widest or 1.0
