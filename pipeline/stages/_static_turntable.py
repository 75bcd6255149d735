"""The angle of the table on which a gyro turns, at the samples of the gyro."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.time_grid import advancing
from pipeline.stages._noise_record import Record
from pipeline.stages._streams import recorded
from pipeline.stages.base import Tables

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ONE_TURN = 2 * np.pi
"""A table that turns by less rests, or is being set."""


def turned(tables: Tables, record: Record) -> tuple[Float, Mask] | None:
    """Angle of the table at each point of a record [rad], and where it is known; both of shape (n,).

    Between its samples the angle is taken for straight; from a rate it is the trapezoids' sum. None where
    there is no table, or it turns by less than once.
    """
    if "turntable" not in tables:
        return None
    table = tables["turntable"]
    columns = recorded(table, "turntable")
    if not columns:
        return None
    time, values = table.column("time").to_numpy(), table.column(columns[0]).to_numpy()
    finite = np.isfinite(values)
    time, values = time[finite], values[finite]
    kept = advancing(time).kept
    time, values = time[kept], values[kept]
    if len(time) < 2:
        return None
    t = (time - record.origin) * 1e-9
    if columns[0] == "rate":
        values = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])
    if abs(values[-1] - values[0]) < _ONE_TURN:
        return None
    at = record.step * np.arange(len(record.channels[0].rate))
    return np.interp(at, t, values), (at >= t[0] - record.step) & (at <= t[-1] + record.step)
