"""The stream tables as arrays, as the stages that compare a gyro with its reference need them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.numerics.alignment import Cumulative, Increments, integrals_of_rate
from pipeline.numerics.rotation import quaternion_from_euler_krylov
from pipeline.numerics.sampling import Intervals, intervals
from pipeline.numerics.time_grid import advancing
from pipeline.stages._navigation_streams import CHANNELS as NAVIGATION
from pipeline.stages.base import ANGLES, Tables

CHANNELS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "gyro": ("p", "q", "r"),
        "gyro_increments": ("increment_p", "increment_q", "increment_r"),
        "reference": ANGLES,
        "turntable": ("angle", "rate"),
        "temperature": ("temperature",),
        "gimbal": ("alpha1", "alpha2"),
        **NAVIGATION,
    }
)
"""The channels of each stream table."""

LONGEST = 3.0
"""An interval of more than this many nominal ones is a gap between gyro and reference."""

LARGEST = 1e100
"""Beyond this the squares and sums of values leave float64."""

MARGIN = 8
"""Samples to keep from a gap: the ripple of a quintic spline falls to 0.43 from one sample to the next."""


def recorded(table: pa.Table, stream: str) -> tuple[str, ...]:
    """The channels of a stream that were recorded: the columns of the others are null."""
    return tuple(name for name in CHANNELS[stream] if table.column(name).null_count == 0)


def channels(table: pa.Table, stream: str) -> NDArray[np.float64]:
    """The channels of a stream, shape (n, k); those that were not recorded are NaN."""
    return np.stack([table.column(name).to_numpy() for name in CHANNELS[stream]], axis=1)


def usable(table: pa.Table, stream: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times [ns] and channels of the samples that are finite in every channel and advance in time."""
    time, values = table.column("time").to_numpy(), channels(table, stream)
    finite = np.isfinite(values).all(axis=1)
    time, values = time[finite], values[finite]
    kept = advancing(time).kept
    return time[kept], values[kept]


@dataclass(frozen=True, slots=True)
class Pair:
    """A gyro and its reference, made comparable; times in seconds from the gyro's first usable sample.

    The reference is thinned to the gyro's interval where it is faster: a shorter interval tells no more.
    """

    stream: str
    origin: int
    """Time of the gyro's first usable sample [ns]."""
    gyro: Cumulative
    gyro_intervals: Intervals
    reference: Increments
    reference_intervals: Intervals

    @property
    def longest(self) -> float:
        """The longest interval of either that is no gap [s]."""
        return LONGEST * max(self.gyro_intervals.nominal, float(np.median(self.reference.length)))

    @property
    def margin(self) -> float:
        """How far to keep from gaps and ends of the gyro [s]."""
        return MARGIN * self.gyro_intervals.nominal


def pair(tables: Tables, least: int) -> Pair | None:
    """Gyro (or angle increments) and reference, made comparable.

    None where either has fewer usable samples than asked, or a value too large to be squared.
    """
    stream = next((name for name in ("gyro", "gyro_increments") if name in tables), None)
    if stream is None or "reference" not in tables:
        return None
    time, values = usable(tables[stream], stream)
    reference_time, angles = usable(tables["reference"], "reference")
    least = max(least, 6)
    if min(len(time), len(reference_time)) < least:
        return None
    if max(np.abs(values).max(), np.abs(angles).max()) > LARGEST:
        return None
    own, other = intervals(time), intervals(reference_time)
    every = max(round(own.nominal / other.nominal), 1)
    if len(reference_time) // every < least:
        return None
    seconds = (time - time[0]) * 1e-9
    of = Cumulative.of_rates if stream == "gyro" else Cumulative.of_increments
    reference = integrals_of_rate(
        (reference_time[::every] - time[0]) * 1e-9, quaternion_from_euler_krylov(angles[::every])
    )
    return Pair(stream, int(time[0]), of(seconds, values), own, reference, other)
