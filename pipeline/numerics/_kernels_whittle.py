"""Compiled expected periodogram of an autocorrelation that is a sum of exponentials."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


@njit(cache=True)
def expected(
    sine: Float,
    cosine: Float,
    parity: Float,
    n: int,
    c: Complex,
    p: Complex,
    dc: Complex,
    dp: Complex,
    f: Float,
    df: Float,
) -> None:
    """Add the exponentials to f and their derivatives to df, of the cosine transform.

    With ``q = exp(-p - i omega)``, ``u = 1/(1 - q)``, ``r = q^n = (-1)^k exp(-p n)``::

        E = sum_(j<n) (1 - j/n) q^j = u - q (1 - r) u^2 / n
        G = sum_(j<n) q^j = u (1 - r)
        f += Re[c E(p) + c* E(p*)] - Re c + Im[c G(p) + c* G(p*)] / (n sin omega)

    Parameters
    ----------
    sine, cosine : ndarray, shape (m,)
        Of ``omega/2``, ``omega = pi k / n`` radians a sample.
    parity : ndarray, shape (m,)
        ``(-1)^k``, or its mean.
    n : int
        Samples.
    c, p : complex ndarray, shape (e,)
        ``R_j = Re sum c exp(-p j)``.
    dc, dp : complex ndarray, shape (k, e)
        Derivatives by the parameters.
    f : ndarray, shape (m,)
    df : ndarray, shape (k, m)
    """
    for e in range(len(c)):
        moved = [j for j in range(len(df)) if dc[j, e] != 0 or dp[j, e] != 0]
        for sign in (1.0, -1.0):
            a, b = p[e].real, sign * p[e].imag
            amplitude = complex(c[e].real, sign * c[e].imag)
            # 1 - exp(-a - i phi) without loss of digits where both are small
            decay, decayed = np.exp(-a), -np.expm1(-a)
            # of an even k the turn of r is that of b n, by which 1 - r is found in the same way
            half = np.sin(0.5 * b * n)
            even = complex(-np.expm1(-a * n) + 2 * np.exp(-a * n) * half**2, np.exp(-a * n) * np.sin(b * n))
            sine_b, cosine_b = np.sin(0.5 * b), np.cos(0.5 * b)
            for i in range(len(sine)):
                s, k = sine[i] * cosine_b + cosine[i] * sine_b, cosine[i] * cosine_b - sine[i] * sine_b
                real, imaginary = decayed + 2 * decay * s * s, 2 * decay * s * k  # of 1 - q
                size = 1 / (real * real + imaginary * imaginary)
                u = complex(real * size, -imaginary * size)
                qu = u - 1
                rest = 1 - parity[i] + parity[i] * even
                across = 0.5 / (n * sine[i] * cosine[i])
                E = u - qu * u * rest / n
                G = u * rest
                f[i] += (amplitude * E).real - 0.5 * amplitude.real + (amplitude * G).imag * across
                E_by_log = qu * u * (2 - rest) - rest * qu * u * (1 + 2 * qu) / n
                G_by_log = u * (qu * rest - n * (1 - rest))
                for j in moved:
                    d_amplitude = complex(dc[j, e].real, sign * dc[j, e].imag)
                    d_decay = amplitude * complex(dp[j, e].real, sign * dp[j, e].imag)
                    change = d_amplitude * E - d_decay * E_by_log
                    df[j, i] += change.real - 0.5 * d_amplitude.real
                    df[j, i] += (d_amplitude * G - d_decay * G_by_log).imag * across
