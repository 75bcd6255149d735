"""Transition, noise and factor of the error-state filter against differences, sums and dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navigation_filter_flights import flight

from pipeline.models import _kernels_error_state as kernel
from pipeline.models._kernels_strapdown import matrix_from_quaternion, step, turn_left
from pipeline.models.ellipsoid import displaced, metres_between
from pipeline.numerics.rotation import rotation_vector_from_quaternion


@pytest.fixture(scope="module")
def weave():
    return flight(2.0, 0.01, turns=0.5)


def moved(truth, steps: int, error=None):
    """The state after some steps, begun with an error of the fifteen states; and the sums."""
    error = np.zeros(15) if error is None else error
    position = displaced(truth.position[0], error[12:])
    velocity, C = truth.velocity[0] + error[9:12], np.empty((3, 3))
    matrix_from_quaternion(truth.attitude[0], C)
    turn_left(C, *error[6:9])
    sums = np.zeros(kernel.SUMS)
    for i in range(steps):
        before, dt = C.copy(), truth.imu.time[i + 1] - truth.imu.time[i]
        turned = np.cross(error[:3], truth.imu.velocity[i]) + np.cross(truth.imu.rotation[i], error[3:6])
        gain = truth.imu.velocity[i] - dt * (error[3:6] + 0.5 * turned)
        step(position, velocity, C, truth.imu.rotation[i] - dt * error[:3], gain, dt)
        kernel.accumulate(sums, before, C, gain, dt)
        sums[kernel.VELOCITY_VARIANCE] += dt * 0.004**2
        sums[kernel.ATTITUDE_VARIANCE] += dt * 1.5e-4**2
    return position, velocity, C, sums


def apart(a, b):
    """Attitude, velocity and position of b less those of a."""
    turn = b[2] @ a[2].T
    q = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    vector = rotation_vector_from_quaternion(np.concatenate([[1.0], q / 2]))
    return np.concatenate([vector, b[1] - a[1], metres_between(a[0], b[0])])


@pytest.mark.parametrize("steps", [1, 10, 100])
def test_the_transition_is_the_derivative_of_the_strapdown_equations(weave, steps):
    nominal = moved(weave, steps)
    Phi = np.empty((15, 9))
    kernel.transition(nominal[3], nominal[0], nominal[1], Phi)
    sizes = np.repeat([1e-3, 1e-1, 1e-3, 1.0, 100.0], 3)
    for j in range(15):
        ahead, behind = (moved(weave, steps, sign * sizes[j] * np.eye(15)[j]) for sign in (1.0, -1.0))
        # the kernel's terms are of the second order in a step of 0.01 s, those of the Earth of the first in
        # T, and they are 1e-4 of g: of the largest element of a column T^2 1e-4 + 1e-4 of it
        wanted = (apart(nominal, ahead) - apart(nominal, behind)) / (2 * sizes[j])
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(Phi[j], wanted, rtol=0, atol=2e-4 * scale)


def test_the_transition_knows_the_slow_terms_of_the_earth():
    """In free fall nothing else is left; quick enough for the transport rate to be like that of the Earth."""
    truth = flight(1.0, 0.1)
    truth.velocity[0] *= 10
    truth.imu.velocity[:] = 0.0
    nominal, Phi = moved(truth, 10), np.empty((15, 9))
    kernel.transition(nominal[3], nominal[0], nominal[1], Phi)
    sizes = np.repeat([1e-3, 10.0, 1e4], 3)
    # Over a second, with velocity taken at its end: the second order in 1e-4 rad/s of a column of that size
    # (5e-9 of attitude, 5e-4 m from the Coriolis force); gravity by latitude, 7e-5 m/s in 10 km, and by the
    # second order of its rate, 1.3e-4; 10 km times half the 10 m/s that it falls in the end over the Earth's
    # radius, 8e-3 m, and twice that with gravity by height, 0.03 m/s at the end of the second
    atol = np.repeat([1e-9, 2e-4, 2e-2], 3)
    for j in range(9):
        e = np.zeros(15)
        e[6 + j] = sizes[j]
        wanted = (apart(nominal, moved(truth, 10, e)) - apart(nominal, moved(truth, 10, -e))) / 2
        off = np.abs(sizes[j] * Phi[6 + j] - wanted)
        assert (off <= atol + 1e-6 * np.abs(wanted)).all(), (j, off)


def test_noise_of_the_sensors_is_that_of_the_steps_taken_together(weave):
    steps = 10
    *_, sums = moved(weave, steps)
    columns = np.empty((6, 9))
    kernel.sensor_noise(sums, columns)
    Q = np.zeros((9, 9))
    for i in range(steps):
        dt = 0.01
        own = np.diag(np.repeat([1.5e-4**2 * dt, 0.004**2 * dt, 0.0], 3))
        *_, after = moved_from(weave, i + 1, steps)
        Phi = np.eye(9)
        if i + 1 < steps:
            full = np.empty((15, 9))
            kernel.transition(after, weave.position[0], weave.velocity[0], full)
            Phi = full[6:].T
        Q += Phi @ own @ Phi.T
    got = columns.T @ columns
    # in the middle of T: variances of the integrals are T^2/4 of the rate's for T^2/3
    sigma = np.sqrt(np.diag(Q))
    np.testing.assert_allclose(got / np.outer(sigma, sigma), Q / np.outer(sigma, sigma), rtol=0, atol=0.3)
    # attitude itself has all of it, velocity but for what attitude makes of it
    np.testing.assert_allclose(np.diag(got)[:6], np.diag(Q)[:6], rtol=2e-3)


def moved_from(truth, first: int, last: int):
    """The sums over a stretch of the steps."""
    C = np.empty((3, 3))
    matrix_from_quaternion(truth.attitude[first], C)
    position, velocity, sums = (
        truth.position[first].copy(),
        truth.velocity[first].copy(),
        np.zeros(kernel.SUMS),
    )
    for i in range(first, last):
        before = C.copy()
        step(position, velocity, C, truth.imu.rotation[i], truth.imu.velocity[i], 0.01)
        kernel.accumulate(sums, before, C, truth.imu.velocity[i], 0.01)
    return position, velocity, C, sums


def lower(rng, n: int):
    """A factor by columns, lower triangular, of states of very different size."""
    sizes = 10.0 ** rng.uniform(-6, 2, n)
    return np.triu(rng.standard_normal((n, n))) * sizes


@settings(max_examples=30, deadline=None)
@given(n=st.integers(15, 30), seed=st.integers(0, 2**32 - 1))
def test_propagation_keeps_the_covariance_that_dense_algebra_has(n, seed):
    rng = np.random.default_rng(seed)
    W, work = np.zeros((2 * n + 6, n)), np.empty(n + 9)
    W[:n] = lower(rng, n)
    size = np.sqrt(np.diag(W[:n].T @ W[:n]))
    Phi, decay = (
        rng.standard_normal((15, 9)) * (1 / size[n - 15 :])[:, np.newaxis] * size[n - 9 :],
        rng.uniform(0, 1, n - 15),
    )
    sensors, diagonal = rng.standard_normal((6, 9)) * size[n - 9 :], rng.uniform(0, 1, n) * size
    diagonal[rng.random(n) < 0.5] = 0.0
    full = np.eye(n)
    full[np.arange(n - 15), np.arange(n - 15)] = decay
    full[n - 9 :, n - 15 :] = Phi.T
    spread = np.zeros((6, n))
    spread[:, n - 9 :] = sensors
    wanted = full @ W[:n].T @ W[:n] @ full.T + np.diag(diagonal**2) + spread.T @ spread
    kernel.propagate(W, n, Phi, decay, work)
    kernel.triangularise(W, n, n, diagonal, kernel.put_noise(W, n, diagonal, sensors), work)
    sigma = np.sqrt(np.diag(wanted))
    assert not np.tril(W[:n], -1).any()
    # n products of numbers of size one
    np.testing.assert_allclose(
        (W[:n].T @ W[:n]) / np.outer(sigma, sigma), wanted / np.outer(sigma, sigma), rtol=0, atol=1e-13
    )


@settings(max_examples=30, deadline=None)
@given(n=st.integers(15, 30), seed=st.integers(0, 2**32 - 1))
def test_a_measurement_does_to_the_factor_what_it_does_to_the_covariance(n, seed):
    rng = np.random.default_rng(seed)
    W = lower(rng, n)
    P = W.T @ W
    h, variance, innovation = (
        rng.standard_normal(n) / np.sqrt(np.diag(P)),
        rng.uniform(0.1, 10),
        rng.standard_normal(),
    )
    gain = P @ h / (h @ P @ h + variance)
    joseph = np.eye(n) - np.outer(gain, h)
    wanted = joseph @ P @ joseph.T + variance * np.outer(gain, gain)
    x = np.zeros(n)
    kernel.observe(x, W, n, h, innovation, variance, np.empty(n))
    sigma = np.sqrt(np.diag(P))
    assert not np.tril(W, -1).any()
    np.testing.assert_allclose(x / sigma, gain * innovation / sigma, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        (W.T @ W) / np.outer(sigma, sigma), wanted / np.outer(sigma, sigma), rtol=0, atol=1e-13
    )
