"""When samples were taken: runs of samples, intervals, gaps, and two clocks compared.

All functions are pure, O(n) and take times as recorded: ``int64`` nanoseconds, in file order, not sorted.
Intervals are those between samples whose stamps advance, by the rule of `pipeline.numerics.time_grid`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.time_grid import advancing

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]

MAD_TO_SIGMA = 1.482602218505602
"""Standard deviation of a normal variate over its median absolute deviation: 1 / Phi^-1(3/4)."""

_MEAN_TO_SIGMA = 1.2533141373155001
"""Standard deviation of a normal variate over its mean absolute deviation: sqrt(pi / 2)."""

_GAP = 1.8
"""Median intervals from which on one is taken for a gap with a lost sample, not for jitter."""

_BLOCKS = 64
"""Blocks that the comparison of clocks averages over: 62 degrees of freedom for its standard error."""


@dataclass(frozen=True, slots=True)
class Runs:
    """Stretches of consecutive samples: ``start`` is the first index, ``stop`` one past the last."""

    start: Int
    stop: Int

    def __len__(self) -> int:
        return len(self.start)

    @property
    def length(self) -> Int:
        """Samples in each run."""
        return self.stop - self.start


def runs(mask: Bool) -> Runs:
    """The runs of true in a mask, shape (n,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    return Runs(edges[::2], edges[1::2])


@dataclass(frozen=True, slots=True)
class Intervals:
    """How regularly the samples that advance follow each other.

    Attributes
    ----------
    nominal : float
        The interval that a regular recording would have [s]: the median; in a recording by batches, the
        mean without the longest hundredth (see `batched`).
    jitter : float
        Robust standard deviation of the intervals about their median [s]: the larger of 1.4826 times their
        median and 1.2533 times their mean absolute deviation, the latter without gaps. The median alone is 0
        where more than half of the intervals are alike, however the others alternate.
    batched : bool
        The median is less than half of that mean: most samples follow the one before at once, in batches.
    """

    nominal: float
    jitter: float
    batched: bool


def intervals(time: Int) -> Intervals:
    """Nominal interval and jitter of stamps of which at least two advance.

    Raises
    ------
    ValueError
        If fewer than two stamps advance.
    """
    steps = np.diff(time[advancing(time).kept]) * 1e-9
    if not len(steps):
        raise ValueError("an interval needs two samples whose stamps advance")
    median = float(np.median(steps))
    usual = np.partition(steps, (99 * (len(steps) - 1)) // 100)[: (99 * (len(steps) - 1)) // 100 + 1]
    mean = float(usual.mean())
    batched = median < 0.5 * mean
    deviation = np.abs(steps - median)
    whole = deviation[steps < _GAP * median]
    jitter = max(MAD_TO_SIGMA * float(np.median(deviation)), _MEAN_TO_SIGMA * float(whole.mean()))
    return Intervals(mean if batched else median, jitter, batched)


@dataclass(frozen=True, slots=True)
class Gaps:
    """Intervals that are too long: between samples ``before`` and ``after`` (indices into the record)."""

    before: Int
    after: Int
    length: Float
    """[s]"""
    lost: Int
    """Samples that a regular recording would have had in between."""

    def __len__(self) -> int:
        return len(self.before)


def gaps(time: Int, nominal: float, factor: float) -> Gaps:
    """Intervals longer than ``factor`` times the nominal one [s], among the samples that advance."""
    index = np.flatnonzero(advancing(time).kept)
    steps = np.diff(time[index]) * 1e-9
    long = np.flatnonzero(steps > factor * nominal)
    lost = np.maximum(np.rint(steps[long] / nominal).astype(np.int64) - 1, 0)
    return Gaps(index[long], index[long + 1], steps[long], lost)


@dataclass(frozen=True, slots=True)
class ClockComparison:
    """A clock against another, sample by sample: difference = this clock minus the other.

    Attributes
    ----------
    offset : float
        Median difference [s].
    drift, drift_standard_error : float
        Slope of the difference [s/s]; nan where the record is too short to tell.
    jump : float
        The largest change of the difference from one sample to the next [s], with its sign.
    batch : float
        Mean number of samples that this clock stamps at once; 1 where each has its own stamp.
    """

    offset: float
    drift: float
    drift_standard_error: float
    jump: float
    batch: float


def compare_clocks(clock: Int, other: Int) -> ClockComparison:
    """Compare two clocks that stamped the same samples.

    The drift is the least-squares line through the medians of 64 blocks of the differences. Medians, because
    a delay in transport is skewed and has outliers; blocks, because it is correlated from sample to sample,
    and over a block that averages out. The standard error is that of the line through independent blocks: a
    delay that wanders for longer than a block (record length / 64) is not in it.

    Parameters
    ----------
    clock, other : ndarray of int64, shape (n,)
        Stamps [ns], n at least 2.
    """
    difference = (clock - other - (clock[0] - other[0])) * 1e-9
    base = float(clock[0] - other[0]) * 1e-9
    steps = np.diff(difference)
    drift, error = _drift((other - other[0]) * 1e-9, difference)
    return ClockComparison(
        offset=base + float(np.median(difference)),
        drift=drift,
        drift_standard_error=error,
        jump=float(steps[np.argmax(np.abs(steps))]),
        batch=_batch(clock, other),
    )


def _drift(time: Float, difference: Float) -> tuple[float, float]:
    """Slope of the difference against time, through block medians, and its standard error."""
    size = max(len(time) // _BLOCKS, 1)
    count = len(time) // size
    t = np.median(time[: count * size].reshape(count, size), axis=1)
    d = np.median(difference[: count * size].reshape(count, size), axis=1)
    t = t - t.mean()
    spread = float(t @ t)
    if count < 4 or spread == 0.0:
        return float("nan"), float("nan")
    slope = float(t @ d) / spread
    residual = d - d.mean() - slope * t
    return slope, float(np.sqrt(residual @ residual / (count - 2) / spread))


def _batch(clock: Int, other: Int) -> float:
    """Samples stamped at once: their interval by the clock is below a tenth of the other's median one."""
    own, nominal = np.diff(clock), float(np.median(np.diff(other)))
    at_once = int(np.count_nonzero(np.abs(own) < 0.1 * nominal))
    return len(clock) / (len(clock) - at_once)
