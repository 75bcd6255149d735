"""Ingest: what was written into a recording comes out in SI, body axes and the plan's clock."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import ExitCode, GyrostandError
from pipeline.formats.base import Series
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_from_euler_krylov,
    quaternion_from_matrix,
)
from pipeline.stages._sample_time import sample_times
from pipeline.stages.base import StageError, Stand
from pipeline.stages.channel_map import Clock
from pipeline.stages.ingest import Settings, run
from pipeline.storage.contract_check import violations

Float = NDArray[np.float64]

N = 200
START = 1_700_000_000_000_000_123
STAMP = START + np.arange(N, dtype=np.int64) * 2_500_000
ROUNDING = 4e-16
"""A few units in the last place: one product and one sum."""


def gyro(values: Float, stamp: NDArray[np.int64] = STAMP) -> Series:
    names = ("angular_velocity.x", "angular_velocity.y", "angular_velocity.z")
    columns = dict(zip(names, values.T, strict=True))
    return Series("/gyro", "sensor_msgs/msg/Imu", STAMP + 1000, stamp, columns)


def reference(quaternion: Float) -> Series:
    names = ("quaternion.w", "quaternion.x", "quaternion.y", "quaternion.z")
    columns = dict(zip(names, quaternion.T, strict=True))
    return Series("/reference", "geometry_msgs/msg/QuaternionStamped", STAMP + 1000, STAMP, columns)


def imu(unit: str = "rad/s", **more: Any) -> dict[str, Any]:
    channels = {
        c: {"field": f"angular_velocity.{a}", "unit": unit} for c, a in zip("pqr", "xyz", strict=True)
    }
    return {"topic": "/gyro", "quantity": "angular_rate", "channels": channels, **more}


def optical(**more: Any) -> dict[str, Any]:
    channels = {c: {"field": f"quaternion.{c}", "unit": "1"} for c in "wxyz"}
    return {"topic": "/reference", "quantity": "quaternion", "channels": channels, **more}


def ingest(recording: Path, time: dict[str, Any] | None = None, **streams: Any) -> dict[str, pa.Table]:
    settings = Settings.model_validate({"time": time or {"clock": "header_stamp"}, "streams": streams})
    tables = run(recording, settings, Stand())
    for name, table in tables.items():
        assert violations(name, table) == []
    return tables


def columns(table: pa.Table, *names: str) -> Float:
    return np.column_stack([table.column(name).to_numpy() for name in names])


def findings(tables: dict[str, pa.Table]) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = tables["findings"].to_pylist()
    return found


@pytest.fixture
def rates() -> Float:
    return np.random.default_rng(1).normal(size=(N, 3))


@pytest.fixture
def recording(tmp_path: Path, rates: Float) -> Path:
    path = tmp_path / "run.mcap"
    formats.write(path, [gyro(rates)])
    return path


def test_rates_clocks_and_order_are_those_of_the_recording(recording: Path, rates: Float) -> None:
    table = ingest(recording, gyro=imu())["gyro"]
    assert np.array_equal(columns(table, "p", "q", "r"), rates)
    assert np.array_equal(table.column("time").to_numpy(), STAMP)
    assert np.array_equal(table.column("header_stamp").to_numpy(), STAMP)
    assert np.array_equal(table.column("log_time").to_numpy(), STAMP + 1000)


def test_another_clock_is_the_plans_choice(recording: Path) -> None:
    table = ingest(recording, {"clock": "log_time"}, gyro=imu())["gyro"]
    assert np.array_equal(table.column("time").to_numpy(), STAMP + 1000)
    own = ingest(recording, gyro=imu(time={"clock": "log_time"}))["gyro"]
    assert own.equals(table)


def test_scale_offset_sign_and_unit_come_in_that_order(recording: Path, rates: Float) -> None:
    stream = imu("deg/s")
    stream["channels"]["q"] |= {"scale": 2.0, "offset": -0.5, "sign": -1}
    table = ingest(recording, gyro=stream)["gyro"]
    expected = rates * np.pi / 180
    expected[:, 1] = -(2.0 * rates[:, 1] - 0.5) * np.pi / 180
    assert columns(table, "p", "q", "r") == pytest.approx(expected, rel=ROUNDING)


def test_rotation_takes_sensor_axes_to_body_axes(recording: Path, rates: Float) -> None:
    R = [[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [0.8, 0.6, 0.0]]
    table = ingest(recording, gyro=imu(rotation=R))["gyro"]
    expected = np.column_stack(
        [rates[:, 2], 0.6 * rates[:, 0] - 0.8 * rates[:, 1], 0.8 * rates[:, 0] + 0.6 * rates[:, 1]]
    )
    assert columns(table, "p", "q", "r") == pytest.approx(expected, abs=1e-15)  # two products, values near 1


def test_what_is_not_finite_stays_so_and_disturbs_nothing_else(tmp_path: Path, rates: Float) -> None:
    rates[3, 0], rates[5, 1], rates[7] = np.inf, np.nan, 1e308
    path = tmp_path / "run.mcap"
    formats.write(path, [gyro(rates)])
    stream = imu("rev/s", rotation=AXES.tolist())
    found = columns(ingest(path, gyro=stream)["gyro"], "p", "q", "r")
    assert np.flatnonzero(~np.isfinite(found).all(axis=1)).tolist() == [3, 5, 7]


def test_increments_become_their_own_table(recording: Path, rates: Float) -> None:
    stream = imu("arcsec")
    stream["quantity"] = "angle_increment"
    tables = ingest(recording, gyro=stream)
    assert "gyro" not in tables
    found = columns(tables["gyro_increments"], "increment_p", "increment_q", "increment_r")
    assert found == pytest.approx(rates * np.pi / 180 / 3600, rel=ROUNDING)


def angles() -> Float:
    rng = np.random.default_rng(2)
    return np.column_stack([rng.uniform(-3, 3, N), rng.uniform(-1.4, 1.4, N), rng.uniform(-3, 3, N)])


def test_quaternions_become_euler_krylov_angles(tmp_path: Path) -> None:
    expected = angles()
    path = tmp_path / "run.mcap"
    formats.write(path, [reference(-quaternion_from_euler_krylov(expected))])  # the sign means nothing
    tables = ingest(path, reference=optical())
    # 1e-14: the angles are well conditioned up to theta = 1.4 rad, amplification 1/cos(1.4) = 6
    assert columns(tables["reference"], "psi", "theta", "gamma") == pytest.approx(expected, abs=1e-14)
    assert findings(tables) == []


AXES = np.array([[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [0.8, 0.6, 0.0]])
TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@pytest.mark.parametrize("quantity", ["quaternion", "euler_krylov"])
def test_axes_of_a_reference_are_turned_on_both_sides(tmp_path: Path, quantity: str) -> None:
    """The matrix from body to reference axes is R_ref A R_body^T, A the reported one."""
    true = matrix_from_quaternion(quaternion_from_euler_krylov(angles()))
    reported = TURN.T @ true @ AXES
    quaternion = np.array([quaternion_from_matrix(A) for A in reported])
    turned = {"rotation": AXES.tolist(), "reference_rotation": TURN.tolist()}
    if quantity == "quaternion":
        path = tmp_path / "run.mcap"
        formats.write(path, [reference(quaternion)])
        table = ingest(path, reference=optical(**turned))["reference"]
    else:
        path = tmp_path / "run.csv"
        plain = tmp_path / "plain.mcap"
        formats.write(plain, [reference(quaternion)])
        reported_angles = columns(ingest(plain, reference=optical())["reference"], "psi", "theta", "gamma")
        np.savetxt(path, reported_angles, delimiter=",", header="psi,theta,gamma", comments="", fmt="%.17g")
        channels = {name: {"field": name, "unit": "rad"} for name in ("psi", "theta", "gamma")}
        stream = {"quantity": quantity, "channels": channels, **turned}
        table = ingest(path, {"rate": 1.0}, reference=stream)["reference"]
    # 1e-7: near theta = 90 deg of the reported angles psi and gamma lose half their digits, in one sample
    assert columns(table, "psi", "theta", "gamma") == pytest.approx(angles(), abs=1e-7)


def test_recorded_angles_without_rotation_stay_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("psi,theta,gamma\n360,95,-720\n361,96,-721\n")
    channels = {name: {"field": name, "unit": "deg"} for name in ("psi", "theta", "gamma")}
    stream = {"quantity": "euler_krylov", "channels": channels}
    table = ingest(path, {"rate": 1.0}, reference=stream)["reference"]
    assert columns(table, "psi", "theta", "gamma")[0] == pytest.approx(
        [2 * np.pi, np.radians(95), -4 * np.pi], rel=ROUNDING
    )


def test_quaternions_that_are_none_are_said(tmp_path: Path) -> None:
    quaternion = quaternion_from_euler_krylov(angles())
    quaternion[3] *= 1.01
    quaternion[4] *= 1.0005  # as single precision or four decimals leave it
    quaternion[7] = 0.0
    quaternion[9, 2] = np.nan
    quaternion[10] = np.inf
    path = tmp_path / "run.mcap"
    formats.write(path, [reference(quaternion)])
    tables = ingest(path, reference=optical())
    found = columns(tables["reference"], "psi", "theta", "gamma")
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [7, 9, 10]
    assert found[3] == pytest.approx(angles()[3], abs=1e-14)
    assert [(f["kind"], f["count"], f["start"], f["end"]) for f in findings(tables)] == [
        ("quaternion norm", 1, STAMP[3], STAMP[3]),
        ("zero quaternion", 1, STAMP[7], STAMP[7]),
    ]


CSV = "t,p,q,r,psi,theta,gamma\n"


def csv_streams(*names: str) -> dict[str, Any]:
    channels = {
        "gyro": ("angular_rate", "p q r", "rad/s"),
        "reference": ("euler_krylov", "psi theta gamma", "rad"),
    }
    return {
        name: {"quantity": q, "channels": {c: {"field": c, "unit": u} for c in cs.split()}}
        for name, (q, cs, u) in channels.items()
        if name in names
    }


def test_rows_without_a_value_of_the_stream_are_no_samples_of_it(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(CSV + "0.5,1,2,3,,,\n1,,,,4,5,6\n1.5,1,2,3,4,5,6\n2,,,,,,\n")
    tables = ingest(path, {"field": "t", "unit": "s"}, **csv_streams("gyro", "reference"))
    assert tables["gyro"].column("time").to_pylist() == [500_000_000, 1_500_000_000]
    assert tables["reference"].column("time").to_pylist() == [1_000_000_000, 1_500_000_000]
    assert tables["gyro"].column("log_time").null_count == 2
    assert findings(tables) == []


def test_single_missing_values_become_nan_and_a_finding(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(CSV + "0,1,2,3,,,\n1,1,,3,,,\n2,1,nan,3,,,\n3,1,,3,,,\n")
    tables = ingest(path, {"field": "t", "unit": "s"}, **csv_streams("gyro"))
    assert np.isnan(tables["gyro"].column("q").to_numpy()).tolist() == [False, True, True, True]
    (found,) = findings(tables)
    assert (found["kind"], found["channel"], found["severity"]) == ("missing value", "q", "warning")
    assert (found["count"], found["start"], found["end"]) == (2, 10**9, 3 * 10**9)


def test_samples_without_time_are_left_out_and_said(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(CSV + "0,1,2,3,,,\n,1,2,3,,,\n2,1,2,3,,,\n")
    tables = ingest(path, {"field": "t", "unit": "s"}, **csv_streams("gyro"))
    assert tables["gyro"].column("time").to_pylist() == [0, 2 * 10**9]
    (found,) = findings(tables)
    assert (found["kind"], found["severity"], found["count"]) == ("missing time", "error", 1)


def test_losses_are_findings_and_say_what_they_do_to_a_rate(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(CSV + "0,1,2,3,4,5,6\n1,2\n2,1,2,3,4,5,6\n3,1,2,3,4,5,6\n")
    tables = ingest(path, {"rate": 400.0}, **csv_streams("gyro"))
    assert tables["gyro"].column("time").to_pylist() == [0, 2_500_000, 5_000_000]
    loss, uncertain = findings(tables)
    assert (loss["stage"], loss["stream"], loss["kind"], loss["severity"]) == (
        "ingest",
        "gyro",
        "loss",
        "error",
    )
    assert (uncertain["kind"], uncertain["stream"]) == ("uncertain time", "gyro")
    both = ingest(path, {"field": "t", "unit": "s"}, **csv_streams("gyro", "reference"))
    assert [(f["kind"], f["stream"]) for f in findings(both)] == [("loss", "recording")]


def test_a_cut_recording_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(CSV + "0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n2,1,2,3,4")
    tables = ingest(path, {"field": "t", "unit": "s"}, **csv_streams("gyro", "reference"))
    assert (tables["gyro"].num_rows, tables["reference"].num_rows) == (2, 2)
    assert [(f["kind"], f["count"]) for f in findings(tables)] == [("loss", 1)]


def test_a_text_layout_is_handed_on(tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    path.write_text("junk\n0;1,5;2;3\n1;1,5;2;3\n")
    text = {
        "delimiter": ";",
        "decimal": ",",
        "skip_lines": 1,
        "header": False,
        "columns": ("t", "p", "q", "r"),
    }
    settings = Settings.model_validate(
        {"time": {"field": "t", "unit": "s"}, "streams": csv_streams("gyro"), "text": text}
    )
    assert run(path, settings, Stand())["gyro"].column("p").to_pylist() == [1.5, 1.5]


def counted(counts: list[float | None], **clock: Any) -> tuple[list[int], list[bool]]:
    topic = pa.table({"n": pa.array(counts, pa.float64())})
    time, there = sample_times(topic, Clock(**({"counter": "n"} | clock)), "here")
    return time.tolist(), there.tolist()


def test_a_counter_leaves_gaps_and_keeps_its_origin() -> None:
    assert counted([4, 5, 8, None, 9], rate=4.0) == (
        [10**9, 1_250_000_000, 2 * 10**9, 0, 2_250_000_000],
        [True, True, True, False, True],
    )


def test_a_counter_wraps_around_where_the_plan_says_so_and_may_step_back() -> None:
    second = 10**9
    time, _ = counted([254, 255, 0, 2, 1, 3], rate=1.0, wraps_at=256)
    assert time == [254 * second, 255 * second, 256 * second, 258 * second, 257 * second, 259 * second]
    time, _ = counted([254, 255, 0], rate=1.0)
    assert time == [254 * second, 255 * second, 0]
    with pytest.raises(StageError, match="wraps_at"):
        counted([254, 256], rate=1.0, wraps_at=256)


@given(
    rate=st.floats(0.01, 1e6),
    first=st.integers(0, 2**40),
    steps=st.lists(st.integers(0, 1000), min_size=1, max_size=20),
)
def test_counted_times_are_exact_to_the_nanosecond(rate: float, first: int, steps: list[int]) -> None:
    counts = [first + sum(steps[:k]) for k in range(len(steps))]
    assume(counts[-1] / rate < 9e9)  # seconds that 64-bit nanoseconds hold
    times, _ = counted([float(c) for c in counts], rate=rate)
    for count, time in zip(counts, times, strict=True):
        # half a nanosecond for each of two roundings, and that of the span: 2e4 / 0.01 s * 1e9 * 2e-16
        assert abs(Fraction(count) * 10**9 / Fraction(rate) - time) <= 1.5


def test_times_beyond_64_bits_are_refused() -> None:
    with pytest.raises(StageError, match="64-bit") as caught:
        counted([0.0, 2.0**52], rate=1e-3)
    assert caught.value.exit_code is ExitCode.USAGE


def refused(code: ExitCode, recording: Path, time: dict[str, Any], *words: str, **streams: Any) -> None:
    with pytest.raises(GyrostandError) as caught:
        ingest(recording, time, **streams)
    assert caught.value.exit_code is code
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_a_clock_that_the_messages_do_not_carry(tmp_path: Path, rates: Float) -> None:
    bag = tmp_path / "run.bag"
    formats.write(bag, [gyro(rates)])
    words = ("publish_time", "header_stamp, log_time", "choose clock")
    refused(ExitCode.USAGE, bag, {"clock": "publish_time"}, *words, gyro=imu())
    text = tmp_path / "run.csv"
    text.write_text(CSV + "0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n")
    words = ("header_stamp", "no clock", "field = …")
    refused(ExitCode.USAGE, text, {"clock": "header_stamp"}, *words, **csv_streams("gyro"))


def test_header_stamps_that_were_never_set(tmp_path: Path, rates: Float) -> None:
    path = tmp_path / "run.mcap"
    formats.write(path, [gyro(rates, np.zeros_like(STAMP))])
    refused(ExitCode.USAGE, path, {"clock": "header_stamp"}, "all 0", "log_time", gyro=imu())
    assert ingest(path, {"clock": "log_time"}, gyro=imu())["gyro"].num_rows == N


def test_a_stream_without_samples(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(CSV + "0,1,2,3,,,\n1,1,2,3,,,\n2,1,2,3,,,\n")
    refused(
        ExitCode.INPUT, path, {"field": "t", "unit": "s"}, "reference", "samples", **csv_streams("reference")
    )


def test_names_that_the_recording_does_not_have(recording: Path) -> None:
    stream = imu()
    stream["topic"] = "/gyr"
    refused(ExitCode.USAGE, recording, {"clock": "log_time"}, "/gyr", "did you mean", gyro=stream)
    stream = imu()
    stream["channels"]["p"]["field"] = "angular_velocity.w"
    refused(ExitCode.USAGE, recording, {"clock": "log_time"}, "did you mean", gyro=stream)


def test_the_same_recording_gives_the_same_tables_in_every_format(tmp_path: Path, rates: Float) -> None:
    mcap, bag, folder = tmp_path / "run.mcap", tmp_path / "run.bag", tmp_path / "run"
    for path in (mcap, bag, folder):
        formats.write(path, [gyro(rates)])
    tables = [ingest(path, gyro=imu())["gyro"] for path in (mcap, bag, folder)]
    for name in ("time", "header_stamp", "log_time", "p", "q", "r"):
        assert tables[0].column(name).to_pylist() == tables[1].column(name).to_pylist()
        assert tables[0].column(name).to_pylist() == tables[2].column(name).to_pylist()


def test_a_gyro_beside_an_optical_reference(shared_data: Path) -> None:
    """BROAD trial 02: 1706 rows without attitude, which were recorded as NaN and stay so."""
    axes = {c: {"field": f"g{a}_rads", "unit": "rad/s"} for c, a in zip("pqr", "xyz", strict=True)}
    quaternion = {c: {"field": f"q{c}", "unit": "1"} for c in "wxyz"}
    tables = ingest(
        shared_data / "csv" / "broad_02_slow_rotation_B.csv",
        {"field": "t_s", "unit": "s"},
        gyro={"quantity": "angular_rate", "channels": axes},
        reference={"quantity": "quaternion", "channels": quaternion},
    )
    assert tables["gyro"].num_rows == tables["reference"].num_rows
    psi = tables["reference"].column("psi").to_numpy()
    assert np.isnan(psi).sum() == 1706
    assert np.diff(tables["gyro"].column("time").to_numpy()[:3]).tolist() == [3_500_000, 3_500_000]


def test_packets_that_were_lost_leave_gaps(shared_data: Path) -> None:
    """The x-IO recorder: no time, packet numbers that skip; 256 packets a second."""
    channels = {c: {"field": f"Gyroscope {c}", "unit": "deg/s"} for c in "XYZ"}
    axes = dict(zip("pqr", channels.values(), strict=True))
    tables = ingest(
        shared_data / "csv" / "sk_xio_00033_CalInertialAndMag.csv",
        {"rate": 256.0, "counter": "Packet number"},
        gyro={"quantity": "angular_rate", "channels": axes},
    )
    time = tables["gyro"].column("time").to_numpy()
    assert (tables["gyro"].num_rows, time[0]) == (12626, round(115 / 256 * 1e9))
    assert set(np.round(np.diff(time) * 256e-9).astype(int).tolist()) == {1, 2, 3}


def test_a_unit_that_the_file_states_otherwise_is_a_finding(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t (s),p (deg/s),q (deg/s),r (rad/s)\n0,1,2,3\n0.1,1,2,3\n")
    channels = {
        "p": {"field": "p", "unit": "rad/s"},
        "q": {"field": "q", "unit": "°/s"},
        "r": {"field": "r", "unit": "rad/s"},
    }
    streams = {"gyro": {"quantity": "angular_rate", "channels": channels}}
    found = findings(ingest(path, {"field": "t", "unit": "s"}, **streams))
    assert [(f["kind"], f["channel"], f["severity"]) for f in found] == [
        ("contradicted unit", "p", "warning")
    ]
    assert "'deg/s'" in found[0]["detail"]
