"""The contracts: every one is sound, a broken one is refused in one line, the reference is current."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pipeline import contracts
from pipeline.errors import ExitCode

REFERENCE = Path(__file__).resolve().parents[1] / "docs" / "contracts.md"


def column(**other: Any) -> dict[str, Any]:
    base = {"name": "x", "type": "float64", "unit": "rad", "nullable": False, "long_name": "an angle"}
    return base | other


def source(*columns: Any, **other: Any) -> str:
    content = {"table": "t", "schema_version": 1, "title": "A table", "columns": columns or [column()]}
    return json.dumps(content | other)


@pytest.mark.parametrize("name", contracts.names())
def test_every_contract_is_sound(name: str) -> None:
    agreed = contracts.contract(name)
    assert agreed.name == name
    assert json.loads(contracts.text(name))["title"] == agreed.title
    for c, field in zip(agreed.columns, agreed.schema, strict=True):
        assert (field.name, field.type, field.nullable) == (c.name, c.type, c.nullable)
        assert field.metadata == {b"unit": c.unit.encode(), b"long_name": c.long_name.encode()}
        assert c.long_name
        # A number without a unit is one whose unit stands in its row.
        assert c.unit or not pa.types.is_floating(c.type) or "unit" in agreed.units


def test_reference_is_current() -> None:
    assert REFERENCE.read_text(encoding="utf-8") == contracts.reference_markdown(), (
        "write docs/contracts.md anew with pipeline.contracts.reference_markdown()"
    )


def test_parse_reads_every_rule() -> None:
    agreed = contracts.parse(
        source(
            column(range=[-1.5, None], nan=True),
            column(name="n", type="int64", monotonic="strictly increasing"),
            column(name="word", type="string", unit="", nullable=True, values=["a", "b"]),
        ),
        "t",
    )
    x, n, word = agreed.columns
    assert (x.range, x.nan, x.unit) == ((-1.5, None), True, "rad")
    assert (n.type, n.monotonic, n.nan) == (pa.int64(), "strictly increasing", False)
    assert (word.values, word.nullable) == (("a", "b"), True)


@pytest.mark.parametrize(
    ("broken", "where", "found"),
    [
        ("{", "schemas/t.json line 1", "Expecting property name"),
        ("[]", "schemas/t.json", "list"),
        (source(table="other"), "table", "'other'"),
        (source(schema_version="1"), "schema_version", "'1'"),
        (source(schema_version=True), "schema_version", "True"),
        (source(titel="A table"), "schemas/t.json", "'titel' (did you mean 'title'?)"),
        (source(columns=[]), "columns", "none"),
        (source(columns={}), "columns", "{}"),
        (source("x"), "column 0", "str"),
        (source(column(), column()), "columns", "'x' twice"),
        (source(column(type="float32")), "column 'x': type", "'float32'"),
        (source(column(type=None)), "column 'x': type", "None"),
        (source(column(nulable=True)), "column 'x'", "'nulable' (did you mean 'nullable'?)"),
        (source({k: v for k, v in column().items() if k != "unit"}), "column 'x'", "none"),
        (source(column(nullable="no")), "column 'x': nullable", "'no'"),
        (source(column(range=[1, 0])), "column 'x': range", "[1, 0]"),
        (source(column(range=[0])), "column 'x': range", "[0]"),
        (source(column(range=[float("nan"), 1])), "column 'x': range", "[nan, 1]"),
        (source(column(range=["0", 1])), "column 'x': range", "['0', 1]"),
        (source(column(type="string", range=[0, 1])), "column 'x': range", "string"),
        (source(column(values=["a"])), "column 'x': values", "float64"),
        (source(column(type="string", values=[])), "column 'x': values", "[]"),
        (source(column(type="string", values=["a", "a"])), "column 'x': values", "'a' twice"),
        (source(column(type="int64", nan=True)), "column 'x': nan", "int64"),
        (source(column(monotonic="rising")), "column 'x': monotonic", "'rising'"),
        (source(column(monotonic="increasing", nullable=True)), "column 'x': monotonic", "one that may be"),
        ('{"table": "t", "table": "t"}', "schemas/t.json", "'table' twice"),
    ],
)
def test_a_broken_contract_is_one_clear_line(broken: str, where: str, found: str) -> None:
    with pytest.raises(contracts.ContractError) as caught:
        contracts.parse(broken, "t")
    assert caught.value.where.endswith(where) or caught.value.where == where
    assert found in caught.value.found
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == ExitCode.FAULT


def test_a_mistyped_table_name_gets_a_suggestion() -> None:
    with pytest.raises(contracts.ContractError, match="did you mean 'metrics'") as caught:
        contracts.contract("metric")
    assert caught.value.exit_code == ExitCode.USAGE


def test_table_takes_types_order_and_metadata_from_the_contract() -> None:
    agreed = contracts.contract("attitude")
    values = {"gamma": [3.0], "theta": [2.0], "psi": np.array([1.0]), "segment": [0], "time": [5]}
    built = contracts.table("attitude", values)
    assert built.schema.equals(agreed.schema, check_metadata=True)
    assert built.to_pylist() == [{"time": 5, "segment": 0, "psi": 1.0, "theta": 2.0, "gamma": 3.0}]


def test_table_turns_nan_into_null_only_where_the_column_may_be_null() -> None:
    metric = {c: [""] for c in contracts.contract("metrics").units} | {
        "value": np.array([np.nan]),
        "standard_error": [None],
        "lower_limit": [None],
        "upper_limit": [None],
    }
    assert contracts.table("metrics", metric).column("value").null_count == 1
    gyro = {c: np.array([np.nan]) for c in "pqr"} | {
        c: [1] for c in ("run", "time", "header_stamp", "log_time", "publish_time")
    }
    assert contracts.table("gyro", gyro).column("p").null_count == 0


def test_table_refuses_other_columns() -> None:
    with pytest.raises(contracts.ContractError, match="fault of the stage"):
        contracts.table("attitude", {"time": [1]})
