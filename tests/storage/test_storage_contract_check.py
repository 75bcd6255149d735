"""The validator, held to a plain loop over the rows, and to messages that name row, value and unit."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline import contracts
from pipeline.storage import contract_check, parquet
from pipeline.storage.contract_check import violations

LIMITED = contracts.parse(
    json.dumps(
        {
            "table": "limited",
            "schema_version": 1,
            "title": "Every rule at once",
            "columns": [
                {
                    "name": name,
                    "type": kind,
                    "unit": unit,
                    "nullable": nullable,
                    "long_name": name,
                    **rules,
                }
                for name, kind, unit, nullable, rules in [
                    ("time", "int64", "ns", False, {"monotonic": "strictly increasing"}),
                    ("segment", "int32", "1", False, {"monotonic": "increasing"}),
                    ("theta", "float64", "rad", True, {"range": [-1.5, 1.5707963]}),
                    ("raw", "float64", "rad/s", False, {"nan": True}),
                    ("word", "string", "", True, {"values": ["a", "b"]}),
                ]
            ],
        }
    ),
    "limited",
)
SOUND: dict[str, list[Any]] = {
    "time": [10, 20, 30, 40],
    "segment": [0, 0, 1, 1],
    "theta": [0.0, None, -1.5, 1.5707963],
    "raw": [math.nan, math.inf, 0.0, 1.0],
    "word": ["a", None, "b", "a"],
}


def table(**other: list[Any]) -> pa.Table:
    columns = SOUND | other
    return pa.table([pa.array(columns[c.name], c.type) for c in LIMITED.columns], schema=LIMITED.schema)


def lines(**other: list[Any]) -> list[str]:
    return [str(v) for v in violations(LIMITED, table(**other))]


def test_a_sound_table_has_no_violation() -> None:
    assert lines() == []


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"theta": [0, 0, 1.71, 0]}, "limited.theta row 2: 1.71 rad is above 1.5707963"),
        ({"theta": [0, -2, -3, 0]}, "limited.theta row 1: -2.0 rad is below -1.5 (2 rows in all)"),
        ({"theta": [math.nan, 0, 0, 0]}, "limited.theta row 0: nan rad is not finite"),
        ({"raw": [0, 0, None, 0]}, "limited.raw row 2: null where every row must have a value"),
        ({"word": ["a", "b", "c\n", "d"]}, r"limited.word row 2: 'c\n' is none of a, b (2 rows in all)"),
        ({"time": [1, 2, 2, 3]}, "limited.time row 2: 2 ns after 2 ns is not strictly increasing"),
        ({"time": [1, 2, 3, -4]}, "limited.time row 3: -4 ns after 3 ns is not strictly increasing"),
        ({"segment": [0, 1, 0, 1]}, "limited.segment row 2: 0 after 1 is not increasing"),
    ],
)
def test_a_violation_names_row_value_and_unit(change: dict[str, list[Any]], line: str) -> None:
    assert lines(**change) == [line]


def test_an_infinite_value_breaks_its_range_too() -> None:
    assert lines(theta=[0, math.inf, 0, 0]) == [
        "limited.theta row 1: inf rad is not finite",
        "limited.theta row 1: inf rad is above 1.5707963",
    ]


def test_the_rise_is_watched_across_chunks_and_rows_are_counted_through() -> None:
    joined = pa.concat_tables([table(), table(time=[40, 50, 60, 70], segment=[1, 1, 1, 1])])
    assert [str(v) for v in violations(LIMITED, joined)] == [
        "limited.time row 4: 40 ns after 40 ns is not strictly increasing"
    ]


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (table().drop_columns(["raw"]), "limited.raw: the column is missing"),
        (table().append_column("more", [[1] * 4]), "limited.more: the contract has no such column"),
        (table().append_column("x\ny", [[1] * 4]), r"limited.'x\ny': the contract has no such column"),
        (table().append_column("raw", [[1.0] * 4]), "limited.raw: the column is there twice"),
        (
            table().select(["segment", "time", "theta", "raw", "word"]),
            "limited: columns stand as segment, time, theta, raw, word instead of time, segment, theta, raw, "
            "word",
        ),
    ],
)
def test_columns_are_held_to_names_and_order(wrong: pa.Table, line: str) -> None:
    assert [str(v) for v in violations(LIMITED, wrong)] == [line]


@pytest.mark.parametrize(
    ("field", "line"),
    [
        (pa.field("raw", pa.float32(), False, {"unit": "rad/s"}), "type float instead of double"),
        (pa.field("raw", pa.float64(), True, {"unit": "rad/s"}), "lets it be null, the contract does not"),
        (pa.field("raw", pa.float64(), False, {"unit": "deg/s"}), "unit 'deg/s' instead of 'rad/s'"),
        (pa.field("raw", pa.float64(), False), "no unit in the field metadata instead of 'rad/s'"),
    ],
)
def test_fields_are_held_to_type_nullability_and_unit(field: pa.Field, line: str) -> None:
    schema = LIMITED.schema.set(3, field)
    (violation,) = violations(LIMITED, table().cast(schema))
    assert (violation.column, violation.row) == ("raw", None)
    assert line in violation.what


@given(
    st.lists(
        st.tuples(
            st.integers(0, 6),
            st.none() | st.sampled_from([0.0, 1.6, -1.6, math.nan, math.inf, -math.inf]),
            st.none() | st.sampled_from(["a", "b", "c"]),
        ),
        max_size=12,
    ),
    st.lists(st.integers(0, 12), max_size=4),
)
def test_equals_a_plain_loop_over_the_rows(
    rows: list[tuple[int, float | None, str | None]], cuts: list[int]
) -> None:
    n = len(rows)
    whole = table(
        time=[r[0] for r in rows],
        segment=[0] * n,
        theta=[r[1] for r in rows],
        raw=[0.0] * n,
        word=[r[2] for r in rows],
    )
    edges = sorted({0, n, *(c for c in cuts if c < n)})
    pieces = [whole.slice(a, b - a) for a, b in pairwise(edges)]
    chunked = pa.concat_tables([whole.slice(0, 0), *pieces])

    bad = {
        "time": [i for i in range(1, n) if rows[i][0] <= rows[i - 1][0]],
        "not finite": [i for i, r in enumerate(rows) if r[1] is not None and not math.isfinite(r[1])],
        "below": [i for i, r in enumerate(rows) if r[1] is not None and r[1] < -1.5],
        "above": [i for i, r in enumerate(rows) if r[1] is not None and r[1] > 1.5707963],
        "none of": [i for i, r in enumerate(rows) if r[2] == "c"],
    }
    expected = {key: (where[0], len(where)) for key, where in bad.items() if where}
    found = {
        next(k for k in bad if k == v.column or k in v.what): (v.row, v.count)
        for v in violations(LIMITED, chunked)
    }
    assert found == expected


def test_a_file_is_read_by_batches_and_its_rows_counted_through(tmp_path: Path) -> None:
    n = contract_check.BATCH + 10  # two batches
    time = np.arange(n)
    time[contract_check.BATCH] = -1  # the first row of the second
    angle = np.zeros(n)
    attitude = {"time": time, "segment": np.zeros(n), "psi": angle, "theta": angle, "gamma": angle}
    path = tmp_path / "attitude.parquet"
    parquet.write(path, "attitude", contracts.table("attitude", attitude))
    assert [str(v) for v in violations("attitude", path)] == [
        f"attitude.time row {n - 10}: -1 ns after {n - 11} ns is not strictly increasing"
    ]


def test_the_units_that_analysts_see_are_held_to_the_contract(tmp_path: Path) -> None:
    empty = contracts.table("attitude", {c: [] for c in contracts.contract("attitude").units})
    metadata = dict(parquet.file_schema(contracts.contract("attitude")).metadata)
    facts = json.loads(metadata[parquet.PANDAS_KEY])
    facts["units"]["psi"] = "deg"
    metadata |= {parquet.PANDAS_KEY: json.dumps(facts), parquet.METADATA_KEY: b"\xff"}
    path = tmp_path / "attitude.parquet"
    pq.write_table(empty.replace_schema_metadata(metadata), path)
    found = [str(v) for v in violations("attitude", path)]
    assert "attitude.psi: file metadata 'PANDAS_ATTRS' says unit 'deg' instead of 'rad'" in found
    assert "attitude: file metadata 'gyrostand' says table None instead of 'attitude'" in found
