"""The trends of a record as lines over its time, and the extremes that they go through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.report.base import Clock, Tables, column
from pipeline.report.series import Floats, Series


@dataclass(frozen=True, slots=True)
class TrendLine:
    """One row of ``trend`` in the record's own time [s, rad].

    It holds from ``start`` (the onset of the vibration, where there is one) to ``end``; ``offset`` and
    ``smooth_offset`` are the values at time 0; ``period`` is that of the vibration.
    """

    method: str
    segment_start: float
    start: float
    end: float
    onset: float | None
    period: float
    slope: float
    slope_error: float | None
    offset: float
    smooth_slope: float
    smooth_offset: float

    @property
    def by_extremes(self) -> bool:
        """Whether the trend goes through three extremes of the angle."""
        return self.method == "extremes"

    def smooth(self, time: Floats) -> Floats:
        """The smooth motion under the vibration [rad]."""
        return self.smooth_slope * time + self.smooth_offset

    def total(self, time: Floats) -> Floats:
        """Smooth motion and trend [rad]."""
        return self.smooth(time) + self.slope * time + self.offset

    def extremes(self, angle: Series, name: str) -> tuple[Floats, Floats]:
        """The samples of (4.1): the maximum of each half of what the trend holds for, and its minimum."""
        part = angle.within(self.start, self.end)
        vibration = part.values[name] - self.smooth(part.time)
        half = int(np.searchsorted(part.time, (self.start + self.end) / 2))
        places = [
            int(vibration[:half].argmax()),
            half + int(vibration[half:].argmax()),
            int(vibration.argmin()),
        ]
        return part.time[places], part.values[name][places]


def trend_lines(tables: Tables, attitude: Series, clock: Clock) -> dict[str, list[TrendLine]]:
    """The trends of each angle that has any, by segment."""
    lines: dict[str, list[TrendLine]] = {}
    if "trend" not in tables:
        return lines
    segment = column(tables["attitude"], "segment")
    for row in tables["trend"].to_pylist():
        mine = attitude.time[segment == row["segment"]]
        if len(mine) > 1:
            lines.setdefault(row["channel"], []).append(_line(row, float(mine[0]), float(mine[-1]), clock))
    return lines


def _line(row: dict[str, Any], first: float, last: float, clock: Clock) -> TrendLine:
    origin = (row["origin"] - clock.origin) * 1e-9
    onset = None if row["onset"] is None else (row["onset"] - clock.origin) * 1e-9
    smooth_slope, smooth_start = row["smooth_a"] or 0.0, row["smooth_b"] or 0.0
    return TrendLine(
        method=row["method"],
        segment_start=first,
        start=first if onset is None else onset,
        end=last,
        onset=onset,
        period=1 / row["frequency"] if row["frequency"] else 0.01 * (last - first),
        slope=row["a"],
        slope_error=row["a_standard_error"],
        offset=row["b"] - row["a"] * origin,
        smooth_slope=smooth_slope,
        smooth_offset=smooth_start - smooth_slope * first,
    )
