"""A real gyro beside an optical reference, with rows where the reference is lost (BROAD, 02 slow rotation).

186 s by hand, a MEMS gyro at 285.7 Hz, 1706 of 53,240 reference rows NaN, the first 4.3 s among them.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

Command = Callable[..., subprocess.CompletedProcess[str]]

PLAN = """\
procedure = "coning"
title = "BROAD 02: slow rotation, gyro beside an optical quaternion"

[time]
field = "t_s"
unit = "s"

[streams.gyro]
quantity = "angular_rate"
channels.p = {{ field = "gx_rads", unit = "rad/s", offset = {0!r} }}
channels.q = {{ field = "gy_rads", unit = "rad/s", offset = {1!r} }}
channels.r = {{ field = "gz_rads", unit = "rad/s", offset = {2!r} }}

[streams.reference]
quantity = "quaternion"
channels.w = {{ field = "qw", unit = "1" }}
channels.x = {{ field = "qx", unit = "1" }}
channels.y = {{ field = "qy", unit = "1" }}
channels.z = {{ field = "qz", unit = "1" }}

[detrend]
method = "none"
"""


@pytest.fixture(scope="module")
def recording(shared_data: Path) -> Path:
    return shared_data / "csv" / "broad_02_slow_rotation_B.csv"


def criteria(gyrostand: Command, recording: Path, folder: Path, bias: np.ndarray) -> dict[str, float]:
    plan = folder / "plan.toml"
    plan.write_text(PLAN.format(*(-bias).tolist()))
    run = gyrostand("run", recording, "--plan", plan, "--out", folder / "out", "--id", "broad")
    assert run.returncode == 0, run.stderr
    assert "1706 of 53240 samples of the reference" in run.stdout
    table = pq.read_table(folder / "out/metrics/recording=broad/part-0.parquet", partitioning=None)
    return {m["channel"]: m["value"] for m in table.to_pylist() if m["name"] == "relative_rms_error"}


def test_runs_end_to_end_and_its_error_is_the_gyros_bias(
    gyrostand: Command, recording: Path, tmp_path: Path
) -> None:
    at_rest = np.genfromtxt(recording, delimiter=",", skip_header=1, usecols=(1, 2, 3), max_rows=1500)
    bias = at_rest.mean(axis=0)  # 5 s before the movement begins
    raw = criteria(gyrostand, recording, tmp_path, np.zeros(3))
    corrected = criteria(gyrostand, recording, tmp_path, bias)
    # Left in, the bias at rest (5.6e-3 rad/s) turns the attitude by 1 rad in 186 s: as large as the angles.
    assert all(0.2 < raw[angle] < 1.5 for angle in ("psi", "theta", "gamma")), raw
    # Taken out, the gyro's instability remains, some 5e-4 rad/s: 0.1 rad, against angles of 1 rad rms.
    assert all(corrected[angle] < 0.15 for angle in ("psi", "theta", "gamma")), corrected
