"""The audit of time: rate, jitter, gaps, stamps that do not advance, and the clocks of a message compared."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.formats.base import CLOCKS
from pipeline.numerics.sampling import (
    ClockComparison,
    Gaps,
    Intervals,
    Runs,
    compare_clocks,
    gaps,
    intervals,
    runs,
)
from pipeline.numerics.time_grid import advancing
from pipeline.stages._audit_rows import StreamReport
from pipeline.stages.base import counted

_DECIDED = 3.0
"""Standard errors that a drift must be away from zero to be called one."""

_FEWEST_FOR_DRIFT = 256
"""Samples below which the 64 blocks of the drift hold fewer than four each."""


def audit_stamps(report: StreamReport, gap_factor: float, max_jitter: float) -> Intervals | None:
    """Mark stamps that do not advance, gaps and jitter; say the rate. None where nothing advances."""
    advance = advancing(report.time)
    for kind, mask, what in (
        ("repeated stamp", advance.repeated, "under the time of another"),
        ("backward stamp", advance.out_of_order, "under a time out of order"),
    ):
        _mark_stamps(report, kind, runs(mask), what)
        report.figure(kind.replace(" ", "_") + "_count", int(mask.sum()))
    if np.count_nonzero(advance.kept) < 2:
        if len(report.time) > 1:
            report.say("no time", "error", "the stamps do not advance: choose another clock")
        return None
    regular = intervals(report.time)
    report.figure("sample_rate", 1 / regular.nominal, "Hz")
    report.figure("rate_jitter", regular.jitter, "s")
    if regular.batched:
        report.say(
            "batched stamps",
            "warning",
            "most samples are stamped at once, in batches, so that the stamps do not tell when each was "
            "taken: choose another clock",
        )
    elif regular.jitter > max_jitter * regular.nominal:
        report.say(
            "jitter",
            "warning",
            f"intervals scatter by {regular.jitter:.3g} s (robust standard deviation) about "
            f"{regular.nominal:.6g} s",
        )
    _mark_gaps(report, gaps(report.time, regular.nominal, gap_factor), regular.nominal)
    return regular


def _mark_stamps(report: StreamReport, kind: str, found: Runs, what: str) -> None:
    report.mark(kind, "warning", found, lambda i: f"{counted(found.length[i], 'sample')} {what}")


def _mark_gaps(report: StreamReport, found: Gaps, nominal: float) -> None:
    report.mark(
        "gap",
        "warning",
        Runs(found.before, found.after + 1),
        lambda i: (
            f"{found.length[i]:.6g} s without a sample, where {nominal:.6g} s is usual: about "
            f"{counted(found.lost[i], 'sample')} lost"
        ),
        count=found.lost,
    )
    report.figure("gap_count", len(found))
    report.figure("longest_gap", float(found.length.max(initial=0.0)), "s")
    report.figure("lost_count", int(found.lost.sum()))


def audit_clocks(report: StreamReport, table: pa.Table, max_drift: float, max_jump: float) -> None:
    """Compare each clock of the messages with the one that the test plan chose."""
    for name in CLOCKS:
        present = pc.is_valid(table.column(name)).to_numpy(zero_copy_only=False)
        if np.count_nonzero(present) < 2:
            continue
        # Nulls are filled before, not after: NumPy has no null integer, and float64 no nanoseconds.
        clock = pc.fill_null(table.column(name), 0).to_numpy()[present]
        chosen = report.time[present]
        if np.array_equal(clock, chosen):
            continue
        if clock.min() == clock.max():
            report.say("clock stands still", "info", f"{name} is {clock[0]} ns in every sample", channel=name)
            continue
        _compare(report, name, compare_clocks(clock, chosen), len(clock), max_drift, max_jump)


def _compare(
    report: StreamReport, name: str, found: ClockComparison, count: int, max_drift: float, max_jump: float
) -> None:
    report.figure("clock_offset", found.offset, "s", channel=name)
    report.figure("clock_jump", found.jump, "s", channel=name)
    text = [f"median offset {found.offset:.6g} s", f"largest jump {found.jump:.3g} s"]
    drifts = False
    if count >= _FEWEST_FOR_DRIFT and np.isfinite(found.drift):
        error = found.drift_standard_error
        report.figure("clock_drift", found.drift, channel=name, standard_error=error)
        text.append(f"drift {found.drift * 1e6:.3g} ± {error * 1e6:.2g} ppm")
        drifts = abs(found.drift) > max_drift and abs(found.drift) > _DECIDED * error
    if found.batch >= 1.5:
        text.append(f"in batches of {found.batch:.3g} samples")
    wrong = drifts or abs(found.jump) > max_jump
    report.say(
        "clocks differ",
        "warning" if wrong else "info",
        f"{name} against the chosen clock: {', '.join(text)}",
        channel=name,
    )
