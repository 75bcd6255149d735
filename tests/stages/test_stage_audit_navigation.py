"""Audit of the streams of a navigation: what cannot be true is said once, clearly; what is sound is not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import navigation_streams as streams
import numpy as np
import pyarrow as pa
import pytest
from navigation_streams import SECOND, changed

from pipeline.contracts import contract
from pipeline.simulate.navigation_scenarios import CRUISE
from pipeline.stages import audit
from pipeline.stages.base import Stand

Row = dict[str, Any]


def audited(tables: dict[str, pa.Table]) -> tuple[list[Row], dict[tuple[str, str], Any]]:
    out = audit.run({n: t for n, t in tables.items() if n in audit.MAY_CONSUME}, audit.Settings(), Stand())
    for name, table in out.items():
        assert table.schema.equals(contract(name).schema)
    figures = {(m["channel"], m["name"]): m["value"] for m in out["metrics"].to_pylist()}
    return out["findings"].to_pylist(), figures


def said(tables: dict[str, pa.Table], kind: str) -> Row:
    """The one finding of a kind."""
    found = [row for row in audited(tables)[0] if row["kind"] == kind]
    assert len(found) == 1, found
    return found[0]


@pytest.fixture
def flight() -> dict[str, pa.Table]:
    """A minute with noise, as sensors have it."""
    return streams.tables(streams.record("diff", 60.0))


def test_a_sound_record_has_no_finding(flight: dict[str, pa.Table]) -> None:
    findings, figures = audited(flight)
    assert findings == []
    assert figures["gnss_position", "sample_rate"] == pytest.approx(1.0, rel=1e-9)  # stamps are even
    assert figures["gyro", "error_count"] == 0
    # a level flight: gravity, and biases of 0.15 m/s^2 across it
    assert figures["accelerometer", "specific_force_ratio"] == pytest.approx(1.0, abs=0.01)
    # 52 uT, noise of 0.2 uT and a hard iron of 0.15 uT
    assert figures["magnetometer", "magnetic_field"] == pytest.approx(52.0, abs=1.0)
    # noise of 0.6 m at both ends of a way of 400 m, along two axes: 0.3 %
    assert figures["gnss_position", "position_velocity_mismatch"] < 0.01


def test_latitude_and_longitude_exchanged_show_as_a_wrong_way(flight: dict[str, pa.Table]) -> None:
    position = flight["gnss_position"]
    flight["gnss_position"] = changed(
        position, latitude=position["longitude"].to_numpy(), longitude=position["latitude"].to_numpy()
    )
    row = said(flight, "implausible position")
    assert row["severity"] == "error"
    assert "latitude and longitude exchanged?" in row["detail"]
    assert "m/s" in row["detail"]


def test_a_latitude_beyond_the_pole_is_exchanged_too(flight: dict[str, pa.Table]) -> None:
    position = flight["gnss_position"]
    flight["gnss_position"] = changed(
        position, latitude=np.deg2rad(np.full(61, 131.9)), longitude=np.deg2rad(np.full(61, 43.1))
    )
    row = said(flight, "implausible position")
    assert row["severity"] == "error"
    assert row["count"] == 61
    assert "latitudes up to 131.9 deg" in row["detail"]
    assert "latitude and longitude exchanged?" in row["detail"]


def test_degrees_declared_as_radians_are_no_exchange(flight: dict[str, pa.Table]) -> None:
    position = flight["gnss_position"]
    flight["gnss_position"] = changed(position, latitude=np.full(61, 58.0), longitude=np.full(61, 38.8))
    assert "wrong unit, or wrong columns?" in said(flight, "implausible position")["detail"]


def test_north_and_east_of_the_velocity_exchanged(flight: dict[str, pa.Table]) -> None:
    """Flying north, where the two differ most; along the diagonal they do not."""
    tables = streams.tables(streams.record("diff", 60.0, flight=replace(CRUISE, duration=60.0, yaw=0.0)))
    velocity = tables["gnss_velocity"]
    tables["gnss_velocity"] = changed(
        velocity, north=velocity["east"].to_numpy(), east=velocity["north"].to_numpy()
    )
    row = said(tables, "implausible position")
    assert row["severity"] == "error"
    assert "north and east exchanged?" in row["detail"]


def test_a_truth_in_other_axes() -> None:
    tables = streams.tables(streams.record("diff", 60.0, flight=replace(CRUISE, duration=60.0, yaw=0.0)))
    velocity = tables["truth_velocity"]
    tables["truth_velocity"] = changed(
        velocity, north=velocity["east"].to_numpy(), east=velocity["north"].to_numpy()
    )
    row = said(tables, "implausible position")
    assert (row["stream"], row["severity"]) == ("truth_position", "error")
    assert "away from the true velocity" in row["detail"]
    assert "the velocity's north and east exchanged?" in row["detail"]


def test_a_velocity_that_nothing_explains_is_a_warning(flight: dict[str, pa.Table]) -> None:
    north = 3 * flight["gnss_velocity"]["north"].to_numpy()
    flight["gnss_velocity"] = changed(flight["gnss_velocity"], north=north)
    row = said(flight, "implausible position")
    assert row["severity"] == "warning"
    assert "wrong columns, unit or clock?" in row["detail"]


def test_a_slow_vehicle_with_coarse_fixes_is_not_blamed() -> None:
    """3 m/s with fixes of 1 m white and 3 m wandering: from fix to fix noise alone moves 2 m/s."""
    slow = replace(CRUISE, duration=60.0, speed=3.0, lift=None)
    findings, figures = audited(streams.tables(streams.record("gps", 60.0, flight=slow)))
    assert [f for f in findings if f["stream"] == "gnss_position"] == []
    assert figures["gnss_position", "position_velocity_mismatch"] < 0.3


def test_a_pole(flight: dict[str, pa.Table]) -> None:
    flight["gnss_position"] = changed(flight["gnss_position"], latitude=np.deg2rad(np.full(61, 89.95)))
    assert said(flight, "pole")["severity"] == "error"


def test_a_jump_is_a_warning(flight: dict[str, pa.Table]) -> None:
    latitude = flight["gnss_position"]["latitude"].to_numpy().copy()
    latitude[30] += 1e-3  # 6 km
    flight["gnss_position"] = changed(flight["gnss_position"], latitude=latitude)
    row = said(flight, "position jump")
    assert (row["severity"], row["count"]) == ("warning", 2)


@pytest.mark.parametrize(
    ("factor", "severity", "words"),
    [
        (1 / 9.80665, "error", "g where m/s^2 are stated?"),
        (9.80665, "error", "m/s^2 where g are stated?"),
        (1000 / 9.80665, "error", "mg where m/s^2 are stated?"),
        (30.0, "error", "30 times gravity"),
    ],
)
def test_the_unit_of_specific_force(
    flight: dict[str, pa.Table], factor: float, severity: str, words: str
) -> None:
    force = flight["accelerometer"]
    flight["accelerometer"] = changed(force, **{a: factor * force[a].to_numpy() for a in "xyz"})
    row = said(flight, "implausible unit")
    assert row["stream"] == "accelerometer"
    assert row["severity"] == severity
    assert words in row["detail"]


def test_axes_that_look_up(flight: dict[str, pa.Table]) -> None:
    force = flight["accelerometer"]
    flight["accelerometer"] = changed(force, **{a: -force[a].to_numpy() for a in "yz"})
    row = said(flight, "implausible axes")
    assert row["severity"] == "error"
    assert "forward, left, up" in row["detail"]


@pytest.mark.parametrize(
    ("factor", "severity", "words"),
    [
        (1e4, "error", "gauss where tesla are stated?"),
        (1e6, "error", "microtesla where tesla are stated?"),
        (1e3, "error", "nanotesla where microtesla are stated?"),
        (1e-3, "error", "microtesla where nanotesla are stated?"),
        (1e-2, "error", "gauss where microtesla are stated?"),
        (10.0, "error", "milligauss where microtesla are stated?"),
        (200.0, "error", "wrong unit?"),
        (1.6, "warning", "hard iron, or a scale?"),
    ],
)
def test_the_unit_of_the_magnetic_field(
    flight: dict[str, pa.Table], factor: float, severity: str, words: str
) -> None:
    field = flight["magnetometer"]
    flight["magnetometer"] = changed(field, **{a: factor * field[a].to_numpy() for a in "xyz"})
    row = said(flight, "implausible unit")
    assert row["stream"] == "magnetometer"
    assert row["severity"] == severity
    assert words in row["detail"]


@pytest.mark.parametrize("beside", [True, False])
def test_the_unit_of_the_pressure(flight: dict[str, pa.Table], beside: bool) -> None:
    table = flight["barometer"]
    wrong = np.full(table.num_rows, 30782.8)  # 1000 hPa stated as Pa
    flight["barometer"] = changed(table, altitude=wrong)
    if not beside:
        del flight["gnss_position"]
    row = said(flight, "implausible unit")
    assert (row["stream"], row["severity"]) == ("barometer", "error")
    assert row["detail"].startswith("the median altitude by pressure is 30782.8 m")
    assert ("the height by satellites" in row["detail"]) is beside


def test_no_common_time(flight: dict[str, pa.Table]) -> None:
    late = flight["gnss_velocity"]["time"].to_numpy() + 3600 * SECOND
    flight["gnss_velocity"] = changed(flight["gnss_velocity"], time=late)
    row = said(flight, "no common time")
    assert (row["stream"], row["severity"]) == ("gnss_velocity", "error")
    assert row["detail"].count(" to ") == 2


def test_bursts_of_nan_are_counted(flight: dict[str, pa.Table]) -> None:
    x = flight["accelerometer"]["x"].to_numpy().copy()
    x[100:110] = np.nan
    x[500:503] = np.nan
    north = flight["gnss_velocity"]["north"].to_numpy().copy()
    north[7] = np.nan
    flight["accelerometer"] = changed(flight["accelerometer"], x=x)
    flight["gnss_velocity"] = changed(flight["gnss_velocity"], north=north)
    findings, figures = audited(flight)
    assert [(f["stream"], f["kind"], f["count"]) for f in findings] == [
        ("accelerometer", "NaN", 10),
        ("accelerometer", "NaN", 3),
        ("gnss_velocity", "NaN", 1),
    ]
    assert figures["accelerometer", "nan_count"] == 13


def test_a_frozen_receiver(flight: dict[str, pa.Table]) -> None:
    position = flight["gnss_position"]
    held = {name: position[name].to_numpy().copy() for name in ("latitude", "longitude", "height")}
    for values in held.values():
        values[20:40] = values[20]
    flight["gnss_position"] = changed(position, **held)
    findings, figures = audited(flight)
    kinds = {(f["stream"], f["kind"]): f["count"] for f in findings}
    assert kinds["gnss_position", "frozen"] == 20
    assert figures["gnss_position", "frozen_count"] == 20


def test_truth_may_rest(flight: dict[str, pa.Table]) -> None:
    flight["truth_velocity"] = changed(
        flight["truth_velocity"], **{n: np.zeros(3001) for n in ("north", "east", "down")}
    )
    assert audited(flight)[0] == []
