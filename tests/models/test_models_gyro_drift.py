"""The drift model against MATH 2.3, 2.8 and 2.9: identities, right-hand sides, closed forms, signs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.models.earth import Base, Scheme, mounting_angles, rotation_vector_from_increments
from pipeline.models.gyro_drift import (
    PARAMETERS,
    Gyro,
    exact_rates,
    in_platform,
    linear_model,
    misalignment_basis,
    misalignment_from_epsilon,
)

Float = NDArray[np.float64]
SCHEMES: tuple[Scheme, ...] = ("polar", "equatorial", "horizontal", "vertical")
LATITUDE = np.deg2rad(55.75)
DAY = 6.300387  # 24 h in units of the Earth rate
NONE = np.zeros(2)


def solved(base: Base, gyro: Gyro, start: tuple[float, float], end: float, count: int = 2) -> Float:
    """Trajectory by the exact model, to rounding (DOP853, 1e-13)."""

    def rates(_: float, alpha: Float) -> Float:
        return exact_rates(alpha[np.newaxis], gyro, base)[0]

    times = np.linspace(0, end, count)
    return solve_ivp(rates, (0, end), start, "DOP853", t_eval=times, rtol=1e-13, atol=1e-14).y.T


@pytest.mark.parametrize(
    ("scheme", "u", "g"),
    [
        ("polar", (0, 0, 1), (-np.cos(LATITUDE), 0, -np.sin(LATITUDE))),
        ("equatorial", (1, 0, 0), (-np.sin(LATITUDE), 0, -np.cos(LATITUDE))),
        ("horizontal", (np.sin(LATITUDE), 0, np.cos(LATITUDE)), (-1, 0, 0)),
        ("vertical", (0, np.cos(LATITUDE), np.sin(LATITUDE)), (0, 0, -1)),
    ],
)
def test_axes_of_the_schemes(scheme: Scheme, u: tuple[float, ...], g: tuple[float, ...]) -> None:
    base = Base.mounted(scheme, LATITUDE)
    np.testing.assert_allclose(base.u, u, atol=1e-15)  # rounding of sines and cosines
    np.testing.assert_allclose(base.g, g, atol=1e-15)


@pytest.mark.parametrize(
    ("scheme", "linear", "exact"),
    [
        ("polar", (-0.393815995447, -0.293845065265), (-0.393823977162, -0.293812262630)),
        ("equatorial", (-0.990839037724, 0.004231795886), (-0.990857652490, 0.004250438408)),
        ("horizontal", (-1.053375641275, -0.162763831034), (-1.053385385621, -0.162765546551)),
        ("vertical", (-0.259240209178, -0.778695394947), (-0.259219906692, -0.778646124245)),
    ],
)
def test_right_hand_sides(scheme: Scheme, linear: tuple[float, float], exact: tuple[float, float]) -> None:
    """MATH 2.9, to its tolerance of 1e-11 and the 12 digits given."""
    base = Base.mounted(scheme, LATITUDE)
    alpha = np.array([[0.3, -0.4]])
    m = np.array([0.011, -0.007, 0.005, 0.003, -0.002, 0.004])
    theta, turn = np.array([0.002, -0.001]), np.array([3e-4, -2e-4, 1e-4])
    np.testing.assert_allclose(
        exact_rates(alpha, Gyro(m, theta), base.misaligned(turn))[0], exact, rtol=0, atol=1e-11
    )
    c, F = linear_model(alpha, base)
    p = np.concatenate([m, theta, np.cross(base.u, turn)])
    np.testing.assert_allclose((c + F @ p)[0], linear, rtol=0, atol=1e-11)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_identities_of_the_columns(scheme: Scheme) -> None:
    """m11 = g.(epsilon) and c = u.(epsilon): the exact null vector m11 = 1, epsilon = -g (MATH 2.3, 2.4)."""
    base = Base.mounted(scheme, LATITUDE)
    alpha = np.random.default_rng(1).uniform(-1.2, 1.2, (200, 2))
    c, F = linear_model(alpha, base)
    epsilon = F[:, :, [PARAMETERS.index(f"epsilon{k}") for k in (1, 2, 3)]]
    scale = 1 / np.cos(1.2)  # the largest factor among the terms
    np.testing.assert_allclose(F[:, :, 0], epsilon @ base.g, rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(c, epsilon @ base.u, rtol=0, atol=1e-14 * scale)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_linear_model_is_the_exact_ones_derivative(scheme: Scheme) -> None:
    base = Base.mounted(scheme, LATITUDE)
    alpha = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 2))
    c, F = linear_model(alpha, base)
    np.testing.assert_allclose(exact_rates(alpha, Gyro(np.zeros(6), NONE), base), c, rtol=0, atol=1e-14)
    B, h = misalignment_basis(base), 1e-6
    for k in range(8):
        step = np.zeros(8)
        step[k] = h
        gyros = [Gyro(s * step[:6], s * step[6:]) for s in (1, -1)]
        slope = np.subtract(*(exact_rates(alpha, gyro, base) for gyro in gyros)) / (2 * h)
        # central difference: rounding 1e-16 / h and curvature h^2, both below 1e-9
        np.testing.assert_allclose(slope, F[:, :, k], rtol=0, atol=1e-9)
    for k in range(2):
        turn = h * misalignment_from_epsilon(B[:, k], base)
        bases = [base.misaligned(s * turn) for s in (1, -1)]
        still = Gyro(np.zeros(6), NONE)
        slope = np.subtract(*(exact_rates(alpha, still, turned) for turned in bases)) / (2 * h)
        np.testing.assert_allclose(slope, F[:, :, 8:] @ B[:, k], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("scheme", "end"),
    [
        ("polar", (-0.446484785153, -0.221557125668)),
        ("horizontal", (-1.348712177016, 0.060034475091)),
        ("vertical", (-1.293042379393, -0.726207509876)),
    ],
)
def test_without_drift_the_rotor_keeps_its_direction(scheme: Scheme, end: tuple[float, float]) -> None:
    """m = 0: e3 rotates about u by -tau; from (0.3, -0.4) at tau = 1.7 (MATH 2.9)."""
    base = Base.mounted(scheme, LATITUDE)
    reached = solved(base, Gyro(np.zeros(6), NONE), (0.3, -0.4), 1.7)[-1]
    np.testing.assert_allclose(reached, end, rtol=0, atol=1e-11)  # solver 1e-13, 12 digits given


def test_gravity_drift_is_a_rotation_about_u_plus_m11_g() -> None:
    """m11 alone: rotation about u + m11 g by -tau |u + m11 g|: the angle of e3 to that axis stays."""
    base = Base.mounted("vertical", LATITUDE)
    m11 = 0.05
    gyro = Gyro(np.array([m11, 0, 0, 0, 0, 0]), NONE)
    axis = base.u + m11 * base.g
    alpha = solved(base, gyro, (0.3, -0.4), 3.0, 20)
    along = in_platform(axis, alpha)[:, 2]  # e3 is the platform's axis 3
    np.testing.assert_allclose(along, along[0], rtol=0, atol=1e-11)
    period = 2 * np.pi / np.linalg.norm(axis)
    np.testing.assert_allclose(
        solved(base, gyro, (0.1, 0.2), period)[-1] % (2 * np.pi), [0.1, 0.2], atol=1e-10
    )


def _without_earth(m: Float) -> tuple[Float, Float]:
    """gamma between e3 and up, and time, without the Earth's rate, in the vertical scheme."""
    base = Base(np.zeros(3), np.array([0.0, 0.0, -1.0]))
    alpha = solved(base, Gyro(m, NONE), (0.3, -0.4), 2.0, 11)
    return np.arccos(-in_platform(base.g, alpha)[:, 2]), np.linspace(0, 2, 11)


def test_radial_drift_alone() -> None:
    """m21: tan(gamma/2) goes as exp(-m21 tau); m22: tan(gamma) as exp(2 m22 tau) (MATH 2.9)."""
    gamma, tau = _without_earth(np.array([0, 0, 0.03, 0, 0, 0]))
    np.testing.assert_allclose(np.tan(gamma / 2), np.tan(gamma[0] / 2) * np.exp(-0.03 * tau), rtol=1e-11)
    gamma, tau = _without_earth(np.array([0, 0, 0, 0.03, 0, 0]))
    np.testing.assert_allclose(np.tan(gamma), np.tan(gamma[0]) * np.exp(2 * 0.03 * tau), rtol=1e-11)


def test_constant_drift_alone() -> None:
    """mc1: alpha2' = mc1; mc2: alpha1' = -mc2 / cos(alpha2); a sign error here leaves no residual."""
    base = Base(np.zeros(3), np.array([0.0, 0.0, -1.0]))
    alpha = np.array([[0.3, -0.4]])
    rates = exact_rates(alpha, Gyro(np.array([0, 0, 0, 0, 0.01, 0]), NONE), base)
    np.testing.assert_allclose(rates, [[0.0, 0.01]], atol=1e-17)
    rates = exact_rates(alpha, Gyro(np.array([0, 0, 0, 0, 0, 0.01]), NONE), base)
    np.testing.assert_allclose(rates, [[-0.01 / np.cos(-0.4), 0.0]], atol=1e-17)


@pytest.mark.parametrize(
    ("scheme", "by_base", "by_tilt"),
    [
        ("polar", 205.85, 1457.2),
        ("equatorial", 125.44, 43.34),
        ("horizontal", 293.40, 1004.8),
        ("vertical", 121.72, 1656.8),
    ],
)
def test_table_2(scheme: Scheme, by_base: float, by_tilt: float) -> None:
    """Largest effect of installation errors in 24 h [arcsec]; four digits are given."""
    base = Base.mounted(scheme, LATITUDE)
    m, minute = np.full(6, 0.01), np.deg2rad(1 / 60)
    chi = mounting_angles(scheme, LATITUDE)
    turn = rotation_vector_from_increments((minute, minute, minute), chi)
    run = solved(base, Gyro(m, NONE), (0.0, 0.0), DAY, 1441)
    with_turn = solved(base.misaligned(turn), Gyro(m, NONE), (0.0, 0.0), DAY, 1441)
    with_tilt = solved(base, Gyro(m, np.full(2, 10 * minute)), (0.0, 0.0), DAY, 1441)
    arcsec = 3600 * np.rad2deg(1)
    assert np.abs(with_turn - run).max() * arcsec == pytest.approx(by_base, rel=1e-4)
    assert np.abs(with_tilt - run).max() * arcsec == pytest.approx(by_tilt, rel=1e-4)
