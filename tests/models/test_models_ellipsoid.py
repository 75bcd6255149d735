"""The ellipsoid, its gravity and its rates against closed forms and against geometry in three dimensions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strapdown_flights import earth_turned, ecef, ned_to_ecef

from pipeline.models import _kernels_strapdown as kernels
from pipeline.models import ellipsoid

LATITUDES = np.radians([-89.9, -60.0, -20.0, 0.0, 30.0, 58.05, 80.0])


def normal_gravity(latitude: np.ndarray, height: float) -> np.ndarray:
    """Magnitude of the exact normal gravity (NGA.STND.0036, equations 4-4 to 4-19)."""
    x, _, z = ecef(np.stack([latitude, 0 * latitude, height + 0 * latitude], -1)).T
    a, omega = ellipsoid.A, ellipsoid.RATE
    b = a * (1 - ellipsoid.FLATTENING)
    E = np.sqrt(a**2 - b**2)
    part = x**2 + z**2 - E**2
    u = np.sqrt(part / 2 * (1 + np.sqrt(1 + 4 * E**2 * z**2 / part**2)))
    beta = np.arctan2(z * np.hypot(u, E), u * x)
    w = np.sqrt((u**2 + (E * np.sin(beta)) ** 2) / (u**2 + E**2))

    def q(at: np.ndarray | float) -> np.ndarray:
        return np.asarray(((1 + 3 * at**2 / E**2) * np.arctan(E / at) - 3 * at / E) / 2)

    q1 = 3 * (1 + u**2 / E**2) * (1 - u / E * np.arctan(E / u)) - 1
    mass = ellipsoid.GM / (u**2 + E**2)
    bulge = omega**2 * a**2 * E / (u**2 + E**2) * q1 / q(b) * (np.sin(beta) ** 2 / 2 - 1 / 6)
    along = -(mass + bulge) + omega**2 * u * np.cos(beta) ** 2
    across = omega**2 * (a**2 / np.hypot(u, E) * q(u) / q(b) - np.hypot(u, E)) * np.sin(beta) * np.cos(beta)
    return np.hypot(along, across) / w


@pytest.mark.parametrize(("height", "tolerance"), [(0.0, 2e-9), (100.0, 2e-8), (5000.0, 1e-6)])
def test_gravity_is_normal_gravity(height: float, tolerance: float) -> None:
    """On the ellipsoid both are exact: the constants of the standard have ten digits, and q loses five of
    sixteen. Above it the formula leaves out some six f² h/a: 1.1e-8 m/s^2 at 100 m, 5e-7 at 5 km."""
    np.testing.assert_allclose(
        ellipsoid.gravity(LATITUDES, height), normal_gravity(LATITUDES, height), rtol=0, atol=tolerance
    )


def test_gravity_at_equator_and_pole() -> None:
    """To rounding: Somigliana's formula goes through both."""
    assert ellipsoid.gravity(0.0, 0.0) == ellipsoid.GRAVITY_EQUATOR
    assert ellipsoid.gravity(np.pi / 2, 0.0) == pytest.approx(ellipsoid.GRAVITY_POLE, rel=1e-14)


def test_radii_and_transport_rate_are_those_of_the_moving_frame() -> None:
    """Position and frame by differences of order two over ±1 s at 100 m/s. Truncation is the cube of the
    angle over the step, 4e-15 rad, rounding of the frame 1e-16 rad, and 1e-9 m of the position."""
    velocity = np.array([60.0, -80.0, 5.0])
    for latitude in np.radians([-60.0, 0.0, 58.05]):
        meridian, prime_vertical = ellipsoid.radii(latitude, 300.0)
        rate = np.array([velocity[0] / meridian, velocity[1] / (prime_vertical * np.cos(latitude)), -5.0])
        ways = np.array([latitude, 0.4, 300.0]) + np.array([[-1.0], [0.0], [1.0]]) * rate
        before, C, after = ned_to_ecef(ways[:, 0], ways[:, 1])
        moved = ecef(ways)
        np.testing.assert_allclose(C.T @ (moved[2] - moved[0]) / 2, velocity, rtol=0, atol=1e-7)
        W = C.T @ (after - before) / 2
        frame = np.array([W[2, 1], W[0, 2], W[1, 0]])
        np.testing.assert_allclose(
            ellipsoid.transport_rate(latitude, 300.0, velocity), frame, rtol=0, atol=1e-13
        )


def test_earth_rate_is_that_of_the_turning_earth() -> None:
    """Over ±1 s the truncation is U³/6, 6e-14 rad/s."""
    turn = (earth_turned(np.array([1.0])) - earth_turned(np.array([-1.0])))[0] / 2
    for latitude in LATITUDES:
        C = ned_to_ecef(np.array([latitude]), np.array([0.0]))[0]
        W = C.T @ turn @ C
        expected = [W[2, 1], W[0, 2], W[1, 0]]
        np.testing.assert_allclose(ellipsoid.earth_rate_ned(latitude), expected, rtol=0, atol=1e-13)


def test_metres_between_are_those_in_space() -> None:
    """About 1 km. The chord is shorter than the arc by (d/a)²/24 of it, 1e-6 m, and parallels bend by as
    much: d³/a² tan²(lat)/12, 1e-5 m at 58 degrees."""
    a = np.array([np.radians(58.05), 0.7, 100.0])
    b = ellipsoid.displaced(a, [700.0, -700.0, 30.0])
    middle = (a + b) / 2
    chord = ned_to_ecef(middle[:1], middle[1:2])[0].T @ (ecef(b[None])[0] - ecef(a[None])[0])
    np.testing.assert_allclose(ellipsoid.metres_between(a, b), chord, rtol=0, atol=2e-5)


@given(
    st.floats(-1.5, 1.5), st.floats(-np.pi, np.pi), st.floats(-100, 1e4),
    st.floats(-2e4, 2e4), st.floats(-2e4, 2e4), st.floats(-1e3, 1e3), st.integers(-1, 1),
)  # fmt: skip
def test_displaced_is_the_inverse_of_metres_between(
    latitude: float, longitude: float, height: float, north: float, east: float, down: float, turns: int
) -> None:
    """Latitude and longitude have 4e-16 rad: 1e-9 m, whatever whole turns do, to twice; four iterations
    leave less."""
    a = np.array([latitude, longitude, height])
    b = ellipsoid.displaced(a, [north, east, down])
    b[1] += 2 * np.pi * turns
    np.testing.assert_allclose(ellipsoid.metres_between(a, b), [north, east, down], rtol=0, atol=2e-8)


def test_compiled_loops_have_the_same_ellipsoid() -> None:
    """The same formulae in another order: a few roundings."""
    for latitude in LATITUDES:
        for height in (-50.0, 0.0, 12000.0):
            expected = ellipsoid.radii(latitude, height)
            np.testing.assert_allclose(kernels.radii(latitude, height), expected, rtol=1e-15)
            gravity = ellipsoid.gravity(latitude, height)
            assert kernels.gravity(latitude, height) == pytest.approx(gravity, rel=1e-15)
