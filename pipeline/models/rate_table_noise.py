"""The standard error of a mean over a stretch of a record whose noise is coloured.

Stretches of one record share the noise: white, or white and exponentially correlated (MATH 3.1, noise 1). Of
the means of blocks of samples, with ``phi = exp(-1 / T)`` for a correlation time of T blocks, the covariance
is ``V (delta_k + R phi^|k|)`` and the variance of a mean of n of them ::

    V/n + V R [ n (1 + phi)/(1 - phi) - 2 phi (1 - phi^n)/(1 - phi)^2 ] / n^2

Each stretch has an unknown mean of its own, so the likelihood is the restricted one: with innovations e of
the data and d of a column of ones, of variance V F, from the Kalman filter of the correlated part, and ::

    Q = sum e^2/F - (sum e d/F)^2 / sum d^2/F              of each stretch
    -2 ln L = sum (n_i - 1) ln(sum Q) + sum ln F + sum ln(sum d^2/F)

V integrated out. The standard error of a mean is not that of the one most likely T and R, which from a short
record is too small as often as not, but its average over a grid of them by likelihood: most of the weight
before the data is on white noise, the rest even in ln T and in the logarithm of the coloured noise at
frequency 0 over the white. Noise slower than half the shortest stretch is not told from its mean; the scatter
between stretches tells it (`rate_table_fit`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Float = NDArray[np.float64]

_BLOCKS = 64
"""Of the shortest stretch: enough to tell the colour from."""
_TIMES = 10
"""Correlation times on the grid, from half a block to half the shortest stretch."""
_RATIOS = 10.0 ** np.arange(-1.0, 4.5, 0.5)
"""Coloured over white noise at frequency 0, on the grid: less is no matter, more is all coloured."""
_WHITE = 0.9
"""Weight of white noise before the data. With half of it the errors of white noise come out 5 % too large."""
_DIFFER = 1e-3
"""Probability, by Bartlett's test, below which the noise of the stretches is not one."""


@dataclass(frozen=True, slots=True)
class MeanNoise:
    """The noise of one channel, as it matters to means.

    Attributes
    ----------
    block : int
        Samples in a block.
    weight : ndarray, shape (g,)
        Of each noise on the grid, by the data; their sum is 1.
    white, coloured : ndarray, shape (g,)
        V and V R: variances of a block's mean.
    phi : ndarray, shape (g,)
        Correlation of neighbouring blocks by the coloured part.
    relative : ndarray, shape (m,)
        Standard deviation in each stretch over the common one: 1, unless the stretches plainly differ.
    """

    block: int
    weight: Float
    white: Float
    coloured: Float
    phi: Float
    relative: Float

    def standard_error(self, samples: int) -> float:
        """Of a mean over so many samples in a row, of ordinary noise."""
        n, phi = samples / self.block, self.phi
        gain = n * (1 + phi) / (1 - phi) - 2 * phi * (1 - phi**n) / (1 - phi) ** 2
        variance = self.white / n + self.coloured * gain / n**2
        return float(self.weight @ np.sqrt(variance))


def noise_of_means(stretches: Sequence[Float]) -> tuple[MeanNoise, ...]:
    """The noise of each channel from the stretches in which it should be constant.

    Parameters
    ----------
    stretches : sequence of ndarray, each of shape (n_i, c)
        Samples in a row, two or more; each has a mean of its own.

    Returns
    -------
    tuple of MeanNoise
        One a channel.
    """
    shortest = min(map(len, stretches))
    block = max(shortest // _BLOCKS, 1)
    blocks = [_block_means(stretch, block) for stretch in stretches]
    R, phi, prior = _grid(shortest / block)
    freedom = np.array([len(b) - 1 for b in blocks], dtype=np.float64)
    squares, determinant = _innovations(blocks, R, phi)
    noises = []
    for Q in np.moveaxis(squares, 1, 0):
        if not Q.sum(axis=0).all():  # constant in every stretch, but for rounding
            noises.append(MeanNoise(block, prior, 0 * R, 0 * R, phi, np.ones(len(blocks))))
            continue
        deviance = freedom.sum() * np.log(Q.sum(axis=0)) + determinant
        weight = prior * np.exp(-(deviance - deviance.min()) / 2)
        # the mean of V, whose inverse is gamma distributed; with two degrees of freedom or fewer it has none
        V = Q.sum(axis=0) / max(freedom.sum() - 2, 1.0)
        relative = _relative(Q[:, int(np.argmax(weight))], freedom)
        noises.append(MeanNoise(block, weight / weight.sum(), V, V * R, phi, relative))
    return tuple(noises)


def standard_errors(stretches: Sequence[Float]) -> Float:
    """Standard error of the mean of each channel in each stretch, shape (m, c)."""
    errors = [
        noise.relative * [noise.standard_error(len(stretch)) for stretch in stretches]
        for noise in noise_of_means(stretches)
    ]
    return np.stack(errors, axis=1)


def _block_means(values: Float, block: int) -> Float:
    """Means of whole blocks less that of all, shape (n, c); what is left over at the end is left out."""
    count = len(values) // block
    means = values[: count * block].reshape(count, block, -1).mean(axis=1)
    return np.asarray(means - means.mean(axis=0), dtype=np.float64)


def _grid(shortest: float) -> tuple[Float, Float, Float]:
    """R, phi and weight before the data of each noise; white noise first."""
    times = np.geomspace(0.5, max(shortest / 2, 1.0), _TIMES)
    phi, ratio = (v.ravel() for v in np.meshgrid(np.exp(-1 / times), _RATIOS))
    R = ratio * (1 - phi) / (1 + phi)
    prior = np.concatenate([[_WHITE], np.full(len(R), (1 - _WHITE) / len(R))])
    return np.concatenate([[0.0], R]), np.concatenate([[0.0], phi]), prior


def _innovations(blocks: Sequence[Float], R: Float, phi: Float) -> tuple[Float, Float]:
    """Q, shape (m, c, g), and ``sum ln F + sum ln(sum d^2/F)``, shape (g,).

    All stretches, channels and noises side by side, block after block. In units of V: the coloured part has
    the prediction x of variance P, begun at 0 and R; its innovations have the variance ``F = P + 1``, and
    ``K = P / F``. Those of a column of ones are the same in all stretches.
    """
    length = np.array([len(b) for b in blocks])
    longest = int(length.max())
    y = np.zeros((longest, len(blocks), blocks[0].shape[1], 1))
    for i, b in enumerate(blocks):
        y[: len(b), i, :, 0] = b
    x, yy, yd = (np.zeros((*y.shape[1:3], len(R))) for _ in range(3))
    level, P = np.zeros(len(R)), R.copy()
    dd, logarithm = np.zeros((longest, len(R))), np.zeros((longest, len(R)))
    for j in range(longest):
        F = P + 1
        d = 1 - level
        e = y[j] - x
        if j >= length.min():
            e[j >= length] = 0.0
        weighted = e / F
        yy += e * weighted
        yd += d * weighted
        dd[j], logarithm[j] = d**2 / F, np.log(F)
        x = phi * (x + P * weighted)
        level = phi * (level + P * d / F)
        P = phi**2 * P / F + R * (1 - phi**2)
    dd, logarithm = np.cumsum(dd, axis=0)[length - 1], np.cumsum(logarithm, axis=0)[length - 1]
    squares = np.maximum(yy - yd**2 / dd[:, np.newaxis], 0.0)
    return squares, np.asarray(np.sum(logarithm + np.log(dd), axis=0), dtype=np.float64)


def _relative(squares: Float, freedom: Float) -> Float:
    """Standard deviation of each stretch over that of all, where Bartlett's test tells that they differ."""
    alike = np.ones(len(squares))
    if len(squares) < 2 or not (squares / np.maximum(freedom, 1)).min() > 0:
        return alike
    variance, pooled = squares / freedom, float(squares.sum() / freedom.sum())
    statistic = freedom.sum() * np.log(pooled) - freedom @ np.log(variance)
    few = 1 + (np.sum(1 / freedom) - 1 / freedom.sum()) / (3 * (len(squares) - 1))
    if chi2.sf(statistic / few, len(squares) - 1) >= _DIFFER:
        return alike
    return np.asarray(np.sqrt(variance / pooled), dtype=np.float64)
