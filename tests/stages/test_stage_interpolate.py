"""Interpolate: what it uses, what it leaves out and says so, and that the increments are kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline import contracts
from pipeline.errors import ExitCode
from pipeline.models.coning import ConingMotion
from pipeline.stages import interpolate
from pipeline.stages.base import StageError, Stand

Float = NDArray[np.float64]
Time = NDArray[np.int64]

MOTION = ConingMotion(cone_angle=np.radians(1.0), frequency=5.0)
START = 1_700_000_000_000_000_000
MS = 1_000_000


def clock(count: int) -> Time:
    """100 Hz."""
    return START + 10 * MS * np.arange(count, dtype=np.int64)


def table(name: str, time: Time, values: Float) -> pa.Table:
    none = [None] * len(time)
    prefix = "increment_" if name == "gyro_increments" else ""
    columns = {prefix + axis: values[:, k] for k, axis in enumerate("pqr")}
    clocks = {"time": time, "header_stamp": none, "log_time": none, "publish_time": none}
    if name == "gyro":
        clocks["run"] = none
    return contracts.table(name, {**clocks, **columns})


def gyro(time: Time, values: Float | None = None) -> dict[str, pa.Table]:
    if values is None:
        values = MOTION.rates((time - START) / 1e9)
    return {"gyro": table("gyro", time, values)}


def run(tables: dict[str, pa.Table], **settings: Any) -> tuple[pa.Table, list[dict[str, Any]]]:
    out = interpolate.run(tables, interpolate.Settings(**settings), Stand())
    assert set(out) == set(interpolate.PRODUCES)
    return out["rates"], out["findings"].to_pylist()


def column(rates: pa.Table, name: str) -> NDArray[Any]:
    return np.asarray(rates.column(name).to_numpy())


def kinds(findings: list[dict[str, Any]]) -> list[str]:
    return [f["kind"] for f in findings]


class TestGrid:
    def test_sound_record_stays_on_its_samples(self) -> None:
        rates, findings = run(gyro(clock(200)))
        assert findings == []
        assert column(rates, "time").tolist() == clock(200).tolist()
        np.testing.assert_array_equal(column(rates, "q"), MOTION.rates((clock(200) - START) / 1e9)[:, 1])
        assert set(column(rates, "segment")) == {0}

    def test_increments_are_the_integrals_of_the_steps(self) -> None:
        rates, _ = run(gyro(clock(200)), method="spline", degree=7)
        t = (clock(200) - START) / 1e9
        # a septic spline of w h = 0.3: 1e-3 (w h)**8 of 2.7 rad/s · 0.01 s inside, more at the ends
        np.testing.assert_allclose(
            column(rates, "increment_q")[6:-5], MOTION.increments(t[5:-6], t[6:-5])[:, 1], rtol=0, atol=1e-8
        )
        assert column(rates, "increment_q")[0] == 0

    def test_oversampling_divides_the_interval(self) -> None:
        rates, _ = run(gyro(clock(101)), oversampling=50)
        assert rates.num_rows == 100 * 50 + 1
        assert set(np.diff(column(rates, "time")).tolist()) == {10 * MS // 50}

    def test_jittered_stamps_are_resampled_uniformly(self) -> None:
        rng = np.random.default_rng(3)
        time = clock(400) + rng.integers(-2 * MS, 2 * MS, 400)
        rates, findings = run(gyro(time), method="spline", degree=5)
        assert findings == []
        steps = np.diff(column(rates, "time"))
        assert np.ptp(steps) <= 1, "uniform to a nanosecond"
        t = (column(rates, "time") - START) / 1e9
        # quintic spline with intervals to 14 ms: w h = 0.44, (w h)**6/100 of 2.7 rad/s; ends are weaker
        np.testing.assert_allclose(
            column(rates, "r")[10:-10], MOTION.rates(t)[10:-10, 2], rtol=0, atol=1e-4 * 2.7
        )

    def test_satisfies_its_contract_s_types(self) -> None:
        rates, _ = run(gyro(clock(50)))
        assert rates.schema.equals(contracts.contract("rates").schema)

    def test_grid_finer_than_a_nanosecond_is_refused(self) -> None:
        time = START + np.arange(50, dtype=np.int64) * 1000
        with pytest.raises(StageError, match="oversampling: expected grid steps of at least 1 ns") as caught:
            run(gyro(time), oversampling=10_000)
        assert caught.value.exit_code == ExitCode.USAGE

    def test_same_input_same_bytes(self) -> None:
        first, _ = run(gyro(clock(300)), method="harmonic", oversampling=7)
        second, _ = run(gyro(clock(300)), method="harmonic", oversampling=7)
        assert first.equals(second)


class TestLeftOut:
    def test_nan_is_left_out_and_bridged(self) -> None:
        values = MOTION.rates((clock(200) - START) / 1e9)
        values[50, 1] = np.nan
        values[120] = np.inf
        rates, findings = run(gyro(clock(200), values))
        assert kinds(findings) == ["NaN"]
        assert findings[0]["count"] == 2
        assert findings[0]["start"] == clock(200)[50]
        assert findings[0]["end"] == clock(200)[120]
        assert rates.num_rows == 200
        # local cubic across 20 ms at w = 31.4: the error of a cubic at midspan, 9/384·… (w h)**4 ~ 1 %
        truth = MOTION.rates((clock(200) - START) / 1e9)[50, 1]
        assert column(rates, "q")[50] == pytest.approx(truth, abs=0.02 * 0.55)

    def test_repeated_and_backward_stamps_are_left_out(self) -> None:
        time = clock(200)
        time[30] = time[29]
        time[80] = time[70] + 1
        rates, findings = run(gyro(time))
        assert sorted(kinds(findings)) == ["backward stamp", "repeated stamp"]
        assert all(f["count"] == 1 and f["severity"] == "warning" for f in findings)
        assert np.all(np.diff(column(rates, "time")) > 0)

    def test_gap_splits_the_record(self) -> None:
        time = np.delete(clock(300), slice(100, 140))
        rates, findings = run(gyro(time))
        assert kinds(findings) == ["gap"]
        assert (findings[0]["start"], findings[0]["end"]) == (clock(300)[99], clock(300)[140])
        assert "0.41 s without a usable sample, longer than max_gap, 0.035 s" in findings[0]["detail"]
        segment = column(rates, "segment")
        assert set(segment) == {0, 1}
        assert column(rates, "time")[segment == 0][-1] == clock(300)[99]
        assert column(rates, "time")[segment == 1][0] == clock(300)[140]
        assert column(rates, "increment_p")[segment == 1][0] == 0

    @pytest.mark.parametrize(("lost", "segments"), [(1, 1), (2, 1), (3, 2)])
    def test_default_max_gap_bridges_two_lost_samples(self, lost: int, segments: int) -> None:
        rates, _ = run(gyro(np.delete(clock(200), slice(90, 90 + lost))))
        assert len(set(column(rates, "segment"))) == segments

    def test_max_gap_is_the_plan_s(self) -> None:
        time = np.delete(clock(300), slice(100, 140))
        rates, findings = run(gyro(time), max_gap=0.5)
        assert findings == []
        assert rates.num_rows == 300

    def test_short_stretch_is_left_out(self) -> None:
        time = np.delete(clock(300), np.r_[100:140, 143:200])
        rates, findings = run(gyro(time), method="spline", degree=7)
        assert kinds(findings) == ["gap", "gap", "segment left out"]
        assert (findings[2]["start"], findings[2]["count"]) == (clock(300)[140], 3)
        assert set(column(rates, "segment")) == {0, 1}

    def test_nothing_long_enough_is_an_error(self) -> None:
        time = START + np.cumsum(np.tile([10 * MS, 500 * MS], 20)).astype(np.int64)
        with pytest.raises(StageError, match="at least 5 samples without a gap") as caught:
            run(gyro(time), max_gap=0.1)
        assert caught.value.exit_code == ExitCode.INPUT

    @pytest.mark.parametrize("count", [0, 1])
    def test_too_few_samples_is_an_error(self, count: int) -> None:
        with pytest.raises(
            StageError, match=f"at least 2 finite samples.*found {count} of {count}"
        ) as caught:
            run(gyro(clock(count)))
        assert caught.value.exit_code == ExitCode.INPUT

    def test_all_nan_is_an_error(self) -> None:
        with pytest.raises(StageError, match="found 0 of 20") as caught:
            run(gyro(clock(20), np.full((20, 3), np.nan)))
        assert caught.value.exit_code == ExitCode.INPUT

    def test_no_gyro_is_an_error_of_the_plan(self) -> None:
        with pytest.raises(StageError, match=r"\[streams.gyro\]") as caught:
            run({})
        assert caught.value.exit_code == ExitCode.USAGE


class TestIncrements:
    def tables(self, time: Time) -> dict[str, pa.Table]:
        t = (time - START) / 1e9
        values = MOTION.increments(np.append(t[0] - 0.01, t[:-1]), t)
        return {"gyro_increments": table("gyro_increments", time, values)}

    @pytest.mark.parametrize("method", ["linear", "local_polynomial", "spline", "pchip", "akima", "harmonic"])
    def test_are_kept_exactly(self, method: str) -> None:
        tables = self.tables(clock(200))
        rates, findings = run(tables, method=method, oversampling=4)
        assert findings == []
        recorded = tables["gyro_increments"].column("increment_q").to_numpy()
        steps = np.add.reduceat(column(rates, "increment_q")[1:], np.arange(0, 199 * 4, 4))
        # roundings of their running sum, which stays below 0.02 rad
        np.testing.assert_allclose(steps, recorded[1:], rtol=0, atol=1e-15)

    def test_give_the_rates(self) -> None:
        rates, _ = run(self.tables(clock(200)), degree=5)
        truth = MOTION.rates((clock(200) - START) / 1e9)
        # sextic of the angle, w h = 0.31: (w h)**6/100 of 0.55 rad/s
        inner = slice(4, -4)
        np.testing.assert_allclose(column(rates, "r")[inner], truth[inner, 2], rtol=0, atol=1e-5)

    def test_a_lost_one_splits_the_record(self) -> None:
        tables = self.tables(np.delete(clock(200), 90))
        rates, findings = run(tables)
        assert set(column(rates, "segment")) == {0, 1}
        assert kinds(findings) == ["gap"]

    def test_one_that_is_nan_splits_the_record_whatever_max_gap(self) -> None:
        recorded = self.tables(clock(200))["gyro_increments"]
        values = np.stack([recorded.column("increment_" + a).to_numpy() for a in "pqr"], axis=1)
        values[90, 2] = np.nan
        rates, findings = run({"gyro_increments": table("gyro_increments", clock(200), values)}, max_gap=1.0)
        assert set(column(rates, "segment")) == {0, 1}
        assert kinds(findings) == ["NaN", "gap"]
        assert "in which an angle increment is lost" in findings[1]["detail"]


class TestSettings:
    @pytest.mark.parametrize(
        ("settings", "says"),
        [
            ({"method": "local_polynomial", "degree": 6}, "takes degree 1, 2, 3, 4, 5; found 6"),
            ({"method": "spline", "degree": 4}, "takes degree 2, 3, 5, 7; found 4"),
            ({"method": "pchip", "degree": 3}, "takes no degree; found 3"),
            ({"oversampling": 0}, "greater than or equal to 1"),
            ({"method": "cubic"}, "Input should be 'linear'"),
        ],
    )
    def test_refuse_what_has_no_meaning(self, settings: dict[str, Any], says: str) -> None:
        with pytest.raises(ValidationError, match=says):
            interpolate.Settings(**settings)

    def test_harmonic_beyond_nyquist_is_refused_with_the_reason(self) -> None:
        with pytest.raises(StageError, match="state harmonics = 9"):
            run(gyro(clock(300)), method="harmonic", harmonics=10)
