"""ROS message definitions as a graph of types, without running any code that they generate.

`rosbags` parses the definitions (``ros1msg``, ``ros2msg``, ``ros2idl``); its own decoders, which are
generated Python, are not used: a definition from a recording is hostile.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from pipeline.formats.payload import MAX_LISTED, PayloadError, Schema

if TYPE_CHECKING:
    from rosbags.interfaces.typing import BaseDesc, FieldDesc, Typesdict

_NUMERIC = MappingProxyType(
    {
        "bool": ("?", 1), "byte": ("B", 1), "char": ("B", 1),
        "int8": ("b", 1), "uint8": ("B", 1), "int16": ("h", 2), "uint16": ("H", 2),
        "int32": ("i", 4), "uint32": ("I", 4), "int64": ("q", 8), "uint64": ("Q", 8),
        "float32": ("f", 4), "float64": ("d", 8),
    }
)  # fmt: skip
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/\w+){1,3}", re.ASCII)
_FILLER = "structure_needs_at_least_one_member"
_INCLUDE = re.compile(r"^[ \t]*#[^\n]*$", re.MULTILINE)
"""What generated IDL includes stands below, and the parser knows no preprocessor."""
_IDL_RULE = "=" * 80 + "\n"
_MAX_DEFINITION = 2**18
_MAX_DEPTH = 64
_MAX_WEIGHT = 10**6
"""Members of a message, written out; definitions of a few lines can double it with each line."""
_PARSING = (TypesysError, ValueError, KeyError, IndexError, AssertionError, RecursionError, OverflowError)
"""What rosbags' parsers raise for definitions that are not well formed."""

HUMBLE = "ROS 2 Humble"
"""The last distribution whose recorder left the definitions out, so the one whose types stand in."""


@dataclass(frozen=True, slots=True)
class Primitive:
    """A number; ``code`` as in `struct`."""

    name: str
    code: str
    size: int


@dataclass(frozen=True, slots=True)
class Text:
    """A string: its length, then its bytes."""


@dataclass(frozen=True, slots=True)
class Array:
    """Elements of one type: ``length`` of them, or as many as the message says (None)."""

    element: Node
    length: int | None


@dataclass(frozen=True, slots=True, eq=False)
class Struct:
    """A message type; compared by identity, since one type stands in many places."""

    name: str
    members: tuple[tuple[str, Node], ...]

    def member(self, name: str) -> Node | None:
        """The type of a member."""
        return next((node for member, node in self.members if member == name), None)


Node = Primitive | Text | Array | Struct


def message_type(schema: Schema) -> Struct:
    """Parse a definition.

    Raises
    ------
    PayloadError
        If it is not well formed, or holds what has no decoder here (``wstring``, ``long double``).
    """
    if not _TYPE_NAME.fullmatch(schema.name):
        raise PayloadError(f"{schema.name!r} is no name of a message type")
    root = _normal(schema.name)
    return _Builder(_definitions(schema, root), ros1=schema.encoding == "ros1msg").struct(root)


def standard_type(name: str) -> Struct:
    """A type of the ROS 2 Humble distribution, for a recording without definitions."""
    root = _normal(name) if _TYPE_NAME.fullmatch(name) else name
    if root not in get_typestore(Stores.ROS2_HUMBLE).fielddefs:
        raise PayloadError(f"the recording does not define {name!r}, and it is no type of {HUMBLE}")
    return distribution_type(root, ros1=False)


def distribution_type(name: str, *, ros1: bool) -> Struct:
    """A type of ROS 2 Humble or of ROS 1 Noetic, which must have it."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    return _Builder(store.fielddefs, ros1=ros1).struct(name)


def _normal(name: str) -> str:
    """``sensor_msgs/Imu`` as ``sensor_msgs/msg/Imu``."""
    package, *folder, last = name.split("/")
    return "/".join((package, *(folder or ("msg",)), last))


def _definitions(schema: Schema, root: str) -> Typesdict:
    if len(schema.data) > _MAX_DEFINITION:
        raise PayloadError(f"its definition of {len(schema.data)} bytes is too long")
    try:
        text = schema.data.decode().replace("\r\n", "\n")
        if schema.encoding == "ros2idl":
            return _idl(_INCLUDE.sub("", text))
        if re.search(r"^---\s*$", text, re.MULTILINE):
            raise PayloadError("its definition is that of a service, not of a message")
        return get_types_from_msg(text, root)
    except _PARSING as error:
        raise PayloadError(f"its definition cannot be parsed ({_first_line(error)})") from error


def _idl(text: str) -> Typesdict:
    """The types of concatenated IDL files, each headed ``IDL: package/msg/Name`` between rules."""
    if not text.startswith(_IDL_RULE):
        return get_types_from_idl(text)
    types: Typesdict = {}
    for part in text.split(_IDL_RULE)[1:]:
        types |= get_types_from_idl(part.partition("\n")[2])
    return types


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:80]


class _Builder:
    """Follows the names of a set of definitions; a type that holds itself is refused."""

    def __init__(self, types: Typesdict, *, ros1: bool) -> None:
        self._types = types
        self._ros1 = ros1
        self._done: dict[str, Struct] = {}
        self._open: list[str] = []
        self._weights: dict[str, int] = {}

    def struct(self, name: str) -> Struct:
        if name in self._done:
            return self._done[name]
        if name in self._open or len(self._open) > _MAX_DEPTH:
            raise PayloadError(f"its type {name!r} holds itself or lies too deep")
        self._open.append(name)
        members = tuple((field, self._node(desc)) for field, desc in self._members(name))
        self._open.pop()
        if len({field for field, _ in members}) < len(members):
            raise PayloadError(f"its type {name!r} has two members of one name")
        # ROS 2 gives a type without members one byte; ROS 1 gives it none.
        if not members and not self._ros1:
            members = ((_FILLER, Primitive("uint8", "B", 1)),)
        self._weights[name] = 1 + sum(self._weight(node) for _, node in members)
        if self._weights[name] > _MAX_WEIGHT:
            raise PayloadError(f"its type {name!r} has too many members")
        self._done[name] = Struct(name, members)
        return self._done[name]

    def _weight(self, node: Node) -> int:
        if isinstance(node, Struct):
            return self._weights[node.name]
        if isinstance(node, Array) and not isinstance(node.element, Primitive):
            return min(node.length or 1, MAX_LISTED) * self._weight(node.element)
        return 1

    def _members(self, name: str) -> list[tuple[str, FieldDesc]]:
        if name in self._types:
            return self._types[name][1]
        if name in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
            # Built into ROS 1, where the seconds of a time are unsigned and a duration is signed throughout.
            duration = name.endswith("Duration")
            seconds: BaseDesc = (Nodetype.BASE, ("int32" if duration or not self._ros1 else "uint32", 0))
            fraction: BaseDesc = (Nodetype.BASE, ("int32" if duration and self._ros1 else "uint32", 0))
            return [("sec", seconds), ("nanosec", fraction)]
        raise PayloadError(f"its definition lacks the type {name!r}")

    def _node(self, desc: FieldDesc) -> Node:
        if desc[0] == Nodetype.BASE:
            name = desc[1][0]
            if name == "string":
                return Text()
            if name not in _NUMERIC:
                raise PayloadError(f"its definition holds {name!r}, which has no decoder here")
            # ROS 1 says byte for a signed number, ROS 2 for an octet.
            return Primitive(name, *_NUMERIC["int8" if name == "byte" and self._ros1 else name])
        if desc[0] == Nodetype.NAME:
            return self.struct(desc[1])
        element, length = desc[1]
        if desc[0] == Nodetype.ARRAY:
            if length < 0:
                raise PayloadError(f"its definition holds an array of {length} elements")
            return Array(self._node(element), length)
        return Array(self._node(element), None)


def is_filler(name: str) -> bool:
    """Whether a member is only there because ROS 2 allows no empty type."""
    return name == _FILLER


def is_stamp(node: Node | None) -> bool:
    """Whether a type is a time of seconds and nanoseconds."""
    return (
        isinstance(node, Struct)
        and [name for name, _ in node.members] == ["sec", "nanosec"]
        and all(isinstance(member, Primitive) for _, member in node.members)
    )


def is_empty(node: Node) -> bool:
    """Whether a value takes no bytes, as a ROS 1 type without members does."""
    if isinstance(node, Struct):
        return all(is_empty(member) for _, member in node.members)
    return isinstance(node, Array) and (
        node.length == 0 or (node.length is not None and is_empty(node.element))
    )
