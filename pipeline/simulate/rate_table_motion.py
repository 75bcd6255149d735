"""How a case of gyros is turned: on a rate table, or by hand; exact at every instant.

A motion gives the rate of the case in its own axes, the Earth's included. It is smooth but at its corners,
between which a quadrature of Gauss & Legendre gives means that are exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import RATE
from pipeline.models.multi_position import SIX_POSITIONS, position
from pipeline.models.rate_table_steps import TableAxis
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotation_vector_from_quaternion,
)
from pipeline.simulate.rate_table_settings import Hand, Profile

Float = NDArray[np.float64]

STANDING = (3, 1)
"""Which axes of the case point up and to the north before it is turned by hand."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Motion(Protocol):
    """The motion of the case in a run."""

    @property
    def duration(self) -> float:
        """Length [s]."""
        ...

    @property
    def corners(self) -> Float:
        """Where it is not smooth [s], increasing."""
        ...

    def rate(self, t: Float) -> Float:
        """Rate of the case in its axes at times from the run's start [rad/s], shape (n, 3)."""
        ...


@dataclass(frozen=True, slots=True)
class TableMotion:
    """A rate table in a run.

    Attributes
    ----------
    corners, rates, angles : ndarray, shape (k,)
        Times [s], rates [rad/s] and angles [rad] that were commanded, between which the rate is straight.
    ripple, harmonic : float, int
        As of `Profile`.
    to_case : ndarray, shape (3, 3)
        From the axes of the table's rotor to those of the case.
    axis : TableAxis or None
        On the Earth; None where that does not turn.
    """

    corners: Float
    rates: Float
    angles: Float
    ripple: float
    harmonic: int
    to_case: Float
    axis: TableAxis | None

    @classmethod
    def of_profile(cls, profile: Profile, to_case: Float, axis: TableAxis | None) -> Self:
        """From rest through all rates of a profile to rest."""
        times, rates = [0.0], [0.0]
        for number, rate in enumerate((*profile.rates, 0.0)):
            # Where the rate changes sign is a corner for a gyro whose scale factor does.
            for corner in [0.0, rate] if rates[-1] * rate < 0 else [rate] if rate != rates[-1] else []:
                times.append(times[-1] + abs(corner - rates[-1]) / profile.acceleration)
                rates.append(corner)
            if number < len(profile.rates):
                times.append(times[-1] + profile.dwell)
                rates.append(rate)
        t, w = np.array(times), np.array(rates)
        angles = np.concatenate([[0.0], np.cumsum(np.diff(t) * (w[1:] + w[:-1]) / 2)])
        return cls(t, w, angles, profile.ripple, profile.ripple_harmonic, to_case, axis)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(self.corners[-1])

    def table(self, t: Float) -> tuple[Float, Float]:
        """Angle [rad] and rate [rad/s] of the table at times [s], each of shape (n,)."""
        k = np.clip(np.searchsorted(self.corners, t, side="right") - 1, 0, len(self.corners) - 2)
        into = t - self.corners[k]
        slope = np.diff(self.rates)[k] / np.diff(self.corners)[k]
        phi = self.angles[k] + self.rates[k] * into + slope * into**2 / 2
        commanded = self.rates[k] + slope * into
        n, e = self.harmonic, self.ripple
        return phi + e / n * np.sin(n * phi), commanded * (1 + e * np.cos(n * phi))

    def rate(self, t: Float) -> Float:
        """Rate of the case in its axes [rad/s], shape (n, 3)."""
        angle, rate = self.table(t)
        rotor = np.zeros((len(t), 3))
        if self.axis is not None:
            rotor += self.axis.on_rotor(np.stack([np.cos(angle), np.sin(angle)], axis=1))
        rotor[:, 2] += rate
        return rotor @ self.to_case.T


@dataclass(frozen=True, slots=True)
class HandMotion:
    """A case that is turned by hand by ``A (s - sin(2 pi s) / (2 pi))`` with s from 0 to 1.

    Attributes
    ----------
    vectors : ndarray, shape (m, 3)
        Axis times angle A of each turn, in the axes of the case [rad].
    rest, moving : float
        Before, between and after, and of each turn [s].
    attitude : ndarray, shape (3, 3)
        From (East, North, Up) to the case before the first turn.
    latitude : float or None
        [rad]; None where the Earth does not turn.
    """

    vectors: Float
    rest: float
    moving: float
    attitude: Float
    latitude: float | None

    @classmethod
    def of_turns(cls, hand: Hand, latitude: float | None, axis_errors: Float, angle_errors: Float) -> Self:
        """Turns by all angles about each axis of the case.

        Parameters
        ----------
        hand : Hand
        latitude : float or None
        axis_errors : ndarray, shape (3 k, 3)
            Rotation of the axis of each turn [rad].
        angle_errors : ndarray, shape (3 k,)
            [rad].
        """
        axes, angles = nominal_turns(hand)
        turned = np.stack([_rotation(e) @ a for e, a in zip(axis_errors, axes, strict=True)])
        vectors = (angles + angle_errors)[:, np.newaxis] * turned
        return cls(vectors, hand.rest, hand.moving, position(*STANDING), latitude)

    @classmethod
    def of_positions(cls, hand: Hand, latitude: float | None, errors: Float) -> Self:
        """From each of six positions to the next, the case turned by an error in each [rad], shape (6, 3)."""
        attitudes = [_rotation(e) @ position(*p) for e, p in zip(errors, SIX_POSITIONS, strict=True)]
        vectors = [_turn_between(a, b) for a, b in pairwise(attitudes)]
        return cls(np.stack(vectors), hand.rest, hand.moving, attitudes[0], latitude)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self.vectors) * (self.rest + self.moving) + self.rest

    @property
    def corners(self) -> Float:
        """Beginning and end of each turn [s]."""
        begin = self.starts
        return np.stack([begin, begin + self.moving], axis=1).ravel()

    @property
    def starts(self) -> Float:
        """Beginning of each turn [s], shape (m,)."""
        period = self.rest + self.moving
        return np.asarray(self.rest + period * np.arange(len(self.vectors)), dtype=np.float64)

    def rate(self, t: Float) -> Float:
        """Rate of the case in its axes [rad/s], shape (n, 3)."""
        k = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, len(self.vectors) - 1)
        s = np.clip((t - self.starts[k]) / self.moving, 0.0, 1.0)
        turned = s - np.sin(2 * np.pi * s) / (2 * np.pi)
        speed = (1 - np.cos(2 * np.pi * s)) / self.moving
        rate = speed[:, np.newaxis] * self.vectors[k]
        if self.latitude is not None:
            rate += self._earth(k, turned)
        return rate

    def _earth(self, k: NDArray[np.intp], turned: Float) -> Float:
        """The Earth's rate in the axes of the case, the given part of turn k made."""
        assert self.latitude is not None
        u = RATE * np.array([0.0, np.cos(self.latitude), np.sin(self.latitude)])
        before = [self.attitude @ u]
        for vector in self.vectors[:-1]:
            before.append(_rotation(vector).T @ before[-1])
        angle = np.linalg.norm(self.vectors, axis=1)
        axis = self.vectors / np.where(angle, angle, 1.0)[:, np.newaxis]
        a, w, theta = axis[k], np.stack(before)[k], (turned * angle[k])[:, np.newaxis]
        # w is turned back by theta about a (Rodrigues)
        along = np.sum(a * w, axis=1, keepdims=True) * a
        back = along + np.cos(theta) * (w - along) - np.sin(theta) * np.cross(a, w)
        return np.asarray(back, dtype=np.float64)


def nominal_turns(hand: Hand) -> tuple[Float, Float]:
    """Axes and angles of the turns by hand as they are meant, shapes (m, 3) and (m,) [rad]."""
    each = len(hand.turns)
    return np.repeat(np.eye(3), each, axis=0), np.tile(hand.turns, 3)


def turned_by_error(to_case: Float, error: Float) -> Float:
    """A mounting whose case is turned by a small rotation: its rates are ``w + error x w`` to first order."""
    return _rotation(error) @ to_case


def mean_over(value: Callable[[Float], Float], edges: Float, corners: Sequence[float] | Float) -> Float:
    """Mean of a function over each interval between edges.

    Parameters
    ----------
    value : callable
        Values at times, shape (n,) to (n, k); smooth but at the corners.
    edges : ndarray, shape (m + 1,)
        Strictly increasing.
    corners : sequence of float
        Increasing.

    Returns
    -------
    ndarray, shape (m, k)
    """
    inner = np.array([c for c in corners if edges[0] < c < edges[-1]])
    points = np.union1d(edges, inner)
    half = np.diff(points) / 2
    t = (points[1:] - half)[:, np.newaxis] + half[:, np.newaxis] * _NODES
    at = value(t.ravel()).reshape(len(half), len(_NODES), -1)
    integral = half[:, np.newaxis] * np.einsum("g,mgk->mk", _WEIGHTS, at)
    whole = np.add.reduceat(integral, np.searchsorted(points, edges[:-1]), axis=0)
    return np.asarray(whole / np.diff(edges)[:, np.newaxis], dtype=np.float64)


def _rotation(vector: Float) -> Float:
    """Matrix that turns a vector by a rotation vector [rad], shape (3, 3)."""
    return matrix_from_quaternion(quaternion_from_rotation_vector(vector))


def _turn_between(one: Float, other: Float) -> Float:
    """The rotation vector of the case from one attitude to another: ``other = R(v)^T one`` [rad]."""
    return rotation_vector_from_quaternion(quaternion_from_matrix(one @ other.T))
