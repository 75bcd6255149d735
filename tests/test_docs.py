"""The documentation against the code: links, settings, figures, and examples that must be valid."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import get_args

import pytest
from pydantic import BaseModel

from pipeline.procedures import PROCEDURES
from pipeline.runner import run
from pipeline.simulate.samples import SAMPLES
from pipeline.testplan import load_plan

PROJECT = Path(__file__).resolve().parents[1]
PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *sorted((PROJECT / "docs").glob("*.md"))]


def examples() -> Iterator[str]:
    """The whole test plans of the page on test plans."""
    page = (PROJECT / "docs" / "test-plan.md").read_text(encoding="utf-8")
    return (match.group(1) for match in re.finditer(r"```toml\n(.*?)```", page, flags=re.DOTALL))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_are_there(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (page.parent / target).exists(), target


@pytest.mark.parametrize("example", list(examples()))
def test_examples_of_test_plans_are_right(example: str, tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(example, encoding="utf-8")
    assert load_plan(path).procedure in PROCEDURES


@pytest.mark.parametrize("procedure", PROCEDURES)
def test_every_setting_is_on_its_procedure_s_page(procedure: str) -> None:
    page = (PROJECT / "docs" / f"{procedure}.md").read_text(encoding="utf-8")
    for stage in PROCEDURES[procedure]:
        if stage == "ingest":
            continue  # its settings are on the page on test plans
        settings = import_module(f"pipeline.stages.{stage}").Settings
        for section, model in ((stage, settings), *nested(stage, settings)):
            # a stage's own keys are below its name, those of a section of it below its header in the plan
            heading = rf"^### {stage}$" if section == stage else rf"^#### \[{re.escape(section)}\]"
            (below,) = re.findall(heading + r"(.*?)(?=\n#)", page, flags=re.MULTILINE | re.DOTALL)
            stated = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", below, flags=re.MULTILINE))
            fields = model.model_fields
            assert set(stated) == set(fields), section
            for name, default in stated.items():
                assert default.startswith("none: state it") == fields[name].is_required(), (section, name)
                if (value := literal(default)) is not None:
                    # None: the stage chooses it
                    assert fields[name].default in (None, value), (section, name)


def nested(section: str, settings: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    """The sections within a section of the plan, however deep."""
    for name, field in settings.model_fields.items():
        kind = field.annotation
        for one in get_args(kind) if isinstance(kind, UnionType) else (kind,):
            if isinstance(one, type) and issubclass(one, BaseModel):
                yield f"{section}.{name}", one
                yield from nested(f"{section}.{name}", one)


def test_nested_sections_are_found() -> None:
    found = dict(nested("navigate", import_module("pipeline.stages.navigate").Settings))
    assert {"navigate.start", "navigate.loops.lift", "navigate.filter.coloured"} <= set(found)


def literal(cell: str) -> object:
    """The value that a cell states, a list as a tuple; None where it is words."""
    try:
        value = json.loads(cell.strip("`"))
    except json.JSONDecodeError:
        return None
    return tuple(value) if isinstance(value, list) else value


def words(text: str) -> list[str | float]:
    """The words of an output, its numbers as numbers."""
    return [float(w) if re.fullmatch(r"-?\d+\.\d+(e-?\d+)?", w) else w for w in text.split()]


def test_the_output_on_the_analysts_page_is_real(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(PROJECT / "sample_data", tmp_path / "sample_data")
    for name in SAMPLES:
        run(tmp_path / "sample_data" / name, tmp_path / "build")
    monkeypatch.chdir(tmp_path)
    page = (PROJECT / "docs" / "analysts.md").read_text(encoding="utf-8")
    variables: dict[str, object] = {}
    printed = ""
    for language, block in re.findall(r"```(\w+)\n(.*?)```", page, flags=re.DOTALL):
        if language == "python":
            exec(block, variables)
            printed = capsys.readouterr().out
        elif language == "sql":
            assert "rad/s" in variables["duckdb"].sql(block).fetchall()[0][0]  # type: ignore[attr-defined]
        else:
            # pandas and polars print six digits or seven; another machine's sums differ in the last of 16,
            # which of a small difference of angles (1e-9 rad of 1e-2) leaves five.
            for found, stated in zip(words(printed), words(block), strict=True):
                assert found == (pytest.approx(stated, rel=1e-5) if isinstance(stated, float) else stated)


def test_every_dependency_has_its_reason() -> None:
    page = (PROJECT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    project = (PROJECT / "pyproject.toml").read_text(encoding="utf-8")
    named = set(re.findall(r"\"([A-Za-z0-9._-]+)>=", project))
    listed = {
        name
        for row in re.findall(r"^\| ([\w., -]+?) \|", page, flags=re.MULTILINE)
        for name in row.split(", ")
    }
    assert named - listed == set()
