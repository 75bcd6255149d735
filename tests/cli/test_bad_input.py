"""Every kind of bad input gives one clear line and the right exit code, through the real command."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.errors import ExitCode

Command = Callable[..., subprocess.CompletedProcess[str]]


def refused(result: subprocess.CompletedProcess[str], code: ExitCode, *words: str) -> None:
    """One line on standard error, with these words, and this exit code."""
    assert result.returncode == code, (result.returncode, result.stderr, result.stdout)
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert "Traceback" not in result.stderr
    assert "internal fault" not in result.stderr
    for word in words:
        assert word in lines[0], lines[0]


def edit(plan: Path, old: str, new: str) -> None:
    text = plan.read_text()
    assert old in text
    plan.write_text(text.replace(old, new))


def keep_rows(recording: Path, keep: Callable[[list[str]], list[str]]) -> None:
    header, *rows = recording.read_text().splitlines()
    recording.write_text("\n".join([header, *keep(rows)]) + "\n")


def test_more_than_the_memory_holds_is_a_fault_of_the_machine(gyrostand: Command, tmp_path: Path) -> None:
    result = gyrostand("simulate", "static", tmp_path / "long.csv", "--hours", "1e12")
    refused(result, ExitCode.FAULT, "memory", "fewer samples")


def test_the_sound_recording_passes(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    result = gyrostand("run", csv_recording, "--out", tmp_path / "out")
    assert result.returncode == ExitCode.PASS, result.stderr
    assert (tmp_path / "out/metrics/recording=run1/part-0.parquet").is_file()
    assert (tmp_path / "out/provenance/recording=run1/part-0.parquet").is_file()


def test_missing_file(gyrostand: Command, tmp_path: Path) -> None:
    refused(gyrostand("run", tmp_path / "none.mcap", "--out", tmp_path / "o"), ExitCode.INPUT, "none.mcap")
    refused(gyrostand("inspect", tmp_path / "none.mcap"), ExitCode.INPUT, "none.mcap")


def test_empty_file(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    csv_recording.write_bytes(b"")
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.INPUT, "run1.csv", "empty")


def test_wrong_format(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    disguised = tmp_path / "run1.mcap"
    disguised.write_bytes(bytes(range(256)) * 10)
    refused(gyrostand("run", disguised, "--out", tmp_path / "o"), ExitCode.INPUT, "run1.mcap")


def test_no_input_is_never_a_pass(gyrostand: Command, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    refused(gyrostand("validate", tmp_path / "empty"), ExitCode.INPUT)
    refused(gyrostand("discover", tmp_path / "empty", "--out", tmp_path / "o"), ExitCode.INPUT)
    refused(gyrostand("check", tmp_path / "empty"), ExitCode.INPUT)
    refused(gyrostand("verdicts", tmp_path / "empty"), ExitCode.INPUT)
    refused(gyrostand("report", tmp_path / "empty"), ExitCode.INPUT)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('field = "q"', 'field = "qq"', ["qq", "did you mean"]),
        ('field = "p", unit = "rad/s"', 'field = "p"', ["unit"]),
        ('field = "p", unit = "rad/s"', 'field = "p", unit = "rads/s"', ["rads/s", "rad/s"]),
        ('[time]\nfield = "time"\nunit = "s"\n', "", ["time"]),
        ("[streams.gyro]", "[streams.gyro]\nquantty = 1", ["quantty", "quantity"]),
        (
            "[streams.reference]",
            "[streams.gyro2]",
            ["gyro2", "gyro"],
        ),
        (
            'quantity = "angular_rate"',
            'quantity = "angular_rate"\nrotation = [[1, 0, 0], [0, 1, 0.1], [0, 0, 1]]',
            ["rotation", "orthonormal"],
        ),
        ('procedure = "coning"', 'procedure = "conning"', ["conning", "coning"]),
        ('procedure = "coning"', 'procedure = "coning', ["run1.toml:1"]),
    ],
)
def test_wrong_test_plan(
    gyrostand: Command, csv_recording: Path, tmp_path: Path, old: str, new: str, words: list[str]
) -> None:
    edit(csv_recording.with_suffix(".toml"), old, new)
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.USAGE, *words)
    assert not list((tmp_path / "o").rglob("*.parquet"))


def test_no_test_plan(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    csv_recording.with_suffix(".toml").unlink()
    refused(
        gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.USAGE, "run1.toml", "plan init"
    )


def test_all_nan(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    keep_rows(
        csv_recording,
        lambda rows: [",".join([r.split(",")[0], "nan", "nan", "nan", *r.split(",")[4:]]) for r in rows],
    )
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.INPUT, "gyro")


def test_one_sample(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    keep_rows(csv_recording, lambda rows: rows[:1])
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.INPUT, "gyro")


def test_header_without_rows(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    keep_rows(csv_recording, lambda rows: [])
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.INPUT)


def test_no_common_time(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    def apart(rows: list[str]) -> list[str]:
        gyro = [",".join([*r.split(",")[:4], "", "", ""]) for r in rows]
        reference = [
            ",".join([str(float(r.split(",")[0]) + 100), "", "", "", *r.split(",")[4:]]) for r in rows
        ]
        return gyro + reference

    keep_rows(csv_recording, apart)
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.INPUT, "reference")


def test_output_folder_not_writable(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "file" / "out"), ExitCode.USAGE, "file")


def test_disk_full(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=32k", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if os.geteuid() != 0 or mount.returncode != 0:
        pytest.skip("a full disk needs the right to mount one")
    try:
        refused(gyrostand("run", csv_recording, "--out", disk / "out"), ExitCode.FAULT, "space")
        assert not list(disk.rglob("recording=*/part-0.parquet")) or not (disk / "out/provenance").is_dir()
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_limit_not_met(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    plan = csv_recording.with_suffix(".toml")
    plan.write_text(
        plan.read_text() + '\n[[limits]]\nmetric = "relative_rms_error"\nchannel = "psi"\nupper = 1e-12\n'
    )
    result = gyrostand("run", csv_recording, "--out", tmp_path / "o")
    assert result.returncode == ExitCode.NOT_MET
    assert "fail" in result.stdout
    assert (tmp_path / "o/metrics/recording=run1/part-0.parquet").is_file()


def test_limit_on_an_unknown_figure(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    plan = csv_recording.with_suffix(".toml")
    plan.write_text(plan.read_text() + '\n[[limits]]\nmetric = "gap_cuont"\nchannel = "gyro"\nupper = 0.0\n')
    for command in (("run", csv_recording, "--out", tmp_path / "o"), ("validate", csv_recording)):
        refused(gyrostand(*command), ExitCode.USAGE, "run1.toml", "gap_cuont", "gap_count")


def test_limit_on_a_figure_that_is_not_there(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    plan = csv_recording.with_suffix(".toml")
    plan.write_text(
        plan.read_text() + '\n[[limits]]\nmetric = "closure_error"\nchannel = "psi"\nupper = 1.0\n'
    )
    result = gyrostand("run", csv_recording, "--out", tmp_path / "o")
    assert result.returncode == ExitCode.NOT_MET
    assert "not evaluated" in result.stdout


def test_a_damaged_recording_fails_only_when_strict(
    gyrostand: Command, csv_recording: Path, tmp_path: Path
) -> None:
    csv_recording.write_text(csv_recording.read_text() + "2.01,0.1,gar\x00bage\n")
    relaxed = gyrostand("run", csv_recording, "--out", tmp_path / "o")
    assert relaxed.returncode == ExitCode.PASS, relaxed.stderr
    assert "loss" in relaxed.stdout
    assert gyrostand("run", csv_recording, "--out", tmp_path / "o", "--strict").returncode == ExitCode.NOT_MET
    assert gyrostand("validate", csv_recording, "--strict").returncode == ExitCode.NOT_MET


def test_validate_goes_on_behind_what_it_cannot_judge(
    gyrostand: Command, csv_recording: Path, tmp_path: Path
) -> None:
    without_plan = tmp_path / "run0.csv"
    without_plan.write_bytes(csv_recording.read_bytes())
    result = gyrostand("validate", without_plan, csv_recording)
    refused(result, ExitCode.USAGE, "run0.csv", "plan init")
    assert result.stdout.startswith("run1: coning: pass")
    (tmp_path / "broken.csv").touch()
    both = gyrostand("validate", without_plan, tmp_path / "broken.csv", csv_recording)
    assert both.returncode == ExitCode.INPUT  # the graver of the two
    assert len(both.stderr.splitlines()) == 2


def test_output_folder_inside_the_recording(gyrostand: Command, tmp_path: Path) -> None:
    made = gyrostand("simulate", "coning", tmp_path / "bag", "--duration", 0.1)
    assert made.returncode == ExitCode.PASS, made.stderr
    refused(gyrostand("run", tmp_path / "bag", "--out", tmp_path / "bag" / "out"), ExitCode.USAGE, "outside")


def test_one_field_for_two_channels(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    edit(csv_recording.with_suffix(".toml"), 'field = "q"', 'field = "p"')
    refused(gyrostand("run", csv_recording, "--out", tmp_path / "o"), ExitCode.USAGE, "already feeds p")


def test_unknown_command_and_option(gyrostand: Command) -> None:
    assert gyrostand("rum").returncode == ExitCode.USAGE
    assert gyrostand("run", "--speed").returncode == ExitCode.USAGE
