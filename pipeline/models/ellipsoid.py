"""The Earth as navigation sees it: the ellipsoid of WGS-84, its gravity, and its rates in N, E, D.

::

    R_M + h = a (1 - e²)/(1 - e² sin² φ)^(3/2) + h        R_N + h = a/sqrt(1 - e² sin² φ) + h
    γ       = γ_e (1 + k sin² φ)/sqrt(1 - e² sin² φ)                                   (Somigliana)
    g(h)    = γ [1 - 2/a (1 + f + m - 2 f sin² φ) h + 3/a² h²]
    ω_ie    = U (cos φ, 0, -sin φ)        ω_en = (v_E/(R_N + h), -v_N/(R_M + h), -v_E tan φ/(R_N + h))
    φ'      = v_N/(R_M + h)      λ' = v_E/((R_N + h) cos φ)      h' = -v_D

with gravity straight down the normal of the ellipsoid (its deflection with height, 1e-5 m/s² at 7 km, is left
out). Constants and formulae: Department of Defense World Geodetic System 1984, NGA.STND.0036 (2014), tables
3.1 to 3.6 and chapter 4. Radians, metres and seconds; all functions broadcast.

`pipeline.models._kernels_strapdown` has the same for compiled loops.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.numerics.rotation import wrapped

Float = NDArray[np.float64]

A = 6378137.0
"""Semi-major axis a [m]."""

FLATTENING = 1 / 298.257223563
"""f."""

E2 = FLATTENING * (2 - FLATTENING)
"""First eccentricity squared, e²."""

RATE = 7.292115e-5
"""Rate of the Earth's rotation U against inertial space [rad/s]."""

GRAVITY_EQUATOR = 9.7803253359
"""Normal gravity γ_e at the equator [m/s^2]."""

GRAVITY_POLE = 9.8321849379
"""Normal gravity at the poles [m/s^2]."""

SOMIGLIANA = (1 - FLATTENING) * GRAVITY_POLE / GRAVITY_EQUATOR - 1
"""k of Somigliana's formula."""

GM = 3.986004418e14
"""Gravitational constant times mass of the Earth [m^3/s^2]."""

M = RATE**2 * A**3 * (1 - FLATTENING) / GM
"""m: centrifugal to gravitational acceleration at the equator."""

POLAR_LIMIT = math.radians(89.9)
"""Greatest absolute latitude [rad] at which north and east are navigated with: 11 km from a pole."""


def radii(latitude: ArrayLike, height: ArrayLike) -> tuple[Float, Float]:
    """Radii of curvature at a height.

    Parameters
    ----------
    latitude : array_like
        [rad].
    height : array_like
        Above the ellipsoid [m].

    Returns
    -------
    meridian, prime_vertical : ndarray
        R_M + h and R_N + h [m].
    """
    h = np.asarray(height, dtype=np.float64)
    x = 1 - E2 * np.square(np.sin(latitude))
    prime_vertical = A / np.sqrt(x)
    return np.asarray(prime_vertical * (1 - E2) / x + h), np.asarray(prime_vertical + h)


def gravity(latitude: ArrayLike, height: ArrayLike) -> Float:
    """Normal gravity: Somigliana's formula, and the free-air formula of second order in height.

    Parameters
    ----------
    latitude : array_like
        [rad].
    height : array_like
        Above the ellipsoid [m].

    Returns
    -------
    ndarray
        Down [m/s^2]; within 1e-6 of the exact normal gravity up to 5 km.
    """
    h = np.asarray(height, dtype=np.float64)
    square = np.square(np.sin(latitude))
    on_ellipsoid = GRAVITY_EQUATOR * (1 + SOMIGLIANA * square) / np.sqrt(1 - E2 * square)
    fall = 1 - 2 / A * (1 + FLATTENING + M - 2 * FLATTENING * square) * h + 3 * np.square(h / A)
    return np.asarray(on_ellipsoid * fall)


def earth_rate_ned(latitude: ArrayLike) -> Float:
    """Rate of the Earth against inertial space, components N, E, D [rad/s], shape (..., 3)."""
    phi = np.asarray(latitude, dtype=np.float64)
    return RATE * np.stack([np.cos(phi), np.zeros_like(phi), -np.sin(phi)], axis=-1)


def transport_rate(latitude: ArrayLike, height: ArrayLike, velocity: ArrayLike) -> Float:
    """Rate of N, E, D against the Earth under a moving vehicle.

    Parameters
    ----------
    latitude : array_like, shape (...)
        [rad]; not at a pole.
    height : array_like, shape (...)
        Above the ellipsoid [m].
    velocity : array_like, shape (..., 3)
        N, E, D [m/s].

    Returns
    -------
    ndarray, shape (..., 3)
        N, E, D [rad/s].
    """
    north, east, _ = np.moveaxis(np.asarray(velocity, dtype=np.float64), -1, 0)
    meridian, prime_vertical = radii(latitude, height)
    about_north = east / prime_vertical
    return np.stack([about_north, -north / meridian, -about_north * np.tan(latitude)], axis=-1)


def metres_between(position_a: ArrayLike, position_b: ArrayLike) -> Float:
    """How far b lies to the north, to the east and down of a, with the radii halfway between them.

    Parameters
    ----------
    position_a, position_b : array_like, shape (..., 3)
        Latitude, longitude [rad], height [m]; longitudes may differ by whole turns.

    Returns
    -------
    ndarray, shape (..., 3)
        b less a: N, E, D [m]. Of a distance d the third order, about d (d/a)²/24, is left out: 1e-6 m at
        1 km, 1 m at 100 km.
    """
    a, b = np.asarray(position_a, dtype=np.float64), np.asarray(position_b, dtype=np.float64)
    difference = b - a
    middle = (a[..., 0] + b[..., 0]) / 2
    meridian, prime_vertical = radii(middle, (a[..., 2] + b[..., 2]) / 2)
    east = wrapped(difference[..., 1]) * prime_vertical * np.cos(middle)
    return np.stack([difference[..., 0] * meridian, east, -difference[..., 2]], axis=-1)


def displaced(position: ArrayLike, ned_metres: ArrayLike) -> Float:
    """The position that lies so far north, east and down of another: `metres_between` solved for b.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Latitude, longitude [rad], height [m].
    ned_metres : array_like, shape (..., 3)
        N, E, D [m].

    Returns
    -------
    ndarray, shape (..., 3)
        Latitude, longitude [rad], height [m].
    """
    a = np.asarray(position, dtype=np.float64)
    north, east, down = np.moveaxis(np.asarray(ned_metres, dtype=np.float64), -1, 0)
    middle = a[..., 0] + 0 * north
    for _ in range(4):  # each makes the error of the middle 200 times less: of 1e-2 rad it leaves 1e-11
        meridian, prime_vertical = radii(middle, a[..., 2] - down / 2)
        middle = a[..., 0] + north / meridian / 2
    longitude = a[..., 1] + east / (prime_vertical * np.cos(middle))
    return np.stack([a[..., 0] + north / meridian, longitude, a[..., 2] - down], axis=-1)
