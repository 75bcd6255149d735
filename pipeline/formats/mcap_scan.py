"""The records of an MCAP file, their checksums, and what its summary says.

The data section is read from its first record to its last, so that a file without a summary, or without an
end, is read as any other. The summary, where its checksum holds, adds the channels without messages, the
counts to compare with, and the places at which reading can go on behind a damaged stretch.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode

from pipeline.formats.base import Loss

MAGIC = b"\x89MCAP0\r\n"
PARSING = (EndOfFile, struct.error, UnicodeDecodeError, OverflowError)
"""What the `mcap` package's records raise for a body that is cut short or is none."""

_PREFIX = struct.Struct("<BQ")
_FOOTER = struct.Struct("<QQI")
_FOOTER_AT = _PREFIX.size + _FOOTER.size + len(MAGIC)
_STEP = 2**20


@dataclass(slots=True)
class Summary:
    """What the end of the file says of the rest; empty where it is missing or its checksum fails."""

    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: list[int] = field(default_factory=list)


def read_summary(file: BinaryIO, size: int) -> Summary:
    """Read the summary of a file of ``size`` bytes; empty where there is none, or its checksum fails."""
    tail = _at(file, size - _FOOTER_AT, _FOOTER_AT) if size >= _FOOTER_AT else b""
    if not tail.endswith(MAGIC) or _PREFIX.unpack_from(tail) != (Opcode.FOOTER, _FOOTER.size):
        return Summary()
    start, _, checksum = _FOOTER.unpack_from(tail, _PREFIX.size)
    end = size - _FOOTER_AT
    if not len(MAGIC) < start <= end:
        return Summary()
    body = _at(file, start, end - start)
    footer = tail[: _PREFIX.size + _FOOTER.size - 4]
    if checksum not in (0, zlib.crc32(footer, zlib.crc32(body))):
        return Summary()
    summary = Summary()
    try:
        for opcode, view in inner_records(memoryview(body)):
            stream = ReadDataStream(io.BytesIO(view))
            if opcode == Opcode.SCHEMA:
                schema = records.Schema.read(stream)
                summary.schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = records.Channel.read(stream)
                summary.channels[channel.id] = channel
            elif opcode == Opcode.STATISTICS:
                summary.counts = records.Statistics.read(stream).channel_message_counts
            elif opcode == Opcode.CHUNK_INDEX:
                summary.chunks.append(records.ChunkIndex.read(stream).chunk_start_offset)
    except PARSING:
        return Summary()
    summary.chunks.sort()
    return summary


def _at(file: BinaryIO, position: int, size: int) -> bytes:
    file.seek(position)
    return file.read(size)


def inner_records(view: memoryview) -> Iterator[tuple[int, memoryview]]:
    """The records of a chunk or a summary.

    Raises
    ------
    EndOfFile
        If the last record is cut short.
    """
    position, end = 0, len(view)
    while position < end:
        if end - position < _PREFIX.size:
            raise EndOfFile
        opcode, length = _PREFIX.unpack_from(view, position)
        position += _PREFIX.size
        if length > end - position:
            raise EndOfFile
        yield opcode, view[position : position + length]
        position += length


class Scan:
    """The records between the file's two magics, with the checksums of both sections compared.

    Attributes
    ----------
    start : int
        Where the record given last begins.
    losses : list of Loss
        What could not be read, or does not agree with its checksum.
    """

    _KEPT = frozenset((Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX))

    def __init__(self, file: BinaryIO, size: int, chunks: Sequence[int]) -> None:
        self.start = 0
        self.losses: list[Loss] = []
        self._file = file
        self._size = size
        self._chunks = chunks
        self._checksum: int | None = zlib.crc32(MAGIC)

    def data_records(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of the data section's records that `McapSource` reads."""
        position = len(MAGIC)
        in_data = True
        while True:
            self.start = position
            prefix = _at(self._file, position, _PREFIX.size)
            if len(prefix) < _PREFIX.size:
                self._cut(position, in_data)
                return
            opcode, length = _PREFIX.unpack(prefix)
            position += _PREFIX.size
            if opcode == 0 or length > self._size - position:
                resumed = self._resume()
                if resumed is None:
                    return
                position = resumed
                continue
            position += length
            if opcode == Opcode.FOOTER:
                self._footer(prefix, length)
                return
            if opcode == Opcode.DATA_END:
                self._data_end(length)
                in_data = False
                continue
            self._sum(prefix)
            if in_data and opcode in self._KEPT:
                body = self._file.read(length)
                self._sum(body)
                yield opcode, body
            else:
                self._pass_over(length)

    def _sum(self, data: bytes) -> None:
        if self._checksum is not None:
            self._checksum = zlib.crc32(data, self._checksum)

    def _pass_over(self, length: int) -> None:
        while length:
            data = self._file.read(min(length, _STEP))
            self._sum(data)
            length -= len(data)

    def _data_end(self, length: int) -> None:
        stored = int.from_bytes(self._file.read(length)[:4], "little")
        if stored and self._checksum is not None and stored != self._checksum:
            detail = "the checksum of the data section fails: what has no checksum of its own may be wrong"
            self.losses.append(Loss("", detail, self.start, "bytes"))
        self._checksum = 0

    def _footer(self, prefix: bytes, length: int) -> None:
        body = self._file.read(length)
        if len(body) < _FOOTER.size:
            self.losses.append(Loss("", "the footer is cut short", len(body), "bytes"))
            return
        _, _, stored = _FOOTER.unpack_from(body)
        self._sum(prefix + body[: _FOOTER.size - 4])
        if stored and self._checksum is not None and stored != self._checksum:
            detail = "the checksum of the summary fails: topics without messages may be missing"
            self.losses.append(Loss("", detail, length, "bytes"))
        rest = self._file.read(_STEP)
        if rest != MAGIC:
            self.losses.append(Loss("", "the file does not end where its footer does", len(rest), "bytes"))

    def _cut(self, position: int, in_data: bool) -> None:
        left = self._size - position
        what = "its messages may go on" if in_data else "its summary is incomplete"
        self.losses.append(Loss("", f"the file ends before its footer, so that {what}", left, "bytes"))

    def _resume(self) -> int | None:
        """Where to read on behind a record whose length cannot be; None where that cannot be known."""
        self._checksum = None
        behind = next((chunk for chunk in self._chunks if self.start < chunk < self._size), None)
        end = self._size if behind is None else behind
        detail = f"the record at byte {self.start} is cut short or damaged; not read up to byte {end}"
        self.losses.append(Loss("", detail, end - self.start, "bytes"))
        return behind
