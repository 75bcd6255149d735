"""The first lines of a text recording, read with one delimiter and one decimal mark.

`Head` says how well that reading explains the lines, and what it makes of them: how many columns there
are, which of them hold numbers, where the rows begin, and what stands above them.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from pipeline import units

MISSING = ("", "NA", "N/A", "n/a", "NULL", "null", "None")
"""Cells without a value: null, where "nan" is a NaN that was recorded."""

COMMENTS = ("#", "%", "//")
WHITESPACE = "whitespace"

SAMPLE_LINES = 100
_HEADER_ABOVE = 10  # lines above the first row among which the header is sought: damaged ones may lie between
_WORD_WITH_UNIT = re.compile(r"\S+(?:\s+(?:\([^()]*\)|\[[^\[\]]*\]))?")
_OTHER_UNITS = frozenset(
    ("-", "g", "m", "m/s", "m/s^2", "m/s2", "m/s²", "uT", "µT", "G", "gauss", "°C", "degC", "C", "V", "A",
     "Pa", "hPa", "%", "count", "counts", "LSB")
)  # fmt: skip
"""Units of columns that no procedure reads, but that a row of units may hold."""

Row = Sequence[str]


def number_pattern(decimal: str) -> str:
    """The regular expression of a finite number written with that decimal mark."""
    # "3." is a number, "3," is one followed by a delimiter
    fraction = r"(?:\d+(?:\.\d*)?|\.\d+)" if decimal == "." else r"(?:\d+(?:,\d+)?|,\d+)"
    return rf"[+-]?{fraction}(?:[eE][+-]?\d+)?"


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without quotes and outer blanks."""
    if delimiter == WHITESPACE:
        line, delimiter = " ".join(line.split()), " "
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    except csv.Error:  # no line of a table
        return [line]


@dataclass(frozen=True)
class Head:
    """The first lines, blank ones and comments left out, read with one delimiter and decimal mark."""

    delimiter: str
    decimal: str
    content: tuple[tuple[int, str], ...]

    @cached_property
    def number(self) -> re.Pattern[str]:
        """What a number looks like."""
        return re.compile(rf"(?:{number_pattern(self.decimal)}|(?i:[+-]?(?:nan|inf|infinity)))")

    @cached_property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """The cells of each line."""
        return tuple(tuple(split(line, self.delimiter)) for _, line in self.content)

    @cached_property
    def _numbers_by_width(self) -> Counter[int]:
        numbers = Counter[int]()
        for row in self.rows[-SAMPLE_LINES:]:
            numbers[len(row)] += sum(map(self.is_number, row))
        return numbers

    @cached_property
    def width(self) -> int:
        """The number of columns: that of the lines that hold most numbers."""
        return max(self._numbers_by_width, key=lambda width: self._numbers_by_width[width])

    @cached_property
    def sample(self) -> tuple[tuple[str, ...], ...]:
        """Lines of that width from the end of the head, where rows are most likely."""
        return tuple(row for row in self.rows[-SAMPLE_LINES:] if len(row) == self.width)

    @cached_property
    def score(self) -> float:
        """How well the reading explains the lines: the count of numbers times the share of fitting cells."""
        rows = [row for row in self.sample if any(map(self.is_number, row))]
        fitting = sum(self._fits(cell) for row in rows for cell in row)
        return self._numbers_by_width[self.width] * fitting / (len(rows) * self.width) if rows else 0.0

    @cached_property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers: half at least of the cells that are not missing.

        Lines with less than half of the fitting cells of the best one are no rows, and have no say.
        """
        fitting = [sum(map(self._fits, row)) for row in self.sample]
        rows = [row for row, count in zip(self.sample, fitting, strict=True) if 2 * count >= max(fitting)]
        present = [[cell for cell in column if cell not in MISSING] for column in zip(*rows, strict=True)]
        return tuple(2 * sum(map(self.is_number, cells)) >= len(cells) for cells in present)

    @cached_property
    def last_is_empty(self) -> bool:
        """Whether the rows end in a delimiter."""
        return all(row[-1] in MISSING for row in self.sample)

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number, NaN and infinity included."""
        return self.number.fullmatch(cell) is not None

    def _fits(self, cell: str) -> bool:
        """Whether a column of numbers may hold the cell."""
        return self.is_number(cell) or cell in MISSING

    def is_data(self, row: Row) -> bool:
        """Whether a line is a row: as wide, and numbers where they belong."""
        return (
            len(row) == self.width
            and any(map(self.is_number, row))
            and all(self._fits(cell) for cell, numeric in zip(row, self.numeric, strict=True) if numeric)
        )

    def as_header(self, line: str) -> tuple[str, ...] | None:
        """The cells of a line where it could be the header or a row of units, else None."""
        cells = split(line, self.delimiter)
        trials = [cells]
        if (
            self.delimiter == WHITESPACE
        ):  # names with blanks: "Gyro X (deg/s)  Gyro Y (deg/s)", "t (s) x (rad)"
            trials += [re.split(r"\s{2,}|\t", line.strip()), _WORD_WITH_UNIT.findall(line)]
        if self.last_is_empty:
            trials.append([*cells, ""])
        if not cells[-1]:
            trials.append(cells[:-1])
        for trial in trials:
            words = [cell for cell in trial if cell not in ("", "1")]  # 1 is the unit of pure numbers
            if len(trial) == self.width and words and not any(map(self.is_number, words)):
                return tuple(trial)
        return None

    def above_rows(self) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None, int]:
        """The header, the row of units, and the index of the line that the rows begin with."""
        data = [self.is_data(row) for row in self.rows]
        start = next((k for k, (row, below) in enumerate(pairwise(data)) if row and below), data.index(True))
        for k in range(start - 1, max(start - 1 - _HEADER_ABOVE, -1), -1):
            if (header := self.as_header(self.content[k][1])) is None:
                continue
            above = self.as_header(self.content[k - 1][1]) if k > 0 and _is_units(header) else None
            return above or header, header if above else None, self.content[k][0] + 1
        # Without a header, a line of numbers alone of another width is a damaged row, not preamble.
        while start > 0 and all(map(self.is_number, self.rows[start - 1])):
            start -= 1
        return None, None, self.content[start][0]

    def in_comments(
        self, lines: Sequence[str], comments: tuple[str, ...]
    ) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None]:
        """The header, and the row of units, in the comment lines right above the rows."""
        found: list[tuple[str, ...]] = []
        for line in reversed(lines[-2:]):
            bare = line.lstrip()
            cells = (
                self.as_header(bare.lstrip("".join(comments)).strip()) if bare.startswith(comments) else None
            )
            if cells is None or self.width < 2:
                break
            found.append(cells)
        if len(found) == 2 and _is_units(found[0]):
            return found[1], found[0]
        return (found[0], None) if found else (None, None)


def _is_units(cells: Row) -> bool:
    """Whether a line is a row of units: half at least of its cells are known ones, or in brackets."""
    present = [cell for cell in cells if cell]
    known = [
        units.dimension(cell.strip("()[]")) is not None or cell.strip("()[]") in _OTHER_UNITS
        for cell in present
    ]
    bracketed = [cell.startswith(("(", "[")) and cell.endswith((")", "]")) for cell in present]
    return all(bracketed) or 2 * sum(known) >= len(present)
