"""The squares of a record's cosine transform, through gaps: what the Whittle likelihood is of.

The transform is the orthonormal one (DCT-II) of the deviations from the mean::

    I_k = (sqrt(2/n) sum_j x_j cos(theta_k (j + 1/2)))^2,   theta_k = pi k / n,   k = 1 ... n - 1

It continues the record evenly, without a jump at its ends. The I sum up to the squared deviations. Of a long
record those above the first `SINGLE` are averaged over bins of a relative width of 1/`BINS_AN_E_FOLD`, within
which any line wider than that is constant.

*Gaps.* Where up to `MOST_RUNS` runs without a gap hold nearly all samples, each is transformed by itself,
about its own mean: what the levels of the runs tell beside each other is not used. Where gaps are so dense
that they do not, I is the (Fourier) periodogram of the observed rows, ``f_k = sum g_j R_j exp(-i omega_k
j)`` with g the autocorrelation of the mask, by FFT; a longer one is cut into blocks whose periodograms and
masks' autocorrelations are averaged. Its ordinates are as many as those of the whole grid, but not
independent: each counts for the observed share. A random walk has no such f: `Periodogram.walks`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, irfft, next_fast_len, prev_fast_len, rfft

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

SINGLE = 2048
"""Lowest ordinates that are never averaged, of all runs together."""
BINS_AN_E_FOLD = 1000
"""Bins in a factor e of frequency."""
MOST_RUNS = 64
"""Runs that are transformed each by itself."""
LONGEST_BLOCK = 2**19
"""Rows of a block where gaps are dense: the expected values need FFTs of it."""
LEVELS = ("white", "walk", "difference")
"""Processes of one parameter, the level: the variance of white noise, of a random walk's increments, and of
the white noise whose differences they are."""
_SHORTEST_RUN = 64
_OF_SAMPLES = 0.9
"""Part of the samples that the runs must hold."""
_FEWEST_SINGLE, _FEWEST_BINS = 64, 200
"""Of each of many runs."""
_TRIMMED = 2**17
"""Rows from which a run is cut to a length of quick FFT; that costs less than 1 percent of them."""


@dataclass(frozen=True, slots=True)
class Periodogram:
    """The averaged squares of a record's transform.

    Attributes
    ----------
    omega : ndarray, shape (m,)
        Mean angular frequency of each bin, radians a sample. Of several runs one after the other.
    value : ndarray, shape (m,)
        Mean of I over each bin.
    count : ndarray, shape (m,)
        Squares of independent normal deviates in each bin, times the observed share where there is a window;
        together the samples, less one of each run.
    samples : int
        That counted.
    length : int
        n of the longest transform.
    runs : tuple of (int, int)
        Of each run n, and its number of bins; none where there is a window.
    parity : ndarray, shape (m,)
        Mean of (-1)^k over each bin.
    window : ndarray, shape (length,), or None
        ``g_j`` of the mask where gaps are dense.
    first : int ndarray, shape (m,)
        First ordinate of each bin, from 0 for the lowest.
    """

    omega: Float
    value: Float
    count: Float
    samples: int
    length: int
    runs: tuple[tuple[int, int], ...]
    parity: Float
    window: Float | None
    first: NDArray[np.intp]

    @property
    def walks(self) -> bool:
        """Whether a random walk has an expected value here."""
        return self.window is None

    @property
    def share(self) -> float:
        """Expected value of white noise of variance 1."""
        return 1.0 if self.window is None else float(self.window[0])

    def levels(self) -> Float:
        """Expected values of a unit level of each of `LEVELS`, shape (3, m); of a walk 0 if it has none."""
        sine = np.sin(0.5 * self.omega) ** 2
        if self.window is not None:
            difference = 2 * (self.window[0] - self.window[1] * (1 - 2 * sine))
            return np.stack([np.full_like(sine, self.share), np.zeros_like(sine), difference])
        n = np.repeat([float(n) for n, _ in self.runs], [bins for _, bins in self.runs])
        return np.stack([np.ones_like(sine), 0.25 / sine, 4 * (sine + (1 - sine) / n)])


def periodogram(x: Float, observed: Mask | None = None) -> Periodogram:
    """The periodogram of a record about its mean.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Evenly sampled; anything where not observed.
    observed : ndarray of bool, shape (n,), optional
        False in gaps.

    Returns
    -------
    Periodogram
        Of each long run the first rows up to a length of quick FFT.
    """
    runs = [slice(0, len(x))] if observed is None or observed.all() else _runs(observed)
    if not runs and observed is not None:
        return _with_dense_gaps(x, observed)
    single = max(SINGLE // len(runs), min(_FEWEST_SINGLE, SINGLE))
    a_fold = max(BINS_AN_E_FOLD // len(runs), min(_FEWEST_BINS, BINS_AN_E_FOLD))
    parts = [_cosine(x[rows], single, a_fold) for rows in runs]
    if len(parts) == 1:
        return parts[0]
    return Periodogram(
        np.concatenate([one.omega for one in parts]),
        np.concatenate([one.value for one in parts]),
        np.concatenate([one.count for one in parts]),
        sum(one.samples for one in parts),
        max(one.length for one in parts),
        tuple(run for one in parts for run in one.runs),
        np.concatenate([one.parity for one in parts]),
        None,
        np.concatenate([one.first for one in parts]),
    )


def grid(n: int) -> Periodogram:
    """The frequencies of a record of n samples without gaps, I being 0: for `expected` and `information`."""
    return _of_ordinates(np.zeros(n - 1), n, SINGLE, BINS_AN_E_FOLD)


def _runs(observed: Mask) -> list[slice]:
    """The longest runs without a gap, in order; none where gaps are dense."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], observed, [False]])))
    begin, end = edges[::2], edges[1::2]
    length = end - begin
    longest = np.sort(np.argsort(length, kind="stable")[::-1][:MOST_RUNS])
    kept = longest[length[longest] >= _SHORTEST_RUN]
    if length[kept].sum() < _OF_SAMPLES * length.sum():
        return []
    return [slice(int(begin[k]), int(end[k])) for k in kept]


def _cosine(x: Float, single: int, a_fold: int) -> Periodogram:
    """Of a run without gaps."""
    n = int(prev_fast_len(len(x), real=True)) if len(x) > _TRIMMED else len(x)
    transform = dct(x[:n] - np.mean(x[:n]), norm="ortho", overwrite_x=True)[1:]
    return _of_ordinates(transform**2, n, single, a_fold)


def _of_ordinates(ordinates: Float, n: int, single: int, a_fold: int) -> Periodogram:
    """Average the n - 1 ordinates above the first."""
    first = _bins(n - 1, single, a_fold)
    count = np.diff(np.append(first, n - 1)).astype(np.float64)
    middle = first + 0.5 * (count + 1)  # k of an ordinate is one more than its place
    parity = np.where(count % 2 == 1, 1.0 - 2.0 * ((first + 1) % 2), 0.0) / count
    value = np.add.reduceat(ordinates, first) / count
    return Periodogram(np.pi / n * middle, value, count, n, n, ((n, len(first)),), parity, None, first)


def _with_dense_gaps(x: Float, observed: Mask) -> Periodogram:
    """The periodogram of the observed rows, averaged over blocks where the record is long."""
    blocks = -(-len(x) // LONGEST_BLOCK)
    n = int(next_fast_len(-(-len(x) // blocks), real=True))
    there = np.zeros(blocks * n)
    there[: len(x)] = observed
    centred = np.zeros(blocks * n)
    centred[: len(x)][observed] = x[observed] - np.mean(x[observed])
    ordinates, window = np.zeros(n // 2), np.zeros(n)
    for rows in range(0, blocks * n, n):
        transform = rfft(centred[rows : rows + n])[1:]
        ordinates += (transform.real**2 + transform.imag**2) / (n * blocks)
        padded = rfft(there[rows : rows + n], next_fast_len(2 * n, real=True))
        correlation = irfft(padded.real**2 + padded.imag**2, next_fast_len(2 * n, real=True))
        window += correlation[:n] / (n * blocks)
    samples = int(np.count_nonzero(observed))
    multiplicity = np.full(n // 2, 2.0)
    if n % 2 == 0:
        multiplicity[-1] = 1.0  # Nyquist's frequency is there once
    first = _bins(n // 2, SINGLE, BINS_AN_E_FOLD)
    weight = np.add.reduceat(multiplicity, first)
    omega = 2 * np.pi / n * np.add.reduceat(multiplicity * np.arange(1, n // 2 + 1), first) / weight
    value = np.add.reduceat(multiplicity * ordinates, first) / weight
    count = weight * ((samples - 1) / (n - 1))
    return Periodogram(omega, value, count, samples, n, (), np.zeros_like(omega), window, first)


def _bins(ordinates: int, single: int, a_fold: int) -> NDArray[np.intp]:
    """First ordinate of each bin."""
    lowest = np.arange(min(ordinates, single))
    if ordinates <= single:
        return lowest
    steps = int(np.log(ordinates / single) * a_fold) + 1
    wide = np.unique((single * np.exp(np.arange(steps) / a_fold)).astype(np.intp))
    return np.concatenate([lowest, wide[wide < ordinates]])
