"""Ingest of gimbal angles: wraps undone, runs parted and gathered, each with its mounting."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import ExitCode, GyrostandError
from pipeline.formats.base import Series
from pipeline.models.earth import mounting_angles
from pipeline.stages._runs import unwrapped
from pipeline.stages.base import Stand
from pipeline.stages.ingest import Settings, run
from pipeline.storage.contract_check import violations

Float = NDArray[np.float64]

N = 120
START = 1_700_000_000_000_000_123
STAMP = START + np.arange(N, dtype=np.int64) * 60_000_000_000
"""One sample a minute for two hours."""
COUNTS = 2**20
DEGREES = np.column_stack([np.linspace(-200, 500, N), np.linspace(30, -40, N)])
"""alpha1 turns nearly twice; alpha2 passes 0."""
TOLERANCE = 1e-14
"""rad: a few units in the last place of 9 rad, by product, sum and the turns taken off."""


def series(columns: dict[str, Float], stamp: NDArray[np.int64] = STAMP) -> Series:
    return Series("/gimbal", "geometry_msgs/msg/Vector3Stamped", stamp + 1000, stamp, columns)


def write(path: Path, values: Float, stamp: NDArray[np.int64] = STAMP) -> Path:
    """A recording of two columns, in the format of its name."""
    names = ("outer", "inner") if path.suffix == ".csv" else ("vector.x", "vector.y")
    formats.write(path, [series(dict(zip(names, values.T, strict=True)), stamp)])
    return path


def gimbal(path: Path, unit: str = "deg", **channel: Any) -> dict[str, Any]:
    text = path.suffix == ".csv"
    fields = ("outer", "inner") if text else ("vector.x", "vector.y")
    channels = {
        name: {"field": f, "unit": unit, **channel}
        for name, f in zip(("alpha1", "alpha2"), fields, strict=True)
    }
    return {"topic": "" if text else "/gimbal", "quantity": "gimbal_angles", "channels": channels}


def ingest(
    recording: Path,
    stream: dict[str, Any] | None = None,
    runs: tuple[dict[str, Any], ...] = (),
    stand: dict[str, Any] | None = None,
    time: dict[str, Any] | None = None,
) -> dict[str, pa.Table]:
    plan = {
        "time": time or {"clock": "header_stamp"},
        "streams": {"gimbal": stream or gimbal(recording)},
        "runs": runs,
    }
    mounting = {"latitude_deg": 55.75, "scheme": "polar"} if stand is None else stand
    tables = run(recording, Settings.model_validate(plan), Stand.model_validate(mounting))
    for name, table in tables.items():
        assert violations(name, table) == []
    return tables


def angles(tables: dict[str, pa.Table], number: int = 0) -> Float:
    of = tables["gimbal"].filter(pa.array(tables["gimbal"]["run"].to_numpy() == number))
    return np.column_stack([of["alpha1"].to_numpy(), of["alpha2"].to_numpy()])


def refused(code: ExitCode, *words: str, **plan: Any) -> None:
    with pytest.raises(GyrostandError) as caught:
        ingest(**plan)
    assert caught.value.exit_code is code
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value), str(caught.value)


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run", "run.csv"])
def test_an_encoder_s_counts_become_unwrapped_radians_in_every_format(tmp_path: Path, name: str) -> None:
    counts = np.rint(DEGREES * COUNTS / 360)
    path = write(tmp_path / name, counts % COUNTS)
    stream = gimbal(path, scale=360 / COUNTS, wraps_at=COUNTS)
    time = {"field": "time", "unit": "s"} if path.suffix == ".csv" else None
    tables = ingest(path, stream, time=time)
    assert set(tables) == {"gimbal", "runs", "findings"}
    found = angles(tables)
    turns = (found[0] - counts[0] * 2 * np.pi / COUNTS) / (2 * np.pi)  # the first count may be of any turn
    assert turns == pytest.approx(np.rint(turns), abs=TOLERANCE)
    assert found - found[0] == pytest.approx((counts - counts[0]) * 2 * np.pi / COUNTS, abs=TOLERANCE)
    assert tables["findings"].num_rows == 0
    recorded = tables["gimbal"]
    assert np.array_equal(np.diff(recorded["time"].to_numpy()), np.diff(STAMP))
    assert recorded["log_time"].null_count == (N if path.suffix == ".csv" else 0)
    assert tables["runs"].to_pylist() == [
        {
            "run": 0,
            "name": "run",
            "scheme": "polar",
            "latitude": np.deg2rad(55.75),
            **dict(zip(("chi1", "chi2", "chi3"), mounting_angles("polar", np.deg2rad(55.75)), strict=True)),
        }
    ]


def test_without_wraps_at_nothing_is_undone(tmp_path: Path) -> None:
    wrapped = DEGREES % 360
    found = angles(ingest(write(tmp_path / "run.mcap", wrapped)))
    assert found == pytest.approx(np.deg2rad(wrapped), abs=TOLERANCE)


@pytest.mark.parametrize("low", [0.0, -180.0])
@pytest.mark.parametrize("sign", [-1, 1])
def test_encoders_from_0_and_about_0_turned_round_and_shifted(tmp_path: Path, low: float, sign: int) -> None:
    path = write(tmp_path / "run.mcap", (DEGREES - low) % 360 + low)
    stream = gimbal(path, wraps_at=360.0, sign=sign, offset=2.5)
    found = angles(ingest(path, stream))
    assert found - found[0] == pytest.approx(sign * np.deg2rad(DEGREES - DEGREES[0]), abs=TOLERANCE)


def test_the_inner_angle_is_the_one_near_0(tmp_path: Path) -> None:
    values = (DEGREES - [0.0, 40.0]) % 360  # 350 to 280 deg: -10 to -80
    values[0] = np.nan
    path = write(tmp_path / "run.mcap", values)
    found = angles(ingest(path, gimbal(path, wraps_at=360.0)))
    assert found[1:, 1] == pytest.approx(np.deg2rad(DEGREES[1:, 1] - 40), abs=TOLERANCE)
    assert found[1, 0] == pytest.approx(np.deg2rad(values[1, 0]), abs=TOLERANCE)  # the outer one: as recorded
    none = write(tmp_path / "none.mcap", np.where(np.arange(2), np.nan, DEGREES % 360))
    assert np.isnan(angles(ingest(none, gimbal(none, wraps_at=360.0)))[:, 1]).all()


def test_wraps_are_undone_in_the_order_of_time(tmp_path: Path) -> None:
    order = np.random.default_rng(3).permutation(N)
    path = write(tmp_path / "run.mcap", (DEGREES % 360)[order], STAMP[order])
    tables = ingest(path, gimbal(path, wraps_at=360.0))
    assert np.array_equal(tables["gimbal"]["time"].to_numpy(), STAMP[order])  # as recorded
    found = angles(tables)[np.argsort(order)]
    assert found - found[0] == pytest.approx(np.deg2rad(DEGREES - DEGREES[0]), abs=TOLERANCE)


def test_what_is_not_finite_stays_and_is_passed_over(tmp_path: Path) -> None:
    values = DEGREES % 360
    values[40:43, 0] = np.nan
    values[70, 1] = np.inf
    path = write(tmp_path / "run.mcap", values)
    found = angles(ingest(path, gimbal(path, wraps_at=360.0)))
    assert np.flatnonzero(~np.isfinite(found[:, 0])).tolist() == [40, 41, 42]
    assert np.flatnonzero(~np.isfinite(found[:, 1])).tolist() == [70]
    expected = np.deg2rad(DEGREES - DEGREES[0])
    finite = np.isfinite(found)
    assert (found - found[0])[finite] == pytest.approx(expected[finite], abs=TOLERANCE)


@given(
    steps=st.lists(st.floats(-0.499, 0.499), min_size=1, max_size=40),
    period=st.floats(1e-3, 1e9),
    begin=st.floats(-5, 5),
    holes=st.sets(st.integers(0, 40), max_size=5),
    seed=st.integers(0, 2**16),
)
def test_any_walk_of_less_than_half_a_turn_a_step_is_found_again(
    steps: list[float], period: float, begin: float, holes: set[int], seed: int
) -> None:
    walk = (begin + np.cumsum([0.0, *steps])) * period
    order = np.random.default_rng(seed).permutation(len(walk))
    readings = (walk % period)[order]
    lost = [h for h in holes if h < len(walk) and h not in (0, len(walk) - 1)]
    # A step over a hole must be less than half a turn as well, or nobody could tell.
    lost = [
        h for h in lost if abs(walk[h + 1] - walk[h - 1]) < 0.499 * period and not {h - 1, h + 1} & set(lost)
    ]
    readings[np.isin(order, lost)] = np.nan
    found = unwrapped(readings, order.astype(np.int64), period, "here")
    assert np.array_equal(np.isnan(found), np.isnan(readings))
    kept = ~np.isnan(found)
    turns = (found - walk[order])[kept] / period
    # 25 turns at most, each rounded to 2e-16 of itself; 40 sums of them.
    assert turns == pytest.approx(np.full(kept.sum(), np.rint(turns[0])), abs=1e-12)


@given(st.lists(st.floats(-0.499, 0.499), min_size=1, max_size=30))
def test_readings_that_never_jump_are_returned_bit_for_bit(steps: list[float]) -> None:
    readings = np.cumsum(steps) / max(1.0, float(np.ptp(np.cumsum(steps))))
    time = np.arange(len(readings), dtype=np.int64)
    assert np.array_equal(unwrapped(readings, time, 1.0, "here"), readings)


def test_runs_of_one_recording_are_parted_by_time(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", DEGREES % 360)
    runs = (
        {"name": "late", "start": 3600.0, "scheme": "equatorial"},
        {
            "name": "early",
            "start": 600.0,
            "stop": 3600.0,
            "chi_deg": (1.0, -90.0, 90.0),
            "latitude_deg": -12.0,
        },
    )
    tables = ingest(path, gimbal(path, wraps_at=360.0), runs)
    for number, (begin, end) in enumerate([(60, N), (10, 60)]):  # a sample a minute; the stop is outside
        expected = np.deg2rad(DEGREES[begin:end] - DEGREES[begin])
        found = angles(tables, number)
        assert found - found[0] == pytest.approx(expected, abs=TOLERANCE)
        alpha1, alpha2 = DEGREES[begin]
        assert found[0] == pytest.approx(
            np.deg2rad([alpha1 % 360, alpha2]), abs=TOLERANCE
        )  # each begins anew
    late, early = tables["runs"].to_pylist()
    assert (late["run"], late["name"], late["scheme"]) == (0, "late", "equatorial")
    assert (late["chi1"], late["chi2"], late["chi3"]) == mounting_angles("equatorial", np.deg2rad(55.75))
    assert (early["scheme"], early["latitude"]) == (None, np.deg2rad(-12.0))
    assert [early[c] for c in ("chi1", "chi2", "chi3")] == np.deg2rad([1.0, -90.0, 90.0]).tolist()
    (left,) = tables["findings"].to_pylist()
    assert (left["kind"], left["severity"], left["count"]) == ("outside the runs", "info", 10)
    assert (left["start"], left["end"]) == (STAMP[0], STAMP[9])


def test_a_run_s_own_scheme_stands_in_place_of_the_stand_s_angles(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", DEGREES)
    stand = {"latitude_deg": 10.0, "chi_deg": (0.0, 1.0, 2.0)}
    tables = ingest(
        path, None, ({"name": "a", "stop": 600.0}, {"name": "b", "start": 600.0, "scheme": "vertical"}), stand
    )
    assert tables["runs"]["scheme"].to_pylist() == [None, "vertical"]
    assert tables["runs"]["chi3"].to_pylist() == [np.deg2rad(2.0), 0.0]


def test_runs_of_further_recordings_are_gathered_in_the_order_of_the_plan(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", DEGREES)
    write(tmp_path / "more", DEGREES + 7, STAMP - 10**12)  # a rosbag2 folder
    write(tmp_path / "last.bag", DEGREES[:30] * 2, STAMP[:30])
    runs = (
        {"name": "3", "recording": "last.bag", "scheme": "vertical"},
        {"name": "1"},
        {"name": "2", "recording": "more", "start": 60.0, "stop": 180.0},
    )
    tables = ingest(path, None, runs)
    assert tables["gimbal"]["run"].to_pylist() == [0] * 30 + [1] * N + [2] * 2
    assert angles(tables, 0) == pytest.approx(np.deg2rad(DEGREES[:30] * 2), abs=TOLERANCE)
    assert angles(tables, 1) == pytest.approx(np.deg2rad(DEGREES), abs=TOLERANCE)
    assert angles(tables, 2) == pytest.approx(np.deg2rad(DEGREES[1:3] + 7), abs=TOLERANCE)
    (left,) = tables["findings"].to_pylist()
    assert left["detail"].startswith("'more': 118 samples outside")


def test_losses_of_a_further_recording_name_it(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", DEGREES)
    damaged = write(tmp_path / "more.mcap", DEGREES)
    damaged.write_bytes(damaged.read_bytes()[:-200])
    tables = ingest(path, None, ({"name": "1"}, {"name": "2", "recording": "more.mcap"}))
    losses = [f for f in tables["findings"].to_pylist() if f["kind"] == "loss"]
    assert losses
    assert all(f["detail"].startswith("'more.mcap': ") for f in losses)


def test_a_cell_that_is_empty_becomes_nan_and_a_finding(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = [f"{k},{k},{-k}" for k in range(20)]
    rows[4] = "4,,-4"
    path.write_text("\n".join(["t,outer,inner", *rows]) + "\n")
    tables = ingest(path, time={"field": "t", "unit": "min"})
    assert np.flatnonzero(np.isnan(angles(tables)[:, 0])).tolist() == [4]
    (missing,) = tables["findings"].to_pylist()
    assert (missing["stream"], missing["channel"], missing["count"]) == ("gimbal", "alpha1", 1)


def test_a_gyro_beside_the_gimbal_is_not_parted(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = [f"{k},{k},{-k},1,2,3" for k in range(20)]
    path.write_text("\n".join(["t,outer,inner,p,q,r", *rows]) + "\n")
    gyro = {"quantity": "angular_rate", "channels": {c: {"field": c, "unit": "deg/h"} for c in "pqr"}}
    plan = {
        "time": {"field": "t", "unit": "min"},
        "streams": {"gyro": gyro, "gimbal": gimbal(path)},
        "runs": ({"name": "a", "stop": 300.0},),
    }
    stand = Stand(latitude_deg=0.0, scheme="horizontal")
    tables = run(path, Settings.model_validate(plan), stand)
    assert (tables["gyro"].num_rows, tables["gimbal"].num_rows) == (20, 5)


def test_what_the_plan_says_of_runs_must_be_in_the_recordings(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", DEGREES)
    write(tmp_path / "more.mcap", DEGREES)
    late = ({"name": "a", "stop": 60.0}, {"name": "b", "start": 9000.0, "stop": 9900.0})
    refused(ExitCode.USAGE, "'b'", "from 9000 s to 9900 s", "0 to 7140 s", recording=path, runs=late)
    named = ({"name": "a", "recording": "moer.mcap"},)
    refused(ExitCode.INPUT, "moer.mcap", "did you mean 'more.mcap'?", recording=path, runs=named)
    itself = ({"name": "a", "recording": "run.mcap"},)
    refused(ExitCode.USAGE, "run.mcap", "leave recording", recording=path, runs=itself)
    (tmp_path / "empty.mcap").touch()
    refused(
        ExitCode.INPUT,
        "empty.mcap",
        "an empty file",
        recording=path,
        runs=({"name": "a", "recording": "empty.mcap"},),
    )
    other = tmp_path / "other.mcap"
    formats.write(
        other, [Series("/else", "geometry_msgs/msg/Vector3Stamped", STAMP, STAMP, {"vector.x": STAMP * 0.0})]
    )
    refused(
        ExitCode.USAGE,
        "other.mcap",
        "'/gimbal'",
        recording=path,
        runs=({"name": "a", "recording": "other.mcap"},),
    )


@pytest.mark.parametrize("stray", [-1e6, 1e9])
def test_one_stray_reading_changes_nothing_else(tmp_path: Path, stray: float) -> None:
    values = DEGREES % 360
    values[50, 0] = stray
    path = write(tmp_path / "run.mcap", values)
    found = angles(ingest(path, gimbal(path, wraps_at=360.0)))
    others = np.arange(N) != 50
    assert (found - found[0])[others] == pytest.approx(np.deg2rad(DEGREES - DEGREES[0])[others], abs=1e-7)
    # 1e9 deg are known to 1e-7 deg, and so are the turns taken off behind it.


def test_a_turn_that_is_not_the_encoder_s_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", np.rint(DEGREES * 100) % 36000)
    stream = gimbal(path, scale=0.01, wraps_at=18000)
    refused(ExitCode.USAGE, "channel 'alpha1'", "wraps_at", "1.9", recording=path, stream=stream)


@pytest.mark.parametrize(
    ("stand", "word"),
    [
        ({}, "latitude_deg"),
        ({"scheme": "polar"}, "latitude_deg"),
        ({"latitude_deg": 3.0}, "scheme or chi_deg"),
    ],
)
def test_without_its_mounting_a_gimbal_is_refused(tmp_path: Path, stand: dict[str, Any], word: str) -> None:
    path = write(tmp_path / "run.mcap", DEGREES)
    refused(ExitCode.USAGE, "[stand]", word, recording=path, stand=stand)
