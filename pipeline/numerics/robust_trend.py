"""The trend of `trend.harmonic` in spite of outlying rows and of jumps of the angle.

A wrong sample of an angle is an outlying row; a wrong sample of a rate is, once integrated, a jump that
stays. Both are left out, and what remains is weighted by its own noise:

1. Huber's M-estimate of the vibration and the trend from all rows of whole vibration periods;
2. rows far from the running median of its residual are left out (the median follows a random walk);
3. generalised least squares on the block means; where the level has made an outlying step, by all the
   other rows, it is set free to do so, and this is repeated until no step is outlying.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from pipeline.numerics.noise_model import (
    Fit,
    generalised_least_squares,
    jump_scores,
    memory,
    ordinary_least_squares,
)
from pipeline.numerics.sampling import MAD_TO_SIGMA
from pipeline.numerics.trend import Blocks, Trend, as_trend, average
from pipeline.numerics.vibration import harmonic_design

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HUBER = 1.345
"""95 % efficient for Gaussian noise."""
_OUTLYING = 5.0
"""Standard deviations of a row from the running median; a Gaussian row in 2e6 is left out."""
_IN_LINE = 0.25
"""Distance from the mean of its neighbours, over that from the median, of a row in line with them."""
_JUMP = 4.0
"""Standard deviations of a step of the level; a Gaussian step in 16,000 is set free."""
_FEWEST_INDEPENDENT = 20
"""Independent scores whose median deviation is a scale."""
_MOST_PASSES = 50
_UPPER_QUARTILE = 1.1503
"""What a quarter of Gaussian deviations exceed, in standard deviations."""


def robust(t: Vector, y: Vector, frequency: float | None, harmonics: int, block: int) -> Trend:
    """The trend over whole vibration periods, without outlying rows and jumps.

    Parameters and errors are those of `trend.harmonic`.

    Returns
    -------
    Trend
        With the number of rows and of jumps that were left out.
    """
    step = t[1] - t[0]
    n = _whole_periods(y.size, step, frequency)
    design = harmonic_design(t[:n], frequency, harmonics)
    coefficients = huber(design, y[:n])
    keep = _near_running_median(y[:n] - design @ coefficients, block)
    blocks = average(design, y[:n], coefficients, keep, block, step)
    jumps = _outlying_jumps(blocks)
    fit = generalised_least_squares(blocks.design, blocks.residual, observed=blocks.observed, jumps=jumps)
    return as_trend(blocks, fit, int(np.count_nonzero(~keep)), int(np.count_nonzero(jumps)))


def huber(design: Matrix, y: Vector) -> Vector:
    """Huber's M-estimate by iteratively reweighted least squares, the scale by the median deviation.

    Parameters
    ----------
    design : (n, p) array
    y : (n,) array

    Returns
    -------
    (p,) array
        Source: Huber & Ronchetti, *Robust Statistics*, 2nd ed., 2009, §7.8.
    """
    weights = np.ones(y.size)
    coefficients = np.zeros(design.shape[1])
    for _ in range(_MOST_PASSES):
        root = np.sqrt(weights)
        updated = ordinary_least_squares(design * root[:, None], y * root)
        change = float(np.max(np.abs(design @ (updated - coefficients))))
        coefficients = updated
        residual = np.abs(y - design @ coefficients)
        scale = MAD_TO_SIGMA * float(np.median(residual))
        if change <= 1e-3 * scale or scale == 0:
            break
        weights = np.minimum(1.0, _HUBER * scale / np.maximum(residual, scale * 1e-9))
    return coefficients


def winsorised(y: Vector) -> Vector:
    """Samples with what lies far off their straight line brought back, for a search of the frequency."""
    design = harmonic_design(np.linspace(0.0, 1.0, y.size), None, 0)
    line: Vector = design @ huber(design, y)
    residual = y - line
    bound = _OUTLYING * MAD_TO_SIGMA * float(np.median(np.abs(residual)))
    return line + np.clip(residual, -bound, bound)


def _whole_periods(n: int, step: float, frequency: float | None) -> int:
    """Rows in the whole number of vibration periods that the record holds."""
    if frequency is None:
        return n
    periods = int((n - 1) * step * frequency + 1e-6)
    return min(n, round(periods / (frequency * step)) + 1)


def _near_running_median(residual: Vector, block: int) -> Mask:
    """Rows that do not stand out, each by itself, of the median of the block of rows around them.

    A row in the flank of a jump that the interpolation has smeared is far from the median too, but in line
    with its neighbours, the nearest and the next: it stays.
    """
    distance = np.abs(residual - median_filter(residual, size=max(5, 2 * (block // 2) + 1), mode="nearest"))
    # Not the median deviation: a row is the median of the few around it one time in five.
    scale = float(np.quantile(distance, 0.75)) / _UPPER_QUARTILE
    if scale == 0:
        return np.ones(residual.size, dtype=np.bool_)
    in_line = np.ones(residual.size, dtype=np.bool_)
    for reach in (1, 2):
        wider = np.pad(residual, reach, mode="edge")
        bend = np.abs(residual - 0.5 * (wider[: -2 * reach] + wider[2 * reach :]))
        in_line &= bend < _IN_LINE * distance
    keep: Mask = (distance <= _OUTLYING * scale) | in_line
    return keep


def _outlying_jumps(blocks: Blocks) -> Mask:
    """Blocks before which the level has made a step that no random walk of its noise makes.

    With each goes its neighbour on either side, over which the interpolation smears a wrong sample. The
    steps are judged by their own median deviation, so that the first pass, whose noise levels are
    still inflated by the jumps, sees them too.
    """
    seen = blocks.observed
    jumps = np.zeros(seen.size, dtype=np.bool_)
    for _ in range(_MOST_PASSES):
        fit = generalised_least_squares(blocks.design, blocks.residual, observed=seen, jumps=jumps)
        residual = blocks.residual - blocks.design @ fit.coefficients
        scores = np.abs(jump_scores(residual, fit, observed=seen, jumps=jumps))
        outlying = (scores > _JUMP * _scale(scores, fit)) & (scores >= _larger_neighbour(scores))
        freed = jumps | outlying | np.roll(outlying, 1) | np.roll(outlying, -1)
        freed[: int(np.argmax(seen)) + 1] = False  # the first block seen is what gives b
        if not outlying.any() or 2 * np.count_nonzero(freed) > seen.size or np.array_equal(freed, jumps):
            break
        jumps = freed
    return jumps


def _scale(scores: Vector, fit: Fit) -> float:
    """Standard deviation of the undisturbed steps' scores: 1 but for the share of the jumps in the noise.

    Where the noise is all but white, the scores of many rows hang together, and their median deviation
    says nothing; a jump then stands out of the white noise as it is.
    """
    scored = scores[scores > 0]
    correlated = 1.0 / memory(fit)
    if scored.size < _FEWEST_INDEPENDENT * correlated:
        return 1.0
    return min(1.0, MAD_TO_SIGMA * float(np.median(scored)))


def _larger_neighbour(x: Vector) -> Vector:
    """For each element the larger of its neighbours."""
    larger: Vector = np.maximum(np.append(x[1:], 0.0), np.append(0.0, x[:-1]))
    return larger
