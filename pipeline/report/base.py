"""What a procedure brings to its page, as numbered rules.

1. A procedure's figures are one module of this package with a function ``figures`` of the shape `Figures`,
   and one line in `FIGURES`.
2. ``figures`` gets the tables of one recording; those the run did not produce are missing, and what
   cannot be drawn without them is left out.
3. Times are drawn in seconds of a `Clock`, curves through `style.curve`, which thins them.
4. No text of a recording enters a figure but as data of a hover tool, which shows it as plain text, or
   through `style.plain`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pyarrow as pa
from bokeh.models import LayoutDOM
from numpy.typing import NDArray

Tables = Mapping[str, pa.Table]


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the page: a heading, a sentence that says what is seen, the picture, and what stands below.

    ``below`` is HTML, in which its maker has escaped every text of the tables. A section of words alone has
    no picture.
    """

    title: str
    text: str
    picture: LayoutDOM | None
    below: str = ""


Figures = Callable[[Tables], list[Section]]

FIGURES: Mapping[str, str] = MappingProxyType(
    {
        "coning": "pipeline.report.coning",
        "drift": "pipeline.report.drift",
        "rate_table": "pipeline.report.rate_table",
        "navigation": "pipeline.report.navigation",
        "static": "pipeline.report.static",
    }
)
"""The module with the figures of each procedure."""


@dataclass(frozen=True, slots=True)
class Clock:
    """The record's own time: seconds from ``origin``, up to ``duration``; ``origin`` in nanoseconds."""

    origin: int
    duration: float

    @classmethod
    def of(cls, *times: NDArray[np.int64]) -> Clock:
        """The clock that starts with the first of these times and ends with the last."""
        first = min(int(t.min()) for t in times)
        return cls(first, (max(int(t.max()) for t in times) - first) * 1e-9)

    def seconds(self, time: NDArray[np.int64]) -> NDArray[np.float64]:
        """Seconds from the record's start, of times in nanoseconds."""
        return np.asarray((time - self.origin) * 1e-9, dtype=np.float64)


def column(table: pa.Table, name: str) -> NDArray[np.float64]:
    """A column of numbers; null is NaN."""
    return np.asarray(table.column(name).to_numpy(), dtype=np.float64)


def times(table: pa.Table, name: str = "time") -> NDArray[np.int64]:
    """A column of times in nanoseconds, without nulls."""
    return np.asarray(table.column(name).drop_null().to_numpy(), dtype=np.int64)


_KEEP_TIME = (
    "attitude",
    "rates",
    "trajectory",
    "navigation",
    "gyro",
    "gyro_increments",
    "gimbal",
    "reference",
)


def record_clock(tables: Tables) -> Clock | None:
    """The clock of the first of `_KEEP_TIME` that has rows; None where nothing has a time.

    Tables on a grid come first because their times rise: one stray stamp of a stream would stretch an axis.
    """
    kept = next((tables[name] for name in _KEEP_TIME if name in tables and tables[name].num_rows), None)
    return None if kept is None else Clock.of(times(kept))
