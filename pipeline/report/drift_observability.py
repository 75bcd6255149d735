"""What the record can tell: how well each direction among the parameters is known, what would help."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource, FixedTicker
from bokeh.models.annotations import Span
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Section, Tables
from pipeline.report.drift_runs import EARTH_RATE, IDENTIFIED, SURE, Floats, filled, primary, symbol
from pipeline.report.formatting import measured, number, power_of_ten, standard_error
from pipeline.report.parts import html_table
from pipeline.report.style import BLACK, BLUE, SEVERITY, Drawn

_COLOURS = {"determined": BLUE, "weak": SEVERITY["warning"], "null": SEVERITY["error"]}
_ROW = 22  # pixels
_TERMS = 4  # of a direction that are named
_LEAST = 0.15  # component that is named
_BELOW = 0.3  # decades below the smallest singular value, at least, where the bars begin
_STUB = 0.012  # of the decades: the bar of a null direction
_ROOM = 0.42  # of the decades: for the words beside a bar
_TICKS = 8
_ARCMIN = np.pi / 180 / 60


class Direction(NamedTuple):
    """One direction: its number, singular value, standard deviation along it, state, components by name."""

    number: int
    singular_value: float
    standard_deviation: float | None
    state: str
    components: Mapping[str, float]


def directions(tables: Tables) -> list[Direction]:
    """The directions, the best determined first."""
    table = filled(tables, "observability")
    grouped: dict[int, list[dict[str, Any]]] = {}
    for row in [] if table is None else table.to_pylist():
        grouped.setdefault(row["direction"], []).append(row)
    several = _several_runs(row for rows in grouped.values() for row in rows)
    return [
        Direction(
            number,
            rows[0]["singular_value"],
            rows[0]["standard_deviation"],
            rows[0]["state"],
            {symbol(row["parameter"], row["run"] if several else None): row["component"] for row in rows},
        )
        for number, rows in sorted(grouped.items())
    ]


def _several_runs(rows: Iterable[Mapping[str, Any]]) -> bool:
    return len({row["run"] for row in rows if row["run"] is not None}) > 1


def named(components: Mapping[str, float]) -> str:
    """A direction by its largest components: ``0.71 m11 + 0.58 mc2 − 0.40 ε3``; the first is positive."""
    largest = sorted(components, key=lambda name: -abs(components[name]))
    kept = [name for name in largest[:_TERMS] if abs(components[name]) >= _LEAST] or largest[:1]
    turn = 1.0 if components[kept[0]] > 0 else -1.0
    terms = [(turn * components[name], name) for name in kept]
    text = "".join(f" {'−' if value < 0 else '+'} {abs(value):.2f} {name}" for value, name in terms)
    rest = 1 - sum(value**2 for value, _ in terms)
    return text.removeprefix(" + ") + (" + …" if rest > _LEAST**2 else "")


def observability(tables: Tables) -> Section | None:
    """Singular-value bars with the weak directions named; beneath, what is known all the same, and advice."""
    found = directions(tables)
    if not found:
        return None
    made = _bars(found)
    below = _combinations(tables) + _further_runs(tables)
    return Section("What the record can tell", _summary(tables, found), style.grid([[made]]), below)


def _summary(tables: Tables, found: Sequence[Direction]) -> str:
    counts = {state: sum(d.state == state for d in found) for state in _COLOURS}
    poor = " and ".join(f"{n} {state}" for state, n in counts.items() if n and state != "determined")
    text = (
        "Directions in the space of the parameters, the best determined first: "
        f"{counts['determined']} of {len(found)} are determined" + (f", {poor}." if poor else ".")
    )
    rows = _primary_rows(tables)
    several = _several_runs(rows)
    for state, words in (("combined", "Only in combination"), ("undetermined", "Not at all")):
        names = [symbol(r["parameter"], r["run"] if several else None) for r in rows if r["state"] == state]
        text += f" {words}: {', '.join(names)}." if names else ""
    return text


def _primary_rows(tables: Tables) -> list[dict[str, Any]]:
    """The parameters by the primary method."""
    table, method = filled(tables, "drift_parameters"), primary(tables)
    rows = [] if table is None else table.to_pylist()
    return [row for row in rows if row["method"] == method and row["parameter"].startswith(IDENTIFIED)]


def _bars(found: Sequence[Direction]) -> figure:
    """One bar a direction over the decades; those of null directions, which are rounding, are stubs."""
    values = np.array([d.singular_value for d in found])
    real = np.array([d.state != "null" for d in found]) & (values > 0.0)
    top = float(np.log10(values[real].max(initial=1.0)))
    bottom = float(np.floor(np.log10(values[real].min(initial=1.0)) - _BELOW))
    ends = np.where(real, np.log10(np.where(real, values, 1.0)), bottom + _STUB * (top - bottom))
    poor = [float(end) for end, d in zip(ends, found, strict=True) if d.state != "determined"]
    right = max(top + 0.02 * (top - bottom), max(poor, default=bottom) + _ROOM * (top - bottom))
    made = style.panel(
        "",
        style.span(bottom, right),
        height=_ROW * len(found) + 14,
        x_label="singular value: useful over actual standard deviation [1]; 1 is just useful",
    )
    style.rows(made, [f"direction {d.number}" for d in found])
    step = max(1, round((top - bottom) / _TICKS))
    decades = list(range(int(bottom), math.floor(top) + 1, step))
    made.xaxis.ticker = FixedTicker(ticks=decades)
    made.xaxis.major_label_overrides = {n: style.plain(power_of_ten(n)) for n in decades}
    made.add_layout(
        Span(location=0.0, dimension="height", line_color=BLACK, line_dash="4 3", level="underlay")
    )
    items = []
    for state, colour in _COLOURS.items():
        rows = [row for row, d in enumerate(found) if d.state == state]
        if rows:
            chosen = [found[row] for row in rows]
            items.append((state, _draw(made, rows, chosen, ends[rows], (bottom, colour))))
    style.legend(made, items)
    return made


def _draw(
    made: figure, rows: Sequence[int], chosen: Sequence[Direction], ends: Floats, look: tuple[float, str]
) -> list[Drawn]:
    """Bars of one state, and beside those that are not determined the direction in words."""
    left, colour = look
    source = ColumnDataSource(
        {
            "row": list(rows),
            "end": ends,
            "value": [number(d.singular_value) for d in chosen],
            "deviation": [number(d.standard_deviation) for d in chosen],
            "state": [d.state for d in chosen],
            "name": [named(d.components) for d in chosen],
        }
    )
    bars = made.hbar(
        y="row", left=left, right="end", height=0.62, source=source, fill_color=colour, line_color=None
    )
    fields = [
        ("direction", "name"), ("singular value", "value"), ("standard deviation along it", "deviation"),
        ("state", "state"),
    ]  # fmt: skip
    style.hover(made, bars, fields)
    if chosen[0].state == "determined":
        return [bars]
    return [bars, style.words(made, source, "end", "row", "name")]


# ------------------------------------------------------------------------------------------ in words


def _combinations(tables: Tables) -> str:
    """What is known although its terms are not, one combination a row."""
    table = filled(tables, "combinations")
    rows: dict[int, dict[str, Any]] = {}
    for row in [] if table is None else table.to_pylist():
        rows.setdefault(row["combination"], row)
    if not rows:
        return ""
    body = "".join(
        f"<tr><td>{escape(symbol(row['expression']))}</td>"
        f"<td class=num>{measured(row['value'], row['standard_error'])}</td>"
        f"<td class=num>{measured(row['value'] * EARTH_RATE, row['standard_error'] * EARTH_RATE)}</td></tr>"
        for row in rows.values()
    )
    return html_table(("combination that the record determines", "value", "as a drift [deg/h]"), body, (1, 2))


def _further_runs(tables: Tables) -> str:
    """Which further run would determine what is missing, one proposal a row."""
    table = filled(tables, "further_runs")
    proposals: dict[int, list[dict[str, Any]]] = {}
    for row in [] if table is None else table.to_pylist():
        proposals.setdefault(row["rank"], []).append(row)
    if not proposals:
        return ""
    known = {(row["parameter"], row["run"]) for row in _primary_rows(tables) if row["state"] in SURE}
    missing = {
        rank: [row for row in rows if (row["parameter"], row["run"]) not in known]
        for rank, rows in proposals.items()
    }
    several = _several_runs(row for rows in proposals.values() for row in rows)
    body = "".join(_proposal(rows, several=several) for rows in missing.values() if rows)
    heads = (
        "further run",
        "α1 at its start [deg]",
        "α2 at its start [deg]",
        "length [h]",
        "would determine, now → then",
        "but not",
    )
    return html_table(heads, body, (1, 2, 3)) if body else ""


def _proposal(rows: Sequence[dict[str, Any]], *, several: bool) -> str:
    first = rows[0]
    places = [np.rad2deg(first["alpha1"]), np.rad2deg(first["alpha2"]), first["duration"] / 3600]
    numbers = "".join(f"<td class=num>{number(round(value, 2))}</td>" for value in places)
    gains = [_gain(row, several=several) for row in rows if row["determined"]]
    rest = [
        symbol(row["parameter"], row["run"] if several else None) for row in rows if not row["determined"]
    ]
    return (
        f"<tr><td>{escape(first['scheme'])}</td>{numbers}<td>{escape('; '.join(gains) or '–')}</td>"
        f"<td>{escape(', '.join(rest))}</td></tr>"
    )


def _gain(row: Mapping[str, Any], *, several: bool) -> str:
    """A parameter with its standard error now and then: ``mc2 ± 0.5 → ± 0.003 deg/h``."""
    drift = row["unit"] == "1"
    factor, unit = (EARTH_RATE, "deg/h") if drift else (1 / _ARCMIN, "arcmin")
    now, then = (
        "unknown" if error is None else f"± {standard_error(error * factor, error * factor)}"
        for error in (row["standard_error_now"], row["standard_error_then"])
    )
    return f"{symbol(row['parameter'], row['run'] if several else None)} {now} → {then} {unit}"
