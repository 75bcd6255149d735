"""Interpolants: exact where they must be, SciPy's where they are SciPy's, and the paper's coning figures."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.interpolate import Akima1DInterpolator, BSpline, PchipInterpolator, make_interp_spline

from pipeline.models.coning import ConingMotion
from pipeline.numerics.integration import euler_krylov_along, integrate_quaternion
from pipeline.numerics.interpolation import Method, fit, fit_from_angle
from pipeline.numerics.local_polynomial import LocalPolynomial, integral_weights
from pipeline.numerics.rotation import quaternion_from_euler_krylov
from pipeline.numerics.time_grid import advancing, uniform_grid

Float = NDArray[np.float64]
close = partial(np.testing.assert_allclose, rtol=0)
EPS = float(np.finfo(np.float64).eps)

METHODS = [
    Method("linear"),
    *[Method("local_polynomial", degree) for degree in (1, 2, 3, 4, 5)],
    *[Method("spline", degree) for degree in (2, 3, 5, 7)],
    Method("pchip"),
    Method("akima"),
    Method("harmonic"),
]
BY_NAME = [f"{m.name}-{m.degree}" for m in METHODS]


def jittered(n: int, seed: int = 0) -> Float:
    rng = np.random.default_rng(seed)
    return np.asarray((np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 0.01, dtype=np.float64)


def uniform(n: int) -> Float:
    return np.arange(n, dtype=np.float64) * 0.01


def vibration(t: Float) -> Float:
    phase = 2 * np.pi * 11.0 * t[:, np.newaxis] + np.array([0.0, 1.0, 2.0])
    return np.asarray(np.sin(phase) + 0.3 * t[:, np.newaxis] ** 2, dtype=np.float64)


def polynomial(degree: int) -> tuple[np.polynomial.Polynomial, np.polynomial.Polynomial]:
    rng = np.random.default_rng(degree)
    p = np.polynomial.Polynomial(rng.normal(size=degree + 1))
    return p, p.integ()


@pytest.mark.parametrize("method", METHODS, ids=BY_NAME)
@pytest.mark.parametrize("times", [uniform, jittered])
class TestEveryMethod:
    def test_passes_through_the_samples(self, method: Method, times: object) -> None:
        t = uniform(80) if times is uniform else jittered(80)
        values, _ = fit(method, t, vibration(t)).sample(t)
        # a septic spline's system has a condition of some hundreds
        close(values, vibration(t), atol=1e-12)

    def test_integrals_are_those_of_its_values(self, method: Method, times: object) -> None:
        t = uniform(80) if times is uniform else jittered(80)
        found = fit(method, t, vibration(t))
        grid = np.linspace(t[0], t[-1], 57)  # longer than the sample interval: steps span several pieces
        _, increments = found.sample(grid)
        fine = np.unique(np.concatenate([np.linspace(t[0], t[-1], 400_001), grid, t]))
        values, _ = found.sample(fine)
        sums = np.concatenate(
            [np.zeros((1, 3)), np.cumsum(np.diff(fine)[:, None] * (values[1:] + values[:-1]) / 2, 0)]
        )
        expected = np.diff(sums[np.searchsorted(fine, grid)], axis=0)
        # trapezoid rule: h**2/12 times the change of x' over a step, (2e-6)**2/12 · 140
        close(increments[1:], expected, atol=5e-11)
        assert not increments[0].any()

    def test_angle_increments_are_reproduced(self, method: Method, times: object) -> None:
        t = uniform(80) if times is uniform else jittered(80)
        angle = np.cumsum(vibration(t) * 0.01, axis=0)
        grid = np.sort(np.concatenate([t, t[:-1] + np.diff(t) * 0.37]))
        _, increments = fit_from_angle(method, t, angle).sample(grid)
        between = np.add.reduceat(increments[1:], np.arange(0, len(grid) - 1, 2))
        # an eighth-degree spline's coefficients carry a thousand roundings of an angle of 0.3 rad
        close(between, np.diff(angle, axis=0), atol=1e-13)

    def test_rates_of_an_angle_come_near_the_rates(self, method: Method, times: object) -> None:
        t = uniform(200) if times is uniform else jittered(200)
        w = 2 * np.pi * 2.0
        angle = np.stack([np.sin(w * t) / w, 0.5 * t, np.cos(w * t) / w], 1)
        values, _ = fit_from_angle(method, t, angle).sample(t)
        expected = np.stack([np.cos(w * t), np.full_like(t, 0.5), -np.sin(w * t)], 1)
        # the weakest, a quadratic or pchip: (w h_max)**2 with h_max = 1.6e-2 s; pchip is flat at extremes
        inner = slice(3, -3)
        close(values[inner], expected[inner], atol=0.1)


class TestLocalPolynomial:
    @pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
    @pytest.mark.parametrize("t", [uniform(30), jittered(30)], ids=["uniform", "jittered"])
    def test_reproduces_polynomials_of_its_degree_to_the_ends(self, degree: int, t: Float) -> None:
        p, integral = polynomial(degree)
        grid = np.linspace(t[0], t[-1], 301)
        values, increments = LocalPolynomial(t, p(t)[:, np.newaxis], degree).sample(grid)
        close(values[:, 0], p(grid), atol=1e-13)
        close(increments[1:, 0], np.diff(integral(grid)), atol=1e-15)

    @pytest.mark.parametrize(("degree", "first"), [(1, 0), (2, 0), (3, -1), (4, -1), (5, -2)])
    def test_uses_the_stated_samples(self, degree: int, first: int) -> None:
        """An impulse at one sample reaches the intervals whose samples include it, and no other."""
        n, at = 21, 10
        reached = np.flatnonzero(
            [
                np.any(LocalPolynomial(uniform(n), np.eye(n)[:, [at]], degree).sample(uniform(n))[1][i + 1])
                for i in range(n - 1)
            ]
        )
        expected = [i for i in range(n - 1) if i + first <= at <= i + first + degree]
        assert reached.tolist() == expected

    def test_shifts_inward_at_the_ends(self) -> None:
        impulse = np.eye(12)[:, [3]]
        _, increments = LocalPolynomial(uniform(12), impulse, 3).sample(uniform(12))
        assert increments[1, 0] != 0, "the first interval uses samples 0 … 3"
        _, increments = LocalPolynomial(uniform(12), np.eye(12)[:, [8]], 3).sample(uniform(12))
        assert increments[11, 0] != 0, "the last interval uses samples 8 … 11"

    def test_weights_of_the_cubic(self) -> None:
        close(integral_weights(3)[1], np.array([-1, 13, 13, -1]) / 24, atol=EPS)
        close(integral_weights(3)[0], np.array([9, 19, -5, 1]) / 24, atol=EPS)

    @pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
    def test_constant_weights_equal_the_coefficients(self, degree: int) -> None:
        t = uniform(500)
        local = LocalPolynomial(t, vibration(t), degree)
        values, increments = local.sample(t)
        general_values, general = local.piecewise().sample(t)
        close(values, general_values, atol=1e-13)
        # the general path takes the steps of t as they are: rounded, eps 5 s in 0.01 s, of 0.08 rad
        close(increments, general, atol=2e-14)

    @pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
    def test_kernel_equals_plain_numpy(self, degree: int) -> None:
        """The same polynomials by a Vandermonde system on each interval."""
        t = jittered(40)
        y = vibration(t)
        found = LocalPolynomial(t, y, degree).piecewise().coefficients
        lead = (degree - 1) // 2
        for i in range(len(t) - 1):
            first = min(max(i - lead, 0), len(t) - 1 - degree)
            near = slice(first, first + degree + 1)
            u = (t[near] - t[i]) / (t[i + 1] - t[i])
            expected = np.linalg.solve(np.vander(u, increasing=True), y[near])
            # closest samples are 0.4 of the mean interval apart: coefficients reach 100 times the values
            close(found[:, i, :].T, expected, rtol=1e-12, atol=1e-12)

    def test_is_exact_on_a_shifted_grid_of_a_long_record(self) -> None:
        n = 1_000_000
        t = np.arange(n) / 1e3
        w = 2 * np.pi * 20
        _, increments = LocalPolynomial(t, np.cos(w * t)[:, np.newaxis], 3).sample(t)
        expected = np.diff(np.sin(w * t)) / w
        # 11/720 (w h)**4 of the local cubic, times h; 2e-4 more at the two one-sided ends
        assert np.abs(increments[2:-1, 0] - expected[1:-1]).max() < 1.02 * 11 / 720 * (w * 1e-3) ** 4 * 1e-3


class TestAgainstScipy:
    @pytest.mark.parametrize("t", [uniform(60), jittered(60)], ids=["uniform", "jittered"])
    @pytest.mark.parametrize("name", ["spline-2", "spline-3", "spline-5", "spline-7", "pchip", "akima"])
    def test_same_function_and_antiderivative(self, name: str, t: Float) -> None:
        y, grid = vibration(t), np.linspace(t[0], t[-1], 777)
        scipys: BSpline[np.float64] | PchipInterpolator | Akima1DInterpolator
        if name.startswith("spline"):
            degree = int(name[-1])
            method, scipys = Method("spline", degree), make_interp_spline(t, y, k=degree)
        elif name == "pchip":
            method, scipys = Method("pchip"), PchipInterpolator(t, y)
        else:
            method, scipys = Method("akima"), Akima1DInterpolator(t, y)
        values, increments = fit(method, t, y).sample(grid)
        close(values, scipys(grid), atol=1e-12)
        close(increments[1:], np.diff(scipys.antiderivative()(grid), axis=0), atol=1e-13)


class TestGodorov:
    """MATH 1.3: 1 degree, 100 Hz, 400 Hz samples on [0, 1] s, output 20,000 a second."""

    MOTION = ConingMotion(cone_angle=np.radians(1.0), frequency=100.0)
    GRID = np.arange(20_001) / 20_000

    def criterion(self, method: Method) -> Float:
        t = np.arange(401) / 400
        truth = self.MOTION.angles(self.GRID)
        rates, increments = fit(method, t, self.MOTION.rates(t)).sample(self.GRID)
        steps = np.diff(self.GRID, prepend=0.0)
        start = quaternion_from_euler_krylov(truth[0])
        error = euler_krylov_along(integrate_quaternion(rates, increments, steps, start)) - truth
        ratio = trapezoid(error**2, self.GRID, axis=0) / trapezoid(truth**2, self.GRID, axis=0)
        return np.asarray(np.sqrt(ratio), dtype=np.float64)

    def test_local_cubic_to_the_oracle_s_digits(self) -> None:
        psi, theta, gamma = self.criterion(Method("local_polynomial", 3))
        assert gamma == pytest.approx(143.6247, rel=1e-4)  # asked for to 0.01 %
        assert psi == pytest.approx(0.2619, abs=0.00005)  # half of the last digit stated
        assert theta == pytest.approx(0.07429, abs=0.000005)

    @pytest.mark.parametrize(
        ("method", "oracle"),
        [
            (Method("linear"), 354.45),
            (Method("local_polynomial", 1), 354.45),
            (Method("local_polynomial", 2), 144.37),
            (Method("local_polynomial", 4), 62.4),
            (Method("local_polynomial", 5), 60.9),
            (Method("spline", 2), 55.30),
            (Method("spline", 3), 29.19),
            (Method("spline", 5), 2.463),
            (Method("spline", 7), 1.100),
            (Method("pchip"), 122.8),
            (Method("akima"), 122.8),
        ],
        ids=str,
    )
    def test_other_interpolants_within_one_per_cent(self, method: Method, oracle: float) -> None:
        assert self.criterion(method)[2] == pytest.approx(oracle, rel=0.01)

    def test_harmonic_model_leaves_next_to_nothing(self) -> None:
        assert np.all(self.criterion(Method("harmonic")) <= [1e-6, 2e-6, 6e-6])


class TestTimeGrid:
    def test_grid_meets_both_ends_and_is_uniform_to_a_nanosecond(self) -> None:
        grid = uniform_grid(10**18 + 7, 10**18 + 7 + 999_999_999, 300)
        assert grid[0] == 10**18 + 7
        assert grid[-1] == 10**18 + 7 + 999_999_999
        assert set(np.diff(grid).tolist()) == {3_333_333, 3_333_334}

    def test_grid_of_a_long_record_does_not_overflow(self) -> None:
        day = 86_400 * 10**9
        grid = uniform_grid(0, day, 3_000_001)
        assert np.all(np.diff(grid) > 0)
        assert grid[-1] == day

    def test_grid_below_a_nanosecond_is_refused(self) -> None:
        with pytest.raises(ValueError, match="10 ns cannot hold 11 steps"):
            uniform_grid(0, 10, 11)

    @pytest.mark.parametrize(
        ("time", "kept", "repeated", "out_of_order"),
        [
            ([1, 2, 3, 4], [0, 1, 2, 3], [], []),
            ([1, 2, 2, 3], [0, 1, 3], [2], []),
            ([1, 2, 3, 2, 4], [0, 1, 2, 4], [], [3]),
            ([5, 0, 6, 7], [0, 2, 3], [], [1]),
            ([1, 2, 900, 3, 4, 5], [0, 1, 3, 4, 5], [], [2]),  # a leap ahead costs one sample, not three
            ([3, 3], [0], [1], []),
            ([7], [0], [], []),
            ([], [], [], []),
        ],
    )
    def test_advancing_leaves_out_few(
        self, time: list[int], kept: list[int], repeated: list[int], out_of_order: list[int]
    ) -> None:
        found = advancing(np.array(time, dtype=np.int64))
        assert np.flatnonzero(found.kept).tolist() == kept
        assert np.flatnonzero(found.repeated).tolist() == repeated
        assert np.flatnonzero(found.out_of_order).tolist() == out_of_order
