"""The unit in which a curve reads best."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_ANGLES = (
    (math.pi / 180, "°"),
    (math.pi / 180 / 60, "arcmin"),
    (math.pi / 180 / 3600, "arcsec"),
    (math.pi / 180 / 3600e3, "mas"),
    (math.pi / 180 / 3600e6, "µas"),
)
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def angle(curves: Iterable[NDArray[np.float64]]) -> tuple[float, str]:
    """Radians in the unit that suits these curves, and its name: degrees down to microarcseconds."""
    return _largest(curves, _ANGLES)


def rate(curves: Iterable[NDArray[np.float64]]) -> tuple[float, str]:
    """Radians a second in the unit that suits these curves, and its name."""
    factor, prefix = _largest(curves, _PREFIXES)
    return factor, f"{prefix}rad/s"


def _largest(
    curves: Iterable[NDArray[np.float64]], units: tuple[tuple[float, str], ...]
) -> tuple[float, str]:
    """The largest unit of which the largest value is at least two; the smallest if it is less than any."""
    peak = max((float(np.abs(c[np.isfinite(c)]).max(initial=0.0)) for c in curves), default=0.0)
    if peak == 0.0:
        return units[0]
    return next((unit for unit in units if peak >= 2 * unit[0]), units[-1])
