"""Text recordings: CSV, TSV, semicolons or blanks, plain or compressed (.gz, .zst).

A text file is one topic, named "", without clocks: its time is a column, or a rate, as the test plan says.
A field is a column, named by its header as written, or without the unit in brackets where that is enough:
``Gyroscope X (deg/s)`` or ``Gyroscope X``. How the file is laid out is found out in `text_layout`; its
rows are parsed in `text_cells`. Columns of words are passed over.

The writer makes one row a time stamp of any series, with empty cells where a series has no sample. Its
rows stand in the order of log time; the time column holds the header stamps, so that a stamp may go back.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.formats import text_bytes
from pipeline.formats.base import (
    Field,
    Inspection,
    RecordingError,
    Request,
    Samples,
    Series,
    TextLayout,
    TimeField,
    Topic,
    nanoseconds_a_unit,
    unknown_name,
    wrong_request,
)
from pipeline.formats.text_cells import parse
from pipeline.formats.text_layout import FoundLayout, find_layout

FORMAT = "text"
SUFFIX = ".csv"
TIME_COLUMN = "time (s)"
"""The time column of files written here: header stamps in seconds, nine decimals."""

_LOOK = 4096
_T = TypeVar("_T")


def recognises(path: Path) -> bool:
    """Whether a file begins like text: no zero byte, and hardly a control character."""
    if not path.is_file():
        return False
    start = text_bytes.head(path, _LOOK)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        start = start.decode("utf-16", errors="replace").encode()
    controls = sum(byte < 32 and byte not in b"\t\n\f\r" for byte in start)
    return bool(start) and b"\0" not in start and controls <= len(start) // 100


def inspect(path: Path, layout: TextLayout) -> Inspection:
    """The columns of numbers, with the units that the header states, and the count of rows."""
    text, losses = text_bytes.load(path)
    found = find_layout(text, layout, str(path))
    numbers = [index for index, column in enumerate(found.columns) if column.number]
    columns, more = parse(text, found, numbers, {}, str(path))
    topic = Topic(
        name="",
        message_type="row",
        encoding=f"text, delimiter {found.delimiter!r}, decimal mark {found.decimal!r}",
        count=len(columns[numbers[0]]),
        fields=tuple(Field(c.name, "float64", c.unit) for c in found.columns if c.number),
        clocks={},
    )
    return Inspection(path, FORMAT, (topic,), losses + more)


def read(path: Path, requests: Sequence[Request], layout: TextLayout) -> Samples:
    """The requested columns, of all requests, as one table.

    Raises
    ------
    RecordingError
        If the file cannot be read as text with rows of numbers; with exit code USAGE if a topic is
        requested, or a column that is not there, or one as a number and as a time.
    """
    where = str(path)
    for request in requests:
        if request.topic:
            raise wrong_request(
                where,
                "no topic: a text file has none",
                repr(request.topic),
                "leave topic out of the test plan",
            )
    text, losses = text_bytes.load(path)
    found = find_layout(text, layout, where)
    fields = _unique(field for request in requests for field in request.fields)
    times = _unique(time for request in requests for time in request.times)
    numbers = {field: _index(field, found, where) for field in fields}
    moments = {time.path: _index(time.path, found, where) for time in times}
    as_times = _time_scales(times, moments, where)
    for path_, index in numbers.items():
        if index in as_times:
            raise wrong_request(f"{where}, column {path_!r}", "a channel or a time", "both")
    columns, more = parse(text, found, set(numbers.values()), as_times, where)
    table = pa.table({name: columns[index] for name, index in (numbers | moments).items()})
    stated = {name: found.columns[index].unit for name, index in (numbers | moments).items()}
    return Samples({"": table}, losses + more, {name: unit for name, unit in stated.items() if unit})


def write(path: Path, series: Sequence[Series]) -> None:
    """Write the series as one table: times exact, values so that they are read back the same.

    The columns are parted by tabs where the name ends in .tsv, else by commas; the file is packed where it
    ends in .gz or .zst.
    """
    delimiter = "\t" if ".tsv" in path.suffixes[-2:] else ","
    names = [TIME_COLUMN]
    for one in series:
        names += one.columns
    if len(set(names)) < len(names):
        raise RecordingError(
            str(path),
            expected="a name of its own for every column",
            found=", ".join(names),
            remedy="name the columns of the series apart",
            exit_code=ExitCode.FAULT,
        )
    rows, places = _rows(series)
    cells = [[""] * len(rows) for _ in names]
    cells[0] = [_seconds(stamp) for stamp in rows.tolist()]
    column = 1
    for one, place in zip(series, places, strict=True):
        for values in one.columns.values():
            for row, value in zip(place.tolist(), values.tolist(), strict=True):
                cells[column][row] = repr(value)
            column += 1
    header = io.StringIO()
    csv.writer(header, delimiter=delimiter, lineterminator="\n").writerow(names)
    body = "".join(delimiter.join(row) + "\n" for row in zip(*cells, strict=True))
    text_bytes.save(path, (header.getvalue() + body).encode())


def _rows(series: Sequence[Series]) -> tuple[NDArray[np.int64], list[NDArray[np.intp]]]:
    """Header stamps of the rows in file order, and for each series the rows of its samples.

    Samples of different series share a row when both their clocks agree; a sample that repeats the clocks
    of another of its own series has a row of its own.
    """
    keys = np.concatenate([_keys(one) for one in series])
    unique, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((first, unique[:, 0]))
    row_of = np.empty(len(order), dtype=np.intp)
    row_of[order] = np.arange(len(order))
    ends = np.cumsum([len(one.log_time) for one in series])
    return unique[order, 1], np.split(row_of[inverse.reshape(-1)], ends[:-1])


def _keys(one: Series) -> NDArray[np.int64]:
    """Log time, header stamp, and how often the pair has come before, of each sample."""
    order = np.lexsort((one.header_stamp, one.log_time))  # stable: repeats stay in file order
    log_time, header_stamp = one.log_time[order], one.header_stamp[order]
    new = np.r_[True, (np.diff(log_time) != 0) | (np.diff(header_stamp) != 0)][: len(order)]
    starts = np.flatnonzero(new)
    repeats = np.empty(len(order), dtype=np.int64)
    repeats[order] = np.arange(len(order)) - starts[np.cumsum(new) - 1]
    return np.column_stack((one.log_time, one.header_stamp, repeats))


def _seconds(nanoseconds: int) -> str:
    whole, fraction = divmod(abs(nanoseconds), 10**9)
    return f"{'-' if nanoseconds < 0 else ''}{whole}.{fraction:09d}"


def _unique(items: Iterable[_T]) -> list[_T]:
    return list(dict.fromkeys(items))


def _index(path: str, found: FoundLayout, where: str) -> int:
    """The column of that name, or of that name but for its unit."""
    names = [column.name for column in found.columns]
    bare_names = [column.bare_name for column in found.columns]
    for candidates in (names, bare_names):
        if candidates.count(path) == 1:
            index = candidates.index(path)
            if found.columns[index].number:
                return index
            raise wrong_request(
                f"{where}, column {path!r}", "numbers", "words", "name another column in the test plan"
            )
    same = [name for name, bare in zip(names, bare_names, strict=True) if bare == path]
    if same:
        raise wrong_request(
            where,
            f"one column {path!r}",
            ", ".join(map(repr, same)),
            "name it with its unit in the test plan",
        )
    raise unknown_name(where, "column", path, names if path.endswith((")", "]")) else bare_names)


def _time_scales(times: Iterable[TimeField], columns: Mapping[str, int], where: str) -> dict[int, int]:
    """Nanoseconds in one unit of each time column."""
    scales: dict[int, int] = {}
    for time in times:
        at = f"{where}, column {time.path!r}"
        scale = nanoseconds_a_unit(time, at)
        if scales.setdefault(columns[time.path], scale) != scale:
            raise wrong_request(at, "one unit of time", f"{time.unit!r} and another")
    return scales
