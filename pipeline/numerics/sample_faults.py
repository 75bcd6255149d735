"""Samples that a sound sensor would hardly give: frozen, clipped and spiking ones.

Each test asks how improbable a stretch is *for this signal*, because the plain rules fire on sound data: a
coarse signal repeats its values, a pure sinusoid has equal samples at its crests, a vibration near a quarter
of the sampling rate has second differences as large as itself. All functions are pure and O(n); times play no
part, samples are neighbours in the order given. NaN is no sample: leave it out first.
"""

from __future__ import annotations

import numpy as np

from pipeline.numerics.sampling import Bool, Float, Int, Runs, runs

_FALSE_ALARMS = 1e-3
"""Expected number of runs marked frozen in a sound record of any length."""

_NEIGHBOURS = 16
"""Runs on each side of a candidate that say how long runs usually are there."""

_USUAL = 0.75
"""Quantile of their lengths that is taken: up to a quarter of them may be frozen runs themselves, up to half
the single samples of a coarse signal that now and then leaves its value."""

_COMMON = 0.1
"""Above this part of runs longer than one sample, repeating is what the signal does, not a fault."""

_PILE_UP = 4.0
"""Samples at a rail over those one level beneath. At the crest of a coarse sinusoid the ratio is at most
1/(sqrt 2 - 1) = 2.41, because the sinusoid stays within x of its crest for a time proportional to sqrt x."""

_HEADING = 0.1
"""Part of the runs' ends that must head beyond the rail; noise hides the heading of the others."""

_FEW_LEVELS = 8
"""A signal whose range is no more than this many of its smallest steps has no slope to speak of."""

_BLOCK = 64
_SCALE_RANK = 57
"""The scale of a block of second differences is the 58th of 64, their 90 % quantile: a spike raises three of
them, so two spikes in a block leave it as it is."""


def frozen_runs(values: Float, minimum: int) -> Runs:
    """Stretches in which every channel repeats its value, bit for bit, improbably long.

    A run of L samples is marked when sound data of the same length would show one so long with a probability
    below 0.001. Were neighbours equal with probability P independently, a run would be at least L long with
    probability ``P**(L - 1)`` and have the mean length m = 1/(1 - P). For m the upper quartile is taken of
    the 32 runs around the candidate, and not less than of all runs of the record. A coarse slow signal thus
    sets its own measure: at a crest its longest run is 8.5 times that quartile, and some 20 times are needed.
    A record that never changes has no measure and is not marked here. An output without any noise, at rest
    below its resolution or simulated, cannot be told from a frozen one.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, channels)
        Finite samples in order.
    minimum : int
        Shortest run to be marked, in samples.

    Returns
    -------
    Runs
        The sample that was seen first belongs to its run.
    """
    table = values if values.ndim == 2 else values[:, None]
    changes = np.flatnonzero(np.any(table[1:] != table[:-1], axis=1)) + 1
    start = np.concatenate([[0], changes]).astype(np.int64)
    stop = np.concatenate([changes, [len(table)]]).astype(np.int64)
    length = stop - start
    if len(length) < 3:
        return Runs(start[:0], stop[:0])
    candidates = np.flatnonzero(length >= minimum)
    usual = _usual_length(length, candidates)
    allowed = 1 + np.log(len(length) / _FALSE_ALARMS) / -np.log1p(-1 / usual)
    frozen = candidates[length[candidates] > allowed]
    return Runs(start[frozen], stop[frozen])


def _usual_length(length: Int, candidates: Int) -> Float:
    """How long the runs around each candidate usually are; never below what all runs of the record say."""
    offsets = np.concatenate([np.arange(-_NEIGHBOURS, 0), np.arange(1, _NEIGHBOURS + 1)])
    around = candidates[:, None] + offsets
    inside = (around >= 0) & (around < len(length))
    lengths = np.where(inside, length[np.clip(around, 0, len(length) - 1)], np.inf)
    lengths.sort(axis=1)
    rank = np.ceil(_USUAL * inside.sum(axis=1)).astype(np.int64) - 1
    local = lengths[np.arange(len(candidates)), np.maximum(rank, 0)]
    repeating = np.count_nonzero(length > 1) / len(length)
    if repeating > _COMMON:
        # In a signal of few levels the runs of the commonest value are longer than most.
        everywhere = float(np.quantile(length[length > 1], _USUAL))
    else:
        # Of memoryless runs the part P is longer than one sample; the mean length is 1/(1 - P).
        everywhere = 1 / (1 - repeating)
    # A sixteenth of a sample keeps a record without repeated values from proving that none can occur.
    usual: Float = np.maximum(local, everywhere) + 1 / 16
    return usual


def usual_hold(values: Float) -> int:
    """How many samples in a row usually hold one value in every channel: the median run, at least 1."""
    table = values if values.ndim == 2 else values[:, None]
    changes = np.flatnonzero(np.any(table[1:] != table[:-1], axis=1)) + 1
    return int(np.median(np.diff(changes))) if len(changes) > 1 else 1


def clipped_runs(values: Float, minimum: int) -> Runs:
    """Runs at the largest or smallest value of the record that look cut off there.

    A rail is believed when runs of at least ``minimum`` equal samples lie at the extreme, at least 4 times as
    many samples lie there as at the next level, and at least a tenth of the runs' ends head beyond the rail:
    the line through the two samples beside the run passes it, within two counts of the resolution. A coarse
    sinusoid fails the second, a plateau that is entered by a step fails the third. A plateau that is entered
    by a ramp and without any noise cannot be told from a rail; a vibration above about an eighth of the
    sampling rate has no three samples at its crest to tell by.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Finite samples in order.
    minimum : int
        Shortest run to be marked, in samples.
    """
    upper, lower = _upper_rail(values, minimum), _upper_rail(-values, minimum)
    start = np.concatenate([upper.start, lower.start])
    order = np.argsort(start, kind="stable")
    return Runs(start[order], np.concatenate([upper.stop, lower.stop])[order])


def _upper_rail(values: Float, minimum: int) -> Runs:
    none = Runs(np.empty(0, np.int64), np.empty(0, np.int64))
    rail = values.max(initial=-np.inf)
    found = runs(values == rail)
    long = found.length >= minimum
    found = Runs(found.start[long], found.stop[long])
    beneath = values[values < rail]
    if not len(found) or not len(beneath):
        return none
    next_level = np.count_nonzero(beneath >= beneath.max() - _rounding(values))
    if len(values) - len(beneath) < _PILE_UP * next_level:
        return none
    before, after = found.start[found.start >= 2], found.stop[found.stop + 2 <= len(values)]
    near = np.concatenate([values[before - 1], values[after]])
    far = np.concatenate([values[before - 2], values[after + 1]])
    quantum = resolution(values)
    # A slope is known to two counts; but a signal of few levels goes by steps and has none.
    slack = 2 * quantum if rail - beneath.min() > _FEW_LEVELS * quantum else 0.0
    heading = np.count_nonzero(near - far + slack > rail - near)
    return found if heading and heading >= _HEADING * len(near) else none


def spikes(values: Float, factor: float) -> Bool:
    """Isolated samples far from the mean of their two neighbours.

    The second difference ``d_i = x_i - (x_{i-1} + x_{i+1})/2`` of a spike of height h is -h/2, h, -h/2. A
    sample is marked when its d exceeds ``factor`` times the local scale and both neighbours of d have the
    opposite sign and 0.2 to 0.8 of its size, which a step (h/2, -h/2) or a kink (0, h, 0) has not. The scale
    is the 90 % quantile of the size of d in a block of 64, the largest of the block and the two beside it, so
    that the onset of a vibration is measured by the vibration; never below the resolution of the signal. For
    white noise of standard deviation s it is about 2.3 s, so that factor 4 finds a spike of 10 s, and fires
    on less than one sound sample in ten million. For a sinusoid near a quarter of the sampling rate it is the
    amplitude.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Finite samples in order; angles unwrapped.
    factor : float
        See above.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    marked = np.zeros(len(values), dtype=np.bool_)
    if len(values) < 5:
        return marked
    d = values[1:-1] - (values[:-2] + values[2:]) / 2
    scale = np.maximum(_local_scale(np.abs(d)), resolution(values))
    candidates = np.flatnonzero(np.abs(d) > factor * scale)
    candidates = candidates[(candidates >= 1) & (candidates < len(d) - 1)]
    for side in (-1, 1):
        share = -d[candidates + side] / d[candidates]
        candidates = candidates[(share > 0.2) & (share < 0.8)]
    marked[candidates + 1] = True
    return marked


def _local_scale(size: Float) -> Float:
    """90 % quantile in blocks of 64, the largest of a block and its neighbours, for each sample."""
    count = -(-len(size) // _BLOCK)
    if count == 1:
        return np.full(len(size), np.quantile(size, 0.9))
    # The last block is taken from the record's end, and so overlaps the one before instead of being short.
    whole = size[: (count - 1) * _BLOCK].reshape(count - 1, _BLOCK)
    blocks = np.concatenate([whole, size[None, -_BLOCK:]])
    scale = np.partition(blocks, _SCALE_RANK, axis=1)[:, _SCALE_RANK]
    padded = np.concatenate([scale[:1], scale, scale[-1:]])
    widest = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    return np.repeat(widest, _BLOCK)[: len(size)]


def _rounding(values: Float) -> float:
    """What rounding in float64 can make of equal values, after a scale and an offset."""
    return 64 * float(np.finfo(np.float64).eps) * float(np.max(np.abs(values)))


def resolution(values: Float) -> float:
    """The smallest step between neighbours, or of steps, and not below what rounding makes.

    Steps of steps are multiples of the same quantum, and tell it where the signal never rests.
    """
    rounding = _rounding(values)
    steps = np.abs(np.concatenate([np.diff(values), np.diff(values, n=2)]))
    steps = steps[steps > rounding]
    return max(rounding, float(steps.min()) if len(steps) else 0.0)
