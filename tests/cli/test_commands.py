"""The commands as an engineer types them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq

Command = Callable[..., subprocess.CompletedProcess[str]]

HEAVY = ("numpy", "scipy", "pandas", "pyarrow", "numba", "bokeh", "pydantic", "rosbags", "mcap")


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys\n"
        "from pipeline.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print([m for m in sys.argv[1:] if m in sys.modules], file=sys.stderr)"
    )
    result = subprocess.run(
        [sys.executable, "-c", program, *HEAVY], capture_output=True, text=True, check=True
    )
    assert result.stderr.strip() == "[]"
    assert "validate" in result.stdout


def test_schema(gyrostand: Command) -> None:
    listed = gyrostand("schema", "list").stdout
    assert "attitude_corrected" in listed
    shown = json.loads(gyrostand("schema", "show", "metrics").stdout)
    assert shown["table"] == "metrics"
    wrong = gyrostand("schema", "show", "metric")
    assert wrong.returncode == 2
    assert "metrics" in wrong.stderr


def test_inspect(gyrostand: Command, csv_recording: Path) -> None:
    assert "201 samples" in gyrostand("inspect", csv_recording).stdout
    held = json.loads(gyrostand("inspect", csv_recording, "--json").stdout)
    assert held["topics"][0]["count"] == 201
    assert [f["path"] for f in held["topics"][0]["fields"]][:3] == ["time", "p", "q"]


def test_plan_check(gyrostand: Command, csv_recording: Path) -> None:
    result = gyrostand("plan", "check", csv_recording.with_suffix(".toml"))
    assert result.returncode == 0
    assert "coning" in result.stdout


def test_plan_init_needs_only_what_it_may_not_guess(gyrostand: Command, csv_recording: Path) -> None:
    plan = csv_recording.with_suffix(".toml")
    plan.write_text(gyrostand("plan", "init", csv_recording).stdout)
    refused = gyrostand("plan", "check", plan)
    assert refused.returncode == 2
    assert "unit" in refused.stderr


def test_run_again_is_up_to_date_and_a_changed_plan_is_not(
    gyrostand: Command, csv_recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert "up to date" not in gyrostand("run", csv_recording, "--out", out).stdout
    assert "up to date" in gyrostand("run", csv_recording, "--out", out).stdout
    plan = csv_recording.with_suffix(".toml")
    plan.write_text(plan.read_text() + "\n[interpolate]\noversampling = 4\n")
    assert "up to date" not in gyrostand("run", csv_recording, "--out", out).stdout


def test_an_output_that_was_damaged_is_made_again(
    gyrostand: Command, csv_recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    gyrostand("run", csv_recording, "--out", out)
    attitude = out / "attitude/recording=run1/part-0.parquet"
    whole = attitude.read_bytes()
    attitude.write_bytes(whole[:-100])
    assert gyrostand("check", out).returncode == 1
    assert "up to date" not in gyrostand("run", csv_recording, "--out", out).stdout
    assert attitude.read_bytes() == whole
    assert gyrostand("check", out).returncode == 0


def test_check_report_and_verdicts(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    gyrostand("run", csv_recording, "--out", out)
    assert gyrostand("check", out).returncode == 0
    assert gyrostand("verdicts", out).stdout.startswith("run1: coning: ")
    pages = gyrostand("report", out).stdout.split()
    assert [Path(p).name for p in pages] == ["run1.html", "index.html"]


def test_validate_writes_nothing(gyrostand: Command, csv_recording: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert gyrostand("validate", csv_recording).returncode == 0
    assert sorted(tmp_path.rglob("*")) == before


def test_simulate_then_run(gyrostand: Command, tmp_path: Path) -> None:
    made = gyrostand(
        "simulate", "coning", tmp_path / "sim.mcap",
        "--cone-angle", "0.5 deg", "--frequency", 40, "--rate", 400, "--duration", 1,
        "--white-noise", "1e-4 rad/s",
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    run = gyrostand("run", tmp_path / "sim.mcap", "--out", tmp_path / "out")
    assert run.returncode == 0, run.stderr
    rates = pq.read_table(tmp_path / "out/gyro/recording=sim/part-0.parquet", partitioning=None)
    assert rates.num_rows == 401


def test_reproduce_godorov(gyrostand: Command) -> None:
    result = gyrostand("reproduce", "godorov", "--json")
    figures = json.loads(result.stdout)
    assert set(figures[0]) == {
        "source", "item", "quantity", "printed", "oracle", "ours", "relative_difference", "within",
    }  # fmt: skip
    assert result.returncode == 0, [f for f in figures if not f["within"]]
