"""The rates of a gyro corrected by a calibration, before the axes of the plan are turned.

Corrected are scale factors, misalignments, biases and what depends on temperature; the stamps stay as they
are, so that a time offset of the calibration is not applied. The standard error that the calibration leaves
is the same error throughout a record, not a new one in each sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from pipeline.errors import ExitCode
from pipeline.models.earth import DEGREES_PER_HOUR, RATE
from pipeline.plan_faults import Fault
from pipeline.stages._calibration_file import Calibration, CalibrationError
from pipeline.stages._runs import is_bare
from pipeline.stages._samples import Float, Mask, Samples
from pipeline.stages.base import finding
from pipeline.stages.channel_map import Stream
from pipeline.stages.quantities import StreamName

_BEYOND = 1.001
"""Of the largest rate of the calibration: what lies beyond it is said."""
_WARMER = 0.05
"""Of the range of temperatures of the calibration, which are means of steps: what lies further is said."""


def calibration_faults(streams: Mapping[StreamName, Stream]) -> Iterator[Fault]:
    """A calibration where no rates are, or one that is not beside the recording; keys from ``[streams]``."""
    for name, stream in streams.items():
        if stream.calibration is None:
            continue
        if name != "gyro" or stream.quantity != "angular_rate":
            expected = "calibration only in the stream 'gyro', with quantity 'angular_rate'"
            found = f"it in the stream {name!r}, with quantity {stream.quantity!r}"
            remedy = "remove it, or record rates" if name == "gyro" else "remove it"
            yield Fault((name, "calibration"), expected, found, remedy)
        elif not is_bare(stream.calibration):
            expected = "the bare name of a file beside the recording"
            remedy = "put it there, and leave the folder out"
            yield Fault((name, "calibration"), expected, repr(stream.calibration), remedy)


def corrected(samples: Samples, calibration: Calibration, temperature: Samples | None) -> Samples:
    """The samples of a gyro with its rates corrected, and what is to be said of it.

    Parameters
    ----------
    samples : Samples
        Rates by unit and scale of the plan.
    calibration : Calibration
    temperature : Samples or None
        Of the gyro, if it was recorded.

    Raises
    ------
    CalibrationError
        If the calibration is of other channels, or needs a temperature that is not there (exit code 2).
    """
    _require_same_channels(samples, calibration)
    samples = replace(samples, values=samples.values.copy(), findings=list(samples.findings))
    _spread_missing(samples, calibration)
    warm = _temperature_at(samples, temperature, calibration) if calibration.thermal else None
    errors = np.empty_like(samples.values)
    beyond, impossible = np.zeros((2, len(samples.time)), dtype=np.bool_)
    with np.errstate(all="ignore"):  # infinities that were recorded
        for channels, model in calibration.models.items():
            places = [samples.channels.index(channel) for channel in channels.split()]
            raw = samples.values[:, places]
            rate, error = model.apply(raw if len(places) > 1 else raw[:, 0], warm)
            lost = ~np.isfinite(rate.reshape(raw.shape)).all(axis=1)
            impossible |= np.isfinite(raw).all(axis=1) & lost
            samples.values[:, places] = rate.reshape(raw.shape)
            errors[:, places] = error.reshape(raw.shape)
            size = np.abs(samples.values[:, places])
            largest = _BEYOND * calibration.largest_rate[channels]
            beyond |= ((size > largest) & np.isfinite(size)).any(axis=1)
    _say(samples, calibration, errors)
    limits = {f"{calibration.largest_rate[c]:.6g} rad/s" for c in calibration.models}
    detail = f"beyond the largest rate that was calibrated with, {' or '.join(sorted(limits))}"
    samples.say("beyond the calibration", "warning", detail, beyond)
    detail = "with an output that the calibrated gyro cannot have at any rate, which becomes NaN"
    samples.say("not corrected", "warning", detail, impossible)
    if warm is not None:
        _say_extrapolated(samples, calibration, warm)
    return samples


def _require_same_channels(samples: Samples, calibration: Calibration) -> None:
    if set(samples.channels) != set(calibration.channels):
        raise CalibrationError(
            calibration.where,
            expected=f"a calibration of the channel{'s'[: len(samples.channels) > 1]} "
            f"{', '.join(samples.channels)} of the test plan",
            found=f"one of {', '.join(calibration.channels)}",
            remedy="map the channels that are calibrated, or name the calibration of this gyro",
            exit_code=ExitCode.USAGE,
        )


def _spread_missing(samples: Samples, calibration: Calibration) -> None:
    """Each rate of a triad is made of all three outputs: where one is missing none is known."""
    if len(calibration.models) < len(calibration.channels):
        missing = ~np.isfinite(samples.values)
        some: Mask = np.logical_or.reduce(missing, axis=1)
        all_: Mask = np.logical_and.reduce(missing, axis=1)
        detail = "in which one of three gyros gave no number: without it the calibration gives none"
        samples.say("missing value", "warning", detail, some & ~all_)
        samples.values[some] = np.nan


def _temperature_at(samples: Samples, temperature: Samples | None, calibration: Calibration) -> Float:
    """Temperature at each sample [K], shape (n,): straight between its samples, and constant beyond."""
    finite = None if temperature is None else np.isfinite(temperature.values[:, 0])
    if temperature is None or finite is None or not finite.any():
        raise CalibrationError(
            calibration.where,
            expected="the temperature of the gyro, for a calibration with terms of it",
            found="no stream 'temperature'" if temperature is None else "no number in the stream",
            remedy="add [streams.temperature] to the test plan, or calibrate without these terms",
            exit_code=ExitCode.USAGE if temperature is None else ExitCode.INPUT,
        )
    order = np.argsort(temperature.time[finite], kind="stable")
    time, value = temperature.time[finite][order], temperature.values[finite, 0][order]
    origin = time[0]
    samples.say(
        "temperature missing",
        "warning",
        "before the first or after the last temperature, which is taken to be that",
        (samples.time < time[0]) | (samples.time > time[-1]),
    )
    return np.asarray(np.interp(samples.time - origin, time - origin, value), dtype=np.float64)


def _say_extrapolated(samples: Samples, calibration: Calibration, warm: Float) -> None:
    """Where the temperature is beyond those that were calibrated with."""
    beyond: Mask = np.zeros(len(warm), dtype=np.bool_)
    for low, high in calibration.temperatures.values():
        margin = _WARMER * (high - low)
        beyond |= (warm < low - margin) | (warm > high + margin)
    ranges = {f"{low:.6g} K to {high:.6g} K" for low, high in calibration.temperatures.values()}
    detail = f"at a temperature beyond those that were calibrated with, {' or '.join(sorted(ranges))}"
    samples.say("beyond the calibration", "warning", detail, beyond)


def _say(samples: Samples, calibration: Calibration, errors: Float) -> None:
    """Which calibration was applied, and how well it tells the rates at worst."""
    finite = np.where(np.isfinite(errors), errors, 0.0)
    known = [
        f"{largest / RATE * DEGREES_PER_HOUR:.3g} deg/h in {c}"
        for c, largest in zip(samples.channels, finite.max(axis=0), strict=True)
    ]
    methods = ", ".join(dict.fromkeys(calibration.methods.values()))
    detail = (
        f"corrected by {calibration.where}, from the recording {calibration.recording!r} "
        f"({calibration.recording_name!r}, by {methods}); the calibration's standard error is at most "
        f"{', '.join(known)}; a time offset is not applied"
    )
    start, end, count = int(samples.time.min()), int(samples.time.max()), len(samples.time)
    samples.findings.append(
        finding("ingest", samples.name, "calibrated", "info", detail, start=start, end=end, count=count)
    )
