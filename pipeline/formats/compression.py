"""Decompression that takes no more memory than was agreed: a small file may declare, or hold, gigabytes."""

from __future__ import annotations

import bz2
from collections.abc import Callable, Mapping
from types import MappingProxyType

import lz4.frame
import zstandard

from pipeline.errors import one_line

MAX_CHUNK = 256 * 2**20
"""Bytes to which one chunk or message may inflate. Recorders write chunks of 1 to 64 MiB."""


class CompressionError(Exception):
    """Compressed bytes that are damaged, or hold more or less than they should."""


def inflate(method: str, data: bytes, size: int | None = None) -> bytes:
    """Decompress one chunk.

    Parameters
    ----------
    method : str
        "zstd", "lz4" or "bz2"; "" and "none" for bytes that are not compressed.
    data : bytes
        The chunk as recorded.
    size : int or None
        How many bytes it should hold; None where the recording does not say.

    Raises
    ------
    CompressionError
        If the method is unknown, the bytes are damaged, or they hold not ``size`` or over `MAX_CHUNK` bytes.
    """
    if method not in _METHODS:
        raise CompressionError(f"its compression {method!r} is not known here")
    if size is not None and size > MAX_CHUNK:
        raise CompressionError(f"it declares {size} bytes, over the limit of {MAX_CHUNK}")
    limit = MAX_CHUNK if size is None else size
    try:
        inflated = _METHODS[method](data, limit + 1)
    except (zstandard.ZstdError, RuntimeError, OSError, ValueError, EOFError) as error:
        raise CompressionError(f"its compressed bytes are damaged ({one_line(str(error))[:80]})") from error
    if len(inflated) > limit or (size is not None and len(inflated) < size):
        raise CompressionError(f"it does not hold the {limit} bytes that it should")
    return inflated


def _zstd(data: bytes, limit: int) -> bytes:
    if not data:
        return b""
    with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as reader:
        return bytes(reader.read(limit))


def _lz4(data: bytes, limit: int) -> bytes:
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit)) if data else b""


def _bz2(data: bytes, limit: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, max_length=limit)


_METHODS: Mapping[str, Callable[[bytes, int], bytes]] = MappingProxyType(
    {"": lambda data, limit: data[:limit], "none": lambda data, limit: data[:limit],
     "zstd": _zstd, "lz4": _lz4, "bz2": _bz2}
)  # fmt: skip
