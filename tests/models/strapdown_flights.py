"""Flights with exact truth: attitude and velocity in closed form, position by integration of order eight."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.models import ellipsoid
from pipeline.models.navigation_problem import Start
from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll
from pipeline.numerics.rotation import matrix_from_quaternion

Float = NDArray[np.float64]

PLACE = np.array([np.radians(58.05), np.radians(38.8), 100.0])
LAUNCH, RAIL = 5.0, 4.0
"""The catapult begins, and how long it pushes [s]."""
TURNS, ENTRY = 20.0, 20.0
"""The weaving begins, and how long until it is full [s]."""


def eased(t: Float, begin: float, length: float) -> tuple[Float, Float, Float]:
    """0 to 1 with four continuous derivatives, and its first two."""
    x = np.clip((t - begin) / length, 0.0, 1.0)
    value = x**5 * (126 - 420 * x + 540 * x**2 - 315 * x**3 + 70 * x**4)
    return value, 630 * (x * (1 - x)) ** 4 / length, 2520 * (x * (1 - x)) ** 3 * (1 - 2 * x) / length**2


@dataclass(frozen=True)
class Flight:
    """Shot from rest to a speed; weaves about a course [rad] with a period [s], banked, and climbs."""

    speed: float = 40.0
    course: float = np.radians(55.0)
    weave: float = 0.0
    period: float = 90.0
    climb: float = 0.0
    place: tuple[float, float, float] = (PLACE[0], PLACE[1], PLACE[2])

    def angles(self, t: Float) -> tuple[Float, Float]:
        """Yaw, pitch and roll [rad], and their derivatives, shape (n, 3)."""
        gain, d_gain, dd_gain = eased(t, TURNS, ENTRY)
        w = 2 * np.pi / self.period
        s, c = np.sin(w * t), np.cos(w * t)
        yaw = self.course + self.weave * gain * s
        d_yaw = self.weave * (d_gain * s + w * gain * c)
        dd_yaw = self.weave * (dd_gain * s + 2 * w * d_gain * c - w * w * gain * s)
        s, c = np.sin(2.4 * w * t), np.cos(2.4 * w * t)
        pitch, d_pitch = self.climb * gain * s, self.climb * (d_gain * s + 2.4 * w * gain * c)
        lean = self.speed * d_yaw / 9.81
        d_roll = self.speed * dd_yaw / 9.81 / (1 + lean**2)
        return np.stack([yaw, pitch, np.arctan(lean)], -1), np.stack([d_yaw, d_pitch, d_roll], -1)

    def velocity(self, t: Float) -> tuple[Float, Float]:
        """Along the nose, N, E, D [m/s], and its derivative, shape (n, 3)."""
        (yaw, pitch, _), (d_yaw, d_pitch, _) = (x.T for x in self.angles(t))
        push, d_push, _ = eased(t, LAUNCH, RAIL)
        cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
        nose = np.stack([cp * cy, cp * sy, -sp], -1)
        d_nose = np.stack([-sp * cy * d_pitch - cp * sy * d_yaw, -sp * sy * d_pitch + cp * cy * d_yaw], -1)
        d_nose = np.column_stack([d_nose, -cp * d_pitch])
        along, d_along = (self.speed * push)[:, None], (self.speed * d_push)[:, None]
        return along * nose, d_along * nose + along * d_nose

    def position(self, t: Float) -> Float:
        """Latitude, longitude, height, shape (n, 3); t begins at 0."""

        def moving(now: float, x: Float) -> list[float]:
            v = self.velocity(np.array([now]))[0][0]
            meridian, prime_vertical = ellipsoid.radii(x[0], x[2])
            return [v[0] / meridian, v[1] / (prime_vertical * np.cos(x[0])), -v[2]]

        # Solved piece by piece, each analytic; relative and absolute tolerance are of rounding.
        knots = [0.0, *(k for k in (LAUNCH, LAUNCH + RAIL, TURNS, TURNS + ENTRY) if k < t[-1]), t[-1]]
        here, out = np.array(self.place), np.empty((len(t), 3))
        for begin, end in pairwise(knots):
            piece = solve_ivp(
                moving, (begin, end), here, method="DOP853", rtol=2.3e-14, atol=[1e-15, 1e-15, 1e-9],
                max_step=self.period / 45, dense_output=True,
            )  # fmt: skip
            inside = (t >= begin) & (t <= end)
            if inside.any():
                out[inside] = piece.sol(t[inside]).T
            here = piece.y[:, -1]
        return out

    def attitude(self, t: Float) -> Float:
        return quaternion_from_yaw_pitch_roll(self.angles(t)[0])

    def start(self) -> Start:
        zero = np.zeros(1)
        return Start(*self.place, self.velocity(zero)[0][0], self.attitude(zero)[0])

    def sensors(self, t: Float, position: Float) -> tuple[Float, Float]:
        """Angular rate [rad/s] and specific force [m/s^2] in body axes, shape (n, 3), exact."""
        (yaw, pitch, roll), (d_yaw, d_pitch, d_roll) = (x.T for x in self.angles(t))
        C = matrix_from_quaternion(quaternion_from_yaw_pitch_roll(np.stack([yaw, pitch, roll], -1)))
        velocity, acceleration = self.velocity(t)
        earth = ellipsoid.earth_rate_ned(position[:, 0])
        carried = ellipsoid.transport_rate(position[:, 0], position[:, 2], velocity)
        felt = acceleration + np.cross(2 * earth + carried, velocity)
        felt[:, 2] -= ellipsoid.gravity(position[:, 0], position[:, 2])
        own = np.stack(
            [
                d_roll - d_yaw * np.sin(pitch),
                d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll),
                d_yaw * np.cos(pitch) * np.cos(roll) - d_pitch * np.sin(roll),
            ],
            -1,
        )
        return own + np.einsum("nij,ni->nj", C, earth + carried), np.einsum("nij,ni->nj", C, felt)

    def integrals(self, t: Float) -> tuple[Float, Float]:
        """Integrals of both over the steps between the instants, shape (n - 1, 3): Gauss, three nodes."""
        h, middle = np.diff(t), (t[1:] + t[:-1]) / 2
        angle, push = np.zeros((len(h), 3)), np.zeros((len(h), 3))
        for node, weight in ((-np.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (np.sqrt(0.6), 5 / 18)):
            at = middle + node * h / 2
            rate, force = self.sensors(at, self.position(np.append(0.0, at))[1:])
            angle += (weight * h)[:, None] * rate
            push += (weight * h)[:, None] * force
        return angle, push


STRAIGHT = Flight()
WEAVING = Flight(weave=1.5, climb=0.05)
SHARP = Flight(speed=20.0, weave=3.0, period=40.0, climb=0.1)


def ecef(position: Float) -> Float:
    """Coordinates fixed in the Earth [m], shape (n, 3)."""
    latitude, longitude, height = position.T
    normal = ellipsoid.A / np.sqrt(1 - ellipsoid.E2 * np.sin(latitude) ** 2)
    across = (normal + height) * np.cos(latitude)
    up = (normal * (1 - ellipsoid.E2) + height) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), up], -1)


def ned_to_ecef(latitude: Float, longitude: Float) -> Float:
    """Matrices, shape (n, 3, 3)."""
    sf, cf, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    rows = [[-sf * cl, -sl, -cf * cl], [-sf * sl, cl, -cf * sl], [cf, 0 * sl, -sf]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def earth_turned(t: Float) -> Float:
    """Matrices from axes fixed in the Earth to inertial ones, shape (n, 3, 3)."""
    c, s, zero = np.cos(ellipsoid.RATE * t), np.sin(ellipsoid.RATE * t), 0 * t
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]
    return np.stack([np.stack(row, -1) for row in rows], -2)
