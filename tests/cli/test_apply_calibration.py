"""A calibration from a rate table to the record that it corrects, by the commands that a user types."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from pipeline import storage
from pipeline.errors import ExitCode
from pipeline.models.coning import ConingMotion

Command = Callable[..., subprocess.CompletedProcess[str]]
NAME = "gyro7.calibration.json"
TABLE = (
    "--rate", 20, "--table-rate", 20, "--dwell", "8 s", "--acceleration", "200 deg/s/s", "--pause", "10 s",
    "--scale-factor-error", "p: 3000 ppm", "--scale-factor-error", "r: -0.2 %", "--bias", "q: 0.05 deg/s",
    "--misalignment", "2 -3 mrad", "--white", "0.1 deg/sqrt(h)", "--latitude", "56 deg",
    "--clock-offset", 0.02,
)  # fmt: skip


class Calibrated(NamedTuple):
    folder: Path
    """Of ``table.mcap``, the output folder ``out``, and the calibration."""
    truth: dict[str, Any]


@pytest.fixture(scope="session")
def calibrated(gyrostand: Command, tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    folder = tmp_path_factory.mktemp("table")
    made = gyrostand("simulate", "rate_table", folder / "table.mcap", *TABLE, "--seed", 4)
    assert made.returncode == ExitCode.PASS, made.stderr
    ran = gyrostand("run", folder / "table.mcap", "--out", folder / "out")
    assert ran.returncode == ExitCode.PASS, ran.stderr
    exported = gyrostand("calibration", "export", folder / "out", "--recording", "table")
    assert exported.returncode == ExitCode.PASS, exported.stderr
    (folder / NAME).write_text(exported.stdout, encoding="utf-8")
    return Calibrated(folder, json.loads((folder / "table.truth.json").read_text()))


@pytest.fixture
def recording(csv_recording: Path, calibrated: Calibrated) -> Path:
    """The coning of `csv_recording`, by the gyros of the table, with a plan that names their calibration."""
    S = np.array(calibrated.truth["sensitivity"])
    bias = [calibrated.truth["gyros"][axis]["bias"] for axis in "pqr"]
    table = np.loadtxt(csv_recording, delimiter=",", skiprows=1)
    table[:, 1:4] = table[:, 1:4] @ S.T + bias
    np.savetxt(
        csv_recording, table, delimiter=",", header="time,p,q,r,psi,theta,gamma", comments="", fmt="%.17g"
    )
    plan = csv_recording.with_suffix(".toml")
    text = plan.read_text().replace("[streams.gyro]\n", f'[streams.gyro]\ncalibration = "{NAME}"\n')
    plan.write_text(text, encoding="utf-8")
    shutil.copy(calibrated.folder / NAME, csv_recording.parent)
    return csv_recording


def test_rates_are_those_of_the_truth_within_the_calibration_s_errors(
    gyrostand: Command, recording: Path, calibrated: Calibrated, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    ran = gyrostand("run", recording, "--out", out)
    assert ran.returncode == ExitCode.PASS, ran.stderr
    motion = ConingMotion(cone_angle=np.radians(1.0), frequency=5.0)
    exact = motion.rates(np.arange(201) / 100)
    gyro = storage.read(out, "run1", "gyro")
    found = np.column_stack([gyro.column(axis).to_numpy() for axis in "pqr"])
    recorded = np.loadtxt(recording, delimiter=",", skiprows=1)[:, 1:4]
    (said,) = (
        row for row in storage.read(out, "run1", "findings").to_pylist() if row["kind"] == "calibrated"
    )
    stated = [
        float(part.split()[-4]) for part in said["detail"].split("at most ")[1].split(";")[0].split(",")
    ]
    error = np.abs(found - exact).max(axis=0)
    # each is one error throughout, of the standard deviation stated at the largest rate: four of it
    assert np.all(error < 4 * np.array(stated))
    # biases of 9e-4 rad/s, and 2 to 3 mrad of a rate of 0.5 rad/s, before
    assert np.abs(recorded - exact).max() > 10 * error.max()

    (first, *_) = storage.read(out, "run1", "provenance").to_pylist()
    source = storage.read(calibrated.folder / "out", "table", "provenance").to_pylist()[0]
    assert first["calibration_name"] == NAME
    assert first["calibration_sha256"] == hashlib.sha256((recording.parent / NAME).read_bytes()).hexdigest()
    assert first["calibration_recording"] == "table"
    assert first["calibration_recording_sha256"] == source["recording_sha256"]
    assert source["calibration_sha256"] is None
    for word in (NAME, "'table'", "by rates", "a time offset is not applied"):
        assert word in said["detail"]
    page = gyrostand("report", out)
    assert page.returncode == ExitCode.PASS, page.stderr
    assert first["calibration_sha256"] in (out / "report" / "run1.html").read_text()


def test_a_record_is_made_anew_when_its_calibration_changes(
    command: Command, recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"

    def run() -> str:
        discovered = command("discover", recording.parent, "--out", out)
        assert discovered.returncode == ExitCode.PASS, discovered.stderr
        ran = command("run", recording, "--out", out)
        assert ran.returncode == ExitCode.PASS, ran.stderr
        return (out / ".recordings" / "run1.json").read_text()

    first = run()
    assert NAME in first
    assert "up to date" in command("run", recording, "--out", out).stdout
    calibration = recording.parent / NAME
    calibration.write_text(calibration.read_text().replace('"made_with": "', '"made_with": "my '))
    assert "up to date" not in command("run", recording, "--out", out).stdout
    assert run() != first


def one_line(refused: subprocess.CompletedProcess[str], code: ExitCode, *words: str) -> None:
    assert refused.returncode == code, refused.stderr
    assert len(refused.stderr.splitlines()) == 1, refused.stderr
    for word in words:
        assert word in refused.stderr


def test_a_calibration_that_is_not_there_is_a_fault_of_the_plan_s_line(
    command: Command, recording: Path, tmp_path: Path
) -> None:
    (recording.parent / NAME).rename(recording.parent / "gyro8.calibration.json")
    line = recording.with_suffix(".toml").read_text().splitlines().index(f'calibration = "{NAME}"') + 1
    words = (f"run1.toml:{line}: streams.gyro.calibration", NAME, "did you mean 'gyro8.calibration.json'?")
    one_line(command("run", recording, "--out", tmp_path / "out"), ExitCode.USAGE, *words)
    one_line(command("validate", recording), ExitCode.USAGE, *words)
    one_line(command("plan", "check", recording.with_suffix(".toml")), ExitCode.USAGE, *words)


def test_a_calibration_that_is_no_bare_name_is_one_too(command: Command, recording: Path) -> None:
    plan = recording.with_suffix(".toml")
    plan.write_text(plan.read_text().replace(NAME, f"../{NAME}"))
    refused = command("plan", "check", plan)
    one_line(
        refused, ExitCode.USAGE, "streams.gyro.calibration", "the bare name of a file beside the recording"
    )


def test_a_damaged_calibration_gives_one_line(command: Command, recording: Path, tmp_path: Path) -> None:
    calibration = recording.parent / NAME
    calibration.write_text(calibration.read_text()[:700])
    refused = command("run", recording, "--out", tmp_path / "out")
    one_line(refused, ExitCode.INPUT, NAME, "JSON", "calibration export")
    assert not (tmp_path / "out" / "gyro").exists()


class TestExport:
    def test_the_only_calibration_needs_no_name(self, command: Command, calibrated: Calibrated) -> None:
        exported = command("calibration", "export", calibrated.folder / "out")
        assert exported.returncode == ExitCode.PASS, exported.stderr
        assert exported.stdout == (calibrated.folder / NAME).read_text()
        model = json.loads(exported.stdout)["models"][0]
        truth = np.array(calibrated.truth["sensitivity"]).ravel()
        values = np.array([one["value"] for one in model["parameters"]])
        errors = np.array([one["standard_error"] for one in model["parameters"]])
        # nine normal deviates, the seed chosen before anything was seen: less than one in 1e4 beyond 4.5
        assert np.all(np.abs(values[:9] - truth) < 4.5 * errors[:9])

    def test_of_none_and_of_several(
        self, command: Command, calibrated: Calibrated, csv_recording: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "out"
        command("run", csv_recording, "--out", out)
        one_line(command("calibration", "export", out), ExitCode.INPUT, "'rate_table'")
        for name in ("one", "two"):
            command("run", calibrated.folder / "table.mcap", "--out", out, "--id", name)
        one_line(command("calibration", "export", out), ExitCode.USAGE, "one, two", "--recording")
        one_line(
            command("calibration", "export", out, "--recording", "run1"),
            ExitCode.INPUT,
            "table calibration",
        )
        one_line(
            command("calibration", "export", out, "--recording", "nine"),
            ExitCode.INPUT,
            "the recording 'nine'",
            "one, two",
        )

    def test_a_damaged_table(self, command: Command, calibrated: Calibrated, tmp_path: Path) -> None:
        out = tmp_path / "out"
        shutil.copytree(calibrated.folder / "out", out)
        for table in ("calibration", "calibration_covariance"):
            path = storage.table_file(out, "table", table)
            whole = path.read_bytes()
            half = len(whole) // 2
            path.write_bytes(whole[:half] + bytes([whole[half] ^ 1]) + whole[half + 1 :])
            one_line(command("calibration", "export", out), ExitCode.NOT_MET, f"{table}/recording=table")
            path.write_bytes(whole)

    def test_what_two_mountings_do_not_tell(self, command: Command, tmp_path: Path) -> None:
        table = tmp_path / "table.mcap"
        command("simulate", "rate_table", table, *TABLE, "--mounting", "p", "--mounting", "q")
        ran = command("run", table, "--out", tmp_path / "out")
        assert ran.returncode == ExitCode.PASS, ran.stderr
        refused = command("calibration", "export", tmp_path / "out")
        words = (
            "none of scale_factor_asymmetry_r of the triad, and S13, S23, S33 of",
            "rotation about all axes",
        )
        one_line(refused, ExitCode.NOT_MET, *words)

    def test_what_turns_by_hand_tell_weakly_is_exported_with_its_error(
        self, command: Command, tmp_path: Path
    ) -> None:
        table = tmp_path / "table.mcap"
        by_hand = ("--method", "turns", "--turns", "90 deg", "--rate", 20, "--white", "0.1 deg/sqrt(h)")
        errors = ("--orientation-error", "1 deg", "--angle-error", "1 deg")
        command("simulate", "rate_table", table, *by_hand, *errors)
        ran = command("run", table, "--out", tmp_path / "out")
        assert ran.returncode == ExitCode.PASS, ran.stderr
        exported = command("calibration", "export", tmp_path / "out")
        one_line(exported, ExitCode.PASS, "gyrostand: warning", "in combination only", "S12", "S32")
        assert "bias" not in exported.stderr
        told = {
            one["name"]: one["standard_error"]
            for model in json.loads(exported.stdout)["models"]
            for one in model["parameters"]
        }
        # one turn about each axis, whose direction is known to a degree
        assert told["S12"] == pytest.approx(np.radians(1), rel=0.05)

    @pytest.mark.parametrize(
        ("key", "value", "words"),
        [
            ("rotation", "[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]", "turned to other axes"),
            ("calibration", f'"{NAME}"', "corrected by a calibration"),
        ],
    )
    def test_of_outputs_that_were_not_the_gyro_s_own(
        self, command: Command, calibrated: Calibrated, tmp_path: Path, key: str, value: str, words: str
    ) -> None:
        for name in ("table.mcap", "table.toml", NAME):
            shutil.copy(calibrated.folder / name, tmp_path)
        plan = tmp_path / "table.toml"
        numbers = value.replace("0", "0.0").replace("1", "1.0") if key == "rotation" else value
        plan.write_text(plan.read_text().replace("[streams.gyro]\n", f"[streams.gyro]\n{key} = {numbers}\n"))
        if key == "rotation":  # p is q's before: the runs say which axis of the turned case was up
            text = plan.read_text()
            for axis in ("axis", "across"):
                text = text.replace(f'{axis} = "p"', f'{axis} = "-Q"').replace(
                    f'{axis} = "q"', f'{axis} = "p"'
                )
            plan.write_text(text.replace('"-Q"', '"-q"'))
        ran = command("run", tmp_path / "table.mcap", "--out", tmp_path / "out")
        assert ran.returncode == ExitCode.PASS, ran.stderr
        refused = command("calibration", "export", tmp_path / "out")
        one_line(refused, ExitCode.USAGE, words, f"remove {key} from [streams.gyro]")
