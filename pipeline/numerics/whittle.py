"""The debiased Whittle likelihood of a stationary process, and its maximum.

Sykulski, Olhede, Guillaumin, Lilly & Early, *Biometrika* 106 (2019) 251-266; with gaps Guillaumin, Sykulski,
Olhede & Simons, *J. R. Stat. Soc. B* 84 (2022) 1526-1557. The periodogram I is held against its expected
value f, not against the spectral density, so that neither leakage nor aliasing nor the record's end biases
the parameters::

    I_k = |sum_j x_j exp(-i omega_k j)|^2 / n,   omega_k = 2 pi k / n
    f_k = E I_k = sum_(|j|<n) (1 - |j|/n) R_j exp(-i omega_k j)
    -2 ln L = sum over the n - 1 non-zero frequencies of ln f + I/f

For ``R_j = white delta_j + Re sum c exp(-p j)`` f has a closed form at each frequency by itself. Of a long
record the ordinates above the first `SINGLE` are therefore averaged over bins of a relative width of
1/`BINS_AN_E_FOLD`, within which f is constant for any line wider than that: a bin of m ordinates has a gamma
distribution of mean f and counts m times. A sample of observed rows only (gaps) has ``f_k = sum g_j R_j
exp(-i omega_k j)`` with g the autocorrelation of the mask, by FFT; a longer one is cut into blocks whose
periodograms and masks' autocorrelations are averaged. Its ordinates are as many as those of the whole grid,
but not independent: each counts for the observed share.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, prev_fast_len, rfft
from scipy.special import chdtrc, gammainc, gammaincc, ndtri

from pipeline.numerics import _kernels_whittle as kernels

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

SINGLE = 16384
"""Lowest ordinates that are never averaged."""
BINS_AN_E_FOLD = 1000
"""Bins in a factor e of frequency."""
LONGEST_BLOCK = 2**19
"""Rows of a block where there are gaps: the expected values need FFTs of it."""
_TRIMMED = 2**17
"""Rows from which a record is cut to a length of quick FFT; that costs less than 1 percent of them."""
_STEPS, _LONGEST_STEP, _SMALL_DECREASE = 60, 1.5, 1e-7


@dataclass(frozen=True, slots=True)
class Periodogram:
    """The averaged periodogram of a record.

    Attributes
    ----------
    omega : ndarray, shape (m,)
        Mean angular frequency of each bin, radians a sample.
    value : ndarray, shape (m,)
        Mean of I over each bin.
    count : ndarray, shape (m,)
        Ordinates of the full circle in each bin, times the observed share; together the samples, less one.
    samples : int
        Observed samples.
    length : int
        n of the transform.
    window : ndarray, shape (length,), or None
        ``g_j`` of the mask; None for ``1 - j/n``, without gaps.
    first : int ndarray, shape (m,)
        First ordinate of each bin, from 0 for the lowest non-zero frequency.
    """

    omega: Float
    value: Float
    count: Float
    samples: int
    length: int
    window: Float | None
    first: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Exponentials:
    """An autocorrelation ``R_j = white delta_j + Re sum c exp(-p j)``, and its derivatives by k parameters.

    Attributes
    ----------
    white : float
    c, p : complex ndarray, shape (e,)
    d_white : ndarray, shape (k,)
    d_c, d_p : complex ndarray, shape (k, e)
    """

    white: float
    c: Complex
    p: Complex
    d_white: Float
    d_c: Complex
    d_p: Complex


@dataclass(frozen=True, slots=True)
class Fit:
    """The parameters of the greatest likelihood.

    Attributes
    ----------
    theta : ndarray, shape (k,)
    information : ndarray, shape (k, k)
        Whittle's Fisher matrix there.
    value : float
        -2 ln L.
    converged : bool
    """

    theta: Float
    information: Float
    value: float
    converged: bool


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
        Of the first rows up to a length of quick FFT where there are many.
    """
    if observed is not None and not observed.all():
        return _with_gaps(x, observed)
    n = int(prev_fast_len(len(x), real=True)) if len(x) > _TRIMMED else len(x)
    centred = x[:n] - np.mean(x[:n])
    transform = rfft(centred, overwrite_x=True)[1:]
    ordinates = (transform.real**2 + transform.imag**2) / n
    return _binned(ordinates, n, n, None)


def grid(n: int) -> Periodogram:
    """The frequencies of a record of n samples without gaps, I being 0: for `expected` and `information`."""
    return _binned(np.zeros(n // 2), n, n, None)


def expected(spectrum: Periodogram, model: Exponentials) -> tuple[Float, Float]:
    """The expected periodogram and its derivatives.

    Parameters
    ----------
    spectrum : Periodogram
    model : Exponentials
        e exponentials, k parameters.

    Returns
    -------
    f : ndarray, shape (m,)
    df : ndarray, shape (k, m)
    """
    share = 1.0 if spectrum.window is None else float(spectrum.window[0])
    f = np.full(len(spectrum.omega), share * model.white)
    df = np.repeat(share * model.d_white[:, np.newaxis], len(f), axis=1)
    if spectrum.window is None:
        kernels.expected(spectrum.omega, spectrum.length, model.c, model.p, model.d_c, model.d_p, f, df)
        return f, df
    j = np.arange(spectrum.length, dtype=np.float64)
    for c, p, d_c, d_p in zip(model.c, model.p, model.d_c.T, model.d_p.T, strict=True):
        falling = spectrum.window * np.exp(-p * j)
        f += _transformed(spectrum, (c * falling).real)
        for k, (a, b) in enumerate(zip(d_c, d_p, strict=True)):
            if a != 0 or b != 0:
                df[k] += _transformed(spectrum, ((a - c * b * j) * falling).real)
    return f, df


def minus_two_log_likelihood(spectrum: Periodogram, f: Float) -> float:
    """``sum over the non-zero frequencies of ln f + I/f``."""
    return float(spectrum.count @ (np.log(f) + spectrum.value / f))


def information(spectrum: Periodogram, model: Exponentials) -> Float:
    """Whittle's Fisher matrix, half the sum of ``(d ln f)(d ln f)^T`` over the frequencies, shape (k, k)."""
    return _fisher(spectrum, *expected(spectrum, model))


def fit(
    spectrum: Periodogram,
    model: Callable[[Float], Exponentials],
    starts: Sequence[Float],
    lower: Float,
    upper: Float,
) -> Fit:
    """The greatest likelihood within bounds: Fisher's scoring, damped, from several starts.

    Parameters
    ----------
    spectrum : Periodogram
    model : callable
        The autocorrelation at parameters theta, of shape (k,). Parameters are logarithms, or of like size.
    starts : sequence of ndarray, each of shape (k,)
    lower, upper : ndarray, shape (k,)

    Returns
    -------
    Fit
        The best of those that converged, or the best of all.
    """
    fits = [_climb(spectrum, model, np.clip(start, lower, upper), lower, upper) for start in starts]
    return min(fits, key=lambda one: one.value)


def band_whiteness(spectrum: Periodogram, f: Float, parameters: int) -> tuple[float, float]:
    """Test whether ``I/f`` is that of white noise, in bands that double in width.

    In a band of m independent ordinates ``m mean(I/f)`` has a gamma distribution; the sum of ``z^2`` over the
    bands, z the normal deviate of its probability, has a chi-square distribution with as many degrees of
    freedom as there are bands, less the parameters that were fitted.

    Parameters
    ----------
    spectrum : Periodogram
    f : ndarray, shape (m,)
        The expected values.
    parameters : int
        That were fitted.

    Returns
    -------
    statistic, p_value : float
    """
    # Bands of ordinates 1 to 3, 4 to 7, 8 to 15 ...
    band = np.maximum(np.log2(spectrum.first + 1.0).astype(np.intp), 1)
    _, start = np.unique(band, return_index=True)
    m = 0.5 * np.add.reduceat(spectrum.count, start)
    total = 0.5 * np.add.reduceat(spectrum.count * spectrum.value / f, start)
    below, above = gammainc(m, total), gammaincc(m, total)
    z = np.where(below < above, ndtri(below), -ndtri(above))
    statistic = float(z @ z)
    return statistic, float(chdtrc(max(len(z) - parameters, 1), statistic))


def _with_gaps(x: Float, observed: Mask) -> Periodogram:
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
    return _binned(ordinates, n, samples, window)


def _binned(ordinates: Float, n: int, samples: int, window: Float | None) -> Periodogram:
    """Average the n // 2 ordinates of the half circle above the first `SINGLE`."""
    half = len(ordinates)
    multiplicity = np.full(half, 2.0)
    if n % 2 == 0:
        multiplicity[-1] = 1.0  # Nyquist's frequency is there once
    first = _bins(half)
    weight = np.add.reduceat(multiplicity, first)
    omega = 2 * np.pi / n * np.arange(1, half + 1)
    mean_omega = np.add.reduceat(multiplicity * omega, first) / weight
    value = np.add.reduceat(multiplicity * ordinates, first) / weight
    count = weight * ((samples - 1) / (n - 1))
    return Periodogram(mean_omega, value, count, samples, n, window, first)


def _bins(half: int) -> NDArray[np.intp]:
    """First ordinate of each bin."""
    single = np.arange(min(half, SINGLE))
    if half <= SINGLE:
        return single
    steps = int(np.log(half / SINGLE) * BINS_AN_E_FOLD) + 1
    wide = np.unique((SINGLE * np.exp(np.arange(steps) / BINS_AN_E_FOLD)).astype(np.intp))
    return np.concatenate([single, wide[wide < half]])


def _transformed(spectrum: Periodogram, product: Float) -> Float:
    """``sum over |j| < n of product_|j| exp(-i omega_k j)``, averaged over the bins."""
    ordinates = 2 * rfft(product).real[1:] - product[0]
    if len(spectrum.first) == len(ordinates):
        return np.asarray(ordinates, dtype=np.float64)
    size = np.diff(np.append(spectrum.first, len(ordinates)))
    return np.asarray(np.add.reduceat(ordinates, spectrum.first) / size, dtype=np.float64)


def _climb(
    spectrum: Periodogram, model: Callable[[Float], Exponentials], theta: Float, lower: Float, upper: Float
) -> Fit:
    f, df = expected(spectrum, model(theta))
    value, damping = minus_two_log_likelihood(spectrum, f), 1e-3
    for _ in range(_STEPS):
        slope = df / f
        gradient = slope @ (spectrum.count * (1 - spectrum.value / f))
        H = (spectrum.count * slope) @ slope.T
        # At a bound, and drawn beyond it, a parameter stays
        free = ~(((theta <= lower) & (gradient > 0)) | ((theta >= upper) & (gradient < 0)))
        accepted = False
        while free.any() and damping < 1e8:
            step = np.zeros(len(theta))
            A = H[np.ix_(free, free)]
            ridge = damping * np.diag(A) + 1e-12 * np.trace(A)
            step[free] = -np.linalg.solve(A + np.diag(ridge), gradient[free])
            longest = float(np.abs(step).max())
            trial = np.clip(theta + step * min(1.0, _LONGEST_STEP / max(longest, 1e-300)), lower, upper)
            f_trial, df_trial = expected(spectrum, model(trial))
            lowered = value - minus_two_log_likelihood(spectrum, f_trial) if f_trial.min() > 0 else -np.inf
            if lowered >= 0:
                accepted, damping = True, max(0.2 * damping, 1e-9)
                break
            damping *= 8
        if not accepted:
            break
        theta, f, df, value = trial, f_trial, df_trial, value - lowered
        if lowered < _SMALL_DECREASE:
            break
    else:
        return Fit(theta, _fisher(spectrum, f, df), value, False)
    return Fit(theta, _fisher(spectrum, f, df), value, True)


def _fisher(spectrum: Periodogram, f: Float, df: Float) -> Float:
    slope = df / f
    matrix: Float = 0.5 * (spectrum.count * slope) @ slope.T
    return matrix
