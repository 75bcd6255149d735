"""The one-line error that every boundary of the pipeline raises, and the exit codes.

Each boundary (formats, contracts, test plan, stages, storage) has one subclass. A message says where,
what was expected, what was found and what to do, in one line, so that a log or a CI job can quote it.
"""

from __future__ import annotations

from enum import IntEnum


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
        line = f"{where}: expected {expected}, found {found}; {remedy}"
        # Names from a recording are hostile: a line break or an escape sequence must not reach a terminal.
        super().__init__("".join(c if c.isprintable() else "?" for c in " ".join(line.split())))
