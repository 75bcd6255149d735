"""Recordings that cannot be navigated, or hardly, through the real command: one clear line, or a finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from in_process import Completed

from pipeline.simulate.navigation import simulate_navigation
from pipeline.simulate.navigation_scenarios import CRUISE, scenario
from pipeline.simulate.recording import START

Command = Callable[..., Completed]


def simulated(path: Path, name: str = "run.csv", **changed: Any) -> Path:
    """Twenty seconds of cruise with every aid, as a text file with its plan; all methods."""
    settings = scenario("diff", flight=replace(CRUISE, duration=20.0), outages=())
    record = simulate_navigation(replace(settings, rate=50.0, truth_rate=10.0, **changed), 1)
    return record.write(path / name)[0]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return simulated(tmp_path)


def replaced(recording: Path, *pairs: tuple[str, str]) -> None:
    """The plan with other words."""
    plan = recording.with_suffix(".toml")
    text = plan.read_text()
    for old, new in pairs:
        assert old in text, text
        text = text.replace(old, new)
    plan.write_text(text)


def edited(recording: Path, edit: Callable[[list[str], list[list[str]]], None]) -> None:
    """The text file with other cells: the edit is given its head and its rows."""
    head, *rows = recording.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    edit(head.split(","), cells)
    recording.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")


def column(head: list[str], begins: str) -> int:
    return next(k for k, name in enumerate(head) if name.startswith(begins))


def run(command: Command, recording: Path) -> Completed:
    done = command("run", recording, "--out", recording.parent / "out")
    assert "Traceback" not in done.stderr + done.stdout
    return done


def refused(command: Command, recording: Path, code: int, *words: str) -> None:
    done = run(command, recording)
    assert done.returncode == code, done.stderr + done.stdout
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("gyrostand: ")
    for word in words:
        assert word in done.stderr


def findings(recording: Path) -> list[dict[str, Any]]:
    file = recording.parent / "out" / "findings" / "recording=run" / "part-0.parquet"
    return list(pq.ParquetFile(file).read().to_pylist())


def test_a_sound_record_passes(command: Command, recording: Path) -> None:
    done = run(command, recording)
    assert done.returncode == 0, done.stderr + done.stdout
    assert [f for f in findings(recording) if f["severity"] == "error"] == []
    checked = command("check", recording.parent / "out")
    assert checked.returncode == 0, checked.stderr + checked.stdout


def test_latitude_and_longitude_exchanged(command: Command, recording: Path) -> None:
    """Exit 1 by an error of the audit, which names the exchange; nothing is lost."""
    replaced(
        recording,
        ('channels.latitude = { field = "gnss_position_latitude', 'channels.latitude = { field = "X'),
        ('channels.longitude = { field = "gnss_position_longitude', 'channels.latitude_ = { field = "Y'),
        ('"X', '"gnss_position_longitude'),
        ("channels.latitude_", "channels.longitude"),
        ('"Y', '"gnss_position_latitude'),
    )
    done = run(command, recording)
    assert done.returncode == 1
    line = next(line for line in done.stdout.splitlines() if "implausible position" in line)
    assert "latitude and longitude exchanged?" in line
    assert "m/s" in line
    assert "start contradicted" in done.stdout
    assert command("validate", recording).returncode == 1


def test_a_magnetometer_of_unknown_unit(command: Command, recording: Path) -> None:
    words = (
        "magnetometer.channels.x.unit",
        "not filled in",
        "known units of magnetic flux density: T, mT, uT",
    )
    plan = recording.with_suffix(".toml")
    text = plan.read_text()
    for axis in "xyz":
        text = text.replace(
            f'{{ field = "magnetometer_{axis} (T)", unit = "T" }}',
            f'{{ field = "magnetometer_{axis} (T)", unit = "" }}',
        )
    plan.write_text(text)
    done = run(command, recording)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 3  # one a channel
    for word in words:
        assert word in done.stderr.splitlines()[0]


def test_a_magnetometer_in_the_wrong_unit(command: Command, recording: Path) -> None:
    plan = recording.with_suffix(".toml")
    text = plan.read_text()
    for axis in "xyz":
        text = text.replace(
            f'"magnetometer_{axis} (T)", unit = "T"', f'"magnetometer_{axis} (T)", unit = "G"'
        )
    plan.write_text(text)
    done = run(command, recording)
    assert done.returncode == 1
    line = next(line for line in done.stdout.splitlines() if "implausible unit" in line)
    assert "0.005" in line
    assert "the Earth's is 20 to 70 uT" in line


def test_a_magnetometer_without_the_earth_s_field(command: Command, recording: Path) -> None:
    plan = recording.with_suffix(".toml")
    text = plan.read_text()
    start = text.index("[navigate.earth_field]")
    end = text.find("\n[", start)
    plan.write_text(text[:start] + (text[end + 1 :] if end >= 0 else ""))
    refused(command, recording, 2, "navigate.earth_field", "add [navigate.earth_field]")


def test_time_bases_that_do_not_overlap(command: Command, recording: Path) -> None:
    """A receiver that counts from its own start, in a column of its own."""
    head, *rows = recording.read_text().splitlines()
    names = head.split(",")
    latitude = column(names, "gnss_position_latitude")
    stamped = []
    for row in rows:
        has = row.split(",")[latitude] != ""
        stamped.append(f"{row},{len(stamped) * 0.02 + 5000.0:.6f}" if has else f"{row},")
    recording.write_text("\n".join([f"{head},tow", *stamped]) + "\n")
    replaced(
        recording,
        ("[streams.gnss_position]\n", '[streams.gnss_position]\ntime = { field = "tow", unit = "s" }\n'),
    )
    refused(
        command,
        recording,
        1,
        "streams 'gyro' and 'gnss_position'",
        "stamps that overlap",
        "5000.000 to 50",
        " and ",
    )
    done = command("validate", recording)
    assert done.returncode == 1
    assert "no common time" in done.stdout
    # what the receiver's clock is behind, stated, makes one time of both
    replaced(
        recording,
        ("[streams.gnss_position]\n", f"[streams.gnss_position]\ndelay_s = {5000.0 - START / 1e9}\n"),
    )
    assert run(command, recording).returncode == 0


def test_aiding_that_is_never_valid(command: Command, recording: Path) -> None:
    """Every method goes on without it, and it is said."""

    def without(head: list[str], rows: list[list[str]]) -> None:
        place = column(head, "gnss_position_height")
        for row in rows:
            if row[place]:
                row[place] = "nan"

    edited(recording, without)
    done = run(command, recording)
    said = [f for f in findings(recording) if f["kind"] == "never valid"]
    assert [f["stream"] for f in said] == ["gnss_position"]
    assert "never valid" in done.stdout
    # A channel without any value is an error of the audit; the methods have navigated by the rest.
    assert done.returncode == 1
    file = recording.parent / "out" / "navigation" / "recording=run" / "part-0.parquet"
    table = pq.ParquetFile(file).read()
    assert set(table["method"].to_pylist()) == {"strapdown", "loops", "filter", "smoother"}


def test_bursts_of_nan_are_coasted_over_and_counted(command: Command, recording: Path) -> None:
    def burst(head: list[str], rows: list[list[str]]) -> None:
        place = column(head, "gyro_q")
        inertial = [row for row in rows if row[place]]
        for row in [*inertial[200:210], *inertial[500:520]]:
            row[place] = "nan"

    edited(recording, burst)
    done = run(command, recording)
    assert done.returncode == 0, done.stderr + done.stdout
    said = {f["kind"]: f for f in findings(recording) if f["stream"] == "gyro"}
    assert said["coasted"]["count"] == 32  # samples that lack, and one more step for each burst
    assert sum(f["count"] for f in findings(recording) if f["kind"] == "NaN") == 30


def test_a_pole(command: Command, recording: Path) -> None:
    """The start of the plan, degrees from the pole."""
    plan = recording.with_suffix(".toml")
    lines = plan.read_text().splitlines()
    lines = ["latitude_deg = 89.99" if line.startswith("latitude_deg") else line for line in lines]
    plan.write_text("\n".join(lines) + "\n")
    refused(
        command, recording, 1, "latitude at the start", "found 89.99 deg", "north and east have no meaning"
    )


def test_gains_that_are_not_stable(command: Command, recording: Path) -> None:
    plan = recording.with_suffix(".toml")
    gains = "{ T_s = 3.0, T_V_s = 3.0, k_L = 3.0, k_V = 3.0, K = 1.0, k_LV = 1.0, k_n = 1.4 }"
    text = plan.read_text()
    if "[navigate.loops]" in text:
        plan.write_text(text.replace("[navigate.loops]\n", f"[navigate.loops]\nsatellites = {gains}\n"))
    else:
        plan.write_text(f"{text}\n[navigate.loops]\nsatellites = {gains}\n")
    refused(command, recording, 2, "gains, velocity by satellites", "k_n < 1.33333 1/s (Routh)", "found 1.4")


def test_no_attitude_to_start_from(command: Command, recording: Path) -> None:
    replaced(recording, ('start_attitude = "plan"\n', ""), ("yaw_deg", "# yaw_deg"))
    refused(command, recording, 2, "navigate.start_attitude", "levelled", "external_attitude")


def test_a_recording_that_breaks_off_is_navigated_as_far_as_it_goes(command: Command, tmp_path: Path) -> None:
    recording = simulated(tmp_path, "run.mcap")
    content = recording.read_bytes()
    recording.write_bytes(content[: len(content) * 9 // 10])
    done = run(command, recording)
    assert done.returncode == 0, done.stderr + done.stdout
    assert "loss" in done.stdout
    assert any(f["kind"] == "loss" for f in findings(recording))
    file = recording.parent / "out" / "navigation" / "recording=run" / "part-0.parquet"
    assert np.isfinite(pq.ParquetFile(file).read()["latitude"].to_numpy()).all()
