"""Gains of the correction loops: characteristic polynomials, limits of stability, and their refusal.

Panov, dissertation, Rybinsk (2007), (2.12) to (2.18). One axis, C = 1, errors of what is corrected (a bias b
of the accelerometer enters as n = n̂ - b), d = c_V + k_LV c_X::

    L_k' = V_kV - k_LV c_X - c_X'       V_kV' = -n - K d - c_V'       n' = k_n K d
    T c_X' = -c_X + k_L dX              T_V c_V' = -c_V + k_V dV

with dX = L_k where the position is measured and dV = V_kV where the velocity is. The attitude has the shape
of the channel that measures the velocity, with T_U, k_U, K_U and k_ω for T_V, k_V, K and k_n.

A channel whose bias is frozen (an outage: n' = 0) has its own polynomial, without the root at zero.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

Measured = Literal["velocity", "position", "both"]
"""What a channel measures."""

_LEAST, _LARGEST = 1e-9, 1e6
"""Of a gain or time constant: no loop needs others, and products of so many as there are remain numbers."""

MEASURED: tuple[Measured, ...] = ("velocity", "position", "both")


class CorrectionGainsError(GyrostandError):
    """Gains with which a loop is not stable."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True, slots=True)
class ChannelGains:
    """Gains of one axis of the velocity and position channel.

    Attributes
    ----------
    T, T_V : float
        Time constants of the corrections c_X and c_V [s].
    k_L, k_V : float
        Gains from dX to c_X and from dV to c_V [1].
    K, k_LV : float
        Gains of the damping and from c_X to the velocity [1/s].
    k_n : float
        Gain of the bias [1/s].
    """

    T: float
    T_V: float
    k_L: float
    k_V: float
    K: float
    k_LV: float
    k_n: float


@dataclass(frozen=True, slots=True)
class AirGains:
    """Gains in the place of T_V [s], k_V [1] and K [1/s] where air data measure the velocity."""

    T_V: float
    k_V: float
    K: float


@dataclass(frozen=True, slots=True)
class AttitudeGains:
    """Gains of the attitude channel: T_U [s], k_U [1], K_U and k_omega [1/s]."""

    T_U: float
    k_U: float
    K_U: float
    k_omega: float

    @property
    def channel(self) -> ChannelGains:
        """The same as a channel that measures the velocity."""
        return ChannelGains(
            T=1.0, T_V=self.T_U, k_L=0.0, k_V=self.k_U, K=self.K_U, k_LV=0.0, k_n=self.k_omega
        )


@dataclass(frozen=True, slots=True)
class LoopGains:
    """Gains of all loops: with satellites, with air data in their outage, and of the attitude."""

    gnss: ChannelGains
    air: AirGains
    attitude: AttitudeGains

    @property
    def outage(self) -> ChannelGains:
        """Of the position and velocity channel in an outage: velocity by air data, height by barometer."""
        return ChannelGains(
            T=self.gnss.T,
            T_V=self.air.T_V,
            k_L=self.gnss.k_L,
            k_V=self.air.k_V,
            K=self.air.K,
            k_LV=self.gnss.k_LV,
            k_n=0.0,
        )


PRINTED = LoopGains(
    gnss=ChannelGains(T=3.0, T_V=3.0, k_L=3.0, k_V=3.0, K=1.0, k_LV=1.0, k_n=0.02),
    air=AirGains(T_V=3.0, k_V=3.0, K=1.0),
    attitude=AttitudeGains(T_U=3.0, k_U=3.0, K_U=1.0, k_omega=0.02),
)
"""As printed: k = T, K = k_LV = 1 1/s; the attitude, of which nothing is printed, by analogy."""

TUNED = LoopGains(
    gnss=ChannelGains(T=9.0, T_V=9.0, k_L=3.0, k_V=3.0, K=1 / 3, k_LV=1 / 3, k_n=0.02),
    air=AirGains(T_V=30.0, k_V=3.0, K=0.1),
    attitude=AttitudeGains(T_U=120.0, k_U=3.0, K_U=0.025, k_omega=0.005),
)
"""For sensors with noise: slower by three with satellites, by ten and more with air data and gravity."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One axis of a loop, as it works with some of the aids.

    Attributes
    ----------
    name : str
        In an engineer's words.
    gains : ChannelGains
    measured : str
        ``velocity``, ``position`` or ``both``.
    frozen : bool
        Whether the bias is left as it is.
    driven_by : tuple of str
        Aids whose fixes drive it, as in `navigation_problem.AidName`. Air data are compared at every step.
    symbols : tuple of str
        Names of the time constant T_V, of k_V, K and k_n in this channel.
    """

    name: str
    gains: ChannelGains
    measured: Measured
    frozen: bool = False
    driven_by: tuple[str, ...] = ()
    symbols: tuple[str, str, str, str] = ("T_V", "k_V", "K", "k_n")


def channels(
    gains: LoopGains, aids: Collection[str] = ("position", "velocity", "airspeed", "altitude")
) -> tuple[Channel, ...]:
    """The channels that may be at work with the given aids.

    Parameters
    ----------
    gains : LoopGains
    aids : collection of str
        Names as in `navigation_problem.AidName`; one may fail while another goes on.

    Returns
    -------
    tuple of Channel
    """
    g, known = gains.gnss, set(aids)
    found = []
    if "velocity" in known:
        found.append(Channel("velocity by satellites", g, "velocity", driven_by=("velocity",)))
    if "position" in known:
        found.append(Channel("position by satellites", g, "position", driven_by=("position",)))
    if {"position", "velocity"} <= known:
        name = "position and velocity by satellites"
        found.append(Channel(name, g, "both", driven_by=("position", "velocity")))
    if "altitude" in known:
        found.append(Channel("height by barometer", g, "position", frozen=True, driven_by=("altitude",)))
    if {"altitude", "velocity"} <= known:
        name = "height by barometer, velocity by satellites"
        found.append(Channel(name, g, "both", driven_by=("altitude", "velocity")))
    if "airspeed" in known:
        found.append(Channel("velocity by air data", gains.outage, "velocity", frozen=True))
    if {"airspeed", "altitude"} <= known:
        name = "height by barometer, velocity by air data"
        found.append(Channel(name, gains.outage, "both", frozen=True, driven_by=("altitude",)))
    symbols = ("T_U", "k_U", "K_U", "k_omega")
    found.append(
        Channel(
            "attitude",
            gains.attitude.channel,
            "velocity",
            driven_by=("attitude", "magnetic_field"),
            symbols=symbols,
        )
    )
    return tuple(found)


def characteristic_polynomial(channel: Channel) -> Float:
    """Coefficients of the characteristic polynomial of a channel, the highest power first.

    Parameters
    ----------
    channel : Channel

    Returns
    -------
    ndarray, shape (4,), (5,) or (6,) for velocity, position, both; one less where the bias is frozen
    """
    a, by_bias = _coefficients(channel.gains, channel.measured)
    return a[:-1] if channel.frozen else a + channel.gains.k_n * by_bias


def _coefficients(g: ChannelGains, measured: Measured) -> tuple[Float, Float]:
    """Coefficients without k_n, and what k_n multiplies."""
    if measured == "velocity":
        # T s³ + (1+k) s² + K k s + K k k_n
        return np.array([g.T_V, 1 + g.k_V, g.K * g.k_V, 0.0]), np.array([0.0, 0.0, 0.0, g.K * g.k_V])
    k = g.k_L * g.k_LV
    if measured == "position":
        # T s⁴ + (1+k_L) s³ + k_L k_LV (s² + K s + K k_n)
        return np.array([g.T, 1 + g.k_L, k, k * g.K, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, k * g.K])
    L, V = 1 + g.k_L, 1 + g.k_V
    a = [
        g.T * g.T_V,
        g.T * V + g.T_V * L,
        L * V + g.K * g.T * g.k_V + g.T_V * k,
        g.K * (g.T_V * k + g.k_V * L) + k * V,
        g.K * k * V,
        0.0,
    ]
    by_bias = [0.0, 0.0, 0.0, g.K * g.T * g.k_V, g.K * (g.T_V * k + g.k_V * L), g.K * k * V]
    return np.array(a), np.array(by_bias)


def bias_limit(channel: Channel) -> float:
    """The k_n (k_omega) below which a channel is stable, by Routh and Hurwitz.

    ::

        velocity:  k_n < (1 + k_V)/T_V
        position:  1 + k_L > K T,   k_n < k_L k_LV (1 + k_L - K T)/(1 + k_L)²
        both:      Δ2 = a1 a2 - a0 a3 > 0,  Δ4 = Δ2 (a3 a4 - a2 a5) - (a1 a4 - a0 a5)² > 0

    Parameters
    ----------
    channel : Channel
        All gains but k_n positive.

    Returns
    -------
    float
        [1/s]; 0 where no k_n is small enough.
    """
    g = channel.gains
    if channel.measured == "velocity":
        return (1 + g.k_V) / g.T_V
    if channel.measured == "position":
        return max(0.0, g.k_L * g.k_LV * (1 + g.k_L - g.K * g.T) / (1 + g.k_L) ** 2)
    pairs = zip(*_coefficients(g, "both"), strict=True)
    a0, a1, a2, a3, a4, a5 = (Polynomial(pair) for pair in pairs)  # of k_n
    second = a1 * a2 - a0 * a3
    fourth = second * (a3 * a4 - a2 * a5) - (a1 * a4 - a0 * a5) ** 2
    if second(0.0) <= 0.0 or fourth(0.0) <= 0.0:
        return 0.0
    roots = np.concatenate([second.roots(), fourth.roots()])
    # A real root of a cubic keeps an imaginary part of rounding.
    real = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if real.size else float("inf")


def poles(channel: Channel) -> Complex:
    """Roots of the characteristic polynomial [1/s], the slowest first."""
    roots = np.roots(characteristic_polynomial(channel)).astype(np.complex128)
    return roots[np.lexsort((roots.imag, -roots.real.round(12)))]


def damping(channel: Channel) -> float:
    """The least damping ratio of the poles, ``-Re s/|s|`` [1]; 1 where none oscillates."""
    roots = poles(channel)
    return float(np.min(-roots.real / np.abs(roots)))


def require_positive(channel: Channel) -> None:
    """Refuse gains that are not positive numbers, of those that a channel has a use for.

    Raises
    ------
    CorrectionGainsError
    """
    g, (T_V, k_V, K, k_n) = channel.gains, channel.symbols
    names = {"T_V": T_V, "k_V": k_V, "K": K, "k_n": k_n}
    unused = {"velocity": {"T", "k_L", "k_LV"}, "position": {"T_V", "k_V"}, "both": set()}[channel.measured]
    if channel.frozen:
        unused = unused | {"k_n"}
    for name in (f.name for f in fields(g) if f.name not in unused):
        value, symbol = getattr(g, name), names.get(name, name)
        if not _LEAST <= value <= _LARGEST:
            remedy = "without it a coefficient of the characteristic polynomial vanishes"
            raise CorrectionGainsError(
                f"gains, {channel.name}",
                expected=f"{symbol} from {_LEAST:g} to {_LARGEST:g}" if value > 0 else f"{symbol} > 0",
                found=f"{value:g}",
                remedy="check its unit" if value > 0 else remedy,
            )


def check_channel(channel: Channel) -> None:
    """Refuse a channel that is not stable in continuous time.

    Raises
    ------
    CorrectionGainsError
        The limit that is not kept, by name.
    """
    require_positive(channel)
    g, k_n, where = channel.gains, channel.symbols[-1], f"gains, {channel.name}"
    if channel.measured == "position" and not 1 + g.k_L > g.K * g.T:
        raise CorrectionGainsError(
            where,
            expected=f"1 + k_L > K T (Routh), that is K < {(1 + g.k_L) / g.T:.6g} 1/s",
            found=f"K = {g.K:.6g} 1/s",
            remedy="lower K or T, or raise k_L",
        )
    limit = bias_limit(channel)
    if limit == 0.0:
        raise CorrectionGainsError(
            where,
            expected=f"gains with which some {k_n} > 0 is stable (Routh)",
            found="none: it is unstable with the bias frozen",
            remedy="lower K or k_LV, or raise k_L and k_V",
        )
    if not channel.frozen and not g.k_n < limit:
        raise CorrectionGainsError(
            where,
            expected=f"{k_n} < {limit:.6g} 1/s (Routh)",
            found=f"{g.k_n:.6g} 1/s",
            remedy=f"lower {k_n}, or see what 'gyrostand gains' prints",
        )
