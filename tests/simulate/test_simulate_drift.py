"""Simulated runs of a non-contact gyro: exact angles, errors as stated, plan and truth beside them."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline import formats, units
from pipeline.errors import ExitCode, GyrostandError
from pipeline.formats.base import Request, TimeField
from pipeline.models.drift_trajectory import trajectory
from pipeline.models.earth import RATE, Base, mounting_angles
from pipeline.models.gyro_drift import Gyro, exact_rates
from pipeline.simulate.drift import SimulatedDrift, simulate_drift
from pipeline.simulate.drift_settings import DriftRun, DriftSettings, Encoder
from pipeline.simulate.imperfections import EncoderErrors, SimulationError, TimingErrors
from pipeline.simulate.recording import START, SUFFIXES
from pipeline.simulate.samples import SAMPLES

Float = NDArray[np.float64]
LATITUDE, ARCMIN, ARCSEC = np.deg2rad(55.75), np.deg2rad(1 / 60), np.deg2rad(1 / 3600)
HOUR = DriftRun(scheme="vertical", start=(0.3, -0.4), duration=3600.0)
SHORT = DriftSettings(
    m=(0.011, -0.007, 0.005, 0.003, -0.002, 0.004), theta=(0.002, -0.001), runs=(HOUR,), interval=60.0
)
LONG = replace(SHORT, runs=(replace(HOUR, duration=100_000.0),), interval=5.0)
COUNT = 20_001
CLEAN = simulate_drift(LONG).gimbal.values
SPREAD = 5 / np.sqrt(2 * 2 * COUNT)  # five standard errors of a standard deviation from 40,002 samples


class TestMotion:
    def test_angles_are_those_of_the_exact_model_at_the_stamps(self) -> None:
        increments = (1 * ARCMIN, 2 * ARCMIN, -1 * ARCMIN)
        settings = replace(SHORT, runs=(replace(HOUR, increments=increments),))
        simulated = simulate_drift(settings)
        # vertical: chi2 = 0, so that the rotation vector is the increments themselves
        base = Base.mounted("vertical", LATITUDE).misaligned(np.array(increments))
        tau = RATE * 60.0 * np.arange(61)
        exact = trajectory(Gyro(np.array(SHORT.m), np.array(SHORT.theta)), base, np.array([0.3, -0.4]), tau)
        assert (simulated.gimbal.header_stamp - START).tolist() == [60 * 10**9 * k for k in range(61)]
        np.testing.assert_allclose(simulated.gimbal.values, exact, rtol=0, atol=1e-14)  # rounding

    def test_rotation_vector_of_increments_and_its_epsilon_are_in_the_truth(self) -> None:
        d1, d2, d3 = increments = (1 * ARCMIN, 2 * ARCMIN, -3 * ARCMIN)
        misalignment = (0.5 * ARCMIN, 0.0, 0.0)
        run = DriftRun(scheme="equatorial", increments=increments, misalignment=misalignment, duration=3600.0)
        truth = simulate_drift(replace(SHORT, runs=(run,))).truth["runs"][0]
        chi2 = mounting_angles("equatorial", LATITUDE)[1]
        vector = [d1 - d3 * np.sin(chi2) + misalignment[0], d2, d3 * np.cos(chi2)]
        assert truth["delta_chi"] == pytest.approx(vector, abs=1e-18)
        # u = (1, 0, 0) in the equatorial scheme; its components carry the rounding of the rotation
        epsilon = [truth["parameters"][f"epsilon{k}"] for k in (1, 2, 3)]
        assert epsilon == pytest.approx([0.0, -vector[2], vector[1]], abs=1e-18)

    def test_angles_chi_stand_for_a_scheme(self) -> None:
        chi = mounting_angles("polar", LATITUDE)
        polar = simulate_drift(replace(SHORT, runs=(replace(HOUR, scheme="polar"),)))
        turned = simulate_drift(replace(SHORT, runs=(replace(HOUR, scheme=None, chi=chi),)))
        np.testing.assert_array_equal(polar.alpha, turned.alpha)

    def test_transient_begins_at_m0_and_ends_at_m(self) -> None:
        m0, base = (0.05, -0.04, 0.03, 0.02, -0.05, 0.06), Base.mounted("vertical", LATITUDE)
        settings = replace(SHORT, interval=1.0, transient=m0, transient_time=600.0)
        alpha = simulate_drift(settings).alpha
        for m, where, bound in (
            # m changes by a 1200th in half a step, of up to 0.09: 7e-5; the curvature cancels
            (m0, 0, 1.5e-4),
            # e^-6 of the change remains: 2e-4
            (SHORT.m, len(alpha) - 2, 5e-4),
        ):
            rates = (alpha[where + 1] - alpha[where]) / RATE
            middle = (alpha[where + 1] + alpha[where])[np.newaxis] / 2
            exact = exact_rates(middle, Gyro(np.array(m), np.array(SHORT.theta)), base)[0]
            np.testing.assert_allclose(rates, exact, rtol=0, atol=bound)

    def test_servo_holds_the_rotor_again_from_where_it_jumped(self) -> None:
        jumped = simulate_drift(replace(SHORT, servo_jumps=((1200.0, 0.02, -0.01),))).alpha
        clean = simulate_drift(SHORT).alpha
        np.testing.assert_array_equal(jumped[:20], clean[:20])
        np.testing.assert_allclose(jumped[20] - clean[20], [0.02, -0.01], rtol=0, atol=1e-15)  # rounding
        again = simulate_drift(
            replace(SHORT, runs=(replace(HOUR, start=tuple(jumped[20]), duration=2400.0),))
        )
        # both integrated to 1e-12
        np.testing.assert_allclose(jumped[20:], again.alpha, rtol=0, atol=1e-11)

    def test_runs_follow_each_other_and_the_plan_parts_them_in_the_pause(self, tmp_path: Path) -> None:
        other = DriftRun(name="late", scheme=None, chi=(0.1, 0.2, -0.3), start=(1.0, 0.2), duration=1800.0)
        settings = replace(SHORT, runs=(HOUR, other, replace(HOUR, scheme="polar")), pause=900.0)
        simulated = simulate_drift(settings)
        stamps = simulated.gimbal.header_stamp - START
        beginnings = np.concatenate([[0], np.flatnonzero(np.diff(stamps) > 60 * 10**9) + 1])
        assert (stamps[beginnings] * 1e-9).tolist() == [0.0, 4500.0, 7200.0]
        np.testing.assert_array_equal(simulated.alpha[beginnings], [HOUR.start, other.start, HOUR.start])
        _, plan, _ = simulated.write(tmp_path / "run.mcap")
        said = tomllib.loads(plan.read_text())
        assert [run["name"] for run in said["runs"]] == ["run 0", "late", "run 2"]
        assert [run.get("scheme") for run in said["runs"]] == ["vertical", None, "polar"]
        assert np.deg2rad(said["runs"][1]["chi_deg"]) == pytest.approx([0.1, 0.2, -0.3], rel=1e-15)
        assert [run.get("start") for run in said["runs"]] == [None, 4050.0, 6750.0]
        assert [run.get("stop") for run in said["runs"]] == [4050.0, 6750.0, None]
        assert said["stand"] == {"name": "simulated gimbal stand", "latitude_deg": pytest.approx(55.75)}
        truth = simulated.truth["runs"]
        assert [(run["start"] - START, run["end"] - START) for run in truth] == [
            (round(a * 1e9), round(b * 1e9)) for a, b in ((0, 3600), (4500, 6300), (7200, 10_800))
        ]

    def test_one_run_begins_anew(self) -> None:
        """A run is the same whatever stands before it: its transient, too, begins with it."""
        settings = replace(SHORT, transient=(0.05,) * 6)
        alone, twice = simulate_drift(settings), simulate_drift(replace(settings, runs=(HOUR, HOUR)))
        np.testing.assert_array_equal(twice.alpha[:61], alone.alpha)
        np.testing.assert_array_equal(twice.alpha[61:], alone.alpha)


class TestErrors:
    def test_white_noise(self) -> None:
        noise = (
            simulate_drift(replace(LONG, errors=EncoderErrors(white_noise=ARCSEC)), 3).gimbal.values - CLEAN
        )
        assert np.std(noise) == pytest.approx(ARCSEC, rel=SPREAD)
        lagged = np.mean(noise[1:] * noise[:-1], axis=0) / np.var(noise)
        assert np.all(np.abs(lagged) < 5 / np.sqrt(COUNT))

    def test_coloured_noise_has_its_variance_and_correlation_time(self) -> None:
        errors = EncoderErrors(coloured_noise=ARCSEC, correlation_time=20.0)
        noise = simulate_drift(replace(LONG, errors=errors), 3).gimbal.values - CLEAN
        # correlated over 20 s: (1 + f^2)/(1 - f^2) = 4.1 times fewer free samples
        fall = np.exp(-5.0 / 20.0)
        wider = SPREAD * np.sqrt((1 + fall**2) / (1 - fall**2))
        assert np.std(noise) == pytest.approx(ARCSEC, rel=wider)
        for lag in (1, 2, 4):
            correlation = np.mean(noise[lag:] * noise[:-lag]) / np.var(noise)
            assert correlation == pytest.approx(fall**lag, abs=wider)

    def test_outliers_are_where_the_truth_says(self) -> None:
        errors = EncoderErrors(outlier_share=0.01, outlier_size=ARCMIN)
        simulated = simulate_drift(replace(LONG, errors=errors), 3)
        off = simulated.gimbal.values - CLEAN
        stamps = simulated.gimbal.header_stamp[np.any(off != 0, axis=1)]
        assert stamps.tolist() == simulated.truth["faults"]["outliers"]
        # five standard errors of a share, and of a standard deviation
        assert len(stamps) == pytest.approx(0.01 * COUNT, abs=5 * np.sqrt(0.01 * COUNT))
        assert np.std(off[np.any(off != 0, axis=1)]) == pytest.approx(
            ARCMIN, rel=5 / np.sqrt(4 * len(stamps))
        )

    def test_steps_of_the_encoder(self) -> None:
        counts = 100_000
        values = simulate_drift(replace(LONG, encoder=Encoder(counts=counts))).gimbal.values
        steps = values * counts / (2 * np.pi)
        np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-9)  # rounding of 1e5 counts
        assert np.max(np.abs(values - CLEAN)) <= np.pi / counts * (1 + 1e-9)

    def test_jittered_samples_are_of_the_instants_that_are_stamped(self) -> None:
        simulated = simulate_drift(replace(SHORT, timing=TimingErrors(sample_jitter=5.0)), 5)
        t = (simulated.gimbal.header_stamp - START) * 1e-9
        assert np.std(t - 60.0 * np.arange(61)) == pytest.approx(5.0, rel=5 / np.sqrt(2 * 61))
        gyro, base = Gyro(np.array(SHORT.m), np.array(SHORT.theta)), Base.mounted("vertical", LATITUDE)
        exact = trajectory(gyro, base, np.array(HOUR.start), RATE * t)
        np.testing.assert_array_equal(simulated.gimbal.values, exact)

    def test_faults_are_where_the_truth_says(self) -> None:
        timing = TimingErrors(
            gaps=((600.0, 240.0),), nan_bursts=((1800.0, 121.0),), backward_stamps=(3000.0,)
        )
        simulated = simulate_drift(replace(SHORT, timing=timing))
        faults, stamps = simulated.truth["faults"], simulated.gimbal.header_stamp
        assert faults["lost"] == 4
        assert faults["gaps"] == [[START + 540 * 10**9, START + 840 * 10**9]]
        assert faults["nan"] == np.isnan(simulated.gimbal.values[:, 0]).sum() == 3
        backward = np.flatnonzero(np.diff(stamps) < 0) + 1
        assert stamps[backward].tolist() == faults["backward_stamps"] == [START + 2910 * 10**9]
        assert len(stamps) == simulated.truth["samples"]["gimbal"] == 61 - 4

    def test_one_error_leaves_the_others_as_they_were(self) -> None:
        noise = EncoderErrors(white_noise=ARCSEC)
        alone = simulate_drift(replace(SHORT, errors=noise), 9).gimbal.values
        coloured = simulate_drift(
            replace(SHORT, errors=replace(noise, coloured_noise=ARCSEC)), 9
        ).gimbal.values
        only = simulate_drift(replace(SHORT, errors=EncoderErrors(coloured_noise=ARCSEC)), 9).gimbal.values
        clean = simulate_drift(SHORT).gimbal.values
        np.testing.assert_allclose(coloured - alone, only - clean, rtol=0, atol=1e-15)  # rounding
        assert np.all(alone != simulate_drift(replace(SHORT, errors=noise), 10).gimbal.values)


class TestRefused:
    @pytest.mark.parametrize(
        "wrong",
        [
            {"latitude": 1.6},
            {"latitude": float("nan")},
            {"m": (2.0, 0, 0, 0, 0, 0)},
            {"theta": (1.0, 0.0)},
            {"interval": 0.0},
            {"interval": 2000.0},
            {"pause": 0.0},
            {"runs": ()},
            {"transient": (float("nan"),) * 6},
            {"transient_time": 0.0},
            {"servo_jumps": ((1.0, float("inf"), 0.0),)},
            {"errors": EncoderErrors(white_noise=-1.0)},
            {"errors": EncoderErrors(correlation_time=0.0)},
            {"errors": EncoderErrors(outlier_share=1.5)},
            {"timing": TimingErrors(gaps=((0.5, -0.1),))},
        ],
    )
    def test_setting_out_of_its_range(self, wrong: dict[str, Any]) -> None:
        with pytest.raises(SimulationError, match="simulation setting") as error:
            replace(SHORT, **wrong)
        assert error.value.exit_code == ExitCode.USAGE

    @pytest.mark.parametrize(
        "wrong",
        [
            {"duration": 0.0},
            {"start": (float("inf"), 0.0)},
            {"misalignment": (1.0, 0.0, 0.0)},
            {"scheme": None},
            {"chi": (0.0, 0.0, 0.0)},
            {"scheme": None, "chi": (0.1, 0.0, 0.0), "increments": (1e-3, 0.0, 0.0)},
        ],
    )
    def test_run_that_cannot_be(self, wrong: dict[str, Any]) -> None:
        with pytest.raises(SimulationError, match="simulation setting"):
            replace(HOUR, **wrong)

    def test_encoder_that_cannot_be(self) -> None:
        with pytest.raises(SimulationError, match="counts"):
            Encoder(counts=1)
        with pytest.raises(SimulationError, match="counts a turn"):
            Encoder(as_counts=True)

    def test_inner_gimbal_at_90_degrees(self) -> None:
        """Polar scheme, rotor across the Earth's axis: in six hours it points along the outer axis."""
        run = DriftRun(scheme="polar", start=(np.pi / 2, 0.0), duration=86_400.0)
        with pytest.raises(GyrostandError, match="90 degrees") as error:
            simulate_drift(replace(SHORT, m=(0.0,) * 6, theta=(0.0, 0.0), runs=(run,)))
        assert error.value.exit_code == ExitCode.USAGE


ENCODERS = (
    Encoder(),
    Encoder(wrapped=True),
    Encoder(unit="deg", wrapped=True),
    Encoder(unit="deg", counts=1_296_000, as_counts=True, wrapped=True),
    Encoder(counts=2**24, as_counts=True),
)


def read_back(recording: Path, plan: dict[str, Any]) -> tuple[NDArray[np.int64], Float]:
    """Stamps and angles [rad] as the plan says they are recorded, unwrapped."""
    stream = plan["streams"]["gimbal"]
    channels = [stream["channels"][name] for name in ("alpha1", "alpha2")]
    topic, fields = stream.get("topic", ""), tuple(channel["field"] for channel in channels)
    times = (TimeField(plan["time"]["field"], plan["time"]["unit"]),) if "field" in plan["time"] else ()
    read = formats.read(recording, [Request(topic, fields, times)])
    assert read.losses == ()
    rows = read.tables[topic]
    angles = []
    for channel in channels:
        raw = rows[channel["field"]].to_numpy()
        if "wraps_at" in channel:
            assert 0 <= raw.min() <= raw.max() < channel["wraps_at"]
            raw = np.unwrap(raw, period=channel["wraps_at"])
        angles.append(raw * channel.get("scale", 1.0) * units.factor(channel["unit"], "angle"))
    return rows[plan["time"].get("field", "header_stamp")].to_numpy(), np.column_stack(angles)


class TestFiles:
    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize("encoder", ENCODERS, ids=lambda e: f"{e.unit}-{e.counts}-{e.wrapped}")
    def test_angles_come_back(self, tmp_path: Path, suffix: str, encoder: Encoder) -> None:
        settings = replace(SHORT, runs=(replace(HOUR, duration=30_000.0),), encoder=encoder)
        simulated = simulate_drift(settings, 4)
        recording, plan, truth = simulated.write(tmp_path / f"run{suffix}")
        assert json.loads(truth.read_text()) == json.loads(json.dumps(simulated.truth))
        stamps, alpha = read_back(recording, tomllib.loads(plan.read_text()))
        np.testing.assert_array_equal(stamps, simulated.gimbal.header_stamp)
        turns = np.rint((alpha[0] - simulated.alpha[0]) / (2 * np.pi))  # a wrapped angle has lost its turn
        # rounding of degrees and turns; half a count where there are counts
        bound = 1e-9 if encoder.counts is None else np.pi / encoder.counts * (1 + 1e-9)
        np.testing.assert_allclose(alpha - 2 * np.pi * turns, simulated.alpha, rtol=0, atol=bound)

    def test_plan_and_truth(self, tmp_path: Path) -> None:
        _, plan, truth = simulate_drift(SHORT, 4).write(tmp_path / "run.csv")
        said = tomllib.loads(plan.read_text())
        assert said["procedure"] == "drift"
        assert said["stand"]["scheme"] == "vertical"
        assert said["streams"]["gimbal"]["quantity"] == "gimbal_angles"
        known = json.loads(truth.read_text())
        assert known["seed"] == 4
        assert known["parameters"]["m12"] == -0.007
        assert known["parameters"]["theta1"] == 0.002
        assert known["drift"]["m11"] == pytest.approx(0.011 * 15.041067, rel=1e-15)

    def test_same_seed_same_record(self) -> None:
        settings = replace(
            SHORT,
            errors=EncoderErrors(
                white_noise=ARCSEC, coloured_noise=ARCSEC, outlier_share=0.1, outlier_size=1e-3
            ),
            timing=TimingErrors(sample_jitter=1.0, stamp_noise=0.1, log_jitter=0.1),
        )

        def bits(simulated: SimulatedDrift) -> list[bytes]:
            recorded = simulated.gimbal
            return [a.tobytes() for a in (recorded.log_time, recorded.header_stamp, recorded.values)]

        first, second, other = (bits(simulate_drift(settings, seed)) for seed in (1, 1, 2))
        assert first == second
        assert all(a != b for a, b in zip(first, other, strict=True))

    def test_runs_of_one_recording_are_jittered_by_themselves(self) -> None:
        settings = replace(SHORT, runs=(HOUR, HOUR), timing=TimingErrors(sample_jitter=1.0))
        stamps = simulate_drift(settings, 1).gimbal.header_stamp
        offsets = [np.diff(part) for part in (stamps[:61], stamps[61:])]
        assert all(np.all(a != b) for a, b in pairwise(offsets))


DRIFT_SAMPLES = {name: s.settings for name, s in SAMPLES.items() if isinstance(s.settings, DriftSettings)}


class TestSamples:
    def test_there_is_one_of_each_scheme_in_each_format(self) -> None:
        schemes = [settings.runs[0].scheme for settings in DRIFT_SAMPLES.values()]
        assert sorted(map(str, schemes)) == ["equatorial", "horizontal", "polar", "vertical"]
        assert {Path(name).suffix for name in DRIFT_SAMPLES} == set(SUFFIXES)

    @pytest.mark.parametrize("name", DRIFT_SAMPLES)
    def test_that_in_the_project_is_this(self, tmp_path: Path, name: str) -> None:
        """Angles to 1e-12, for sines may differ in their last digit between machines, or by a count."""
        kept = Path(__file__).resolve().parents[2] / "sample_data" / name
        made = tmp_path / name
        SAMPLES[name].write(made)
        assert made.with_suffix(".toml").read_bytes() == kept.with_suffix(".toml").read_bytes()
        assert sum(f.stat().st_size for f in [kept, *kept.glob("*")] if f.is_file()) < 400_000
        plan = tomllib.loads(kept.with_suffix(".toml").read_text())
        (stamps, alpha), (others, same) = read_back(made, plan), read_back(kept, plan)
        np.testing.assert_array_equal(stamps, others)
        counts = DRIFT_SAMPLES[name].encoder.counts
        bound = 1e-12 if counts is None else 2 * np.pi / counts * (1 + 1e-9)
        np.testing.assert_allclose(alpha, same, rtol=0, atol=bound)
