"""Recordings of a folder, and what make is told of them."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from pipeline.discover import DiscoveryError, expand, listed, recordings, write_rules
from pipeline.errors import ExitCode
from pipeline.formats.base import RecordingError
from pipeline.testplan import PlanError


@pytest.fixture
def folder(csv_recording: Path) -> Path:
    """The folder of run1.csv and its plan, with a bag's folder and much that is no recording."""
    folder = csv_recording.parent
    (folder / "bag").mkdir()
    (folder / "bag" / "metadata.yaml").touch()
    (folder / "bag.toml").write_text("")
    (folder / "plain").mkdir()
    for name in ("notes.md", ".hidden.csv", "RUN2.CSV.GZ", "run1.truth.json"):
        (folder / name).touch()
    (folder / "RUN2.toml").write_text("")
    return folder


def test_recordings_are_known_by_their_names(folder: Path) -> None:
    assert [path.name for path in recordings(folder)] == ["RUN2.CSV.GZ", "bag", "run1.csv"]


def test_expand_opens_plain_folders_alone(folder: Path) -> None:
    bag, odd = folder / "bag", folder / "notes.md"
    assert expand([bag, folder, odd]) == [bag, *recordings(folder), odd]


@pytest.mark.parametrize("name", ["plain", "none"])
def test_no_recording_is_an_error(folder: Path, name: str) -> None:
    with pytest.raises(RecordingError, match="a folder with recordings") as caught:
        recordings(folder / name)
    assert caught.value.exit_code == ExitCode.INPUT


def test_rules_name_each_recording_and_hold_no_name_from_outside(folder: Path, tmp_path: Path) -> None:
    odd = folder / "a b: $(touch hacked) 'x'.csv"
    shutil.copy(folder / "run1.csv", odd)
    (folder / "testplan.toml").write_text("")
    out = tmp_path / "out put"
    text = write_rules(folder, out).read_text()
    pages = re.findall(r"^pages: report/(\S+)\.html$", text, re.MULTILINE)
    assert len(pages) == 4
    assert "hacked)" not in text
    assert {listed(out / ".recordings" / f"{page}.json") for page in pages} == set(recordings(folder))


def test_a_listing_changes_with_its_recording_its_plan_and_nothing_else(folder: Path, tmp_path: Path) -> None:
    def stamps() -> dict[str, int]:
        write_rules(folder, tmp_path / "out")
        return {p.name: p.stat().st_mtime_ns for p in (tmp_path / "out").rglob("*") if p.is_file()}

    def changed(before: dict[str, int]) -> set[str]:
        after = stamps()
        return {name for name in after if after[name] != before[name]}

    before = stamps()
    (folder / "notes.md").write_text("new")
    assert changed(before) == set()
    (folder / "run1.toml").write_text("# new")
    assert changed(before) == {"run1.json"}
    (folder / "bag" / "bag_0.db3").write_text("new")
    assert changed(before) == {"run1.json", "bag.json"}
    facts = json.loads((tmp_path / "out/.recordings/run1.json").read_text())
    assert set(facts["files"]) == {str(folder / "run1.csv"), str(folder / "run1.toml")}


def test_two_recordings_of_one_id_are_refused(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "run1.csv", folder / "run1.tsv")
    with pytest.raises(DiscoveryError, match="both called 'run1'") as caught:
        write_rules(folder, tmp_path / "out")
    assert caught.value.exit_code == ExitCode.USAGE


def test_a_recording_without_a_plan_is_named_and_the_others_are_listed(folder: Path, tmp_path: Path) -> None:
    (folder / "bag.toml").unlink()
    (folder / "RUN2.toml").unlink()
    with pytest.raises(PlanError, match="plan init") as caught:
        write_rules(folder, tmp_path / "out")
    assert caught.value.exit_code == ExitCode.USAGE
    assert [line.partition(": ")[0] for line in str(caught.value).splitlines()] == [
        str(folder / "RUN2.CSV.GZ"),
        str(folder / "bag"),
    ]
    assert re.findall(r"^pages: (\S+)$", (tmp_path / "out" / "recordings.mk").read_text(), re.MULTILINE) == [
        "report/run1.html"
    ]


def test_where_no_recording_has_a_plan_there_are_no_rules(folder: Path, tmp_path: Path) -> None:
    for plan in folder.glob("*.toml"):
        plan.unlink()
    with pytest.raises(PlanError):
        write_rules(folder, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def names(folder: Path) -> list[str]:
    return [path.name for path in recordings(folder)]


def test_a_part_of_another_recording_is_none_of_its_own(folder: Path) -> None:
    (folder / "run1.toml").write_text('[[runs]]\nrecording = "RUN2.CSV.GZ"\n[[runs]]\nrecording = "bag"\n')
    assert names(folder) == ["RUN2.CSV.GZ", "bag", "run1.csv"]  # with test plans of their own
    (folder / "RUN2.toml").unlink()
    assert names(folder) == ["bag", "run1.csv"]
    (folder / "bag.toml").unlink()
    assert names(folder) == ["run1.csv"]
    assert expand([folder]) == [folder / "run1.csv"]
    assert expand([folder / "bag"]) == [folder / "bag"]


def test_the_folder_s_plan_may_name_parts_too(folder: Path) -> None:
    for plan in folder.glob("*.toml"):
        plan.unlink()
    (folder / "testplan.toml").write_text('[[runs]]\nrecording = "bag"\n')
    assert names(folder) == ["RUN2.CSV.GZ", "run1.csv"]
    every = "".join(f'[[runs]]\nrecording = "{name}"\n' for name in ("bag", "RUN2.CSV.GZ", "run1.csv"))
    (folder / "testplan.toml").write_text(every)
    assert names(folder) == ["RUN2.CSV.GZ", "bag", "run1.csv"]  # nothing is lost in silence


def test_a_listing_has_the_stamps_of_its_further_recordings(folder: Path, tmp_path: Path) -> None:
    for name in ("RUN2.toml", "bag.toml"):
        (folder / name).unlink()
    (folder / "run1.toml").write_text(
        "".join(f'[[runs]]\nrecording = "{name}"\n' for name in ("bag", "RUN2.CSV.GZ", "later.csv"))
    )
    listing = tmp_path / "out" / ".recordings" / "run1.json"

    def files() -> set[str]:
        write_rules(folder, tmp_path / "out")
        return {str(Path(path).relative_to(folder)) for path in json.loads(listing.read_text())["files"]}

    assert files() == {"run1.csv", "run1.toml", "RUN2.CSV.GZ", "bag/metadata.yaml"}
    before = listing.stat().st_mtime_ns
    assert files()
    assert listing.stat().st_mtime_ns == before
    (folder / "bag" / "metadata.yaml").write_text("new")
    assert files()
    assert listing.stat().st_mtime_ns != before
    (folder / "later.csv").touch()
    assert "later.csv" in files()


def test_what_cannot_be_written_or_read_is_the_users_fault(folder: Path) -> None:
    with pytest.raises(DiscoveryError, match="a folder that can be written") as caught:
        write_rules(folder, folder / "run1.csv" / "out")
    assert caught.value.exit_code == ExitCode.USAGE
    for wrong in (folder / "run1.csv", folder / "none.json", folder / "bag"):
        with pytest.raises(DiscoveryError, match="a listing"):
            listed(wrong)
