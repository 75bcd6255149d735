"""Rates corrected at ingest by the file of a calibration: exactness, what is said, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import calibrations
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline import formats
from pipeline.errors import ExitCode
from pipeline.formats.base import Series
from pipeline.models.rate_table_triad_model import TriadCalibration
from pipeline.stages import ingest
from pipeline.stages._calibration_file import CalibrationError, read, text_of
from pipeline.stages.base import Stand

Float = NDArray[np.float64]
N = 500
STAMP = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 10**7
RATES = np.random.default_rng(3).uniform(-1.5, 1.5, (N, 3))
NAME = "gyro7.calibration.json"
WARM_STAMP = STAMP[::50]
TEMPERATURE = 293.15 + np.linspace(-5.0, 20.0, len(WARM_STAMP))


def ingested(
    folder: Path, outputs: Float, text: str | None, *, warm: bool = False, **more: Any
) -> dict[str, pa.Table]:
    """Ingest of outputs [rad/s] of the gyros p, q, r, or of q alone, recorded in deg/s."""
    axes = "pqr" if outputs.shape[1] == 3 else "q"
    paths = [f"angular_velocity.{'xyz'['pqr'.index(a)]}" for a in axes]
    columns = dict(zip(paths, np.degrees(outputs).T, strict=True))
    series = [Series("/gyro", "sensor_msgs/msg/Imu", STAMP, STAMP, columns)]
    channels = {a: {"field": path, "unit": "deg/s"} for a, path in zip(axes, paths, strict=True)}
    gyro = {"topic": "/gyro", "quantity": "angular_rate", "channels": channels, "calibration": NAME, **more}
    streams: dict[str, Any] = {"gyro": gyro}
    if warm:
        of_warm = {"temperature": TEMPERATURE - 273.15}
        series.append(Series("/warm", "sensor_msgs/msg/Temperature", WARM_STAMP, WARM_STAMP, of_warm))
        channel = {"temperature": {"field": "temperature", "unit": "degC"}}
        streams["temperature"] = {"topic": "/warm", "quantity": "temperature", "channels": channel}
    recording = folder / "run.mcap"
    formats.write(recording, series)
    if text is not None:
        (folder / NAME).write_text(text, encoding="utf-8")
    settings = ingest.Settings.model_validate({"time": {"clock": "header_stamp"}, "streams": streams})
    return ingest.run(recording, settings, Stand())


def rates_of(tables: dict[str, pa.Table], axes: str = "pqr") -> Float:
    return np.column_stack([tables["gyro"].column(axis).to_numpy() for axis in axes])


def said(tables: dict[str, pa.Table]) -> dict[str, dict[str, Any]]:
    return {row["kind"]: row for row in tables["findings"].to_pylist()}


class TestCorrection:
    def test_a_triad_gives_the_rates_of_the_case(self, tmp_path: Path) -> None:
        outputs = RATES @ calibrations.S.T + calibrations.BIAS
        tables = ingested(tmp_path, outputs, calibrations.triad_text())
        # degrees and back, and the inverse of a matrix that is nearly unity: some roundings of 1.5 rad/s
        np.testing.assert_allclose(rates_of(tables), RATES, rtol=0, atol=2e-15)
        assert list(said(tables)) == ["calibrated"]

    def test_its_biases_follow_the_temperature(self, tmp_path: Path) -> None:
        warmth = np.interp(STAMP - STAMP[0], WARM_STAMP - STAMP[0], TEMPERATURE) - calibrations.T0
        outputs = RATES @ calibrations.S.T + calibrations.BIAS + np.outer(warmth, calibrations.WARM)
        tables = ingested(tmp_path, outputs, calibrations.triad_text(warm=True), warm=True)
        # 3e-6 rad/s/K times the rounding of 300 K in degrees Celsius, and as above
        np.testing.assert_allclose(rates_of(tables), RATES, rtol=0, atol=2e-15)
        after = said(tables)["temperature missing"]
        assert (after["count"], after["start"]) == (49, WARM_STAMP[-1] + 10**7)  # held after the last one

    def test_gyros_of_a_triad_have_terms_of_their_own(self, tmp_path: Path) -> None:
        warmth = np.interp(STAMP - STAMP[0], WARM_STAMP - STAMP[0], TEMPERATURE) - calibrations.T0
        outputs = calibrations.bent_output(RATES, warmth)
        tables = ingested(tmp_path, outputs, calibrations.bent_text(), warm=True)
        # the inversion ends at rounding
        np.testing.assert_allclose(rates_of(tables), RATES, rtol=0, atol=4e-15)
        model = read(tmp_path / NAME).models["p q r"]
        np.testing.assert_array_equal(model.value[12:], calibrations.OWN.ravel())

    def test_one_gyro_with_all_its_terms(self, tmp_path: Path) -> None:
        temperature = np.interp(STAMP - STAMP[0], WARM_STAMP - STAMP[0], TEMPERATURE)
        outputs = calibrations.axis_output(RATES[:, 1], temperature)[:, np.newaxis]
        tables = ingested(tmp_path, outputs, calibrations.axis_text(), warm=True)
        # the inversion ends at rounding
        np.testing.assert_allclose(rates_of(tables, "q")[:, 0], RATES[:, 1], rtol=0, atol=2e-15)

    def test_axes_are_turned_after_it(self, tmp_path: Path) -> None:
        R = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        outputs = RATES @ calibrations.S.T + calibrations.BIAS
        tables = ingested(tmp_path, outputs, calibrations.triad_text(), rotation=R)
        np.testing.assert_allclose(rates_of(tables), RATES @ np.array(R).T, rtol=0, atol=2e-15)

    def test_a_lost_output_of_a_triad_leaves_no_rate(self, tmp_path: Path) -> None:
        outputs = RATES @ calibrations.S.T + calibrations.BIAS
        outputs[7, 1] = np.nan
        outputs[9] = np.inf
        tables = ingested(tmp_path, outputs, calibrations.triad_text())
        found = rates_of(tables)
        assert np.isnan(found[[7, 9]]).all()
        assert np.isfinite(np.delete(found, [7, 9], axis=0)).all()
        missing = said(tables)["missing value"]
        assert (missing["count"], missing["start"]) == (1, STAMP[7])
        assert "one of three gyros" in missing["detail"]

    def test_what_is_said_names_the_source_and_the_largest_error(self, tmp_path: Path) -> None:
        outputs = RATES @ calibrations.S.T + calibrations.BIAS
        tables = ingested(tmp_path, outputs, calibrations.triad_text())
        finding = said(tables)["calibrated"]
        assert (finding["severity"], finding["count"]) == ("info", N)
        model = read(tmp_path / NAME).models["p q r"]
        assert isinstance(model, TriadCalibration)
        _, error = model.apply(outputs)
        for axis, largest in zip("pqr", error.max(axis=0), strict=True):
            assert f"{np.degrees(largest) * 3600:.3g} deg/h in {axis}" in finding["detail"]
        for word in (NAME, "'table'", "'table.mcap'", "by rates", "a time offset is not applied"):
            assert word in finding["detail"]

    def test_rates_beyond_the_calibrated_ones_are_counted(self, tmp_path: Path) -> None:
        faster = RATES * np.where(np.arange(N) == 11, 4.0, 1.0)[:, np.newaxis]
        tables = ingested(tmp_path, faster @ calibrations.S.T + calibrations.BIAS, calibrations.triad_text())
        beyond = said(tables)["beyond the calibration"]
        assert (beyond["severity"], beyond["count"], beyond["start"]) == ("warning", 1, STAMP[11])
        assert f"{calibrations.LARGEST:g} rad/s" in beyond["detail"]

    def test_outputs_that_the_gyro_cannot_have_have_no_rate(self, tmp_path: Path) -> None:
        bent = calibrations.axis_text().replace(
            '"scale_factor_nonlinearity_3", "value": 0.00015', '"scale_factor_nonlinearity_3", "value": -0.5'
        )
        outputs = np.full((N, 1), 0.3)
        spikes = [7, 12]
        outputs[spikes, 0] = 6.0, -60.0
        outputs[9] = np.nan
        tables = ingested(tmp_path, outputs, bent, warm=True)
        rate = rates_of(tables, "q")[:, 0]
        assert np.flatnonzero(np.isnan(rate)).tolist() == [7, 9, 12]
        lost = said(tables)["not corrected"]
        assert (lost["severity"], lost["count"]) == ("warning", 2)  # what was NaN before is none of them
        assert (lost["start"], lost["end"]) == tuple(STAMP[spikes])

    def test_one_output_that_a_gyro_of_a_triad_cannot_have_leaves_no_rate(self, tmp_path: Path) -> None:
        name = '"scale_factor_nonlinearity_3_q", "value": '
        text = calibrations.bent_text()
        assert name in text
        bent = text.replace(f"{name}-0.0002", f"{name}-0.5")
        assert bent != text
        outputs = calibrations.bent_output(0.2 * RATES, np.zeros(N))
        outputs[5, 1] = 6.0
        tables = ingested(tmp_path, outputs, bent, warm=True)
        assert np.flatnonzero(np.isnan(rates_of(tables)).any(axis=1)).tolist() == [5]
        assert np.isnan(rates_of(tables)[5]).all()
        assert said(tables)["not corrected"]["count"] == 1

    def test_temperatures_beyond_the_calibrated_ones_are_counted(self, tmp_path: Path) -> None:
        outputs = RATES @ calibrations.S.T + calibrations.BIAS
        text = calibrations.triad_text(warm=True)
        high = calibrations.T0 + calibrations.WARMTH[1]
        assert "beyond the calibration" not in said(ingested(tmp_path, outputs, text, warm=True))
        lowered = text.replace(f'"highest_temperature": {high}', f'"highest_temperature": {high - 5}')
        assert lowered != text
        beyond = said(ingested(tmp_path, outputs, lowered, warm=True))["beyond the calibration"]
        warmth = np.interp(STAMP - STAMP[0], WARM_STAMP - STAMP[0], TEMPERATURE)
        # a twentieth of the range of 20 K further: 1 K
        late = np.flatnonzero(warmth > high - 4)
        assert (beyond["count"], beyond["start"]) == (len(late), STAMP[late[0]])
        assert f"{calibrations.T0 - 5:g} K to {high - 5:g} K" in beyond["detail"]

    def test_a_file_that_does_not_say_its_temperatures_is_read(self, tmp_path: Path) -> None:
        lines = calibrations.triad_text(warm=True).splitlines(keepends=True)
        kept = [line for line in lines if "lowest_temp" not in line and "highest_temp" not in line]
        assert len(kept) == len(lines) - 2
        outputs = RATES @ calibrations.S.T + calibrations.BIAS
        assert "beyond the calibration" not in said(ingested(tmp_path, outputs, "".join(kept), warm=True))


class TestFile:
    def test_what_is_written_is_read_again(self, tmp_path: Path) -> None:
        path = tmp_path / NAME
        path.write_text(calibrations.triad_text(warm=True), encoding="utf-8")
        found = read(path)
        model = found.models["p q r"]
        value = np.concatenate([calibrations.S.ravel(), calibrations.BIAS, calibrations.WARM])
        assert np.array_equal(model.value, value)
        # a correlation is the covariance over two deviations, and is multiplied by them again
        np.testing.assert_allclose(model.covariance, calibrations.covariance_of(np.abs(value)), rtol=1e-14)
        assert (found.recording, found.recording_name) == ("table", "table.mcap")
        assert (found.recording_sha256, found.methods) == ("ab" * 32, {"p q r": "rates"})
        assert model.reference_temperature == calibrations.T0

    def test_one_parameter_and_one_row_of_correlations_a_line(self) -> None:
        lines = calibrations.axis_text().splitlines()
        assert sum('"name"' in line for line in lines) == len(calibrations.AXIS)
        assert sum(line.strip().startswith("[") for line in lines) == len(calibrations.AXIS)

    def test_errors_of_a_gyro_are_those_of_its_covariance(self, tmp_path: Path) -> None:
        """By finite differences of the correction, parameter by parameter."""
        path = tmp_path / NAME
        path.write_text(calibrations.axis_text(), encoding="utf-8")
        model = read(path).models["q"]
        rate, warm = np.array([-1.2, 0.4, 1.9]), np.full(3, 300.0)
        raw = calibrations.axis_output(rate, warm)
        J = []
        for k, value in enumerate(calibrations.AXIS):
            step = 1e-4 * abs(value)
            up, down = calibrations.AXIS.copy(), calibrations.AXIS.copy()
            up[k] += step
            down[k] -= step
            J.append((inverted(raw, warm, up) - inverted(raw, warm, down)) / (2 * step))
        C = calibrations.covariance_of(np.abs(calibrations.AXIS))
        wanted = np.sqrt(np.einsum("kn,kl,ln->n", np.array(J), C, np.array(J)))
        _, error = model.apply(raw, warm)
        # rounding of 1 rad/s over steps of 2e-8 and more: 1e-8; second differences of 1e-8
        np.testing.assert_allclose(error, wanted, rtol=1e-6)

    def test_the_triad_is_chosen_where_there_are_gyros_beside_it(self) -> None:
        pairs = [calibrations.triad_tables(), calibrations.axis_tables("p")]
        whole = [pa.concat_tables(tables) for tables in zip(*pairs, strict=True)]
        written = json.loads(text_of("table", whole[0], whole[1], calibrations.PROVENANCE))
        assert [model["channels"] for model in written["models"]] == ["p q r"]

    def test_what_is_weakly_determined_has_a_standard_error_and_is_written(self) -> None:
        assert calibrations.triad_text(states={"S13": "combined"}) == calibrations.triad_text()

    def test_gyros_each_by_itself(self, tmp_path: Path) -> None:
        pairs = [calibrations.axis_tables(gyro) for gyro in "pqr"]
        whole = [pa.concat_tables(tables) for tables in zip(*pairs, strict=True)]
        text = text_of("table", whole[0], whole[1], calibrations.PROVENANCE)
        outputs = calibrations.axis_output(RATES, np.full((N, 1), 293.15))
        warm = text.replace(f'"reference_temperature": {calibrations.T0}', '"reference_temperature": 293.15')
        tables = ingested(tmp_path, outputs, warm, warm=True)
        temperature = np.interp(STAMP - STAMP[0], WARM_STAMP - STAMP[0], TEMPERATURE)
        # the outputs were made at T0: what the temperature would have added is taken off
        wanted = [inverted(column, temperature, calibrations.AXIS) for column in outputs.T]
        np.testing.assert_allclose(rates_of(tables), np.column_stack(wanted), rtol=0, atol=4e-15)


def inverted(raw: Float, temperature: Float, value: Float) -> Float:
    """The rates of one gyro with parameters ``value`` by bisection, which knows no derivative."""
    b, K, a, c, d, e = value
    low, high = np.full(raw.shape, -4.0), np.full(raw.shape, 4.0)
    for _ in range(60):
        w = (low + high) / 2
        warmth = temperature - calibrations.T0
        braces = w + a * np.abs(w) / 2 + c * calibrations.LARGEST * (w / calibrations.LARGEST) ** 3
        above = K * (braces + e * warmth * w) + b + d * warmth > raw
        low, high = np.where(above, low, w), np.where(above, w, high)
    return np.asarray((low + high) / 2, dtype=np.float64)


def of_uncertain_s33(error: float) -> str:
    """The file of a triad of which one sensitivity has this standard error."""
    value = np.concatenate([calibrations.S.ravel(), calibrations.BIAS])
    errors = np.full(len(value), 1e-6)
    errors[calibrations.TRIAD.index("S33")] = error
    made = calibrations.tables_of("", calibrations.TRIAD, value, np.diag(errors**2))
    return text_of("table", *made, calibrations.PROVENANCE)


class TestRefusal:
    def outputs(self) -> Float:
        return np.asarray(RATES @ calibrations.S.T + calibrations.BIAS, dtype=np.float64)

    def test_a_calibration_that_does_not_tell_all_is_not_written(self) -> None:
        states = {"S13": "combined", "bias_r": "undetermined"}
        with pytest.raises(CalibrationError, match=r"found none of bias_r of the triad;") as refused:
            calibrations.triad_text(states=states)
        assert refused.value.exit_code is ExitCode.NOT_MET

    def test_a_sensitivity_that_is_not_known_to_a_tenth_is_not_written(self) -> None:
        assert '"standard_error": 0.09' in of_uncertain_s33(0.09)
        with pytest.raises(
            CalibrationError, match=r"S33 of the triad with a standard error of 0.11"
        ) as refused:
            of_uncertain_s33(0.11)
        assert refused.value.exit_code is ExitCode.NOT_MET

    def test_sensitivities_that_cannot_be_inverted(self, tmp_path: Path) -> None:
        text = calibrations.triad_text()
        for k in range(9):
            text = text.replace(f'"value": {calibrations.S.ravel()[k]}', '"value": 1.0', 1)
        with pytest.raises(CalibrationError, match="can be inverted, found a singular matrix") as refused:
            ingested(tmp_path, self.outputs(), text)
        assert refused.value.exit_code is ExitCode.INPUT

    def test_other_channels(self, tmp_path: Path) -> None:
        with pytest.raises(CalibrationError, match=r"the channels p, q, r .*, found one of q;") as refused:
            ingested(tmp_path, self.outputs(), calibrations.axis_text())
        assert refused.value.exit_code is ExitCode.USAGE

    def test_no_temperature(self, tmp_path: Path) -> None:
        with pytest.raises(CalibrationError, match=r"add \[streams.temperature\]") as refused:
            ingested(tmp_path, self.outputs(), calibrations.triad_text(warm=True))
        assert refused.value.exit_code is ExitCode.USAGE

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("", None, ["JSON"]),
            ('"outputs": "rad/s"', '"outputs": "deg/s"', ["outputs", "'rad/s'", "'deg/s'"]),
            ('"version": 1', '"version": 2', ["version", "2"]),
            ('"format": "gyrostand calibration"', '"format": "another"', ["format", "'another'"]),
            ('"name": "S12"', '"name": "S21"', ["the parameters of a model, in order"]),
            ('"unit": "rad/s"', '"unit": "deg/s"', ["input should be", "'rad/s/K'", "'deg/s'"]),
            ('"unit": "rad/s"', '"unit": "1"', ["bias_p in 'rad/s'", "'1'"]),
            ('"value": 1.003', '"value": NaN', ["NaN, which is no number"]),
            ('"value": 1.003', '"value": "1.003"', ["models.0.parameters.0.value", "'1.003'"]),
            ('"value": 1.003', '"value": 1.003, "value": 1.0', ["a key that occurs twice"]),
            ('"value": 1.003, ', "", ["the key models.0.parameters.0.value", "none"]),
            ('"method": "rates"', '"method": "rates", "by": "me"', ["no key beside those", "models.0.by"]),
            ("        [1.0]", "        [0.5]", ["correlations"]),
            ("        [1.0],\n", "", ["the lower triangle of 12 correlations"]),
            ('"channels": "p q r"', '"channels": "p"', ["the parameters of a model, in order"]),
            ('"largest_rate": 2.0', '"largest_rate": 0.0', ["models.0.largest_rate", "greater than 0"]),
            ('"value": 1.003', '"value": 1e999', ["models.0.parameters.0.value"]),
            ('"lowest_temperature": null', '"lowest_temperature": 1.0', ["or neither", "1.0, None"]),
        ],
    )  # fmt: skip
    def test_a_damaged_file_gives_one_line(
        self, tmp_path: Path, old: str, new: str | None, words: list[str]
    ) -> None:
        text = calibrations.triad_text()
        damaged = text[: len(text) // 2] if new is None else text.replace(old, new, 1)
        assert damaged != text
        with pytest.raises(CalibrationError) as refused:
            ingested(tmp_path, self.outputs(), damaged)
        assert refused.value.exit_code is ExitCode.INPUT
        message = str(refused.value)
        assert "\n" not in message
        for word in (*words, NAME, "calibration export"):
            assert word in message

    @pytest.mark.parametrize(
        "content", [b"", b"\xff\xfe\x00", b"[" * 100_000, b"[]", b"null", b"1" * (2**20 + 1)]
    )
    def test_what_is_no_such_file(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / NAME
        path.write_bytes(content)
        with pytest.raises(CalibrationError) as refused:
            read(path)
        assert refused.value.exit_code is ExitCode.INPUT
        assert "\n" not in str(refused.value)

    def test_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(CalibrationError, match="No such file") as refused:
            ingested(tmp_path, self.outputs(), None)
        assert refused.value.exit_code is ExitCode.INPUT

    @pytest.mark.parametrize(
        ("streams", "words"),
        [
            ({"quantity": "angle_increment", "calibration": NAME}, "with quantity 'angular_rate'"),
            ({"quantity": "angular_rate", "calibration": f"../{NAME}"}, "the bare name of a file"),
            ({"quantity": "angular_rate", "calibration": ".."}, "the bare name of a file"),
        ],
    )
    def test_a_plan_that_asks_for_what_cannot_be(self, streams: dict[str, Any], words: str) -> None:
        unit = "rad/s" if streams["quantity"] == "angular_rate" else "rad"
        gyro = {"topic": "/gyro", "channels": {"p": {"field": "x", "unit": unit}}, **streams}
        plan = {"time": {"clock": "header_stamp"}, "streams": {"gyro": gyro}}
        with pytest.raises(ValidationError, match=words):
            ingest.Settings.model_validate(plan)
