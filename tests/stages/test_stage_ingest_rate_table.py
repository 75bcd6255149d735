"""Ingest of a gyro on a rate table: runs parted with their mountings, and the audit run by run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import ExitCode, GyrostandError
from pipeline.formats.base import Series
from pipeline.stages import audit
from pipeline.stages.base import Stand
from pipeline.stages.ingest import Settings, run
from pipeline.storage.contract_check import violations

Float = NDArray[np.float64]

START = 1_700_000_000_000_000_000
STEP = 20_000_000
N = 1000
RUNS = (
    {"name": "up", "axis": "r", "across": "p", "stop": 8.0},
    {"name": "by hand", "start": 9.0, "stop": 12.0},
    {"name": "other", "recording": "second.mcap", "axis": "-q"},
)


def write(path: Path, seed: int, *, begin: int = START) -> Path:
    """Gyro at 50 Hz, the table's encoder in counts of 2^16 at 25 Hz, the temperature at 1 Hz."""
    rng = np.random.default_rng(seed)
    time = begin + STEP * np.arange(N, dtype=np.int64)
    seconds = (time - begin) * 1e-9
    rate = 0.5 * np.sin(seconds)
    gyro = np.stack([rate, 0 * rate, rate], axis=1) + 1e-4 * rng.standard_normal((N, 3))
    counts = np.rint((0.5 * (1 - np.cos(seconds)) + 6.1) / (2 * np.pi) * 65536) % 65536
    vectors: dict[str, Any] = dict(zip(("x", "y", "z"), gyro.T, strict=True))
    formats.write(
        path,
        [
            Series(
                "/gyro", "geometry_msgs/msg/Vector3Stamped", time, time,
                {f"vector.{name}": values for name, values in vectors.items()},
            ),
            Series(
                "/table", "sensor_msgs/msg/Temperature", time[::2], time[::2], {"temperature": counts[::2]}
            ),
            Series(
                "/warm", "sensor_msgs/msg/Temperature", time[::50], time[::50],
                {"temperature": 20 + seconds[::50] / 10},
            ),
        ],
    )  # fmt: skip
    return path


def plan(runs: tuple[dict[str, Any], ...] = RUNS) -> dict[str, Any]:
    return {
        "time": {"clock": "log_time"},
        "runs": runs,
        "streams": {
            "gyro": {
                "topic": "/gyro",
                "quantity": "angular_rate",
                "channels": {
                    c: {"field": f"vector.{f}", "unit": "rad/s"} for c, f in zip("pqr", "xyz", strict=True)
                },
            },
            "turntable": {
                "topic": "/table",
                "quantity": "table_angle",
                "channels": {
                    "angle": {"field": "temperature", "unit": "rev", "scale": 1 / 65536, "wraps_at": 65536}
                },
            },
            "temperature": {
                "topic": "/warm",
                "quantity": "temperature",
                "channels": {"temperature": {"field": "temperature", "unit": "degC"}},
            },
        },
    }


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    write(tmp_path / "second.mcap", 2, begin=START - 10**12)
    return write(tmp_path / "first.mcap", 1)


def ingested(recording: Path, given: dict[str, Any]) -> dict[str, pa.Table]:
    tables = run(recording, Settings.model_validate(given), Stand())
    for name, table in tables.items():
        assert violations(name, table) == []
    return tables


def test_runs_part_every_stream_and_have_their_mountings(recording: Path) -> None:
    tables = ingested(recording, plan())
    assert set(tables) == {"gyro", "turntable", "temperature", "mountings", "findings"}
    counts = {
        name: np.bincount(tables[name]["run"].to_numpy()).tolist()
        for name in ("gyro", "turntable", "temperature")
    }
    assert counts == {
        "gyro": [400, 150, N],
        "turntable": [200, 75, N // 2],
        "temperature": [8, 3, N // 50],
    }
    mounted = tables["mountings"].to_pylist()
    assert [row["name"] for row in mounted] == ["up", "by hand", "other"]
    assert [mounted[0][f"axis_{i}"] for i in (1, 2, 3)] == [0.0, 0.0, 1.0]
    assert [mounted[0][f"across_{i}"] for i in (1, 2, 3)] == [1.0, 0.0, 0.0]
    assert [mounted[1][f"axis_{i}"] for i in (1, 2, 3)] == [None, None, None]
    assert [mounted[2][f"axis_{i}"] for i in (1, 2, 3)] == [0.0, -1.0, 0.0]
    kinds = {(row["stream"], row["kind"]) for row in tables["findings"].to_pylist()}
    assert kinds == {(name, "outside the runs") for name in ("gyro", "turntable", "temperature")}
    # the encoder passes its end at 6.28 rad in every run, and nothing of it is left
    for number in (0, 2):
        own = tables["turntable"].filter(pa.array(tables["turntable"]["run"].to_numpy() == number))
        assert np.abs(np.diff(own["angle"].to_numpy())).max() < 0.04
    assert tables["temperature"]["temperature"][0].as_py() == pytest.approx(293.15)


def test_without_runs_there_is_no_mounting_and_no_number(recording: Path) -> None:
    tables = ingested(recording, plan(()))
    assert "mountings" not in tables
    for name in ("gyro", "turntable", "temperature"):
        assert tables[name]["run"].null_count == tables[name].num_rows
    assert tables["gyro"].num_rows == N


def test_the_audit_looks_at_every_run_by_itself(recording: Path) -> None:
    tables = ingested(recording, plan())
    wanted = {name: tables[name] for name in audit.MAY_CONSUME if name in tables}
    out = audit.run(wanted, audit.Settings(), Stand())
    kinds = {row["kind"] for row in out["findings"].to_pylist()}
    # one recording ends years before the other begins: no gap, no step back of the clock
    assert not kinds & {"gap", "backward stamp", "repeated stamp"}, out["findings"].to_pylist()
    figures = {(row["channel"], row["name"]): row["value"] for row in out["metrics"].to_pylist()}
    assert figures["gyro", "sample_count"] == 400 + 150 + N
    assert figures["gyro", "gap_count"] == 0
    assert figures["turntable", "sample_count"] == 200 + N // 2  # by hand it was not on the table
    assert figures["temperature", "error_count"] == 0


def test_a_run_without_samples_is_refused_by_name(recording: Path) -> None:
    with pytest.raises(GyrostandError, match="samples of the run 'late', from 100 s on") as caught:
        ingested(recording, plan(({"name": "late", "axis": "r", "start": 100.0},)))
    assert caught.value.exit_code is ExitCode.USAGE


def test_a_further_recording_that_is_not_there_is_refused(recording: Path) -> None:
    with pytest.raises(GyrostandError, match=r"did you mean 'second.mcap'") as caught:
        ingested(recording, plan(({"name": "a", "axis": "r", "recording": "secnd.mcap"},)))
    assert caught.value.exit_code is ExitCode.INPUT
