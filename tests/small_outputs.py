"""A small recording's tables in two versions, and a run that publishes them: for the tests of storage."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa

from pipeline import contracts, storage

START = 1_700_000_000_000_000_001  # odd: a float64 cannot hold it
IDENTITY = {"recording_name": "run7.mcap", "recording_sha256": "ab" * 32}


def tables(version: int, samples: int = 500) -> dict[str, pa.Table]:
    """Tables as a run leaves them; version 2 has ``trend`` in place of version 1's ``reference``."""
    rng = np.random.default_rng(version)
    time = START + 2_500_000 * np.arange(samples)
    clocks = {
        "time": time,
        "header_stamp": [None, *time[1:].tolist()],
        "log_time": [None] * samples,
        "publish_time": [None] * samples,
    }
    noise = rng.standard_normal((3, samples))
    rates = dict(zip("pqr", noise, strict=True))
    made = {
        "gyro": contracts.table("gyro", {**clocks, "run": [None] * samples, **rates}),
        "metrics": contracts.table("metrics", _metrics(float(version))),
        "findings": contracts.table("findings", {c: [] for c in contracts.contract("findings").units}),
    }
    if version == 1:
        angles = dict(zip(("psi", "theta", "gamma"), noise, strict=True))
        made["reference"] = contracts.table("reference", {**clocks, **angles})
    else:
        made["trend"] = contracts.table("trend", _trend())
    return made


def publish(
    out: Path, recording_id: str, version: int = 1, samples: int = 500
) -> dict[str, storage.Published]:
    """Publish a version of a recording as the runner does."""
    with storage.publication(out, recording_id) as publication:
        named = {n: publication.publish(n, t) for n, t in tables(version, samples).items()}
        publication.finish(provenance(named))
    return named


def provenance(named: Mapping[str, storage.Published]) -> pa.Table:
    """Provenance of one stage that made every table."""
    files = {name: {"rows": p.rows, "sha256": p.sha256} for name, p in sorted(named.items())}
    values: dict[str, object] = {
        **IDENTITY,
        "order": 0,
        "procedure": "coning",
        "stage": "ingest",
        "settings": "{}",
        "recording_bytes": 1000,
        "plan_sha256": "cd" * 32,
        **{c.name: None for c in contracts.contract("provenance").columns if c.nullable},
        "versions": "{}",
        "duration": 0.25,
        "peak_memory": 1 << 20,
        "tables": json.dumps(files),
    }
    return contracts.table("provenance", {name: [value] for name, value in values.items()})


def files(out: Path) -> dict[str, bytes]:
    """Every file among the tables, hidden or not, with its bytes."""
    return {
        str(p.relative_to(out)): p.read_bytes()
        for p in sorted(out.rglob("*"))
        if p.is_file() and p.relative_to(out).parts[0] != ".publishing"
    }


def _metrics(value: float) -> dict[str, list[object]]:
    row = {
        "procedure": "coning",
        "stage": "score",
        "channel": "gamma",
        "name": "peak_error",
        "value": value,
        "unit": "rad",
        "standard_error": None,
        "lower_limit": None,
        "upper_limit": 3.0,
        "verdict": "pass",
    }
    return {key: [v] for key, v in row.items()}


def _trend() -> dict[str, list[object]]:
    row: dict[str, list[object]] = {c: [None] for c in contracts.contract("trend").units}
    known = {"segment": 0, "channel": "gamma", "method": "extremes", "origin": START, "a": -0.0135, "b": 1e-5}
    return row | {key: [value] for key, value in known.items()}
