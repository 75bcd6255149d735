"""Speed of the navigation filter, its smoother and the loops, beside pyins.

One hour at 100 Hz, position and velocity by GNSS at 1 Hz; then the same with every aid.

navigation filter
    ``navigation_filter.navigate``: the state at 100 Hz, the covariance at 10 Hz and at every fix; 15 states,
    and 18 with air speed at 5 Hz, barometer and magnetometer at 10 Hz. ``every step``: the covariance at 100
    Hz too.
pyins
    ``filters.run_feedback_filter`` with its default ``time_step`` of 0.1 s, and with 0.01 s: the covariance
    after as many steps of the same increments, the same position and velocity. On a slice of the record,
    scaled by the duration. Its covariance is not in square-root form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
from _timing import Candidate, by_turns, machine, show, wants_json
from pyins import filters, inertial_sensor, measurements

from pipeline.models import correction_loops, navigation_filter, navigation_smoother
from pipeline.models.ellipsoid import metres_between
from pipeline.models.navigation_filter_settings import FilterSettings
from pipeline.models.navigation_problem import AidName, Navigation, Problem
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.simulate.navigation import simulate_navigation
from pipeline.simulate.navigation_scenarios import CRUISE, scenario

DURATION, SLICE, SHORT_SLICE = 3600, 20, 4
"""Seconds: of the record, and of what pyins is given of it at 0.1 s and at 0.01 s."""
ROUNDS = 3
SETTINGS = FilterSettings(states=15)
EVERY_STEP = replace(SETTINGS, covariance_step=0.01)
GNSS: tuple[AidName, ...] = ("position", "velocity")


def main() -> None:
    as_json = wants_json("speed of the navigation filter beside pyins")
    every_aid = simulated()
    gnss = replace(every_aid, aids={name: every_aid.aids[name] for name in GNSS})
    calls: dict[str, tuple[Callable[[], object], int]] = {
        "filter, GNSS": (lambda: navigation_filter.navigate(gnss, SETTINGS), DURATION),
        "filter, GNSS, every step": (lambda: navigation_filter.navigate(gnss, EVERY_STEP), DURATION),
        "filter, every aid": (lambda: navigation_filter.navigate(every_aid), DURATION),
        "smoother, every aid": (lambda: navigation_smoother.smooth(every_aid), DURATION),
        "loops, every aid": (lambda: correction_loops.navigate(every_aid), DURATION),
        "pyins, GNSS": (pyins(gnss, SLICE, 0.1), SLICE),
        "pyins, GNSS, every step": (pyins(gnss, SHORT_SLICE, 0.01), SHORT_SLICE),
    }
    timings = by_turns({name: Candidate(*call) for name, call in calls.items()}, ROUNDS)
    show(
        {
            "machine": machine("numpy", "numba", "pandas", "python-ins"),
            "CPU s for an hour (asked: filter 5, loops 1)": {
                name: timings.nanoseconds(name) * 1e-9 * DURATION for name in calls
            },
            "times quicker than pyins at the same step (asked: 50)": {
                "covariance at 10 Hz": timings.ratio("pyins, GNSS", "filter, GNSS"),
                "covariance at 100 Hz": timings.ratio("pyins, GNSS, every step", "filter, GNSS, every step"),
            },
            "difference of the two filters at the slice's end, in standard deviations": apart(gnss),
        },
        as_json,
    )


def simulated() -> Problem:
    """An hour of straight flight in the scenario *diff*, without an outage."""
    flight = replace(CRUISE, duration=float(DURATION))
    problem = simulate_navigation(scenario("diff", flight=flight, outages=()), seed=0).problem()
    return replace(problem, aids={name: fixes for name, fixes in problem.aids.items() if name != "attitude"})


def pyins(problem: Problem, duration: int, step: float) -> Callable[[], object]:
    """The peer's call, its tables made beforehand."""
    imu, start, told = problem.imu, problem.start, SETTINGS
    steps = int(np.searchsorted(imu.time, duration))
    increments = pd.DataFrame(
        np.column_stack([np.diff(imu.time), imu.rotation, imu.velocity])[:steps],
        index=pd.Index(imu.time[1 : steps + 1], name="time"),
        columns=["dt", *(f"{kind}_{axis}" for kind in ("theta", "dv") for axis in "xyz")],
    )
    yaw, pitch, roll = np.degrees(yaw_pitch_roll(start.attitude))
    place = [np.degrees(start.latitude), np.degrees(start.longitude), start.height]
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    begun = pd.Series([*place, *start.velocity, roll, pitch, yaw], index=names, name=float(imu.time[0]))
    tables = []
    for aid, columns in zip(GNSS, (names[:3], names[3:6]), strict=True):
        fixes = problem.aids[aid]
        value = (
            np.column_stack([np.degrees(fixes.value[:, :2]), fixes.value[:, 2]])
            if aid == "position"
            else fixes.value
        )
        tables.append(pd.DataFrame(value, index=fixes.time, columns=columns).loc[:duration])
    p0, q = told.start, told.noise

    def call() -> object:
        return filters.run_feedback_filter(
            begun,
            p0.position,
            p0.velocity,
            np.degrees(p0.tilt),
            np.degrees(p0.yaw),
            increments,
            inertial_sensor.EstimationModel(p0.gyro_bias, q.attitude, q.gyro_bias),
            inertial_sensor.EstimationModel(p0.accelerometer_bias, q.velocity, q.accelerometer_bias),
            [
                measurements.Position(tables[0], told.measurement.position),
                measurements.NedVelocity(tables[1], told.measurement.velocity),
            ],
            time_step=step,
        )

    return call


def apart(problem: Problem) -> dict[str, float]:
    """Largest over the axes, half a second before the end: of states, and of the deviations' ratio less 1."""
    own: Navigation = navigation_filter.navigate(problem, SETTINGS)
    peer = pyins(problem, SLICE, 0.1)()
    row = int(np.searchsorted(peer.trajectory_sd.index, SLICE - 0.5))  # type: ignore[attr-defined]
    spread = peer.trajectory_sd.iloc[row]  # type: ignore[attr-defined]
    last = peer.trajectory.loc[spread.name]  # type: ignore[attr-defined]
    end = int(np.argmin(np.abs(own.time - spread.name)))
    place = np.array([np.radians(last["lat"]), np.radians(last["lon"]), last["alt"]])
    assert own.deviations is not None
    sigma_p, sigma_v = own.deviations.position[end], own.deviations.velocity[end]
    velocity = last[["VN", "VE", "VD"]].to_numpy() - own.velocity[end]
    ratio = spread[["north", "east", "down"]].to_numpy() / sigma_p - 1
    return {
        "position": float(np.abs(metres_between(own.position[end], place) / sigma_p).max()),
        "velocity": float(np.abs(velocity / sigma_v).max()),
        "standard deviation of position": float(np.abs(ratio).max()),
    }


if __name__ == "__main__":
    main()
