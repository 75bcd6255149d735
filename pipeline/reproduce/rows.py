"""A published figure beside ours: the row of a reproduction, and the rows as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict


class Row(TypedDict):
    """One published figure beside ours.

    ``printed`` is the paper's, ``oracle`` what a converged computation gives: a value, or a bound that
    ``ours`` must not exceed. ``relative_difference`` is (ours - oracle)/oracle.
    """

    source: str
    item: str
    quantity: str
    printed: float | None
    oracle: float
    ours: float
    relative_difference: float
    within: bool


@dataclass(frozen=True, slots=True)
class Expected:
    """What is expected of a figure.

    Attributes
    ----------
    oracle : float
        Not 0.
    least, most : float
        What ours may be in units of the oracle; `near`, `at_most` and `about` set them.
    printed : float, optional
        The paper's figure.
    """

    oracle: float
    least: float
    most: float
    printed: float | None = None

    def beside(self, source: str, item: str, quantity: str, ours: float) -> Row:
        """The row of the figure."""
        return Row(
            source=source,
            item=item,
            quantity=quantity,
            printed=self.printed,
            oracle=self.oracle,
            ours=ours,
            relative_difference=(ours - self.oracle) / self.oracle,
            within=bool(self.least <= ours / self.oracle <= self.most),
        )


def near(oracle: float, tolerance: float, printed: float | None = None) -> Expected:
    """Within a relative tolerance of the oracle."""
    return Expected(oracle, 1 - tolerance, 1 + tolerance, printed)


def at_most(bound: float, factor: float = 1.0, printed: float | None = None) -> Expected:
    """Not above the bound, or some factor of it."""
    return Expected(bound, -float("inf"), factor, printed)


def about(oracle: float, factor: float, printed: float | None = None) -> Expected:
    """Within a factor of the oracle, both ways."""
    return Expected(oracle, 1 / factor, factor, printed)


def as_text(rows: Sequence[Row]) -> str:
    """The rows as a table for the terminal, with a line on how many are within their tolerance."""
    item, quantity = (max(len(name), *(len(row[name]) for row in rows)) for name in ("item", "quantity"))
    head = f"{'item':<{item}} {'quantity':<{quantity}} {'printed':>11} {'oracle':>11}"
    lines = [f"{head} {'ours':>12} {'difference':>11}"]
    for row in rows:
        printed = "" if row["printed"] is None else f"{row['printed']:g}"
        verdict = "" if row["within"] else "  NOT WITHIN"
        lines.append(
            f"{row['item']:<{item}} {row['quantity']:<{quantity}} {printed:>11} {row['oracle']:>11g} "
            f"{row['ours']:>12.6g} {row['relative_difference']:>11.1e}{verdict}"
        )
    within = sum(row["within"] for row in rows)
    sources = "; ".join(dict.fromkeys(row["source"] for row in rows))
    lines.append(f"{within} of {len(rows)} figures within their tolerance. Source: {sources}")
    return "\n".join(lines)
