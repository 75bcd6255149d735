"""The audit of units: whether the gyro turns as fast as the reference says, or as fast as a gyro can."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.alignment import covered, gain
from pipeline.numerics.sampling import Intervals
from pipeline.stages._audit_rows import StreamReport
from pipeline.stages._streams import Pair, pair
from pipeline.stages.base import Tables, counted

Float = NDArray[np.float64]

_FEWEST = 30
"""Intervals of the reference below which nothing is said about units."""

_DETERMINED = 0.5
"""Part of the gyro's power that the reference must explain. Noise alone explains about 9 parameters' worth:
9/90 at 30 intervals of three axes."""

_DEGREES = 180 / math.pi

_NEAR = 2.0
"""A ratio within this factor of 57.3 is a confusion of units: no gyro's scale factor is wrong by 2."""

_SUSTAINED = 0.01
"""Part of the samples above the plausible rate that is more than spikes."""

_AGREES = 0.1
"""Part of the held rate, and of the record's root mean square, within which a reference confirms it."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Gyro and reference of one recording, where both have enough samples."""

    records: Pair
    ratio: float
    """Rotation of the gyro over that of the reference."""
    determined: float
    """Part of the gyro's power that the reference explains."""

    def confirms(self, stream: str, start: int, stop: int, values: Float) -> bool:
        """Whether the reference turns at the rate that the gyro holds from start to stop [ns]."""
        if stream != self.records.stream:
            return False
        held = values if stream == "gyro" else values / self.records.gyro_intervals.nominal
        reference = self.records.reference
        inside = (reference.start >= (start - self.records.origin) * 1e-9) & (
            reference.stop <= (stop - self.records.origin) * 1e-9
        )
        length = float(reference.length[inside].sum())
        if length < 0.5e-9 * (stop - start):
            return False
        rate = reference.angle[inside].sum(axis=0) / length
        usual = float(np.sqrt(np.sum(reference.angle**2) / np.sum(reference.length**2)))
        return bool(np.linalg.norm(rate - held) <= _AGREES * max(float(np.linalg.norm(held)), usual))


_QUARTER = np.pi / 2 * (1 + 1e-6)
"""The largest |theta| [rad], and a little for six digits in a text file."""


def compare(tables: Tables) -> Comparison | None:
    """Compare the gyro with the reference; None where too little of them lies at common times."""
    records = pair(tables, _FEWEST)
    if records is None or records.gyro_intervals.batched:
        return None
    mask = covered(records.reference, records.gyro.time, 0.0, records.longest, records.margin)
    if np.count_nonzero(mask) < _FEWEST:
        return None
    ratio, determined = gain(records.reference.only(mask), records.gyro)
    return Comparison(records, ratio, determined)


def audit_units(
    report: StreamReport,
    values: Float,
    regular: Intervals | None,
    comparison: Comparison | None,
    max_plausible_rate: float,
) -> None:
    """Say where the unit that the test plan states can hardly be right.

    With a reference that explains half of what the gyro shows, the ratio of the two rotations decides.
    Without one only rates that are too high can be told: small ones are plausible in any unit.

    Parameters
    ----------
    values : ndarray, shape (n, k)
        Rates [rad/s] or angle increments [rad] of the gyro, one column a channel.
    """
    if comparison is not None and comparison.determined >= _DETERMINED:
        ratio = comparison.ratio
        report.figure("rotation_ratio", ratio)
        if 1 / _NEAR < ratio / _DEGREES < _NEAR:
            _contradicted(report, ratio, "the gyro's values are degrees where radians are stated")
        elif 1 / _NEAR < ratio * _DEGREES < _NEAR:
            _contradicted(report, ratio, "the gyro's values are radians where degrees are stated")
        elif not 1 / _NEAR < ratio < _NEAR:
            text = f"the gyro turns {ratio:.3g} times as far as the reference; check its unit and scale"
            report.say("implausible unit", "error", text)
        return
    if report.stream == "gyro_increments" and regular is None:
        return
    rates = values / regular.nominal if regular is not None and report.stream == "gyro_increments" else values
    size = np.sqrt(np.sum(rates * rates, axis=1))
    fast = int(np.count_nonzero(size > max_plausible_rate))
    if fast > _SUSTAINED * len(size):
        report.say(
            "implausible unit",
            "warning",
            f"{fast} of {counted(len(size), 'sample')} above {max_plausible_rate:g} rad/s, median "
            f"{np.median(size):.4g} rad/s: degrees where radians are stated?",
            count=fast,
        )


def audit_attitude(report: StreamReport, theta: Float) -> None:
    """Say where the angles of a reference cannot be radians: theta lies within a quarter turn of zero."""
    beyond = int(np.count_nonzero(np.abs(theta) > _QUARTER))
    if beyond:
        report.say(
            "implausible unit",
            "error",
            f"theta exceeds a quarter turn in {counted(beyond, 'sample')}, which it cannot: degrees where "
            "radians are stated?",
            channel="theta",
            count=beyond,
        )


def _contradicted(report: StreamReport, ratio: float, what: str) -> None:
    report.say(
        "implausible unit",
        "error",
        f"the gyro turns {ratio:.4g} times as far as the reference: {what}, or the reference's unit is wrong",
    )
