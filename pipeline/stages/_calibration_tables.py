"""The rows of a calibration's tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.models.rate_table import SingleAxis
from pipeline.models.rate_table_observations import Observations
from pipeline.models.rate_table_triad import Triad
from pipeline.models.rate_table_triad_model import Decomposition
from pipeline.stages._calibration_file import unit_of
from pipeline.stages._calibration_observations import Stretches
from pipeline.stages._rate_table_record import AXES

Float = NDArray[np.float64]
Rows = Iterator[dict[str, Any]]
Role = Literal["model", "derived"]

_PPM = 1e6


def lettered(name: str) -> str:
    """A parameter of the triad with the letters of its axes: ``misalignment_12`` is ``misalignment_pq``."""
    if name.startswith("S"):
        return name
    stem, _, axes = name.rpartition("_")
    return f"{stem}_{''.join(AXES[int(axis) - 1] for axis in axes)}"


def single_axis_rows(fit: SingleAxis, channel: str, role: Role, stretches: Stretches) -> Rows:
    """Rows of ``calibration`` of one gyro by its own axis."""
    fixed = _fixed("rates", channel, fit, stretches)
    for name, value, error in zip(fit.names, fit.value, fit.standard_errors, strict=True):
        yield {**fixed, **_row(name, value, error, unit_of(name), "determined"), "role": role}
    linearity = fit.linearity_error_ppm / _PPM
    for name, value, unit in (("linearity_error", linearity, "1"), ("step_scatter", fit.scatter, "rad/s")):
        yield {**fixed, **_row(name, value, None, unit, "determined"), "role": "derived"}


def cross_axis_row(fit: SingleAxis, channel: str, along: str, stretches: Stretches) -> dict[str, Any]:
    """The row of ``calibration`` of what one gyro tells of the rate about another axis."""
    name = f"S{AXES.index(channel) + 1}{AXES.index(along) + 1}"
    fixed = _fixed("rates", "", fit, stretches)
    value, error = float(fit.value[1]), float(fit.standard_errors[1])
    return {**fixed, **_row(name, value, error, "1", "determined"), "role": "derived"}


def triad_rows(fit: Triad, method: str, stretches: Stretches) -> Rows:
    """Rows of ``calibration`` of three gyros together."""
    fixed = _fixed(method, "", fit, stretches)
    states = dict(zip(fit.observability.names, fit.observability.states, strict=True))
    for name, value, error in zip(fit.names, fit.value, fit.standard_error, strict=True):
        unit = unit_of(lettered(name))
        state = states[name] if np.isfinite(error) or states[name] != "determined" else "undetermined"
        yield {**fixed, **_row(lettered(name), value, error, unit, state), "role": "model"}
    told = decomposed(fit)
    for name, value, error in zip(told.names, told.value, told.standard_error, strict=True):
        unit = "1" if name.startswith("scale_factor") else "rad"
        state = "determined" if np.isfinite(error) else "undetermined"
        yield {**fixed, **_row(lettered(name), value, error, unit, state), "role": "derived"}
    for axis, scatter in zip(AXES, fit.scatter, strict=True):
        row = _row(f"step_scatter_{axis}", scatter, None, "rad/s", "determined")
        yield {**fixed, **row, "role": "derived"}


def decomposed(fit: Triad) -> Decomposition:
    """Scale factors and angles; a gyro whose own axis nobody turned is taken to be near that axis.

    What is not told stays so: its standard error is infinite.
    """
    value = fit.value.copy()
    for k in (0, 4, 8):
        if not np.isfinite(fit.standard_error[k]):
            value[k] = 1.0
    return replace(fit, value=value).decomposed()


def covariance_rows(gyro: str, names: Sequence[str], covariance: Float) -> Rows:
    """Rows of ``calibration_covariance``."""
    units = [unit_of(name) for name in names]
    covariance = (covariance + covariance.T) / 2  # but for rounding it is symmetric
    for i, j in product(range(len(names)), repeat=2):
        yield {
            "gyro": gyro,
            "row": names[i],
            "column": names[j],
            "value": float(covariance[i, j]),
            "unit": _product(units[i], units[j]),
        }


def single_axis_residuals(fit: SingleAxis, channel: str, output: Float, stretches: Stretches) -> Rows:
    """Rows of ``calibration_residuals`` of one gyro."""
    for k in range(len(stretches)):
        yield {
            "fit": "single axis",
            **_place(stretches, k),
            "channel": channel,
            "rate": float(fit.input_rate[k]),
            "output": float(output[k]),
            "residual": float(fit.residual[k]),
            "residual_error": float(fit.residual_error[k]),
            "residual_ppm": float(fit.residual_ppm[k]),
            "deviation": float(fit.deviation[k]),
        }


def triad_residuals(fit: Triad, observed: Observations, stretches: Stretches) -> Rows:
    """Rows of ``calibration_residuals`` of three gyros."""
    scale = np.abs(decomposed(fit).value[:3]) * fit.largest_rate
    for k in range(len(stretches)):
        for i, channel in enumerate(AXES):
            yield {
                "fit": "triad",
                **_place(stretches, k),
                "channel": channel,
                "rate": float(observed.rate[k, i]),
                "output": float(observed.output[k, i]),
                "residual": float(fit.residual[k, i]),
                "residual_error": float(fit.residual_error[k, i]),
                "residual_ppm": float(_PPM * fit.residual[k, i] / scale[i]),
                "deviation": None,
            }


def _place(stretches: Stretches, k: int) -> dict[str, Any]:
    return {
        "method": stretches.method[k],
        "run": stretches.run[k],
        "observation": k,
        "start": int(stretches.start[k]),
        "stop": int(stretches.stop[k]),
        "temperature": None if stretches.temperature is None else float(stretches.temperature[k]),
    }


def _fixed(method: str, gyro: str, fit: SingleAxis | Triad, stretches: Stretches) -> dict[str, Any]:
    met = stretches.temperature if fit.terms.thermal else None
    return {
        "method": method,
        "gyro": gyro,
        "reference_temperature": None if met is None else fit.reference_temperature,
        "lowest_temperature": None if met is None else float(met.min()),
        "highest_temperature": None if met is None else float(met.max()),
        "largest_rate": fit.largest_rate,
    }


def _row(name: str, value: float, error: float | None, unit: str, state: str) -> dict[str, Any]:
    told = error is None or bool(np.isfinite(error))
    return {
        "parameter": name,
        "value": float(value) if told else None,
        "standard_error": float(error) if told and error is not None else None,
        "unit": unit,
        "state": state,
    }


def _product(one: str, other: str) -> str:
    if "1" in (one, other):
        return other if one == "1" else one
    return f"({one})({other})"
