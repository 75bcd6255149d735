"""JSON payloads, with a JSON Schema or without one.

A message may hold what the schema does not name and lack what it does, so that only the messages can tell
which fields there are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from decimal import Decimal
from itertools import islice
from typing import Any

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

_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")
_MAX_DEPTH = 32
_NUMERIC = {"number", "integer", "boolean"}


class JsonPayload:
    """JSON messages.

    Parameters
    ----------
    schema : bytes
        A JSON Schema, or nothing.
    """

    def __init__(self, schema: bytes) -> None:
        self._schema = _load(schema) if schema.strip() else {}

    def fields(self, sample: Bytes | None) -> tuple[Field, ...]:
        """The numbers that the schema names, then those that only the sample holds."""
        found = {field.path: field for field in islice(_promised(self._schema, "", 0), MAX_FIELDS)}
        if sample is not None:
            for field in islice(_held(_load(sample), "", 0), MAX_FIELDS):
                found.setdefault(field.path, field)
        return tuple(found.values())[:MAX_FIELDS]

    def has(self, path: str) -> bool | None:  # noqa: ARG002 - only the messages can tell
        """Unknown."""
        return None

    def has_time(self, path: str) -> bool | None:  # noqa: ARG002 - only the messages can tell
        """Unknown."""
        return None

    def header_stamp(self, sample: Bytes | None) -> str | None:
        """The stamp that the sample carries."""
        if sample is None:
            return None
        message = _load(sample)
        return next((path for path in STAMPS if _stamp(_find(message, path, _split(path))) is not None), None)

    def extractor(self, fields: Sequence[str], times: Sequence[tuple[str, int]]) -> Extractor:
        """Compile a request; decimal numbers are kept exact where a time is asked for."""
        numbers = [(path, _split(path)) for path in fields]
        stamps = [(path, _split(path), scale) for path, scale in times]

        def extract(payload: Bytes) -> Row:
            message = _load(payload, exact=bool(stamps))
            return [_number(_find(message, path, tokens)) for path, tokens in numbers] + [
                _time(_find(message, path, tokens), scale) for path, tokens, scale in stamps
            ]

        return extract


def _load(payload: Bytes, *, exact: bool = False) -> Any:
    try:
        return json.loads(bytes(payload), parse_float=Decimal if exact else None)
    except (ValueError, RecursionError) as error:  # JSONDecodeError and UnicodeDecodeError are ValueErrors
        raise PayloadError(f"it is no JSON ({str(error)[:80]})") from error


def _split(path: str) -> Path:
    return parse_path(path) or (path,)


def _find(message: Any, path: str, tokens: Path) -> Any:
    """What the path leads to, None where it leads nowhere; a key may itself hold dots."""
    if isinstance(message, dict) and path in message:
        return message[path]
    value = message
    for token in tokens:
        if isinstance(token, str):
            if not (isinstance(value, dict) and token in value):
                return None
        elif not (isinstance(value, list) and token < len(value)):
            return None
        value = value[token]
    return value


def _number(value: Any) -> float | None:
    if not isinstance(value, int | float | Decimal):
        return None
    try:
        return float(value)
    except OverflowError as error:
        raise PayloadError("a number beyond the range of a double") from error


def _time(value: Any, scale: int) -> int | None:
    if isinstance(value, dict):
        return _stamp(value)
    return nanoseconds(value, scale) if isinstance(value, int | float | Decimal | str) else None


def _stamp(value: Any) -> int | None:
    """A stamp of whole seconds and nanoseconds."""
    if not isinstance(value, dict):
        return None
    second = next((value[name] for name in _SECONDS if name in value), None)
    fraction = next((value[name] for name in _NANOSECONDS if name in value), None)
    if not (isinstance(second, int) and isinstance(fraction, int)):
        return None
    return within(second * 10**9 + fraction)


def _held(value: Any, path: str, depth: int) -> Iterator[Field]:
    """The numbers in a message."""
    if isinstance(value, bool):
        yield Field(path, "boolean")
    elif isinstance(value, int | float):
        yield Field(path, "integer" if isinstance(value, int) else "number")
    elif isinstance(value, dict) and depth < _MAX_DEPTH:
        for key, inner in value.items():
            # A key with dots or brackets is reachable at the top only.
            if parse_path(key) == (key,) or (not path and not isinstance(inner, dict | list)):
                yield from _held(inner, join_path(path, key), depth + 1)
    elif isinstance(value, list) and path and depth < _MAX_DEPTH:
        for index, inner in enumerate(value[:MAX_LISTED]):
            yield from _held(inner, f"{path}[{index}]", depth + 1)


def _promised(schema: Any, path: str, depth: int) -> Iterator[Field]:
    """The numbers that a JSON Schema names; what it leaves open (arrays, references) the messages show."""
    if not isinstance(schema, dict) or depth > _MAX_DEPTH:
        return
    kind = schema.get("type")
    if isinstance(kind, str) and kind in _NUMERIC and path:
        yield Field(path, kind)
    properties = schema.get("properties")
    if isinstance(properties, dict):
        for name, inner in properties.items():
            if parse_path(name) == (name,):
                yield from _promised(inner, join_path(path, name), depth + 1)
