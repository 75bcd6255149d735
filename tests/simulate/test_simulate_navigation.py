"""Simulated navigations: errors as stated, the oracle of MATH 4.3, and files that hold what was simulated."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import ExitCode
from pipeline.formats import mcap
from pipeline.formats.base import Request
from pipeline.models import strapdown
from pipeline.models.ellipsoid import metres_between
from pipeline.models.navigation_problem import AidName, Navigation
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)
from pipeline.runner import validate
from pipeline.simulate.imperfections import SimulationError, TimingErrors
from pipeline.simulate.navigation import NavigationRecord, simulate_navigation
from pipeline.simulate.navigation_profile import fly
from pipeline.simulate.navigation_scenarios import CRUISE, SENSOR_SETS, STRAIGHT, scenario
from pipeline.simulate.navigation_settings import (
    AIDS,
    Aid,
    Air,
    GaussMarkov,
    ImuErrors,
    ImuOutput,
    Manoeuvre,
    NavigationSettings,
    StartErrors,
    Sway,
)
from pipeline.simulate.plan import Processing
from pipeline.simulate.recording import START, SUFFIXES
from pipeline.simulate.samples import SAMPLES

Float = NDArray[np.float64]
DEGREE = np.pi / 180

SHORT = replace(
    STRAIGHT, duration=40.0, manoeuvres=(Manoeuvre(kind="turn", start=10.0, length=20.0, amount=1.0),)
)
EXACT = NavigationSettings(flight=SHORT, aids={name: Aid(rate=5.0) for name in AIDS})
TURNING = replace(
    STRAIGHT,
    manoeuvres=(
        Manoeuvre(kind="turn", start=30.0, length=30.0, amount=1.5),
        Manoeuvre(kind="climb", start=100.0, length=60.0, amount=200.0),
        Manoeuvre(kind="accelerate", start=200.0, length=20.0, amount=15.0),
        Manoeuvre(kind="turn", start=300.0, length=1200.0, amount=-60.0),
    ),
)


def errors_of(record: NavigationRecord, name: AidName) -> Float:
    """An aid's values less the truth: N, E, D [m], m/s, T, or rad."""
    recorded = record.aids[name]
    t = (recorded.header_stamp - record.settings.start) / 1e9
    motion = record.flight.at(t)
    if name == "position":
        return metres_between(motion.position, recorded.values)
    if name == "attitude":
        turned = quaternion_multiply(recorded.values, quaternion_conjugate(motion.attitude))
        return rotation_vector_from_quaternion(turned)
    exact = {
        "velocity": motion.velocity,
        "altitude": motion.position[:, 2:],
        "airspeed": np.linalg.norm(motion.velocity, axis=1)[:, np.newaxis],
        "magnetic_field": np.einsum(
            "nji,j->ni", matrix_from_quaternion(motion.attitude), record.settings.earth_field.ned
        ),
    }[name]
    return np.asarray(recorded.values - exact)


def horizontal(truth: Navigation, found: Navigation) -> Float:
    return np.asarray(np.linalg.norm(metres_between(truth.position, found.position)[:, :2], axis=1))


class TestOracle:
    @pytest.mark.parametrize("flight", [STRAIGHT, TURNING], ids=["straight", "turning"])
    @pytest.mark.parametrize("output", ["rates", "increments"])
    def test_error_free_sensors_lead_to_the_truth(self, flight: Any, output: ImuOutput) -> None:
        """MATH 4.3: below 1e-3 m over 1800 s, catapult included."""
        record = simulate_navigation(NavigationSettings(flight=flight, output=output))
        found = strapdown.navigate(record.problem(start_error=False))
        off = np.linalg.norm(metres_between(record.truth.position, found.position), axis=1)
        assert len(off) == 180_001
        assert off.max() < 1e-3

    def test_set_2_without_correction(self) -> None:
        """MATH 4.3: 10.3 m at 10 s, 89 m at 30 s, 366 m at 60 s, to 1.5 %."""
        settings = scenario("ideal", 2, flight=replace(CRUISE, duration=60.0))
        record = simulate_navigation(settings)
        off = horizontal(record.truth, strapdown.navigate(record.problem(start_error=False)))
        assert off[[1000, 3000, 6000]] == pytest.approx([10.3, 89.0, 366.0], rel=0.015)

    def test_set_1_is_a_fifth_of_set_2(self) -> None:
        for name in ("gyro_bias", "accelerometer_bias"):
            first, second = (np.array(getattr(SENSOR_SETS[number], name)) for number in (1, 2))
            np.testing.assert_allclose(5 * first, second, rtol=1e-15)
        assert SENSOR_SETS[2].gyro_bias == pytest.approx(
            np.array([0.035, -0.015, -0.025]) * DEGREE, rel=1e-15
        )


class TestErrors:
    def test_without_errors_every_aid_measures_the_truth(self) -> None:
        record = simulate_navigation(EXACT)
        for name in AIDS:
            assert len(record.aids[name].values) == 201
            # rounding, of 1e6 m of the Earth's radius 1e-9
            np.testing.assert_allclose(errors_of(record, name), 0.0, atol=2e-9)

    def test_white_noise_bias_scale_and_wander_of_the_aids(self) -> None:
        flight = replace(CRUISE, duration=4000.0)
        aid = Aid(rate=1.0, noise=0.4, bias=1.5, wander=GaussMarkov(sigma=0.8, time=20.0))
        record = simulate_navigation(
            NavigationSettings(flight=flight, rate=2.0, aids={"position": aid, "velocity": aid}), seed=1
        )
        for name in ("position", "velocity"):
            error = errors_of(record, name)  # type: ignore[arg-type]
            # of 4000 s some 4000/(2 * 20) = 100 are independent in the mean: 0.8/10, three of that
            np.testing.assert_allclose(error.mean(axis=0), 1.5, atol=0.25)
            centred = error - error.mean(axis=0)
            # scatter of a variance sqrt(2 * 20/4000) = 0.1 of the wander, 0.64; three axes are pooled
            assert np.mean(centred**2) == pytest.approx(0.64 + 0.16, abs=0.15)
            for lag in (1, 20):
                product = np.mean(centred[lag:] * centred[:-lag])
                assert product == pytest.approx(0.64 * np.exp(-lag / 20), abs=0.15)

    def test_drawn_biases_have_their_sigma_over_the_seeds(self) -> None:
        settings = replace(
            EXACT, flight=replace(CRUISE, duration=1.0), aids={"magnetic_field": Aid(drawn_bias=2e-7)}
        )
        drawn = np.array(
            [errors_of(simulate_navigation(settings, seed), "magnetic_field")[0] for seed in range(100)]
        )
        # 300 values: their standard deviation errs by 1/sqrt(600) = 4 %; three of that
        assert np.std(drawn) == pytest.approx(2e-7, rel=0.12)

    def test_the_air_speed_takes_wind_gusts_and_its_own_errors(self) -> None:
        flight = replace(CRUISE, duration=4000.0, wind=(4.0, -3.0))
        settings = NavigationSettings(
            flight=flight, rate=5.0, air=Air.turbulent(1.06, wander=0.3), aids={"airspeed": Aid(rate=5.0)}
        )
        record = simulate_navigation(settings, seed=2)
        speed = record.aids["airspeed"].values[:, 0]
        # gusts along the flight, 1.06 m/s with 300 independent: 0.06, and the wander's 7 independent: 0.11;
        # three of both together
        assert speed.mean() == pytest.approx(40.0, abs=0.4)
        assert speed.var() == pytest.approx(1.06**2 + 0.3**2, rel=0.25)
        assert record.truth.wind is not None
        np.testing.assert_allclose(record.truth.wind.mean(axis=0), [4.0, -3.0], atol=0.35)
        spoilt = replace(settings, aids={"airspeed": Aid(rate=5.0, scale=0.01, bias=0.3)})
        np.testing.assert_allclose(
            simulate_navigation(spoilt, seed=2).aids["airspeed"].values[:, 0], 1.01 * speed + 0.3, rtol=1e-14
        )

    @pytest.mark.parametrize("output", ["rates", "increments"])
    def test_inertial_biases_noise_and_wander(self, output: ImuOutput) -> None:
        errors = ImuErrors(
            gyro_bias=(1e-3, 0.0, -2e-3),
            accelerometer_bias=(0.1, -0.2, 0.0),
            gyro_noise=1e-3,
            accelerometer_noise=0.02,
            gyro_wander=GaussMarkov(sigma=5e-4, time=5.0),
        )
        clean = NavigationSettings(flight=replace(CRUISE, duration=400.0), rate=50.0, output=output)
        exact = simulate_navigation(clean).imu.values
        record = simulate_navigation(replace(clean, errors=errors), seed=4)
        scale = 1.0 if output == "rates" else 0.02
        noise = (record.imu.values - exact) / scale
        noise[:, :3] -= record.truth.gyro_bias
        noise[:, 3:] -= record.truth.accelerometer_bias
        # 60,003 values: 0.3 %, five of that
        assert np.std(noise[:, :3]) == pytest.approx(1e-3, rel=0.015)
        assert np.std(noise[:, 3:]) == pytest.approx(0.02, rel=0.015)
        wander = record.truth.gyro_bias - errors.gyro_bias
        assert np.std(wander) == pytest.approx(5e-4, rel=0.3)  # 3 * 400/(2 * 5) = 120 independent: 6.5 %
        np.testing.assert_array_equal(record.truth.accelerometer_bias, np.tile([0.1, -0.2, 0.0], (20_001, 1)))

    def test_the_start_is_drawn_with_its_sigma_or_true(self) -> None:
        settings = replace(
            EXACT,
            flight=replace(CRUISE, duration=1.0),
            aids={},
            start_errors=StartErrors(velocity=0.3, position=3.0),
        )
        angles, velocity, position = [], [], []
        for seed in range(200):
            record = simulate_navigation(settings, seed)
            start, true = record.start(error=True), record.start(error=False)
            off = strapdown.yaw_pitch_roll(start.attitude) - strapdown.yaw_pitch_roll(true.attitude)
            angles.append(off / DEGREE)
            velocity.append(start.velocity - true.velocity)
            places = [[s.latitude, s.longitude, s.height] for s in (true, start)]
            position.append(metres_between(*places))
        # 200 values: 5 %, three of that; 600: 3 %
        np.testing.assert_allclose(np.std(angles, axis=0), [1.0, 0.5, 0.5], rtol=0.16)
        assert np.std(velocity) == pytest.approx(0.3, rel=0.09)
        assert np.std(position) == pytest.approx(3.0, rel=0.09)
        np.testing.assert_array_equal(
            record.truth.attitude[0], record.problem(start_error=False).start.attitude
        )

    def test_a_sensor_has_the_same_errors_whatever_the_others_have(self) -> None:
        settings = scenario("diff", flight=replace(SHORT, duration=10.0))
        full = simulate_navigation(settings, 3)
        np.testing.assert_array_equal(full.imu.values, simulate_navigation(settings, 3).imu.values)
        for name, aid in settings.aids.items():
            alone = simulate_navigation(replace(settings, aids={name: aid}, errors=ImuErrors()), 3)
            np.testing.assert_array_equal(alone.aids[name].values, full.aids[name].values)
        assert not np.array_equal(full.imu.values, simulate_navigation(settings, 4).imu.values)
        sensors = [full.aids[name].values[:, 0] for name in ("velocity", "altitude")]
        assert not np.array_equal(np.diff(sensors[0]), np.diff(sensors[1][: len(sensors[0])]))

    def test_levels_differ_in_gnss_alone(self) -> None:
        diff, gps = scenario("diff"), scenario("gps")
        same = replace(
            gps, aids={**gps.aids, "position": diff.aids["position"], "velocity": diff.aids["velocity"]}
        )
        assert same == diff
        assert all(aid == Aid(rate=aid.rate, outages=aid.outages) for aid in scenario("ideal").aids.values())


class TestTransport:
    def test_outages_bursts_gaps_and_clocks(self) -> None:
        aids: dict[AidName, Aid] = {
            "position": Aid(rate=2.0, outages=((10.0, 5.0),), timing=TimingErrors(clock_offset=0.1)),
            "velocity": Aid(rate=2.0, clock_rate=1e-3, timing=TimingErrors(nan_bursts=((4.0, 2.0),))),
            "altitude": Aid(rate=4.0, first=0.13, timing=TimingErrors(gaps=((7.0, 1.0),), log_delay=0.2)),
        }
        timing = TimingErrors(gaps=((20.0, 0.05),), nan_bursts=((30.0, 0.1),), repeated_samples=(5.0,))
        record = simulate_navigation(replace(EXACT, aids=aids, timing=timing), 1)
        problem = record.problem()
        position, velocity, altitude = (problem.aids[name] for name in ("position", "velocity", "altitude"))
        wanted = np.arange(81) / 2
        wanted = wanted[(wanted < 10) | (wanted >= 15)]
        np.testing.assert_allclose(position.time, wanted + 0.1, rtol=0, atol=1e-9)  # whole nanoseconds
        np.testing.assert_allclose(velocity.time, 1.001 * np.arange(81) / 2, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(np.flatnonzero(~velocity.usable), [8, 9, 10, 11])
        assert np.isnan(velocity.value[~velocity.usable]).all()
        np.testing.assert_allclose(altitude.time[:3], [0.13, 0.38, 0.63], rtol=0, atol=1e-9)
        assert len(altitude.time) == 160 - 4
        assert record.faults["altitude"]["lost"] == 4
        assert np.all(record.aids["altitude"].log_time - record.aids["altitude"].header_stamp == 200_000_000)
        # what was lost or NaN is bridged and marked: five samples and ten, and the steps on either side
        steps = np.floor(100 * problem.imu.time[1:][problem.imu.coasted] + 0.5).astype(int)
        np.testing.assert_array_equal(steps, [*range(2000, 2006), *range(3000, 3011)])
        assert len(problem.imu) == 4000
        assert record.faults["imu"]["nan"] == 10

    def test_first_fix_of_an_outage_is_lost_and_the_one_at_its_end_is_not(self) -> None:
        record = simulate_navigation(
            scenario("ideal", flight=replace(CRUISE, duration=100.0), outages=((40, 20),))
        )
        t = record.problem().aids["position"].time
        assert 40.0 not in t
        assert 60.0 in t
        assert len(t) == 101 - 20

    def test_a_start_after_the_first_sample_is_that_of_the_first_usable(self) -> None:
        timing = TimingErrors(nan_bursts=((0.0, 2.0),))
        record = simulate_navigation(replace(EXACT, timing=timing))
        problem = record.problem(start_error=False)
        assert problem.imu.time[0] == pytest.approx(2.0, abs=1e-12)
        np.testing.assert_array_equal(problem.start.velocity, record.flight.velocity(np.array([2.0]))[0])

    def test_backward_and_repeated_stamps_are_left_out_of_the_problem(self) -> None:
        timing = TimingErrors(backward_stamps=(3.0,), repeated_samples=(4.0,))
        record = simulate_navigation(
            replace(EXACT, timing=timing, aids={"position": Aid(rate=5.0, timing=timing)})
        )
        assert len(record.imu.values) == 4002
        problem = record.problem()
        assert np.all(np.diff(problem.aids["position"].time) > 0)
        assert len(problem.aids["position"].time) == 200


@pytest.fixture(scope="module")
def records() -> dict[ImuOutput, NavigationRecord]:
    settings = scenario("diff", flight=replace(SHORT, duration=6.0), outages=((2.0, 2.0),))
    settings = replace(settings, rate=50.0, timing=TimingErrors(nan_bursts=((1.0, 0.1),), log_delay=0.01))
    return {out: simulate_navigation(replace(settings, output=out), 2) for out in ("rates", "increments")}


class TestFiles:
    @pytest.mark.parametrize("output", ["rates", "increments"])
    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_every_format_holds_every_stream(
        self, tmp_path: Path, records: dict[ImuOutput, NavigationRecord], output: ImuOutput, suffix: str
    ) -> None:
        record = records[output]
        path, plan, truth = record.write(tmp_path / f"run{suffix}", angle_unit="deg")
        streams = record.streams(text=suffix == ".csv", angle_unit="deg")
        names = [
            "gyro",
            "accelerometer",
            "gnss_position",
            "gnss_velocity",
            "airspeed",
            "barometer",
            "magnetometer",
        ]
        assert [one.name for one in streams] == [
            *names, "external_attitude", "truth_position", "truth_velocity", "truth_attitude"
        ]  # fmt: skip
        requests = [Request(one.topic, tuple(one.fields.values())) for one in streams]
        if suffix == ".csv":
            requests = [Request("", tuple(path for one in streams for path in one.fields.values()))]
        else:
            merged: dict[str, tuple[str, ...]] = {}
            for request in requests:
                merged[request.topic] = (*merged.get(request.topic, ()), *request.fields)
            requests = [Request(topic, fields) for topic, fields in merged.items()]
        tables = formats.read(path, requests).tables
        for one in streams:
            table = tables[one.topic]
            for field in one.fields.values():
                column = table.column(field)
                values = column.to_numpy()[np.asarray(column.is_valid())]
                np.testing.assert_array_equal(values, one.series.columns[field])
        text = plan.read_text()
        assert 'procedure = "navigation"' in text
        assert text.count("[streams.") == len(streams)
        said = json.loads(truth.read_text())
        assert said["seed"] == 2
        assert said["samples"]["position"] == 5  # 0, 1, 4, 5 and 6 s
        assert said["faults"]["imu"]["nan"] == 5

    def test_units_in_messages_and_in_text(self, records: dict[ImuOutput, NavigationRecord]) -> None:
        messages = {one.name: one for one in records["rates"].streams(text=False)}
        columns = {one.name: one for one in records["rates"].streams(text=True, angle_unit="deg")}
        assert messages["gnss_position"].units == {"latitude": "deg", "longitude": "deg", "height": "m"}
        assert columns["truth_attitude"].units == {"yaw": "deg", "pitch": "deg", "roll": "deg"}
        assert messages["gyro"].series is messages["accelerometer"].series
        in_rad = messages["gyro"].series.columns["angular_velocity.x"]
        np.testing.assert_allclose(
            columns["gyro"].series.columns["gyro_p (deg/s)"], np.rad2deg(in_rad), rtol=1e-15, atol=1e-300
        )
        position = records["rates"].truth.position[0]
        field = messages["truth_position"].series.columns
        assert field["latitude"][0] == pytest.approx(np.rad2deg(position[0]), rel=1e-15)
        yaw = columns["truth_attitude"].series.columns["truth_attitude_yaw (deg)"][0]
        assert yaw == pytest.approx(55.0, rel=1e-12)

    def test_the_truth_and_the_plan_state_the_start_of_the_problem(
        self, tmp_path: Path, records: dict[ImuOutput, NavigationRecord]
    ) -> None:
        record = records["rates"]
        said = json.loads(record.write(tmp_path / "run.mcap")[2].read_text())
        start = record.problem().start
        stated = said["start_with_errors"]
        assert stated["latitude"] == start.latitude
        np.testing.assert_array_equal(stated["yaw_pitch_roll"], strapdown.yaw_pitch_roll(start.attitude))
        assert said["biases"]["altitude"] == [3.0]
        assert said["settings"]["start"] == START

    @pytest.mark.parametrize("encoding", ["cdr", "json", "protobuf"])
    def test_every_serialisation_holds_every_message(
        self, tmp_path: Path, records: dict[ImuOutput, NavigationRecord], encoding: str
    ) -> None:
        path = tmp_path / "run.mcap"
        series = {one.topic: one.series for one in records["rates"].streams(text=False)}
        mcap.write(path, list(series.values()), encoding)
        requests = [Request(topic, tuple(one.columns)) for topic, one in series.items()]
        tables = formats.read(path, requests).tables
        for topic, one in series.items():
            for field, values in one.columns.items():
                found = tables[topic].column(field).to_numpy()
                np.testing.assert_array_equal(found.astype(np.float64), values)  # JSON's null is read as NaN

    def test_the_plan_is_valid_and_states_what_is_known(
        self, tmp_path: Path, records: dict[ImuOutput, NavigationRecord]
    ) -> None:
        record = records["rates"]
        stages = {"navigate": {"methods": ["strapdown", "filter"]}}
        path, plan, _ = record.write(tmp_path / "run.mcap", processing=Processing(stages=stages))
        validate(path)
        stated = tomllib.loads(plan.read_text())
        assert stated["navigate"]["methods"] == ["strapdown", "filter"]
        assert stated["navigate"]["start_attitude"] == "plan"
        start = record.problem().start
        place, angles = stated["navigate"]["start"], strapdown.yaw_pitch_roll(start.attitude)
        # 1e-12 deg of latitude are 1e-7 m; 1e-9 deg of attitude
        assert np.deg2rad(place["latitude_deg"]) == pytest.approx(start.latitude, abs=1e-13)
        found = np.deg2rad([place["yaw_deg"], place["pitch_deg"], place["roll_deg"]])
        np.testing.assert_allclose(found, angles, rtol=0, atol=1e-11)
        assert stated["navigate"]["earth_field"] == {
            "strength_ut": 52.0, "dip_deg": 71.0, "declination_deg": 11.0
        }  # fmt: skip
        assert stated["navigate"]["loops"]["lift"]["cruise_speed_m_s"] == 40.0
        assert stated["navigate"]["filter"] == {"measurement": {"sideslip_m_s": 8.6}}
        assert stated["score_navigation"]["accelerometer_bias_m_s2"] == [0.15, -0.15, 0.0]

    def test_a_plan_does_not_state_what_wanders_or_is_not_there(self, tmp_path: Path) -> None:
        wander = ImuErrors(gyro_wander=GaussMarkov(sigma=1e-5, time=100.0))
        flight = replace(CRUISE, duration=2.0, speed=0.0, lift=None)
        settings = NavigationSettings(flight=flight, errors=wander, aids={"attitude": Aid()})
        plan = tomllib.loads(simulate_navigation(settings).write(tmp_path / "run.mcap")[1].read_text())
        assert plan["navigate"].keys() == {"start_position", "start_velocity", "start_attitude", "start"}
        assert plan["score_navigation"].keys() == {"accelerometer_bias_m_s2"}

    def test_the_sample_has_an_outage_and_is_as_it_is_kept(self, tmp_path: Path) -> None:
        """Plans to the byte; samples to 1e-9: splines may differ in their last digits between machines."""
        sample = SAMPLES["flight.mcap"]
        assert isinstance(sample.settings, NavigationSettings)
        assert sample.settings.aids["position"].outages == ((120.0, 30.0),)
        sample.write(tmp_path / "flight.mcap")
        kept = Path(__file__).resolve().parents[2] / "sample_data"
        assert (tmp_path / "flight.toml").read_bytes() == (kept / "flight.toml").read_bytes()
        request = [Request("/imu", ("linear_acceleration.x",)), Request("/gnss_position", ("latitude",))]
        here, there = (formats.read(folder / "flight.mcap", request).tables for folder in (tmp_path, kept))
        for one in request:
            made, old = here[one.topic], there[one.topic]
            assert made["header_stamp"].equals(old["header_stamp"])
            values = [table[one.fields[0]].to_numpy() for table in (made, old)]
            np.testing.assert_allclose(*values, rtol=0, atol=1e-9)
        assert (kept / "flight.mcap").stat().st_size < 1_300_000


class TestStand:
    def test_a_moving_laboratory_stand_with_any_subset_of_aids(self) -> None:
        flight = replace(
            CRUISE,
            speed=0.0,
            lift=None,
            duration=60.0,
            sways=(Sway(angle="roll", amplitude=0.2, frequency=0.5),),
        )
        record = simulate_navigation(NavigationSettings(flight=flight, aids={"attitude": Aid(rate=10.0)}))
        problem = record.problem(start_error=False)
        assert list(problem.aids) == ["attitude"]
        assert horizontal(record.truth, strapdown.navigate(problem)).max() < 1e-3
        assert fly(flight) is record.flight


class TestRefused:
    @pytest.mark.parametrize(
        ("change", "part"),
        [
            ({"aids": {"radar": Aid()}}, "radar"),
            ({"rate": 0.0}, "rate"),
            ({"rate": 0.01}, "three samples"),
            ({"clock_rate": 0.5}, "clock_rate"),
            ({"timing": TimingErrors(sample_jitter=1e-3)}, "sample_jitter"),
        ],
    )
    def test_settings_out_of_their_range(self, change: dict[str, Any], part: str) -> None:
        with pytest.raises(SimulationError, match=part) as caught:
            replace(EXACT, **change)
        assert caught.value.exit_code is ExitCode.USAGE

    def test_an_aid_that_begins_after_the_end(self) -> None:
        with pytest.raises(SimulationError, match="100 s of position"):
            simulate_navigation(replace(EXACT, aids={"position": Aid(first=100.0)}))

    @pytest.mark.parametrize(("level", "sensors"), [("best", 2), ("ideal", 3)])
    def test_scenarios_there_are_not(self, level: Any, sensors: int) -> None:
        with pytest.raises(SimulationError, match="one of"):
            scenario(level, sensors)
