"""Test plans of the procedure navigation: streams, units, start and gains; what is refused, and how."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import ExitCode
from pipeline.models.correction_gains import PRINTED, TUNED
from pipeline.models.navigation_filter_settings import USUAL, FilterSettings, GaussMarkov
from pipeline.procedures import PROCEDURES
from pipeline.stages import navigate
from pipeline.stages._navigation_filter_plan import FilterPlan
from pipeline.stages._navigation_settings import LoopPlan
from pipeline.testplan import PlanError, load_plan

GOOD = """\
procedure = "navigation"

[time]
clock = "header_stamp"

[streams.gyro]
topic = "/imu"
quantity = "angular_rate"
channels.p = { field = "angular_velocity.x", unit = "rad/s" }
channels.q = { field = "angular_velocity.y", unit = "rad/s" }
channels.r = { field = "angular_velocity.z", unit = "rad/s" }

[streams.accelerometer]
topic = "/imu"
quantity = "specific_force"
channels.x = { field = "linear_acceleration.x", unit = "m/s^2" }
channels.y = { field = "linear_acceleration.y", unit = "m/s^2" }
channels.z = { field = "linear_acceleration.z", unit = "m/s^2" }

[streams.gnss_position]
topic = "/fix"
quantity = "geodetic_position"
channels.latitude = { field = "latitude", unit = "deg" }
channels.longitude = { field = "longitude", unit = "deg" }
channels.height = { field = "altitude", unit = "m" }
channels.fix = { field = "status.status", unit = "1" }

[streams.magnetometer]
topic = "/magnetic"
quantity = "magnetic_field"
channels.x = { field = "magnetic_field.x", unit = "T" }
channels.y = { field = "magnetic_field.y", unit = "T" }
channels.z = { field = "magnetic_field.z", unit = "T" }

[streams.external_attitude]
topic = "/attitude"
quantity = "quaternion"
rotation = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
reference_rotation = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
channels.w = { field = "quaternion.w", unit = "1" }
channels.x = { field = "quaternion.x", unit = "1" }
channels.y = { field = "quaternion.y", unit = "1" }
channels.z = { field = "quaternion.z", unit = "1" }

[navigate]
methods = ["loops", "filter"]
start_attitude = "plan"

[navigate.start]
yaw_deg = 55
pitch_deg = 2.0
roll_deg = 0

[navigate.earth_field]
strength_ut = 52.0
dip_deg = 71
declination_deg = 11

[navigate.loops]
gains = "printed"
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "run7.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_a_vehicle_is_a_plan(plan: Path) -> None:
    read = load_plan(plan)
    assert tuple(read.settings) == PROCEDURES["navigation"]
    settings = read.settings["navigate"]
    assert isinstance(settings, navigate.Settings)
    assert settings.methods == ("loops", "filter")
    assert settings.loops.loop_gains == PRINTED
    assert settings.earth_field is not None
    assert settings.earth_field.field.ned == pytest.approx(
        52e-6 * np.array([0.319586, 0.062121, 0.945519]),
        rel=1e-5,  # six digits of sines and cosines
    )
    assert "fix" in read.streams["gnss_position"].channels


def test_the_kind_of_fix_may_be_left_out(plan: Path) -> None:
    line = 'channels.fix = { field = "status.status", unit = "1" }\n'
    plan.write_text(GOOD.replace(line, ""), encoding="utf-8")
    assert tuple(load_plan(plan).streams["gnss_position"].channels) == ("latitude", "longitude", "height")


def test_defaults_are_those_of_the_models() -> None:
    """All but the lift, which a plan must state: not every vehicle flies; and errors that are constant."""
    assert FilterPlan().settings(2.5) == FilterSettings(coloured=USUAL)
    assert LoopPlan().loop_gains == TUNED
    assert LoopPlan().settings(2.5).lift is None


def test_sigmas_of_the_plan_arrive_where_they_belong() -> None:
    told = FilterPlan.model_validate(
        {
            "states": 15,
            "start": {"position_m": 1.0, "yaw_rad": 0.5, "gyro_bias_rad_s": 2e-3},
            "noise": {"wind_m_s": 0.7, "coasted_attitude_rad": 0.3},
            "measurement": {"magnetic_field_ut": 2.0, "attitude_rad": 0.02, "sideslip_m_s": 9.0},
            "coloured": {"position_m": 0.5, "position_time_s": 40.0, "hard_iron_ut": 0.0, "gust_m_s": 1.0},
            "gate": 0.0,
        }
    ).settings(4.0)
    assert (told.states, told.stale, told.gate) == (15, 4.0, 0.0)
    assert (told.start.position, told.start.yaw, told.start.gyro_bias) == (1.0, 0.5, 2e-3)
    assert (told.noise.wind, told.noise.coasted_attitude) == (0.7, 0.3)
    assert told.measurement.magnetic_field == pytest.approx(2e-6, rel=1e-15)  # one product
    assert (told.measurement.attitude, told.measurement.sideslip) == (0.02, 9.0)
    assert told.coloured == replace(
        USUAL, position=GaussMarkov(0.5, 40.0), gust=GaussMarkov(1.0, 6.6), hard_iron=0.0
    )


BROKEN = [
    # what is changed: from, to; line; key; words
    ("[streams.accelerometer]", "[streams.magnetometer2]", 13, "streams.magnetometer2",
     ["did you mean 'magnetometer'?"]),
    (GOOD[GOOD.index("[streams.accelerometer]"):GOOD.index("[streams.gnss_position]")], "", 6, "streams",
     ["streams.accelerometer, for the procedure 'navigation'", "add [streams.accelerometer]"]),
    ('channels.q = { field = "angular_velocity.y", unit = "rad/s" }\n', "", 9, "streams.gyro.channels",
     ["the channels p, q, r", "no q"]),
    ('channels.y = { field = "linear_acceleration.y", unit = "m/s^2" }\n', "", 16,
     "streams.accelerometer.channels", ["the channels x, y, z", "no y"]),
    ('channels.height = { field = "altitude", unit = "m" }\n', "", 23, "streams.gnss_position.channels",
     ["the channels latitude, longitude, height for quantity 'geodetic_position'", "no height"]),
    ('field = "magnetic_field.x", unit = "T"', 'field = "magnetic_field.x", unit = ""', 31,
     "streams.magnetometer.channels.x.unit",
     ["a unit of magnetic flux density", "not filled in", "T, mT, uT, nT, G, mG"]),
    ('field = "magnetic_field.x", unit = "T"', 'field = "magnetic_field.x", unit = "counts"', 31,
     "streams.magnetometer.channels.x.unit", ["a unit of magnetic flux density", "found 'counts'"]),
    ('field = "linear_acceleration.x", unit = "m/s^2"', 'field = "linear_acceleration.x", unit = "m/s"', 16,
     "streams.accelerometer.channels.x.unit", ["a unit of acceleration", "m/s^2, g, mg"]),
    ('field = "latitude", unit = "deg"', 'field = "latitude", unit = "m"', 23,
     "streams.gnss_position.channels.latitude.unit", ["a unit of angle", "found 'm'"]),
    ('quantity = "geodetic_position"', 'quantity = "ned_velocity"', 22, "streams.gnss_position.quantity",
     ["'geodetic_position' for the stream 'gnss_position'"]),
    ('topic = "/fix"\n', 'topic = "/fix"\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n', 22,
     "streams.gnss_position.rotation", ["no axes to turn"]),
    ('topic = "/magnetic"\n', 'topic = "/magnetic"\nreference_rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n',
     30,
     "streams.magnetometer.reference_rotation", ["only in the streams 'reference', 'external_attitude'"]),
    ("roll_deg = 0\n", "", 49, "navigate.start",
     ["yaw_deg, pitch_deg, roll_deg beside start_attitude = 'plan'", "no roll_deg", "add roll_deg"]),
    ("yaw_deg = 55", "yaw_deg = 555", 50, "navigate.start.yaw_deg", ["360", "found 555"]),
    ("declination_deg = 11\n", "", 54, "navigate.earth_field", ["the key 'declination_deg'"]),
    ('"loops", "filter"', '"loops", "kalman"', 46, "navigate.methods[2]", ["found 'kalman'"]),
    ('gains = "printed"', 'gains = "printed"\nsatellites = { T_s = 3.0 }', 61, "navigate.loops.satellites",
     ["T_V_s"]),
    ('start_attitude = "plan"', 'start_attitude = "guess"', 47, "navigate.start_attitude",
     ["'plan', 'external_attitude', 'levelled' or 'truth'"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "key", "words"), BROKEN)
def test_a_broken_plan_gives_a_line_that_names_it(
    plan: Path, old: str, new: str, line: int, key: str, words: list[str]
) -> None:
    assert old in GOOD
    plan.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(PlanError) as caught:
        load_plan(plan)
    message = str(caught.value)
    assert caught.value.exit_code is ExitCode.USAGE
    assert message.startswith(f"{plan}:{line}: {key}: expected "), message
    for word in words:
        assert word in message
