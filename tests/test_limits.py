"""Verdicts, against the rules in the module's own words."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pipeline.limits import Limit, judge
from pipeline.stages.base import metric, rows
from pipeline.storage.contract_check import violations
from pipeline.verdicts import overall


def limit(**bounds: float) -> Limit:
    return Limit(metric="peak_error", channel="gamma", **bounds)


def metrics(*figures: dict[str, Any]) -> pa.Table:
    return rows("metrics", list(figures))


def figure(
    value: float | None, standard_error: float | None = None, name: str = "peak_error"
) -> dict[str, Any]:
    return metric("score", "gamma", name, value, "rad", standard_error)


@pytest.mark.parametrize(
    ("value", "standard_error", "bounds", "verdict"),
    [
        (0.1, None, {"upper": 0.2}, "pass"),
        (0.2, None, {"upper": 0.2}, "pass"),
        (0.21, None, {"upper": 0.2}, "fail"),
        (-0.1, None, {"lower": 0.0}, "fail"),
        (0.5, None, {"lower": 0.0, "upper": 1.0}, "pass"),
        (0.16, None, {"upper": 0.2, "marginal_upper": 0.15}, "marginal"),
        (0.15, None, {"upper": 0.2, "marginal_upper": 0.15}, "pass"),
        (0.05, None, {"lower": 0.0, "marginal_lower": 0.1}, "marginal"),
        (0.17, 0.02, {"upper": 0.2}, "marginal"),
        (0.15, 0.02, {"upper": 0.2}, "pass"),
        (0.03, 0.02, {"lower": 0.0}, "marginal"),
        (0.21, 0.02, {"upper": 0.2}, "fail"),
        (None, None, {"upper": 0.2}, "not evaluated"),
    ],
)
def test_verdict(
    value: float | None, standard_error: float | None, bounds: dict[str, float], verdict: str
) -> None:
    judged = judge(metrics(figure(value, standard_error)), [limit(**bounds)], "coning").to_pylist()
    assert [row["verdict"] for row in judged] == [verdict]
    assert judged[0]["procedure"] == "coning"
    assert judged[0]["upper_limit"] == bounds.get("upper")
    assert judged[0]["lower_limit"] == bounds.get("lower")
    assert (overall(judged) == "fail") is (verdict in ("fail", "not evaluated"))


def test_a_figure_without_limits_is_not_evaluated_and_hinders_nothing() -> None:
    judged = judge(metrics(figure(1e9), figure(None, name="trend_a")), [], "coning")
    assert judged.column("verdict").to_pylist() == ["not evaluated"] * 2
    assert overall(judged.to_pylist()) == "not evaluated"


def test_a_limit_without_a_figure_is_not_met() -> None:
    judged = judge(metrics(figure(0.1, name="trend_a")), [limit(upper=0.2)], "coning")
    missing = judged.to_pylist()[1]
    assert (missing["name"], missing["channel"], missing["value"]) == ("peak_error", "gamma", None)
    assert (missing["upper_limit"], missing["verdict"]) == (0.2, "not evaluated")
    assert overall(judged.to_pylist()) == "fail"
    assert violations("metrics", judged) == []


def test_a_limit_of_a_stage_that_has_not_run_is_passed_over() -> None:
    judged = judge(metrics(figure(0.1, name="trend_a")), [limit(upper=0.2)], "coning", pending={"peak_error"})
    assert judged.num_rows == 1
    assert overall(judged.to_pylist()) == "not evaluated"


@pytest.mark.parametrize(
    ("errors", "allowed", "verdict"),
    [(0, None, "pass"), (1, None, "fail"), (1, 2.0, "pass"), (3, 2.0, "fail")],
)
def test_an_error_of_the_audit_fails_unless_the_plan_allows_it(
    errors: int, allowed: float | None, verdict: str
) -> None:
    found = metrics(metric("audit", "gyro", "error_count", errors, "1"))
    limits = [] if allowed is None else [Limit(metric="error_count", channel="gyro", upper=allowed)]
    assert overall(judge(found, limits, "coning").to_pylist()) == verdict


def test_only_the_channel_that_is_named_is_limited() -> None:
    other = metric("score", "psi", "peak_error", 5.0, "rad")
    judged = judge(metrics(other, figure(0.1)), [limit(upper=0.2)], "coning")
    assert judged.column("verdict").to_pylist() == ["not evaluated", "pass"]


@pytest.mark.parametrize(
    "bounds",
    [
        {},
        {"marginal_upper": 1.0},
        {"lower": 1.0, "upper": 0.0},
        {"upper": 1.0, "marginal_upper": 2.0},
        {"lower": 1.0, "marginal_lower": 0.0},
        {"lower": 0.0, "upper": 2.0, "marginal_lower": 1.5, "marginal_upper": 1.0},
        {"upper": float("nan")},
        {"upper": float("inf")},
    ],
)
def test_bounds_that_make_no_sense_are_refused(bounds: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        limit(**bounds)


finite = st.floats(-1e6, 1e6)


@given(value=finite, error=st.none() | st.floats(0, 1e6), low=finite, high=finite)
def test_a_pass_stays_inside_with_two_standard_errors(
    value: float, error: float | None, low: float, high: float
) -> None:
    low, high = min(low, high), max(low, high)
    verdict = limit(lower=low, upper=high).verdict(value, error)
    assert (verdict == "fail") == (not low <= value <= high)
    reach = 2 * (error or 0.0)
    if verdict != "fail":
        assert (verdict == "pass") == (low <= value - reach and value + reach <= high)
