"""Gyros that others turned by hand, calibrated by the plans in ``plans/``, against what NumPy makes of them.

The turns are those that the makers of the recordings say they made; nobody measured how well. The plans say
2 degrees of angle and 1 degree of axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline import storage
from pipeline.cli import main
from pipeline.testplan import load_plan

Float = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "turntable"
PLANS = Path(__file__).parent / "plans"
DEGREE = np.pi / 180
AXES = "pqr"
COUNT = 2000 / 32768
"""deg/s of a count of the annotated session, by the data sheet."""

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recordings of others are not beside this checkout"
)


@dataclass(frozen=True)
class Case:
    """A recording: samples a second, lines above its rows, columns of the gyro, and their unit [deg/s]."""

    file: str
    rate: float
    head: int
    columns: tuple[int, int, int]
    unit: float

    def samples(self) -> tuple[Float, Float]:
        """Time [s], shape (n,), row by row, and rates [deg/s], shape (n, 3)."""
        rows = np.genfromtxt(DATA / self.file, delimiter=",", skip_header=self.head, usecols=self.columns)
        return np.arange(len(rows)) / self.rate, rows * self.unit


CASES = {
    "ferraris": Case("imucal_ferraris_session.csv", 102.4, 1, (1, 2, 3), 1.0),
    "annotated": Case("imucal_annotated_session.csv", 204.8, 1, (5, 6, 7), COUNT),
    "quarter_turn": Case("tomi_mpu6050_90deg_x_rot.csv", 100.0, 5, (3, 4, 5), 1 / 131),
}


def command(*arguments: object) -> int:
    """The command line without a process of its own; its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    code = ended.value.code
    assert code is None or isinstance(code, int)
    return code or 0


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every case run, into one output folder."""
    out = tmp_path_factory.mktemp("turned")
    for name, case in CASES.items():
        plan = PLANS / f"turntable_{name}.toml"
        assert command("run", DATA / case.file, "--plan", plan, "--out", out, "--id", name) == 0
    return out


@pytest.fixture
def told(output: Path) -> Callable[[str], dict[str, dict[str, Any]]]:
    """The parameters of a recording's calibration, by name."""
    return lambda name: {
        row["parameter"]: row for row in storage.read(output, name, "calibration").to_pylist()
    }


def by_hand(name: str) -> tuple[Float, Float]:
    """Bias [deg/s], and the angle of each turn of the plan less it [deg], shape (turns, 3)."""
    settings: Any = load_plan(PLANS / f"turntable_{name}.toml").settings["calibrate"]
    time, rate = CASES[name].samples()

    def of(stretch: Any) -> Float:
        return (time >= stretch.start) & (time <= stretch.stop)

    bias = np.concatenate([rate[of(rest)] for rest in settings.rests]).mean(axis=0)
    turned = [np.trapezoid(rate[of(turn)] - bias, time[of(turn)], axis=0) for turn in settings.turns]
    return bias, np.array(turned)


@pytest.mark.parametrize("name", ["ferraris", "annotated"])
def test_full_turns_tell_scale_factors_and_biases(name: str, told: Callable[[str], Any]) -> None:
    calibration = told(name)
    bias, turned = by_hand(name)
    for i, axis in enumerate(AXES):
        row = calibration[f"S{i + 1}{i + 1}"]
        assert row["state"] == "determined"
        # the angle by which the sensor turned, over 360 deg; a tenth of the 2 deg that it is known to
        assert row["value"] == pytest.approx(abs(turned[i, i]) / 360, abs=0.1 * 2 / 360)
        assert row["standard_error"] == pytest.approx(2 / 360, rel=0.05)  # times a scale factor near 1
        rested = calibration[f"bias_{axis}"]
        assert rested["state"] == "determined"
        # the rests do not weigh alike in both: four of the standard errors that their scatter gives
        assert rested["value"] / DEGREE == pytest.approx(bias[i], abs=4 * rested["standard_error"] / DEGREE)
        # each sensor's own tolerance is 3 %, and the turns' 0.6 %
        assert calibration[f"scale_factor_{axis}"]["value"] == pytest.approx(1, abs=0.04)


@pytest.mark.parametrize("name", ["ferraris", "annotated"])
def test_a_hand_tells_no_misalignment_better_than_its_axis(name: str, told: Callable[[str], Any]) -> None:
    calibration = told(name)
    for one in AXES:
        for other in AXES.replace(one, ""):
            error = calibration[f"misalignment_{one}{other}"]["standard_error"]
            assert error == pytest.approx(DEGREE, rel=0.05)  # of the turn about the other axis


def test_what_was_measured_with_the_models_before(told: Callable[[str], Any]) -> None:
    """The same turns, found by a threshold: 1.0277, 0.9825, 0.9981; 16.68, 16.19, 16.25 counts to a deg/s."""
    found = [told("ferraris")[f"scale_factor_{axis}"]["value"] for axis in AXES]
    # start and stop in other places of the same rests: their noise, a hundredth of the standard errors
    np.testing.assert_allclose(found, [1.0277, 0.9825, 0.9981], atol=3e-4)
    counts = np.array([told("annotated")[f"scale_factor_{axis}"]["value"] for axis in AXES]) / COUNT
    np.testing.assert_allclose(counts, [16.68, 16.19, 16.25], atol=0.01)


def test_a_quarter_turn_tells_a_column_alone(told: Callable[[str], Any]) -> None:
    calibration = told("quarter_turn")
    _, turned = by_hand("quarter_turn")
    assert turned[0, 0] == pytest.approx(90, rel=0.03)  # the data sheet's scale factor tolerance
    for i in (1, 2, 3):
        value = calibration[f"S{i}1"]["value"]
        assert value == pytest.approx(
            turned[0, i - 1] / 90, abs=0.1 * 2 / 90
        )  # of what the angle is known to
        assert all(calibration[f"S{i}{j}"]["state"] == "undetermined" for j in (2, 3))
        assert all(calibration[f"S{i}{j}"]["value"] is None for j in (2, 3))
        assert calibration[f"bias_{AXES[i - 1]}"]["state"] == "determined"


def test_every_recording_has_its_page_and_keeps_the_contracts(output: Path) -> None:
    assert command("report", output) == 0
    assert command("check", output) == 0
    for name in CASES:
        page = (output / "report" / f"{name}.html").read_text(encoding="utf-8")
        assert "<h2>The record</h2>" in page
        assert "turns (blue) and rests (grey)" in page
