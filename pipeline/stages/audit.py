"""Audit: mark what is wrong with the samples of every stream, and never edit one.

What is marked is a finding with start, end, count and a sentence with its figures; how much of it there is,
is a metric, so that a test plan can limit it. Later stages say themselves how they treat each kind. At most
``max_rows`` findings of a kind in a channel have their own row; the rest are summed in one more.

Severity
--------
error
    The stream cannot serve: fewer than two samples, a channel without any finite value, a unit that
    the reference, gravity, the Earth's field or the Earth rate that gimbal angles imply contradicts, an inner
    gimbal at 90 degrees, positions that do not move as their velocity says, streams without a common time.
warning
    Samples that a later stage leaves out, bridges or takes at face value though they may be wrong: gaps,
    stamps that do not advance, batches, jitter, NaN, frozen, clipped and spiking samples, a channel that is
    zero while others move, a rate that no gyro reaches, positions that jump, gimbal angles that do not turn
    with the Earth, clocks that drift or jump.
info
    What is worth knowing and needs no treatment: how clocks differ, a clock that stands still, a channel of
    one value, values held over several samples, a steady stretch that the reference confirms.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from pydantic import Field

from pipeline.stages._audit_gimbal import audit_earth_rate, of_all_runs
from pipeline.stages._audit_navigation import SENSORS, audit_aid, audit_size, judge_together
from pipeline.stages._audit_rows import StreamReport
from pipeline.stages._audit_time import audit_clocks, audit_stamps
from pipeline.stages._audit_units import Comparison, audit_attitude, audit_units, compare
from pipeline.stages._audit_values import Thresholds, audit_missing, audit_values
from pipeline.stages._gimbal_samples import gimbal_runs
from pipeline.stages._navigation_streams import TABLES as NAVIGATION
from pipeline.stages._streams import recorded
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Severity, Stand, Tables, counted, rows

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME: tuple[str, ...] = (
    "gyro",
    "gyro_increments",
    "reference",
    "turntable",
    "temperature",
    "gimbal",
    "runs",
    "mountings",
    *NAVIGATION,
)
PRODUCES: tuple[str, ...] = ("findings", "metrics")
_STREAMS = ("gyro", "gyro_increments", "reference", "turntable", "temperature", *NAVIGATION)
"""One stream a table; of ``gimbal``, and where there are ``mountings``, each run is one."""
_SLOW = ("turntable", "temperature")
"""Streams that stand, turn evenly or step: nothing of that is a fault."""

METRICS = (
    "sample_count",
    "sample_rate",
    "rate_jitter",
    "gap_count",
    "longest_gap",
    "lost_count",
    "repeated_stamp_count",
    "backward_stamp_count",
    "clock_offset",
    "clock_jump",
    "clock_drift",
    "nan_count",
    "frozen_count",
    "clipped_count",
    "spike_count",
    "rotation_ratio",
    "implied_earth_rate",
    "specific_force_ratio",
    "magnetic_field",
    "position_velocity_mismatch",
    "error_count",
    "warning_count",
)


class Settings(_Settings):
    """What counts as a fault."""

    gap_factor: float = Field(
        1.8, gt=1, description="an interval of more than this many nominal intervals is a gap"
    )
    max_jitter: float = Field(
        0.1,
        gt=0,
        description="robust standard deviation of the intervals that is jitter, in nominal intervals",
    )
    max_clock_drift: float = Field(
        1e-4,
        gt=0,
        description="drift of a clock against the chosen one that is a warning, s/s (1e-6 is 1 ppm)",
    )
    max_clock_jump: float = Field(
        0.1, gt=0, description="change of a clock against the chosen one between two samples that is one, s"
    )
    frozen_samples: int = Field(
        10, ge=2, description="fewest samples that hold their value bit for bit to be called frozen"
    )
    clipped_samples: int = Field(
        3, ge=2, description="fewest samples in a row at the largest or smallest value to be called clipped"
    )
    spike_factor: float = Field(
        4.0, gt=1, description="second difference of a spike, over the 90 % quantile of those around it"
    )
    max_plausible_rate: float = Field(
        40.0, gt=0, description="rate above which the unit is doubted where no reference decides, rad/s"
    )
    min_samples: int = Field(10, ge=2, description="fewer samples than this are a warning")
    max_rows: int = Field(100, ge=1, description="findings of a kind in a channel with a row of their own")


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Audit every stream that is there.

    Returns
    -------
    dict
        ``findings`` and ``metrics``.
    """
    # What was recorded may be near the largest float; what overflows then is infinite, and marks nothing.
    with np.errstate(over="ignore", invalid="ignore"):
        comparison = compare(tables) if "mountings" not in tables else None
        reports = [
            _of_stream(tables, stream, settings, comparison) for stream in _STREAMS if stream in tables
        ]
        judge_together(reports, tables)
        if "gimbal" in tables and "runs" in tables:
            reports.append(_gimbal(tables["gimbal"], tables["runs"], settings))
    for report in reports:
        _count_findings(report)
    return {
        "findings": rows("findings", [row for report in reports for row in report.findings]),
        "metrics": rows("metrics", [row for report in reports for row in report.metrics]),
    }


def _of_stream(
    tables: Tables, stream: str, settings: Settings, comparison: Comparison | None
) -> StreamReport:
    """One stream, run by run where the plan lists runs on a rate table."""
    table = tables[stream]
    if "mountings" not in tables or "run" not in table.column_names:
        return _marked(table, stream, settings, comparison)
    number = table.column("run").to_numpy()
    reports = [
        _marked(
            table.filter(pa.array(number == run["run"])), stream, settings, None, f"run {run['name']!r}: "
        )
        for run in tables["mountings"].to_pylist()
        if stream != "turntable" or run["axis_1"] is not None  # off the table it need not be recorded
    ]
    return _together(reports, stream, table, settings)


def _together(
    reports: Sequence[StreamReport], stream: str, table: pa.Table, settings: Settings
) -> StreamReport:
    """The reports of all runs in one: what lies between two runs is no gap."""
    whole = StreamReport(stream, table.column("time").to_numpy(), settings.max_rows)
    whole.findings = [row for report in reports for row in report.findings]
    whole.metrics = of_all_runs(reports)
    return whole


def _gimbal(table: pa.Table, runs: pa.Table, settings: Settings) -> StreamReport:
    """Every run of ``gimbal`` by itself, in one report."""
    reports = []
    for run in gimbal_runs(table, runs):
        about = f"run {run.name!r}: " if runs.num_rows > 1 else ""
        report = _marked(run.table, "gimbal", settings, None, about)
        audit_earth_rate(report, run)
        reports.append(report)
    return _together(reports, "gimbal", table, settings)


def _count_findings(report: StreamReport) -> None:
    for severity in ("error", "warning"):
        found = sum(row["severity"] == severity for row in report.findings)
        report.figure(f"{severity}_count", found)


def _marked(
    table: pa.Table, stream: str, settings: Settings, comparison: Comparison | None, about: str = ""
) -> StreamReport:
    """Everything about the time and the values of one stream."""
    report = StreamReport(stream, table.column("time").to_numpy(), settings.max_rows, about)
    report.figure("sample_count", table.num_rows)
    if table.num_rows < settings.min_samples:
        severity: Severity = "error" if table.num_rows < 2 else "warning"
        report.say("too few samples", severity, f"{counted(table.num_rows, 'sample')} in the record")
    if not table.num_rows:
        return report
    regular = audit_stamps(report, settings.gap_factor, settings.max_jitter)
    audit_clocks(report, table, settings.max_clock_drift, settings.max_clock_jump)
    channels = {name: table.column(name).to_numpy() for name in recorded(table, stream)}
    if stream in _SLOW:
        audit_missing(report, channels)
        return report
    if stream in NAVIGATION and stream not in SENSORS:
        audit_aid(report, table, settings.frozen_samples)
        return report
    audit_values(
        report,
        channels,
        Thresholds(settings.frozen_samples, settings.clipped_samples, settings.spike_factor),
        regular,
        comparison,
    )
    if stream == "reference":
        audit_attitude(report, channels["theta"])
    elif stream in SENSORS:
        audit_size(report, channels, regular)
    elif stream != "gimbal":
        values = np.column_stack(list(channels.values()))
        audit_units(
            report, values[np.isfinite(values).all(axis=1)], regular, comparison, settings.max_plausible_rate
        )
    return report
