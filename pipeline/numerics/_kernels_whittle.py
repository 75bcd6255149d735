"""Compiled expected periodogram of an autocorrelation that is a sum of exponentials."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


@njit(cache=True)
def expected(
    omega: Float, n: int, c: Complex, p: Complex, dc: Complex, dp: Complex, f: Float, df: Float
) -> None:
    """Add the exponentials to f and their derivatives to df.

    With ``q = exp(-p - i omega)``, ``u = 1/(1 - q)``, ``r = exp(-p n)`` (q^n is r at the frequencies 2 pi k /
    n)::

        E = sum_(j<n) (1 - j/n) q^j = u - q (1 - r) u^2 / n
        f += Re[c E(p) + c* E(p*)] - Re c

    Parameters
    ----------
    omega : ndarray, shape (m,)
        Radians a sample.
    n : int
        Samples.
    c, p : complex ndarray, shape (e,)
        ``R_j = Re sum c exp(-p j)``.
    dc, dp : complex ndarray, shape (k, e)
        Derivatives by the parameters.
    f : ndarray, shape (m,)
    df : ndarray, shape (k, m)
    """
    parameters = len(df)
    for e in range(len(c)):
        for sign in (1.0, -1.0):
            a, b = p[e].real, sign * p[e].imag
            amplitude = complex(c[e].real, sign * c[e].imag)
            # 1 - exp(-a - i phi) without loss of digits where both are small
            decay, decayed = np.exp(-a), -np.expm1(-a)
            # the turn of r is that of b n, by which 1 - r is found in the same way
            half = np.sin(0.5 * b * n)
            rest = complex(-np.expm1(-a * n) + 2 * np.exp(-a * n) * half**2, np.exp(-a * n) * np.sin(b * n))
            for i in range(len(omega)):
                phi = omega[i] + b
                s, k = np.sin(0.5 * phi), np.cos(0.5 * phi)
                left = complex(decayed + 2 * decay * s * s, 2 * decay * s * k)
                u = 1 / left
                q = 1 - left
                qu = q * u
                E = u - qu * u * rest / n
                f[i] += (amplitude * E).real - 0.5 * amplitude.real
                by_log = qu * u * (2 - rest) - rest * qu * u * (1 + 2 * qu) / n
                for j in range(parameters):
                    d_amplitude = complex(dc[j, e].real, sign * dc[j, e].imag)
                    d_decay = complex(dp[j, e].real, sign * dp[j, e].imag)
                    change = d_amplitude * E - amplitude * d_decay * by_log
                    df[j, i] += change.real - 0.5 * d_amplitude.real
