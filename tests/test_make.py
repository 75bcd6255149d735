"""``make`` on real folders: odd names, parallel, incremental, and never a silent pass."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
GYROSTAND = f"{sys.executable} -m pipeline"
ODD = ["a b: 12:30 $(touch hacked) 'x'.csv", "#100%;&.csv", "2026-11-22.csv", "ünïcode.csv"]


def make(*arguments: str, recordings: Path, build: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    settings = (f"RECORDINGS={recordings}", f"BUILD={build}", f"GYROSTAND={GYROSTAND}")
    return subprocess.run(
        # -o: the environment that runs this test is already set up
        ["make", "-o", ".venv/.ready", *arguments, *settings],
        cwd=PROJECT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture
def odd_folder(csv_recording: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in ODD:
        shutil.copy(csv_recording, folder / name)
    shutil.copy(csv_recording.with_suffix(".toml"), folder / "testplan.toml")
    return folder


def test_odd_names_in_parallel_then_nothing_to_do_then_clean(odd_folder: Path, tmp_path: Path) -> None:
    build = tmp_path / "bu ild"
    first = make("-j2", recordings=odd_folder, build=build)
    assert first.returncode == 0, first.stderr + first.stdout
    assert len(list(build.glob("metrics/recording=*/part-0.parquet"))) == len(ODD)
    assert len(list(build.glob("report/*.html"))) == len(ODD) + 1
    assert not (PROJECT / "hacked").exists()

    stamps = {p: p.stat().st_mtime_ns for p in build.rglob("*.parquet")}
    again = make("-j2", recordings=odd_folder, build=build)
    assert again.returncode == 0, again.stderr
    assert {p: p.stat().st_mtime_ns for p in build.rglob("*.parquet")} == stamps

    assert make("clean", recordings=odd_folder, build=build).returncode == 0
    assert not build.exists()
    assert len(list(odd_folder.iterdir())) == len(ODD) + 1


def test_a_failed_verdict_fails_each_time(odd_folder: Path, tmp_path: Path) -> None:
    plan = odd_folder / "testplan.toml"
    plan.write_text(
        plan.read_text() + '\n[[limits]]\nmetric = "sample_count"\nchannel = "gyro"\nupper = 5.0\n'
    )
    for _ in range(2):  # the second time every table is up to date, the verdict still stands
        result = make(recordings=odd_folder, build=tmp_path / "build")
        assert result.returncode != 0
        assert "fail" in result.stdout


def test_an_unreadable_recording_fails_the_rest_goes_on(odd_folder: Path, tmp_path: Path) -> None:
    (odd_folder / "broken.mcap").write_bytes(b"not a recording")
    result = make(recordings=odd_folder, build=tmp_path / "build")
    assert result.returncode != 0
    assert "broken.mcap" in result.stderr
    assert len(list((tmp_path / "build").glob("metrics/recording=*/part-0.parquet"))) == len(ODD)


def test_a_recording_without_a_plan_fails_the_rest_goes_on(odd_folder: Path, tmp_path: Path) -> None:
    (odd_folder / "testplan.toml").rename(odd_folder / "2026-11-22.toml")
    result = make(recordings=odd_folder, build=tmp_path / "build")
    assert result.returncode != 0
    unplanned = [line for line in result.stderr.splitlines() if "plan init" in line]
    assert len(unplanned) == len(ODD) - 1
    assert [p.name for p in (tmp_path / "build" / "metrics").iterdir()] == ["recording=rec-2026-11-22"]
    assert "rec-2026-11-22: coning: pass" in result.stdout
    (odd_folder / "2026-11-22.toml").rename(odd_folder / "testplan.toml")
    assert make(recordings=odd_folder, build=tmp_path / "build").returncode == 0


def test_validate(odd_folder: Path, tmp_path: Path) -> None:
    assert make("validate", recordings=odd_folder, build=tmp_path / "build").returncode == 0
    assert not (tmp_path / "build").exists()


def test_validate_judges_all_and_tells_of_the_unreadable(odd_folder: Path, tmp_path: Path) -> None:
    (odd_folder / "aaa.mcap").write_bytes(b"\0 not a recording")
    result = make("validate", recordings=odd_folder, build=tmp_path / "build")
    assert result.returncode != 0
    assert "aaa.mcap" in result.stderr
    assert result.stdout.count(": coning: pass") == len(ODD)


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    """A project with one compiled kernel, whose cache is newer than its source."""
    shutil.copy(PROJECT / "Makefile", tmp_path)
    models = tmp_path / "pipeline" / "models"
    (models / "__pycache__").mkdir(parents=True)
    for name in ("_kernels_step", "ellipsoid", "navigation_states"):
        (models / f"{name}.py").touch()
    (models / "__pycache__" / "_kernels_loop.follow-1.py311.nbi").touch()
    return models


def cached(models: Path) -> bool:
    """Make what keeps the caches true; whether the one is still there."""
    command = ["make", "--no-print-directory", "pipeline/__pycache__/.kernels"]
    subprocess.run(command, cwd=models.parents[1], check=True, capture_output=True)
    return any((models / "__pycache__").glob("*.nbi"))


def test_what_is_compiled_goes_when_a_kernel_changes_and_only_then(kernels: Path) -> None:
    assert not cached(kernels)
    (kernels / "__pycache__" / "_kernels_loop.follow-1.py311.nbi").touch()
    assert cached(kernels)
    later = (kernels.parent / "__pycache__" / ".kernels").stat().st_mtime + 1
    os.utime(kernels / "_kernels_step.py", (later, later))
    assert not cached(kernels)


@pytest.mark.parametrize("target", ["all", "validate", "test", "bench", "nightly", "sample-data"])
def test_every_target_that_runs_code_asks_for_it(kernels: Path, target: str) -> None:
    ready = ("-o", ".venv/.ready", "-o", ".venv/.ready-dev")
    planned = subprocess.run(
        ["make", "-n", *ready, target], cwd=kernels.parents[1], capture_output=True, text=True, check=False
    )
    assert "-name '*.nb[ci]' -delete" in planned.stdout
