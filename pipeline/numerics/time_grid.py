"""Integer time: which samples advance, and the uniform grid of a segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Time = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Advance:
    """Which samples to keep so that time strictly advances, and what is wrong with the others."""

    kept: Mask
    repeated: Mask
    out_of_order: Mask


def advancing(time: Time) -> Advance:
    """Keep the samples that make time strictly advance, leaving out as few as one of two rules can.

    Either a sample must be later than all before it (right for stamps that fall back), or earlier than
    all after it (right for a stamp that leaps ahead, which would else condemn all that follows). The rule
    that keeps more is taken; on a tie the first.

    Parameters
    ----------
    time : ndarray of int64, shape (n,)
        As recorded [ns].
    """
    if time.size == 0:
        empty = np.zeros(0, dtype=np.bool_)
        return Advance(empty, empty, empty)
    before = np.maximum.accumulate(time)
    after = np.minimum.accumulate(time[::-1])[::-1]
    later = np.append(True, time[1:] > before[:-1])
    earlier = np.append(time[:-1] < after[1:], True)
    if np.count_nonzero(later) >= np.count_nonzero(earlier):
        kept, equal = later, np.append(False, time[1:] == before[:-1])
    else:
        kept, equal = earlier, np.append(time[:-1] == after[1:], False)
    return Advance(kept, ~kept & equal, ~kept & ~equal)


def uniform_grid(start: int, end: int, steps: int) -> Time:
    """``steps + 1`` times from start to end inclusive, uniform to the rounding of a nanosecond.

    Raises
    ------
    ValueError
        If a step were shorter than a nanosecond.
    """
    if not 1 <= steps <= end - start:
        raise ValueError(f"{end - start} ns cannot hold {steps} steps")
    whole, rest = divmod(end - start, steps)
    index = np.arange(steps + 1, dtype=np.int64)
    # start + round(index (end - start)/steps), in parts that cannot overflow
    return start + index * whole + (index * rest + steps // 2) // steps
