"""The options of ``gyrostand simulate static``: what they say in the truth, and how they are refused."""

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
HOUR = 3600.0


def truth_of(gyrostand: Command, path: Path, *options: object) -> dict[str, Any]:
    made = gyrostand("simulate", "static", path, *options)
    assert made.returncode == ExitCode.PASS, made.stderr
    truth = path.with_suffix(".truth.json")
    assert made.stdout.split() == [str(path), str(path.with_suffix(".toml")), str(truth)]
    found: dict[str, Any] = json.loads(truth.read_text())
    return found


def test_every_option_reaches_the_truth(gyrostand: Command, tmp_path: Path) -> None:
    truth = truth_of(
        gyrostand, tmp_path / "run.csv",
        "--axes", "r,p", "--hours", 0.5, "--rate", 2, "--output", "angular_rate",
        "--white", "0.01 deg/sqrt(h)", "--white", "r: 0.02 °/√h", "--noise1", "p: 2 deg/h, 0.01 rad/s",
        "--noise2", "1 deg/h, 0.02 0.1 rad/s", "--noise2", "1 deg/h, 0.02 0.2 rad/s",
        "--noise3", "r:1 deg/h, 0.5 1 deg/s", "--rate-random-walk", "1 deg/h/sqrt(h)",
        "--quantisation", "0.1 arcsec", "--bias", "r: -1 deg/h", "--ramp", "p:0.1 deg/h/h",
        "--quantum", "1e-9 rad/s", "--latitude", "55.75 deg", "--tilt", "1 arcmin",
        "--turning", "3 deg/s", "--table", "table_angle", "--wrapped",
        "--motion", "600:60:1 arcmin", "--tap", "900:2:10 arcsec", "--stamp-noise", 0.001,
        "--gap", "100:20", "--nan-burst", "200:5", "--backward-stamp", 300, "--repeated-sample", 400,
        "--log-delay", 0.2, "--log-jitter", 0.1, "--seed", 3,
    )  # fmt: skip
    assert list(truth["axes"]) == ["p", "r"]
    p, r = truth["axes"]["p"], truth["axes"]["r"]
    walk = 0.01 * DEGREE / 60
    noise2 = [
        {"model": "noise2", "sigma": DEGREE / HOUR, "mu": 0.02, "lambda": lambda_} for lambda_ in (0.1, 0.2)
    ]
    wanted_p = [
        {"model": "white", "N": walk**2},
        {"model": "noise1", "sigma": 2 * DEGREE / HOUR, "mu": 0.01},
        *noise2,
        {"model": "rate_random_walk", "K": DEGREE / HOUR / 60},
    ]
    wanted_r = [
        {"model": "white", "N": (2 * walk) ** 2},
        *noise2,
        {"model": "noise3", "sigma": DEGREE / HOUR, "mu": 0.5 * DEGREE, "lambda": DEGREE},
        {"model": "rate_random_walk", "K": DEGREE / HOUR / 60},
    ]
    for axis, wanted in ((p, wanted_p), (r, wanted_r)):
        assert [term["model"] for term in axis["terms"]] == [term["model"] for term in wanted]
        for found, term in zip(axis["terms"], wanted, strict=True):
            numbers = {name: value for name, value in term.items() if name != "model"}
            # products of a few rounded factors
            assert {name: found[name] for name in numbers} == pytest.approx(numbers, rel=1e-14)
        assert axis["quantisation"] == pytest.approx(0.1 * DEGREE / HOUR, rel=1e-14)
    assert (p["bias"], r["ramp"]) == (0.0, 0.0)
    assert r["bias"] == pytest.approx(-DEGREE / HOUR, rel=1e-14)
    assert p["ramp"] == pytest.approx(0.1 * DEGREE / HOUR**2, rel=1e-14)
    settings = truth["settings"]
    assert (settings["rate"], settings["duration"], settings["output"]) == (2.0, 1800.0, "angular_rate")
    numbers = {"quantum": 1e-9, "latitude": 55.75 * DEGREE, "tilt": DEGREE / 60}
    assert {name: settings[name] for name in numbers} == pytest.approx(numbers, rel=1e-15)
    assert settings["turning"] == {
        "rate": pytest.approx(3 * DEGREE, rel=1e-15), "quantity": "table_angle", "wrapped": True,
    }  # fmt: skip
    assert settings["disturbances"] == [
        {"start": 600.0, "length": 60.0, "angle": pytest.approx(DEGREE / 60), "returns": False},
        {"start": 900.0, "length": 2.0, "angle": pytest.approx(DEGREE / 360), "returns": True},
    ]
    assert settings["timing"] == {
        "sample_jitter": 0.0, "stamp_noise": 0.001, "clock_offset": 0.0, "gaps": [[100.0, 20.0]],
        "nan_bursts": [[200.0, 5.0]], "backward_stamps": [300.0], "repeated_samples": [400.0],
        "log_delay": 0.2, "log_jitter": 0.1,
    }  # fmt: skip
    assert truth["seed"] == 3


def test_the_plan_beside_it_is_accepted(gyrostand: Command, tmp_path: Path) -> None:
    truth_of(gyrostand, tmp_path / "run.mcap", "--axes", "q", "--hours", 0.2, "--white", "0.01 deg/sqrt(h)")
    checked = gyrostand("plan", "check", tmp_path / "run.toml")
    assert checked.returncode == ExitCode.PASS, checked.stderr
    validated = gyrostand("validate", tmp_path / "run.mcap")
    assert validated.returncode == ExitCode.PASS, validated.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--axes", "x"), ["--axes", "some of p, q, r", "'x'"]),
        (("--axes", ""), ["--axes", "''"]),
        (("--axes", "p", "--white", "q: 1 deg/sqrt(h)"), ["--white", "'q'", "--axes"]),
        (("--white", "0.01 deg/h"), ["--white", "deg/sqrt(h)", "for example"]),
        (("--white", "0.01"), ["--white", "'0.01'"]),
        (("--white", "-1 deg/sqrt(h)"), ["--white", "a number of at least 0"]),
        (("--noise1", "2 deg/h"), ["--noise1", "a comma", "'2 deg/h, 0.01 rad/s'"]),
        (("--noise2", "2 deg/h, 0.01 rad/s"), ["--noise2", "2 numbers"]),
        (("--noise1", "0 deg/h, 0.01 rad/s"), ["sigma of noise1", "a positive number"]),
        (("--ramp", "1 deg/h"), ["--ramp", "deg/h/h"]),
        (("--tap", "900:10 arcsec"), ["--tap", "START:LENGTH:ANGLE UNIT"]),
        (("--motion", "5:5"), ["--motion", "START:LENGTH:ANGLE UNIT", "'5:5'"]),
        (("--latitude", "95 deg"), ["--latitude", "from -90 to 90 deg", "'95 deg'"]),
        (("--latitude", "50 deg", "--tilt", "-2 rad"), ["--tilt", "from -90 to 90 deg", "'-2 rad'"]),
        (("--tilt", "1 deg"), ["--tilt", "no --latitude"]),
        (("--wrapped",), ["--wrapped", "no --turning"]),
        (("--table", "table_rate"), ["--table", "no --turning"]),
        (("--turning", "3"), ["--turning", "unit of angular rate"]),
        (("--turning", "0 deg/s"), ["a rate of the platform other than 0"]),
        (("--hours", -1), ["duration", "more than 0"]),
        (("--quantum", "1 rad/s"), ["--quantum", "unit of angle"]),
    ],
)
def test_a_wrong_option_gives_one_line(
    gyrostand: Command, tmp_path: Path, options: tuple[object, ...], words: list[str]
) -> None:
    refused = gyrostand("simulate", "static", tmp_path / "run.mcap", *options)
    assert refused.returncode == ExitCode.USAGE
    assert len(refused.stderr.splitlines()) == 1, refused.stderr
    for word in words:
        assert word in refused.stderr
    assert not (tmp_path / "run.mcap").exists()
