"""From a container's raw messages to an `Inspection` or to `Samples`: what all binary containers share.

A container gives a `Source`; this module knows of payloads, the container does not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import pyarrow as pa

from pipeline.formats.base import (
    CLOCKS,
    Field,
    Inspection,
    Loss,
    RecordingError,
    Request,
    Samples,
    Topic,
    nanoseconds_a_unit,
    unknown_name,
    wrong_request,
)
from pipeline.formats.json_payload import JsonPayload
from pipeline.formats.payload import Batch, Bytes, Decoder, Payload, PayloadError, Schema
from pipeline.formats.protobuf_payload import ProtobufPayload
from pipeline.formats.ros_payload import RosPayload
from pipeline.formats.ros_types import HUMBLE, message_type, standard_type

_BATCH = 4096
"""Messages that are decoded together."""


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """A writer of one topic. Compared by identity: a topic may have several, even of different types."""

    topic: str
    schema: Schema


class Channels:
    """The channels of a recording: one for each topic and schema, however many writers or files it has."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, Schema], Channel] = {}

    def get(self, topic: str, schema: Schema) -> Channel:
        """The channel of that topic and schema, made where there is none yet."""
        return self._known.setdefault((topic, schema), Channel(topic, schema))

    def __iter__(self) -> Iterator[Channel]:
        return iter(self._known.values())


Message = tuple[Channel, int, int, Bytes]
"""Channel, log time and publish time [ns], payload, which may be a view that keeps a whole chunk alive."""


class Source(Protocol):
    """The raw messages of a recording, in the order of the file.

    ``messages`` never raises for damage: it ends, or goes on behind it, and says so in ``losses``.
    ``channels`` and ``losses`` are complete once it has ended.
    """

    publishes: bool
    """Whether the container keeps publish times."""
    channels: Channels
    losses: list[Loss]

    def messages(self) -> Iterator[Message]:
        """Every message, once."""
        ...


@lru_cache(maxsize=64)
def payload_of(schema: Schema) -> Payload:
    """The payload that reads a channel's messages.

    Raises
    ------
    PayloadError
        If there is no decoder for the encodings, or the schema is not well formed.
    """
    match schema.message_encoding, schema.encoding:
        case "cdr", "ros2msg" | "ros2idl":
            return RosPayload(message_type(schema), cdr=True)
        case "cdr", encoding if encoding == HUMBLE:
            return RosPayload(standard_type(schema.name), cdr=True)
        case "ros1", "ros1msg":
            return RosPayload(message_type(schema), cdr=False)
        case "json", "jsonschema" | "":
            return JsonPayload(schema.data)
        case "protobuf", "protobuf":
            return ProtobufPayload(schema.name, schema.data)
        case "cdr" | "ros1", "":
            raise PayloadError(f"the recording does not define its type {schema.name!r}")
        case message_encoding, encoding:
            raise PayloadError(
                f"messages in {message_encoding!r} with a schema in {encoding!r} have no decoder here"
            )


@dataclass(slots=True)
class _Seen:
    """What `inspect_source` keeps of a channel; messages with their number in the file."""

    count: int
    first: tuple[int, Message]
    last: tuple[int, Message]


def inspect_source(path: Path, container: str, source: Source) -> Inspection:
    """Read through a recording, decode the first and the last message of each channel, and report."""
    seen: dict[Channel, _Seen] = {}
    for number, message in enumerate(source.messages()):
        state = seen.get(message[0])
        if state is None:
            kept = (*message[:3], bytes(message[3]))
            seen[message[0]] = _Seen(1, (number, kept), (number, kept))
        else:
            state.count += 1
            state.last = (number, message)
    _something(path, source)
    by_topic: dict[str, list[Channel]] = {}
    for channel in source.channels:
        by_topic.setdefault(channel.topic, []).append(channel)
    topics = tuple(_topic(name, channels, seen, source.publishes) for name, channels in by_topic.items())
    return Inspection(path, container, topics, tuple(source.losses))


def _something(path: Path, source: Source) -> None:
    """Refuse a recording in which nothing at all could be read."""
    if source.losses and not any(source.channels):
        raise RecordingError(
            str(path),
            expected="a recording of which at least a part can be read",
            found=source.losses[0].detail,
            remedy="record again, or restore the file from its source",
        )


def _topic(name: str, channels: list[Channel], seen: Mapping[Channel, _Seen], publishes: bool) -> Topic:
    states = [seen[channel] for channel in channels if channel in seen]
    fields: dict[str, Field] = {}
    problems: list[str] = []
    for channel in channels:
        try:
            fields |= {field.path: field for field in _fields(channel, seen.get(channel))}
        except PayloadError as error:
            problems.append(str(error))
    schemas = [channel.schema for channel in channels]
    return Topic(
        name=name,
        message_type=" | ".join(dict.fromkeys(schema.name for schema in schemas)),
        encoding=" | ".join(dict.fromkeys(_encoding(schema) for schema in schemas)),
        count=sum(state.count for state in states),
        fields=tuple(fields.values()),
        clocks=_clocks(states, publishes),
        problem="; ".join(dict.fromkeys(problems)) or None,
    )


def _fields(channel: Channel, state: _Seen | None) -> tuple[Field, ...]:
    """The fields of the first message or, where that one is damaged, of the last."""
    payload = payload_of(channel.schema)
    if state is None:
        return payload.fields(None)
    walk = payload.extractor((), ())
    _, (_, _, _, sample) = state.first
    try:
        walk(sample)
    except PayloadError:
        _, (_, _, _, sample) = state.last
        walk(sample)
    return payload.fields(sample)


def _encoding(schema: Schema) -> str:
    return f"{schema.message_encoding} ({schema.encoding})" if schema.encoding else schema.message_encoding


def _clocks(states: list[_Seen], publishes: bool) -> dict[str, tuple[int, int]]:
    """First and last time of each clock, in file order."""
    if not states:
        return {}
    _, first = min((state.first for state in states), key=lambda numbered: numbered[0])
    _, last = max((state.last for state in states), key=lambda numbered: numbered[0])
    stamps = (_stamp(first), _stamp(last))
    clocks = {} if None in stamps else {"header_stamp": stamps}
    clocks["log_time"] = (first[1], last[1])
    if publishes:
        clocks["publish_time"] = (first[2], last[2])
    return clocks  # type: ignore[return-value]  # None was sorted out above


def _stamp(message: Message) -> int | None:
    channel, _, _, data = message
    try:
        payload = payload_of(channel.schema)
        path = payload.header_stamp(data)
        value = payload.extractor((), [(path, 1)])(data)[0] if path else None
    except PayloadError:
        return None
    return None if value is None else int(value)


def read_source(path: Path, source: Source, requests: Sequence[Request]) -> Samples:
    """Decode the requested topics; requests of one topic are read together."""
    tables: dict[str, _Reader] = {}
    for request in requests:
        where = f"{path}, topic {request.topic!r}"
        reader = tables.setdefault(request.topic, _Reader(where, request.topic, source.publishes))
        reader.want(request)
    for message in source.messages():
        wanted = tables.get(message[0].topic)
        if wanted is not None:
            wanted.add(message)
    _something(path, source)
    for topic, reader in tables.items():
        channels = [channel for channel in source.channels if channel.topic == topic]
        if not channels:
            names = dict.fromkeys(channel.topic for channel in source.channels)
            raise unknown_name(str(path), "topic", topic, names)
        reader.finish(channels)
    losses = [*source.losses, *(loss for reader in tables.values() for loss in reader.losses())]
    return Samples({topic: reader.table() for topic, reader in tables.items()}, tuple(losses))


@dataclass(slots=True)
class _Columns:
    """How one channel's messages fill the columns of its topic."""

    decoder: Decoder
    names: tuple[str, ...]


class _Reader:
    """Collects one topic: batches of messages in, Arrow columns out."""

    def __init__(self, where: str, topic: str, publishes: bool) -> None:
        self._where = where
        self._topic = topic
        self._publishes = publishes
        self._fields: dict[str, None] = {}
        self._times: dict[str, int] = {}
        self._columns: dict[Channel, _Columns | PayloadError] = {}
        self._payloads: dict[Channel, tuple[Payload, Bytes | None]] = {}
        self._batch: list[Message] = []
        self._tables: list[dict[str, pa.Array]] = []
        self._failed: list[int] = []
        self._reason = ""

    def want(self, request: Request) -> None:
        """Add the fields of a request."""
        self._fields |= dict.fromkeys(request.fields)
        for time in request.times:
            scale = nanoseconds_a_unit(time, self._where)
            if self._times.setdefault(time.path, scale) != scale:
                raise wrong_request(
                    self._where, f"one unit of time for {time.path!r}", f"{time.unit!r} and another"
                )
        names = [*CLOCKS, *self._fields, *self._times]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise wrong_request(
                self._where,
                "each field once, as a number or as a time, and none by the name of a clock",
                f"{twice!r} twice",
            )

    def add(self, message: Message) -> None:
        """Take a message; it is decoded together with those of its channel that follow it."""
        channel, log_time, publish_time, data = message
        if self._batch and (len(self._batch) == _BATCH or self._batch[0][0] is not channel):
            self._flush()
        self._batch.append((channel, log_time, publish_time, bytes(data)))

    def finish(self, channels: Sequence[Channel]) -> None:
        """Decode what is left, and check that what was wanted was there to be had."""
        self._flush()
        for channel in channels:
            self._decoder(channel, None)
        problems = [c for c in self._columns.values() if isinstance(c, PayloadError)]
        if problems and len(problems) == len(self._columns):
            raise self._unreadable(str(problems[0]))
        if self._failed and not self._tables:
            raise self._unreadable(f"none: {self._reason}")
        for path in (*self._fields, *self._times):
            if not self._is_held(path):
                known = [field.path for p, sample in self._payloads.values() for field in p.fields(sample)]
                raise unknown_name(self._where, "field", path, dict.fromkeys(known))

    def table(self) -> pa.Table:
        """The samples, in the order of the file."""
        stamped = any("header_stamp" in columns for columns in self._tables) or any(
            payload.header_stamp(sample) for payload, sample in self._payloads.values()
        )
        clocks = [
            c for c in CLOCKS if c == "log_time" or (stamped if c == "header_stamp" else self._publishes)
        ]
        types = {
            **dict.fromkeys(clocks, pa.int64()),
            **dict.fromkeys(self._fields, pa.float64()),
            **dict.fromkeys(self._times, pa.int64()),
        }
        columns = []
        for name, type_ in types.items():
            arrays = [part.get(name, pa.nulls(len(part["log_time"]), type_)) for part in self._tables]
            columns.append(pa.chunked_array(arrays, type=type_))
        return pa.table(columns, names=list(types))

    def losses(self) -> Iterable[Loss]:
        """The messages of this topic that could not be decoded."""
        if self._failed:
            yield Loss(
                self._topic,
                f"messages cannot be decoded, the first because {self._reason}",
                len(self._failed),
                "messages",
                min(self._failed),
                max(self._failed),
            )

    def _flush(self) -> None:
        if not self._batch:
            return
        batch, self._batch = self._batch, []
        columns = self._decoder(batch[0][0], batch[0][3])
        if isinstance(columns, PayloadError):
            decoded = Batch([], dict.fromkeys(range(len(batch)), str(columns)))
        else:
            decoded = columns.decoder.decode([data for _, _, _, data in batch])
        if decoded.failures:
            self._reason = self._reason or next(iter(decoded.failures.values()))
            self._failed += [batch[index][1] for index in decoded.failures]
            batch = [message for index, message in enumerate(batch) if index not in decoded.failures]
        if batch and not isinstance(columns, PayloadError):
            clocks = {"log_time": pa.array([m[1] for m in batch], pa.int64())}
            if self._publishes:
                clocks["publish_time"] = pa.array([m[2] for m in batch], pa.int64())
            self._tables.append(clocks | dict(zip(columns.names, decoded.columns, strict=True)))

    def _decoder(self, channel: Channel, sample: Bytes | None) -> _Columns | PayloadError:
        """The channel's decoder, compiled at its first message."""
        if channel not in self._columns:
            try:
                self._columns[channel] = self._compile(channel, sample)
            except PayloadError as error:
                self._columns[channel] = error
        return self._columns[channel]

    def _compile(self, channel: Channel, sample: Bytes | None) -> _Columns:
        payload = payload_of(channel.schema)
        fields = [path for path in self._fields if payload.has(path) is not False]
        times = [(path, scale) for path, scale in self._times.items() if payload.has_time(path) is not False]
        try:
            stamp = payload.header_stamp(sample)
        except PayloadError:  # the first message may be the damaged one
            sample, stamp = None, payload.header_stamp(None)
        names = [*fields, *(path for path, _ in times)]
        if stamp:
            times.append((stamp, 1))
            names.append("header_stamp")
        self._payloads[channel] = (payload, sample)
        return _Columns(Decoder(payload.extractor(fields, times), len(fields), len(times)), tuple(names))

    def _is_held(self, path: str) -> bool:
        """Whether a channel's type has the field; where only messages can tell, whether one held it."""
        is_time = path in self._times
        answers = [p.has_time(path) if is_time else p.has(path) for p, _ in self._payloads.values()]
        if True in answers or not (None in answers and self._tables):
            return any(answer is not False for answer in answers)
        return any(path in part and part[path].null_count < len(part[path]) for part in self._tables)

    def _unreadable(self, found: str) -> RecordingError:
        return RecordingError(
            self._where,
            expected="messages that can be decoded",
            found=found,
            remedy="see 'gyrostand inspect' for the topics that can be read",
        )
