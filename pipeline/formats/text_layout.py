"""How a text recording is laid out: found out from its first lines, or as the test plan's [text] says.

The rows of numbers are looked for first: of all readings (delimiter, decimal mark) the one that turns
most cells into numbers is right. They say how many columns there are, and so which of the lines above
them is the header, which a row of units, and which the preamble. A header may stand in a comment line
(``%time,field.header.stamp``). What two readings explain equally well is refused, with the key to give.

A column's name is its header text as written, without quotes and outer blanks, unit and all:
``Gyroscope X (deg/s)``. An empty header is ``column_3`` (counted from 1), and so is every column of a file
without header; the second of two equal names is ``x.1``. Text in round or square brackets at the end is the
unit, unless it is a number: ``gyro_rad[0]`` has none.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.formats.base import RecordingError, TextLayout, wrong_request
from pipeline.formats.text_head import COMMENTS, SAMPLE_LINES, WHITESPACE, Head, Row

_READINGS = (
    (",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", "."), ("|", ","),
    (WHITESPACE, "."), (WHITESPACE, ","),
)  # fmt: skip
_HEAD_BYTES = 256 * 1024
_HEAD_LINES = 1000
_UNIT = re.compile(r"^(?P<name>.*?)\s*(?:\((?P<round>[^()\[\]]+)\)|\[(?P<square>[^()\[\]]+)\])$")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")


@dataclass(frozen=True, slots=True)
class Column:
    """One column; ``number`` says whether its cells are numbers, ``unit`` is as written."""

    name: str
    bare_name: str
    unit: str | None
    number: bool


@dataclass(frozen=True, slots=True)
class FoundLayout:
    """The layout of a file.

    Attributes
    ----------
    delimiter, decimal : str
        As in `TextLayout`.
    comments : tuple of str
        What comment lines begin with.
    columns : tuple of Column
        In the order of the file.
    first_line : int
        Index, from 0, of the line that the rows begin with.
    above : frozenset of bytes
        The lines above it: where one comes again further on, it is a repeated header, no damaged row.
    """

    delimiter: str
    decimal: str
    comments: tuple[str, ...]
    columns: tuple[Column, ...]
    first_line: int
    above: frozenset[bytes]


def find_layout(text: bytes, asked: TextLayout, where: str) -> FoundLayout:
    """Find out the layout.

    Parameters
    ----------
    text : bytes
        The recording, as `text_bytes.load` returns it.
    asked : TextLayout
        What the test plan states; the rest is found out.
    where : str
        The file, for errors.

    Raises
    ------
    RecordingError
        If there are no rows of numbers, or if delimiter, decimal mark or header cannot be decided, or not
        as asked.
    """
    _check_asked(asked, where)
    comments = (asked.comment,) if asked.comment else COMMENTS
    lines = _first_lines(text)
    content = [
        (index, line)
        for index, line in enumerate(lines)
        if index >= (asked.skip_lines or 0) and line.strip() and not line.lstrip().startswith(comments)
    ]
    if not content:
        raise RecordingError(
            where,
            expected="rows of numbers",
            found="no line that is neither blank nor comment",
            remedy="check that the recording was saved, and skip_lines and comment in [text]",
        )
    delimiter, decimal = _reading(content, text, asked, where)
    head = Head(delimiter, decimal, tuple(content))
    header, unit_row, first = head.above_rows()
    if header is None:
        header, unit_row = head.in_comments(lines[:first], comments)
    if asked.header is False:
        header = None
    _check_found(head, header, asked, where)
    return FoundLayout(
        delimiter=delimiter,
        decimal=decimal,
        comments=comments,
        columns=_columns(asked.columns or header or ("",) * head.width, unit_row, head.numeric),
        first_line=first,
        above=frozenset(line.strip().encode() for line in lines[:first]),
    )


def _first_lines(text: bytes) -> list[str]:
    """The lines of the head, without the last where it may be cut."""
    lines = text[:_HEAD_BYTES].decode("utf-8", errors="replace").split("\n")
    if len(text) > _HEAD_BYTES and len(lines) > 1:
        lines.pop()
    return lines[:_HEAD_LINES]


def _reading(
    content: Sequence[tuple[int, str]], text: bytes, asked: TextLayout, where: str
) -> tuple[str, str]:
    """The delimiter and the decimal mark that explain the lines best."""
    readings = [
        (delimiter, decimal)
        for delimiter, decimal in (
            _READINGS if asked.delimiter is None else ((asked.delimiter, "."), (asked.delimiter, ","))
        )
        if asked.decimal in (None, decimal) and delimiter != decimal
    ]
    sample = tuple(content[-SAMPLE_LINES:])
    scores = {reading: Head(*reading, sample).score for reading in readings}
    best = max(readings, key=lambda reading: scores[reading])
    if not scores[best]:
        raise RecordingError(
            where,
            expected="rows of numbers",
            found=f"none up to line {content[-1][0] + 1}",
            remedy="if it is a recording, give delimiter, decimal or skip_lines in [text]",
        )
    rivals = [r for r in readings if r[0] == best[0] and scores[r] == scores[best]]
    if len(rivals) == 1:
        return best
    # Only whole numbers so far: the file's first fractions decide, and without any the mark is idle.
    lines = re.finditer(rb"[^\n]*\d[.,]\d[^\n]*", text)
    fractions = tuple(
        (0, match[0].decode("utf-8", "replace")) for match, _ in zip(lines, range(SAMPLE_LINES), strict=False)
    )
    return max(rivals, key=lambda r: Head(r[0], r[1], fractions).score) if fractions else best


def _columns(names: Row, unit_row: Row | None, numeric: Sequence[bool]) -> tuple[Column, ...]:
    taken: set[str] = set()
    columns = []
    for place, (text, number) in enumerate(zip(names, numeric, strict=True)):
        match = _UNIT.match(text)
        unit = (match["round"] or match["square"]).strip() if match else None
        if unit is not None and unit.isdigit():
            match = unit = None
        if unit is None and unit_row is not None:
            unit = unit_row[place].strip("()[] ") or None
        stem = text or f"column_{place + 1}"
        name, again = stem, 0
        while name in taken:
            again += 1
            name = f"{stem}.{again}"
        taken.add(name)
        columns.append(Column(name, (match["name"] if match else "") or name, unit, number))
    return tuple(columns)


def _check_asked(asked: TextLayout, where: str) -> None:
    mark = asked.delimiter
    if mark is not None and mark != WHITESPACE and (len(mark) != 1 or not mark.isascii() or mark in '"\r\n'):
        raise wrong_request(where, 'one ASCII character or "whitespace" as delimiter in [text]', repr(mark))
    if asked.decimal not in (None, ".", ",") or (asked.decimal and asked.decimal == asked.delimiter):
        raise wrong_request(
            where, '"." or "," as decimal in [text], other than the delimiter', repr(asked.decimal)
        )


def _check_found(head: Head, header: Row | None, asked: TextLayout, where: str) -> None:
    """Refuse what would be a guess, and what is not as asked."""
    if asked.columns is not None and len(asked.columns) != head.width:
        raise wrong_request(
            where,
            f"{len(asked.columns)} columns, as [text] names them",
            f"{head.width} in the rows of the file",
            "name every column in [text] columns, or check its delimiter",
        )
    if asked.header and header is None:
        raise wrong_request(
            where,
            f"a header of {head.width} names, as [text] says",
            "none above the rows",
            "leave header out, or name the columns in [text] columns",
        )
    if asked.delimiter is None and head.delimiter == "," and header is None and _may_be_halves(head.sample):
        raise RecordingError(
            where,
            expected="one way to read its commas",
            found=f"{head.width} whole numbers a row, or half as many with decimal commas",
            remedy="give delimiter and decimal in [text]",
        )
    if asked.decimal is None and head.decimal == "," and _may_be_grouped(head.sample):
        raise RecordingError(
            where,
            expected="one way to read its commas",
            found="numbers like 1,234 alone: a decimal mark, or grouped thousands",
            remedy='give decimal = "," in [text]; grouped thousands are not read',
        )


def _may_be_halves(rows: Sequence[Row]) -> bool:
    """Whether neighbours could be halves of numbers with decimal commas: whole, the second unsigned."""
    return len(rows[0]) % 2 == 0 and all(
        re.fullmatch(r"\d+" if place % 2 else r"[+-]?\d+", cell)
        for row in rows
        for place, cell in enumerate(row)
    )


def _may_be_grouped(rows: Sequence[Row]) -> bool:
    commas = [cell for row in rows for cell in row if "," in cell]
    return bool(commas) and all(_GROUPED.fullmatch(cell) for cell in commas)
