"""Every figure of the paper, by the stages themselves (Godorov & Lutmanov 2016, and beyond)."""

import math

import pytest

from pipeline.reproduce import as_text, godorov


@pytest.fixture(scope="module")
def rows():
    return godorov()


def ours(rows, item, quantity):
    [found] = [row["ours"] for row in rows if row["item"] == item and row["quantity"] == quantity]
    return found


def test_every_figure_is_within_its_tolerance(rows):
    assert [row for row in rows if not row["within"]] == []


def test_every_figure_is_there(rows):
    assert len(rows) == 6 + 2 * 10 + 3 + 2 + 4
    assert all(math.isfinite(row["ours"]) for row in rows)
    assert sum(row["printed"] is not None for row in rows) == 6
    assert len({(row["item"], row["quantity"]) for row in rows}) == len(rows)


def test_the_paper_experiment(rows):
    """Stated here a second time, so that a slip in the table of expectations shows."""
    item = "sections 3 and 4, local cubic"
    assert ours(rows, item, "I_gamma") == pytest.approx(143.6247, rel=1e-4)
    assert ours(rows, item, "a, rad/s") == pytest.approx(-0.013467, rel=0.02)
    assert ours(rows, item, "b, rad") == pytest.approx(4.69e-5, rel=0.02)
    assert ours(rows, item, "I_gamma corrected") == pytest.approx(0.12387, rel=2e-3)
    assert ours(rows, "harmonic model", "I_gamma, at most") <= 6e-6
    assert ours(rows, "section 5, local cubic", "I_gamma corrected, at most") <= 3e-4


def test_differences_are_what_they_say(rows):
    for row in rows:
        assert row["relative_difference"] == pytest.approx((row["ours"] - row["oracle"]) / row["oracle"])


def test_text_has_a_line_a_figure_and_the_sum(rows):
    lines = as_text(rows).splitlines()
    assert len(lines) == len(rows) + 2
    assert lines[-1].startswith(f"{len(rows)} of {len(rows)} figures within")
    broken = [{**rows[0], "within": False}]
    assert "NOT WITHIN" in as_text(broken)
