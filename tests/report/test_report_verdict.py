from __future__ import annotations

import re
from typing import Any

import pytest
from report_tables import metric

from pipeline.report.verdict import badge, banner, bar, limits, reason


def limited(verdict: str, name: str = "peak_error") -> dict[str, Any]:
    return metric(name, "gamma", 1.0, upper_limit=2.0, verdict=verdict)


@pytest.mark.parametrize(
    ("verdicts", "word", "sentence"),
    [
        ([], "not evaluated", "The test plan sets no limit on any metric of this recording."),
        (["pass"], "pass", "The one limit is met."),
        (["fail"], "fail", "1 of 1 limit not met: peak error (gamma)."),
        (["pass", "pass"], "pass", "All 2 limits are met."),
        (["pass", "marginal"], "marginal", "All 2 limits are met, but only just by peak error (gamma)."),
        (["pass", "fail", "marginal"], "fail", "1 of 3 limits not met: peak error (gamma)."),
        (["not evaluated", "pass"], "fail", "1 of 2 limits not evaluated: peak error (gamma)."),
        (
            ["not evaluated", "fail"],
            "fail",
            "1 of 2 limits not met: peak error (gamma). 1 of 2 limits not evaluated: peak error (gamma).",
        ),
    ],
)
def test_the_gravest_verdict_counts(verdicts: list[str], word: str, sentence: str) -> None:
    unlimited = metric("sample_count", "gyro", 401.0)
    metrics = [unlimited, *(limited(verdict) for verdict in verdicts)]
    assert reason(metrics) == sentence
    assert f"<strong>{word}</strong><p>{sentence}</p>" in banner(metrics)


def test_a_long_list_of_failures_is_cut() -> None:
    sentence = reason([limited("fail", f"metric_{i}") for i in range(6)])
    assert sentence.endswith("metric 3 (gamma) and more.")


def test_limits_in_words() -> None:
    assert limits(metric("b", "gyro", 1.0, lower_limit=0.0)) == "≥ 0"
    assert limits(metric("b", "gyro", 1.0, upper_limit=2.0)) == "≤ 2"
    assert limits(metric("c", "gyro", 1.0, lower_limit=-0.5, upper_limit=0.5)) == "−0.5 to 0.5"


def test_a_verdict_is_a_word_and_a_sign_beside_its_colour() -> None:
    assert re.sub("<[^>]*>", "", badge("not evaluated")) == "– not evaluated"
    assert re.sub("<[^>]*>", "", badge("fail")) == "✕ fail"


def place(svg: str, part: str) -> tuple[float, float]:
    found = re.search(rf'class="{part}" x="([\d.]+)".*?width="([\d.]+)"', svg)
    assert found
    return float(found[1]), float(found[2])


@pytest.mark.parametrize("value", [-3.0, 0.0, 0.5, 1.5, 100.0])
def test_the_stroke_lies_in_the_shade_exactly_if_the_value_is_allowed(value: float) -> None:
    svg = bar(metric("a", "gyro", value, lower_limit=-1.0, upper_limit=1.0))
    (left, width), (stroke, thickness) = place(svg, "allowed"), place(svg, "value")
    centre = stroke + thickness / 2
    assert (left <= centre <= left + width) == (-1.0 <= value <= 1.0)


def test_a_value_that_is_missing_has_no_bar() -> None:
    assert bar(metric("a", "gyro", None, upper_limit=1.0)) == ""
