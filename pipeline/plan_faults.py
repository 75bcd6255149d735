"""How a section of a test plan refuses what it cannot accept, with the key at which the fault lies.

A pydantic validator raises what it finds by `refuse`; `pipeline.testplan` adds file and line. For a fault
of the whole section a plain ``ValueError("what is expected; found what is there")`` does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, NoReturn

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

FAULT = "plan_fault"
"""Type of the errors made here; their context has what `Fault` has."""


class Fault(NamedTuple):
    """What is wrong; the key is given from the section that is checked, () for the section itself."""

    key: tuple[str | int, ...]
    expected: str
    found: str
    remedy: str


def refuse(faults: Sequence[Fault]) -> NoReturn:
    """Raise all faults as one pydantic error, each at its key."""
    raise ValidationError.from_exception_data(
        "test plan",
        [
            InitErrorDetails(
                type=PydanticCustomError(
                    FAULT,
                    "expected {expected}, found {found}; {remedy}",
                    {"expected": fault.expected, "found": fault.found, "remedy": fault.remedy},
                ),
                loc=fault.key,
                input=None,
            )
            for fault in faults
        ],
    )
