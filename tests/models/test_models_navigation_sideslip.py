"""That an aircraft has its nose in the air's way, as the filter may take it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.models._kernels_navigation_aids import CALIBRATION, sideslip
from pipeline.models._kernels_navigation_update import correct
from pipeline.models.navigation_filter import navigate
from pipeline.models.navigation_filter_settings import (
    ColouredErrors,
    FilterSettings,
    GaussMarkov,
    MeasurementNoise,
)
from pipeline.models.navigation_problem import Problem
from pipeline.models.navigation_states import states_of
from pipeline.numerics.rotation import matrix_from_quaternion
from pipeline.simulate.navigation import NavigationRecord, simulate_navigation
from pipeline.simulate.navigation_scenarios import CRUISE, scenario


def test_its_derivatives_are_those_of_what_is_predicted() -> None:
    """Each state moved by h and back; the terms of second order cancel, the third is h² of the derivative."""
    coloured = ColouredErrors(wind=GaussMarkov(0.3, 300.0), gust=GaussMarkov(1.0, 6.6))
    states = states_of(FilterSettings(coloured=coloured), ["airspeed"])
    n, h = len(states), 1e-4
    rng = np.random.default_rng(1)

    def predicted(x: np.ndarray) -> tuple[float, np.ndarray]:
        nominal = (
            np.array([1.0, 0.5, 100.0]),
            np.array([30.0, 20.0, -3.0]),
            matrix_from_quaternion(np.array([0.8, 0.1, -0.2, 0.55]) / np.linalg.norm([0.8, 0.1, -0.2, 0.55])),
            np.zeros(6),
            np.arange(1.0, n - 14.0),
        )
        correct(nominal, x)
        z, H = np.empty(3), rng.standard_normal((3, n))
        sideslip(nominal, states.slots, np.zeros(CALIBRATION), z, H)
        return -z[0], H[0]

    _, H = predicted(np.zeros(n))
    moved = [(predicted(h * e)[0] - predicted(-h * e)[0]) / (2 * h) for e in np.eye(n)]
    # h² of 40 m/s, and rounding of 1e-14 of it over h
    assert moved == pytest.approx(H, abs=1e-6)
    assert np.count_nonzero(H) == 3 + 3 + 2 * 3


def record() -> tuple[NavigationRecord, Problem]:
    one = simulate_navigation(scenario("diff", flight=replace(CRUISE, duration=120.0)), 0)
    problem = one.problem()
    return one, replace(problem, aids={k: v for k, v in problem.aids.items() if k != "attitude"})


def across(wind: np.ndarray) -> np.ndarray:
    """Component to the right of the flight."""
    yaw = CRUISE.yaw
    return -np.sin(yaw) * wind[:, 0] + np.cos(yaw) * wind[:, 1]


@pytest.mark.parametrize("states", [15, 18])
def test_nothing_is_taken_of_it_by_default(states) -> None:
    _, problem = record()
    default, never = (
        navigate(problem, FilterSettings(states=states, measurement=noise))
        for noise in (MeasurementNoise(), MeasurementNoise(sideslip=np.inf))
    )
    assert np.array_equal(default.position, never.position)


def test_it_tells_the_wind_across_a_straight_flight() -> None:
    one, problem = record()
    without = navigate(problem, FilterSettings())
    told = navigate(problem, FilterSettings(measurement=MeasurementNoise(sideslip=8.6)))
    truth = across(np.array([one.settings.flight.wind]))[0]
    # Air speed alone does not see it: it stays near 0, the truth being 5 m/s.
    assert abs(across(without.wind)[-1] - truth) > 4.0
    # 8.6 m/s five times a second over 120 s is 0.35 m/s; hard iron turns the heading by 0.15/17, of 40 m/s
    # another 0.35 m/s; three sigma of both.
    assert abs(across(told.wind)[-1] - truth) < 1.5
    assert told.deviations.wind[-1].max() < 0.5 * without.deviations.wind[-1].max()
