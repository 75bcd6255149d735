"""Tables of a static run as its stages would leave them, made from the models alone.

Channel p has white noise and noise 1, q white noise and a resonance (noise 2), r white noise, a rate random
walk and quantisation. Deviations and densities scatter as those of a record would; estimates are the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from report_tables import finding, from_rows, metric, provenance

from pipeline import contracts
from pipeline.models.random_error import Noise1, Noise2, Quantisation, RandomError, RateRandomWalk, White
from pipeline.models.random_error_growth import (
    growth,
    recommended_rate,
    reversing_growth,
    schuler_growth,
    variance,
    worse_bands,
)

Float = np.ndarray

DEG = np.pi / 180
STEP, LENGTH = 0.1, 4 * 3600.0  # s
ROOT = 0.01 * DEG / 60  # rad/sqrt(s), of 0.01 deg/sqrt(h)
TURNING = 3 * DEG  # rad/s, of the channel for which no rate can be recommended
SIGMA = 6 * ROOT * np.sqrt(0.01)  # rad/s, of the colour, whose mu is 0.01 /s
SCATTER = (
    0.2  # the interval of a deviation of one degree of freedom, in its logarithm: 2 SCATTER sqrt(tau/step)
)
UNCERTAIN = 0.15  # relative standard error of the growth

MODELS: dict[str, RandomError] = {
    "p": RandomError((White(ROOT**2), Noise1(SIGMA, 0.01))),
    "q": RandomError((White(ROOT**2), Noise2(SIGMA, 0.004, 0.03))),
    "r": RandomError((White(4 * ROOT**2), RateRandomWalk(2e-2 * ROOT), Quantisation(0.8 * ROOT))),
}
CHOSEN = {"p": "white + noise 1", "q": "white + noise 2", "r": "white + rate random walk + quantisation"}
CANDIDATES = (
    "white",
    "white + noise 1",
    "white + noise 2",
    "white + noise 3",
    "white + rate random walk",
    "white + rate random walk + quantisation",
)

COEFFICIENTS: dict[str, dict[str, float]] = {
    "p": {"N": ROOT, "B": 3 * ROOT / 60, "K": 0.0, "Q": 0.8 * ROOT, "R": 0.0},
    "q": {"N": ROOT, "B": 2 * ROOT / 60, "K": 2e-2 * ROOT, "Q": 0.0, "R": 0.0},
    "r": {"N": 2 * ROOT, "B": 0.0, "K": 2e-2 * ROOT, "Q": 0.0, "R": 2e-5 * ROOT},
}
"""N, B, K, Q, R, SI; those that are 0 are not significant."""
UNITS = {
    "N": ("rad/sqrt(s)", "deg/sqrt(h)", 60 / DEG),
    "B": ("rad/s", "deg/h", 3600 / DEG),
    "K": ("rad/s/sqrt(s)", "deg/h/sqrt(h)", 3600 * 60 / DEG),
    "Q": ("rad", "arcsec", 3600 / DEG),
    "R": ("rad/s^2", "deg/h/h", 3600**2 / DEG),
}
PARAMETER_UNITS = {
    "N": "rad^2/s",
    "sigma": "rad/s",
    "mu": "1/s",
    "lambda": "rad/s",
    "K": "rad/s/sqrt(s)",
    "Q": "rad",
}


def make_static_tables(channels: str = "pqr", text: str = "") -> dict[str, pa.Table]:
    """All tables of some channels; ``text`` is put into every text that a recording or its plan can bring."""
    return {
        "allan": pa.concat_tables(allan(channel) for channel in channels),
        "noise_coefficients": from_rows(
            "noise_coefficients", [row for channel in channels for row in coefficients(channel)]
        ),
        "spectrum": pa.concat_tables(spectrum(channel) for channel in channels),
        "noise_model": from_rows("noise_model", [row for channel in channels for row in models(channel)]),
        "modulation": pa.concat_tables(modulation(channel) for channel in channels),
        "growth": pa.concat_tables(angle_error(channel) for channel in channels),
        "findings": from_rows("findings", [finding(f"jitter{text}", "info", 0.0, 60.0)]),
        "metrics": from_rows(
            "metrics", [metric(f"duration{text}", "gyro", LENGTH, unit="s"), *advice(channels)]
        ),
        "provenance": static_provenance(text),
    }


def static_provenance(text: str = "") -> pa.Table:
    (row,) = provenance(text).to_pylist()
    return from_rows("provenance", [row | {"procedure": "static"}])


def allan_model(channel: str, tau: Float) -> Float:
    """Allan deviation of the coefficients (IEEE Std 952-1997) [rad/s]."""
    c = COEFFICIENTS[channel]
    flicker = 2 * np.log(2) / np.pi * c["B"] ** 2
    square = 3 * (c["Q"] / tau) ** 2 + c["N"] ** 2 / tau + flicker + c["K"] ** 2 * tau / 3
    return np.asarray(np.sqrt(square + c["R"] ** 2 * tau**2 / 2))


def allan(channel: str) -> pa.Table:
    """The overlapping deviation about the model, and the others a little off; total reaches further."""
    rng = np.random.default_rng(ord(channel))
    parts = []
    shapes = {"allan": (1.0, 4), "modified": (0.75, 6), "hadamard": (0.9, 6), "total": (1.0, 2)}
    for estimator, (size, parting) in shapes.items():
        tau = STEP * np.unique(np.geomspace(1, LENGTH / STEP / parting, 48).round())
        spread = SCATTER * np.sqrt(tau / tau[-1])
        model = allan_model(channel, tau)
        deviation = size * model * np.exp(spread * rng.standard_normal(len(tau)))
        known = estimator != "total"
        parts.append(
            contracts.table(
                "allan",
                {
                    "channel": [channel] * len(tau),
                    "estimator": [estimator] * len(tau),
                    "tau": tau,
                    "deviation": deviation,
                    "lower": deviation * np.exp(-2 * spread) if known else [None] * len(tau),
                    "upper": deviation * np.exp(4 * spread) if known else [None] * len(tau),
                    "degrees_of_freedom": 1 / (2 * spread**2) if known else [None] * len(tau),
                    "count": np.maximum(LENGTH / STEP - 2 * tau / STEP, 1).astype(np.int64),
                    "model": model if estimator == "allan" else [None] * len(tau),
                    "noise_model": 1.1 * model if estimator == "allan" else [None] * len(tau),
                },
            )
        )
    return pa.concat_tables(parts)


def coefficients(channel: str) -> list[dict[str, Any]]:
    rows = []
    for name, value in COEFFICIENTS[channel].items():
        si, datasheet, factor = UNITS[name]
        error = 0.03 * value if value else None
        rows.append(
            {
                "channel": channel, "coefficient": name, "value": value, "standard_error": error, "unit": si,
                "datasheet_value": value * factor, "datasheet_standard_error": error and error * factor,
                "datasheet_unit": datasheet, "significant": value > 0,
            }
        )  # fmt: skip
    return rows


def spectrum(channel: str, count: int = 160) -> pa.Table:
    """Means over the ordinates of even shares of a logarithmic axis, one ordinate at its beginning."""
    edges = np.unique(np.geomspace(1, LENGTH / STEP / 2, count).round()).astype(np.int64)
    ordinates = np.diff(edges)
    frequency = (edges[1:] + edges[:-1] - 1) / 2 / LENGTH
    model = MODELS[channel].psd(2 * np.pi * frequency)
    rng = np.random.default_rng(100 + ord(channel))
    density = model * rng.gamma(ordinates, 1 / ordinates)
    columns = {"frequency": frequency, "density": density, "count": ordinates, "model": model}
    return contracts.table("spectrum", {"channel": [channel] * len(frequency), **columns})


def parameters(model: RandomError) -> Mapping[str, float]:
    return {name: value for term in model.terms for name, value in term.parameters.items()}


def models(channel: str) -> list[dict[str, Any]]:
    """The chosen candidate with the truth; of the others the size of the white noise alone."""
    rows = []
    for place, candidate in enumerate(CANDIDATES):
        chosen = candidate == CHOSEN[channel]
        told = parameters(MODELS[channel]) if chosen else {"N": 1.1 * MODELS[channel].N}
        for name, value in told.items():
            rows.append(
                {
                    "channel": channel, "candidate": candidate, "chosen": chosen,
                    "bic": 0.0 if chosen else 1000.0 / 3.0 ** (place + 1),
                    "whiteness": 0.4 if chosen else 1e-9, "parameter": name, "value": value,
                    "standard_error": 0.1 * value, "lower": value * np.exp(-0.196),
                    "upper": value * np.exp(0.196), "unit": PARAMETER_UNITS[name],
                }
            )  # fmt: skip
    return rows


def rate_of(channel: str) -> float:
    """The recommended rate [rad/s]; `TURNING` where there is none."""
    model = MODELS[channel]
    return TURNING if model.K else recommended_rate(model, 0.1)


def modulation(channel: str) -> pa.Table:
    """From rest to 20 deg/s; no number where the growth has no bound."""
    model, rates = MODELS[channel], np.append(0.0, np.geomspace(0.05, 20, 120) * DEG)
    size = growth(model, rates)
    size[~np.isfinite(size)] = np.nan
    worse = np.any([(b.low < rates) & (rates < b.high) for b in worse_bands(model)] + [rates < 0], axis=0)
    reversing = [None if w == 0 else reversing_growth(model, w) for w in rates.tolist()]
    colour = (size - model.N) / size * UNCERTAIN
    return contracts.table(
        "modulation",
        {
            "channel": [channel] * len(rates), "rotation_rate": rates, "growth": size,
            "lower": size * np.exp(-2 * colour - 0.02), "upper": size * np.exp(2 * colour + 0.02),
            "worse": worse, "schuler_growth": schuler_growth(model, rates), "reversing_growth": reversing,
        },
    )  # fmt: skip


def angle_error(channel: str) -> pa.Table:
    model, rate = MODELS[channel], rate_of(channel)
    time = np.geomspace(10, 8 * 3600, 80)
    rest, turning = (np.sqrt(variance(model, time, omega)) for omega in (0.0, rate))
    return contracts.table(
        "growth",
        {
            "channel": [channel] * len(time), "duration": time, "without_rotation": rest,
            "with_rotation": turning, "rotation_rate": np.full(len(time), rate),
            "lower": turning * (1 - UNCERTAIN), "upper": turning * (1 + UNCERTAIN),
        },
    )  # fmt: skip


def advice(channels: str) -> list[dict[str, Any]]:
    """The recommended rates as the score tells them; none of r."""
    return [
        metric(
            "recommended_rate",
            channel,
            rate_of(channel) / DEG if channel != "r" else None,
            unit="deg/s",
            procedure="static",
            stage="score_static",
        )
        for channel in channels
    ]
