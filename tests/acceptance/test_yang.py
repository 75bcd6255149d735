"""Every figure of the paper, by the models themselves (Yang et al. 2014, and the identification beside)."""

import json
import math

import pytest

from pipeline.errors import ExitCode
from pipeline.reproduce import as_text, yang


@pytest.fixture(scope="module")
def rows():
    return yang()


def ours(rows, item, quantity):
    [found] = [row["ours"] for row in rows if row["item"] == item and row["quantity"] == quantity]
    return found


def test_every_figure_is_within_its_tolerance(rows):
    assert [row for row in rows if not row["within"]] == []


def test_every_figure_is_there(rows):
    tables, resonance, law, axes, without_table = 3 * 2 * 3, 2 * 2, 3 * 2, 3, 4
    bands, never_worse, recommended, schuler, reversing = 3 * 4, 2, 1, 3 * 2, 3
    monte_carlo, fits, white = 3 * 4, 1 + 5 * 2, 1
    closed = tables + resonance + law + axes + without_table
    assert (
        len(rows)
        == closed + bands + never_worse + recommended + schuler + reversing + monte_carlo + fits + white
    )
    assert all(math.isfinite(row["ours"]) for row in rows)
    assert all(row["printed"] is None for row in rows)  # the paper prints graphs
    assert len({(row["item"], row["quantity"]) for row in rows}) == len(rows)


@pytest.mark.parametrize(
    ("item", "at_rest", "turning", "growth"),
    [
        ("noise 1", 198.0, 7.103825398, 7.038395345e-4),
        ("noise 2, lambda = 0.01", 100.0, 7.856906707, 7.785878192e-4),
        ("noise 3, lambda = 0.01", 199.0, 1.145540093, 1.058742534e-4),
    ],
)
def test_the_tables(rows, item, at_rest, turning, growth):
    """Stated here a second time, so that a slip in the table of expectations shows."""
    # the issue's tolerance
    assert ours(rows, item, "variance at rest, t = 10000 s") == pytest.approx(at_rest, rel=1e-9)
    assert ours(rows, item, "variance at 3 deg/s, t = 10000 s") == pytest.approx(turning, rel=1e-9)
    assert ours(rows, item, "S(3 deg/s)") == pytest.approx(growth, rel=1e-9)


def test_the_bounds_of_the_issue(rows):
    deviations = [row["ours"] for row in rows if "|z|" in row["quantity"]]
    assert len(deviations) == 12
    assert max(deviations) < 3
    over_bound = [row["ours"] for row in rows if row["quantity"].startswith("RMSE")]
    # 1.15 is asked of 200 records of each noise; here of all 100 together, by root mean square, whose own
    # standard deviation is 1/sqrt(200)
    assert math.sqrt(sum(ratio**2 for ratio in over_bound) / len(over_bound)) <= 1.15


def test_differences_are_what_they_say(rows):
    for row in rows:
        assert row["relative_difference"] == pytest.approx((row["ours"] - row["oracle"]) / row["oracle"])


def test_text_has_a_line_a_figure_and_the_sum(rows):
    lines = as_text(rows).splitlines()
    assert len(lines) == len(rows) + 2
    assert lines[-1].startswith(f"{len(rows)} of {len(rows)} figures within")


def test_the_command_prints_the_same_rows(gyrostand, rows):
    result = gyrostand("reproduce", "yang", "--json")
    assert result.returncode == ExitCode.PASS, result.stderr
    printed = json.loads(result.stdout)
    assert [set(row) for row in printed] == [set(row) for row in rows]
    # the same program on the same machine
    assert [row["ours"] for row in printed] == [row["ours"] for row in rows]
