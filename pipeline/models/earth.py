"""The Earth under a gyro stand: its rate, the local frame, the mounting schemes of a two-axis gimbal.

Frames: ``eta`` is (East, North, Up); ``zeta`` the base of the stand,
``v_zeta = R1(chi1) R2(chi2) R3(chi3) v_eta`` with passive rotations
(Gubarenko & Kuzmenko, Mechanics of Solids, 1995, section 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Scheme = Literal["polar", "equatorial", "horizontal", "vertical"]

DEGREES_PER_HOUR = 15.041067
"""U, rate of the Earth's rotation [deg/h]: the drift of a dimensionless m of 1."""

RATE = np.deg2rad(DEGREES_PER_HOUR) / 3600
"""The same in rad/s; ``tau = U t`` is time in units of it."""


def passive_rotation(axis: int, angle: float) -> Float:
    """Matrix that gives a vector's components in axes turned by an angle [rad] about axis 1, 2 or 3."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis - 1]
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = s, -s
    return R


@dataclass(frozen=True, slots=True)
class Base:
    """The base of a stand: the Earth's rotation axis and gravity in its axes zeta.

    Attributes
    ----------
    u, g : ndarray, shape (3,)
        Unit vectors of the Earth's rotation and of gravity, components in zeta.
    """

    u: Float
    g: Float

    @classmethod
    def at(cls, latitude: float, chi: tuple[float, float, float]) -> Base:
        """The base at a latitude [rad], turned from (East, North, Up) by the angles chi [rad]."""
        chi1, chi2, chi3 = chi
        R = passive_rotation(1, chi1) @ passive_rotation(2, chi2) @ passive_rotation(3, chi3)
        u = R @ np.array([0.0, np.cos(latitude), np.sin(latitude)])
        return cls(u, R @ np.array([0.0, 0.0, -1.0]))

    @classmethod
    def mounted(cls, scheme: Scheme, latitude: float) -> Base:
        """The base of one of the paper's schemes I to IV at a latitude [rad]."""
        return cls.at(latitude, mounting_angles(scheme, latitude))

    @property
    def latitude(self) -> float:
        """Latitude [rad] of the base, however it stands: ``sin phi = -u.g``."""
        return float(np.arcsin(np.clip(-self.u @ self.g, -1.0, 1.0)))

    def misaligned(self, rotation_vector: Float) -> Base:
        """The base whose axes are turned by a small rotation vector Delta chi [rad], components in zeta.

        ``v_zeta <- Exp(-[Delta chi]x) v_zeta``, exact (Rodrigues).
        """
        angle = float(np.linalg.norm(rotation_vector))
        K = np.cross(rotation_vector, np.eye(3))  # K v = v x (Delta chi)
        R = np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)
        return Base(R @ self.u, R @ self.g)


def mounting_angles(scheme: Scheme, latitude: float) -> tuple[float, float, float]:
    """Angles chi1, chi2, chi3 [rad] of schemes I polar, II equatorial, III horizontal, IV vertical."""
    quarter = np.pi / 2
    angles: dict[Scheme, tuple[float, float, float]] = {
        "polar": (0.0, latitude - quarter, -quarter),
        "equatorial": (0.0, -latitude, quarter),
        "horizontal": (0.0, -quarter, -quarter),
        "vertical": (0.0, 0.0, 0.0),
    }
    return angles[scheme]


def rotation_vector_from_increments(
    increments: tuple[float, float, float], chi: tuple[float, float, float]
) -> Float:
    """Rotation vector Delta chi [rad] of small increments of the angles chi, of first order.

    ``Delta chi = (d1 - d3 sin chi2, d2, d3 cos chi2)`` for ``chi1 = 0``, as in all four schemes;
    degenerate in the horizontal one.
    """
    d1, d2, d3 = increments
    return np.array([d1 - d3 * np.sin(chi[1]), d2, d3 * np.cos(chi[1])])
