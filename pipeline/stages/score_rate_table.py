"""Score of the procedure `rate_table`: its calibration as figures that a plan can limit.

The channel is the gyro's; of an angle between two axes both: the component of the input axis of p along q is
the misalignment of ``pq``. Scale factor, bias and their sensitivity are the triad's where there is one.
What is not determined has no value, which no limit accepts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.stages._calibration_settings import HIGHEST_ORDER
from pipeline.stages._rate_table_record import AXES
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand, Tables, metric, rows

_PPM = 1e6
_DEG_H = float(np.degrees(1) * 3600)
_ARCSEC = float(np.degrees(1) * 3600)
_ORDERS = range(2, HIGHEST_ORDER + 1)

_SINGLE: Mapping[str, tuple[str, float, str]] = MappingProxyType(
    {
        "bias": ("bias", _DEG_H, "deg/h"),
        "bias_temperature_sensitivity": ("bias_temperature_sensitivity", _DEG_H, "deg/h/K"),
        "scale_factor": ("scale_factor", 1.0, "1"),
        "scale_factor_asymmetry": ("scale_factor_asymmetry", _PPM, "ppm"),
        **{
            f"scale_factor_nonlinearity_{k}": (f"scale_factor_nonlinearity_{k}", _PPM, "ppm") for k in _ORDERS
        },
        "scale_factor_temperature_sensitivity": ("scale_factor_temperature_sensitivity", _PPM, "ppm/K"),
        "linearity_error": ("linearity_error", _PPM, "ppm"),
        "step_scatter": ("step_scatter", _DEG_H, "deg/h"),
    }
)
"""Metric, factor and unit of a parameter, by its name without the axis."""

_ANGLES = ("misalignment", "nonorthogonality", "triad_rotation")

CONSUMES: tuple[str, ...] = ("calibration", "calibration_residuals")
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES: tuple[str, ...] = ("metrics",)
METRICS: tuple[str, ...] = (
    *dict.fromkeys(name for name, _, _ in _SINGLE.values()),
    "scale_factor_error",
    *_ANGLES,
    "residual_rms",
    "largest_residual",
    "normalised_residual",
)

Row = dict[str, Any]


class Settings(_Settings):
    """Nothing to choose."""


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Compute the figures.

    Parameters
    ----------
    tables : mapping
        ``calibration`` and ``calibration_residuals``.

    Returns
    -------
    dict
        ``metrics``: scale factor (1), its error against 1 (ppm), asymmetry, nonlinearity and linearity error
        (ppm), bias (deg/h), sensitivities, angles (arcsec), residuals in parts per million of full scale and
        in units of what they should be.
    """
    figures = [*_parameters(tables["calibration"].to_pylist())]
    figures += _residuals(tables["calibration_residuals"].to_pylist())
    return {"metrics": rows("metrics", figures)}


def _parameters(table: Sequence[Row]) -> Iterator[Row]:
    told: dict[tuple[str, str], Row] = {}
    for row in table:
        name, axes = (row["parameter"], row["gyro"]) if row["gyro"] else _parted(row["parameter"])
        # The triad's own stand before those of the single axes.
        told.setdefault((name, axes), row)
    for (name, axes), row in told.items():
        if name in _SINGLE:
            yield _figure(axes, row, *_SINGLE[name])
        elif name in _ANGLES:
            yield _figure(axes, row, name, _ARCSEC, "arcsec")
        if name == "scale_factor":
            error = {**row, "value": None if row["value"] is None else row["value"] - 1}
            yield _figure(axes, error, "scale_factor_error", _PPM, "ppm")


def _parted(parameter: str) -> tuple[str, str]:
    """A parameter of the triad as its name and its axes; of S, which has no metric, without."""
    name, _, axes = parameter.rpartition("_")
    return (name, axes) if set(axes) <= set(AXES) else (parameter, "")


def _figure(channel: str, row: Row, name: str, factor: float, unit: str) -> Row:
    value, error = (None if row[key] is None else row[key] * factor for key in ("value", "standard_error"))
    return metric("score_rate_table", channel, name, value, unit, error)


def _residuals(table: Sequence[Row]) -> Iterator[Row]:
    """Of the triad where there is one, else of the single axes."""
    fits = {row["fit"] for row in table}
    fit = "triad" if "triad" in fits else "single axis"
    for channel in AXES:
        own = [row for row in table if row["fit"] == fit and row["channel"] == channel]
        if not own:
            continue
        ppm = np.array([row["residual_ppm"] for row in own])
        size = np.array([row["residual"] for row in own])
        should = np.array([row["residual_error"] for row in own])
        sure = should > 0
        normalised = float(np.sqrt(np.mean((size[sure] / should[sure]) ** 2))) if sure.any() else None
        yield metric("score_rate_table", channel, "residual_rms", float(np.sqrt(np.mean(ppm**2))), "ppm")
        yield metric("score_rate_table", channel, "largest_residual", float(np.abs(ppm).max()), "ppm")
        yield metric("score_rate_table", channel, "normalised_residual", normalised, "1")
