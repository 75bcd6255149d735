"""The vibration in a record: its columns in a regression, and its fundamental frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from pipeline.numerics.harmonic import HarmonicError, fit_harmonic

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_SURROUNDINGS = 65
"""Spectral lines whose median is the floor that a line must stand out of."""
_PROMINENCE = 25.0
"""Power over that floor; noise reaches it once in 2**25 = 3e7 lines."""
_ROUNDING = 1e-14
"""Amplitude of a line, over the angle's size, that rounding may make."""
_FEWEST_PERIODS = 3
"""Slower motion cannot be told from a trend."""


def harmonic_design(t: Vector, frequency: float | None, harmonics: int) -> Matrix:
    """Columns 1, t, cos kwt, sin kwt (k = 1 … harmonics; none where frequency is None): (n, 2 + 2 K)."""
    columns = [np.ones_like(t), t]
    if frequency is not None:
        for k in range(1, harmonics + 1):
            phase = 2 * np.pi * k * frequency * t
            columns += [np.cos(phase), np.sin(phase)]
    return np.column_stack(columns)


def fundamental(y: Vector, step: float, harmonics: int = 1) -> float | None:
    """Frequency of the strongest spectral line, refined by variable projection.

    Parameters
    ----------
    y : (n,) array
        Uniform samples.
    step : float
        Sampling step, s.
    harmonics : int
        Harmonics fitted together in the refinement; those at or above Nyquist are left out of it.

    Returns
    -------
    float or None
        Hz; None where no line of at least three periods stands 25 times above the median power of its
        surroundings (measured on the derivative, so that a random walk makes no line).

    Notes
    -----
    The line is sought in the Hann-windowed spectrum. A line within one line width of the Nyquist frequency
    cannot be refined and is given as the spectrum has it.
    """
    n = y.size
    if n < 4 * _FEWEST_PERIODS:
        return None
    t: Vector = np.arange(n, dtype=np.float64) * step
    line = np.polynomial.Polynomial.fit(t, y, 1)
    power = np.abs(np.fft.rfft((y - line(t)) * np.hanning(n))) ** 2
    bins = np.arange(power.size)
    derivative = power * bins.astype(np.float64) ** 2
    floor = median_filter(derivative, size=min(_SURROUNDINGS, power.size), mode="reflect")
    stands_out = (derivative > _PROMINENCE * floor) & (bins >= _FEWEST_PERIODS)
    rounding = (_ROUNDING * np.max(np.abs(y)) * n) ** 2
    stands_out &= power > rounding
    if not stands_out.any():
        return None
    peak = int(np.argmax(np.where(stands_out, power, -1.0)))
    return _refine(t, y, peak / (n * step), harmonics)


def _refine(t: Vector, y: Vector, peak: float, harmonics: int) -> float:
    """The frequency of least residual near the peak; the peak itself where the samples cannot refine it."""
    line_width = 1 / (t[-1] + t[1])
    nyquist = 0.5 / t[1]
    fitted = max(1, min(harmonics, int(np.ceil((nyquist - line_width) / peak)) - 1))
    try:
        fit = fit_harmonic(t, y[:, np.newaxis], fitted, frequency=peak, with_slope=True)
    except HarmonicError:  # at the Nyquist frequency
        return peak
    refined = fit.model.omega / (2 * np.pi)
    return refined if abs(refined - peak) < line_width else peak
