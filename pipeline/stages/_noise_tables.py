"""The tables of the stage `noise`, and the chosen models read back from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.models.random_error import RandomError
from pipeline.models.random_error_fit import Candidate, Identified
from pipeline.models.random_error_forms import FORMS, process, terms_of
from pipeline.models.random_error_growth import allan_variance
from pipeline.numerics import cosine_spectrum, whittle
from pipeline.numerics.allan import Record, Variances
from pipeline.numerics.allan_confidence import confidence
from pipeline.numerics.noise_coefficients import NoiseCoefficients, in_datasheet_units

Float = NDArray[np.float64]
Rows = Iterator[dict[str, Any]]

_TERMS = {
    "noise1": "noise 1",
    "noise2": "noise 2",
    "noise3": "noise 3",
    "rate_random_walk": "rate random walk",
    "quantisation": "quantisation",
}
CANDIDATES: dict[str, str] = {
    form: " + ".join(["white", *(_TERMS[term] for term in terms_of(form))]) for form in FORMS
}
"""What the tables call the forms of random error."""

UNITS = {
    "N": "rad^2/s",
    "sigma": "rad/s",
    "mu": "1/s",
    "lambda": "rad/s",
    "K": "rad/s/sqrt(s)",
    "Q": "rad",
}

COEFFICIENT_UNITS = {"N": "rad/sqrt(s)", "B": "rad/s", "K": "rad/s/sqrt(s)", "Q": "rad", "R": "rad/s^2"}

QUANTILE = 1.959963984540054
"""Standard errors on either side of a 95 % interval."""

_TOLD = 5.0
"""Standard error of a parameter's logarithm from which on no interval is told: it spans eight decades."""

_A_DECADE = 30
"""Points of the stored spectrum in a factor ten of frequency."""


def allan_rows(
    channel: str,
    record: Record,
    variances: Variances,
    level: float,
    model: NoiseCoefficients | None,
    fitted: RandomError,
) -> Rows:
    """Rows of ``allan``: one estimator of one channel."""
    known = confidence(record, variances, level=level)
    shown = whole = np.full(len(variances.tau), np.nan)
    if variances.kind == "allan":
        whole = np.sqrt(allan_variance(fitted, variances.tau))
        if model is not None:
            shown = np.sqrt(model.model(variances.tau))
    for k, tau in enumerate(variances.tau.tolist()):
        yield {
            "channel": channel,
            "estimator": variances.kind,
            "tau": tau,
            "deviation": float(variances.deviation[k]),
            "lower": _finite(known.lower[k]),
            "upper": _finite(known.upper[k]),
            "degrees_of_freedom": _finite(known.degrees_of_freedom[k]),
            "count": int(variances.terms[k]),
            "model": _finite(shown[k]),
            "noise_model": _finite(whole[k]),
        }


def coefficient_rows(channel: str, found: NoiseCoefficients) -> Rows:
    """Rows of ``noise_coefficients``; those that the record does not show are 0."""
    for one in found.coefficients:
        value, error = one.value or 0.0, one.standard_error
        datasheet, unit = in_datasheet_units(one.name, value)
        yield {
            "channel": channel,
            "coefficient": one.name,
            "value": value,
            "standard_error": error,
            "unit": COEFFICIENT_UNITS[one.name],
            "datasheet_value": datasheet,
            "datasheet_standard_error": None if error is None else in_datasheet_units(one.name, error)[0],
            "datasheet_unit": unit,
            "significant": one.value is not None,
        }


def model_rows(channel: str, found: Identified) -> Rows:
    """Rows of ``noise_model``: every parameter of every candidate."""
    best = found.chosen
    for one in found.candidates:
        errors = one.standard_errors
        for name, value in one.parameters.items():
            relative = errors[name] / value
            known = relative < _TOLD
            yield {
                "channel": channel,
                "candidate": CANDIDATES[one.form],
                "chosen": one is best,
                "bic": one.bic - best.bic,
                "whiteness": one.whiteness,
                "parameter": name,
                "value": value,
                "standard_error": _finite(errors[name]),
                "lower": value * float(np.exp(-QUANTILE * relative)) if known else None,
                "upper": value * float(np.exp(QUANTILE * relative)) if known else None,
                "unit": UNITS[name],
            }


def information_rows(channel: str, found: Identified) -> Rows:
    """Rows of ``noise_information``."""
    for one in found.candidates:
        for a, of_a in zip(one.names, one.information, strict=True):
            for b, value in zip(one.names, of_a.tolist(), strict=True):
                yield {
                    "channel": channel,
                    "candidate": CANDIDATES[one.form],
                    "parameter_a": a,
                    "parameter_b": b,
                    "information": value,
                }


def spectrum_rows(
    channel: str, periodogram: cosine_spectrum.Periodogram, step: float, chosen: Candidate
) -> Rows:
    """Rows of ``spectrum``: means over even shares of a logarithmic axis, of record and model alike."""
    expected, _ = whittle.expected(periodogram, process(chosen.form, chosen.theta, step))
    lowest = periodogram.omega.min()
    bins = np.floor(_A_DECADE * np.log10(periodogram.omega / lowest)).astype(np.intp)
    weight = np.bincount(bins, periodogram.count)
    there = weight > 0
    weight = weight[there]

    def mean(values: Float) -> Float:
        total = np.bincount(bins, periodogram.count * values)[there]
        return np.asarray(total / weight, dtype=np.float64)

    frequency, unit = mean(periodogram.omega) / (2 * np.pi * step), step / periodogram.share
    density, model = mean(periodogram.value) * unit, mean(expected) * unit
    for k, at in enumerate(frequency.tolist()):
        yield {
            "channel": channel,
            "frequency": at,
            "density": float(density[k]),
            "count": max(1, round(0.5 * float(weight[k]))),
            "model": float(model[k]),
        }


def chosen_models(models: pa.Table, informations: pa.Table) -> Mapping[str, Candidate]:
    """The chosen candidate of each channel, as it was fitted but for its likelihood."""
    chosen: dict[str, dict[str, float]] = {}
    named: dict[str, tuple[str, float]] = {}
    for row in models.to_pylist():
        if row["chosen"]:
            chosen.setdefault(row["channel"], {})[row["parameter"]] = row["value"]
            named[row["channel"]] = row["candidate"], row["whiteness"]
    elements = {
        (row["channel"], row["candidate"], row["parameter_a"], row["parameter_b"]): row["information"]
        for row in informations.to_pylist()
    }
    form_of = {name: form for form, name in CANDIDATES.items()}
    found = {}
    for channel, parameters in chosen.items():
        name, whiteness = named[channel]
        theta = np.log(np.array(list(parameters.values())))
        information = np.array([[elements[channel, name, a, b] for b in parameters] for a in parameters])
        found[channel] = Candidate(form_of[name], theta, information, 0.0, np.nan, whiteness, False, True)
    return found


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
