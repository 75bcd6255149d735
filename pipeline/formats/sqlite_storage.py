"""The SQLite storage of ROS 2 bags (.db3).

SQLite keeps no checksums: damage within a payload that leaves its length is not found out.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from pipeline.errors import one_line
from pipeline.formats.base import Loss
from pipeline.formats.messages import Channel, Channels, Message
from pipeline.formats.payload import Schema
from pipeline.formats.ros_types import HUMBLE

MAGIC = b"SQLite format 3\0"
_HEADER = struct.Struct(">16xH6xII60xI")
"""Page size, change counter, pages, and the change counter for which that number of pages is valid."""
_JOURNALS = ("-wal", "-journal")
_LEAST_LIMIT = 2**20


class SqliteSource:
    """The messages of one .db3 file, in the order in which they were stored.

    Parameters
    ----------
    path : Path
        The file. A journal beside it, which a recorder leaves that did not close it, is applied to a copy.
    channels : Channels, optional
        Where the channels go; those of the bag that the file is a part of.
    serialisations : mapping of topic to str, optional
        What metadata.yaml says of a topic's serialisation, which goes before what the file says.
    """

    publishes = False

    def __init__(
        self,
        path: Path,
        channels: Channels | None = None,
        serialisations: Mapping[str, str] | None = None,
    ) -> None:
        self.channels = channels if channels is not None else Channels()
        self.losses: list[Loss] = []
        self._path = path
        self._serialisations = serialisations or {}
        self._damaged: Counter[str] = Counter()

    def messages(self) -> Iterator[Message]:
        """Every message in the order of its row."""
        found = 0
        self._measure()
        try:
            with self._database() as database:
                topics = self._topics(database)
                rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY rowid")
                for number, time, data in rows:
                    found += 1
                    channel = topics.get(number)
                    if channel is None or not isinstance(time, int) or not isinstance(data, bytes):
                        self._damaged[channel.topic if channel else ""] += 1
                    else:
                        yield channel, time, time, data
        except sqlite3.DatabaseError as error:
            detail = f"{self._path.name!r} is damaged behind {found} messages ({one_line(str(error))[:80]})"
            self.losses.append(Loss("", detail, self._left(found), "messages"))
        for topic, count in self._damaged.items():
            self.losses.append(Loss(topic, "rows are damaged", count, "messages"))

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        journals = [Path(f"{self._path}{end}") for end in _JOURNALS]
        journals = [journal for journal in journals if journal.is_file() and journal.stat().st_size]
        if not journals:
            uri = self._path.resolve().as_uri() + "?mode=ro&immutable=1"
            with closing(self._open(uri)) as database:
                yield database
            return
        with TemporaryDirectory() as folder:
            for file in (self._path, *journals):
                shutil.copyfile(file, Path(folder) / file.name)
            with closing(self._open((Path(folder) / self._path.name).as_uri())) as database:
                yield database

    def _open(self, uri: str) -> sqlite3.Connection:
        database = sqlite3.connect(uri, uri=True)
        database.text_factory = lambda text: text.decode(errors="backslashreplace")
        # No value can be longer than the file; a view could make one (rule 6 of `base`).
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(self._path.stat().st_size, _LEAST_LIMIT))
        database.execute("PRAGMA trusted_schema = OFF")
        # Nothing is written: this lets SQLite open a file that is shorter than its header says.
        database.execute("PRAGMA writable_schema = ON")
        return database

    def _measure(self) -> None:
        """Compare the file's size with what its header says."""
        size = self._path.stat().st_size
        with self._path.open("rb") as file:
            header = file.read(_HEADER.size)
        if len(header) < _HEADER.size:
            return
        page, changes, pages, valid_for = _HEADER.unpack(header)
        missing = pages * (2**16 if page == 1 else page) - size
        if changes == valid_for and missing > 0:
            self.losses.append(Loss("", f"{self._path.name!r} is cut short", missing, "bytes"))

    def _topics(self, database: sqlite3.Connection) -> dict[int, Channel]:
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise sqlite3.DatabaseError("it has not the tables of a ROS 2 bag")
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in tables:
            columns = "topic_type, encoding, encoded_message_definition"
            for name, encoding, text in database.execute(f"SELECT {columns} FROM message_definitions"):
                definitions[str(name)] = (str(encoding), str(text))
        topics = {}
        columns = "id, name, type, serialization_format"
        for number, topic, type_, serialisation in database.execute(
            f"SELECT {columns} FROM topics ORDER BY id"
        ):
            encoding, text = definitions.get(str(type_), (HUMBLE, ""))
            form = self._serialisations.get(str(topic), str(serialisation))
            schema = Schema(form, encoding, str(type_), text.encode(errors="replace"))
            topics[number] = self.channels.get(str(topic), schema)
        return topics

    def _left(self, found: int) -> int:
        """How many messages the damaged file should still hold, as far as its index can tell."""
        try:
            with self._database() as database:
                (count,) = database.execute("SELECT count(*) FROM messages").fetchone()
        except sqlite3.DatabaseError:
            return 0
        return max(int(count) - found, 0)
