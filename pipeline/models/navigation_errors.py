"""The one error of the models of navigation, and what every method refuses alike."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models.ellipsoid import POLAR_LIMIT
from pipeline.models.navigation_problem import Problem


class NavigationError(GyrostandError):
    """What cannot be navigated: a gap too long to coast over, a pole, a start that is no number."""

    exit_code = ExitCode.NOT_MET


def check_start(problem: Problem) -> None:
    """Refuse a start that is no number or at a pole.

    Raises
    ------
    NavigationError
    """
    start = problem.start
    state = [start.latitude, start.longitude, start.height, *start.velocity, *start.attitude]
    if not np.isfinite(state).all() or not np.any(start.attitude):
        raise NavigationError(
            "the start of navigation",
            expected="position, velocity and attitude that are numbers",
            found=", ".join(f"{value:g}" for value in state),
            remedy="state the start in the test plan",
        )
    if abs(start.latitude) > POLAR_LIMIT:
        raise NavigationError(
            "the start of navigation",
            expected=f"a latitude within {math.degrees(POLAR_LIMIT):g} degrees",
            found=f"{math.degrees(start.latitude):.6g} degrees",
            remedy="there is no north at a pole: leave that stretch out, or check the unit of latitude",
        )


def lost(method: str, elapsed: float, latitude: float) -> NavigationError:
    """A method whose state has come to a pole or is no number any more.

    Parameters
    ----------
    method : str
        In words.
    elapsed : float
        From the start [s].
    latitude : float
        Of the instant before [rad].
    """
    return NavigationError(
        f"{method}, {elapsed:.3f} s after the start",
        expected=f"a latitude within {math.degrees(POLAR_LIMIT):g} degrees",
        found=f"one beyond, or no number, after {math.degrees(latitude):.4g} degrees",
        remedy="leave out the recording from there on, or look at the start, the sensors and the aids",
    )


def field_of(problem: Problem) -> NDArray[np.float64]:
    """The magnetic field of the Earth N, E, D [T], shape (3,); zero where nothing measures it.

    Raises
    ------
    NavigationError
        If there is a magnetometer, and the field is not known.
    """
    if problem.earth_field is not None:
        return np.ascontiguousarray(problem.earth_field.ned, dtype=np.float64)
    if "magnetic_field" in problem.aids:
        raise NavigationError(
            "the magnetometer of a navigation",
            expected="the magnetic field of the Earth beside it",
            found="none",
            remedy="state its strength, dip and declination, or leave the magnetometer out",
        )
    return np.zeros(3)
