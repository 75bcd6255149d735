"""The audit of values: samples that are NaN, frozen, clipped or spiking, and channels that say nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.sample_faults import clipped_runs, frozen_runs, spikes, usual_hold
from pipeline.numerics.sampling import Intervals, Runs, runs
from pipeline.numerics.steps import stuck_runs
from pipeline.stages._audit_rows import StreamReport
from pipeline.stages._audit_units import Comparison
from pipeline.stages.base import counted

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


_ANGLES = ("reference", "gimbal")
"""Streams of angles: they wrap, and one of them may rest."""

_TOO_LONG = "far longer than the signal elsewhere"


@dataclass(frozen=True, slots=True)
class Thresholds:
    """What counts as frozen, clipped or spiking; see the settings of the audit."""

    frozen_samples: int
    clipped_samples: int
    spike_factor: float


def audit_values(
    report: StreamReport,
    channels: Mapping[str, Float],
    thresholds: Thresholds,
    regular: Intervals | None,
    comparison: Comparison | None,
) -> None:
    """Mark the samples of one stream, channel by channel.

    Parameters
    ----------
    report : StreamReport
        Takes the findings and metrics.
    channels : mapping of name to ndarray, shape (n,)
        In SI.
    thresholds : Thresholds
    regular : Intervals, optional
        For the rate at which a held value really changes.
    comparison : Comparison, optional
        Gyro against reference, to tell a steady rate from a frozen one.
    """
    finite = audit_missing(report, channels)
    _say_silent_channels(report, channels, finite)
    if report.stream != "gimbal":  # an encoder holds a slow angle, by its quantum
        _say_held(report, channels, finite, regular)
    clipped, spiking = {}, {}
    for name, values in channels.items():
        index = np.flatnonzero(finite[name])
        # Angles jump by whole turns at ±pi, which is no spike; and an attitude has no rail.
        sound = np.unwrap(values[index]) if report.stream in _ANGLES else values[index]
        clipped[name] = (
            np.zeros(len(values), dtype=np.bool_)
            if report.stream == "reference"
            else _mark_clipped(report, name, index, sound, thresholds.clipped_samples)
        )
        spiking[name] = _mark_spikes(report, name, index, sound, thresholds.spike_factor)
    if report.stream == "gimbal":
        frozen = _mark_stuck(report, channels, finite, thresholds.frozen_samples)
    else:
        frozen = _mark_frozen(report, channels, finite, clipped, thresholds.frozen_samples, comparison)
    for kind, masks in (("clipped", clipped), ("spike", spiking), ("frozen", frozen)):
        _count(report, f"{kind}_count", masks)


def _count(report: StreamReport, name: str, masks: Mapping[str, Bool]) -> None:
    """How many samples each channel has of a kind, and how many have it in any channel."""
    for channel, mask in masks.items():
        report.figure(name, int(mask.sum()), channel=channel)
    report.figure(name, int(np.any(list(masks.values()), axis=0).sum()))


def audit_missing(report: StreamReport, channels: Mapping[str, Float]) -> dict[str, Bool]:
    """One finding where all channels are NaN together, and one a channel where it is alone.

    Returns
    -------
    dict
        Where each channel is finite, shape (n,).
    """
    finite = {name: np.isfinite(values) for name, values in channels.items()}
    missing = {name: ~mask for name, mask in finite.items()}
    together = np.all(list(missing.values()), axis=0)
    empty = [name for name, mask in missing.items() if mask.all()]
    for name in empty:
        report.say("missing channel", "error", "no finite value in the record", channel=name)
    if not together.all():
        _mark_nan(report, runs(together), None)
        for name, mask in missing.items():
            if name not in empty:
                _mark_nan(report, runs(mask & ~together), name)
    _count(report, "nan_count", missing)
    return finite


def _mark_nan(report: StreamReport, found: Runs, channel: str | None) -> None:
    which = "any channel" if channel is None else channel
    report.mark(
        "NaN",
        "warning",
        found,
        lambda i: f"{counted(found.length[i], 'sample')} without a finite value of {which}",
        channel=channel,
    )


def _say_silent_channels(
    report: StreamReport, channels: Mapping[str, Float], finite: Mapping[str, Bool]
) -> None:
    """Channels that hold one value throughout."""
    held = {
        name: float(values[finite[name]][0])
        for name, values in channels.items()
        if np.count_nonzero(finite[name]) > 1 and np.ptp(values[finite[name]]) == 0
    }
    alive = [name for name in channels if name not in held and finite[name].any()]
    if held and not alive:
        values = ", ".join(f"{name} = {value:.6g}" for name, value in held.items())
        report.say("constant", "warning", f"no channel ever changes: {values}")
        return
    for name, value in held.items():
        if value == 0 and report.stream not in _ANGLES:
            text = f"zero throughout, while {', '.join(alive)} {'move' if len(alive) > 1 else 'moves'}"
            report.say("missing channel", "error", text, channel=name)
        else:
            report.say("constant", "info", f"{value:.6g} throughout", channel=name)


def _mark_stuck(
    report: StreamReport, channels: Mapping[str, Float], finite: Mapping[str, Bool], minimum: int
) -> dict[str, Bool]:
    """Gimbal angles that hold their value while they should turn.

    Each angle by itself: one may well rest, and a coarse encoder holds a slow angle for many samples.
    """
    masks = {}
    for name, values in channels.items():
        index = np.flatnonzero(finite[name])
        if not len(index):
            masks[name] = np.zeros(len(values), dtype=np.bool_)
            continue
        found = _in_record(stuck_runs(np.unwrap(values[index]), minimum), index)
        _mark_hold(report, "frozen", found, name, "though it turns before and after")
        masks[name] = _mask(found, len(report.time))
    return masks


def _mark_frozen(
    report: StreamReport,
    channels: Mapping[str, Float],
    finite: Mapping[str, Bool],
    explained: Mapping[str, Bool],
    minimum: int,
    comparison: Comparison | None,
) -> dict[str, Bool]:
    """Frozen runs of all channels together, then of each alone where it is not clipped; as masks too.

    A single angle of a reference may well rest: the stand holds an axis, and an encoder has no noise.
    """
    held, frozen = _mark_held_together(report, channels, finite, minimum, comparison)
    masks = {}
    for name, values in channels.items():
        index = np.flatnonzero(finite[name])
        found = _in_record(frozen_runs(values[index], minimum), index)
        known = held | explained[name]
        alone = [not known[a:b].all() for a, b in zip(found.start, found.stop, strict=True)]
        found = _some(found, np.array(alone, dtype=np.bool_) & (report.stream != "reference"))
        _mark_hold(report, "frozen", found, name, _TOO_LONG)
        masks[name] = frozen | _mask(found, len(report.time))
    return masks


def _mark_held_together(
    report: StreamReport,
    channels: Mapping[str, Float],
    finite: Mapping[str, Bool],
    minimum: int,
    comparison: Comparison | None,
) -> tuple[Bool, Bool]:
    """Where all channels hold their values; and where they do and the reference does not confirm it."""
    index = np.flatnonzero(np.all(list(finite.values()), axis=0))
    values = np.stack([v[index] for v in channels.values()], axis=1)
    within = frozen_runs(values, minimum)
    found = _in_record(within, index)
    ends = zip(found.start, found.stop - 1, within.start, strict=True)
    confirmed = [
        comparison is not None
        and comparison.confirms(report.stream, report.time[first], report.time[last], values[at])
        for first, last, at in ends
    ]
    steady = np.array(confirmed, dtype=np.bool_)
    _mark_hold(report, "steady", _some(found, steady), None, "as the reference does")
    _mark_hold(report, "frozen", _some(found, ~steady), None, _TOO_LONG)
    count = len(report.time)
    return _mask(found, count), _mask(_some(found, ~steady), count)


def _mark_hold(report: StreamReport, kind: str, found: Runs, channel: str | None, why: str) -> None:
    which = "all channels hold their values" if channel is None else f"{channel} holds its value"
    report.mark(
        kind,
        "info" if kind == "steady" else "warning",
        found,
        lambda i: f"{which} for {counted(found.length[i], 'sample')}, bit for bit, {why}",
        channel=channel,
    )


def _say_held(
    report: StreamReport,
    channels: Mapping[str, Float],
    finite: Mapping[str, Bool],
    regular: Intervals | None,
) -> None:
    """A sensor slower than its record: values usually come several times over."""
    whole = np.all(list(finite.values()), axis=0)
    hold = usual_hold(np.stack([v[whole] for v in channels.values()], axis=1))
    if hold > 1 and regular is not None:
        report.say(
            "held",
            "info",
            f"each value usually comes {hold} times: the sensor gives about "
            f"{1 / regular.nominal / hold:.6g} Hz, or rests below its resolution",
        )


def _mark_clipped(report: StreamReport, channel: str, index: Int, values: Float, minimum: int) -> Bool:
    found = clipped_runs(values, minimum)
    at = values[found.start] if len(found) else values[:0]
    marked = _in_record(found, index)
    report.mark(
        "clipped",
        "warning",
        marked,
        lambda i: f"{counted(found.length[i], 'sample')} at {at[i]:.6g}, where the record is cut off",
        channel=channel,
        count=found.length,
    )
    return _mask(marked, len(report.time))


def _mark_spikes(report: StreamReport, channel: str, index: Int, values: Float, factor: float) -> Bool:
    at = np.flatnonzero(spikes(values, factor))
    height = values[at] - (values[at - 1] + values[at + 1]) / 2
    found = Runs(index[at], index[at] + 1)
    report.mark(
        "spike",
        "warning",
        found,
        lambda i: f"one sample {height[i]:+.6g} away from its neighbours",
        channel=channel,
    )
    return _mask(found, len(report.time))


def _in_record(found: Runs, index: Int) -> Runs:
    """Runs among chosen samples as runs in the record."""
    return Runs(index[found.start], index[found.stop - 1] + 1)


def _some(found: Runs, chosen: Bool) -> Runs:
    return Runs(found.start[chosen], found.stop[chosen])


def _mask(found: Runs, count: int) -> Bool:
    edges = np.zeros(count + 1, dtype=np.int64)
    np.add.at(edges, found.start, 1)
    np.add.at(edges, found.stop, -1)
    return np.asarray(np.cumsum(edges[:-1]) > 0, dtype=np.bool_)
