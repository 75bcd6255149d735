"""Least squares: exactness, honest uncertainty, and what is not determined is said."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.numerics.least_squares import solve, triangular

NAMES = ("x", "y", "z")


def test_exact_rows_give_the_parameters() -> None:
    rng = np.random.default_rng(1)
    A, p = rng.standard_normal((50, 3)), np.array([1.0, -2.0, 3.0])
    solution = solve(A, A @ p, NAMES)
    np.testing.assert_allclose(solution.estimate, p, rtol=1e-13)  # condition below 2
    assert solution.rank == 3
    assert solution.condition == pytest.approx(np.linalg.cond(A), rel=1e-12)


def test_error_over_standard_error_is_standard_normal() -> None:
    rng = np.random.default_rng(2)
    A, p = rng.standard_normal((40, 3)), np.array([1.0, -2.0, 3.0])
    scores = []
    for _ in range(2000):
        solution = solve(A, A @ p + 0.3 * rng.standard_normal(40), NAMES)
        scores.append((solution.estimate - p) / solution.standard_errors)
    # student's t with 37 degrees of freedom has 1.028; 2000 draws of three spread by 0.016 each
    assert np.std(scores, axis=0) == pytest.approx(1.028, abs=0.05)


def test_a_null_direction_is_named_and_left_at_nothing() -> None:
    A = np.random.default_rng(3).standard_normal((30, 2)) @ np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    solution = solve(A, A @ np.array([1.0, 5.0, 1.0]), NAMES)
    assert solution.rank == 2
    assert solution.condition == float("inf")
    np.testing.assert_allclose(np.abs(solution.directions[2]), [0.5**0.5, 0, 0.5**0.5], atol=1e-14)
    np.testing.assert_allclose(solution.estimate, [1.0, 5.0, 1.0], rtol=1e-13)  # the shortest that fits


def test_a_prior_decides_what_the_rows_do_not() -> None:
    A = np.array([[1.0, 0.0], [1.0, 0.0]])
    solution = solve(A, np.array([2.0, 2.0]), ("x", "y"), prior=np.array([np.inf, 0.5]), sigma=0.1)
    np.testing.assert_allclose(solution.estimate, [2.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(solution.standard_errors, [0.1 / 2**0.5, 0.5], rtol=1e-13)


def test_prior_and_rows_are_weighed_by_their_variances() -> None:
    solution = solve(np.ones((1, 1)), np.array([1.0]), ("x",), prior=np.array([2.0]), sigma=1.0)
    np.testing.assert_allclose(solution.estimate, [4 / 5], rtol=1e-14)
    np.testing.assert_allclose(solution.standard_errors, [(4 / 5) ** 0.5], rtol=1e-14)


def test_many_rows_are_solved_as_few() -> None:
    """By QR first: against numpy's own solution of all rows."""
    rng = np.random.default_rng(5)
    A = rng.standard_normal((5000, 3)) * [1.0, 10.0, 1e-3]
    b = A @ [1.0, 2.0, 3.0] + 0.1 * rng.standard_normal(5000)
    solution = solve(A, b, NAMES)
    expected, rss, *_ = np.linalg.lstsq(A, b, rcond=None)
    np.testing.assert_allclose(solution.estimate, expected, rtol=1e-11)  # condition 1e4
    assert solution.sigma == pytest.approx((rss[0] / 4997) ** 0.5, rel=1e-12)
    np.testing.assert_allclose(solution.singular_values, np.linalg.svd(A)[1], rtol=1e-11)
    np.testing.assert_allclose(solution.residual, b - A @ expected, atol=1e-11)
    covariance = solution.sigma**2 * np.linalg.inv(A.T @ A)
    np.testing.assert_allclose(solution.covariance, covariance, rtol=1e-9, atol=1e-12 * covariance.max())
    np.testing.assert_allclose(solution.factor @ solution.factor.T, solution.covariance, rtol=1e-13)


def test_triangles_stand_for_their_rows() -> None:
    rng = np.random.default_rng(6)
    A, b = rng.standard_normal((400, 3)), rng.standard_normal(400)
    halves = [triangular(np.column_stack([A[part], b[part]])) for part in (slice(0, 100), slice(100, None))]
    rows = np.concatenate(halves)
    prior = np.array([1.0, 0.01, np.inf])
    whole = solve(A, b, NAMES, prior=prior)
    few = solve(rows[:, :3], rows[:, 3], NAMES, prior=prior, observations=400)
    np.testing.assert_allclose(few.estimate, whole.estimate, rtol=1e-11)
    np.testing.assert_allclose(few.covariance, whole.covariance, rtol=1e-11)
    assert few.sigma == pytest.approx(whole.sigma, rel=1e-12)


def test_triangle_of_fewer_rows_than_columns_is_square() -> None:
    R = triangular(np.array([[3.0, 4.0, 5.0]]))
    np.testing.assert_allclose(np.abs(R), [[3, 4, 5], [0, 0, 0], [0, 0, 0]], atol=1e-15)


def test_a_prior_has_its_mean() -> None:
    mean, prior = np.array([5.0, -1.0]), np.array([2.0, 0.5])
    solution = solve(np.array([[1.0, 0.0]]), np.ones(1), ("x", "y"), prior=prior, prior_mean=mean, sigma=1.0)
    # weights 1 and 1/4 of 1 and 5; y has its prior alone
    np.testing.assert_allclose(solution.estimate, [9 / 5, -1.0], rtol=1e-14)
    np.testing.assert_allclose(solution.standard_errors, [(4 / 5) ** 0.5, 0.5], rtol=1e-14)


def test_a_weak_prior_is_not_lost_beside_strong_rows() -> None:
    """Rows 1e15 times as strong as the prior leave a direction to it: its deviation is kept."""
    A = np.array([[1e6, 0.0], [1e6, 0.0], [1e6, 0.0]])
    solution = solve(A, np.full(3, 1e6), ("x", "y"), prior=np.array([1.0, 1.0]), sigma=1e-9)
    np.testing.assert_allclose(solution.estimate, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(solution.standard_errors, [1e-15 / 3**0.5, 1.0], rtol=1e-9)
    assert not len(solution.unknown)


def test_what_neither_rows_nor_priors_tell_is_named() -> None:
    A = np.random.default_rng(3).standard_normal((30, 2)) @ np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    solution = solve(A, A @ np.array([1.0, 5.0, 1.0]), NAMES)
    np.testing.assert_allclose(np.abs(solution.unknown), [[0.5**0.5, 0, 0.5**0.5]], atol=1e-14)
    with_prior = solve(A, A @ np.ones(3), NAMES, prior=np.array([1.0, np.inf, np.inf]), sigma=1.0)
    assert not len(with_prior.unknown)
