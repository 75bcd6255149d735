"""The rows of a text recording as Arrow columns: numbers as ``float64``, times as exact ``int64`` ns.

Arrow's own parser reads the whole of a sound file, and the count of its rows is held against the count of
lines, so that nothing can vanish in it. Where that does not come out (comments between the rows, ragged
or cut lines, garbled cells), the lines are gone through one by one, and every line and cell left out is
said with its number.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal, InvalidOperation, localcontext

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
from numpy.typing import NDArray

from pipeline.formats.base import Loss, RecordingError
from pipeline.formats.text_head import MISSING, WHITESPACE, number_pattern, split
from pipeline.formats.text_layout import FoundLayout

_SHOWN = 10
_DIGITS = pa.decimal128(37, 18)
_INT64 = np.iinfo(np.int64)


def parse(
    text: bytes, layout: FoundLayout, numbers: Collection[int], times: Mapping[int, int], where: str
) -> tuple[dict[int, pa.ChunkedArray], tuple[Loss, ...]]:
    """Parse some columns of a text recording.

    Parameters
    ----------
    text : bytes
        The recording, as `text_bytes.load` returns it.
    layout : FoundLayout
        Its layout.
    numbers : collection of int
        Indices of the columns to be read as ``float64``.
    times : mapping of int to int
        Indices of the columns to be read as times, each with the nanoseconds in one of its units.
    where : str
        The file, for errors.

    Returns
    -------
    columns : dict of int to pyarrow.ChunkedArray
        By index; equal lengths.
    losses : tuple of Loss
        Lines that are no rows, and cells that are no numbers, with their numbers.
    """
    kinds = dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(times, pa.string())
    if not kinds:
        return {}, ()
    body = _body(text, layout)
    if _is_plain(body, layout):
        try:
            table = _read(body, layout, kinds)
            if table.num_rows == body.count(b"\n") + (not body.endswith(b"\n")):
                return {
                    index: _exact_times(column, times[index], layout.decimal) if index in times else column
                    for index, column in _columns(table, kinds)
                }, ()
        except (pa.ArrowInvalid, _GarbledError):
            pass  # which line or cell it is, is found out line by line
    return _parse_by_line(body, layout, kinds, times, where)


class _GarbledError(Exception):
    """Some cells are no numbers; ``rows`` says which."""

    def __init__(self, rows: NDArray[np.intp]) -> None:
        self.rows = rows
        super().__init__(f"{len(rows)} cells")


def _body(text: bytes, layout: FoundLayout) -> bytes:
    """The lines from the first row on; runs of blanks, where they delimit, as one blank."""
    start = 0
    for _ in range(layout.first_line):
        start = text.index(b"\n", start) + 1
    body = text[start:]
    if layout.delimiter == WHITESPACE:
        body = b"\n" + body.replace(b"\t", b" ") + b"\n"
        for many, one in ((b"  ", b" "), (b" \n", b"\n"), (b"\n ", b"\n")):
            while many in body:
                body = body.replace(many, one)
        body = body[1:-1]
    return body


def _separator(layout: FoundLayout) -> bytes:
    """What parts the cells of the body."""
    return b" " if layout.delimiter == WHITESPACE else layout.delimiter.encode()


def _is_plain(body: bytes, layout: FoundLayout) -> bool:
    """Whether Arrow's parser can be trusted with the body.

    It knows no comments, and what stands beside a quoted part of a cell it joins to it: here every quote has
    to open or close a whole cell.
    """
    if any(b"\n" + mark.encode() in body for mark in layout.comments):
        return False
    if b'"' not in body:
        return True
    characters = np.frombuffer(b"\n" + body + b"\n", dtype=np.uint8)
    quotes = np.flatnonzero(characters == ord('"'))
    outside = np.concatenate((characters[quotes[::2] - 1], characters[quotes[1::2] + 1]))
    return len(quotes) % 2 == 0 and bool(np.isin(outside, (ord(_separator(layout)), ord("\n"))).all())


def _read(body: bytes, layout: FoundLayout, kinds: Mapping[int, pa.DataType]) -> pa.Table:
    """Arrow's parser: fails on a line that is not as wide as the others, or a cell not of its kind."""
    names = [str(index) for index in range(len(layout.columns))]
    return pyarrow.csv.read_csv(
        pa.BufferReader(body),
        read_options=pyarrow.csv.ReadOptions(column_names=names),
        parse_options=pyarrow.csv.ParseOptions(
            delimiter=" " if layout.delimiter == WHITESPACE else layout.delimiter
        ),
        convert_options=pyarrow.csv.ConvertOptions(
            column_types={str(index): kind for index, kind in kinds.items()},
            include_columns=[str(index) for index in kinds],
            null_values=list(MISSING),
            strings_can_be_null=True,
            decimal_point=layout.decimal,
        ),
    )


def _columns(table: pa.Table, kinds: Mapping[int, pa.DataType]) -> list[tuple[int, pa.ChunkedArray]]:
    return [(index, table.column(str(index))) for index in kinds]


def _parse_by_line(
    body: bytes,
    layout: FoundLayout,
    kinds: Mapping[int, pa.DataType],
    times: Mapping[int, int],
    where: str,
) -> tuple[dict[int, pa.ChunkedArray], tuple[Loss, ...]]:
    """Leave out the lines that are no rows, make null the cells that are no numbers, and say so."""
    rows, numbers, damaged, cut = _sort_lines(body, layout)
    if not rows:
        raise RecordingError(
            where,
            expected=f"rows of {len(layout.columns)} columns, as its first numbers suggest",
            found="none",
            remedy="if it is a recording, give delimiter, decimal or skip_lines in [text]",
        )
    losses = []
    if damaged:
        detail = f"{len(damaged)} lines do not have {len(layout.columns)} columns: {_listed(damaged)}"
        losses.append(Loss("", detail, len(damaged), "lines"))
    if cut is not None:
        losses.append(Loss("", f"the last line, {cut}, is cut short", 1, "lines"))
    try:
        table = _read(b"\n".join(rows) + b"\n", layout, dict.fromkeys(kinds, pa.string()))
        if table.num_rows != len(rows):
            raise pa.ArrowInvalid(f"{table.num_rows} rows from {len(rows)} lines")
    except pa.ArrowInvalid as error:
        raise RecordingError(
            where,
            expected=f"rows of {len(layout.columns)} columns",
            found=f"lines that cannot be taken apart ({error})",
            remedy="check the quotes in the file, or its delimiter in [text]",
        ) from error
    columns = {}
    for index, cells in _columns(table, kinds):
        column, garbled = _tolerant(cells, times.get(index), layout.decimal)
        columns[index] = column
        if garbled.size:
            name = layout.columns[index].name
            kind = "times" if index in times else "numbers"
            lines = _listed([numbers[row] for row in garbled])
            losses.append(
                Loss(
                    "",
                    f"{garbled.size} cells of column {name!r} are no {kind}: {lines}",
                    garbled.size,
                    "cells",
                )
            )
    return columns, tuple(losses)


def _sort_lines(body: bytes, layout: FoundLayout) -> tuple[list[bytes], list[int], list[int], int | None]:
    """Rows with their line numbers, numbers of damaged lines, and that of a cut last line.

    Blank lines, comments and repeated headers are neither: they hold no sample.
    """
    delimiter = _separator(layout)
    comments = tuple(mark.encode() for mark in layout.comments)
    cell = rb'(?:"(?:[^"]|"")*" *|[^"%s]*)' % re.escape(delimiter)
    well_quoted = re.compile(rb"%s(?:%s%s)*" % (cell, re.escape(delimiter), cell))
    rows: list[bytes] = []
    numbers: list[int] = []
    damaged: list[int] = []
    lines = body.split(b"\n")
    for number, line in enumerate(lines, start=layout.first_line + 1):
        bare = line.strip()
        if not bare or bare in layout.above or bare.startswith(comments):
            continue
        width, sound = line.count(delimiter) + 1, b"\0" not in line
        if b'"' in line:
            sound = sound and well_quoted.fullmatch(line) is not None
            width = len(split(line.decode("utf-8", "replace"), layout.delimiter))
        if sound and width == len(layout.columns):
            rows.append(line)
            numbers.append(number)
        else:
            damaged.append(number)
    last = layout.first_line + len(lines)
    cut = damaged.pop() if damaged and damaged[-1] == last else None
    return rows, numbers, damaged, cut


def _tolerant(
    cells: pa.ChunkedArray, scale: int | None, decimal: str
) -> tuple[pa.ChunkedArray, NDArray[np.intp]]:
    """Cells as numbers (or times, where there is a scale), null where they are none, and which those are."""
    garbled = np.empty(0, dtype=np.intp)
    while True:
        try:
            if scale is None:
                return _exact_numbers(cells, decimal), garbled
            return _exact_times(cells, scale, decimal), garbled
        except _GarbledError as error:
            garbled = np.union1d(garbled, error.rows)
            keep = np.ones(len(cells), dtype=bool)
            keep[garbled] = False
            cells = pc.if_else(pa.array(keep), cells, None)


def _point(cells: pa.ChunkedArray, decimal: str) -> pa.ChunkedArray:
    """The cells without outer blanks and with a decimal point; those that are blank alone are null."""
    cells = pc.utf8_trim_whitespace(cells)
    if decimal != ".":
        cells = pc.replace_substring(cells, decimal, ".")
    return pc.if_else(pc.equal(cells, ""), None, cells)


def _garbled(cells: pa.ChunkedArray, pattern: str) -> NDArray[np.intp]:
    """Rows whose cells do not match."""
    match = pc.fill_null(pc.match_substring_regex(cells, f"^(?:{pattern})$"), True)
    return np.flatnonzero(~match.to_numpy())


def _exact_numbers(cells: pa.ChunkedArray, decimal: str) -> pa.ChunkedArray:
    cells = _point(cells, decimal)
    rows = _garbled(cells, rf"{number_pattern('.')}|(?i:[+-]?(?:nan|inf|infinity))")
    if rows.size:
        raise _GarbledError(rows)
    return pc.cast(cells, pa.float64())


def _exact_times(cells: pa.ChunkedArray, scale: int, decimal: str) -> pa.ChunkedArray:
    """Decimal text to the nearest nanosecond, halves away from zero.

    A cell is ``whole + fraction / 10^18`` of its unit of ``scale`` ns, so that with ``fraction = 10^9 high +
    low`` its nanoseconds are ``whole scale + (high scale + low scale / 10^9) / 10^9``: integers throughout.
    """
    cells = _point(cells, decimal)
    try:
        exact = pc.fill_null(pc.cast(cells, _DIGITS), Decimal(0)).combine_chunks()
        whole_part = pc.trunc(exact)
        whole = pc.cast(whole_part, pa.int64()).to_numpy()
    except pa.ArrowInvalid:  # a garbled cell, or more digits than the type has
        return _decimal_times(cells, scale)
    fraction = _low_words(pc.subtract(exact, whole_part))
    most = _INT64.max // scale
    if np.any((whole >= most) | (whole <= -most)):
        return _decimal_times(cells, scale)
    sign = np.sign(fraction)
    high, low = np.divmod(np.abs(fraction), 10**9)
    if scale >= 10**9:
        part = high * (scale // 10**9) + (low * (scale // 10**9) + 5 * 10**8) // 10**9
    else:
        part = (high * scale + low * scale // 10**9 + 5 * 10**8) // 10**9
    return pa.chunked_array([pa.array(whole * scale + sign * part, mask=cells.is_null().to_numpy())])


def _low_words(exact: pa.Array) -> NDArray[np.int64]:
    """The unscaled integers of a decimal array, where they fit into 64 bits."""
    words = np.frombuffer(exact.buffers()[1], dtype=np.int64)
    return words[2 * exact.offset : 2 * (exact.offset + len(exact)) : 2]


def _decimal_times(cells: pa.ChunkedArray, scale: int) -> pa.ChunkedArray:
    """One cell at a time, with as many digits as it has."""
    rows = _garbled(cells, number_pattern("."))
    if rows.size:
        raise _GarbledError(rows)
    times: list[int | None] = []
    bad = []
    with localcontext() as context:
        context.prec = 60
        for row, cell in enumerate(cells.to_pylist()):
            if cell is None:
                times.append(None)
                continue
            try:
                time = int((Decimal(cell) * scale).quantize(Decimal(1), ROUND_HALF_UP))
            except InvalidOperation:  # beyond 60 digits
                time = _INT64.max + 1
            if not _INT64.min <= time <= _INT64.max:
                bad.append(row)
            times.append(time)
    if bad:
        raise _GarbledError(np.array(bad, dtype=np.intp))
    return pa.chunked_array([pa.array(times, pa.int64())])


def _listed(numbers: Sequence[int]) -> str:
    shown = ", ".join(map(str, numbers[:_SHOWN]))
    return f"line {shown}" + (f" and {len(numbers) - _SHOWN} more" if len(numbers) > _SHOWN else "")
