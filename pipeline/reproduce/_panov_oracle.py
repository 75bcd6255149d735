"""What must be reached in section 4.3: sensors alone, loops and filter, and the filter before the loops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.models import strapdown
from pipeline.models.ellipsoid import metres_between
from pipeline.reproduce._panov_runs import (
    FILTER_15,
    FILTER_18,
    LEVELS,
    PRINTED_X,
    SOURCE,
    TUNED_A,
    Float,
    Score,
    Scores,
)
from pipeline.reproduce._panov_table import COLUMNS
from pipeline.reproduce.rows import Row, at_most, near
from pipeline.simulate.navigation import NavigationRecord, simulate_navigation
from pipeline.simulate.navigation_scenarios import CRUISE, STRAIGHT, Level, scenario
from pipeline.simulate.navigation_settings import (
    FlightSettings,
    Manoeuvre,
    NavigationSettings,
)

_TURNING = replace(
    STRAIGHT,
    manoeuvres=(
        Manoeuvre(kind="turn", start=300.0, length=60.0, amount=np.pi),
        Manoeuvre(kind="climb", start=700.0, length=60.0, amount=200.0),
        Manoeuvre(kind="turn", start=1000.0, length=90.0, amount=-2 * np.pi),
    ),
)

_UNCORRECTED = ((10, 10.3), (30, 89.0), (60, 366.0))
_UNCORRECTED_TOLERANCE = 0.015

_ASKED: tuple[tuple[tuple[Level, str], tuple[tuple[str, str, float, float | None], ...]], ...] = (
    (
        ("ideal", PRINTED_X),
        (
            ("on_h_rms", "ON H rms, m, at most", 0.05, None),
            ("on_v_rms", "ON V rms, m/s, at most", 0.01, 0.1),
            ("n_180", "accelerometer bias at 180 s, relative, at most", 0.05, None),
            ("n_600", "accelerometer bias at 600 s, relative, at most", 0.01, None),
            ("off_h_max", "OFF H max, m, at most", 60.0, 22.0),
        ),
    ),
    (
        ("diff", TUNED_A),
        (
            ("on_h_rms", "ON H rms, m, at most", 1.0, None),
            ("on_v_rms", "ON V rms, m/s, at most", 0.2, 0.1),
            ("omega_rms", "gyro bias, 400 to 600 s, rms, deg/s, at most", 0.003, None),
            ("off_h_max", "OFF H max, m, at most", 450.0, 22.0),
        ),
    ),
    (
        ("diff", FILTER_18),
        (
            ("on_h_rms", "ON H rms, m, at most", 0.7, None),
            ("on_v_rms", "ON V rms, m/s, at most", 0.05, None),
            ("off_h_max", "OFF H max, m, at most", 300.0, None),
        ),
    ),
)
"""Of each method: the score, its name in the row, the bound, and what is printed."""


def alone() -> Iterator[Row]:
    """Inertial sensors without errors, and those of set 2 without correction."""
    for name, flight in (("straight", STRAIGHT), ("turns and a climb", _TURNING)):
        yield at_most(1e-3).beside(
            SOURCE,
            f"sensors without errors, {name}",
            "largest error in 1800 s, m, at most",
            _without_errors(flight),
        )
    error = _uncorrected()
    for second, metres in _UNCORRECTED:
        yield near(metres, _UNCORRECTED_TOLERANCE).beside(
            SOURCE, "sensor set 2, cruise, true start", f"error at {second} s, m", float(error[100 * second])
        )


def _without_errors(flight: FlightSettings) -> float:
    """Largest distance from the truth [m]."""
    return float(np.max(_distance(simulate_navigation(NavigationSettings(flight=flight)))))


def _uncorrected() -> Float:
    """Distance from the truth at each sample of a minute of cruise, from the true state [m]."""
    return _distance(simulate_navigation(scenario("ideal", sensors=2, flight=replace(CRUISE, duration=60.0))))


def _distance(record: NavigationRecord) -> Float:
    """By the inertial sensors alone, from the true start."""
    alone = strapdown.navigate(record.problem(start_error=False))
    return np.asarray(np.linalg.norm(metres_between(record.truth.position, alone.position), axis=1))


def reached(medians: Scores) -> Iterator[Row]:
    """The bounds on the medians, and the filter's share of the loops' errors."""
    for (level, method), bounds in _ASKED:
        for field, quantity, bound, printed in bounds:
            ours = getattr(medians[level, method], field)
            yield at_most(bound, printed=printed).beside(SOURCE, f"{level}, {method}", quantity, ours)
    for level in LEVELS:
        for method in (FILTER_15, FILTER_18):
            share = _largest_share(medians[level, method], medians[level, TUNED_A])
            quantity = "error over that of the loops A, tuned, in the worst column, below"
            yield at_most(1.0).beside(SOURCE, f"{level}, {method}", quantity, share)


def _largest_share(found: Score, other: Score) -> float:
    """The largest ratio of two scores' errors of the table."""
    return float(max(getattr(found, name) / getattr(other, name) for name in COLUMNS))
