"""Observability of a regression: directions, states, combinations, each on rows whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.numerics.observability import Combination, analyse, correlation, standard_deviations

Float = NDArray[np.float64]
NAMES = ("x", "y", "z")
INF = np.inf


def test_directions_of_a_known_triangle() -> None:
    # useful deviations 0.1: singular values are 0.1 times those of the rows
    rows = np.diag([1000.0, 50.0, 2.0])
    found = analyse(rows, NAMES, np.full(3, 0.1))
    np.testing.assert_allclose(found.singular_values, [100, 5, 0.2], rtol=1e-14)
    np.testing.assert_allclose(found.directions, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(found.standard_deviations, [1e-3, 0.02, 0.5], rtol=1e-14)
    np.testing.assert_allclose(found.standard_errors, [1e-3, 0.02, 0.5], rtol=1e-14)
    assert found.direction_states == ("determined", "determined", "weak")
    assert found.states == ("determined", "determined", "undetermined")
    assert found.combinations == ()
    assert found.condition == pytest.approx(500, rel=1e-14)


def test_many_rows_or_their_triangle_are_the_same() -> None:
    rows = np.random.default_rng(1).standard_normal((500, 3)) * [1, 10, 100]
    many = analyse(rows, NAMES, np.ones(3))
    few = analyse(np.linalg.qr(rows).R, NAMES, np.ones(3))
    np.testing.assert_allclose(many.singular_values, few.singular_values, rtol=1e-13)
    np.testing.assert_allclose(many.directions, few.directions, atol=1e-13)
    # the covariance of least squares
    expected = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(many.standard_errors, expected, rtol=1e-12)


def test_a_sum_is_determined_and_its_terms_are_not() -> None:
    rng = np.random.default_rng(2)
    u, v = rng.standard_normal((2, 100))
    rows = 1e3 * np.column_stack([u, v, -u])  # tell x - z, and y
    found = analyse(rows, NAMES, np.full(3, 0.01))
    assert found.direction_states == ("determined", "determined", "null")
    np.testing.assert_allclose(found.directions[2], [0.5**0.5, 0, 0.5**0.5], atol=1e-12)
    assert found.standard_deviations[2] == INF
    assert found.condition == INF
    assert found.states == ("combined", "determined", "combined")
    assert np.isinf(found.standard_errors[[0, 2]]).all()
    [combination] = found.combinations
    assert combination.terms == {"x": 1.0, "z": -1.0}
    assert combination.read() == "x - z"
    # both columns free: the covariance of x alone when z is fixed and y is free
    expected = np.sqrt(np.linalg.inv(rows[:, :2].T @ rows[:, :2])[0, 0])
    assert combination.standard_deviation == pytest.approx(expected, rel=1e-9)


def test_a_combination_of_an_estimate() -> None:
    rows = np.array([[1e3, 0, -0.7e3], [0, 1e3, 0]])
    [combination] = analyse(rows, NAMES, np.full(3, 0.01)).combinations
    assert combination.read(str.upper) == "X - 0.7 Z"
    covariance = np.array([[4.0, 0, 1], [0, 1, 0], [1, 0, 9]])
    value, error = combination.evaluate(NAMES, np.array([1.0, 2.0, 3.0]), covariance)
    assert value == pytest.approx(1 - 0.7 * 3, rel=1e-12)
    assert error == pytest.approx((4 - 2 * 0.7 + 0.49 * 9) ** 0.5, rel=1e-12)


def test_first_columns_lead_the_combinations() -> None:
    """Two sums of four: whichever order the columns have, the first two that can are kept."""
    rows = 1e3 * np.array([[1.0, 0, 1, 0.5], [0, 1, 0, 2]])
    useful = np.full(4, 0.01)
    found = analyse(rows, ("a", "b", "c", "d"), useful)
    assert [c.read() for c in found.combinations] == ["a + c + 0.5 d", "b + 2 d"]
    found = analyse(rows[:, [2, 3, 0, 1]], ("c", "d", "a", "b"), useful)
    assert [c.read() for c in found.combinations] == ["c + a - 0.25 b", "d + 0.5 b"]
    assert found.states == ("combined",) * 4


def test_what_cannot_matter_is_left_out_and_counted() -> None:
    """A term of 0.02 z with z within 0.1 adds 0.002 to a deviation of 0.001; useful is 0.01."""
    rows = np.array([[1e3, 0, 20.0, 1e3], [0, 1e3, 0, 0]])
    names, useful = (*NAMES, "w"), np.full(4, 0.01)
    known = analyse(rows, names, useful, extent=np.array([INF, INF, 0.1, INF]))
    assert [c.read() for c in known.combinations] == ["x + w"]
    assert known.combinations[0].standard_deviation == pytest.approx(np.hypot(0.001, 0.002), rel=1e-12)
    assert known.states == ("combined", "determined", "undetermined", "combined")
    unknown = analyse(rows, names, useful)
    assert [c.read() for c in unknown.combinations] == ["x + 0.02 z + w"]
    # with z within 0.5 the term matters
    wide = analyse(rows, names, useful, extent=np.array([INF, INF, 0.5, INF]))
    assert [c.read() for c in wide.combinations] == ["x + 0.02 z + w"]


def test_a_number_reads_as_simple_only_where_it_is_near() -> None:
    rows = np.array([[1e3, 0, -1.78e3], [0, 1e3, 0.99e3]])
    found = analyse(rows, NAMES, np.full(3, 0.01), extent=np.array([INF, INF, 0.02]))
    assert [c.read() for c in found.combinations] == ["x - 1.78 z", "y + z"]
    assert found.combinations[1].standard_deviation == pytest.approx(np.hypot(1e-3, 0.01 * 0.02), rel=1e-12)


def test_a_column_is_judged_by_the_rows_and_what_the_others_may_be() -> None:
    """x - z told to 1e-3, z within 0.004: x is told to hypot(1e-3, 4e-3), whatever x itself may be."""
    rows = np.array([[1e3, 0, -1e3]])
    for own in (INF, 1.0, 1e-3):
        extent = np.array([own, 1.0, 0.004])
        error = standard_deviations(rows, np.full(3, 0.01), extent=extent, basis=np.eye(3))
        assert error[0] == pytest.approx(np.hypot(1e-3, 4e-3), rel=1e-9)
        assert error[1] == INF
        assert error[2] == pytest.approx(np.hypot(1e-3, own), rel=1e-9)


def test_bound_columns() -> None:
    """(a, b, c) across (0, 0.6, 0.8), and e bound to 0: the bond is no lack of knowledge."""
    basis = np.zeros((5, 3))
    basis[0, 0] = basis[4, 2] = 1.0
    basis[1:3, 1] = 0.8, -0.6
    names = ("a", "b", "c", "e", "f")
    rng = np.random.default_rng(3)
    rows = 1e3 * rng.standard_normal((40, 5))
    found = analyse(rows, names, np.full(5, 0.01), basis=basis)
    assert found.direction_states == ("determined",) * 3
    assert found.states == ("determined", "determined", "determined", "given", "determined")
    # by q, of which all are free
    P = basis @ np.linalg.inv((rows @ basis).T @ (rows @ basis)) @ basis.T
    np.testing.assert_allclose(found.standard_errors, np.sqrt(np.diag(P)), rtol=1e-10)
    np.testing.assert_allclose(found.directions @ [0, 0.6, 0.8, 0, 0], 0, atol=1e-15)
    # rows that tell nothing of b and c: neither counts as more than undetermined, the bond makes no direction
    rows[:, 1:3] = 0.0
    found = analyse(rows, names, np.full(5, 0.01), basis=basis)
    assert found.direction_states == ("determined", "determined", "null")
    np.testing.assert_allclose(found.directions[2], [0, 0.8, -0.6, 0, 0], atol=1e-12)
    assert found.states == ("determined", "undetermined", "undetermined", "given", "determined")
    # a + f - b: c hangs on b, and is combined with it
    rows = np.column_stack(
        [rng.standard_normal((40, 1)) * [1e3, -1e3, 0], np.zeros(40), 1e3 * rng.standard_normal(40)]
    )
    found = analyse(rows, names, np.full(5, 0.01), basis=basis)
    assert [c.read() for c in found.combinations] == ["a - b"]
    assert found.states == ("combined", "combined", "combined", "given", "determined")


def test_null_vectors_are_readable_whatever_the_singular_vectors() -> None:
    """A null space of two dimensions: its echelon form, not one of the endless mixtures."""
    null = np.array([[1.0, 0, 0.5, 0, -0.3], [0, 1.0, 0, 0, 0.7]])
    Q = np.linalg.qr(null.T, mode="complete").Q
    rows = 100 * np.random.default_rng(4).standard_normal((30, 3)) @ Q[:, 2:].T
    found = analyse(rows, tuple("abcde"), np.ones(5))
    assert found.direction_states == ("determined",) * 3 + ("null",) * 2
    expected = null / np.linalg.norm(null, axis=1)[:, np.newaxis]
    np.testing.assert_allclose(found.directions[3:], expected, atol=1e-12)


def test_fewer_rows_than_columns() -> None:
    found = analyse(np.array([[100.0, 0, 0]]), NAMES, np.ones(3))
    assert found.direction_states == ("determined", "null", "null")
    assert found.states == ("determined", "undetermined", "undetermined")


def test_rows_that_tell_nothing_or_too_little() -> None:
    for rows in (np.zeros((4, 3)), 1e-3 * np.eye(3)):
        found = analyse(rows, NAMES, np.ones(3), extent=np.array([10.0, 1.0, INF]))
        assert found.states == ("undetermined",) * 3
        assert found.combinations == ()
    assert found.direction_states == ("weak",) * 3
    np.testing.assert_allclose(found.standard_errors, 1e3, rtol=1e-6)  # less the extents' 1 in 1e6


def test_the_most_precise_rows_do_not_hide_an_extent() -> None:
    """x - z told to 1e-15, z within 0.004; the rows' own rounding is no knowledge of x + z."""
    rng = np.random.default_rng(5)
    rows = 1e14 * rng.standard_normal((50, 1)) * np.array([1, 0, -1])
    rows += 10 * rng.standard_normal((50, 3))
    error = standard_deviations(rows, np.full(3, 0.01), extent=np.array([1.0, INF, 0.004]), basis=np.eye(3))
    assert error[0] == pytest.approx(0.004, rel=1e-6)
    assert error[2] == pytest.approx(1.0, rel=1e-3)


def test_correlation() -> None:
    covariance = np.array([[4.0, 1, 0], [1, 9, 0], [0, 0, 0]])
    expected = np.array([[1, 1 / 6, 0], [1 / 6, 1, 0], [0, 0, 0]])
    np.testing.assert_allclose(correlation(covariance), expected, rtol=1e-15)
    # the products of two such errors, 1e-340, are no floats
    small = correlation(np.diag([1e-300, 1e-320]))
    np.testing.assert_allclose(small, np.eye(2), rtol=1e-3)  # 1e-320 has three digits
    unknown = np.diag([4.0, 9.0, np.inf]) + np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 0]])
    np.testing.assert_allclose(correlation(unknown), expected, rtol=1e-15)


def test_a_combination_is_of_its_terms_alone() -> None:
    covariance = np.diag([4.0, 9.0, np.inf])
    value, error = Combination({"a": 1.0, "b": -2.0}, 0.0).evaluate(("a", "b", "c"), np.ones(3), covariance)
    assert value == pytest.approx(-1.0, rel=1e-15)
    assert error == pytest.approx(40**0.5, rel=1e-15)
