"""Stream tables of simulated navigations, as ingest would make them, without a file between."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.simulate.navigation import NavigationRecord, simulate_navigation
from pipeline.simulate.navigation_scenarios import CRUISE, Level, scenario
from pipeline.simulate.navigation_settings import NavigationSettings
from pipeline.simulate.recording import START
from pipeline.stages._navigation_problem import AID_TABLES
from pipeline.stages._navigation_streams import CHANNELS

Float = NDArray[np.float64]
Time = NDArray[np.int64]
EARTH = {"strength_ut": 52.0, "dip_deg": 71.0, "declination_deg": 11.0}
SECOND = 10**9


def settings(
    level: Level = "ideal", duration: float = 30.0, *, rate: float = 50.0, **changed: Any
) -> NavigationSettings:
    """A level flight at 40 m/s, of a scenario's sensors and aids."""
    flight = changed.pop("flight", replace(CRUISE, duration=duration))
    outages = changed.pop("outages", ())
    return replace(scenario(level, flight=flight, outages=outages), rate=rate, **changed)


def record(level: Level = "ideal", duration: float = 30.0, seed: int = 1, **changed: Any) -> NavigationRecord:
    return simulate_navigation(settings(level, duration, **changed), seed)


def table(name: str, time: Time, values: Float, **more: Any) -> pa.Table:
    """A stream table by its contract; what is not given is null."""
    channels = ("p", "q", "r") if name == "gyro" else CHANNELS.get(name, ())
    if name == "gyro_increments":
        channels = ("increment_p", "increment_q", "increment_r")
    absent = dict.fromkeys(contracts.contract(name).schema.names, pa.nulls(len(time)))
    return contracts.table(
        name, {**absent, "time": time, **dict(zip(channels, values.T, strict=True)), **more}
    )


def tables(one: NavigationRecord, *, truth: bool = True, truth_rate: float = 50.0) -> dict[str, pa.Table]:
    """All streams of a record."""
    kind = "_increments" if one.settings.output == "increments" else ""
    stamps, values = one.imu.header_stamp, one.imu.values
    found = {
        f"gyro{kind}": table(f"gyro{kind}", stamps, values[:, :3]),
        f"accelerometer{kind}": table(f"accelerometer{kind}", stamps, values[:, 3:]),
    }
    for aid, recorded in one.aids.items():
        measured = np.atleast_2d(recorded.values.reshape(len(recorded.header_stamp), -1))
        if aid == "attitude":
            measured = yaw_pitch_roll(measured)
        found[AID_TABLES[aid]] = table(AID_TABLES[aid], recorded.header_stamp, measured)
    if truth:
        seconds = np.arange(int(one.settings.flight.duration * truth_rate) + 1) / truth_rate
        motion, at = one.flight.at(seconds), START + np.rint(seconds * SECOND).astype(np.int64)
        found["truth_position"] = table("truth_position", at, motion.position)
        found["truth_velocity"] = table("truth_velocity", at, motion.velocity)
        found["truth_attitude"] = table("truth_attitude", at, yaw_pitch_roll(motion.attitude))
    return found


def changed(of: pa.Table, **columns: Any) -> pa.Table:
    """A table with other columns."""
    for name, values in columns.items():
        place = of.schema.get_field_index(name)
        of = of.set_column(place, of.schema.field(place), pa.array(values, of.schema.field(place).type))
    return of
