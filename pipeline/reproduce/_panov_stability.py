"""The loops by themselves: limits of stability, answers to a step, and what a fix a second makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipeline.models.correction_gains import MEASURED, TUNED, Channel, ChannelGains, Measured, bias_limit
from pipeline.models.correction_response import (
    CX,
    DV,
    DX,
    L,
    N,
    V,
    rates_matrix,
    spectral_radius,
    step_matrix,
)
from pipeline.reproduce._panov_runs import SOURCE
from pipeline.reproduce.rows import Row, at_most, near

Float = NDArray[np.float64]

_CONSTANTS = (3.0, 5.0, 10.0)
"""T = k [s]."""

_LIMITS: tuple[tuple[float, Measured, float], ...] = (
    *((T, "velocity", (1 + T) / T) for T in _CONSTANTS),
    *((T, "position", T / (1 + T) ** 2) for T in _CONSTANTS),
)
"""Closed forms of the limit of k_n [1/s] with k = T and K = k_LV = 1 1/s."""

_STEPS: tuple[tuple[Measured, int, tuple[float, float, float]], ...] = (
    ("velocity", 50, (0.632140682, 0.118249361, 10.913738832)),
    ("position", 5, (0.086474207, -0.878049927, 0.081861322)),
    ("position", 50, (0.631835656, 0.040563870, 0.128103373)),
    ("both", 5, (0.080570651, -0.021482111, -0.019840047)),
    ("both", 50, (0.632089404, -0.002448843, 0.028590722)),
)
"""What a bias of 1 m/s^2 makes of n̂ [m/s^2], V_k [m/s] and L_k [m] by the second t, T = 3, k_n = 0.02."""

_RADII = ((3.0, 1.029), (5.0, 1.108), (10.0, 1.170))
_TUNED_RADIUS = 0.979
_RADIUS_TOLERANCE = 1e-3

_STEP, _INTERVAL = 0.01, 1.0
"""Between samples of the sensors and between fixes [s]."""


def stability() -> Iterator[Row]:
    """Limits of k_n, steps, spectral radii."""
    yield from _limits()
    for measured, t, expected in _STEPS:
        for quantity, oracle, ours in zip(("n", "V", "X"), expected, _stepped(measured, t), strict=True):
            # nine decimals are given, and asked for to 1e-6
            yield near(oracle, 1e-6 / abs(oracle)).beside(
                SOURCE, f"step, {measured} measured", f"{quantity} at {t} s", ours
            )
    yield from _radii()


def _channel(T: float, measured: Measured, k_n: float = 0.02) -> Channel:
    """With the printed settings, k = T and K = k_LV = 1."""
    return Channel("printed", ChannelGains(T=T, T_V=T, k_L=T, k_V=T, K=1.0, k_LV=1.0, k_n=k_n), measured)


def _limits() -> Iterator[Row]:
    """Of both measured there is no closed form; there the oracle is where an eigenvalue comes to 0.

    Of all of them the source says k_n < 1.
    """
    both: list[tuple[float, Measured, float]] = [
        (T, "both", brentq(_rightmost, 0.5, 1.0, args=(T,), xtol=1e-12)) for T in _CONSTANTS
    ]
    for T, measured, oracle in (*_LIMITS, *both):
        yield near(oracle, 1e-6, printed=1.0).beside(
            SOURCE, f"limit, {measured} measured", f"k_n, 1/s, T = {T:g} s", bias_limit(_channel(T, measured))
        )


def _rightmost(k_n: float, T: float) -> float:
    """Largest real part of the equations' eigenvalues, both measured [1/s]."""
    A = rates_matrix(_channel(T, "both", k_n), "held")
    # the reference stands: dX = L_k, dV = V_kV, so that the fixes' two columns belong to those of the state
    A[:, L] += A[:, DX]
    A[:, V] += A[:, DV]
    return float(np.max(np.linalg.eigvals(A[:DX, :DX]).real))


def _stepped(measured: Measured, t: int) -> tuple[float, float, float]:
    """The estimate n̂ and the errors V_k, L_k after t seconds of a bias of 1, in steps of the sensors."""
    channel = _channel(3.0, measured)
    x = np.zeros(7)
    x[N] = -1.0
    x = np.linalg.matrix_power(step_matrix(channel, "held", _STEP), round(t / _STEP)) @ x
    return 1.0 + x[N], x[V] - channel.gains.k_LV * x[CX], x[L]


def _radii() -> Iterator[Row]:
    """Above 1 a loop diverges: with differences held and printed gains, not with references propagated."""
    for T, oracle in _RADII:
        yield near(oracle, _RADIUS_TOLERANCE / oracle).beside(
            SOURCE,
            "differences held, both measured",
            f"spectral radius, T = {T:g} s",
            _held(_channel(T, "both")),
        )
    tuned = Channel("tuned", TUNED.gnss, "both")
    yield near(_TUNED_RADIUS, _RADIUS_TOLERANCE / _TUNED_RADIUS).beside(
        SOURCE, "differences held, both measured", "spectral radius, tuned gains", _held(tuned)
    )
    stable = at_most(1.0)
    for T, _ in _RADII:
        yield stable.beside(
            SOURCE, "differences held, velocity measured", f"spectral radius, T = {T:g} s, below",
            _held(_channel(T, "velocity")),
        )  # fmt: skip
    for measured in MEASURED:
        for channel, gains in (
            *((_channel(T, measured), f"T = {T:g} s") for T in _CONSTANTS),
            (replace(tuned, measured=measured), "tuned gains"),
        ):
            radius = spectral_radius(channel, step=_STEP, interval=_INTERVAL, reference="propagated")
            yield stable.beside(
                SOURCE,
                f"references propagated, {measured} measured",
                f"spectral radius, {gains}, below",
                radius,
            )


def _held(channel: Channel) -> float:
    return spectral_radius(channel, step=_STEP, interval=_INTERVAL, reference="held_difference")
