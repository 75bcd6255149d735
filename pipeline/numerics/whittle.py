"""The debiased Whittle likelihood of a random process, in the cosine transform, and its maximum.

Sykulski, Olhede, Guillaumin, Lilly & Early, *Biometrika* 106 (2019) 251-266; with gaps Guillaumin, Sykulski,
Olhede & Simons, *J. R. Stat. Soc. B* 84 (2022) 1526-1557. The squares I of a transform are held against their
expected value f, not against the spectral density, so that neither leakage nor aliasing nor the record's end
biases the parameters. The transform is the cosine one of `pipeline.numerics.cosine_spectrum`::

    theta_k = pi k / n,   k = 1 ... n - 1
    f_k = E I_k = sum_(|m|<n) R_m [(1 - |m|/n) cos(m theta_k) - sin(|m| theta_k) / (n sin theta_k)]
    -2 ln L = sum over the n - 1 ordinates of ln f + I/f

In a periodogram (of Fourier's transform) a random walk has its ends in every ordinate. Here it is diagonal:
with ``x_j = sum_(i<=j) e_i`` the precision of the deviations from the mean is D^T D/q, D the first
differences, whose eigenvectors are those cosines. With ``var e = q``::

    f_k = q / (4 sin^2(theta_k / 2))

is exact, the ordinates are independent, and of white noise with a random walk the likelihood is that of the
samples themselves. White noise differenced, ``x_j = v_(j+1) - v_j``, has ``f_k = 4 v^2 [sin^2(theta_k/2) +
cos^2(theta_k/2)/n]``. For ``R_m = Re sum c exp(-p m)`` there is a closed form at each ordinate by itself.
A bin of m ordinates has a gamma distribution of mean f and counts m times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.special import chdtrc, gammainc, gammaincc, ndtri

from pipeline.numerics import _kernels_whittle as kernels
from pipeline.numerics.cosine_spectrum import Periodogram

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

_STEPS, _LONGEST_STEP, _SMALL_DECREASE = 60, 1.5, 1e-5


@dataclass(frozen=True, slots=True)
class Process:
    """A process, and its derivatives by k parameters.

    Attributes
    ----------
    levels : ndarray, shape (3,)
        Of `LEVELS`.
    c, p : complex ndarray, shape (e,)
        Of what is stationary besides: ``R_j = Re sum c exp(-p j)``.
    d_levels : ndarray, shape (k, 3)
    d_c, d_p : complex ndarray, shape (k, e)
    """

    levels: Float
    c: Complex
    p: Complex
    d_levels: Float
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


def expected(spectrum: Periodogram, model: Process) -> tuple[Float, Float]:
    """The expected periodogram and its derivatives.

    Parameters
    ----------
    spectrum : Periodogram
    model : Process
        e exponentials, k parameters; without a walk where the spectrum has none.

    Returns
    -------
    f : ndarray, shape (m,)
    df : ndarray, shape (k, m)
    """
    levels = spectrum.levels()
    f, df = model.levels @ levels, model.d_levels @ levels
    if spectrum.window is None:
        sine, cosine, begin = np.sin(0.5 * spectrum.omega), np.cos(0.5 * spectrum.omega), 0
        c, p, d_c, d_p = model.c, model.p, model.d_c, model.d_p
        for n, bins in spectrum.runs:
            rows = slice(begin, begin + bins)
            parity = spectrum.parity[rows]
            kernels.expected(sine[rows], cosine[rows], parity, n, c, p, d_c, d_p, f[rows], df[:, rows])
            begin += bins
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
    """``sum over the ordinates of ln f + I/f``."""
    return float(spectrum.count @ (np.log(f) + spectrum.value / f))


def information(spectrum: Periodogram, model: Process) -> Float:
    """Whittle's Fisher matrix, half the sum of ``(d ln f)(d ln f)^T`` over the frequencies, shape (k, k)."""
    return _fisher(spectrum, *expected(spectrum, model))


def fit(
    spectrum: Periodogram,
    model: Callable[[Float], Process],
    starts: Sequence[Float],
    lower: Float,
    upper: Float,
) -> Fit:
    """The greatest likelihood within bounds: Fisher's scoring, damped, from several starts.

    Parameters
    ----------
    spectrum : Periodogram
    model : callable
        The process at parameters theta, of shape (k,). Parameters are logarithms, or of like size.
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
    # Bands of ordinates 1 to 3, 4 to 7, 8 to 15 ... of the longest run, and what others have there
    ordinate = spectrum.omega / spectrum.omega.min()
    band = np.maximum(np.log2(ordinate + 1e-6).astype(np.intp), 1)
    m = 0.5 * np.bincount(band, spectrum.count)
    total = 0.5 * np.bincount(band, spectrum.count * spectrum.value / f)[m > 0]
    m = m[m > 0]
    below, above = gammainc(m, total), gammaincc(m, total)
    z = np.where(below < above, ndtri(below), -ndtri(above))
    statistic = float(z @ z)
    return statistic, float(chdtrc(max(len(z) - parameters, 1), statistic))


def _transformed(spectrum: Periodogram, product: Float) -> Float:
    """``sum over |j| < n of product_|j| exp(-i omega_k j)``, averaged over the bins."""
    ordinates = 2 * rfft(product).real[1:] - product[0]
    if len(spectrum.first) == len(ordinates):
        return np.asarray(ordinates, dtype=np.float64)
    size = np.diff(np.append(spectrum.first, len(ordinates)))
    return np.asarray(np.add.reduceat(ordinates, spectrum.first) / size, dtype=np.float64)


def _climb(
    spectrum: Periodogram, model: Callable[[Float], Process], theta: Float, lower: Float, upper: Float
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
