"""The one-line error that every boundary of the pipeline raises, and the exit codes.

Each boundary (formats, contracts, test plan, stages, storage) has one subclass. A message says where,
what was expected, what was found and what to do, in one line, so that a log or a CI job can quote it.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum

_MACHINE_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EMFILE, errno.ENOMEM)


class ExitCode(IntEnum):
    """What the process tells the shell."""

    PASS = 0
    """Everything asked for was done, and every limit is met."""
    NOT_MET = 1
    """A limit or a contract is not met."""
    USAGE = 2
    """The command line or the test plan is wrong."""
    INPUT = 3
    """A recording is missing, unreadable or empty."""
    FAULT = 4
    """The fault is ours, or the machine's."""


def one_line(text: str) -> str:
    """A text in one printable line: names from a recording are hostile, and a terminal obeys them."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


class GyrostandError(Exception):
    """A fault that the user can read in one line.

    Parameters
    ----------
    where : str
        File, line, key, topic, table or row.
    expected, found : str
        What should be there, and what is.
    remedy : str
        What to do about it.
    exit_code : ExitCode, optional
        Overrides the class's own.
    """

    exit_code: ExitCode = ExitCode.FAULT

    def __init__(
        self,
        where: str,
        *,
        expected: str,
        found: str,
        remedy: str,
        exit_code: ExitCode | None = None,
    ) -> None:
        self.where = where
        self.expected = expected
        self.found = found
        self.remedy = remedy
        if exit_code is not None:
            self.exit_code = exit_code
        super().__init__(one_line(f"{where}: expected {expected}, found {found}; {remedy}"))


@contextmanager
def writing(path: str | os.PathLike[str], kind: type[GyrostandError]) -> Iterator[None]:
    """Turn the operating system's refusal to write at a path into an error of the boundary's own kind.

    Raises
    ------
    GyrostandError
        Of that kind; with exit code FAULT where the machine has no room, else USAGE.
    """
    try:
        yield
    except OSError as error:
        machine = error.errno in _MACHINE_FAULTS
        raise kind(
            repr(os.fspath(path)),
            expected="room to write" if machine else "a folder that can be written",
            found=os.strerror(error.errno) if error.errno else str(error),
            remedy="what was published before is untouched; "
            + ("make room and run again" if machine else "name another output folder"),
            exit_code=ExitCode.FAULT if machine else ExitCode.USAGE,
        ) from error
