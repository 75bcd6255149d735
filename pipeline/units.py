"""Units that a test plan or a column header may state, and their factors to SI and radians."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from difflib import get_close_matches
from types import MappingProxyType

_DEGREE = math.pi / 180
_ANGLE = {
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "deg": _DEGREE,
    "mdeg": _DEGREE / 1000,
    "arcmin": _DEGREE / 60,
    "arcsec": _DEGREE / 3600,
    "rev": 2 * math.pi,
}
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}

FACTORS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "angle": _ANGLE,
        "angular rate": {
            **{
                f"{angle}/{time}": _ANGLE[angle] / _TIME[time]
                for angle in _ANGLE
                for time in ("s", "min", "h")
            },
            "rpm": 2 * math.pi / 60,
        },
        "time": _TIME,
        "pure number": {"1": 1.0},
        "temperature": {"K": 1.0, "degC": 1.0, "degF": 5 / 9},
    }
)
"""Factor to SI and radians of each unit, by dimension."""

_ZEROS: Mapping[str, float] = MappingProxyType({"degC": 273.15, "degF": 459.67 * 5 / 9})
"""The zero of a unit in SI, where it is not that of SI."""

_ALIASES = {
    "°": "deg", "º": "deg", "degree": "deg", "degrees": "deg", "dps": "deg/s", "mdps": "mdeg/s",
    "radian": "rad", "radians": "rad", "µrad": "urad", "μrad": "urad", "µs": "us", "μs": "us",
    "″": "arcsec", '"': "arcsec", "′": "arcmin", "'": "arcmin", "sec": "s", "second": "s", "seconds": "s",
    "msec": "ms", "usec": "us", "nsec": "ns", "minute": "min", "minutes": "min", "hr": "h", "hour": "h",
    "hours": "h", "turn": "rev", "turns": "rev", "r/min": "rpm", "dimensionless": "1",
    "unitless": "1", "°C": "degC", "ºC": "degC", "celsius": "degC", "Celsius": "degC", "C": "degC",
    "°F": "degF", "fahrenheit": "degF", "Fahrenheit": "degF", "kelvin": "K", "Kelvin": "K",
}  # fmt: skip

_INVERSE = re.compile(r"(?<=\S)[ ·⋅.*](s|min|h)(?:\^?-1|⁻¹)$")
"""The end of ``rad s^-1`` and ``rad·s⁻¹``."""


def canonical(unit: str) -> str:
    """The one spelling of a unit: ``°/s``, ``dps`` and ``degrees/sec`` are all ``deg/s``.

    A word that is no known unit is returned as it is.
    """
    text = _INVERSE.sub(r"/\1", unit.strip())
    text = text.replace(" per ", "/").replace(" ", "")
    text = _ALIASES.get(text, text)
    return "/".join(_ALIASES.get(part, part) for part in text.split("/"))


def dimension(unit: str) -> str | None:
    """What the unit measures, or None where it is not known."""
    name = canonical(unit)
    return next((d for d, units in FACTORS.items() if name in units), None)


def factor(unit: str, of: str) -> float | None:
    """Factor to SI and radians of a unit of the given dimension, or None where it is none of it."""
    return FACTORS[of].get(canonical(unit))


def zero(unit: str) -> float:
    """The zero of a unit in SI: 273.15 K of degrees Celsius, 0 of nearly all others."""
    return _ZEROS.get(canonical(unit), 0.0)


def nearest(unit: str, of: str) -> str:
    """A sentence's end for an error: the unit probably meant, and all that would do."""
    spellings = [*FACTORS[of], *(alias for alias in _ALIASES if canonical(alias) in FACTORS[of])]
    matches = get_close_matches(unit, spellings, n=1)
    guess = f"did you mean {matches[0]!r}? " if matches else ""
    listed = [name for name in FACTORS[of] if not name.endswith(("/min", "/h"))]
    slower = ", the same per min and h" if len(listed) < len(FACTORS[of]) else ""
    return f"{guess}known units of {of}: {', '.join(listed)}{slower}"
