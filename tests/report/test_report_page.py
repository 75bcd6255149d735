"""The page: in the agreed order, the same bytes every time, harmless whatever a recording holds."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from report_tables import HOSTILE, finding, from_rows, make_tables, metric, publish

from pipeline.errors import ExitCode
from pipeline.report import page
from pipeline.storage import StorageError

SAFE_ELEMENTS = (
    {"html", "head", "meta", "title", "style", "body", "main", "header", "section", "footer", "div", "span"}
    | {"h1", "h2", "p", "a", "strong", "code", "dl", "dt", "dd", "details", "summary", "svg", "rect"}
    | {"table", "thead", "tbody", "tr", "th", "td", "script"}
)


class Elements(HTMLParser):
    """All elements of a page with their attributes, and its text by element."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._in_script = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self._in_script = tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._in_script = False

    def handle_data(self, data: str) -> None:
        if not self._in_script:
            self.text += data


def test_the_order_is_verdict_metrics_findings_pictures_provenance() -> None:
    text = Elements(page.render("run-7", make_tables())).text
    order = [
        "run-7",
        "The one limit is met.",
        "Metrics",
        "Findings",
        "Angular rates",
        "Trend of γ",
        "Provenance",
    ]
    places = [text.index(word) for word in order]
    assert places == sorted(places)


def test_metrics_with_limits_come_first_and_findings_by_severity() -> None:
    text = Elements(page.render("run-7", make_tables())).text
    assert text.index("≤ 10×10⁻⁶") < text.index("0.00675")
    severities = [text.index(f"about {kind}") for kind in ("gap", "clocks")]
    assert severities == sorted(severities)
    assert "1 error, 1 warning, 2 info" in text


def test_metrics_of_many_channels_stand_in_tables_that_fit_the_page() -> None:
    tables = make_tables()
    pairs = ["pq", "pr", "qp", "qr", "rp", "rq", "pz"]
    rows = [metric(name, channel, 1.0) for name in ("bias", "scale") for channel in ("p", "r")]
    rows += [metric("scale", "q", 1.0), *(metric("misalignment", pair, 1.0) for pair in pairs)]
    tables["metrics"] = from_rows("metrics", rows)
    heads = re.findall(r'<table class="matrix"><thead><tr>(.*?)</tr>', page.render("run-7", tables))
    # what shares a metric is together, in the channels' order; the seventh pair does not fit beside six
    assert [re.findall(r">([^<>]+)</th>", head)[2:] for head in heads] == [
        ["p", "r", "q"], pairs[:6], pairs[6:],
    ]  # fmt: skip


def test_every_recording_of_a_plan_is_named() -> None:
    tables = make_tables()
    first = tables["provenance"].to_pylist()[0]
    runs = [{"recording": name} for name in (None, "y<up>.mcap", "z up.mcap", "y<up>.mcap")]
    ingest = first | {"stage": "ingest", "settings": json.dumps({"runs": runs})}
    tables["provenance"] = from_rows("provenance", [ingest])
    text = Elements(page.render("run-7", tables)).text
    # once in the head, once in the provenance
    assert text.count(f"{first['recording_name']}, y<up>.mcap, z up.mcap") == 2


def test_a_long_list_of_findings_is_folded_and_a_very_long_one_cut() -> None:
    tables = make_tables()
    rows = [finding(f"spike {i}", "info", 0.1, 0.1) for i in range(1000)]
    tables["findings"] = from_rows("findings", [*rows, finding("gap", "error", 0.2, 0.3)])
    text = Elements(page.render("run-7", tables)).text
    assert "989 more findings" in text
    assert "501 more are in the table findings." in text
    assert text.index("about gap") < text.index("about spike 0")
    assert "about spike 498" in text
    assert "about spike 499" not in text


def test_the_same_tables_give_the_same_bytes(tmp_path: Path) -> None:
    publish(tmp_path, "run-7", make_tables())
    first = page.write_page(tmp_path, "run-7").read_bytes()
    assert page.write_page(tmp_path, "run-7").read_bytes() == first
    code = "import sys, pathlib, pipeline.report.page as p; p.write_page(pathlib.Path(sys.argv[1]), 'run-7')"
    root = Path(page.__file__).parents[2]
    for seed in ("1", "2"):  # the order of Bokeh's sets changes with it
        elsewhere = {**os.environ, "PYTHONHASHSEED": seed, "BOKEH_SIMPLE_IDS": "no", "TZ": "Asia/Tokyo"}
        subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True, env=elsewhere, cwd=root)
        assert (tmp_path / "report" / "run-7.html").read_bytes() == first
    assert [p.name for p in (tmp_path / "report").iterdir()] == ["run-7.html"]


def test_the_page_is_one_bokeh_and_the_figures() -> None:
    text = page.render("run-7", make_tables())
    assert len(re.findall(r"Copyright \(c\) Anaconda", text)) == 1
    # 1.27 MB is Bokeh 3.9 without widgets, tables and formulae; the figures of this run are 0.8 MB
    assert len(text.encode()) < 2.6e6


def test_hostile_text_stays_text() -> None:
    written = page.render("run-7", make_tables(HOSTILE))
    parsed = Elements(written)
    assert {tag for tag, _ in parsed.found} <= SAFE_ELEMENTS
    assert sum(tag == "script" for tag, _ in parsed.found) == 3  # the data, Bokeh, the start
    assert not [name for _, attributes in parsed.found for name in attributes if name.startswith("on")]
    # kind, detail, stream and channel; metric, channel and unit; recording twice, settings: all are shown
    assert parsed.text.count("<img src=x") >= 10


def test_hostile_text_cannot_leave_the_data_of_the_figures() -> None:
    written = page.render("run-7", make_tables(HOSTILE))
    (data,) = re.findall(r'<script type="application/json" id="figures">(.*?)</script>', written, re.DOTALL)
    assert not set("<>&") & set(data)
    assert HOSTILE in json.dumps(json.loads(data), ensure_ascii=False).replace('\\"', '"').replace(
        "\\\\", "\\"
    )


def test_the_policy_allows_two_scripts_and_no_request() -> None:
    parsed = Elements(page.render("run-7", make_tables()))
    (policy,) = [a["content"] for _, a in parsed.found if a.get("http-equiv") == "Content-Security-Policy"]
    assert policy is not None
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert policy.count("sha256-") == 2
    assert "unsafe-eval" not in policy
    assert "http" not in policy
    fetching = [(tag, a) for tag, a in parsed.found if "src" in a or tag in ("link", "iframe", "object")]
    assert fetching == []


def test_a_procedure_without_figures_has_a_page_of_words() -> None:
    tables = make_tables()
    (row,) = tables["provenance"].to_pylist()
    tables["provenance"] = from_rows("provenance", [row | {"procedure": "acceptance"}])
    written = page.render("run-7", tables)
    assert "<script" not in written
    assert "script-src 'none'" in written
    assert "The one limit is met." in written


def test_the_index_lists_every_recording_with_its_verdict(tmp_path: Path) -> None:
    good, bad = make_tables(), make_tables()
    row = bad["metrics"].to_pylist()[1] | {"verdict": "fail"}
    bad["metrics"] = from_rows("metrics", [row])
    publish(tmp_path, "run-7", good)
    publish(tmp_path, "run-8", bad)
    written = page.write_index(tmp_path)
    assert written == tmp_path / "report" / "index.html"
    parsed = Elements(written.read_text())
    assert [a["href"] for tag, a in parsed.found if tag == "a"] == ["run-7.html", "run-8.html"]
    assert re.search(r"run-7.*pass.*run-8.*fail", parsed.text)
    assert "1 of 1 limit not met: peak error (psi)." in parsed.text


def test_no_recording_is_an_error_and_leaves_no_page(tmp_path: Path) -> None:
    with pytest.raises(StorageError) as unknown:
        page.write_page(tmp_path, "run-9")
    assert unknown.value.exit_code == ExitCode.INPUT
    with pytest.raises(StorageError) as empty:
        page.write_index(tmp_path)
    assert empty.value.exit_code == ExitCode.INPUT
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    publish(tmp_path, "run-7", make_tables())
    (tmp_path / "report").write_text("a file where the folder should be")
    with pytest.raises(StorageError) as refused:
        page.write_page(tmp_path, "run-7")
    assert refused.value.exit_code == ExitCode.USAGE
