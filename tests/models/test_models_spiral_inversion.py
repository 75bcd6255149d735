"""The drift from a spiral about the pole, against MATH 2.6."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.models.drift_problem import Arc, Parameter, Prior, Problem
from pipeline.models.drift_trajectory import trajectory
from pipeline.models.earth import RATE, Base
from pipeline.models.gyro_drift import DRIFT, Gyro
from pipeline.models.polar_spiral import Ellipse, Spiral, SpiralError, fit_ellipse, fit_spiral
from pipeline.models.spiral_inversion import INVERSIONS, invert_ellipse, invert_spiral, spiral_estimates

Float = NDArray[np.float64]
LATITUDE = np.deg2rad(55.75)
DEGREES_PER_HOUR = 15.041067
M = np.array([0.004, -0.002, 0.003, 0.0015, -0.001, 0.002])
TAU = np.arange(24 * 60 + 1) * (60 * RATE)
MC, M1, M2 = list(INVERSIONS)[:3]


def spiral_of(figures: tuple[float, ...], covariance: Float | None = None) -> Spiral:
    c1, c2, r, decay, nu, psi = figures
    P = np.zeros((6, 6)) if covariance is None else covariance
    return Spiral(c1, c2, r, decay, nu, psi, P, 0.0, np.zeros((0, 2)))


ORACLE = spiral_of((-7e-4, -2.1e-3, 0.022, 9e-4, 0.9946, 0.364))


def known(sigma: float = 0.0, **values: float) -> dict[str, Prior]:
    return {name: Prior(value, sigma) for name, value in values.items()}


def arc(start: tuple[float, float] = (0.02, -0.01)) -> Arc:
    alpha = trajectory(Gyro(M, np.zeros(2)), Base.mounted("polar", LATITUDE), np.array(start), TAU)
    return Arc(0, TAU, alpha, np.ones(len(TAU), dtype=np.bool_))


@pytest.mark.parametrize(
    ("method", "given", "expected"),
    [
        (MC, {"mc1": -0.001, "mc2": 0.002}, (0.004040, -0.001963, 0.002931, 0.001450, -0.001, 0.002)),
        (M1, {"m11": 0.004, "m21": 0.003}, (0.004, -0.001994, 0.003, 0.001505, -0.000988, 0.002007)),
        (M2, {"m12": -0.002, "m22": 0.0015}, (0.003993, -0.002, 0.002994, 0.0015, -0.000989, 0.002008)),
    ],
)
def test_oracle(method: str, given: dict[str, float], expected: tuple[float, ...]) -> None:
    m, _ = invert_spiral(ORACLE, LATITUDE, method, known(**given))
    np.testing.assert_allclose(m, expected, atol=5e-7)  # six digits are given


def test_the_formulas_of_the_paper() -> None:
    """(4.5), (4.6) and MATH's others, as they are written there, at another latitude."""
    rng = np.random.default_rng(4)
    latitude = np.deg2rad(-41.0)
    s, c, s2 = np.sin(latitude), np.cos(latitude), np.sin(2 * latitude)
    D = 1 - 3 * s**2
    c1, c2, decay, nu = (*rng.normal(0, 1e-3, 2), rng.normal(0, 1e-3), 1 + rng.normal(0, 1e-3))
    spiral = spiral_of((c1, c2, 0.02, decay, nu, 0.3))
    given = dict(zip(DRIFT, rng.normal(0, 1e-3, 6), strict=True))
    mc1, mc2 = given["mc1"], given["mc2"]
    m12 = ((1 - nu) * c + (c2 - mc2) * s) / c**3
    m22 = ((mc1 - c1) * s + decay * c) / c**3
    by_mc = ((-c2 + mc2 + m12 * s2) / c, m12, (c1 - mc1 + m22 * s2) / c, m22, mc1, mc2)
    m11, m21 = given["m11"], given["m21"]
    m12, m22 = (1 - nu - m11 * s) / D, (decay - m21 * s) / D
    by_m1 = (m11, m12, m21, m22, c1 - m21 * c + m22 * s2, c2 + m11 * c - m12 * s2)
    m12, m22 = given["m12"], given["m22"]
    m11, m21 = (1 - nu - m12 * D) / s, (decay - m22 * D) / s
    by_m2 = (m11, m12, m21, m22, c1 - m21 * c + m22 * s2, c2 + m11 * c - m12 * s2)
    for method, expected in ((MC, by_mc), (M1, by_m1), (M2, by_m2)):
        m, _ = invert_spiral(spiral, latitude, method, known(**given))
        np.testing.assert_allclose(m, expected, rtol=1e-11, atol=1e-15)  # condition of the inversions: 10

    A, b = np.array([[0, 1], [-1, 0]]) + rng.normal(0, 1e-3, (2, 2)), rng.normal(0, 1e-3, 2)
    m22, m12 = (A[0, 0] - A[1, 1]) / (2 * c**2), -(A[0, 1] + A[1, 0]) / (2 * c**2)
    m21 = -((A[0, 0] + A[1, 1]) / 2 + m22 * D) / s
    m11 = (1 - m12 * D - (A[0, 1] - A[1, 0]) / 2) / s
    six = (m11, m12, m21, m22, b[1] - m21 * c + m22 * s2, m11 * c - m12 * s2 - b[0])
    m, _ = invert_ellipse(Ellipse(A, b, np.zeros((6, 6)), 0.0, np.zeros((0, 2))), latitude)
    np.testing.assert_allclose(m, six, rtol=1e-11, atol=1e-15)


def test_bias_of_the_spiral_alone() -> None:
    """8e-3 degrees an hour with mc known, exact model, 24 h of minutes: MATH 2.6, within a factor 1.5."""
    mc = known(mc1=M[4], mc2=M[5])
    m, _ = invert_spiral(fit_spiral(arc()), LATITUDE, MC, mc)
    error = np.abs(m - M).max() * DEGREES_PER_HOUR
    assert 8e-3 / 1.5 < error < 8e-3 * 1.5
    # the ellipse leaves out less, and needs to know nothing
    m, _ = invert_ellipse(fit_ellipse(arc()), LATITUDE)
    assert np.abs(m - M).max() * DEGREES_PER_HOUR < error


def test_standard_errors_are_those_of_a_monte_carlo() -> None:
    """Figures and known values drawn from their covariances: the drift has the covariance that is given."""
    rng = np.random.default_rng(5)
    half = rng.normal(0, 1e-4, (6, 6))
    spiral = spiral_of(tuple(ORACLE.value), half @ half.T)
    given = known(2e-4, m11=0.004, m21=0.003)
    _, covariance = invert_spiral(spiral, LATITUDE, M1, given)
    drawn = []
    for _ in range(4000):
        values = {name: rng.normal(prior.mean, prior.sigma) for name, prior in given.items()}
        figures = tuple(ORACLE.value + half @ rng.standard_normal(6))
        drawn.append(invert_spiral(spiral_of(figures), LATITUDE, M1, known(**values))[0])
    # of 4000 draws a variance is good to 2.2 %; four sigma of it
    sample = np.cov(np.transpose(drawn))
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        sample / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=0.09
    )


def test_six_parameters_know_their_error() -> None:
    """The truth is the ellipse, noise of 1 arcsec."""
    exact = fit_ellipse(arc())
    truth, _ = invert_ellipse(exact, LATITUDE)
    few = slice(None, None, 15)
    scores = []
    for seed in range(200):
        noise = np.deg2rad(1 / 3600) * np.random.default_rng(seed).standard_normal(exact.predicted.shape)
        noisy = Arc(0, TAU[few], (exact.predicted + noise)[few], np.ones(len(TAU[few]), dtype=np.bool_))
        m, covariance = invert_ellipse(fit_ellipse(noisy), LATITUDE)
        scores.append((m - truth) / np.sqrt(np.diag(covariance)))
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.9) & (spread < 1.1)), spread  # two sigma of 200 seeds


def test_the_singular_latitude_is_refused_and_near_it_errors_are_huge() -> None:
    given = known(1e-4, m11=0.004, m21=0.003)
    with pytest.raises(SpiralError, match=r"tells m12, m22, mc1, mc2, found 35\.26 deg"):
        invert_spiral(ORACLE, np.deg2rad(35.26), M1, given)
    for latitude in (35.2, -35.33):
        _, covariance = invert_spiral(ORACLE, np.deg2rad(latitude), M1, given)
        D = 1 - 3 * np.sin(np.deg2rad(latitude)) ** 2
        expected = 1e-4 * abs(np.sin(np.deg2rad(latitude)) / D)
        assert np.sqrt(covariance[1, 1]) == pytest.approx(expected, rel=1e-9)
        assert expected > 100 * 1e-4  # of what is known
    with pytest.raises(SpiralError, match="another or cumulative"):
        invert_spiral(ORACLE, 0.0, M2, known(m12=0.0, m22=0.0))


def test_every_inversion_that_can_be_made_is_made() -> None:
    base, other = Base.mounted("polar", LATITUDE), Base.mounted("vertical", LATITUDE)
    whole = arc()
    short = Arc(1, TAU[:100], whole.alpha[:100], whole.measured[:100])
    first = Arc(0, TAU[:9], np.zeros((9, 2)), whole.measured[:9])
    problem = Problem((other, base), (first, short, Arc(1, TAU, whole.alpha, whole.measured)))
    found, refused = spiral_estimates(problem, known(1e-6, mc1=M[4], mc2=M[5], m12=M[1]))
    assert [e.method for e in found] == ["spiral", MC, "spiral_six"]
    assert refused == ()
    assert found[0].parameters[3:5] == (Parameter("lambda"), Parameter("nu"))
    assert found[0].parameters[5] == Parameter("psi", 1)
    for estimate in found:
        assert np.isnan(estimate.predicted[0]).all()
        assert np.isnan(estimate.predicted[1]).all()
        # the picture is good to a few arc seconds: what the spiral leaves is O(m r) = 1e-4 at most
        assert np.abs(estimate.predicted[2] - whole.alpha).max() < 1e-4
    assert found[1].parameters == tuple(Parameter(name) for name in DRIFT)
    assert found[1].standard_errors[4:] == pytest.approx([1e-6, 1e-6])


def test_a_latitude_that_forbids_one_inversion_leaves_the_others() -> None:
    latitude = np.deg2rad(35.26)
    base = Base.mounted("polar", latitude)
    alpha = trajectory(Gyro(M, np.zeros(2)), base, np.array([0.02, -0.01]), TAU)
    problem = Problem((base,), (Arc(0, TAU, alpha, np.ones(len(TAU), dtype=np.bool_)),))
    found, refused = spiral_estimates(problem, known(1e-6, **dict(zip(DRIFT, M, strict=True))))
    assert [e.method for e in found] == ["spiral", MC, M2, "spiral_six"]
    assert [error.where for error in refused] == [f"method {M1}"]


def test_large_angles_are_said_and_other_schemes_refused() -> None:
    base = Base.mounted("polar", LATITUDE)
    found, _ = spiral_estimates(Problem((base,), (arc((0.6, 0.5)),)), {})
    assert "where the axis' path about the pole is no spiral" in found[0].notes[0]
    with pytest.raises(SpiralError, match="expected a run of the polar scheme, found none"):
        spiral_estimates(Problem((Base.mounted("vertical", LATITUDE),), (arc(),)), {})
