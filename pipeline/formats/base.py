"""What a recording is, whatever its container, as numbered rules.

1. A container is one module of this package with the names of `Container`; `pipeline.formats` lists them.
2. A recording holds topics; a topic holds messages; a message holds numeric fields (booleans are 0 and 1),
   named by their path: ``angular_velocity.x``, ``imu[1].gyro[0]``. The two parts of a ROS stamp are ``sec``
   and ``nanosec``, in ROS 1 too. A text file is one topic, named "".
3. ``read`` gives one Arrow table a topic: the clocks that exist, as ``int64`` nanoseconds under the names
   in `CLOCKS`, then each requested field under its path, ``float64``, and each requested time field as
   ``int64`` nanoseconds. Rows stand in the order of the file. No sample is dropped, sorted or edited.
4. A message in which a requested field is absent (a JSON key, an empty text cell, a short array) has null
   there. A NaN that was recorded stays NaN.
5. What cannot be read is a `Loss`, never silence; what precedes it is returned. Nothing readable at all
   is a `RecordingError`.
6. Sizes that a file declares are bounded before memory is taken.
7. ``write`` makes a file that the container's own public reader opens.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import units
from pipeline.errors import ExitCode, GyrostandError

CLOCKS = ("header_stamp", "log_time", "publish_time")
"""The clocks a message may carry: of its sender, of the recorder, of the transport."""

_LISTED = 12
"""Names that an error lists; `inspect` shows them all."""


class RecordingError(GyrostandError):
    """A recording, a topic or a field cannot be read."""

    exit_code = ExitCode.INPUT


def begins_with(path: Path, magic: bytes) -> bool:
    """Whether a path is a file whose first bytes are these."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(magic)) == magic


def wrong_request(
    where: str, expected: str, found: str, remedy: str = "correct the test plan"
) -> RecordingError:
    """The error for what the test plan asks of a recording that cannot give it: exit code USAGE."""
    return RecordingError(where, expected=expected, found=found, remedy=remedy, exit_code=ExitCode.USAGE)


def unknown_name(where: str, kind: str, name: str, known: Iterable[str]) -> RecordingError:
    """The error for a topic, field or column that the test plan names and the recording does not hold.

    Parameters
    ----------
    where : str
        The recording, and the topic where there is one.
    kind : str
        "topic", "field" or "column".
    name : str
        What the plan says.
    known : iterable of str
        What there is; the nearest is suggested, or where none is near, the first are listed.
    """
    names = list(known)
    nearest = get_close_matches(name, names, n=1)
    guess = f"did you mean {nearest[0]!r}? " if nearest else ""
    listed = ", ".join(repr(n) for n in names[:_LISTED]) + (", …" if len(names) > _LISTED else "")
    choice = f"one of its {len(names)} {kind}s" + ("" if nearest else f": {listed}")
    return RecordingError(
        where,
        expected=choice if names else f"a {kind}",
        found=f"the {kind} {name!r} in the test plan" if names else f"no {kind} at all",
        remedy=f"{guess}see 'gyrostand inspect'",
        exit_code=ExitCode.USAGE if names else ExitCode.INPUT,
    )


@dataclass(frozen=True, slots=True)
class Field:
    """One numeric field of a topic; ``unit`` as the file states it, None where it states none."""

    path: str
    type: str
    unit: str | None = None


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic as `inspect` reports it.

    ``clocks`` maps each clock that the topic carries to its first and last time [ns], in file order.
    ``problem`` says why the topic's messages cannot be decoded, and is None where they can.
    """

    name: str
    message_type: str
    encoding: str
    count: int
    fields: tuple[Field, ...]
    clocks: Mapping[str, tuple[int, int]]
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class Loss:
    """A part of the recording that could not be read.

    ``count`` is in ``unit`` ("messages", "bytes", "lines" …); ``start`` and ``end`` are the first and the
    last log time in it [ns], None where they are not known.
    """

    topic: str
    detail: str
    count: int
    unit: str
    start: int | None = None
    end: int | None = None


@dataclass(frozen=True, slots=True)
class Inspection:
    """What a recording holds, without its samples."""

    path: Path
    format: str
    topics: tuple[Topic, ...]
    losses: tuple[Loss, ...] = ()


@dataclass(frozen=True, slots=True)
class TimeField:
    """A field that is a time: read exactly (integers or decimal text) into ``int64`` nanoseconds.

    A message's own stamp of seconds and nanoseconds is such a field too, by its path; it needs no unit.
    """

    path: str
    unit: str


def nanoseconds_a_unit(time: TimeField, where: str) -> int:
    """Nanoseconds in one unit of a time field; ``where`` is for the error.

    Raises
    ------
    RecordingError
        With exit code USAGE if the unit is none of time.
    """
    factor = units.factor(time.unit, "time")
    if factor is None:
        raise wrong_request(
            where,
            f"a unit of time for the field {time.path!r}",
            repr(time.unit),
            units.nearest(time.unit, "time"),
        )
    return round(factor * 1e9)


@dataclass(frozen=True, slots=True)
class Request:
    """What to read of one topic."""

    topic: str
    fields: tuple[str, ...]
    times: tuple[TimeField, ...] = ()


@dataclass(frozen=True, slots=True)
class TextLayout:
    """How a text file is laid out, where it should not be found out by itself (None)."""

    delimiter: str | None = None
    """One character; "whitespace" for runs of blanks."""
    decimal: str | None = None
    comment: str | None = None
    """Lines that begin with this are passed over."""
    skip_lines: int | None = None
    """Lines before the header (or before the first row where there is none)."""
    header: bool | None = None
    columns: tuple[str, ...] | None = None
    """Column names, for a file without a header."""


@dataclass(frozen=True, slots=True)
class Samples:
    """The requested topics as Arrow tables (rule 3), and what could not be read.

    ``units`` has the unit of a requested field where the file itself states one, as it stands there.
    """

    tables: Mapping[str, pa.Table]
    losses: tuple[Loss, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Series:
    """Samples to be written as one topic.

    Attributes
    ----------
    topic : str
        Topic name; a text file has none.
    message_type : str
        One of the ROS types that the writers know: ``sensor_msgs/msg/Imu``,
        ``geometry_msgs/msg/QuaternionStamped``, ``geometry_msgs/msg/Vector3Stamped``,
        ``sensor_msgs/msg/Temperature``; a text file has none.
    log_time, header_stamp : ndarray of int64, shape (n,)
        Nanoseconds.
    columns : mapping of str to ndarray of float64, shape (n,)
        By field path, ``{"angular_velocity.x": …}``; in a text file by the header, ``{"p (rad/s)": …}``.
    """

    topic: str
    message_type: str
    log_time: NDArray[np.int64]
    header_stamp: NDArray[np.int64]
    columns: Mapping[str, NDArray[np.float64]]


class Container(Protocol):
    """The shape of a container module."""

    FORMAT: str
    SUFFIX: str

    def recognises(self, path: Path) -> bool:
        """Whether the first bytes (or the folder) are this container's; never raises on bad content."""
        ...

    def inspect(self, path: Path, layout: TextLayout) -> Inspection:
        """Topics, types, counts, clocks and losses."""
        ...

    def read(self, path: Path, requests: Sequence[Request], layout: TextLayout) -> Samples:
        """The requested fields as Arrow tables."""
        ...

    def write(self, path: Path, series: Sequence[Series]) -> None:
        """Write the series as a recording."""
        ...
