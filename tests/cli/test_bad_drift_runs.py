"""Runs of a gimbal that cannot be identified, through the real command: one clear line and the exit code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from in_process import Completed
from scipy.spatial.transform import Rotation

from pipeline.models.earth import RATE, Base, Scheme
from pipeline.simulate.drift import simulate_drift
from pipeline.simulate.drift_settings import DriftRun, DriftSettings, Encoder
from pipeline.simulate.imperfections import EncoderErrors

Command = Callable[..., Completed]
ARCSEC = np.deg2rad(1 / 3600)
DEGREES = Encoder(unit="deg")


def simulated(path: Path, scheme: Scheme, *, hours: float = 12.0, **settings: object) -> Path:
    """A sound run, as a text file with its plan."""
    defaults: dict[str, object] = {"interval": 60.0, "errors": EncoderErrors(white_noise=ARCSEC)}
    start = settings.pop("start_angles", (0.05, -0.02))
    run = DriftRun(scheme=scheme, start=start, duration=hours * 3600)  # type: ignore[arg-type]
    drift = (0.01, -0.004, 0.003, 0.002, 0.005, -0.001)
    simulate_drift(DriftSettings(m=drift, runs=(run,), **(defaults | settings))).write(path)  # type: ignore[arg-type]
    return path


def replaced(plan: Path, old: str, new: str) -> None:
    text = plan.read_text()
    assert old in text
    plan.write_text(text.replace(old, new))


def refused(command: Command, recording: Path, code: int, *words: str) -> None:
    done = command("run", recording, "--out", recording.parent / "out")
    assert done.returncode == code, done.stderr + done.stdout
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("gyrostand: ")
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize("scheme", ["polar", "equatorial", "horizontal", "vertical"])
def test_degrees_declared_as_radians(gyrostand: Command, tmp_path: Path, scheme: Scheme) -> None:
    recording = simulated(tmp_path / "run.csv", scheme, encoder=DEGREES)
    replaced(recording.with_suffix(".toml"), 'unit = "deg"', 'unit = "rad"')
    words = ("alpha1.unit", "15.041 deg/h", "if the numbers are degrees where radians are stated")
    refused(gyrostand, recording, 2, *words)


def test_radians_declared_as_degrees(gyrostand: Command, tmp_path: Path) -> None:
    recording = simulated(tmp_path / "run.csv", "vertical")
    replaced(recording.with_suffix(".toml"), 'unit = "rad"', 'unit = "deg"')
    refused(gyrostand, recording, 2, "if the numbers are radians where degrees are stated")


def test_too_short_says_how_long_would_do(gyrostand: Command, tmp_path: Path) -> None:
    recording = simulated(tmp_path / "run.csv", "vertical", hours=0.1, interval=10.0)
    refused(gyrostand, recording, 1, "a record long enough", "h would do, found 0.1 h")


def test_servo_lost(gyrostand: Command, tmp_path: Path) -> None:
    jump = (20_000.0, np.deg2rad(0.5), np.deg2rad(0.1))
    recording = simulated(tmp_path / "run.csv", "vertical", servo_jumps=(jump,))
    refused(gyrostand, recording, 1, "run 'run', 5.55", "found a jump of 0.49", 'resample.jumps = "split"')
    # as the line proposes: two arcs with initial angles of their own
    plan = recording.with_suffix(".toml")
    plan.write_text(plan.read_text() + '\n[resample]\njumps = "split"\n')
    done = gyrostand("run", recording, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "jump" in done.stdout


def test_inner_gimbal_passes_90_degrees(gyrostand: Command, tmp_path: Path) -> None:
    """A rotor that points along the outer axis after 4 h: behind it alpha2 goes on beyond a right angle."""
    recording = simulated(tmp_path / "run.csv", "horizontal", hours=8)
    head, *rows = recording.read_text().splitlines()
    t = np.array([float(row.split(",")[0]) for row in rows])
    turned = Rotation.from_rotvec(
        -np.outer((t - t.mean()) * RATE, Base.mounted("horizontal", np.deg2rad(55.75)).u)
    )
    axis = turned.apply([1.0, 0.0, 0.0])  # (sin alpha2, -sin alpha1 cos alpha2, cos alpha1 cos alpha2)
    behind = np.where(t > t.mean(), -1.0, 1.0)
    alpha2 = np.arctan2(axis[:, 0], behind * np.hypot(axis[:, 1], axis[:, 2]))
    alpha1 = np.unwrap(np.arctan2(-behind * axis[:, 1], behind * axis[:, 2]))
    lines = [f"{a:.9f},{b:.12f},{c:.12f}" for a, b, c in zip(t, alpha1, alpha2, strict=True)]
    recording.write_text("\n".join([head, *lines]) + "\n")
    refused(gyrostand, recording, 1, "alpha2", "90 deg")


@dataclass(frozen=True)
class Slip:
    """One slip of the pen in a plan, and the words that name it."""

    old: str
    new: str
    words: str


@pytest.mark.parametrize(
    "slip",
    [
        Slip('scheme = "vertical"', 'scheme = "horizontal"', "scheme vertical"),
        Slip("latitude_deg = 55.75", "latitude_deg = -55.75", "the other hemisphere"),
        Slip('"alpha1 (rad)", unit = "rad"', '"alpha1 (rad)", unit = "rad", sign = -1', "alpha1 negated"),
    ],
    ids=lambda slip: slip.words,
)
def test_a_plan_that_another_explains_better_fails_and_is_told(
    gyrostand: Command, tmp_path: Path, slip: Slip
) -> None:
    recording = simulated(tmp_path / "run.csv", "vertical")
    replaced(recording.with_suffix(".toml"), slip.old, slip.new)
    done = gyrostand("run", recording, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    line = next(line for line in done.stdout.splitlines() if "implausible Earth rate" in line)
    assert slip.words in line
