"""Regression for the drift against MATH 2.5 and 2.8: quadrature errors, conditioning, Table 3."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.models.drift_regression import Quadrature, integrals, jacobian, transitions
from pipeline.models.earth import Base, Scheme, mounting_angles, rotation_vector_from_increments
from pipeline.models.gyro_drift import PARAMETERS, Gyro, exact_rates, linear_model
from pipeline.numerics.least_squares import Solution, solve

Float = NDArray[np.float64]
SCHEMES: tuple[Scheme, ...] = ("polar", "equatorial", "horizontal", "vertical")
LATITUDE, DAY, ARCMIN = np.deg2rad(55.75), 6.300387, np.deg2rad(1 / 60)
DEGREES_PER_HOUR = 15.041067
START = {"polar": (0.6, 0.5), "equatorial": (0.0, 0.6), "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)}
M = np.full(6, 0.01)


def times(minutes: int) -> Float:
    return np.linspace(0, DAY, 24 * 60 // minutes + 1)


def misalignment(scheme: Scheme) -> Float:
    return rotation_vector_from_increments((ARCMIN, ARCMIN, ARCMIN), mounting_angles(scheme, LATITUDE))


@cache
def linear_truth(scheme: Scheme, start: tuple[float, float]) -> Float:
    """Angles each minute of a day by the linear model with theta = 10', Delta chi = 1', to 1e-13."""
    tau = times(1)
    base = Base.mounted(scheme, LATITUDE)
    p = np.concatenate([M, [10 * ARCMIN] * 2, np.cross(base.u, misalignment(scheme))])

    def rates(_: float, alpha: Float) -> Float:
        c, F = linear_model(alpha[np.newaxis], base)
        return (c + F @ p)[0]

    # a step a sample: between its steps DOP853's values are of a lower order than at their ends
    step = tau[1] - tau[0]
    options = {"method": "DOP853", "t_eval": tau, "first_step": step, "max_step": step, "rtol": 1e-13}
    return solve_ivp(rates, (0, tau[-1]), start, atol=1e-14, **options).y.T


def segment_solution(
    scheme: Scheme, tau: Float, alpha: Float, quadrature: Quadrature, length: int, *, errors: bool
) -> Solution:
    rows = integrals(tau, alpha, Base.mounted(scheme, LATITUDE), quadrature, errors=errors)
    return solve(*rows.segments(alpha, length), rows.names)


ERRORS = {
    # minutes: (trapezoid, Simpson), bound of the quintic spline; I, II, III, IV, in degrees an hour
    1: ((2e-4, 2e-6, 6e-4, 2e-4), (4e-9, 1e-11, 2e-8, 2e-9), 5e-12),
    5: ((5e-3, 5e-5, 2e-2, 4e-3), (2e-6, 8e-9, 2e-5, 1e-6), 1e-9),
    10: ((2e-2, 2e-4, 6e-2, 2e-2), (4e-5, 1e-7, 2e-4, 2e-5), 8e-8),
}


@pytest.mark.parametrize("minutes", ERRORS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_quadrature_decides_the_accuracy(scheme: Scheme, minutes: int) -> None:
    """The table of MATH 2.5, within its factor 3; segments of 60 min, noise-free."""
    tau, alpha = times(minutes), linear_truth(scheme, START[scheme])[::minutes]
    trapezoid, simpson, quintic = ERRORS[minutes]
    k = SCHEMES.index(scheme)

    def error(quadrature: Quadrature) -> float:
        solution = segment_solution(scheme, tau, alpha, quadrature, 60 // minutes, errors=True)
        return float(np.abs(solution.estimate[:6] - M).max()) * DEGREES_PER_HOUR

    assert trapezoid[k] / 3 < error("trapezoid") < 3 * trapezoid[k]
    assert error("simpson") < 3 * simpson[k]
    assert error("quintic_spline") < 3 * quintic


@pytest.mark.parametrize(
    ("scheme", "start", "drift", "whole"),
    [
        ("polar", (0.0, 0.0), 731, 1.1e7),
        ("polar", (0.02, -0.01), 299, 1.8e6),
        ("polar", (0.6, 0.5), 6.6, 277),
        ("polar", (1.0, 0.2), 4.1, 79),
        ("horizontal", (0.0, 0.0), 18.7, 72),
        ("vertical", (0.0, 0.0), 9.9, 801),
        ("vertical", (0.5, -0.5), 5.3, 46),
    ],
)
def test_condition(scheme: Scheme, start: tuple[float, float], drift: float, whole: float) -> None:
    """MATH 2.5: segments of 10 samples, 1 min, Simpson; 6 parameters, and with the installation errors."""
    tau = times(1)
    alpha = linear_truth(scheme, start)
    # two or three digits are given
    found = segment_solution(scheme, tau, alpha, "simpson", 10, errors=False).condition
    assert found == pytest.approx(drift, rel=0.02)
    found = segment_solution(scheme, tau, alpha, "simpson", 10, errors=True).condition
    assert found == pytest.approx(whole, rel=0.05)


@pytest.mark.parametrize(
    ("scheme", "by_base", "by_tilt"),
    [
        ("polar", 0.006862, 0.043869),
        ("equatorial", 0.007882, 0.001442),
        ("horizontal", 0.012817, 0.144208),
        ("vertical", 0.003945, 0.044220),
    ],
)
def test_table_3(scheme: Scheme, by_base: float, by_tilt: float) -> None:
    """Error of m when the regression knows nothing of the installation errors; four digits are given."""
    tau = times(1)
    base = Base.mounted(scheme, LATITUDE)
    no_tilt, tilt = np.zeros(2), np.full(2, 10 * ARCMIN)
    for standing, theta, expected in (
        (base.misaligned(misalignment(scheme)), no_tilt, by_base),
        (base, tilt, by_tilt),
    ):
        gyro = Gyro(M, theta)

        def rates(_: float, alpha: Float, gyro: Gyro = gyro, standing: Base = standing) -> Float:
            return exact_rates(alpha[np.newaxis], gyro, standing)[0]

        alpha = solve_ivp(rates, (0, DAY), (0, 0), "DOP853", t_eval=tau, rtol=1e-13, atol=1e-14).y.T
        solution = segment_solution(scheme, tau, alpha, "simpson", 10, errors=False)
        error = np.abs(solution.estimate - M).max() * DEGREES_PER_HOUR
        assert error == pytest.approx(expected, rel=1e-3)


def test_cumulative_least_squares_knows_its_error() -> None:
    """White noise of 1 arcsec on the angles, 200 seeds: error over standard error is a standard normal."""
    tau, noise = times(1), np.deg2rad(1 / 3600)
    base = Base.mounted("horizontal", LATITUDE)
    exact = linear_truth("horizontal", (0.0, 0.0))
    scores = []
    for seed in range(200):
        alpha = exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)
        rows = integrals(tau, alpha, base, "cubic_spline", errors=True)
        A, b, names = rows.cumulative(alpha)
        solution = solve(A, b, names)
        scores.append((solution.estimate[2:8] - M) / solution.standard_errors[2:8])
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.9) & (spread < 1.1)), spread  # two sigma of what 200 seeds tell


@pytest.mark.parametrize("scheme", SCHEMES)
def test_jacobian_is_the_derivative_of_the_rates(scheme: Scheme) -> None:
    """By complex step, which loses no digits; parameters of 0.1, and a row a sample of them."""
    rng = np.random.default_rng(1)
    base, alpha = Base.mounted(scheme, LATITUDE), rng.uniform(-1, 1, (50, 2))
    p = 0.1 * rng.standard_normal((50, len(PARAMETERS)))
    J = jacobian(alpha, base, p)
    for k in range(2):
        c, F = linear_model(alpha + 1e-30j * np.eye(2)[k], base)
        derivative = (c + np.einsum("ijk,ik->ij", F, p)).imag / 1e-30
        np.testing.assert_allclose(J[:, :, k], derivative, rtol=0, atol=1e-14)  # values up to 5
    np.testing.assert_array_equal(jacobian(alpha[:1], base, p[0]), J[:1])


@pytest.mark.parametrize("scheme", SCHEMES)
def test_transitions_carry_a_deviation_along(scheme: Scheme) -> None:
    """The product of a day's transitions, against trajectories from neighbouring starts."""
    tau, base = times(5), Base.mounted(scheme, LATITUDE)
    p = np.concatenate([M, [10 * ARCMIN] * 2, np.cross(base.u, misalignment(scheme))])

    def rates(_: float, alpha: Float) -> Float:
        c, F = linear_model(alpha[np.newaxis], base)
        return (c + F @ p)[0]

    def run(start: Float) -> Float:
        return solve_ivp(rates, (0, DAY), start, "DOP853", t_eval=tau, rtol=1e-12, atol=1e-13).y.T

    start = np.array(START[scheme])
    alpha, step = run(start), 1e-5
    ends = [(run(start + d)[-1] - run(start - d)[-1]) / (2 * step) for d in step * np.eye(2)]
    grown = np.eye(2)
    for phi in transitions(tau, alpha, base, p):
        grown = phi @ grown
    # of second order: (h J)^3 / 12 and the like, 300 times
    np.testing.assert_allclose(grown, np.transpose(ends), atol=1e-3 * np.abs(ends).max())


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 9, 10])
@pytest.mark.parametrize("quadrature", ["trapezoid", "simpson", "cubic_spline", "quintic_spline"])
def test_every_count_of_samples_is_integrated(quadrature: Quadrature, count: int) -> None:
    """The rule keeps its order on any count that allows it; c and F are no polynomials, so to an error."""
    base, step = Base.mounted("polar", LATITUDE), 0.01
    fine = np.linspace(0, step * (count - 1), 100 * (count - 1) + 1)
    path = np.stack([0.6 - fine, 0.5 + 0.3 * fine], axis=1)
    alpha, tau = path[::100], fine[::100]
    exact = integrals(fine, path, base, "quintic_spline", errors=True)
    rows = integrals(tau, alpha, base, quadrature, errors=True)
    orders = {"trapezoid": 2, "simpson": 3, "cubic_spline": 4, "quintic_spline": 6}
    order = min(orders[quadrature], count)
    # a local error of order h^(order + 1); functions of unit size and rate
    bound = 3 * step ** (order + 1) + 1e-15
    assert len(rows.c) == count - 1
    found, expected = rows.F, exact.F.reshape(count - 1, 100, 2, -1).sum(axis=1)
    assert np.abs(found - expected).max() < bound
    assert np.abs(rows.c - exact.c.reshape(count - 1, 100, 2).sum(axis=1)).max() < bound
