"""The test plan of a simulated flight, as it is written, makes the filter better than the loops."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.models import correction_loops, navigation_filter
from pipeline.models.navigation_consistency import Truth, errors
from pipeline.models.navigation_problem import Navigation
from pipeline.simulate.navigation import NavigationRecord, simulate_navigation
from pipeline.simulate.navigation_scenarios import CRUISE, scenario
from pipeline.stages.navigate import Settings

Float = NDArray[np.float64]
LEVEL = scenario("diff")


def planned(folder: Path) -> Settings:
    """The settings that the plan of a short flight of the same scenario states."""
    short = replace(LEVEL, flight=replace(CRUISE, wind=LEVEL.flight.wind, duration=2.0))
    _, plan, _ = simulate_navigation(short).write(folder / "flight.mcap")
    return Settings.model_validate(tomllib.loads(plan.read_text(encoding="utf-8"))["navigate"])


def columns(navigation: Navigation, record: NavigationRecord) -> Float:
    """Root mean squares with satellites, and largest and root mean square without, horizontally."""
    truth = record.truth
    found = errors(
        navigation,
        Truth(truth.position, truth.velocity, truth.attitude, truth.gyro_bias, truth.accelerometer_bias),
    )
    time = navigation.time
    on, off = (time >= 180) & (time < 600), (time >= 600) & (time < 1200)
    away, moving = np.hypot(*found[:, 12:14].T), np.hypot(*found[:, 9:11].T)
    tilt, yaw = np.hypot(*found[:, 6:8].T), np.abs(found[:, 8])
    squares = [one[on] for one in (away, moving, tilt, yaw)] + [moving[off]]
    return np.array([*(np.sqrt(np.mean(one**2)) for one in squares), away[off].max(), moving[off].max()])


@pytest.mark.nightly
def test_the_filter_of_the_plan_is_better_than_its_loops(tmp_path: Path) -> None:
    """Medians over eight seeds, in every column of the table that `reproduce panov` prints.

    Without what the plan says of the side-slip the filter is farther off after the outage.
    """
    settings = planned(tmp_path)
    told, loops = settings.filter.settings(settings.stale), settings.loops.settings(settings.stale)
    assert told.measurement.sideslip == told.measurement.airspeed
    scores = []
    for seed in range(8):
        record = simulate_navigation(LEVEL, seed)
        problem = record.problem()
        problem = replace(problem, aids={n: a for n, a in problem.aids.items() if n != "attitude"})
        scores.append(
            [
                columns(navigation_filter.navigate(problem, told), record),
                columns(correction_loops.navigate(problem, loops), record),
            ]
        )
    filtered, looped = np.median(scores, axis=0)
    assert (filtered < looped).all()
