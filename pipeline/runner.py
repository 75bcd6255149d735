"""One recording through its procedure: skip what is up to date, judge, publish, record provenance."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline import __version__, formats, limits, storage, verdicts
from pipeline.errors import ExitCode
from pipeline.procedures import PROCEDURES
from pipeline.stages._calibration_file import read as read_calibration
from pipeline.stages.base import ACCUMULATING, Stage, StageError, rows
from pipeline.testplan import TestPlan, find_plan, load_plan

Progress = Callable[[str, int, int], None]
"""Told the stage that begins, its place from 0, and how many there are."""

VALIDATION = ("ingest", "audit")
"""The stages that say whether a recording is fit to be processed."""

CALIBRATED = (
    "calibration_name",
    "calibration_sha256",
    "calibration_recording",
    "calibration_recording_sha256",
)
"""What provenance says of the calibration that was applied, and of the recording that it came from."""

_COMPUTING = ("numpy", "scipy", "pyarrow", "numba", "mcap", "rosbags")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one recording.

    ``errors`` counts the findings of that severity, among them every part of the recording that could not
    be read; ``up_to_date`` says that nothing had to be done.
    """

    recording_id: str
    procedure: str
    metrics: pa.Table
    findings: pa.Table
    verdict: verdicts.Verdict
    errors: int
    up_to_date: bool = False


def run(
    recording: Path,
    out: Path,
    plan: Path | None = None,
    recording_id: str | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Take a recording through its procedure and publish its tables.

    Parameters
    ----------
    recording : Path
        A file or a rosbag2 folder; it is never changed.
    out : Path
        Output folder; tables go to ``out/<table>/recording=<id>/part-0.parquet``.
    plan : Path, optional
        The test plan; by default the one beside the recording, see `testplan.find_plan`.
    recording_id : str, optional
        By default made from the recording's name, see `storage.recording_id`.
    progress : callable, optional
        Told each stage as it begins.

    Returns
    -------
    Outcome
        Metrics with verdicts, and findings.

    Raises
    ------
    GyrostandError
        With the exit code that fits: test plan, recording, a stage's refusal, the output folder.
    """
    formats.detect(recording)
    _require_outside(out, recording)
    test_plan = load_plan(plan or find_plan(recording))
    further = test_plan.further_recordings(recording)
    for other in further:
        _require_outside(out, other)
        formats.detect(other)
    calibration = test_plan.calibration(recording)
    digest, size = fingerprint(recording, *further)
    name = recording_id or storage.recording_id(recording)
    stages = PROCEDURES[test_plan.procedure]
    versions = _versions()
    identity = {
        "procedure": test_plan.procedure,
        "recording_name": recording.name,
        "recording_sha256": digest,
        "recording_bytes": size,
        "plan_sha256": test_plan.sha256,
        **_said_of_calibration(calibration),
        "versions": json.dumps(versions, sort_keys=True),
    }
    with storage.publication(out, name) as publication:
        if publication.is_current(identity):
            return _outcome(
                name,
                test_plan.procedure,
                publication.read("metrics"),
                publication.read("findings"),
                up_to_date=True,
            )
        tables, log = _run_stages(recording, test_plan, stages, progress)
        tables["metrics"] = limits.judge(tables["metrics"], test_plan.limits, test_plan.procedure)
        published = {table: publication.publish(table, tables[table]) for table in sorted(tables)}
        publication.finish(_provenance(log, published, identity))
    return _outcome(name, test_plan.procedure, tables["metrics"], tables["findings"])


def validate(recording: Path, plan: Path | None = None, progress: Progress | None = None) -> Outcome:
    """Audit a recording and judge the limits that the audit can judge; nothing is written.

    Parameters and errors as in `run`.
    """
    formats.detect(recording)
    test_plan = load_plan(plan or find_plan(recording))
    test_plan.calibration(recording)
    tables, _ = _run_stages(recording, test_plan, VALIDATION, progress)
    left = [stage for stage in PROCEDURES[test_plan.procedure] if stage not in VALIDATION]
    pending = {name for stage in left for name in import_module(f"pipeline.stages.{stage}").METRICS}
    metrics = limits.judge(tables["metrics"], test_plan.limits, test_plan.procedure, pending)
    return _outcome(storage.recording_id(recording), test_plan.procedure, metrics, tables["findings"])


def outcomes(out: Path) -> list[Outcome]:
    """What became of every finished recording below an output folder, from its published tables.

    Raises
    ------
    StorageError
        If there is none, or a table is damaged.
    """
    found = []
    for name in storage.recordings(out):
        procedure = str(storage.read(out, name, "provenance").column("procedure")[0])
        metrics, findings = storage.read(out, name, "metrics"), storage.read(out, name, "findings")
        found.append(_outcome(name, procedure, metrics, findings))
    return found


def fingerprint(recording: Path, *further: Path) -> tuple[str, int]:
    """SHA-256 and size [byte] of a recording; of a folder, over the names and bytes of its files.

    Of a recording with further ones, over the names and the fingerprints of them all.
    """
    if further:
        each = [(path.name, *fingerprint(path)) for path in (recording, *further)]
        names = "".join(f"{name}\0{digest}\n" for name, digest, _ in each)
        return hashlib.sha256(os.fsencode(names)).hexdigest(), sum(size for *_, size in each)
    if not recording.is_dir():
        return _file_sha256(recording), recording.stat().st_size
    whole, size = hashlib.sha256(), 0
    for path in sorted(p for p in recording.rglob("*") if p.is_file()):
        whole.update(f"{path.relative_to(recording)}\0{_file_sha256(path)}\n".encode())
        size += path.stat().st_size
    return whole.hexdigest(), size


@cache
def code_fingerprint() -> str:
    """SHA-256 over the package's own source, so that a changed checkout is not taken for the old one."""
    whole = hashlib.sha256()
    package = Path(__file__).parent
    for path in sorted(
        [*package.rglob("*.py"), *package.rglob("*.json"), *package.parent.glob("schemas/*.json")]
    ):
        whole.update(path.name.encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()


def _said_of_calibration(path: Path | None) -> dict[str, str | None]:
    """What provenance says of the calibration by which the gyro is corrected; nulls where there is none."""
    if path is None:
        return dict.fromkeys(CALIBRATED)
    source = read_calibration(path)
    said = (path.name, _file_sha256(path), source.recording, source.recording_sha256)
    return dict(zip(CALIBRATED, said, strict=True))


def _require_outside(out: Path, recording: Path) -> None:
    """A recording is never changed: a rosbag2 folder does not take its own tables."""
    if recording.is_dir() and out.resolve().is_relative_to(recording.resolve()):
        raise storage.StorageError(
            repr(str(out)),
            expected="an output folder outside the recording",
            found=f"one inside {str(recording)!r}",
            remedy="choose another --out",
            exit_code=ExitCode.USAGE,
        )


def _run_stages(
    recording: Path, plan: TestPlan, stages: Sequence[str], progress: Progress | None
) -> tuple[dict[str, pa.Table], list[dict[str, Any]]]:
    """Run the stages in order; give the tables and one provenance entry a stage."""
    tables: dict[str, pa.Table] = {name: rows(name, []) for name in ACCUMULATING}
    log: list[dict[str, Any]] = []
    for order, name in enumerate(stages):
        if progress is not None:
            progress(name, order, len(stages))
        begun = time.perf_counter()
        produced = _run_stage(name, recording, tables, plan)
        tables = _merge(tables, produced)
        log.append(
            {
                "order": order,
                "stage": name,
                "settings": plan.settings[name].model_dump_json(),
                "duration": time.perf_counter() - begun,
                "peak_memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
                "produced": tuple(produced),
            }
        )
    return tables, log


def _run_stage(
    name: str, recording: Path, tables: Mapping[str, pa.Table], plan: TestPlan
) -> dict[str, pa.Table]:
    module = import_module(f"pipeline.stages.{name}")
    settings = plan.settings[name]
    if name == "ingest":  # the one door: it alone gets the recording
        return dict(module.run(recording, settings, plan.stand))
    stage: Stage = module
    missing = [t for t in stage.CONSUMES if t not in tables]
    if missing:
        raise StageError(
            f"stage {name}",
            expected=f"table {missing[0]}",
            found="none: no stream of the test plan gives it",
            remedy=f"add the stream that {missing[0]} comes from to the test plan",
        )
    wanted = (*stage.CONSUMES, *stage.MAY_CONSUME)
    return stage.run({t: tables[t] for t in wanted if t in tables}, settings, plan.stand)


def _merge(tables: Mapping[str, pa.Table], produced: Mapping[str, pa.Table]) -> dict[str, pa.Table]:
    """Tables after a stage: its own replace those of the same name, but for the accumulating ones."""
    merged = {**tables, **produced}
    for name in ACCUMULATING:
        if name in produced:
            merged[name] = pa.concat_tables([tables[name], produced[name]])
    return merged


def _provenance(
    log: Sequence[dict[str, Any]],
    published: Mapping[str, storage.Published],
    identity: Mapping[str, object],
) -> pa.Table:
    """One row a stage, with the files that were published from it."""
    last = _last_producers(log)
    for entry in log:
        files = {
            table: {"rows": file.rows, "sha256": file.sha256}
            for table, file in published.items()
            if last[table] == entry["stage"]
        }
        entry.update(identity, tables=json.dumps(files, sort_keys=True))
    return rows("provenance", log)


def _last_producers(log: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Stage whose version of each table is the one that stands at the end."""
    last = dict.fromkeys(ACCUMULATING, log[-1]["stage"])
    for entry in log:
        last.update({t: entry["stage"] for t in entry.pop("produced") if t not in ACCUMULATING})
    return last


def _outcome(
    name: str, procedure: str, metrics: pa.Table, findings: pa.Table, *, up_to_date: bool = False
) -> Outcome:
    errors = findings.column("severity").to_pylist().count("error")
    verdict = verdicts.overall(metrics.to_pylist())
    return Outcome(name, procedure, metrics, findings, verdict, errors, up_to_date)


def _versions() -> dict[str, str]:
    return {"gyrostand": __version__, "code": code_fingerprint(), **{p: version(p) for p in _COMPUTING}}


def _file_sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
