"""From a sensor's samples to a recording: what the transport does to them, and the files that are written.

Beside the recording ``run.mcap`` go its test plan ``run.toml`` and its truth ``run.truth.json``: the
settings, the seed, and where each fault was put.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import formats
from pipeline.errors import writing
from pipeline.simulate.imperfections import (
    SimulationError,
    TimingErrors,
    generator,
    in_seconds,
    nanoseconds,
    samples_at,
    within,
)
from pipeline.simulate.streams import Recorded, RecordedStream

Float = NDArray[np.float64]
Time = NDArray[np.int64]

SUFFIXES = (".mcap", ".bag", "", ".csv")
"""How the name of a simulated recording may end: MCAP, ROS 1 bag, ROS 2 bag with db3 storage, text."""

START = 1_767_225_600_000_000_000
"""2026-01-01T00:00:00Z in nanoseconds of Unix time."""


def transmitted(
    instants: Time, values: Float, rate: float, start: int, timing: TimingErrors, seed: int
) -> tuple[Recorded, dict[str, Any]]:
    """A sensor's samples in the order in which they are recorded, and where their faults lie.

    Parameters
    ----------
    instants : ndarray of int64, shape (n,)
        When the samples were taken [ns from the record's start].
    values : ndarray, shape (n, k)
        What the sensor gave.
    rate : float
        Samples a second [Hz].
    start : int
        Unix time of the record's start [ns].
    timing : TimingErrors
        What is wrong with the stamps and the transport.
    seed : int
        Seed.

    Returns
    -------
    recorded : Recorded
    faults : dict
        Counts of lost and NaN samples; stamps of those that go back or are repeated; edges of the gaps [ns].
    """
    count, seconds = len(instants), in_seconds(instants)
    bursts = within(timing.nan_bursts, seconds)
    given = np.where(bursts[:, np.newaxis], np.nan, values)

    true = start + instants
    stamps = true + round(1e9 * timing.clock_offset)
    stamps += nanoseconds(timing.stamp_noise * generator(seed, "stamp noise").standard_normal(count))
    backward = samples_at(timing.backward_stamps, seconds, "backward_stamps")
    stamps[backward] -= round(1.5e9 / rate)

    lost = within(timing.gaps, seconds)
    repeated = samples_at(timing.repeated_samples, seconds, "repeated_samples")
    order = np.sort(np.concatenate((np.flatnonzero(~lost), repeated[~lost[repeated]])))
    faults = {
        "lost": int(lost.sum()),
        "nan": int((bursts & ~lost).sum()),
        "backward_stamps": [int(stamps[i]) for i in backward if not lost[i]],
        "repeated_stamps": [int(stamps[i]) for i in repeated if not lost[i]],
        "gaps": [[int(true[a]), int(true[b])] for a, b in _edges(lost)],
    }
    late = np.abs(timing.log_jitter * generator(seed, "log jitter").standard_normal(count))
    log_time = true + nanoseconds(timing.log_delay + late)
    return Recorded(np.maximum.accumulate(log_time[order]), stamps[order], given[order]), faults


def _edges(lost: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Last sample before and first after each run of lost samples, where there are both."""
    change = np.flatnonzero(np.diff(lost.astype(np.int8)))
    starts = [int(i) for i in change if not lost[i]]
    return [(i, int(np.flatnonzero(~lost[i + 1 :])[0]) + i + 1) for i in starts if not lost[i + 1 :].all()]


def recorded_as_text(path: Path) -> bool:
    """Whether the name's end asks for a text file.

    Raises
    ------
    SimulationError
        If it is none of `SUFFIXES`.
    """
    if path.suffix not in SUFFIXES:
        raise SimulationError(
            str(path),
            expected="a name that ends in .mcap, .bag or .csv, or has no suffix (a ROS 2 bag, db3)",
            found=repr(path.suffix),
            remedy="rename the recording",
        )
    return path.suffix == ".csv"


def write_recording(
    path: Path, streams: Sequence[RecordedStream], plan: str, truth: Mapping[str, Any]
) -> tuple[Path, Path, Path]:
    """Write a recording, its test plan and its truth.

    Parameters
    ----------
    path : Path
        The recording, in the format that the name's end asks for, see `SUFFIXES`: a file, or for db3 a folder
        that is not there yet.
    streams : sequence of RecordedStream
        What was recorded.
    plan : str
        The test plan, as TOML.
    truth : mapping
        What JSON can hold.

    Returns
    -------
    recording, plan, truth : Path

    Raises
    ------
    SimulationError, pipeline.formats.base.RecordingError
        If it cannot be written.
    """
    beside = path.with_suffix(".toml"), path.with_suffix(".truth.json")
    with writing(path, SimulationError):
        path.parent.mkdir(parents=True, exist_ok=True)
        formats.write(path, list({id(stream.series): stream.series for stream in streams}.values()))
        beside[0].write_text(plan, encoding="utf-8")
        beside[1].write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")
    return path, *beside
