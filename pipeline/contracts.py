"""The contracts in ``schemas/``: what each table holds.

A contract is one JSON file: the table's title and, for each column, name, Arrow type, unit, whether it
may be null, its meaning, and, where they apply, its range, its allowed values, whether it holds what was
recorded (then NaN and infinities may occur) and how it must rise. It is the single source of truth for the
code, for CI and for analysts. `pipeline.storage.contract_check` holds a table against it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NoReturn, TypeVar, cast

import pyarrow as pa

from pipeline.errors import ExitCode, GyrostandError

_HERE = Path(__file__).resolve().parent
_T = TypeVar("_T")
Rise = Literal["increasing", "strictly increasing"]

TYPES: Mapping[str, pa.DataType] = MappingProxyType(
    {
        "bool": pa.bool_(),
        "int32": pa.int32(),
        "int64": pa.int64(),
        "float64": pa.float64(),
        "string": pa.string(),
    }
)
"""The types a column may have: those that pandas, polars, DuckDB and pyarrow read alike."""

_RISES = ("increasing", "strictly increasing")
_TABLE_KEYS = ("table", "schema_version", "title", "columns")
_COLUMN_KEYS = ("name", "type", "unit", "nullable", "long_name")
_OPTIONAL_KEYS = ("range", "values", "nan", "monotonic")


class ContractError(GyrostandError):
    """A table, or a contract itself, is not what ``schemas/`` says."""

    exit_code = ExitCode.NOT_MET


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a contract; ``unit`` is "" for words (or a unit by row) and "1" for pure numbers."""

    name: str
    type: pa.DataType
    unit: str
    nullable: bool
    long_name: str
    range: tuple[float | None, float | None] | None
    values: tuple[str, ...] | None
    nan: bool
    monotonic: Rise | None


@dataclass(frozen=True, slots=True)
class Contract:
    """What a table holds. Its Arrow schema carries the units in field metadata."""

    name: str
    version: int
    title: str
    columns: tuple[Column, ...]

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema, each field with its unit and meaning in its metadata."""
        return pa.schema(
            [
                pa.field(c.name, c.type, c.nullable, {"unit": c.unit, "long_name": c.long_name})
                for c in self.columns
            ]
        )

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return {c.name: c.unit for c in self.columns}

    @property
    def long_names(self) -> dict[str, str]:
        """Meaning of each column."""
        return {c.name: c.long_name for c in self.columns}


def folder() -> Path:
    """Where the contracts are: inside the installed package, else at the checkout's top level."""
    installed = _HERE / "schemas"
    return installed if installed.is_dir() else _HERE.parent / "schemas"


@cache
def names() -> tuple[str, ...]:
    """Every table that has a contract, in alphabetical order."""
    return tuple(sorted(p.stem for p in folder().glob("*.json") if not p.name.endswith(".schema.json")))


def text(table: str) -> str:
    """The contract of a table as it stands in ``schemas/`` (JSON).

    Raises
    ------
    ContractError
        If no table has that name.
    """
    if table not in names():
        nearest = get_close_matches(table, names(), n=1)
        raise ContractError(
            f"table {table!r}",
            expected="a table with a contract: " + ", ".join(names()),
            found="none of that name",
            remedy=f"did you mean {nearest[0]!r}?" if nearest else "see 'gyrostand schema list'",
            exit_code=ExitCode.USAGE,
        )
    return (folder() / f"{table}.json").read_text(encoding="utf-8")


@cache
def contract(table: str) -> Contract:
    """The contract of a table.

    Raises
    ------
    ContractError
        If no table has that name, or its file is not a contract.
    """
    return parse(text(table), table)


def table(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """Build a table in the types, order and metadata of its contract.

    Parameters
    ----------
    name : str
        Table name.
    columns : mapping
        One array or list for each column of the contract; no other, none missing. A NumPy array whose
        column may be null and may not be NaN has its NaN turned into null.
    """
    agreed = contract(name)
    if set(columns) != {c.name for c in agreed.columns}:
        raise ContractError(
            f"table {name}",
            expected="columns " + ", ".join(c.name for c in agreed.columns),
            found=", ".join(columns),
            remedy="report this as a fault of the stage that built it",
            exit_code=ExitCode.FAULT,
        )
    arrays = [
        pa.array(columns[c.name], type=c.type, from_pandas=c.nullable and not c.nan)
        if not isinstance(columns[c.name], pa.ChunkedArray | pa.Array)
        else columns[c.name].cast(c.type)
        for c in agreed.columns
    ]
    return pa.Table.from_arrays(arrays, schema=agreed.schema)


def parse(source: str, name: str) -> Contract:
    """Read a contract from the text of its file.

    Parameters
    ----------
    source : str
        JSON.
    name : str
        Name of the file without its suffix, which is the table's name.

    Raises
    ------
    ContractError
        At the first thing that is wrong, with exit code 4: a contract is part of the program.
    """
    where = f"schemas/{name}.json"
    try:
        content = json.loads(source, object_pairs_hook=lambda pairs: _unique(pairs, where))
    except json.JSONDecodeError as error:
        _refuse(f"{where} line {error.lineno}", "JSON", error.msg)
    if not isinstance(content, dict):
        _refuse(where, "a JSON object", type(content).__name__)
    _require_keys(content, _TABLE_KEYS, (), where)
    if content["table"] != name:
        _refuse(f"{where}: table", f"{name!r}, as the file is called", repr(content["table"]))
    columns = tuple(
        _column(entry, where, place) for place, entry in enumerate(_typed(content, "columns", list, where))
    )
    if not columns:
        _refuse(f"{where}: columns", "at least one", "none")
    _unique([(c.name, None) for c in columns], f"{where}: columns")
    version = _typed(content, "schema_version", int, where)
    return Contract(name, version, _typed(content, "title", str, where), columns)


def reference_markdown() -> str:
    """The reference of all tables for ``docs/contracts.md``, as Markdown."""
    lines = [
        "# The tables",
        "",
        "<!-- Made from schemas/ by pipeline.contracts.reference_markdown(); do not edit. -->",
        "",
        "Every table is written as `<out>/<table>/recording=<id>/part-0.parquet`. Units are SI and radians; "
        '"1" is a pure number, "by row" means that the column `unit` of the same row says it. '
        "Times are integer nanoseconds. Where NaN is allowed the column holds what was recorded, infinities "
        "included; everywhere else every number is finite, and a value that does not exist is null.",
        "",
        "`gyrostand schema show NAME` prints a contract as JSON, `gyrostand check DIR` holds outputs "
        "against it.",
    ]
    for name in names():
        lines += ["", *_section(contract(name))]
    return "\n".join(lines) + "\n"


def _section(agreed: Contract) -> list[str]:
    by_row = any(c.name == "unit" for c in agreed.columns)
    lines = [
        f"## {agreed.name}",
        "",
        f"{agreed.title}. Version {agreed.version}.",
        "",
        "| column | type | unit | null | rule | meaning |",
        "|---|---|---|---|---|---|",
    ]
    for c in agreed.columns:
        unit = c.unit or ("by row" if by_row and c.type == pa.float64() else "")
        null = "yes" if c.nullable else "no"
        type_name = next(alias for alias, arrow in TYPES.items() if arrow == c.type)
        lines.append(f"| `{c.name}` | {type_name} | {unit} | {null} | {_rule(c)} | {c.long_name} |")
    return lines


def _rule(column: Column) -> str:
    rules = []
    if column.range is not None:
        low, high = column.range
        rules.append(f"≥ {low:g}" if low is not None else "")
        rules.append(f"≤ {high:g}" if high is not None else "")
    if column.values is not None:
        rules.append(", ".join(f"`{v}`" for v in column.values))
    if column.nan:
        rules.append("NaN allowed")
    rules.append(column.monotonic or "")
    return "; ".join(r for r in rules if r)


def _column(entry: object, file: str, place: int) -> Column:
    """One column, with every rule that a column must keep."""
    if not isinstance(entry, dict):
        _refuse(f"{file}: column {place}", "a JSON object", type(entry).__name__)
    where = f"{file}: column {entry.get('name', place)!r}"
    _require_keys(entry, _COLUMN_KEYS, _OPTIONAL_KEYS, where)
    alias = _typed(entry, "type", str, where)
    if alias not in TYPES:
        _refuse(f"{where}: type", "one of " + ", ".join(TYPES), repr(alias))
    column = Column(
        name=_typed(entry, "name", str, where),
        type=TYPES[alias],
        unit=_typed(entry, "unit", str, where),
        nullable=_typed(entry, "nullable", bool, where),
        long_name=_typed(entry, "long_name", str, where),
        range=_range(entry, where),
        values=_values(entry, where),
        nan=_typed(entry, "nan", bool, where) if "nan" in entry else False,
        monotonic=_rise(entry, where),
    )
    _require_sense(column, alias, where)
    return column


def _require_sense(column: Column, alias: str, where: str) -> None:
    """Refuse rules that the column's type cannot keep."""
    number = alias in ("int32", "int64", "float64")
    if column.nan and alias != "float64":
        _refuse(f"{where}: nan", "it on a float64 only", alias)
    if column.values is not None and alias != "string":
        _refuse(f"{where}: values", "them on a string only", alias)
    if column.range is not None and not number:
        _refuse(f"{where}: range", "it on a number only", alias)
    if column.monotonic is not None and (not number or column.nullable or column.nan):
        _refuse(f"{where}: monotonic", "it on a number that is never null or NaN", "one that may be")


def _range(entry: Mapping[str, Any], where: str) -> tuple[float | None, float | None] | None:
    if "range" not in entry:
        return None
    expected = "[low, high], finite, either of them null, low not above high"
    bounds = entry["range"]
    if not isinstance(bounds, list) or len(bounds) != 2:
        _refuse(f"{where}: range", expected, repr(bounds))
    for bound in bounds:
        if bound is not None and (type(bound) not in (int, float) or not math.isfinite(bound)):
            _refuse(f"{where}: range", expected, repr(bounds))
    low, high = bounds
    if low is not None and high is not None and low > high:
        _refuse(f"{where}: range", expected, repr(bounds))
    return (low, high)


def _values(entry: Mapping[str, Any], where: str) -> tuple[str, ...] | None:
    if "values" not in entry:
        return None
    values = _typed(entry, "values", list, where)
    if not values or not all(isinstance(v, str) for v in values):
        _refuse(f"{where}: values", "a list of words", repr(values))
    _unique([(v, None) for v in values], f"{where}: values")
    return tuple(values)


def _rise(entry: Mapping[str, Any], where: str) -> Rise | None:
    if "monotonic" not in entry:
        return None
    if entry["monotonic"] not in _RISES:
        _refuse(f"{where}: monotonic", "one of " + ", ".join(_RISES), repr(entry["monotonic"]))
    return cast("Rise", entry["monotonic"])


def _typed(entry: Mapping[str, Any], key: str, kind: type[_T], where: str) -> _T:
    """The value of a key, which must be of exactly that JSON type (true is no integer)."""
    value = entry[key]
    if type(value) is not kind:
        _refuse(f"{where}: {key}", kind.__name__, repr(value))
    return value


def _require_keys(
    entry: Mapping[str, Any], required: Sequence[str], optional: Sequence[str], where: str
) -> None:
    known = (*required, *optional)
    for key in entry:
        if key not in known:
            nearest = get_close_matches(key, known, n=1)
            hint = f" (did you mean {nearest[0]!r}?)" if nearest else ""
            _refuse(where, "the keys " + ", ".join(known), f"{key!r}{hint}")
    for key in required:
        if key not in entry:
            _refuse(where, f"the key {key!r}", "none")


def _unique(pairs: Sequence[tuple[str, Any]], where: str) -> dict[str, Any]:
    """The pairs as a mapping; a name that occurs twice is refused, where JSON would keep the last."""
    mapping = dict(pairs)
    if len(mapping) != len(pairs):
        keys = [key for key, _ in pairs]
        _refuse(where, "every name once", f"{next(k for k in keys if keys.count(k) > 1)!r} twice")
    return mapping


def _refuse(where: str, expected: str, found: str) -> NoReturn:
    raise ContractError(
        where, expected=expected, found=found, remedy="correct the contract", exit_code=ExitCode.FAULT
    )
