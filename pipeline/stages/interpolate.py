"""Interpolate: samples of the gyro become rates on a uniform grid, with their exact integrals.

Only finite samples whose time strictly advances are used. Where two of them lie farther apart than
``max_gap`` the record is split: nothing is interpolated across. Each segment gets its own grid from its
first to its last sample, of as many steps as the median sample interval and ``oversampling`` ask for, so
that the grid meets the samples of a uniform record.

Of angle increments their running sum is interpolated, by one degree more, so that the integrals of the
rates between the samples are the increments recorded. An increment that is missing is angle lost: there
the record is always split.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline import contracts
from pipeline.errors import ExitCode
from pipeline.numerics.harmonic import HarmonicError
from pipeline.numerics.interpolation import DEGREES, Method, MethodName, fit, fit_from_angle
from pipeline.numerics.time_grid import advancing, uniform_grid
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import StageError, Stand, Tables, counted, finding, rows

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Findings = list[dict[str, Any]]

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME = ("gyro", "gyro_increments")
PRODUCES = ("rates", "findings")
METRICS: tuple[str, ...] = ()

_GAP_OF_RATES = 3.5
_GAP_OF_INCREMENTS = 1.5
"""Default ``max_gap`` in median sample intervals. Half an interval of jitter is allowed; of rates two lost
samples are bridged, of increments none, since the angle they held is not known."""


class Settings(_Settings):
    """Which interpolant, on which grid."""

    method: MethodName = Field("local_polynomial", description="interpolant between the samples")
    degree: int | None = Field(
        None,
        description="degree of local_polynomial (1 to 5), spline and harmonic (2, 3, 5, 7); default 3. "
        "Of angle increments their sum is interpolated, by one degree more",
    )
    oversampling: int = Field(1, ge=1, le=10_000, description="grid steps per median sample interval")
    max_gap: float | None = Field(
        None,
        gt=0,
        description="longest interval between samples that is bridged, s; default 3.5 median sample "
        "intervals, of angle increments 1.5",
    )
    harmonics: int = Field(1, ge=1, description="method harmonic: number of harmonics, each below Nyquist")
    frequency: float | None = Field(
        None,
        gt=0,
        description="method harmonic: where the search for the fundamental begins, Hz; default the "
        "highest peak of the spectrum",
    )

    @model_validator(mode="after")
    def _degree_is_of_the_method(self) -> Self:
        if self.degree is None:
            return self
        known = DEGREES.get(self.method, ())
        if self.degree not in known:
            choice = f"degree {', '.join(map(str, known))}" if known else "no degree"
            raise ValueError(f"method {self.method} takes {choice}; found {self.degree}")
        return self

    @property
    def interpolant(self) -> Method:
        """The method as the mathematics wants it."""
        return Method(self.method, self.degree or 3, self.harmonics, self.frequency)


@dataclass(frozen=True, slots=True)
class _Record:
    """The usable samples: time [ns], channels (n, 3), and before which of them something was lost."""

    stream: str
    time: Time
    values: Float
    after_loss: NDArray[np.bool_]

    @property
    def of_increments(self) -> bool:
        return self.stream == "gyro_increments"


@dataclass(frozen=True, slots=True)
class _Sampled:
    """Rates (m, 3) and increments (m, 3) of one segment on its grid."""

    time: Time
    rates: Float
    increments: Float


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Interpolate ``gyro`` or ``gyro_increments``.

    Returns
    -------
    dict
        ``rates``, and ``findings``: what was left out, and where the record was split.

    Raises
    ------
    StageError
        If no segment has enough samples (exit code 3), or the method cannot decide.
    """
    findings: Findings = []
    record = _usable(tables, findings)
    interval = float(np.median(np.diff(record.time)))
    segments: list[_Sampled] = []
    refusal: StageError | None = None
    for piece in _segments(record, settings, interval, findings):
        try:
            segments.append(_interpolated(piece, settings, interval))
        except StageError as error:
            refusal = refusal or error
            findings.append(_left_out(piece, error))
    if not segments:
        raise refusal or _too_few(record, settings)
    return {"rates": _table(segments), "findings": rows("findings", findings)}


def _usable(tables: Tables, findings: Findings) -> _Record:
    """The finite samples whose time strictly advances; what is left out becomes findings."""
    stream = next((name for name in MAY_CONSUME[::-1] if name in tables), None)
    if stream is None:
        raise StageError(
            "stage interpolate",
            expected="a stream 'gyro'",
            found="none",
            remedy="map one under [streams.gyro] of the test plan",
            exit_code=ExitCode.USAGE,
        )
    table = tables[stream]
    prefix = "increment_" if stream == "gyro_increments" else ""
    time = table.column("time").to_numpy()
    values = np.stack([table.column(prefix + axis).to_numpy() for axis in "pqr"])
    finite = np.isfinite(values).all(axis=0)
    _say_left_out(findings, stream, "NaN", "with a channel that is not finite", time[~finite])
    advance = advancing(time[finite])
    _say_left_out(
        findings, stream, "repeated stamp", "whose time repeats another's", time[finite][advance.repeated]
    )
    _say_left_out(
        findings, stream, "backward stamp", "whose time is out of order", time[finite][advance.out_of_order]
    )
    index = np.flatnonzero(finite)[advance.kept]
    if index.size < 2:
        raise StageError(
            f"stage interpolate, stream {stream!r}",
            expected="at least 2 finite samples of advancing time",
            found=f"{index.size} of {len(time)}",
            remedy="check the recording, and the stream's clock and channels in the test plan",
            exit_code=ExitCode.INPUT,
        )
    lost_before = np.diff(np.cumsum(~finite)[index], prepend=0) > 0
    if index.size == len(time):
        return _Record(stream, time, values.T, lost_before)
    return _Record(stream, time[index], np.ascontiguousarray(values[:, index]).T, lost_before)


def _say_left_out(findings: Findings, stream: str, kind: str, which: str, time: Time) -> None:
    if time.size:
        findings.append(
            finding(
                "interpolate",
                stream,
                kind,
                "warning",
                f"{counted(time.size, 'sample')} {which}: left out",
                start=int(time.min()),
                end=int(time.max()),
                count=int(time.size),
            )
        )


def _segments(record: _Record, settings: Settings, interval: float, findings: Findings) -> Iterator[_Record]:
    """The stretches between gaps; each gap becomes a finding."""
    intervals = np.diff(record.time)
    if settings.max_gap is not None:
        longest = settings.max_gap * 1e9
    else:
        longest = (_GAP_OF_INCREMENTS if record.of_increments else _GAP_OF_RATES) * interval
    split = intervals > longest
    if record.of_increments:
        split |= record.after_loss[1:]
    starts = np.flatnonzero(split) + 1
    for start in starts:
        before, after = int(record.time[start - 1]), int(record.time[start])
        gap = (after - before) / 1e9
        why = (
            f"longer than max_gap, {longest / 1e9:.6g} s"
            if after - before > longest
            else "in which an angle increment is lost"
        )
        findings.append(
            finding(
                "interpolate",
                record.stream,
                "gap",
                "warning",
                f"the record is split: {gap:.6g} s without a usable sample, {why}",
                start=before,
                end=after,
            )
        )
    bounds = [0, *starts.tolist(), len(record.time)]
    for first, last in pairwise(bounds):
        yield _Record(
            record.stream, record.time[first:last], record.values[first:last], record.after_loss[first:last]
        )


def _interpolated(piece: _Record, settings: Settings, interval: float) -> _Sampled:
    """One segment on its grid."""
    method = settings.interpolant
    if len(piece.time) < method.samples_needed:
        raise _too_few(piece, settings)
    start, end = int(piece.time[0]), int(piece.time[-1])
    steps = max(1, round((end - start) * settings.oversampling / interval))
    try:
        grid = uniform_grid(start, end, steps)
    except ValueError as error:
        raise StageError(
            "test plan, key interpolate.oversampling",
            expected="grid steps of at least 1 ns",
            found=f"{interval / settings.oversampling:.3g} ns",
            remedy="lower it",
            exit_code=ExitCode.USAGE,
        ) from error
    t, times = (piece.time - start) / 1e9, (grid - start) / 1e9
    try:
        if piece.of_increments:
            angle = np.cumsum(piece.values, axis=0) - piece.values[0]
            rates, increments = fit_from_angle(method, t, angle).sample(times)
        else:
            rates, increments = fit(method, t, piece.values).sample(times)
    except HarmonicError as error:
        raise StageError(
            f"stage interpolate, method harmonic, {start / 1e9:.6f} s to {end / 1e9:.6f} s",
            expected=error.expected,
            found=error.found,
            remedy=error.remedy,
        ) from error
    return _Sampled(grid, rates, increments)


def _too_few(piece: _Record, settings: Settings) -> StageError:
    return StageError(
        f"stage interpolate, stream {piece.stream!r}",
        expected=f"a stretch of at least {settings.interpolant.samples_needed} samples without a gap for "
        f"method {settings.method}",
        found=f"{len(piece.time)}",
        remedy="choose a simpler method or a longer max_gap, or check the recording",
        exit_code=ExitCode.INPUT,
    )


def _left_out(piece: _Record, error: StageError) -> dict[str, Any]:
    return finding(
        "interpolate",
        piece.stream,
        "segment left out",
        "warning",
        f"a stretch of {counted(len(piece.time), 'sample')} is left out: expected {error.expected}, found "
        f"{error.found}",
        start=int(piece.time[0]),
        end=int(piece.time[-1]),
        count=len(piece.time),
    )


def _table(segments: list[_Sampled]) -> pa.Table:
    def joined(arrays: list[Float]) -> Float:
        return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)

    columns: dict[str, NDArray[Any]] = {
        "time": np.concatenate([s.time for s in segments]),
        "segment": np.repeat(np.arange(len(segments), dtype=np.int32), [len(s.time) for s in segments]),
    }
    for k, axis in enumerate("pqr"):
        columns[axis] = joined([s.rates[:, k] for s in segments])
        columns["increment_" + axis] = joined([s.increments[:, k] for s in segments])
    return contracts.table("rates", columns)
