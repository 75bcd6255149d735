"""What a run tells of a gyro: the paper's variants 1 to 4 as MATH 2.4 corrects them, and the null vector."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.models.drift_observability import drift_observability, expression, extents, useful_deviations
from pipeline.models.drift_problem import Arc, Parameter, Prior, Problem
from pipeline.models.drift_regression import integrals, transitions
from pipeline.models.drift_rows import columns_of
from pipeline.models.drift_trajectory import linear_trajectory
from pipeline.models.earth import RATE, Base, Scheme
from pipeline.models.gyro_drift import DRIFT, PARAMETERS, TILT, linear_model
from pipeline.numerics.least_squares import triangular
from pipeline.numerics.observability import Observability, analyse

Float = NDArray[np.float64]
LATITUDE = np.deg2rad(55.75)
SIN, COS = np.sin(LATITUDE), np.cos(LATITUDE)
ARCMIN, ARCSEC = float(np.deg2rad(1 / 60)), float(np.deg2rad(1 / 3600))
USEFUL = np.array([0.01 / 15.041067, ARCMIN])
"""0.01 degrees an hour, and 1 arc minute."""
PRIORS = (
    {name: Prior(0.0, 0.1) for name in DRIFT}
    | {name: Prior(0.0, 15 * ARCMIN) for name in TILT}
    | {"epsilon": Prior(0.0, 1.5 * ARCMIN)}
)
TAU = np.arange(24 * 60 + 1) * (60 * RATE)
SMALL = np.array([0.004, -0.002, 0.003, 0.0015, -0.001, 0.002])
LARGE = np.full(6, 0.01)
SCHEMES: tuple[Scheme, ...] = ("polar", "equatorial", "horizontal", "vertical")


def angles(scheme: Scheme, start: tuple[float, float], m: Float) -> Float:
    p = np.concatenate([m, np.zeros(5)])
    return linear_trajectory(p, Base.mounted(scheme, LATITUDE), np.array(start), TAU)


def rows_of(scheme: Scheme, alpha: Float, m: Float) -> Float:
    """Rows of 1 arcsec of noise each minute, columns as `PARAMETERS`, initial angles projected out.

    The trapezoid rule serves: what vanishes in F vanishes in its sums, and nothing is estimated here.
    """
    base = Base.mounted(scheme, LATITUDE)
    _, F = linear_model(alpha, base)
    steps = (TAU[1] - TAU[0]) / 2 * (F[1:] + F[:-1])
    phi = transitions(TAU, alpha, base, np.concatenate([m, np.zeros(5)]))
    A = np.zeros((len(TAU), 2, 2 + 11))
    A[0, :, :2] = np.eye(2)
    for j in range(len(TAU) - 1):
        A[j + 1] = phi[j] @ A[j]
        A[j + 1, :, 2:] += steps[j]
    return triangular(A.reshape(-1, 13))[2:, 2:] / ARCSEC


def problem(scheme: Scheme, alpha: Float, priors: dict[str, Prior] = PRIORS) -> Problem:
    arc = Arc(0, TAU, alpha, np.ones(len(TAU), dtype=np.bool_))
    return Problem((Base.mounted(scheme, LATITUDE),), (arc,), priors)


def told(scheme: Scheme, start: tuple[float, float], m: Float) -> Observability[Parameter]:
    alpha = angles(scheme, start, m)
    return drift_observability(rows_of(scheme, alpha, m), problem(scheme, alpha), USEFUL)


def states(found: Observability[Parameter]) -> dict[str, str]:
    return {p.name: state for p, state in zip(found.names, found.states, strict=True)}


def free_of(names: tuple[str, ...], rows: Float) -> Observability[str]:
    """The rows of some columns alone, u.epsilon = 0 not imposed: what the paper looks at."""
    columns = [PARAMETERS.index(name) for name in names]
    useful = useful_deviations([Parameter(name) for name in names], USEFUL)
    return analyse(rows[:, columns], names, useful)


def test_variant_1_polar_small_angles() -> None:
    """m11 to m22 and two combinations of the rest are told."""
    found = told("polar", (0.02, -0.01), SMALL)
    assert states(found) == dict.fromkeys(DRIFT[:4], "determined") | dict.fromkeys(
        (*DRIFT[4:], *TILT, "epsilon1", "epsilon2"), "combined"
    ) | {"epsilon3": "given"}
    assert [expression(c, 1) for c in found.combinations] == [
        "mc1 - theta1 - epsilon2",
        "mc2 - theta2 + epsilon1",
    ]
    for combination in found.combinations:
        assert combination.standard_deviation < USEFUL[0] / 10


def test_variant_1_has_a_weak_direction() -> None:
    """The paper's set, mc1' and mc2' as mc1 and mc2: (m11, mc2', epsilon3) ~ (1, cos phi, sin phi)."""
    names = ("m11", "m12", "m21", "m22", "mc1", "mc2", "epsilon3")
    rows = rows_of("polar", angles("polar", (0.02, -0.01), SMALL), SMALL)
    found = free_of(names, rows)
    # mc2 stands for mc2 + epsilon1 to first order in the angles: of the exact null vector m11 = 1,
    # epsilon = -g the remainder is of second order, 5e-4, against the first order, 0.02, that tells m11
    weak = np.array([1, 0, 0, 0, 0, COS, SIN]) / 2**0.5
    assert found.direction_states == ("determined",) * 6 + ("weak",)
    np.testing.assert_allclose(found.directions[6], weak * np.sign(found.directions[6] @ weak), atol=0.02)
    without = free_of(names[:-1], rows)
    assert without.states == ("determined",) * 6


def test_variant_2_polar_arbitrary_angles() -> None:
    """All, with u.epsilon = 0."""
    found = told("polar", (0.6, 0.5), LARGE)
    assert states(found) == dict.fromkeys(PARAMETERS, "determined") | {"epsilon3": "given"}
    assert found.direction_states == ("determined",) * 10
    assert found.combinations == ()


@pytest.mark.parametrize("inner", [0.0, 0.6])
def test_variants_3_and_4_equatorial_at_constant_angle(inner: float) -> None:
    """(m11, mc2', epsilon3) ~ (1, sin phi, cos phi) is unobservable at any constant alpha2; so is theta."""
    alpha = np.column_stack([-TAU, np.full(len(TAU), inner)])
    rows = rows_of("equatorial", alpha, np.zeros(6))
    found = drift_observability(rows, problem("equatorial", alpha, {}), USEFUL)
    assert found.direction_states == ("determined",) * 7 + ("null",) * 3
    # mc2 enters row 1 as -1/cos alpha2, epsilon1 as -1: mc2' = mc2 + epsilon1 cos alpha2; u.epsilon = 0 holds
    null = np.zeros(11)
    null[[0, 5, 10]] = 1, SIN * np.cos(inner), COS
    np.testing.assert_allclose(found.directions[7], null / np.linalg.norm(null), atol=1e-9)
    np.testing.assert_allclose(found.directions[8:], np.eye(11)[6:8], atol=1e-9)
    assert states(found) == {
        **dict.fromkeys(("m12", "m21", "m22", "mc1", "epsilon2"), "determined"),
        **dict.fromkeys(("m11", "mc2", "epsilon3"), "combined"),
        **dict.fromkeys(TILT, "undetermined"),
        "epsilon1": "given",
    }
    [first, second] = found.combinations
    assert first.terms == pytest.approx({Parameter("m11"): 1.0, Parameter("epsilon3", 0): -1 / COS})
    tangent = SIN * np.cos(inner) / COS
    assert second.terms == pytest.approx({Parameter("mc2"): 1.0, Parameter("epsilon3", 0): -tangent})


def test_variant_3_in_the_papers_own_columns() -> None:
    """Without u.epsilon = 0, at alpha2 = 0: mc2 and epsilon1 are one column, mc2' = mc2 + epsilon1."""
    alpha = np.column_stack([-TAU, np.zeros(len(TAU))])
    names = tuple(name for name in PARAMETERS if name not in TILT)
    found = free_of(names, rows_of("equatorial", alpha, np.zeros(6)))
    assert [c.read() for c in found.combinations] == ["m11 - 1.78 epsilon3", "mc2 + epsilon1 - 1.47 epsilon3"]
    assert found.direction_states == ("determined",) * 7 + ("null",) * 2


def test_variant_4_equatorial_moving_inner_angle() -> None:
    """All but theta1, theta2, once alpha2 moves: by m = 0.01 of each it does."""
    found = told("equatorial", (0.0, 0.6), LARGE)
    assert found.direction_states == ("determined",) * 8 + ("null",) * 2
    assert states(found) == dict.fromkeys(PARAMETERS, "determined") | dict.fromkeys(TILT, "undetermined") | {
        "epsilon1": "given"
    }


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_null_vector_of_every_scheme(scheme: Scheme) -> None:
    """``m11 = 1, epsilon = -g_zeta`` of (6.9), exact, where u.epsilon = 0 is not imposed."""
    base = Base.mounted(scheme, LATITUDE)
    alpha = angles(scheme, {"polar": (0.6, 0.5), "equatorial": (0.0, 0.6)}.get(scheme, (0.0, 0.0)), LARGE)
    rows = rows_of(scheme, alpha, LARGE)
    null = np.zeros(11)
    null[0], null[8:] = 1.0, -base.g
    # sums of 1440 steps, each rounded at 1e-16 of the whole
    assert np.linalg.norm(rows @ null) < 1e-12 * np.linalg.norm(rows)
    useful = useful_deviations([Parameter(name) for name in PARAMETERS], USEFUL)
    found = analyse(rows, PARAMETERS, useful)
    bonds = [d for d, s in zip(found.directions, found.direction_states, strict=True) if s == "null"]
    assert len(bonds) == (3 if scheme == "equatorial" else 1)
    np.testing.assert_allclose(bonds[0], null / np.linalg.norm(null), atol=1e-8)
    # imposed, it is gone: g and u are not orthogonal
    imposed = drift_observability(rows, problem(scheme, alpha), USEFUL)
    assert imposed.direction_states.count("null") == len(bonds) - 1


def test_the_rows_of_a_problem() -> None:
    """Integrals with eta, spread to epsilon by B, say the same as rows with epsilon."""
    alpha = angles("vertical", (0.0, 0.0), LARGE)
    given = problem("vertical", alpha)
    steps = integrals(TAU, alpha, given.bases[0], "trapezoid", errors=True)
    A, _, _ = steps.cumulative(alpha)
    rows = triangular(A)[2:, 2:] / ARCSEC @ columns_of(given).expansion.T
    found = drift_observability(rows, given, USEFUL)
    _, F = linear_model(alpha, given.bases[0])
    named = np.concatenate([np.zeros((1, 2, 11)), np.cumsum((F[1:] + F[:-1]) * (TAU[1] / 2), axis=0)])
    expected = drift_observability((named - named.mean(axis=0)).reshape(-1, 11) / ARCSEC, given, USEFUL)
    np.testing.assert_allclose(found.singular_values, expected.singular_values, rtol=1e-9)
    np.testing.assert_allclose(found.standard_errors, expected.standard_errors, rtol=1e-8)


def test_priors_and_names() -> None:
    parameters = (Parameter("m11"), Parameter("theta2"), Parameter("epsilon3", 1))
    np.testing.assert_allclose(extents(parameters, PRIORS), [0.1, 15 * ARCMIN, 1.5 * ARCMIN])
    assert np.isinf(extents(parameters, {})).all()
    np.testing.assert_allclose(useful_deviations(parameters, USEFUL), USEFUL[[0, 1, 1]])
    found = told("polar", (0.02, -0.01), SMALL).combinations[0]
    assert expression(found, 2) == "mc1 - theta1 - epsilon2 of run 0"
