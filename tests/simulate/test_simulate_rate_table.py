"""Simulated rate tables: exact motion and outputs, noise as stated, plan and truth beside them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models.earth import RATE
from pipeline.models.multi_position import SIX_POSITIONS, position
from pipeline.models.random_error import Noise1, RateRandomWalk, White
from pipeline.runner import validate
from pipeline.simulate.drift_settings import Encoder
from pipeline.simulate.imperfections import SimulationError, TimingErrors
from pipeline.simulate.rate_table import SimulatedRateTable, simulate_rate_table
from pipeline.simulate.rate_table_settings import (
    Hand,
    Mounting,
    Profile,
    RateTableSettings,
    TableGyro,
    TableSensor,
    Thermometer,
)
from pipeline.simulate.recording import START, SUFFIXES
from pipeline.stages import ingest
from pipeline.testplan import load_plan

Float = NDArray[np.float64]
DEGREE = np.pi / 180
LATITUDE, HEADING, TILT = 0.9, 0.4, 0.02
PROFILE = Profile(rates=(0.0, 0.5, -0.5, 1.0), dwell=4.0, acceleration=1.0)
UPRIGHT = RateTableSettings(profile=PROFILE, mountings=(Mounting(axis="r"),), rate=50.0)
BENT = TableGyro(
    scale_factor=1.002,
    asymmetry=4e-4,
    nonlinearity={2: 1e-4, 3: 2e-4},
    bias=3e-4,
    misalignment=(2e-3, -1e-3),
    bias_temperature_sensitivity=1e-6,
    scale_factor_temperature_sensitivity=5e-5,
)


def simulated(settings: RateTableSettings, seed: int = 0) -> SimulatedRateTable:
    return simulate_rate_table(settings, seed)


class TestMotion:
    def test_the_table_ramps_holds_and_stops(self) -> None:
        """Corners by hand: 4 s at rest, ramps of 0.5, 1.0, 1.5 and 1.0 s, four dwells."""
        record = simulated(UPRIGHT)
        at = [0.0, 4.0, 4.5, 8.5, 9.5, 13.5, 15.0, 19.0, 20.0]
        rates = [0.0, 0.0, 0.5, 0.5, -0.5, -0.5, 1.0, 1.0, 0.0]
        t = np.arange(1001) / 50
        exact = np.interp(t, at, rates)
        # the slope of a ramp times rounded time
        np.testing.assert_allclose(record.exact[:, 2], exact, rtol=0, atol=1e-14)
        assert record.table is not None
        until = [np.array([*(corner for corner in at if corner < s), s]) for s in t]
        angle = np.array([np.trapezoid(np.interp(u, at, rates), u) for u in until])
        np.testing.assert_allclose(record.table.values[::2, 0], angle, rtol=0, atol=1e-13)

    def test_ripple_is_in_both_and_means_are_differences_of_the_angle(self) -> None:
        rippling = replace(PROFILE, ripple=0.02, ripple_harmonic=9)
        sensor = TableSensor(rate=50.0)
        record = simulated(replace(UPRIGHT, profile=rippling, means=True, table=sensor))
        assert record.table is not None
        # quadrature of 8 nodes over a phase of 9 x 0.02 rad, differences of 10 rad over 0.02 s
        np.testing.assert_allclose(
            record.exact[1:, 2], np.diff(record.table.values[:, 0]) * 50, rtol=0, atol=3e-13
        )
        assert np.std(record.exact[480:660, 2] + 0.5) < 1e-2  # still about the rate that was commanded
        assert np.ptp(record.exact[480:660, 2]) == pytest.approx(2 * 0.02 * 0.5, rel=0.01)

    @pytest.mark.parametrize("axis", ["p", "q", "r", "-p", "-q", "-r"])
    def test_the_case_has_the_table_s_axis_and_the_earth_s_rate(self, axis: Any) -> None:
        earth = {"latitude": LATITUDE, "heading": HEADING, "tilt": TILT}
        record = simulated(replace(UPRIGHT, mountings=(Mounting(axis=axis),), **earth))
        along, sign = "pqr".index(axis[-1]), -1.0 if axis.startswith("-") else 1.0
        u = RATE * np.array([np.cos(LATITUDE), 0.0, np.sin(LATITUDE)])  # North, West, Up
        up = np.array([np.sin(TILT) * np.cos(HEADING), -np.sin(TILT) * np.sin(HEADING), np.cos(TILT)])
        # at rest and upon the whole turns: along the axis of rotation
        np.testing.assert_allclose(record.exact[:150, along], sign * (u @ up), rtol=0, atol=1e-18)
        size = np.linalg.norm(record.exact[:150], axis=1)
        np.testing.assert_allclose(size, RATE, rtol=1e-14)
        # the rotor's axis 1 is the next axis of the case: at angle 0 it leans down along the heading
        one = np.array([np.cos(TILT) * np.cos(HEADING), -np.cos(TILT) * np.sin(HEADING), -np.sin(TILT)])
        np.testing.assert_allclose(record.exact[0, (along + 1) % 3], u @ one, rtol=0, atol=1e-18)

    def test_an_orientation_error_turns_the_case(self) -> None:
        record = simulated(replace(UPRIGHT, orientation_error=1e-3), 5)
        psi = np.array(record.truth["runs"][0]["orientation_errors"][0])
        assert 0 < np.abs(psi).max() < 4e-3
        turned = np.array([0.0, 0.0, 1.0]) + np.cross(psi, [0.0, 0.0, 1.0])
        direction = record.exact[300] / np.linalg.norm(record.exact[300])
        np.testing.assert_allclose(
            direction, turned / np.linalg.norm(turned), rtol=0, atol=3e-6
        )  # second order

    def test_turns_by_hand_integrate_to_their_angles(self) -> None:
        hand = Hand(turns=(2 * np.pi, -np.pi), rest=3.0, moving=2.0)
        record = simulated(replace(UPRIGHT, method="turns", hand=hand, means=True))
        turned = np.cumsum(record.exact, axis=0) / 50
        ends = turned[[250 * k for k in range(1, 7)]]
        steps = np.diff(ends, axis=0, prepend=np.zeros((1, 3)))
        wanted = np.zeros((6, 3))
        for k, angle in enumerate((2 * np.pi, -np.pi) * 3):
            wanted[k, k // 2] = angle
        np.testing.assert_allclose(steps, wanted, rtol=0, atol=1e-12)  # rounding of 1000 sums
        assert record.table is None

    def test_the_earth_s_rate_turns_back_in_the_case(self) -> None:
        """dw/dt = -omega x w, by central differences of the simulated rates themselves."""
        settings = replace(UPRIGHT, method="turns", hand=Hand(rest=3.0, moving=2.0), rate=1000.0)
        with_earth = simulated(replace(settings, latitude=LATITUDE)).exact
        omega = simulated(settings).exact
        w = with_earth - omega
        np.testing.assert_allclose(np.linalg.norm(w, axis=1), RATE, rtol=1e-9)  # of a difference from 6 rad/s
        derivative = (w[2:] - w[:-2]) * 500.0
        # h^2/6 of the third derivative (6 rad/s)^3 RATE is 3e-9; rounding of 6 rad/s over 2 ms 5e-13
        np.testing.assert_allclose(derivative, -np.cross(omega, w)[1:-1], rtol=0, atol=1e-8)
        np.testing.assert_allclose(w[0], RATE * np.array([np.cos(LATITUDE), 0, np.sin(LATITUDE)]), atol=1e-18)
        np.testing.assert_allclose(w[-1], w[0], rtol=0, atol=1e-15)  # whole turns

    def test_six_positions(self) -> None:
        hand = Hand(rest=3.0, moving=2.0)
        record = simulated(replace(UPRIGHT, method="positions", hand=hand, latitude=LATITUDE))
        u = RATE * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
        for k, (up, north) in enumerate(SIX_POSITIONS):
            seen = record.exact[250 * k : 250 * k + 150]
            np.testing.assert_allclose(seen, np.tile(position(up, north) @ u, (150, 1)), rtol=0, atol=1e-18)


class TestOutput:
    def test_the_model_of_the_standards(self) -> None:
        warm = Thermometer(profile=((0.0, 283.15), (20.0, 303.15)))
        settings = replace(UPRIGHT, gyros={"p": BENT, "r": BENT}, temperature=warm)
        record = simulated(settings)
        t = np.arange(1001) / 50
        across, along = np.sqrt(1 - 5e-6), record.exact[:, 1]
        warmth = t - 10.0
        for k, part in enumerate((-1e-3, across)):  # r is the second of the others of p
            w = part * along
            bent = 1e-4 * w**2 + 2e-4 * w**3  # the full scale is 1 rad/s
            braces = w + 4e-4 * np.abs(w) / 2 + bent + 5e-5 * warmth * w
            y = 1.002 * braces + 3e-4 + 1e-6 * warmth
            np.testing.assert_allclose(record.gyro.values[:, k], y, rtol=0, atol=1e-14)
        assert record.truth["sensitivity"][1] == pytest.approx([1.002 * v for v in (2e-3, -1e-3, across)])

    def test_means_are_integrals_of_the_instants(self) -> None:
        warm = Thermometer(profile=((0.0, 283.15), (7.3, 303.15), (20.0, 290.0)))
        settings = replace(UPRIGHT, gyros={"r": BENT}, temperature=warm, rate=10.0, full_scale=1.0)
        fine = simulated(replace(settings, rate=1000.0)).gyro.values[:, 0]
        # Simpson's rule; every corner falls on a sample of 1 ms, and is one of its edges or middles
        weight = np.ones(101)
        weight[1:-1:2], weight[2:-1:2] = 4.0, 2.0
        wanted = np.array([weight @ fine[100 * k : 100 * k + 101] / 300 for k in range(200)])
        found = simulated(replace(settings, means=True)).gyro.values[1:, 0]
        # a corner in the middle of a pair costs h^2/6 of the step of the slope: 2e-4 x 1e-6 / 6 / 0.1
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)

    def test_noise_is_that_of_its_terms(self) -> None:
        terms = (White(1e-8), Noise1(2e-4, 0.5), RateRandomWalk(1e-6))
        quiet = replace(UPRIGHT, profile=replace(PROFILE, dwell=1000.0), rate=20.0)
        noisy = replace(quiet, gyros={"r": TableGyro(terms=terms[:2])})
        noise = simulated(noisy, 1).gyro.values[:, 0] - simulated(quiet).exact[:, 2]
        # N / step + sigma^2; of the coloured part some 4000 x 0.5 / 2 are independent: 4.5 % of it
        assert np.var(noise) == pytest.approx(1e-8 * 20 + 4e-8, rel=0.04)
        walk = replace(quiet, gyros={"r": TableGyro(terms=terms[2:])})
        steps = np.diff(simulated(walk, 1).gyro.values[:, 0] - simulated(quiet).exact[:, 2])
        assert np.std(steps) == pytest.approx(1e-6 / np.sqrt(20), rel=0.02)  # 80,000 of them: 0.25 %

    def test_each_run_has_noise_and_biases_of_its_own(self) -> None:
        gyros = {"p": TableGyro(terms=(White(1e-8),)), "r": TableGyro(terms=(White(1e-8),))}
        twice = (Mounting(axis="r"), Mounting(axis="r", name="again"))
        record = simulated(replace(UPRIGHT, gyros=gyros, mountings=twice, bias_error=1e-3), 2)
        first, second = np.split(record.gyro.values - record.exact, 2)
        a, b = (np.array(run["bias_errors"])[[0, 2]] for run in record.truth["runs"])
        assert not np.array_equal(a, b)
        for noise, bias in ((first, a), (second, b)):
            # white noise of 7e-4 rad/s over 1001 samples
            np.testing.assert_allclose(noise.mean(axis=0), bias, rtol=0, atol=4 * 7.1e-4 / np.sqrt(1001))
        assert abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]) < 4 / np.sqrt(1001)

    def test_same_seed_same_record_and_a_gyro_knows_nothing_of_the_others(self) -> None:
        noisy = TableGyro(terms=(White(1e-8), Noise1(1e-4, 0.1)))
        both = replace(UPRIGHT, gyros={"p": noisy, "r": noisy}, orientation_error=1e-3)
        first = simulated(both, 3).gyro.values
        np.testing.assert_array_equal(first, simulated(both, 3).gyro.values)
        assert not np.array_equal(first, simulated(both, 4).gyro.values)
        np.testing.assert_array_equal(
            first[:, 1:], simulated(replace(both, gyros={"r": noisy}), 3).gyro.values
        )

    def test_least_steps(self) -> None:
        stepped = simulated(replace(UPRIGHT, gyros={"r": BENT}, quantum=1e-3)).gyro.values / 1e-3
        np.testing.assert_allclose(stepped, np.rint(stepped), rtol=0, atol=1e-9)
        counts = simulated(replace(UPRIGHT, gyros={"r": BENT}, counts_per_unit=16.4)).gyro.values
        exact = simulated(replace(UPRIGHT, gyros={"r": BENT})).gyro.values
        np.testing.assert_array_equal(counts, np.rint(counts))
        assert np.max(np.abs(counts / 16.4 - np.degrees(exact))) <= 0.5 / 16.4 * (1 + 1e-12)


class TestRecording:
    SETTINGS = replace(
        UPRIGHT,
        gyros={"p": BENT, "q": TableGyro(bias=1e-4), "r": TableGyro(scale_factor=-0.99)},
        mountings=(Mounting(axis="p"), Mounting(axis="-q", name="upside down"), Mounting(axis="r")),
        table=TableSensor(
            rate=20.0, encoder=Encoder(counts=36_000, as_counts=True, unit="deg", wrapped=True)
        ),
        temperature=Thermometer(profile=((0.0, 293.15), (60.0, 300.0))),
        latitude=LATITUDE,
        orientation_error=1e-4,
        bias_error=1e-6,
        timing=TimingErrors(gaps=((5.0, 1.0),), clock_offset=0.01),
    )

    @pytest.mark.parametrize("apart", [False, True])
    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_what_is_written_is_read_again(self, tmp_path: Path, suffix: str, apart: bool) -> None:
        record = simulated(self.SETTINGS, 2)
        recording, plan, truth, *further = record.write(
            tmp_path / f"table{suffix}", angle_unit="deg", apart=apart
        )
        assert [path.name for path in further] == ([f"table_2{suffix}", f"table_3{suffix}"] if apart else [])
        read = load_plan(plan)
        assert read.procedure == "rate_table"
        settings = read.settings["ingest"]
        assert isinstance(settings, ingest.Settings)
        tables = ingest.run(recording, settings, read.stand)
        gyro, table, warm = (tables[name] for name in ("gyro", "turntable", "temperature"))
        found = np.column_stack([gyro.column(axis).to_numpy() for axis in "pqr"])
        np.testing.assert_allclose(found, record.gyro.values, rtol=4e-16)  # degrees and back
        assert np.array_equal(gyro.column("time").to_numpy(), record.gyro.header_stamp)
        runs = gyro.column("run").to_numpy()
        assert [int(np.count_nonzero(runs == k)) for k in range(3)] == [1001 - 50, 1001, 1001]
        angle, of_run = table.column("angle").to_numpy(), table.column("run").to_numpy()
        # from 0 in each run: 0.125 + 2 - 2 + 0.375 + 4 + 0.5 rad, in steps of an encoder of 0.01 deg
        ends = [float(angle[of_run == k][-1]) for k in range(3)]
        assert ends == pytest.approx([5.0] * 3, abs=0.01 * DEGREE)
        assert np.ptp(warm.column("temperature").to_numpy()) == pytest.approx(6.85, abs=1e-9)
        assert validate(recording).errors == 0
        said = json.loads(truth.read_text())
        assert (said["faults"]["lost"], said["time_offset"]) == (50, 0.01)
        assert said["samples"] == {"gyro": 2953, "turntable": 1203, "temperature": 63}
        assert [run["name"] for run in said["runs"]] == ["p", "upside down", "r"]
        assert said["runs"][0]["start"] == START

    def test_the_plan_says_what_calibrating_needs(self, tmp_path: Path) -> None:
        _, plan, *_ = simulated(self.SETTINGS).write(tmp_path / "table.mcap")
        read = load_plan(plan)
        calibrate: Any = read.settings["calibrate"]
        assert (calibrate.methods, calibrate.nonlinearity) == (("rates",), (2, 3))
        assert calibrate.bias_temperature
        assert calibrate.scale_factor_temperature
        assert calibrate.orientation_error_deg == pytest.approx(1e-4 / DEGREE)
        assert calibrate.bias_error_deg_h == pytest.approx(1e-6 / DEGREE * 3600)
        assert read.stand.table_tilt_deg == 0
        assert [run.axis for run in read.settings["ingest"].runs] == ["p", "-q", "r"]  # type: ignore[attr-defined]

    @pytest.mark.parametrize("method", ["turns", "positions"])
    def test_so_does_that_of_turns_by_hand(self, tmp_path: Path, method: Any) -> None:
        settings = replace(
            UPRIGHT, method=method, latitude=LATITUDE, angle_error=1e-3, orientation_error=1e-3
        )
        recording, plan, *_ = simulated(settings).write(tmp_path / "hand.csv")
        calibrate: Any = load_plan(plan).settings["calibrate"]
        assert calibrate.methods == (method,)
        assert (len(calibrate.turns), len(calibrate.rests), len(calibrate.positions)) == (
            (6, 7, 0) if method == "turns" else (0, 0, 6)
        )
        assert validate(recording).errors == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gyros": {}}, "gyros"),
        ({"gyros": {"x": TableGyro()}}, "'x'"),
        ({"mountings": ()}, "one at least"),
        ({"mountings": (Mounting(), Mounting())}, "a name of its own"),
        ({"rate": 0.0}, "rate: expected more than 0"),
        ({"tilt": -0.1}, "tilt"),
        ({"quantum": 1e-3, "counts_per_unit": 10.0}, "counts"),
        ({"timing": TimingErrors(sample_jitter=1e-4)}, "even instants"),
        ({"timing": TimingErrors(clock_offset=40.0)}, "half of the pause"),
    ],
)
def test_what_cannot_be_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(SimulationError, match=words) as refused:
        replace(UPRIGHT, **change)
    assert refused.value.exit_code is ExitCode.USAGE


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Profile(rates=(0.0,)), "one rate other than 0"),
        (lambda: TableGyro(scale_factor=0.0), "other than 0"),
        (lambda: TableGyro(nonlinearity={1: 1e-4}), "orders from 2 to 5"),
        (lambda: TableGyro(nonlinearity={7: 1e-4}), "of order 7"),
        (lambda: Hand(turns=(0.0, 1.0)), "angles other than 0"),
        (lambda: Mounting(axis="x"), "one of p, q, r"),  # type: ignore[arg-type]
        (
            lambda: TableSensor(quantity="table_rate", encoder=Encoder(wrapped=True)),
            "record the table's angle",
        ),
        (lambda: Thermometer(profile=((5.0, 300.0), (1.0, 301.0))), "increasing times"),
        (lambda: Thermometer(profile=()), "none"),
    ],
)
def test_so_are_parts_of_it(make: Any, words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        make()
