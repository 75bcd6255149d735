"""Plans of drift that are wrong, or do not fit the recording: one line each, through the real command."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.errors import ExitCode

Command = Callable[..., subprocess.CompletedProcess[str]]

PLAN = """\
procedure = "drift"

[stand]
latitude_deg = 55.75
scheme = "polar"

[time]
field = "t"
unit = "min"

[streams.gimbal]
quantity = "gimbal_angles"
channels.alpha1 = { field = "outer", unit = "deg", wraps_at = 360 }
channels.alpha2 = { field = "inner", unit = "deg" }

[[runs]]
name = "first"
stop = 1800

[[runs]]
name = "second"
start = 1800

[[runs]]
name = "third"
recording = "run8.csv"
scheme = "vertical"
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """An hour of a gimbal at a sample a minute, its plan, and the further recording that the plan names."""
    rows = [f"{k},{(350 + k) % 360},{0.1 * k:.6g}" for k in range(60)]
    for name in ("run7.csv", "run8.csv"):
        (tmp_path / name).write_text("\n".join(["t,outer,inner", *rows]) + "\n")
    (tmp_path / "run7.toml").write_text(PLAN)
    return tmp_path / "run7.csv"


def refused(result: subprocess.CompletedProcess[str], code: ExitCode, *words: str) -> None:
    """One line on standard error, with these words, and this exit code."""
    assert result.returncode == code, (result.returncode, result.stderr, result.stdout)
    (line,) = result.stderr.strip().splitlines()
    assert "internal fault" not in line
    for word in words:
        assert word in line, line


def test_the_plan_is_sound(gyrostand: Command, recording: Path) -> None:
    result = gyrostand("plan", "check", recording.with_suffix(".toml"))
    assert result.returncode == ExitCode.PASS, result.stderr
    assert "procedure drift, streams gimbal" in result.stdout


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        ("latitude_deg = 55.75\n", "", ExitCode.USAGE, ["run7.toml:3: stand", "latitude_deg", "to [stand]"]),
        ("= 55.75", "= 95.75", ExitCode.USAGE, ["run7.toml:4: stand.latitude_deg", "at most 90", "95.75"]),
        ('scheme = "polar"\n', "", ExitCode.USAGE, ["run7.toml:3: stand", "scheme or chi_deg"]),
        ('"polar"', '"poler"', ExitCode.USAGE, ["run7.toml:5: stand.scheme", "did you mean 'polar'?"]),
        (
            '"vertical"',
            '"upright"',
            ExitCode.USAGE,
            ["run7.toml:27: runs[3].scheme", "'upright'", "'vertical'"],
        ),
        ("start = 1800", "start = 1700", ExitCode.USAGE, ["run7.toml:20: runs[2]", "do not overlap"]),
        ('"run8.csv"', '"../run8.csv"', ExitCode.USAGE, ["run7.toml:26: runs[3].recording", "bare name"]),
        ('"run8.csv"', '"run9.csv"', ExitCode.INPUT, ["run9.csv", "[[runs]]", "did you mean 'run8.csv'?"]),
        ('"run8.csv"', '"run7.csv"', ExitCode.USAGE, ["run7.csv", "leave recording = 'run7.csv' out"]),
        ("start = 1800", "start = 7200", ExitCode.USAGE, ["the run 'second', from 7200 s on", "0 to 3540 s"]),
        ("wraps_at = 360", "wraps_at = 90", ExitCode.USAGE, ["channel 'alpha1'", "correct wraps_at"]),
        ('"inner"', '"iner"', ExitCode.USAGE, ["'iner'", "did you mean 'inner'?"]),
    ],
)
def test_a_wrong_plan(
    gyrostand: Command, recording: Path, old: str, new: str, code: ExitCode, words: list[str]
) -> None:
    assert old in PLAN
    recording.with_suffix(".toml").write_text(PLAN.replace(old, new, 1))
    refused(gyrostand("run", recording, "--out", recording.parent / "out"), code, *words)
    assert not list(recording.parent.rglob("*.parquet"))


@pytest.mark.parametrize(
    ("content", "code", "words"),
    [
        ("", ExitCode.INPUT, ["run8.csv", "an empty file"]),
        ("t,outer,inner\n", ExitCode.INPUT, ["run8.csv"]),
        ("t,outer,middle\n0,1,2\n1,1,2\n", ExitCode.USAGE, ["run8.csv", "'inner'"]),
    ],
)
def test_a_further_recording_that_cannot_serve(
    gyrostand: Command, recording: Path, content: str, code: ExitCode, words: list[str]
) -> None:
    recording.with_name("run8.csv").write_text(content)
    refused(gyrostand("run", recording, "--out", recording.parent / "out"), code, *words)


def test_a_part_of_another_recording_is_judged_with_it_alone(gyrostand: Command, recording: Path) -> None:
    result = gyrostand("discover", recording.parent, "--out", recording.parent / "build")
    assert result.returncode == ExitCode.PASS, result.stderr
    assert [p.name for p in (recording.parent / "build" / ".recordings").iterdir()] == ["run7.json"]


def test_discover_names_a_recording_without_a_plan_and_lists_the_others(
    gyrostand: Command, recording: Path
) -> None:
    (recording.parent / "stray.csv").write_text("t\n0\n")
    build = recording.parent / "build"
    refused(gyrostand("discover", recording.parent, "--out", build), ExitCode.USAGE, "stray.csv", "plan init")
    assert "pages: report/run7.html" in (build / "recordings.mk").read_text()
