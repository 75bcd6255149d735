"""The simulated flight: its truth is consistent to the last digit, and it flies what was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.models.air_data import Lift, air_velocity
from pipeline.models.ellipsoid import E2, RATE, A, gravity, radii
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)
from pipeline.simulate.imperfections import SimulationError
from pipeline.simulate.navigation_flight import Flight
from pipeline.simulate.navigation_profile import fly, ramp, ramp_slope
from pipeline.simulate.navigation_scenarios import CRUISE, STRAIGHT
from pipeline.simulate.navigation_settings import FlightSettings, Manoeuvre, Sway

Float = NDArray[np.float64]
DEGREE = np.pi / 180

MANOEUVRES = (
    Manoeuvre(kind="turn", start=20.0, length=25.0, amount=np.pi / 2),
    Manoeuvre(kind="climb", start=35.0, length=40.0, amount=150.0),
    Manoeuvre(kind="accelerate", start=60.0, length=20.0, amount=12.0),
    Manoeuvre(kind="turn", start=80.0, length=30.0, amount=-2.0),
)
AEROBATIC = replace(
    STRAIGHT,
    duration=120.0,
    wind=(4.0, -3.0),
    manoeuvres=MANOEUVRES,
    sways=(
        Sway(angle="roll", amplitude=0.05, frequency=0.3),
        Sway(angle="pitch", amplitude=0.02, frequency=0.5),
    ),
)
STAND = replace(
    CRUISE,
    duration=60.0,
    speed=0.0,
    lift=None,
    sways=(
        Sway(angle="pitch", amplitude=0.1, frequency=1.0, phase=0.4),
        Sway(angle="roll", amplitude=0.1, frequency=1.0),
    ),
    manoeuvres=(Manoeuvre(kind="turn", start=10.0, length=30.0, amount=4 * np.pi),),
)
FLIGHTS = pytest.mark.parametrize("settings", [AEROBATIC, STAND], ids=["flight", "stand"])


def earth_axes(position: Float) -> Float:
    """N, E, D as columns, in axes of the Earth; shape (n, 3, 3)."""
    (sp, cp), (sl, cl) = [(np.sin(angle), np.cos(angle)) for angle in position[:, :2].T]
    north = np.stack([-sp * cl, -sp * sl, cp], axis=-1)
    east = np.stack([-sl, cl, np.zeros_like(sl)], axis=-1)
    return np.stack([north, east, np.cross(north, east)], axis=-1)


def cartesian(position: Float) -> Float:
    """Geodetic to Earth-centred coordinates, shape (n, 3) [m]."""
    latitude, longitude, h = position.T
    N = A / np.sqrt(1 - E2 * np.sin(latitude) ** 2)
    around = (N + h) * np.cos(latitude)
    return np.column_stack(
        [around * np.cos(longitude), around * np.sin(longitude), (N * (1 - E2) + h) * np.sin(latitude)]
    )


class TestTruth:
    @FLIGHTS
    def test_newtons_law_holds_in_axes_of_the_earth(self, settings: FlightSettings) -> None:
        """r'' = C f + g - 2 U x r', by differences of the Cartesian position."""
        flight, h = fly(settings), 0.1
        t = np.linspace(5.0, settings.duration - 1.0, 400)
        r = np.array([cartesian(flight.position(t + k * h)) for k in range(-4, 5)])
        first = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
        second = (
            np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]) / h**2
        )
        velocity, acceleration = np.tensordot(first, r, 1), np.tensordot(second, r, 1)
        motion = flight.at(t)
        to_earth = earth_axes(motion.position)
        down = gravity(motion.position[:, 0], motion.position[:, 2])
        force = np.einsum("nij,njk,nk->ni", to_earth, matrix_from_quaternion(motion.attitude), motion.force)
        turning = 2 * np.cross([0.0, 0.0, RATE], velocity)
        # rounding of 6.4e6 m is 1e-9 m: 3e-9/h of the velocity, 6e-9/h^2 of the acceleration; the differences
        # leave h^8/3150 of the tenth derivative, of edges of manoeuvres over 4 s less than that. (Of the
        # catapult's, 0.5 s, more; what is asked here holds there too, for derivatives of splines are exact.)
        exact = np.einsum("nij,nj->ni", to_earth, motion.velocity)
        np.testing.assert_allclose(velocity, exact, rtol=0, atol=2e-6)
        np.testing.assert_allclose(
            acceleration, force + to_earth[:, :, 2] * down[:, np.newaxis] - turning, rtol=0, atol=5e-6
        )

    @FLIGHTS
    def test_rates_turn_the_attitude_against_inertial_space(self, settings: FlightSettings) -> None:
        """The exact rotation over a step, by Magnus' series of the fourth order of the rates."""
        flight, h = fly(settings), 0.01
        t = np.arange(1.0, settings.duration - 1.0, h)
        half = h * np.sqrt(3) / 6
        middle = (t[:-1] + t[1:]) / 2
        before, after = flight.at(middle - half).rate, flight.at(middle + half).rate
        magnus = h / 2 * (before + after) + np.sqrt(3) / 12 * h**2 * np.cross(before, after)
        # h^5 of derivatives and products of rates up to 0.6 rad/s and 4 rad/s^2: 1e-10 times a few
        np.testing.assert_allclose(flight.increments(t).rotation, magnus, rtol=0, atol=3e-11)

    @FLIGHTS
    def test_increments_compose(self, settings: FlightSettings) -> None:
        """Over 0.05 s they are what those over 0.01 s make together, and so are the integrals."""
        flight, parts = fly(settings), 5
        fine = np.arange(0, int(settings.duration * 100) + 1) / 100
        whole, single = flight.increments(fine[::parts]), flight.increments(fine)
        rotation = single.rotation.reshape(-1, parts, 3)
        velocity = single.velocity.reshape(-1, parts, 3)
        q, total = quaternion_from_rotation_vector(np.zeros((len(whole), 3))), np.zeros((len(whole), 3))
        for k in range(parts):
            total += np.einsum("nij,nj->ni", matrix_from_quaternion(q), velocity[:, k])
            q = quaternion_multiply(q, quaternion_from_rotation_vector(rotation[:, k]))
        # five roundings of quaternions; quadrature over 0.05 s with four nodes
        np.testing.assert_allclose(rotation_vector_from_quaternion(q), whole.rotation, rtol=0, atol=2e-14)
        np.testing.assert_allclose(total, whole.velocity, rtol=0, atol=1e-9)
        coarse, pieces = flight.integrals(fine[::parts]), flight.integrals(fine)
        for one, many in zip(coarse, pieces, strict=True):
            np.testing.assert_allclose(many.reshape(-1, parts, 3).sum(axis=1), one, rtol=0, atol=1e-9)

    def test_the_position_integrates_the_velocity_to_a_micrometre(self) -> None:
        flight, settings = fly(AEROBATIC), AEROBATIC

        start = np.array([settings.latitude, settings.longitude, settings.height])
        to_metres = np.array([A, A, 1.0])

        def rates(t: float, metres: Float) -> list[float]:
            north, east, down = flight.velocity(np.array([t]))[0]
            latitude, _, height = start + metres / to_metres
            meridian, prime_vertical = radii(latitude, height)
            return [A * north / meridian, A * east / (prime_vertical * np.cos(latitude)), -down]

        t = np.linspace(0.0, settings.duration, 25)
        span = (0.0, settings.duration)
        solved = solve_ivp(rates, span, np.zeros(3), "DOP853", t, rtol=1e-13, atol=1e-9, max_step=0.5)
        metres = (flight.position(t) - start) * to_metres
        # latitude and longitude of 1 rad are rounded to 2e-16 rad, or 1.4e-9 m; the solver errs by as much
        np.testing.assert_allclose(metres, solved.y.T, rtol=0, atol=2e-8)

    def test_the_poles_side_of_the_earth_is_the_same(self) -> None:
        """Nothing depends on the longitude or the sign of the latitude but what should."""
        north = fly(replace(AEROBATIC, wind=(0.0, 0.0), latitude=0.5, longitude=3.1))
        t = np.linspace(0, 120, 50)
        far = fly(replace(AEROBATIC, wind=(0.0, 0.0), latitude=0.5, longitude=-1.0))
        np.testing.assert_array_equal(north.at(t).force, far.at(t).force)
        np.testing.assert_array_equal(north.at(t).rate, far.at(t).rate)


class TestFlown:
    def test_a_catapult_from_rest_to_speed(self) -> None:
        flight = fly(replace(STRAIGHT, duration=60.0, wind=(4.0, -3.0)))
        t = np.array([0.0, 1.0, 3.0, 13.0, 60.0])
        v = flight.velocity(t)
        np.testing.assert_allclose(v[:2], 0.0, atol=1e-6)  # a spline at the edge of a ramp
        along = 40.0 * np.array([np.cos(55 * DEGREE), np.sin(55 * DEGREE), 0.0])
        np.testing.assert_allclose(v[2], along, atol=1e-6)
        np.testing.assert_allclose(v[3:], np.tile(along + np.array([4.0, -3.0, 0.0]), (2, 1)), atol=1e-6)
        assert flight.position(t)[:, 2] == pytest.approx(100.0, abs=1e-9)  # the sum of roundings
        assert np.max(flight.at(np.arange(0, 4, 0.01)).force[:, 0]) < 4 * 9.81

    def test_manoeuvres_change_what_they_say_by_what_they_say(self) -> None:
        flight = fly(replace(AEROBATIC, wind=(0.0, 0.0), sways=()))
        before, after = np.array([15.0]), np.array([118.0])
        v = flight.velocity(np.concatenate((before, after)))
        course = np.unwrap(np.arctan2(flight.velocity(np.arange(15, 118.0))[:, 1],
                                      flight.velocity(np.arange(15, 118.0))[:, 0]))  # fmt: skip
        assert course[-1] - course[0] == pytest.approx(np.pi / 2 - 2.0, abs=1e-9)  # interpolation
        np.testing.assert_allclose(np.linalg.norm(v, axis=1), [40.0, 52.0], atol=1e-8)
        climbed = flight.position(after)[0, 2] - flight.position(before)[0, 2]
        assert climbed == pytest.approx(150.0, abs=1e-6)

    def test_turns_are_coordinated_and_the_flow_comes_as_the_lift_says(self) -> None:
        settings = replace(AEROBATIC, sways=(), catapult=None, standing=0.0)
        flight, t = fly(settings), np.linspace(0, 120, 3000)
        motion = flight.at(t)
        through_air = motion.velocity - [4.0, -3.0, 0.0]
        body = np.einsum("nji,nj->ni", matrix_from_quaternion(motion.attitude), through_air)
        speed = np.linalg.norm(body, axis=1)
        assert settings.lift is not None
        alpha = settings.lift.angle_of_attack(-motion.force[:, 2], speed)
        # attitude is a spline through exact knots: 1e-6 of the acceleration beside edges of manoeuvres
        np.testing.assert_allclose(motion.force[:, 1], 0.0, atol=1e-4)
        # the lift is across the flow, n along axis 3: cos(alpha) and the thrust's share of it, 1.5 % of alpha
        np.testing.assert_allclose(body, air_velocity(speed, alpha), rtol=0, atol=0.03)
        assert np.max(np.abs(yaw_pitch_roll(motion.attitude)[:, 2])) > 15 * DEGREE

    def test_a_stand_stays_level_where_it_is(self) -> None:
        flight, t = fly(replace(STAND, sways=())), np.linspace(0, 60, 300)
        motion = flight.at(t)
        angles = yaw_pitch_roll(motion.attitude)
        np.testing.assert_array_equal(angles[:, 1:], 0.0)
        np.testing.assert_array_equal(motion.velocity, 0.0)
        np.testing.assert_allclose(motion.force[:, :2], 0.0, atol=1e-15)
        turned = flight.angles(np.array([0.0, 60.0]))[:, 0]
        assert turned[1] - turned[0] == pytest.approx(4 * np.pi, abs=1e-9)

    def test_a_sway_is_what_it_says(self) -> None:
        settings = replace(STAND, manoeuvres=())
        t = np.linspace(0, 60, 1000)
        angles = fly(settings).angles(t)
        # quintic splines with forty knots a period: 2e-8 of the amplitude
        np.testing.assert_allclose(angles[:, 1], 0.1 * np.sin(2 * np.pi * t + 0.4), atol=1e-8)
        np.testing.assert_allclose(angles[:, 2], 0.1 * np.sin(2 * np.pi * t), atol=1e-8)

    @pytest.mark.parametrize("ease", [0.1, 0.25, 0.5])
    def test_a_ramp_is_smooth_and_its_slope_its_derivative(self, ease: float) -> None:
        s, h = np.linspace(-0.2, 1.2, 2801), 1e-5
        assert ramp(np.array([-1.0, 0.0, 0.5, 1.0, 2.0]), ease) == pytest.approx([0, 0, 0.5, 1, 1], abs=1e-15)
        slope = (ramp(s + h, ease) - ramp(s - h, ease)) / (2 * h)
        # rounding 1e-16/h and h^2/6 of the third derivative, 60/ease^2
        np.testing.assert_allclose(ramp_slope(s, ease), slope, rtol=0, atol=2e-7)

    def test_the_angle_of_attack_grows_with_the_load_and_falls_with_the_speed(self) -> None:
        lift = Lift()
        assert float(lift.angle_of_attack(0.0, 40.0)) == lift.zero_lift
        cruise = float(lift.angle_of_attack(9.80665, 40.0))
        # 40^2 / sqrt(40^4 + 20^4) is 0.970
        assert cruise == pytest.approx(lift.zero_lift + 4 * DEGREE * 0.9701425, rel=1e-7)
        assert (
            float(lift.angle_of_attack(2 * 9.80665, 40.0)) > cruise > float(lift.angle_of_attack(9.8, 50.0))
        )
        assert np.isfinite(lift.angle_of_attack(30.0, 0.0))
        np.testing.assert_allclose(np.linalg.norm(air_velocity([40.0, 20.0], 0.1), axis=1), [40.0, 20.0])


class TestRefused:
    @pytest.mark.parametrize(
        ("settings", "part"),
        [
            (replace(STRAIGHT, manoeuvres=(Manoeuvre(kind="turn", start=10, length=5, amount=3.0),)), "bank"),
            (
                replace(STRAIGHT, manoeuvres=(Manoeuvre(kind="climb", start=10, length=5, amount=900.0),)),
                "climb",
            ),
            (
                replace(
                    STRAIGHT, manoeuvres=(Manoeuvre(kind="accelerate", start=10, length=5, amount=-50.0),)
                ),
                "speed",
            ),
            (replace(STAND, sways=(Sway(angle="pitch", amplitude=1.5, frequency=1.0),)), "pitch"),
        ],
    )
    def test_what_the_model_does_not_have(self, settings: FlightSettings, part: str) -> None:
        with pytest.raises(SimulationError, match=part):
            fly(replace(settings, duration=40.0))

    @pytest.mark.parametrize(
        ("name", "value"), [("latitude", 1.57), ("speed", 0.0), ("duration", 0.0), ("catapult", 0.0)]
    )
    def test_settings_out_of_their_range(self, name: str, value: float) -> None:
        with pytest.raises(SimulationError, match=name):
            replace(STRAIGHT, **{name: value})

    def test_a_flight_without_attitude_has_none(self) -> None:
        t = np.arange(10.0)
        with pytest.raises(ValueError, match="attitude"):
            Flight(t, np.zeros((10, 3)), np.zeros(3)).angles(t)
