"""The parts of a page that are words: metrics, findings, provenance. Every text of a table is escaped."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from typing import Any

import pyarrow as pa

from pipeline.report.base import Clock
from pipeline.report.formatting import measured, number, plural, size, standard_error, unit, words
from pipeline.report.verdict import badge, bar, limits
from pipeline.verdicts import Row, limited

_SEVERITIES = ("error", "warning", "info")
_FINDINGS_OPEN = 12
_FINDINGS_MOST = 500
_ABREAST = 6
"""Channels in a table of metrics that fit beside each other on a page of 1240 pixels."""


def metrics(rows: Sequence[Row]) -> str:
    """Metrics with a limit, one a row; then all of them by channels, those of the earlier stages folded."""
    judged = limited(rows)
    computed = [row for row in rows if row["stage"]]  # not those that only a limit asks for
    stages = list(dict.fromkeys(row["stage"] for row in reversed(computed)))  # the procedure's end first
    tables = [_by_channel(stage, [row for row in computed if row["stage"] == stage]) for stage in stages]
    folded = [
        _fold(f"Metrics of {stage}", table) for stage, table in zip(stages[1:], tables[1:], strict=True)
    ]
    return (_judged(judged) if judged else "") + "".join(tables[:1] + folded)


def findings(table: pa.Table, clock: Clock | None) -> str:
    """Findings, the gravest first; what exceeds a screenful is folded, and counted beyond some hundreds."""
    rows = sorted(table.to_pylist(), key=lambda row: _SEVERITIES.index(row["severity"]))
    if not rows:
        return '<p class="note">Nothing was found.</p>'
    shown, folded = rows[:_FINDINGS_OPEN], rows[_FINDINGS_OPEN:_FINDINGS_MOST]
    text = _finding_table(shown, clock)
    if folded:
        text += _fold(f"{plural(len(rows) - len(shown), 'more finding')}", _finding_table(folded, clock))
    if len(rows) > _FINDINGS_MOST:
        more = number(len(rows) - _FINDINGS_MOST)
        text += f'<p class="note">{more} more are in the table <code>findings</code>.</p>'
    return text


def finding_counts(table: pa.Table) -> str:
    """How many findings of each severity, in words."""
    severities = table.column("severity").to_pylist()
    counts = [(severities.count(s), s) for s in _SEVERITIES]
    named = [plural(n, s) if s != "info" else f"{number(n)} info" for n, s in counts if n]
    return ", ".join(named) or "none"


def recordings(table: pa.Table) -> list[str]:
    """File names of the recordings that were processed: the plan's own, then those that its runs name."""
    further = [
        run.get("recording")
        for row in table.to_pylist()
        if row["stage"] == "ingest"
        for run in json.loads(row["settings"]).get("runs") or ()
    ]
    own = table.column("recording_name")[0].as_py()
    return list(dict.fromkeys([own, *(name for name in further if name)]))


def provenance(table: pa.Table) -> str:
    """How the tables came about: the recording, the versions, and each stage with its settings, folded."""
    rows = table.to_pylist()
    if not rows:
        return ""
    first = rows[0]
    facts = [
        ("Recording", escape(", ".join(recordings(table))), size(first["recording_bytes"])),
        ("SHA-256 of the recording", _code(first["recording_sha256"]), ""),
        ("SHA-256 of the test plan", _code(first["plan_sha256"]), ""),
        *_calibration(first),
        ("Versions", _pairs(first["versions"]), ""),
    ]
    listed = "".join(f"<dt>{name}</dt><dd>{text} {extra}</dd>" for name, text, extra in facts)
    stages = "".join(
        f"<tr><td>{escape(row['stage'])}</td><td class=num>{number(row['duration'])}</td>"
        f"<td class=num>{size(row['peak_memory'])}</td><td>{_pairs(row['settings'])}</td></tr>"
        for row in rows
    )
    listed_stages = html_table(("stage", "duration [s]", "peak memory", "settings"), stages, (1, 2))
    return _fold("How these tables came about", f"<dl>{listed}</dl>{listed_stages}")


def _calibration(row: Row) -> list[tuple[str, str, str]]:
    """The calibration by which the gyro was corrected, and what it came from."""
    if row["calibration_name"] is None:
        return []
    source = f"from the recording {escape(row['calibration_recording'])}"
    return [
        ("Calibration applied", escape(row["calibration_name"]), source),
        ("SHA-256 of the calibration", _code(row["calibration_sha256"]), ""),
        ("SHA-256 of its recording", _code(row["calibration_recording_sha256"]), ""),
    ]


def _judged(rows: Sequence[Row]) -> str:
    body = "".join(
        f"<tr><td>{escape(words(row['name']))}</td><td>{escape(row['channel'])}</td>"
        f"<td class=num title={_exact(row['value'])}>{number(row['value'], row['standard_error'])}</td>"
        f"<td class=num>{_error(row)}</td><td>{escape(unit(row['unit']))}</td>"
        f"<td class=num>{escape(limits(row))}</td><td>{bar(row)}</td><td>{badge(row['verdict'])}</td></tr>"
        for row in rows
    )
    heads = ("metric with a limit", "channel", "value", "standard error", "unit", "limit", "", "verdict")
    return html_table(heads, body, (2, 3, 5))


def _by_channel(stage: str, rows: Sequence[Row]) -> str:
    """Metrics by channels; where a stage has channels of streams, one table a stream."""
    of_streams = {row["channel"].partition(".")[0] for row in rows if "." in row["channel"]}
    groups: dict[str, list[Row]] = {}
    for row in rows:
        stream = row["channel"].partition(".")[0]
        groups.setdefault(stream if stream in of_streams else "", []).append(row)
    tables = "".join(
        _matrix(stage, stream, part) for stream, group in groups.items() for part in _abreast(group)
    )
    return f'<div class="matrices">{tables}</div>'


def _abreast(rows: Sequence[Row]) -> list[list[Row]]:
    """Metrics of many channels, as the pairs of axes are, in parts that are not too wide.

    Channels that share a metric, if by way of others, stay together up to as many as fit.
    """
    named: dict[str, set[str]] = {}
    for row in rows:
        named.setdefault(row["channel"], set()).add(row["name"])
    if len(named) <= _ABREAST:
        return [list(rows)]
    families: list[list[str]] = []
    for channel, names in named.items():
        related = [family for family in families if any(named[other] & names for other in family)]
        families = [family for family in families if family not in related]
        families.append([*(other for family in related for other in family), channel])
    order = {channel: place for place, channel in enumerate(named)}
    families = sorted(
        (sorted(family, key=order.__getitem__) for family in families), key=lambda f: order[f[0]]
    )
    parts = [set(family[i : i + _ABREAST]) for family in families for i in range(0, len(family), _ABREAST)]
    return [[row for row in rows if row["channel"] in part] for part in parts]


def _matrix(stage: str, stream: str, rows: Sequence[Row]) -> str:
    channels = list(dict.fromkeys(row["channel"] for row in rows))
    metrics: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        metrics.setdefault((row["name"], row["unit"]), {})[row["channel"]] = row
    body = "".join(
        f"<tr><td>{escape(words(name))}</td><td>{escape(unit(of))}</td>"
        + "".join(_cell(by_channel.get(channel)) for channel in channels)
        + "</tr>"
        for (name, of), by_channel in metrics.items()
    )
    title = f"{stage} of {stream}" if stream else stage
    heads = (title, "unit", *(channel.removeprefix(f"{stream}.") for channel in channels))
    return html_table(heads, body, tuple(range(2, len(heads))), "matrix")


def _cell(row: Row | None) -> str:
    if row is None:
        return "<td></td>"
    value, _, error = measured(row["value"], row["standard_error"]).partition(" ± ")
    beside = f' <span class="error">± {error}</span>' if error else ""
    return f"<td class=num title={_exact(row['value'])}>{value}{beside}</td>"


def _error(row: Row) -> str:
    return standard_error(row["standard_error"], row["value"])


def _finding_table(rows: Sequence[dict[str, Any]], clock: Clock | None) -> str:
    body = "".join(
        f'<tr><td><span class="severity {escape(row["severity"])}">{escape(row["severity"])}</span></td>'
        f"<td>{escape(row['kind'])}</td><td>{escape(_place(row))}</td>"
        f"<td class=num>{_seconds(row['start'], clock)}</td><td class=num>{_seconds(row['end'], clock)}</td>"
        f"<td class=num>{number(row['count'])}</td><td>{escape(row['detail'])}</td></tr>"
        for row in rows
    )
    heads = ("severity", "kind", "where", "from [s]", "to [s]", "count", "detail")
    return html_table(heads, body, (3, 4, 5))


def _place(row: dict[str, Any]) -> str:
    return row["stream"] if row["channel"] is None else f"{row['stream']}.{row['channel']}"


def _seconds(time: int | None, clock: Clock | None) -> str:
    return "–" if time is None or clock is None else number(round((time - clock.origin) * 1e-9, 9))


def html_table(heads: Sequence[str], body: str, numeric: Sequence[int], look: str = "list") -> str:
    """A table of words: its heads, the rows as HTML, and which columns are of numbers."""
    columns = "".join(
        f"<th scope=col{' class=num' if i in numeric else ''}>{escape(head)}</th>"
        for i, head in enumerate(heads)
    )
    head, rows = f"<thead><tr>{columns}</tr></thead>", f"<tbody>{body}</tbody>"
    return f'<div class="wide"><table class="{look}">{head}{rows}</table></div>'


def _fold(summary: str, content: str) -> str:
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"


def _pairs(text: str) -> str:
    """A JSON object of settings or versions, one ``name value`` after the other."""
    return " · ".join(
        f"{escape(str(name))}&nbsp;{_code(json.dumps(value, ensure_ascii=False))}"
        for name, value in json.loads(text).items()
    )


def _code(text: str) -> str:
    return f"<code>{escape(text)}</code>"


def _exact(value: float | None) -> str:
    return f'"{value!r}"' if value is not None else '""'
