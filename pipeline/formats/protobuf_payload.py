"""Protobuf payloads, with a ``FileDescriptorSet`` as their schema."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from types import MappingProxyType
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import DecodeError

from pipeline.formats.base import Field
from pipeline.formats.payload import (
    MAX_FIELDS,
    MAX_LISTED,
    STAMPS,
    Bytes,
    Extractor,
    Path,
    PayloadError,
    Row,
    join_path,
    nanoseconds,
    parse_path,
    within,
)

_NUMERIC = MappingProxyType(
    {
        FieldDescriptor.TYPE_DOUBLE: "double",
        FieldDescriptor.TYPE_FLOAT: "float",
        FieldDescriptor.TYPE_INT32: "int32",
        FieldDescriptor.TYPE_INT64: "int64",
        FieldDescriptor.TYPE_UINT32: "uint32",
        FieldDescriptor.TYPE_UINT64: "uint64",
        FieldDescriptor.TYPE_SINT32: "sint32",
        FieldDescriptor.TYPE_SINT64: "sint64",
        FieldDescriptor.TYPE_FIXED32: "fixed32",
        FieldDescriptor.TYPE_FIXED64: "fixed64",
        FieldDescriptor.TYPE_SFIXED32: "sfixed32",
        FieldDescriptor.TYPE_SFIXED64: "sfixed64",
        FieldDescriptor.TYPE_BOOL: "bool",
        FieldDescriptor.TYPE_ENUM: "enum",
    }
)
_STAMP_NAMES = (("seconds", "nanos"), ("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))
_MAX_VISITS = 10**5
"""Fields looked at for a list of them; descriptors of a few lines can double it with each line."""


class ProtobufPayload:
    """Messages of one protobuf type.

    Parameters
    ----------
    name : str
        The full name of the type.
    schema : bytes
        A serialised ``FileDescriptorSet`` that holds it.
    """

    def __init__(self, name: str, schema: bytes) -> None:
        try:
            files = descriptor_pb2.FileDescriptorSet.FromString(schema)
            pool = descriptor_pool.DescriptorPool()
            for file in _in_order(files):
                pool.Add(file)
            self._type: Descriptor = pool.FindMessageTypeByName(name)
            self._message = message_factory.GetMessageClass(self._type)
        except (DecodeError, TypeError, KeyError, ValueError) as error:
            raise PayloadError(f"its descriptors do not hold together ({str(error)[:80]})") from error

    def fields(self, sample: Bytes | None) -> tuple[Field, ...]:
        """Numeric leaves; a repeated field has the sample's elements, none without a sample."""
        message = None if sample is None else self._decode(sample)
        return tuple(islice(_leaves(self._type, message, "", iter(range(_MAX_VISITS))), MAX_FIELDS))

    def has(self, path: str) -> bool:
        """Whether the path leads to a number (or a repeated field's element)."""
        field = self._resolve(path)
        return field is not None and field.type in _NUMERIC

    def has_time(self, path: str) -> bool:
        """Whether the path leads to a number or to a stamp."""
        field = self._resolve(path)
        return field is not None and (field.type in _NUMERIC or _stamp_names(field) is not None)

    def header_stamp(self, sample: Bytes | None) -> str | None:  # noqa: ARG002 - the type says it all
        """The sender's stamp, where the type has one."""
        for path in STAMPS:
            field = self._resolve(path)
            if field is not None and _stamp_names(field):
                return path
        return None

    def extractor(self, fields: Sequence[str], times: Sequence[tuple[str, int]]) -> Extractor:
        """Compile a request."""
        numbers = [_split(path) for path in fields]
        stamps = [(_split(path), scale) for path, scale in times]

        def extract(payload: Bytes) -> Row:
            message = self._decode(payload)
            return [_find(message, path) for path in numbers] + [
                _time(_find(message, path), scale) for path, scale in stamps
            ]

        return extract

    def _decode(self, payload: Bytes) -> Any:
        try:
            return self._message.FromString(bytes(payload))
        except DecodeError as error:
            raise PayloadError(f"it is no {self._type.full_name} ({str(error)[:80]})") from error

    def _resolve(self, path: str) -> FieldDescriptor | None:
        """The field that a path leads to; repeated fields need an index, others take none."""
        type_: Descriptor | None = self._type
        field: FieldDescriptor | None = None
        indexed = True
        for token in _split(path):
            if isinstance(token, int):
                if field is None or indexed:
                    return None
                indexed = True
                continue
            if type_ is None or not indexed:
                return None
            field = type_.fields_by_name.get(token)
            if field is None or _is_map(field):
                return None
            indexed = not field.is_repeated
            type_ = field.message_type
        return field if indexed else None


def _split(path: str) -> Path:
    return parse_path(path) or ("",)


def _in_order(files: Any) -> Iterator[Any]:
    """The files of a set, each behind those that it imports."""
    by_name = {file.name: file for file in files.file}
    done: set[str] = set()
    for first in by_name:
        stack = [first]
        while stack:
            name = stack[-1]
            missing = [n for n in by_name[name].dependency if n in by_name and n not in done]
            if missing and not set(missing) <= set(stack):
                stack += [n for n in missing if n not in stack]
                continue
            stack.pop()
            if name not in done:
                done.add(name)
                yield by_name[name]


def _is_map(field: FieldDescriptor) -> bool:
    return field.message_type is not None and field.message_type.GetOptions().map_entry


def _stamp_names(field: FieldDescriptor) -> tuple[str, str] | None:
    """The names of a stamp's seconds and nanoseconds, if that is what the field is."""
    if field.message_type is None or field.is_repeated:
        return None
    members = field.message_type.fields_by_name
    return next((pair for pair in _STAMP_NAMES if all(_is_integer(members.get(n)) for n in pair)), None)


def _is_integer(field: FieldDescriptor | None) -> bool:
    return (
        field is not None
        and not field.is_repeated
        and _NUMERIC.get(field.type, "").lstrip("su").startswith(("int", "fixed"))
    )


def _find(message: Any, path: Path) -> Any:
    """What the path leads to, None where the message does not hold it."""
    value = message
    for token in path:
        if isinstance(token, int):
            if token >= len(value):
                return None
            value = value[token]
        else:
            field = value.DESCRIPTOR.fields_by_name[token]
            if field.has_presence and not value.HasField(token):
                return None
            value = getattr(value, token)
    return value


def _time(value: Any, scale: int) -> int | None:
    if value is None or isinstance(value, int | float):
        return None if value is None else nanoseconds(value, scale)
    members = value.DESCRIPTOR.fields_by_name
    for seconds, fraction in _STAMP_NAMES:
        if seconds in members and fraction in members:
            return within(getattr(value, seconds) * 10**9 + getattr(value, fraction))
    return None


def _leaves(
    type_: Descriptor, message: Any, path: str, visits: Iterator[int], inside: tuple[str, ...] = ()
) -> Iterator[Field]:
    """Numeric leaves of a type; the message, where there is one, shows how long repeated fields are.

    A type that holds itself is followed as far as the message goes, and once without one.
    """
    inside = (*inside, type_.full_name)
    for field, _ in zip(type_.fields, visits, strict=False):
        here = join_path(path, field.name)
        inner = field.message_type
        if _is_map(field):
            continue
        if field.is_repeated:
            values = list(getattr(message, field.name)[:MAX_LISTED]) if message is not None else []
            paths = [f"{here}[{index}]" for index in range(len(values))]
        else:
            held = inner is not None and message is not None and message.HasField(field.name)
            values, paths = [getattr(message, field.name) if held else None], [here]
        for value, leaf in zip(values, paths, strict=True):
            if inner is None and field.type in _NUMERIC:
                yield Field(leaf, _NUMERIC[field.type])
            elif inner is not None and (value is not None or inner.full_name not in inside):
                yield from _leaves(inner, value, leaf, visits, inside)
