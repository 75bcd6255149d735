"""Options about the axes of a gyro: which it has, what holds for one of them, and the errors of the rate.

An option holds for all axes, or, begun by ``p:``, ``q:`` or ``r:``, for one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from pipeline.cli_simulate.options import OptionError, numbers, quantity

if TYPE_CHECKING:
    from pipeline.models.random_error import Term
    from pipeline.simulate.static_settings import Axis

_DEGREE = math.pi / 180
ANGLE_RANDOM_WALK: Mapping[str, float] = MappingProxyType(
    {
        "deg/sqrt(h)": _DEGREE / 60,
        "rad/sqrt(s)": 1.0,
        "deg/sqrt(s)": _DEGREE,
        "deg/s/sqrt(Hz)": _DEGREE,
        "rad/s/sqrt(Hz)": 1.0,
    }
)
DEFAULT_WHITE = "0.01 deg/sqrt(h)"
"""Of an axis of which no noise is given: a record without any is constant at rest, as no gyro's is."""
RATE_RANDOM_WALK: Mapping[str, float] = MappingProxyType(
    {"deg/h/sqrt(h)": _DEGREE / 3600 / 60, "deg/s/sqrt(s)": _DEGREE, "rad/s/sqrt(s)": 1.0}
)
RAMP: Mapping[str, float] = MappingProxyType(
    {"deg/h/h": _DEGREE / 3600**2, "deg/s/s": _DEGREE, "rad/s/s": 1.0}
)
_ONE_AXIS = re.compile(r"\s*(\w+)\s*:(.*)")


def known_axes(text: str) -> tuple[Axis, ...]:
    """The axes that ``--axes`` names, in their order."""
    from pipeline.simulate.static_settings import AXES

    words = text.replace(",", " ").split()
    if not words or set(words) - set(AXES):
        raise OptionError(
            "--axes", expected=f"some of {', '.join(AXES)}", found=repr(text), remedy="for example 'p q'"
        )
    return tuple(axis for axis in AXES if axis in words)


def of_axis(axis: Axis, known: Sequence[Axis], option: str, texts: Sequence[str] | None) -> Iterator[str]:
    """What an option says of an axis."""
    for text in texts or ():
        match = _ONE_AXIS.fullmatch(text)
        if match is None:
            yield text
        elif match[1] not in known:
            raise OptionError(
                option,
                expected=f"one of the axes {', '.join(known)} before the colon",
                found=repr(match[1]),
                remedy="correct it, or add it to --axes",
            )
        elif match[1] == axis:
            yield match[2].strip()


def coefficient(option: str, text: str, factors: Mapping[str, float], *, signed: bool = False) -> float:
    """A number with one of these units, in SI; 0 where nothing is said."""
    if not text:
        return 0.0
    number, _, unit = text.strip().partition(" ")
    unit = unit.replace(" ", "").replace("°", "deg").replace("√h", "sqrt(h)").replace("√s", "sqrt(s)")
    try:
        value = float(number) * factors[unit]
        if value < 0 and not signed:
            raise ValueError
        return value
    except (ValueError, KeyError):
        raise OptionError(
            option,
            expected=f"a number{'' if signed else ' of at least 0'} and a unit of {', '.join(factors)}",
            found=repr(text),
            remedy=f"for example '0.1 {next(iter(factors))}'",
        ) from None


def noise_term(option: str, text: str) -> Term:
    """``SIGMA UNIT, MU [LAMBDA] UNIT`` as a term."""
    from pipeline.models.random_error import Noise1, Noise2, Noise3

    sigma, comma, rest = (part.strip() for part in text.partition(","))
    if not comma:
        example = "2 deg/h, 0.01 rad/s" if option == "--noise1" else "2 deg/h, 0.01 0.05 rad/s"
        raise OptionError(
            option,
            expected=f"sigma with its unit, a comma, then mu{'' if option == '--noise1' else ' and lambda'} "
            "with a unit of angular rate",
            found=repr(text),
            remedy=f"for example '{example}'",
        )
    size = quantity(option, sigma, "angular rate")
    if option == "--noise1":
        return Noise1(size, quantity(option, rest, "angular rate"))
    mu, lambda_ = numbers(option, rest, "angular rate", 2)
    return (Noise2 if option == "--noise2" else Noise3)(size, mu, lambda_)
