"""Score of the procedure `static`: its noise as figures that a plan can limit, in the units of data sheets.

What the record does not show is null, which no limit accepts: a limit on it says that it must be shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.numerics.noise_coefficients import DATASHEET, Name
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand, Tables, metric, rows

CONSUMES: tuple[str, ...] = ("noise_coefficients", "noise_model")
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES: tuple[str, ...] = ("metrics",)
METRICS: tuple[str, ...] = (
    "N",
    "B",
    "K",
    "Q",
    "R",
    "model_N",
    "model_K",
    "model_Q",
    "colour_sigma",
    "colour_time",
    "colour_period",
)

_DEG_H = float(np.degrees(1) * 3600)


class Settings(_Settings):
    """Nothing to choose."""


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Compute the figures.

    Parameters
    ----------
    tables : mapping
        ``noise_coefficients`` and ``noise_model``.

    Returns
    -------
    dict
        ``metrics``, by channel: N, B, K, Q, R in the units of data sheets; of the chosen model N, K and Q in
        the same, of its coloured noise the standard deviation (deg/h), correlation time 1/mu (s) and period
        2 pi/lambda (s). Null where the error is larger than the figure, or has no bound.
    """
    figures = [*_coefficients(tables["noise_coefficients"]), *_colours(tables["noise_model"])]
    return {"metrics": rows("metrics", figures)}


def _coefficients(table: pa.Table) -> Iterator[dict[str, Any]]:
    for row in table.to_pylist():
        shown = row["significant"]
        yield metric(
            "score_static",
            row["channel"],
            row["coefficient"],
            row["datasheet_value"] if shown else None,
            row["datasheet_unit"],
            row["datasheet_standard_error"] if shown else None,
        )


def _levels(channel: str, told: dict[str, tuple[float, float | None]]) -> Iterator[dict[str, Any]]:
    """N, K and Q of the chosen model; its N is a density, of which the data sheet has the root."""
    levels: tuple[Name, ...] = ("N", "K", "Q")
    for name in levels:
        factor, unit = DATASHEET[name]
        power = 0.5 if name == "N" else 1.0
        value, error = _shown(told, name, power)
        if value is None:
            yield metric("score_static", channel, f"model_{name}", None, unit)
            continue
        size = factor * value**power
        spread = None if error is None else power * size * error / value
        yield metric("score_static", channel, f"model_{name}", size, unit, spread)


def _shown(
    told: dict[str, tuple[float, float | None]], name: str, power: float = 1.0
) -> tuple[float | None, float | None]:
    """A parameter and its error, where the record shows it: its power has an error, no larger than itself."""
    value, error = told.get(name, (0.0, None))
    return (value, error) if error is not None and power * error <= value else (None, None)


def _colours(table: pa.Table) -> Iterator[dict[str, Any]]:
    chosen: dict[str, dict[str, tuple[float, float | None]]] = {}
    for row in table.to_pylist():
        if row["chosen"]:
            told = chosen.setdefault(row["channel"], {})
            told[row["parameter"]] = (row["value"], row["standard_error"])
    for channel, told in chosen.items():
        yield from _levels(channel, told)
        sigma, error = _shown(told, "sigma")
        in_deg_h = None if sigma is None else sigma * _DEG_H
        of_sigma = None if error is None else error * _DEG_H
        yield metric("score_static", channel, "colour_sigma", in_deg_h, "deg/h", of_sigma)
        for name, of, turn in (("colour_time", "mu", 1.0), ("colour_period", "lambda", 2 * np.pi)):
            value, error = _shown(told, of)
            time = None if value is None else turn / value
            of_time = None if time is None or value is None or error is None else time * error / value
            yield metric("score_static", channel, name, time, "s", of_time)
