"""Least squares: exactness, honest uncertainty, and what is not determined is said."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.numerics.least_squares import solve

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
