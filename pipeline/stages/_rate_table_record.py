"""The record of a gyro on a rate table, run by run, as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.numerics.time_grid import advancing
from pipeline.stages._runs import WHOLE
from pipeline.stages._streams import recorded
from pipeline.stages.base import StageError, Tables
from pipeline.stages.quantities import QUANTITIES

Float = NDArray[np.float64]
Time = NDArray[np.int64]

AXES = tuple(QUANTITIES["angular_rate"])


@dataclass(frozen=True, slots=True)
class Series:
    """Samples that are finite and advance: ``time`` int64 [ns], shape (n,); ``values``, shape (n, c)."""

    time: Time
    values: Float


@dataclass(frozen=True, slots=True)
class TableRun:
    """One run of a gyro on a rate table, or beside it.

    Attributes
    ----------
    number : int or None
        As in the tables; None where the plan lists no runs.
    name : str
    axis : ndarray, shape (3,), or None
        Unit vector of the table's axis in the axes of the case; None off the table.
    across : ndarray, shape (3,), or None
        Of the table's axis 1 at angle 0, in the axes of the case; None where it is not said.
    channels : tuple of str
        Of the gyro, those that were recorded.
    gyro : Series
        [rad/s].
    table : Series or None
        Angle [rad] or rate [rad/s], shape (n, 1).
    by_angle : bool
        Whether the table's angle was recorded.
    temperature : Series or None
        [K], shape (n, 1).
    """

    number: int | None
    name: str
    axis: Float | None
    across: Float | None
    channels: tuple[str, ...]
    gyro: Series
    table: Series | None
    by_angle: bool
    temperature: Series | None

    @property
    def origin(self) -> int:
        """Time of the gyro's first usable sample [ns]."""
        return int(self.gyro.time[0])

    @property
    def where(self) -> str:
        """The run in the words of an error."""
        return "" if self.number is None else f"run {self.name!r}, "

    @property
    def about(self) -> str:
        """The run at the beginning of a finding."""
        return "" if self.number is None else f"run {self.name!r}: "

    def seconds(self, time: Time) -> Float:
        """Seconds from the origin."""
        return np.asarray((time - self.origin) * 1e-9, dtype=np.float64)

    def stamps(self, seconds: Float) -> Time:
        """The reverse [ns]."""
        return self.origin + np.rint(seconds * 1e9).astype(np.int64)

    def temperature_at(self, seconds: Float) -> Float | None:
        """Temperature at instants [K], that of the nearest end beyond the record; None without one."""
        if self.temperature is None:
            return None
        of = self.temperature
        return np.interp(seconds, self.seconds(of.time), of.values[:, 0])


def table_runs(tables: Tables) -> Iterator[TableRun]:
    """The runs of ``mountings``, or the whole recording.

    Raises
    ------
    StageError
        If the gyro has no usable sample (exit code 3), or it is not said which axis of a gyro of several
        channels lies along the table's (exit code 2).
    """
    gyro = tables["gyro"]
    channels = recorded(gyro, "gyro")
    if "mountings" not in tables:
        yield _run(None, WHOLE, _own_axis(channels), None, channels, tables)
        return
    for row in tables["mountings"].to_pylist():
        axis, across = (_vector(row, key) for key in ("axis", "across"))
        yield _run(row["run"], row["name"], axis, across, channels, tables)


def _run(
    number: int | None,
    name: str,
    axis: Float | None,
    across: Float | None,
    channels: tuple[str, ...],
    tables: Tables,
) -> TableRun:
    def of(stream: str, columns: tuple[str, ...]) -> Series | None:
        return _series(_part(tables[stream], number), columns) if stream in tables and columns else None

    kinds = recorded(tables["turntable"], "turntable") if "turntable" in tables else ()
    gyro = of("gyro", channels)
    if gyro is None:
        raise StageError(
            "gyro" if number is None else f"gyro, run {name!r}",
            expected="samples with finite values that advance in time",
            found="fewer than two",
            remedy="check the recording, and the gyro's channels and clock in the test plan",
            exit_code=ExitCode.INPUT,
        )
    return TableRun(
        number=number,
        name=name,
        axis=axis,
        across=across,
        channels=channels,
        gyro=gyro,
        table=of("turntable", kinds),
        by_angle="angle" in kinds,
        temperature=of("temperature", ("temperature",)),
    )


def _part(table: pa.Table, number: int | None) -> pa.Table:
    if number is None:
        return table
    own = table.column("run").to_numpy() == number
    return table if own.all() else table.filter(pa.array(own))


def _series(table: pa.Table, columns: tuple[str, ...]) -> Series | None:
    """The usable samples; None where there are fewer than two."""
    time = table.column("time").to_numpy()
    values = np.stack([table.column(name).to_numpy() for name in columns], axis=1)
    finite = np.isfinite(values).all(axis=1)
    time, values = time[finite], values[finite]
    kept = advancing(time).kept
    return Series(time[kept], values[kept]) if np.count_nonzero(kept) > 1 else None


def _own_axis(channels: tuple[str, ...]) -> Float | None:
    """The axis of the one channel."""
    if len(channels) == 1:
        return np.array([float(axis == channels[0]) for axis in AXES])
    return None


def _vector(row: dict[str, Any], key: str) -> Float | None:
    components = [row[f"{key}_{i}"] for i in (1, 2, 3)]
    return None if components[0] is None else np.array(components)
