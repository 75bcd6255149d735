"""Outputs held against their contracts and their provenance: what ``gyrostand check`` does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline import contracts, storage
from pipeline.errors import ExitCode, GyrostandError
from pipeline.storage import PARTITION, PROVENANCE, Published, StorageError, parquet
from pipeline.storage.contract_check import stated, violations


def check(paths: Sequence[Path]) -> list[str]:
    """Check output folders and single Parquet files.

    Of every file: page checksums, contract, units, ranges, allowed values, rise of the time. Of a folder
    also, for each recording: that it is finished, that its files are those that its provenance names, by row
    count and SHA-256, and that no other file stands among the tables.

    Parameters
    ----------
    paths : sequence of Path
        Output folders as given to ``gyrostand run --out``, or files of tables.

    Returns
    -------
    list of str
        One line a fault; empty where everything is as it should be.

    Raises
    ------
    StorageError
        If a path does not exist, or a folder holds no recording (exit code 3).
    """
    return [fault for path in paths for fault in (_folder(path) if path.is_dir() else _file(path))]


def _folder(out: Path) -> Iterator[str]:
    tables = [f for f in sorted(out.iterdir()) if f.is_dir() and _holds_tables(f)]
    recordings = sorted({p.name.removeprefix(PARTITION) for f in tables for p in f.glob(f"{PARTITION}*")})
    if not recordings:
        raise StorageError(
            repr(str(out)),
            expected="an output folder with tables of recordings",
            found="none",
            remedy="name the folder that was given to 'gyrostand run --out'",
            exit_code=ExitCode.INPUT,
        )
    for folder in tables:
        yield from _strangers(folder)
    for recording in recordings:
        try:
            yield from _recording(out, recording)
        except GyrostandError as error:
            yield str(error)


def _holds_tables(folder: Path) -> bool:
    """Whether a folder is that of a table; pages and the like stand beside the tables."""
    return any(e.name.startswith(PARTITION) or e.suffix == ".parquet" for e in folder.iterdir())


def _strangers(folder: Path) -> Iterator[str]:
    """What does not belong in a table's folder."""
    if folder.name not in contracts.names():
        yield f"{str(folder)!r}: no table has that name"
    for entry in sorted(folder.iterdir()):
        if not (entry.is_dir() and entry.name.startswith(PARTITION)):
            yield f"{str(entry)!r}: only folders '{PARTITION}<id>' belong here"
            continue
        recording = entry.name.removeprefix(PARTITION)
        for file in sorted(entry.iterdir()):
            if file.name != storage.PART:
                yield f"{str(file)!r}: no run of recording {recording!r} wrote that"


def _recording(out: Path, recording: str) -> Iterator[str]:
    """The files of one recording, against its provenance and their contracts."""
    storage.table_file(out, recording, PROVENANCE)  # refuses an unsafe id
    try:
        named = storage.published(out, recording)
    except GyrostandError as error:  # unfinished or damaged: the tables are still held to their contracts
        yield str(error)
        named = None
    for table in contracts.names():
        path = storage.table_file(out, recording, table)
        if table == PROVENANCE:
            yield from _content(path, table) if named is not None else ()
        elif path.exists():
            if named is not None and table not in named:
                yield f"{str(path)!r}: the provenance of recording {recording!r} does not name it"
            yield from _content(path, table, (named or {}).get(table))
        elif named is not None and table in named:
            yield f"{str(path)!r}: missing, but the provenance of recording {recording!r} names it"
    for table in sorted(set(named or ()) - set(contracts.names())):
        yield f"recording {recording!r}: its provenance names {table!r}, which has no contract"


def _file(path: Path) -> Iterator[str]:
    """A single file, by the table that its metadata names."""
    try:
        with parquet.opened(path) as file:
            name = stated(file.schema_arrow.metadata or {}, parquet.METADATA_KEY).get("table")
    except GyrostandError as error:
        if error.exit_code == ExitCode.INPUT:
            raise
        yield str(error)
        return
    if name not in contracts.names():
        yield f"{str(path)!r}: its metadata names no table that has a contract, but {name!r}"
        return
    yield from _content(path, name)


def _content(path: Path, table: str, named: Published | None = None) -> Iterator[str]:
    """Bytes against provenance, then rows against the contract."""
    try:
        digest = None if named is None else named.sha256
        with parquet.opened(path, digest) as file:
            rows = file.metadata.num_rows
        if named is not None and rows != named.rows:
            yield f"{str(path)!r}: {rows} rows, but its provenance says {named.rows}"
        for violation in violations(table, path):
            yield f"{str(path)!r}: {violation}"
    except GyrostandError as error:
        yield str(error)
