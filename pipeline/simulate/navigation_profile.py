"""How the simulated vehicle moves: speed, heading and climb by manoeuvres, and the attitude that they need.

An aircraft flies its manoeuvres in the mean air and is carried with it. What is invented, the source giving
none of it:

- The catapult: the speed rises by a trapezoid of acceleration, level, and the nose sinks from the angle of
  attack that the lift curve has at rest, 14 degrees, to that of flight; within 10 s after it the aircraft
  takes up the drift of the mean wind.
- Turns are coordinated: the specific force across the path lies in the plane of symmetry, which fixes the
  bank, and the body is turned up from the path by the angle of attack that the lift gives, see
  `pipeline.models.air_data`.
- Gusts, and the wandering of the wind, do not move the aircraft: it holds its path over the ground and its
  attitude, and the air speed takes them whole. (Light aircraft do follow slow gusts; an air speed in error
  by all of them is the harder case.)

A vehicle without lift stays level across its path: on wheels, or at rest on a stand. Oscillations are set on
yaw, pitch and roll.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.models.air_data import Lift
from pipeline.simulate.navigation_flight import Flight
from pipeline.simulate.navigation_settings import FlightSettings, Kind, Manoeuvre, wrong

Float = NDArray[np.float64]

_STEP = 0.05
"""Of the knots at most [s]; a sway has forty a period."""
_MARGIN = 1.0
"""By which the profile goes beyond the record at both ends [s]."""
_EASE = 4.0
"""In which the rate of a manoeuvre rises, and falls, if it is long enough [s]."""
_CATAPULT_EASE = 0.25
"""The same of the catapult, as a share of its length."""
_CARRIED = 10.0
"""In which the drift of the wind is taken up [s]."""
_STEEPEST = 0.7
"""Most climb rate, as a share of the air speed."""
_MOST_BANK = np.deg2rad(75.0)
_MOST_PITCH = np.deg2rad(80.0)

_RISE = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
"""From 0 to 1 with four derivatives that vanish at both ends."""
_RISEN = _RISE.integ()


@lru_cache(maxsize=4)
def fly(settings: FlightSettings) -> Flight:
    """The flight that the settings describe; the same object for the same settings.

    Raises
    ------
    SimulationError
        If a manoeuvre asks for what the model does not have: a speed below 0, or too steep a climb, bank or
        pitch.
    """
    t = _knots(settings)
    speed, climb, heading = _profile(settings, t)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(speed > 0, climb / speed, 0.0)
    path = np.arcsin(slope)
    level = speed * np.cos(path)
    through_air = np.column_stack([level * np.cos(heading), level * np.sin(heading), -climb])
    start = np.array([settings.latitude, settings.longitude, settings.height])
    velocity = through_air + _drift(settings, t)
    if settings.lift is None:
        angles = np.column_stack([heading, path, np.zeros_like(t)])
    else:
        forces = Flight(t, velocity, start).forces(t)
        angles = _lifted(settings.lift, forces, speed, heading, path)
    for sway in settings.sways:
        place = ("yaw", "pitch", "roll").index(sway.angle)
        angles[:, place] += sway.amplitude * np.sin(2 * np.pi * sway.frequency * t + sway.phase)
    steepest = float(np.max(np.abs(angles[:, 1])))
    if not steepest <= _MOST_PITCH:
        found = f"{np.rad2deg(steepest):.3g} deg"
        raise wrong("manoeuvres", "a pitch of at most 80 deg", found, "climb more slowly, or sway less")
    return Flight(t, velocity, start, angles)


def ramp(s: Float, ease: float) -> Float:
    """Smooth rise from 0 at s = 0 to 1 at s = 1; its slope is a trapezoid, smooth flanks ease long."""
    s = np.clip(np.asarray(s, dtype=np.float64), 0.0, 1.0)
    mirrored = np.minimum(s, 1 - s)
    flank = ease * _RISEN(np.minimum(mirrored / ease, 1.0))
    risen = (flank + np.maximum(mirrored - ease, 0.0)) / (1 - ease)
    return np.where(s <= 0.5, risen, 1 - risen)


def ramp_slope(s: Float, ease: float) -> Float:
    """Derivative of `ramp` by s."""
    s = np.asarray(s, dtype=np.float64)
    inside = np.clip(np.minimum(s, 1 - s) / ease, 0.0, 1.0)
    return np.asarray(_RISE(inside) / (1 - ease), dtype=np.float64)


def _knots(settings: FlightSettings) -> Float:
    fastest = max((sway.frequency for sway in settings.sways), default=0.0)
    shortest = min((one.length for one in settings.manoeuvres), default=np.inf)
    if settings.catapult is not None and settings.speed:
        shortest = min(shortest, settings.catapult)
    step = min(_STEP, shortest / 40, 1 / (40 * fastest) if fastest else np.inf)
    before, after = np.ceil(_MARGIN / step), np.ceil((settings.duration + _MARGIN) / step)
    return np.asarray(step * np.arange(-before, after + 1), dtype=np.float64)


def _profile(settings: FlightSettings, t: Float) -> tuple[Float, Float, Float]:
    """Speed [m/s], climb rate [m/s] and heading [rad] at times [s]."""
    speed = np.full_like(t, settings.speed)
    if settings.catapult is not None:
        speed *= ramp((t - settings.standing) / settings.catapult, _CATAPULT_EASE)
    for one in _of("accelerate", settings.manoeuvres):
        speed += one.amount * ramp((t - one.start) / one.length, _ease(one))
    heading = np.full_like(t, settings.yaw)
    for one in _of("turn", settings.manoeuvres):
        heading += one.amount * ramp((t - one.start) / one.length, _ease(one))
    climb = np.zeros_like(t)
    for one in _of("climb", settings.manoeuvres):
        climb += one.amount / one.length * ramp_slope((t - one.start) / one.length, _ease(one))
    if np.min(speed) < 0:
        raise wrong("manoeuvres", "a speed of 0 at least", f"{np.min(speed):.3g} m/s", "decelerate less")
    if np.any(np.abs(climb) > _STEEPEST * speed):
        place = int(np.argmax(np.abs(climb) - _STEEPEST * speed))
        found = f"{climb[place]:.3g} m/s at {speed[place]:.3g} m/s"
        raise wrong(
            "manoeuvres", f"a climb rate of at most {_STEEPEST:g} of the speed", found, "climb longer"
        )
    return speed, climb, heading


def _of(kind: Kind, manoeuvres: Iterable[Manoeuvre]) -> list[Manoeuvre]:
    return [one for one in manoeuvres if one.kind == kind]


def _ease(one: Manoeuvre) -> float:
    return min(0.5, _EASE / one.length)


def _drift(settings: FlightSettings, t: Float) -> Float:
    """Velocity N, E, D [m/s] with which the mean air carries the aircraft."""
    carried = np.zeros((len(t), 3))
    if settings.lift is not None:
        carried[:, :2] = settings.wind
        if settings.catapult is not None:
            free = settings.standing + settings.catapult
            carried *= ramp((t - free) / _CARRIED, 0.5)[:, np.newaxis]
    return carried


def _lifted(lift: Lift, forces: Float, speed: Float, heading: Float, path: Float) -> Float:
    """Yaw, pitch, roll of an aircraft in coordinated flight, ``R3(heading) R2(path) R1(bank) R2(alpha)``.

    Parameters
    ----------
    forces : ndarray, shape (m, 3)
        Specific force N, E, D [m/s^2].
    speed, heading, path : ndarray, shape (m,)
        Through the mean air: [m/s], [rad], [rad].
    """
    (c3, s3), (c2, s2) = (np.cos(heading), np.sin(heading)), (np.cos(path), np.sin(path))
    level = c3 * forces[:, 0] + s3 * forces[:, 1]
    across = -s3 * forces[:, 0] + c3 * forces[:, 1]
    upward = -(s2 * level + c2 * forces[:, 2])
    bank = np.arctan2(across, upward)
    if np.max(np.abs(bank)) > _MOST_BANK:
        found = f"{np.rad2deg(np.max(np.abs(bank))):.3g} deg"
        raise wrong("manoeuvres", "turns that need a bank of at most 75 deg", found, "turn more slowly")
    alpha = lift.angle_of_attack(np.hypot(across, upward), speed)
    (c1, s1), (ca, sa) = (np.cos(bank), np.sin(bank)), (np.cos(alpha), np.sin(alpha))
    # the body's axis 1 and the third components of its axes 2 and 3, in axes turned by the heading
    forward = np.stack([c2 * ca - s2 * c1 * sa, s1 * sa, -s2 * ca - c2 * c1 * sa])
    right_down, down_down = c2 * s1, -s2 * sa + c2 * c1 * ca
    yaw = heading + np.arctan2(forward[1], forward[0])
    pitch = np.arcsin(np.clip(-forward[2], -1.0, 1.0))
    return np.column_stack([yaw, pitch, np.arctan2(right_down, down_down)])
