"""The flights on which the figures of section 4.3 stand, navigated by every method, and how wrong each is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models import correction_loops, navigation_filter
from pipeline.models.correction_gains import PRINTED, TUNED
from pipeline.models.correction_loops import LoopSettings
from pipeline.models.navigation_consistency import Truth, errors
from pipeline.models.navigation_filter_settings import FilterSettings, MeasurementNoise
from pipeline.models.navigation_problem import Navigation, Problem
from pipeline.simulate.navigation import NavigationRecord, simulate_navigation
from pipeline.simulate.navigation_scenarios import SENSOR_SETS, Level, scenario

Float = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Told what is done, how much has been, and of how much."""

SOURCE = "Panov, dissertation, Rybinsk (2007)"

SEEDS = 8

INVENTED = (
    "Invented, the source giving none of it: the lift curve, the catapult, coordinated turns; and that gusts "
    "and the wandering of the wind move neither path nor heading, so that air speed takes them whole."
)
"""What the model of the aircraft adds to the source."""

_GYRO, _ACCELEROMETER, _TILT, _YAW = slice(0, 3), slice(3, 6), slice(6, 8), 8
_VELOCITY, _POSITION = slice(9, 11), slice(12, 14)
"""Places of the errors of `pipeline.models.navigation_consistency.errors`; horizontal."""

_ON, _OUT, _SETTLED = (180.0, 600.0), (600.0, 1200.0), (400.0, 600.0)
"""With satellites, in their outage, and where the gyros' bias is judged [s]."""


class Score(NamedTuple):
    """How wrong a navigation is, ON with satellites (180 to 600 s) and OFF in their outage (600 to 1200 s).

    Of three axes of a bias the worst.
    """

    on_h_rms: float
    """Horizontal position [m]."""
    on_v_rms: float
    """Horizontal velocity [m/s]."""
    on_tilt_rms: float
    """Root of half the sum of roll's and pitch's square [deg]."""
    on_yaw_rms: float
    """[deg]"""
    off_h_max: float
    """[m]"""
    off_v_max: float
    """[m/s]"""
    off_v_rms: float
    """[m/s]"""
    n_180: float
    """Accelerometer bias at 180 s, over the largest true one [1]."""
    n_600: float
    """The same at 600 s [1]."""
    omega_rms: float
    """Gyro bias, 400 to 600 s [deg/s]."""


@dataclass(frozen=True, slots=True)
class Method:
    """A method of the table.

    Attributes
    ----------
    level : str
        Of the aids.
    name : str
    navigate : callable
        From a problem to its navigation.
    """

    level: Level
    name: str
    navigate: Callable[[Problem], Navigation]


PRINTED_X, TUNED_A, FILTER_15, FILTER_18 = (
    "X, printed gains",
    "A, tuned gains",
    "filter, 15 states",
    "filter, 18 states",
)

LEVELS: tuple[Level, ...] = get_args(Level)

Scores = Mapping[tuple[Level, str], Score]
"""Medians over the seeds, by level and method."""


def scores(seeds: int, progress: Progress | None = None) -> Scores:
    """Every method on the flights of the seeds 0, 1, ..., each flight simulated once.

    Parameters
    ----------
    seeds : int
    progress : callable, optional
    """
    found: dict[tuple[Level, str], list[Score]] = {}
    for seed in range(seeds):
        for place, level in enumerate(LEVELS):
            if progress:
                progress(f"seed {seed}, {level}", len(LEVELS) * seed + place, len(LEVELS) * seeds)
            for name, score in _flown(level, seed):
                found.setdefault((level, name), []).append(score)
    return {key: Score(*np.median(np.array(of_seeds), axis=0).tolist()) for key, of_seeds in found.items()}


def _flown(level: Level, seed: int) -> Iterator[tuple[str, Score]]:
    record = simulate_navigation(scenario(level, sensors=2), seed)
    problem = record.problem()
    for method in METHODS:
        if method.level == level:
            yield method.name, score(method.navigate(problem), record)


def score(navigation: Navigation, record: NavigationRecord) -> Score:
    """How wrong a navigation is."""
    t, truth = navigation.time, record.truth
    e = errors(
        navigation,
        Truth(truth.position, truth.velocity, truth.attitude, truth.gyro_bias, truth.accelerometer_bias),
    )
    on, out, settled = ((t >= start) & (t < end) for start, end in (_ON, _OUT, _SETTLED))
    h, v = np.linalg.norm(e[:, _POSITION], axis=1), np.linalg.norm(e[:, _VELOCITY], axis=1)
    tilt, yaw = np.rad2deg(np.linalg.norm(e[:, _TILT], axis=1) / np.sqrt(2)), np.rad2deg(e[:, _YAW])
    largest = np.max(np.abs(SENSOR_SETS[2].accelerometer_bias))
    at_180, at_600 = np.max(np.abs(e[np.searchsorted(t, _ON), _ACCELEROMETER]), axis=1) / largest
    omega = np.rad2deg(np.max([_rms(axis) for axis in e[settled, _GYRO].T]))
    return Score(
        on_h_rms=_rms(h[on]),
        on_v_rms=_rms(v[on]),
        on_tilt_rms=_rms(tilt[on]),
        on_yaw_rms=_rms(yaw[on]),
        off_h_max=float(h[out].max()),
        off_v_max=float(v[out].max()),
        off_v_rms=_rms(v[out]),
        n_180=float(at_180),
        n_600=float(at_600),
        omega_rms=float(omega),
    )


def _rms(x: Float) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _printed(problem: Problem) -> Navigation:
    return correction_loops.navigate(problem, LoopSettings(gains=PRINTED, attitude="X"))


def _tuned(problem: Problem) -> Navigation:
    return correction_loops.navigate(problem, LoopSettings(gains=TUNED, attitude="A"))


_NOISE = MeasurementNoise(sideslip=MeasurementNoise().airspeed)
"""R of *diff*. That the air comes along the nose, which the loops go by too, is as true as the air speed."""

_MEASUREMENT: Mapping[Level, MeasurementNoise] = {
    "ideal": _NOISE,
    "diff": _NOISE,
    # as much larger as the errors of the satellites are
    "gps": replace(_NOISE, position=6 * _NOISE.position, velocity=2 * _NOISE.velocity),
}


def _filter(level: Level, states: Literal[15, 18]) -> Callable[[Problem], Navigation]:
    # the wind of the 15 states is the mean that the loops take
    mean = LoopSettings().wind_time_constant
    settings = FilterSettings(states=states, measurement=_MEASUREMENT[level], calibration_time=mean)

    def navigate(problem: Problem) -> Navigation:
        # the external attitude is for reference X alone
        aids = dict(problem.aids)
        del aids["attitude"]
        return navigation_filter.navigate(replace(problem, aids=aids), settings)

    return navigate


METHODS = (
    Method("ideal", PRINTED_X, _printed),
    *(
        method
        for level in LEVELS
        for method in (
            Method(level, TUNED_A, _tuned),
            Method(level, FILTER_15, _filter(level, 15)),
            Method(level, FILTER_18, _filter(level, 18)),
        )
    ),
)
"""In the order of the table."""
