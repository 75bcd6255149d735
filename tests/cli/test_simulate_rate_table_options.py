"""The options of ``gyrostand simulate rate_table``: what they say in the truth, and how they are refused."""

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
DEG_H = DEGREE / 3600


def about(value: object) -> Any:
    return pytest.approx(value, rel=1e-14)  # products of a few rounded factors


def test_every_option_reaches_the_truth(gyrostand: Command, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    made = gyrostand(
        "simulate", "rate_table", path, "--axes", "r,p", "--mounting", "p", "--mounting", "-r:upside down",
        "--apart", "--rates", "10 -10 20 deg/s", "--dwell", "2 s", "--acceleration", "100 deg/s/s",
        "--ripple", "0.1 %", "--ripple-harmonic", 6,
        "--pause", "30 s", "--rate", 20, "--means", "--scale-factor-error", "500 ppm",
        "--scale-factor-error", "r:-0.1 %", "--asymmetry", "p: 200 ppm", "--nonlinearity", "2 50 ppm",
        "--nonlinearity", "p: 3 -150 ppm", "--full-scale", "30 deg/s", "--bias", "p: -3 deg/h",
        "--misalignment", "r: 1 -2 mrad", "--bias-temperature", "0.5 deg/h/K",
        "--scale-factor-temperature", "p: -20 ppm/K", "--temperature", "0:20 degC",
        "--temperature", "10:300 K", "--temperature-rate", 2, "--temperature-noise", 0.01,
        "--reference-temperature", "25 °C", "--white", "0.01 deg/sqrt(h)", "--noise1", "2 deg/h, 0.01 rad/s",
        "--rate-random-walk", "r: 1 deg/h/sqrt(h)", "--counts-per-unit", 131, "--latitude", "55.75 deg",
        "--heading", "-30 deg", "--tilt", "1 arcmin", "--orientation-error", "0.1 mrad",
        "--bias-error", "1 deg/h", "--table", "table_angle", "--table-rate", 10,
        "--table-noise", "1 arcsec", "--counts-per-turn", 36000, "--as-counts", "--wrapped", "--unit", "deg",
        "--clock-offset", 0.01, "--stamp-noise", 0.0001, "--gap", "1:0.5", "--nan-burst", "2:0.2",
        "--backward-stamp", 3, "--repeated-sample", 3.5, "--log-delay", 0.2, "--log-jitter", 0.1, "--seed", 3,
    )  # fmt: skip
    assert made.returncode == ExitCode.PASS, made.stderr
    further, truth_file = tmp_path / "run_2.csv", tmp_path / "run.truth.json"
    assert made.stdout.split() == list(map(str, (path, tmp_path / "run.toml", truth_file, further)))
    truth: dict[str, Any] = json.loads(truth_file.read_text())
    p, r = truth["gyros"]["p"], truth["gyros"]["r"]
    assert (p["scale_factor"], r["scale_factor"]) == about((1.0005, 0.999))
    assert (p["asymmetry"], r["asymmetry"]) == about((2e-4, 0.0))
    assert p["nonlinearity"] == {"2": about(5e-5), "3": about(-1.5e-4)}
    assert r["nonlinearity"] == {"2": about(5e-5)}
    assert (p["bias"], r["bias"]) == about((-3 * DEG_H, 0.0))
    assert r["misalignment"] == about([1e-3, -2e-3])
    assert r["bias_temperature_sensitivity"] == about(0.5 * DEG_H)
    assert p["scale_factor_temperature_sensitivity"] == about(-2e-5)
    assert [term["model"] for term in p["terms"]] == ["white", "noise1"]
    assert [term["model"] for term in r["terms"]] == ["white", "noise1", "rate_random_walk"]
    assert truth["largest_rate"] == about(30 * DEGREE)
    assert truth["time_offset"] == about(0.01 + 0.025)  # a mean of 50 ms has its instant in the middle
    assert [run["name"] for run in truth["runs"]] == ["p", "upside down"]
    settings = truth["settings"]
    assert (settings["method"], settings["means"], settings["rate"]) == ("rates", True, 20.0)
    assert settings["profile"] == {
        "rates": about([10 * DEGREE, -10 * DEGREE, 20 * DEGREE]), "dwell": 2.0,
        "acceleration": about(100 * DEGREE), "ripple": about(1e-3), "ripple_harmonic": 6,
    }  # fmt: skip
    assert settings["mountings"] == [{"axis": "p", "name": ""}, {"axis": "-r", "name": "upside down"}]
    numbers = {
        "pause": 30.0, "quantum": 0.0, "counts_per_unit": 131.0, "latitude": 55.75 * DEGREE,
        "heading": -30 * DEGREE, "tilt": DEGREE / 60, "orientation_error": 1e-4,
        "bias_error": DEG_H, "reference_temperature": 298.15,
    }  # fmt: skip
    assert {name: settings[name] for name in numbers} == about(numbers)
    encoder = {"counts": 36000, "as_counts": True, "unit": "deg", "wrapped": True}
    sensor = {"quantity": "table_angle", "rate": 10.0, "noise": about(DEG_H), "encoder": encoder}
    assert settings["table"] == sensor
    assert settings["temperature"] == {"profile": [[0.0, 293.15], [10.0, 300.0]], "rate": 2.0, "noise": 0.01}
    assert settings["timing"] == {
        "sample_jitter": 0.0, "stamp_noise": 0.0001, "clock_offset": 0.01, "gaps": [[1.0, 0.5]],
        "nan_bursts": [[2.0, 0.2]], "backward_stamps": [3.0], "repeated_samples": [3.5], "log_delay": 0.2,
        "log_jitter": 0.1,
    }  # fmt: skip
    assert truth["seed"] == 3


def test_every_option_of_turns_reaches_the_truth(command: Command, tmp_path: Path) -> None:
    made = command(
        "simulate", "rate_table", tmp_path / "run.csv", "--method", "turns", "--turns", "90 -180 deg",
        "--rest", "3 s", "--moving", "1 s", "--angle-error", "1 arcmin", "--rate", 20,
    )  # fmt: skip
    assert made.returncode == ExitCode.PASS, made.stderr
    settings = json.loads((tmp_path / "run.truth.json").read_text())["settings"]
    assert settings["hand"] == {"turns": about([np.pi / 2, -np.pi]), "rest": 3.0, "moving": 1.0}
    assert settings["angle_error"] == about(DEGREE / 60)


@pytest.mark.parametrize(
    ("options", "terms"),
    [
        ((), ["white"]),
        (("--white", "q: 0 deg/sqrt(h)"), []),
        (("--noise1", "2 deg/h, 0.01 rad/s"), ["noise1"]),
        (("--noise1", "p: 2 deg/h, 0.01 rad/s"), ["white"]),
        (("--rate-random-walk", "1 deg/h/sqrt(h)"), ["rate_random_walk"]),
    ],
)
def test_a_gyro_of_which_no_noise_is_given_has_white_noise(
    command: Command, tmp_path: Path, options: tuple[str, ...], terms: list[str]
) -> None:
    short = ("--dwell", "1 s", "--rate", 20)
    for simulation, length in (("rate_table", short), ("static", ("--hours", 0.1))):
        made = command("simulate", simulation, tmp_path / "run.csv", *options, *length)
        assert made.returncode == ExitCode.PASS, made.stderr
        truth = json.loads((tmp_path / "run.truth.json").read_text())
        gyros = truth["gyros" if simulation == "rate_table" else "axes"]
        assert [term["model"] for term in gyros["q"]["terms"]] == terms


@pytest.mark.parametrize(
    "options",
    [
        ("rate_table",),
        ("rate_table", "--method", "turns"),
        ("rate_table", "--method", "positions", "--latitude", "55 deg"),
        ("static", "--hours", "1"),
    ],
)
def test_what_is_simulated_by_default_runs(
    command: Command, tmp_path: Path, options: tuple[str, ...]
) -> None:
    made = command("simulate", options[0], tmp_path / "run.csv", *options[1:])
    assert made.returncode == ExitCode.PASS, made.stderr
    ran = command("run", tmp_path / "run.csv", "--out", tmp_path / "out")
    assert ran.returncode == ExitCode.PASS, ran.stderr


@pytest.mark.parametrize("method", ["rates", "turns", "positions"])
def test_the_plan_beside_it_is_run_as_it_is(command: Command, tmp_path: Path, method: str) -> None:
    # gyros so good that they see the Earth turn, and the positions tell their scale factors
    quiet = ["--white", "1e-5 deg/sqrt(h)", "--latitude", "55 deg", "--rate", 20]
    if method != "rates":
        quiet += ["--rest", "10 s"]
    made = command("simulate", "rate_table", tmp_path / "run.mcap", "--method", method, *quiet)
    assert made.returncode == ExitCode.PASS, made.stderr
    ran = command("run", tmp_path / "run.mcap", "--out", tmp_path / "out")
    assert ran.returncode == ExitCode.PASS, ran.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--axes", "x"), ["--axes", "some of p, q, r"]),
        (("--axes", "p", "--bias", "q: 1 deg/h"), ["--bias", "'q'", "--axes"]),
        (("--mounting", "up"), ["--mounting", "one of p, q, r, -p, -q, -r", "'up'"]),
        (("--mounting", "p", "--mounting", "p"), ["a name of its own for each"]),
        (("--rates", "10 20"), ["--rates", "unit of angular rate"]),
        (("--rates", "0 deg/s"), ["one rate other than 0"]),
        (("--acceleration", "5 deg/s"), ["--acceleration", "deg/s/s"]),
        (("--asymmetry", "200"), ["--asymmetry", "ppm"]),
        (("--nonlinearity", "150 ppm"), ["--nonlinearity", "'3 150 ppm'"]),
        (("--nonlinearity", "1 150 ppm"), ["orders from 2 to 5"]),
        (("--nonlinearity", "7 10 ppm"), ["orders from 2 to 5", "of order 7"]),
        (("--method", "positions"), ["--latitude", "for six positions"]),
        (("--method", "turns", "--turns", "0 10 deg"), ["turns", "angles other than 0"]),
        (("--method", "turns", "--rates", "10 deg/s"), ["--rates", "only beside --method rates"]),
        (("--method", "positions", "--turns", "10 deg"), ["--turns", "only beside --method turns"]),
        (("--rest", "10 s"), ["--rest", "only beside --method turns or positions"]),
        (("--bias-temperature", "5 deg/h/K"), ["--bias-temperature", "no --temperature"]),
        (("--scale-factor-temperature", "5 ppm/K"), ["--scale-factor-temperature", "no --temperature"]),
        (("--misalignment", "1 mrad"), ["--misalignment", "2 numbers"]),
        (("--temperature", "20 degC"), ["--temperature", "TIME:VALUE"]),
        (("--temperature", "0:20 rad"), ["--temperature", "unit of temperature"]),
        (("--temperature", "0:-300 degC"), ["profile", "at least 0"]),
        (("--latitude", "95 deg"), ["--latitude", "from -90 to 90 deg", "'95 deg'"]),
        (("--latitude", "50 deg", "--tilt", "-1 deg"), ["--tilt", "from 0 to 180 deg", "'-1 deg'"]),
        (("--heading", "1 deg"), ["--heading", "no --latitude"]),
        (("--table", "table_rate", "--wrapped"), ["record the table's angle"]),
        (("--table", "table_rate", "--table-noise", "1 arcsec"), ["--table-noise", "unit of angular rate"]),
        (("--as-counts",), ["the counts a turn"]),
        (("--clock-offset", 100), ["clock_offset", "half of the pause"]),
    ],
)
def test_a_wrong_option_gives_one_line(
    command: Command, tmp_path: Path, options: tuple[object, ...], words: list[str]
) -> None:
    refused = command("simulate", "rate_table", tmp_path / "run.mcap", *options)
    assert refused.returncode == ExitCode.USAGE
    assert len(refused.stderr.splitlines()) == 1, refused.stderr
    for word in words:
        assert word in refused.stderr
    assert not (tmp_path / "run.mcap").exists()
