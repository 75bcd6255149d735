"""Options of the simulators: numbers with their units, spans of time, faults of stamps and transport."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.errors import ExitCode, GyrostandError

if TYPE_CHECKING:
    from pipeline.simulate.imperfections import TimingErrors

RecordingPath = Annotated[
    Path,
    typer.Argument(
        help="The recording; the suffix says its format: .mcap, .bag, .csv, none for a ROS 2 bag (db3).",
        show_default=False,
    ),
]
SampleJitter = Annotated[float, typer.Option(help="1 sigma of the sampling instants, s.")]
StampNoise = Annotated[float, typer.Option(help="1 sigma of the stamps, s.")]
Gap = Annotated[list[str] | None, typer.Option(help="Lost samples, START:LENGTH in s; repeatable.")]
NanBurst = Annotated[list[str] | None, typer.Option(help="NaN samples, START:LENGTH in s; repeatable.")]
BackwardStamp = Annotated[list[float] | None, typer.Option(help="A stamp that goes back, at s.")]
RepeatedSample = Annotated[list[float] | None, typer.Option(help="A sample recorded twice, at s.")]
LogDelay = Annotated[float, typer.Option(help="Of the recorder's clock behind the stamps, s.")]
LogJitter = Annotated[float, typer.Option(help="1 sigma of the recorder's delay, s.")]
Seed = Annotated[int, typer.Option(min=0, help="Of all that is random.")]


_GLUED = re.compile(r"[-+]?\d[\d.]*(?:[eE][-+]?\d+)?(?P<unit>\D.*)")
"""A number and its unit without a blank between."""


class Output(StrEnum):
    """What the gyro gives."""

    ANGULAR_RATE = "angular_rate"
    ANGLE_INCREMENT = "angle_increment"


class Table(StrEnum):
    """What is recorded of a table."""

    TABLE_ANGLE = "table_angle"
    TABLE_RATE = "table_rate"


class AngleUnit(StrEnum):
    """Unit of recorded angles and of those in rates."""

    RAD = "rad"
    DEG = "deg"


class OptionError(GyrostandError):
    """An option's value is not what it should be."""

    exit_code = ExitCode.USAGE


def quantity(option: str, text: str, dimension: str) -> float:
    """A number with its unit, such as ``1 deg``, in SI and radians."""
    (value,) = numbers(option, text, dimension, 1)
    return value


def angle(option: str, text: str, least: float, most: float) -> float:
    """An angle with its unit, such as ``55.75 deg``, in radians; its range is given in degrees."""
    value = quantity(option, text, "angle")
    if not math.radians(least) <= value <= math.radians(most):
        raise OptionError(
            option,
            expected=f"an angle from {least:g} to {most:g} deg",
            found=repr(text),
            remedy="choose another value",
        )
    return value


def pair(option: str, text: str, dimension: str) -> tuple[float, float]:
    """Two numbers that share a unit."""
    first, second = numbers(option, text, dimension, 2)
    return first, second


def triple(option: str, text: str, dimension: str) -> tuple[float, float, float]:
    """Three numbers that share a unit."""
    first, second, third = numbers(option, text, dimension, 3)
    return first, second, third


def numbers(option: str, text: str, dimension: str, count: int) -> list[float]:
    """Numbers that share a unit, such as ``1e-4 0 0 rad/s``, in SI and radians.

    Parameters
    ----------
    option : str
        For the error.
    text : str
        What was given.
    dimension : str
        Of the unit, see `pipeline.units`.
    count : int
        How many numbers.

    Raises
    ------
    OptionError
        If the text is not so.
    """
    from pipeline import units

    *given, unit = text.split() or [""]
    factor = units.factor(unit, dimension)
    values = _floats(given)
    if factor is None or len(values) != count:
        remedy = units.nearest(unit, dimension) if factor is None else "give the numbers before the unit"
        glued = _GLUED.fullmatch(unit)
        if glued is not None and units.factor(glued["unit"], dimension) is not None:
            remedy = "leave a blank between the number and the unit"
        raise OptionError(
            option,
            expected=f"{count} number{'s' * (count > 1)} and a unit of {dimension}",
            found=repr(text),
            remedy=remedy,
        )
    return [value * factor for value in values]


def _floats(texts: list[str]) -> list[float]:
    """The numbers, or none where one is no number."""
    try:
        return [float(text) for text in texts]
    except ValueError:
        return []


def only_with(needed: str, given: object, **options: bool) -> None:
    """Refuse options that were given though what they are about is not there.

    Parameters
    ----------
    needed : str
        The option that says it is.
    given : object
        Its value; None where it was not given.
    **options : bool
        Name of each option, with ``_`` for ``-``, and whether it was given.
    """
    for name, there in options.items():
        if there and given is None:
            raise OptionError(
                f"--{name.replace('_', '-')}",
                expected=f"{needed}, without which it says nothing",
                found=f"no {needed}",
                remedy=f"give {needed}, or leave it out",
            )


def span(option: str, text: str) -> tuple[float, float]:
    """``START:LENGTH`` in seconds."""
    start, _, length = text.partition(":")
    try:
        return float(start), float(length)
    except ValueError:
        raise OptionError(
            option, expected="START:LENGTH in seconds", found=repr(text), remedy="for example 0.5:0.02"
        ) from None


def timing_errors(
    gap: Sequence[str] | None,
    nan_burst: Sequence[str] | None,
    backward_stamp: Sequence[float] | None,
    repeated_sample: Sequence[float] | None,
    log_delay: float,
    log_jitter: float,
    *,
    stamp_noise: float,
    sample_jitter: float = 0.0,
    clock_offset: float = 0.0,
) -> TimingErrors:
    """What is wrong with stamps and transport, from the options that every simulator has."""
    from pipeline.simulate.imperfections import TimingErrors

    return TimingErrors(
        sample_jitter=sample_jitter,
        stamp_noise=stamp_noise,
        clock_offset=clock_offset,
        gaps=[span("--gap", text) for text in gap or ()],
        nan_bursts=[span("--nan-burst", text) for text in nan_burst or ()],
        backward_stamps=backward_stamp or (),
        repeated_samples=repeated_sample or (),
        log_delay=log_delay,
        log_jitter=log_jitter,
    )
