"""The time of samples, by the clock that the test plan chooses."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.formats.base import CLOCKS
from pipeline.stages.base import StageError
from pipeline.stages.channel_map import Clock

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]

_TIME_LIMIT = 2.0**63
_EXACT = 2.0**53
"""Counts up to here are exact in float64."""


def sample_times(topic: pa.Table, clock: Clock, where: str) -> tuple[Time, Mask]:
    """Time of each row of a topic by the clock of the plan, and whether it has one.

    Parameters
    ----------
    topic : pyarrow.Table
        As `pipeline.formats.read` gives it, n rows.
    clock : Clock
    where : str
        Recording and stream, for errors.

    Returns
    -------
    time : ndarray of int64, shape (n,)
        [ns]; without meaning where there is none.
    there : ndarray of bool, shape (n,)

    Raises
    ------
    StageError
        If the messages do not carry that clock, or counts do not fit rate or wraps_at (exit code 2).
    """
    if clock.rate is not None:
        if clock.counter is None:
            count: Float = np.arange(topic.num_rows, dtype=np.float64)
        else:
            count = numbers(topic.column(clock.counter))
        return _counted(count, clock, clock.rate, where)
    column = clock.clock or clock.field
    if column not in topic.column_names:
        there = [name for name in CLOCKS if name in topic.column_names]
        raise StageError(
            where,
            expected=f"the clock {column}",
            found=f"the clocks {', '.join(there)}" if there else "a recording whose samples carry no clock",
            remedy=f'choose clock = "{there[-1]}"' if there else "choose field = … and unit = …, or rate = …",
            exit_code=ExitCode.USAGE,
        )
    recorded = topic.column(column)
    return np.asarray(pc.fill_null(recorded, 0).to_numpy(), dtype=np.int64), valid(recorded)


def _counted(count: Float, clock: Clock, rate: float, where: str) -> tuple[Time, Mask]:
    """Time of samples by their count: count / rate, exact in the first, so that streams agree.

    Parameters
    ----------
    count : ndarray, shape (n,)
        Count of each sample; NaN where it is missing.
    """
    there = np.isfinite(count) & (np.abs(count) <= _EXACT)
    counts = count[there].astype(np.int64)
    if clock.wraps_at is not None and counts.size:
        counts = _unwrapped(counts, clock.wraps_at, where)
    time = np.zeros(len(count), dtype=np.int64)
    if counts.size:
        first = round(int(counts[0]) * 10**9 / Fraction(rate))
        since = np.rint((counts - counts[0]) / rate * 1e9)
        if abs(first) + float(np.abs(since).max()) >= _TIME_LIMIT:
            raise StageError(
                where,
                expected="times within 64-bit nanoseconds",
                found=f"counts up to {int(np.abs(counts).max())} at {rate:g} Hz",
                remedy="correct rate and counter in the test plan",
                exit_code=ExitCode.USAGE,
            )
        time[there] = first + since.astype(np.int64)
    return time, there


def _unwrapped(counts: Time, modulus: int, where: str) -> Time:
    """Counts without wrap-around: each step is taken as the shortest way round."""
    outside = (counts < 0) | (counts >= modulus)
    if outside.any():
        raise StageError(
            where,
            expected=f"counts from 0 to {modulus - 1}, as wraps_at says",
            found=str(counts[outside][0]),
            remedy="correct wraps_at in the test plan",
            exit_code=ExitCode.USAGE,
        )
    half = modulus // 2
    steps = (np.diff(counts) + half) % modulus - half
    return np.asarray(counts[0] + np.concatenate(([0], np.cumsum(steps))), dtype=np.int64)


def refuse_idle_stamps(time: Time, topic: pa.Table, clock: Clock, where: str) -> None:
    """Header stamps that nobody ever set are no clock.

    Raises
    ------
    StageError
        If header stamps are the clock, and all times of the samples are 0.
    """
    if clock.clock == "header_stamp" and not time.any():
        others = [name for name in CLOCKS[1:] if name in topic.column_names]
        raise StageError(
            where,
            expected="header stamps that advance",
            found="header stamps that are all 0: the sender never set them",
            remedy=f"choose {' or '.join(others)} as the clock",
            exit_code=ExitCode.USAGE,
        )


def numbers(column: pa.ChunkedArray) -> Float:
    """A column of numbers as an array, NaN where it is null."""
    return np.asarray(pc.fill_null(column, np.nan).to_numpy(), dtype=np.float64)


def valid(column: pa.ChunkedArray) -> Mask:
    """Where a column is not null."""
    return np.asarray(pc.is_valid(column).to_numpy(), dtype=np.bool_)
