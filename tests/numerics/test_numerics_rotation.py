"""Rotations against SciPy; the compiled integrators against plain NumPy and the exact coning motion."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.numerics.integration import (
    SingularityError,
    euler_krylov_along,
    integrate_euler_krylov,
    integrate_quaternion,
)
from pipeline.numerics.rotation import (
    euler_krylov_from_quaternion,
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_euler_krylov,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
    wrapped,
)

Float = NDArray[np.float64]
close = partial(np.testing.assert_allclose, rtol=0)
EPS = float(np.finfo(np.float64).eps)

ROUNDING = 1e-13
"""A few hundred roundings of numbers of order one."""


def random_angles(seed: int, count: int = 500) -> Float:
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [np.pi, 1.5, np.pi]


def coning(t: Float, cone_angle: float, frequency: float) -> tuple[Float, Float, Float]:
    """Angles (3.1) of Godorov & Lutmanov, corrected; their exact body rates, and integrals of the rates."""
    w, c, s = 2 * np.pi * frequency, np.cos(cone_angle / 2), np.sin(cone_angle / 2)
    cosine, sine = np.cos(w * t), np.sin(w * t)
    base = 2 * c * c - 1
    psi = np.arctan(2 * c * s * cosine / base)
    theta = np.arcsin(2 * c * s * sine)
    gamma = -np.arctan(2 * s * s * cosine * sine / (base + 2 * s * s * cosine**2))
    rates = [np.full_like(t, -2 * w * s * s), -2 * w * c * s * sine, 2 * w * c * s * cosine]
    integrals = [-2 * w * s * s * t, 2 * c * s * cosine, 2 * c * s * sine]
    return np.stack([psi, theta, gamma], 1), np.stack(rates, 1), np.stack(integrals, 1)


def increments_of(integrals: Float) -> Float:
    return np.diff(integrals, axis=0, prepend=integrals[:1])


def smooth_motion(n: int, rate: float, seed: int) -> tuple[Float, Float, Float]:
    """Rates of random sinusoids with their exact increments, and steps that are not all equal."""
    rng = np.random.default_rng(seed)
    steps = 0.01 * rng.uniform(0.8, 1.2, n)
    t = np.cumsum(steps)[:, np.newaxis]
    rates, integrals = np.zeros((n, 3)), np.zeros((n, 3))
    for _ in range(4):
        w, a, phase = rng.uniform(1, 6), rate * rng.normal(size=3), rng.uniform(0, 6, 3)
        rates += a * np.cos(w * t + phase)
        integrals += a / w * np.sin(w * t + phase)
    return rates, increments_of(integrals), steps


class TestRepresentations:
    def test_matrix_is_r2_psi_r3_theta_r1_gamma(self) -> None:
        angles = random_angles(0)
        expected = Rotation.from_euler("YZX", angles).as_matrix()  # intrinsic turns about 2, 3, 1
        found = matrix_from_quaternion(quaternion_from_euler_krylov(angles))
        close(found, expected, atol=10 * EPS)

    def test_angles_come_back(self) -> None:
        angles = random_angles(1)
        found = euler_krylov_from_quaternion(quaternion_from_euler_krylov(angles))
        # psi and gamma lose digits as 1/cos(theta); the set reaches cos(1.5) = 0.07
        close(found, angles, atol=ROUNDING)

    @pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-9, 1e-6])
    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_attitude_survives_the_singularity(self, distance: float, side: float) -> None:
        angles = np.array([0.7, side * (np.pi / 2 - distance), -1.1])
        q = quaternion_from_euler_krylov(angles)
        back = quaternion_from_euler_krylov(euler_krylov_from_quaternion(q))
        apart = rotation_vector_from_quaternion(quaternion_multiply(quaternion_conjugate(q), back))
        # psi and gamma are ill-determined here, the attitude they make together is not
        assert np.linalg.norm(apart) < 40 * EPS

    def test_product_turns_by_the_right_hand_factor_first(self) -> None:
        left, right = (
            quaternion_from_euler_krylov(random_angles(2)),
            quaternion_from_euler_krylov(random_angles(3)),
        )
        found = matrix_from_quaternion(quaternion_multiply(left, right))
        expected = matrix_from_quaternion(left) @ matrix_from_quaternion(right)
        close(found, expected, atol=10 * EPS)

    @given(
        st.floats(0, 3.14),
        st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1),
    )
    def test_exponential_and_logarithm_are_inverse(
        self, angle: float, axis: tuple[float, float, float]
    ) -> None:
        vector = angle * np.array(axis) / np.linalg.norm(axis)
        back = rotation_vector_from_quaternion(quaternion_from_rotation_vector(vector))
        close(back, vector, atol=1e-14)  # a few roundings of 3

    def test_logarithm_is_the_shortest_of_both_signs(self) -> None:
        q = quaternion_from_rotation_vector([0.3, -0.2, 0.1])
        close(rotation_vector_from_quaternion(-q), [0.3, -0.2, 0.1], atol=4 * EPS)

    @given(st.floats(-100, 100))
    def test_wrapped_is_the_same_direction_within_half_a_turn(self, angle: float) -> None:
        assert abs(wrapped(angle)) <= np.pi + 100 * EPS
        assert abs(np.exp(1j * wrapped(angle)) - np.exp(1j * angle)) < 1000 * EPS  # rounding of 100 rad

    @given(st.floats(-3.1, 3.1), st.integers(-50, 50))
    def test_whole_turns_do_not_count(self, angle: float, turns: int) -> None:
        close(wrapped(angle + 2 * np.pi * turns), angle, atol=300 * EPS)  # a rounding or two of 50 turns

    @given(st.floats(-3.1, 3.1))
    def test_wrapped_within_half_a_turn_keeps_every_digit(self, angle: float) -> None:
        assert wrapped(angle) == angle


def quaternion_in_plain_numpy(rates: Float, increments: Float, steps: Float, initial: Float) -> Float:
    """Formula by formula: the reference of the compiled kernel."""
    q = [initial / np.linalg.norm(initial)]
    for i in range(1, len(steps)):
        first_moment = steps[i] * (rates[i] - rates[i - 1]) / 12
        vector = increments[i] + np.cross(increments[i], first_moment)
        q.append(quaternion_multiply(q[-1], quaternion_from_rotation_vector(vector)))
    return np.array(q)


def angles_in_plain_numpy(rates: Float, increments: Float, steps: Float, initial: Float) -> Float:
    """Classical Runge-Kutta on (1.1) and the sines and cosines: the reference of the compiled kernel."""

    def with_sines(angles: Float) -> Float:
        return np.array([*angles, *np.sin(angles[1:]), *np.cos(angles[1:])])

    def slope(x: Float, w: Float) -> Float:
        _, _, _, sin_theta, sin_gamma, cos_theta, cos_gamma = x
        p, q, r = w
        psi_rate = (q * cos_gamma - r * sin_gamma) / cos_theta
        theta_rate = q * sin_gamma + r * cos_gamma
        gamma_rate = p - sin_theta * psi_rate
        of_sines = [theta_rate * cos_theta, gamma_rate * cos_gamma]
        of_cosines = [-theta_rate * sin_theta, -gamma_rate * sin_gamma]
        return np.array([psi_rate, theta_rate, gamma_rate, *of_sines, *of_cosines])

    found = [initial]
    for i in range(1, len(steps)):
        h, w0, w1 = steps[i], rates[i - 1], rates[i]
        middle = (6 * increments[i] / h - w0 - w1) / 4
        x = with_sines(found[-1])
        k1 = slope(x, w0)
        k2 = slope(x + h / 2 * k1, middle)
        k3 = slope(x + h / 2 * k2, middle)
        k4 = slope(x + h * k3, w1)
        found.append((x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))[:3])
    return np.array(found)


class TestKernels:
    # 2048 steps, in two halves, are a block of the kernel; rate 100 leaves the series for sin and cos
    @pytest.mark.parametrize(
        ("n", "rate"),
        [(1, 1.0), (2, 1.0), (3, 1.0), (4, 1.0), (2049, 1.0), (2050, 1.0), (4200, 1.0), (600, 100.0)],
    )
    def test_quaternion_is_the_plain_formula(self, n: int, rate: float) -> None:
        motion = smooth_motion(n, rate, seed=n)
        initial = quaternion_from_euler_krylov([0.3, -0.4, 0.5])
        found = integrate_quaternion(*motion, initial)
        close(found, quaternion_in_plain_numpy(*motion, initial), atol=ROUNDING)

    def test_angles_are_the_plain_formula(self) -> None:
        rates, increments, steps = smooth_motion(600, 0.1, seed=4)
        initial = np.array([0.3, -0.4, 0.5])
        found = integrate_euler_krylov(rates, increments, steps, initial, limit=1.5)
        expected = angles_in_plain_numpy(rates, increments, steps, initial)
        close(found, expected, atol=ROUNDING)

    def test_angles_along_a_history_are_the_plain_ones_unwrapped(self) -> None:
        motion = smooth_motion(5000, 3.0, seed=5)
        q = integrate_quaternion(*motion, np.array([1.0, 0, 0, 0]))
        plain = euler_krylov_from_quaternion(q)
        expected = np.unwrap(plain, axis=0) * [1, 0, 1] + plain * [0, 1, 0]
        assert np.ptp(expected[:, 0]) > 2 * np.pi, "the motion must need unwrapping"
        well = np.abs(plain[:, 1]) < 1.5  # elsewhere psi and gamma magnify rounding by 1/cos(theta) > 14
        few_roundings = 8 * EPS * np.abs(expected).max()  # of some 20 turns
        close(euler_krylov_along(q)[well], expected[well], atol=few_roundings)

    def test_arctangent_in_every_octant_and_on_the_axes(self) -> None:
        # q = turn about axis 2 has psi = its angle: all directions pass through the kernel's arctangent
        psi = np.concatenate([np.linspace(-np.pi, np.pi, 721), [1e-300, -1e-17]])
        q = quaternion_from_euler_krylov(np.stack([psi, 0 * psi, 0 * psi], 1))
        found = np.array([euler_krylov_along(row[np.newaxis])[0] for row in q])
        close(wrapped(found[:, 0] - psi), 0, atol=4 * EPS * np.pi)
        assert np.all(found[:, 1] == 0)

    def test_norm_stays_one_through_a_million_steps(self) -> None:
        n = 1_000_000
        t = np.linspace(0, 1e-3 * (n - 1), n)
        _, rates, integrals = coning(t, np.radians(1.0), 20.0)
        q = integrate_quaternion(rates, increments_of(integrals), np.full(n, 1e-3), np.array([2.0, 0, 0, 0]))
        # the norm is restored every 2048 steps, each of which rounds a few times
        close(np.linalg.norm(q, axis=1), 1, atol=2048 * 2 * EPS)


class TestAccuracy:
    def integrated(self, path: str, intervals: int) -> Float:
        """Largest error of each angle over two periods of a wide cone, with exact rates and increments."""
        t = np.linspace(0, 2, intervals + 1)
        angles, rates, integrals = coning(t, np.radians(20.0), 1.0)
        steps = np.diff(t, prepend=t[:1])
        if path == "quaternion":
            start = quaternion_from_euler_krylov(angles[0])
            found = euler_krylov_along(integrate_quaternion(rates, increments_of(integrals), steps, start))
        else:
            found = integrate_euler_krylov(rates, increments_of(integrals), steps, angles[0], 1.5)
        return np.asarray(np.abs(found - angles).max(axis=0), dtype=np.float64)

    @pytest.mark.parametrize("path", ["quaternion", "euler_krylov"])
    def test_is_of_fourth_order(self, path: str) -> None:
        order = np.log2(self.integrated(path, 200) / self.integrated(path, 400))
        # at 100 steps a period terms of the next order still weigh a few per cent; some cancellation
        # may make a component better than fourth order, never worse
        assert np.all(order > 3.9), order
        assert self.integrated(path, 400).max() < 1e-6

    def test_coning_term_is_what_makes_it_fourth_order(self) -> None:
        """Without rates the term a × b1 is nothing, and only the product of the increments is left."""
        t = np.linspace(0, 2, 401)
        angles, rates, integrals = coning(t, np.radians(20.0), 1.0)
        steps = np.diff(t, prepend=t[:1])
        start = quaternion_from_euler_krylov(angles[0])
        without = integrate_quaternion(0 * rates, increments_of(integrals), steps, start)
        error = np.abs(euler_krylov_along(without) - angles).max(axis=0)
        assert np.all(error[[0, 2]] > 100 * self.integrated("quaternion", 400)[[0, 2]])

    def test_both_paths_agree_on_a_general_motion(self) -> None:
        rates, increments, steps = smooth_motion(2000, 0.2, seed=7)
        start = np.array([0.1, 0.2, -0.3])
        by_angles = integrate_euler_krylov(rates, increments, steps, start, 1.5)
        q = integrate_quaternion(rates, increments, steps, quaternion_from_euler_krylov(start))
        # two fourth-order rules, w h = 0.06: (w h)**4/720 of angles of order one, over 20 s
        close(euler_krylov_along(q), by_angles, atol=1e-7)

    def test_constant_rate_is_exact(self) -> None:
        n, rate = 1001, np.array([3.0, -2.0, 1.0])
        steps = np.full(n, 1e-2)
        rates = np.tile(rate, (n, 1))
        q = integrate_quaternion(rates, rates * 1e-2, steps, np.array([1.0, 0, 0, 0]))
        close(np.abs(q[-1] @ quaternion_from_rotation_vector(rate * 10)), 1, atol=1e-12)

    def test_singularity_is_an_error_at_its_row(self) -> None:
        n, h = 200, 0.01  # theta grows at 1 rad/s: passes 1.5 rad at row 150
        rates = np.tile([0.0, 0.0, 1.0], (n, 1))
        with pytest.raises(SingularityError, match="row 151") as caught:
            integrate_euler_krylov(rates, rates * h, np.full(n, h), np.zeros(3), 1.505)
        assert caught.value.row == 151
