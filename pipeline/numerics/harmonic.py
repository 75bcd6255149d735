"""Harmonic model of a vibration: one frequency and its multiples, common to all channels.

The angular rates of a vibration stand are a few sinusoids::

    x(t) = c0 + Σ_k a_k cos kωt + b_k sin kωt,    k = 1 … K

For a given ω this is linear least squares; ω itself is found by variable projection (Golub & Pereyra, SIAM
J. Numer. Anal. 10, 1973, with Kaufman's simplification, BIT 15, 1975): with Φ(ω) the columns, C the
coefficients, D = dΦ/dω and R = (I - ΦΦ⁺) Y what the model leaves, the Gauss-Newton step is

    δω = <(I - ΦΦ⁺) D C, R> / |(I - ΦΦ⁺) D C|²

started from the highest peak of the spectrum. Samples at f_s tell the harmonic k from its aliases only for
k f < f_s/2; by one line width 1/T of the record, beyond which the two are alike. Others are refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_LEAST_PERIODS = 2.0
"""Periods that a record must hold: with fewer the sinusoid is not told from a trend."""

_ITERATIONS = 50


class HarmonicError(ValueError):
    """The harmonic model cannot be determined from the samples."""

    def __init__(self, expected: str, found: str, remedy: str) -> None:
        self.expected, self.found, self.remedy = expected, found, remedy
        super().__init__(f"expected {expected}, found {found}; {remedy}")


@dataclass(frozen=True, slots=True)
class Harmonic:
    """``x(t) = constant + Σ_k cosine_k cos kωt + sine_k sin kωt``.

    Attributes
    ----------
    omega : float
        Fundamental [rad/s].
    constant : ndarray, shape (channels,)
    cosine, sine : ndarray, shape (K, channels)
    """

    omega: float
    constant: Float
    cosine: Float
    sine: Float

    def sample(self, times: Float) -> tuple[Float, Float]:
        """Values, and exact integrals from each time to the next: see `pipeline.numerics.piecewise`."""
        values = np.tile(self.constant, (len(times), 1))
        increments = np.zeros_like(values)
        step, middle = np.diff(times)[:, np.newaxis], (times[1:] + times[:-1]) / 2
        increments[1:] = self.constant * step
        for k, (a, b) in enumerate(zip(self.cosine, self.sine, strict=True), start=1):
            w = k * self.omega
            values += _turn(w * times, a, b)
            # ∫ cos wt over a step = 2 sin(w h/2)/w cos(w t_mid): no difference of nearly equal numbers.
            increments[1:] += 2 / w * np.sin(w * step / 2) * _turn(w * middle, a, b)
        return values, increments

    def derivative(self, slope: Float) -> Harmonic:
        """The derivative by time of ``slope t`` plus this."""
        w = self.omega * np.arange(1, len(self.cosine) + 1)[:, np.newaxis]
        return Harmonic(self.omega, slope, w * self.sine, -w * self.cosine)


@dataclass(frozen=True, slots=True)
class HarmonicFit:
    """A fitted model: ``slope t`` (zero where none was asked for) plus the sinusoids, and what they leave.

    ``slope`` has shape (channels,), in the unit of y per second; ``residual`` is (n, channels), as y.
    """

    model: Harmonic
    slope: Float
    residual: Float


def fit_harmonic(
    t: Float, y: Float, harmonics: int, *, frequency: float | None = None, with_slope: bool = False
) -> HarmonicFit:
    """Fit the model by separable least squares.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Strictly ascending times [s], uniform or not.
    y : ndarray, shape (n, channels)
    harmonics : int
        K.
    frequency : float, optional
        Where the search begins [Hz]; by default at the spectrum's highest peak.
    with_slope : bool
        Add a term linear in time (for angles, whose rate has a constant part).

    Raises
    ------
    HarmonicError
        If there is no vibration, fewer than two periods, a harmonic beyond half the sampling frequency,
        or no convergence.
    """
    middle = (t[0] + t[-1]) / 2
    basis = _Basis(t - middle, harmonics, with_slope)
    start = 2 * np.pi * frequency if frequency is not None else _spectral_peak(t, y, with_slope)
    _require_distinct(start, t, harmonics)
    omega = _refine(start, basis, y)
    _require_distinct(omega, t, harmonics)
    columns = basis.columns(omega)
    coefficients = np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0], dtype=np.float64)
    return _from_centred(coefficients, basis, omega, middle, y - columns @ coefficients)


@dataclass(frozen=True, slots=True)
class _Basis:
    """Columns 1, [t], cos ωt, sin ωt, cos 2ωt … at times from the record's middle."""

    t: Float
    harmonics: int
    with_slope: bool

    @property
    def smooth(self) -> int:
        return 2 if self.with_slope else 1

    def columns(self, omega: float) -> Float:
        columns = np.empty((len(self.t), self.smooth + 2 * self.harmonics))
        columns[:, 0] = 1.0
        if self.with_slope:
            columns[:, 1] = self.t
        for k in range(1, self.harmonics + 1):
            phase = k * omega * self.t
            columns[:, self.smooth + 2 * k - 2] = np.cos(phase)
            columns[:, self.smooth + 2 * k - 1] = np.sin(phase)
        return columns

    def by_omega(self, columns: Float) -> Float:
        """The derivative of the columns by ω."""
        derivative = np.zeros_like(columns)
        for k in range(1, self.harmonics + 1):
            c, s = self.smooth + 2 * k - 2, self.smooth + 2 * k - 1
            derivative[:, c] = -k * self.t * columns[:, s]
            derivative[:, s] = k * self.t * columns[:, c]
        return derivative


def _refine(omega: float, basis: _Basis, y: Float) -> float:
    """Gauss-Newton on the projected problem until ω moves the phase at the ends by rounding only."""
    half = float(basis.t[-1])
    for _ in range(_ITERATIONS):
        columns = basis.columns(omega)
        orthonormal, triangle = np.linalg.qr(columns)
        coefficients = np.linalg.solve(triangle, orthonormal.T @ y)
        residual = y - columns @ coefficients
        change = basis.by_omega(columns) @ coefficients
        change -= orthonormal @ (orthonormal.T @ change)
        scale = float(np.sum(change * change))
        if scale == 0.0:
            break
        # A step of more than a quarter turn at the ends would leave the valley of the peak.
        step = float(np.clip(np.sum(change * residual) / scale, -np.pi / 2 / half, np.pi / 2 / half))
        omega += step
        if abs(step) * half < 1e-13 * max(1.0, omega * half):
            return omega
    raise HarmonicError(
        "a vibration whose frequency the samples determine",
        f"no convergence near {omega / (2 * np.pi):.6g} Hz",
        "state its frequency, or choose method = 'spline'",
    )


def _spectral_peak(t: Float, y: Float, with_slope: bool) -> float:
    """Angular frequency of the highest peak of the channels' summed power, Hann window."""
    n = len(t)
    grid = np.linspace(t[0], t[-1], n)
    smooth = np.stack([np.ones(n), grid - grid.mean()][: 2 if with_slope else 1], axis=1)
    even = np.stack([np.interp(grid, t, channel) for channel in y.T], axis=1)
    even -= smooth @ np.linalg.lstsq(smooth, even, rcond=None)[0]
    if not np.any(np.abs(even) > 1e-12 * np.max(np.abs(y), initial=np.finfo(np.float64).tiny)):
        raise HarmonicError(
            "a vibration",
            "constant rates",
            "choose another method, such as 'local_polynomial'",
        )
    power = np.sum(np.abs(np.fft.rfft(even * np.hanning(n)[:, np.newaxis], axis=0)) ** 2, axis=1)
    peak = int(np.argmax(power[1:-1])) + 1
    low, top, high = np.log(np.maximum(power[peak - 1 : peak + 2], np.finfo(np.float64).tiny))
    curvature = low - 2 * top + high
    offset = (low - high) / (2 * curvature) if curvature < 0 else 0.0
    return float(2 * np.pi * (peak + offset) * (n - 1) / (n * (t[-1] - t[0])))


def _require_distinct(omega: float, t: Float, harmonics: int) -> None:
    duration = float(t[-1] - t[0])
    frequency = omega / (2 * np.pi)
    nyquist = 1 / (2 * float(np.median(np.diff(t))))
    if frequency * duration < _LEAST_PERIODS:
        raise HarmonicError(
            f"at least {_LEAST_PERIODS:g} periods of the vibration",
            f"{frequency * duration:.2g} ({frequency:.6g} Hz over {duration:.6g} s)",
            "state the frequency of the vibration, or choose another method",
        )
    if harmonics * frequency >= nyquist - 1 / duration:
        most = max(0, int(np.ceil((nyquist - 1 / duration) / frequency)) - 1)
        raise HarmonicError(
            f"every harmonic below half the sampling frequency, {nyquist:.6g} Hz",
            f"harmonic {harmonics} of {frequency:.6g} Hz at {harmonics * frequency:.6g} Hz",
            f"state harmonics = {most}" if most else "choose another method: not even the first is below it",
        )


def _from_centred(
    coefficients: Float, basis: _Basis, omega: float, middle: float, residual: Float
) -> HarmonicFit:
    """Shift the origin of time from the record's middle to the one of ``t``."""
    slope = coefficients[1] if basis.with_slope else np.zeros(coefficients.shape[1])
    a, b = coefficients[basis.smooth :: 2], coefficients[basis.smooth + 1 :: 2]
    phase = (omega * middle * np.arange(1, basis.harmonics + 1))[:, np.newaxis]
    cosine = a * np.cos(phase) - b * np.sin(phase)
    sine = a * np.sin(phase) + b * np.cos(phase)
    return HarmonicFit(Harmonic(omega, coefficients[0] - slope * middle, cosine, sine), slope, residual)


def _turn(phase: Float, cosine: Float, sine: Float) -> Float:
    return np.cos(phase)[:, np.newaxis] * cosine + np.sin(phase)[:, np.newaxis] * sine
