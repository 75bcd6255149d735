"""Samples of a smooth signal on an even grid: as they are, interpolated, or averaged.

Each function takes ascending times (``int64`` ns) and gives points whose times are even to the rounding of
a nanosecond. A grid point without a sample is bridged by the cubic through the nearest four
(`local_polynomial`), and is marked as not measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.local_polynomial import LocalPolynomial
from pipeline.numerics.time_grid import uniform_grid

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Bool = NDArray[np.bool_]

FEWEST = 5
"""Samples, or averages, below which nothing is put on a grid."""

_WHOLE = 1.8
"""An interval between samples of more than this many nominal ones lacks one."""

_HALF = 0.5
"""Part of the usual number of samples below which an average is not taken for one: its noise is another."""


@dataclass(frozen=True, slots=True)
class EvenSamples:
    """Points on an even grid.

    Attributes
    ----------
    time : ndarray of int64, shape (m,)
        [ns]
    values : ndarray, shape (m, channels)
    measured : ndarray of bool, shape (m,)
        False where a point was bridged.
    """

    time: Time
    values: Float
    measured: Bool


def as_they_are(time: Time, values: Float, interval: float, tolerance: float) -> EvenSamples | None:
    """The samples themselves, where none is farther than a tolerance from an even grid.

    The grid goes from the first sample to the last. Samples are not moved: what the tolerance allows is an
    error of the values' rate times it.

    Parameters
    ----------
    time : ndarray of int64, shape (n,)
        [ns]
    values : ndarray, shape (n, channels)
    interval : float
        Nominal interval [ns]; a missing sample leaves a multiple of it.
    tolerance : float
        [ns]

    Returns
    -------
    EvenSamples or None
        None where the samples are not even.
    """
    # Counted interval by interval: the nominal one is not known well enough to divide a whole record by.
    counted = np.maximum(np.rint(np.diff(time) / interval), 1).astype(np.int64)
    index = np.concatenate([[0], np.cumsum(counted)])
    grid = uniform_grid(int(time[0]), int(time[-1]), int(index[-1]))
    if np.abs(time - grid[index]).max() > tolerance:
        return None
    measured = np.zeros(len(grid), dtype=np.bool_)
    measured[index] = True
    placed = np.empty((len(grid), values.shape[1]))
    placed[index] = values
    return EvenSamples(grid, _bridged(grid, placed, measured), measured)


def interpolated(time: Time, values: Float, interval: float, nominal: float) -> EvenSamples:
    """The cubic through the nearest four samples, at points an interval apart from the first sample on.

    Parameters
    ----------
    time : ndarray of int64, shape (n,)
        [ns]
    values : ndarray, shape (n, channels)
    interval : float
        Of the grid [ns].
    nominal : float
        Of the samples [ns]: a point between samples farther apart than 1.8 of it is bridged.
    """
    steps = max(1, int((time[-1] - time[0]) / interval + 1e-6))
    grid = uniform_grid(
        int(time[0]), int(time[0]) + min(round(steps * interval), int(time[-1] - time[0])), steps
    )
    after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    measured = (
        (time[after] - time[after - 1] <= _WHOLE * nominal)
        | (grid == time[after])
        | (grid == time[after - 1])
    )
    return EvenSamples(grid, _cubic(time, values, grid), measured)


def averaged(time: Time, values: Float, interval: int, nominal: float) -> EvenSamples | None:
    """Means over windows as long as the interval, brought to the windows' middles.

    The mean over a window H of a signal with slope s and curvature k is ``x + s mean(t) + k mean(t^2)/2``,
    t from the window's middle; of even samples that is k H^2/24 too much. Both are taken off, with s and k
    by the parabola through five means around. What is left is of order H^4. The noise of the points is that
    of means of different samples, white: the five means add 0.6 % to its standard deviation and correlate
    neighbours by less than 1 %, where a parabola through the samples of each window alone would add 50 %.

    Parameters
    ----------
    time : ndarray of int64, shape (n,)
        [ns]
    values : ndarray, shape (n, channels)
    interval : int
        H [ns]. A window that is not filled at the end is left out.
    nominal : float
        Of the samples [ns].

    Returns
    -------
    EvenSamples or None
        None where fewer than five windows have their samples.
    """
    start = int(time[0]) - round(nominal / 2)
    window = (time - start) // interval
    count = int((time[-1] + round(nominal / 2) - start + interval // 1000) // interval)
    usual = interval / nominal
    inside = window < count
    held = np.bincount(window[inside], minlength=count)
    measured = held >= _HALF * usual
    if np.count_nonzero(measured) < FEWEST:
        return None
    middle = start + interval // 2 + interval * np.arange(count, dtype=np.int64)
    offset = (time[inside] - middle[window[inside]]) / interval
    many = np.maximum(held, 1)

    def mean(of: Float) -> Float:
        return np.asarray(np.bincount(window[inside], of, count) / many, dtype=np.float64)

    first = np.where(measured, mean(offset), 0.0)
    second = np.where(measured, mean(offset**2), 1 / 12)
    columns = []
    for channel in values.T:
        at = channel[0]  # means of what is left keep their digits
        means = _bridged(middle, mean(channel[inside] - at)[:, np.newaxis], measured)[:, 0]
        slope, curvature = _parabola(means)
        columns.append(at + means - slope * first - 0.5 * curvature * second)
    points = np.stack(columns, axis=1)
    points[~measured] = _bridged(middle, points, measured)[~measured]
    return EvenSamples(middle, points, measured)


def _parabola(y: Float) -> tuple[Float, Float]:
    """Slope and curvature, for steps of 1, of the parabola through the nearest five."""
    five = np.lib.stride_tricks.sliding_window_view(y, 5)
    curvature = five @ np.array([2.0, -1.0, -2.0, -1.0, 2.0]) / 7
    slope = five @ np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) / 10
    place = np.arange(len(y))
    centre = np.clip(place, 2, len(y) - 3)
    return slope[centre - 2] + curvature[centre - 2] * (place - centre), curvature[centre - 2]


def _bridged(grid: Time, placed: Float, measured: Bool) -> Float:
    """Values with those that are not measured taken from the cubic through the nearest four that are."""
    if measured.all():
        return placed
    filled = placed.copy()
    filled[~measured] = _cubic(grid[measured], placed[measured], grid[~measured])
    return filled


def _cubic(time: Time, values: Float, at: Time) -> Float:
    sampled, _ = LocalPolynomial((time - time[0]) * 1e-9, values, 3).sample((at - time[0]) * 1e-9)
    return np.asarray(sampled, dtype=np.float64)
