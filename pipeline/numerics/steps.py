"""Samples of a slow, smooth signal that leave it: spikes, which return, jumps, which do not, and stuck ones.

The functions are given *steps*: the differences of neighbouring samples, without what is known of the
signal's own motion. A smooth remainder is taken off by a running median, so that only noise is left, of
which a step of r stands out. The sum of steps says where the signal is: after a spike it is back, after a
jump it is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, percentile_filter

from pipeline.numerics.sample_faults import frozen_runs, resolution
from pipeline.numerics.sampling import Runs

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]

_WINDOW = 11
"""Steps of the running median: a spike spoils two of them."""

_SCALE_WINDOW = 129
_QUANTILE, _QUANTILE_TO_SIGMA = 90.0, 1.6448536269514722
"""The scale of noise: the 90 % quantile of the size of steps around, over that of a normal variate. Of a
coarse signal most steps are 0; a quantile this high still tells how large the others are. A spike in twenty
leaves it."""

_FEW = 6.0
"""The scale of n steps is raised by 6/n: a quantile of few steps may be too small, and their median follows
them."""

_RETURNED = 0.5
"""Part of a step's height within which the signal is taken to be back, and never beyond two thresholds. Noise
of a sixth of the height leads a jump there once in a thousand times, and a spike away from it as rarely."""

_WIDE = 2.0
"""The sum of several steps has the error of their smooth rate in it as often."""

_MOVED = 16.0
"""Quanta that a signal must have moved in a time that long, before and after, for a hold to be a fault. At
a crest x = k t^2 the hold is as long as the signal stays within a quantum, and it moves 8 quanta in as long
a time beside it."""


@dataclass(frozen=True, slots=True)
class Steps:
    """What stands out of a signal of n samples.

    Attributes
    ----------
    spikes : ndarray of bool, shape (n,)
        Samples away from the signal.
    jumps : ndarray of int64
        i for a jump between samples i and i + 1, rising.
    """

    spikes: Bool
    jumps: Int


def detrended(steps: Float, length: Float) -> Float:
    """Steps without a smooth rate, their running median.

    A rate that rises or falls is followed exactly, and at a crest to its fall within three steps.

    Parameters
    ----------
    steps : ndarray, shape (n, channels)
    length : ndarray, shape (n,)
        Time that each step takes: the median is that of the rates.

    Returns
    -------
    ndarray, shape (n, channels)
    """
    rates = steps / length[:, np.newaxis]
    return np.asarray(steps - _smooth(rates) * length[:, np.newaxis], dtype=np.float64)


def _smooth(rates: Float) -> Float:
    """Running median, with the ends continued along the line between the medians of the last two windows."""
    half = _WINDOW // 2
    if len(rates) < 2 * _WINDOW:
        return running_median(rates, _WINDOW)
    ends = []
    for part in (rates[: 2 * _WINDOW][::-1], rates[-2 * _WINDOW :]):
        inner, outer = np.median(part[:_WINDOW], axis=0), np.median(part[_WINDOW:], axis=0)
        ends.append(outer + (outer - inner) / _WINDOW * np.arange(half + 1, _WINDOW)[:, np.newaxis])
    padded = np.concatenate([ends[0][::-1], rates, ends[1]])
    return running_median(padded, _WINDOW)[half:-half]


def running_median(values: Float, window: int) -> Float:
    """Median of each channel of values, shape (n, channels), over an odd window; mirrored at the ends."""
    columns = [median_filter(np.ascontiguousarray(channel), window, mode="reflect") for channel in values.T]
    return np.asarray(np.stack(columns, axis=1), dtype=np.float64)


def without_large_spikes(values: Float, longest: int) -> Float:
    """Values with their running median where they are farther from it than their motion explains.

    Elsewhere the median is not taken: it lags at crests and at the ends.

    Parameters
    ----------
    values : ndarray, shape (n, channels)
        A slow, smooth signal.
    longest : int
        Samples that a spike may last.

    Returns
    -------
    ndarray, shape (n, channels)
    """
    median = running_median(values, 2 * longest + 1)
    usual = np.quantile(np.abs(np.diff(values, axis=0)), _QUANTILE / 100, axis=0)
    return np.asarray(
        np.where(np.abs(values - median) > 3 * longest * usual, median, values), dtype=np.float64
    )


def noise_scale(steps: Float) -> Float:
    """Standard deviation of the steps around each, robust against a spike in twenty samples.

    Parameters
    ----------
    steps : ndarray, shape (n, channels)
        Without trend.

    Returns
    -------
    ndarray, shape (n, channels)
    """
    columns = [
        percentile_filter(np.ascontiguousarray(channel), _QUANTILE, _SCALE_WINDOW, mode="reflect")
        for channel in np.abs(steps).T
    ]
    few = 1 + _FEW / min(len(steps), _SCALE_WINDOW)
    return np.asarray(few / _QUANTILE_TO_SIGMA * np.stack(columns, axis=1), dtype=np.float64)


def classify(steps: Float, threshold: Float, longest: int) -> Steps:
    """Tell spikes from jumps among the steps that stand out.

    Parameters
    ----------
    steps : ndarray, shape (n - 1, channels)
        Without trend.
    threshold : ndarray, shape (n - 1, channels)
        Above which a step stands out.
    longest : int
        Samples that a spike may last; a signal that has not returned after so many has jumped. So few
        samples beyond a jump at either end are taken for a spike.

    Returns
    -------
    Steps
    """
    count = len(steps) + 1
    level = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
    spikes = np.zeros(count, dtype=np.bool_)
    jumps: list[int] = []
    done = 0
    for i in np.flatnonzero(np.any(np.abs(steps) > threshold, axis=1)).tolist():
        if i < done:
            continue
        height = np.abs(steps[i])
        wide = _WIDE * threshold[i]
        near = np.where(height > threshold[i], np.minimum(_RETURNED * height, wide), wide)
        # back[k]: the signal at sample i + 2 + k is where it was at sample i
        back = np.all(np.abs(level[i + 2 : i + 2 + longest] - level[i]) <= near, axis=1)
        # left[k]: the signal at sample i - longest + k is where it is at sample i + 1
        first = max(i - longest, 0)
        left = np.all(np.abs(level[first:i] - level[i + 1]) <= near, axis=1)
        if back.any():
            done = i + 2 + int(np.argmax(back))
            spikes[i + 1 : done] = True
        elif left.any():
            spikes[first + int(np.flatnonzero(left)[-1]) + 1 : i + 1] = True
        elif i + 1 <= longest:
            spikes[: i + 1] = True
        elif count - (i + 1) <= longest:
            spikes[i + 1 :] = True
            break
        else:
            jumps.append(i)
    return Steps(spikes, np.array(jumps, dtype=np.int64))


def stuck_runs(values: Float, minimum: int) -> Runs:
    """Stretches that hold their value bit for bit, where the signal beside them does not rest.

    A quantised angle that turns slowly holds its value for many samples and is sound. A hold of L samples
    is marked when it is improbably long for the record (`frozen_runs`) and in the L samples before it and
    in the L after it the signal moves more than 16 quanta, the step out of the hold included. Where one
    side is missing, at the ends, the other decides.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Finite samples in order; angles unwrapped.
    minimum : int
        Shortest run to be marked, in samples.
    """
    found = frozen_runs(values, minimum)
    quantum = resolution(values)
    before = np.abs(values[found.start] - values[np.maximum(found.start - found.length, 0)])
    last = len(values) - 1
    after = np.abs(values[np.minimum(found.stop + found.length - 1, last)] - values[found.stop - 1])
    least = np.where(found.start == 0, after, np.where(found.stop > last, before, np.minimum(before, after)))
    moved = least > _MOVED * quantum
    return Runs(found.start[moved], found.stop[moved])
