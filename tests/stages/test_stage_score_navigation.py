"""Score of a navigation: errors that were put in come out, phase by phase, with and without truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import navigation_streams as streams
import numpy as np
import pyarrow as pa
import pytest
from navigation_streams import SECOND, changed

from pipeline import contracts
from pipeline.models.ellipsoid import displaced
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.numerics.rotation import quaternion_from_rotation_vector, quaternion_multiply
from pipeline.simulate.navigation import NavigationRecord
from pipeline.simulate.navigation_scenarios import CRUISE
from pipeline.simulate.navigation_settings import Manoeuvre
from pipeline.simulate.recording import START
from pipeline.stages import score_navigation
from pipeline.stages.base import Stand
from pipeline.storage.contract_check import violations

Tables = dict[str, pa.Table]
N = 601
SECONDS = np.arange(N) * 0.1
STAMPS = START + np.arange(N, dtype=np.int64) * (SECOND // 10)
PHASE = np.select([SECONDS < 30, SECONDS < 40], ["aided", "outage"], "reacquired")
NED = ("north", "east", "down")


@pytest.fixture(scope="module")
def flight() -> NavigationRecord:
    return streams.record("ideal", 60.0)


def navigation(
    flight: NavigationRecord,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
    method: str = "filter",
    **columns: Any,
) -> pa.Table:
    """A table of one method with errors: N, E, D [m], [m/s], rotation vector [rad]; each (N, 3)."""
    motion, none = (
        flight.at(SECONDS) if hasattr(flight, "at") else flight.flight.at(SECONDS),
        np.zeros((N, 3)),
    )
    here = displaced(motion.position, none if position is None else position)
    turned = quaternion_from_rotation_vector(none if rotation is None else rotation)
    angles = yaw_pitch_roll(quaternion_multiply(turned, motion.attitude))
    speed = motion.velocity + (none if velocity is None else velocity)
    contract = contracts.contract("navigation")
    found: dict[str, Any] = {}
    for column in contract.columns:
        if column.nullable:
            found[column.name] = np.full(N, np.nan)
        elif column.type == pa.bool_():
            found[column.name] = np.zeros(N, dtype=np.bool_)
        else:
            found[column.name] = np.zeros(N)
    found |= {"time": STAMPS, "method": [method] * N, "phase": PHASE.tolist()}
    for names, values in (
        (("latitude", "longitude", "height"), here),
        (("v_north", "v_east", "v_down"), speed),
        (("yaw", "pitch", "roll"), angles),
    ):
        found |= dict(zip(names, values.T, strict=True))
    return contracts.table("navigation", found | columns)


def scored(tables: Tables, **settings: Any) -> tuple[Tables, dict[tuple[str, str], Any]]:
    kept = {
        n: t for n, t in tables.items() if n in (*score_navigation.CONSUMES, *score_navigation.MAY_CONSUME)
    }
    plan = score_navigation.Settings.model_validate({"settling_s": 10.0} | settings)
    out = score_navigation.run(kept, plan, Stand())
    assert set(out) == set(score_navigation.PRODUCES)
    for name, table in out.items():
        assert violations(name, table) == []
    figures = {(m["channel"], m["name"]): m for m in out["metrics"].to_pylist()}
    assert {name for _, name in figures} <= set(score_navigation.METRICS)
    return out, figures


def truth(flight: NavigationRecord, rate: float = 50.0) -> Tables:
    return {n: t for n, t in streams.tables(flight, truth_rate=rate).items() if n.startswith("truth")}


def test_errors_that_were_put_in_come_out(flight: NavigationRecord) -> None:
    rng = np.random.default_rng(1)
    position, velocity, rotation = (
        5 * rng.normal(size=(N, 3)),
        rng.normal(size=(N, 3)),
        0.01 * rng.normal(size=(N, 3)),
    )
    out, _ = scored({"navigation": navigation(flight, position, velocity, rotation)} | truth(flight))
    errors = out["navigation_errors"]
    found = {
        k: np.stack([errors[f"{k}_{a}"].to_numpy() for a in NED], axis=1)
        for k in ("position", "velocity", "phi")
    }
    # a position of 1 rad is rounded at 1e-16 of 6e6 m, twice; the displacement's third order is 1e-18
    assert found["position"] == pytest.approx(position, abs=5e-9)
    assert found["velocity"] == pytest.approx(velocity, abs=1e-12)  # truth sampled at these instants
    assert found["phi"] == pytest.approx(rotation, abs=1e-12)
    assert errors["phase"].to_pylist() == PHASE.tolist()


@pytest.mark.parametrize(("rate", "tolerance"), [(10.0, 5e-7), (1.0, 5e-3)])
def test_truth_is_interpolated_between_its_samples(rate: float, tolerance: float) -> None:
    """In a turn: a cubic with the velocities errs by h^4/384 of the fourth derivative, here 1 m/s^4."""
    turn = Manoeuvre(kind="turn", start=5.0, length=30.0, amount=np.pi / 2)
    record = streams.record("ideal", flight=replace(CRUISE, duration=60.0, manoeuvres=(turn,)))
    out, _ = scored({"navigation": navigation(record)} | truth(record, rate))
    errors = out["navigation_errors"]
    assert max(np.abs(errors[f"position_{a}"].to_numpy()).max() for a in NED) < tolerance


def test_figures_of_each_phase(flight: NavigationRecord) -> None:
    """Errors of 3 and 4 m in the horizontal plane but in the transient and the outage."""
    position = np.tile([3.0, 4.0, -2.0], (N, 1))
    position[SECONDS < 10] = 100.0
    position[PHASE == "outage"] *= np.linspace(1, 6, 100)[:, np.newaxis]
    velocity = np.tile([0.6, 0.8, 0.0], (N, 1))
    _, figures = scored({"navigation": navigation(flight, position, velocity)} | truth(flight))

    def value(channel: str, name: str) -> float:
        return float(figures[channel, name]["value"])

    # positions are rounded at 1e-9 m
    assert value("filter.aided", "horizontal_position_rms") == pytest.approx(5.0, abs=1e-7)
    assert value("filter.aided", "horizontal_position_max") == pytest.approx(5.0, abs=1e-7)
    assert value("filter.aided", "height_rms") == pytest.approx(2.0, abs=1e-7)
    assert value("filter.aided", "velocity_rms") == pytest.approx(1.0, abs=1e-9)
    assert value("filter.outage", "horizontal_position_max") == pytest.approx(30.0, abs=1e-6)
    assert value("filter", "outage_drift") == pytest.approx(30.0, abs=1e-6)
    assert value("filter", "reacquisition_time") == pytest.approx(0.1, abs=1e-9)
    # the transient at the beginning is in no figure, and counts where it is asked for
    _, all_of_it = scored({"navigation": navigation(flight, position)} | truth(flight), settling_s=0.0)
    assert all_of_it["filter.aided", "horizontal_position_max"]["value"] > 100


def test_tilt_and_yaw(flight: NavigationRecord) -> None:
    """Roll and pitch wrong by 1 and 2 degrees, yaw by 3, in a level flight."""
    motion = flight.flight.at(SECONDS)
    angles = yaw_pitch_roll(motion.attitude) + np.deg2rad([3.0, 2.0, 1.0])
    columns = dict(zip(("yaw", "pitch", "roll"), angles.T, strict=True))
    _, figures = scored({"navigation": navigation(flight, **columns)} | truth(flight))
    assert figures["filter.aided", "tilt_rms"]["value"] == pytest.approx(np.sqrt((1 + 4) / 2), abs=1e-9)
    assert figures["filter.aided", "yaw_rms"]["value"] == pytest.approx(3.0, abs=1e-9)


def test_errors_over_their_standard_deviations(flight: NavigationRecord) -> None:
    rng = np.random.default_rng(2)
    position = 5 * rng.normal(size=(N, 3))
    sigmas = {f"sigma_{a}": np.full(N, 5.0) for a in NED} | {f"sigma_v_{a}": np.zeros(N) for a in NED}
    sigmas |= {f"sigma_phi_{a}": np.full(N, 0.01) for a in NED}
    _, figures = scored({"navigation": navigation(flight, position, **sigmas)} | truth(flight))
    # the aided phase after the transient has 200 instants of three axes: 1 +- 0.029, four of them
    assert figures["filter.aided", "position_error_ratio"]["value"] == pytest.approx(1.0, abs=0.12)
    assert figures["filter.aided", "velocity_error_ratio"]["value"] is None  # no deviation is no ratio
    _, figures = scored({"navigation": navigation(flight, position, method="strapdown")} | truth(flight))
    assert ("strapdown.aided", "position_error_ratio") not in figures


def test_settling_and_errors_of_the_biases(flight: NavigationRecord) -> None:
    """An exponential of 4 s: within 5 % of its final value after 4 ln 20 = 12.0 s, 1 % after 18.4 s."""
    bias = np.array([0.15, -0.15, 0.1])
    rising = 1 - np.exp(-SECONDS / 4.0)
    columns = {f"accelerometer_bias_{a}": b * rising for a, b in zip("xyz", bias, strict=True)}
    columns |= {f"sigma_accelerometer_bias_{a}": np.full(N, 1e-3) for a in "xyz"}
    table = navigation(flight, **columns)
    _, figures = scored({"navigation": table}, accelerometer_bias_m_s2=tuple(bias))
    for percent, seconds in ((5, 4 * np.log(20)), (1, 4 * np.log(100))):
        found = figures["filter", f"accelerometer_bias_settling_time_{percent}"]["value"]
        assert seconds <= found <= seconds + 0.1  # rows each 0.1 s
    assert ("filter", "gyro_bias_settling_time_5") not in figures  # none is estimated
    error = figures["filter", "accelerometer_bias_error"]
    assert error["value"] == pytest.approx(np.linalg.norm(bias) * np.exp(-15), rel=1e-6)
    assert error["standard_error"] == pytest.approx(np.sqrt(3) * 1e-3, rel=1e-12)
    # without the truth the last tenth of the aided phase stands for it: it lacks exp(-7) of the bias
    _, figures = scored({"navigation": table})
    found = figures["filter", "accelerometer_bias_settling_time_5"]["value"]
    assert found == pytest.approx(4 * np.log(20), abs=0.15)
    assert ("filter", "accelerometer_bias_error") not in figures


def test_a_bias_that_never_settles_has_no_time(flight: NavigationRecord) -> None:
    columns = {f"gyro_bias_{a}": np.linspace(0.0, 1e-3, N) for a in "xyz"}
    true = tuple(np.rad2deg([1e-3] * 3))
    _, figures = scored({"navigation": navigation(flight, **columns)}, gyro_bias_deg_s=true)
    assert figures["filter", "gyro_bias_settling_time_5"]["value"] is None


def test_without_truth_there_are_residuals(flight: NavigationRecord) -> None:
    position, velocity = np.tile([3.0, 4.0, 9.0], (N, 1)), np.tile([0.3, 0.4, 9.0], (N, 1))
    fixes = {n: t for n, t in streams.tables(flight).items() if n.startswith("gnss")}
    out, figures = scored({"navigation": navigation(flight, position, velocity)} | fixes)
    assert out["navigation_errors"].num_rows == 0
    assert {name for _, name in figures} == {"horizontal_residual_rms", "velocity_residual_rms"}
    assert figures["filter", "horizontal_residual_rms"]["value"] == pytest.approx(5.0, abs=1e-7)
    assert figures["filter", "velocity_residual_rms"]["value"] == pytest.approx(0.5, abs=1e-9)


def test_truth_at_another_time_is_said(flight: NavigationRecord) -> None:
    late = {n: changed(t, time=t["time"].to_numpy() + 3600 * SECOND) for n, t in truth(flight).items()}
    out, figures = scored({"navigation": navigation(flight)} | late)
    assert [row["kind"] for row in out["findings"].to_pylist()] == ["no truth"]
    assert figures["filter.aided", "horizontal_position_rms"]["value"] is None


def test_part_of_the_truth_will_do(flight: NavigationRecord) -> None:
    only = {"truth_position": truth(flight)["truth_position"]}
    out, figures = scored({"navigation": navigation(flight)} | only)
    # without velocities a line: a straight flight
    assert figures["filter.aided", "horizontal_position_rms"]["value"] < 1e-6
    assert figures["filter.aided", "velocity_rms"]["value"] is None
    assert out["navigation_errors"]["velocity_north"].null_count == N


def test_a_gap_in_the_truth_is_not_interpolated(flight: NavigationRecord) -> None:
    kept = np.r_[0:1000, 1500:3001]
    with_gap = {n: t.take(pa.array(kept)) for n, t in truth(flight).items()}
    out, _ = scored({"navigation": navigation(flight)} | with_gap)
    nulls = np.array([v is None for v in out["navigation_errors"]["position_north"].to_pylist()])
    assert np.array_equal(nulls, (SECONDS > 19.98 + 1e-6) & (SECONDS < 30.0 - 1e-6))


def test_normalised_innovations(flight: NavigationRecord) -> None:
    """The mean over a component is one, whatever was refused or came before the transient."""
    count = 60
    time = STAMPS[::10][:count]
    squared = np.where(np.arange(count) < 10, 1000.0, 3.0)
    accepted = np.ones(count, dtype=np.bool_)
    squared[50], accepted[50] = 1e6, False
    innovations = contracts.table(
        "innovations",
        {
            "time": np.repeat(time, 3),
            "method": ["filter"] * (3 * count),
            "aid": ["position"] * (3 * count),
            "component": list(NED) * count,
            "value": np.ones(3 * count),
            "sigma": np.ones(3 * count),
            "unit": ["m"] * (3 * count),
            "normalised_squared": np.repeat(squared, 3),
            "accepted": np.repeat(accepted, 3),
        },
    )
    _, figures = scored({"navigation": navigation(flight), "innovations": innovations})
    assert figures["filter.position", "normalised_innovations"]["value"] == pytest.approx(1.0, rel=1e-12)
    # the band of 49 means of chi-squared with 3 degrees of freedom: 1 -+ 1.96 sqrt(2/147), a little askew
    low, high = (
        figures["filter.position", f"normalised_innovations_{end}"]["value"] for end in ("lower", "upper")
    )
    assert (low, high) == pytest.approx((1 - 0.2286, 1 + 0.2286), abs=0.02)
