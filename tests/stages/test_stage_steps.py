"""Steps of a rate table from the stream tables: rates, time offset, what is left out and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from rate_table_stand import BIAS, DEG, HOLD, RATES, SIGMA, STEP, S, Stand, tables

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models.rate_table_steps import TableAxis
from pipeline.stages import base, steps
from pipeline.storage.contract_check import violations

VERTICAL = TableAxis(50 * DEG, 0.0, 0.0)


def measured(
    made: dict[str, pa.Table], stand: base.Stand | None = None, **settings: Any
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], dict[tuple[str, str], dict[str, Any]]]:
    """Rows of ``rate_steps``, findings, and metrics by channel and name."""
    wanted = {name: made[name] for name in (*steps.CONSUMES, *steps.MAY_CONSUME) if name in made}
    out = steps.run(wanted, steps.Settings(**settings), stand or base.Stand())
    assert set(out) == set(steps.PRODUCES)
    for name, table in out.items():
        assert violations(name, table) == []
    figures = {(row["channel"], row["name"]): row for row in out["metrics"].to_pylist()}
    assert {name for _, name in figures} <= set(steps.METRICS)
    return out["rate_steps"].to_pylist(), out["findings"].to_pylist(), figures


def refused(code: ExitCode, *words: str, made: dict[str, pa.Table], **settings: Any) -> None:
    with pytest.raises(GyrostandError) as caught:
        measured(made, **settings)
    assert caught.value.exit_code is code
    for word in words:
        assert word in str(caught.value), str(caught.value)


def of(rows: list[dict[str, Any]], channel: str, key: str) -> np.ndarray:
    return np.array([row[key] for row in rows if row["channel"] == channel])


def test_every_step_of_every_channel_has_a_row() -> None:
    rows, findings, figures = measured(tables(Stand(axes=("r", "-p"))))
    assert len(rows) == 2 * len(RATES) * 3
    assert findings == []
    assert figures["", "step_count"]["value"] == 2 * len(RATES)
    assert figures["about -p", "step_count"]["value"] == len(RATES)
    for run, along, sign in ((0, 2, 1), (1, 0, -1)):
        own = [row for row in rows if row["run"] == run]
        assert of(own, "p", "step").tolist() == list(range(len(RATES)))
        # the rate without noise, by the rounding of its integral
        np.testing.assert_allclose(of(own, "p", "rate"), RATES, atol=1e-10)
        for k, channel in enumerate("pqr"):
            error = of(own, channel, "standard_error")
            truth = S[k, along] * sign * RATES + BIAS[k]
            assert np.all(np.abs(of(own, channel, "output") - truth) < 5 * error)
            # white noise over 400 samples or more, whose level 6 stretches of 64 blocks tell to 4 %
            assert np.all(error < 1.15 * SIGMA / np.sqrt(400))
            duration = (of(own, channel, "stop") - of(own, channel, "start")) * 1e-9
            assert np.all((duration > 0.4 * HOLD) & (duration < HOLD + 3.0))


@pytest.mark.parametrize("by_angle", [False, True])
def test_the_time_offset_is_found_and_taken_out(by_angle: bool) -> None:
    stand = Stand(axes=("r", "q"), offset=0.2137, by_angle=by_angle)
    rows, findings, figures = measured(tables(stand, 1))
    for channel in ("about r", "about q", ""):
        told = figures[channel, "time_offset"]
        assert told["value"] == pytest.approx(0.2137, abs=4 * told["standard_error"])
        # ramps of 10 deg/s/s and more against 0.02 deg/s of noise in 150 samples each: far below a sample
        assert told["standard_error"] < 0.01 * STEP
    assert findings == []
    np.testing.assert_allclose(of(rows, "r", "rate")[: len(RATES)], RATES, atol=1e-10)


def test_errors_of_the_offset_over_their_standard_error() -> None:
    errors = []
    for seed in range(40):
        _, _, figures = measured(tables(Stand(channels="r", offset=0.05), seed, named=False))
        told = figures["", "time_offset"]
        errors.append((told["value"] - 0.05) / told["standard_error"])
    # 1 / sqrt(80) = 11 %, three times that
    assert 0.67 < np.std(errors) < 1.33


def test_the_offset_may_be_stated_or_left_out() -> None:
    made = tables(Stand(offset=0.3))
    stated, findings, figures = measured(made, time_offset=0.3)
    np.testing.assert_allclose(of(stated, "r", "rate"), RATES, atol=1e-10)
    assert findings == []
    assert figures["", "time_offset"]["value"] is None
    left, _, _ = measured(made, time_offset="none")
    # by the table's clock the steps begin 0.3 s earlier than they do by the gyro's
    assert 0.25e9 < stated[0]["stop"] - left[0]["stop"] + 1e9 * STEP < 0.35e9


def test_without_ramps_the_offset_is_not_estimated_and_the_ends_are_left_out() -> None:
    made = tables(Stand(rates=DEG * np.array([50.0])))
    seconds = (made["turntable"]["time"].to_numpy() - made["turntable"]["time"][0].as_py()) * 1e-9
    held = pa.array(seconds > 4.0)
    made = {**made, "turntable": made["turntable"].filter(held), "gyro": made["gyro"].filter(held)}
    rows, findings, figures = measured(made)
    assert len(rows) == 3
    (note,) = findings
    assert note["kind"] == "time offset"
    assert "a constant rate" in note["detail"]
    assert figures["", "time_offset"]["value"] is None
    first = made["gyro"]["time"][0].as_py()
    # one second of settling and one of an unknown offset
    assert rows[0]["start"] - first == pytest.approx(2e9, abs=1e9 * STEP)


def test_the_turn_is_told_where_the_zero_of_the_angle_is() -> None:
    oriented = base.Stand(table_heading_deg=0.0)
    for across, stand, known in (
        (("p",), oriented, True),
        (None, oriented, False),
        (("p",), base.Stand(), False),
    ):
        made = tables(Stand(by_angle=True, across=across))
        rows, _, _ = measured(made, stand)
        at_rest = rows[0]
        assert at_rest["cosine"] == (pytest.approx(1.0, abs=1e-9) if known else None)
        assert at_rest["sine"] == (pytest.approx(0.0, abs=1e-9) if known else None)
        # whole turns, but for one sample of 500
        assert all(abs(row["cosine"]) < 2e-3 for row in rows[3:])


def test_the_temperature_of_each_step_is_its_mean() -> None:
    rows, _, _ = measured(tables(Stand(warm=(290.0, 0.01))))
    middle = np.array([(row["start"] + row["stop"]) / 2 - rows[0]["start"] for row in rows]) * 1e-9
    # it rises by 0.01 K/s from the first sample of the first step, one second of settling after 0
    expected = 290.0 + 0.01 * (middle + 1.0)
    np.testing.assert_allclose([row["temperature"] for row in rows], expected, atol=0.001)


def test_a_gap_in_a_step_leaves_it_out_and_a_lost_sample_does_not() -> None:
    made = tables(Stand())
    seconds = (made["gyro"]["time"].to_numpy() - made["gyro"]["time"][0].as_py()) * 1e-9
    begin = 2 * (HOLD + 3.0) + 3.0  # of the third rate
    gap = (seconds > begin + 8) & (seconds < begin + 10)
    lost = np.zeros(len(seconds), dtype=bool)
    lost[::97] = True
    rows, findings, _ = measured({**made, "gyro": made["gyro"].filter(pa.array(~(gap | lost)))})
    assert len(rows) == 3 * (len(RATES) - 1)
    np.testing.assert_allclose(of(rows, "r", "rate"), np.delete(RATES, 2), atol=1e-10)
    (note,) = findings
    assert (note["kind"], note["severity"]) == ("gap in a step", "warning")
    assert "run 'about r': " in note["detail"]
    every = made["gyro"].filter(pa.array(seconds % 5.0 > 1.5))
    refused(ExitCode.NOT_MET, "without a gap", "steps.max_gap_s", made={**made, "gyro": every})


def test_samples_without_a_value_are_passed_over() -> None:
    made = tables(Stand(channels="r"), named=False)
    values = made["gyro"]["r"].to_numpy().copy()
    values[::50] = np.nan
    place = made["gyro"].schema.names.index("r")
    made["gyro"] = made["gyro"].set_column(place, made["gyro"].schema.field("r"), pa.array(values))
    rows, _, _ = measured(made)
    assert len(rows) == len(RATES)
    assert np.isfinite([row["output"] for row in rows]).all()


def test_a_run_off_the_table_and_a_plan_without_a_table_have_no_steps() -> None:
    made = tables(Stand(axes=("r", "q")))
    mountings = made["mountings"].to_pylist()
    mountings[1] |= {f"axis_{i}": None for i in (1, 2, 3)}
    rows, _, _ = measured({**made, "mountings": base.rows("mountings", mountings)})
    assert {row["run"] for row in rows} == {0}
    rows, _, figures = measured({name: made[name] for name in ("gyro", "mountings")})
    assert rows == []
    assert figures["", "step_count"]["value"] == 0


SLIPS = {
    # gyro over table, what is recorded as which unit
    "rpm as deg/s": (6.0, "the table's rate looks like rpm where deg/s is stated"),
    "rpm as rad/s": (np.pi / 30, "the table's rate looks like rpm where rad/s is stated"),
    "deg/s as rpm": (1 / 6, "the table's rate looks like deg/s where rpm is stated"),
    "rad/s as rpm": (30 / np.pi, "the table's rate looks like rad/s where rpm is stated"),
    "deg/s as rad/s": (np.pi / 180, "the table's values look like degrees where radians are stated"),
    "rad/s as deg/s": (180 / np.pi, "the gyro's values look like degrees where radians are stated"),
    "deg/h as deg/s": (3600.0, "the gyro's values look like deg/h"),
    "deg/s as deg/h": (1 / 3600, "the table's values look like deg/h"),
}


@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("axis", ["r", "-r"])
def test_another_unit_than_stated_is_refused_by_name(slip: str, axis: Any) -> None:
    gain, words = SLIPS[slip]
    made = tables(Stand(gain=gain, axes=(axis,)))
    refused(ExitCode.USAGE, "gyro r against the table", "near 1", words, "correct the unit", made=made)


def test_turns_of_an_encoder_taken_for_radians_are_refused() -> None:
    made = tables(Stand(by_angle=True, gain=2 * np.pi))
    refused(ExitCode.USAGE, "the table's angle looks like turns where rad is stated", made=made)


@pytest.mark.parametrize("gain", [0.55, 0.9, 1.1, 1.8])
def test_a_poor_scale_factor_is_none_of_the_unit(gain: float) -> None:
    _, findings, _ = measured(tables(Stand(gain=gain)))
    assert findings == []


def test_an_implausible_scale_factor_and_a_negative_one_are_marked() -> None:
    _, findings, _ = measured(tables(Stand(gain=16.4)))
    assert [(row["kind"], row["severity"]) for row in findings] == [("implausible unit", "warning")]
    _, findings, _ = measured(tables(Stand(gain=-1.0)))
    assert [(row["kind"], row["severity"]) for row in findings] == [("negative scale factor", "warning")]


def test_a_table_that_never_turns_is_refused() -> None:
    made = tables(Stand(rates=np.zeros(3)))
    refused(ExitCode.NOT_MET, "run 'about r', stream 'turntable'", "a table that turns", made=made)
    noisy = tables(Stand(rates=np.zeros(3), tachometer=1e-3 * DEG))
    refused(ExitCode.NOT_MET, "a table that turns", "stays within", made=noisy)


def test_a_gyro_that_does_not_follow_the_table_is_refused() -> None:
    made = tables(Stand(channels="r"), named=False)
    place = made["gyro"].schema.names.index("r")
    noise = SIGMA * np.random.default_rng(3).standard_normal(made["gyro"].num_rows)
    made["gyro"] = made["gyro"].set_column(place, made["gyro"].schema.field("r"), pa.array(noise))
    refused(ExitCode.NOT_MET, "a gyro that follows the table", "a scale factor of", made=made)


def test_the_wrong_axis_names_the_channel_that_does_follow() -> None:
    made = tables(Stand(axes=("q",)))
    mountings = made["mountings"].to_pylist()
    mountings[0] |= {"axis_1": 1.0, "axis_2": 0.0}
    made["mountings"] = base.rows("mountings", mountings)
    # q's cross response of 0.2 % is no following
    refused(ExitCode.NOT_MET, "gyro p against the table", "of q", "correct axis of the run", made=made)


def test_records_of_different_times_are_refused() -> None:
    made = tables(Stand())
    late = made["turntable"]["time"].to_numpy() + 10**13
    made["turntable"] = made["turntable"].set_column(
        0, made["turntable"].schema.field("time"), pa.array(late)
    )
    refused(ExitCode.NOT_MET, "a common stretch of time", "check the clocks", made=made)


def test_several_channels_need_an_axis() -> None:
    made = tables(Stand(channels="pr"), named=False)
    refused(ExitCode.USAGE, "which axis of the case", "p, r and no [[runs]]", "[[runs]]", made=made)


def test_without_a_constant_rate_the_run_is_named() -> None:
    made = tables(Stand(axes=("r",)))
    refused(ExitCode.NOT_MET, "run 'about r', table rate", "at least 100 s", made=made, shortest_s=100.0)


def test_a_stream_without_values_is_refused() -> None:
    made = tables(Stand(channels="r"), named=False)
    nothing = pa.array(np.full(made["turntable"].num_rows, np.nan))
    place = made["turntable"].schema.names.index("rate")
    empty = made["turntable"].set_column(place, made["turntable"].schema.field("rate"), nothing)
    refused(ExitCode.INPUT, "stream 'turntable'", "fewer than two", made={**made, "turntable": empty})
    refused(ExitCode.INPUT, "gyro", "fewer than two", made={**made, "gyro": made["gyro"].slice(0, 1)})


def test_the_earth_s_rate_is_in_no_step() -> None:
    rows, _, _ = measured(tables(Stand(earth=VERTICAL)))
    np.testing.assert_allclose(of(rows, "r", "rate"), RATES, atol=1e-10)


def test_an_angle_that_begins_again_asks_for_wraps_at() -> None:
    made = tables(Stand(channels="r", by_angle=True), named=False)
    angle = made["turntable"]["angle"].to_numpy()
    for turn, words in ((2 * np.pi, "back by a turn, "), (100.0 * DEG, "back by 100 deg, ")):
        place = made["turntable"].schema.get_field_index("angle")
        table = made["turntable"].set_column(place, "angle", pa.array(angle % turn))
        refused(ExitCode.USAGE, "wraps_at", words, made={**made, "turntable": table}, shortest_s=10.0)


def test_a_gyro_that_gives_one_value_is_said_to() -> None:
    made = tables(Stand(channels="r"), named=False)
    place = made["gyro"].schema.get_field_index("r")
    table = made["gyro"].set_column(place, "r", pa.array(np.full(len(made["gyro"]), 0.5 * DEG)))
    refused(ExitCode.NOT_MET, "gyro r", "gives 0.5 deg/s throughout", made={**made, "gyro": table})


def test_steps_at_rest_only_are_said_to_be() -> None:
    made = tables(Stand(channels="r", rates=DEG * np.array([0.0, 30.0]), hold=16.0), named=False)
    seconds = (made["turntable"]["time"].to_numpy() - made["turntable"]["time"][0].as_py()) * 1e-9
    kept = pa.array(seconds < 16.0 + 6.0 + 5.0)  # the table turns for 5 s, which is no step of 10 s
    made = {**made, "gyro": made["gyro"].filter(kept), "turntable": made["turntable"].filter(kept)}
    words = ("1 step at rest only", "up to 30 deg/s", "steps.shortest_s")
    refused(ExitCode.NOT_MET, *words, made=made, shortest_s=10.0)


def test_no_stretch_names_the_keys() -> None:
    made = tables(Stand(hold=4.0))
    words = ("steps.shortest_s", "steps.tolerance_deg_s", "deg/s;")
    refused(ExitCode.NOT_MET, *words, made=made, shortest_s=10.0)


def test_an_offset_beyond_the_longest_is_refused() -> None:
    with pytest.raises(ValueError, match=r"at most longest_offset_s = 1, either way"):
        steps.Settings(time_offset=-5.0)
    assert steps.Settings(time_offset=-5.0, longest_offset_s=5.0).time_offset == -5.0
