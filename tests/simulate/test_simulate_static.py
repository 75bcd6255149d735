"""Simulated static records: exact noise, motion as stated, plan and truth beside them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import ExitCode
from pipeline.formats.base import Request
from pipeline.models.earth import RATE
from pipeline.models.random_error import Noise1, Noise2, Noise3, RandomError, RateRandomWalk, White
from pipeline.models.random_error_growth import variance
from pipeline.runner import validate
from pipeline.simulate.imperfections import SimulationError, TimingErrors
from pipeline.simulate.recording import START, SUFFIXES
from pipeline.simulate.samples import SAMPLES
from pipeline.simulate.static import simulate_static
from pipeline.simulate.static_settings import AxisErrors, Disturbance, StaticSettings, Turning
from pipeline.stages import ingest
from pipeline.testplan import load_plan

Float = NDArray[np.float64]
QUIET = StaticSettings(errors={"p": AxisErrors()}, duration=600.0)
ALL = AxisErrors(
    terms=(
        White(1e-10),
        Noise1(1e-5, 0.02),
        Noise2(2e-5, 0.02, 0.1),
        Noise3(1e-5, 0.02, 0.05),
        RateRandomWalk(1e-8),
    ),
    quantisation=1e-6,
    bias=2e-5,
    ramp=-3e-9,
)
TURNING = Turning(rate=np.deg2rad(3.0))


def record(settings: StaticSettings, seed: int = 0) -> Float:
    return simulate_static(settings, seed).gyro.values


def of(errors: AxisErrors, **changed: Any) -> StaticSettings:
    return replace(QUIET, errors={"p": errors}, **changed)


class TestNoise:
    def test_the_mean_of_all_terms_grows_in_variance_as_the_closed_forms_say(self) -> None:
        """Summed increments are the integral: Var(t, 0) of MATH's table, the walk's with them."""
        model, t = RandomError(ALL.terms), 100.0
        settings = of(AxisErrors(terms=ALL.terms), duration=t - 1)
        sums = np.array([record(settings, seed).sum() for seed in range(300)])
        exact = float(variance(model, np.array([t]))[0])
        # a variance of zero mean from 300 normal values: relative standard deviation sqrt(2/300) = 0.082
        assert np.mean(sums**2) == pytest.approx(exact, rel=3 * 0.082)

    def test_rates_have_the_autocorrelation_of_their_model(self) -> None:
        term = Noise2(1e-5, 0.02, 0.1)
        x = record(of(AxisErrors(terms=(term,)), output="angular_rate", duration=200_000.0))[:, 0]
        for lag in (0, 10, 30):
            measured = float(np.mean(x[: len(x) - lag] * x[lag:]))
            # of 200,000 s some 200000 mu = 4000 are independent: 1.6 % of sigma^2; five of that
            assert measured == pytest.approx(
                float(term.autocorrelation(np.array([float(lag)]))[0]), abs=0.08 * term.sigma**2
            )

    def test_quantisation_is_white_noise_of_the_angle(self) -> None:
        errors, duration = AxisErrors(quantisation=1e-6), 20_000.0
        rates = record(of(errors, duration=duration, output="angular_rate", rate=4.0))
        increments = record(of(errors, duration=duration, rate=4.0))
        np.testing.assert_allclose(rates / 4.0, increments, rtol=1e-12)  # one division
        # differences of white noise: 2 Q^2, of neighbours -Q^2; 80,001 samples give 0.5 % each
        assert np.var(increments) == pytest.approx(2e-12, rel=0.03)
        assert np.mean(increments[1:] * increments[:-1]) == pytest.approx(-1e-12, rel=0.03)

    def test_bias_and_ramp(self) -> None:
        errors = AxisErrors(bias=2e-5, ramp=-3e-9)
        t = np.arange(1201) / 2
        rates = record(of(errors, output="angular_rate", rate=2.0))[:, 0]
        np.testing.assert_allclose(rates, 2e-5 - 3e-9 * t, rtol=1e-14)  # rounding
        turned = np.cumsum(record(of(errors, rate=2.0))[:, 0])
        before = 2e-5 * 0.5 + 3e-9 * 0.125  # the step before the first sample
        np.testing.assert_allclose(turned, before + 2e-5 * t - 1.5e-9 * t**2, rtol=1e-12)

    def test_a_quantum_loses_no_remainder(self) -> None:
        errors, quantum = AxisErrors(bias=3.3e-6), 1e-5
        turned = np.cumsum(record(of(errors, quantum=quantum))[:, 0])
        exact = np.cumsum(record(of(errors))[:, 0])
        assert np.max(np.abs(turned - exact)) <= quantum / 2 * (1 + 1e-9)
        rates = record(of(ALL, quantum=quantum, output="angular_rate"))
        np.testing.assert_allclose(rates / quantum, np.rint(rates / quantum), rtol=0, atol=1e-9)

    def test_same_seed_same_record_and_an_axis_knows_nothing_of_the_others(self) -> None:
        both = replace(QUIET, errors={"p": ALL, "r": ALL})
        first = simulate_static(both, 3)
        np.testing.assert_array_equal(first.gyro.values, simulate_static(both, 3).gyro.values)
        assert not np.array_equal(first.gyro.values, record(both, 4))
        np.testing.assert_array_equal(first.gyro.values[:, 1:], record(replace(QUIET, errors={"r": ALL}), 3))
        assert not np.array_equal(first.gyro.values[:, 0], first.gyro.values[:, 1])


class TestMotion:
    def test_earth_and_platform(self) -> None:
        latitude, tilt = np.deg2rad(55.75), np.deg2rad(0.5)
        settings = StaticSettings(
            latitude=latitude, tilt=tilt, turning=TURNING, output="angular_rate", duration=300.0
        )
        simulated = simulate_static(settings)
        assert simulated.table is not None
        angle = simulated.table.values[:, 0]
        np.testing.assert_allclose(angle, np.deg2rad(3.0) * np.arange(301), rtol=1e-15)
        across = RATE * np.cos(latitude + tilt)
        exact = np.column_stack(
            [
                across * np.cos(angle),
                -across * np.sin(angle),
                np.full(301, np.deg2rad(3.0) + RATE * np.sin(latitude + tilt)),
            ]
        )
        np.testing.assert_allclose(simulated.gyro.values, exact, rtol=0, atol=1e-18)  # rounding of 7e-5

    @pytest.mark.parametrize("turning", [None, TURNING, Turning(rate=-2.0)])
    def test_increments_are_integrals_of_the_rates(self, turning: Turning | None) -> None:
        moved = (
            Disturbance(start=10, length=20, angle=0.01),
            Disturbance(start=50, length=8, angle=0.01, returns=True),
        )
        settings = StaticSettings(latitude=0.9, turning=turning, disturbances=moved, duration=100.0)
        fine = record(replace(settings, output="angular_rate", rate=1000.0))
        # Simpson's rule over each second
        weight = np.ones(1001)
        weight[1:-1:2], weight[2:-1:2] = 4.0, 2.0
        seconds = np.array([weight @ fine[1000 * k : 1000 * k + 1001] / 3000 for k in range(100)])
        # its error h^4/180 times the fourth derivative, which steps at a disturbance's ends: 1e-11
        np.testing.assert_allclose(record(settings)[1:], seconds, rtol=0, atol=1e-10)

    def test_a_motion_stays_and_a_tap_returns(self) -> None:
        stays, returns = (
            np.cumsum(record(replace(QUIET, disturbances=(d,)))[:, 0])
            for d in (
                Disturbance(start=100.5, length=10, angle=0.02),
                Disturbance(start=100.5, length=10, angle=0.02, returns=True),
            )
        )
        assert not stays[:101].any()
        np.testing.assert_allclose(stays[111:], 0.02, rtol=1e-12)
        np.testing.assert_allclose(returns[111:], 0.0, atol=1e-16)
        assert returns.max() == pytest.approx(0.02, rel=0.03)  # half a sample from the top: sin^2(0.45 pi)


class TestRecording:
    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_what_is_written_is_read_again(self, tmp_path: Path, suffix: str) -> None:
        settings = StaticSettings(
            errors={"p": ALL, "r": ALL},
            duration=600.0,
            turning=Turning(rate=0.5, wrapped=True),
            latitude=0.9,
            timing=TimingErrors(gaps=((100.0, 30.0),)),
        )
        simulated = simulate_static(settings, 2)
        recording, plan, truth = simulated.write(tmp_path / f"run{suffix}", angle_unit="deg")
        read = load_plan(plan)
        assert read.procedure == "static"
        assert read.stand.latitude_deg == pytest.approx(np.rad2deg(0.9), rel=1e-15)
        settings_of_ingest = read.settings["ingest"]
        assert isinstance(settings_of_ingest, ingest.Settings)
        tables = ingest.run(recording, settings_of_ingest, read.stand)
        gyro, table = tables["gyro_increments"], tables["turntable"]
        found = np.column_stack([gyro.column(f"increment_{axis}").to_numpy() for axis in "pr"])
        np.testing.assert_allclose(found, simulated.gyro.values, rtol=4e-16)  # degrees and back
        assert gyro.column("increment_q").null_count == gyro.num_rows == 601 - 30
        # a turn lost and found again: rounding of 300 rad, and of 360 degrees
        np.testing.assert_allclose(table.column("angle").to_numpy(), 0.5 * np.arange(601), rtol=0, atol=1e-12)
        assert table.column("rate").null_count == 601
        assert validate(recording).errors == 0
        said = json.loads(truth.read_text())
        assert said["faults"]["lost"] == 30
        assert said["samples"] == {"gyro": 571, "turntable": 601}
        assert said["axes"]["p"]["terms"][2] == {"model": "noise2", "sigma": 2e-5, "mu": 0.02, "lambda": 0.1}
        assert said["axes"]["r"]["coefficients"] == {"N": 1e-5, "K": 1e-8, "Q": 1e-6, "R": 3e-9}

    def test_a_table_s_rate_is_recorded_in_its_unit(self, tmp_path: Path) -> None:
        turning = Turning(rate=0.5, quantity="table_rate")
        recording, plan, _ = simulate_static(replace(QUIET, turning=turning)).write(
            tmp_path / "run.csv", angle_unit="deg"
        )
        assert 'channels.rate = { field = "table rate (deg/s)", unit = "deg/s" }' in plan.read_text()
        settings = load_plan(plan).settings["ingest"]
        assert isinstance(settings, ingest.Settings)
        table = ingest.run(recording, settings, load_plan(plan).stand)["turntable"]
        assert table.column("rate").to_pylist() == pytest.approx([0.5] * 601, rel=1e-15)

    def test_the_sample_is_at_rest_with_one_gap_and_as_it_is_kept(self, tmp_path: Path) -> None:
        settings = SAMPLES["static.mcap"].settings
        assert isinstance(settings, StaticSettings)
        simulated = simulate_static(settings, SAMPLES["static.mcap"].seed)
        assert simulated.truth["faults"]["lost"] == 30
        assert np.diff(simulated.gyro.header_stamp).max() == 62 * 10**9
        assert simulated.gyro.header_stamp[0] == START
        SAMPLES["static.mcap"].write(tmp_path / "static.mcap")
        kept = Path(__file__).resolve().parents[2] / "sample_data"
        assert (tmp_path / "static.toml").read_bytes() == (kept / "static.toml").read_bytes()
        here, there = (
            formats.read(folder / "static.mcap", [Request("/gyro", ("vector.y",))]).tables["/gyro"]
            for folder in (tmp_path, kept)
        )
        assert here["header_stamp"].equals(there["header_stamp"])
        # exponentials may differ in their last digit between machines; increments are some 1e-5 rad
        np.testing.assert_allclose(
            here["vector.y"].to_numpy(), there["vector.y"].to_numpy(), rtol=0, atol=1e-15
        )
        assert (kept / "static.mcap").stat().st_size < 400_000


REFUSED = [
    ({"errors": {}}, "errors", "found none"),
    ({"errors": {"x": AxisErrors()}}, "errors", "'x'"),
    ({"rate": 0.0}, "rate", "more than 0"),
    ({"duration": 1.0}, "duration", "three samples"),
    ({"quantum": -1.0}, "quantum", "at least 0"),
    ({"latitude": 2.0}, "latitude", "at most 1.5708"),
    ({"timing": TimingErrors(sample_jitter=0.01)}, "sample_jitter", "even instants"),
]


@pytest.mark.parametrize(("changed", "key", "words"), REFUSED)
def test_a_record_that_cannot_be_is_refused(changed: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(SimulationError, match=f"simulation setting {key}: ") as caught:
        replace(QUIET, **changed)
    assert words in str(caught.value)
    assert caught.value.exit_code is ExitCode.USAGE


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        (Turning, {"rate": 0.0}),
        (Turning, {"rate": np.inf}),
        (Turning, {"rate": 1.0, "quantity": "table_rate", "wrapped": True}),
        (Disturbance, {"start": 0.0, "length": 0.0, "angle": 1.0}),
        (AxisErrors, {"quantisation": -1.0}),
        (AxisErrors, {"bias": np.nan}),
    ],
)
def test_a_part_that_cannot_be_is_refused(kind: type, changed: dict[str, Any]) -> None:
    with pytest.raises(SimulationError, match="simulation setting"):
        kind(**changed)
