"""ROS payloads: CDR (ROS 2) and ROS 1 serialisation, which differ in alignment alone.

Both write the members of a message one after the other, a string as its length and its bytes, a sequence
as its length and its elements. CDR (OMG CORBA 3.3, 15.3; encapsulations 0 and 1 of DDS-RTPS 10.2) puts every
number at a multiple of its own size, counted from the end of the four-byte encapsulation header.

A type is compiled into steps. A run of members of fixed size is one `struct` format for each position modulo
8 at which it may begin, with pad bytes for what nobody asked for; only strings and sequences end a run.
Every message is walked to its end, so that a definition that does not fit the message is found out.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

from pipeline.formats.base import Field
from pipeline.formats.payload import (
    MAX_FIELDS,
    MAX_LISTED,
    Bytes,
    Extractor,
    PayloadError,
    Row,
    join_path,
    nanoseconds,
    parse_path,
    within,
)
from pipeline.formats.ros_types import Array, Node, Primitive, Struct, Text, is_empty, is_filler, is_stamp

_Step = Callable[[memoryview, int, list[Any]], int]
"""Reads at a position, fills slots of the row, returns the position behind what it read."""
_Wanted = dict[str | int, Any]
"""Which members or elements go into which slot of the row: names and indexes to slots, nested."""

_INLINE = 256
"""Leaves up to which a type is written out in its run; larger ones are walked in a loop."""
_ENCAPSULATION = 4
_ALIGNMENT = 8
_CDR_PADDING = 3


class RosPayload:
    """Messages of one ROS type.

    Parameters
    ----------
    message : Struct
        The message type.
    cdr : bool
        Whether the messages are CDR (ROS 2), else they are ROS 1 serialisation.
    """

    def __init__(self, message: Struct, *, cdr: bool) -> None:
        self._type = message
        self._cdr = cdr

    def fields(self, sample: Bytes | None) -> tuple[Field, ...]:
        """Numeric leaves; a sequence has the sample's elements, none without a sample."""
        cursor = None
        if sample is not None:
            body, order = self._open(sample)
            cursor = _Cursor(body, order, aligned=self._cdr)
        try:
            return tuple(islice(_leaves(self._type, "", cursor), MAX_FIELDS))
        except struct.error as error:
            raise PayloadError("it is shorter than its definition says") from error

    def has(self, path: str) -> bool:
        """Whether the path leads to a number (or a sequence's element, which may lack in a message)."""
        return isinstance(self._resolve(path), Primitive)

    def has_time(self, path: str) -> bool:
        """Whether the path leads to a number or to a stamp."""
        node = self._resolve(path)
        return isinstance(node, Primitive) or is_stamp(node)

    def header_stamp(self, sample: Bytes | None) -> str | None:  # noqa: ARG002 - the type says it all
        """The stamp of the standard header, where the type has one."""
        return "header.stamp" if is_stamp(self._resolve("header.stamp")) else None

    def extractor(self, fields: Sequence[str], times: Sequence[tuple[str, int]]) -> Extractor:
        """Compile a request into one walk over the message."""
        slots: dict[str, int] = {}
        numbers = [slots.setdefault(path, len(slots)) for path in fields]
        stamps: list[tuple[int, int | None, int]] = []
        for path, scale in times:
            if is_stamp(self._resolve(path)):
                second = slots.setdefault(f"{path}.sec", len(slots))
                stamps.append((second, slots.setdefault(f"{path}.nanosec", len(slots)), 10**9))
            else:
                stamps.append((slots.setdefault(path, len(slots)), None, scale))
        wanted = _trie(slots)
        programs = {order: _Compiler(order, aligned=self._cdr).program(self._type, wanted) for order in "<>"}
        slack = _CDR_PADDING if self._cdr else 0

        def extract(payload: Bytes) -> Row:
            body, order = self._open(payload)
            row: list[Any] = [None] * len(slots)
            position = 0
            try:
                for step in programs[order]:
                    position = step(body, position, row)
            except struct.error as error:
                raise PayloadError("it is shorter than its definition says") from error
            if not position <= len(body) <= position + slack:
                raise PayloadError(f"it has {len(body)} bytes where its definition asks for {position}")
            return [row[slot] for slot in numbers] + [_time(row, *stamp) for stamp in stamps]

        return extract

    def _open(self, payload: Bytes) -> tuple[memoryview, str]:
        """The body behind the encapsulation header, and its byte order as in `struct`."""
        if not self._cdr:
            return memoryview(payload), "<"
        header = bytes(payload[:2])
        if len(payload) < _ENCAPSULATION or header not in (b"\0\0", b"\0\1"):
            raise PayloadError(f"it is no plain CDR: it begins with {header.hex(' ') or 'nothing'}")
        return memoryview(payload)[_ENCAPSULATION:], "<" if header[1] else ">"

    def _resolve(self, path: str) -> Node | None:
        node: Node | None = self._type
        for token in parse_path(path) or ("",):
            if isinstance(token, str):
                node = node.member(token) if isinstance(node, Struct) and not is_filler(token) else None
            elif isinstance(node, Array) and (node.length is None or token < node.length):
                node = node.element
            else:
                node = None
        return node


def _time(row: list[Any], first: int, fraction: int | None, scale: int) -> int | None:
    value = row[first]
    if value is None:
        return None
    if fraction is None:
        return nanoseconds(value, scale)
    return within(value * scale + row[fraction])


def _trie(slots: Mapping[str, int]) -> _Wanted:
    root: _Wanted = {}
    for path, slot in slots.items():
        *parents, leaf = parse_path(path) or ()
        wanted = root
        for token in parents:
            wanted = wanted.setdefault(token, {})
        wanted[leaf] = slot
    return root


class _Compiler:
    """Compiles a type and what is wanted of it into steps, for one byte order."""

    def __init__(self, order: str, *, aligned: bool) -> None:
        self._order = order
        self._aligned = aligned
        self._skips: dict[Node, list[_Step]] = {}
        self._sizes: dict[Node, int] = {}

    def program(self, node: Node, wanted: _Wanted | int | None) -> list[_Step]:
        """The steps that read a value from where it begins to where it ends."""
        steps: list[_Step] = []
        self._emit(node, wanted, steps)
        return steps

    def _emit(self, node: Node, wanted: Any, steps: list[_Step]) -> None:
        if isinstance(node, Primitive):
            self._run(steps).add(node, 1, {} if wanted is None else {0: wanted})
        elif isinstance(node, Text):
            steps.append(self._text())
        elif isinstance(node, Array):
            self._emit_array(node, wanted or {}, steps)
        elif wanted is None and steps and self._leaves(node) > _INLINE:
            steps.append(_loop(1, self._skip(node), {}))
        else:
            for name, member in node.members:
                self._emit(member, (wanted or {}).get(name), steps)

    def _emit_array(self, node: Array, wanted: _Wanted, steps: list[_Step]) -> None:
        element, length = node.element, node.length
        if isinstance(element, Primitive):
            if length is None:
                steps.append(self._numbers(element, wanted))
            else:
                self._run(steps).add(element, length, wanted)
        elif length is not None and self._leaves(node) <= _INLINE:
            for index in range(length):
                self._emit(element, wanted.get(index), steps)
        else:
            special = {int(index): self.program(element, inner) for index, inner in wanted.items()}
            count = length if length is not None else self._count()
            steps.append(_loop(count, [] if is_empty(element) else self._skip(element), special))

    def _run(self, steps: list[_Step]) -> _Run:
        """The run at the end of the steps, begun if there is none."""
        if not (steps and isinstance(steps[-1], _Run)):
            steps.append(_Run(self._order, aligned=self._aligned))
        run = steps[-1]
        assert isinstance(run, _Run)
        return run

    def _skip(self, node: Node) -> list[_Step]:
        """The steps that pass over a value; compiled once for a type, however often it occurs."""
        if node not in self._skips:
            self._skips[node] = self.program(node, None)
        return self._skips[node]

    def _leaves(self, node: Node) -> int:
        if isinstance(node, Primitive | Text):
            return 1
        if node not in self._sizes:
            if isinstance(node, Array):
                self._sizes[node] = self._leaves(node.element) * (
                    node.length if node.length is not None else 1
                )
            else:
                self._sizes[node] = sum(self._leaves(member) for _, member in node.members)
        return self._sizes[node]

    def _count(self) -> Callable[[memoryview, int], tuple[int, int]]:
        """Reads a length; returns it and the position behind it."""
        unpack = struct.Struct(self._order + "I").unpack_from
        mask = 3 if self._aligned else 0

        def count(body: memoryview, position: int) -> tuple[int, int]:
            position = (position + mask) & ~mask
            return unpack(body, position)[0], position + 4

        return count

    def _text(self) -> _Step:
        count = self._count()

        def text(body: memoryview, position: int, row: list[Any]) -> int:  # noqa: ARG001 - shape of a step
            length, position = count(body, position)
            return position + length

        return text

    def _numbers(self, element: Primitive, wanted: _Wanted) -> _Step:
        """A sequence of numbers, of which some elements may be wanted."""
        count = self._count()
        unpack = struct.Struct(self._order + element.code).unpack_from
        size = element.size
        mask = size - 1 if self._aligned else 0
        elements = [(int(index), slot) for index, slot in wanted.items()]

        def numbers(body: memoryview, position: int, row: list[Any]) -> int:
            length, position = count(body, position)
            if length:  # an empty sequence is not padded
                position = (position + mask) & ~mask
            for index, slot in elements:
                if index < length:
                    row[slot] = unpack(body, position + index * size)[0]
            return position + length * size

        return numbers


def _loop(
    count: int | Callable[[memoryview, int], tuple[int, int]],
    skip: list[_Step],
    special: Mapping[int, list[_Step]],
) -> _Step:
    """The step over elements that are walked one by one."""

    def loop(body: memoryview, position: int, row: list[Any]) -> int:
        length, position = (count, position) if isinstance(count, int) else count(body, position)
        if not skip:  # elements without members take no bytes, however many are declared
            return position
        for index in range(length):
            for step in special.get(index, skip):
                position = step(body, position, row)
            if position > len(body):
                raise PayloadError("it is shorter than its definition says")
        return position

    return loop


class _Run:
    """A step over members of fixed size, as one `struct` format for each position modulo 8."""

    def __init__(self, order: str, *, aligned: bool) -> None:
        self._order = order
        self._mask = _ALIGNMENT - 1 if aligned else 0
        self._parts: list[tuple[Primitive, int, Mapping[Any, int]]] = []
        self._slots: list[int] = []
        self._formats: dict[int, struct.Struct] = {}

    def add(self, element: Primitive, count: int, wanted: Mapping[Any, int]) -> None:
        """Append ``count`` numbers, of which the wanted indexes go into slots."""
        if count:
            self._parts.append((element, count, wanted))
            self._slots += [wanted[index] for index in sorted(wanted)]

    def __call__(self, body: memoryview, position: int, row: list[Any]) -> int:
        """Read the run; a run in which nothing is wanted is passed over."""
        phase = position & self._mask
        compiled = self._formats.get(phase)
        if compiled is None:
            compiled = self._formats[phase] = struct.Struct(self._format(phase))
        if self._slots:
            for slot, value in zip(self._slots, compiled.unpack_from(body, position), strict=True):
                row[slot] = value
        return position + compiled.size

    def _format(self, phase: int) -> str:
        codes = [self._order]
        position = phase
        for element, count, wanted in self._parts:
            if self._mask:
                gap = -position % element.size
                codes.append(f"{gap}x" if gap else "")
                position += gap
            done = 0
            for index in sorted(wanted):
                codes.append(f"{(index - done) * element.size}x{element.code}")
                done = index + 1
            codes.append(f"{(count - done) * element.size}x")
            position += count * element.size
        return "".join(codes)


class _Cursor:
    """A position in a message, for the one look that `RosPayload.fields` takes."""

    def __init__(self, body: memoryview, order: str, *, aligned: bool) -> None:
        self._body = body
        self._order = order
        self._aligned = aligned
        self._position = 0

    def numbers(self, element: Primitive, count: int) -> None:
        """Pass over numbers."""
        if self._aligned and count:
            self._position += -self._position % element.size
        self._position += count * element.size
        if self._position > len(self._body):
            raise PayloadError("it is shorter than its definition says")

    def count(self) -> int:
        """Read a length."""
        self.numbers(Primitive("uint32", "I", 4), 1)
        (count,) = struct.unpack_from(self._order + "I", self._body, self._position - 4)
        return int(count)


def _leaves(node: Node, path: str, cursor: _Cursor | None) -> Iterator[Field]:
    """Numeric leaves in order, with the first elements of each array; moves the cursor past the node."""
    if isinstance(node, Primitive):
        if cursor:
            cursor.numbers(node, 1)
        yield Field(path, node.name)
    elif isinstance(node, Text):
        if cursor:
            cursor.numbers(Primitive("char", "B", 1), cursor.count())
    elif isinstance(node, Array):
        yield from _elements(node, path, cursor)
    else:
        for name, member in node.members:
            for leaf in _leaves(member, join_path(path, name), cursor):
                if not is_filler(name):
                    yield leaf


def _elements(node: Array, path: str, cursor: _Cursor | None) -> Iterator[Field]:
    length = node.length
    if length is None:
        length = cursor.count() if cursor else 0
    if isinstance(node.element, Primitive):
        if cursor:
            cursor.numbers(node.element, length)
        yield from (Field(f"{path}[{i}]", node.element.name) for i in range(min(length, MAX_LISTED)))
        return
    if is_empty(node.element):
        return
    for index in range(length if cursor else min(length, MAX_LISTED)):
        leaves = _leaves(node.element, f"{path}[{index}]", cursor)
        if index < MAX_LISTED:
            yield from leaves
        else:
            for _ in leaves:  # only to move the cursor
                pass
