"""The tables of the stage `modulation`: growth against the rate of rotation, and against time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error_fit import Candidate
from pipeline.models.random_error_growth import (
    Band,
    growth,
    reversing_growth,
    schuler_growth,
    variance,
)
from pipeline.stages._noise_tables import QUANTILE

Float = NDArray[np.float64]
Rows = Iterator[dict[str, Any]]

_INSTANTS = 101
"""Instants of the growth against time."""
_FIRST = 1e-4
"""The first of them, as a part of the last."""


def modulation_rows(
    channel: str, chosen: Candidate, rates: Float, bands: Sequence[Band], *, schuler: bool, turns: float
) -> Rows:
    """Rows of ``modulation``: the growth coefficient at each rate [rad/s], and whether it is in a worse band.

    The interval is that of its logarithm; null where the record does not determine it. Of a rate random walk
    at rest no growth is told, which has no bound.
    """
    model = chosen.model
    size = growth(model, rates)
    bounded = np.isfinite(size)
    error = np.full(len(rates), np.inf)
    error[bounded] = chosen.standard_error(lambda one: np.log(growth(one, rates[bounded])))
    low, high = _interval(np.where(bounded, size, 1.0), error)
    beyond = schuler_growth(model, rates)
    for k, rate in enumerate(rates.tolist()):
        yield {
            "channel": channel,
            "rotation_rate": rate,
            "growth": _bounded(size[k]),
            "lower": low[k],
            "upper": high[k],
            "worse": any(band.low < rate < band.high for band in bands),
            "schuler_growth": _bounded(beyond[k]) if schuler else None,
            "reversing_growth": _bounded(reversing_growth(model, rate, turns)) if rate > 0 else None,
        }


def growth_rows(channel: str, chosen: Candidate, rate: float, longest: float) -> Rows:
    """Rows of ``growth``: standard deviation of the angle at instants up to the longest [s]."""
    model = chosen.model
    t = np.geomspace(_FIRST * longest, longest, _INSTANTS)
    still, turning = np.sqrt(variance(model, t)), np.sqrt(variance(model, t, rate))
    error = chosen.standard_error(lambda one: 0.5 * np.log(variance(one, t, rate)))
    low, high = _interval(turning, error)
    for k, duration in enumerate(t.tolist()):
        yield {
            "channel": channel,
            "duration": duration,
            "without_rotation": float(still[k]),
            "with_rotation": float(turning[k]),
            "rotation_rate": rate,
            "lower": low[k],
            "upper": high[k],
        }


def _bounded(size: float) -> float | None:
    return float(size) if np.isfinite(size) else None


def _interval(value: Float, relative: Float) -> tuple[list[float | None], list[float | None]]:
    """Ends of the 95 % interval of a positive figure from the standard error of its logarithm."""
    with np.errstate(over="ignore"):
        low, high = value * np.exp(-QUANTILE * relative), value * np.exp(QUANTILE * relative)
    known = np.isfinite(high) & (low > 0)
    return tuple(
        [float(x) if is_known else None for x, is_known in zip(end, known, strict=True)]
        for end in (low, high)
    )  # type: ignore[return-value]
