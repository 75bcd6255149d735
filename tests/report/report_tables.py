"""Tables of a coning run as its stages would leave them, made here from the formulas alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline import contracts, storage

START = 1_700_000_000_000_000_000
TREND = -0.0135  # rad/s, as in the paper's experiment
CONE, FREQUENCY = np.pi / 180, 100.0

HOSTILE = '<img src=x onerror="window.hacked=1"></script><script>window.hacked=2</script>$$\\frac{1}{2}$$'


def stamps(seconds: np.ndarray) -> np.ndarray:
    return START + np.round(seconds * 1e9).astype(np.int64)


def finding(kind: str, severity: str, start: float | None, end: float | None, **other: Any) -> dict[str, Any]:
    """A row of ``findings``; times in seconds from the record's start."""
    when = [None if t is None else START + round(t * 1e9) for t in (start, end)]
    row = {"stage": "audit", "stream": "gyro", "channel": None, "kind": kind, "severity": severity}
    return row | {"start": when[0], "end": when[1], "count": 1, "detail": f"about {kind}"} | other


def metric(name: str, channel: str, value: float | None, **other: Any) -> dict[str, Any]:
    """A row of ``metrics``, by default one without limits."""
    row = {"procedure": "coning", "stage": "score", "channel": channel, "name": name, "value": value}
    open_end = {"unit": "1", "standard_error": None, "lower_limit": None, "upper_limit": None}
    return row | open_end | {"verdict": "not evaluated"} | other


def from_rows(name: str, rows: list[dict[str, Any]]) -> pa.Table:
    return contracts.table(
        name, {c.name: [r[c.name] for r in rows] for c in contracts.contract(name).columns}
    )


def raw(name: str, seconds: np.ndarray, columns: Mapping[str, np.ndarray]) -> pa.Table:
    absent = {c: [None] * len(seconds) for c in contracts.contract(name).units}
    return contracts.table(name, {**absent, "time": stamps(seconds), **columns})


def rates(t: np.ndarray) -> dict[str, np.ndarray]:
    """The body rates of `angles`."""
    omega = 2 * np.pi * FREQUENCY
    return {
        "p": np.full_like(t, -2 * omega * (CONE / 2) ** 2),
        "q": -omega * CONE * np.sin(omega * t),
        "r": omega * CONE * np.cos(omega * t),
    }


def angles(t: np.ndarray) -> dict[str, np.ndarray]:
    """The coning motion (3.1) to the second order of the cone angle: enough for a picture."""
    half, phase = CONE / 2, 2 * np.pi * FREQUENCY * t
    return {
        "psi": 2 * half * np.cos(phase),
        "theta": 2 * half * np.sin(phase),
        "gamma": -(half**2) * np.sin(2 * phase),
    }


def make_tables(text: str = "") -> dict[str, pa.Table]:
    """The tables of a run of half a second; ``text`` is put into every text that a recording can bring."""
    slow, fast = np.arange(0, 0.5001, 1 / 400), np.arange(0, 0.50001, 1 / 10_000)
    motion = angles(fast)
    drifted = {**motion, "gamma": motion["gamma"] + TREND * fast}
    common = {"time": stamps(fast), "segment": np.zeros(len(fast), np.int32)}
    increments = {f"increment_{name}": value / 10_000 for name, value in rates(fast).items()}
    return {
        "gyro": raw("gyro", slow, rates(slow)),
        "reference": raw("reference", slow, angles(slow)),
        "rates": contracts.table("rates", {**common, **rates(fast), **increments}),
        "attitude": contracts.table("attitude", {**common, **drifted}),
        "attitude_corrected": contracts.table("attitude_corrected", {**common, **motion}),
        "trend": from_rows("trend", [trend_row()]),
        "findings": from_rows(
            "findings",
            [
                finding(f"jitter{text}", "info", 0.0, 0.5, detail=f"all along{text}"),
                finding("gap", "error", 0.2, 0.25, stream=f"gyro{text}", channel=f"p{text}"),
                finding("clocks", "warning", None, None),
                finding("$$x^2$$", "info", 0.4, 0.4),  # a label that Bokeh would take for a formula
            ],
        ),
        "metrics": from_rows(
            "metrics",
            [
                metric(f"peak_error{text}", f"gamma{text}", 6.75e-3, unit=f"rad{text}"),
                metric("peak_error", "psi", 1e-6, unit="rad", upper_limit=1e-5, verdict="pass"),
            ],
        ),
        "provenance": provenance(text),
    }


def trend_row(**other: Any) -> dict[str, Any]:
    row = {c.name: None for c in contracts.contract("trend").columns}
    known = {"segment": 0, "channel": "gamma", "method": "extremes", "origin": START, "a": TREND, "b": 0.0}
    return row | known | {"a_standard_error": 5e-5, "frequency": FREQUENCY} | other


def provenance(text: str = "", tables: str = "{}") -> pa.Table:
    row = {
        "order": 0,
        "procedure": "coning",
        "stage": "ingest",
        "settings": json.dumps({"topic": f"/gyro{text}"}),
        "recording_name": f"run 7{text}.mcap",
        "recording_sha256": "ab" * 32,
        "recording_bytes": 123_456,
        "plan_sha256": "cd" * 32,
        "calibration_name": f"gyro 7{text}.calibration.json",
        "calibration_sha256": "ef" * 32,
        "calibration_recording": "table",
        "calibration_recording_sha256": "12" * 32,
        "versions": json.dumps({"gyrostand": "0.1.0"}),
        "duration": 0.1,
        "peak_memory": 10**8,
        "tables": tables,
    }
    return from_rows("provenance", [row])


def publish(out: Path, recording_id: str, tables: Mapping[str, pa.Table], text: str = "") -> None:
    """Publish tables as a run does."""
    with storage.publication(out, recording_id) as door:
        files = {name: door.publish(name, t) for name, t in tables.items() if name != "provenance"}
        named = {name: {"rows": file.rows, "sha256": file.sha256} for name, file in files.items()}
        door.finish(provenance(text, json.dumps(named)))
