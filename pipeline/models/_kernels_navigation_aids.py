"""Compiled measurements of an error-state filter of navigation: what is predicted, and its derivatives.

Each aid has a function that fills ``z``, measured less predicted, and ``H``, the derivatives of z by the
states, and returns how many rows it has, 0 where it has nothing to say. States stand as in
`pipeline.models.navigation_states`. With φ, δv, δp true less estimated, l the lever arm, B the field::

    position          z = L_m - (L + C l) - e        δp - [C l x] φ + δe
    velocity          z = v_m - v - C (ω x l)        δv - [C (ω x l) x] φ
    air speed         z = V_m - (1 + s) |v - w| - b  (1 + s) u . (δv - δw) + |v - w| δs + δb,  u along v - w
    altitude          z = h_m - h - b                -δp_D + δb
    magnetic field    z = m - C^T B - b              C^T [B x] φ + δb
    attitude          exp([z + e x]) = C_m C^T       φ + δe
    sideslip          z = -e_2 . C^T (v - w)         e_2 . C^T ((δv - δw) + [(v - w) x] φ)

A measurement is older than the state by its ``lag``, less than a step: what is predicted goes back by the
share of the last step, its derivatives only where it shows, in the position.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models._kernels_error_state import minus_cross
from pipeline.models._kernels_strapdown import (
    matrix_from_quaternion,
    radii,
    rotation_vector,
    turn_right,
)
from pipeline.models.navigation_states import SLOTS

Float = NDArray[np.float64]
Integer = NDArray[np.int64]

POSITION, VELOCITY, AIRSPEED, ALTITUDE, MAGNETIC_FIELD, ATTITUDE = range(6)
"""In the order of `pipeline.models.navigation_problem.AidName`."""

SIDESLIP = 6
"""Place of its variance, after those of the aids."""

_HARD_IRON, _AIRSPEED_SCALE, _AIRSPEED_BIAS = (
    SLOTS.index("hard_iron"),
    SLOTS.index("airspeed_scale"),
    SLOTS.index("airspeed_bias"),
)
_BAROMETER_BIAS, _POSITION_COLOUR = SLOTS.index("barometer_bias"), SLOTS.index("position_colour")
_WIND, _WIND_CHANGE, _GUST = SLOTS.index("wind"), SLOTS.index("wind_change"), SLOTS.index("gust")
_ATTITUDE_BIAS, _ATTITUDE_COLOUR = SLOTS.index("attitude_bias"), SLOTS.index("attitude_colour")

# Options, in one array.
LEVER_ARM = 0
"""3"""
LEAST_AIRSPEED = 3
CALIBRATION_TIME = 4
OUTAGE = 5
"""Seconds after the last fix at which GNSS counts as lost."""
CALIBRATES = 6
"""1 where wind and barometer are calibrated beside the filter."""
RESEAT_AFTER = 7
OPTIONS = 8

# Calibration beside the filter, in one array.
CALIBRATED_WIND = 0
"""2"""
WIND_COUNT = 2
WIND_TIME = 3
CALIBRATED_BAROMETER = 4
BAROMETER_COUNT = 5
BAROMETER_TIME = 6
LAST_GNSS = 7
CALIBRATION = 8


@njit(cache=True, error_model="numpy")
def measure(
    kind: int,
    value: Float,
    lag: float,
    share: float,
    nominal: tuple[Float, Float, Float, Float, Float],
    moved: Float,
    slots: Integer,
    options: Float,
    field: Float,
    calibration: Float,
    z: Float,
    H: Float,
) -> int:
    """Fill z and H for one measurement; see the module.

    Parameters
    ----------
    value : ndarray, shape (4,)
        As in `Fixes`.
    lag, share : float
        Age of the measurement [s], and as a share of the last step.
    nominal : tuple of ndarray
        Position, velocity, C, biases, and the states before the fifteen.
    moved : ndarray, shape (10,)
        Over the last step: change of position, of velocity, rotation vector; its duration.
    """
    H[:] = 0.0
    n = H.shape[1]
    position, velocity, C, _, other = nominal
    if kind == POSITION:
        return _position(value, lag, share, position, C, moved, slots, options, other, z, H)
    if kind == VELOCITY:
        return _velocity(value, share, velocity, C, moved, options, z, H)
    if kind == AIRSPEED:
        return _airspeed(value[0], share, velocity, moved, slots, options, other, calibration, z, H)
    if kind == ALTITUDE:
        bias = slots[_BAROMETER_BIAS]
        z[0] = value[0] - (position[2] - share * moved[2])
        H[0, n - 1] = -1.0
        H[0, n - 4] = lag
        if bias >= 0:
            H[0, bias] = 1.0
            z[0] -= other[bias]
        else:
            z[0] -= calibration[CALIBRATED_BAROMETER]
        return 1
    then = C.copy()
    turn_right(then, -share * moved[6], -share * moved[7], -share * moved[8])
    if kind == MAGNETIC_FIELD:
        return _magnetic_field(value, then, slots, field, other, z, H)
    return _attitude(value, then, slots, other, z, H)


@njit(cache=True, error_model="numpy")
def _position(
    value: Float,
    lag: float,
    share: float,
    position: Float,
    C: Float,
    moved: Float,
    slots: Integer,
    options: Float,
    other: Float,
    z: Float,
    H: Float,
) -> int:
    n = H.shape[1]
    meridian, prime_vertical = radii(position[0], position[2])
    turn = value[1] - position[1] + share * moved[1]
    turn -= 2.0 * math.pi * np.round(turn / (2.0 * math.pi))
    z[0] = (value[0] - position[0] + share * moved[0]) * meridian
    z[1] = turn * prime_vertical * math.cos(position[0])
    z[2] = -(value[2] - position[2] + share * moved[2])
    _lever(C, options[LEVER_ARM], options[LEVER_ARM + 1], options[LEVER_ARM + 2], z, H)
    colour = slots[_POSITION_COLOUR]
    for i in range(3):
        H[i, n - 3 + i] = 1.0
        H[i, n - 6 + i] = -lag
        if colour >= 0:
            H[i, colour + i] = 1.0
            z[i] -= other[colour + i]
    return 3


@njit(cache=True, error_model="numpy")
def _velocity(
    value: Float, share: float, velocity: Float, C: Float, moved: Float, options: Float, z: Float, H: Float
) -> int:
    n = H.shape[1]
    for i in range(3):
        H[i, n - 6 + i] = 1.0
        z[i] = value[i] - velocity[i] + share * moved[3 + i]
    if moved[9] > 0.0:
        p, q, r = moved[6] / moved[9], moved[7] / moved[9], moved[8] / moved[9]
        a, b, c = options[LEVER_ARM], options[LEVER_ARM + 1], options[LEVER_ARM + 2]
        _lever(C, q * c - r * b, r * a - p * c, p * b - q * a, z, H)
    return 3


@njit(cache=True, error_model="numpy")
def _lever(C: Float, a: float, b: float, c: float, z: Float, H: Float) -> None:
    """What is measured at a place, or has the velocity, (a, b, c) in body axes from that of the state."""
    if a == 0.0 and b == 0.0 and c == 0.0:
        return
    n = H.shape[1]
    for i in range(3):
        z[i] -= C[i, 0] * a + C[i, 1] * b + C[i, 2] * c
    x = C[0, 0] * a + C[0, 1] * b + C[0, 2] * c
    y = C[1, 0] * a + C[1, 1] * b + C[1, 2] * c
    w = C[2, 0] * a + C[2, 1] * b + C[2, 2] * c
    minus_cross(x, y, w, H.T, n - 9, 0)


@njit(cache=True, error_model="numpy")
def _airspeed(
    value: float,
    share: float,
    velocity: Float,
    moved: Float,
    slots: Integer,
    options: Float,
    other: Float,
    calibration: Float,
    z: Float,
    H: Float,
) -> int:
    air = np.empty(3)
    _through_air(velocity, slots, other, calibration, air)
    for i in range(3):
        air[i] -= share * moved[3 + i]
    speed = math.sqrt(air[0] * air[0] + air[1] * air[1] + air[2] * air[2])
    if speed < options[LEAST_AIRSPEED]:
        return 0
    scale = 1.0
    z[0] = value
    if slots[_AIRSPEED_SCALE] >= 0:
        scale += other[slots[_AIRSPEED_SCALE]]
        H[0, slots[_AIRSPEED_SCALE]] = speed
    if slots[_AIRSPEED_BIAS] >= 0:
        z[0] -= other[slots[_AIRSPEED_BIAS]]
        H[0, slots[_AIRSPEED_BIAS]] = 1.0
    z[0] -= scale * speed
    for i in range(3):
        _by_air(i, scale * air[i] / speed, slots, H)
    return 1


@njit(cache=True, error_model="numpy")
def sideslip(
    nominal: tuple[Float, Float, Float, Float, Float], slots: Integer, calibration: Float, z: Float, H: Float
) -> None:
    """Fill the first row with the air across the plane of symmetry, which an aircraft has none of."""
    n = H.shape[1]
    _, velocity, C, _, other = nominal
    air = np.empty(3)
    _through_air(velocity, slots, other, calibration, air)
    a, b, c = C[0, 1], C[1, 1], C[2, 1]
    H[:] = 0.0
    z[0] = -(a * air[0] + b * air[1] + c * air[2])
    H[0, n - 9] = b * air[2] - c * air[1]
    H[0, n - 8] = c * air[0] - a * air[2]
    H[0, n - 7] = a * air[1] - b * air[0]
    for i in range(3):
        _by_air(i, C[i, 1], slots, H)


@njit(cache=True, error_model="numpy")
def _through_air(velocity: Float, slots: Integer, other: Float, calibration: Float, air: Float) -> None:
    """Fill v - w."""
    for i in range(3):
        air[i] = velocity[i]
    for i in range(2):
        air[i] -= calibration[CALIBRATED_WIND + i]
        for group in (_WIND, _WIND_CHANGE, _GUST):
            if slots[group] >= 0:
                air[i] -= other[slots[group] + i]


@njit(cache=True, error_model="numpy")
def _by_air(i: int, derivative: float, slots: Integer, H: Float) -> None:
    """Set the derivatives of the first row by component i of v, and of w."""
    H[0, H.shape[1] - 6 + i] = derivative
    if i < 2:
        for group in (_WIND, _WIND_CHANGE, _GUST):
            if slots[group] >= 0:
                H[0, slots[group] + i] = -derivative


@njit(cache=True, error_model="numpy")
def _magnetic_field(
    value: Float, C: Float, slots: Integer, field: Float, other: Float, z: Float, H: Float
) -> int:
    first = H.shape[1] - 9
    iron = slots[_HARD_IRON]
    for i in range(3):
        a, b, c = C[0, i], C[1, i], C[2, i]
        z[i] = value[i] - (a * field[0] + b * field[1] + c * field[2])
        # row i of C^T [B x]
        H[i, first] = b * field[2] - c * field[1]
        H[i, first + 1] = c * field[0] - a * field[2]
        H[i, first + 2] = a * field[1] - b * field[0]
        if iron >= 0:
            H[i, iron + i] = 1.0
            z[i] -= other[iron + i]
    return 3


@njit(cache=True, error_model="numpy")
def _attitude(value: Float, C: Float, slots: Integer, other: Float, z: Float, H: Float) -> int:
    first = H.shape[1] - 9
    measured, turn = np.empty((3, 3)), np.empty((3, 3))
    matrix_from_quaternion(value, measured)
    for i in range(3):
        for j in range(3):
            turn[i, j] = measured[i, 0] * C[j, 0] + measured[i, 1] * C[j, 1] + measured[i, 2] * C[j, 2]
    turned = rotation_vector(turn)
    for i in range(3):
        H[i, first + i] = 1.0
        z[i] = turned[i]
        for group in (_ATTITUDE_BIAS, _ATTITUDE_COLOUR):
            if slots[group] >= 0:
                H[i, slots[group] + i] = 1.0
                z[i] -= other[slots[group] + i]
    return 3


@njit(cache=True, error_model="numpy")
def calibrated(
    kind: int,
    value: Float,
    time: float,
    nominal: tuple[Float, Float, Float, Float, Float],
    options: Float,
    calibration: Float,
) -> bool:
    """Whether a measurement of air speed or altitude is for the calibration beside the filter.

    That is so while GNSS is there: the wind ``v - C (V, 0, 0)`` and the barometer's bias ``h_m - h`` go
    through a low-pass, which begins as their mean. Before its first fix there is nothing to calibrate with,
    and nothing calibrated.
    """
    if options[CALIBRATES] == 0.0 or (kind != AIRSPEED and kind != ALTITUDE):
        return False
    position, velocity, C, _, _ = nominal
    count, last = (WIND_COUNT, WIND_TIME) if kind == AIRSPEED else (BAROMETER_COUNT, BAROMETER_TIME)
    if time - calibration[LAST_GNSS] > options[OUTAGE]:
        return bool(options[OUTAGE] > 0.0 and calibration[count] == 0.0)
    calibration[count] += 1.0
    gain = 1.0 / calibration[count]
    if calibration[count] > 1.0:
        gain = max(gain, (time - calibration[last]) / options[CALIBRATION_TIME])
    gain = min(gain, 1.0)
    calibration[last] = time
    if kind == AIRSPEED:
        for i in range(2):
            wind = velocity[i] - C[i, 0] * value[0]
            calibration[CALIBRATED_WIND + i] += gain * (wind - calibration[CALIBRATED_WIND + i])
    else:
        bias = value[0] - position[2]
        calibration[CALIBRATED_BAROMETER] += gain * (bias - calibration[CALIBRATED_BAROMETER])
    return True
