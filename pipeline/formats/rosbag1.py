"""ROS 1 bags, version 2.0 (http://wiki.ros.org/Bags/Format/2.0), read in file order, and written.

The bag is read from its first record to its last, so that one without an index, which its recorder did not
close, is read as any other. The index, where there is one, adds the connections of chunks that are
damaged, the counts to compare with, and the places at which reading can go on behind a damaged stretch.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import md5
from pathlib import Path
from typing import BinaryIO

from pipeline.formats.account import Account
from pipeline.formats.base import (
    Inspection,
    Loss,
    RecordingError,
    Request,
    Samples,
    Series,
    TextLayout,
    begins_with,
)
from pipeline.formats.compression import CompressionError, inflate
from pipeline.formats.messages import Channel, Channels, Message, inspect_source, read_source
from pipeline.formats.payload import Schema

FORMAT = "ROS 1 bag"
SUFFIX = ".bag"

_MAGIC = b"#ROSBAG V"
_VERSION = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_LENGTH = struct.Struct("<I")
_EMPTY_MD5 = md5(b"", usedforsecurity=False).hexdigest()


class _DamagedError(Exception):
    """A record that is cut short or is none."""


def recognises(path: Path) -> bool:
    """Whether the file begins as a bag does."""
    return begins_with(path, _MAGIC)


def inspect(path: Path, layout: TextLayout) -> Inspection:  # noqa: ARG001 - shape of a container
    """Topics, types, counts, clocks and losses."""
    return inspect_source(path, FORMAT, Rosbag1Source(path))


def read(path: Path, requests: Sequence[Request], layout: TextLayout) -> Samples:  # noqa: ARG001
    """The requested fields as Arrow tables."""
    return read_source(path, Rosbag1Source(path), requests)


def write(path: Path, series: Sequence[Series]) -> None:
    """Write the series with bzip2 chunks, messages in the order of their log time."""
    from rosbags.rosbag1 import Writer

    from pipeline.formats.ros_messages import encode, in_time_order, md5sum

    topics = [encode(one, "ros1") for one in series]
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer:
        connections = [
            writer.add_connection(
                one.topic,
                one.message_type,
                msgdef=topic.schema.data.decode(),
                md5sum=md5sum(one.message_type),
            )
            for one, topic in zip(series, topics, strict=True)
        ]
        for number, index, time in in_time_order(series):
            writer.write(connections[number], time, topics[number].messages[index])


@dataclass(frozen=True, slots=True)
class _Record:
    """A record: its header's fields, and where its data lies."""

    start: int
    header: Mapping[bytes, bytes]
    data_at: int
    data_size: int

    @property
    def end(self) -> int:
        return self.data_at + self.data_size

    @property
    def op(self) -> int:
        return self.number(b"op", "<B")

    def number(self, name: bytes, code: str) -> int:
        """A number of the header; `_DamagedError` where it lacks."""
        try:
            return int(struct.unpack(code, self.header[name])[0])
        except (KeyError, struct.error) as error:
            raise _DamagedError(f"its header has no {name.decode()}") from error


@dataclass(slots=True)
class _Index:
    """What the end of the bag says of the rest."""

    connections: dict[int, tuple[str, Schema]] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    chunks: list[int] = field(default_factory=list)


class Rosbag1Source:
    """The messages of a bag."""

    publishes = False

    def __init__(self, path: Path) -> None:
        self.channels = Channels()
        self.losses: list[Loss] = []
        self._path = path
        self._connections: dict[int, Channel] = {}
        self._account = Account(self.losses, self._topic)
        self._listed: dict[int, tuple[str, Schema]] = {}
        """Connections as the index has them, for those that no chunk defines."""

    def messages(self) -> Iterator[Message]:
        """Every message in the order of the file."""
        with self._path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(0)
            version = file.read(len(_VERSION))
            if version != _VERSION:
                raise self._refused("a bag of version 2.0", repr(version), "convert it with 'rosbag fix'")
            index = self._read_index(file, size)
            self._listed = dict(index.connections)
            yield from self._scan(file, size, index.chunks)
        for number in self._listed:
            self._channel(number)
        self._account.close(index.counts, "the index")

    def _read_index(self, file: BinaryIO, size: int) -> _Index:
        index = _Index()
        try:
            bag = _record(file, len(_VERSION), size)
            if bag.header.get(b"encryptor"):
                raise self._refused("a bag without encryption", repr(bag.header[b"encryptor"]), "decrypt it")
            position = bag.number(b"index_pos", "<Q")
            if position == 0:
                detail = "the bag has no index: its recorder did not close it, and may have held more"
                self.losses.append(Loss("", detail, 0, "messages"))
                return index
            while position < size:
                record = _record(file, position, size)
                data = file.read(record.data_size)
                if record.op == _CONNECTION:
                    index.connections.setdefault(record.number(b"conn", "<I"), _connection(record, data))
                elif record.op == _CHUNK_INFO:
                    index.chunks.append(record.number(b"chunk_pos", "<Q"))
                    for number, count in struct.iter_unpack("<II", data[: len(data) // 8 * 8]):
                        index.counts[number] += count
                position = record.end
        except _DamagedError as error:
            detail = f"the bag's index cannot be read: {error}"
            self.losses.append(Loss("", detail, 0, "messages"))
        index.chunks.sort()
        return index

    def _scan(self, file: BinaryIO, size: int, chunks: Sequence[int]) -> Iterator[Message]:
        position = len(_VERSION)
        while position < size:
            try:
                record = _record(file, position, size)
                op = record.op
            except _DamagedError as error:
                behind = next((chunk for chunk in chunks if position < chunk < size), None)
                end = size if behind is None else behind
                detail = f"the record at byte {position} is damaged ({error}); not read up to byte {end}"
                self.losses.append(Loss("", detail, end - position, "bytes"))
                position = end
                continue
            if op != _INDEX:
                self._account.close_chunk()
            data = file.read(record.data_size) if op in (_CHUNK, _INDEX, _CONNECTION, _MESSAGE) else b""
            yield from self._record(op, record, data)
            position = record.end
        self._account.close_chunk()

    def _record(self, op: int, record: _Record, data: bytes) -> Iterator[Message]:
        try:
            if op == _CHUNK:
                yield from self._chunk(record, data)
            elif op == _MESSAGE:
                yield from self._message(record, memoryview(data))
            elif op == _CONNECTION:
                self._listed.setdefault(record.number(b"conn", "<I"), _connection(record, data))
            elif op == _INDEX and self._account.has_lost_chunk:
                self._index(record, data)
        except (CompressionError, _DamagedError) as error:
            if op == _CHUNK:
                detail = f"the chunk at byte {record.start} cannot be read: {error}"
                self._account.lose_chunk(detail, len(data))
            else:
                detail = f"the record at byte {record.start} cannot be read: {error}"
                self.losses.append(Loss("", detail, len(data), "bytes"))

    def _chunk(self, record: _Record, data: bytes) -> Iterator[Message]:
        method = _text(record.header.get(b"compression", b"none"))
        inflated = inflate(method, data, record.number(b"size", "<I"))
        view = memoryview(inflated)
        position = 0
        while position < len(view):
            try:
                inner = _inner_record(inflated, position)
                part = view[inner.data_at : inner.end]
                if inner.op == _MESSAGE:
                    yield from self._message(inner, part)
                elif inner.op == _CONNECTION:
                    self._define(inner, bytes(part))
            except _DamagedError as error:
                detail = f"the chunk at byte {record.start} is damaged {position} bytes in: {error}"
                self.losses.append(Loss("", detail, len(view) - position, "bytes"))
                return
            position = inner.end

    def _message(self, record: _Record, data: memoryview) -> Iterator[Message]:
        number = record.number(b"conn", "<I")
        stamp = record.number(b"time", "<Q")  # seconds in the low half, nanoseconds in the high
        time = (stamp & 0xFFFFFFFF) * 10**9 + (stamp >> 32)
        channel = self._connections.get(number) or self._channel(number)
        if channel is None:
            self._account.found(number, f"messages of a connection {number} that the bag does not define")
        else:
            self._account.found(number)
            yield channel, time, time, data

    def _define(self, record: _Record, data: bytes) -> None:
        number = record.number(b"conn", "<I")
        self._connections[number] = self.channels.get(*_connection(record, data))

    def _channel(self, number: int) -> Channel | None:
        """A connection's channel; by the index where no chunk has defined it."""
        if number not in self._connections and number in self._listed:
            self._connections[number] = self.channels.get(*self._listed[number])
        return self._connections.get(number)

    def _index(self, record: _Record, data: bytes) -> None:
        times = [s * 10**9 + ns for s, ns, _ in struct.iter_unpack("<III", data[: len(data) // 12 * 12])]
        self._account.index(record.number(b"conn", "<I"), times)

    def _topic(self, number: int) -> str:
        channel = self._channel(number)
        return channel.topic if channel else ""

    def _refused(self, expected: str, found: str, remedy: str) -> RecordingError:
        return RecordingError(str(self._path), expected=expected, found=found, remedy=remedy)


def _record(file: BinaryIO, start: int, size: int) -> _Record:
    """The record at a position of the file, which is left at the record's data."""
    file.seek(start)
    header_size = _read_length(file)
    if header_size > size - start - 2 * _LENGTH.size:
        raise _DamagedError("its header is cut short")
    header = _fields(file.read(header_size))
    data_size = _read_length(file)
    data_at = start + 2 * _LENGTH.size + header_size
    if data_size > size - data_at:
        raise _DamagedError("its data are cut short")
    return _Record(start, header, data_at, data_size)


def _inner_record(chunk: bytes, start: int) -> _Record:
    """The record at a position of a chunk."""
    try:
        (header_size,) = _LENGTH.unpack_from(chunk, start)
        header_end = start + _LENGTH.size + header_size
        (data_size,) = _LENGTH.unpack_from(chunk, header_end)
    except struct.error as error:
        raise _DamagedError("a record is cut short") from error
    data_at = header_end + _LENGTH.size
    if data_size > len(chunk) - data_at:
        raise _DamagedError("a record's data are cut short")
    return _Record(start, _fields(chunk[start + _LENGTH.size : header_end]), data_at, data_size)


def _connection(record: _Record, data: bytes) -> tuple[str, Schema]:
    """Topic and schema of a connection."""
    about = _fields(data)
    topic = record.header.get(b"topic", about.get(b"topic", b""))
    definition = about.get(b"message_definition", b"")
    # Only std_msgs/Empty and its like are truly defined by nothing.
    defined = definition.strip() or about.get(b"md5sum") == _EMPTY_MD5.encode()
    type_ = _text(about.get(b"type", b""))
    return _text(topic), Schema("ros1", "ros1msg" if defined else "", type_, definition)


def _read_length(file: BinaryIO) -> int:
    data = file.read(_LENGTH.size)
    if len(data) < _LENGTH.size:
        raise _DamagedError("it is cut short")
    return int(_LENGTH.unpack(data)[0])


def _fields(data: bytes) -> dict[bytes, bytes]:
    """The ``name=value`` fields of a header."""
    fields = {}
    position = 0
    while position < len(data):
        if position + _LENGTH.size > len(data):
            raise _DamagedError("a header field is cut short")
        (length,) = _LENGTH.unpack_from(data, position)
        position += _LENGTH.size
        name, equals, value = data[position : position + length].partition(b"=")
        if not equals or position + length > len(data):
            raise _DamagedError("a header field is damaged")
        fields[name] = value
        position += length
    return fields


def _text(data: bytes) -> str:
    return data.decode(errors="backslashreplace")
