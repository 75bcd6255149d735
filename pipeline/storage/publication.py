"""Where the tables of a recording are, and how they come to be there whole or not at all.

Layout: ``<out>/<table>/recording=<id>/part-0.parquet``, so that a table of all recordings is one folder to
pandas, polars and DuckDB. The rules:

1. A run first writes all its tables to ``<out>/.publishing/<id>/``, checked and on the disk; what was
   published before stands. That folder is not beside the tables, because polars and DuckDB read hidden files
   too: a file being written there breaks their reading of the table.
2. Then it removes the recording's provenance and the tables that it does not have itself, renames each of
   its tables into its place, and its provenance last.
3. So a recording is *finished* exactly if it has provenance, and then every table is the one that its
   provenance names, by row count and SHA-256. `recordings`, `read` and `load` know finished recordings only.
4. A run that fails leaves everything as it was; one that is killed leaves that, or an unfinished recording.
   The next run of the recording clears up after it. A lock, which the kernel frees when its holder dies,
   keeps two runs of one recording apart; runs of different recordings share no file.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from pipeline.contracts import Contract, ContractError, contract
from pipeline.errors import ExitCode, GyrostandError
from pipeline.storage import parquet
from pipeline.storage.contract_check import schema_violations, violations
from pipeline.storage.naming import LONGEST, is_safe
from pipeline.storage.parquet import Published, StorageError

if TYPE_CHECKING:
    import pandas as pd

PROVENANCE = "provenance"
PARTITION = "recording="
PART = "part-0.parquet"
_PUBLISHING = ".publishing"


def table_file(out: str | os.PathLike[str], recording_id: str, table: str) -> Path:
    """The file of a table of a recording, whether it exists or not.

    Raises
    ------
    StorageError
        If the id is not a safe one, as `recording_id` makes them (exit code 2).
    """
    if not is_safe(recording_id):
        raise StorageError(
            f"recording id {recording_id!r}",
            expected=f"a letter, then at most {LONGEST - 1} of A-Z a-z 0-9 . _ -",
            found="something else",
            remedy="give an id that is safe in a path",
            exit_code=ExitCode.USAGE,
        )
    return Path(out) / table / f"{PARTITION}{recording_id}" / PART


def recordings(out: str | os.PathLike[str]) -> list[str]:
    """The ids of the finished recordings below an output folder, in alphabetical order.

    Raises
    ------
    StorageError
        If there is none (exit code 3): no input is never a pass.
    """
    folder = Path(out) / PROVENANCE
    found = sorted(p.parent.name.removeprefix(PARTITION) for p in folder.glob(f"{PARTITION}*/{PART}"))
    if not found:
        raise StorageError(
            repr(str(out)),
            expected="an output folder with at least one finished recording",
            found="none" if Path(out).is_dir() else "no such folder",
            remedy="name the folder that was given to 'gyrostand run --out'",
            exit_code=ExitCode.INPUT,
        )
    return found


def published(out: str | os.PathLike[str], recording_id: str) -> dict[str, Published]:
    """What the provenance of a recording names: rows and SHA-256 of each table's file.

    Raises
    ------
    StorageError
        If the recording is not finished (exit code 3) or its provenance is damaged (exit code 1).
    """
    return _named(read(out, recording_id, PROVENANCE), table_file(out, recording_id, PROVENANCE))


def read(out: str | os.PathLike[str], recording_id: str, table: str) -> pa.Table:
    """One table of one finished recording, as published: SHA-256 and page checksums are verified.

    Raises
    ------
    StorageError
        If the recording or the table is not there (exit code 3), or the file is damaged (exit code 1).
    ContractError
        If no table has that name, or the file was written under another contract.
    """
    agreed = contract(table)
    path = table_file(out, recording_id, table)
    if table == PROVENANCE:
        _require_finished(out, recording_id)
        return _kept(agreed, path, parquet.read(path))
    named = published(out, recording_id)
    if table not in named:
        raise StorageError(
            f"recording {recording_id!r}",
            expected=f"table {table}",
            found=", ".join(sorted(named)),
            remedy="no stage of its run made that table; see its test plan",
            exit_code=ExitCode.INPUT,
        )
    return _kept(agreed, path, parquet.read(path, named[table].sha256))


def load(out: str | os.PathLike[str], table: str) -> pd.DataFrame:
    """One table of all finished recordings; see `pipeline.load`.

    ``recording`` comes first, as a category. Integers that may be null come as pandas' ``Int64``, because
    a float64 holds 1.7e18 ns only to 256 ns.
    """
    agreed = contract(table)
    names = recordings(out)
    having = [n for n in names if table == PROVENANCE or table in published(out, n)]
    if not having:
        raise StorageError(
            repr(str(out)),
            expected=f"a recording with the table {table}",
            found=f"{len(names)} finished recordings without it",
            remedy="no stage of their runs made that table; see their test plans",
            exit_code=ExitCode.INPUT,
        )
    parts = []
    for place, name in enumerate(having):
        part = read(out, name, table)
        codes = pa.repeat(pa.scalar(place, pa.int32()), part.num_rows)
        parts.append(part.add_column(0, "recording", pa.DictionaryArray.from_arrays(codes, having)))
    frame: pd.DataFrame = pa.concat_tables(parts).to_pandas()
    facts = parquet.description(agreed)
    facts["units"]["recording"] = ""
    facts["long_name"]["recording"] = "id of the recording"
    frame.attrs.update(facts)
    return frame


class Publication:
    """The one door by which a run writes the tables of a recording; made by `publication`."""

    def __init__(self, out: Path, recording_id: str, staging: Path) -> None:
        self._out = out
        self._id = recording_id
        self._staging = staging
        self._staged: dict[str, Published] = {}

    def is_current(self, identity: Mapping[str, object]) -> bool:
        """Whether the recording is finished, whole, and was made from the same.

        Parameters
        ----------
        identity : mapping
            Columns of provenance that every row must have with these values.
        """
        try:
            rows = self.read(PROVENANCE).to_pylist()
            named = published(self._out, self._id)
            whole = all(self._is_whole(table, file) for table, file in named.items())
        except GyrostandError:  # missing or damaged: made anew
            return False
        return whole and all(row[key] == value for row in rows for key, value in identity.items())

    def read(self, table: str) -> pa.Table:
        """A published table of this recording; errors as in `pipeline.storage.read`."""
        return read(self._out, self._id, table)

    def publish(self, name: str, table: pa.Table) -> Published:
        """Check a table and write it; it comes into its place with `finish`.

        Raises
        ------
        ContractError
            If the table does not keep its contract.
        StorageError
            If it cannot be written: exit code 4 where the disk is full, 2 where the folder refuses.
        """
        faults = violations(name, table)
        if faults:
            more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
            raise ContractError(
                f"recording {self._id!r}",
                expected=f"table {name} to keep its contract",
                found=f"{faults[0]}{more}",
                remedy="nothing was published",
            )
        self._staged[name] = parquet.write(self._staging / name, name, table)
        return self._staged[name]

    def finish(self, provenance: pa.Table) -> None:
        """Bring all tables into their places, and provenance, which names every one of them, last.

        Raises
        ------
        StorageError
            As in `publish`; exit code 4 if provenance does not name exactly the tables that were published.
        """
        staged = dict(self._staged)
        if _named(provenance, self._out) != staged:
            raise StorageError(
                f"recording {self._id!r}",
                expected="provenance that names the published tables: " + ", ".join(sorted(staged)),
                found="other tables, rows or SHA-256",
                remedy="report this as a fault of the runner",
                exit_code=ExitCode.FAULT,
            )
        self.publish(PROVENANCE, provenance)
        with parquet.writing(self._out):
            # Folders first: on a full disk this is the last step that can fail, and nothing is changed yet.
            for table in self._staged:
                _make_folder(self._file(table).parent)
            _remove(self._file(PROVENANCE))
            for path in self._out.glob(f"*/{PARTITION}{self._id}/{PART}"):
                if path.parent.parent.name not in staged:
                    _remove(path)
                    with suppress(OSError):  # something else is in it, of which check will speak
                        path.parent.rmdir()
            for table in (*staged, PROVENANCE):
                os.replace(self._staging / table, self._file(table))
                _sync(self._file(table).parent)

    def _file(self, table: str) -> Path:
        return table_file(self._out, self._id, table)

    def _is_whole(self, table: str, file: Published) -> bool:
        path = self._file(table)
        return path.is_file() and parquet.sha256(path) == file.sha256


@contextmanager
def publication(out: Path, recording_id: str) -> Iterator[Publication]:
    """Open the door to the tables of one recording, for one process at a time.

    Parameters
    ----------
    out : Path
        Output folder; it is made where there is none.
    recording_id : str
        As `recording_id` makes them.

    Raises
    ------
    StorageError
        If the folder cannot be written or another process is at the recording (exit code 2), or the disk
        is full (exit code 4).
    """
    table_file(out, recording_id, PROVENANCE)  # refuses an unsafe id
    folder = out / _PUBLISHING
    staging = folder / recording_id
    with parquet.writing(out):
        _make_folder(folder)
    with _lock(folder, recording_id):
        with parquet.writing(staging):
            if staging.exists():  # of a run that was killed
                shutil.rmtree(staging)
            staging.mkdir()
        try:
            yield Publication(out, recording_id, staging)
        finally:
            shutil.rmtree(staging, ignore_errors=True)  # else the next run does it


@contextmanager
def _lock(folder: Path, recording_id: str) -> Iterator[None]:
    """Hold a recording for this process.

    The lock's file begins with a point, as no id does, and stays: were it removed, two processes could each
    hold a file of that name. Its name has no capitals, so that two ids that are one to a file system without
    case exclude each other.
    """
    path = folder / f".{recording_id.lower()}.lock"
    with parquet.writing(path):
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StorageError(
                f"recording {recording_id!r}",
                expected="no other run of it into the same output folder",
                found="one at work",
                remedy="wait until it has ended",
                exit_code=ExitCode.USAGE,
            ) from error
        yield
    finally:
        os.close(handle)


def _require_finished(out: str | os.PathLike[str], recording_id: str) -> None:
    if not table_file(out, recording_id, PROVENANCE).is_file():
        raise StorageError(
            f"recording {recording_id!r} in {str(out)!r}",
            expected="a finished recording",
            found="no provenance: its run has not ended, or was killed",
            remedy="run the recording again",
            exit_code=ExitCode.INPUT,
        )


def _kept(agreed: Contract, path: Path, content: pa.Table) -> pa.Table:
    """The content of a file, if its columns are those of the contract."""
    for violation in schema_violations(agreed, content.schema):
        raise ContractError(
            repr(str(path)),
            expected=f"contract {agreed.name}, version {agreed.version}",
            found=str(violation),
            remedy="run the recording again with this version",
        )
    return content


def _named(provenance: pa.Table, path: Path) -> dict[str, Published]:
    """The files that a provenance table names; ``{"table": {"rows": n, "sha256": "…"}}`` in each row."""
    named: dict[str, Published] = {}
    for text in provenance.column("tables").to_pylist():
        try:
            named |= {t: Published(int(f["rows"]), str(f["sha256"])) for t, f in json.loads(text).items()}
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise parquet.damaged(path, "rows and sha256 of each table, as JSON", repr(text)) from error
    return named


def _make_folder(folder: Path) -> None:
    """Make a folder with its parents, and bring every new entry to the disk."""
    missing = [p for p in (folder, *folder.parents) if not p.is_dir()]
    folder.mkdir(parents=True, exist_ok=True)
    for made in missing:
        _sync(made.parent)


def _remove(path: Path) -> None:
    path.unlink(missing_ok=True)
    _sync(path.parent)


def _sync(folder: Path) -> None:
    """Bring the entries of a folder to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
