"""Altitude from static pressure by the International Standard Atmosphere (ISO 2533:1975).

Up to 11 km the temperature falls by L a metre from T_0 and then stays at T_1::

    H = (T_0/L) [1 - (p/p_0)^(R L/g_0)]         p >= p_1 = p_0 (T_1/T_0)^(g_0/(R L))
    H = 11 km + (R T_1/g_0) ln(p_1/p)           p < p_1, to 20 km

H is geopotential altitude, which at 10 km is 16 m less than the geometric one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.units import STANDARD_GRAVITY

Float = NDArray[np.float64]

SEA_LEVEL_PRESSURE = 101325.0
"""p_0 [Pa]."""

SEA_LEVEL_TEMPERATURE = 288.15
"""T_0 [K]."""

LAPSE = 6.5e-3
"""L [K/m]."""

GAS_CONSTANT = 287.05287
"""R of dry air [J/(kg K)]."""

TROPOPAUSE = 11_000.0
"""[m]."""

_EXPONENT = GAS_CONSTANT * LAPSE / STANDARD_GRAVITY
_COLD = SEA_LEVEL_TEMPERATURE - LAPSE * TROPOPAUSE
_TROPOPAUSE_PRESSURE = SEA_LEVEL_PRESSURE * (_COLD / SEA_LEVEL_TEMPERATURE) ** (1 / _EXPONENT)


def altitude_of_pressure(pressure: ArrayLike) -> Float:
    """Geopotential altitude of a static pressure.

    Parameters
    ----------
    pressure : array_like, shape (...)
        [Pa].

    Returns
    -------
    ndarray, shape (...)
        [m]; NaN where the pressure is not above 0, or infinite.
    """
    p = np.asarray(pressure, dtype=np.float64)
    p = np.where((p > 0) & np.isfinite(p), p, np.nan)
    below = SEA_LEVEL_TEMPERATURE / LAPSE * (1 - (p / SEA_LEVEL_PRESSURE) ** _EXPONENT)
    above = TROPOPAUSE + GAS_CONSTANT * _COLD / STANDARD_GRAVITY * np.log(_TROPOPAUSE_PRESSURE / p)
    return np.asarray(np.where(p >= _TROPOPAUSE_PRESSURE, below, above), dtype=np.float64)
