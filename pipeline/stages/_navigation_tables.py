"""What navigations become as tables: `navigation`, `innovations`, `poles` and `loops`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.correction_response import Analysis
from pipeline.models.navigation_problem import AidName, Innovations, Navigation
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.stages._navigation_problem import AID_TABLES
from pipeline.stages.base import rows

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]
Integer = NDArray[np.intp]

AXES = ("x", "y", "z")
NED = ("north", "east", "down")
ANGLES = ("yaw", "pitch", "roll")
CORRECTIONS: Mapping[str, str] = MappingProxyType({"position": "c_x", "velocity": "c_v", "attitude": "c_u"})

COMPONENTS: Mapping[AidName, tuple[tuple[str, ...], str]] = MappingProxyType(
    {
        "position": (NED, "m"),
        "velocity": (NED, "m/s"),
        "airspeed": (("airspeed",), "m/s"),
        "altitude": (("altitude",), "m"),
        "magnetic_field": (AXES, "T"),
        "attitude": (NED, "rad"),
    }
)
"""Components of an aid's innovations, and their unit."""

_GAIN_UNITS = {"T": "s", "T_V": "s", "k_L": "1", "k_V": "1", "K": "1/s", "k_LV": "1/s", "k_n": "1/s"}
_FIX_UNITS = {"position": "m", "velocity": "m/s", "attitude": "rad"}


def chosen(time: Float, interval: float) -> Integer:
    """The instants that have a row: the first at or after each point of an even grid, and the last.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s].
    interval : float
        [s].
    """
    # A thousandth of the interval late is not late: stamps are whole nanoseconds.
    passed = np.floor((time - time[0]) / interval + 1e-3)
    first = np.diff(passed, prepend=-1.0) > 0
    return np.flatnonzero(first | (np.arange(len(time)) == len(time) - 1))


def navigation_rows(
    one: Navigation, at: Integer, stamps: Time, phase: Sequence[str], coasted: Mask
) -> pa.Table:
    """The rows of one method.

    Parameters
    ----------
    one : Navigation
        At all n instants.
    at : ndarray of int, shape (m,)
        Those that get a row.
    stamps : ndarray of int64, shape (m,)
        [ns].
    phase : sequence of str, of m
    coasted : ndarray of bool, shape (m,)
    """
    count, absent = len(at), np.full(len(at), np.nan)
    columns: dict[str, Any] = {
        "time": stamps,
        "method": [one.method] * count,
        "phase": list(phase),
        "coasted": coasted,
    }
    columns |= _named(("latitude", "longitude", "height"), one.position[at])
    columns |= _named([f"v_{a}" for a in NED], one.velocity[at])
    columns |= _named(ANGLES, yaw_pitch_roll(one.attitude[at]))
    columns |= _named([f"gyro_bias_{a}" for a in AXES], one.gyro_bias[at])
    columns |= _named([f"accelerometer_bias_{a}" for a in AXES], one.accelerometer_bias[at])
    columns |= _or_absent(("wind_north", "wind_east"), one.wind, at)
    columns |= _or_absent(("barometer_bias",), one.barometer_bias, at)
    for name, symbol in CORRECTIONS.items():
        columns |= _or_absent([f"{symbol}_{a}" for a in NED], one.corrections.get(name), at)
    for aid in AID_TABLES:
        used = one.used.get(aid)
        columns[f"used_{aid}"] = np.zeros(count, dtype=np.bool_) if used is None else used[at]
    contract = contracts.contract("navigation")
    sigmas = [c.name for c in contract.columns if c.name.startswith("sigma_")]
    columns |= dict.fromkeys(sigmas, absent) | _sigmas(one, at)
    return contracts.table("navigation", columns)


def _sigmas(one: Navigation, at: Integer) -> dict[str, Float]:
    told = one.deviations
    if told is None:
        return {}
    return {
        **_named([f"sigma_{a}" for a in NED], told.position[at]),
        **_named([f"sigma_v_{a}" for a in NED], told.velocity[at]),
        **_named([f"sigma_phi_{a}" for a in NED], told.attitude[at]),
        **_named([f"sigma_gyro_bias_{a}" for a in AXES], told.gyro_bias[at]),
        **_named([f"sigma_accelerometer_bias_{a}" for a in AXES], told.accelerometer_bias[at]),
        **_or_absent(("sigma_wind_north", "sigma_wind_east"), told.wind, at),
        **_or_absent(("sigma_barometer_bias",), told.barometer_bias, at),
    }


def _named(names: Sequence[str], values: Float) -> dict[str, Float]:
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))


def _or_absent(names: Sequence[str], values: Float | None, at: Integer) -> dict[str, Float]:
    """The columns of an array at some instants; NaN, which becomes null, where there is none."""
    if values is None:
        return dict.fromkeys(names, np.full(len(at), np.nan))
    return _named(names, values[at].reshape(len(at), -1))


def innovation_rows(method: str, aid: AidName, found: Innovations, origin: int) -> pa.Table:
    """One row a component of each measurement that was tried."""
    names, unit = COMPONENTS[aid]
    components = len(names)
    values = found.value.reshape(-1, components)
    tried = np.isfinite(values).all(axis=1)
    values, count = values[tried], int(np.count_nonzero(tried))

    def each(one: NDArray[Any]) -> NDArray[Any]:
        return np.repeat(one, components)

    return contracts.table(
        "innovations",
        {
            "time": each(origin + np.rint(found.time[tried] * 1e9).astype(np.int64)),
            "method": [method] * (count * components),
            "aid": [aid] * (count * components),
            "component": list(names) * count,
            "value": values.ravel(),
            "sigma": found.sigma.reshape(-1, components)[tried].ravel(),
            "unit": [unit] * (count * components),
            "normalised_squared": each(found.normalised_squared[tried]),
            "accepted": each(found.accepted[tried]),
        },
    )


def pole_rows(found: Sequence[Analysis]) -> pa.Table:
    """The poles of each loop, in continuous time and from fix to fix."""
    items = [
        {
            "loop": one.channel.name,
            "kind": kind,
            "real": float(p.real),
            "imaginary": float(p.imag),
            "unit": unit,
        }
        for one in found
        for kind, unit, poles in (("continuous", "1/s", one.poles), ("discrete", "1", one.sampled_poles))
        for p in poles
    ]
    return rows("poles", items)


def loop_rows(found: Sequence[Analysis]) -> pa.Table:
    """Gains, limits and what follows from them, of each loop."""
    items = []
    for one in found:
        gains = one.channel.gains
        figures: list[tuple[str, float, str]] = [
            (name, getattr(gains, name), unit) for name, unit in _GAIN_UNITS.items()
        ]
        figures += [
            ("k_n_limit", one.limit, "1/s"),
            ("spectral_radius", one.radius, "1"),
            ("damping", one.damping, "1"),
            ("settling_time", one.settling_time, "s"),
        ]
        figures += [
            (f"noise_{output}_by_{source}", gain, f"({_FIX_UNITS[output]})/({_FIX_UNITS[source]})")
            for (source, output), gain in one.noise_gain.items()
        ]
        items += [
            {
                "loop": one.channel.name,
                "name": name,
                "value": value if np.isfinite(value) else None,
                "unit": unit,
            }
            for name, value, unit in figures
        ]
    return rows("loops", items)
