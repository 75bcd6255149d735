from __future__ import annotations

import numpy as np
import pytest
from bokeh.models import PlainText
from report_tables import START, finding, from_rows

from pipeline.report import style, timeline
from pipeline.report.base import Clock

CLOCK = Clock(START, 10.0)


def test_findings_closer_than_a_pixel_are_one_mark_of_the_gravest_severity() -> None:
    rows = [finding("spike", "info", 1.0 + 1e-4 * i, 1.0 + 1e-4 * i) for i in range(50)]
    rows += [finding("spike", "error", 1.0025, 1.0025), finding("spike", "info", 9.0, 9.0)]
    first, second = timeline.marks(from_rows("findings", rows), CLOCK)
    assert (first["number"], first["severity"], second["number"]) == (51, "error", 1)
    assert (first["start"], first["end"]) == pytest.approx((1.0, 1.0049), abs=1e-9)  # whole nanoseconds


def test_the_marks_of_a_million_findings_fit_the_page() -> None:
    rng = np.random.default_rng(7)
    rows = [finding("spike", "info", t, t) for t in rng.uniform(0, 10, 20_000)]
    assert len(timeline.marks(from_rows("findings", rows), CLOCK)) <= style.COLUMNS


def test_what_lies_outside_the_record_is_drawn_at_its_edge_and_what_has_no_time_not_at_all() -> None:
    rows = [
        finding("backward stamp", "warning", -1e6, -1e6),
        finding("gap", "warning", 9.0, 20.0),
        finding("clocks", "warning", None, None),
        finding("open", "info", 2.0, None),
    ]
    found = timeline.marks(from_rows("findings", rows), CLOCK)
    assert [(m["kind"], m["start"], m["end"]) for m in found] == [
        ("backward stamp", 0.0, 0.0),
        ("open", 2.0, 2.0),
        ("gap", 9.0, 10.0),
    ]


def test_more_kinds_than_lanes_share_the_last_lane() -> None:
    rows = [finding(f"kind {i}", "info", 0.1 * i, 0.1 * i) for i in range(40)]
    found = timeline.marks(from_rows("findings", rows), CLOCK)
    kinds = list(dict.fromkeys(m["kind"] for m in found))
    assert len(kinds) == 12
    assert kinds[-1] == "other kinds"
    assert sum(m["number"] for m in found) == 40
    lanes = timeline.lanes(found, style.span(0, 10), "time [s]")
    assert len(lanes.yaxis.major_label_overrides) == 12


def test_a_kind_that_looks_like_a_formula_is_a_plain_label() -> None:
    found = timeline.marks(from_rows("findings", [finding("$$x^2$$", "info", 1.0, 2.0)]), CLOCK)
    lanes = timeline.lanes(found, style.span(0, 10), "time [s]")
    (label,) = lanes.yaxis.major_label_overrides.values()
    assert isinstance(label, PlainText)
    assert label.text == "$$x^2$$"


def test_findings_of_one_stream() -> None:
    rows = [finding("frozen", "warning", 0.0, 1.0, stream="reference"), finding("gap", "warning", 2.0, 3.0)]
    assert [m["stream"] for m in timeline.marks(from_rows("findings", rows), CLOCK)] == ["reference", "gyro"]
    assert [m["kind"] for m in timeline.marks(from_rows("findings", rows), CLOCK, ["gyro"])] == ["gap"]


def test_curves_are_tinted_where_it_matters_only() -> None:
    for severity, strips in (("info", 0), ("warning", 1), ("error", 1)):
        made = style.panel("p", style.span(0, 10))
        timeline.shade(made, timeline.marks(from_rows("findings", [finding("x", severity, 1, 2)]), CLOCK))
        assert len(made.renderers) == strips
