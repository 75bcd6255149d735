"""When a vibration begins: the rise of its power within a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.vibration import fundamental

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_POWER_RISE = 4.0
"""Least rise of a channel's power at an onset: what rises less was no rest before."""
_SURE = 50.0
"""Least gain in twice the log likelihood. Noise without an onset gains, at one row, a chi-squared variate of
six degrees of freedom (mean and variance of three channels): 50 once in 2e8 rows, as long as rows count."""
_FEWEST_SAMPLES = 8


@dataclass(frozen=True, slots=True)
class Onset:
    """When the vibration begins.

    Attributes
    ----------
    stretch, row : int
        The last row before the rise, and the stretch of the record that holds it.
    ratio : float
        Factor by which the power rises, in the channel where it rises most.
    accuracy : float
        The longer of a period of the vibration and two sample intervals, s.
    """

    stretch: int
    row: int
    ratio: float
    accuracy: float


def find_onset(stretches: Sequence[Matrix], step: float, stride: int) -> Onset | None:
    """When the vibration begins, by the one change of variance of the angles' rates of change.

    Parameters
    ----------
    stretches : sequence of (n, c) arrays
        Angles on a uniform grid, one array for each uninterrupted stretch, rad.
    step : float
        Step of the grid, s.
    stride : int
        Rows in a sample interval. The rates are differences over it: a smooth motion is a constant in them.

    Returns
    -------
    Onset or None
        None where the power does not rise. The interpolation of the rates smears the onset over two sample
        intervals, and in noise the beginning of the first period may not stand out.
    """
    differences = [np.diff(x[::stride], axis=0) for x in stretches]
    longest = max(differences, key=len)
    strongest = int(np.argmax(np.sum((longest - longest.mean(axis=0)) ** 2, axis=0))) if longest.size else 0
    interval = stride * step
    period = 1 / (fundamental(longest[:, strongest], interval) or 1 / interval)
    margin = max(_FEWEST_SAMPLES, int(np.ceil(2 * period / interval)))
    rise = power_rise(np.concatenate(differences), margin)
    if rise is None:
        return None
    first = np.cumsum([0, *(d.shape[0] for d in differences)])
    stretch = int(np.searchsorted(first, rise.index, side="right")) - 1
    row = (rise.index - int(first[stretch])) * stride
    return Onset(stretch, row, rise.ratio, max(period, 2 * interval))


@dataclass(frozen=True, slots=True)
class PowerRise:
    """Where the power of a signal rises, and by what factor in the channel where it rises most."""

    index: int
    ratio: float


def power_rise(x: Matrix, margin: int) -> PowerRise | None:
    """The one change of variance in a record, by maximum likelihood.

    For independent Gaussian samples of one mean and variance before the row k and others from it on, the
    log likelihood is ``-½ Σ_channels (k log v1 + (n - k) log v2)``; k is where it is largest.

    Parameters
    ----------
    x : (n, c) array
        Channels whose power rises at the onset, e.g. rates.
    margin : int
        Least number of rows on either side, at least two periods of the vibration: part of a period has
        another variance than the whole.

    Returns
    -------
    PowerRise or None
        None where no channel gains a factor of four in power, where chance could make the likelihood as
        large, or where a side would have fewer than `margin` rows.
    """
    n = x.shape[0]
    k = np.arange(margin, n - margin + 1)
    if k.size == 0:
        return None
    centred = x - x.mean(axis=0)
    total = np.mean(centred**2, axis=0)
    # 1e-9 of the power: a rest without noise has a variance of rounding errors only
    smallest = np.maximum(1e-9 * total.max(), np.finfo(np.float64).tiny)
    before = _variance(np.cumsum(centred, axis=0), np.cumsum(centred**2, axis=0), k, smallest)
    turned = centred[::-1]
    after = _variance(np.cumsum(turned, axis=0), np.cumsum(turned**2, axis=0), n - k, smallest)
    cost = k * np.log(before).sum(axis=1) + (n - k) * np.log(after).sum(axis=1)
    best = int(np.argmin(cost))
    ratio = float(np.max(after[best] / before[best]))
    gain = n * np.log(np.maximum(total, smallest)).sum() - cost[best]
    at_edge = best in (0, k.size - 1)
    return None if ratio < _POWER_RISE or gain < _SURE or at_edge else PowerRise(int(k[best]), ratio)


def _variance(sums: Matrix, squares: Matrix, count: NDArray[np.intp], smallest: float) -> Matrix:
    """Variance of the first `count` rows, from cumulative sums, each with its own mean."""
    m = count[:, None]
    variance: Matrix = squares[count - 1] / m - (sums[count - 1] / m) ** 2
    return np.maximum(variance, smallest)
