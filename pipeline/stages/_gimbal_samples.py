"""The runs of the table ``gimbal`` as arrays, with the bases on which they were made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.models.earth import RATE, Base
from pipeline.stages._streams import channels
from pipeline.stages.base import Severity, finding

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Bool = NDArray[np.bool_]
Findings = list[dict[str, Any]]

_LARGEST = 1e9
"""Angle [rad] beyond which float64 no longer tells a tenth of an arc second: no angle."""


@dataclass(frozen=True, slots=True)
class GimbalRun:
    """One run of a gyro.

    Attributes
    ----------
    number : int
        As in the tables.
    name : str
        What the test plan calls it.
    latitude : float
        Of the stand [rad].
    scheme : str or None
        The mounting scheme; None where the plan gives the angles chi.
    base : Base
        How the base is meant to stand.
    table : pyarrow.Table
        Its rows of ``gimbal``, as recorded.
    """

    number: int
    name: str
    latitude: float
    scheme: str | None
    base: Base
    table: pa.Table

    @property
    def samples(self) -> Samples:
        """All samples as recorded."""
        return Samples(self.table.column("time").to_numpy(), channels(self.table, "gimbal"))


@dataclass(frozen=True, slots=True)
class Samples:
    """Angles at instants: ``time`` int64 [ns], shape (n,), and ``alpha`` [rad], shape (n, 2)."""

    time: Time
    alpha: Float

    @property
    def tau(self) -> Float:
        """Time from the first sample on, in units of the Earth rate."""
        return np.asarray((self.time - self.time[0]) * (1e-9 * RATE), dtype=np.float64)

    @property
    def finite(self) -> Bool:
        """Which have two finite angles, shape (n,)."""
        # NaN compares as false.
        return np.asarray((np.abs(self.alpha) < _LARGEST).all(axis=1), dtype=np.bool_)

    def only(self, chosen: Bool | slice) -> Samples:
        """Some of them."""
        return Samples(self.time[chosen], self.alpha[chosen])


def gimbal_runs(gimbal: pa.Table, runs: pa.Table) -> Iterator[GimbalRun]:
    """Each run of ``runs``, in order, with its rows of ``gimbal``; none where nothing was recorded."""
    number = gimbal.column("run").to_numpy()
    for row in runs.to_pylist():
        base = Base.at(row["latitude"], (row["chi1"], row["chi2"], row["chi3"]))
        own = number == row["run"]
        table = gimbal if own.all() else gimbal.filter(pa.array(own))
        yield GimbalRun(row["run"], row["name"], row["latitude"], row["scheme"], base, table)


def said(
    of: GimbalRun,
    kind: str,
    severity: Severity,
    detail: str,
    time: Time | None = None,
    count: int | None = None,
) -> dict[str, Any]:
    """A finding of the stage `resample` about samples of a run, by default all."""
    stamps = of.table.column("time").to_numpy() if time is None else time
    return finding(
        "resample",
        "gimbal",
        kind,
        severity,
        f"run {of.name!r}: {detail}",
        start=int(stamps.min()) if len(stamps) else None,
        end=int(stamps.max()) if len(stamps) else None,
        count=len(stamps) if count is None else count,
    )
