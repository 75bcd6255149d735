"""The text of a recording as UTF-8 bytes with Unix line ends, whatever it was packed and encoded in.

Plain, gzip or Zstandard; UTF-8 or UTF-16 with a byte order mark, UTF-8 without, else Latin-1. A packed
file that ends early is unpacked as far as it goes, and its last, cut line is left out, as a `Loss`.
"""

from __future__ import annotations

import codecs
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Protocol

import zstandard

from pipeline.formats.base import Loss, RecordingError

MAX_BYTES = 2 * 1024**3
"""The most that a packed file may unpack to (base rule 6): about 20 million rows of 100 characters."""

_CHUNK = 1024 * 1024
_LOOK = 1024
_PACKED_CHUNK = 4096  # one Zstandard run-length block makes 128 KiB of 4 bytes: 4 KiB stay below 128 MiB
_MAX_WINDOW = 128 * 1024**2
_GZIP = b"\x1f\x8b"
_ZSTANDARD = b"\x28\xb5\x2f\xfd"


class _Decompressor(Protocol):
    """What the gzip and the Zstandard decompressor of one frame have in common."""

    @property
    def eof(self) -> bool: ...

    @property
    def unused_data(self) -> bytes: ...

    def decompress(self, data: bytes, /) -> bytes: ...


def head(path: Path, size: int) -> bytes:
    """The first bytes of a recording, unpacked; fewer where there are no more or they are damaged."""
    with path.open("rb") as file:
        parts, got = [], 0
        try:
            for part in _parts(file):
                parts.append(part)
                got += len(part)
                if got >= size:
                    break
        except _DamageError:
            pass  # the caller only looks whether what is there is text
    return b"".join(parts)[:size]


def save(path: Path, text: bytes) -> None:
    """Write a text, packed where the name ends in .gz or .zst; the same bytes every time."""
    match path.suffix.lower():
        case ".gz":
            text = gzip.compress(text, mtime=0)
        case ".zst":
            text = zstandard.ZstdCompressor(write_checksum=True).compress(text)
    path.write_bytes(text)


def load(path: Path) -> tuple[bytes, tuple[Loss, ...]]:
    """Read, unpack and decode a whole recording.

    Returns
    -------
    text : bytes
        UTF-8, Unix line ends, no byte order mark.
    losses : tuple of Loss
        One where a packed file ends early or fails its checksum.

    Raises
    ------
    RecordingError
        If the file unpacks to more than `MAX_BYTES`, or is not text.
    OSError
        If it cannot be opened.
    """
    raw, damage = _unpack(path)
    losses: tuple[Loss, ...] = ()
    if damage is not None:
        whole_lines = raw.rfind(b"\n") + 1
        losses = (
            Loss("", f"{damage}; the incomplete last line is left out", len(raw) - whole_lines, "bytes"),
        )
        raw = raw[:whole_lines]
    text = _decode(raw)
    # Further on, zero bytes are the block that a power failure left: lines lost, not a wrong format.
    if b"\0" in text[:_LOOK]:
        raise RecordingError(
            str(path),
            expected="text",
            found=f"a zero byte at offset {text.index(0)}",
            remedy="this is no CSV, TSV or other text recording",
        )
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text, losses


class _DamageError(Exception):
    """A packed stream cannot be unpacked further; says why."""


def _unpack(path: Path) -> tuple[bytes, str | None]:
    parts, size, damage = [], 0, None
    try:
        with path.open("rb") as file:
            packed = file.read(4).startswith((_GZIP, _ZSTANDARD))
            file.seek(0)
            for part in _parts(file):
                parts.append(part)
                size += len(part)
                if packed and size > MAX_BYTES:
                    raise RecordingError(
                        str(path),
                        expected=f"at most {MAX_BYTES} bytes of text",
                        found="more in the compressed file",
                        remedy="decompress it, or split it",
                    )
    except _DamageError as error:
        damage = str(error)
    return b"".join(parts), damage


def _parts(file: BinaryIO) -> Iterator[bytes]:
    """The file's content in pieces, unpacked."""
    magic = file.read(4)
    file.seek(0)
    if magic.startswith(_GZIP):
        yield from _frames(file, "gzip")
    elif magic == _ZSTANDARD:
        yield from _frames(file, "Zstandard")
    else:
        while part := file.read(_CHUNK):
            yield part


def _decompressor(kind: str) -> _Decompressor:
    if kind == "gzip":
        return zlib.decompressobj(wbits=31)
    return zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW).decompressobj()


def _frames(file: BinaryIO, kind: str) -> Iterator[bytes]:
    """Unpack the frames of a gzip or Zstandard file one after the other."""
    unpacker: _Decompressor | None = None
    for piece in _pieces(file):
        data = piece
        while data:
            unpacker = unpacker or _decompressor(kind)
            try:
                part = unpacker.decompress(data)
            except (zlib.error, zstandard.ZstdError) as error:
                raise _DamageError(f"the {kind} data are damaged ({error})") from error
            if part:
                yield part
            data = unpacker.unused_data if unpacker.eof else b""
            if unpacker.eof:
                unpacker = None
    if unpacker is not None:
        raise _DamageError(f"the {kind} data end early")


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    """The file in pieces, the last one byte by byte: a wrong checksum at the end then costs no text."""
    last = file.read(_PACKED_CHUNK)
    while following := file.read(_PACKED_CHUNK):
        yield last
        last = following
    for place in range(len(last)):
        yield last[place : place + 1]


def _decode(raw: bytes) -> bytes:
    """To UTF-8 without a byte order mark.

    Latin-1 takes any byte, so it comes last. Where the beginning, header and all, is UTF-8 with more than
    ASCII in it, the rest is UTF-8 with damage rather than Latin-1: the bad bytes become U+FFFD, and the
    cells that hold them fail as numbers.
    """
    if raw.startswith(codecs.BOM_UTF8):
        raw = raw[len(codecs.BOM_UTF8) :]
    elif raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16", errors="replace").encode()
    if raw.isascii():
        return raw
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError as error:
        start = raw[: error.start]
        return raw.decode("latin-1" if start.isascii() else "utf-8", errors="replace").encode()
    return raw
