"""Units that a test plan or a column header may state, and their factors to SI and radians."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from difflib import get_close_matches
from types import MappingProxyType

STANDARD_GRAVITY = 9.80665
"""g_0, by which g is defined [m/s^2]."""

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
_LENGTH = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
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
        "length": _LENGTH,
        "speed": {
            **{
                f"{length}/{time}": _LENGTH[length] / _TIME[time]
                for length in _LENGTH
                for time in ("s", "min", "h")
            },
            "kn": 1852 / 3600,
            "mph": 1609.344 / 3600,
        },
        "acceleration": {
            "m/s^2": 1.0,
            "g": STANDARD_GRAVITY,
            "mg": STANDARD_GRAVITY * 1e-3,
            "cm/s^2": 1e-2,
            "ft/s^2": 0.3048,
        },
        "magnetic flux density": {"T": 1.0, "mT": 1e-3, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "mG": 1e-7},
        "pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "bar": 1e5, "inHg": 3386.389},
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
    "metre": "m", "metres": "m", "meter": "m", "meters": "m", "feet": "ft", "foot": "ft", "kph": "km/h",
    "kmh": "km/h", "knot": "kn", "knots": "kn", "kt": "kn", "kts": "kn", "m/s2": "m/s^2", "m/s²": "m/s^2",
    "m/s/s": "m/s^2", "m/s**2": "m/s^2", "ms^-2": "m/s^2", "gee": "g", "g0": "g",
    "tesla": "T", "µT": "uT", "μT": "uT", "microtesla": "uT", "nanotesla": "nT", "gauss": "G", "Gauss": "G",
    "mGauss": "mG", "milligauss": "mG", "mbar": "hPa", "millibar": "hPa", "pascal": "Pa", "Pascal": "Pa",
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
