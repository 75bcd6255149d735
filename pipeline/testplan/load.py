"""Test plans: TOML to typed settings, composed from those of the procedure's stages.

A plan's top level holds the procedure, its title, the stand, the limits, the settings of `ingest` (time,
streams, runs, text), and a section for each further stage of the procedure. A stage's settings are the class
``Settings`` of its module: a new stage brings its section with it.

Types are strict: TOML says itself what is a number, a string or a truth value.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self

from pydantic import Field, ValidationError, create_model, model_validator
from pydantic.json_schema import models_json_schema

from pipeline import contracts
from pipeline.formats.base import RecordingError
from pipeline.limits import Limit
from pipeline.plan_faults import Fault, refuse
from pipeline.procedures import NEEDS, PROCEDURES, WHOLE, WITH_RUNS
from pipeline.stages import ingest
from pipeline.stages._calibration_settings import rate_table_faults
from pipeline.stages._runs import further_recordings, is_bare, mounting_faults, neighbour
from pipeline.stages.base import Settings, Stand
from pipeline.stages.channel_map import Stream, missing_channels
from pipeline.stages.quantities import StreamName
from pipeline.storage.naming import COMPRESSIONS
from pipeline.testplan.errors import PlanError, faults_of, plan_error, shown, shown_path, unknown
from pipeline.testplan.locate import key_lines

FOLDER_PLAN = "testplan.toml"
"""The plan of every recording of its folder that has none of its own."""

SCHEMA = "testplan.schema.json"

_LARGEST = 2**20
_AT_LINE = re.compile(r" \(at line (\d+), column \d+\)$| \(at end of document\)$")


@dataclass(frozen=True, slots=True)
class TestPlan:
    """A test plan that was read and checked.

    Attributes
    ----------
    path : Path
        Its file.
    sha256 : str
        Of the file's bytes.
    procedure, title : str
    stand : Stand
    limits : tuple of Limit
    settings : mapping of str to Settings
        Of every stage of the procedure, by the stage's name.
    """

    path: Path
    sha256: str
    procedure: str
    title: str
    stand: Stand
    limits: tuple[Limit, ...]
    settings: Mapping[str, Settings]

    @property
    def streams(self) -> Mapping[StreamName, Stream]:
        """The streams that the plan maps."""
        return self._ingest.streams

    def further_recordings(self, recording: Path) -> tuple[Path, ...]:
        """The recordings beside the given one, of which the plan says that they hold runs too.

        Raises
        ------
        RecordingError
            If one of them is not there, or is the given one.
        """
        return tuple(further_recordings(recording, self._ingest.runs).values())

    def calibration(self, recording: Path) -> Path | None:
        """The file beside the given recording, by which the plan has its gyro corrected; None: not at all.

        Raises
        ------
        PlanError
            If it is not there.
        """
        path = self._ingest.calibration_beside(recording)
        if path is None or path.is_file():
            return path
        text, _ = _parsed(self.path, _bytes(self.path))
        beside = [p.name for p in path.parent.iterdir() if p.is_file() and not p.name.endswith(".truth.json")]
        near = get_close_matches(path.name, beside, n=1)
        fault = Fault(
            ("streams", "gyro", "calibration"),
            f"the file of a calibration beside the recording, in {shown_path(path.parent)}",
            f"no {path.name!r}",
            f"did you mean {near[0]!r}?" if near else "'gyrostand calibration export' writes one",
        )
        raise plan_error(self.path, key_lines(text), [fault])

    @property
    def _ingest(self) -> ingest.Settings:
        settings = self.settings["ingest"]
        assert isinstance(settings, ingest.Settings)
        return settings


class _Plan(ingest.Settings):
    """What the plans of all procedures have in common."""

    procedure: str
    title: str = Field("", description="what the recording is called in the report")
    stand: Stand = Field(default_factory=Stand, description="the stand that the recording is from")
    limits: tuple[Limit, ...] = Field((), description="what figures must be for the recording to pass")

    @model_validator(mode="after")
    def _limits_are_told_apart(self) -> Self:
        first: dict[tuple[str, str], int] = {}
        faults = []
        for place, limit in enumerate(self.limits):
            earlier = first.setdefault((limit.metric, limit.channel), place)
            if earlier != place:
                found = f"a second for {limit.metric!r}, {limit.channel!r}, as limits[{earlier + 1}]"
                expected = "one limit for each metric and channel"
                faults.append(Fault(("limits", place), expected, found, "make one of the two"))
        if faults:
            refuse(faults)
        return self


def load_plan(path: str | os.PathLike[str]) -> TestPlan:
    """Read and check a test plan.

    Parameters
    ----------
    path : path
        A TOML file.

    Returns
    -------
    TestPlan

    Raises
    ------
    PlanError
        If it cannot be read, or is wrong: one line for each fault, with its line in the file.
    """
    path = Path(path)
    content = _bytes(path)
    text, data = _parsed(path, content)
    model = plan_model(_procedure(path, text, data))
    try:
        plan = model.model_validate(_immutable(data), strict=True)
    except ValidationError as error:
        raise plan_error(path, key_lines(text), faults_of(error, data, model)) from None
    faults = [*_unknown_metrics(plan), *_missing(plan)]
    if faults:
        raise plan_error(path, key_lines(text), faults)
    mapped = {name: getattr(plan, name) for name in ingest.Settings.model_fields}
    settings: dict[str, Settings] = {"ingest": ingest.Settings(**mapped)}
    settings |= {stage: getattr(plan, stage) for stage in PROCEDURES[plan.procedure] if stage != "ingest"}
    return TestPlan(
        path=path,
        sha256=hashlib.sha256(content).hexdigest(),
        procedure=plan.procedure,
        title=plan.title,
        stand=plan.stand,
        limits=plan.limits,
        settings=MappingProxyType(settings),
    )


def _unknown_metrics(plan: Any) -> list[Fault]:
    """Limits on figures that no stage of the procedure has: they could never be met."""
    modules = [import_module(f"pipeline.stages.{stage}") for stage in PROCEDURES[plan.procedure]]
    known = list(dict.fromkeys(name for module in modules for name in module.METRICS))
    return [
        unknown(
            ("limits", place, limit.metric), f"a metric of the procedure {plan.procedure!r}", known
        )._replace(key=("limits", place, "metric"))
        for place, limit in enumerate(plan.limits)
        if limit.metric not in known
    ]


def _missing(plan: Any) -> Iterator[Fault]:
    """What the procedure needs and the plan does not say."""
    needs = NEEDS.get(plan.procedure, ())
    for need in needs:
        section, name = need.split(".")
        given = plan.streams.get(name) if section == "streams" else getattr(plan.stand, name)
        if given is None:
            remedy = f"add [streams.{name}]" if section == "streams" else f"add {name} = … to [{section}]"
            yield Fault((section,), f"{need}, for the procedure {plan.procedure!r}", "none", remedy)
    streams: Mapping[StreamName, Stream] = plan.streams
    for name, stream in streams.items():
        for fault in missing_channels(stream) if name in WHOLE.get(plan.procedure, ()) else ():
            yield fault._replace(key=("streams", name, *fault.key))
    if plan.runs and plan.procedure not in WITH_RUNS:
        expected = f"[[runs]] only in the procedures {', '.join(WITH_RUNS)}"
        yield Fault(("runs",), expected, repr(plan.procedure), "remove them, or correct the procedure")
    if plan.procedure == "rate_table":
        yield from rate_table_faults(plan.streams, plan.runs, plan.calibrate, plan.stand)
    if "gimbal" in plan.streams or "streams.gimbal" in needs:
        yield from mounting_faults(plan.runs, plan.stand)


def named_recordings(plan: Path, recording: Path) -> tuple[Path, ...]:
    """The further recordings that a plan names for a recording, whether they are there or not.

    A plan that cannot be read names none; what else is wrong with it does not matter here.
    """
    runs = _read_or_empty(plan).get("runs")
    entries = (
        [run.get("recording") for run in runs if isinstance(run, dict)] if isinstance(runs, list) else []
    )
    names = [name for name in entries if isinstance(name, str) and name and is_bare(name)]
    return tuple(neighbour(recording, name) for name in dict.fromkeys(names))


def named_calibration(plan: Path, recording: Path) -> Path | None:
    """The calibration that a plan names for a recording, as `named_recordings` gives the recordings."""
    name: Any = _read_or_empty(plan)
    for key in ("streams", "gyro", "calibration"):
        name = name.get(key) if isinstance(name, dict) else None
    return neighbour(recording, name) if isinstance(name, str) and name and is_bare(name) else None


def _read_or_empty(plan: Path) -> dict[str, Any]:
    """What a plan says as TOML; nothing where it cannot be read."""
    try:
        return _parsed(plan, _bytes(plan))[1]
    except PlanError:
        return {}


def find_plan(recording: Path) -> Path:
    """The test plan of a recording: ``run7.toml`` beside ``run7.mcap``, else ``testplan.toml`` in the folder.

    The name of a rosbag2 folder is taken whole; of ``run7.csv.gz`` both suffixes are taken off.

    Raises
    ------
    RecordingError
        If there is no such recording.
    PlanError
        If it has no test plan; says which file to write, and how to begin.
    """
    shown_recording = shown_path(recording)
    if not recording.exists():
        raise RecordingError(
            shown_recording, expected="a recording", found="no such file or folder", remedy="check the name"
        )
    own = own_plan(recording)
    for plan in (own, own.with_name(FOLDER_PLAN)):
        if plan.is_file():
            return plan
    begin = f"gyrostand plan init {shlex.quote(str(recording))} > {shlex.quote(str(own))}"
    raise PlanError(
        shown_recording,
        expected=f"its test plan {shown_path(own)}, or {FOLDER_PLAN} in the folder",
        found="neither",
        remedy=f"begin one with '{begin}'",
    )


def own_plan(recording: Path) -> Path:
    """Where the test plan of this recording alone is, or should be."""
    if recording.name in ("", ".."):
        recording = recording.resolve()
    name = recording.name
    if not recording.is_dir():
        if name.lower().endswith(COMPRESSIONS):
            name = Path(name).stem
        name = Path(name).stem
    return recording.with_name(f"{name}.toml")


@cache
def plan_model(procedure: str) -> type[_Plan]:
    """The model of a procedure's test plans.

    Parameters
    ----------
    procedure : str
        A key of `PROCEDURES`.
    """
    name = (Literal[procedure], Field(description="the stages that the recording goes through"))
    sections: dict[str, Any] = {"procedure": name}
    for stage in PROCEDURES[procedure]:
        if stage != "ingest":  # its settings are those of the top level
            settings = import_module(f"pipeline.stages.{stage}").Settings
            sections[stage] = (settings, Field(default_factory=settings))
    return create_model(procedure, __base__=_Plan, **sections)


def schema_text() -> str:
    """JSON Schema of test plans, for editors: what ``schemas/testplan.schema.json`` holds."""
    models = [(plan_model(procedure), "validation") for procedure in PROCEDURES]
    _, schema = models_json_schema(models, title="gyrostand test plan")  # type: ignore[arg-type]
    choices = [{"$ref": f"#/$defs/{procedure}"} for procedure in PROCEDURES]
    whole = {"$schema": "https://json-schema.org/draft/2020-12/schema", "oneOf": choices, **schema}
    return json.dumps(whole, indent=2, ensure_ascii=False) + "\n"


def write_schema() -> None:
    """Write ``schemas/testplan.schema.json`` anew; a test says when that is due."""
    (contracts.folder() / SCHEMA).write_text(schema_text(), encoding="utf-8")


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        raise PlanError(
            shown_path(path),
            expected="a test plan",
            found="no such file" if missing else error.strerror or str(error),
            remedy="check the name; 'gyrostand plan init RECORDING' begins one",
        ) from error
    if len(content) > _LARGEST:
        raise PlanError(
            shown_path(path),
            expected="a test plan of at most 1 MiB",
            found="a larger file",
            remedy="check the name",
        )
    return content


def _parsed(path: Path, content: bytes) -> tuple[str, dict[str, Any]]:
    """The text, and what it says as TOML."""
    try:
        text = content.decode("utf-8-sig")  # editors of Windows put a mark before it
        return text, tomllib.loads(text)
    except UnicodeDecodeError as error:
        line, found = content.count(b"\n", 0, error.start) + 1, f"the byte {content[error.start]:#04x}"
    except tomllib.TOMLDecodeError as error:
        at = _AT_LINE.search(str(error))
        line = int(at[1]) if at and at[1] else max(1, len(text.splitlines()))
        found = _AT_LINE.sub("", str(error))
        found = f"what is none: {found[:1].lower()}{found[1:]}"
    except RecursionError:
        line, found = 1, "arrays or tables nested too deeply"
    raise PlanError(
        f"{shown_path(path)}:{line}",
        expected="TOML in UTF-8",
        found=found,
        remedy="correct the line; https://toml.io shows how it is written",
    )


def _procedure(path: Path, text: str, data: Mapping[str, Any]) -> str:
    """The procedure of a plan, which decides on all else."""
    name = data.get("procedure")
    if isinstance(name, str) and name in PROCEDURES:
        return name
    known = ", ".join(PROCEDURES)
    if name is None:
        fault = Fault((), "the key 'procedure' at the top", "none", f"add procedure = …, one of {known}")
    else:
        fault = unknown(("procedure", str(name)), "one of the procedures", tuple(PROCEDURES))
        fault = fault._replace(key=("procedure",), found=shown(name))
    raise plan_error(path, key_lines(text), [fault])


def _immutable(value: Any) -> Any:
    """Arrays as tuples, which is what the settings hold."""
    if isinstance(value, dict):
        return {key: _immutable(item) for key, item in value.items()}
    return tuple(map(_immutable, value)) if isinstance(value, list) else value
