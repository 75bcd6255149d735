"""Curves of one recording on one time, and what a picture asks of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.report.base import Clock, Tables, column, times

Floats = NDArray[np.float64]

_GAP = 3.0  # sample intervals; a longer pause interrupts a curve
_EVEN = 1.5  # sample intervals; a longer step ends a stretch that is fit for a spectrum
_LARGEST_SPECTRUM = 2**20
_SMALLEST_SPECTRUM = 16


@dataclass(frozen=True, slots=True)
class Series:
    """Curves over one time [s], rising; ``interval`` [s] is the median step between samples."""

    time: Floats
    values: Mapping[str, Floats]
    interval: float

    @property
    def gap(self) -> float:
        """The pause [s] that interrupts the curves."""
        return _GAP * self.interval

    def part(self, which: slice) -> Series:
        """Some of the samples."""
        return Series(self.time[which], {name: v[which] for name, v in self.values.items()}, self.interval)

    def within(self, start: float, end: float) -> Series:
        """The samples from ``start`` to ``end`` [s], both included."""
        first = int(np.searchsorted(self.time, start))
        return self.part(slice(first, int(np.searchsorted(self.time, end, side="right"))))


def read(tables: Tables, name: str, clock: Clock, channels: Sequence[str]) -> Series | None:
    """Curves of a table in the order of their times, inside the record's span; None where there are none.

    A value that is not finite is NaN.
    """
    table: pa.Table | None = tables.get(name)
    if table is None or not table.num_rows:
        return None
    time = clock.seconds(times(table))
    order = np.argsort(time, kind="stable")
    inside = order[(time[order] >= 0.0) & (time[order] <= clock.duration)]
    steps = np.diff(time[inside])
    if not np.any(steps > 0):
        return None
    columns = {channel: column(table, channel)[inside] for channel in channels}
    values = {channel: np.where(np.isfinite(v), v, np.nan) for channel, v in columns.items()}
    return Series(time[inside], values, float(np.median(steps[steps > 0])))


def at(series: Series, time: Floats, name: str) -> Floats:
    """A curve at other times [s], linear between samples; NaN inside its gaps and outside its span."""
    after = np.clip(np.searchsorted(series.time, time), 1, len(series.time) - 1)
    before = after - 1
    on_sample = (time == series.time[after]) | (time == series.time[before])
    covered = (time >= series.time[0]) & (time <= series.time[-1])
    covered &= on_sample | (series.time[after] - series.time[before] <= series.gap)
    return np.where(covered, np.interp(time, series.time, series.values[name]), np.nan)


def difference(attitude: Series, reference: Series) -> Series:
    """Attitude less reference at the reference's times [rad], in (-pi, pi]."""
    wrapped = {
        name: np.pi - np.mod(np.pi - (at(attitude, reference.time, name) - value), 2 * np.pi)
        for name, value in reference.values.items()
    }
    return Series(reference.time, wrapped, reference.interval)


def on_branch(reference: Series, attitude: Series) -> Series:
    """The reference with each angle on the turn that lies nearest the attitude, where there is one."""
    error = difference(attitude, reference)
    nearest = {
        name: np.where(
            np.isfinite(error.values[name]), at(attitude, reference.time, name) - error.values[name], value
        )
        for name, value in reference.values.items()
    }
    return Series(reference.time, nearest, reference.interval)


def longest_stretch(series: Series) -> Series | None:
    """The longest stretch of finite samples at even steps, as far as a spectrum needs it."""
    finite = np.all([np.isfinite(v) for v in series.values.values()], axis=0)
    steps = np.diff(series.time)
    joined = (steps > 0) & (steps < _EVEN * series.interval) & finite[1:] & finite[:-1]
    ends = np.flatnonzero(~np.append(joined, False)) + 1
    firsts = np.append(0, ends[:-1])
    longest = int(np.argmax(ends - firsts))
    count = min(int(ends[longest] - firsts[longest]), _LARGEST_SPECTRUM)
    if count < _SMALLEST_SPECTRUM:
        return None
    return series.part(slice(int(firsts[longest]), int(firsts[longest]) + count))


def spectrum(stretch: Series) -> tuple[Floats, dict[str, Floats]]:
    """Amplitude spectrum of samples at even steps: Hann window, mean removed.

    ::

        amplitude = 2 |X| / sum(w)

    so that a sinusoid of amplitude A whose frequency is a line of the spectrum reads A.

    Returns
    -------
    frequency : (n // 2,) array [Hz]
        Without zero.
    amplitude : dict of (n // 2,) arrays
        In the unit of the curves.
    """
    n = len(stretch.time)
    window = np.hanning(n + 1)[:-1]
    step = float(stretch.time[-1] - stretch.time[0]) / (n - 1)
    frequency = np.asarray(np.fft.rfftfreq(n, step), dtype=np.float64)
    amplitude = {
        name: 2 * np.abs(np.fft.rfft((value - value.mean()) * window))[1:] / window.sum()
        for name, value in stretch.values.items()
    }
    return frequency[1:], amplitude
