"""A flight as smooth functions of time, with exact specific force, body rates and increments.

Velocity (N, E, D) and the angles yaw, pitch, roll are quintic splines through the knots of a profile: what
the splines say is the truth, so their derivatives are exact::

    f_n    = v' + (2 omega_ie + omega_en) x v - g            f     = C^T f_n
    omega  = omega_nb + C^T (omega_ie + omega_en)
    omega_nb = (roll' - yaw' sin(pitch), pitch' cos(roll) + yaw' cos(pitch) sin(roll),
                -pitch' sin(roll) + yaw' cos(pitch) cos(roll))

Height is the exact integral of v_D; latitude and longitude integrate the kinematics of the ellipsoid by
Picard's iteration with splines of the sixth degree, to rounding. Increments come from the attitude against
inertial space at both ends of a step, and from Gauss' quadrature of the force, turned with the attitude,
within it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from pipeline.models.ellipsoid import RATE, earth_rate_ned, gravity, radii, transport_rate
from pipeline.models.navigation_problem import Imu
from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]

_DEGREE = 5
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Exact to rounding for polynomials of degree 7 within a step."""
_ITERATIONS = 4
"""Of Picard: the radii change by 1e-3 of the latitude's change, so that each gains three digits."""
_AT_ONCE = 20_000
"""Steps whose nodes are evaluated together, to bound the memory."""


@dataclass(frozen=True, slots=True)
class Motion:
    """The state of a flight at n instants.

    Attributes
    ----------
    position : ndarray, shape (n, 3)
        Latitude, longitude [rad], height [m].
    velocity : ndarray, shape (n, 3)
        N, E, D [m/s].
    attitude : ndarray, shape (n, 4)
        Quaternion (w, x, y, z), body to N, E, D.
    rate : ndarray, shape (n, 3)
        Of the body against inertial space, body axes [rad/s].
    force : ndarray, shape (n, 3)
        Specific force, body axes [m/s^2].
    """

    position: Float
    velocity: Float
    attitude: Float
    rate: Float
    force: Float


class Flight:
    """A flight from the knots of a profile.

    Parameters
    ----------
    knots : ndarray, shape (m,)
        Increasing [s]; 0 is among them.
    velocity : ndarray, shape (m, 3)
        N, E, D [m/s].
    position : ndarray, shape (3,)
        Latitude, longitude [rad], height [m] at 0.
    angles : ndarray, shape (m, 3), optional
        Yaw, pitch, roll, unwrapped [rad]; none yet where only `forces` is asked for.
    """

    def __init__(self, knots: Float, velocity: Float, position: Float, angles: Float | None = None) -> None:
        self._velocity = make_interp_spline(knots, velocity, k=_DEGREE)
        self._acceleration = self._velocity.derivative()
        self._angles = None if angles is None else make_interp_spline(knots, angles, k=_DEGREE)
        self._position = _travelled(knots, self._velocity, position)

    def position(self, t: Float) -> Float:
        """Latitude, longitude [rad], height [m] at times [s]; shape (n, 3)."""
        return np.column_stack([spline(t) for spline in self._position])

    def velocity(self, t: Float) -> Float:
        """N, E, D [m/s] at times [s]; shape (n, 3)."""
        return np.asarray(self._velocity(t), dtype=np.float64)

    def forces(self, t: Float) -> Float:
        """Specific force, components N, E, D [m/s^2], at times [s]; shape (n, 3)."""
        position, v = self.position(t), self.velocity(t)
        return self._forces(t, position, v)

    def angles(self, t: Float) -> Float:
        """Yaw, unwrapped, pitch, roll [rad] at times [s]; shape (n, 3)."""
        if self._angles is None:
            raise ValueError("the flight has no attitude yet")
        return np.asarray(self._angles(t), dtype=np.float64)

    def at(self, t: Float) -> Motion:
        """The state at times [s], shape (n,)."""
        angles = self.angles(t)
        position, velocity = self.position(t), self.velocity(t)
        attitude = quaternion_from_yaw_pitch_roll(angles)
        inverse = np.swapaxes(matrix_from_quaternion(attitude), -1, -2)
        navigation_rate = earth_rate_ned(position[:, 0]) + transport_rate(
            position[:, 0], position[:, 2], velocity
        )
        rate = self._turning(t, angles) + _applied(inverse, navigation_rate)
        force = _applied(inverse, self._forces(t, position, velocity))
        return Motion(position, velocity, attitude, rate, force)

    def increments(self, t: Float) -> Imu:
        """What error-free sensors give over the steps between the times, coning and sculling included.

        Parameters
        ----------
        t : ndarray, shape (n + 1,)
            Increasing [s].
        """
        inertial = self._inertial_attitude(t)
        turned = quaternion_multiply(quaternion_conjugate(inertial[:-1]), inertial[1:])
        parts = [slice(i, min(i + _AT_ONCE, len(t) - 1)) for i in range(0, len(t) - 1, _AT_ONCE)]
        velocity = np.concatenate(
            [self._velocity_increments(t[part.start : part.stop + 1], inertial[part]) for part in parts]
        )
        coasted = np.zeros(len(velocity), dtype=np.bool_)
        return Imu(t, rotation_vector_from_quaternion(turned), velocity, coasted)

    def integrals(self, t: Float) -> tuple[Float, Float]:
        """Integrals of rate [rad] and specific force [m/s] in body axes over the steps; each (n, 3)."""
        parts = [self._integrals(t[i : i + _AT_ONCE + 1]) for i in range(0, len(t) - 1, _AT_ONCE)]
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def _integrals(self, t: Float) -> tuple[Float, Float]:
        nodes, half = _nodes(t)
        motion = self.at(nodes.reshape(-1))
        shape = (*nodes.shape, 3)
        scale = half[:, np.newaxis]
        turned = scale * np.einsum("j,njk->nk", _WEIGHTS, motion.rate.reshape(shape))
        gained = scale * np.einsum("j,njk->nk", _WEIGHTS, motion.force.reshape(shape))
        return turned, gained

    def _velocity_increments(self, t: Float, start: Float) -> Float:
        """Integral of the force over each step, in the body axes at its beginning."""
        nodes, half = _nodes(t)
        flat = nodes.reshape(-1)
        before = np.repeat(quaternion_conjugate(start), nodes.shape[1], axis=0)
        since = quaternion_multiply(before, self._inertial_attitude(flat))
        force = _applied(matrix_from_quaternion(since), self.at(flat).force)
        total = np.einsum("j,njk->nk", _WEIGHTS, force.reshape(*nodes.shape, 3))
        return np.asarray(half[:, np.newaxis] * total, dtype=np.float64)

    def _inertial_attitude(self, t: Float) -> Float:
        """Quaternions from body axes to axes that do not turn: Earth's at 0."""
        position = self.position(t)
        return quaternion_multiply(
            _earth_from_ned(position[:, 0], position[:, 1] + RATE * t),
            quaternion_from_yaw_pitch_roll(self.angles(t)),
        )

    def _turning(self, t: Float, angles: Float) -> Float:
        """Rate of the body against N, E, D, in body axes."""
        assert self._angles is not None  # for the type checker; `angles` has refused it
        yaw_rate, pitch_rate, roll_rate = np.asarray(self._angles(t, nu=1), dtype=np.float64).T
        _, pitch, roll = angles.T
        return np.column_stack(
            [
                roll_rate - yaw_rate * np.sin(pitch),
                pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll),
                -pitch_rate * np.sin(roll) + yaw_rate * np.cos(pitch) * np.cos(roll),
            ]
        )

    def _forces(self, t: Float, position: Float, v: Float) -> Float:
        latitude, height = position[:, 0], position[:, 2]
        turning = 2 * earth_rate_ned(latitude) + transport_rate(latitude, height, v)
        force = np.asarray(self._acceleration(t), dtype=np.float64) + np.cross(turning, v)
        force[:, 2] -= gravity(latitude, height)
        return force


def _travelled(knots: Float, velocity: BSpline, start: Float) -> tuple[BSpline, BSpline, BSpline]:
    """Latitude, longitude and height, 0 seconds being at the start."""
    north, east, down = np.asarray(velocity(knots), dtype=np.float64).T
    height = _integral(knots, -down, start[2])
    at_knots = height(knots)
    latitude = np.full(len(knots), start[0])
    for _ in range(_ITERATIONS):
        meridian, _ = radii(latitude, at_knots)
        spline = _integral(knots, north / meridian, start[0])
        latitude = spline(knots)
    _, prime_vertical = radii(latitude, at_knots)
    longitude = _integral(knots, east / (prime_vertical * np.cos(latitude)), start[1])
    return spline, longitude, height


def _integral(knots: Float, derivative: Float, at_zero: float) -> BSpline:
    spline = make_interp_spline(knots, derivative, k=_DEGREE).antiderivative()
    constant = at_zero - float(spline(0.0))
    return BSpline(spline.t, spline.c + constant, spline.k)


def _earth_from_ned(latitude: Float, longitude: Float) -> Float:
    """Quaternions from N, E, D to axes of the Earth, 3 along its own, 1 to the meridian of longitude 0.

    ``q3(longitude) q2(-latitude - pi/2)``.
    """
    half = np.stack([longitude, -latitude - np.pi / 2]) / 2
    (c3, c2), (s3, s2) = np.cos(half), np.sin(half)
    return np.stack([c3 * c2, -s3 * s2, c3 * s2, s3 * c2], axis=-1)


def _nodes(t: Float) -> tuple[Float, Float]:
    """Nodes of the quadrature in each step, shape (n, 4), and half the steps, shape (n,)."""
    half = np.diff(t) / 2
    middle = (t[1:] + t[:-1]) / 2
    return middle[:, np.newaxis] + half[:, np.newaxis] * _NODES, half


def _applied(matrices: Float, vectors: Float) -> Float:
    """Each matrix times its vector."""
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors), dtype=np.float64)
