"""The line of every key, against plans written by a writer that knows where it puts them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.testplan.locate import Key, key_lines, line_of

EVERY_FORM = '''\
procedure = "coning"   # [not.a.table]
text = """
[not.a.table]
x = 1\\"""  ""\
"""
literal = \'\'\'
# y = 2
\'\'\'\'
[a . "b.c"]            # two names
'q' = { r = [1,
    [2, # three
     3]], s.t = 1979-05-27 07:32:00 }
u.v.w = 1e-3
u.v."x\\u0041" = inf
[[limits]]
metric = 'a # b'
[limits.sub]
k = true
[[limits]]
upper=1
[a]
late = [{ x = 1 }, { x = 2 }]
'''


@pytest.mark.parametrize(
    ("key", "line"),
    [
        (("procedure",), 1),
        (("text",), 2),
        (("literal",), 5),
        (("a",), 20),
        (("a", "b.c"), 8),
        (("a", "b.c", "q", "r", 1, 0), 10),
        (("a", "b.c", "q", "r", 1, 1), 11),
        (("a", "b.c", "q", "s", "t"), 11),
        (("a", "b.c", "u", "v", "w"), 12),
        (("a", "b.c", "u", "v", "xA"), 13),
        (("limits",), 14),
        (("limits", 0), 14),
        (("limits", 0, "metric"), 15),
        (("limits", 0, "sub", "k"), 17),
        (("limits", 1), 18),
        (("limits", 1, "upper"), 19),
        (("a", "late", 1, "x"), 21),
    ],
)
def test_every_form_of_toml(key: Key, line: int) -> None:
    tomllib.loads(EVERY_FORM)
    assert key_lines(EVERY_FORM)[key] == line


def test_a_key_that_is_not_there_has_the_line_of_its_table() -> None:
    lines = key_lines(EVERY_FORM)
    assert line_of(lines, ("limits", 1, "channel")) == 18
    assert line_of(lines, ("nothing", "at", "all")) == 1
    assert line_of(lines, ()) == 1


NAMES = st.text("abzAZ09_-", min_size=1, max_size=4) | st.text(
    st.characters(exclude_categories=["Cs"]), max_size=6
)
SCALARS = (
    st.integers(-(2**40), 2**40)
    | st.booleans()
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
)
TABLES = st.recursive(
    st.dictionaries(NAMES, SCALARS, max_size=4),
    lambda inner: st.dictionaries(
        NAMES, SCALARS | inner | st.lists(SCALARS | inner, max_size=3), min_size=1, max_size=4
    ),
    max_leaves=25,
)


class Writer:
    """Writes a plan in forms drawn at random, and notes on which line it puts each key."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw
        self.text = ""
        self.lines: dict[Key, int] = {}

    def one_of(self, *forms: str) -> str:
        return self.draw(st.sampled_from(forms))

    def note(self, key: Key) -> None:
        self.lines[key] = self.text.count("\n") + 1

    def name(self, name: str) -> str:
        bare = name and all(c.isascii() and (c.isalnum() or c in "_-") for c in name)
        literal = all(c.isprintable() and c != "'" for c in name)
        forms = [basic(name)] + [f"'{name}'"] * literal + [name] * bool(bare)
        return self.one_of(*forms)

    def value(self, key: Key, value: Any) -> None:
        if isinstance(value, Mapping):
            self.text += "{ "
            for place, (name, item) in enumerate(value.items()):
                self.text += ", " if place else ""
                self.note((*key, name))
                self.text += f"{self.name(name)} = "
                self.value((*key, name), item)
            self.text += " }"
        elif isinstance(value, list):
            self.text += "["
            for index, item in enumerate(value):
                self.text += self.one_of("", "\n  ", " # ] a comment [\n\t")
                self.note((*key, index))
                self.value((*key, index), item)
                self.text += self.one_of(", ", ",\n", " # }\n,")
            self.text += "]"
        elif isinstance(value, str):
            self.text += self.string(value)
        else:
            self.text += json.dumps(value).replace("Infinity", "inf")

    def string(self, value: str) -> str:
        multi_line = f'"""\n{basic(value)[1:-1]}"""'
        forms = [basic(value), multi_line]
        if all(c.isprintable() and c != "'" for c in value):
            forms += [f"'{value}'", f"'''\n{value}'''"]
        return self.one_of(*forms)

    def pair(self, key: Key, value: Any) -> None:
        """A pair of the table ``key[:-1]``, a table as dotted keys or inline."""
        if isinstance(value, Mapping) and value and self.one_of("dotted", "inline") == "dotted":
            self.note(key)
            for name, item in value.items():
                self.note((*key, name))
                self.text += f"{self.name(str(key[-1]))} . {self.name(name)} = "
                self.value((*key, name), item)
                self.text += "\n"
            return
        self.note(key)
        self.text += f"{self.name(str(key[-1]))}={self.one_of('', ' ')}"
        self.value(key, value)
        self.text += self.one_of("\n", "   # [x]\n", "\n\n")

    def table(self, key: Key, header: str, table: Mapping[str, Any]) -> None:
        """A table: its pairs first, then those of its tables that get a header of their own."""
        under_headers = []
        for name, item in table.items():
            tables = isinstance(item, Mapping) or (
                isinstance(item, list) and bool(item) and all(isinstance(i, Mapping) for i in item)
            )
            if tables and self.one_of("header", "pair") == "header":
                under_headers.append(name)
            else:
                self.pair((*key, name), item)
        for name in under_headers:
            item, path = table[name], f"{header}.{self.name(name)}" if header else self.name(name)
            if isinstance(item, Mapping):
                self.note((*key, name))
                self.text += f"[{path}]\n"
                self.table((*key, name), path, item)
            else:
                self.note((*key, name))
                for index, element in enumerate(item):
                    self.note((*key, name, index))
                    self.text += f"[[ {path} ]]\n"
                    self.table((*key, name, index), path, element)


def basic(text: str) -> str:
    """A basic string of TOML."""
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08X}" for c in text) + '"'


@st.composite
def plans(draw: st.DrawFn) -> tuple[str, dict[str, Any], dict[Key, int]]:
    table = draw(TABLES)
    writer = Writer(draw)
    writer.table((), "", table)
    return writer.text, table, writer.lines


@given(plans())
def test_lines_of_random_plans(plan: tuple[str, dict[str, Any], dict[Key, int]]) -> None:
    text, table, lines = plan
    assert tomllib.loads(text) == table  # the writer writes what it should
    assert dict(key_lines(text)) == lines


TOML_LIKE = st.text("[]{}=.,\"'#\\ \n\tab1", max_size=80)


@given(st.text() | TOML_LIKE)
def test_any_text_ends(text: str) -> None:
    lines = key_lines(text)
    assert all(1 <= line <= text.count("\n") + 1 for line in lines.values())


@pytest.mark.parametrize("opening", ["[", "{a=", "a.", '"""', "'", "[[", "#"])
def test_hostile_depth_and_length_end(opening: str) -> None:
    assert len(key_lines("a = " + opening * 50_000)) <= 100
