"""What check says of outputs: nothing of sound ones, one line a fault of others."""

from __future__ import annotations

import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from small_outputs import provenance, publish, tables

from pipeline import contracts, storage
from pipeline.errors import ExitCode
from pipeline.storage import Published, StorageError, parquet, table_file
from pipeline.storage.check import check


@pytest.fixture
def out(tmp_path: Path) -> Path:
    publish(tmp_path, "run7", 1)
    publish(tmp_path, "run8", 2)
    return tmp_path


def the_line(*paths: Path) -> str:
    (line,) = check(paths)
    assert "\n" not in line
    return line


def test_sound_outputs_have_no_fault(out: Path) -> None:
    (out / "report").mkdir()
    (out / "report" / "run7.html").write_text("")
    (out / "recordings.mk").write_text("")
    assert check([out]) == []
    assert check([table_file(out, "run7", name) for name in (*tables(1), "provenance")]) == []


def test_a_folder_without_recordings_is_exit_3(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(StorageError) as caught:
            check([path])
        assert caught.value.exit_code == ExitCode.INPUT


def test_an_unfinished_recording(out: Path) -> None:
    table_file(out, "run7", "provenance").unlink()
    assert "expected a finished recording" in the_line(out)


def test_a_missing_table(out: Path) -> None:
    table_file(out, "run7", "gyro").unlink()
    assert the_line(out).endswith("missing, but the provenance of recording 'run7' names it")


def test_a_table_of_another_run(out: Path) -> None:
    shutil.copytree(out / "trend" / "recording=run8", out / "trend" / "recording=run7")
    assert the_line(out).endswith("the provenance of recording 'run7' does not name it")


def test_a_table_with_other_bytes(out: Path) -> None:
    parquet.write(table_file(out, "run7", "gyro"), "gyro", tables(2)["gyro"])
    assert "by provenance, found" in the_line(out)


def test_other_row_counts_than_provenance_says(out: Path) -> None:
    named = storage.published(out, "run7")
    named["gyro"] = Published(1, named["gyro"].sha256)
    parquet.write(table_file(out, "run7", "provenance"), "provenance", provenance(named))
    assert the_line(out).endswith("500 rows, but its provenance says 1")


def test_a_table_that_breaks_its_contract_names_row_value_and_unit(out: Path) -> None:
    trend = tables(2)["trend"]
    place = trend.schema.get_field_index("frequency")
    path = table_file(out, "run8", "trend")
    named = storage.published(out, "run8")
    broken = trend.set_column(place, trend.schema.field(place), [[-5.0]])
    named["trend"] = parquet.write(path, "trend", broken)
    parquet.write(table_file(out, "run8", "provenance"), "provenance", provenance(named))
    line = f"{str(path)!r}: trend.frequency row 0: -5.0 Hz is below 0"
    assert the_line(out) == line
    assert the_line(path) == line


def test_files_and_folders_that_do_not_belong(out: Path) -> None:
    (out / "gyro" / "notes.txt").write_text("")
    (out / "gyro" / "recording=run7" / "part-1.parquet").write_bytes(b"")
    (out / "gyroscope" / "recording=run7").mkdir(parents=True)
    (out / "loose").mkdir()
    (out / "loose" / "x.parquet").write_bytes(b"")
    lines = check([out])
    assert len(lines) == 5
    for end in (
        "notes.txt': only folders 'recording=<id>' belong here",
        "part-1.parquet': no run of recording 'run7' wrote that",
        "gyroscope': no table has that name",
        "loose': no table has that name",
        "x.parquet': only folders 'recording=<id>' belong here",
    ):
        assert sum(line.endswith(end) for line in lines) == 1, end


def test_a_recording_folder_with_an_unsafe_name(out: Path) -> None:
    (out / "gyro" / "recording=007").mkdir()
    assert "safe in a path" in the_line(out)


def test_provenance_that_names_an_unknown_table(out: Path) -> None:
    named = storage.published(out, "run7") | {"rolls": Published(1, "0" * 64)}
    parquet.write(table_file(out, "run7", "provenance"), "provenance", provenance(named))
    assert "names 'rolls', which has no contract" in the_line(out)


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    text, foreign = tmp_path / "a.csv", tmp_path / "b.parquet"
    text.write_text("a,b\n1,2\n")
    pq.write_table(
        contracts.table("attitude", {c: [] for c in contracts.contract("attitude").units}), foreign
    )
    first, second = check([text, foreign])
    assert "whole Parquet pages and footer" in first
    assert second == f"{str(foreign)!r}: its metadata names no table that has a contract, but None"
