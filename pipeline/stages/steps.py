"""Steps: where the table turned at a constant rate, and what the gyro told there.

Each run of a gyro on the table by itself: the clocks of gyro and table are put together by the time offset
that the ramps between the steps show, the stretches of constant rate are found in the table's own record,
and over each the gyro is averaged (`pipeline.models.rate_table_steps`). Samples that the audit marks are
averaged with the others, but for those without a value or whose time does not advance.

A gyro that does not follow the table, or follows it in another unit only, is refused
(`_rate_table_plausibility`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.errors import ExitCode
from pipeline.models.rate_table_offset import TimeOffset, time_offset
from pipeline.models.rate_table_steps import (
    Motion,
    RateTableError,
    Steps,
    constant_stretches,
    measure_steps,
)
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._rate_table_plausibility import (
    followed,
    refuse_jumps,
    refuse_only_rest,
    refuse_still,
)
from pipeline.stages._rate_table_record import AXES, TableRun, table_runs
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import StageError, Stand, Tables, counted, finding, metric, rows

CONSUMES: tuple[str, ...] = ("gyro",)
MAY_CONSUME: tuple[str, ...] = ("turntable", "temperature", "mountings")
PRODUCES: tuple[str, ...] = ("rate_steps", "findings", "metrics")
METRICS: tuple[str, ...] = ("time_offset", "step_count")

Float = NDArray[np.float64]
Rows = list[dict[str, Any]]

_ENDS = 3.0
"""Standard errors of the time offset that are left out at either end of a step."""
_ROUNDING = 1e-6
"""Of a turn."""


class Settings(_Settings):
    """What a step is, and how the clocks are put together."""

    shortest_s: float = Field(
        5.0, gt=0, description="shortest stretch of constant rate that counts, without its settling, s"
    )
    settling_s: float = Field(
        1.0, ge=0, description="left out at the beginning of each stretch, where table and gyro settle, s"
    )
    tolerance_deg_s: float | None = Field(
        None,
        gt=0,
        description="change of the table's mean rate within which it is constant, deg/s; None: by its noise",
    )
    max_gap_s: float = Field(
        1.0, gt=0, description="longest interval without a sample of gyro or table within a step, s"
    )
    time_offset: Literal["estimate", "none"] | float = Field(
        "estimate",
        description="the gyro's clock minus the table's: estimate, from the ramps between the steps; none; "
        "or a number, s",
    )
    longest_offset_s: float = Field(1.0, gt=0, description="largest time offset that is looked for, s")

    @model_validator(mode="after")
    def _offset_is_no_longer_than_that(self) -> Self:
        if not isinstance(self.time_offset, str) and abs(self.time_offset) > self.longest_offset_s:
            expected = f"at most longest_offset_s = {self.longest_offset_s:g}, either way"
            remedy = "correct it, or raise longest_offset_s"
            refuse([Fault(("time_offset",), expected, f"{self.time_offset:g}", remedy)])
        return self


@dataclass(frozen=True, slots=True)
class _Offset:
    """The time offset of a run as it is used: what the table's clock is advanced by, and may miss by."""

    value: float
    lag: float
    told: TimeOffset | None
    note: Rows


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:
    """Find the steps of every run on the table, and measure them.

    Parameters
    ----------
    tables : mapping
        ``gyro``; ``turntable``, without which there are no steps; ``temperature`` and ``mountings``.
    settings : Settings
    stand : Stand
        Whether it is known how the table's angle stands to the North.

    Returns
    -------
    dict
        ``rate_steps``, ``findings`` and ``metrics``.

    Raises
    ------
    StageError
        If a run on the table has no step, the table never turns, or the gyro does not follow it (exit code
        1); if it follows it in another unit only, or the axis is not said (2); or has no samples (3).
    """
    steps: Rows = []
    findings: Rows = []
    figures: Rows = []
    offsets: dict[str, TimeOffset] = {}
    if "turntable" in tables:
        for one in table_runs(tables):
            if "mountings" in tables and one.axis is None:
                continue
            made, said, told = _of_run(one, settings, oriented=stand.table_heading_deg is not None)
            steps += made
            findings += said
            if told is not None:
                offsets[one.name] = told
            count = len(made) // len(one.channels)
            if one.number is not None:
                figures.append(metric("steps", one.name, "step_count", count, "1"))
    figures.append(metric("steps", "", "step_count", len({(s["run"], s["step"]) for s in steps}), "1"))
    figures += _offset_figures(offsets, named="mountings" in tables)
    return {
        "rate_steps": rows("rate_steps", steps),
        "findings": rows("findings", findings),
        "metrics": rows("metrics", figures),
    }


def _offset_figures(offsets: dict[str, TimeOffset], *, named: bool) -> Iterator[dict[str, Any]]:
    """The offset of each run, and the largest of all without a channel."""
    for name, told in offsets.items() if named else ():
        yield metric("steps", name, "time_offset", told.offset, "s", told.standard_error)
    largest = max(offsets.values(), key=lambda told: abs(told.offset), default=None)
    value, error = (None, None) if largest is None else (largest.offset, largest.standard_error)
    yield metric("steps", "", "time_offset", value, "s", error)


def _of_run(one: TableRun, settings: Settings, *, oriented: bool) -> tuple[Rows, Rows, TimeOffset | None]:
    """Rows of ``rate_steps``, findings, and the time offset if it was estimated."""
    if one.axis is None:
        raise StageError(
            f"{one.where}gyro",
            expected="which axis of the case lies along the table's",
            found=f"the channels {', '.join(one.channels)} and no [[runs]]",
            remedy='add [[runs]] with name = … and axis = "p", "q" or "r" to the test plan',
            exit_code=ExitCode.USAGE,
        )
    try:
        recorded = _motion(one)
        refuse_still(one, recorded)
        if one.by_angle:
            refuse_jumps(one, recorded)
        offset = _offset(one, recorded, settings)
        motion = _common(one, replace(recorded, time=recorded.time + offset.value))
        tolerance = None if settings.tolerance_deg_s is None else float(np.radians(settings.tolerance_deg_s))
        found = constant_stretches(
            motion,
            shortest=settings.shortest_s,
            settling=settings.settling_s,
            lag=offset.lag,
            tolerance=tolerance,
        )
        stretches, left_out = _without_gaps(one, motion, found, settings)
        time = one.seconds(one.gyro.time)
        temperature = one.temperature_at(time)
        measured = measure_steps(motion, stretches, time, one.gyro.values, temperature)
        refuse_only_rest(one, measured, motion)
        if one.across is None or not oriented:  # the zero of the table's angle tells nothing of the case's
            length = stretches[:, 1] - stretches[:, 0]
            less = np.abs(measured.rate) * length < 2 * np.pi * (1 - _ROUNDING)
            measured = replace(measured, turn=np.where(less[:, np.newaxis], np.nan, measured.turn))
    except RateTableError as error:
        raise RateTableError(
            f"{one.where}{error.where}", expected=error.expected, found=error.found, remedy=error.remedy
        ) from error
    said = [*offset.note, *left_out, *followed(one, measured)]
    return list(_step_rows(one, measured)), said, offset.told


def _motion(one: TableRun) -> Motion:
    """What the table did, by its own clock."""
    if one.table is None:
        raise StageError(
            f"{one.where}stream 'turntable'",
            expected="samples with finite values that advance in time",
            found="fewer than two",
            remedy="check the recording, and the stream's channel and clock in the test plan",
            exit_code=ExitCode.INPUT,
        )
    time, values = one.seconds(one.table.time), one.table.values[:, 0]
    return Motion.of_angle(time, values) if one.by_angle else Motion.of_rate(time, values)


def _common(one: TableRun, motion: Motion) -> Motion:
    """The table's motion as long as the gyro was recorded."""
    last = float(one.seconds(one.gyro.time[-1:])[0])
    inside = (motion.time >= 0) & (motion.time <= last)
    if np.count_nonzero(inside) < 2:
        raise StageError(
            f"{one.where}streams 'gyro' and 'turntable'",
            expected="a common stretch of time",
            found=f"the gyro from 0 to {last:.6g} s, the table from {motion.time[0]:.6g} s to "
            f"{motion.time[-1]:.6g} s",
            remedy="check the clocks of both streams in the test plan",
        )
    return replace(motion, time=motion.time[inside], angle=motion.angle[inside])


def _offset(one: TableRun, motion: Motion, settings: Settings) -> _Offset:
    """The time offset by the setting; where ramps do not tell it, none, and steps are cut accordingly."""
    if not isinstance(settings.time_offset, str):
        return _Offset(settings.time_offset, 0.0, None, [])
    if settings.time_offset == "none":
        return _Offset(0.0, 0.0, None, [])
    assert one.axis is not None, "checked by the caller"
    along = AXES[int(np.argmax(np.abs(one.axis)))]
    if along not in one.channels:
        why = f"{along}, along the table's axis, was not recorded"
    else:
        gyro = one.gyro.values[:, one.channels.index(along)]
        try:
            told = time_offset(motion, one.seconds(one.gyro.time), gyro, longest=settings.longest_offset_s)
        except RateTableError as error:
            why = f"expected {error.expected}, found {error.found}"
        else:
            return _Offset(told.offset, _ENDS * told.standard_error, told, [])
    text = (
        f"{one.about}not estimated: {why}; taken as 0, and {settings.longest_offset_s:g} s left out at the "
        "ends of each step"
    )
    note = finding("steps", "gyro", "time offset", "warning", text)
    return _Offset(0.0, settings.longest_offset_s, None, [note])


def _without_gaps(one: TableRun, motion: Motion, found: Float, settings: Settings) -> tuple[Float, Rows]:
    """The stretches in which neither record has a long gap, and findings about the others."""
    kept = np.ones(len(found), dtype=np.bool_)
    for stamps in (motion.time, one.seconds(one.gyro.time)):
        for start, stop in _gaps(stamps, settings.max_gap_s):
            kept &= (found[:, 1] <= start) | (found[:, 0] >= stop)
    if not kept.any():
        raise RateTableError(
            "table rate",
            expected="stretches of constant rate without a gap",
            found=f"{counted(len(found), 'stretch')}, each with a gap of more than {settings.max_gap_s:g} s",
            remedy="check the recording, or raise steps.max_gap_s",
        )
    left_out = [
        finding(
            "steps",
            "gyro",
            "gap in a step",
            "warning",
            f"{one.about}a stretch of constant rate of {stop - start:.4g} s with a gap of more than "
            f"{settings.max_gap_s:g} s: left out",
            start=int(one.stamps(np.array(start))),
            end=int(one.stamps(np.array(stop))),
        )
        for start, stop in found[~kept]
    ]
    return found[kept], left_out


def _gaps(time: Float, longest: float) -> Float:
    """Start and stop of the intervals that are longer, shape (k, 2)."""
    long = np.flatnonzero(np.diff(time) > longest)
    return np.stack([time[long], time[long + 1]], axis=1)


def _step_rows(one: TableRun, measured: Steps) -> Iterator[dict[str, Any]]:
    start, stop = one.stamps(measured.start), one.stamps(measured.stop)
    for step in range(len(measured)):
        cosine, sine = (None if np.isnan(part) else float(part) for part in measured.turn[step])
        for k, channel in enumerate(one.channels):
            yield {
                "run": one.number,
                "step": step,
                "channel": channel,
                "start": int(start[step]),
                "stop": int(stop[step]),
                "rate": float(measured.rate[step]),
                "cosine": cosine,
                "sine": sine,
                "output": float(measured.gyro[step, k]),
                "standard_error": float(measured.standard_error[step, k]),
                "temperature": None if measured.temperature is None else float(measured.temperature[step]),
            }
