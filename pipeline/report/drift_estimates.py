"""The drift parameters as they become known while the record grows: value and standard error over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models import ColumnDataSource, Range1d
from bokeh.models.annotations import Span
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline.report import style
from pipeline.report.base import Section, Tables, column, times
from pipeline.report.drift_runs import DRIFT, EARTH_RATE, METHODS, Floats, Run, filled, primary, runs
from pipeline.report.style import BLACK, BLUE, GREEN, VERMILION, Drawn

_COLOURS = (BLUE, VERMILION, GREEN)
_COLUMNS = 2
_INSTANTS = 400  # of a curve that takes half the page
_SETTLED = 0.4  # of the record, after which the estimates set the scale: before, they are the prior's


class History(NamedTuple):
    """One parameter by one method: hours, value and standard error [deg/h], each (n,)."""

    hours: Floats
    value: Floats
    error: Floats


def estimates(tables: Tables) -> Section | None:
    """One panel a drift parameter: band of one standard error by each method, and the final value."""
    table, found, final = filled(tables, "drift_estimates"), runs(tables), _final(tables)
    if table is None or not found:
        return None
    end = sum(run.duration for run in found)
    x_range = style.span(0.0, end)
    methods = [m for m in METHODS if m in set(table["method"].unique().to_pylist())][: len(_COLOURS)]
    panels, lines = [], []
    names = [name for name in DRIFT if pc.any(pc.equal(table["parameter"], name)).as_py()]
    for place, name in enumerate(names):
        histories = {method: _history(table, method, name, found) for method in methods}
        lowest = place >= len(names) - _COLUMNS
        made, drawn = _panel(name, histories, final.get(name), x_range, labelled=lowest)
        _between_runs(made, found)
        panels.append(made)
        lines.append(drawn)
    if not panels:
        return None
    words = dict.fromkeys(word for drawn in lines for word in drawn)
    style.legend(
        panels[0], [(word, [line for drawn in lines for line in drawn.get(word, [])]) for word in words]
    )
    if len(panels) > 1:
        style.make_room(panels[1], 30)
    several = "" if len(found) == 1 else " The runs stand one after the other, parted by a vertical line."
    return Section(
        "Estimates in time",
        "Value and band of one standard error of each drift parameter as the record grows (filter) or from "
        f"the whole of it (smoother). Early estimates, worth little, leave the panel.{several}",
        style.grid([panels[i : i + _COLUMNS] for i in range(0, len(panels), _COLUMNS)]),
    )


def _final(tables: Tables) -> Mapping[str, tuple[str, float]]:
    """The method and value [deg/h] of each parameter by the primary method."""
    table, method = filled(tables, "drift_parameters"), primary(tables)
    rows = [] if table is None else table.to_pylist()
    return {
        row["parameter"]: (METHODS[method], row["drift"])
        for row in rows
        if row["method"] == method and method is not None and row["drift"] is not None
    }


def _history(table: pa.Table, method: str, name: str, found: Sequence[Run]) -> History | None:
    mine = table.filter(pc.and_(pc.equal(table["method"], method), pc.equal(table["parameter"], name)))
    if not mine.num_rows:
        return None
    hours = elapsed(times(mine), found)
    kept = np.unique(np.linspace(0, len(hours) - 1, min(len(hours), _INSTANTS)).round().astype(np.int64))
    value, error = (column(mine, c)[kept] * EARTH_RATE for c in ("value", "standard_error"))
    return History(hours[kept], value, error)


def elapsed(time: NDArray[np.int64], found: Sequence[Run]) -> Floats:
    """Hours of recording behind each of these times, which go through the runs one after the other.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Rising within a run [ns]. Runs of their own recordings may overlap in time: a step back is a new run.
    found : sequence of Run
        In the order of the times.
    """
    hours = np.empty(len(time))
    place, before, last = 0, 0.0, time[0]
    ends = [run.clock.origin + round(run.clock.duration * 1e9) for run in found]
    for i, now in enumerate(time.tolist()):
        while place < len(found) - 1 and (now < last or now > ends[place]):
            before += found[place].duration
            place, last = place + 1, now
        hours[i] = before + (now - found[place].clock.origin) * (1e-9 / 3600)
        last = now
    return hours


def _panel(
    name: str,
    histories: Mapping[str, History | None],
    final: tuple[str, float] | None,
    x_range: Range1d,
    *,
    labelled: bool,
) -> tuple[figure, dict[str, list[Drawn]]]:
    made = style.panel(
        f"{name} [deg/h]", x_range, x_label="hours of recording [h]" if labelled else None, ticks=6
    )
    there = {method: h for method, h in histories.items() if h is not None}
    centre, reach = _scale(list(there.values()), None if final is None else final[1])
    made.y_range = style.span(centre - reach, centre + reach)
    drawn: dict[str, list[Drawn]] = {}
    for colour, (method, history) in zip(_COLOURS, there.items(), strict=False):
        drawn[METHODS[method]] = _band(made, history, colour, reach)
    if final is not None:
        ends = np.array([x_range.start, x_range.end])
        line = style.curve(made, ends, np.full(2, final[1]), BLACK, width=1.2, dash="5 4")
        drawn[f"final value by {final[0]}"] = [line]
    return made, drawn


def _scale(histories: Sequence[History], final: float | None) -> tuple[float, float]:
    """Middle and half height of a panel: the final value, and as far as the estimates go once settled."""
    centre = float(histories[0].value[-1]) if final is None else final
    end = max(h.hours[-1] for h in histories)
    reach = max(
        float((np.abs(h.value - centre) + h.error)[h.hours >= _SETTLED * end].max(initial=0.0))
        for h in histories
    )
    return centre, 1.15 * reach or 1.0


def _band(made: figure, history: History, colour: str, reach: float) -> list[Drawn]:
    """Value and band; no value where the band is wider than the panel, which it would only cross."""
    source = ColumnDataSource(
        {
            "hours": history.hours,
            "value": np.where(history.error <= reach, history.value, np.nan),
            "low": history.value - history.error,
            "high": history.value + history.error,
        }
    )
    band = made.varea("hours", "low", "high", source=source, fill_color=colour, fill_alpha=0.16)
    return [made.line("hours", "value", source=source, line_color=colour, line_width=1.4), band]


def _between_runs(made: figure, found: Sequence[Run]) -> None:
    for border in np.cumsum([run.duration for run in found])[:-1].tolist():
        made.add_layout(Span(location=border, dimension="height", line_color=BLACK, line_dash="2 3"))
