"""Scenarios ready made: straight flight from a catapult, two sensor sets, three levels of the aids.

They are those of Panov's dissertation (Rybinsk 2007), with what it leaves open filled in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from pipeline.models.navigation_problem import AidName
from pipeline.simulate.imperfections import Span
from pipeline.simulate.navigation_settings import (
    Aid,
    Air,
    FlightSettings,
    GaussMarkov,
    ImuErrors,
    NavigationSettings,
    wrong,
)

Level = Literal["ideal", "diff", "gps"]

_DEGREE = float(np.deg2rad(1.0))

STRAIGHT = FlightSettings()
"""Straight and level for half an hour, from a catapult."""

CRUISE = replace(STRAIGHT, catapult=None, standing=0.0)
"""The same, without the catapult."""

SENSOR_SETS: Mapping[int, ImuErrors] = MappingProxyType(
    {
        divisor_of: ImuErrors(
            gyro_bias=(0.035 * _DEGREE / by, -0.015 * _DEGREE / by, -0.025 * _DEGREE / by),
            accelerometer_bias=(0.15 / by, -0.15 / by, 0.0),
        )
        for divisor_of, by in ((1, 5.0), (2, 1.0))
    }
)
"""Biases of the sensor sets 1 and 2."""

OUTAGE: tuple[Span, ...] = ((600.0, 600.0),)
"""When there is no GNSS in the scenarios: (start, length) [s]."""

_GNSS: Mapping[Level, tuple[Aid, Aid]] = MappingProxyType(
    {
        "ideal": (Aid(), Aid()),
        "diff": (Aid(noise=0.3, wander=GaussMarkov(sigma=0.5, time=30.0)), Aid(noise=0.05)),
        "gps": (Aid(noise=1.0, wander=GaussMarkov(sigma=3.0, time=60.0)), Aid(noise=0.1)),
    }
)
_FAST = 20.0
"""Measurements a second of the aids that have no outage: the paper's are as quick as its inertial sensors."""


def scenario(
    level: Level,
    sensors: int = 2,
    *,
    flight: FlightSettings = STRAIGHT,
    outages: tuple[Span, ...] = OUTAGE,
) -> NavigationSettings:
    """A scenario: level of the aids, sensor set, flight and outages of GNSS.

    Parameters
    ----------
    level : {"ideal", "diff", "gps"}
        *ideal*: perfect aids and inertial sensors without noise, gusts of 0.265 m/s, no wind. *diff*: GNSS of
        0.5 m, wind (4, -3) m/s that wanders by 0.3, gusts of 1.06 m/s, and every aid with errors. *gps*: the
        same with GNSS of 3 m.
    sensors : {1, 2}
        The sensor set.
    flight : FlightSettings, optional
        Its wind is the level's.
    outages : tuple of (start, length), optional
        Of GNSS [s].

    Raises
    ------
    SimulationError
        If there is no such level or set.
    """
    if level not in _GNSS:
        raise wrong("level", f"one of {', '.join(_GNSS)}", repr(level), "choose one of them")
    if sensors not in SENSOR_SETS:
        raise wrong(
            "sensors", f"one of {', '.join(map(str, SENSOR_SETS))}", str(sensors), "choose one of them"
        )
    position, velocity = (replace(aid, outages=outages) for aid in _GNSS[level])
    errors = SENSOR_SETS[sensors]
    gnss: dict[AidName, Aid] = {"position": position, "velocity": velocity}
    if level == "ideal":
        others: tuple[AidName, ...] = ("airspeed", "altitude", "magnetic_field", "attitude")
        return NavigationSettings(
            flight=replace(flight, wind=(0.0, 0.0)),
            air=Air.turbulent(0.265),
            errors=errors,
            aids={**gnss, **{name: Aid(rate=_FAST) for name in others}},
        )
    return NavigationSettings(
        flight=replace(flight, wind=(4.0, -3.0)),
        air=Air.turbulent(1.06, wander=0.3),
        errors=replace(errors, gyro_noise=0.05 * _DEGREE, accelerometer_noise=0.02),
        aids={
            **gnss,
            "airspeed": Aid(rate=_FAST, scale=0.01, bias=0.3),
            "altitude": Aid(rate=_FAST, noise=0.3, bias=3.0),
            "magnetic_field": Aid(rate=_FAST, noise=0.2e-6, drawn_bias=0.15e-6),
            "attitude": Aid(
                rate=_FAST,
                drawn_bias=0.3 * _DEGREE,
                wander=GaussMarkov(sigma=0.3 * _DEGREE, time=10.0),
            ),
        },
    )
