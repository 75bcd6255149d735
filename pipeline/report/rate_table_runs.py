"""The runs of a gyro on a rate table, and the observations of its calibration, as the pictures want them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import units
from pipeline.report.base import Clock, Tables, times

Floats = NDArray[np.float64]
Row = dict[str, Any]

CHANNELS = ("p", "q", "r")
DEG_S = float(np.degrees(1.0))
"""A rate in rad/s to deg/s, and an angle in rad to deg."""
DEG_H = DEG_S * 3600
"""A rate in rad/s to deg/h."""
PPM = 1e6
CELSIUS = units.zero("degC")
"""The zero of degrees Celsius [K]."""
ABREAST = 3
"""Panels."""
COLUMNS = 400
"""Of pixels in one of so many panels."""
BORDER = 78
"""Pixels left of a frame that is not as wide as the page."""

_TRIAD, _SINGLE = "triad", "single axis"


@dataclass(frozen=True, slots=True)
class Run:
    """One run: its number, None where the plan lists none; what it is called; its own clock."""

    number: int | None
    title: str
    clock: Clock


def runs(tables: Tables) -> list[Run]:
    """The runs that the gyro was recorded in, in their order."""
    gyro = tables.get("gyro")
    if gyro is None or not gyro.num_rows:
        return []
    known = _mounted(tables)
    numbers: list[int | None] = [*sorted(known)] or [None]
    found = []
    for number in numbers:
        time = times(of_run(gyro, number))
        if len(time):
            found.append(Run(number, "" if number is None else known[number], Clock.of(time)))
    return [run for run in found if run.clock.duration > 0.0]


def of_run(table: pa.Table, number: int | None) -> pa.Table:
    """The rows of a run; all of them where there are no runs."""
    if number is None:
        return table
    return table.filter(pa.array(table.column("run").to_numpy(zero_copy_only=False) == number))


def rows_of(tables: Tables, name: str) -> list[Row]:
    """The rows of a table; none where it is missing."""
    table = tables.get(name)
    return [] if table is None else table.to_pylist()


def run_names(tables: Tables) -> dict[int | None, str]:
    """What each run is called."""
    return {row["run"]: row["name"] for row in rows_of(tables, "mountings")}


def main_fit(rows: Sequence[Row]) -> list[Row]:
    """The residuals of the triad where there is one, else of the single axes, each with its ``kind``.

    An observation is a step, a turn, rest beside turns, or a position.
    """
    fits = {row["fit"] for row in rows}
    mine = [row for row in rows if row["fit"] == (_TRIAD if _TRIAD in fits else _SINGLE)]
    turned = {row["observation"] for row in mine if row["method"] == "turns" and row["rate"] != 0}
    words = {"rates": "step", "positions": "position"}
    return [
        row | {"kind": words.get(row["method"], "turn" if row["observation"] in turned else "rest")}
        for row in mine
    ]


def single_axis(rows: Sequence[Row], channel: str) -> list[Row]:
    """The residuals of one gyro by its own axis, which are of steps."""
    own = (_SINGLE, channel)
    return [row | {"kind": "step"} for row in rows if (row["fit"], row["channel"]) == own]


def parts_per_million(rows: Sequence[Row]) -> float:
    """Factor from an output of these rows, which have one full scale [rad/s], to ppm of it; 0: unknown."""
    largest = max(rows, key=lambda row: abs(row["residual"]), default=None)
    if largest is None or not largest["residual"]:
        return 0.0
    return float(largest["residual_ppm"] / largest["residual"])


def _mounted(tables: Tables) -> dict[int, str]:
    """The runs and how the case was mounted in them, in words."""
    return {row["run"]: _title(row) for row in rows_of(tables, "mountings")}


def _title(row: Row) -> str:
    axis = [row[f"axis_{i}"] for i in (1, 2, 3)]
    if axis[0] is None:
        return f"run {row['run']}: {row['name']}, off the table"
    along = int(np.argmax(np.abs(axis)))
    negative, channel = axis[along] < 0, CHANNELS[along]
    name = "" if row["name"] == f"{'-' * negative}{channel}" else f"{row['name']}, "
    return f"run {row['run']}: {name}{'−' * negative}{channel} along the table's axis"
