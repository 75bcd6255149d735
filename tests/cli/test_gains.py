"""The command ``gains``: what it prints, and what it refuses."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

Command = Callable[..., subprocess.CompletedProcess[str]]

PRINTED = "--preset", "printed"


def test_it_prints_limits_poles_damping_settling_and_noise(gyrostand: Command) -> None:
    result = gyrostand("gains", *PRINTED)
    assert result.returncode == 0, result.stderr
    text = result.stdout
    for limit in ("1.3333", "0.1875", "0.8499"):
        assert f"k_n < {limit} 1/s" in text
    for word in ("poles", "damping", "settling time", "spectral radius", "noise gain"):
        assert word in text
    assert "attitude, compared each 0.01 s" in text
    assert "T_U = 3 s, k_U = 3, K_U = 1 1/s, k_omega = 0.02 1/s" in text


def test_json_holds_the_same(gyrostand: Command) -> None:
    loops = {loop["loop"]: loop for loop in json.loads(gyrostand("gains", "--json").stdout)}
    both = loops["position and velocity by satellites"]
    assert both["gains"]["K"] == {"value": pytest.approx(1 / 3), "unit": "1/s"}
    assert len(both["poles"]) == 5
    assert both["spectral_radius"] == pytest.approx(0.979, abs=1e-3)  # stated with three decimals
    assert {(n["from"], n["to"]) for n in both["noise_gain"]} == {
        (a, b) for a in ("position", "velocity") for b in ("position", "velocity")
    }
    assert loops["velocity by air data"]["bias"] == "frozen"
    assert loops["velocity by air data"]["limit"] is None


def test_unstable_gains_are_printed_and_refused(gyrostand: Command) -> None:
    result = gyrostand("gains", "--json", "--gain", "satellites.k_n=0.3")
    assert result.returncode == 2
    both = json.loads(result.stdout)[2]
    assert both["settling_time"] == {"value": None, "unit": "s"}
    assert "expected k_n < 0.0625 1/s (Routh), found 0.3 1/s" in result.stderr
    assert result.stderr.count("\n") == 1


def test_held_differences_are_refused_with_their_radius(gyrostand: Command) -> None:
    result = gyrostand("gains", *PRINTED, "--references", "held_difference")
    assert result.returncode == 2
    assert "spectral radius  1.0291: NOT STABLE" in result.stdout
    assert "propagate the references" in result.stderr
    seldom = gyrostand("gains", *PRINTED, "--references", "held_difference", "--interval", "0.1")
    assert seldom.returncode == 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("satellites.k_x=1", "NAME of T, T_V, k_L"),
        ("wind.T=1", "GROUP of satellites, air, attitude"),
        ("air.K", "GROUP.NAME=VALUE"),
        ("air.K=nan", "GROUP.NAME=VALUE"),
        ("satellites.T=0", "T > 0"),
        ("attitude.T_U=1e-200", "T_U from 1e-09 to 1e+06"),
    ],
)
def test_a_gain_that_is_none_is_refused(gyrostand: Command, text: str, complaint: str) -> None:
    result = gyrostand("gains", "--gain", text)
    assert result.returncode == 2
    assert complaint in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_loop_that_overflows_is_unstable(gyrostand: Command) -> None:
    result = gyrostand("gains", "--json", "--gain", "satellites.k_V=1e6")
    assert result.returncode == 2
    assert json.loads(result.stdout)[0]["spectral_radius"] is None
    assert "found inf" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("option", ["--rate", "--interval"])
def test_a_time_without_end_is_refused(gyrostand: Command, option: str) -> None:
    result = gyrostand("gains", option, "inf")
    assert result.returncode == 2
    assert "less than or equal to 1000000" in result.stderr


def test_a_plan_of_another_procedure_is_refused(gyrostand: Command, csv_recording: Path) -> None:
    result = gyrostand("gains", csv_recording.with_suffix(".toml"))
    assert result.returncode == 2
    assert "procedure navigation, found procedure coning" in result.stderr


def test_a_plan_says_its_gains_and_references(gyrostand: Command, tmp_path: Path) -> None:
    plan = tmp_path / "flight.toml"
    streams = {
        "gyro": ("angular_rate", "p q r", "rad/s"),
        "accelerometer": ("specific_force", "x y z", "m/s^2"),
    }
    lines = ['procedure = "navigation"', "[time]", 'field = "time"', 'unit = "s"']
    for stream, (quantity, channels, unit) in streams.items():
        lines += [f"[streams.{stream}]", f'quantity = "{quantity}"']
        lines += [f'channels.{c} = {{ field = "{stream}_{c}", unit = "{unit}" }}' for c in channels.split()]
    lines += ["[navigate.loops]", 'gains = "printed"', 'references = "held_difference"']
    plan.write_text("\n".join(lines) + "\n", encoding="utf-8")
    refused = gyrostand("gains", plan)
    assert refused.returncode == 2
    assert "references 'held_difference'" in refused.stderr
    assert "gains            T_V = 3 s, k_V = 3, K = 1 1/s, k_n = 0.02 1/s" in refused.stdout
    # Options say otherwise.
    assert gyrostand("gains", plan, "--references", "propagated").returncode == 0
    tuned = gyrostand("gains", plan, "--preset", "tuned")
    assert tuned.returncode == 0  # slow enough for held differences, which the plan still asks for
    assert "spectral radius  0.9789" in tuned.stdout
