"""Motion in a record that should be static: a tap, a slow turn, a step.

Gaussian noise of any colour, random walk and ramp included, has differences of neighbouring blocks' means
that are normal with one and the same variance, and block variances that are alike. A turn has edges: one
difference that is far larger than the others, at the length of block that is about as long as the edge, and
another of opposite sign at its end; all between is motion. A tap shakes: one block variance is far above the
others. Scales are robust (median absolute deviation), block lengths rise by factors of two, and the level is
that of one false alarm in a thousand records.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from pipeline.numerics.sampling import MAD_TO_SIGMA, runs
from pipeline.stages._noise_record import Channel, usual_share

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

_FALSE_ALARMS = 1e-3
_SHORTEST = 16
"""Samples in the shortest block: the mean of so many of any noise is about normal."""
_UNUSUAL = 16
"""Samples in the shortest block of a coarse channel that must be other than the usual value."""
_RATIO = 2
_FEWEST_BLOCKS = 64
"""Blocks from which on their spread can be told."""
_FILLED = 0.75
"""Part of a block that must have samples."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion in one channel, from point ``start`` of the grid to the one before ``stop``.

    ``size`` is how far its samples lie from those around: root mean square [rad/s].
    """

    channel: str
    start: int
    stop: int
    size: float


@dataclass(frozen=True, slots=True)
class _Blocks:
    length: int
    mean: Float
    variance: Float
    filled: Mask


def motions(channel: Channel) -> tuple[Motion, ...]:
    """What moves in a channel, in order of time; none of it overlaps."""
    n = len(channel.rate)
    moving = np.zeros(n, dtype=np.bool_)
    values = channel.rate[channel.present]
    unusual = 1 - usual_share(values)
    length = max(_SHORTEST, int(np.ceil(_UNUSUAL / unusual)))
    tests = 2 * n / length * _RATIO / (_RATIO - 1)
    level = -float(ndtri(0.5 * _FALSE_ALARMS / max(tests, 1.0)))
    open_edges: list[tuple[int, int]] = []
    while n // length >= _FEWEST_BLOCKS:
        blocks = _blocks(channel.rate, channel.present & ~moving, length)
        longest = n // (length * _RATIO) < _FEWEST_BLOCKS
        turns, ends = _turns(blocks, level, longest=longest)
        for first, last in [*turns, *_shakes(blocks, level)]:
            # what is left behind the last whole block belongs to it
            moving[first * length : n if last + 1 == n // length else (last + 1) * length] = True
        open_edges += [(first * length, (last + 1) * length) for first, last in ends]
        length *= _RATIO
    for start, stop in open_edges:
        if not moving[start:stop].any():
            moving[start:stop] = True
    found = runs(moving)
    still = channel.present & ~moving
    if len(found) and not still.any():
        still = channel.present
    return tuple(
        Motion(channel.name, int(start), int(stop), _size(channel, still, int(start), int(stop)))
        for start, stop in zip(found.start, found.stop, strict=True)
    )


def _blocks(rate: Float, present: Mask, length: int) -> _Blocks:
    count = len(rate) // length
    inside = present[: count * length].reshape(count, length)
    values = np.where(inside, rate[: count * length].reshape(count, length), 0.0)
    held = np.count_nonzero(inside, axis=1)
    many = np.maximum(held, 1)
    mean = values.sum(axis=1) / many
    values -= mean[:, np.newaxis]
    variance = np.einsum("ij,ij,ij->i", values, values, inside) / many
    return _Blocks(length, mean, variance, held >= _FILLED * length)


def _turns(
    blocks: _Blocks, level: float, *, longest: bool
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Turns by their first and last blocks, those in which the edges lie included; and edges without an end.

    Of such an edge the blocks beside it, since longer blocks may show its end; among the longest blocks it is
    a turn of the shorter side of the record.
    """
    both = blocks.filled[1:] & blocks.filled[:-1]
    difference = np.where(both, np.diff(blocks.mean), 0.0)
    sigma = _spread(difference[both])
    turns: list[tuple[int, int]] = []
    if not sigma > 0:
        return turns, turns
    height = level * _allowance(int(np.count_nonzero(both))) * sigma
    large = np.abs(difference) > height
    # An edge that begins or ends within a block has a part in the differences beside it
    about = large.copy()
    about[1:] |= large[:-1]
    about[:-1] |= large[1:]
    level_so_far = np.cumsum(np.where(about, difference, 0.0))
    last = len(blocks.mean) - 1
    begun: list[int] = []
    before = 0.0
    for edge in np.flatnonzero(large).tolist():
        if not begun:
            before = float(level_so_far[edge - 2]) if edge > 1 else 0.0
        begun.append(edge)
        after = float(level_so_far[min(edge + 1, last - 1)])
        if abs(after - before) <= height:  # back again, but for noise
            turns.append((begun[0], edge + 1))
            begun = []
    if begun and longest:
        turns.append((begun[0], last) if last - begun[0] <= begun[0] else (0, begun[0] + 1))
        begun = []
    return turns, [(edge, edge + 1) for edge in begun]


def _shakes(blocks: _Blocks, level: float) -> list[tuple[int, int]]:
    """Blocks whose variance is far above that of the others."""
    alive = blocks.filled & (blocks.variance > 0)
    if np.count_nonzero(alive) < _FEWEST_BLOCKS:
        return []
    logarithm = np.log(blocks.variance[alive])
    usual = float(np.median(logarithm))
    # That of white noise at the least: ln chi^2 has the variance 2/nu and a light upper tail
    sigma = max(_spread(logarithm), float(np.sqrt(2 / blocks.length)))
    above = np.zeros(len(alive), dtype=np.bool_)
    above[alive] = logarithm - usual > level * _allowance(len(logarithm)) * sigma
    found = runs(above)
    return [(int(a), int(b) - 1) for a, b in zip(found.start, found.stop, strict=True)]


def _spread(values: Float) -> float:
    """Robust standard deviation."""
    if len(values) < _FEWEST_BLOCKS - 1:
        return 0.0
    return MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))


def _allowance(count: int) -> float:
    """Factor on the level for the error of the spread, 1.17/sqrt(count) of it: three times that."""
    return 1 + 3.5 / float(np.sqrt(count))


def _size(channel: Channel, still: Mask, start: int, stop: int) -> float:
    """Root mean square deviation from the mean of as many still samples on either side."""
    around = slice(max(0, 2 * start - stop), 2 * stop - start)
    near = channel.rate[around][still[around]]
    mean = float(np.mean(near if len(near) else channel.rate[still]))
    inside = channel.rate[start:stop][channel.present[start:stop]]
    return float(np.sqrt(np.mean((inside - mean) ** 2))) if len(inside) else 0.0
