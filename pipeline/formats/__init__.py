"""Recordings: one door to every container.

`inspect` says what a recording holds, `read` gives requested topics as Arrow tables, `write` makes one.
A new container is one module with the names of `pipeline.formats.base.Container` and one line in
`CONTAINERS`; a new serialisation is one module with the names of `pipeline.formats.payload.Payload` and
one line in `pipeline.formats.messages.payload_of`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from pipeline.errors import ExitCode, writing
from pipeline.formats import mcap, rosbag1, rosbag2, text
from pipeline.formats.base import Container, Inspection, RecordingError, Request, Samples, Series, TextLayout

CONTAINERS: tuple[Container, ...] = (mcap, rosbag1, rosbag2, text)
"""Every container, in the order in which they are asked whether they recognise a file."""

Encoding = Literal["cdr", "ros1", "json", "protobuf"]
"""The serialisations that `write` can put into an MCAP file."""

_HEAD = 16

_NEVER_TEXT = frozenset((".mcap", ".bag", ".db3"))
"""Names that promise one of the other containers: a text of that name is no recording of that name."""


def detect(path: str | os.PathLike[str]) -> Container:
    """Find the container that recognises a recording by its first bytes.

    Raises
    ------
    RecordingError
        If there is no such file, it is empty or unreadable, or no container recognises it; or it is text
        under the name of another container.
    """
    path = Path(path)
    try:
        if path.is_dir():
            head = b""
        else:
            with path.open("rb") as file:
                head = file.read(_HEAD)
            if not head:
                raise _error(path, "a recording", "an empty file", "record again, or leave the file out")
        container = next((c for c in CONTAINERS if c.recognises(path)), None)
    except OSError as error:
        raise _unreadable(path, error) from error
    if container is text and path.suffix.lower() in _NEVER_TEXT:
        remedy = "check how it was saved; the name of a text recording ends in .csv, .tsv or .txt"
        raise _error(path, f"a binary recording, as {path.suffix} says", "text", remedy)
    if container is not None:
        return container
    if path.is_dir():
        raise _not_a_bag(path)
    known = ", ".join(c.FORMAT for c in CONTAINERS)
    raise _error(path, f"one of {known}", f"the first bytes {head!r}", "convert it to one of these formats")


def inspect(path: str | os.PathLike[str], layout: TextLayout | None = None) -> Inspection:
    """Topics, types, counts, clocks and losses of a recording.

    Parameters
    ----------
    path : path
        A file, or the folder of a ROS 2 bag.
    layout : TextLayout, optional
        How a text file is laid out, where it should not be found out by itself.
    """
    container = detect(path)
    try:
        return container.inspect(Path(path), layout or TextLayout())
    except OSError as error:
        raise _unreadable(Path(path), error) from error


def read(
    path: str | os.PathLike[str], requests: Sequence[Request], layout: TextLayout | None = None
) -> Samples:
    """Read the requested fields of a recording as Arrow tables (rules 3 to 5 of `base`).

    Raises
    ------
    RecordingError
        With exit code 2 for a topic or a field that the recording does not hold, 3 where it is unreadable.
    """
    container = detect(path)
    try:
        return container.read(Path(path), requests, layout or TextLayout())
    except OSError as error:
        raise _unreadable(Path(path), error) from error


def write(path: str | os.PathLike[str], series: Sequence[Series], encoding: Encoding = "cdr") -> None:
    """Write series as a recording, in the format that the name's end asks for.

    Parameters
    ----------
    path : path
        ``….mcap``, ``….bag`` (ROS 1) or a text file's name; a name without a suffix becomes the folder of a
        ROS 2 bag. A file is replaced, whole or not at all; a folder must not exist.
    series : sequence of Series
        One a topic.
    encoding : {"cdr", "ros1", "json", "protobuf"}, optional
        Serialisation within MCAP; the other formats have only their own.
    """
    path = Path(path)
    container = _container_for(path)
    if encoding != "cdr" and container is not mcap:
        raise _usage(path, "MCAP for that encoding", repr(encoding), "name the file ….mcap")
    if path.is_dir():
        raise _usage(path, "a name that is free", "a folder", "choose another name or remove it")
    with (
        writing(path, RecordingError),
        TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder,
    ):
        draft = Path(folder) / path.name
        if container is mcap:
            mcap.write(draft, series, encoding)
        else:
            container.write(draft, series)
        os.replace(draft, path)


def _container_for(path: Path) -> Container:
    suffix = path.suffix.lower()
    if suffix in (".gz", ".zst"):
        return text
    named = {c.SUFFIX: c for c in CONTAINERS} | {".tsv": text, ".txt": text, "": rosbag2}
    if suffix not in named:
        known = ", ".join(name or "no suffix (a ROS 2 bag)" for name in named)
        raise _usage(path, f"a name that ends in one of {known}", repr(path.suffix), "rename the recording")
    return named[suffix]


def _error(path: Path, expected: str, found: str, remedy: str) -> RecordingError:
    return RecordingError(str(path), expected=expected, found=found, remedy=remedy)


def _usage(path: Path, expected: str, found: str, remedy: str) -> RecordingError:
    return RecordingError(str(path), expected=expected, found=found, remedy=remedy, exit_code=ExitCode.USAGE)


def _unreadable(path: Path, error: OSError) -> RecordingError:
    if isinstance(error, FileNotFoundError):
        return _error(path, "a recording", "no such file or folder", "check the name")
    return _error(path, "a readable recording", error.strerror or str(error), "check the file and its rights")


def _not_a_bag(folder: Path) -> RecordingError:
    inside = sorted(p.name for p in folder.iterdir() if p.suffix in (".mcap", ".db3", ".bag"))
    found = f"{len(inside)} recordings without one, such as {inside[0]!r}" if inside else "none"
    remedy = "name one of the files" if inside else "name a recording or a ROS 2 bag's folder"
    return _error(folder, "a folder with metadata.yaml (a ROS 2 bag)", found, remedy)
