"""Strapdown navigation against exact flights, closed forms, high-order integration, and pyins."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from pyins import strapdown as pyins_strapdown
from scipy.spatial.transform import Rotation
from strapdown_flights import SHARP, STRAIGHT, WEAVING, Flight, earth_turned, ecef, ned_to_ecef

from pipeline.errors import ExitCode
from pipeline.models import _kernels_strapdown as kernels
from pipeline.models import ellipsoid
from pipeline.models.navigation_errors import NavigationError
from pipeline.models.navigation_problem import Imu, Navigation, Problem, Start
from pipeline.models.strapdown import (
    from_increments,
    increments,
    navigate,
    quaternion_from_yaw_pitch_roll,
    yaw_pitch_roll,
)
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]


def even(seconds: float, hertz: float) -> Float:
    return np.arange(round(seconds * hertz) + 1) / hertz


def flown(flight: Flight, t: Float) -> tuple[Float, Imu]:
    """True positions, and the increments of perfect sensors."""
    position = flight.position(t)
    return position, increments(t, *flight.sensors(t, position))


def errors(flight: Flight, t: Float, position: Float, imu: Imu) -> tuple[float, float, float]:
    """Greatest errors of position [m], velocity [m/s] and attitude [rad] from the true start."""
    got = navigate(Problem(imu, flight.start()))
    turn = quaternion_multiply(got.attitude, quaternion_conjugate(flight.attitude(t)))
    return (
        float(np.abs(ellipsoid.metres_between(position, got.position)).max()),
        float(np.abs(got.velocity - flight.velocity(t)[0]).max()),
        float(np.abs(rotation_vector_from_quaternion(turn)).max()),
    )


# --- the truth itself ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("flight", [STRAIGHT, WEAVING], ids=["straight", "weaving"])
def test_perfect_sensors_obey_newton_in_inertial_space(flight: Flight) -> None:
    """C f + gravitation is the second derivative of the inertial position, by differences of order six.
    Rounding of 6e6 m is 1e-9 m, over h² 1e-7 m/s^2; of the attitude 1e-15 over h, 1e-14 rad/s; truncation,
    the sixth power of 0.1 s times some 0.3 rad/s, is a part in 1e9 of 10 m/s^2 and 0.3 rad/s."""
    h, middle = 0.1, np.array([2.0, 30.0, 47.3, 71.1])
    t = np.sort((middle[:, None] + h * np.arange(-3, 4)).ravel())
    position = flight.position(np.append(0.0, t))[1:]
    rate, force = flight.sensors(t, position)
    C_en = ned_to_ecef(position[:, 0], position[:, 1])
    spin = earth_turned(t)
    place = np.einsum("nij,nj->ni", spin, ecef(position)).reshape(4, 7, 3)
    C = (spin @ C_en @ matrix_from_quaternion(flight.attitude(t))).reshape(4, 7, 3, 3)
    second = np.array([1 / 90, -3 / 20, 3 / 2, -49 / 18, 3 / 2, -3 / 20, 1 / 90]) / h**2
    first = np.array([-1 / 60, 3 / 20, -3 / 4, 0, 3 / 4, -3 / 20, 1 / 60]) / h
    fall = ellipsoid.gravity(position[:, 0], position[:, 2])[:, None] * (spin @ C_en)[:, :, 2]
    axis = np.array([0.0, 0.0, ellipsoid.RATE])
    fall = fall.reshape(4, 7, 3)[:, 3] + np.cross(axis, np.cross(axis, place[:, 3]))
    felt = np.einsum("nij,nj->ni", C[:, 3], force.reshape(4, 7, 3)[:, 3])
    np.testing.assert_allclose(np.einsum("k,nki->ni", second, place), felt + fall, rtol=0, atol=1e-6)
    W = np.swapaxes(C[:, 3], 1, 2) @ np.einsum("k,nkij->nij", first, C)
    turned = np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], -1)
    np.testing.assert_allclose(turned, rate.reshape(4, 7, 3)[:, 3], rtol=0, atol=1e-8)


# --- perfect sensors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("flight", [STRAIGHT, WEAVING], ids=["straight", "weaving"])
def test_perfect_sensors_at_100_hz_lose_less_than_a_millimetre_in_1800_s(flight: Flight) -> None:
    """MATH 4.3. Velocity and attitude: a millimetre over the half hour is 6e-7 m/s, and that over g and the
    84 min of Schuler 5e-11 rad; both leave room for the trapezoid of the catapult and for rounding."""
    t = even(1800, 100)
    position, imu = flown(flight, t)
    metres, speed, angle = errors(flight, t, position, imu)
    assert metres < 1e-3
    assert speed < 1e-6
    assert angle < 1e-9
    assert not imu.coasted.any()


def test_integrating_sensors_are_as_good() -> None:
    """The same millimetre, over 300 s."""
    t = even(300, 100)
    metres, _, angle = errors(WEAVING, t, WEAVING.position(t), from_increments(t, *WEAVING.integrals(t)))
    assert metres < 1e-3
    assert angle < 1e-9


@pytest.mark.parametrize("integrating", [False, True], ids=["samples", "integrals"])
def test_irregular_intervals_are_as_good(integrating: bool) -> None:
    """Intervals from 6 to 14 ms; the millimetre again, over 300 s."""
    rng = np.random.default_rng(5)
    t = np.append(0.0, np.cumsum(0.01 * rng.uniform(0.6, 1.4, 30_000)))
    position, imu = flown(SHARP, t)
    if integrating:
        imu = from_increments(t, *SHARP.integrals(t))
    metres, _, angle = errors(SHARP, t, position, imu)
    assert metres < 1e-3
    assert angle < 1e-9


def test_error_falls_with_the_square_of_the_step() -> None:
    """The step is of second order, so from 25 to 50 Hz the error of position falls by 4 (3.9 to 4.1: the next
    order is (0.04 s)² less)."""
    found = []
    for hertz in (25, 50):
        t = even(100, hertz)
        found.append(errors(SHARP, t, *flown(SHARP, t))[0])
    assert found[0] / found[1] == pytest.approx(4, abs=0.1)


@pytest.mark.parametrize(("second", "metres"), [(10, 10.3), (30, 89.0), (60, 366.0)])
def test_sensors_of_set_2_drift_as_they_must(second: int, metres: float) -> None:
    """MATH 4.3: cruise, true start, no correction; within 1.5 %."""
    cruise = Flight(course=np.radians(55.0))
    t = even(90, 100)
    position = cruise.position(t)
    rate, force = cruise.sensors(t, position)
    rate = rate + np.radians([0.035, -0.015, -0.025])
    force = force + np.array([0.15, -0.15, 0.0])
    begin = 2000  # 20 s: the catapult is over
    start = Start(*position[begin], cruise.velocity(t[begin : begin + 1])[0][0], cruise.attitude(t[:1])[0])
    got = navigate(Problem(increments(t[begin:], rate[begin:], force[begin:]), start))
    row = 100 * second
    error = ellipsoid.metres_between(position[begin + row], got.position[row])
    assert np.hypot(error[0], error[1]) == pytest.approx(metres, rel=0.015)


# --- start and end ------------------------------------------------------------------------------------------


def at_rest(seconds: float, start: Start) -> Imu:
    t = even(seconds, 10)
    C = matrix_from_quaternion(start.attitude)
    rate = C.T @ ellipsoid.earth_rate_ned(start.latitude)
    force = C.T @ np.array([0.0, 0.0, -ellipsoid.gravity(start.latitude, start.height)])
    return increments(t, np.tile(rate, (len(t), 1)), np.tile(force, (len(t), 1)))


def test_a_stand_at_rest_stays_there() -> None:
    """An hour at 10 Hz. Of second order is what a step makes of the turn of body and frame together,
    (U dt)² g/12 = 4e-11 m/s^2; the fall of gravity with height lets it grow by e in 570 s, to
    4e-11 * 570² * cosh(3600/570) = 4 mm, and twice that with the body leaning; over 570 s the velocity."""
    start = Start(0.9, -2.0, 250.0, np.zeros(3), quaternion_from_yaw_pitch_roll([2.0, 0.4, -1.0]))
    got = navigate(Problem(at_rest(3600, start), start))
    moved = ellipsoid.metres_between([start.latitude, start.longitude, start.height], got.position)
    assert np.abs(moved).max() < 0.02
    assert np.abs(got.velocity).max() < 4e-5
    assert got.method == "strapdown"
    assert not got.gyro_bias.any()


@pytest.mark.parametrize("degrees", [90.0, 89.95, -89.95])
def test_a_pole_is_refused(degrees: float) -> None:
    start = Start(np.radians(degrees), 0.0, 0.0, np.zeros(3), np.array([1.0, 0, 0, 0]))
    with pytest.raises(
        NavigationError, match=r"the start of navigation: expected a latitude within 89\.9 degrees"
    ) as refused:
        navigate(Problem(at_rest(1, start), start))
    assert refused.value.exit_code is ExitCode.NOT_MET


def test_a_way_over_the_limit_is_refused_where_it_leads_there() -> None:
    """600 m/s north from 89.8 degrees: 0.1 degrees are 11.17 km, 18.6 s."""
    start = Start(np.radians(89.8), 0.0, 0.0, np.array([600.0, 0, 0]), np.array([1.0, 0, 0, 0]))
    with pytest.raises(NavigationError, match=r"navigation, 18\.[67]00 s after"):
        navigate(Problem(at_rest(60, start), start))


@pytest.mark.parametrize("attitude", [[np.nan, 0, 0, 0], [0.0, 0, 0, 0]])
def test_a_start_that_is_no_number_is_refused(attitude: list[float]) -> None:
    start = Start(0.9, 0.0, 0.0, np.zeros(3), np.array([1.0, 0, 0, 0]))
    imu = at_rest(1, start)
    with pytest.raises(
        NavigationError, match="the start of navigation: expected position, velocity and attitude"
    ):
        navigate(Problem(imu, Start(0.9, 0.0, 0.0, np.zeros(3), np.array(attitude))))


def test_yaw_pitch_and_roll_are_the_usual_angles() -> None:
    """Against scipy's intrinsic z, y, x; away from its singularity, a few roundings of pi."""
    angles = np.random.default_rng(7).uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (200, 3))
    quaternion = quaternion_from_yaw_pitch_roll(angles)
    expected = Rotation.from_euler("ZYX", angles).as_matrix()
    np.testing.assert_allclose(matrix_from_quaternion(quaternion), expected, rtol=0, atol=2e-15)
    np.testing.assert_allclose(yaw_pitch_roll(quaternion), angles, rtol=0, atol=2e-14)


# --- the compiled step --------------------------------------------------------------------------------------


def reference_step(
    position: Float, velocity: Float, C: Float, rotation: Float, increment: Float, dt: float
) -> tuple[Float, Float, Float]:
    """The formulae of the module's head in plain NumPy."""
    meridian, prime_vertical = ellipsoid.radii(position[0], position[2])
    middle = position + dt / 2 * np.array([velocity[0] / meridian, 0.0, -velocity[2]])
    pushed = C @ increment
    earth = ellipsoid.earth_rate_ned(middle[0])
    down = np.array([0.0, 0.0, ellipsoid.gravity(middle[0], middle[2])])

    def carried(v: Float) -> Float:
        return ellipsoid.transport_rate(middle[0], middle[2], v)

    half = velocity + pushed / 2 + dt / 2 * (down - np.cross(2 * earth + carried(velocity), velocity))
    zeta = (earth + carried(half)) * dt
    after = velocity + pushed - np.cross(zeta, pushed) / 2
    after = after + dt * (down - np.cross(2 * earth + carried(half), half))
    mean = (velocity + after) / 2
    meridian, prime_vertical = ellipsoid.radii(middle[0], middle[2])
    way = np.array([mean[0] / meridian, mean[1] / (prime_vertical * np.cos(middle[0])), -mean[2]]) * dt
    frame = Rotation.from_rotvec(-(earth + carried(mean)) * dt).as_matrix()
    return position + way, after, frame @ C @ Rotation.from_rotvec(rotation).as_matrix()


def test_the_compiled_step_is_the_formulae() -> None:
    """Steps of 0.5 s at up to 300 m/s; a few roundings of each state."""
    rng = np.random.default_rng(8)
    for _ in range(50):
        position = rng.uniform([-1.4, -3.0, -100.0], [1.4, 3.0, 1e4])
        velocity, C = rng.normal(0, 100, 3), Rotation.random(rng=rng).as_matrix()
        rotation, increment = rng.normal(0, 0.3, 3), rng.normal(0, 5, 3)
        expected = reference_step(position, velocity, C, rotation, increment, 0.5)
        kernels.step(position, velocity, C, rotation, increment, 0.5)
        np.testing.assert_allclose(position, expected[0], rtol=1e-15, atol=1e-15)
        np.testing.assert_allclose(velocity, expected[1], rtol=0, atol=3e-13)
        np.testing.assert_allclose(C, expected[2], rtol=0, atol=3e-15)


def test_the_compiled_rotations_are_rotations() -> None:
    """On both sides of the series' limit, and near half a turn; a few roundings of 1."""
    rng = np.random.default_rng(9)
    for size in (0.0, 1e-9, 1e-3, 0.099, 0.101, 1.0, 3.0, 3.14159):
        vector = rng.normal(size=3)
        vector *= size / np.linalg.norm(vector)
        turn = Rotation.from_rotvec(vector).as_matrix()
        np.testing.assert_allclose(kernels.rotation_matrix(vector), turn, rtol=0, atol=3e-15)
        C = Rotation.random(rng=rng).as_matrix()
        left, right, quaternion, back = C.copy(), C.copy(), np.empty(4), np.empty((3, 3))
        kernels.turn_left(left, *vector)
        kernels.turn_right(right, *vector)
        np.testing.assert_allclose(left, turn @ C, rtol=0, atol=3e-15)
        np.testing.assert_allclose(right, C @ turn, rtol=0, atol=3e-15)
        for matrix in (
            C,
            turn,
            np.diag([1.0, -1.0, -1.0]),
            np.diag([-1.0, 1.0, -1.0]),
            np.diag([-1.0, -1.0, 1.0]),
        ):
            kernels.quaternion_from_matrix(np.ascontiguousarray(matrix), quaternion)
            np.testing.assert_allclose(quaternion, quaternion_from_matrix(matrix), rtol=0, atol=3e-15)
            kernels.matrix_from_quaternion(3.0 * quaternion, back)
            np.testing.assert_allclose(back, matrix, rtol=0, atol=3e-15)


def test_orthonormalisation_takes_back_small_faults() -> None:
    """Newton's step squares a fault of 1e-7; what is left is 1e-14 and roundings."""
    rng = np.random.default_rng(10)
    C = Rotation.random(rng=rng).as_matrix() + 1e-7 * rng.normal(size=(3, 3))
    kernels.orthonormalise(C)
    np.testing.assert_allclose(C @ C.T, np.eye(3), rtol=0, atol=3e-13)


# --- pyins --------------------------------------------------------------------------------------------------


def by_pyins(flight: Flight, sensed: pd.DataFrame) -> Float:
    """Positions by pyins' integrator from a table of its increments."""
    start = flight.start()
    yaw, pitch, roll = np.degrees(yaw_pitch_roll(start.attitude))
    state = pd.Series(
        [
            np.degrees(start.latitude),
            np.degrees(start.longitude),
            start.height,
            *start.velocity,
            roll,
            pitch,
            yaw,
        ],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
    )
    got = pyins_strapdown.Integrator(state).integrate(sensed)
    return np.stack([np.radians(got.lat), np.radians(got.lon), got.alt], -1)


def pyins_increments(t: Float, imu: Imu) -> pd.DataFrame:
    names = ["dt", *(f"{kind}_{axis}" for kind in ("theta", "dv") for axis in "xyz")]
    return pd.DataFrame(np.column_stack([np.diff(t), imu.rotation, imu.velocity]), index=t[1:], columns=names)


@pytest.mark.filterwarnings("ignore:The copy keyword is deprecated")
def test_pyins_agrees_as_far_as_its_order_goes() -> None:
    """A random flight of 300 s at sea level (where its gravity, linear in height, is ours), by both.

    From our increments pyins differs by its Coriolis acceleration, taken at the beginning of the step: in
    the first order, so half as much at 200 Hz as at 100 Hz (0.4 to 0.6 for what is of second order). At
    100 Hz that is 2 ω v h/2 = 3e-5 m/s for 300 s, 9 mm at most. From its own increments, which leave the
    square of the rotation within a step out, it differs by the second order, a quarter (0.2 to 0.3).
    """
    rng = np.random.default_rng(11)
    flight = Flight(
        speed=rng.uniform(30, 50), course=rng.uniform(-3, 3), weave=rng.uniform(1, 2),
        period=rng.uniform(60, 120), climb=0.02, place=(rng.uniform(-1, 1), rng.uniform(-3, 3), 0.0),
    )  # fmt: skip
    ours, theirs = [], []
    for hertz in (100, 200):
        t = even(300, hertz)
        position = flight.position(t)
        rate, force = flight.sensors(t, position)
        imu = increments(t, rate, force)
        got = navigate(Problem(imu, flight.start())).position
        names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
        table = pd.DataFrame(np.column_stack([rate, force]), index=t, columns=names)
        own = by_pyins(flight, pyins_strapdown.compute_increments_from_imu(table, "rate"))
        same = by_pyins(flight, pyins_increments(t, imu))
        ours.append(np.abs(ellipsoid.metres_between(got, same)).max())
        theirs.append(np.abs(ellipsoid.metres_between(got, own)).max())
        assert np.abs(ellipsoid.metres_between(got, position)).max() < 1e-3
    assert ours[0] < 9e-3
    assert 0.4 < ours[1] / ours[0] < 0.6
    assert 0.2 < theirs[1] / theirs[0] < 0.3


def test_navigation_is_complete() -> None:
    t = even(30, 50)
    position, imu = flown(WEAVING, t)
    got: Navigation = navigate(Problem(imu, WEAVING.start()))
    assert got.position.shape == position.shape == got.velocity.shape == got.gyro_bias.shape
    np.testing.assert_array_equal(got.time, t)
    np.testing.assert_allclose(np.linalg.norm(got.attitude, axis=1), 1.0, rtol=0, atol=4e-16)  # two roundings
