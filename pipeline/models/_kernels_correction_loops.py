"""The correction loops over a record, compiled; `correction_loops` has the equations and the axes.

A step of the sensors is that of `_kernels_strapdown`, made with corrected increments from the corrected state
(L_k, V_k, C_k); what the loops add to it is a linear channel an axis (`_kernels_correction_channel`), of
velocity and position in N, E, D and of the attitude about them. ``exp(-[c_U x]) C`` is followed by what
changes it, ``C_k <- exp(-[Δc_U x]) C_k``: the same but for second order in c_U.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models import ellipsoid
from pipeline.models._kernels_correction_aids import (
    ACCELERATION,
    AIR,
    AIRSPEED,
    ALTITUDE,
    ATTITUDE,
    BAROMETER_BIAS,
    BY_FIELD,
    BY_GRAVITY,
    EXTERNAL,
    FILTERED,
    GRAVITY_CONSTANT,
    LEVEL,
    LOAD,
    LONGEST,
    MAGNETIC_FIELD,
    MEMORY,
    POSITION,
    REFERENCE,
    REFERENCE_OF_ATTITUDE,
    TURN,
    VELOCITY,
    WIND,
    WIND_CONSTANT,
    WIND_TIME,
    gravity_down,
    rotated,
    rotated_back,
    set_air_velocity,
    take_airspeed,
    take_altitude,
    take_attitude,
    take_field,
    take_position,
    take_velocity,
)
from pipeline.models._kernels_correction_channel import (
    CV,
    CX,
    DV,
    HELD_DIFFERENCE,
    KLV_,
    PROPAGATED,
    L,
    N,
    V,
    channel,
)
from pipeline.models._kernels_strapdown import (
    cross,
    gravity,
    matrix_from_quaternion,
    orthonormalise,
    quaternion_from_matrix,
    radii,
    step,
    turn_left,
)

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]
Vector = tuple[float, float, float]

BY_SATELLITES, BY_AIR, OF_ATTITUDE = range(3)
"""Rows of the gains."""

_RATE, _POLAR_LIMIT = ellipsoid.RATE, ellipsoid.POLAR_LIMIT

_FRESH = 1024
"""Steps after which rounding is taken back from C."""


@njit(cache=True)
def _filter_gravity(
    turn: Float, increment: Float, C: Float, latitude: float, memory: Float, options: Float, dt: float
) -> None:
    """Low-pass ``g_b = V_a' + (ω + Cᵀ ω_ie) x V_a - f_m``, transported by the rotation; and the lift.

    With h what is filtered and D its change seen from inertial space, ``D h = (g_b - h)/τ``. So w = h - V_a/τ
    has ``D w = (Cᵀ ω_ie x V_a - f_m - V_a/τ - w)/τ``, in which the air speed need not be differentiated.
    """
    tau = options[GRAVITY_CONSTANT]
    kept = math.exp(-dt / tau)
    earth = rotated_back(C, (_RATE * math.cos(latitude), 0.0, -_RATE * math.sin(latitude)))
    carried = cross(earth, (memory[AIR], memory[AIR + 1], memory[AIR + 2]))
    for i in range(3):
        target = carried[i] - increment[i] / dt - memory[AIR + i] / tau
        memory[FILTERED + i] = kept * memory[FILTERED + i] + (1.0 - kept) * target
    memory[LOAD] = kept * memory[LOAD] + (1.0 - kept) * increment[2] / dt
    theta = (turn[0], turn[1], turn[2])
    w = (memory[FILTERED], memory[FILTERED + 1], memory[FILTERED + 2])
    once = cross(theta, w)
    twice = cross(theta, once)
    for i in range(3):
        memory[FILTERED + i] += twice[i] / 2.0 - once[i]


@njit(cache=True)
def _correct_attitude(
    C: Float, z: Float, bias: Float, gains: Float, valid: Mask, memory: Float, options: Float, turn: Float,
    dt: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Move the attitude's channels; add to the turn of the body what they correct; return Δc_U."""
    reference = options[REFERENCE_OF_ATTITUDE]
    if reference == BY_GRAVITY:
        tilt, yaw = memory[LEVEL] > 0.0, valid[MAGNETIC_FIELD]
    elif reference == BY_FIELD:
        tilt = yaw = valid[MAGNETIC_FIELD]
    else:
        tilt = yaw = reference == EXTERNAL and valid[ATTITUDE]
    before = (z[3, CV], z[4, CV], z[5, CV])
    for i in range(3, 6):
        z[i, L] = z[i, V] = z[i, N] = 0.0
        measured = yaw if i == 5 else tilt
        channel(z[i], gains[OF_ATTITUDE], False, measured, False, PROPAGATED, 0.0, 0.0, dt, options[LONGEST])
    change = (z[3, CV] - before[0], z[4, CV] - before[1], z[5, CV] - before[2])
    fed_back = rotated_back(C, (z[3, V] + change[0], z[4, V] + change[1], z[5, V] + change[2]))
    learnt = rotated_back(C, (z[3, N], z[4, N], z[5, N]))
    for i in range(3):
        turn[i] += fed_back[i]
        bias[0, i] += learnt[i]
    return change


@njit(cache=True)
def _correct_velocity(
    position: Float, velocity: Float, before: Float, C: Float, z: Float, bias: Float, gains: Float,
    valid: Mask, options: Float, dt: float,
) -> None:  # fmt: skip
    """Move the channels of velocity and position, and with them V_k, L_k, n̂; C as before the step."""
    live = valid[POSITION] or valid[VELOCITY]
    air = valid[AIRSPEED] and not live
    g = gains[BY_AIR] if air else gains[BY_SATELLITES]
    reference = int(options[REFERENCE])
    for i in range(3):
        measured = valid[POSITION] or (i == 2 and valid[ALTITUDE])
        z[i, L], z[i, V], z[i, N] = 0.0, g[KLV_] * z[i, CX], 0.0
        mean, acceleration = (before[i] + velocity[i]) / 2.0, (velocity[i] - before[i]) / dt
        channel(
            z[i], g, measured, valid[VELOCITY] or air, not live, reference, mean, acceleration, dt,
            options[LONGEST],
        )  # fmt: skip
        velocity[i] += z[i, V] - g[KLV_] * z[i, CX]
    meridian, prime_vertical = radii(position[0], position[2])
    position[1] += z[1, L] / (prime_vertical * math.cos(position[0]))
    position[0] += z[0, L] / meridian
    position[2] -= z[2, L]
    learnt = rotated_back(C, (z[0, N], z[1, N], z[2, N]))
    for i in range(3):
        bias[1, i] += learnt[i]


@njit(cache=True)
def _corrected_increment(rotation: Float, turn: Float, increment: Float, bias: Float, dt: float) -> Float:
    """``u - n̂ dt`` in the axes of the step's beginning, with the rotation that the loops add."""
    theta = (turn[0], turn[1], turn[2])
    added = (turn[0] - rotation[0], turn[1] - rotation[1], turn[2] - rotation[2])
    carried = cross(added, (increment[0], increment[1], increment[2]))
    taken = cross(theta, (bias[0], bias[1], bias[2]))
    out = np.empty(3)
    for i in range(3):
        out[i] = increment[i] + carried[i] / 2.0 - dt * (bias[i] + taken[i] / 2.0)
    return out


@njit(cache=True)
def _advance(
    position: Float, velocity: Float, C: Float, z: Float, bias: Float, memory: Float, gains: Float,
    options: Float, valid: Mask, rotation: Float, increment: Float, dt: float,
) -> None:  # fmt: skip
    """One step of sensors and loops."""
    turn = rotation - bias[0] * dt
    # What the accelerometers are held to err by is not fed back into levelling.
    _filter_gravity(turn, increment, C, position[0], memory, options, dt)
    x, y, w = _correct_attitude(C, z, bias, gains, valid, memory, options, turn, dt)
    gained = _corrected_increment(rotation, turn, increment, bias[1], dt)
    half = (x / 2.0, y / 2.0, w / 2.0)
    _turn(C, velocity, z, gains, options, half)
    before, old = velocity.copy(), C.copy()
    step(position, velocity, C, turn, gained, dt)
    for i in range(3):
        memory[TURN + i], memory[ACCELERATION + i] = turn[i] / dt, (velocity[i] - before[i]) / dt
    _correct_velocity(position, velocity, before, old, z, bias, gains, valid, options, dt)
    _turn(C, velocity, z, gains, options, half)


@njit(cache=True)
def _turn(C: Float, velocity: Float, z: Float, gains: Float, options: Float, change: Vector) -> None:
    """C_k by what c_U changes, half of it before a step and half after, so that the second order is right.

    V_b is integrated in body axes: with the attitude ``V_g = C_k V_b`` is turned, but not the reference.
    """
    turn_left(C, -change[0], -change[1], -change[2])
    k = gains[BY_SATELLITES, KLV_]
    V_g = (
        velocity[0] + z[0, CV] + k * z[0, CX],
        velocity[1] + z[1, CV] + k * z[1, CX],
        velocity[2] + z[2, CV] + k * z[2, CX],
    )
    turned = cross(V_g, change)
    for i in range(3):
        velocity[i] += turned[i]
        if options[REFERENCE] != HELD_DIFFERENCE:
            z[i, DV] += turned[i]


@njit(cache=True)
def _take_fixes(
    now: float, row: Integer, fix_time: Float, fix_value: Float, position: Float, velocity: Float, C: Float,
    z: Float, memory: Float, gains: Float, options: Float, gates: Float, stale: Float, last: Float,
    valid: Mask, accepted: Mask, innovation: Float,
) -> None:  # fmt: skip
    """The fixes of an instant, the velocity before the position, which asks whether it is measured."""
    g = gains[BY_SATELLITES]
    for aid in (VELOCITY, AIRSPEED, ALTITUDE, POSITION, MAGNETIC_FIELD, ATTITUDE):
        k = row[aid]
        if k >= 0:
            fix, lag, age, told = fix_value[k], now - fix_time[k], fix_time[k] - last[aid], innovation[k]
            gate = gates[aid]
            if aid == POSITION:
                taken = take_position(
                    fix, lag, age, position, velocity, z, g, memory, options, gate, valid[ALTITUDE],
                    not valid[VELOCITY], told,
                )  # fmt: skip
            elif aid == VELOCITY:
                taken = take_velocity(fix, lag, age, velocity, z, g, memory, options, gate, told)
            elif aid == AIRSPEED:
                taken = take_airspeed(fix, age, memory, gate, told)
            elif aid == ALTITUDE:
                alone = not valid[VELOCITY] and (valid[POSITION] or not valid[AIRSPEED])
                taken = take_altitude(
                    fix, lag, age, position, velocity, z, g, memory, options, gate, alone, told
                )
            elif aid == MAGNETIC_FIELD:
                taken = take_field(fix, lag, C, position, z, memory, options, told)
            else:
                taken = take_attitude(fix, lag, age, C, z, memory, options, gate, told)
            accepted[k] = taken
            if taken:
                last[aid] = fix_time[k]
        valid[aid] = now - last[aid] <= stale[aid]


@njit(cache=True)
def _compare(
    position: Float, velocity: Float, C: Float, z: Float, memory: Float, gains: Float, options: Float,
    valid: Mask, dt: float,
) -> None:  # fmt: skip
    """Compare at every instant gravity, and the velocity through the air, or learn the wind from it."""
    set_air_velocity(memory, options, valid[AIRSPEED])
    memory[LEVEL] = 0.0
    if options[REFERENCE_OF_ATTITUDE] == BY_GRAVITY:
        level, down = gravity_down(C, position, memory, options)
        if level:
            memory[LEVEL], z[3, DV], z[4, DV] = 1.0, -down[1], down[0]
    if not valid[AIRSPEED]:
        return
    flown = rotated(C, (memory[AIR], memory[AIR + 1], memory[AIR + 2]))
    if valid[POSITION] or valid[VELOCITY]:
        # A plain mean at first, which forgets with the time constant later.
        share = dt / (memory[WIND_TIME] + dt) if dt > 0.0 else 0.0
        memory[WIND_TIME] = min(options[WIND_CONSTANT], memory[WIND_TIME] + dt)
        for i in range(3):
            memory[WIND + i] += share * (velocity[i] - flown[i] - memory[WIND + i])
    else:
        for i in range(3):
            offset = gains[BY_AIR, KLV_] * z[i, CX]
            z[i, DV] = velocity[i] + offset - flown[i] - memory[WIND + i]


@njit(cache=True)
def _keep(
    z: Float, estimated: Float, memory: Float, valid: Mask, bias: Float, correction: Float, air: Float,
    used: Mask,
) -> None:  # fmt: skip
    """Fill the rows of an instant."""
    bias[:] = estimated
    for j in range(3):
        correction[0, j], correction[1, j], correction[2, j] = z[j, CX], z[j, CV], z[3 + j, CV]
    air[0], air[1], air[2] = memory[WIND], memory[WIND + 1], memory[BAROMETER_BIAS]
    used[:] = valid


@njit(cache=True)
def follow(
    time: Float, rotation: Float, increment: Float, at: Integer, fix_time: Float, fix_value: Float,
    gains: Float, options: Float, gates: Float, stale: Float, position: Float, velocity: Float,
    quaternion: Float, bias: Float, correction: Float, air: Float, used: Mask, accepted: Mask,
    innovation: Float,
) -> int:  # fmt: skip
    """Fill what is navigated from its first rows on.

    Parameters
    ----------
    time : ndarray, shape (n + 1,)
    rotation, increment : ndarray, shape (n, 3)
    at : ndarray of int, shape (n + 1, 6)
        The fix of each aid that is used at the instant, -1 for none.
    fix_time, fix_value : ndarray, shape (m,) and (m, 4)
    gains : ndarray, shape (3, 7)
        By satellites, by air, of the attitude.
    options : ndarray, shape (16,)
    gates, stale : ndarray, shape (6, 3) and (6,)
    position, velocity, quaternion : ndarray, shape (n + 1, 3), (n + 1, 3), (n + 1, 4)
    bias : ndarray, shape (n + 1, 2, 3)
        Of gyros and accelerometers.
    correction : ndarray, shape (n + 1, 3, 3)
        c_X, c_V, c_U.
    air : ndarray, shape (n + 1, 3)
        Wind N, E, and the barometer's bias.
    used : ndarray of bool, shape (n + 1, 6)
    accepted, innovation : ndarray, shape (m,) and (m, 3)

    Returns
    -------
    int
        The row at which the latitude passes the polar limit or is not a number, else -1.
    """
    here, speed, C, estimated = position[0].copy(), velocity[0].copy(), np.empty((3, 3)), np.zeros((2, 3))
    z, memory, valid = np.zeros((6, 7)), np.zeros(MEMORY), np.zeros(6, dtype=np.bool_)
    last = np.full(6, -math.inf)
    matrix_from_quaternion(quaternion[0], C)
    weight = gravity(here[0], here[2])
    for j in range(3):
        memory[FILTERED + j] = C[2, j] * weight
    memory[LOAD] = -C[2, 2] * weight
    dt = 0.0
    for i in range(time.size):
        if i:
            dt = time[i] - time[i - 1]
            _advance(
                here, speed, C, z, estimated, memory, gains, options, valid, rotation[i - 1],
                increment[i - 1], dt,
            )  # fmt: skip
        if not abs(here[0]) <= _POLAR_LIMIT:
            return i
        if i % _FRESH == _FRESH - 1:
            orthonormalise(C)
        _take_fixes(
            time[i], at[i], fix_time, fix_value, here, speed, C, z, memory, gains, options, gates, stale,
            last, valid, accepted, innovation,
        )  # fmt: skip
        _compare(here, speed, C, z, memory, gains, options, valid, dt)
        _keep(z, estimated, memory, valid, bias[i], correction[i], air[i], used[i])
        position[i], velocity[i] = here, speed
        quaternion_from_matrix(C, quaternion[i])
    return -1
