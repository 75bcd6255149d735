"""What the tests share: the command line as a process, recordings of others, small ones of our own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# The same examples each time, so that a change is judged and not its luck; `make nightly` draws new ones.
settings.register_profile("judged", derandomize=True, deadline=None)
settings.register_profile("nightly", max_examples=1000, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "judged"))

PROJECT = Path(__file__).resolve().parents[1]
Completed = subprocess.CompletedProcess[str]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recordings of others, beside the project; their tests are skipped where they are not."""
    folder = PROJECT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the recordings of others are not beside this checkout")
    return folder


@pytest.fixture(scope="session")
def gyrostand() -> Callable[..., Completed]:
    """Run the command line in a process of its own."""

    def call(*arguments: object, cwd: Path | None = None) -> Completed:
        return subprocess.run(
            [sys.executable, "-c", "from pipeline.cli import main; main()", *map(str, arguments)],
            capture_output=True,
            text=True,
            cwd=cwd or PROJECT,
            check=False,
        )

    return call


CSV_PLAN = """\
procedure = "coning"

[time]
field = "time"
unit = "s"

[streams.gyro]
quantity = "angular_rate"
channels.p = { field = "p", unit = "rad/s" }
channels.q = { field = "q", unit = "rad/s" }
channels.r = { field = "r", unit = "rad/s" }

[streams.reference]
quantity = "euler_krylov"
channels.psi = { field = "psi", unit = "rad" }
channels.theta = { field = "theta", unit = "rad" }
channels.gamma = { field = "gamma", unit = "rad" }
"""


@pytest.fixture
def csv_recording(tmp_path: Path) -> Path:
    """A small, sound CSV recording (coning of 1 degree at 5 Hz, 100 Hz, 2 s) with its test plan beside it."""
    from pipeline.models.coning import ConingMotion

    motion = ConingMotion(cone_angle=np.radians(1.0), frequency=5.0)
    t = np.arange(201) / 100
    table = np.column_stack([t, motion.rates(t), motion.angles(t)])
    path = tmp_path / "run1.csv"
    np.savetxt(path, table, delimiter=",", header="time,p,q,r,psi,theta,gamma", comments="", fmt="%.17g")
    (tmp_path / "run1.toml").write_text(CSV_PLAN, encoding="utf-8")
    return path
