"""The input axes of a triad against the axes of its case: where their tips lie, and how surely."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.annotations import Span
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline.report import scale, style
from pipeline.report.base import Section, Tables
from pipeline.report.formatting import measured
from pipeline.report.parts import html_table
from pipeline.report.rate_table_runs import BORDER, CHANNELS, Floats, Row, rows_of
from pipeline.report.style import BLACK, BLUE, PALE

_HEIGHT = 330
_SIGMAS = 2.0
_POINTS = 73
_PAIRS = ("pq", "pr", "qr")


def axes(tables: Tables) -> Section | None:
    """One panel a gyro: the tip of its input axis, seen along the axis of the case that it should lie on."""
    told = {row["parameter"]: row for row in rows_of(tables, "calibration") if not row["gyro"]}
    tips = {channel: tip for channel in CHANNELS if (tip := _tip(told, channel)) is not None}
    if not tips:
        return None
    covariance = {
        (row["row"], row["column"]): row["value"]
        for row in rows_of(tables, "calibration_covariance")
        if not row["gyro"]
    }
    ellipses = {channel: _ellipse(told, covariance, channel) for channel in tips}
    corners = [tips[c] + sign * ellipses[c].max(axis=1) for c in tips for sign in (-1, 1)]
    factor, unit = scale.angle(corners)
    reach = max(float(np.abs(corner).max()) for corner in corners) / factor or 1.0
    panels = []
    for channel, tip in tips.items():
        across = [c for c in CHANNELS if c != channel]
        made = style.plane(*(f"towards {c} [{unit}]" for c in across), height=_HEIGHT, equal=True)
        corner = ColumnDataSource({"x": [-reach, reach], "y": [-reach, reach]})
        made.scatter("x", "y", source=corner, size=0)  # one scale for all, that every panel shows whole
        made.min_border_left = BORDER
        _draw(made, tip / factor, ellipses[channel] / factor)
        style.heading(made, f"input axis of {channel}")
        panels.append(made)
    return Section(
        "Input axes",
        "The tip of each gyro's input axis, seen along the axis of the case on which it should lie: the "
        "cross is that axis, the ellipse two standard errors. Below, how far the input axes are from square "
        "to each other (90° less the angle between two), and how the triad as a whole is turned in its case.",
        style.grid([panels]),
        _angles(told, factor, unit),
    )


def _tip(told: Mapping[str, Row], channel: str) -> Floats | None:
    """Components of the input axis across the axis of the case [rad], shape (2,); None where not told."""
    rows = [told.get(f"misalignment_{channel}{c}") for c in CHANNELS if c != channel]
    values = [row["value"] for row in rows if row is not None and row["value"] is not None]
    return np.array(values) if len(values) == 2 else None


def _ellipse(
    told: Mapping[str, Row], covariance: Mapping[tuple[str, str], float], channel: str
) -> NDArray[np.float64]:
    """The ellipse of two standard errors about a tip [rad], shape (2, n).

    The components are S_ij / K_i, of whose errors those of S_ij alone count to first order.
    """
    i = CHANNELS.index(channel) + 1
    names = [f"S{i}{j}" for j in range(1, len(CHANNELS) + 1) if j != i]
    K = told[f"scale_factor_{channel}"]["value"]
    C = np.array([[covariance.get((a, b), 0.0) for b in names] for a in names]) / K**2
    size, directions = np.linalg.eigh(C)
    angle = np.linspace(0.0, 2 * np.pi, _POINTS)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(_SIGMAS * directions @ (np.sqrt(np.maximum(size, 0.0))[:, np.newaxis] * circle))


def _draw(made: figure, tip: Floats, ellipse: Floats) -> None:
    for dimension in ("width", "height"):
        made.add_layout(Span(location=0.0, dimension=dimension, line_color=PALE, line_width=1))
    made.scatter([0.0], [0.0], marker="cross", size=14, line_color=BLACK, line_width=1.6)
    x, y = tip[:, np.newaxis] + ellipse
    source = ColumnDataSource({"x": x, "y": y})
    made.patch("x", "y", source=source, fill_color=BLUE, fill_alpha=0.15, line_color=BLUE, line_width=1.2)
    made.line([0.0, tip[0]], [0.0, tip[1]], line_color=BLUE, line_width=1.2, line_dash="4 3")
    point = ColumnDataSource({"x": tip[:1], "y": tip[1:]})
    drawn = made.scatter("x", "y", source=point, size=8, fill_color=BLUE, line_color=BLUE)
    style.hover(made, drawn, [("across", "x"), ("up", "y")])


def _angles(told: Mapping[str, Row], factor: float, unit: str) -> str:
    """Misalignments, angles between the input axes and the turn of the triad in its case, with errors."""
    wanted = {
        "misalignment": [a + b for a in CHANNELS for b in CHANNELS if a != b],
        "nonorthogonality": _PAIRS,
        "triad_rotation": CHANNELS,
    }
    rows = {f"{name}_{of}": told.get(f"{name}_{of}") for name, axes_ in wanted.items() for of in axes_}
    tables = ""
    for name, words in (
        ("misalignment", "input axis, towards"),
        ("nonorthogonality", "short of 90°, between"),
        ("triad_rotation", "triad turned, about"),
    ):
        body = "".join(
            f"<tr><td>{_pair(of, name)}</td><td class=num>{_cell(rows[f'{name}_{of}'], factor)}</td></tr>"
            for of in wanted[name]
        )
        tables += html_table((words, f"[{unit}]"), body, (1,), "matrix")
    return f'<div class="matrices">{tables}</div>'


def _pair(of: str, name: str) -> str:
    """The axes of an angle in words."""
    joiner = {"misalignment": " towards ", "nonorthogonality": " and "}.get(name, "")
    return joiner.join(of)


def _cell(row: Row | None, factor: float) -> str:
    if row is None or row["value"] is None:
        return '<span class="pale">not determined</span>'
    error = row["standard_error"]
    text = measured(row["value"] / factor, None if error is None else error / factor)
    return text if row["state"] == "determined" else f'<span class="pale">{text}</span>'
