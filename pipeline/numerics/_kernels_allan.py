"""Compiled sums of `allan`: squares of differences of an integral, over runs of samples without a gap.

A run of the samples ``start`` to ``stop - 1`` has the points ``x[start]`` to ``x[stop]`` of the integral. The
factors ascend. Starts of terms are taken in blocks, and all factors within a block: what the near factors
read is then still in the cache, and the sum of a block is small enough to lose no digits in the whole.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Integer = NDArray[np.int64]

_BLOCK = 8192
"""Starts of terms in a block: 64 KiB of x."""

_ANY_ORDER = {"reassoc", "contract"}
"""The order of a sum is free, so that it can be taken in vectors; nothing else is."""


@njit(cache=True)
def mean(values: Float, starts: Integer, stops: Integer) -> float:
    """Mean over the runs; not a number where a value is none."""
    total, count = 0.0, 0
    for run in range(starts.size):
        for first in range(starts[run], stops[run], _BLOCK):
            last = min(first + _BLOCK, stops[run])
            total += _sum(values, first, last)
            count += last - first
    return total / count


@njit(cache=True)
def integrate(values: Float, starts: Integer, stops: Integer, bias: float, scale: float, x: Float) -> None:
    """``x[k + 1] = x[k] + scale (values[k] - bias)``, x constant where a value is missing.

    The sum is compensated (Kahan, *Commun. ACM* 8 (1965) 40): every x is right to its last digit.
    """
    total, lost, filled = 0.0, 0.0, 0
    x[0] = 0.0
    for run in range(starts.size):
        while filled < starts[run]:
            filled += 1
            x[filled] = x[filled - 1]
        for k in range(starts[run], stops[run]):
            term = (values[k] - bias) - lost
            grown = total + term
            lost = (grown - total) - term
            total = grown
            x[k + 1] = scale * total
        filled = stops[run]
    for k in range(filled + 1, x.size):
        x[k] = x[k - 1]


@njit(cache=True)
def second_differences(x: Float, starts: Integer, stops: Integer, factors: Integer, sums: Float) -> None:
    """Add the squares of ``x[i + 2m] - 2 x[i + m] + x[i]`` to ``sums``, shape as ``factors``."""
    for run in range(starts.size):
        for first in range(starts[run], stops[run], _BLOCK):
            for k in range(factors.size):
                last = min(first + _BLOCK, stops[run] - 2 * factors[k] + 1)
                if last <= first:
                    break
                sums[k] += _second(x, first, last, factors[k])


@njit(cache=True)
def third_differences(x: Float, starts: Integer, stops: Integer, factors: Integer, sums: Float) -> None:
    """Add the squares of ``x[i + 3m] - 3 x[i + 2m] + 3 x[i + m] - x[i]`` to ``sums``."""
    for run in range(starts.size):
        for first in range(starts[run], stops[run], _BLOCK):
            for k in range(factors.size):
                last = min(first + _BLOCK, stops[run] - 3 * factors[k] + 1)
                if last <= first:
                    break
                sums[k] += _third(x, first, last, factors[k])


@njit(cache=True)
def averaged_differences(x: Float, starts: Integer, stops: Integer, factors: Integer, sums: Float) -> None:
    """Add the squares of the sums of m successive second differences to ``sums``.

    The sum slides: what enters less what leaves is a third difference. It is formed anew every so many
    steps, lest its rounding grow with the record.
    """
    for run in range(starts.size):
        for k in range(factors.size):
            m = factors[k]
            end = stops[run] - 3 * m + 2
            stride = max(_BLOCK, m)
            for first in range(starts[run], end, stride):
                sums[k] += _sliding(x, first, min(first + stride, end), m)


@njit(cache=True)
def reflected_differences(x: Float, starts: Integer, stops: Integer, factors: Integer, sums: Float) -> None:
    """Add the squares of the second differences that reach over an end of a run to ``sums``.

    Beyond its ends a run goes on as its image by the end point: ``x[s - j] = 2 x[s] - x[s + j]``.
    """
    for run in range(starts.size):
        s, e = starts[run], stops[run]
        for k in range(factors.size):
            m = factors[k]
            if 2 * m > e - s:
                break
            total = 0.0
            for i in range(1, m):
                left = x[s + i + m] - 2.0 * x[s + i] + (2.0 * x[s] - x[s + m - i])
                right = x[e - i - m] - 2.0 * x[e - i] + (2.0 * x[e] - x[e - m + i])
                total += left * left + right * right
            sums[k] += total


@njit(cache=True)
def lag_one(x: Float, starts: Integer, stops: Integer, m: int, order: int) -> tuple[float, int]:
    """Lag-1 autocorrelation of the means over m samples, differenced ``order`` times; and their number.

    Of order 0 to 2; pairs lie in one run.
    """
    total, count = 0.0, 0
    for run in range(starts.size):
        for i in range(starts[run], stops[run] - (order + 1) * m + 1, m):
            total += _difference(x, i, m, order)
            count += 1
    if count == 0:
        return 0.0, 0
    middle = total / count
    power, product = 0.0, 0.0
    for run in range(starts.size):
        before, there = 0.0, False
        for i in range(starts[run], stops[run] - (order + 1) * m + 1, m):
            z = _difference(x, i, m, order) - middle
            power += z * z
            if there:
                product += before * z
            before, there = z, True
    return (product / power if power > 0.0 else 0.0), count


@njit(cache=True)
def _difference(x: Float, i: int, m: int, order: int) -> float:
    d = x[i + m] - x[i]
    if order == 1:
        d = (x[i + 2 * m] - x[i + m]) - d
    elif order == 2:
        d = (x[i + 3 * m] - x[i]) - 3.0 * (x[i + 2 * m] - x[i + m])
    return float(d)


@njit(cache=True, fastmath=_ANY_ORDER)
def _sum(values: Float, first: int, last: int) -> float:
    total = 0.0
    for k in range(first, last):
        total += values[k]
    return total


@njit(cache=True, fastmath=_ANY_ORDER)
def _second(x: Float, first: int, last: int, m: int) -> float:
    n = last - first
    a, b, c = x[first:last], x[first + m : last + m], x[first + 2 * m : last + 2 * m]
    total = 0.0
    for i in range(n):
        v = (c[i] - b[i]) - (b[i] - a[i])
        total += v * v
    return total


@njit(cache=True, fastmath=_ANY_ORDER)
def _third(x: Float, first: int, last: int, m: int) -> float:
    n = last - first
    a, b = x[first:last], x[first + m : last + m]
    c, d = x[first + 2 * m : last + 2 * m], x[first + 3 * m : last + 3 * m]
    total = 0.0
    for i in range(n):
        v = (d[i] - a[i]) - 3.0 * (c[i] - b[i])
        total += v * v
    return total


@njit(cache=True)
def _sliding(x: Float, first: int, last: int, m: int) -> float:
    window = 0.0
    for i in range(first, first + m):
        window += (x[i + 2 * m] - x[i + m]) - (x[i + m] - x[i])
    total = window * window
    for i in range(first, last - 1):
        window += (x[i + 3 * m] - x[i]) - 3.0 * (x[i + 2 * m] - x[i + m])
        total += window * window
    return total
