"""A run that is killed or interrupted at any moment, and started again, gives the same bytes."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

RUN = [sys.executable, "-m", "pipeline", "run"]
PROJECT = Path(__file__).resolve().parents[2]


def published(out: Path) -> dict[str, bytes]:
    """Every published table but provenance, which holds durations."""
    tables = {
        str(p.relative_to(out)): p.read_bytes() for p in sorted(out.glob("*/recording=*/part-0.parquet"))
    }
    return {name: content for name, content in tables.items() if not name.startswith("provenance")}


def start(recording: Path, out: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*RUN, str(recording), "--out", str(out)],
        cwd=PROJECT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def finish(process: subprocess.Popen[str]) -> str:
    """What it wrote to standard error, when it has ended well."""
    _, error = process.communicate()
    assert process.returncode == 0, error
    return error


def test_killed_at_random_moments(csv_recording: Path, tmp_path: Path) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    begun = time.perf_counter()
    finish(start(csv_recording, whole))
    length = time.perf_counter() - begun
    for moment in np.random.default_rng(11).uniform(0.2, 1.05, 6):
        process = start(csv_recording, out)
        time.sleep(moment * length)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    finish(start(csv_recording, out))
    assert published(out) == published(whole)


def test_interrupted(csv_recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = start(csv_recording, out)
    while process.poll() is None and not (out / ".publishing" / "run1").is_dir():
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate()
    assert process.returncode == 130, error
    assert error.startswith("gyrostand: interrupted")
    assert len(error.strip().splitlines()) == 1
    assert not published(out)
    finish(start(csv_recording, out))
