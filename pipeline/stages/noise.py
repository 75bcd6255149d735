"""Noise: what the errors of a gyro at rest are.

The Allan family and the noise coefficients that it shows, and the random error that the periodogram
shows (debiased Whittle likelihood, chosen by BIC): two looks at the same samples, side by side. A
gap stays a gap for both. Motion is found, and refused unless the test plan says what to do about it. Where
the record was made on a turning table harmonics of its angle are taken out, and the chosen model is held
against the error that is integrated along the axes of the room.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal, Self, get_args

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.errors import ExitCode
from pipeline.models.random_error_fit import Identified, fit_forms
from pipeline.models.random_error_forms import forms
from pipeline.models.rotation_record import Demodulation, demodulate, without_harmonics
from pipeline.numerics import allan, cosine_spectrum
from pipeline.numerics.noise_coefficients import NoiseCoefficients, fit_coefficients
from pipeline.plan_faults import Fault, refuse
from pipeline.stages import _noise_findings as about
from pipeline.stages import _noise_tables as as_table
from pipeline.stages._noise_motion import motions
from pipeline.stages._noise_record import Channel, Record, record_of, with_part
from pipeline.stages._static_turntable import turned
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import StageError, Stand, Tables, metric, rows

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME: tuple[str, ...] = ("gyro", "gyro_increments", "turntable")
PRODUCES: tuple[str, ...] = (
    "allan",
    "noise_coefficients",
    "noise_model",
    "noise_information",
    "spectrum",
    "findings",
    "metrics",
)
METRICS: tuple[str, ...] = (
    "whiteness",
    "duration",
    "sample_count",
    "motion_count",
    "demodulated_ratio",
    "demodulated_probability",
)

_ALIKE = 0.01
"""Part by which an averaging time of a plan may be below the mean interval of the samples, and mean it."""

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]


Colour = Literal["white", "noise1", "noise2", "noise3"]
AddedTerm = Literal["rate_random_walk", "quantisation"]


class Settings(_Settings):
    """Averaging times, estimators, candidates, and what to do about gaps and motion."""

    estimators: tuple[allan.Kind, ...] = Field(
        allan.KINDS, min_length=1, description="deviations to compute: allan, modified, hadamard, total"
    )
    shortest_tau: float | None = Field(
        None, gt=0, description="shortest averaging time, s; None: the interval of the samples"
    )
    longest_tau: float | None = Field(
        None, gt=0, description="longest averaging time, s; None: the longest that the record allows"
    )
    tau_count: int = Field(
        48, ge=2, le=10_000, description="averaging times, evenly spaced in their logarithm"
    )
    confidence: float = Field(0.95, gt=0, lt=1, description="probability of the deviations' intervals")
    candidates: tuple[Colour, ...] = Field(
        get_args(Colour), min_length=1, description="models of the random error to choose from"
    )
    added_terms: tuple[AddedTerm, ...] = Field(
        get_args(AddedTerm), description="terms that each candidate is tried with and without"
    )
    motion: Literal["refuse", "cut", "keep"] = Field(
        "refuse", description="what to do about motion in the record; cut: leave it out in every channel"
    )
    max_gap: float = Field(
        1.8, ge=1, description="longest interval between samples that is no gap, in nominal intervals"
    )

    @model_validator(mode="after")
    def _tau_rises(self) -> Self:
        low, high = self.shortest_tau, self.longest_tau
        if low is not None and high is not None and low >= high:
            expected = f"more than shortest_tau, {low:g} s"
            refuse([Fault(("longest_tau",), expected, f"{high:g} s", "raise it")])
        return self


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Identify the noise of each channel that was recorded.

    Parameters
    ----------
    tables : mapping
        ``gyro`` or ``gyro_increments``; ``turntable`` where the gyro was turned.
    settings : Settings
    stand : Stand
        Not needed here.

    Returns
    -------
    dict
        The tables of `PRODUCES`.

    Raises
    ------
    StageError
        If the record holds no noise to identify, is too short for the averaging time asked for, or moves.
    """
    record = record_of(tables, settings.max_gap)
    marked = list(about.stamps(record))
    table = turned(tables, record)
    if table is not None:
        record = _without_table(record, *table)
        marked.append(about.table(record.stream))
    moved = [motion for channel in record.channels for motion in motions(channel)]
    if moved and settings.motion == "refuse":
        raise about.moves(record, moved)
    marked += [about.moved(record, motion, settings.motion) for motion in moved]
    if moved and settings.motion == "cut":
        kept = np.ones(len(record.channels[0].rate), dtype=np.bool_)
        for motion in moved:
            kept[motion.start : motion.stop] = False
        record = with_part(record, kept)
    tables_of: dict[str, list[dict[str, Any]]] = {name: [] for name in PRODUCES}
    tables_of["findings"] += marked
    for channel in record.channels:
        found, made = _of_channel(record, channel, settings)
        if table is not None:
            test = demodulate(found.chosen.model, channel.rate, table[0], record.step, channel.present)
            made["metrics"] += _demodulated(channel.name, test)
            made["findings"] += about.demodulation(record.stream, channel.name, test)
        for name, items in made.items():
            tables_of[name] += items
    tables_of["metrics"].append(metric("noise", record.stream, "motion_count", len(moved), "1"))
    return {name: rows(name, items) for name, items in tables_of.items()}


def _without_table(record: Record, angle: Float, known: Mask) -> Record:
    """The record without harmonics of the table's angle, as long as that is known."""
    kept = with_part(record, known)
    channels = tuple(
        Channel(one.name, without_harmonics(one.rate, angle, one.present), one.present)
        for one in kept.channels
    )
    return replace(kept, channels=channels)


def _demodulated(channel: str, test: Demodulation | None) -> Iterator[dict[str, Any]]:
    """The integrated error over whole turns against its prediction."""
    ratio, error = (None, None) if test is None else (test.ratio, test.ratio_error)
    yield metric("noise", channel, "demodulated_ratio", ratio, "1", error)
    probability = None if test is None else test.probability
    yield metric("noise", channel, "demodulated_probability", probability, "1")


def _of_channel(
    record: Record, channel: Channel, settings: Settings
) -> tuple[Identified, dict[str, list[dict[str, Any]]]]:
    """The candidates of one channel, and its rows of every table."""
    integral = allan.from_rates(channel.rate, record.step, channel.present)
    told = _coefficients(integral)
    model = None if isinstance(told, str) else told
    periodogram = cosine_spectrum.periodogram(channel.rate, channel.present)
    wanted = forms(tuple(dict.fromkeys(settings.candidates)), tuple(dict.fromkeys(settings.added_terms)))
    found = Identified(fit_forms(periodogram, record.step, wanted), periodogram.samples)
    fitted = found.chosen.model
    of_allan = [
        row
        for kind in settings.estimators
        for variances in [allan.variances(integral, _factors(integral, channel.name, kind, settings), kind)]
        for row in as_table.allan_rows(channel.name, integral, variances, settings.confidence, model, fitted)
    ]
    unfitted = [] if periodogram.walks or "rate_random_walk" not in settings.added_terms else [
        about.no_walk(record.stream, channel.name)
    ]  # fmt: skip
    count = int(np.count_nonzero(channel.present))

    def figure(name: str, value: float, unit: str) -> dict[str, Any]:
        return metric("noise", channel.name, name, value, unit)

    return found, {
        "allan": of_allan,
        "noise_coefficients": [] if model is None else list(as_table.coefficient_rows(channel.name, model)),
        "noise_model": list(as_table.model_rows(channel.name, found)),
        "noise_information": list(as_table.information_rows(channel.name, found)),
        "spectrum": list(as_table.spectrum_rows(channel.name, periodogram, record.step, found.chosen)),
        "findings": [
            *about.coefficients(record.stream, channel.name, told),
            *unfitted,
            *about.model(record, channel, found, model),
        ],
        "metrics": [
            figure("whiteness", found.chosen.whiteness, "1"),
            figure("duration", count * record.step, "s"),
            figure("sample_count", count, "1"),
        ],
    }


def _coefficients(integral: allan.Record) -> NoiseCoefficients | str:
    """The coefficients, or why there are none."""
    try:
        return fit_coefficients(integral)
    except allan.UnusableRecordError as error:
        return str(error)


def _factors(record: allan.Record, channel: str, kind: allan.Kind, settings: Settings) -> NDArray[np.int64]:
    """Averaging times as multiples of the step.

    Raises
    ------
    StageError
        If the record is too short for the longest asked for, or too coarse for it.
    """
    try:
        possible = allan.spaced_factors(record, settings.tau_count, kind)
    except allan.UnusableRecordError as error:
        raise StageError(
            f"stage noise, channel {channel}, estimator {kind}",
            expected="stretches of at least three samples without a gap",
            found=str(error),
            remedy="leave the estimator out of noise.estimators, or raise noise.max_gap",
            exit_code=ExitCode.INPUT,
        ) from error
    longest, shortest = int(possible[-1]) * record.step, record.step
    asked = settings.longest_tau
    if asked is not None and asked > longest * (1 + 1e-9):
        raise StageError(
            f"test plan, key noise.longest_tau, channel {channel}",
            expected=f"at most {_below(longest)} s, the longest averaging time of the {kind} deviation that "
            f"{record.runs.max()} samples every {record.step:.6g} s without a gap allow",
            found=f"{asked:g} s",
            remedy="lower it, leave it or the estimator out, or record longer",
            exit_code=ExitCode.USAGE,
        )
    low, high = settings.shortest_tau or shortest, asked or longest
    if high < shortest or low > high or low < shortest * (1 - _ALIKE):
        raise StageError(
            f"test plan, keys noise.shortest_tau and longest_tau, channel {channel}",
            expected=f"averaging times of the {kind} deviation from {shortest:.6g} s, the interval of the "
            f"samples, to {_below(longest)} s",
            found=f"{low:g} to {high:g} s",
            remedy="change or leave out the one that is beyond",
            exit_code=ExitCode.USAGE,
        )
    if settings.shortest_tau is None and asked is None:
        return possible
    ends = np.clip(np.rint(np.array([low, high]) / record.step), 1, possible[-1])
    return np.unique(np.rint(np.geomspace(ends[0], ends[1], settings.tau_count)).astype(np.int64))


def _below(seconds: float) -> str:
    """Four digits, not rounded up: what is said to be possible is."""
    size = 10.0 ** (np.floor(np.log10(seconds)) - 3)
    return f"{np.floor(seconds / size * (1 + 1e-12)) * size:.4g}"
