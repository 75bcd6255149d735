"""The deviations of each channel against averaging time, and the noise coefficients that they give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models import ColumnDataSource

from pipeline.report import style
from pipeline.report.base import Section, Tables, column
from pipeline.report.formatting import measured, unit
from pipeline.report.parts import html_table
from pipeline.report.static_panels import (
    DEG_H,
    FAINT,
    Floats,
    Panel,
    Panels,
    band,
    by_channel,
    line,
    log_span,
    panels,
    plainly,
)
from pipeline.report.style import BLACK, BLUE, GREEN, VERMILION

_OTHERS = {"modified": ("modified", "solid"), "hadamard": ("Hadamard", "5 3"), "total": ("total", "2 3")}
_BEYOND = 3.0  # times the extreme deviations, to which a panel shows the confidence intervals

NAMES = {
    "N": "angle random walk",
    "B": "bias instability",
    "K": "rate random walk",
    "Q": "quantisation",
    "R": "rate ramp",
}
"""The noise coefficients as data sheets call them."""

_SLOPES = {
    "Q": (-1.0, np.sqrt(3.0)),
    "N": (-0.5, 1.0),
    "B": (0.0, np.sqrt(2 * np.log(2) / np.pi)),
    "K": (0.5, np.sqrt(1 / 3)),
    "R": (1.0, np.sqrt(0.5)),
}
"""Power of tau, and factor, of the Allan deviation of a unit coefficient (IEEE Std 952-1997, annex C)."""
_EXPONENTS = {"Q": "−1", "N": "−½", "B": "flat", "K": "+½", "R": "+1"}


def deviations(tables: Tables) -> Section | None:
    """One panel a channel: Allan deviation with its interval, the fit, its terms, the other estimators."""
    channels = by_channel(tables, "allan", "tau")
    if not channels:
        return None
    whole = tables["allan"]
    deviation = column(whole, "deviation") * DEG_H
    tau = column(whole, "tau")
    made = panels(
        plainly(channels),
        log_span([tau], 1.1),
        log_span([deviation], _BEYOND),
        "averaging time τ [s]",
        "deviation [deg/h]",
    )
    terms = _terms(tables)
    for channel, table in channels.items():
        _draw(made, channel, table, terms.get(channel, {}))
    shown = [name for name in _SLOPES if any(name in of for of in terms.values())]
    listed = ", ".join(f"{name} {NAMES[name]} ({_EXPONENTS[name]})" for name in shown)
    named = f" Terms of the fit and their slopes: {listed}." if listed else ""
    return Section(
        "Allan deviation",
        "How much the mean rate over τ differs from one such time to the next, in deg/h (the table holds "
        f"rad/s), with its confidence interval, the fit of the noise coefficients to it, and the same by the "
        f"noise model below, which was fitted to the spectrum.{named}",
        made.arranged(),
    )


def coefficients(tables: Tables) -> Section | None:
    """The noise coefficients in the units of data sheets, one column a channel."""
    table = tables.get("noise_coefficients")
    if table is None or not table.num_rows:
        return None
    rows = {(row["coefficient"], row["channel"]): row for row in table.to_pylist()}
    channels = sorted({channel for _, channel in rows})
    body = "".join(_line(name, channels, rows) for name in NAMES if any(name == of for of, _ in rows))
    pale = " Pale: not significant, the record does not show it."
    return Section(
        "Noise coefficients",
        "From the Allan variance, in the units of data sheets, ± one standard error."
        + ("" if all(row["significant"] for row in rows.values()) else pale),
        None,
        html_table(("noise", "", "unit", *channels), body, range(3, 3 + len(channels)), "matrix"),
    )


def _terms(tables: Tables) -> dict[str, dict[str, float]]:
    """The significant coefficients of each channel [SI]."""
    terms: dict[str, dict[str, float]] = {}
    table = tables.get("noise_coefficients")
    for row in [] if table is None else table.to_pylist():
        if row["significant"] and row["value"] > 0.0:
            terms.setdefault(row["channel"], {})[row["coefficient"]] = row["value"]
    return terms


def _draw(made: Panels, channel: str, table: pa.Table, terms: Mapping[str, float]) -> None:
    panel, others = made.of[channel], {}
    for estimator, (word, dash) in _OTHERS.items():
        mine = table.filter(pc.equal(table["estimator"], estimator))
        if mine.num_rows:
            tau, deviation = column(mine, "tau"), column(mine, "deviation") * DEG_H
            others[word] = line(panel, tau, deviation, FAINT, width=1.0, dash=dash)
    allan = table.filter(pc.equal(table["estimator"], "allan"))
    if allan.num_rows:
        _draw_allan(made, panel, allan, terms)
    for word, drawn in others.items():
        made.note(word, drawn)


def _draw_allan(made: Panels, panel: Panel, allan: pa.Table, terms: Mapping[str, float]) -> None:
    tau = column(allan, "tau")
    deviation, low, high, fit, model = (
        column(allan, name) * DEG_H for name in ("deviation", "lower", "upper", "model", "noise_model")
    )
    shaded = band(panel, tau, low, high, BLUE)
    curve = line(panel, tau, deviation, BLUE, width=2.0)
    made.note("Allan deviation", curve, shaded)
    style.hover(panel.figure, curve, [("averaging time [s]", "x"), ("Allan deviation [deg/h]", "y")])
    if np.isfinite(fit).any():
        made.note("fit of the coefficients", line(panel, tau, fit, BLACK, width=1.3, dash="6 3"))
    if np.isfinite(model).any():
        made.note("noise model", line(panel, tau, model, GREEN, width=1.3))
    _slopes(made, panel, tau, deviation, terms)


def _slopes(made: Panels, panel: Panel, tau: Floats, deviation: Floats, terms: Mapping[str, float]) -> None:
    """A thin line for each term, named where it is farthest from all the others."""
    corners = np.log(np.column_stack([panel.x, panel.y]))
    x = np.geomspace(*panel.x, 60)
    there = {name: terms[name] * _SLOPES[name][1] * x ** _SLOPES[name][0] * DEG_H for name in terms}

    def placed(x: Floats, y: Floats) -> Floats:
        """Points as they lie in the frame, its width and its height 1."""
        return np.asarray((np.log(np.column_stack([x, y])) - corners[0]) / (corners[1] - corners[0]))

    positive = deviation > 0.0
    curve = placed(tau[positive], deviation[positive])
    lines = {name: placed(x, y) for name, y in there.items()}
    for name, y in there.items():
        made.note("terms of the fit", line(panel, x, y, VERMILION, width=0.8))
        others = np.concatenate([curve, *(of for other, of in lines.items() if other != name)])
        at = _freest(lines[name], others)
        if at is not None:
            source = ColumnDataSource({"x": x[[at]], "y": y[[at]], "word": [name]})
            word = style.words(
                panel.figure, source, "x", "y", "word", colour=VERMILION, align="center", drop=-9
            )
            made.note("terms of the fit", word)


def _freest(points: Floats, others: Floats) -> int | None:
    """Which of the points, well inside the frame, is farthest from all others; None where none is inside."""
    inside = np.all((points > 0.05) & (points < 0.93), axis=1)
    if not inside.any():
        return None
    apart = np.min(np.linalg.norm(points[:, None] - others[None], axis=2), axis=1, initial=np.inf)
    return int(np.argmax(np.where(inside, apart, -1.0)))


def _line(name: str, channels: Sequence[str], rows: Mapping[tuple[str, str], dict[str, Any]]) -> str:
    mine = [rows.get((name, channel)) for channel in channels]
    of = next(row["datasheet_unit"] for row in mine if row is not None)
    return (
        f"<tr><td>{name}</td><td>{NAMES[name]}</td><td>{escape(unit(of))}</td>"
        + "".join(map(_cell, mine))
        + "</tr>"
    )


def _cell(row: dict[str, Any] | None) -> str:
    if row is None:
        return "<td class=num>–</td>"
    text = measured(row["datasheet_value"], row["datasheet_standard_error"])
    look = "num" if row["significant"] else '"num pale"'
    return f"<td class={look} title={row['value']!r}>{text}</td>"
