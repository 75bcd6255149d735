"""The filter of navigation against a dense textbook filter, and what it makes of what each aid says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from navigation_filter_flights import FIELD, drawn, flight

from pipeline.models import ellipsoid, strapdown
from pipeline.models._kernels_strapdown import matrix_from_quaternion, step, turn_left
from pipeline.models.navigation_errors import NavigationError
from pipeline.models.navigation_filter import covariances, navigate, run
from pipeline.models.navigation_filter_settings import (
    ColouredErrors,
    FilterSettings,
    GaussMarkov,
    MeasurementNoise,
    ProcessNoise,
    StartDeviations,
)
from pipeline.models.navigation_problem import Fixes, Start

AIDS = {"position": 1.0, "velocity": 1.0, "airspeed": 0.2, "altitude": 0.1, "magnetic_field": 0.1}
EXACT = StartDeviations(*[1e-6] * 8)
"""A start without errors."""


@pytest.fixture(scope="module")
def weave():
    return flight(60.0, 0.02, turns=0.3)


def fixes(truth, at, value, usable=None):
    usable = np.ones(len(at), dtype=np.bool_) if usable is None else usable
    return Fixes(truth.imu.time[at] if np.issubdtype(np.asarray(at).dtype, np.integer) else at, value, usable)


def started(truth) -> Start:
    return Start(*truth.position[0], truth.velocity[0], truth.attitude[0])


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def textbook(problem, settings, seconds: float):
    """A dense filter with 18 states in long double: position, velocity, altitude and magnetometer.

    States p, v, φ, accelerometer bias, gyro bias, wind, barometer bias; Φ = I + F dt + (F dt)²/2, Q by the
    trapezoidal rule, Joseph's update, all rows of an aid at once.
    """
    p0, q, r = settings.start, settings.noise, settings.measurement
    sigma = [p0.position] * 3 + [p0.velocity] * 3 + [p0.tilt, p0.tilt, p0.yaw] + [p0.accelerometer_bias] * 3
    P = np.diag(np.square([*sigma, *[p0.gyro_bias] * 3, *[p0.wind] * 2, p0.barometer_bias])).astype(
        np.longdouble
    )
    densities = [0] * 3 + [q.velocity] * 3 + [q.attitude] * 3 + [q.accelerometer_bias] * 3 + [q.gyro_bias] * 3
    spread = np.diag(np.square([*densities, q.wind, q.wind, q.barometer_bias])).astype(np.longdouble)
    start, imu = problem.start, problem.imu
    position, velocity = np.array([start.latitude, start.longitude, start.height]), start.velocity.copy()
    C, accelerometer, gyro, barometer = np.empty((3, 3)), np.zeros(3), np.zeros(3), 0.0
    matrix_from_quaternion(start.attitude, C)
    for i in range(round(seconds / imu.time[1])):
        dt = imu.time[i + 1] - imu.time[i]
        lat, h, before = position[0], position[2], C.copy()
        turned = np.cross(gyro, imu.velocity[i]) + np.cross(imu.rotation[i], accelerometer)
        gain = imu.velocity[i] - dt * (accelerometer + turned / 2)
        step(position, velocity, C, imu.rotation[i] - dt * gyro, gain, dt)
        rm, rn = ellipsoid.radii(lat, h)
        f, mean = before @ gain / dt, (before + C) / 2
        earth, transport = ellipsoid.earth_rate_ned(lat), ellipsoid.transport_rate(lat, h, velocity)
        vn, ve, vd = velocity
        by_v = np.array([[0, 1 / rn, 0], [-1 / rm, 0, 0], [0, -np.tan(lat) / rn, 0]])
        F = np.zeros((18, 18), dtype=np.longdouble)
        F[:3, :3] = [
            [-vd / rm, 0, vn / rm],
            [ve * np.tan(lat) / rn, -(vd + vn * np.tan(lat)) / rn, ve / rn],
            [0, 0, 0],
        ]
        F[:3, 3:6] = np.eye(3)
        F[3:6, 3:6] = -cross(2 * earth + transport) + cross(velocity) @ by_v
        F[3:6, 6:9], F[3:6, 9:12] = -cross(f), -mean
        F[5, 2] = 2 * ellipsoid.gravity(lat, h) / rn
        F[6:9, 3:6], F[6:9, 6:9], F[6:9, 12:15] = -by_v, -cross(earth + transport), -mean
        Phi = np.eye(18) + F * dt + F @ F * dt**2 / 2
        P = Phi @ (P + spread * dt / 2) @ Phi.T + spread * dt / 2
        for aid in ("position", "velocity", "altitude", "magnetic_field"):
            for j in np.flatnonzero(np.abs(problem.aids[aid].time - imu.time[i + 1]) < 1e-9):
                value, rows = problem.aids[aid].value[j], np.zeros((3, 18))
                if aid == "position":
                    z, rows[:, :3] = ellipsoid.metres_between(position, value), np.eye(3)
                elif aid == "velocity":
                    z, rows[:, 3:6] = value - velocity, np.eye(3)
                elif aid == "altitude":
                    rows = np.zeros((1, 18))
                    rows[0, 2], rows[0, 17] = -1, 1
                    z = np.array([value - position[2] - barometer])
                else:
                    z, rows[:, 6:9] = value - C.T @ FIELD.ned, C.T @ cross(FIELD.ned)
                R = np.eye(len(z)) * getattr(r, aid) ** 2
                S = (rows @ P @ rows.T + R).astype(np.float64)
                K = P @ rows.T @ np.linalg.inv(S)
                joseph = np.eye(18) - K @ rows
                P = joseph @ P @ joseph.T + K @ R @ K.T
                x = (K @ z).astype(np.float64)
                position, velocity = ellipsoid.displaced(position, x[:3]), velocity + x[3:6]
                turn_left(C, *x[6:9])
                accelerometer, gyro, barometer = accelerometer + x[9:12], gyro + x[12:15], barometer + x[17]
    return position, velocity, C, accelerometer, gyro, P.astype(np.float64)


@pytest.mark.parametrize(("covariance_step", "tolerance"), [(0.02, 2e-3), (0.1, 1e-2)])
def test_the_filter_is_the_textbook_one(weave, covariance_step, tolerance):
    # what the covariance's steps differ by is their noise, in the middle or at the ends: a share of the order
    # of (T/1 s)^2 of what is gathered between fixes, and the Earth's terms, of the first order here
    settings = FilterSettings(covariance_step=covariance_step, gate=0.0)
    aids = {name: AIDS[name] for name in ("position", "velocity", "altitude", "magnetic_field")}
    problem = drawn(weave, settings, aids, np.random.default_rng(3)).problem
    position, velocity, C, accelerometer, gyro, P = textbook(problem, settings, 20.0)
    filtered = run(problem, settings, keep_history=True)
    nav, end = filtered.navigation, 1000
    mine = covariances(filtered)[np.searchsorted(filtered.rows, end)]
    order = ("position", "velocity", "attitude", "accelerometer_bias", "gyro_bias", "wind", "barometer_bias")
    index = np.concatenate([np.arange(18)[filtered.states.groups[name]] for name in order])
    mine, sigma = mine[np.ix_(index, index)], np.sqrt(np.diag(P))
    np.testing.assert_allclose(
        mine / np.outer(sigma, sigma), P / np.outer(sigma, sigma), rtol=0, atol=tolerance
    )
    turn = strapdown_matrix(nav.attitude[end]) @ C.T
    apart = np.concatenate(
        [
            ellipsoid.metres_between(position, nav.position[end]),
            nav.velocity[end] - velocity,
            [turn[2, 1], turn[0, 2], turn[1, 0]],
            nav.accelerometer_bias[end] - accelerometer,
            nav.gyro_bias[end] - gyro,
        ]
    )
    assert np.abs(apart / sigma[:15]).max() < tolerance


def strapdown_matrix(quaternion):
    C = np.empty((3, 3))
    matrix_from_quaternion(quaternion, C)
    return C


def test_without_aids_it_is_the_strapdown_navigation(weave):
    problem = replace(drawn(weave, FilterSettings(), AIDS, np.random.default_rng(0)).problem, aids={})
    own, plain = navigate(problem), strapdown.navigate(problem)
    # rounding is taken back from C at other steps: 1e-14 of it, times g and 60 s squared
    assert np.abs(ellipsoid.metres_between(own.position, plain.position)).max() < 1e-8
    np.testing.assert_allclose(own.attitude, plain.attitude, rtol=0, atol=1e-13)
    assert own.used == {}
    assert own.deviations is not None
    # biases of 0.2 m/s^2 and 1e-3 rad/s and a tilt of 0.02 rad, over 60 s of straight flight; the weave turns
    # a bias by 0.3 rad at most, which takes less than a tenth from it
    straight = np.linalg.norm([0.2 * 60**2 / 2, 0.02 * 9.82 * 60**2 / 2, 1e-3 * 9.82 * 60**3 / 6])
    assert 0.9 * straight < own.deviations.position[-1, 0] < straight


@pytest.mark.parametrize(
    "aid", ["position", "velocity", "altitude", "magnetic_field", "attitude", "airspeed"]
)
def test_a_measurement_between_two_steps_is_compared_with_its_own_instant(weave, aid):
    """Exact aids 7 ms after every 50th row, of a record of 100 Hz; the filter sees every other row."""
    fine = flight(20.0, 0.01, turns=0.3)
    coarse = replace(
        flight(20.0, 0.02, turns=0.3),
        position=fine.position[::2],
        velocity=fine.velocity[::2],
        attitude=fine.attitude[::2],
    )
    at = np.arange(51, len(fine.imu.time) - 1, 50)
    value = {
        "position": fine.position,
        "velocity": fine.velocity,
        "altitude": fine.position[:, 2:],
        "attitude": fine.attitude,
        "airspeed": np.linalg.norm(fine.velocity, axis=1)[:, np.newaxis],
        "magnetic_field": np.einsum(
            "nji,j->ni", np.array([strapdown_matrix(q) for q in fine.attitude]), FIELD.ned
        ),
    }[aid][at]
    problem = drawn(coarse, FilterSettings(start=EXACT), {}, np.random.default_rng(0)).problem
    problem = replace(
        problem, imu=coarse.imu, aids={aid: Fixes(fine.imu.time[at], value, np.ones(len(at), dtype=np.bool_))}
    )
    settings = FilterSettings(start=EXACT, noise=ProcessNoise(*[1e-9] * 8))
    innovations = navigate(problem, settings).innovations[aid]
    # in half a step of 0.02 s there are 0.4 m and, weaving, 0.03 m/s and 1e-3 rad (6e-8 T); linear between
    # two rows leaves the eighth of the second difference: 1e-4 of them, and what both flights differ by in 20
    # s, 1e-3 m
    limit = {
        "position": 5e-3,
        "velocity": 1e-3,
        "altitude": 5e-3,
        "airspeed": 1e-3,
        "attitude": 2e-5,
        "magnetic_field": 1e-9,
    }
    assert len(innovations.time) == len(at)
    assert np.abs(innovations.value).max() < limit[aid]


def test_a_lever_arm_is_taken_off(weave):
    arm = np.array([3.0, -1.0, 0.5])
    problem = drawn(weave, FilterSettings(start=EXACT), {}, np.random.default_rng(0)).problem
    at = np.arange(50, 3000, 50)
    turned = np.array([strapdown_matrix(q) @ arm for q in weave.attitude])
    antenna = ellipsoid.displaced(weave.position, turned)
    rate = weave.imu.rotation / 0.02
    moving = np.array(
        [strapdown_matrix(q) @ np.cross(w, arm) for q, w in zip(weave.attitude[1:], rate, strict=True)]
    )
    aids = {
        "position": fixes(weave, at, antenna[at]),
        "velocity": fixes(weave, at, weave.velocity[at] + moving[at - 1]),
    }
    problem = replace(problem, imu=weave.imu, start=started(weave), aids=aids)
    settings = FilterSettings(start=EXACT, noise=ProcessNoise(*[1e-9] * 8), lever_arm=(3.0, -1.0, 0.5))
    found = navigate(problem, settings).innovations
    # the rate is that of the step, not of its end, and the Earth's rate is in it: 1e-4 rad/s and half of 0.02
    # s of its change
    assert np.abs(found["position"].value).max() < 1e-5
    assert np.abs(found["velocity"].value).max() < 2e-3
    without = navigate(problem, replace(settings, lever_arm=(0.0, 0.0, 0.0))).innovations
    assert np.abs(without["position"].value[0]).max() > 1.0


def test_an_outlier_is_refused_and_said(weave):
    problem = drawn(weave, FilterSettings(), AIDS, np.random.default_rng(1)).problem
    position = problem.aids["position"]
    value = position.value.copy()
    value[30, 2] += 50.0
    spoilt = replace(problem, aids=dict(problem.aids) | {"position": replace(position, value=value)})
    nav, clean = navigate(spoilt), navigate(problem)
    found = nav.innovations["position"]
    assert np.flatnonzero(~found.accepted).tolist() == [30]
    time = nav.time
    lost = (time >= position.time[30]) & (time < position.time[31])
    assert not nav.used["position"][lost].any()
    assert nav.used["position"][(time >= position.time[0]) & ~lost].all()
    # it is as if the fix had not been
    absent = position.usable.copy()
    absent[30] = False
    without = navigate(
        replace(problem, aids=dict(problem.aids) | {"position": replace(position, usable=absent)})
    )
    np.testing.assert_array_equal(nav.position, without.position)
    assert not np.array_equal(nav.position, clean.position)


def test_values_that_are_no_numbers_are_no_fixes_and_a_lost_aid_goes_stale(weave):
    problem = drawn(weave, FilterSettings(), AIDS, np.random.default_rng(1)).problem
    value = problem.aids["velocity"].value.copy()
    value[10:40, 1] = np.nan
    nav = navigate(
        replace(
            problem, aids=dict(problem.aids) | {"velocity": replace(problem.aids["velocity"], value=value)}
        )
    )
    assert np.isfinite(nav.position).all()
    assert len(nav.innovations["velocity"].time) == len(value) - 30
    assert not nav.used["velocity"][(nav.time >= 11) & (nav.time < 41)].any()
    first = Fixes(
        *(
            part[:20]
            for part in (
                problem.aids["altitude"].time,
                problem.aids["altitude"].value,
                problem.aids["altitude"].usable,
            )
        )
    )
    used = navigate(replace(problem, aids=dict(problem.aids) | {"altitude": first})).used["altitude"]
    # 20 fixes of 0.1 s, and 2.5 intervals more
    assert np.flatnonzero(used)[-1] == pytest.approx((2.0 + 0.25) / 0.02, abs=1)


def test_what_is_refused_long_enough_is_believed(weave):
    """A state that is 3 km off with a deviation of 3 m: refused 30 times, then made uncertain by as much."""
    problem = drawn(weave, FilterSettings(), AIDS, np.random.default_rng(1)).problem
    far = replace(problem.start, latitude=problem.start.latitude + 3000 / 6.38e6)
    nav = navigate(replace(problem, start=far))
    assert np.flatnonzero(nav.innovations["position"].accepted)[0] == 30
    assert (
        np.linalg.norm(ellipsoid.metres_between(nav.position[-1], weave.position[-1])) < 5.0
    )  # 3 sigma of a fix
    never = navigate(replace(problem, start=far), FilterSettings(reseat_after=0))
    assert not never.innovations["position"].accepted.any()


def test_coasted_steps_are_uncertain(weave):
    problem = drawn(weave, FilterSettings(), AIDS, np.random.default_rng(1)).problem
    coasted = np.zeros(len(problem.imu), dtype=np.bool_)
    coasted[1500:1525] = True
    nav = navigate(replace(problem, imu=replace(problem.imu, coasted=coasted)))
    plain = navigate(problem)
    assert nav.deviations is not None
    assert plain.deviations is not None
    # half a second of 0.5 m/s/sqrt(s)
    gathered = nav.deviations.velocity[1525] ** 2 - plain.deviations.velocity[1525] ** 2
    assert (gathered > 0.1 * 0.25 * 0.5).all()
    assert (gathered < 1.1 * 0.25 * 0.5 + 0.02**2 * 9.81**2 * 0.5).all()


def test_fifteen_states_calibrate_wind_and_barometer_beside_the_filter():
    truth = flight(200.0, 0.02)
    settings = FilterSettings(
        states=15,
        noise=ProcessNoise(wind=0.0, barometer_bias=0.0),
        measurement=MeasurementNoise(airspeed=0.5),
    )
    simulated = drawn(truth, settings, AIDS, np.random.default_rng(2), outage=(100.0, 150.0))
    nav = navigate(simulated.problem, settings)
    assert nav.wind is None
    assert nav.deviations is not None
    assert nav.deviations.barometer_bias is None
    gnss, air = nav.used["position"], nav.used["airspeed"]
    # aided by either, not by both; the last fix aids for 2.5 s of the outage
    during = (nav.time > 103) & (nav.time < 150)
    assert air[during].all()
    assert not (air & gnss).any()
    height = nav.position[during, 2] - truth.position[during, 2]
    assert np.abs(height).max() < 1.0  # a barometer of 0.5 m whose bias of 5 m is known to 0.2 m


def test_coloured_errors_get_states_only_where_there_is_the_aid(weave):
    colour = ColouredErrors(position=GaussMarkov(0.5, 30.0), gust=GaussMarkov(1.0, 6.6), hard_iron=1e-7)
    settings = FilterSettings(coloured=colour)
    problem = drawn(weave, settings, {"position": 1.0}, np.random.default_rng(1)).problem
    filtered = run(problem, settings, keep_history=False)
    assert list(filtered.states.groups)[:3] == ["barometer_bias", "wind", "position_colour"]
    assert len(filtered.states) == 21
    # a fix of 1.5 m says nothing of its own error of 0.5 m: it stays
    last = filtered.navigation.deviations
    assert last is not None
    assert np.all(last.position[-1] > 0.4)


def test_standard_deviations_are_continuous_between_measurements(weave):
    problem = drawn(weave, FilterSettings(), {"position": 1.0}, np.random.default_rng(1)).problem
    coarse, fine = (
        navigate(problem, FilterSettings(covariance_step=size)).deviations for size in (0.1, 0.02)
    )
    assert coarse is not None
    assert fine is not None
    # a deviation of velocity of 0.05 to 0.3 m/s grows by less than 1e-2 of it in 0.1 s but for the first
    # second
    np.testing.assert_allclose(coarse.velocity[50:], fine.velocity[50:], rtol=1e-2)


def test_a_magnetometer_needs_a_field(weave):
    problem = drawn(weave, FilterSettings(), AIDS, np.random.default_rng(1)).problem
    with pytest.raises(NavigationError, match="magnetic field of the Earth"):
        navigate(replace(problem, earth_field=None))


def test_a_pole_is_one_clear_line(weave):
    problem = drawn(weave, FilterSettings(), {}, np.random.default_rng(1)).problem
    with pytest.raises(NavigationError, match=r"latitude within 89\.9 degrees, found 89\.95"):
        navigate(replace(problem, start=replace(problem.start, latitude=np.radians(89.95))))


def test_a_swapped_quaternion_sign_is_the_same_attitude(weave):
    aids = {"position": 1.0, "attitude": 0.1}
    problem = drawn(weave, FilterSettings(), aids, np.random.default_rng(1)).problem
    attitude = problem.aids["attitude"]
    other = replace(problem, aids=dict(problem.aids) | {"attitude": replace(attitude, value=-attitude.value)})
    # the sign changes the rounding of the products only
    np.testing.assert_allclose(navigate(other).attitude, navigate(problem).attitude, rtol=0, atol=1e-12)


def test_the_answer_does_not_depend_on_the_turn_at_which_longitude_is_counted(weave):
    problem = drawn(weave, FilterSettings(), AIDS, np.random.default_rng(1)).problem
    position = problem.aids["position"]
    value = position.value + np.array([0.0, 2 * np.pi, 0.0])
    round_the_world = replace(problem, aids=dict(problem.aids) | {"position": replace(position, value=value)})
    # 2 pi has an ulp of 1e-15, in metres 6e-9
    apart = ellipsoid.metres_between(navigate(round_the_world).position, navigate(problem).position)
    assert np.abs(apart).max() < 1e-6
