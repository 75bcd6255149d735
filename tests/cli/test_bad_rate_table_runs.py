"""Recordings of a rate table that cannot be calibrated, through the real command: one line, and its code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from in_process import Completed
from rate_table_stand import RATES, Stand, write_text

Command = Callable[..., Completed]

ONE = Stand(channels="r")


def replaced(recording: Path, old: str, new: str) -> None:
    plan = recording.with_suffix(".toml")
    text = plan.read_text(encoding="utf-8")
    assert old in text
    plan.write_text(text.replace(old, new), encoding="utf-8")


def refused(command: Command, recording: Path, code: int, *words: str) -> None:
    done = command("run", recording, "--out", recording.parent / "out")
    assert done.returncode == code, done.stderr + done.stdout
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("gyrostand: ")
    for word in words:
        assert word in done.stderr, done.stderr
    assert not list((recording.parent / "out").rglob("*.parquet"))


def test_a_sound_recording_is_judged(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", ONE)
    plan = recording.with_suffix(".toml")
    limits = (
        '\n[[limits]]\nmetric = "scale_factor_error"\nchannel = "r"\nupper = 2000\nlower = -2000\n'
        '\n[[limits]]\nmetric = "misalignment"\nchannel = "rp"\nupper = 2000\n'
    )
    plan.write_text(plan.read_text(encoding="utf-8") + limits, encoding="utf-8")
    done = gyrostand("run", recording, "--out", tmp_path / "out")
    # 1000 ppm lie within 2000; of a misalignment one gyro about its own axis tells nothing
    assert done.returncode == 1, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    assert ["pass", "r", "scale_factor_error"] in [line[:3] for line in lines]
    assert "not evaluated rp misalignment = none" in done.stdout


def test_no_table_rate(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", ONE)
    plan = recording.with_suffix(".toml")
    text = plan.read_text(encoding="utf-8")
    plan.write_text(text[: text.index("[streams.turntable]")], encoding="utf-8")
    refused(gyrostand, recording, 2, "streams.turntable", "the method 'rates'", "add [streams.turntable]")


def test_rpm_is_not_said(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", ONE)
    replaced(recording, ', unit = "rpm"', "")
    refused(gyrostand, recording, 2, "run.toml:15", "streams.turntable.channels.rate", "'unit'")
    replaced(recording, 'field = "table"', 'field = "table", unit = ""')
    refused(gyrostand, recording, 2, "a unit of angular rate", "'', not filled in", "rpm")


def test_rpm_said_to_be_something_else(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", ONE)
    replaced(recording, 'unit = "rpm"', 'unit = "deg/s"')
    words = ("found 6.0", "the table's rate looks like rpm where deg/s is stated", "correct the unit")
    refused(gyrostand, recording, 2, *words)


def test_fewer_steps_than_unknowns(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", Stand(channels="r", rates=RATES[:3]))
    plan = recording.with_suffix(".toml")
    plan.write_text(plan.read_text(encoding="utf-8") + "\n[calibrate]\nnonlinearity = [2, 3]\n")
    refused(gyrostand, recording, 1, "at least 5 steps for bias, scale_factor", "found 3", "fewer terms")


def test_a_table_that_never_turns(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", Stand(channels="r", rates=np.zeros(3)))
    refused(gyrostand, recording, 1, "a table that turns", "stays within 0 deg", "unit and scale")


def test_a_gyro_that_does_not_follow(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", Stand(channels="r", gain=1e-5))
    refused(gyrostand, recording, 1, "a gyro that follows the table", "check that the gyro was on the table")


def test_several_channels_without_an_axis(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", Stand())
    refused(gyrostand, recording, 2, "which of its axes lies along the table's", "add [[runs]]")
    plan = recording.with_suffix(".toml")
    plan.write_text(plan.read_text(encoding="utf-8") + '\n[[runs]]\nname = "a"\naxis = "q"\n')
    refused(gyrostand, recording, 1, "run 'a', gyro q against the table", "of r", "correct axis of the run")


def test_a_gyro_whose_record_is_constant(gyrostand: Command, tmp_path: Path) -> None:
    recording = write_text(tmp_path / "run.csv", Stand(channels="r", gain=0.0))
    refused(gyrostand, recording, 1, "a gyro that follows the table", "gives 0 deg/s throughout")
