"""Curves as a screen can show them: the extremes of each column of pixels.

A column of pixels of a line drawing covers what lies between the smallest and the largest sample in it,
so these two, in the order in which they occur, draw the same picture as all of them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.int64]


def min_max(time: Floats, value: Floats, columns: int, gap: float = np.inf) -> tuple[Floats, Floats]:
    """Thin a curve to the extremes of each column of pixels, broken where samples are missing.

    Parameters
    ----------
    time : (n,) array
        Rising; it may repeat.
    value : (n,) array
        A sample that is not finite interrupts the curve.
    columns : int
        Columns of pixels over the whole of ``time``.
    gap : float, optional
        The curve is also interrupted where two samples lie further apart than this, in the unit of time.

    Returns
    -------
    time, value : (m,) arrays
        Samples of the curve, and NaN where it is interrupted; m is at most ``4 columns``. A curve of no
        more than ``2 columns`` samples keeps them all. An interruption inside a column, too narrow for a
        screen, is not kept.
    """
    if len(time) <= 2 * columns:
        bounds = np.arange(len(time) + 1)
        kept = bounds[:-1]
    else:
        edges = np.searchsorted(time, np.linspace(time[0], time[-1], columns + 1)[1:-1])
        bounds = np.unique(np.concatenate(([0], edges, [len(time)])))
        kept = np.array([i for first, end in pairwise(bounds.tolist()) for i in _drawn(value, first, end)])
    firsts = bounds[1:-1]
    after_gap = firsts[time[firsts] - time[firsts - 1] > gap]
    thinned = np.where(np.isfinite(value[kept]), value[kept], np.nan)
    return _interrupt(time[kept], thinned, np.searchsorted(kept, after_gap))


def _drawn(value: Floats, first: int, end: int) -> list[int]:
    """Places of the extremes in one column, and of its first and last sample where these are missing."""
    column = value[first:end]
    low, high = int(column.argmin()), int(column.argmax())
    if np.isfinite(column[low]) and np.isfinite(column[high]):
        return [first + i for i in sorted({low, high})]
    finite = np.flatnonzero(np.isfinite(column))
    if not len(finite):
        return [first]
    extremes = {int(finite[column[finite].argmin()]), int(finite[column[finite].argmax()])}
    missing = {i for i in (0, len(column) - 1) if not np.isfinite(column[i])}
    return [first + i for i in sorted(extremes | missing)]


def _interrupt(time: Floats, value: Floats, before: Places) -> tuple[Floats, Floats]:
    """Put a NaN before the given places, unless there is one at either side already."""
    needed = before[np.isfinite(value[before]) & np.isfinite(value[before - 1])]
    return np.insert(time, needed, time[needed]), np.insert(value, needed, np.nan)
