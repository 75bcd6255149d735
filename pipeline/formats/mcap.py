"""MCAP files (https://mcap.dev/spec), read in file order with every checksum on, and written."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from pipeline.formats.account import Account
from pipeline.formats.base import Inspection, Loss, Request, Samples, Series, TextLayout, begins_with
from pipeline.formats.compression import CompressionError, inflate
from pipeline.formats.mcap_scan import MAGIC, PARSING, Scan, inner_records, read_summary
from pipeline.formats.messages import Channel, Channels, Message, inspect_source, read_source
from pipeline.formats.payload import Schema

FORMAT = "MCAP"
SUFFIX = ".mcap"

_MESSAGE = struct.Struct("<HIQQ")
_INDEX = struct.Struct("<HI")
_INDEX_ENTRY = 16
_CHUNK_SIZE = 2**20


def recognises(path: Path) -> bool:
    """Whether the file begins with MCAP's magic bytes."""
    return begins_with(path, MAGIC)


def inspect(path: Path, layout: TextLayout) -> Inspection:  # noqa: ARG001 - shape of a container
    """Topics, types, counts, clocks and losses."""
    return inspect_source(path, FORMAT, McapSource(path))


def read(path: Path, requests: Sequence[Request], layout: TextLayout) -> Samples:  # noqa: ARG001
    """The requested fields as Arrow tables."""
    return read_source(path, McapSource(path), requests)


def write(path: Path, series: Sequence[Series], encoding: str = "cdr") -> None:
    """Write the series with Zstandard chunks, all checksums, and messages in the order of their log time.

    Parameters
    ----------
    path : Path
        The file to be made.
    series : sequence of Series
        One a topic.
    encoding : {"cdr", "ros1", "json", "protobuf"}
        The messages' serialisation.
    """
    from mcap.writer import CompressionType, Writer

    from pipeline.formats.ros_messages import encode, in_time_order

    topics = [encode(one, encoding) for one in series]
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=_CHUNK_SIZE, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile={"cdr": "ros2", "ros1": "ros1"}.get(encoding, ""), library="gyrostand")
        channels = []
        for one, topic in zip(series, topics, strict=True):
            schema = writer.register_schema(topic.schema.name, topic.schema.encoding, topic.schema.data)
            channels.append(writer.register_channel(one.topic, topic.schema.message_encoding, schema))
        for number, index, time in in_time_order(series):
            data = topics[number].messages[index]
            writer.add_message(channels[number], time, data, publish_time=time, sequence=index)
        writer.finish()  # type: ignore[no-untyped-call]


class McapSource:
    """The messages of an MCAP file."""

    publishes = True

    def __init__(self, path: Path, channels: Channels | None = None) -> None:
        self.channels = channels if channels is not None else Channels()
        self.losses: list[Loss] = []
        self._path = path
        self._schemas: dict[int, records.Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._account = Account(self.losses, self._topic)

    def messages(self) -> Iterator[Message]:
        """Every message in the order of the file."""
        with self._path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(0)
            if file.read(len(MAGIC)) != MAGIC:
                self.losses.append(
                    Loss("", f"{self._path.name!r} does not begin as MCAP does", size, "bytes")
                )
                return
            summary = read_summary(file, size)
            self._schemas |= summary.schemas
            for record in summary.channels.values():
                self._define(record)
            scan = Scan(file, size, summary.chunks)
            for opcode, body in scan.data_records():
                if opcode != Opcode.MESSAGE_INDEX:
                    self._account.close_chunk()
                yield from self._record(opcode, body, scan.start)
            self._account.close_chunk()
        self.losses += scan.losses
        self._account.close(summary.counts, "the summary")

    def _record(self, opcode: int, body: bytes, start: int) -> Iterator[Message]:
        try:
            if opcode == Opcode.CHUNK:
                yield from self._chunk(body)
            elif opcode == Opcode.MESSAGE:
                yield from self._message(memoryview(body))
            elif opcode != Opcode.MESSAGE_INDEX:
                self._definition(opcode, body)
            elif self._account.has_lost_chunk:
                self._index(body)
        except (CompressionError, *PARSING) as error:
            reason = str(error) if isinstance(error, CompressionError) else "it is cut short or damaged"
            if opcode == Opcode.CHUNK:
                self._account.lose_chunk(f"the chunk at byte {start} cannot be read: {reason}", len(body))
            else:
                self.losses.append(
                    Loss("", f"the record at byte {start} cannot be read: {reason}", len(body), "bytes")
                )

    def _chunk(self, body: bytes) -> Iterator[Message]:
        chunk = records.Chunk.read(ReadDataStream(io.BytesIO(body)))
        data = inflate(chunk.compression, chunk.data, chunk.uncompressed_size)
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise CompressionError("its checksum fails")
        try:
            for opcode, view in inner_records(memoryview(data)):
                if opcode == Opcode.MESSAGE:
                    yield from self._message(view)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._definition(opcode, bytes(view))
        except PARSING:
            self.losses.append(Loss("", "a chunk ends in a record that is cut short", len(data), "bytes"))

    def _message(self, view: memoryview) -> Iterator[Message]:
        number, _, log_time, publish_time = _MESSAGE.unpack_from(view)
        channel = self._channels.get(number)
        if channel is None:
            self._account.found(number, f"messages of a channel {number} that the recording does not define")
        elif (log_time | publish_time) >> 63:
            self._account.found(number, "messages with a time beyond 64-bit nanoseconds")
        else:
            self._account.found(number)
            yield channel, log_time, publish_time, view[_MESSAGE.size :]

    def _definition(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = records.Schema.read(stream)
            self._schemas[schema.id] = schema
        else:
            self._define(records.Channel.read(stream))

    def _define(self, record: records.Channel) -> None:
        """Take a channel's definition; a second one under the same number holds from there on."""
        schema = self._schemas.get(record.schema_id)
        if schema is None:
            described = Schema(record.message_encoding, "", "", b"")
        else:
            described = Schema(record.message_encoding, schema.encoding, schema.name, schema.data)
        self._channels[record.id] = self.channels.get(record.topic, described)

    def _index(self, body: bytes) -> None:
        number, length = _INDEX.unpack_from(body)
        entries = min(length, len(body) - _INDEX.size) // _INDEX_ENTRY
        self._account.index(number, struct.unpack_from("<" + "Q8x" * entries, body, _INDEX.size))

    def _topic(self, number: int) -> str:
        return self._channels[number].topic if number in self._channels else ""
