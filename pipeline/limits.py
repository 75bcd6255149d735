"""Limits of the test plan, and the verdict that each gives a figure.

A figure outside its limits fails. Inside them it is marginal where it lies beyond the plan's marginal
limits, or so near a limit that two of its standard errors reach it; else it passes. A figure without limits,
or without a value, is not evaluated. A limit that finds no figure is not met: it stands in the metrics as a
row without a value.

One limit holds without being written: what the audit calls an error in a stream (a dead channel, a wrong
unit) fails the recording, unless the plan allows a number of them by a limit of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, Self

import pyarrow as pa
from pydantic import Field, model_validator

from pipeline.plan_faults import Fault, refuse
from pipeline.stages.base import Settings, metric, rows
from pipeline.verdicts import Verdict

COVERAGE = 2.0
"""Standard errors by which a figure may be off: about 95 % of a normal distribution."""


class Limit(Settings):
    """What one figure may be; at least one of lower and upper."""

    metric: Annotated[str, Field(min_length=1)] = Field(description="name of the figure")
    channel: Annotated[str, Field(min_length=1)] = Field(
        description="what the figure is about: an angle (gamma), a stream (gyro), a stream's channel (gyro.p)"
    )
    lower: float | None = Field(None, description="smallest value that passes, in the figure's unit")
    upper: float | None = Field(None, description="largest value that passes, in the figure's unit")
    marginal_lower: float | None = Field(None, description="values from lower up to here are marginal")
    marginal_upper: float | None = Field(None, description="values from here up to upper are marginal")

    @model_validator(mode="after")
    def _bounds_are_in_order(self) -> Self:
        if self.lower is None and self.upper is None:
            refuse([Fault((), "the key 'lower' or 'upper'", "neither", "add the limit")])
        faults = []
        for owner in ("lower", "upper"):
            marginal = f"marginal_{owner}"
            if getattr(self, marginal) is not None and getattr(self, owner) is None:
                remedy = f"add {owner}, or remove {marginal}"
                faults.append(Fault((marginal,), f"{owner} beside {marginal}", "none", remedy))
        given = [
            (key, value)
            for key in ("lower", "marginal_lower", "marginal_upper", "upper")
            if (value := getattr(self, key)) is not None
        ]
        for (key, value), (above, bound) in pairwise(given):
            if value > bound:
                expected = f"{key} not above {above} = {bound:g}"
                faults.append(Fault((key,), expected, f"{value:g}", "exchange or correct them"))
        if faults:
            refuse(faults)
        return self

    def verdict(self, value: float | None, standard_error: float | None) -> Verdict:
        """What the limit says of a value; ``standard_error`` None counts as exact."""
        if value is None:
            return "not evaluated"
        if not _within(value, self.lower, self.upper):
            return "fail"
        margin = COVERAGE * (standard_error or 0.0)
        sure = _within(value - margin, self.lower, None) and _within(value + margin, None, self.upper)
        return "pass" if sure and _within(value, self.marginal_lower, self.marginal_upper) else "marginal"


AUDIT_ERRORS = "error_count"
"""The audit's figure that has a limit in every plan."""


def judge(
    metrics: pa.Table, limits: Sequence[Limit], procedure: str, pending: Collection[str] = ()
) -> pa.Table:
    """Give every figure its limits and its verdict.

    Parameters
    ----------
    metrics : pyarrow.Table
        As the stages made them.
    limits : sequence of Limit
        At most one for each metric and channel.
    procedure : str
        Name of the procedure, for the table.
    pending : collection of str, optional
        Names of metrics that stages which have not run could still add: limits on those are passed over. Any
        other limit without a figure becomes a row that is not evaluated.

    Returns
    -------
    pyarrow.Table
        ``metrics``.
    """
    figures = metrics.to_pylist()
    audited = [figure["channel"] for figure in figures if figure["name"] == AUDIT_ERRORS]
    unwritten = [Limit(metric=AUDIT_ERRORS, channel=stream, upper=0.0) for stream in audited]
    by_figure = {(limit.metric, limit.channel): limit for limit in (*unwritten, *limits)}
    judged = [_judged(figure, by_figure.get((figure["name"], figure["channel"]))) for figure in figures]
    there = {(figure["name"], figure["channel"]) for figure in figures}
    judged += [
        _judged(metric("", channel, name, None, ""), limit)
        for (name, channel), limit in by_figure.items()
        if (name, channel) not in there and name not in pending
    ]
    return rows("metrics", [{**figure, "procedure": procedure} for figure in judged])


def _judged(figure: Mapping[str, Any], limit: Limit | None) -> dict[str, Any]:
    if limit is None:
        return dict(figure)
    return {
        **figure,
        "lower_limit": limit.lower,
        "upper_limit": limit.upper,
        "verdict": limit.verdict(figure["value"], figure["standard_error"]),
    }


def _within(value: float, lower: float | None, upper: float | None) -> bool:
    return (lower is None or value >= lower) and (upper is None or value <= upper)
