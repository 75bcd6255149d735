"""Ingest of the streams of a navigation: units, axes, shared topics, and what becomes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import navigation_streams as streams
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline import formats
from pipeline.formats.base import Series
from pipeline.models.standard_atmosphere import altitude_of_pressure
from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll
from pipeline.numerics.rotation import matrix_from_quaternion, quaternion_from_matrix, quaternion_multiply
from pipeline.simulate.navigation import simulate_navigation
from pipeline.stages import audit, ingest
from pipeline.stages.base import Stand
from pipeline.storage.contract_check import violations
from pipeline.testplan import load_plan

N = 50
STAMP = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 10**7
ENU_TO_NED = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
FLU_TO_FRD = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
RANDOM = np.random.default_rng(3)


def ingested(recording: Path, **named: Any) -> dict[str, pa.Table]:
    plan = {"time": {"clock": "header_stamp"}, "streams": named}
    found = ingest.run(recording, ingest.Settings.model_validate(plan), Stand())
    for name, one in found.items():
        assert violations(name, one) == []
    return found


def written(path: Path, kind: str, columns: dict[str, NDArray[np.float64]], topic: str = "/s") -> Path:
    recording = path / "run.mcap"
    formats.write(recording, [Series(topic, kind, STAMP, STAMP, columns)])
    return recording


def stream(quantity: str, unit: str, fields: dict[str, str], **more: Any) -> dict[str, Any]:
    channels = {channel: {"field": path, "unit": unit} for channel, path in fields.items()}
    return {"topic": "/s", "quantity": quantity, "channels": channels, **more}


def columns(table: pa.Table, *names: str) -> NDArray[np.float64]:
    return np.stack([table.column(name).to_numpy() for name in names], axis=1)


def test_two_streams_of_one_topic(tmp_path: Path) -> None:
    """Gyro and accelerometer of one message, the latter in g and in axes of its own."""
    rates, forces = RANDOM.normal(size=(2, N, 3))
    message = {f"angular_velocity.{a}": rates[:, k] for k, a in enumerate("xyz")}
    message |= {f"linear_acceleration.{a}": forces[:, k] for k, a in enumerate("xyz")}
    recording = written(tmp_path, "sensor_msgs/msg/Imu", message)
    found = ingested(
        recording,
        gyro=stream("angular_rate", "deg/s", dict(zip("pqr", list(message)[:3], strict=True))),
        accelerometer=stream(
            "specific_force", "g", {a: f"linear_acceleration.{a}" for a in "xyz"}, rotation=FLU_TO_FRD
        ),
    )
    assert found["findings"].num_rows == 0
    assert np.array_equal(found["gyro"]["time"].to_numpy(), found["accelerometer"]["time"].to_numpy())
    # one product, and a matrix of ones and zeros
    assert columns(found["gyro"], "p", "q", "r") == pytest.approx(np.deg2rad(rates), rel=1e-15)
    turned = forces * 9.80665 * np.array([1, -1, -1])
    assert columns(found["accelerometer"], "x", "y", "z") == pytest.approx(turned, rel=1e-15)


@pytest.mark.parametrize(
    ("unit", "factor"), [("T", 1.0), ("uT", 1e-6), ("µT", 1e-6), ("nT", 1e-9), ("gauss", 1e-4), ("mG", 1e-7)]
)
def test_units_of_the_magnetic_field(tmp_path: Path, unit: str, factor: float) -> None:
    field = RANDOM.normal(size=(N, 3))
    message = {f"magnetic_field.{a}": field[:, k] for k, a in enumerate("xyz")}
    recording = written(tmp_path, "sensor_msgs/msg/MagneticField", message)
    fields = {a: f"magnetic_field.{a}" for a in "xyz"}
    table = ingested(recording, magnetometer=stream("magnetic_field", unit, fields))["magnetometer"]
    assert columns(table, "x", "y", "z") == pytest.approx(factor * field, rel=1e-15)  # one product


def test_an_unknown_unit_of_the_magnetometer_is_refused() -> None:
    fields = {a: f"magnetic_field.{a}" for a in "xyz"}
    with pytest.raises(ValidationError, match="known units of magnetic flux density: T, mT, uT, nT, G, mG"):
        ingested(Path("run.mcap"), magnetometer=stream("magnetic_field", "counts", fields))


def test_positions_with_and_without_the_kind_of_fix(tmp_path: Path) -> None:
    degrees = np.column_stack([58 + 1e-5 * np.arange(N), np.full(N, 38.85), np.full(N, 100.0)])
    status = np.where(np.arange(N) < 5, -1.0, 0.0)
    message = dict(zip(("latitude", "longitude", "altitude"), degrees.T, strict=True))
    message["status.status"] = status
    recording = written(tmp_path, "sensor_msgs/msg/NavSatFix", message)
    plan = stream("geodetic_position", "deg", {"latitude": "latitude", "longitude": "longitude"})
    plan["channels"]["height"] = {"field": "altitude", "unit": "m"}
    table = ingested(recording, gnss_position=plan)["gnss_position"]
    assert table["fix"].null_count == N
    assert columns(table, "latitude", "longitude") == pytest.approx(np.deg2rad(degrees[:, :2]), rel=1e-15)
    plan["channels"]["fix"] = {"field": "status.status", "unit": "1"}
    table = ingested(recording, gnss_position=plan)["gnss_position"]
    assert np.array_equal(table["fix"].to_numpy(), status)


def test_velocities_east_north_up(tmp_path: Path) -> None:
    """The plan names what each field is; a sign turns up to down."""
    v = RANDOM.normal(size=(N, 3))
    message = {f"twist.linear.{a}": v[:, k] for k, a in enumerate("xyz")}
    recording = written(tmp_path, "geometry_msgs/msg/TwistStamped", message)
    fields = dict(zip(("east", "north", "down"), message, strict=True))
    plan = stream("ned_velocity", "km/h", fields)
    plan["channels"]["down"]["sign"] = -1
    table = ingested(recording, gnss_velocity=plan)["gnss_velocity"]
    # one product
    assert columns(table, "north", "east", "down") == pytest.approx(
        v[:, [1, 0, 2]] * np.array([1, 1, -1]) / 3.6, rel=1e-15
    )


@pytest.mark.parametrize("name", ["external_attitude", "truth_attitude"])
def test_attitudes_of_the_convention_of_ros(tmp_path: Path, name: str) -> None:
    """Forward, left, up against east, north, up becomes yaw from north to the east, pitch up, roll right."""
    angles = RANDOM.uniform([-3, -1.4, -3], [3, 1.4, 3], size=(N, 3))
    ned_frd = quaternion_from_yaw_pitch_roll(angles)
    from_ned, to_frd = quaternion_from_matrix(ENU_TO_NED), quaternion_from_matrix(FLU_TO_FRD)
    # Both turns are their own inverses.
    enu_flu = quaternion_multiply(quaternion_multiply(from_ned, ned_frd), to_frd)
    message = {f"quaternion.{a}": enu_flu[:, k] for k, a in enumerate("wxyz")}
    recording = written(tmp_path, "geometry_msgs/msg/QuaternionStamped", message)
    plan = stream(
        "quaternion",
        "1",
        {a: f"quaternion.{a}" for a in "wxyz"},
        rotation=FLU_TO_FRD,
        reference_rotation=ENU_TO_NED,
    )
    table = ingested(recording, **{name: plan})[name]
    # roundings of four products, magnified by 1/cos(1.4) = 6
    assert columns(table, "yaw", "pitch", "roll") == pytest.approx(angles, abs=1e-14)


def test_yaw_pitch_and_roll_as_they_are_and_turned(tmp_path: Path) -> None:
    angles = RANDOM.uniform([-3, -1.4, -3], [3, 1.4, 3], size=(N, 3))
    message = {f"vector.{a}": np.rad2deg(angles[:, k]) for k, a in enumerate("xyz")}
    recording = written(tmp_path, "geometry_msgs/msg/Vector3Stamped", message)
    fields = dict(zip(("yaw", "pitch", "roll"), (f"vector.{a}" for a in "xyz"), strict=True))
    plan = stream("yaw_pitch_roll", "deg", fields)
    table = ingested(recording, external_attitude=plan)["external_attitude"]
    assert columns(table, *fields) == pytest.approx(angles, rel=1e-15)
    R = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # a sensor whose axis 1 points to the right
    plan["rotation"] = R
    turned = ingested(recording, external_attitude=plan)["external_attitude"]
    C = matrix_from_quaternion(quaternion_from_yaw_pitch_roll(angles)) @ np.array(R).T
    found = matrix_from_quaternion(quaternion_from_yaw_pitch_roll(columns(turned, *fields)))
    assert found == pytest.approx(C, abs=1e-14)  # roundings of a few products


def test_a_pressure_becomes_an_altitude(tmp_path: Path) -> None:
    pressure = np.linspace(950.0, 1013.25, N)
    recording = written(tmp_path, "geometry_msgs/msg/PointStamped", {"point.z": pressure})
    plan = stream("static_pressure", "hPa", {"pressure": "point.z"})
    table = ingested(recording, barometer=plan)["barometer"]
    assert table["pressure"].to_numpy() == pytest.approx(pressure * 100, rel=1e-15)
    assert np.array_equal(table["altitude"].to_numpy(), altitude_of_pressure(table["pressure"].to_numpy()))
    # as an altitude there is no pressure
    plan = stream("pressure_altitude", "m", {"altitude": "point.z"})
    table = ingested(recording, barometer=plan)["barometer"]
    assert table["pressure"].null_count == N
    assert np.array_equal(table["altitude"].to_numpy(), pressure)


def test_increments_have_a_table_of_their_own(tmp_path: Path) -> None:
    v = RANDOM.normal(size=(N, 3))
    message = {f"vector.{a}": v[:, k] for k, a in enumerate("xyz")}
    recording = written(tmp_path, "geometry_msgs/msg/Vector3Stamped", message)
    plan = stream("velocity_increment", "mm/s", {a: f"vector.{a}" for a in "xyz"})
    table = ingested(recording, accelerometer=plan)["accelerometer_increments"]
    names = [f"increment_{a}" for a in "xyz"]
    assert columns(table, *names) == pytest.approx(v * 1e-3, rel=1e-15)


@pytest.mark.parametrize("name", ["flight.mcap", "flight.bag", "flight.csv", "flight"])
def test_the_simulator_s_recordings_are_read_as_they_were_made(tmp_path: Path, name: str) -> None:
    """Every stream of every format against the arrays that were written."""
    record = simulate_navigation(streams.settings("diff", 4.0), 1)
    recording, plan, _ = record.write(tmp_path / name)
    read = load_plan(plan)
    found = ingest.run(recording, read.settings["ingest"], Stand())  # type: ignore[arg-type]
    expected = streams.tables(record, truth=False)
    assert set(expected) < set(found)
    for table, made in expected.items():
        for column in made.column_names:
            if column in ("header_stamp", "log_time", "publish_time") or made[column].null_count:
                continue
            # positions went through degrees; an attitude through a quaternion, or degrees
            assert found[table][column].to_numpy() == pytest.approx(
                made[column].to_numpy(), rel=1e-14, abs=1e-13
            ), column
    kept = {name: table for name, table in found.items() if name in audit.MAY_CONSUME}
    findings = audit.run(kept, audit.Settings(), Stand())["findings"].to_pylist()
    assert [f for f in findings if f["severity"] == "error"] == []


@pytest.mark.parametrize("delay", [0.25, -1_600_000_000.5])
def test_stamps_that_are_late_are_put_right_and_it_is_said(tmp_path: Path, delay: float) -> None:
    """A quarter of a second of transport; a clock that begins in 2020. The stamps as recorded stay."""
    message = {f"magnetic_field.{a}": RANDOM.normal(size=N) for a in "xyz"}
    recording = written(tmp_path, "sensor_msgs/msg/MagneticField", message)
    fields = dict(zip("xyz", message, strict=True))
    found = ingested(recording, magnetometer=stream("magnetic_field", "T", fields, delay_s=delay))
    table = found["magnetometer"]
    assert np.array_equal(table["time"].to_numpy() + round(delay * 1e3) * 10**6, STAMP)
    assert np.array_equal(table["header_stamp"].to_numpy(), STAMP)
    row = found["findings"].to_pylist()[0]
    assert (row["kind"], row["severity"], row["count"]) == ("delay", "info", N)
