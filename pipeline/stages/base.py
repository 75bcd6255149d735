"""What a stage is, as numbered rules.

1. A stage is one module of this package with the names of `Stage`.
2. ``run`` is a pure function: it reads no file, writes no file, prints nothing, and gives the same
   bytes for the same tables and settings. (`ingest` is the one door: its ``run`` alone gets a path.)
3. ``CONSUMES`` names the tables that must be there, ``MAY_CONSUME`` those it uses when they are.
4. ``PRODUCES`` names the tables it may return, ``METRICS`` the metrics it may add: a limit on any other name
   is a fault of the test plan. Every returned table satisfies its contract.
5. A returned table replaces the one of the same name for the stages after it, except ``findings`` and
   ``metrics``, which accumulate: a stage returns only its own rows.
6. ``Settings`` is a frozen pydantic model whose every field has a default and a description with its
   unit; it is the stage's section of the test plan.
7. What the stage cannot decide it refuses with a `StageError`; what it dropped, split or assumed it
   says as a finding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol, Self, get_args

import numpy as np
import pyarrow as pa
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline import contracts
from pipeline.errors import ExitCode, GyrostandError
from pipeline.models.earth import Scheme
from pipeline.plan_faults import Fault, refuse

Tables = Mapping[str, pa.Table]
Severity = Literal["info", "warning", "error"]
Angle = Literal["psi", "theta", "gamma"]

ANGLES: tuple[Angle, ...] = get_args(Angle)
"""The Euler-Krylov angles, in the order of the attitude's columns."""

ACCUMULATING = ("findings", "metrics")
"""The tables to which every stage may add rows (rule 5)."""


class StageError(GyrostandError):
    """A stage cannot do what the test plan asks with the data it was given."""

    exit_code = ExitCode.NOT_MET


class Settings(BaseModel):
    """Base of every section of a test plan: immutable, and closed to unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Mounting(Settings):
    """Where on the Earth a base stands, and how it is turned."""

    latitude_deg: float | None = Field(
        None, ge=-90, le=90, description="geodetic latitude of the stand, degrees north"
    )
    scheme: Scheme | None = Field(None, description="how the base of a gimbal is mounted")
    chi_deg: tuple[float, float, float] | None = Field(
        None,
        description="angles chi1, chi2, chi3 of the base against (East, North, Up), in place of a scheme, "
        "degrees",
    )

    @model_validator(mode="after")
    def _is_mounted_one_way(self) -> Self:
        if self.scheme is not None and self.chi_deg is not None:
            refuse([Fault(("chi_deg",), "one of scheme and chi_deg", "both", "keep the one that is meant")])
        return self


class Stand(Mounting):
    """The stand on which the recording was made; common to all procedures."""

    name: str = Field("", description="what the laboratory calls the stand")
    returns_to_start: bool = Field(
        False, description="the stand ends the record in the attitude in which it began it"
    )
    table_tilt_deg: float | None = Field(
        None,
        ge=0,
        le=180,
        description="angle of a rate table's axis of rotation from the vertical, degrees; 0 points up",
    )
    table_heading_deg: float | None = Field(
        None,
        ge=-360,
        le=360,
        description="azimuth of axis 1 of a rate table, towards which its axis of rotation leans, degrees "
        "clockwise from North",
    )


class Stage(Protocol):
    """The shape of a stage module."""

    CONSUMES: tuple[str, ...]
    MAY_CONSUME: tuple[str, ...]
    PRODUCES: tuple[str, ...]
    METRICS: tuple[str, ...]
    Settings: type[Settings]

    def run(self, tables: Tables, settings: Any, stand: Stand) -> dict[str, pa.Table]:
        """Turn the consumed tables into the produced ones."""
        ...


def counted(count: int, noun: str) -> str:
    """``1 sample``, ``20 samples``: a count in the words of a finding."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def finding(
    stage: str,
    stream: str,
    kind: str,
    severity: Severity,
    detail: str,
    *,
    channel: str | None = None,
    start: int | None = None,
    end: int | None = None,
    count: int = 1,
) -> dict[str, Any]:
    """One row of ``findings``; start and end in nanoseconds of the stream's clock."""
    return {
        "stage": stage,
        "stream": stream,
        "channel": channel,
        "kind": kind,
        "severity": severity,
        "start": start,
        "end": end,
        "count": count,
        "detail": detail,
    }


def metric(
    stage: str,
    channel: str,
    name: str,
    value: float | None,
    unit: str,
    standard_error: float | None = None,
) -> dict[str, Any]:
    """One row of ``metrics`` without limits; the run's end adds the procedure, limits and verdict.

    A value that is not finite is stored as null, which no limit accepts.
    """
    finite = value is not None and bool(np.isfinite(value))
    return {
        "procedure": "",
        "stage": stage,
        "channel": channel,
        "name": name,
        "value": float(value) if finite and value is not None else None,
        "unit": unit,
        "standard_error": standard_error,
        "lower_limit": None,
        "upper_limit": None,
        "verdict": "not evaluated",
    }


def rows(table: str, items: Sequence[Mapping[str, Any]]) -> pa.Table:
    """A table from rows, in the types and order of its contract (also when there are none)."""
    contract = contracts.contract(table)
    return contracts.table(table, {c.name: [item[c.name] for item in items] for c in contract.columns})
