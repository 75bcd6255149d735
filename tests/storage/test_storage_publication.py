"""Storage: tables whole or absent, and readers that know finished recordings only."""

from __future__ import annotations

import os
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pytest
from small_outputs import IDENTITY, START, files, provenance, publish, tables

import pipeline
from pipeline import contracts, storage
from pipeline.contracts import ContractError
from pipeline.errors import ExitCode
from pipeline.storage import StorageError


def test_what_is_published_is_read(tmp_path: Path) -> None:
    named = publish(tmp_path, "run7")
    assert storage.recordings(tmp_path) == ["run7"]
    assert storage.published(tmp_path, "run7") == named
    for name, table in tables(1).items():
        assert storage.read(tmp_path, "run7", name).equals(table)
        assert named[name].rows == table.num_rows
    assert files(tmp_path).keys() == {
        f"{name}/recording=run7/part-0.parquet"
        for name in ("findings", "gyro", "metrics", "provenance", "reference")
    }


def test_the_same_run_again_writes_the_same_bytes(tmp_path: Path) -> None:
    publish(tmp_path / "a", "run7")
    publish(tmp_path / "b", "run7")
    publish(tmp_path / "b", "run7")
    assert files(tmp_path / "a") == files(tmp_path / "b")


def test_a_new_run_replaces_the_tables_and_removes_those_it_does_not_have(tmp_path: Path) -> None:
    publish(tmp_path, "run7", version=1)
    publish(tmp_path, "run8", version=1)
    publish(tmp_path, "run7", version=2)
    publish(tmp_path / "fresh", "run7", version=2)
    ours = {k: v for k, v in files(tmp_path).items() if "run7" in k and not k.startswith("fresh")}
    assert ours == files(tmp_path / "fresh")
    assert not (tmp_path / "reference" / "recording=run7").exists()
    assert (tmp_path / "reference" / "recording=run8").exists()


def test_nothing_is_seen_before_the_end_and_nothing_changes_when_a_run_fails(tmp_path: Path) -> None:
    publish(tmp_path, "run7", version=1)
    before = files(tmp_path)

    def fail_late() -> None:
        with storage.publication(tmp_path, "run7") as publication:
            for name, table in tables(2).items():
                publication.publish(name, table)
            assert files(tmp_path) == before
            raise RuntimeError("a stage of the caller")

    with pytest.raises(RuntimeError, match="a stage of the caller"):
        fail_late()
    assert files(tmp_path) == before
    assert [p.name for p in (tmp_path / ".publishing").iterdir()] == [".run7.lock"]


def test_what_a_killed_run_left_is_cleared_away(tmp_path: Path) -> None:
    left = tmp_path / ".publishing" / "run7"
    left.mkdir(parents=True)
    (left / "gyro").write_bytes(b"PAR1 half a file")
    publish(tmp_path, "run7")
    assert not left.exists()


def test_a_table_that_breaks_its_contract_is_not_published(tmp_path: Path) -> None:
    publish(tmp_path, "run7")
    before = files(tmp_path)
    attitude = {c: [1.0, float("nan")] for c in ("psi", "theta", "gamma")}
    bad = contracts.table("attitude", {"time": [2, 1], "segment": [0, 0], **attitude})
    with (
        storage.publication(tmp_path, "run7") as publication,
        pytest.raises(ContractError, match=r"attitude.time row 1: 1 ns after 2 ns .* and 3 more") as caught,
    ):
        publication.publish("attitude", bad)
    assert caught.value.exit_code == ExitCode.NOT_MET
    assert files(tmp_path) == before


def test_provenance_must_name_what_was_published(tmp_path: Path) -> None:
    with storage.publication(tmp_path, "run7") as publication:
        named = {"metrics": publication.publish("metrics", tables(1)["metrics"])}
        other = {"metrics": storage.Published(named["metrics"].rows + 1, named["metrics"].sha256)}
        with pytest.raises(StorageError, match="provenance that names") as caught:
            publication.finish(provenance(other))
    assert caught.value.exit_code == ExitCode.FAULT
    assert files(tmp_path) == {}


def test_is_current_asks_for_the_same_origin_and_whole_files(tmp_path: Path) -> None:
    def is_current(**changed: str) -> bool:
        with storage.publication(tmp_path, "run7") as publication:
            return publication.is_current({**IDENTITY, **changed})

    assert not is_current()
    publish(tmp_path, "run7")
    assert is_current()
    assert not is_current(recording_sha256="ef" * 32)
    gyro = storage.table_file(tmp_path, "run7", "gyro")
    gyro.write_bytes(gyro.read_bytes() + b" ")
    assert not is_current()
    gyro.unlink()
    assert not is_current()


def test_an_unfinished_recording_is_not_read(tmp_path: Path) -> None:
    publish(tmp_path, "run7")
    publish(tmp_path, "run8")
    storage.table_file(tmp_path, "run7", "provenance").unlink()
    assert storage.recordings(tmp_path) == ["run8"]
    assert set(storage.load(tmp_path, "metrics")["recording"]) == {"run8"}
    with pytest.raises(StorageError, match="its run has not ended, or was killed") as caught:
        storage.read(tmp_path, "run7", "metrics")
    assert caught.value.exit_code == ExitCode.INPUT


def test_one_run_of_a_recording_at_a_time(tmp_path: Path) -> None:
    with storage.publication(tmp_path, "run7"):
        # On a file system without case, run7 and RUN7 are one folder.
        for name in ("run7", "RUN7"):
            with pytest.raises(StorageError, match="found one at work") as caught:
                publish(tmp_path, name)
            assert caught.value.exit_code == ExitCode.USAGE
        publish(tmp_path, "run8")
    publish(tmp_path, "run7")
    assert storage.recordings(tmp_path) == ["run7", "run8"]


@pytest.mark.parametrize("bad", ["", "..", "../x", "007", "a/b", "a b", "x" * 101, "run7\n"])
def test_an_unsafe_id_never_becomes_a_path(tmp_path: Path, bad: str) -> None:
    with pytest.raises(StorageError, match="safe in a path") as caught:
        publish(tmp_path / "out", bad)
    assert caught.value.exit_code == ExitCode.USAGE
    assert not (tmp_path / "out").exists()


def test_an_output_folder_that_is_a_file_is_exit_2(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(StorageError, match="name another output folder") as caught:
        publish(tmp_path / "taken" / "out", "run7")
    assert caught.value.exit_code == ExitCode.USAGE
    assert "\n" not in str(caught.value)


def test_a_read_only_output_folder_is_exit_2(tmp_path: Path) -> None:
    """Root may write anywhere but in the kernel's own folders."""
    tmp_path.chmod(0o555)
    out = Path("/proc/self") if os.geteuid() == 0 else tmp_path
    with pytest.raises(StorageError, match="expected a folder that can be written") as caught:
        publish(out / "out", "run7")
    tmp_path.chmod(0o755)
    assert caught.value.exit_code == ExitCode.USAGE


def test_load_joins_the_recordings_with_units(tmp_path: Path) -> None:
    publish(tmp_path, "run7", version=1)
    publish(tmp_path, "run8", version=2)
    frame = pipeline.load(tmp_path, "metrics")
    assert list(frame.columns) == ["recording", *contracts.contract("metrics").units]
    assert list(zip(frame["recording"], frame["value"], strict=True)) == [("run7", 1.0), ("run8", 2.0)]
    gyro = pipeline.load(tmp_path, "gyro")
    assert gyro.attrs["units"]["p"] == "rad/s"
    assert gyro.attrs["long_name"]["p"] == "angular rate about body axis 1"
    assert gyro.attrs["units"]["recording"] == ""
    assert len(gyro) == 1000
    # Only one of the two has a trend.
    assert set(pipeline.load(tmp_path, "trend")["recording"]) == {"run8"}
    assert pipeline.load(tmp_path, "provenance")["stage"].tolist() == ["ingest", "ingest"]


def test_load_keeps_nanoseconds_exact_beside_null(tmp_path: Path) -> None:
    publish(tmp_path, "run7")
    stamps = pipeline.load(tmp_path, "gyro")["header_stamp"]
    assert stamps.dtype == pd.Int64Dtype()
    assert stamps[1] == START + 2_500_000  # odd, above 2**53
    assert stamps.isna().tolist() == [True] + [False] * 499


def test_load_of_a_table_without_rows(tmp_path: Path) -> None:
    publish(tmp_path, "run7")
    frame = pipeline.load(tmp_path, "findings")
    assert len(frame) == 0
    assert frame.attrs["units"]["start"] == "ns"


def test_load_refuses_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="found none") as empty:
        pipeline.load(tmp_path, "metrics")
    with pytest.raises(StorageError, match="no such folder"):
        pipeline.load(tmp_path / "nowhere", "metrics")
    publish(tmp_path, "run7")
    with pytest.raises(StorageError, match="a recording with the table trend") as absent:
        pipeline.load(tmp_path, "trend")
    with pytest.raises(ContractError, match="did you mean 'metrics'") as mistyped:
        pipeline.load(tmp_path, "metric")
    with pytest.raises(StorageError, match="expected table trend, found findings, gyro") as other:
        storage.read(tmp_path, "run7", "trend")
    assert empty.value.exit_code == absent.value.exit_code == other.value.exit_code == ExitCode.INPUT
    assert mistyped.value.exit_code == ExitCode.USAGE


def test_a_file_of_another_contract_is_refused(tmp_path: Path) -> None:
    publish(tmp_path, "run7")
    table = storage.read(tmp_path, "run7", "provenance")
    path = storage.table_file(tmp_path, "run7", "provenance")
    pa.parquet.write_table(table.drop_columns(["duration"]), path)
    with pytest.raises(ContractError, match=r"provenance.duration: the column is missing") as caught:
        storage.published(tmp_path, "run7")
    assert caught.value.exit_code == ExitCode.NOT_MET


@pytest.mark.parametrize("text", ["", "[]", '{"gyro": 1}', '{"gyro": {"rows": "x", "sha256": ""}}'])
def test_provenance_that_names_nothing_readable_is_damage(tmp_path: Path, text: str) -> None:
    publish(tmp_path, "run7")
    table = storage.read(tmp_path, "run7", "provenance")
    place = table.schema.get_field_index("tables")
    changed = table.set_column(place, table.schema.field(place), pa.array([text]))
    pa.parquet.write_table(changed, storage.table_file(tmp_path, "run7", "provenance"))
    with pytest.raises(StorageError, match="rows and sha256 of each table"):
        storage.published(tmp_path, "run7")
