"""The options of ``gyrostand simulate drift``: what they say in the truth, and how they are refused."""

from __future__ import annotations

import json
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import ExitCode

Command = Callable[..., subprocess.CompletedProcess[str]]
DEGREE = np.pi / 180


def truth_of(gyrostand: Command, path: Path, *options: object) -> dict[str, Any]:
    made = gyrostand("simulate", "drift", path, *options)
    assert made.returncode == ExitCode.PASS, made.stderr
    truth = path.with_suffix(".truth.json")
    assert made.stdout.split() == [str(path), str(path.with_suffix(".toml")), str(truth)]
    found: dict[str, Any] = json.loads(truth.read_text())
    return found


def test_every_option_reaches_the_truth(gyrostand: Command, tmp_path: Path) -> None:
    truth = truth_of(
        gyrostand, tmp_path / "run.mcap",
        "--latitude", "-30 deg", "--scheme", "vertical", "--start", "0.1 -0.2 rad", "--hours", 2,
        "--m11", "0.15 deg/h", "--m12", 0.01, "--m21", "-0.3 deg/h", "--m22", 1e-3, "--mc1", "-2e-3",
        "--mc2", "1 arcsec/s", "--theta", "10 -5 arcmin", "--delta-chi", "1 0 -1 arcmin",
        "--delta-chi-increments", "0 1 0 arcmin", "--interval", "0.5 min", "--pause", "2 h",
        "--transient", "0.75 0.75 0 0 0 0.75 deg/h", "--transient-time", "30 min",
        "--servo-jump", "600:1 -2 deg", "--noise", "1 arcsec", "--coloured-noise", "0.5 arcsec",
        "--correlation-time", "5 min", "--outlier-share", 0.01, "--outlier-size", "1 arcmin",
        "--counts-per-turn", 1296000, "--as-counts", "--unit", "deg", "--wrapped",
        "--sample-jitter", 0.1, "--stamp-noise", 0.01, "--gap", "900:120", "--nan-burst", "1800:60",
        "--backward-stamp", 3000, "--repeated-sample", 3600, "--log-delay", 0.2, "--log-jitter", 0.1,
        "--seed", 3,
    )  # fmt: skip
    settings, arcmin = truth["settings"], DEGREE / 60
    earth = np.deg2rad(15.041067) / 3600
    # one product or quotient of rounded factors
    assert settings["m"] == pytest.approx(
        [0.15 / 15.041067, 0.01, -0.3 / 15.041067, 1e-3, -2e-3, DEGREE / 3600 / earth], rel=1e-14
    )
    assert settings["transient"] == pytest.approx(
        [0.75 / 15.041067 * k for k in (1, 1, 0, 0, 0, 1)], rel=1e-14
    )
    assert settings["theta"] == pytest.approx([10 * arcmin, -5 * arcmin], rel=1e-15)
    numbers = {
        "latitude": -30 * DEGREE, "interval": 30.0, "pause": 7200.0, "transient_time": 1800.0,
    }  # fmt: skip
    assert {name: settings[name] for name in numbers} == pytest.approx(numbers, rel=1e-15)
    assert settings["servo_jumps"][0] == pytest.approx([600.0, DEGREE, -2 * DEGREE], rel=1e-15)
    [run] = settings["runs"]
    assert (run["scheme"], run["chi"], run["start"], run["duration"]) == (
        "vertical",
        None,
        [0.1, -0.2],
        7200.0,
    )
    assert run["misalignment"] == pytest.approx([arcmin, 0.0, -arcmin], rel=1e-15)
    assert run["increments"] == pytest.approx([0.0, arcmin, 0.0], rel=1e-15)
    assert settings["errors"] == pytest.approx(
        {
            "white_noise": DEGREE / 3600, "coloured_noise": 0.5 * DEGREE / 3600, "correlation_time": 300.0,
            "outlier_share": 0.01, "outlier_size": arcmin,
        },
        rel=1e-15,
    )  # fmt: skip
    assert settings["encoder"] == {"counts": 1296000, "as_counts": True, "unit": "deg", "wrapped": True}
    assert settings["timing"] == {
        "sample_jitter": 0.1, "stamp_noise": 0.01, "clock_offset": 0.0, "gaps": [[900.0, 120.0]],
        "nan_bursts": [[1800.0, 60.0]], "backward_stamps": [3000.0], "repeated_samples": [3600.0],
        "log_delay": 0.2, "log_jitter": 0.1,
    }  # fmt: skip
    assert truth["seed"] == 3


def test_runs_take_what_they_leave_out_from_the_command(gyrostand: Command, tmp_path: Path) -> None:
    options = ("--hours", 1, "--interval", "1 min", "--start", "0.2 0.1 rad", "--delta-chi", "1 0 0 arcmin")
    runs = (
        "--run", "scheme=equatorial,start=0 0.8 rad,hours=2",
        "--run", "name=turned,chi=0 -45 10 deg,delta-chi=0 0 0 rad",
        "--run", "delta_chi_increments=0 1 0 mrad",
    )  # fmt: skip
    first, second, third = truth_of(gyrostand, tmp_path / "runs", *options, *runs)["settings"]["runs"]
    assert (first["scheme"], first["start"], first["duration"]) == ("equatorial", [0.0, 0.8], 7200.0)
    assert first["misalignment"] == third["misalignment"] == [DEGREE / 60, 0.0, 0.0]
    assert (second["name"], second["scheme"], second["start"]) == ("turned", None, [0.2, 0.1])
    assert second["chi"] == pytest.approx([0.0, -45 * DEGREE, 10 * DEGREE], rel=1e-15)
    assert second["misalignment"] == [0.0, 0.0, 0.0]
    assert (third["scheme"], third["duration"], third["increments"]) == ("polar", 3600.0, [0.0, 1e-3, 0.0])
    plan = tomllib.loads((tmp_path / "runs.toml").read_text())
    assert [run["name"] for run in plan["runs"]] == ["run 0", "turned", "run 2"]


def test_a_scheme_of_a_run_takes_the_place_of_the_angles_of_all(gyrostand: Command, tmp_path: Path) -> None:
    options = (
        "--chi",
        "0 -45 10 deg",
        "--hours",
        1,
        "--interval",
        "1 min",
        "--run",
        "scheme=polar",
        "--run",
        "hours=2",
    )
    first, second = truth_of(gyrostand, tmp_path / "run.csv", *options)["settings"]["runs"]
    assert (first["scheme"], first["chi"]) == ("polar", None)
    assert second["scheme"] is None
    assert second["chi"] == pytest.approx([0.0, -45 * DEGREE, 10 * DEGREE], rel=1e-15)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--latitude", "55.75"], ["--latitude", "a unit of angle"]),
        (["--latitude", "91 deg"], ["--latitude", "from -90 to 90 deg", "'91 deg'"]),
        (["--m11", "a"], ["--m11", "1 number", "unit of angular rate"]),
        (["--m11", "1 deg"], ["--m11", "'1 deg'"]),
        (["--transient", "1 2 3"], ["--transient", "6 numbers"]),
        (["--theta", "1 arcmin"], ["--theta", "2 numbers"]),
        (["--start", "0.6 0.5"], ["--start", "a unit of angle"]),
        (["--interval", "0 s"], ["interval", "more than 0"]),
        (["--hours", "0"], ["duration", "more than 0"]),
        (["--chi", "0 0 0 rad", "--scheme", "polar"], ["scheme", "both 'polar' and the angles"]),
        (["--run", "shceme=polar"], ["--run", "one of the keys", "scheme"]),
        (["--run", "scheme"], ["--run", "key=value"]),
        (["--run", "scheme=round"], ["--run scheme", "polar, equatorial, horizontal, vertical", "'round'"]),
        (["--run", "hours=long"], ["--run hours", "a number", "'long'"]),
        (["--run", "start=0 0.8"], ["--start", "a unit of angle"]),
        (["--servo-jump", "600"], ["--servo-jump", "2 numbers"]),
        (["--servo-jump", "soon:1 1 deg"], ["--servo-jump", "TIME:JUMP1 JUMP2 UNIT"]),
        (["--as-counts"], ["counts a turn", "none"]),
        (["--outlier-share", "2"], ["outlier_share", "at most 1"]),
        (["--gap", "5"], ["--gap", "START:LENGTH"]),
        (["--start", "90 0 deg"], ["alpha2", "90 degrees"]),
    ],
)
def test_a_wrong_option_is_one_line_and_writes_nothing(
    gyrostand: Command, tmp_path: Path, options: list[str], words: list[str]
) -> None:
    result = gyrostand("simulate", "drift", tmp_path / "run.mcap", *options)
    assert result.returncode == ExitCode.USAGE
    assert len(result.stderr.splitlines()) == 1
    assert all(word in result.stderr for word in words), result.stderr
    assert list(tmp_path.iterdir()) == []
