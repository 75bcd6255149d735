"""Modulation: what rotation of the platform does to the integrated error of each channel.

Yang et al., *Chinese Journal of Sensors and Actuators* 27(5) (2014) 637-642: after long time the variance of
the angle grows by S(omega) a second, the two-sided spectral density of the error at the rotation rate. The
chosen model of the stage `noise` gives S, and its information matrix the error of every figure (delta method,
of the logarithm where a figure is positive).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.models.random_error import RandomError
from pipeline.models.random_error_fit import Candidate
from pipeline.models.random_error_growth import Band, worse_bands
from pipeline.numerics.sampling import intervals
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._modulation_advice import Advice, advise, known_bands
from pipeline.stages._modulation_tables import growth_rows, modulation_rows
from pipeline.stages._noise_tables import chosen_models
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand, Tables, finding, metric, rows

CONSUMES: tuple[str, ...] = ("noise_model", "noise_information")
MAY_CONSUME: tuple[str, ...] = ("gyro", "gyro_increments")
PRODUCES: tuple[str, ...] = ("modulation", "growth", "findings", "metrics")
METRICS: tuple[str, ...] = ("recommended_rate", "suppression", "worse_below")

Float = NDArray[np.float64]

_USUAL_RATE_DEG_S = 3.0
"""Rate for the growth against time where none is recommended, deg/s; Yang's."""


class Settings(_Settings):
    """Rates of rotation, what is asked of them, and how far the growth is told."""

    lowest_rate_deg_s: float = Field(0.01, gt=0, description="lowest rotation rate, deg/s; 0 is always there")
    highest_rate_deg_s: float = Field(
        100.0, gt=0, description="highest rotation rate that the platform can turn at, deg/s"
    )
    rate_count: int = Field(
        121, ge=2, le=10_000, description="rotation rates, evenly spaced in their logarithm"
    )
    fraction: float = Field(
        0.1,
        gt=0,
        description="growth that the recommended rate leaves to coloured noise, as a part of white noise's",
    )
    hours: float = Field(8.0, gt=0, description="time of integration for the growth against time, h")
    rate_deg_s: float | None = Field(
        None,
        gt=0,
        description="rotation rate for the growth against time, deg/s; None: the recommended one, or 3 deg/s "
        "where none is needed or found",
    )
    turns: float = Field(1.0, gt=0, description="turns each way of a platform that turns to and fro")
    schuler: bool = Field(True, description="whether to give the growth beyond Schuler's period")

    @model_validator(mode="after")
    def _rates_rise(self) -> Self:
        if self.lowest_rate_deg_s >= self.highest_rate_deg_s:
            expected = f"more than lowest_rate_deg_s, {self.lowest_rate_deg_s:g}"
            found = f"{self.highest_rate_deg_s:g}"
            refuse([Fault(("highest_rate_deg_s",), expected, found, "raise it")])
        return self


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Tell what rotation does to each channel.

    Parameters
    ----------
    tables : mapping
        ``noise_model`` and ``noise_information``; ``gyro`` or ``gyro_increments`` for the interval of their
        samples, without which their Nyquist frequency is no bound.
    settings : Settings
    stand : Stand
        Not needed here.

    Returns
    -------
    dict
        The tables of `PRODUCES`. The metric ``recommended_rate`` is 0 where no rotation is needed, null where
        the platform cannot turn fast enough, or the record does not show it: the chosen model does not
        describe it, or its colour is as fast as the samples.
    """
    made: dict[str, list[dict[str, Any]]] = {name: [] for name in PRODUCES}
    step = _step(tables)
    spaced = np.geomspace(settings.lowest_rate_deg_s, settings.highest_rate_deg_s, settings.rate_count)
    for channel, chosen in chosen_models(tables["noise_model"], tables["noise_information"]).items():
        advice = advise(chosen, settings.fraction, float(np.radians(settings.highest_rate_deg_s)), step)
        bands = known_bands(chosen.model, step)
        rates = np.unique(np.append(np.radians(spaced), [0.0, advice.rate or 0.0]))
        shown = settings.rate_deg_s or np.degrees(advice.rate or 0.0) or _USUAL_RATE_DEG_S
        made["modulation"] += modulation_rows(
            channel, chosen, rates, bands, schuler=settings.schuler, turns=settings.turns
        )
        made["growth"] += growth_rows(channel, chosen, float(np.radians(shown)), 3600 * settings.hours)
        made["findings"] += _findings(channel, chosen, advice, bands, settings.hours)
        made["metrics"] += _metrics(channel, chosen, advice, bands, step)
    return {name: rows(name, items) for name, items in made.items()}


def _step(tables: Tables) -> float:
    """Interval of the gyro's samples [s]; 0 where they are not there."""
    for name in ("gyro", "gyro_increments"):
        if name in tables:
            return intervals(tables[name].column("time").to_numpy()).nominal
    return 0.0


def _findings(
    channel: str, chosen: Candidate, advice: Advice, bands: Sequence[Band], hours: float
) -> Iterator[dict[str, Any]]:
    severity: Literal["info", "warning"] = "info" if advice.rate is not None else "warning"
    yield finding("modulation", "modulation", "recommended rate", severity, advice.reason, channel=channel)
    if not chosen.fits:
        return
    model = chosen.model
    for band in bands:
        detail = (
            f"the error grows faster than without rotation at rates from {np.degrees(band.low):.3g} to "
            f"{np.degrees(band.high):.3g} deg/s"
        )
        yield finding("modulation", "modulation", "worse with rotation", "warning", detail, channel=channel)
    longest = max((1 / noise.mu for noise in model.coloured), default=0.0) / 3600
    if longest > hours:
        detail = (
            f"the colour's time constant, {longest:.3g} h, is longer than the {hours:g} h of integration: "
            "until then the variance grows up to twice as fast as the growth coefficient says"
        )
        yield finding("modulation", "modulation", "slow colour", "warning", detail, channel=channel)


def _metrics(
    channel: str, chosen: Candidate, advice: Advice, bands: Sequence[Band], step: float
) -> Iterator[dict[str, Any]]:
    rate, error = advice.rate, advice.rate_error
    in_degrees = None if rate is None else float(np.degrees(rate))
    of_rate = None if error is None else float(np.degrees(error))
    yield metric("modulation", channel, "recommended_rate", in_degrees, "deg/s", of_rate)
    yield metric("modulation", channel, "suppression", advice.suppression, "1", advice.suppression_error)
    if chosen.fits and bands and bands[-1].high * step < np.pi:
        top = float(np.degrees(_worse_below(chosen.model)))
        spread = float(np.degrees(chosen.standard_error(_worse_below)))
        yield metric(
            "modulation", channel, "worse_below", top, "deg/s", spread if np.isfinite(spread) else None
        )


def _worse_below(model: RandomError) -> Float:
    """Rate above which no rotation makes the error worse [rad/s]."""
    return np.array(max((band.high for band in worse_bands(model)), default=0.0))
