"""The options of ``gyrostand simulate coning``: what they say in the truth, and how they are refused."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import ExitCode

Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize("suffix", [".mcap", ".bag", "", ".csv"])
def test_every_option_reaches_the_truth_and_the_record_is_processed(
    gyrostand: Command, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"run{suffix}"
    made = gyrostand(
        "simulate", "coning", path,
        "--cone-angle", "0.8 deg", "--frequency", 30, "--rate", 500, "--reference-rate", 2000,
        "--duration", 1, "--first-time", -0.5, "--onset", 0.25,
        "--smooth-slope", "0.5 deg/s", "--smooth-offset", "1 mrad",
        "--white-noise", "1e-2 deg/s", "--white-angle-noise", "1 urad", "--bias", "1 -2 0.5 deg/h",
        "--quantum", "0.001 deg/s", "--mounting", "0.1 0 -0.1 deg",
        "--sample-jitter", 1e-5, "--stamp-noise", 1e-5, "--clock-offset", 2e-4,
        "--gap", "0.6:0.02", "--gap", "0.7:0.01", "--nan-burst", "0.8:0.01",
        "--backward-stamp", 0.1, "--repeated-sample", 0.2, "--log-delay", 1e-3, "--log-jitter", 1e-4,
        "--reference-noise", "1 arcsec", "--seed", 3,
    )  # fmt: skip
    assert made.returncode == ExitCode.PASS, made.stderr
    assert made.stdout.split() == [str(path), str(tmp_path / "run.toml"), str(tmp_path / "run.truth.json")]
    truth = json.loads((tmp_path / "run.truth.json").read_text())
    settings, degree = truth["settings"], np.pi / 180
    expected = {
        "cone_angle": 0.8 * degree, "frequency": 30.0, "rate": 500.0, "reference_rate": 2000.0,
        "duration": 1.0, "first_time": -0.5, "onset": 0.25, "smooth_slope": 0.5 * degree,
        "smooth_offset": 1e-3, "reference_noise": degree / 3600,
    }  # fmt: skip
    # one product of two rounded factors
    assert {name: settings[name] for name in expected} == pytest.approx(expected, rel=1e-15)
    gyro = settings["gyro"]
    assert gyro["bias"] == pytest.approx([degree / 3600, -2 * degree / 3600, 0.5 * degree / 3600], rel=1e-15)
    assert gyro["mounting"] == pytest.approx([0.1 * degree, 0.0, -0.1 * degree], rel=1e-15)
    assert gyro["white_noise"] == pytest.approx(1e-2 * degree, rel=1e-15)
    assert gyro["white_angle_noise"] == pytest.approx(1e-6, rel=1e-15)
    assert gyro["quantum"] == pytest.approx(1e-3 * degree, rel=1e-15)
    assert settings["timing"] == {
        "sample_jitter": 1e-5, "stamp_noise": 1e-5, "clock_offset": 2e-4, "gaps": [[0.6, 0.02], [0.7, 0.01]],
        "nan_bursts": [[0.8, 0.01]], "backward_stamps": [0.1], "repeated_samples": [0.2],
        "log_delay": 1e-3, "log_jitter": 1e-4,
    }  # fmt: skip
    assert truth["seed"] == 3
    run = gyrostand("run", path, "--out", tmp_path / "out")
    assert run.returncode == ExitCode.PASS, run.stderr


def test_the_quantum_of_increments_is_an_angle(gyrostand: Command, tmp_path: Path) -> None:
    options = ("--output", "angle_increment", "--duration", 0.1, "--reference-rate", 1000)
    made = gyrostand("simulate", "coning", tmp_path / "run.csv", *options, "--quantum", "1 urad")
    assert made.returncode == ExitCode.PASS, made.stderr
    assert json.loads((tmp_path / "run.truth.json").read_text())["settings"]["gyro"]["quantum"] == 1e-6
    wrong = gyrostand("simulate", "coning", tmp_path / "run.csv", *options, "--quantum", "1 urad/s")
    assert wrong.returncode == ExitCode.USAGE
    assert "a unit of angle" in wrong.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--cone-angle", "1"], ["--cone-angle", "1 number and a unit of angle", "'1'"]),
        (["--cone-angle", "1 dge"], ["'1 dge'", "did you mean 'deg'?"]),
        (["--cone-angle", ""], ["--cone-angle", "''"]),
        (["--bias", "1 2 rad/s"], ["--bias", "3 numbers", "'1 2 rad/s'"]),
        (["--bias", "a b c rad/s"], ["--bias", "before the unit"]),
        (["--bias", "nan 0 0 rad/s"], ["bias", "a finite number", "nan"]),
        (["--gap", "0.5"], ["--gap", "START:LENGTH", "'0.5'"]),
        (["--nan-burst", "0.5:-1"], ["nan_bursts", "at least 0", "-1"]),
        (["--clock-offset", "nan"], ["clock_offset", "nan"]),
        (["--backward-stamp", "9"], ["backward_stamps", "where the record ends"]),
        (["--cone-angle", "200 deg"], ["cone angle", "pi"]),
        (["--smooth-slope", "1 deg/s"], ["onset", "none"]),
    ],
)
def test_a_wrong_option_is_one_line_and_writes_nothing(
    gyrostand: Command, tmp_path: Path, options: list[str], words: list[str]
) -> None:
    result = gyrostand("simulate", "coning", tmp_path / "run.mcap", *options)
    assert result.returncode == ExitCode.USAGE
    assert len(result.stderr.splitlines()) == 1
    assert all(word in result.stderr for word in words), result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_name_of_no_format_is_refused(gyrostand: Command, tmp_path: Path) -> None:
    result = gyrostand("simulate", "coning", tmp_path / "run.xyz")
    assert result.returncode == ExitCode.USAGE
    assert ".mcap, .bag or .csv" in result.stderr


@pytest.mark.parametrize("what", ["coning", "samples"])
def test_a_folder_that_cannot_be_made_is_refused(gyrostand: Command, tmp_path: Path, what: str) -> None:
    (tmp_path / "file").touch()
    where = [tmp_path / "file" / "run.mcap"] if what == "coning" else ["--out", tmp_path / "file" / "samples"]
    result = gyrostand("simulate", what, *where)
    assert result.returncode == ExitCode.USAGE, result.stderr
    assert "a folder that can be written" in result.stderr
