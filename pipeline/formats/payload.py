"""The seam between containers and serialisations: what a payload is, and how payloads become columns.

1. A serialisation is one module with one class of the shape of `Payload`, made from a channel's schema;
   what it cannot read it refuses with a `PayloadError` when it is made.
2. ``extractor`` compiles the requested fields into one function from a message's bytes to one value a
   column: a number for a field, ``int`` nanoseconds for a time, None for what is absent (rule 4 of
   `pipeline.formats.base`). It raises `PayloadError` for a message that it cannot decode, and nothing else.
3. Only `Decoder` turns rows into Arrow columns. A faster decoding replaces `Decoder.decode`, which has many
   messages in hand at once; nothing outside this module knows of rows.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Protocol

import numpy as np
import pyarrow as pa

from pipeline.errors import one_line
from pipeline.formats.base import Field

Bytes = bytes | memoryview
Row = Sequence[float | int | None]
Extractor = Callable[[Bytes], Row]
Path = tuple[str | int, ...]

MAX_FIELDS = 4096
"""Fields of one topic that are listed; more can still be requested by their path."""
MAX_LISTED = 64
"""Elements of one array that are listed; more can still be requested by their index."""

STAMPS = ("header.stamp", "timestamp")
"""Where messages like those of ROS, and Foxglove's own schemas, keep the sender's stamp."""

_LIMIT = 2**63
_TOKEN = re.compile(r"([^.\[\]]+)|\[(\d{1,9})\]")


class PayloadError(Exception):
    """A schema or a message that cannot be decoded; caught in `pipeline.formats.messages`."""

    def __init__(self, reason: str) -> None:
        super().__init__(one_line(reason))


@dataclass(frozen=True, slots=True)
class Schema:
    """What a recording says of a channel's messages, as it says it."""

    message_encoding: str
    encoding: str
    name: str
    data: bytes


class Payload(Protocol):
    """What a serialisation makes of a schema."""

    def fields(self, sample: Bytes | None) -> tuple[Field, ...]:
        """The numeric fields; ``sample`` is the first message, which shows what the schema leaves open."""
        ...

    def has(self, path: str) -> bool | None:
        """Whether messages hold this numeric field; None where only the messages can tell."""
        ...

    def has_time(self, path: str) -> bool | None:
        """Whether messages hold this number or stamp of seconds and nanoseconds."""
        ...

    def header_stamp(self, sample: Bytes | None) -> str | None:
        """The path of the sender's stamp, if messages carry one."""
        ...

    def extractor(self, fields: Sequence[str], times: Sequence[tuple[str, int]]) -> Extractor:
        """Compile a request: field paths, then time paths with their nanoseconds a unit."""
        ...


@dataclass(frozen=True, slots=True)
class Batch:
    """Decoded messages: one Arrow array a column, and which messages could not be decoded, and why."""

    columns: list[pa.Array]
    failures: dict[int, str]


@dataclass(frozen=True, slots=True)
class Decoder:
    """Decodes messages into the columns of one request."""

    extract: Extractor
    fields: int
    """The first so many columns are numbers, the others times."""
    times: int

    def decode(self, payloads: Sequence[Bytes]) -> Batch:
        """Decode messages in order; those that fail have no row."""
        rows: list[Row] = []
        failures: dict[int, str] = {}
        for index, payload in enumerate(payloads):
            try:
                rows.append(self.extract(payload))
            except PayloadError as error:
                failures[index] = str(error)
        columns = list(zip(*rows, strict=True)) if rows else [()] * (self.fields + self.times)
        return Batch(
            [numbers(column) for column in columns[: self.fields]]
            + [times(column) for column in columns[self.fields :]],
            failures,
        )


def numbers(values: Sequence[float | int | None]) -> pa.Array:
    """A ``float64`` column: None becomes null, NaN stays NaN."""
    absent = np.fromiter((v is None for v in values), dtype=np.bool_, count=len(values))
    data = np.array([0.0 if v is None else float(v) for v in values], dtype=np.float64)
    return pa.array(data, mask=absent if absent.any() else None, from_pandas=False)


def times(values: Sequence[float | int | None]) -> pa.Array:
    """An ``int64`` column: None becomes null."""
    return pa.array(values, type=pa.int64())


def nanoseconds(value: float | int | str | Decimal, scale: int) -> int | None:
    """A time in nanoseconds: exactly for integers and decimal text, to the nearest for binary floats.

    Parameters
    ----------
    value : number or decimal text
        NaN, infinity and text that is no number give None.
    scale : int
        Nanoseconds a unit.
    """
    if isinstance(value, str):
        try:
            value = Decimal(value)
        except InvalidOperation:
            return None
    if isinstance(value, int):
        return within(value * scale)
    if not (value.is_finite() if isinstance(value, Decimal) else math.isfinite(value)):
        return None
    if not -_LIMIT < value < _LIMIT:
        raise PayloadError("a time beyond 64-bit nanoseconds")
    whole = math.floor(value)
    # The whole part apart, so that the rest keeps its digits; in exact arithmetic for decimal text.
    rest = value - whole if isinstance(value, Decimal) else Decimal(value - whole)
    return within(whole * scale + round(rest * scale))


def within(time: int) -> int:
    """The time, if 64 bits can hold it."""
    if not -_LIMIT <= time < _LIMIT:
        raise PayloadError("a time beyond 64-bit nanoseconds")
    return time


def parse_path(path: str) -> Path | None:
    """``imu[1].gyro[0]`` as ``("imu", 1, "gyro", 0)``; None where it is no path."""
    tokens: list[str | int] = []
    for number, part in enumerate(re.split(r"\.|(?=\[)", path)):
        match = _TOKEN.fullmatch(part)
        if match is None or (number == 0 and match[1] is None):
            return None
        tokens.append(match[1] if match[1] is not None else int(match[2]))
    return tuple(tokens)


def join_path(parent: str, name: str) -> str:
    """The path of a member of ``parent``, which is "" for the message itself."""
    return f"{parent}.{name}" if parent else name
