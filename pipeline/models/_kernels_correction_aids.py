"""What one fix of an aid, or one instant, makes of the differences that the correction loops are driven by.

A fix is older than the instant at which it is used by its ``lag``, less than a step: position, velocity and
attitude are taken back by it. Each function of a fix returns whether the fix passed its gate: the innovation
(fix less navigated) is within ``g0 + g1 age + g2 age²/2``, age since the last fix that was accepted; the
first of all passes. Axes, references A, M, X and the filter of gravity: see `correction_loops`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models._kernels_correction_channel import CX, DV, DX, KLV_
from pipeline.models._kernels_strapdown import (
    cross,
    gravity,
    matrix_from_quaternion,
    radii,
    rotation_vector,
)

Float = NDArray[np.float64]
Vector = tuple[float, float, float]

POSITION, VELOCITY, AIRSPEED, ALTITUDE, MAGNETIC_FIELD, ATTITUDE = range(6)
"""Aids, in the order of `navigation_problem.AidName`."""

NO_REFERENCE, BY_GRAVITY, BY_FIELD, EXTERNAL = range(4)
"""Attitude references: none, A, M, X."""

# Memory: vectors first.
WIND, FILTERED, AIR, ACCELERATION, TURN = 0, 3, 6, 9, 12
SPEED, LOAD, AIR_ON, WIND_TIME, BAROMETER_BIAS, CALIBRATED, LEVEL = range(15, 22)
MEMORY = 22

# Options.
(
    REFERENCE_OF_ATTITUDE,
    REFERENCE,
    WIND_CONSTANT,
    BAROMETER_CONSTANT,
    GRAVITY_CONSTANT,
    RESEAT_AFTER,
    FOLLOWING,
    LONGEST,
    GRAVITY_GATE,
    FIELD_GATE,
    ZERO_LIFT,
    LIFT,
    STALL_SQUARED,
    FIELD,
) = range(14)
OPTIONS = FIELD + 3

_LEAST_AGE = 1e-3
"""Of a fix [s], where one is divided by it."""

_LEAST_HORIZONTAL = 0.05
"""Part of the field, the Earth's and the measured one, that must be horizontal, if it is to tell a yaw."""


@njit(cache=True)
def passes(gate: Float, age: float, innovation: float) -> bool:
    """Whether an innovation lies within its gate; NaN does not."""
    return abs(innovation) <= gate[0] + age * (gate[1] + age * gate[2] / 2.0) or age == math.inf


@njit(cache=True)
def take_position(
    fix: Float, lag: float, age: float, position: Float, velocity: Float, z: Float, gains: Float,
    memory: Float, options: Float, gate: Float, barometer: bool, alone: bool, innovation: Float,
) -> bool:  # fmt: skip
    """``dX = L_k - L_ext``; the height only without barometer, whose bias is else learnt.

    After an outage ``L_k = L_ext``. ``alone``: the velocity is not measured; that of the reference begins as
    V_k and follows the fixes.
    """
    meridian, prime_vertical = radii(position[0], position[2])
    east = position[1] - fix[1]
    east -= 2.0 * math.pi * round(east / (2.0 * math.pi))
    dN = meridian * (position[0] - fix[0]) - velocity[0] * lag
    dE = east * prime_vertical * math.cos((position[0] + fix[0]) / 2.0) - velocity[1] * lag
    dD = fix[2] - position[2] - velocity[2] * lag
    innovation[0], innovation[1], innovation[2] = -dN, -dE, -dD
    if not passes(gate, age, math.sqrt(dN * dN + dE * dE + dD * dD)):
        return False
    if barometer:
        # Its fix less height by satellites: dX_D holds what the barometer, less its bias, says.
        told = z[2, DX] + memory[BAROMETER_BIAS] - dD
        # A plain mean at first, which forgets with the time constant later.
        since = min(age, options[RESEAT_AFTER])
        change = since / (memory[CALIBRATED] + since) * (told - memory[BAROMETER_BIAS])
        memory[BAROMETER_BIAS] += change
        z[2, DX] -= change
        memory[CALIBRATED] = min(options[BAROMETER_CONSTANT], memory[CALIBRATED] + since)
    reseat = age > options[RESEAT_AFTER]
    if reseat:
        position[0] -= dN / meridian
        position[1] -= dE / (prime_vertical * math.cos(position[0]))
        position[2] += 0.0 if barometer else dD
        dN = dE = dD = 0.0
    following = min(options[FOLLOWING], 1.0 / max(age, _LEAST_AGE)) if alone else 0.0
    difference = (dN, dE, dD)
    for i in range(2 if barometer else 3):
        if reseat and alone:
            z[i, DV] = gains[KLV_] * z[i, CX]
        elif alone:
            z[i, DV] += following * (difference[i] - z[i, DX])
        z[i, DX] = difference[i]
    return True


@njit(cache=True)
def take_velocity(
    fix: Float, lag: float, age: float, velocity: Float, z: Float, gains: Float, memory: Float,
    options: Float, gate: Float, innovation: Float,
) -> bool:  # fmt: skip
    """``dV = V_kV - V_ext``; after an outage ``V_k = V_ext``."""
    total = 0.0
    for i in range(3):
        innovation[i] = fix[i] - (velocity[i] - memory[ACCELERATION + i] * lag)
        total += innovation[i] * innovation[i]
    if not passes(gate, age, math.sqrt(total)):
        return False
    for i in range(3):
        offset = gains[KLV_] * z[i, CX]
        if age > options[RESEAT_AFTER]:
            velocity[i] += innovation[i]
            z[i, DV] = offset
        else:
            z[i, DV] = offset - innovation[i]
    return True


@njit(cache=True)
def take_altitude(
    fix: Float, lag: float, age: float, position: Float, velocity: Float, z: Float, gains: Float,
    memory: Float, options: Float, gate: Float, alone: bool, innovation: Float,
) -> bool:  # fmt: skip
    """``dX_D`` by the barometer less its bias; the first one is calibrated by the height."""
    height = position[2] + velocity[2] * lag
    if age == math.inf:
        memory[BAROMETER_BIAS] = fix[0] - height
    innovation[0] = fix[0] - memory[BAROMETER_BIAS] - height
    if not passes(gate, age, innovation[0]):
        return False
    if alone and age > options[RESEAT_AFTER]:
        z[2, DV] = gains[KLV_] * z[2, CX]
    elif alone:
        z[2, DV] += min(options[FOLLOWING], 1.0 / max(age, _LEAST_AGE)) * (innovation[0] - z[2, DX])
    z[2, DX] = innovation[0]
    return True


@njit(cache=True)
def take_airspeed(fix: Float, age: float, memory: Float, gate: Float, innovation: Float) -> bool:
    """The air speed; its gate is of the change since the last."""
    innovation[0] = fix[0] - memory[SPEED]
    if not (fix[0] >= 0.0 and passes(gate, age, innovation[0])):
        return False
    memory[SPEED] = fix[0]
    return True


@njit(cache=True)
def set_air_velocity(memory: Float, options: Float, valid: bool) -> None:
    """V_a in body axes of air speed and the angle of attack that the lift gives; zero where it is not valid.

    ``alpha = alpha_0 + lift n / sqrt(V⁴ + V_s⁴)``. When it comes or goes, the filtered gravity stays.
    """
    speed = memory[SPEED] if valid else 0.0
    alpha = 0.0
    if valid:
        stall = options[STALL_SQUARED]
        alpha = options[ZERO_LIFT] - options[LIFT] * memory[LOAD] / math.sqrt(speed**4 + stall * stall)
    forward, down = speed * math.cos(alpha), speed * math.sin(alpha)
    if valid != (memory[AIR_ON] > 0.0):
        memory[AIR_ON] = 1.0 if valid else 0.0
        memory[FILTERED] -= (forward - memory[AIR]) / options[GRAVITY_CONSTANT]
        memory[FILTERED + 2] -= (down - memory[AIR + 2]) / options[GRAVITY_CONSTANT]
    memory[AIR], memory[AIR + 2] = forward, down


@njit(cache=True)
def rotated(C: Float, v: Vector) -> Vector:
    """C v."""
    a, b, c = v
    return (
        C[0, 0] * a + C[0, 1] * b + C[0, 2] * c,
        C[1, 0] * a + C[1, 1] * b + C[1, 2] * c,
        C[2, 0] * a + C[2, 1] * b + C[2, 2] * c,
    )


@njit(cache=True)
def rotated_back(C: Float, v: Vector) -> Vector:
    """Cᵀ v."""
    a, b, c = v
    return (
        C[0, 0] * a + C[1, 0] * b + C[2, 0] * c,
        C[0, 1] * a + C[1, 1] * b + C[2, 1] * c,
        C[0, 2] * a + C[1, 2] * b + C[2, 2] * c,
    )


@njit(cache=True)
def unit(a: Vector) -> Vector:
    """Vector a over its length."""
    size = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return a[0] / size, a[1] / size, a[2] / size


@njit(cache=True)
def gravity_down(C: Float, position: Float, memory: Float, options: Float) -> tuple[bool, Vector]:
    """Whether gravity is seen, and its direction C_k g_b/|g_b|, g_b as it is filtered; else straight down."""
    tau = options[GRAVITY_CONSTANT]
    seen = rotated(
        C,
        (
            memory[FILTERED] + memory[AIR] / tau,
            memory[FILTERED + 1] + memory[AIR + 1] / tau,
            memory[FILTERED + 2] + memory[AIR + 2] / tau,
        ),
    )
    size = math.sqrt(seen[0] * seen[0] + seen[1] * seen[1] + seen[2] * seen[2])
    expected = gravity(position[0], position[2])
    # Accelerometers that are dead leave nothing that has a direction.
    if not (size > 0.0 and abs(size / expected - 1.0) <= options[GRAVITY_GATE]):
        return False, (0.0, 0.0, 1.0)
    return True, unit(seen)


@njit(cache=True)
def take_field(
    fix: Float, lag: float, C: Float, position: Float, z: Float, memory: Float, options: Float,
    innovation: Float,
) -> bool:  # fmt: skip
    """Set dU by the magnetic field: with A the yaw alone, with M the field first and gravity second."""
    turn = (memory[TURN] * lag, memory[TURN + 1] * lag, memory[TURN + 2] * lag)
    raw = (fix[0], fix[1], fix[2])
    back = cross(turn, raw)
    m = rotated(C, (raw[0] - back[0], raw[1] - back[1], raw[2] - back[2]))
    size = math.sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    field = (options[FIELD], options[FIELD + 1], options[FIELD + 2])
    strength = math.sqrt(field[0] * field[0] + field[1] * field[1] + field[2] * field[2])
    for i in range(3):
        innovation[i] = fix[i] - rotated_back(C, field)[i]
    if not abs(size / strength - 1.0) <= options[FIELD_GATE]:
        return False
    if math.hypot(m[0], m[1]) < _LEAST_HORIZONTAL * size:
        return False
    if math.hypot(field[0], field[1]) < _LEAST_HORIZONTAL * strength:
        return False
    if options[REFERENCE_OF_ATTITUDE] == BY_GRAVITY:
        yaw = math.atan2(m[1], m[0]) - math.atan2(field[1], field[0])
        z[5, DV] = yaw - 2.0 * math.pi * round(yaw / (2.0 * math.pi))
    elif options[REFERENCE_OF_ATTITUDE] == BY_FIELD:
        level, down = gravity_down(C, position, memory, options)
        _set_by_two(unit(field), (0.0, 0.0, 1.0), unit(m), down, level, z)
    return True


@njit(cache=True)
def _set_by_two(
    first: Vector, second: Vector, seen: Vector, seen_second: Vector, both: bool, z: Float
) -> None:
    """Set the dU that takes the first direction to where it is seen, the second as near as that leaves it.

    The two make an orthogonal triad each (Black, AIAA Journal 2 (1964) 1350). Without the second: the
    rotation about an axis across the first.
    """
    u, s = unit(cross(first, second)), seen
    if both:
        t = unit(cross(s, seen_second))
        a, b = cross(first, u), cross(s, t)
        R = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                R[i, j] = s[i] * first[j] + t[i] * u[j] + b[i] * a[j]
        dU = rotation_vector(R)
    else:
        c = cross(first, s)
        sine = math.sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2])
        angle = math.atan2(sine, first[0] * s[0] + first[1] * s[1] + first[2] * s[2])
        scale = angle / sine if sine > 0.0 else 0.0
        dU = (c[0] * scale, c[1] * scale, c[2] * scale)
    z[3, DV], z[4, DV], z[5, DV] = dU


@njit(cache=True)
def take_attitude(
    fix: Float, lag: float, age: float, C: Float, z: Float, memory: Float, options: Float, gate: Float,
    innovation: Float,
) -> bool:  # fmt: skip
    """Set dU by reference X: the rotation vector of ``C_k C_refᵀ`` in N, E, D."""
    reference = np.empty((3, 3))
    matrix_from_quaternion(fix, reference)
    then = rotated(C, (memory[TURN] * lag, memory[TURN + 1] * lag, memory[TURN + 2] * lag))
    d = rotation_vector(C @ reference.T)
    dU = (d[0] - then[0], d[1] - then[1], d[2] - then[2])
    for i in range(3):
        innovation[i] = -dU[i]
    if not passes(gate, age, math.sqrt(dU[0] * dU[0] + dU[1] * dU[1] + dU[2] * dU[2])):
        return False
    if options[REFERENCE_OF_ATTITUDE] == EXTERNAL:
        z[3, DV], z[4, DV], z[5, DV] = dU
    return True
