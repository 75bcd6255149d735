"""ROS 2 bags: the folder with metadata.yaml, its storage in SQLite (.db3) or MCAP, or a bare .db3 file.

The files of a split bag are read one after the other. A bare .mcap file is `pipeline.formats.mcap`'s.
"""

from __future__ import annotations

import errno
import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import zstandard
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pipeline.errors import ExitCode, one_line
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
from pipeline.formats.mcap import McapSource
from pipeline.formats.messages import Channel, Channels, Message, Source, inspect_source, read_source
from pipeline.formats.sqlite_storage import MAGIC, SqliteSource

FORMAT = "ROS 2 bag"
SUFFIX = ""

_METADATA = "metadata.yaml"
_MAX_METADATA = 64 * 2**20
_MAX_RATIO = 1000
"""A compressed file may inflate so far on the disk; recordings of sensors reach 2 to 20."""
_SLACK = 2**20


def recognises(path: Path) -> bool:
    """Whether it is a folder with metadata.yaml, or an SQLite file."""
    return (path / _METADATA).is_file() if path.is_dir() else begins_with(path, MAGIC)


def inspect(path: Path, layout: TextLayout) -> Inspection:  # noqa: ARG001 - shape of a container
    """Topics, types, counts, clocks and losses."""
    return inspect_source(path, FORMAT, _source(path))


def read(path: Path, requests: Sequence[Request], layout: TextLayout) -> Samples:  # noqa: ARG001
    """The requested fields as Arrow tables."""
    return read_source(path, _source(path), requests)


def write(path: Path, series: Sequence[Series]) -> None:
    """Write the series as a folder with SQLite storage, messages in the order of their log time."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    from pipeline.formats.ros_messages import encode, in_time_order

    if set("?#%") & set(str(path)):  # the name becomes an SQLite URI
        raise RecordingError(
            str(path),
            expected="a name without ?, # and %",
            found="one of them",
            remedy="choose another name",
            exit_code=ExitCode.USAGE,
        )
    topics = [encode(one, "cdr") for one in series]
    store = get_typestore(Stores.ROS2_HUMBLE)
    try:
        with Writer(path, version=8) as writer:
            connections = [
                writer.add_connection(
                    one.topic,
                    one.message_type,
                    msgdef=topic.schema.data.decode(),
                    rihs01=store.hash_rihs01(one.message_type),
                )
                for one, topic in zip(series, topics, strict=True)
            ]
            for number, index, time in in_time_order(series):
                writer.write(connections[number], time, topics[number].messages[index])
    except sqlite3.OperationalError as error:
        full = error.sqlite_errorcode == sqlite3.SQLITE_FULL
        raise OSError(errno.ENOSPC if full else errno.EIO, str(error)) from error


def _source(path: Path) -> Source:
    return FolderSource(path) if path.is_dir() else SqliteSource(path)


@dataclass(frozen=True, slots=True)
class _Metadata:
    """What metadata.yaml says of the storage."""

    storage: str
    files: tuple[str, ...]
    compression_mode: str
    counts: Mapping[str, int] = field(default_factory=dict)
    serialisations: Mapping[str, str] = field(default_factory=dict)


class FolderSource:
    """The messages of a bag's folder."""

    def __init__(self, path: Path) -> None:
        self.channels = Channels()
        self.losses: list[Loss] = []
        self._path = path
        self._metadata = _read_metadata(path / _METADATA)
        self.publishes = self._metadata.storage == "mcap"

    def messages(self) -> Iterator[Message]:
        """Every message, file by file."""
        account = Account[str](self.losses, str)
        for name in self._metadata.files:
            if not (self._path / name).is_file():
                self.losses.append(Loss("", f"the bag's file {name!r} is missing", 0, "messages"))
                continue
            with self._inflated(self._path / name) as file:
                yield from self._file(file, account)
        account.close(self._metadata.counts, _METADATA)

    def _file(self, path: Path, account: Account[str]) -> Iterator[Message]:
        source: Source
        if self._metadata.storage == "mcap":
            source = McapSource(path, self.channels)
        else:
            source = SqliteSource(path, self.channels, self._metadata.serialisations)
        damaged: Counter[Channel] = Counter()
        for message in source.messages():
            account.found(message[0].topic)
            if self._metadata.compression_mode != "message":
                yield message
                continue
            channel, log_time, publish_time, data = message
            try:
                yield channel, log_time, publish_time, inflate("zstd", bytes(data))
            except CompressionError:
                damaged[channel] += 1
        self.losses += source.losses
        for channel, count in damaged.items():
            self.losses.append(Loss(channel.topic, "messages cannot be decompressed", count, "messages"))

    @contextmanager
    def _inflated(self, path: Path) -> Iterator[Path]:
        """The file, decompressed into a temporary folder where the bag is compressed by file."""
        if self._metadata.compression_mode != "file":
            yield path
            return
        size = path.stat().st_size
        with TemporaryDirectory() as folder:
            copy = Path(folder) / path.stem
            try:
                _decompress(path, copy, limit=size * _MAX_RATIO + _SLACK)
            except (zstandard.ZstdError, CompressionError) as error:
                detail = (
                    f"the bag's file {path.name!r} cannot be decompressed to its end: {one_line(str(error))}"
                )
                self.losses.append(Loss("", detail, size, "bytes"))
            yield copy


def _decompress(packed: Path, plain: Path, limit: int) -> None:
    with packed.open("rb") as source, plain.open("wb") as target:
        for part in zstandard.ZstdDecompressor().read_to_iter(source):
            target.write(part)
            if target.tell() > limit:
                raise CompressionError(f"it inflates beyond {limit} bytes")


def _read_metadata(path: Path) -> _Metadata:
    def refused(found: str) -> RecordingError:
        return RecordingError(
            str(path),
            expected="the metadata of a ROS 2 bag",
            found=found,
            remedy="rebuild it with 'ros2 bag reindex'",
        )

    if path.stat().st_size > _MAX_METADATA:
        raise refused(f"a file of {path.stat().st_size} bytes")
    try:
        document: Any = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
        about = document["rosbag2_bagfile_information"]
        topics = about["topics_with_message_count"]
        metadata = _Metadata(
            storage=str(about["storage_identifier"]),
            files=tuple(PurePosixPath(str(name)).name for name in about["relative_file_paths"]),
            compression_mode=str(about.get("compression_mode") or "").lower(),
            counts={str(t["topic_metadata"]["name"]): int(t["message_count"]) for t in topics},
            serialisations={
                str(t["topic_metadata"]["name"]): str(t["topic_metadata"]["serialization_format"])
                for t in topics
            },
        )
    except YAMLError as error:
        raise refused(f"no YAML ({one_line(str(error))[:80]})") from error
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise refused(
            f"one without its keys ({type(error).__name__}: {one_line(str(error))[:80]})"
        ) from error
    if metadata.storage not in ("sqlite3", "mcap"):
        raise refused(f"the storage {metadata.storage!r}, where sqlite3 and mcap are known")
    form = about.get("compression_format") or "zstd"
    if metadata.compression_mode not in ("", "none", "file", "message") or form != "zstd":
        raise refused(f"compression {form!r} by {metadata.compression_mode!r}, where zstd is known")
    return metadata
