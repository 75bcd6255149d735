"""The record of a gyro at rest on an even grid, its gaps kept as gaps, and what cannot be one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models.random_error_fit import FEWEST_SAMPLES
from pipeline.numerics.sampling import Intervals, intervals
from pipeline.numerics.time_grid import advancing
from pipeline.stages._streams import CHANNELS, LARGEST, recorded
from pipeline.stages.base import StageError, Tables

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

_SILENT = 0.99
"""Part of the samples that may be one value: of a coarser channel the record holds hardly anything."""

_SPARSE = 0.25
"""Part of a record's time that must have samples: else it is several records far apart."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of the record.

    Attributes
    ----------
    name : str
        p, q or r.
    rate : ndarray, shape (n,)
        [rad/s]; 0 where not present.
    present : ndarray of bool, shape (n,)
        Where there is a sample.
    """

    name: str
    rate: Float
    present: Mask


@dataclass(frozen=True, slots=True)
class Record:
    """The channels that were recorded, on a grid of n points a step apart.

    Attributes
    ----------
    stream : str
        gyro or gyro_increments.
    origin : int
        Time of the first point [ns].
    step : float
        [s]
    regular : Intervals
        Of the stamps.
    channels : tuple of Channel
    """

    stream: str
    origin: int
    step: float
    regular: Intervals
    channels: tuple[Channel, ...]

    def at(self, index: int) -> int:
        """Time of a grid point [ns]."""
        return self.origin + round(index * self.step * 1e9)


def record_of(tables: Tables, max_gap: float) -> Record:
    """The record as it was made: no sample is moved in order, filled in or averaged.

    Parameters
    ----------
    tables : mapping
        With ``gyro`` or ``gyro_increments``. A mean rate over the step is the increment over it; the one
        after a gap is left out, since nobody knows whether it holds what was turned within.
    max_gap : float
        Longest interval between samples that is one step, in nominal ones; a longer one is a gap.

    Raises
    ------
    StageError
        If there is no record of noise in it.
    """
    stream = next((name for name in ("gyro", "gyro_increments") if name in tables), None)
    if stream is None:
        raise StageError(
            "stage noise",
            expected="a stream of angular rates or angle increments",
            found="neither",
            remedy="map a gyro in the test plan",
            exit_code=ExitCode.USAGE,
        )
    table = tables[stream]
    time = table.column("time").to_numpy()
    kept = np.flatnonzero(advancing(time).kept)
    if len(kept) < FEWEST_SAMPLES:
        raise _too_few(stream, len(kept), "whose time advances")
    regular = intervals(time)
    if regular.batched:
        raise StageError(
            f"stage noise, stream {stream}",
            expected="samples that are stamped one by one",
            found="most of them stamped at once, in batches",
            remedy="choose another clock in the test plan",
            exit_code=ExitCode.USAGE,
        )
    index = _places(time[kept], regular.nominal, max_gap)
    points = int(index[-1]) + 1
    if len(kept) < _SPARSE * points:
        raise StageError(
            f"stage noise, stream {stream}",
            expected=f"one record, with samples for at least {_SPARSE:.0%} of its time",
            found=f"{len(kept)} samples every {regular.nominal:.4g} s in {points * regular.nominal:.4g} s",
            remedy="process its parts one by one, or check the clock in the test plan",
        )
    step = (int(time[kept[-1]]) - int(time[kept[0]])) * 1e-9 / (points - 1)
    first = np.append(False, np.diff(index) > 1)
    made = []
    for name, column in zip("pqr", CHANNELS[stream], strict=True):
        if column not in recorded(table, stream):
            continue
        values = table.column(column).to_numpy()[kept]
        usable = np.isfinite(values)
        if stream == "gyro_increments":
            values, usable = values / step, usable & ~first
        _refuse_unless_noise(f"{stream}, channel {name}", values[usable])
        rate, present = np.zeros(points), np.zeros(points, dtype=np.bool_)
        rate[index[usable]], present[index] = values[usable], usable
        made.append(Channel(name, rate, present))
    return Record(stream, int(time[kept[0]]), step, regular, tuple(made))


def with_part(record: Record, kept: Mask) -> Record:
    """The record without the points that are not kept, shape (n,).

    Raises
    ------
    StageError
        If hardly anything is left.
    """
    channels = []
    for channel in record.channels:
        present = channel.present & kept
        _refuse_unless_noise(f"{record.stream}, channel {channel.name}", channel.rate[present])
        channels.append(Channel(channel.name, np.where(present, channel.rate, 0.0), present))
    return Record(record.stream, record.origin, record.step, record.regular, tuple(channels))


def _places(time: Int, nominal: float, max_gap: float) -> Int:
    """Grid point of each sample: counted interval by interval, as the nominal one is not known better."""
    steps = np.diff(time) * (1e-9 / nominal)
    counted = np.where(steps > max_gap, np.maximum(np.rint(steps), 2), 1).astype(np.int64)
    return np.concatenate([[0], np.cumsum(counted)]).astype(np.int64)


def _refuse_unless_noise(where: str, values: Float) -> None:
    """A channel whose samples are too few, too large or all but one value has no noise to identify."""
    if len(values) < FEWEST_SAMPLES:
        raise _too_few(where, len(values), "that are finite")
    if np.abs(values).max() > LARGEST:
        raise StageError(
            f"stage noise, {where}",
            expected=f"rates below {LARGEST:g}",
            found=f"{np.abs(values).max():g}",
            remedy="check the channel's unit and the recording",
            exit_code=ExitCode.INPUT,
        )
    same = usual_share(values)
    if same > _SILENT:
        raise StageError(
            f"stage noise, {where}",
            expected="a signal that shows the sensor's noise",
            found="a constant" if same == 1.0 else f"one and the same value in {same:.2%} of the samples",
            remedy="record with a finer resolution, or leave the channel out of the test plan",
            exit_code=ExitCode.INPUT,
        )


def usual_share(values: Float) -> float:
    """Share of the samples that have the median's value: of a channel of which it is most, of the usual."""
    median = np.partition(values, len(values) // 2)[len(values) // 2]
    return float(np.count_nonzero(values == median) / len(values))


def _too_few(where: str, count: int, which: str) -> StageError:
    return StageError(
        f"stage noise, {where}",
        expected=f"at least {FEWEST_SAMPLES} samples {which}",
        found=str(count),
        remedy="record longer, or check the recording, and the clock and the channels in the test plan",
        exit_code=ExitCode.INPUT,
    )
