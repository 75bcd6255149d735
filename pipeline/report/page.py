"""The page of a recording: one HTML file that needs nothing else, from the published tables alone.

It runs two scripts, Bokeh and four lines that start the figures, and a content security policy lets the
browser run these two, by their hashes, and fetch nothing: what a recording's names and texts hold is
escaped, and would stay without effect if it were not.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from html import escape
from importlib import import_module
from pathlib import Path
from urllib.parse import quote

import pyarrow as pa

from pipeline import storage
from pipeline.report import embed, parts
from pipeline.report.base import FIGURES, Clock, Section, Tables, record_clock
from pipeline.report.formatting import number
from pipeline.report.style import COLUMNS
from pipeline.report.verdict import badge, banner, reason
from pipeline.storage.parquet import writing
from pipeline.verdicts import overall

FOLDER = "report"
"""Where the pages are, below the output folder."""
INDEX = "index.html"


def write_page(out: Path, recording_id: str) -> Path:
    """Write the page of one finished recording to ``out/report/<id>.html``, whole or not at all.

    Parameters
    ----------
    out : Path
        The folder given to ``gyrostand run --out``.
    recording_id : str
        One of `pipeline.storage.recordings`.

    Returns
    -------
    Path
        The page; the same tables give the same bytes.

    Raises
    ------
    StorageError
        If the recording is not there (exit code 3), its tables are damaged (1), or the page cannot be
        written (2, and 4 where the disk is full).
    """
    names = (*storage.published(out, recording_id), storage.PROVENANCE)
    tables = {name: storage.read(out, recording_id, name) for name in names}
    return _publish(out / FOLDER / f"{recording_id}.html", render(recording_id, tables))


def write_index(out: Path) -> Path:
    """Write ``out/report/index.html``: every finished recording, its verdict, and the way to its page.

    Parameters, returns and errors as in `write_page`.
    """
    rows = "".join(_index_row(out, name) for name in storage.recordings(out))
    heads = "".join(
        f"<th scope=col>{head}</th>" for head in ("recording", "procedure", "verdict", "", "findings")
    )
    body = (
        "<header><h1>Recordings</h1></header>"
        f'<div class="wide"><table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>'
    )
    return _publish(out / FOLDER / INDEX, _document("Recordings", body, "", ()))


def render(recording_id: str, tables: Tables) -> str:
    """The page of a recording as HTML; the same tables give the same text.

    Parameters
    ----------
    recording_id : str
        Its name among the outputs.
    tables : mapping of pyarrow.Table
        By name; ``metrics``, ``findings`` and ``provenance`` at least.
    """
    metrics = tables["metrics"].to_pylist()
    clock = record_clock(tables)
    procedure = _procedure(tables["provenance"])
    sections = _figures(procedure)(tables)
    places = [f"picture-{i}" for i in range(len(sections))]
    drawn = {p: s.picture for p, s in zip(places, sections, strict=True) if s.picture is not None}
    pictures = "".join(map(_section, sections, places))
    body = (
        f'<header><p class=kicker>{escape(procedure)} · <a href="{INDEX}">all recordings</a></p>'
        f"<h1>{escape(recording_id)}</h1>"
        f"{_facts(tables, clock)}{banner(metrics)}</header>"
        f"<section><h2>Metrics</h2>{parts.metrics(metrics)}</section>"
        f"<section><h2>Findings</h2>{parts.findings(tables['findings'], clock)}</section>"
        f"{pictures}"
        f"<section><h2>Provenance</h2>{parts.provenance(tables['provenance'])}</section>"
        f"<footer>A curve shows the extremes in each of {number(COLUMNS)} columns of its time axis. "
        "The full data are in the Parquet tables beside this page.</footer>"
    )
    scripts = embed.scripts() if drawn else ()
    data = embed.figures(list(drawn.values()), list(drawn)) if drawn else ""
    return _document(recording_id, body, data, scripts)


def _index_row(out: Path, recording_id: str) -> str:
    metrics, findings, provenance = (
        storage.read(out, recording_id, table) for table in ("metrics", "findings", storage.PROVENANCE)
    )
    judged = metrics.to_pylist()
    link = escape(quote(f"{recording_id}.html"))
    return (
        f'<tr><td><a href="{link}">{escape(recording_id)}</a></td>'
        f"<td>{escape(_procedure(provenance))}</td><td>{badge(overall(judged))}</td>"
        f"<td>{escape(reason(judged))}</td><td>{escape(parts.finding_counts(findings))}</td></tr>"
    )


def _procedure(provenance: pa.Table) -> str:
    return str(provenance.column("procedure")[0].as_py())


def _document(title: str, body: str, data: str, scripts: Sequence[embed.Script]) -> str:
    allowed = " ".join(script.source for script in scripts) or "'none'"
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    css = Path(__file__).with_name("page.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{css}</style></head>\n"
        f"<body><main>{body}</main>\n{data}\n{''.join(script.tag for script in scripts)}</body></html>\n"
    )


def _figures(procedure: str) -> Callable[[Tables], list[Section]]:
    """The figures of a procedure; a procedure that brings none has a page of words."""
    if procedure not in FIGURES:
        return lambda _: []
    module = import_module(FIGURES[procedure])
    figures: Callable[[Tables], list[Section]] = module.figures
    return figures


def _section(section: Section, place: str) -> str:
    picture = "" if section.picture is None else f'<div class="picture" id="{place}"></div>'
    return (
        f"<section><h2>{escape(section.title)}</h2><p class=note>{escape(section.text)}</p>"
        f"{picture}{section.below}</section>"
    )


def _facts(tables: Tables, clock: Clock | None) -> str:
    names = parts.recordings(tables["provenance"])
    facts = [("recording" if len(names) == 1 else "recordings", ", ".join(names))]
    if clock is not None:
        facts.append(("duration", f"{number(clock.duration)} s"))
    if "attitude" in tables:
        facts.append(("segments", number(len(tables["attitude"].column("segment").unique()))))
    facts.append(("findings", parts.finding_counts(tables["findings"])))
    listed = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>" for name, text in facts)
    return f'<dl class="facts">{listed}</dl>'


def _publish(path: Path, text: str) -> Path:
    """Write a file whole or not at all, and bring it to the disk."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with unfinished.open("wb") as file:
                file.write(text.encode())
                file.flush()
                os.fsync(file.fileno())
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    return path
