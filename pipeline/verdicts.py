"""The verdict on a recording: the gravest of those on its metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

Verdict = Literal["pass", "marginal", "fail", "not evaluated"]
Row = Mapping[str, Any]


def limited(metrics: Sequence[Row]) -> list[Row]:
    """The rows of ``metrics`` that have a limit."""
    return [m for m in metrics if m["lower_limit"] is not None or m["upper_limit"] is not None]


def overall(metrics: Sequence[Row]) -> Verdict:
    """The gravest verdict on any metric with a limit; without any, "not evaluated".

    A limit that could not be evaluated is one that is not met: it fails the recording.
    """
    verdicts = {m["verdict"] for m in limited(metrics)}
    if not verdicts:
        return "not evaluated"
    if verdicts & {"fail", "not evaluated"}:
        return "fail"
    return "marginal" if "marginal" in verdicts else "pass"
