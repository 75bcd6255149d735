"""Calibration from the stream tables: errors over standard errors, triads, turns, positions."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from calibrations import PROVENANCE
from rate_table_stand import ASYMMETRY, BIAS, DEG, RATES, START, S, Stand, tables

from pipeline import contracts
from pipeline.errors import ExitCode, GyrostandError
from pipeline.models import earth
from pipeline.models.multi_position import position
from pipeline.models.rate_table_model import Terms
from pipeline.models.rate_table_steps import TableAxis
from pipeline.stages import _calibration_tables as as_table
from pipeline.stages import base, calibrate, steps
from pipeline.stages._calibration_file import read, text_of
from pipeline.stages._mountings import mountings_table
from pipeline.stages._runs import Run
from pipeline.storage.contract_check import violations

THREE = ("p", "q", "r")
VERTICAL = TableAxis(50 * DEG, 0.3, 0.0)
ON_EARTH = base.Stand(latitude_deg=50.0, table_tilt_deg=0.0, table_heading_deg=float(np.degrees(0.3)))
DEG_H = DEG / 3600


def calibrated(
    made: dict[str, pa.Table],
    stand: base.Stand | None = None,
    step_settings: dict[str, Any] | None = None,
    **settings: Any,
) -> dict[str, pa.Table]:
    """The tables of `calibrate`, after `steps`."""
    stand = stand or base.Stand()
    tables_of = dict(made)
    stages: tuple[tuple[Any, dict[str, Any]], ...] = ((steps, step_settings or {}), (calibrate, settings))
    for stage, chosen in stages:
        wanted = (*stage.CONSUMES, *stage.MAY_CONSUME)
        given = {name: tables_of[name] for name in wanted if name in tables_of}
        out = stage.run(given, stage.Settings.model_validate(chosen), stand)
        tables_of |= out
    assert set(out) == set(calibrate.PRODUCES)
    for name, table in out.items():
        assert violations(name, table) == []
    return out


def told(out: dict[str, pa.Table], gyro: str = "") -> dict[str, tuple[float, float]]:
    """Value and standard error of each parameter of a gyro, or of the triad."""
    rows = [row for row in out["calibration"].to_pylist() if row["gyro"] == gyro]
    return {row["parameter"]: (row["value"], row["standard_error"]) for row in rows}


def kinds(out: dict[str, pa.Table]) -> list[str]:
    return [row["kind"] for row in out["findings"].to_pylist()]


def refused(code: ExitCode, *words: str, made: dict[str, pa.Table], **settings: Any) -> None:
    with pytest.raises(GyrostandError) as caught:
        calibrated(made, **settings)
    assert caught.value.exit_code is code
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value), str(caught.value)


@cache
def single_axis_errors(seeds: int) -> np.ndarray:
    """Normalised errors of bias, scale factor and asymmetry of one gyro, shape (seeds, 3)."""
    found = []
    for seed in range(seeds):
        stand = Stand(channels="r", asymmetry=ASYMMETRY, offset=0.05)
        told_of = told(calibrated(tables(stand, seed, named=False)), "r")
        K = S[2, 2]
        truth = {"bias": BIAS[2], "scale_factor": K, "scale_factor_asymmetry": ASYMMETRY[2] / K}
        found.append([(told_of[n][0] - truth[n]) / told_of[n][1] for n in truth])
    return np.array(found)


def test_errors_of_a_single_axis_over_their_standard_errors() -> None:
    errors = single_axis_errors(60)
    # 180 values, 5.3 %: the band of the requirement is twice that
    assert 0.9 < errors.std() < 1.1
    assert np.all(np.abs(errors.mean(axis=0)) < 3.5 / np.sqrt(60))


@pytest.mark.nightly
def test_errors_of_a_single_axis_over_many_seeds() -> None:
    # each of the three: 200 values, 5 %
    assert np.all(np.abs(single_axis_errors(200).std(axis=0) - 1) < 0.15)
    assert 0.9 < single_axis_errors(200)[:, 1].std() < 1.1


@cache
def triad_errors(seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """Normalised errors of scale factors and misalignments, shapes (seeds, 3) and (seeds, 6)."""
    K = np.linalg.norm(S, axis=1)
    n = S / K[:, np.newaxis]
    truth = {f"scale_factor_{a}": K[i] for i, a in enumerate(THREE)}
    off = {
        f"misalignment_{a}{b}": n[i, j] for i, a in enumerate(THREE) for j, b in enumerate(THREE) if i != j
    }
    scale, angle = [], []
    for seed in range(seeds):
        # with an encoder: of an angle without a zero the Earth's rate at rest is no random error here
        stand = Stand(axes=THREE, across=("q", "r", "p"), earth=VERTICAL, offset=-0.1, by_angle=True)
        made = tables(stand, seed)
        found = told(calibrated(made, ON_EARTH))
        scale.append([(found[k][0] - v) / found[k][1] for k, v in truth.items()])
        angle.append([(found[k][0] - v) / found[k][1] for k, v in off.items()])
    return np.array(scale), np.array(angle)


def test_errors_of_a_triad_over_their_standard_errors() -> None:
    scale, angle = triad_errors(40)
    # 120 and 240 values: 6.5 % and 4.6 %, two and a half times that
    assert 0.84 < scale.std() < 1.16
    assert 0.88 < angle.std() < 1.12


@pytest.mark.nightly
def test_errors_of_a_triad_over_many_seeds() -> None:
    for errors in triad_errors(200):
        assert 0.9 < errors.std() < 1.1


def test_a_single_axis_is_what_a_later_plan_corrects_by() -> None:
    out = calibrated(tables(Stand(channels="q", axes=("q",)), named=False), nonlinearity=(3,))
    rows = out["calibration"].to_pylist()
    model = [row for row in rows if row["role"] == "model"]
    names = tuple(row["parameter"] for row in model)
    assert names == Terms(asymmetry=True, nonlinearity=(3,)).names
    assert {(row["gyro"], row["method"], row["state"]) for row in rows} == {("q", "rates", "determined")}
    assert {row["parameter"] for row in rows} - set(names) == {"linearity_error", "step_scatter"}
    assert all(row["reference_temperature"] is None for row in rows)
    assert all(row["lowest_temperature"] is None for row in rows)
    assert all(row["largest_rate"] == pytest.approx(100 * DEG, rel=1e-9) for row in rows)
    covariance = {(r["row"], r["column"]): r["value"] for r in out["calibration_covariance"].to_pylist()}
    assert len(covariance) == len(names) ** 2
    for row in model:
        own = covariance[row["parameter"], row["parameter"]]
        assert np.sqrt(own) == pytest.approx(row["standard_error"], rel=1e-12)
        for other in names:
            assert covariance[row["parameter"], other] == covariance[other, row["parameter"]]
    residuals = out["calibration_residuals"].to_pylist()
    assert len(residuals) == len(RATES)
    assert {row["fit"] for row in residuals} == {"single axis"}
    for row in residuals:
        assert row["residual_ppm"] == pytest.approx(1e6 * row["residual"] / (S[1, 1] * 100 * DEG), rel=2e-4)
        assert abs(row["residual"]) < 5 * max(row["residual_error"], 1e-9)


def test_a_triad_is_what_a_later_plan_corrects_by_and_single_axes_stand_beside_it() -> None:
    out = calibrated(tables(Stand(axes=THREE, asymmetry=ASYMMETRY), 2))
    rows = out["calibration"].to_pylist()
    model = [row for row in rows if row["role"] == "model"]
    names = [*(f"S{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "bias_p", "bias_q", "bias_r"]
    names += [f"scale_factor_asymmetry_{axis}" for axis in THREE]
    assert [row["parameter"] for row in model] == names
    assert [row["unit"] for row in model] == [*["1"] * 9, *["rad/s"] * 3, *["1"] * 3]
    assert {row["gyro"] for row in model} == {""}
    found = told(out)
    for k, axis in enumerate(THREE):
        value, error = found[f"scale_factor_asymmetry_{axis}"]
        assert value == pytest.approx(ASYMMETRY[k] / S[k, k], abs=5 * error)
        value, error = found[f"bias_{axis}"]
        assert value == pytest.approx(BIAS[k], abs=5 * error)
    assert {row["gyro"] for row in out["calibration_covariance"].to_pylist()} == {""}
    for k, axis in enumerate(THREE):
        own = told(out, axis)
        value, error = own["scale_factor_asymmetry"]
        assert value == pytest.approx(ASYMMETRY[k] / S[k, k], abs=5 * error)
        residuals = [r for r in out["calibration_residuals"].to_pylist() if r["channel"] == axis]
        assert [r["fit"] for r in residuals].count("triad") == 3 * len(RATES)
        assert [r["fit"] for r in residuals].count("single axis") == len(RATES)
    assert kinds(out) == ["Earth's rate"]


def test_every_term_of_a_triad_has_its_unit_and_is_in_the_file(tmp_path: Path) -> None:
    made = tables(Stand(axes=THREE, asymmetry=ASYMMETRY, warm=(285.0, 0.1), rates=np.tile(RATES, 2)), 2)
    terms = {"bias_temperature": True, "scale_factor_temperature": True, "nonlinearity": (3,)}
    out = calibrated(made, **terms)
    units = {row["parameter"]: row["unit"] for row in out["calibration"].to_pylist() if row["gyro"] == ""}
    assert units["bias_temperature_sensitivity_q"] == "rad/s/K"
    assert units["scale_factor_temperature_sensitivity_q"] == "1/K"
    assert units["scale_factor_nonlinearity_3_q"] == units["scale_factor_asymmetry_q"] == "1"
    products = {(r["row"], r["column"]): r["unit"] for r in out["calibration_covariance"].to_pylist()}
    assert products["bias_p", "scale_factor_temperature_sensitivity_q"] == "(rad/s)(1/K)"
    found = told(out)
    for k, axis in enumerate(THREE):
        for name, truth in (
            ("scale_factor_temperature_sensitivity", 0.0),
            ("scale_factor_nonlinearity_3", 0.0),
            ("scale_factor_asymmetry", ASYMMETRY[k] / S[k, k]),
        ):
            value, error = found[f"{name}_{axis}"]
            assert value == pytest.approx(truth, abs=5 * error)
    path = tmp_path / "gyro.calibration.json"
    path.write_text(text_of("table", out["calibration"], out["calibration_covariance"], PROVENANCE))
    model = read(path).models["p q r"]
    assert model.terms == Terms(True, (3,), bias_temperature=True, scale_factor_temperature=True)
    written = {row["parameter"]: row["value"] for row in out["calibration"].to_pylist() if row["gyro"] == ""}
    assert model.value.tolist() == [written[as_table.lettered(name)] for name in model.names]


def test_one_axis_of_a_triad_calibrates_its_gyro_and_tells_what_the_others_see() -> None:
    out = calibrated(tables(Stand(axes=("r",)), 3))
    rows = out["calibration"].to_pylist()
    assert {row["gyro"] for row in rows if row["role"] == "model"} == {"r"}
    cross = told(out)
    assert set(cross) == {"S13", "S23"}
    for name, truth in (("S13", S[0, 2]), ("S23", S[1, 2])):
        assert cross[name][0] == pytest.approx(truth, abs=5 * cross[name][1])


@pytest.mark.parametrize("by_angle", [False, True])
def test_a_gyro_without_noise_has_its_truth(by_angle: bool) -> None:
    stand = Stand(axes=THREE, across=("q", "r", "p"), earth=VERTICAL, by_angle=by_angle, sigma=0.0)
    found = told(calibrated(tables(stand), ON_EARTH))
    for i in range(3):
        for j in range(3):
            # the horizontal Earth rate over whole turns but for one sample of 600: 5e-8 rad/s of 1.7
            assert found[f"S{i + 1}{j + 1}"][0] == pytest.approx(S[i, j], abs=1e-6)


def test_runs_either_way_about_one_axis_are_one_calibration() -> None:
    both = told(calibrated(tables(Stand(channels="p", axes=("p", "-p")), 4)), "p")
    one = told(calibrated(tables(Stand(channels="p", axes=("p",)), 4)), "p")
    assert both["scale_factor"][0] == pytest.approx(S[0, 0], abs=5 * both["scale_factor"][1])
    # twice the steps
    assert both["scale_factor"][1] == pytest.approx(one["scale_factor"][1] / np.sqrt(2), rel=0.2)


def test_what_two_axes_do_not_determine_is_null_and_named() -> None:
    out = calibrated(tables(Stand(axes=("p", "q")), 5))
    rows = {row["parameter"]: row for row in out["calibration"].to_pylist() if row["gyro"] == ""}
    open_ = {"S13", "S23", "S33", "scale_factor_asymmetry_r"}
    for name, row in rows.items():
        if row["role"] == "model":
            assert (row["state"] == "determined") == (name not in open_), name
            assert (row["value"] is None) == (name in open_)
    # what they do tell of the angles is given
    assert rows["misalignment_pq"]["value"] == pytest.approx(S[0, 1] / S[0, 0], abs=1e-4)
    assert rows["scale_factor_q"]["value"] == pytest.approx(S[1, 1], abs=1e-3)
    for name in ("scale_factor_r", "misalignment_pr", "nonorthogonality_pr"):
        assert rows[name]["value"] is None
        assert rows[name]["state"] == "undetermined"
    (finding,) = [f for f in out["findings"].to_pylist() if f["kind"] == "not determined"]
    assert "S13, S23, S33, scale_factor_asymmetry_r" in finding["detail"]


def test_combinations_that_are_determined_are_named() -> None:
    """At rest in two positions: sums of bias and sensitivities are told, and none of them alone."""
    rng = np.random.default_rng(10)
    u = earth.RATE * np.array([0.0, np.cos(50 * DEG), np.sin(50 * DEG)])
    places = [("r", 3, 1), ("-r", -3, 1)] * 2
    parts = [
        S @ position(up, north) @ u + 1e-6 * DEG * rng.standard_normal((100, 3)) for _, up, north in places
    ]
    listed = [
        {"up": name, "north": "p", "start": 100.0 * k, "stop": 100.0 * k + 99.5}
        for k, (name, _, _) in enumerate(places)
    ]
    made = streams(np.arange(400.0), np.concatenate(parts))
    out = calibrated(made, base.Stand(latitude_deg=50.0), methods=("positions",), positions=tuple(listed))
    said = [f["detail"] for f in out["findings"].to_pylist() if f["kind"] == "combination"]
    # bias_p and S11 always come together, at the horizontal rate
    assert any("S11" in words and "bias_p" in words for words in said), said
    rows = {row["parameter"]: row for row in out["calibration"].to_pylist()}
    assert rows["S13"]["state"] == "determined"
    assert rows["S11"]["state"] == "combined"
    assert rows["S12"]["state"] == "undetermined"


def test_the_earth_s_rate_is_taken_out_where_the_stand_is_known() -> None:
    made = tables(Stand(channels="r", earth=VERTICAL, sigma=0.0005 * DEG), 6, named=False)
    up = earth.RATE * np.sin(50 * DEG)
    value, error = told(calibrated(made, ON_EARTH), "r")["bias"]
    assert value == pytest.approx(BIAS[2], abs=5 * error)
    assert error < up / 20
    out = calibrated(made)
    assert kinds(out) == ["Earth's rate"]
    assert "add latitude_deg and table_tilt_deg to [stand]" in out["findings"]["detail"][0].as_py()
    assert told(out, "r")["bias"][0] == pytest.approx(BIAS[2] + S[2, 2] * up, abs=5 * error)


def test_temperature() -> None:
    d = DEG * np.array([1e-3, 2e-3, -1e-3])
    made = tables(Stand(axes=THREE, warm=(285.0, 0.1), bias_temperature=d), 7)
    settings = {"bias_temperature": True, "reference_temperature": 293.15}
    out = calibrated(made, **settings)
    found = told(out)
    for k, axis in enumerate(THREE):
        value, error = found[f"bias_temperature_sensitivity_{axis}"]
        assert value == pytest.approx(d[k], abs=5 * error)
        value, error = found[f"bias_{axis}"]
        assert value == pytest.approx(BIAS[k], abs=5 * error)
        value, error = told(out, axis)["bias_temperature_sensitivity"]
        assert value == pytest.approx(d[k], abs=5 * error)
    rows = out["calibration"].to_pylist()
    assert {row["reference_temperature"] for row in rows} == {293.15}
    # means of steps of a record that begins at 285 K and warms by 0.1 K/s for 161 s
    ((low, high),) = {(row["lowest_temperature"], row["highest_temperature"]) for row in rows}
    assert 285.0 < low < 287.5
    assert 298.5 < high < 301.1
    assert {row["unit"] for row in rows if "temperature" in row["parameter"]} == {"rad/s/K"}
    without = {name: made[name] for name in made if name != "temperature"}
    refused(ExitCode.NOT_MET, "a temperature, for a calibration", made=without, **settings)


def test_fewer_steps_than_unknowns_name_both_counts() -> None:
    made = tables(Stand(channels="r", rates=RATES[:3]), named=False)
    settings = {"nonlinearity": (2, 3)}
    words = ("at least 5 steps for bias, scale_factor, scale_factor_asymmetry", "found 3", "fewer terms")
    refused(ExitCode.NOT_MET, *words, made=made, **settings)
    one_way = tables(Stand(channels="r", rates=np.abs(RATES)), named=False)
    refused(ExitCode.NOT_MET, "scale_factor from scale_factor_asymmetry", "both directions", made=one_way)


def test_terms_that_the_rates_of_a_triad_do_not_tell_are_refused() -> None:
    few = tables(Stand(axes=THREE, rates=RATES[:3]))
    words = ("rate table, gyro 1", "scale_factor from scale_factor_nonlinearity_3", "leave terms out")
    refused(ExitCode.NOT_MET, *words, made=few, nonlinearity=(2, 3))
    one_way = tables(Stand(axes=THREE, rates=np.abs(RATES)))
    refused(ExitCode.NOT_MET, "scale_factor from scale_factor_asymmetry", made=one_way)
    assert {row["gyro"] for row in calibrated(one_way, asymmetry=False)["calibration"].to_pylist()} == {
        "", *THREE
    }  # fmt: skip


def test_a_run_about_an_axis_that_no_channel_has_is_refused() -> None:
    made = tables(Stand(channels="p", axes=("r",)))
    refused(
        ExitCode.USAGE, "one of the gyro's channels, p", "runs about r", made=made,
        step_settings={"time_offset": "none"},
    )  # fmt: skip


def test_an_error_of_the_fixture_widens_the_misalignments() -> None:
    made = tables(Stand(axes=THREE), 8)
    exact, loose = (told(calibrated(made, orientation_error_deg=e)) for e in (0.0, 0.1))
    assert loose["misalignment_pq"][1] == pytest.approx(0.1 * DEG, rel=0.02)
    assert exact["misalignment_pq"][1] < 0.01 * DEG
    assert loose["scale_factor_p"][1] < 2 * exact["scale_factor_p"][1]


def test_a_step_that_lies_far_from_the_model_is_marked() -> None:
    made = tables(Stand(channels="r", rates=np.tile(RATES, 2)), 9, named=False)
    seconds = (made["gyro"]["time"].to_numpy() - made["gyro"]["time"][0].as_py()) * 1e-9
    begin = 4 * 23.0 + 3.0
    values = made["gyro"]["r"].to_numpy().copy()
    values[(seconds > begin) & (seconds < begin + 20.0)] += 0.05 * DEG
    place = made["gyro"].schema.names.index("r")
    made["gyro"] = made["gyro"].set_column(place, made["gyro"].schema.field("r"), pa.array(values))
    (marked,) = [f for f in calibrated(made)["findings"].to_pylist() if f["kind"] == "outlying step"]
    assert "step at -60 deg/s" in marked["detail"]
    assert begin < (marked["start"] - made["gyro"]["time"][0].as_py()) * 1e-9 < begin + 3.0
    sound = tables(Stand(channels="r", rates=np.tile(RATES, 2)), 9, named=False)
    assert kinds(calibrated(sound)) == ["Earth's rate"]


def streams(time: np.ndarray, gyro: np.ndarray) -> dict[str, pa.Table]:
    absent = dict.fromkeys(contracts.contract("gyro").schema.names, pa.nulls(len(time)))
    columns = {"time": START + np.rint(time * 1e9).astype(np.int64), **dict(zip("pqr", gyro.T, strict=True))}
    return {"gyro": contracts.table("gyro", {**absent, **columns})}


def turned(
    rng: np.random.Generator,
    axes: tuple[str, ...] = THREE,
    sigma: float = 0.05 * DEG,
    earth_rate: np.ndarray | None = None,
) -> tuple[dict[str, pa.Table], dict[str, Any]]:
    """One round by hand about each axis, either way, rest between; and the settings that say so."""
    step, rest, length = 0.01, 5.0, 4.0
    parts, turns, rests, clock = [], [], [], 0.0
    t = np.arange(0.0, length, step)
    for axis, way in ((a, w) for a in axes for w in (1, -1)):
        parts.append(np.zeros((int(rest / step), 3)))
        rests.append({"start": clock + 0.2, "stop": clock + rest - 0.2})
        clock += rest
        shape = 1 - np.cos(2 * np.pi * t / length)
        rate = shape / (shape.sum() * step) * way * 2 * np.pi
        parts.append(np.outer(rate, np.eye(3)["pqr".index(axis)]))
        turns.append(
            {"axis": axis, "angle_deg": 360.0 * way, "start": clock - 0.1, "stop": clock + length + 0.1}
        )
        clock += length
    rate = np.concatenate([*parts, np.zeros((int(rest / step), 3))])
    if earth_rate is not None:
        rate = rate + earth_rate
    gyro = rate @ S.T + BIAS + sigma * rng.standard_normal(rate.shape)
    settings = {"methods": ("turns",), "turns": tuple(turns), "rests": tuple(rests)}
    return streams(step * np.arange(len(gyro)), gyro), settings


def test_turns_by_hand_tell_s_and_b() -> None:
    errors = []
    for seed in range(20):
        made, settings = turned(np.random.default_rng(seed))
        out = calibrated(made, **settings)
        found = told(out)
        errors += [
            (found[f"S{i + 1}{j + 1}"][0] - S[i, j]) / found[f"S{i + 1}{j + 1}"][1]
            for i in range(3)
            for j in range(3)
        ]
    # 180 values: 5.3 %, three times that
    assert 0.84 < np.std(errors) < 1.16
    assert {row["method"] for row in out["calibration"].to_pylist()} == {"turns"}
    assert {row["method"] for row in out["calibration_residuals"].to_pylist()} == {"turns"}
    assert kinds(out)[0] == "Earth's rate"


def test_turns_in_several_runs() -> None:
    made, settings = turned(np.random.default_rng(1))
    half = 27.0
    seconds = (made["gyro"]["time"].to_numpy() - START) * 1e-9
    number = (seconds >= half).astype(np.int32)
    place = made["gyro"].schema.names.index("run")
    made["gyro"] = made["gyro"].set_column(place, made["gyro"].schema.field("run"), pa.array(number))
    made["mountings"] = mountings_table([Run(name="a", stop=half), Run(name="b", start=half)])

    def of_run(one: dict[str, Any]) -> dict[str, Any]:
        late = one["start"] >= half - 0.2
        # the second begins when it does, and a turn at its very edge does too
        shift = half if late else 0.0
        return {
            **one, "run": "b" if late else "a",
            "start": max(one["start"] - shift, 0.0), "stop": one["stop"] - shift,
        }  # fmt: skip

    whole = told(calibrated({"gyro": made["gyro"]}, **settings))
    parted = {
        "methods": ("turns",),
        "turns": tuple(of_run(t) for t in settings["turns"]),
        "rests": tuple(of_run(r) for r in settings["rests"]),
    }
    out = calibrated(made, **parted)
    for name, (value, error) in told(out).items():
        if name.startswith("S"):
            assert value == pytest.approx(whole[name][0], abs=error)
    assert {row["run"] for row in out["calibration_residuals"].to_pylist()} == {0, 1}


def test_positions_tell_s_and_b_of_a_good_gyro() -> None:
    rng = np.random.default_rng(11)
    u = earth.RATE * np.array([0.0, np.cos(50 * DEG), np.sin(50 * DEG)])
    names = ("p", "q", "r", "-p", "-q", "-r")
    parts, listed = [], []
    for k, up in enumerate(names):
        north = names[(k % 3 + 1) % 3]
        sign = -1 if up.startswith("-") else 1
        C = position(sign * ("pqr".index(up[-1]) + 1), "pqr".index(north) + 1)
        parts.append(S @ C @ u + BIAS * 1e-3 + 0.01 * DEG / 60 * rng.standard_normal((600, 3)))
        listed.append({"up": up, "north": north, "start": 600.0 * k, "stop": 600.0 * k + 599.5})
    made = streams(np.arange(3600.0), np.concatenate(parts))
    settings: dict[str, Any] = {"methods": ("positions",), "positions": tuple(listed)}
    out = calibrated(made, base.Stand(latitude_deg=50.0), **settings)
    found = told(out)
    for i in range(3):
        for j in range(3):
            value, error = found[f"S{i + 1}{j + 1}"]
            assert value == pytest.approx(S[i, j], abs=4.5 * error)
            assert error < 0.002  # 0.01 deg/sqrt(h) over ten minutes is 0.025 deg/h of 15
    assert out["calibration_residuals"].num_rows == 18
    late = {**listed[0], "start": 1e5, "stop": 2e5}
    with pytest.raises(GyrostandError, match="position, 100000 s to 200000 s: expected samples") as caught:
        calibrated(made, base.Stand(latitude_deg=50.0), methods=("positions",), positions=(late,))
    assert caught.value.exit_code is ExitCode.USAGE


def rates_and_turns(
    rates: np.ndarray, earth_rate: np.ndarray | None = None, seed: int = 12
) -> tuple[dict[str, pa.Table], dict[str, Any]]:
    """Steps of these rates about p and q, and turns about r by hand; the turns as settings.

    With an Earth's rate in the axes of the case by hand [rad/s] there is one on the table too.
    """
    axis = None if earth_rate is None else VERTICAL
    by_rates = tables(Stand(axes=("p", "q"), rates=rates, earth=axis, by_angle=True), seed)
    by_hand, settings = turned(np.random.default_rng(seed), axes=("r",), earth_rate=earth_rate)
    gyro = by_hand["gyro"]
    gyro = gyro.set_column(
        gyro.schema.names.index("run"),
        gyro.schema.field("run"),
        pa.array(np.full(gyro.num_rows, 2, np.int32)),
    )
    mountings = [*by_rates["mountings"].to_pylist(), *mountings_table([Run(name="by hand")]).to_pylist()]
    mountings[2]["run"] = 2
    made = {
        **by_rates,
        "gyro": pa.concat_tables([by_rates["gyro"], gyro]),
        "mountings": base.rows("mountings", mountings),
    }
    parted = {key: tuple({**one, "run": "by hand"} for one in settings[key]) for key in ("turns", "rests")}
    return made, parted


def test_rates_and_turns_join() -> None:
    made, parted = rates_and_turns(RATES)
    out = calibrated(made, methods=("rates", "turns"), **parted)
    rows = [row for row in out["calibration"].to_pylist() if row["role"] == "model"]
    assert {row["method"] for row in rows} == {"joined"}
    assert {row["state"] for row in rows} == {"determined"}
    found = told(out)
    assert found["S33"][0] == pytest.approx(S[2, 2], abs=5 * found["S33"][1])
    methods = [r["method"] for r in out["calibration_residuals"].to_pylist() if r["fit"] == "triad"]
    assert set(methods) == {"rates", "turns"}
    value, error = found["scale_factor_asymmetry_r"]
    assert value == pytest.approx(0.0, abs=5 * error)
    bent = calibrated(made, methods=("rates", "turns"), nonlinearity=(3,), **parted)
    assert "scale_factor_nonlinearity_3_p" not in told(bent)
    assert told(bent, "p")["scale_factor_nonlinearity_3"][1] > 0
    (said,) = [f["detail"] for f in bent["findings"].to_pylist() if f["kind"] == "terms"]
    assert said == "the triad is without scale_factor_nonlinearity_3, which turns do not tell"


def test_the_earth_s_rate_in_the_turns_is_an_error_of_their_biases() -> None:
    rng = np.random.default_rng(13)
    errors, own = [], []
    for seed in range(20):
        u = rng.standard_normal(3)
        u *= earth.RATE / np.linalg.norm(u)
        made, parted = rates_and_turns(RATES, u, seed)
        out = calibrated(made, ON_EARTH, methods=("rates", "turns"), **parted)
        found = told(out)
        errors += [(found[f"bias_{a}"][0] - BIAS[k]) / found[f"bias_{a}"][1] for k, a in enumerate(THREE)]
        own.append(found["bias_r"][1])
    # 60 values: 9 %, three times that
    assert 0.73 < np.std(errors) < 1.27
    # 140 s of rates tell the bias to some deg/h, rest by hand to 15 deg/h at best
    assert max(own) < earth.RATE
    said = [f["detail"] for f in out["findings"].to_pylist() if f["kind"] == "Earth's rate"]
    assert len(said) == 1
    assert "counted as an error of their biases" in said[0]


def test_what_a_gyro_does_not_tell_of_another_axis_is_said() -> None:
    made = tables(Stand(axes=("r",)), 3)
    place = made["gyro"].schema.names.index("p")
    still = pa.array(np.zeros(made["gyro"].num_rows))
    made["gyro"] = made["gyro"].set_column(place, made["gyro"].schema.field("p"), still)
    out = calibrated(made)
    assert set(told(out)) == {"S23"}
    (said,) = [f for f in out["findings"].to_pylist() if f["kind"] == "cross axis"]
    assert said["channel"] == "p"
    assert "about r: expected an output that changes with the rate, found 0 in every step" in said["detail"]


def test_what_counts_in_a_triad_only_is_said_of_single_axes() -> None:
    made = tables(Stand(axes=("r",)), 3)
    out = calibrated(made, orientation_error_deg=0.1)
    (said,) = [f for f in out["findings"].to_pylist() if f["kind"] == "not counted"]
    assert said["severity"] == "warning"
    assert said["detail"].startswith("orientation_error_deg of [calibrate]: counted in a triad only")
    assert "not counted" not in kinds(calibrated(tables(Stand(axes=THREE), 3), orientation_error_deg=0.1))


def test_beside_a_triad_a_gyro_without_its_terms_is_a_finding() -> None:
    made, parted = rates_and_turns(RATES[:3])
    out = calibrated(made, methods=("rates", "turns"), nonlinearity=(2, 3), **parted)
    assert kinds(out).count("single axis") == 2  # nobody turned r on the table
    assert {row["gyro"] for row in out["calibration"].to_pylist()} == {""}


def test_as_many_steps_as_unknowns_check_nothing() -> None:
    for count, said in ((3, ["p: 3 steps for 3 unknowns: no step is left to check the model by"]), (4, [])):
        made = tables(Stand(axes=("p",), channels="p", rates=RATES[1 : 1 + count]))
        found = [f for f in calibrated(made)["findings"].to_pylist() if f["kind"] == "not checked"]
        assert [f["detail"].split(", and")[0] for f in found] == said
        assert all(f["severity"] == "warning" for f in found)
