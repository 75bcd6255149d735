"""Detrend: takes the linear trend that the interpolation error leaves in an integrated angle out of it.

Source: Godorov & Lutmanov, *Problems of Mechanics and Control* 48 (2016), sections 4 and 5.

Where the vibration begins within the record, at t*, the angle before it is a smooth motion
``a_s t + b_s``, fitted by least squares; the trend ``a (t - t*) + b`` is that of the angle after t* less
the smooth motion, and is taken out of it from t* on only.

A segment of which the trend cannot be found because it is too short stays as it is, and a finding says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field

from pipeline import contracts
from pipeline.errors import ExitCode
from pipeline.numerics.onset import find_onset
from pipeline.numerics.robust_trend import robust, winsorised
from pipeline.numerics.smooth_motion import SmoothMotion, fit_smooth_motion
from pipeline.numerics.trend import (
    FEWEST_BLOCKS,
    TooFewRowsError,
    Trend,
    find_extremes,
    harmonic,
    trend_by_extremes,
)
from pipeline.numerics.vibration import fundamental
from pipeline.stages.base import ANGLES, Angle, StageError, Stand, Tables, counted, finding, rows
from pipeline.stages.base import Settings as _Settings

CONSUMES = ("attitude",)
MAY_CONSUME = ("gyro", "gyro_increments")
PRODUCES = ("trend", "attitude_corrected", "findings")
METRICS: tuple[str, ...] = ()

Vector = NDArray[np.float64]
Time = NDArray[np.int64]
Row = dict[str, Any]

_NS = 1e-9


class Settings(_Settings):
    """What is taken for the trend, and of which angles."""

    method: Literal["harmonic", "extremes", "robust", "none"] = Field(
        "harmonic",
        description="harmonic: least squares over trend and vibration, weighted by the residual's own noise; "
        "extremes: two maxima and a minimum, as the paper; robust: as harmonic, without outlying samples "
        "and jumps; none: nothing is taken out",
    )
    channels: tuple[Angle, ...] = Field(
        ("gamma",), min_length=1, description="angles to take the trend out of: psi, theta, gamma"
    )
    onset: Literal["none", "auto"] | float = Field(
        "none",
        description="where the vibration begins: none (it lasts through the record), auto (found by the rise "
        "of its power), or seconds from the record's start",
    )
    frequency: float | None = Field(
        None, gt=0, description="fundamental of the angle's vibration, Hz; left out, it is found"
    )
    harmonics: int = Field(1, ge=1, le=10, description="harmonics of the vibration that are fitted, 1")
    min_separation: float = Field(
        0.1,
        gt=0,
        lt=1,
        description="extremes: least time between the two maxima, as a part of the record, 1",
    )


@dataclass(frozen=True, slots=True)
class _Record:
    """The attitude, its clock and what all its segments share."""

    time: Time
    segment: NDArray[np.int32]
    interval: float
    onset: int | None

    @property
    def start(self) -> int:
        """The record's first time."""
        return int(self.time[0])

    @property
    def pieces(self) -> list[slice]:
        """Rows of each segment."""
        edges = np.flatnonzero(np.diff(self.segment)) + 1
        bounds = [0, *edges.tolist(), self.time.size]
        return [slice(i, j) for i, j in pairwise(bounds)]

    def seconds(self, part: slice, origin: int) -> Vector:
        """Time of the rows from an origin."""
        return np.asarray((self.time[part] - origin) * _NS, dtype=np.float64)

    def block(self, part: slice) -> int:
        """Rows in two sample intervals of the gyro."""
        return max(1, round(2 * self.interval / self.step(part)))

    def step(self, part: slice) -> float:
        """Step between the rows, s."""
        steps = np.diff(self.time[part])
        return float(np.median(steps)) * _NS if steps.size else self.interval


@dataclass(frozen=True, slots=True)
class _Task:
    """One angle to detrend, and where its findings go."""

    record: _Record
    channel: str
    settings: Settings
    findings: list[Row]

    def note(self, part: slice, kind: str, detail: str, count: int | None = None) -> None:
        """Add a finding on a part of the angle."""
        row = finding(
            "detrend",
            "attitude",
            kind,
            "warning" if kind == "trend left in" else "info",
            detail,
            channel=self.channel,
            start=int(self.record.time[part.start]),
            end=int(self.record.time[part.stop - 1]),
            count=part.stop - part.start if count is None else count,
        )
        self.findings.append(row)

    def where(self, part: slice) -> str:
        """Segment and channel, for a message."""
        return f"segment {self.record.segment[part.start]}, channel {self.channel}"


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Find the trend of each chosen angle in each segment, and take it out.

    Parameters
    ----------
    tables : mapping
        ``attitude``, and ``gyro`` or ``gyro_increments`` for the sample interval.
    settings : Settings
    stand : Stand

    Returns
    -------
    dict
        ``trend`` (one row a segment and angle), ``attitude_corrected``, ``findings``.

    Raises
    ------
    StageError
        If the onset cannot be decided or lies outside the record, if the maxima are too close to each
        other, if the stated frequency cannot be seen in the record, or if every segment is too short.
    """
    attitude = tables["attitude"]
    angles: dict[str, Vector] = {
        name: attitude[name].to_numpy().astype(np.float64, copy=True) for name in ANGLES
    }
    trends: list[Row] = []
    findings: list[Row] = []
    if settings.method != "none":
        record = _record(tables, angles, settings, findings)
        for channel in dict.fromkeys(settings.channels):
            trends += _detrend(_Task(record, channel, settings, findings), angles[channel])
    columns = {"time": attitude["time"], "segment": attitude["segment"], **angles}
    return {
        "trend": rows("trend", sorted(trends, key=lambda row: row["segment"])),
        "attitude_corrected": contracts.table("attitude_corrected", columns),
        "findings": rows("findings", findings),
    }


def _record(tables: Tables, angles: dict[str, Vector], settings: Settings, findings: list[Row]) -> _Record:
    """The clock of the attitude, the sample interval of the gyro, and the onset."""
    attitude = tables["attitude"]
    time = attitude["time"].to_numpy().astype(np.int64)
    if time.size < 2:
        raise StageError(
            "stage detrend, table attitude",
            expected="an attitude to find a trend in",
            found=counted(time.size, "row"),
            remedy="see the findings of the stages before",
        )
    record = _Record(time, attitude["segment"].to_numpy(), _sample_interval(tables, time), None)
    if settings.onset == "none":
        return record
    if settings.onset == "auto":
        onset, note = _find_onset(record, angles)
        findings.append(note)
    else:
        onset = int(time[0]) + round(settings.onset * 1e9)
    if not time[0] < onset < time[-1]:
        raise StageError(
            "test plan, key detrend.onset",
            expected=f"seconds from the record's start, between 0 and {(time[-1] - time[0]) * _NS:g}",
            found=f"{settings.onset}",
            remedy="state when the vibration begins, or onset = 'none' if it lasts through the record",
            exit_code=ExitCode.USAGE,
        )
    return _Record(record.time, record.segment, record.interval, onset)


def _sample_interval(tables: Tables, time: Time) -> float:
    """Median interval between the gyro's samples, s; the attitude's own step where there is no gyro."""
    step = float(np.median(np.diff(time)))
    for name in MAY_CONSUME:
        if name in tables:
            intervals = np.diff(tables[name]["time"].to_numpy())
            intervals = intervals[intervals > 0]
            if intervals.size:
                return max(float(np.median(intervals)), step) * _NS
    return step * _NS


def _detrend(task: _Task, angle: Vector) -> list[Row]:
    """Take the trend of each segment out of the angle, in place; the rows of ``trend``."""
    record = task.record
    trends: list[Row] = []
    smooth: SmoothMotion | None = None
    reason = ""
    for piece in record.pieces:
        if record.onset is not None and record.time[piece.stop - 1] <= record.onset:
            reason = "the vibration has not begun"
        else:
            try:
                smooth = smooth or _smooth_motion(task, piece, angle)
                trends.append(_correct(task, piece, smooth, angle))
                continue
            except TooFewRowsError as error:
                reason = str(error)
        task.note(piece, "trend left in", f"{task.where(piece)} stays as it is: {reason}")
    if not trends:
        raise StageError(
            f"stage detrend, channel {task.channel}",
            expected="a segment that is long enough for a trend",
            found=f"{counted(len(record.pieces), 'segment')}, none with one ({reason})",
            remedy="record longer, raise interpolate.max_gap, or state detrend.method = 'none'",
        )
    return trends


def _smooth_motion(task: _Task, piece: slice, angle: Vector) -> SmoothMotion | None:
    """The smooth motion before t*, from the segment that holds t*; its time is the record's."""
    record = task.record
    if record.onset is None:
        return None
    before = slice(piece.start, piece.start + int(np.searchsorted(record.time[piece], record.onset)))
    found = before.stop - before.start
    if found > 2 * record.block(piece):
        t = record.seconds(before, record.start)
        return fit_smooth_motion(t, angle[before], (record.onset - record.start) * _NS, record.block(piece))
    raise StageError(
        f"stage detrend, {task.where(piece)}",
        expected="smooth motion before the onset of the vibration, in the same segment",
        found=f"{counted(found, 'row')} before it",
        remedy="check detrend.onset; a gap just before the onset hides the smooth motion",
    )


def _correct(task: _Task, piece: slice, smooth: SmoothMotion | None, angle: Vector) -> Row:
    """Take the trend of one segment out of the angle, in place; the row of ``trend``."""
    record = task.record
    start = int(record.time[piece.start])
    origin = start if record.onset is None else max(start, record.onset)
    part = slice(piece.start + int(np.searchsorted(record.time[piece], origin)), piece.stop)
    if part.stop - part.start < FEWEST_BLOCKS:
        raise TooFewRowsError(f"too few rows for a trend and its noise: {part.stop - part.start}")
    remainder = angle[part].copy()
    if smooth is not None:
        remainder -= smooth(record.seconds(part, record.start))
    t = record.seconds(part, origin)
    frequency = _frequency(task, part, remainder)
    trend = _trend(task, part, t, remainder, frequency)
    angle[part] -= trend.a * t + trend.b
    a_error, b_error = trend.a_standard_error, trend.b_standard_error
    row: Row = {"onset": None, "smooth_a": None, "smooth_b": None}
    if smooth is not None:
        a_error = float(np.hypot(a_error, smooth.a_standard_error))
        b_error = float(np.hypot(b_error, smooth.standard_error((origin - record.start) * _NS)))
        row = {
            "onset": record.onset if origin > start else None,
            "smooth_a": smooth.a,
            "smooth_b": smooth.a * (start - record.start) * _NS + smooth.b,
        }
    return row | {
        "segment": int(record.segment[piece.start]),
        "channel": task.channel,
        "method": task.settings.method,
        "origin": origin,
        "a": trend.a,
        "a_standard_error": a_error,
        "b": trend.b,
        "b_standard_error": b_error,
        "frequency": frequency,
        "white_angle_noise": trend.white_angle_noise,
        "angle_random_walk": trend.angle_random_walk,
    }


def _trend(task: _Task, part: slice, t: Vector, y: Vector, frequency: float | None) -> Trend:
    """The trend by the chosen method."""
    settings, block = task.settings, task.record.block(part)
    harmonics = _harmonics(task, part, frequency)
    if settings.method == "robust":
        trend = robust(t, y, frequency, harmonics, block)
        for kind, count in {"outlying row": trend.left_out, "jump": trend.jumps}.items():
            if count:
                task.note(part, kind, f"the robust trend left out {counted(count, kind)}", count)
        return trend
    weighted = harmonic(t, y, frequency, harmonics, block)
    if settings.method == "harmonic":
        return weighted
    extremes = find_extremes(t, y)
    least = settings.min_separation * float(t[-1] - t[0])
    if extremes.separation < least:
        raise StageError(
            f"stage detrend, {task.where(part)}",
            expected=f"the maxima of the record's two halves at least {least:g} s apart",
            found=f"{extremes.separation:g} s",
            remedy="use detrend.method = 'harmonic', which needs no extremes, or state a smaller "
            "detrend.min_separation",
        )
    return trend_by_extremes(extremes, weighted)


def _frequency(task: _Task, part: slice, y: Vector) -> float | None:
    """The stated fundamental, or that found in the angle; None where it does not vibrate."""
    settings, step = task.settings, task.record.step(part)
    if settings.frequency is None:
        return fundamental(winsorised(y) if settings.method == "robust" else y, step, settings.harmonics)
    if settings.frequency >= 0.5 / step:
        raise StageError(
            "test plan, key detrend.frequency",
            expected=f"less than {0.5 / step:g} Hz, the Nyquist frequency of the attitude",
            found=f"{settings.frequency:g} Hz",
            remedy="state the vibration's frequency, or leave it out to have it found",
            exit_code=ExitCode.USAGE,
        )
    return settings.frequency


def _harmonics(task: _Task, part: slice, frequency: float | None) -> int:
    """Harmonics a line below the Nyquist frequency of the samples; the fundamental always."""
    if frequency is None:
        note = "no line stands out of the spectrum: the trend is fitted without a vibration"
        task.note(part, "no vibration", note)
        return 0
    record, asked = task.record, task.settings.harmonics
    nyquist = 0.5 / record.interval
    line_width = 1 / (record.step(part) * (part.stop - part.start))
    seen = max(1, min(asked, int(np.ceil((nyquist - line_width) / frequency)) - 1))
    if seen < asked:
        note = (
            f"harmonics {seen + 1} to {asked} of {frequency:g} Hz are not below {nyquist:g} Hz, "
            "the Nyquist frequency of the samples: left out"
        )
        task.note(part, "harmonic left out", note)
    return seen


def _find_onset(record: _Record, angles: dict[str, Vector]) -> tuple[int, Row]:
    """When the vibration begins, from all three angles."""
    samples = np.column_stack(list(angles.values()))
    pieces = record.pieces
    stride = max(1, round(record.interval / record.step(slice(None))))
    onset = find_onset([samples[piece] for piece in pieces], record.step(slice(None)), stride)
    if onset is None:
        raise StageError(
            "stage detrend, onset of the vibration",
            expected="one rise of the vibration's power, to at least four times what it was",
            found="none",
            remedy="state detrend.onset in seconds from the record's start, or 'none' if the vibration lasts "
            "through the record",
        )
    time = int(record.time[pieces[onset.stretch].start + onset.row])
    detail = (
        f"the vibration begins {(time - record.start) * _NS:.6g} s after the record's start, where "
        f"the power rises {onset.ratio:.3g} times; good to {onset.accuracy:.2g} s"
    )
    return time, finding("detrend", "attitude", "onset", "info", detail, start=time, end=time)
