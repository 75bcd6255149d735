"""Navigate: streams to problems, starts that are stated and not guessed, methods side by side."""

from __future__ import annotations

from typing import Any

import navigation_streams as streams
import numpy as np
import pyarrow as pa
import pytest
from navigation_streams import EARTH, SECOND, changed

from pipeline.contracts import contract
from pipeline.errors import ExitCode, GyrostandError
from pipeline.models.correction_gains import CorrectionGainsError
from pipeline.models.ellipsoid import displaced, metres_between
from pipeline.models.navigation_errors import NavigationError
from pipeline.models.navigation_problem import Fixes, Imu, Navigation
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.numerics.rotation import quaternion_from_rotation_vector, quaternion_multiply
from pipeline.simulate.navigation import NavigationRecord
from pipeline.simulate.navigation_settings import FlightSettings, ImuErrors, StartErrors
from pipeline.simulate.recording import START
from pipeline.stages import navigate
from pipeline.stages._navigation_consistency import consistency_figures
from pipeline.stages._navigation_methods import Done
from pipeline.stages._navigation_outages import Outage, outages, phases
from pipeline.stages._navigation_tables import chosen
from pipeline.stages._navigation_truth import Truth, truth_of
from pipeline.stages.base import Stand
from pipeline.storage.contract_check import violations

Tables = dict[str, pa.Table]
Row = dict[str, Any]
TRUE_START = {"start_position": "truth", "start_velocity": "truth", "start_attitude": "truth"}
NO_ERRORS = ImuErrors()


def navigated(tables: Tables, **plan: Any) -> Tables:
    """All tables of the stage, each by its contract."""
    settings = navigate.Settings.model_validate({"earth_field": EARTH} | TRUE_START | plan)
    kept = {name: table for name, table in tables.items() if name in navigate.MAY_CONSUME}
    out = navigate.run(kept, settings, Stand())
    assert set(out) == set(navigate.PRODUCES)
    for name, table in out.items():
        assert table.schema.equals(contract(name).schema)
        assert violations(name, table) == []
    return out


def by_method(out: Tables, method: str) -> dict[str, np.ndarray]:
    table = out["navigation"]
    kept = np.array(table["method"].to_pylist()) == method
    return {name: np.array(table[name].to_pylist())[kept] for name in table.column_names}


def away(found: dict[str, np.ndarray], record: NavigationRecord) -> np.ndarray:
    """Distance from the true position [m], by the true motion at the stamps."""
    seconds = (found["time"] - START) * 1e-9
    here = np.stack([found[n] for n in ("latitude", "longitude", "height")], axis=1)
    return np.linalg.norm(metres_between(record.flight.position(seconds), here), axis=1)


def findings(out: Tables, kind: str) -> list[Row]:
    return [row for row in out["findings"].to_pylist() if row["kind"] == kind]


def figures(out: Tables) -> dict[tuple[str, str], Any]:
    return {(m["channel"], m["name"]): m["value"] for m in out["metrics"].to_pylist()}


@pytest.fixture(scope="module")
def flight() -> NavigationRecord:
    return streams.record("diff", 60.0, outages=((30.0, 10.0),))


class TestMethods:
    def test_side_by_side(self, flight: NavigationRecord) -> None:
        out = navigated(
            streams.tables(flight), aids=("position", "velocity", "airspeed", "altitude", "magnetic_field")
        )
        assert out["navigation"]["method"].unique().to_pylist() == [
            "strapdown",
            "loops",
            "filter",
            "smoother",
        ]
        far = {
            method: away(by_method(out, method), flight)
            for method in ("strapdown", "loops", "filter", "smoother")
        }
        assert all(len(one) == 601 for one in far.values())  # 60 s at 10 Hz
        # a bias of 0.15 m/s^2 along two axes for a minute is 0.15*sqrt(2)*60^2/2 = 380 m
        assert 200 < far["strapdown"][-1] < 600
        # GNSS of 0.5 m wandering and 0.3 m white; the start is true
        for method in ("loops", "filter", "smoother"):
            assert far[method][:300].max() < 5.0
        assert far["filter"][400:].max() < 20.0
        # the smoother knows both ends of the outage
        assert far["smoother"].max() < 4.0

    def test_only_those_of_the_plan(self, flight: NavigationRecord) -> None:
        out = navigated(streams.tables(flight), methods=("smoother", "strapdown"))
        assert out["navigation"]["method"].unique().to_pylist() == ["strapdown", "smoother"]
        assert out["poles"].num_rows == out["loops"].num_rows == 0

    def test_phases_are_those_of_the_satellites(self, flight: NavigationRecord) -> None:
        found = by_method(navigated(streams.tables(flight), methods=("strapdown",)), "strapdown")
        seconds = (found["time"] - START) * 1e-9
        # fixes each second: from 30 s, when one is due and missing, to that of 40 s
        lost = (seconds >= 30.0 - 1e-6) & (seconds < 40.0 - 1e-6)
        assert set(found["phase"][lost]) == {"outage"}
        assert set(found["phase"][seconds < 30.0 - 1e-6]) == {"aided"}
        assert set(found["phase"][seconds >= 40.0 - 1e-6]) == {"reacquired"}

    def test_columns_that_a_method_has_not_are_null(self, flight: NavigationRecord) -> None:
        table = navigated(streams.tables(flight))["navigation"]
        counts = {}
        for method in ("strapdown", "loops", "filter"):
            rows = table.filter(pa.compute.equal(table["method"], method))
            counts[method] = {n: rows[n].null_count for n in ("sigma_north", "wind_north", "c_x_north")}
        assert counts["strapdown"] == {"sigma_north": 601, "wind_north": 601, "c_x_north": 601}
        assert counts["loops"]["sigma_north"] == 601
        assert counts["loops"]["c_x_north"] == 0
        assert counts["filter"]["sigma_north"] == counts["filter"]["wind_north"] == 0
        assert counts["filter"]["c_x_north"] == 601

    def test_innovations_poles_and_figures(self, flight: NavigationRecord) -> None:
        out = navigated(streams.tables(flight))
        tried = out["innovations"].to_pylist()
        assert {row["method"] for row in tried} == {"loops", "filter"}
        position = [r for r in tried if r["method"] == "filter" and r["aid"] == "position"]
        assert {r["component"] for r in position} == {"north", "east", "down"}
        assert {row["kind"] for row in out["poles"].to_pylist()} == {"continuous", "discrete"}
        continuous = [r["real"] for r in out["poles"].to_pylist() if r["kind"] == "continuous"]
        assert max(continuous) < 0  # tuned gains are stable
        names = {row["name"] for row in out["loops"].to_pylist()}
        assert {"k_n", "k_n_limit", "spectral_radius", "damping", "settling_time"} <= names
        found = figures(out)
        assert found["position", "usable_count"] == 51  # 61 fixes, of which 30 to 39 s are missing
        assert found["position", "outage_count"] == 1
        assert found["position", "outage_time"] == pytest.approx(10.0, abs=1e-9)
        assert found["gyro", "step_count"] == 3000


class TestProblem:
    """With sensors and aids that are perfect a start at the truth stays there."""

    def perfect(self, **changes: Any) -> NavigationRecord:
        errors = {"errors": NO_ERRORS, "start_errors": StartErrors(attitude=(0.0, 0.0, 0.0))}
        return streams.record("ideal", 30.0, **errors | changes)

    def strapdown(self, tables: Tables, record: NavigationRecord, **plan: Any) -> float:
        return float(
            away(by_method(navigated(tables, methods=("strapdown",), **plan), "strapdown"), record).max()
        )

    def test_samples(self) -> None:
        record = self.perfect()
        # the integration's own error at 50 Hz in straight flight, and truth's attitude through angles
        assert self.strapdown(streams.tables(record), record) < 1e-4

    def test_increments(self) -> None:
        record = self.perfect(output="increments")
        assert self.strapdown(streams.tables(record), record) < 1e-4

    def test_an_accelerometer_of_its_own_rate(self) -> None:
        """At 200 Hz, interpolated linearly: curvature over 5 ms is nothing in straight flight."""
        record = self.perfect()
        fast = self.perfect(rate=200.0)
        tables = streams.tables(record) | {
            "accelerometer": streams.table(
                "accelerometer", fast.imu.header_stamp + 1_000_000, fast.imu.values[:, 3:]
            )
        }
        out = navigated(tables, methods=("strapdown",))
        assert [row["stream"] for row in findings(out, "resampled")] == ["accelerometer"]
        # the stamps are 1 ms late, in a force that does not change
        assert away(by_method(out, "strapdown"), record).max() < 1e-2

    def test_a_burst_of_nan_is_bridged_and_marked(self) -> None:
        record = self.perfect()
        tables = streams.tables(record)
        p = tables["gyro"]["p"].to_numpy().copy()
        p[500:510] = np.nan
        tables["gyro"] = changed(tables["gyro"], p=p)
        out = navigated(tables, methods=("strapdown",))
        found = by_method(out, "strapdown")
        assert findings(out, "coasted")[0]["count"] == figures(out)["gyro", "coasted_count"] == 11
        seconds = (found["time"] - START) * 1e-9
        assert found["coasted"][(seconds > 10.0) & (seconds < 10.19)].all()
        assert not found["coasted"][(seconds < 9.9) | (seconds > 10.3)].any()
        assert away(found, record).max() < 1e-3  # straight flight is what is bridged with

    def test_a_longer_gap_is_refused_in_one_line(self) -> None:
        tables = streams.tables(self.perfect())
        p = tables["gyro"]["p"].to_numpy().copy()
        p[500:600] = np.nan
        tables["gyro"] = changed(tables["gyro"], p=p)
        with pytest.raises(NavigationError, match="usable samples at most 1 s apart"):
            navigated(tables)
        out = navigated(tables, methods=("strapdown",), max_coast_s=3.0)
        assert findings(out, "coasted")[0]["count"] == 101

    def test_stamps_that_do_not_advance_are_left_out(self) -> None:
        record = self.perfect()
        tables = streams.tables(record)
        doubled = {
            n: pa.concat_tables([t.slice(0, 700), t.slice(699)])
            for n, t in tables.items()
            if t.num_rows > 700
        }
        assert self.strapdown(tables | doubled, record) < 1e-4
        position = tables["gnss_position"]
        tables["gnss_position"] = pa.concat_tables([position.slice(0, 10), position.slice(9)])
        assert findings(navigated(tables, methods=("strapdown",)), "stamp")[0]["count"] == 1

    def test_measurements_outside_the_inertial_record_are_counted(self) -> None:
        """Satellites from 5 s before the inertial sensors to 10 s after them: they serve within."""
        record = self.perfect()
        tables = streams.tables(record)
        for name in ("gyro", "accelerometer"):
            seconds = (tables[name]["time"].to_numpy() - START) / 1e9
            tables[name] = tables[name].filter(pa.array((seconds >= 5.0) & (seconds <= 20.0)))
        out = navigated(tables, methods=("filter",))
        row = next(r for r in findings(out, "outside the record") if r["stream"] == "gnss_position")
        assert (row["severity"], row["count"]) == ("info", 15)  # 0 to 4 s, and 21 to 30 s
        assert figures(out)["position", "usable_count"] == 16
        assert away(by_method(out, "filter"), record).max() < 0.05  # ideal aids and sensors

    def test_sensors_that_share_no_time(self) -> None:
        tables = streams.tables(self.perfect())
        late = tables["accelerometer"]["time"].to_numpy() + 100 * SECOND
        with pytest.raises(GyrostandError) as caught:
            navigated(tables | {"accelerometer": changed(tables["accelerometer"], time=late)})
        line = str(caught.value)
        assert "streams 'gyro' and 'accelerometer'" in line
        assert "1700000000.000 to 1700000030.000 s" in line or line.count(" to ") >= 2
        assert "\n" not in line

    def test_an_aid_that_shares_no_time(self) -> None:
        tables = streams.tables(self.perfect())
        late = tables["gnss_position"]["time"].to_numpy() + 100 * SECOND
        with pytest.raises(
            GyrostandError, match=r"'gyro' and 'gnss_position'.*overlap.*choose the same clock"
        ):
            navigated(tables | {"gnss_position": changed(tables["gnss_position"], time=late)})

    def test_rates_beside_velocity_increments(self) -> None:
        tables = streams.tables(self.perfect())
        other = streams.tables(self.perfect(output="increments"))
        del tables["accelerometer"]
        tables["accelerometer_increments"] = other["accelerometer_increments"]
        with pytest.raises(GyrostandError, match="the same kind of quantity"):
            navigated(tables)

    def test_no_accelerometer(self) -> None:
        tables = streams.tables(self.perfect())
        del tables["accelerometer"]
        with pytest.raises(GyrostandError, match=r"add \[streams.accelerometer\]"):
            navigated(tables)


class TestAids:
    def test_none_at_all(self, flight: NavigationRecord) -> None:
        tables = {
            n: t for n, t in streams.tables(flight).items() if n in ("gyro", "accelerometer") or "truth" in n
        }
        out = navigated(tables, loops={"attitude_reference": "none"})
        assert [row["severity"] for row in findings(out, "no aid")] == ["warning"]
        assert set(by_method(out, "filter")["phase"]) == {"outage"}
        pairs = [by_method(out, method) for method in ("strapdown", "loops", "filter")]
        here = [np.stack([p[n] for n in ("latitude", "longitude")]) for p in pairs]
        # Nothing corrects, so all three integrate the same increments; a centimetre is 2e-9 rad.
        assert here[1] == pytest.approx(here[0], abs=2e-9)
        assert here[2] == pytest.approx(here[0], abs=2e-9)

    def test_one_that_is_never_valid(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        nothing = changed(tables["gnss_position"], latitude=np.full(tables["gnss_position"].num_rows, np.nan))
        out = navigated(tables | {"gnss_position": nothing})
        row = findings(out, "never valid")[0]
        assert (row["stream"], row["severity"]) == ("gnss_position", "warning")
        assert "every method goes on without it" in row["detail"]
        assert not by_method(out, "filter")["used_position"].any()
        assert by_method(out, "filter")["used_velocity"].any()
        assert away(by_method(out, "filter"), flight).max() < 30.0  # velocity and the start remain

    @pytest.mark.parametrize("reason", ["fix", "frozen", "pole", "nowhere"])
    def test_what_the_data_say_is_no_measurement(self, flight: NavigationRecord, reason: str) -> None:
        tables = streams.tables(flight)
        position = tables["gnss_position"]
        latitude = position["latitude"].to_numpy().copy()
        if reason == "fix":
            fix = np.where(np.arange(position.num_rows) < 20, -1.0, 0.0)
            position = changed(position, fix=fix, latitude=np.where(fix < 0, 0.0, latitude))
        elif reason == "frozen":
            held = {n: position[n].to_numpy().copy() for n in ("latitude", "longitude", "height")}
            for values in held.values():
                values[4:24] = values[4]
            position = changed(position, **held)
        elif reason == "nowhere":  # what many receivers write until they have a fix
            longitude = position["longitude"].to_numpy().copy()
            latitude[:20], longitude[:20] = 0.0, 0.0
            position = changed(position, latitude=latitude, longitude=longitude)
        else:
            latitude[:20] = 2.0
            position = changed(position, latitude=latitude)
        out = navigated(tables | {"gnss_position": position})
        (row,) = findings(out, "not usable")
        words = {
            "fix": "kind of fix is below 0",
            "frozen": "bit for bit",
            "pole": "beyond a pole",
            "nowhere": "of latitude and longitude 0",
        }
        assert words[reason] in row["detail"]
        assert row["count"] == (19 if reason == "frozen" else 20)
        assert away(by_method(out, "filter"), flight).max() < 30.0

    def test_a_magnetometer_that_is_dead(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        dead = {a: np.zeros(tables["magnetometer"].num_rows) for a in "xyz"}
        out = navigated(tables | {"magnetometer": changed(tables["magnetometer"], **dead)})
        (row,) = findings(out, "not usable")
        assert "of no field at all" in row["detail"]
        assert len(findings(out, "never valid")) == 1

    def test_measurements_that_cannot_be_are_refused(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        latitude = tables["gnss_position"]["latitude"].to_numpy().copy()
        latitude[20] += 1e-3  # 6 km
        out = navigated(tables | {"gnss_position": changed(tables["gnss_position"], latitude=latitude)})
        said = {row["detail"].split(":")[0]: row for row in findings(out, "refused")}
        assert set(said) == {"loops", "filter"}
        assert figures(out)["filter.position", "refused_count"] == 1
        assert figures(out)["filter.position", "refused_share"] == 1 / 51  # one a second, ten seconds without
        assert "so many" not in said["filter"]["detail"]
        assert away(by_method(out, "loops"), flight)[:300].max() < 5.0

    def test_an_aid_that_is_mostly_refused_is_doubted(self, flight: NavigationRecord) -> None:
        """A magnetometer turned by half a turn about the vertical."""
        tables = streams.tables(flight)
        field = tables["magnetometer"]
        turned = changed(field, x=-field["x"].to_numpy(), y=-field["y"].to_numpy())
        out = navigated(tables | {"magnetometer": turned}, methods=("filter",), filter={"reseat_after": 0})
        (row,) = findings(out, "refused")
        assert row["severity"] == "warning"
        assert "so many: are its unit, axes, clock" in row["detail"]
        assert figures(out)["filter.magnetic_field", "refused_share"] > 0.5

    def test_an_aid_that_says_nothing_has_no_innovations(self) -> None:
        """On a stand at rest air speed has no direction, so that the filter looks at none of it."""
        still = FlightSettings(duration=30.0, speed=0.0, lift=None, catapult=None, standing=0.0)
        record = streams.record("diff", flight=still, output="increments")
        out = navigated(streams.tables(record))
        tried = {(r["method"], r["aid"]) for r in out["innovations"].to_pylist()}
        assert ("filter", "airspeed") not in tried
        assert ("filter", "position") in tried
        assert figures(out)["filter.airspeed", "refused_count"] == 0
        assert ("filter.airspeed", "refused_share") not in figures(out)

    @pytest.mark.parametrize("exchanged", [True, False])
    def test_positions_far_from_the_start_are_an_error(
        self, flight: NavigationRecord, exchanged: bool
    ) -> None:
        """No method can say which is wrong; without velocity by satellites the audit can not either."""
        tables = streams.tables(flight)
        latitude, longitude = (tables["gnss_position"][n].to_numpy() for n in ("latitude", "longitude"))
        wrong = {"latitude": longitude, "longitude": latitude} if exchanged else {"latitude": latitude + 0.01}
        tables["gnss_position"] = changed(tables["gnss_position"], **wrong)
        out = navigated(tables)
        row = findings(out, "start contradicted")[0]
        assert row["severity"] == "error"
        assert ("latitude and longitude exchanged?" in row["detail"]) == exchanged
        assert (" 64 km" in row["detail"]) != exchanged  # 0.01 rad of a meridian
        assert figures(out)["start", "error_count"] == 1
        assert out["navigation"].num_rows
        # a start that is from the satellites cannot contradict them
        assert (
            findings(navigated(tables, start_position="gnss", methods=("loops",)), "start contradicted") == []
        )

    def test_a_first_position_that_is_wrong_is_no_contradiction(self, flight: NavigationRecord) -> None:
        latitude = flight.aids["position"].values[:, 0].copy()
        latitude[0] += 0.01
        position = changed(streams.tables(flight)["gnss_position"], latitude=latitude)
        out = navigated(streams.tables(flight) | {"gnss_position": position})
        assert findings(out, "start contradicted") == []

    def test_a_magnetometer_needs_the_field(self, flight: NavigationRecord) -> None:
        with pytest.raises(GyrostandError, match="strength_ut, dip_deg and declination_deg") as caught:
            navigated(streams.tables(flight), earth_field=None)
        assert caught.value.exit_code is ExitCode.USAGE
        out = navigated(streams.tables(flight), earth_field=None, aids=("position",), methods=("filter",))
        assert by_method(out, "filter")["used_position"].any()

    def test_one_of_the_plan_that_has_no_stream(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        del tables["barometer"]
        with pytest.raises(GyrostandError, match=r"streams.barometer, which 'altitude' is from"):
            navigated(tables, aids=("position", "altitude"))


class TestStart:
    def test_the_plan_s_own(self, flight: NavigationRecord) -> None:
        true = flight.start(0.0, error=False)
        yaw, pitch, roll = np.rad2deg(yaw_pitch_roll(true.attitude)).tolist()
        plan = {
            "start_position": "plan",
            "start_velocity": "plan",
            "start_attitude": "plan",
            "start": {
                "latitude_deg": float(np.rad2deg(true.latitude)),
                "longitude_deg": float(np.rad2deg(true.longitude)),
                "height_m": true.height,
                "velocity_m_s": tuple(true.velocity.tolist()),
                "yaw_deg": yaw,
                "pitch_deg": pitch,
                "roll_deg": roll,
            },
        }
        tables = streams.tables(flight, truth=False)
        out = navigated(tables, methods=("strapdown",), **plan)
        assert away(by_method(out, "strapdown"), flight)[0] < 1e-6  # degrees of 16 digits are 1e-9 m
        del plan["start_attitude"]  # stated is stated
        again = navigated(tables, methods=("strapdown",), start_attitude=None, **plan)
        assert again["navigation"].equals(out["navigation"])

    def test_the_first_fix(self) -> None:
        """GNSS from 5 s on: what lies before is left out, and the fix is brought to the sample after it."""
        record = streams.record("ideal", 20.0, errors=NO_ERRORS)
        tables = streams.tables(record)
        for name in ("gnss_position", "gnss_velocity"):
            kept = tables[name].slice(5)
            tables[name] = changed(kept, time=kept["time"].to_numpy() + 1)  # a nanosecond after a sample
        out = navigated(tables, methods=("strapdown",), start_position="gnss", start_velocity="gnss")
        found = by_method(out, "strapdown")
        assert (found["time"][0] - START) * 1e-9 == pytest.approx(5.02, abs=1e-6)
        assert "5.020 s before" in findings(out, "before the start")[0]["detail"]
        # 40 m/s for 20 ms are 0.8 m; that the velocity is that of the fix leaves 1e-7
        assert away(found, record)[0] < 1e-6

    def test_no_fix_to_start_from(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        del tables["gnss_position"]
        with pytest.raises(
            GyrostandError, match=r"a usable position by satellites, found no such aid; state it"
        ):
            navigated(tables, start_position="gnss")

    def test_an_attitude_is_never_guessed(self, flight: NavigationRecord) -> None:
        with pytest.raises(GyrostandError, match="where the attitude at the start is from") as caught:
            navigated(streams.tables(flight), start_attitude=None)
        assert caught.value.exit_code is ExitCode.USAGE

    def test_a_plan_that_does_not_state_what_it_names(self) -> None:
        with pytest.raises(ValueError, match="yaw_deg, pitch_deg, roll_deg beside start_attitude = 'plan'"):
            navigate.Settings(start_attitude="plan")
        with pytest.raises(ValueError, match="height_m beside start_position = 'plan', found no height_m"):
            navigate.Settings.model_validate(
                {"start_position": "plan", "start": {"latitude_deg": 58.0, "longitude_deg": 38.0}}
            )

    def test_an_external_attitude(self) -> None:
        record = streams.record("ideal", 20.0, errors=NO_ERRORS)
        tables = streams.tables(record)
        first = tables["external_attitude"].slice(3)
        tables["external_attitude"] = changed(first, time=first["time"].to_numpy() + 1)
        out = navigated(tables, methods=("strapdown",), start_attitude="external_attitude")
        found = by_method(out, "strapdown")
        angles = np.array([found[n][0] for n in ("yaw", "pitch", "roll")])
        true = yaw_pitch_roll(record.flight.at(np.array([(found["time"][0] - START) * 1e-9])).attitude)[0]
        assert angles == pytest.approx(true, abs=1e-9)  # perfect, and turning slowly between two

    def at_rest(self, **errors: Any) -> NavigationRecord:
        flight = FlightSettings(duration=40.0, catapult=2.0, standing=20.0)
        return streams.record("ideal", flight=flight, errors=ImuErrors(**errors))

    def test_levelled_at_rest(self) -> None:
        record = self.at_rest(accelerometer_bias=(0.05, 0.0, 0.0))
        plan = {"start_position": "gnss", "start_velocity": "gnss", "start_attitude": "levelled"}
        out = navigated(streams.tables(record, truth=False), methods=("strapdown",), **plan)
        found = by_method(out, "strapdown")
        angles = np.array([found[n][0] for n in ("yaw", "pitch", "roll")])
        true = yaw_pitch_roll(record.start(0.0, error=False).attitude)
        g = 9.82
        # a bias along axis 1 pitches by b/g, but for the cosine of the pitch; a tilted magnetometer turns
        # by the tilt times tan(dip) = 2.9 times the sine of what lies across
        assert angles[1] - true[1] == pytest.approx(0.05 / g, rel=0.05)
        assert angles[2] == pytest.approx(true[2], abs=1e-3)
        assert angles[0] == pytest.approx(true[0], abs=3 * 0.05 / g)

    def test_levelled_by_increments_with_a_yaw_of_the_plan(self) -> None:
        flight = FlightSettings(duration=40.0, catapult=2.0, standing=20.0)
        record = streams.record("ideal", flight=flight, errors=NO_ERRORS, output="increments")
        tables = {n: t for n, t in streams.tables(record).items() if n != "magnetometer"}
        plan = {"start_attitude": "levelled", "start": {"yaw_deg": 55.0}}
        found = by_method(navigated(tables, methods=("strapdown",), **plan), "strapdown")
        true = yaw_pitch_roll(record.start(0.0, error=False).attitude)
        angles = np.array([found[n][0] for n in ("yaw", "pitch", "roll")])
        assert angles == pytest.approx(true, abs=1e-6)  # g differs from the flight's own by no direction

    def test_levelled_without_a_yaw(self) -> None:
        tables = {n: t for n, t in streams.tables(self.at_rest()).items() if n != "magnetometer"}
        with pytest.raises(GyrostandError, match="gravity tells no yaw"):
            navigated(tables, start_attitude="levelled")

    def test_levelled_in_motion(self) -> None:
        record = self.at_rest()
        with pytest.raises(GyrostandError, match="expected rest over the first 25 s"):
            navigated(streams.tables(record), start_attitude="levelled", level_s=25.0)

    def test_a_pole(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        polar = changed(
            tables["truth_position"], latitude=np.full(tables["truth_position"].num_rows, np.pi / 2)
        )
        with pytest.raises(GyrostandError, match=r"within 89.9 deg.*found 90 deg"):
            navigated(tables | {"truth_position": polar})


class TestLoops:
    def test_gains_that_are_not_stable_are_refused_with_their_limit(self, flight: NavigationRecord) -> None:
        gains = {"T_s": 3.0, "T_V_s": 3.0, "k_L": 3.0, "k_V": 3.0, "K": 1.0, "k_LV": 1.0, "k_n": 1.4}
        with pytest.raises(CorrectionGainsError, match=r"k_n < 1.33333 1/s \(Routh\), found 1.4") as caught:
            navigated(streams.tables(flight), loops={"satellites": gains}, aids=("position", "velocity"))
        assert caught.value.exit_code is ExitCode.USAGE

    def test_differences_that_are_held_diverge_and_are_refused(self, flight: NavigationRecord) -> None:
        with pytest.raises(CorrectionGainsError, match=r"a spectral radius below 1 a fix.*'held_difference'"):
            navigated(
                streams.tables(flight),
                loops={"gains": "printed", "references": "held_difference"},
                methods=("loops",),
            )

    def test_a_reference_that_is_not_there(self, flight: NavigationRecord) -> None:
        tables = {n: t for n, t in streams.tables(flight).items() if n != "external_attitude"}
        with pytest.raises(GyrostandError, match="which the reference 'X' is"):
            navigated(tables, loops={"attitude_reference": "X"})

    def test_what_reference_a_cannot_tell_is_said(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight)
        out = navigated(tables, methods=("loops",))
        row = findings(out, "bias as tilt")[0]
        assert row["severity"] == "info"
        assert "b/g" in row["detail"]
        assert "with 'X' they follow it" in findings(out, "not followed")[0]["detail"]
        out = navigated(tables, methods=("loops",), loops={"attitude_reference": "X"})
        assert findings(out, "bias as tilt") == findings(out, "not followed") == []
        assert findings(navigated(tables, methods=("filter",)), "bias as tilt") == []

    def test_noise_of_the_attitude_s_loop_is_of_attitudes(self, flight: NavigationRecord) -> None:
        rows = navigated(streams.tables(flight), methods=("loops",))["loops"].to_pylist()
        of_attitude = [r for r in rows if r["name"] == "noise_attitude_by_attitude"]
        assert of_attitude
        assert {r["unit"] for r in of_attitude} == {"(rad)/(rad)"}
        loops = {r["loop"] for r in of_attitude}
        assert not [r for r in rows if r["loop"] in loops and r["name"] == "noise_velocity_by_velocity"]


class TestConsistency:
    def test_the_figure_is_that_of_the_covariance(self, flight: NavigationRecord) -> None:
        """Errors drawn from a covariance of which all nine components go together: mean 1."""
        rng = np.random.default_rng(5)
        n = 1200
        at = np.arange(0, 2 * n, 2)
        time = np.linspace(0.0, 60.0, 2 * n)
        factor = 0.1 * rng.normal(size=(n, 12, 9))
        scale = np.repeat([1e-3, 0.1, 1.0], 3)  # rad, m/s, m
        error = scale * np.einsum("nij,ni->nj", factor, rng.normal(size=(n, 12)))
        motion = flight.flight.at(time)
        whole = np.zeros((2 * n, 9))
        whole[at] = error
        turned = quaternion_multiply(quaternion_from_rotation_vector(-whole[:, :3]), motion.attitude)
        one = Navigation(
            "filter",
            time,
            displaced(motion.position, -whole[:, 6:]),
            motion.velocity - whole[:, 3:6],
            turned,
            np.zeros((2 * n, 3)),
            np.zeros((2 * n, 3)),
        )
        phase = ["aided"] * n + ["outage"] * n
        truth = truth_of(streams.tables(flight))
        done = Done(one, at, factor * scale)
        rows = list(consistency_figures(done, np.arange(2 * n), phase, START, truth))
        found = {r["channel"]: r["value"] for r in rows}
        assert set(found) == {"filter.aided", "filter.outage"}
        # a mean over 600 times 9: 1 +- sqrt(2/5400) = 0.019, five of them
        assert list(found.values()) == pytest.approx([1.0, 1.0], abs=0.1)
        only = Truth(truth.position, None, None)
        row = next(consistency_figures(done, np.arange(2 * n), phase, START, only))
        assert row["value"] == pytest.approx(1.0, abs=5 * np.sqrt(2 / 1800))

    def test_without_covariances_or_truth_there_is_none(self, flight: NavigationRecord) -> None:
        tables = streams.tables(flight, truth=False)
        plan = {"start_position": "gnss", "start_velocity": "gnss", "start_attitude": "external_attitude"}
        names = {name for _, name in figures(navigated(tables, **plan))}
        assert "normalised_errors" not in names
        with_truth = {
            c for c, name in figures(navigated(streams.tables(flight))) if name == "normalised_errors"
        }
        phases = ("aided", "outage", "reacquired")
        assert with_truth == {f"{method}.{phase}" for method in ("filter", "smoother") for phase in phases}

    def test_an_external_attitude_is_not_believed_more_than_it_deserves(self) -> None:
        """0.3 degrees constant and as much wandering, at 20 Hz: by the defaults, and taken for white."""
        mean, white = [], []
        for seed in range(1, 7):
            tables = streams.tables(streams.record("diff", 120.0, seed))
            plan = {"methods": ("filter",), "aids": ("position", "velocity", "attitude")}
            mean.append(figures(navigated(tables, **plan))["filter.aided", "normalised_errors"])
            none = {"coloured": {"attitude_rad": 0.0, "attitude_bias_rad": 0.0}}
            told = navigated(tables, **plan, filter=none)
            white.append(figures(told)["filter.aided", "normalised_errors"])
        # A state's share of one draw is 1 +- sqrt(2/9), of six 0.19; P0 and R that are larger than the errors
        # make it less.
        assert 0.3 < np.mean(mean) < 1.4
        assert np.mean(white) > 3.0


class TestInstants:
    def test_outages_and_phases(self) -> None:
        time = np.arange(0.0, 100.5, 0.5)
        imu = Imu(time, np.zeros((200, 3)), np.zeros((200, 3)), np.zeros(200, dtype=np.bool_))
        at = np.r_[np.arange(10.0, 31.0), np.arange(60.0, 81.0)]
        fixes = Fixes(at, np.zeros((42, 3)), np.ones(42, dtype=np.bool_))
        lost = outages(fixes, imu, 2.5)
        assert lost == (Outage(0.0, 10.0), Outage(31.0, 60.0), Outage(81.0, 100.0))
        found = np.array(phases(time, lost))
        expected = np.select(
            [time < 10, time < 31, time < 60, time < 81],
            ["outage", "aided", "outage", "reacquired"],
            "outage",
        )
        assert (found == expected).all()
        assert set(phases(time, None)) == {"outage"}
        assert set(phases(time, ())) == {"aided"}

    def test_rows_on_a_grid_and_at_the_end(self) -> None:
        time = np.arange(0, 1004) * 0.01 + 1e-10 * np.random.default_rng(1).normal(size=1004)
        at = chosen(time, 0.1)
        assert at[:-1].tolist() == list(range(0, 1003, 10))
        assert at[-1] == 1003
        assert chosen(time, 1e-3).tolist() == list(range(1004))
        assert chosen(time, 1e6).tolist() == [0, 1003]
        # A grid far finer than the samples takes no room.
        assert chosen(time, 1e-12).tolist() == list(range(1004))


def test_the_same_tables_twice(flight: NavigationRecord) -> None:
    tables = streams.tables(flight)
    first, second = navigated(tables), navigated(tables)
    assert all(first[name].equals(second[name]) for name in first)


def test_when_it_was_recorded_does_not_matter(flight: NavigationRecord) -> None:
    tables = streams.tables(flight)
    shifted = {n: changed(t, time=t["time"].to_numpy() - START) for n, t in tables.items()}
    here, there = (navigated(one, methods=("strapdown",))["navigation"] for one in (tables, shifted))
    assert np.array_equal(here["time"].to_numpy() - START, there["time"].to_numpy())
    assert here["latitude"].equals(there["latitude"])
