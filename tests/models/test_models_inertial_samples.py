"""Increments from samples of gyros and accelerometers: their order in the step, gaps, and what is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from pipeline.errors import ExitCode
from pipeline.models._inertial_samples import of_samples, slopes
from pipeline.models.coning import ConingMotion
from pipeline.models.navigation_errors import NavigationError
from pipeline.models.navigation_problem import Imu
from pipeline.models.strapdown import from_increments, increments
from pipeline.numerics.rotation import (
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]


def even(seconds: float, hertz: float) -> Float:
    return np.arange(round(seconds * hertz) + 1) / hertz


# --- increments ---------------------------------------------------------------------------------------------


def test_increments_of_linear_rate_and_force_are_of_fifth_order_in_the_step() -> None:
    """Of one step, against order eight: halving the step divides the error by 32, or by more."""
    rng = np.random.default_rng(2)
    w0, w1, f0, f1 = rng.normal(size=(4, 3))

    def error(h: float) -> float:
        def moving(t: float, x: Float) -> Float:
            C, w = x[:9].reshape(3, 3), w0 + w1 * t
            return np.concatenate([(C @ np.cross(w, np.eye(3)).T).ravel(), C @ (f0 + f1 * t)])

        C0 = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
        true = solve_ivp(moving, (0, h), C0, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        t = np.array([0.0, h])
        imu = increments(t, w0 + w1 * t[:, None], f0 + f1 * t[:, None])
        turn = Rotation.from_matrix(true[:9].reshape(3, 3)).as_rotvec() - imu.rotation[0]
        return float(np.linalg.norm(np.append(turn, true[9:] - imu.velocity[0])))

    sizes = [error(h) for h in (0.4, 0.2, 0.1)]
    for larger, smaller in pairwise(sizes):
        assert larger / smaller > 28  # 32 less what the sixth order adds at these steps


def test_increments_of_constant_rate_and_force_are_exact() -> None:
    """Half a turn in one step: u is the integral of the rotated force in closed form; a few roundings."""
    rate, force, t = np.array([0.0, 0.0, np.pi]), np.array([2.0, 0.0, 1.0]), np.array([0.0, 1.0])
    imu = increments(t, np.tile(rate, (2, 1)), np.tile(force, (2, 1)))
    np.testing.assert_allclose(imu.rotation, [rate], rtol=0, atol=1e-15)
    np.testing.assert_allclose(imu.velocity, [[0.0, 4 / np.pi, 1.0]], rtol=0, atol=3e-15)


@pytest.mark.parametrize("integrating", [False, True], ids=["samples", "integrals"])
def test_coning_is_of_fourth_order(integrating: bool) -> None:
    """Attitude after 2 s of 3 Hz coning by 5 degrees: halving the step divides its error by 16 (13 to 19 for
    what the sixth order adds)."""
    motion = ConingMotion(cone_angle=np.radians(5.0), frequency=3.0)
    found = []
    for hertz in (100, 200):
        t = even(2, hertz)
        still = np.zeros((len(t), 3))
        if integrating:
            imu = from_increments(t, motion.increments(t[:-1], t[1:]), still[1:])
        else:
            imu = increments(t, motion.rates(t), still)
        attitude = motion.quaternion(0.0)
        for turn in quaternion_from_rotation_vector(imu.rotation):
            attitude = quaternion_multiply(attitude, turn)
        error = quaternion_multiply(attitude, quaternion_conjugate(motion.quaternion(t[-1])))
        found.append(np.linalg.norm(rotation_vector_from_quaternion(error)))
    assert 13 < found[0] / found[1] < 19


@pytest.mark.parametrize("integrating", [False, True], ids=["samples", "integrals"])
def test_sculling_is_of_fourth_order(integrating: bool) -> None:
    """Rotation about 1 and force along 2 in phase at 3 Hz make a constant acceleration along 3; what the
    increments make of it over 2 s is held to an integral of order eight, and its error falls by 16."""
    w, swing, push = 6 * np.pi, 0.05, 10.0

    def sensed(t: Float) -> tuple[Float, Float]:
        zero = 0 * t
        rate = np.stack([swing * w * np.cos(w * t + 0.3), zero, zero], -1)
        return rate, np.stack([zero, push * np.sin(w * t + 0.3), zero], -1)

    def lean(t: Float) -> Float:
        return swing * (np.sin(w * t + 0.3) - np.sin(0.3))

    def turned(t: float, _: Float) -> list[float]:
        felt = push * np.sin(w * t + 0.3)
        return [felt * np.cos(lean(t)), felt * np.sin(lean(t))]

    true = solve_ivp(turned, (0, 2), [0.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    found = []
    for hertz in (100, 200):
        t = even(2, hertz)
        if integrating:
            rise = -push / w * np.diff(np.cos(w * t + 0.3))
            zero = 0 * rise
            imu = from_increments(
                t, np.stack([np.diff(lean(t)), zero, zero], -1), np.stack([zero, rise, zero], -1)
            )
        else:
            imu = increments(t, *sensed(t))
        at = np.append(0.0, np.cumsum(imu.rotation[:, 0]))[:-1]
        c, s = np.cos(at), np.sin(at)
        _, dv2, dv3 = imu.velocity.T
        found.append(np.hypot(np.sum(c * dv2 - s * dv3) - true[0], np.sum(s * dv2 + c * dv3) - true[1]))
    assert 13 < found[0] / found[1] < 19  # 16 but for the sixth order


# --- gaps ---------------------------------------------------------------------------------------------------


def linear(t: Float) -> tuple[Float, Float]:
    """A rate and a force that a line through any two samples gives exactly."""
    return np.outer(t, [0.02, -0.03, 0.01]) + 0.1, np.outer(t, [-0.5, 0.2, 0.3]) + 9.0


def total(imu: Imu) -> tuple[Float, Float]:
    """Attitude and velocity at the end, without an Earth."""
    C, velocity = np.eye(3), np.zeros(3)
    for turn, push in zip(imu.rotation, imu.velocity, strict=True):
        velocity = velocity + C @ push
        C = C @ Rotation.from_rotvec(turn).as_matrix()
    return C, velocity


def assert_same_motion(first: Imu, second: Imu) -> None:
    """Steps within 0.1 s differ by the fifth order, (0.1 s * 0.1 rad/s)^4 * 9 m/s^2 * 0.1 s = 1e-8."""
    for a, b in zip(total(first), total(second), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8)


def test_a_burst_of_nan_is_coasted_over_and_marked() -> None:
    t = even(5, 50)
    rate, force = linear(t)
    whole = increments(t, rate, force)
    rate, force = rate.copy(), force.copy()
    rate[100:110, 1] = np.nan
    force[105:113] = np.inf
    imu = increments(t, rate, force)
    np.testing.assert_array_equal(imu.time, t)
    assert np.flatnonzero(imu.coasted).tolist() == list(range(99, 113))
    assert_same_motion(imu, whole)
    assert not whole.coasted.any()


def test_lost_samples_are_replaced_by_steps_of_the_usual_length() -> None:
    t = even(5, 50)
    lost = np.delete(np.arange(len(t)), np.s_[100:110])
    imu = increments(t[lost], *(x[lost] for x in linear(t)))
    np.testing.assert_allclose(imu.time, t, rtol=0, atol=1e-12)  # roundings of 5 s
    assert np.flatnonzero(imu.coasted).tolist() == list(range(99, 110))
    assert_same_motion(imu, increments(t, *linear(t)))


def test_what_is_not_usable_at_both_ends_is_left_out() -> None:
    t = even(1, 50)
    rate, force = (x.copy() for x in linear(t))
    rate[:3], force[-2:] = np.nan, np.nan
    imu = increments(t, rate, force)
    np.testing.assert_array_equal(imu.time, t[3:-2])
    assert not imu.coasted.any()


def test_increments_that_are_missing_are_coasted_over() -> None:
    """A burst of NaN, a lost message of three, and bad ends; a line through the means is exact."""
    t = even(5, 50)
    (w, f), (dw, df) = linear(np.zeros(1)), (np.array([0.02, -0.03, 0.01]), np.array([-0.5, 0.2, 0.3]))
    middle = ((t[1:] + t[:-1]) / 2)[:, None]
    angle, push = 0.02 * (w + dw * middle), 0.02 * (f + df * middle)
    whole = from_increments(t, angle, push)
    angle[50:60], push[:2], push[-1] = np.nan, np.nan, np.nan
    kept = np.delete(np.arange(len(t)), [150, 151])
    imu = from_increments(t[kept], angle[kept[1:] - 1], push[kept[1:] - 1])
    np.testing.assert_allclose(imu.time, t[2:-1], rtol=0, atol=1e-12)  # roundings of 5 s
    # The sample after the lost ones spans three steps: it is not used.
    assert (np.flatnonzero(imu.coasted) + 2).tolist() == [*range(50, 60), *range(149, 152)]
    inner = Imu(whole.time[2:-1], whole.rotation[2:-1], whole.velocity[2:-1], whole.coasted[2:-1])
    assert_same_motion(imu, inner)


def test_what_is_bridged_tells_nothing_of_the_steps_beside_it() -> None:
    """Garbage in place of what is bridged leaves the integrals and slopes of usable steps to the bit."""
    rng = np.random.default_rng(4)
    t = np.append(0.0, np.cumsum(rng.uniform(0.5, 1.5, 40)))
    value, usable = rng.normal(size=(41, 3)), np.ones(41, dtype=np.bool_)
    usable[[7, 8, 9, 20, 40]] = False
    garbage = np.where(usable[:, np.newaxis], value, 1e6)
    step = usable[1:] & usable[:-1]
    for first, second in zip(of_samples(t, value, usable), of_samples(t, garbage, usable), strict=True):
        np.testing.assert_array_equal(first[step], second[step])
    h, sound = np.diff(t), usable[1:]
    first, second = slopes(h, value[1:], sound), slopes(h, garbage[1:], sound)
    np.testing.assert_array_equal(first[sound], second[sound])


def test_noise_is_not_made_more_by_irregular_stamps() -> None:
    """Of white noise, over intervals from 0.05 to 1.95 of the mean, against the trapezoid's weights. What it
    makes of short intervals beside long ones is a tenth more at most; 6000 sums scatter by 0.9 %."""
    rng = np.random.default_rng(3)
    t = np.append(0.0, np.cumsum(rng.uniform(0.05, 1.95, 100)))
    still, noise = np.zeros((101, 3)), rng.normal(size=(2000, 101, 3))
    sums = [increments(t, still, value, max_step=2.0, max_coast=2.0).velocity.sum(axis=0) for value in noise]
    trapezoid = np.linalg.norm(np.convolve(np.diff(t), [0.5, 0.5]))
    assert np.std(sums) / trapezoid < 1.1


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        ("burst", "gyros at 1.980 s: expected usable samples at most 1 s apart, found 1.220 s without one;"),
        ("hole", "gyros at 1.980 s: expected usable samples at most 1 s apart, found 2.020 s without one;"),
        (
            "stamp",
            "sample 100 of the inertial sensors: expected a later instant than that of the sample before",
        ),
        ("empty", "at least 2 samples with numbers of gyros and accelerometers, found 0 of 251"),
        ("short", "at least 2 samples with numbers of gyros and accelerometers, found 1 of 1"),
    ],
)
def test_samples_that_cannot_be_navigated_with_are_refused_in_one_line(spoil: str, message: str) -> None:
    t = even(5, 50)
    rate, force = (x.copy() for x in linear(t))
    if spoil == "burst":
        rate[100:160] = np.nan
    elif spoil == "hole":
        t, rate, force = (np.delete(x, np.s_[100:200], axis=0) for x in (t, rate, force))
    elif spoil == "stamp":
        t[100] = t[99]
    elif spoil == "empty":
        force[:] = np.nan
    else:
        t, rate, force = t[:1], rate[:1], force[:1]
    with pytest.raises(NavigationError) as refused:
        increments(t, rate, force)
    assert message in str(refused.value)
    assert refused.value.exit_code is ExitCode.NOT_MET


def test_a_longer_gap_is_coasted_over_where_asked() -> None:
    t = np.delete(even(5, 50), np.s_[100:200])
    imu = increments(t, *linear(t), max_coast=2.5)
    assert imu.coasted.sum() == 101
    with pytest.raises(NavigationError, match=r"found 2\.020 s without one"):
        from_increments(t, linear(t)[0][1:], linear(t)[1][1:])
