"""Simulated recordings: same seed, same bytes; errors of the stated size; truth and test plan beside them."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline import formats
from pipeline.errors import ExitCode
from pipeline.formats.base import Request, TimeField
from pipeline.models.coning import ConingMotion, MotionError
from pipeline.numerics.rotation import matrix_from_quaternion, quaternion_from_rotation_vector
from pipeline.simulate.coning import ConingSettings, simulate_coning
from pipeline.simulate.imperfections import GyroErrors, SimulationError, TimingErrors
from pipeline.simulate.plan import Limit, Processing
from pipeline.simulate.recording import START, SUFFIXES
from pipeline.simulate.samples import SAMPLES, write_samples

SHORT = ConingSettings(duration=0.1, reference_rate=1000.0)
LONG = ConingSettings(duration=50.0, reference_rate=10.0)  # 20,001 samples for the statistics
CLEAN = simulate_coning(LONG).gyro.values
SPREAD = 5 / np.sqrt(2 * 3 * 20_001)  # five standard errors of a standard deviation from 60,003 samples


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


class TestRecord:
    def test_paper_by_default(self) -> None:
        simulated = simulate_coning(ConingSettings())
        motion = ConingMotion(np.radians(1.0), 100.0)
        assert len(simulated.gyro.log_time) == 401
        assert len(simulated.reference.log_time) == 20_001
        assert simulated.gyro.header_stamp[0] == START
        t = (simulated.gyro.header_stamp - START) * 1e-9
        np.testing.assert_array_equal(simulated.gyro.values, motion.rates(t))
        t = (simulated.reference.header_stamp - START) * 1e-9
        np.testing.assert_array_equal(simulated.reference_angles.values, motion.angles(t))
        np.testing.assert_array_equal(simulated.reference.values, motion.quaternion(t))

    def test_onset(self) -> None:
        settings = replace(SHORT, first_time=-0.05, onset=0.0, smooth_slope=-0.05, smooth_offset=0.5)
        simulated = simulate_coning(settings)
        np.testing.assert_array_equal(simulated.gyro.values[:20], [[-0.05, 0, 0]] * 20)
        assert simulated.gyro.values[20, 2] != 0  # t* = 0 is the 21st sample, and belongs to the coning
        assert simulated.reference_angles.values[0, 2] == pytest.approx(0.5025, abs=1e-15)

    def test_increments_sum_to_the_integral(self) -> None:
        """Rounding alone: 41 increments of up to 0.02 rad."""
        settings = replace(SHORT, output="angle_increment")
        increments = simulate_coning(settings).gyro.values
        whole = settings.motion.increments([-1 / 400], [0.1])[0]
        np.testing.assert_allclose(increments.sum(axis=0), whole, rtol=0, atol=1e-15)

    def test_mounting_and_clock_offset(self) -> None:
        mounting = (0.01, -0.02, 0.03)
        settings = replace(
            SHORT, gyro=GyroErrors(mounting=mounting), timing=TimingErrors(clock_offset=-0.00123)
        )
        simulated, clean = simulate_coning(settings), simulate_coning(SHORT)
        body_from_gyro = matrix_from_quaternion(quaternion_from_rotation_vector(mounting))
        back = simulated.gyro.values @ body_from_gyro.T
        # rounding of rates of 11 rad/s
        np.testing.assert_allclose(back, clean.gyro.values, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(simulated.gyro.header_stamp, clean.gyro.header_stamp - 1_230_000)
        np.testing.assert_array_equal(simulated.gyro.log_time, clean.gyro.log_time)


class TestErrors:
    def test_white_noise(self) -> None:
        noise = simulate_coning(replace(LONG, gyro=GyroErrors(white_noise=1e-3)), 3).gyro.values - CLEAN
        assert np.std(noise) == pytest.approx(1e-3, rel=SPREAD)
        assert np.abs(np.mean(noise)) < 5e-3 / np.sqrt(noise.size)
        lagged = np.mean(noise[1:] * noise[:-1]) / np.var(noise)
        assert abs(lagged) < 5 / np.sqrt(noise.size)  # white: neighbours are not correlated

    def test_white_noise_of_increments_acts_over_the_interval(self) -> None:
        settings = replace(LONG, output="angle_increment")
        clean = simulate_coning(settings).gyro.values
        noise = simulate_coning(replace(settings, gyro=GyroErrors(white_noise=1e-3)), 3).gyro.values - clean
        assert np.std(noise) == pytest.approx(1e-3 / 400, rel=SPREAD)

    def test_white_angle_noise_does_not_add_up(self) -> None:
        settings = replace(LONG, output="angle_increment")
        clean = simulate_coning(settings).gyro.values
        noisy = simulate_coning(replace(settings, gyro=GyroErrors(white_angle_noise=1e-5)), 3).gyro.values
        angle = np.cumsum(noisy - clean, axis=0)
        angle -= angle.mean(axis=0)  # the noise at the instant before the first sample is common to all
        assert np.std(angle) == pytest.approx(1e-5, rel=SPREAD)
        rates = simulate_coning(replace(LONG, gyro=GyroErrors(white_angle_noise=1e-5)), 3).gyro.values - CLEAN
        # rounding of rates of 11 rad/s
        np.testing.assert_allclose(rates / 400, noisy - clean, rtol=0, atol=1e-14)

    def test_bias(self) -> None:
        biased = simulate_coning(replace(LONG, gyro=GyroErrors(bias=(1e-3, 0, -2e-3)))).gyro.values
        np.testing.assert_allclose(biased - CLEAN, [[1e-3, 0, -2e-3]] * len(CLEAN), rtol=0, atol=1e-14)

    def test_quantised_rates(self) -> None:
        lsb = np.radians(0.01)
        quantised = simulate_coning(replace(LONG, gyro=GyroErrors(quantum=lsb))).gyro.values
        np.testing.assert_allclose(quantised / lsb, np.rint(quantised / lsb), rtol=0, atol=1e-9)
        assert np.max(np.abs(quantised - CLEAN)) <= lsb / 2 * (1 + 1e-9)

    def test_quantised_increments_lose_no_remainder(self) -> None:
        lsb = 1e-5
        settings = replace(LONG, output="angle_increment")
        clean = simulate_coning(settings).gyro.values
        quantised = simulate_coning(replace(settings, gyro=GyroErrors(quantum=lsb))).gyro.values
        error = np.cumsum(quantised - clean, axis=0)
        assert np.max(np.abs(error)) <= lsb / 2 * (1 + 1e-6)

    def test_sample_jitter_is_stamped(self) -> None:
        simulated = simulate_coning(replace(LONG, timing=TimingErrors(sample_jitter=1e-4)), 5)
        offsets = simulated.gyro.header_stamp - simulate_coning(LONG).gyro.header_stamp
        assert np.std(offsets) == pytest.approx(1e5, rel=5 / np.sqrt(2 * 20_001))
        t = (simulated.gyro.header_stamp - START) * 1e-9
        # stamps hold whole nanoseconds, as the instants do: rounding of phases up to 3e4 rad
        np.testing.assert_allclose(simulated.gyro.values, LONG.motion.rates(t), rtol=0, atol=1e-9)
        wild = simulate_coning(replace(LONG, timing=TimingErrors(sample_jitter=1.0)), 5).gyro.header_stamp
        assert np.all(np.diff(wild) > 0)

    def test_stamp_noise_leaves_the_samples(self) -> None:
        simulated = simulate_coning(replace(LONG, timing=TimingErrors(stamp_noise=1e-4)), 5)
        np.testing.assert_array_equal(simulated.gyro.values, CLEAN)
        offsets = simulated.gyro.header_stamp - simulate_coning(LONG).gyro.header_stamp
        assert np.std(offsets) == pytest.approx(1e5, rel=5 / np.sqrt(2 * 20_001))

    def test_faults_are_where_the_truth_says(self) -> None:
        timing = TimingErrors(
            gaps=((0.02, 0.01),),
            nan_bursts=((0.05, 0.0051),),
            backward_stamps=(0.07,),
            repeated_samples=(0.08,),
            log_delay=1e-3,
            log_jitter=1e-4,
        )
        simulated = simulate_coning(replace(SHORT, timing=timing))
        gyro, faults = simulated.gyro, simulated.truth["faults"]
        stamps = gyro.header_stamp - START
        assert faults["lost"] == 4
        assert faults["gaps"] == [[START + 17_500_000, START + 30_000_000]]
        assert np.max(np.diff(stamps)) == 12_500_000
        assert faults["nan"] == np.isnan(gyro.values[:, 0]).sum() == 3
        backward = np.flatnonzero(np.diff(stamps) < 0) + 1
        assert gyro.header_stamp[backward].tolist() == faults["backward_stamps"] == [START + 66_250_000]
        repeated = np.flatnonzero(np.diff(stamps) == 0)
        assert gyro.header_stamp[repeated].tolist() == faults["repeated_stamps"] == [START + 80_000_000]
        assert len(stamps) == simulated.truth["samples"]["gyro"] == 41 - 4 + 1
        assert np.all(np.diff(gyro.log_time) >= 0)

    def test_reference_noise(self) -> None:
        settings = replace(LONG, reference_rate=400.0, frequency=7.3)
        noisy = simulate_coning(replace(settings, reference_noise=1e-4), 2)
        difference = noisy.reference_angles.values - simulate_coning(settings).reference_angles.values
        # axes and angles differ by a cone of 1 degree: 2e-4 of the noise
        assert np.std(difference) == pytest.approx(1e-4, rel=SPREAD + 2e-4)

    def test_one_error_leaves_the_others_as_they_were(self) -> None:
        noise = GyroErrors(white_noise=1e-3)
        alone = simulate_coning(replace(LONG, gyro=noise), 9).gyro
        both = simulate_coning(replace(LONG, gyro=noise, timing=TimingErrors(stamp_noise=1e-5)), 9).gyro
        np.testing.assert_array_equal(alone.values, both.values)
        other = simulate_coning(replace(LONG, gyro=noise), 10).gyro
        assert np.all(alone.values != other.values)


class TestRefused:
    @pytest.mark.parametrize(
        "wrong",
        [
            {"rate": 0.0},
            {"reference_rate": -1.0},
            {"duration": float("nan")},
            {"duration": 1e-3},
            {"reference_noise": -1.0},
            {"first_time": float("inf")},
            {"onset": float("nan")},
            {"smooth_slope": float("nan")},
            {"gyro": GyroErrors(white_noise=-1e-3)},
            {"gyro": GyroErrors(bias=(0.0, float("nan"), 0.0))},
            {"gyro": GyroErrors(mounting=(float("inf"), 0.0, 0.0))},
            {"timing": TimingErrors(log_jitter=-1e-3)},
            {"timing": TimingErrors(clock_offset=float("nan"))},
            {"timing": TimingErrors(clock_offset=-1e12)},
            {"timing": TimingErrors(gaps=((0.5, -0.1),))},
            {"timing": TimingErrors(nan_bursts=((0.5, float("nan")),))},
            {"timing": TimingErrors(backward_stamps=(float("nan"),))},
        ],
    )
    def test_setting_out_of_its_range(self, wrong: dict[str, Any]) -> None:
        with pytest.raises(SimulationError, match="simulation setting") as error:
            ConingSettings(**wrong)
        assert error.value.exit_code == ExitCode.USAGE

    def test_impossible_motion_or_fault(self) -> None:
        with pytest.raises(MotionError):
            simulate_coning(replace(SHORT, cone_angle=4.0))
        with pytest.raises(SimulationError, match="onset"):
            simulate_coning(replace(SHORT, smooth_slope=0.1))
        with pytest.raises(SimulationError, match="where the record ends"):
            simulate_coning(replace(SHORT, timing=TimingErrors(backward_stamps=(3.0,))))

    @pytest.mark.parametrize("name", ["run.xyz", "run.csv.gz", "run.db3"])
    def test_name_of_no_format(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(SimulationError, match=r"a name that ends in \.mcap"):
            simulate_coning(SHORT).write(tmp_path / name)
        assert list(tmp_path.iterdir()) == []


class TestFiles:
    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("output", ["angular_rate", "angle_increment"])
    def test_recording_plan_and_truth(self, tmp_path: Path, suffix: str, output: str) -> None:
        timing = TimingErrors(backward_stamps=(0.07,), nan_bursts=((0.05, 0.0051),))
        settings = replace(SHORT, output=output, timing=timing)  # type: ignore[arg-type]
        simulated = simulate_coning(settings, 4)
        recording, plan_path, truth_path = simulated.write(tmp_path / f"run{suffix}")
        truth = json.loads(truth_path.read_text())
        assert truth["seed"] == 4
        assert truth["settings"]["cone_angle"] == np.radians(1.0)
        assert truth["motion"]["roll_rate"] == settings.motion.rates([0.0])[0, 0]

        plan = tomllib.loads(plan_path.read_text())
        gyro = plan["streams"]["gyro"]
        assert (plan["procedure"], gyro["quantity"]) == ("coning", output)
        fields = tuple(channel["field"] for channel in gyro["channels"].values())
        times = (TimeField(plan["time"]["field"], plan["time"]["unit"]),) if "field" in plan["time"] else ()
        table = formats.read(recording, [Request(gyro.get("topic", ""), fields, times)])
        rows = table.tables[gyro.get("topic", "")]
        stamps = rows[plan["time"].get("field", "header_stamp")].to_numpy()
        found = np.column_stack([rows[field].to_numpy(zero_copy_only=False) for field in fields])
        is_sample = np.array([not null for null in rows[fields[0]].is_null().to_pylist()])
        assert table.losses == ()
        np.testing.assert_array_equal(stamps[is_sample], simulated.gyro.header_stamp)
        np.testing.assert_array_equal(found[is_sample], simulated.gyro.values)  # all 17 digits

    def test_degrees_in_text(self, tmp_path: Path) -> None:
        simulated = simulate_coning(SHORT)
        recording, plan, _ = simulated.write(tmp_path / "run.csv", angle_unit="deg")
        assert recording.read_text().startswith("time (s),p (deg/s),q (deg/s),r (deg/s),psi (deg)")
        assert tomllib.loads(plan.read_text())["streams"]["gyro"]["channels"]["p"]["unit"] == "deg/s"
        samples = formats.read(recording, [Request("", ("r (deg/s)",))])
        column = np.array([v for v in samples.tables[""]["r (deg/s)"].to_pylist() if v is not None])
        np.testing.assert_array_equal(column, np.degrees(simulated.gyro.values[:, 2]))

    def test_plan_carries_stages_and_limits(self, tmp_path: Path) -> None:
        processing = Processing(
            title='a "quoted" title',
            stages={"interpolate": {"method": "spline", "degree": 5}},
            limits=(Limit("peak_error", "psi", 1e-3, 5e-4, "why"), Limit("peak_error", "theta", 2.0)),
        )
        _, plan_path, _ = simulate_coning(SHORT).write(tmp_path / "run.mcap", processing=processing)
        plan = tomllib.loads(plan_path.read_text())
        assert plan["title"] == 'a "quoted" title'
        assert plan["interpolate"] == {"method": "spline", "degree": 5}
        assert plan["limits"] == [
            {"metric": "peak_error", "channel": "psi", "upper": 1e-3, "marginal_upper": 5e-4},
            {"metric": "peak_error", "channel": "theta", "upper": 2.0},
        ]


class TestSamples:
    def test_same_bytes_twice_in_four_formats_below_7_megabytes(self, tmp_path: Path) -> None:
        first = write_samples(tmp_path / "a")
        assert {path.suffix for path in first} == set(SUFFIXES)
        write_samples(tmp_path / "b")
        assert files(tmp_path / "a") == files(tmp_path / "b")
        write_samples(tmp_path / "a")  # what is there is replaced
        assert files(tmp_path / "a") == files(tmp_path / "b")
        assert sum(map(len, files(tmp_path / "a").values())) < 7_000_000

    def test_those_in_the_project_are_these(self, tmp_path: Path) -> None:
        """Plans to the byte; samples to 1e-12, for sines may differ in their last digit between machines."""
        project = Path(__file__).resolve().parents[2] / "sample_data"
        write_samples(tmp_path)
        made, kept = files(tmp_path), files(project)
        assert made.keys() <= kept.keys()
        plans = [name for name in made if name.endswith(".toml")]
        assert [made[name] for name in plans] == [kept[name] for name in plans]
        for name, field in (
            ("godorov.mcap", "quaternion.y"), ("noisy_gap.bag", "quaternion.y"), ("onset", "quaternion.x")
        ):  # fmt: skip
            here, there = (
                formats.read(folder / name, [Request("/reference", (field,))]).tables["/reference"]
                for folder in (tmp_path, project)
            )
            assert here["header_stamp"].equals(there["header_stamp"])
            np.testing.assert_allclose(here[field].to_numpy(), there[field].to_numpy(), rtol=0, atol=1e-12)

    @pytest.mark.parametrize("name", SAMPLES)
    def test_has_limits(self, name: str) -> None:
        assert SAMPLES[name].processing.limits
