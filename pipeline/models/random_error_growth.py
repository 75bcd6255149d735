"""What rotation of the platform makes of a sensor's random error: variance of the integral, and its growth.

Yang et al., *Chinese Journal of Sensors and Actuators* 27(5) (2014) 637-642. The error of one horizontal
sensor is integrated along the axes of the room while the platform turns at omega; the sum of both components
has::

    Var(t, omega) = 2 int_0^t (t - tau) R(tau) cos(omega tau) dtau = Re[c (F(p + i omega) + F(p - i omega))]
    F(p) = t/p - (1 - exp(-p t)) / p^2

with c and p of `pipeline.models.random_error`. After long time Var grows by S(omega) a second, the two-sided
spectral density at the rotation rate. A second, independent sensor adds its own.

The rate random walk has no R: ``Var = (2 K^2/omega^2) (t - sin(omega t)/omega)``, that is ``K^2 t^3 / 3`` at
rest. It grows by ``2 S(omega)``, since besides the noise at omega the walk itself, over omega, grows. Of
quantisation the integral has the error of its first and its last reading, ``Var = 2 Q^2`` whatever the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import Coloured, RandomError, RandomErrorError, RateRandomWalk, Term

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

SCHULER = 2 * np.pi / 5064
"""Schuler's frequency, rad/s."""

_SMALL_PRODUCT = 1e-3
"""|p t| below which F is the series: the closed form has lost three digits there, the series none."""
_SMALL_TURN = 1e-5
"""Turn omega t [rad] below which J2 is J0, to its square; the closed form has lost five digits there."""
_HARMONICS = 4000
"""Harmonics of a reversing carousel: what lies above is below 1e-10 of the sum, |c_k|^2 falling as k^-4."""


@dataclass(frozen=True, slots=True)
class Band:
    """Rotation rates from ``low`` to ``high`` [rad/s], both excluded."""

    low: float
    high: float


def kernel(p: Complex, t: Float) -> Complex:
    """``F(p, t) = t/p - (1 - exp(-p t))/p^2``, the integral of (t - tau) exp(-p tau) from 0 to t.

    Parameters
    ----------
    p : complex ndarray
        [1/s]; may be 0.
    t : ndarray
        [s]; broadcasts with p.

    Returns
    -------
    complex ndarray
        [s^2].
    """
    z: Complex = np.asarray(p, dtype=np.complex128) * t
    series = 0.5 - z / 6 + z**2 / 24 - z**3 / 120
    small = np.abs(z) < _SMALL_PRODUCT
    safe = np.where(small, 1.0, z)
    F = t**2 * np.where(small, series, (safe + np.expm1(-safe)) / safe**2)
    return np.asarray(F, dtype=np.complex128)


def variance(model: RandomError, t: Float, omega: Float | float = 0.0) -> Float:
    """Variance of the integrated error, the sum of both horizontal components.

    Parameters
    ----------
    model : RandomError
    t : ndarray
        Times of integration [s].
    omega : float or ndarray
        Rotation rate [rad/s]; 0 for no rotation. Broadcasts with t.

    Returns
    -------
    ndarray
        In the square of the sensor's unit times s^2.
    """
    t, w = np.broadcast_arrays(np.asarray(t, dtype=np.float64), np.asarray(omega, dtype=np.float64))
    total: Float = model.N * t
    for noise in model.coloured:
        F = kernel(noise.decay + 1j * w, t) + kernel(noise.decay - 1j * w, t)
        total = total + (noise.amplitude * F).real
    # 2 K^2 (x - sin x) / omega^3 with x = omega t
    return total + 2 * model.K**2 * t**3 * _sine_remainder(w * t) + 2 * model.Q**2


def variance_by_axis(model: RandomError, t: Float, omega: float) -> tuple[Float, Float]:
    """The variance of each horizontal component.

    Parameters
    ----------
    model : RandomError
    t : ndarray
        Times of integration [s].
    omega : float
        Rotation rate [rad/s].

    Returns
    -------
    along, across : ndarray
        ``(J0 + J2)/2`` along where the sensor pointed at t = 0, ``(J0 - J2)/2`` across; same shape as t.

    Notes
    -----
    ::

        J2 = (1/omega) int_0^t R(tau) [sin omega(2t - tau) - sin omega tau] dtau
           = (2/omega) cos(omega t) Im[exp(i omega t) I*],   I = int_0^t R(tau) exp(i omega tau) dtau

    and of the rate random walk ``J2 = -(K/omega)^2 (t cos 2x + (2 sin x - 1.5 sin 2x)/omega)`` with x =
    omega t, and of quantisation, whose first reading lies along, ``J2 = Q^2 (1 + cos 2x)``. Across is known
    to rounding of the sum, over omega t where that is small.
    """
    t = np.asarray(t, dtype=np.float64)
    J0 = variance(model, t, omega)
    turned = np.abs(omega * t) > _SMALL_TURN
    if omega == 0:
        return J0, np.zeros_like(J0)
    x = omega * t
    integral: Complex = np.full(t.shape, 0.5 * model.N, dtype=np.complex128)  # half of delta lies in [0, t]
    for noise in model.coloured:
        c, p = noise.amplitude, noise.decay
        for a, q in ((c, p - 1j * omega), (c.conjugate(), p.conjugate() - 1j * omega)):
            integral = integral - 0.5 * a * np.expm1(-q * t) / q
    J2 = 2 / omega * np.cos(x) * (np.exp(1j * x) * integral.conj()).imag
    # The bracket of the walk without the difference of its large terms: sin y = y - y^3 ((y - sin y)/y^3)
    walk = 12 * _sine_remainder(2 * x) - 2 * _sine_remainder(x) - 2 * np.sinc(x / np.pi) ** 2
    readings = model.Q**2 * (1 + np.cos(2 * x))
    J2 = np.where(turned, J2 - model.K**2 * t**3 * walk + readings, J0)
    return 0.5 * (J0 + J2), 0.5 * (J0 - J2)


def growth(model: RandomError, omega: Float | float) -> Float:
    """Growth of the variance a second after long time, at a constant rotation rate.

    Parameters
    ----------
    model : RandomError
    omega : float or ndarray
        Rotation rate [rad/s].

    Returns
    -------
    ndarray
        ``S(omega)``, of the rate random walk twice that (infinite at rest); same shape as omega.
    """
    w = np.asarray(omega, dtype=np.float64)
    total: Float = np.zeros(w.shape)
    for term in model.terms:
        total = total + (2 if isinstance(term, RateRandomWalk) else 1) * term.psd(w)
    return total


def schuler_growth(model: RandomError, omega: Float | float, schuler: float = SCHULER) -> Float:
    """Growth of the variance a second over many periods of Schuler's oscillation.

    Parameters
    ----------
    model : RandomError
    omega : float or ndarray
        Rotation rate [rad/s]; 0 for no rotation.
    schuler : float
        Frequency of the oscillation [rad/s].

    Returns
    -------
    ndarray
        ``(S(omega - omega_s) + S(omega + omega_s)) / 4``, which at rest is ``S(omega_s) / 2``; the sum of
        both components, same shape as omega. The rate random walk grows by more while the platform turns, see
        Notes.

    Notes
    -----
    The walk's response to a step at u is ``int_u^t exp(i omega s) cos(omega_s (t - s)) ds``; of its square
    the mean is, with A and B = 1/(omega -+ omega_s), ``(A^2 + B^2 + (A + B)^2) / 4``.
    """
    w = np.asarray(omega, dtype=np.float64)
    total: Float = np.zeros(w.shape)
    for term in model.terms:
        total = total + 0.25 * (term.psd(w - schuler) + term.psd(w + schuler))
    if model.K > 0:
        with np.errstate(divide="ignore"):
            total = total + 0.25 * model.K**2 * (2 * w / (w**2 - schuler**2)) ** 2
    return total


def reversing_coefficients(turns: float, harmonics: int = _HARMONICS) -> Complex:
    """Fourier coefficients of ``exp(i theta(t))``, theta turning so many turns one way, and back.

    Parameters
    ----------
    turns : float
        Turns each way.
    harmonics : int
        Highest k.

    Returns
    -------
    complex ndarray, shape (2 harmonics + 1,)
        c_k of ``exp(i k Omega t)``, k from -harmonics to harmonics; ``Omega = omega / (2 turns)``.

    Notes
    -----
    ``c_k = (E(a + k) + E(a - k)) / 2`` with ``a = 2 turns`` and ``E(x) = (exp(i pi x) - 1) / (i pi x)``.
    """
    k = np.arange(-harmonics, harmonics + 1)
    total = sum(np.exp(0.5j * np.pi * x) * np.sinc(0.5 * x) for x in (2 * turns + k, 2 * turns - k))
    return np.asarray(0.5 * total, dtype=np.complex128)


def reversing_growth(model: RandomError, omega: float, turns: float = 1.0) -> float:
    """Growth of the variance a second with a carousel that turns at omega one way and back.

    Parameters
    ----------
    model : RandomError
    omega : float
        Rate in either sense [rad/s].
    turns : float
        Turns each way.

    Returns
    -------
    float
        ``sum_k |c_k|^2 S(k Omega)``, of the rate random walk twice that, averaged over a period. White noise
        keeps N whatever the schedule; a rate random walk is infinite unless the turns are whole, so
        that c_0 = 0.
    """
    power: Float = np.abs(reversing_coefficients(turns)) ** 2
    k = np.arange(-_HARMONICS, _HARMONICS + 1, dtype=np.float64)
    there = power > np.finfo(np.float64).eps ** 2  # a coefficient that is 0 but for rounding meets S(0) = inf
    coloured = RandomError(tuple(term for term in model.terms if term.name != "white"))
    return model.N + float(power[there] @ growth(coloured, k[there] * omega / (2 * turns)))


def peak(term: Term) -> float:
    """Rotation rate of the largest growth coefficient [rad/s]; 0 where rotation makes none worse.

    Notes
    -----
    ``omega^2 = -(mu^2 + lambda^2) + 2 lambda sqrt(mu^2 + lambda^2)`` of noise 2 and ``lambda^2 - mu^2`` of
    noise 3.
    """
    if not isinstance(term, Coloured):
        return 0.0
    mu, lambda_ = term.mu, -term.decay.imag
    size = np.hypot(mu, lambda_)
    square = lambda_**2 - mu**2 if term.name == "noise3" else size * (2 * lambda_ - size)
    return float(np.sqrt(max(square, 0.0)))


def worse_band(term: Term) -> Band | None:
    """Rotation rates at which one term grows more than at rest.

    Returns
    -------
    Band or None
        ``0 < omega^2 < 3 lambda^2 - mu^2`` of noise 2, ``0 < omega^2 < 2 (lambda^2 - mu^2)`` of noise 3; None
        where there are none: white noise, noise 1, rate random walk.
    """
    if not isinstance(term, Coloured):
        return None
    mu, lambda_ = term.mu, -term.decay.imag
    square = 2 * (lambda_**2 - mu**2) if term.name == "noise3" else 3 * lambda_**2 - mu**2
    return Band(0.0, float(np.sqrt(square))) if square > 0 else None


def worse_bands(model: RandomError) -> tuple[Band, ...]:
    """Rotation rates at which the sum grows more than at rest, in rising order.

    Of one coloured term the closed form of `worse_band`, else the roots of the polynomial in omega^2 that
    says ``S(omega) = S(0)``.
    """
    if model.K > 0 or not model.coloured:
        return ()
    if len(model.coloured) == 1:
        band = worse_band(model.coloured[0])
        return () if band is None else (band,)
    top, bottom, unit = _rational(model)
    level = float(top[0] / bottom[0])
    edges = np.concatenate([[0.0], _crossings(top, bottom, level, unit)])
    middle = np.append(0.5 * (edges[1:] + edges[:-1]), 2 * edges[-1])
    bands = [
        Band(float(low), float(high))
        for low, high, w in zip(edges[:-1], edges[1:], middle[:-1], strict=True)
        if growth(RandomError(model.coloured), w) > level
    ]
    return tuple(bands)


def recommended_rate(model: RandomError, fraction: float) -> float:
    """The smallest rate outside the 'worse' bands that leaves colour no more than a fraction of white noise.

    Parameters
    ----------
    model : RandomError
    fraction : float
        epsilon of ``S_colour(omega) <= epsilon N``.

    Returns
    -------
    float
        [rad/s]; 0 where no rotation is needed. Of noise 1 ``sqrt(2 sigma^2 mu/(epsilon N) - mu^2)``.

    Raises
    ------
    RandomErrorError
        If there is no white noise to compare with.
    """
    level = fraction * model.N
    if not level > 0:
        raise RandomErrorError(
            "recommended rotation rate",
            expected="white noise, and a fraction of it, above 0",
            found=f"N = {model.N:g}, fraction {fraction:g}",
            remedy="compare with a white noise that the sensor has",
        )
    colour = RandomError(tuple(term for term in model.terms if term.name != "white"))
    if not colour.terms or growth(colour, 0.0) <= level:
        return 0.0
    bands = worse_bands(colour)
    rates = np.concatenate(
        [_crossings(*_rational(colour)[:2], level, _rational(colour)[2]), [b.high for b in bands]]
    )
    # At a crossing the growth is the level but for rounding; it must not rise above it there
    fits = [w for w in np.sort(rates) if growth(colour, w * (1 + 1e-9)) <= level * (1 + 1e-12)]
    return float(next(w for w in fits if not any(b.low < w < b.high for b in bands)))


def allan_variance(model: RandomError, tau: Float) -> Float:
    """Allan variance of the model's mean rates over tau.

    Parameters
    ----------
    model : RandomError
    tau : ndarray
        Averaging times [s].

    Returns
    -------
    ndarray
        ``(4 V(tau) - V(2 tau)) / (2 tau^2)``, V the variance at rest of all but the walk; ``K^2 tau / 3``.
    """
    tau = np.asarray(tau, dtype=np.float64)
    stationary = RandomError(tuple(term for term in model.terms if not isinstance(term, RateRandomWalk)))
    difference = 4 * variance(stationary, tau) - variance(stationary, 2 * tau)
    return difference / (2 * tau**2) + model.K**2 * tau / 3


def _sine_remainder(x: Float) -> Float:
    """``(x - sin x) / x^3``; below 0.5 its series, to rounding."""
    y = np.asarray(x, dtype=np.float64) ** 2
    series = (1 - y / 20 * (1 - y / 42 * (1 - y / 72 * (1 - y / 110 * (1 - y / 156))))) / 6
    safe = np.where(y < 0.25, 1.0, x)
    return np.where(y < 0.25, series, (safe - np.sin(safe)) / safe**3)


def _rational(model: RandomError) -> tuple[Float, Float, float]:
    """Growth of the terms but white noise as ``top(w)/bottom(w)``, w = (omega/unit)^2; rising powers."""
    parts: list[tuple[Float, Float]] = []
    unit = max([abs(noise.decay) for noise in model.coloured], default=1.0)
    for noise in model.coloured:
        size = abs(noise.decay / unit) ** 2
        scale = 2 * noise.sigma**2 * noise.mu / unit**2
        square = np.array([size**2, 2 * (noise.mu**2 - noise.decay.imag**2) / unit**2, 1.0])
        if noise.name == "noise3":
            parts.append((np.array([2 * scale * size]), square))
        elif noise.name == "noise2":
            parts.append((scale * np.array([size, 1.0]), square))
        else:
            parts.append((np.array([scale]), np.array([size, 1.0])))
    if model.K > 0:
        parts.append((np.array([2 * model.K**2 / unit**2]), np.array([0.0, 1.0])))
    polynomial = np.polynomial.polynomial
    top, bottom = [np.asarray(part, dtype=np.float64) for part in (np.zeros(1), np.ones(1))]
    for above, below in parts:
        numerator = polynomial.polyadd(polynomial.polymul(top, below), polynomial.polymul(above, bottom))
        top = np.asarray(numerator, dtype=np.float64)
        bottom = np.asarray(polynomial.polymul(bottom, below), dtype=np.float64)
    return top, bottom, float(unit)


def _crossings(top: Float, bottom: Float, level: float, unit: float) -> Float:
    """Rates above 0 where ``top/bottom`` is at the level, rising [rad/s]."""
    difference = np.polynomial.polynomial.polysub(top, level * bottom)
    if abs(difference[0]) <= 1e-12 * abs(top[0]):
        difference = difference[1:]  # the root at rest
    roots = np.polynomial.polynomial.polyroots(difference)
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return unit * np.sqrt(np.sort(real))
