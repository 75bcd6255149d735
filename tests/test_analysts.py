"""What analysts' own tools see of the outputs: all recordings at once, exact integers, units."""

from __future__ import annotations

import json
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest
from small_outputs import START, publish

from pipeline import storage
from pipeline.storage.naming import recording_id

NAMES = ("run7.mcap", "007.mcap", "2026-11-22.csv", "true.bag", "nan.bag", "null.bag", "1e5.bag")
IDS = sorted(recording_id(Path(name)) for name in NAMES)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("build")
    for name in IDS:
        publish(folder, name, samples=50)
    return folder


def test_pandas_sees_units_and_exact_integers(out: Path) -> None:
    frame = pd.read_parquet(storage.table_file(out, "run7", "gyro"))
    assert frame.attrs["units"]["p"] == "rad/s"
    assert frame.attrs["long_name"]["p"] == "angular rate about body axis 1"
    assert frame.attrs["table"] == "gyro"
    assert frame["header_stamp"].dtype == pd.Int64Dtype()
    assert frame["header_stamp"][1] == START + 2_500_000


def test_pandas_sees_all_recordings(out: Path) -> None:
    frame = pd.read_parquet(out / "gyro")
    assert sorted(set(frame["recording"])) == IDS
    assert frame.attrs["units"]["p"] == "rad/s"
    assert len(frame) == 50 * len(IDS)


def test_polars_sees_all_recordings_and_the_units(out: Path) -> None:
    frame = pl.read_parquet(out / "gyro", hive_partitioning=True)
    assert frame.schema["recording"] == pl.String
    assert sorted(frame["recording"].unique()) == IDS
    assert frame["header_stamp"].drop_nulls().min() == START + 2_500_000
    metadata = pl.read_parquet_metadata(storage.table_file(out, "run7", "gyro"))
    assert json.loads(metadata["gyrostand"])["units"]["p"] == "rad/s"


def test_duckdb_sees_all_recordings_and_the_units(out: Path) -> None:
    files = out / "gyro" / "*" / "*.parquet"
    rows = duckdb.execute(
        "select recording, count(*), min(header_stamp) from read_parquet(?) group by recording order by 1",
        [str(files)],
    ).fetchall()
    assert rows == [(name, 50, START + 2_500_000) for name in IDS]
    facts = duckdb.execute(
        "select decode(value) from parquet_kv_metadata(?) where decode(key) = 'gyrostand'",
        [str(storage.table_file(out, "run7", "gyro"))],
    ).fetchall()
    assert json.loads(facts[0][0])["units"]["p"] == "rad/s"


def test_pyarrow_sees_all_recordings_and_the_units(out: Path) -> None:
    whole = ds.dataset(out / "gyro", partitioning="hive").to_table()
    assert sorted(whole.column("recording").unique().to_pylist()) == IDS
    schema = pq.read_schema(storage.table_file(out, "run7", "gyro"))
    assert schema.field("p").metadata[b"unit"] == b"rad/s"


def test_a_run_at_work_does_not_disturb_readers(out: Path) -> None:
    """Polars and DuckDB read hidden files too: nothing unfinished may lie among the tables."""
    with storage.publication(out, "run7") as publication:
        publication.publish("gyro", storage.read(out, "run7", "gyro"))
        assert len(pl.read_parquet(out / "gyro")) == 50 * len(IDS)
        query = "select count(*) from read_parquet(?)"
        count = duckdb.execute(query, [str(out / "gyro" / "**" / "*.parquet")]).fetchall()
        assert count == [(50 * len(IDS),)]
        assert len(pd.read_parquet(out / "gyro")) == 50 * len(IDS)
