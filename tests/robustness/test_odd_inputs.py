"""Odd but sound recordings give the attitude of the motion; wrong ones are told, and never pass.

The truth is a motion of three sinusoids in the Euler-Krylov angles, with its rates by the inverse of (1.1),
written down here and not by the project's own models::

    p = gamma' + psi' sin theta
    q = psi' cos theta cos gamma + theta' sin gamma
    r = theta' cos gamma - psi' cos theta sin gamma
"""

from __future__ import annotations

import gzip
import json
import shutil
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from mcap.writer import Writer
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from pipeline import formats, runner
from pipeline.errors import ExitCode, GyrostandError

Float = NDArray[np.float64]

RATE = 200
CLOSE = 2e-8
"""Peak error [rad]. At 200 Hz the quintic spline of this motion (products of its sinusoids up to 4 Hz,
2 pi f h = 0.13) leaves 4e-9 at the record's ends; the rest is margin for twelve digits of text."""

START = 1_767_225_600
NAMES = ("t", "p", "q", "r", "psi", "theta", "gamma")

AMPLITUDE = np.array([0.20, 0.15, 0.25])
OMEGA = 2 * np.pi * np.array([1.3, 2.1, 0.7])
PHASE = np.array([0.3, 1.0, 0.0])


def angles(t: Float) -> Float:
    return AMPLITUDE * np.sin(np.multiply.outer(t, OMEGA) + PHASE)


def rates(t: Float) -> Float:
    _, theta, gamma = np.moveaxis(angles(t), -1, 0)
    d_psi, d_theta, d_gamma = np.moveaxis(
        AMPLITUDE * OMEGA * np.cos(np.multiply.outer(t, OMEGA) + PHASE), -1, 0
    )
    p = d_gamma + d_psi * np.sin(theta)
    q = d_psi * np.cos(theta) * np.cos(gamma) + d_theta * np.sin(gamma)
    r = d_theta * np.cos(gamma) - d_psi * np.cos(theta) * np.sin(gamma)
    return np.stack([p, q, r], axis=-1)


def increments(t: Float) -> Float:
    """Integral of the rates over the sample interval that ends at t, by Gauss-Legendre of eight points."""
    half = 0.5 / RATE
    nodes, weights = leggauss(8)
    terms = [weight * rates(t - half + half * node) for node, weight in zip(nodes, weights, strict=True)]
    return half * np.sum(terms, axis=0)


T = np.arange(5 * RATE) / RATE


def plan(
    time: str = 'field = "t"\nunit = "s"',
    *,
    unit: str = "rad/s",
    quantity: str = "angular_rate",
    fields: Sequence[str] = NAMES[1:],
    topics: tuple[str, str] = ("", ""),
    more: str = "",
) -> str:
    """A plan for the motion: a quintic spline, no trend taken out."""

    def channels(names: Sequence[str], of: Sequence[str], in_unit: str) -> str:
        return "".join(
            f"channels.{name} = {{ field = {json.dumps(field)}, unit = {json.dumps(in_unit)} }}\n"
            for name, field in zip(names, of, strict=True)
        )

    return (
        f'procedure = "coning"\n[time]\n{time}\n'
        f'[streams.gyro]\ntopic = {json.dumps(topics[0])}\nquantity = "{quantity}"\n'
        + channels(NAMES[1:4], fields[:3], unit)
        + f'[streams.reference]\ntopic = {json.dumps(topics[1])}\nquantity = "euler_krylov"\n'
        + channels(NAMES[4:], fields[3:], "rad")
        + '[interpolate]\nmethod = "spline"\ndegree = 5\n[detrend]\nmethod = "none"\n'
        + more
    )


def table(
    gyro_time: Float,
    gyro: Float,
    reference_time: Float,
    reference: Float,
) -> str:
    """CSV with a row a sample of either stream, the reference's rows last."""
    lines = [",".join(NAMES)]
    lines += [f"{t:.9f},{p!r},{q!r},{r!r},,," for t, (p, q, r) in zip(gyro_time, gyro.tolist(), strict=True)]
    lines += [
        f"{t:.9f},,,,{psi!r},{theta!r},{gamma!r}"
        for t, (psi, theta, gamma) in zip(reference_time, reference.tolist(), strict=True)
    ]
    return "\n".join(lines) + "\n"


def process(
    folder: Path, content: str | bytes, test_plan: str, name: str = "run.csv"
) -> tuple[runner.Outcome, dict[tuple[str, str], float]]:
    """Run a recording of this content; the outcome and its figures."""
    recording = folder / name
    recording.write_bytes(content.encode() if isinstance(content, str) else content)
    (folder / "run.toml").write_text(test_plan, encoding="utf-8")
    return process_file(recording, folder)


def process_file(recording: Path, folder: Path) -> tuple[runner.Outcome, dict[tuple[str, str], float]]:
    outcome = runner.run(recording, folder / "out", folder / "run.toml")
    return outcome, {(m["channel"], m["name"]): m["value"] for m in outcome.metrics.to_pylist()}


def peak(figures: dict[tuple[str, str], float]) -> float:
    return max(figures[angle, "peak_error"] for angle in NAMES[4:])


def kinds(outcome: runner.Outcome, stream: str) -> list[str]:
    return [f["kind"] for f in outcome.findings.to_pylist() if f["stream"] == stream]


def rows(delimiter: str = ",", decimal: str = ".", end: str = "\n", first: Callable[[int], str] = str) -> str:
    """The rows of gyro and reference at common times; `first` writes the time of a sample by its number."""
    values = np.hstack([rates(T), angles(T)])
    text = [delimiter.join([first(k), *(f"{x:.12g}" for x in row)]) for k, row in enumerate(values)]
    return end.join(line.replace(".", decimal) for line in text) + end


def seconds(k: int) -> str:
    return f"{k / RATE:.6f}"


HEADER = ",".join(NAMES)
NANOSECONDS = plan('field = "t"\nunit = "ns"')
NO_HEADER = plan(more=f"[text]\nheader = false\ncolumns = {json.dumps(NAMES)}\n")
LAYOUTS: dict[str, tuple[str | bytes, str]] = {
    "semicolons and decimal commas": (
        HEADER.replace(",", ";") + "\n" + rows(";", ",", first=seconds),
        plan(),
    ),
    "tabs and decimal commas": (HEADER.replace(",", "\t") + "\n" + rows("\t", ",", first=seconds), plan()),
    "row of units": (HEADER + "\ns,rad/s,rad/s,rad/s,rad,rad,rad\n" + rows(first=seconds), plan()),
    "no header": (rows(first=seconds), NO_HEADER),
    "no time": (HEADER + "\n" + rows(first=lambda k: "0"), plan(f"rate = {RATE}")),
    "nanoseconds of Unix time": (
        HEADER + "\n" + rows(first=lambda k: str(START * 10**9 + k * 5_000_000)),
        NANOSECONDS,
    ),
    "decimal seconds of Unix time": (
        HEADER + "\n" + rows(first=lambda k: f"{START + k // RATE}.{k % RATE * 5_000_000:09d}"),
        plan(),
    ),
    "byte order mark and CRLF": (
        "\ufeff" + HEADER + "\r\n" + rows(end="\r\n", first=seconds),
        plan(),
    ),
    "CR alone": (HEADER + "\r" + rows(end="\r", first=seconds), plan()),
    "UTF-16": (("\ufeff" + HEADER + "\n" + rows(first=seconds)).encode("utf-16-le"), plan()),
    "Latin-1": (
        (HEADER.replace("p,", "über (rad/s),", 1) + "\n" + rows(first=seconds)).encode("latin-1"),
        plan(fields=("über", *NAMES[2:])),
    ),
    "delimiter in a quoted name": (
        HEADER.replace("p,", '"p, raw",', 1) + "\n" + rows(first=seconds),
        plan(fields=("p, raw", *NAMES[2:])),
    ),
    "trailing delimiters": (HEADER + "\n" + rows(end=",\n", first=seconds), plan()),
    "comments and preamble": (
        "Stand 3; by X, Y\n# a comment\n\n" + HEADER + "\n" + rows(end="\n# again\n", first=seconds),
        plan(),
    ),
    "blank lines": (HEADER + "\n" + rows(end="\n\n", first=seconds), plan()),
    "gzip of two members": (
        gzip.compress(f"{HEADER}\n".encode()) + gzip.compress(rows(first=seconds).encode()),
        plan(),
    ),
    "zstandard": (
        pa.compress(f"{HEADER}\n{rows(first=seconds)}".encode(), codec="zstd", asbytes=True),
        plan(),
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_any_layout_of_a_text_file_gives_the_same_attitude(layout: str, tmp_path: Path) -> None:
    outcome, figures = process(tmp_path, *LAYOUTS[layout])
    assert outcome.verdict == "pass"
    assert outcome.errors == 0
    assert figures["gyro", "sample_count"] == len(T)
    assert peak(figures) < CLOSE


@pytest.mark.parametrize("method", ["quaternion", "euler_krylov"])
def test_increments_give_the_attitude_that_rates_give(method: str, tmp_path: Path) -> None:
    more = f'[integrate]\nmethod = "{method}"\n'
    _, figures = process(tmp_path, table(T, rates(T), T, angles(T)), plan(more=more))
    assert peak(figures) < CLOSE
    of_increments = plan(unit="rad", quantity="angle_increment", more=more)
    _, figures = process(tmp_path, table(T, increments(T), T, angles(T)), of_increments)
    assert peak(figures) < CLOSE


@pytest.mark.parametrize(
    ("quantity", "unit", "factor"),
    [
        ("angular_rate", "rad/s", 180 / np.pi),
        ("angular_rate", "deg/s", 1.0),
        ("angle_increment", "rad", 180 / np.pi),
        ("angle_increment", "deg", 1.0),
    ],
)
def test_degrees_for_radians_fail_the_recording(
    quantity: str, unit: str, factor: float, tmp_path: Path
) -> None:
    gyro = rates(T) if quantity == "angular_rate" else increments(T)
    outcome, _ = process(tmp_path, table(T, factor * gyro, T, angles(T)), plan(unit=unit, quantity=quantity))
    assert outcome.verdict == "fail"
    assert any("implausible unit" in kinds(outcome, stream) for stream in ("gyro", "gyro_increments"))


def test_a_late_reference_and_a_turned_case_are_taken_out(tmp_path: Path) -> None:
    turned = rates(T)[:, [2, 0, 1]]  # a cyclic permutation of the axes is a rotation
    more = "[align]\nclock_offset = true\nmax_offset = 0.1\nmounting_rotation = true\n"
    outcome, figures = process(tmp_path, table(T, turned, T, angles(T - 0.02)), plan(more=more))
    offset = next(
        m for m in outcome.metrics.to_pylist() if (m["stage"], m["name"]) == ("align", "clock_offset")
    )
    assert offset["value"] == pytest.approx(-0.02, abs=1e-8)  # at 3 rad/s, what the peak error leaves it
    assert peak(figures) < CLOSE


@pytest.mark.parametrize(
    "reference_time",
    [T[200:600], T[200:], np.arange(45) / 10 + 0.05, np.arange(4) + 0.5],
    ids=["shorter", "late", "10 Hz", "1 Hz"],
)
def test_a_reference_of_its_own_times(reference_time: Float, tmp_path: Path) -> None:
    _, figures = process(tmp_path, table(T, rates(T), reference_time, angles(reference_time)), plan())
    assert figures["reference", "sample_count"] == len(reference_time)
    assert peak(figures) < 5 * CLOSE  # between samples the attitude is a local cubic: another 2e-8


def test_each_piece_of_a_record_in_pieces_is_right(tmp_path: Path) -> None:
    gyro, kept = rates(T), np.ones(len(T), dtype=np.bool_)
    gyro[200:210] = np.nan
    gyro[210, 1] = np.inf
    for start, stop in ((400, 420), (600, 700), (800, 850)):
        kept[start:stop] = False
    outcome, figures = process(tmp_path, table(T[kept], gyro[kept], T, angles(T)), plan())
    assert figures["gyro", "gap_count"] == 3
    assert figures["gyro", "nan_count"] == 11
    assert kinds(outcome, "gyro").count("gap") == 3 + 4  # as found by the audit, and as split
    assert peak(figures) < CLOSE


def test_a_lost_increment_splits_the_record(tmp_path: Path) -> None:
    kept = np.arange(len(T)) != 500
    content = table(T[kept], increments(T)[kept], T, angles(T))
    outcome, figures = process(tmp_path, content, plan(unit="rad", quantity="angle_increment"))
    assert figures["gyro_increments", "lost_count"] == 1
    assert "gap" in kinds(outcome, "gyro_increments")
    assert peak(figures) < CLOSE


def test_a_clock_that_jumps_back_an_hour_and_repeats_itself(tmp_path: Path) -> None:
    time = T + 7200
    time[500:502] -= 3600
    time[700] = time[699]
    outcome, figures = process(tmp_path, table(time, rates(T), T + 7200, angles(T)), plan())
    assert figures["gyro", "backward_stamp_count"] == 2
    assert figures["gyro", "repeated_stamp_count"] == 1
    assert {"backward stamp", "repeated stamp"} <= set(kinds(outcome, "gyro"))
    assert peak(figures) < CLOSE


@pytest.mark.parametrize(
    ("gyro_time", "gyro", "reference_time"),
    [
        (0 * T, rates(T), T),
        (T[::-1], rates(T), T),
        (T, np.full((len(T), 3), np.inf), T),
        (T[:1], rates(T[:1]), T),
        (T, rates(T), T + 100),
    ],
    ids=["one stamp", "backward", "infinite", "one sample", "no common time"],
)
def test_what_nothing_can_be_made_of_is_refused(
    gyro_time: Float, gyro: Float, reference_time: Float, tmp_path: Path
) -> None:
    with pytest.raises(GyrostandError) as refused:
        process(tmp_path, table(gyro_time, gyro, reference_time, angles(T)), plan())
    assert refused.value.exit_code == ExitCode.INPUT
    assert "\n" not in str(refused.value)
    assert not list(tmp_path.glob("out/*/recording=*"))


def test_a_hostile_topic_of_json_messages(tmp_path: Path) -> None:
    topic = "<script>alert(1)</script>\n\"; $(touch pwned) `id` ' ../../x"
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = [writer.register_channel(name, "json", 0) for name in (topic, "/reference")]
        for k, (gyro, reference) in enumerate(zip(rates(T).tolist(), angles(T).tolist(), strict=True)):
            stamp = START * 10**9 + k * 5_000_000
            for channel, names, values in zip(
                channels, (NAMES[1:4], NAMES[4:]), (gyro, reference), strict=True
            ):
                data = json.dumps({"value": dict(zip(names, values, strict=True))}).encode()
                writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    fields = [f"value.{name}" for name in NAMES[1:]]
    test_plan = plan('clock = "log_time"', fields=fields, topics=(topic, "/reference"))
    (tmp_path / "run.toml").write_text(test_plan, encoding="utf-8")
    _, figures = process_file(tmp_path / "run.mcap", tmp_path)
    assert peak(figures) < CLOSE
    assert {p.name for p in tmp_path.iterdir()} == {"run.mcap", "run.toml", "out"}


def test_a_bag_whose_recorder_was_killed_is_read_and_not_changed(tmp_path: Path) -> None:
    """Rows that stand in SQLite's log alone count; reading must not fold the log into the recording."""
    sample = Path(__file__).resolve().parents[2] / "sample_data/onset/onset.db3"
    shutil.copy(sample, tmp_path / "open.db3")
    connection = sqlite3.connect(tmp_path / "open.db3")
    connection.execute("pragma journal_mode = wal")
    connection.execute("pragma wal_autocheckpoint = 0")
    count = connection.execute("select count(*) from messages").fetchone()[0]
    connection.execute(
        "insert into messages (topic_id, timestamp, data) "
        "select topic_id, timestamp + 1, data from messages limit 50"
    )
    connection.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in ("open.db3", "open.db3-wal"):
        shutil.copy(tmp_path / file, killed / file)
    connection.close()
    before = {p.name: p.read_bytes() for p in killed.iterdir()}
    inspection = formats.inspect(killed / "open.db3")
    assert sum(topic.count for topic in inspection.topics) == count + 50
    assert {p.name: p.read_bytes() for p in killed.iterdir()} == before
