"""On which line of a TOML text each key stands; `tomllib` gives the values without their places.

The text is one that `tomllib` has read, so the scanner need not judge it: it only walks over keys and
values. Given any other text it still ends, with the lines that it made out before.

Source of the grammar: TOML 1.0.0, https://toml.io/en/v1.0.0.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence

Key = tuple[str | int, ...]
"""A path of keys, and of indices in arrays, from the top of the file."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BLANK_ON_LINE = re.compile(r"[ \t]*")
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}'  # basic, multi-line; it may end in two quotes of its own
    r"|'''.*?'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^\s,\]}#]+(?: \d[^\s,\]}#]*)?")  # a date and a time of day may have a blank between
_DEEPEST = 64
"""Nesting that is followed: plans have five levels, and hostile files must not end the interpreter."""


def key_lines(text: str) -> Mapping[Key, int]:
    """The line, from 1, of every key and array element of a TOML text.

    A table has the line of its header, or of the first key that implies it.
    """
    return _Scanner(text).lines


def line_of(lines: Mapping[Key, int], key: Sequence[str | int]) -> int:
    """The line of a key; of one that is not there, that of the table which would hold it."""
    path = tuple(key)
    while path and path not in lines:
        path = path[:-1]
    return lines.get(path, 1)


class _Scanner:
    """Walks over a TOML text once and notes where keys begin."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Key, int] = {}
        self._text = text
        self._at = 0
        self._counted = 0
        self._line = 1
        self._sizes: dict[Key, int] = {}
        table: Key | None = ()
        while table is not None:
            self._take(_BLANK)
            if self._at >= len(text):
                return
            if text[self._at] == "[":
                table = self._header()
            elif not self._pair(table, 0):
                return

    def _header(self) -> Key | None:
        """A line ``[a.b]`` or ``[[a.b]]``: the table that the pairs after it belong to."""
        line = self._here()
        of_array = self._text.startswith("[[", self._at)
        self._at += 2 if of_array else 1
        names = self._key()
        if not names or not self._text.startswith("]]" if of_array else "]", self._at):
            return None
        self._at += 2 if of_array else 1
        path: Key = ()
        for name in names[:-1]:
            path = (*path, name)
            self.lines.setdefault(path, line)
            if path in self._sizes:  # a header speaks of the array's last element
                path = (*path, self._sizes[path] - 1)
        path = (*path, names[-1])
        if of_array:
            self._sizes[path] = self._sizes.get(path, 0) + 1
            self.lines.setdefault(path, line)
            path = (*path, self._sizes[path] - 1)
        self.lines[path] = line
        return path

    def _pair(self, table: Key, depth: int) -> bool:
        """``a.b = value``; False where there is none."""
        line = self._here()
        names = self._key()
        if not names or not self._skip("="):
            return False
        path = table
        for name in names:
            path = (*path, name)
            self.lines.setdefault(path, line)
        return self._value(path, depth)

    def _key(self) -> list[str]:
        """Names parted by dots, bare or quoted; empty where there is no key."""
        names: list[str] = []
        while True:
            self._take(_BLANK_ON_LINE)
            name = self._take(_BARE_KEY)
            if not name:
                quoted = self._take(_STRING)
                if not quoted:
                    return []
                name = _unquoted(quoted)
            names.append(name)
            self._take(_BLANK_ON_LINE)
            if not self._skip("."):
                return names

    def _value(self, path: Key, depth: int) -> bool:
        self._take(_BLANK_ON_LINE)
        if self._text.startswith(("[", "{"), self._at):
            return depth < _DEEPEST and self._nested(path, depth + 1)
        return bool(self._take(_STRING) or self._take(_SCALAR))

    def _nested(self, path: Key, depth: int) -> bool:
        """An array or an inline table, up to behind its end."""
        of_array = self._text[self._at] == "["
        self._at += 1
        index = 0
        while True:
            self._take(_BLANK)
            if self._skip("]" if of_array else "}"):
                return True
            if of_array:
                self.lines[*path, index] = self._here()
            if not (self._value((*path, index), depth) if of_array else self._pair(path, depth)):
                return False
            self._take(_BLANK)
            self._skip(",")
            index += 1

    def _skip(self, mark: str) -> bool:
        found = self._text.startswith(mark, self._at)
        self._at += len(mark) if found else 0
        return found

    def _take(self, pattern: re.Pattern[str]) -> str:
        """Walk over what the pattern matches here."""
        match = pattern.match(self._text, self._at)
        if match is None:
            return ""
        self._at = match.end()
        return match[0]

    def _here(self) -> int:
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at
        return self._line


def _unquoted(quoted: str) -> str:
    """The name that a quoted key stands for; as it is written where it is no string of TOML."""
    try:
        return str(tomllib.loads(f"key = {quoted}")["key"])
    except tomllib.TOMLDecodeError:
        return quoted
