"""Verdicts as they are shown: a word, a sign and a colour, each enough by itself, and the reason."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from pipeline.report.formatting import number, plural, words
from pipeline.verdicts import Row, limited, overall

SIGNS = {"pass": "✓", "marginal": "!", "fail": "✕", "not evaluated": "–"}
_NOT_MET = {"fail": "not met", "not evaluated": "not evaluated"}
_MOST_NAMED = 4
_WIDTH = 130.0  # of a bar, pixels


def reason(metrics: Sequence[Row]) -> str:
    """The overall verdict in a sentence: how many limits, and by which metrics they are not met."""
    rows = limited(metrics)
    by_verdict = {word: [m for m in rows if m["verdict"] == word] for word in SIGNS}
    if not rows:
        return "The test plan sets no limit on any metric of this recording."
    if overall(metrics) == "fail":
        parts = (_count(by_verdict[word], rows, what) for word, what in _NOT_MET.items())
        return " ".join(filter(None, parts))
    met = "The one limit is met" if len(rows) == 1 else f"All {len(rows)} limits are met"
    if by_verdict["marginal"]:
        return f"{met}, but only just by {_named(by_verdict['marginal'])}."
    return f"{met}."


def _count(some: Sequence[Row], of: Sequence[Row], what: str) -> str:
    return f"{len(some)} of {plural(len(of), 'limit')} {what}: {_named(some)}." if some else ""


def _named(metrics: Sequence[Row]) -> str:
    names = [f"{words(m['name'])} ({m['channel']})" for m in metrics]
    return ", ".join(names[:_MOST_NAMED]) + (" and more" if len(names) > _MOST_NAMED else "")


def badge(word: str) -> str:
    """A verdict as HTML."""
    return (
        f'<span class="badge {_css(word)}"><span aria-hidden="true">{escape(SIGNS.get(word, ""))}</span> '
        f"{escape(word)}</span>"
    )


def banner(metrics: Sequence[Row]) -> str:
    """The verdict on the recording as HTML, for the head of the page."""
    word = overall(metrics)
    return (
        f'<div class="banner {_css(word)}"><span class="sign" aria-hidden="true">'
        f"{escape(SIGNS[word])}</span><div><strong>{escape(word)}</strong>"
        f"<p>{escape(reason(metrics))}</p></div></div>"
    )


def bar(metric: Row) -> str:
    """The value against its limits, drawn to scale: what is allowed is shaded, the value is a stroke."""
    value, lower, upper = metric["value"], metric["lower_limit"], metric["upper_limit"]
    if value is None:
        return ""
    shown = [
        x for x in (value, lower, upper, 0.0 if lower is None or upper is None else None) if x is not None
    ]
    first, last = min(shown), max(shown)
    margin = 0.12 * (last - first) or 1.0

    def place(x: float) -> float:
        return round(_WIDTH * (x - first + margin) / (last - first + 2 * margin), 1)

    left = 0.0 if lower is None else place(lower)
    right = _WIDTH if upper is None else place(upper)
    return (
        f'<svg class="bar {_css(metric["verdict"])}" width="{_WIDTH:.0f}" height="16" role="img" '
        f'aria-label="value against its limits">'
        f'<rect class="track" x="0" y="5" width="{_WIDTH:.0f}" height="6" rx="3"/>'
        f'<rect class="allowed" x="{left}" y="5" width="{max(right - left, 1.0):.1f}" height="6"/>'
        f'<rect class="value" x="{place(value) - 1.5:.1f}" y="0" width="3" height="16" rx="1"/></svg>'
    )


def limits(metric: Row) -> str:
    """The limits in words."""
    lower, upper = metric["lower_limit"], metric["upper_limit"]
    if lower is None or upper is None:
        return f"≤ {number(upper)}" if lower is None else f"≥ {number(lower)}"
    return f"{number(lower)} to {number(upper)}"


def _css(word: str) -> str:
    return word.replace(" ", "-") if word in SIGNS else "not-evaluated"
