"""The options of ``gyrostand simulate navigation``: what they say in the truth, and how they are refused."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import ExitCode

Command = Callable[..., subprocess.CompletedProcess[str]]
DEGREE = np.pi / 180


def truth_of(gyrostand: Command, path: Path, *options: object) -> dict[str, Any]:
    made = gyrostand("simulate", "navigation", path, *options)
    assert made.returncode == ExitCode.PASS, made.stderr
    truth = path.with_suffix(".truth.json")
    assert made.stdout.split() == [str(path), str(path.with_suffix(".toml")), str(truth)]
    found: dict[str, Any] = json.loads(truth.read_text())
    return found


def test_every_option_reaches_the_truth(gyrostand: Command, tmp_path: Path) -> None:
    truth = truth_of(
        gyrostand, tmp_path / "run.mcap",
        "--level", "gps", "--sensors", 1, "--duration", 30, "--rate", 50, "--output", "increments",
        "--latitude", "45 deg", "--longitude", "-10 deg", "--height", "1 km", "--yaw", "-90 deg",
        "--speed", "180 km/h", "--cruise", "--turn", "5:10:-30 deg", "--climb", "15:10:20 m",
        "--accelerate", "2:5:5 m/s", "--sway", "roll:0.2:2 deg", "--wind", "1 2 m/s",
        "--wind-wander", "0.1 m/s", "--gust", "0.5 m/s", "--gyro-bias", "0.1 0 -0.1 deg/s",
        "--accelerometer-bias", "0 0 5 mg", "--gyro-noise", "0.01 deg/s",
        "--accelerometer-noise", "1 mg", "--start-error", "2 1 1 deg",
        "--aids", "position velocity airspeed altitude", "--outage", "10:5", "--outage", "20:2",
        "--aid-outage", "airspeed: 3:4", "--aid-rate", "position: 5", "--aid-noise", "position: 0.5 m",
        "--aid-bias", "altitude: -2 m", "--aid-clock-offset", "position: 0.1",
        "--aid-clock-rate", "velocity: 2e-5", "--aid-nan-burst", "altitude: 1:2", "--truth-rate", 5,
        "--stamp-noise", 1e-5, "--gap", "6:0.1", "--nan-burst", "7:0.1", "--backward-stamp", 8,
        "--repeated-sample", 9, "--log-delay", 0.2, "--log-jitter", 0.01, "--seed", 3,
    )  # fmt: skip
    settings = truth["settings"]
    flight = settings["flight"]
    assert flight["latitude"] == pytest.approx(45 * DEGREE, rel=1e-15)
    assert flight["longitude"] == pytest.approx(-10 * DEGREE, rel=1e-15)
    assert (flight["height"], flight["speed"], flight["catapult"]) == (1000.0, pytest.approx(50.0), None)
    assert flight["yaw"] == pytest.approx(-90 * DEGREE)
    assert flight["wind"] == [1.0, 2.0]
    assert [(m["kind"], m["start"], m["length"]) for m in flight["manoeuvres"]] == [
        ("turn", 5.0, 10.0), ("climb", 15.0, 10.0), ("accelerate", 2.0, 5.0)
    ]  # fmt: skip
    assert [m["amount"] for m in flight["manoeuvres"]] == pytest.approx([-30 * DEGREE, 20.0, 5.0])
    assert flight["sways"] == [
        {"angle": "roll", "amplitude": pytest.approx(2 * DEGREE), "frequency": 0.2, "phase": 0.0}
    ]
    assert settings["air"]["gust"]["sigma"] == 0.5
    assert settings["air"]["vertical_gust"]["sigma"] == 0.365
    assert settings["air"]["wander"]["sigma"] == 0.1
    errors = settings["errors"]
    assert errors["gyro_bias"] == pytest.approx([0.1 * DEGREE, 0.0, -0.1 * DEGREE])
    assert errors["accelerometer_bias"] == pytest.approx([0.0, 0.0, 5e-3 * 9.80665])
    assert errors["gyro_noise"] == pytest.approx(0.01 * DEGREE)
    assert errors["accelerometer_noise"] == pytest.approx(1e-3 * 9.80665)
    assert settings["start_errors"]["attitude"] == pytest.approx([2 * DEGREE, DEGREE, DEGREE])
    aids = settings["aids"]
    assert list(aids) == ["position", "velocity", "airspeed", "altitude"]
    position = aids["position"]
    assert position["outages"] == [[10.0, 5.0], [20.0, 2.0]] == aids["velocity"]["outages"]
    assert (position["rate"], position["noise"], position["timing"]["clock_offset"]) == (5.0, 0.5, 0.1)
    assert position["wander"] == {"sigma": 3.0, "time": 60.0}
    assert aids["velocity"]["clock_rate"] == 2e-5
    assert aids["airspeed"]["outages"] == [[3.0, 4.0]]
    assert aids["altitude"]["bias"] == -2.0
    assert aids["altitude"]["timing"]["nan_bursts"] == [[1.0, 2.0]]
    assert (settings["rate"], settings["output"], settings["truth_rate"]) == (50.0, "increments", 5.0)
    timing = settings["timing"]
    assert (timing["stamp_noise"], timing["log_delay"], timing["log_jitter"]) == (1e-5, 0.2, 0.01)
    assert (timing["gaps"], timing["nan_bursts"]) == ([[6.0, 0.1]], [[7.0, 0.1]])
    assert truth["faults"]["imu"]["lost"] == 5
    assert len(truth["faults"]["imu"]["backward_stamps"]) == 1
    assert truth["samples"]["position"] == 151 - 25 - 10
    assert truth["seed"] == 3


def test_a_stand_rests_and_an_outage_can_be_none(gyrostand: Command, tmp_path: Path) -> None:
    truth = truth_of(
        gyrostand, tmp_path / "run.csv", "--stand", "--duration", 5, "--turn", "1:3:180 deg",
        "--outage", "0:0", "--level", "ideal", "--aids", "position,attitude",
    )  # fmt: skip
    flight = truth["settings"]["flight"]
    assert (flight["speed"], flight["lift"], flight["catapult"]) == (0.0, None, None)
    assert truth["samples"] == {"imu": 501, "position": 6, "attitude": 101}


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--turn", "10:90 deg"), "START:LENGTH:AMOUNT UNIT"),
        (("--climb", "10:5:90 deg"), "length"),
        (("--sway", "heave:1:1 deg"), "yaw, pitch or roll"),
        (("--aids", "position radar"), "radar"),
        (("--aid-noise", "radar: 1 m"), "radar"),
        (("--aid-noise", "position: 1 deg"), "length"),
        (("--aid-rate", "position: often"), "a number"),
        (("--aid-rate", "attitude: 5"), "--aids"),
        (("--wind", "4 m/s"), "2 numbers"),
        (("--wind", "4 -3m/s"), "leave a blank"),
        (("--turn", "1:2:60deg"), "leave a blank"),
        (("--sensors", "3"), "one of 1, 2"),
        (("--latitude", "89.5 deg"), "latitude"),
        (("--turn", "1:2:180 deg"), "bank"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    gyrostand: Command, tmp_path: Path, options: tuple[str, ...], part: str
) -> None:
    made = gyrostand("simulate", "navigation", tmp_path / "run.mcap", "--duration", "20", *options)
    assert made.returncode == ExitCode.USAGE
    assert made.stderr.count("\n") == 1
    assert part in made.stderr
    assert list(tmp_path.iterdir()) == []
