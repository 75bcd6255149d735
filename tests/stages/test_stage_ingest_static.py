"""Ingest and audit of static records: a gyro of some axes, and the table on which it turns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import ExitCode
from pipeline.formats.base import Series
from pipeline.stages import audit, ingest
from pipeline.stages.base import StageError, Stand
from pipeline.storage.contract_check import violations

N = 400
STAMP = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 10**9
RATES = 1e-4 * np.random.default_rng(1).normal(size=(N, 3))


def tables(
    path: Path, table: NDArray[np.float64] | None = None, stamp: NDArray[np.int64] = STAMP, **streams: Any
) -> dict[str, pa.Table]:
    """Ingest of a recording of a gyro and, where it is given, of a table."""
    names = ("angular_velocity.x", "angular_velocity.y", "angular_velocity.z")
    series = [Series("/gyro", "sensor_msgs/msg/Imu", STAMP, STAMP, dict(zip(names, RATES.T, strict=True)))]
    if table is not None:
        kind = "geometry_msgs/msg/Vector3Stamped"
        series.append(Series("/table", kind, stamp, stamp, {"vector.z": table}))
    recording = path / "run.mcap"
    formats.write(recording, series)
    settings = ingest.Settings.model_validate({"time": {"clock": "header_stamp"}, "streams": streams})
    found = ingest.run(recording, settings, Stand())
    for name, one in found.items():
        assert violations(name, one) == []
    return found


def gyro(axes: str, quantity: str = "angular_rate", unit: str = "rad/s") -> dict[str, Any]:
    fields = dict(zip("pqr", "xyz", strict=True))
    channels = {a: {"field": f"angular_velocity.{fields[a]}", "unit": unit} for a in axes}
    return {"topic": "/gyro", "quantity": quantity, "channels": channels}


def turntable(quantity: str, unit: str, **more: Any) -> dict[str, Any]:
    channel = quantity.removeprefix("table_")
    channels = {channel: {"field": "vector.z", "unit": unit, **more}}
    return {"topic": "/table", "quantity": quantity, "channels": channels}


def audited(found: dict[str, pa.Table]) -> tuple[list[dict[str, Any]], dict[tuple[str, str], Any]]:
    kept = {name: table for name, table in found.items() if name in audit.MAY_CONSUME}
    out = audit.run(kept, audit.Settings(), Stand())
    figures = {(m["channel"], m["name"]): m["value"] for m in out["metrics"].to_pylist()}
    return out["findings"].to_pylist(), figures


@pytest.mark.parametrize("axes", ["p", "q", "r", "pr", "rp", "pqr"])
def test_channels_that_the_plan_does_not_map_are_null(tmp_path: Path, axes: str) -> None:
    found = tables(tmp_path, gyro=gyro(axes))
    for k, axis in enumerate("pqr"):
        column = found["gyro"].column(axis)
        if axis in axes:
            assert np.array_equal(column.to_numpy(), RATES[:, k])
        else:
            assert column.null_count == N
    assert found["findings"].num_rows == 0


def test_so_are_those_of_increments(tmp_path: Path) -> None:
    table = tables(tmp_path, gyro=gyro("q", "angle_increment", "arcsec"))["gyro_increments"]
    exact = RATES[:, 1] * np.pi / 180 / 3600
    assert table.column("increment_q").to_numpy() == pytest.approx(exact, rel=4e-16)  # one product
    assert [table.column(f"increment_{axis}").null_count for axis in "pr"] == [N, N]


def test_an_absent_channel_is_not_audited(tmp_path: Path) -> None:
    """It is no missing channel, and neither a value nor a unit of it is judged."""
    findings, figures = audited(tables(tmp_path, gyro=gyro("pr")))
    assert findings == []
    assert ("gyro.p", "nan_count") in figures
    assert ("gyro.q", "nan_count") not in figures
    # of the one axis that is there the size is judged: 1000 rad/s
    scaled = gyro("q")
    scaled["channels"]["q"]["scale"] = 1e7
    assert [f["kind"] for f in audited(tables(tmp_path, gyro=scaled))[0]] == ["implausible unit"]


def test_the_turns_of_a_table_s_encoder_are_undone(tmp_path: Path) -> None:
    angle = 2.9 * np.arange(N)  # degrees: more than three turns
    plan = turntable("table_angle", "deg", wraps_at=360.0)
    found = tables(tmp_path, np.mod(angle, 360.0), gyro=gyro("p"), turntable=plan)
    table = found["turntable"]
    assert np.array_equal(table.column("time").to_numpy(), STAMP)
    # rounding of 360 degrees and of 1157
    assert table.column("angle").to_numpy() == pytest.approx(np.deg2rad(angle), abs=1e-12)
    assert table.column("rate").null_count == N
    # a table may turn backwards, and its encoder may count so
    turned = turntable("table_angle", "deg", wraps_at=360.0, sign=-1)
    back = tables(tmp_path, np.mod(-angle, 360.0), gyro=gyro("p"), turntable=turned)["turntable"]
    assert back.column("angle").to_numpy() == pytest.approx(np.deg2rad(angle), abs=1e-12)


def test_a_wrong_turn_is_refused(tmp_path: Path) -> None:
    plan = turntable("table_angle", "deg", wraps_at=180.0)
    with pytest.raises(StageError, match="correct wraps_at") as caught:
        tables(tmp_path, np.mod(2.9 * np.arange(N), 360.0), gyro=gyro("p"), turntable=plan)
    assert caught.value.exit_code is ExitCode.USAGE
    assert "\n" not in str(caught.value)


def test_a_table_s_rate_is_in_si(tmp_path: Path) -> None:
    table = tables(tmp_path, np.full(N, 0.5), gyro=gyro("p"), turntable=turntable("table_rate", "rpm"))[
        "turntable"
    ]
    assert table.column("rate").to_numpy() == pytest.approx(np.full(N, np.pi / 60), rel=1e-15)
    assert table.column("angle").null_count == N


def test_the_table_s_stamps_and_missing_readings_are_marked_and_its_motion_is_not(tmp_path: Path) -> None:
    rate = np.where(np.arange(N) < 200, 0.0, 3.0)  # it stands, then steps to 3 deg/s
    rate[50:53] = np.nan
    kept = np.delete(np.arange(N), np.s_[300:320])
    found = tables(
        tmp_path, rate[kept], STAMP[kept], gyro=gyro("p"), turntable=turntable("table_rate", "deg/s")
    )
    findings, figures = audited(found)
    assert [(f["stream"], f["kind"], f["count"]) for f in findings] == [
        ("turntable", "gap", 20),
        ("turntable", "NaN", 3),
    ]
    assert figures["turntable", "sample_rate"] == pytest.approx(1.0, rel=1e-9)
    assert figures["turntable", "nan_count"] == 3
    assert figures["turntable", "lost_count"] == 20
    assert figures["turntable", "error_count"] == 0
