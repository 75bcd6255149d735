"""The spectrum of each channel with the chosen noise model, and the candidates among which it was chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource

from pipeline.report import style
from pipeline.report.base import Section, Tables, column
from pipeline.report.formatting import measured, number
from pipeline.report.parts import html_table
from pipeline.report.static_panels import (
    DEG_H,
    DEG_ROOT_H,
    DEG_S,
    by_channel,
    line,
    log_span,
    mark,
    panels,
    plainly,
    rate_in_words,
    recommended,
)
from pipeline.report.style import BLUE, VERMILION

_DOTS = 400  # of a panel; more become a line


class Shown(NamedTuple):
    """How a parameter is shown: its heading, and ``factor * value ** power``, which is in its unit."""

    heading: str
    factor: float
    power: float


_PARAMETERS = {
    "N": Shown("√N [deg/√h]", DEG_ROOT_H, 0.5),
    "sigma": Shown("σ [deg/h]", DEG_H, 1.0),
    "mu": Shown("1/μ [s]", 1.0, -1.0),
    "lambda": Shown("2π/λ [s]", 2 * math.pi, -1.0),
    "K": Shown("K [deg/h/√h]", DEG_S * 3600 * 60, 1.0),
    "Q": Shown("Q [″]", DEG_H, 1.0),
}


def spectrum(tables: Tables) -> Section | None:
    """One panel a channel: the root of the density, the chosen model, and where the platform would turn."""
    channels = by_channel(tables, "spectrum", "frequency")
    if not channels:
        return None
    whole, rates = tables["spectrum"], recommended(tables)
    turns = [np.array([rates[c] / (2 * np.pi)]) for c in channels if c in rates]
    made = panels(
        plainly(channels),
        log_span([column(whole, "frequency"), *turns]),
        log_span([np.sqrt(column(whole, name)) * DEG_ROOT_H for name in ("density", "model")]),
        "frequency [Hz]",
        "√density [deg/√h]",
    )
    for channel, table in channels.items():
        panel, frequency = made.of[channel], column(table, "frequency")
        density, model = (np.sqrt(column(table, name)) * DEG_ROOT_H for name in ("density", "model"))
        there = (frequency > 0.0) & (density > 0.0)
        if there.sum() > _DOTS:
            drawn = line(panel, frequency, density, BLUE, width=0.8)
        else:
            source = ColumnDataSource({"x": frequency[there], "y": density[there]})
            drawn = panel.figure.scatter("x", "y", source=source, size=4, line_color=None, fill_color=BLUE)
        made.note("periodogram, means about a frequency", drawn)
        style.hover(panel.figure, drawn, [("frequency [Hz]", "x"), ("√density [deg/√h]", "y")])
        if np.isfinite(model).any():
            made.note("chosen model", line(panel, frequency, model, VERMILION, width=2.0))
        if rates.get(channel, 0.0) > 0.0:
            mark(panel, rates[channel] / (2 * np.pi), f"one turn at {rate_in_words(rates[channel])}")
    marked = any(rates.get(channel, 0.0) > 0.0 for channel in channels)
    return Section(
        "Spectrum",
        "Root of the two-sided spectral density in the unit of an angle random walk: white noise N lies at N."
        + (" Dashed: the recommended rotation, which moves the error's spectrum there." if marked else ""),
        made.arranged(),
    )


def models(tables: Tables) -> Section | None:
    """The candidates and how much worse than the best they are; the parameters of the chosen ones."""
    table = tables.get("noise_model")
    if table is None or not table.num_rows:
        return None
    rows = table.to_pylist()
    return Section(
        "Noise models",
        "Models by debiased Whittle likelihood. Above: Bayesian information criterion less that of the best, "
        "which is chosen; a difference of 10 is decisive. Below: the parameters of the chosen ones ± one "
        "standard error, and their 95 % intervals.",
        None,
        _candidates(rows) + _parameters([row for row in rows if row["chosen"]]),
    )


def _candidates(rows: Sequence[dict[str, Any]]) -> str:
    """Differences of the criterion: one row a candidate, one column a channel."""
    channels = sorted({row["channel"] for row in rows})
    found = {(row["candidate"], row["channel"]): row for row in rows}
    body = ""
    for candidate in dict.fromkeys(row["candidate"] for row in rows):
        mine = [found.get((candidate, channel)) for channel in channels]
        cells = "".join(f"<td class=num>{_difference(row)}</td>" for row in mine)
        body += f"<tr><td>{escape(candidate)}</td>{cells}</tr>"
    return html_table(("model", *channels), body, range(1, 1 + len(channels)), "matrix")


def _difference(row: dict[str, Any] | None) -> str:
    if row is None:
        return "–"
    text = f"{row['bic']:.1f}" if row["bic"] else "0"
    return f"<strong>{text}</strong>" if row["chosen"] else text


def _parameters(rows: Sequence[dict[str, Any]]) -> str:
    """The parameters of the chosen models, one row a channel."""
    if not rows:
        return ""
    names = [name for name in _PARAMETERS if any(row["parameter"] == name for row in rows)]
    body = ""
    for channel in sorted({row["channel"] for row in rows}):
        mine = [row for row in rows if row["channel"] == channel]
        cells = "".join(
            "<td class=num>" + "".join(_parameter(row) for row in mine if row["parameter"] == name) + "</td>"
            for name in names
        )
        chosen = f"<strong>{escape(mine[0]['candidate'])}</strong>"
        body += f"<tr><td>{escape(channel)}</td><td>{chosen}</td>{cells}</tr>"
    heads = ("channel", "chosen model", *(_PARAMETERS[name].heading for name in names))
    return html_table(heads, body, range(2, 2 + len(names)), "matrix")


def _parameter(row: dict[str, Any]) -> str:
    """Value, error and interval; an error is that of the logarithm times the value: the power scales it."""
    shown = _PARAMETERS[row["parameter"]]

    def converted(value: float) -> float:
        return shown.factor * value**shown.power if value > 0.0 else 0.0

    value, error = row["value"], row["standard_error"]
    if error is not None and value > 0.0:
        error *= converted(value) * abs(shown.power) / value
    text = f"<div title={row['value']!r}>{measured(converted(value), error)}</div>"
    ends = [row[end] for end in ("lower", "upper")]
    if None in ends or (shown.power < 0 and not all(ends)):
        return text
    low, high = (float(f"{end:.3g}") for end in sorted(map(converted, ends)))
    return f'{text}<div class="error">{number(low)} to {number(high)}</div>'
