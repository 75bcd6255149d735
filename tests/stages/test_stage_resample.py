from typing import Any

import gimbal_records as gr
import numpy as np
import pyarrow as pa
import pytest

from pipeline.contracts import contract
from pipeline.errors import ExitCode
from pipeline.models.earth import Scheme
from pipeline.stages import resample
from pipeline.stages.base import StageError, Stand

Float = np.ndarray
SCHEMES = list(gr.STARTS)


def resampled(
    records: list[gr.Record], schemes: list[Scheme], **changed: Any
) -> tuple[pa.Table, list[dict[str, Any]], dict[str, float]]:
    """Trajectory, findings, and metrics by name; all tables keep their contracts' schemas."""
    out = resample.run(gr.tables(records, schemes), resample.Settings(**changed), Stand())
    assert set(out) == {"trajectory", "findings", "metrics"}
    for name, table in out.items():
        assert table.schema.equals(contract(name).schema)
    figures = {m["name"]: m["value"] for m in out["metrics"].to_pylist()}
    assert set(figures) == set(resample.METRICS)
    return out["trajectory"], out["findings"].to_pylist(), figures


def angles(trajectory: pa.Table) -> Float:
    return np.stack([trajectory.column(name).to_numpy() for name in ("alpha1", "alpha2")], axis=1)


def measured(trajectory: pa.Table) -> Float:
    return trajectory.column("measured").to_numpy()


def refusal(records: list[gr.Record], schemes: list[Scheme], **changed: Any) -> StageError:
    with pytest.raises(StageError) as caught:
        resampled(records, schemes, **changed)
    assert "\n" not in str(caught.value)
    return caught.value


class TestSoundRecords:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("step", [1.0, 60.0, 600.0])
    @pytest.mark.parametrize("noise", [0.0, 1.0])
    @pytest.mark.parametrize("quantum", [0.0, 2 * np.pi / 2**20, 2 * np.pi / 2**16])
    def test_even_samples_are_taken_as_they_are(
        self, scheme: Scheme, step: float, noise: float, quantum: float
    ) -> None:
        """Bit for bit, without a word: nothing of a sound record is a spike, a jump or a stuck encoder."""
        time, alpha = gr.record(scheme, 24 if step > 1 else 4, step, noise=noise, quantum=quantum)
        trajectory, findings, figures = resampled([(time, alpha)], [scheme])
        assert findings == []
        assert np.array_equal(trajectory.column("time").to_numpy(), time)
        assert np.array_equal(angles(trajectory), alpha)
        assert measured(trajectory).all()
        assert figures["sample_interval"] == step
        assert figures["arc_count"] == 1
        assert figures["bridged_count"] == 0
        assert figures["span_hours"] == (time[-1] - time[0]) / 3.6e12

    @pytest.mark.parametrize("seed", range(40))
    def test_any_sound_record(self, seed: int) -> None:
        """Any start, rate, noise and quantum: of 797 such records none was doubted when rules were set."""
        rng = np.random.default_rng(seed)
        scheme = SCHEMES[seed % 4]
        step = float(rng.choice([5, 10, 30, 60, 120, 300]))
        record = gr.record(
            scheme,
            rng.uniform(3, 24),
            step,
            noise=10 ** rng.uniform(-2, 1.3),
            quantum=rng.choice([0.0, 2 * np.pi / 2**22, 2 * np.pi / 2**18]),
            seed=seed,
            start=tuple(rng.uniform(-0.5, 0.5, size=2)),
            drift=rng.uniform(-0.03, 0.03),
        )
        assert resampled([record], [scheme], useful_drift_deg_h=1.0)[1] == []

    def test_same_bytes_again(self) -> None:
        tables = gr.tables([gr.record("polar", 6, 60.0, jitter=3.0)], ["polar"])
        first, second = (resample.run(tables, resample.Settings(), Stand()) for _ in range(2))
        assert all(first[name].equals(second[name]) for name in first)


class TestWholeTurns:
    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_wrapped_angles(self, scheme: Scheme) -> None:
        time, alpha = gr.record(scheme, 24, 60.0)
        for wrapped in (alpha % (2 * np.pi), (alpha + np.pi) % (2 * np.pi) - np.pi):
            trajectory, findings, _ = resampled([(time, wrapped)], [scheme])
            turns = (angles(trajectory) - alpha) / (2 * np.pi)
            # Whole turns of alpha1 mean nothing; they are the same throughout, to the remainder's rounding.
            assert np.abs(turns - turns[0].round()).max() < 1e-14
            assert turns[0, 1].round() == 0
            assert {f["kind"] for f in findings} <= {"unwrapped"}
            moved = int(np.any(np.abs(angles(trajectory) - wrapped) > 1, axis=1).sum())
            assert sum(f["count"] for f in findings) == moved


class TestSpikes:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("step", [5.0, 60.0])
    def test_spikes_are_bridged_and_nothing_else(self, scheme: Scheme, step: float) -> None:
        time, alpha = gr.record(scheme, 24, step, seed=3)
        rng = np.random.default_rng(4)
        spiking, truth = alpha.copy(), np.zeros(len(time), dtype=bool)
        for first in 20 + 70 * np.arange(20) + rng.integers(0, 50, size=20):
            wrong = slice(first, first + rng.integers(1, 6))
            spiking[wrong, rng.integers(2)] += rng.choice([-1, 1]) * 10 ** rng.uniform(-4, 0)
            truth[wrong] = True
        trajectory, findings, figures = resampled([(time, spiking)], [scheme])
        assert np.array_equal(~measured(trajectory), truth)
        assert [(f["kind"], f["count"]) for f in findings] == [
            ("spike", truth.sum()),
            ("bridged", truth.sum()),
        ]
        assert figures["bridged_count"] == truth.sum()
        # The cubic through four samples of 1" multiplies noise by up to 2.6 over five missing ones; three
        # sigma, and the sample that it is held against has 1" itself.
        assert np.abs(angles(trajectory) - alpha)[truth].max() < 3 * 2.8 * gr.ARCSEC
        assert np.array_equal(angles(trajectory)[~truth], alpha[~truth])

    def test_wrong_samples_at_either_end(self) -> None:
        time, alpha = gr.record("vertical", 6, 60.0)
        alpha[:2, 0] += 1e-3
        alpha[-3:, 1] -= 1e-3
        trajectory, findings, _ = resampled([(time, alpha)], ["vertical"])
        assert [(f["kind"], f["count"]) for f in findings] == [("spike", 5)]
        assert np.array_equal(trajectory.column("time").to_numpy(), time[2:-3])


class TestServoLost:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("height", [3e-4, 3e-2])
    def test_jump(self, scheme: Scheme, height: float) -> None:
        time, alpha = gr.record(scheme, 24, 60.0)
        alpha[480:, 0] += height
        error = refusal([(time, alpha)], [scheme])
        assert error.exit_code is ExitCode.NOT_MET
        assert "run 'run 0', 7.9833 h from its start: expected alpha1 to move by at most" in str(error)
        assert 'set resample.jumps = "split"' in str(error)
        found = float(str(error).split("a jump of ")[1].split(" deg")[0])
        # Behind the jump the model is evaluated at other angles, for a minute; noise is 1".
        assert found == pytest.approx(np.degrees(height), rel=0.05)
        trajectory, findings, figures = resampled([(time, alpha)], [scheme], jumps="split")
        assert [(f["kind"], f["severity"], f["start"]) for f in findings] == [("jump", "warning", time[479])]
        assert figures["arc_count"] == 2
        assert np.array_equal(trajectory.column("arc").to_numpy(), np.arange(len(time)) >= 480)
        assert np.array_equal(angles(trajectory), alpha)

    def test_a_platform_that_runs_away(self) -> None:
        """300 deg/h for twenty minutes, then held again: no step stands out, the rate does."""
        time, alpha = gr.record("equatorial", 24, 5.0)
        first, steps = 8000, 240
        alpha[:, 1] -= np.radians(300 / 3600) * 5.0 * np.clip(np.arange(len(time)) - first, 0, steps)
        error = refusal([(time, alpha)], ["equatorial"])
        assert "turns by less than 60 deg/h against the stars, found 300" in str(error)
        trajectory, findings, figures = resampled([(time, alpha)], ["equatorial"], jumps="split")
        assert {f["kind"] for f in findings} == {"servo lost", "gap"}
        assert figures["arc_count"] == 2
        kept = trajectory.column("time").to_numpy()
        assert not np.isin(time[first : first + steps], kept).any()
        # A window is ten steps at least; no more than it is lost beside the event.
        assert len(kept) >= len(time) - steps - 2 * 11

    def test_a_stuck_encoder_is_left_out(self) -> None:
        time, alpha = gr.record("vertical", 24, 60.0, noise=0.3, quantum=2 * np.pi / 2**20)
        alpha[500:560, 1] = alpha[500, 1]
        trajectory, findings, _ = resampled([(time, alpha)], ["vertical"])
        assert [(f["kind"], f["count"]) for f in findings] == [("frozen", 59), ("gap", 1)]
        assert not np.isin(time[501:560], trajectory.column("time").to_numpy()).any()

    def test_short_arcs_are_left_out(self) -> None:
        time, alpha = gr.record("vertical", 24, 60.0)
        alpha[480:492, 0] += 0.03
        _, findings, figures = resampled([(time, alpha)], ["vertical"], jumps="split")
        assert [f["kind"] for f in findings] == ["jump", "jump", "short arc"]
        assert findings[2]["count"] == 12
        assert figures["arc_count"] == 2


class TestSingularGimbal:
    def test_alpha2_beyond_a_quarter_turn(self) -> None:
        time, alpha = gr.record("vertical", 24, 60.0)
        alpha[:, 1] += np.radians(10) * np.arange(len(time)) / len(time)
        peak = int(np.argmax(np.abs(alpha[:, 1])))
        alpha[:, 1] *= np.radians(92) / np.abs(alpha[peak, 1])
        error = refusal([(time, alpha)], ["vertical"])
        assert error.exit_code is ExitCode.NOT_MET
        assert "expected alpha2 within 90 deg" in str(error)

    def test_a_spike_beyond_it_is_a_spike(self) -> None:
        time, alpha = gr.record("vertical", 24, 60.0)
        alpha[700, 1] = 2.0
        assert [f["kind"] for f in resampled([(time, alpha)], ["vertical"])[1]] == ["spike", "bridged"]


class TestUnit:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("hours", [2, 24])
    def test_degrees_declared_as_radians(self, scheme: Scheme, hours: float) -> None:
        time, alpha = gr.record(scheme, hours, 10.0)
        for degrees in (np.degrees(alpha), np.degrees(alpha) % 360):
            error = refusal([(time, degrees)], [scheme])
            assert error.exit_code is ExitCode.USAGE
            assert "key streams.gimbal.channels.alpha1.unit" in str(error)
            assert "15.041 deg/h" in str(error)
            assert "numbers are degrees where radians are stated" in str(error)

    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_radians_declared_as_degrees(self, scheme: Scheme) -> None:
        time, alpha = gr.record(scheme, 24, 60.0)
        error = refusal([(time, np.radians(alpha))], [scheme])
        assert error.exit_code is ExitCode.USAGE
        assert "numbers are radians where degrees are stated" in str(error)


class TestTooShort:
    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("step", [1.0, 60.0])
    def test_how_long_would_do_and_does(self, scheme: Scheme, step: float) -> None:
        time, alpha = gr.record(scheme, 6, step)
        short = time - time[0] <= (0.05 if step == 1 else 0.4) * 3.6e12
        error = refusal([(time[short], alpha[short])], [scheme])
        assert error.exit_code is ExitCode.NOT_MET
        hours = float(str(error).split(" h would do")[0].split(", ")[-1])
        assert 0.2 < hours < 3
        # The noise of a short record is known to a third, and the length goes with its 0.4th power at least.
        enough = time - time[0] <= 1.2 * hours * 3.6e12
        assert resampled([(time[enough], alpha[enough])], [scheme])[2]["span_hours"] > hours
        too_few = time - time[0] <= hours / 2 * 3.6e12
        refusal([(time[too_few], alpha[too_few])], [scheme])

    def test_no_samples(self) -> None:
        time, alpha = gr.record("polar", 1, 60.0)
        assert refusal([(time, np.full_like(alpha, np.nan))], ["polar"]).exit_code is ExitCode.INPUT
        assert refusal([(time[:3], alpha[:3])], ["polar"]).exit_code is ExitCode.INPUT

    def test_a_short_run_beside_a_long_one_is_kept(self) -> None:
        long, short = gr.record("polar", 12, 60.0), gr.record("vertical", 0.4, 60.0)
        trajectory, findings, figures = resampled([long, short], ["polar", "vertical"])
        assert [f["kind"] for f in findings] == ["short run"]
        assert np.array_equal(np.unique(trajectory.column("run").to_numpy()), [0, 1])
        assert figures["arc_count"] == 2


class TestGaps:
    def test_short_ones_are_bridged_and_long_ones_split(self) -> None:
        time, alpha = gr.record("vertical", 24, 60.0)
        keep = np.ones(len(time), dtype=bool)
        keep[300:307] = keep[700:800] = False
        trajectory, findings, figures = resampled([(time[keep], alpha[keep])], ["vertical"])
        assert [(f["kind"], f["severity"], f["count"]) for f in findings] == [
            ("gap", "warning", 1),
            ("bridged", "info", 7),
        ]
        assert (findings[0]["start"], findings[0]["end"]) == (time[699], time[800])
        assert (findings[1]["start"], findings[1]["end"]) == (time[300], time[306])
        assert figures["arc_count"] == 2
        assert np.array_equal(trajectory.column("time").to_numpy(), np.delete(time, slice(700, 800)))
        assert np.array_equal(measured(trajectory), np.delete(keep, slice(700, 800)))

    def test_what_is_left_out_is_said(self) -> None:
        time, alpha = gr.record("vertical", 6, 60.0)
        alpha[50] = np.nan
        stamps = time.copy()
        stamps[100] = stamps[99]
        stamps[200] = stamps[198] - 1
        trajectory, findings, _ = resampled([(stamps, alpha)], ["vertical"])
        said = {(f["kind"], f["count"]) for f in findings}
        assert said == {("NaN", 1), ("repeated stamp", 1), ("backward stamp", 1), ("bridged", 3)}
        assert np.array_equal(trajectory.column("time").to_numpy(), time)
        assert np.flatnonzero(~measured(trajectory)).tolist() == [50, 100, 200]

    def test_stamps_in_batches_are_no_clock(self) -> None:
        time, alpha = gr.record("vertical", 6, 60.0)
        batched = time[0] + (np.arange(len(time)) // 10) * 600 * 10**9 + np.arange(len(time)) % 10
        assert refusal([(batched, alpha)], ["vertical"]).exit_code is ExitCode.USAGE


class TestGrid:
    def test_uneven_samples_are_interpolated(self) -> None:
        time, alpha = gr.record("polar", 24, 60.0, noise=0.0, jitter=6.0)
        trajectory, findings, _ = resampled([(time, alpha)], ["polar"])
        assert findings == []
        grid = trajectory.column("time").to_numpy()
        assert np.ptp(np.diff(grid)) <= 1  # whole nanoseconds
        # The cubic through samples 4.4 mrad of the Earth's rotation apart: 0.023 h^4 if they were even.
        true = gr.true_angles("polar", (grid - time[0]) * 1e-9)
        assert np.abs(angles(trajectory) - true).max() < 1e-9

    def test_slightly_uneven_samples_are_not_moved(self) -> None:
        time, alpha = gr.record("polar", 6, 1.0)
        moved = time + np.random.default_rng(0).integers(-500_000, 500_001, size=len(time))
        trajectory, _, _ = resampled([(moved, alpha)], ["polar"])
        assert np.array_equal(angles(trajectory), alpha)
        assert np.ptp(np.diff(trajectory.column("time").to_numpy())) <= 1

    def test_averages(self) -> None:
        """A minute of samples at 1 Hz: 60 times less variance, and no bias that shows."""
        time, alpha = gr.record("vertical", 12, 1.0, noise=5.0)
        trajectory, _, figures = resampled([(time, alpha)], ["vertical"], interval=60.0)
        grid = trajectory.column("time").to_numpy()
        assert figures["sample_interval"] == 60.0
        assert np.array_equal(np.diff(grid), np.full(len(grid) - 1, 60 * 10**9))
        error = angles(trajectory) - gr.true_angles("vertical", (grid - time[0]) * 1e-9)
        # 1438 values: their standard deviation is known to 2 %, three sigma; 0.6 % is the parabola's.
        assert np.std(error) == pytest.approx(5.0 * gr.ARCSEC / np.sqrt(60), rel=0.065)
        assert np.abs(error.mean(axis=0)).max() < 4 * 5.0 * gr.ARCSEC / np.sqrt(60 * len(grid))

    def test_a_finer_grid_than_the_samples_is_refused(self) -> None:
        error = refusal([gr.record("polar", 6, 60.0)], ["polar"], interval=1.0)
        assert error.exit_code is ExitCode.USAGE
        assert "resample.interval" in str(error)


class TestOddRecords:
    """Whatever comes, one line or a table; a warning of NumPy would be an error here."""

    def test_milliseconds_declared_as_seconds(self) -> None:
        """A sample in 17 hours: the model cannot be followed between them."""
        time, alpha = gr.record("polar", 24, 60.0)
        error = refusal([(1000 * time, alpha)], ["polar"])
        assert error.exit_code is ExitCode.USAGE
        assert "found a nominal interval of 60000 s; check the unit of the time" in str(error)

    def test_minutes_declared_as_seconds(self) -> None:
        time, alpha = gr.record("polar", 24, 60.0)
        assert "or the time is in another unit" in str(refusal([(time // 60, alpha)], ["polar"]))

    @pytest.mark.parametrize("count", [0, 1, 5, 20, 500])
    @pytest.mark.parametrize("stamps", ["even", "one", "backward", "nanoseconds"])
    @pytest.mark.parametrize("jumps", ["refuse", "split"])
    def test_is_refused_or_resampled(self, count: int, stamps: str, jumps: str) -> None:
        rng = np.random.default_rng(0)
        even = np.arange(count) * 10**9
        time = {
            "even": even,
            "one": 0 * even,
            "backward": even[::-1].copy(),
            "nanoseconds": np.arange(count),
        }[stamps]
        noise = rng.normal(size=(count, 2))
        flags = rng.random((count, 2)) < 0.1
        for alpha in (
            np.zeros((count, 2)),
            np.full((count, 2), np.pi / 2),
            noise,
            1e300 * noise,
            1e-300 * noise,
            0.01 * np.cumsum(noise, axis=0),
            np.where(flags, np.inf, 0.2),
        ):
            try:
                trajectory, _, _ = resampled([(time, alpha)], ["vertical"], jumps=jumps)
            except StageError as error:
                assert error.exit_code in (ExitCode.NOT_MET, ExitCode.USAGE, ExitCode.INPUT)  # noqa: PT017
            else:
                assert np.isfinite(angles(trajectory)).all()
