"""A table held against its contract, row group by row group.

The work is done by `pyarrow.compute` on batches of bounded size, so that a file of any length is checked in
the memory of one batch. Every violation names table, column, row (from 0), the value and its unit; further
rows that break the same rule of the same column are counted, not listed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline.contracts import Column, Contract, contract
from pipeline.storage import parquet

BATCH = 1 << 18
"""Rows looked at together: 2 MiB a float column."""


@dataclass(frozen=True, slots=True)
class Violation:
    """One rule of a contract that a table breaks.

    ``column`` is "" where the table as a whole is meant, ``row`` (from 0, the first that breaks the rule)
    None where no row is; ``count`` is the number of rows that break it.
    """

    table: str
    column: str
    row: int | None
    what: str
    count: int = 1

    def __str__(self) -> str:
        # A column that a foreign file brings along may be called anything.
        column = self.column if self.column.isprintable() else repr(self.column)
        place = self.table + (f".{column}" if column else "")
        row = "" if self.row is None else f" row {self.row}"
        more = f" ({self.count} rows in all)" if self.count > 1 else ""
        return f"{place}{row}: {self.what}{more}"


@dataclass(frozen=True, slots=True)
class _Breach:
    """The rows of one batch that break a rule; ``reason`` follows the value found in the row it is given."""

    mask: pa.Array
    reason: Callable[[int], str]


def violations(table: str | Contract, source: pa.Table | Path) -> list[Violation]:
    """Hold a table against its contract.

    Checked are the columns' names, order, types, units and whether they may be null; then in each row nulls,
    NaN and infinities, range, allowed values and rise; of a file also what its metadata says of it.

    Parameters
    ----------
    table : str or Contract
        Name of a table of ``schemas/``, or another contract.
    source : pyarrow.Table or Path
        The table, or a Parquet file, which is read with its page checksums verified.

    Returns
    -------
    list of Violation
        Empty where the table keeps its contract.

    Raises
    ------
    StorageError
        If the file is missing or damaged.
    ContractError
        If no table has that name.
    """
    agreed = contract(table) if isinstance(table, str) else table
    if isinstance(source, pa.Table):
        batches = source.to_batches(max_chunksize=BATCH)
        return [*schema_violations(agreed, source.schema), *_row_violations(agreed, source.schema, batches)]
    with parquet.opened(source) as file:
        schema = file.schema_arrow
        return [
            *schema_violations(agreed, schema),
            *_metadata_violations(agreed, schema.metadata or {}),
            *_row_violations(agreed, schema, file.iter_batches(batch_size=BATCH)),
        ]


def schema_violations(agreed: Contract, schema: pa.Schema) -> list[Violation]:
    """Hold the columns' names, order, types, units and nullability against the contract."""
    expected = [c.name for c in agreed.columns]
    found = list(schema.names)
    faults = [Violation(agreed.name, c, None, "the column is missing") for c in expected if c not in found]
    for place, name in enumerate(found):
        if name not in expected:
            faults.append(Violation(agreed.name, name, None, "the contract has no such column"))
        elif name in found[:place]:
            faults.append(Violation(agreed.name, name, None, "the column is there twice"))
    if not faults and found != expected:
        order = f"columns stand as {', '.join(found)} instead of {', '.join(expected)}"
        faults.append(Violation(agreed.name, "", None, order))
    for column in agreed.columns:
        if found.count(column.name) == 1:
            faults += _field_violations(agreed.name, column, schema.field(column.name))
    return faults


def _field_violations(table: str, column: Column, field: pa.Field) -> Iterator[Violation]:
    if field.type != column.type:
        yield Violation(table, column.name, None, f"type {field.type} instead of {column.type}")
    if field.nullable and not column.nullable:
        yield Violation(table, column.name, None, "the schema lets it be null, the contract does not")
    if column.nullable and not field.nullable:
        yield Violation(table, column.name, None, "the schema does not let it be null, the contract does")
    stated = (field.metadata or {}).get(b"unit")
    if stated is None:
        yield Violation(table, column.name, None, f"no unit in the field metadata instead of {column.unit!r}")
    elif stated.decode(errors="replace") != column.unit:
        unit = stated.decode(errors="replace")
        yield Violation(table, column.name, None, f"unit {unit!r} instead of {column.unit!r}")


def _metadata_violations(agreed: Contract, metadata: dict[bytes, bytes]) -> Iterator[Violation]:
    """Hold what the file says of itself, to gyrostand's readers and to pandas, against the contract."""
    expected = parquet.description(agreed)
    for key in (parquet.METADATA_KEY, parquet.PANDAS_KEY):
        where = f"file metadata {key.decode()!r}"
        facts = stated(metadata, key)
        for fact in ("table", "schema_version"):
            if facts.get(fact) != expected[fact]:
                what = f"{where} says {fact} {facts.get(fact)!r} instead of {expected[fact]!r}"
                yield Violation(agreed.name, "", None, what)
        units = facts.get("units")
        units = units if isinstance(units, dict) else {}
        for column, unit in agreed.units.items():
            if units.get(column) != unit:
                what = f"{where} says unit {units.get(column)!r} instead of {unit!r}"
                yield Violation(agreed.name, column, None, what)


def stated(metadata: dict[bytes, bytes], key: bytes) -> dict[str, Any]:
    """The JSON object under a key of the file metadata; empty where there is none that can be read."""
    try:
        facts = json.loads(metadata.get(key, b"{}"))
    except ValueError:  # no JSON, or no UTF-8
        return {}
    return facts if isinstance(facts, dict) else {}


def _row_violations(
    agreed: Contract, schema: pa.Schema, batches: Iterable[pa.RecordBatch]
) -> list[Violation]:
    """Look at every row; the first of each rule and column is described, the others are counted."""
    columns = [
        c for c in agreed.columns if schema.names.count(c.name) == 1 and schema.field(c.name).type == c.type
    ]
    found: dict[tuple[str, str], Violation] = {}
    before: dict[str, pa.Array] = {}
    start = 0
    for batch in batches:
        for column in columns:
            values = batch.column(schema.get_field_index(column.name))
            for rule, breach in _breaches(column, values, before.get(column.name)):
                _note(found, agreed.name, column, rule, breach, values, start)
            if column.monotonic is not None and len(values):
                before[column.name] = values.slice(len(values) - 1)
        start += len(batch)
    return list(found.values())


def _note(
    found: dict[tuple[str, str], Violation],
    table: str,
    column: Column,
    rule: str,
    breach: _Breach,
    values: pa.Array,
    start: int,
) -> None:
    """Add the breaking rows of a batch, the first of which stands `start` rows into the table."""
    count = breach.mask.true_count
    if not count:
        return
    first = found.get((column.name, rule))
    if first is not None:
        found[column.name, rule] = Violation(table, column.name, first.row, first.what, first.count + count)
        return
    row = pc.index(breach.mask, True).as_py()
    what = f"{_shown(values[row], column.unit)} {breach.reason(row)}"
    found[column.name, rule] = Violation(table, column.name, start + row, what, count)


def _breaches(column: Column, values: pa.Array, before: pa.Array | None) -> Iterator[tuple[str, _Breach]]:
    """Each rule of the column with the rows of the batch that break it; null breaks only its own rule."""
    if not column.nullable and values.null_count:
        yield "null", _Breach(values.is_null(), lambda _: "where every row must have a value")
    if pa.types.is_floating(column.type) and not column.nan:
        yield "finite", _Breach(pc.invert(pc.is_finite(values)), lambda _: "is not finite")
    if column.range is not None:
        low, high = column.range
        if low is not None:
            yield "low", _Breach(pc.less(values, low), lambda _: f"is below {low}")
        if high is not None:
            yield "high", _Breach(pc.greater(values, high), lambda _: f"is above {high}")
    if column.values is not None:
        allowed = column.values
        known = pc.is_in(values, value_set=pa.array(allowed, column.type))
        breaking = pc.and_(values.is_valid(), pc.invert(known))
        yield "values", _Breach(breaking, lambda _: f"is none of {', '.join(allowed)}")
    if column.monotonic is not None and len(values):
        yield "rise", _rise(column, values, before)


def _rise(column: Column, values: pa.Array, before: pa.Array | None) -> _Breach:
    """The rows that do not rise above the row before them, which for the first stands in the batch before."""
    head = values.slice(0, 1) if before is None else before
    behind = pa.concat_arrays([head, values.slice(0, len(values) - 1)])
    strictly = column.monotonic == "strictly increasing"
    mask = pc.less_equal(values, behind) if strictly else pc.less(values, behind)
    if before is None:  # the table's first row has none before it
        mask = pa.concat_arrays([pa.array([False]), mask.slice(1)])
    return _Breach(mask, lambda row: f"after {_shown(behind[row], column.unit)} is not {column.monotonic}")


def _shown(value: pa.Scalar, unit: str) -> str:
    """A value with its unit; a word in quotes, every digit of a number."""
    text = repr(value.as_py()) if value.is_valid else "null"
    return f"{text} {unit}" if value.is_valid and unit not in ("", "1") else text
