"""What the correction loops do in time: sampled poles, settling, and what they make of a fix's noise.

The state of a channel is ``(L_k, V_kV, c_X, c_V, n, dX, dV)``, the errors of `correction_gains` and the two
differences that the corrections are driven by. Between two fixes the differences follow the *reference*:

``propagated``
    The reference goes on with the sensors (``V_ext' = C_k (f_m - n̂) + g ...``, ``L_ext' = V_ext``). Only
    what the loops correct changes the differences: ``dV' = -K d - c_V'``, ``dX' = dV - k_LV c_X - c_X'``.
    Where the velocity is not measured, that of the reference follows the fixes, ``V_ext += γ (L_fix -
    L_ext)``: with the corrected velocity in its place the loop diverges with the printed gains.
``held``
    The reference stays: ``dX' = L_k'``, ``dV' = V_kV'``. To a vehicle at rest it is the continuous loop.
``held_difference``
    The differences stay. With a fix a second this diverges with the printed gains.

A step of the sensors is the polynomial of fourth order in A, which is what the compiled loops do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

from pipeline.models.correction_gains import (
    Channel,
    Complex,
    CorrectionGainsError,
    Float,
    bias_limit,
    check_channel,
    damping,
    poles,
    require_positive,
)

Reference = Literal["propagated", "held", "held_difference"]
REFERENCES: tuple[Reference, ...] = ("propagated", "held", "held_difference")


class Sampling(TypedDict):
    """How a channel is sampled: between samples of the sensors and between fixes [s], and the reference."""

    step: float
    interval: float
    reference: Reference


L, V, CX, CV, N, DX, DV = range(7)
"""Places in the state."""

FOLLOWING = 0.2
"""γ [1/s], but not above one over the interval. With 0.02 to 1 printed and tuned gains have radii < 0.99."""

_SETTLED = 0.05
"""Part of a disturbance that is left when a loop counts as settled."""

_POINTS = 4000
"""Of a response: so many over ten of the slowest time constants."""


def rates_matrix(channel: Channel, reference: Reference) -> Float:
    """The matrix A of ``x' = A x`` between fixes, shape (7, 7), in the order of the state."""
    g = channel.gains
    A = np.zeros((7, 7))
    if channel.measured != "velocity":
        A[CX, CX], A[CX, DX] = -1 / g.T, g.k_L / g.T
    if channel.measured != "position":
        A[CV, CV], A[CV, DV] = -1 / g.T_V, g.k_V / g.T_V
    d = np.zeros(7)
    d[CV] = 1.0
    d[CX] = g.k_LV
    corrected = -g.K * d - A[CV]
    A[N] = 0.0 if channel.frozen else g.k_n * g.K * d
    A[V] = corrected
    A[V, N] = -1.0
    A[L] = -A[CX]
    A[L, V], A[L, CX] = 1.0, A[L, CX] - g.k_LV
    if reference == "held":
        A[DX], A[DV] = A[L], A[V]
    elif reference == "propagated":
        A[DV] = corrected
        A[DX] = -A[CX]
        A[DX, DV], A[DX, CX] = 1.0, A[DX, CX] - g.k_LV
    return A


def step_matrix(channel: Channel, reference: Reference, step: float) -> Float:
    """``I + hA + (hA)²/2 + (hA)³/6 + (hA)⁴/24``: one step of the sensors, shape (7, 7)."""
    hA = step * rates_matrix(channel, reference)
    one = np.eye(7)
    return one + hA @ (one + hA / 2 @ (one + hA / 3 @ (one + hA / 4)))


def fix_matrix(channel: Channel, interval: float) -> Float:
    """What a fix makes of the state, shape (7, 7): ``dX = L_k``, ``dV = V_kV`` or what follows the fixes."""
    R = np.eye(7)
    R[DX] = np.eye(7)[L]
    if channel.measured == "position":
        R[DV] += min(FOLLOWING, 1 / interval) * (np.eye(7)[L] - np.eye(7)[DX])
    else:
        R[DV] = np.eye(7)[V]
    return R


def _concerned(channel: Channel, reference: Reference) -> list[int]:
    """Places of the state that the channel corrects or is corrected by."""
    places = {"velocity": {V, CV, N, DV}, "position": {L, V, CX, N, DX, DV}, "both": set(range(7))}
    left_out = {N} if channel.frozen else set()
    if channel.measured == "position" and reference != "propagated":
        left_out = left_out | {DV}
    return sorted(places[channel.measured] - left_out)


def _between_fixes(channel: Channel, *, step: float, interval: float, reference: Reference) -> Float:
    """All steps from one fix to the next, shape (7, 7)."""
    count = max(1, round(interval / step))
    return np.linalg.matrix_power(step_matrix(channel, reference, interval / count), count)


def sampled_matrix(channel: Channel, *, step: float, interval: float, reference: Reference) -> Float:
    """From just before a fix to just before the next, over the states that the channel concerns.

    Parameters
    ----------
    channel : Channel
    step : float
        Between samples of the sensors [s].
    interval : float
        Between fixes [s]; made of steps no longer than ``step``.
    reference : str
        What the difference does between them.

    Returns
    -------
    ndarray, shape (k, k)
    """
    Phi = _between_fixes(channel, step=step, interval=interval, reference=reference)
    places = _concerned(channel, reference)
    return np.asarray((Phi @ fix_matrix(channel, interval))[np.ix_(places, places)])


def sampled_poles(channel: Channel, *, step: float, interval: float, reference: Reference) -> Complex:
    """Eigenvalues of `sampled_matrix` [1], the largest first; one that is infinite if it overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        M = sampled_matrix(channel, step=step, interval=interval, reference=reference)
    if not np.isfinite(M).all():
        return np.array([np.inf], dtype=np.complex128)
    found = np.linalg.eigvals(M)
    return found[np.argsort(-np.abs(found))].astype(np.complex128)


def spectral_radius(channel: Channel, *, step: float, interval: float, reference: Reference) -> float:
    """The largest absolute eigenvalue a fix [1]: the loop is stable below 1."""
    return float(np.abs(sampled_poles(channel, step=step, interval=interval, reference=reference)[0]))


def settling_time(channel: Channel) -> float:
    """When 5 % is left of a disturbance, for good [s].

    The disturbance is a constant bias, and what is left of it in n̂; where the bias is frozen an error of the
    velocity, and what is left of it in V_k.

    Parameters
    ----------
    channel : Channel
        Stable.

    Returns
    -------
    float
        To a fortieth of a percent of ten times the slowest time constant.
    """
    place = V if channel.frozen else N
    A = rates_matrix(channel, "held")
    x = np.zeros(7)
    x[place] = x[DV if channel.frozen else N] = 1.0
    horizon = 10.0 / float(np.min(-poles(channel).real))
    step = expm(A * horizon / _POINTS)
    watched = np.zeros(7)
    watched[place] = 1.0
    if channel.frozen:
        watched[CX] = -channel.gains.k_LV
    left = np.empty(_POINTS + 1)
    for i in range(_POINTS + 1):
        left[i] = watched @ x
        x = step @ x
    return float(np.flatnonzero(np.abs(left) > _SETTLED)[-1] + 1) * horizon / _POINTS


def noise_gain(
    channel: Channel, *, step: float, interval: float, reference: Reference
) -> dict[tuple[str, str], float]:
    """Standard deviation of what is navigated over that of a fix, white from fix to fix, at the fixes.

    Returns
    -------
    dict of (str, str) to float
        By ``("position" or "velocity" of the fix, "position" or "velocity" navigated)`` [m or m/s a m or
        m/s], of the attitude's channel by ``("attitude", "attitude")`` [1]; infinite where the loop is not
        stable.
    """
    settings = {"step": step, "interval": interval}
    stable = spectral_radius(channel, reference=reference, **settings) < 1.0
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that is not stable
        Phi = _between_fixes(channel, reference=reference, **settings)
    places = _concerned(channel, reference)
    M = (Phi @ fix_matrix(channel, interval))[np.ix_(places, places)] if stable else None
    outputs = {"velocity": np.eye(7)[V] - channel.gains.k_LV * np.eye(7)[CX]}
    if channel.measured == "velocity":
        outputs["velocity"] = np.eye(7)[V]
    else:
        outputs["position"] = np.eye(7)[L]
    sources = {"position": DX, "velocity": DV}
    if channel.measured != "both":
        del sources["velocity" if channel.measured == "position" else "position"]
    gains = {}
    for source, place in sources.items():
        column = -Phi[places, place]
        if channel.measured == "position":
            column -= min(FOLLOWING, 1 / interval) * Phi[places, DV]
        P = None if M is None else solve_discrete_lyapunov(M, np.outer(column, column))
        for output, row in outputs.items():
            seen = row[places]
            gains[source, output] = float(np.sqrt(seen @ P @ seen)) if P is not None else float("inf")
    if "attitude" in channel.driven_by:  # which has the shape of the channel that measures the velocity
        return {("attitude", "attitude"): gains["velocity", "velocity"]}
    return gains


@dataclass(frozen=True, slots=True)
class Analysis:
    """What is known of a channel before anything is measured.

    Attributes
    ----------
    channel : Channel
    limit : float
        The k_n below which it is stable [1/s].
    poles : ndarray of complex
        [1/s].
    sampled_poles : ndarray of complex
        A fix [1].
    radius : float
        The largest of them [1].
    damping : float
        The least of the poles' [1].
    settling_time : float
        [s].
    noise_gain : dict
        As `noise_gain` gives it.
    """

    channel: Channel
    limit: float
    poles: Complex
    sampled_poles: Complex
    radius: float
    damping: float
    settling_time: float
    noise_gain: dict[tuple[str, str], float]


def analyse(channel: Channel, *, step: float, interval: float, reference: Reference) -> Analysis:
    """Limits, poles, damping, settling time and noise gain of a channel; parameters as `sampled_matrix` has.

    A channel that is not stable has infinite settling time and noise gain.

    Raises
    ------
    CorrectionGainsError
        If a gain that the channel uses is not a positive number, or out of all measure.
    """
    require_positive(channel)
    found = poles(channel)
    stable = bool(np.all(found.real < 0))
    sampled = sampled_poles(channel, step=step, interval=interval, reference=reference)
    return Analysis(
        channel=channel,
        limit=bias_limit(channel),
        poles=found,
        sampled_poles=sampled,
        radius=float(np.abs(sampled[0])),
        damping=damping(channel),
        settling_time=settling_time(channel) if stable else float("inf"),
        noise_gain=noise_gain(channel, step=step, interval=interval, reference=reference),
    )


def check(channel: Channel, *, step: float, interval: float, reference: Reference) -> None:
    """Refuse a channel that is not stable, in continuous time or as it is sampled.

    Raises
    ------
    CorrectionGainsError
        The limit that is not kept, by name.
    """
    check_channel(channel)
    radius = spectral_radius(channel, step=step, interval=interval, reference=reference)
    if not radius < 1.0:
        remedy = "lower K, k_LV and k/T, or take fixes more often"
        raise CorrectionGainsError(
            f"gains, {channel.name}",
            expected=f"a spectral radius below 1 a fix, with fixes each {interval:g} s",
            found=f"{radius:.3f} with references '{reference}'",
            remedy=remedy if reference == "propagated" else f"propagate the references, or {remedy}",
        )
