"""Score: the integrated attitude against the reference, before and after detrending.

The criterion (2.5) of Godorov & Lutmanov (*Problems of Mechanics and Control* 48, 2016), the peak and
the final error of each angle, and its trend. Without a reference, where the stand ends in the attitude in
which it began, the closure error: the angle that the record ends with, less the one it begins with.

Everything is evaluated at the reference's sample times; the attitude, whose grid is the denser, is
interpolated to them by its local cubic, within a segment only. Differences of angles are without whole turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field

from pipeline.errors import ExitCode
from pipeline.numerics.criterion import relative_rms_error
from pipeline.numerics.local_polynomial import LocalPolynomial
from pipeline.numerics.rotation import wrapped
from pipeline.numerics.time_grid import advancing
from pipeline.stages.base import (
    ANGLES,
    Angle,
    Severity,
    StageError,
    Stand,
    Tables,
    counted,
    finding,
    metric,
    rows,
)
from pipeline.stages.base import Settings as _Settings

CONSUMES = ("attitude",)
MAY_CONSUME = ("attitude_corrected", "reference", "trend")
PRODUCES = ("metrics", "findings")
METRICS: tuple[str, ...] = (
    *(
        f"{figure}{suffix}"
        for figure in ("relative_rms_error", "peak_error", "final_error", "closure_error")
        for suffix in ("", "_corrected")
    ),
    "trend_a",
    "trend_b",
)

Vector = NDArray[np.float64]
Time = NDArray[np.int64]
Row = dict[str, Any]

_NS = 1e-9
_SUFFIXES = {"attitude": "", "attitude_corrected": "_corrected"}
"""Table → what its figures' names end with."""


class Settings(_Settings):
    """Which angles are scored."""

    channels: tuple[Angle, ...] = Field(
        ANGLES, min_length=1, description="angles to score: psi, theta, gamma"
    )


@dataclass(frozen=True, slots=True)
class _Common:
    """Reference samples that lie within a segment of the attitude, and which segment that is."""

    time: Time
    segment: NDArray[np.int32]
    index: NDArray[np.intp]


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:
    """Compute the figures.

    Parameters
    ----------
    tables : mapping
        ``attitude``; ``attitude_corrected``, ``reference`` and ``trend`` where there are.
    settings : Settings
    stand : Stand
        Says whether the record ends where it began.

    Returns
    -------
    dict
        ``metrics``: relative_rms_error (1), peak_error, final_error (rad), each also ``_corrected``; or
        closure_error (rad); trend_a (rad/s), trend_b (rad). ``findings``: what was left out.

    Raises
    ------
    StageError
        If attitude and reference have no time in common.
    """
    metrics: list[Row] = []
    findings: list[Row] = []
    channels = tuple(dict.fromkeys(settings.channels))
    if "reference" in tables:
        common = _common_time(tables, channels, findings)
        for channel in channels:
            metrics += _against_reference(tables, common, channel, findings)
    elif stand.returns_to_start:
        for channel in channels:
            metrics += _closure(tables, channel, findings)
    else:
        detail = "there is neither a reference nor a return to the start to judge the attitude by"
        findings.append(finding("score", "reference", "not scored", "info", detail))
    if "trend" in tables:
        for channel in channels:
            metrics += _trend(tables, channel)
    return {"metrics": rows("metrics", metrics), "findings": rows("findings", findings)}


def _common_time(tables: Tables, channels: tuple[str, ...], findings: list[Row]) -> _Common:
    """The reference's samples that can be compared with the attitude."""
    reference, attitude = tables["reference"], tables["attitude"]
    time = reference["time"].to_numpy().astype(np.int64)
    grid = attitude["time"].to_numpy().astype(np.int64)
    finite = np.all([np.isfinite(reference[c].to_numpy()) for c in channels], axis=0)
    index = np.flatnonzero(finite)
    kept = advancing(time[index]).kept
    for kind, at in (("NaN", time[~finite]), ("time not advancing", time[index[~kept]])):
        findings += _left_out(kind, "warning", at, time.size)
    index = index[kept]
    segments = attitude["segment"].to_numpy()
    after = np.searchsorted(grid, time[index], side="left")
    before = np.searchsorted(grid, time[index], side="right") - 1
    inside = (before >= 0) & (after < grid.size)
    inside[inside] &= segments[before[inside]] == segments[after[inside]]
    if not inside.any():
        raise StageError(
            "stage score, tables attitude and reference",
            expected="a time that they have in common",
            found=f"attitude {_span(grid)}, reference {_span(time[index])}",
            remedy="check the [time] of both streams in the test plan, and their clocks",
            exit_code=ExitCode.INPUT,
        )
    outside = time[index[~inside]]
    # That a reference runs on is common; where most of it is not scored, good figures mean little.
    severity: Severity = "warning" if outside.size > index.size / 2 else "info"
    findings += _left_out("outside the attitude", severity, outside, time.size)
    index = index[inside]
    return _Common(time[index], segments[before[inside]], index)


def _left_out(kind: str, severity: Severity, at: Time, of: int) -> list[Row]:
    """The finding on reference samples that do not count, if there are any."""
    if not at.size:
        return []
    detail = f"{at.size} of {counted(of, 'sample')} of the reference left out of the score: {kind}"
    start, end = int(at.min()), int(at.max())
    return [finding("score", "reference", kind, severity, detail, start=start, end=end, count=at.size)]


def _span(time: Time) -> str:
    """First and last time, for an error."""
    return f"from {time.min()} ns to {time.max()} ns" if time.size else "without a usable sample"


def _against_reference(tables: Tables, common: _Common, channel: str, findings: list[Row]) -> list[Row]:
    """Criterion, peak and final error of one angle, before and after detrending."""
    reference = tables["reference"][channel].to_numpy()[common.index]
    t = (common.time - common.time[0]) * _NS
    figures: list[Row] = []
    for table, suffix in _SUFFIXES.items():
        if table not in tables:
            continue
        difference = wrapped(_at(tables[table], channel, common) - reference)
        criterion = relative_rms_error(t, difference, reference, common.segment)
        if criterion is None and not suffix:
            detail = f"the criterion of {channel} is not defined: its reference is zero, or a single sample"
            findings.append(finding("score", "reference", "undefined", "warning", detail, channel=channel))
        figures += [
            metric("score", channel, f"relative_rms_error{suffix}", criterion, "1"),
            metric("score", channel, f"peak_error{suffix}", float(np.max(np.abs(difference))), "rad"),
            metric("score", channel, f"final_error{suffix}", float(difference[-1]), "rad"),
        ]
    return figures


def _at(attitude: pa.Table, channel: str, common: _Common) -> Vector:
    """An angle of the attitude at the times of the reference."""
    grid = attitude["time"].to_numpy().astype(np.int64)
    segments = attitude["segment"].to_numpy()
    angle = attitude[channel].to_numpy()
    result = np.empty(common.time.size)
    for segment in np.unique(common.segment):
        here, there = _stretch(common.segment, segment), _stretch(segments, segment)
        result[here] = _interpolated(grid[there], angle[there], common.time[here])
    return result


def _stretch(segments: NDArray[np.int32], number: int) -> slice:
    """The rows of one segment; the numbers ascend."""
    first, end = np.searchsorted(segments, [number, number + 1])
    return slice(int(first), int(end))


def _interpolated(grid: Time, angle: Vector, time: Time) -> Vector:
    """Values on the grid where the times coincide, else by the local cubic (lower where rows are few)."""
    place = np.searchsorted(grid, time)
    if np.array_equal(grid[place], time):
        return angle[place]
    curve = LocalPolynomial((grid - grid[0]) * _NS, angle[:, np.newaxis], min(3, grid.size - 1))
    return curve.sample((time - grid[0]) * _NS)[0][:, 0]


def _closure(tables: Tables, channel: str, findings: list[Row]) -> list[Row]:
    """Angle at the end less angle at the beginning; of one uninterrupted stretch only."""
    segments = tables["attitude"]["segment"].to_numpy()
    whole = segments.size > 0 and segments[0] == segments[-1]
    if not whole:
        detail = f"the closure of {channel} is not known: the record is in pieces"
        findings.append(finding("score", "attitude", "not scored", "warning", detail, channel=channel))
    figures = []
    for table, suffix in _SUFFIXES.items():
        if table in tables:
            angle = tables[table][channel].to_numpy()
            error = float(wrapped(angle[-1:] - angle[:1])[0]) if whole else None
            figures.append(metric("score", channel, f"closure_error{suffix}", error, "rad"))
    return figures


def _trend(tables: Tables, channel: str) -> list[Row]:
    """The trend of the longest segment that has one."""
    trend, segments = tables["trend"], tables["attitude"]["segment"].to_numpy()
    found = [row for row in trend.to_pylist() if row["channel"] == channel]
    if not found:
        return []
    row = max(found, key=lambda row: np.count_nonzero(segments == row["segment"]))
    return [
        metric("score", channel, "trend_a", row["a"], "rad/s", row["a_standard_error"]),
        metric("score", channel, "trend_b", row["b"], "rad", row["b_standard_error"]),
    ]
