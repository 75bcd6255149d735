"""The smoother of navigation against least squares of all errors at once, and against its own deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from navigation_filter_flights import drawn, flight

from pipeline.models.ellipsoid import metres_between
from pipeline.models.navigation_filter import navigate, run
from pipeline.models.navigation_filter_settings import (
    ColouredErrors,
    FilterSettings,
    GaussMarkov,
    MeasurementNoise,
    ProcessNoise,
    StartDeviations,
)
from pipeline.models.navigation_smoother import run_back, smooth
from pipeline.numerics.rotation import (
    quaternion_conjugate,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

SMALL = 1e-3
"""Errors so much smaller than usual are linear: their second order is 1e-3 of a sigma at most."""
TINY = FilterSettings(
    states=15,
    start=StartDeviations(*(SMALL * np.array([3.0, 0.3, 0.02, 0.02, 0.2, 1e-3, 6.0, 5.0]))),
    noise=ProcessNoise(*(SMALL * np.array([0.02, 1e-3, 1e-3, 1e-4, 0.0, 0.0]))),
    measurement=MeasurementNoise(position=1.5 * SMALL, velocity=0.08 * SMALL),
    gate=0.0,
)
AIDS = {"position": 1.0, "velocity": 0.5}


def least_squares(problem, settings):
    """Errors of the unaided navigation at all nodes, and their covariance, by one least-squares problem.

    Its unknowns are the states at all nodes; its rows the start, the transition of every interval with its
    noise, and every measurement against the unaided navigation.
    """
    nodes = run(problem, settings, keep_history=False).rows
    free = run(with_nodes_of(problem), settings, keep_history=True)
    assert np.array_equal(free.rows, nodes)
    history, n = free.history, 15
    K = len(nodes)
    rows, right = [], []
    first = np.zeros((n, K * n))
    first[:, :n] = np.diag(1 / free.states.start)
    rows.append(first)
    right.append(np.zeros(n))
    for k in range(1, K):
        full = np.eye(n)
        full[6:] = history.transition[k].T
        spread = np.diag(history.own_noise[k] ** 2)
        spread[6:, 6:] += history.sensor_noise[k].T @ history.sensor_noise[k]
        # noise of position is that of velocity, T/2 of it: a millionth more of its own makes it whole
        spread[12:, 12:] += 1e-6 * spread[12:, 12:].max() * np.eye(3)
        root = np.linalg.inv(np.linalg.cholesky(spread))
        part = np.zeros((n, K * n))
        part[:, k * n : (k + 1) * n], part[:, (k - 1) * n : k * n] = root, -root @ full
        rows.append(part)
        right.append(np.zeros(n))
    nav = free.navigation
    for aid, place in (("position", 12), ("velocity", 9)):
        sigma = getattr(settings.measurement, aid)
        for time, value in zip(problem.aids[aid].time, problem.aids[aid].value, strict=True):
            k = int(np.argmin(np.abs(nav.time[nodes] - time)))
            at = nodes[k]
            z = metres_between(nav.position[at], value) if aid == "position" else value - nav.velocity[at]
            part = np.zeros((3, K * n))
            part[:, k * n + place : k * n + place + 3] = np.eye(3) / sigma
            rows.append(part)
            right.append(z / sigma)
    A, b = np.vstack(rows), np.concatenate(right)
    scale = 1 / np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A * scale)
    x = (scale * np.linalg.solve(R, Q.T @ b)).reshape(K, n)
    sigma = (scale * np.linalg.norm(np.linalg.inv(R), axis=1)).reshape(K, n)
    return free, nodes, x, sigma


def with_nodes_of(problem):
    """The same instants of measurement, but no measurement that tells: all are 1e9 sigma away and refused."""
    return replace(
        problem,
        aids={
            name: replace(fixes, value=fixes.value, usable=np.zeros_like(fixes.usable))
            for name, fixes in problem.aids.items()
        },
    )


def test_the_smoother_is_least_squares_over_the_whole_record():
    truth = flight(3.0, 0.05, turns=0.3)
    # a covariance at every step, so that the nodes do not depend on which measurements there are
    settings = replace(TINY, covariance_step=0.05)
    problem = drawn(truth, settings, AIDS, np.random.default_rng(5)).problem
    free, nodes, x, sigma = least_squares(problem, settings)
    nav = free.navigation
    smoothed = run_back(run(problem, settings, keep_history=True), keep_factors=True)
    found = smoothed.navigation
    turned = quaternion_multiply(found.attitude, quaternion_conjugate(nav.attitude))[nodes]
    mine = np.concatenate(
        [
            found.gyro_bias[nodes],
            found.accelerometer_bias[nodes],
            rotation_vector_from_quaternion(turned),
            found.velocity[nodes] - nav.velocity[nodes],
            metres_between(nav.position[nodes], found.position[nodes]),
        ],
        axis=1,
    )
    own_sigma = np.linalg.norm(smoothed.factor, axis=1)
    # the second order, and rounding of latitude: 1e-9 m of 1e-3 m, and of A, whose columns span 1e6 of its
    # rows
    np.testing.assert_allclose(own_sigma, sigma, rtol=1e-3)
    assert np.abs((mine - x) / sigma).max() < 5e-3


def test_at_the_end_it_is_the_filter_and_everywhere_it_is_surer():
    truth = flight(60.0, 0.02, turns=0.3)
    aids = AIDS | {"altitude": 0.1, "magnetic_field": 0.1, "airspeed": 0.2}
    problem = drawn(truth, FilterSettings(), aids, np.random.default_rng(0), outage=(20.0, 50.0)).problem
    forward, back = navigate(problem), smooth(problem)
    np.testing.assert_array_equal(forward.position[-1], back.position[-1])
    np.testing.assert_allclose(forward.velocity[-1], back.velocity[-1], rtol=0, atol=0)
    assert forward.deviations is not None
    assert back.deviations is not None
    for name in ("position", "velocity", "attitude", "gyro_bias", "accelerometer_bias", "wind"):
        before, after = getattr(forward.deviations, name), getattr(back.deviations, name)
        # rounding of two chains of 600 reflections
        assert (after <= before * (1 + 1e-9)).all()
    middle = np.argmin(np.abs(truth.imu.time - 45))
    assert (back.deviations.position[middle, :2] < 0.5 * forward.deviations.position[middle, :2]).all()
    for aid, used in forward.used.items():
        np.testing.assert_array_equal(back.used[aid], used)
    assert back.method == "smoother"


def test_it_has_no_steps_where_the_filter_has_them():
    """A correction of the filter is a jump; what is smoothed moves as the vehicle does."""
    truth = flight(60.0, 0.02, turns=0.3)
    problem = drawn(truth, FilterSettings(), AIDS, np.random.default_rng(0)).problem
    forward, back = navigate(problem), smooth(problem)

    def jump(nav):
        steps = metres_between(nav.position[:-1], nav.position[1:])
        middle = (nav.velocity[1:] + nav.velocity[:-1]) / 2
        return np.abs(steps - 0.02 * middle)[100:].max()

    assert jump(forward) > 0.1
    # the noise of a second, 0.004 m/s, in a step of 0.02 s; and white noise of attitude on gravity
    assert jump(back) < 1e-3


@pytest.mark.parametrize("reseat", [False, True])
def test_it_passes_what_the_filter_was_told_on_the_way(reseat):
    """Coasted steps, and a state believed wrong after refused measurements: both are noise of an interval."""
    truth = flight(60.0, 0.02, turns=0.3)
    problem = drawn(
        truth, FilterSettings(), {"position": 0.5, "velocity": 0.5}, np.random.default_rng(4)
    ).problem
    imu = problem.imu
    coasted = np.zeros(len(imu), dtype=np.bool_)
    coasted[1500:1550] = True
    if reseat:
        velocity = imu.velocity.copy()
        velocity[1500] += [0.0, 20.0, 0.0]  # a knock that no model knows
        problem = replace(problem, imu=replace(imu, velocity=velocity))
        settings = FilterSettings(reseat_after=3)
    else:
        problem = replace(problem, imu=replace(imu, coasted=coasted))
        settings = FilterSettings()
    back = smooth(problem, settings)
    apart = metres_between(back.position, truth.position)
    quiet = np.abs(truth.imu.time - 31) > 6
    assert back.deviations is not None
    # 4.5 sigma: of 5000 correlated numbers one or two in a thousand records
    assert np.abs(apart / back.deviations.position)[quiet].max() < 4.5


def test_coloured_errors_are_smoothed_as_well():
    truth = flight(120.0, 0.02, turns=0.3)
    colour = ColouredErrors(position=GaussMarkov(0.5, 30.0), gust=GaussMarkov(1.06, 6.6), hard_iron=1.5e-7)
    settings = FilterSettings(coloured=colour, measurement=MeasurementNoise(position=0.3, airspeed=0.1))
    aids = AIDS | {"altitude": 0.1, "magnetic_field": 0.1, "airspeed": 0.2}
    record = drawn(truth, settings, aids, np.random.default_rng(7))
    forward, back = navigate(record.problem, settings), smooth(record.problem, settings)
    assert forward.deviations is not None
    assert back.deviations is not None
    assert (back.deviations.position <= forward.deviations.position * (1 + 1e-9)).all()
    assert back.wind is not None
    assert back.deviations.wind is not None
    # five sigma of the wind, which walks and whose error is one or two numbers in 120 s
    assert (np.abs(back.wind - record.wind) < 5 * back.deviations.wind).all()


def test_a_run_without_history_cannot_be_smoothed():
    problem = drawn(flight(2.0, 0.02), FilterSettings(), AIDS, np.random.default_rng(0)).problem
    with pytest.raises(ValueError, match="no history"):
        run_back(run(problem, FilterSettings(), keep_history=False), keep_factors=False)
