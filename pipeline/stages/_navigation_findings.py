"""What is to be said of a navigation: steps coasted, aids lost, measurements refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models.navigation_problem import AidName, Fixes, Imu, Navigation
from pipeline.numerics.sampling import runs
from pipeline.stages._navigation_outages import Outage
from pipeline.stages._navigation_problem import AID_TABLES
from pipeline.stages.base import Severity, counted, finding

Mask = NDArray[np.bool_]
Row = dict[str, Any]

_MOST = 20
"""Outages of an aid with a finding of their own; the others are in one more."""

_MANY = 0.2
"""Share of refused measurements from which more than outliers are to be suspected."""
_DOUBT = "; so many: are its unit, axes, clock and sigma right, and the start?"


def of_sensors(imu: Imu, origin: int) -> Iterator[Row]:
    """Steps whose samples were missing or not numbers."""
    found = runs(imu.coasted)
    if len(found):
        length = imu.time[found.stop] - imu.time[found.start]
        count = int(imu.coasted.sum())
        places = f"in {len(found)} places of at most" if len(found) > 1 else "over"
        detail = (
            f"{counted(count, 'step')} without usable samples, {places} {length.max():.3f} s: bridged "
            "linearly, and marked coasted"
        )
        ends = imu.time[found.start[0]], imu.time[found.stop[-1]]
        yield _row("gyro", "coasted", "warning", detail, ends, origin, count)


def of_aids(
    aids: Mapping[AidName, Fixes], lost: Mapping[AidName, Sequence[Outage]], imu: Imu, origin: int
) -> Iterator[Row]:
    """Aids that never aid, and the outages of the others."""
    whole = float(imu.time[0]), float(imu.time[-1])
    for aid, fixes in aids.items():
        if aid not in lost:
            found = f"none of {counted(len(fixes.time), 'measurement')} is usable"
            detail = f"{found}: every method goes on without it"
            yield _row(AID_TABLES[aid], "never valid", "warning", detail, whole, origin, len(fixes.time))
            continue
        outages = lost[aid]
        for one in outages[:_MOST]:
            detail = f"no usable measurement for {one.end - one.start:.3f} s"
            yield _row(AID_TABLES[aid], "outage", "info", detail, (one.start, one.end), origin)
        rest = outages[_MOST:]
        if rest:
            total = sum(one.end - one.start for one in rest)
            detail = f"{len(rest)} more outages, {total:.3f} s together"
            ends = rest[0].start, rest[-1].end
            yield _row(AID_TABLES[aid], "outage", "info", detail, ends, origin, len(rest))
    if not lost:
        detail = "nothing aids: every method has the inertial sensors alone, and its error grows"
        yield _row("gyro", "no aid", "warning", detail, whole, origin)


def of_gates(navigations: Sequence[Navigation], origin: int) -> Iterator[Row]:
    """Measurements that a method did not believe."""
    for one in navigations:
        for aid, tried in one.innovations.items():
            refused = gated(tried.value, tried.accepted)
            count = int(refused.sum())
            if count:
                at = tried.time[refused]
                tries = count + int(tried.accepted.sum())
                detail = (
                    f"{one.method}: {counted(count, 'measurement')} of {tries} too far from what was "
                    f"predicted: not used{_DOUBT if count > _MANY * tries else ''}"
                )
                ends = float(at[0]), float(at[-1])
                yield _row(AID_TABLES[aid], "refused", "warning", detail, ends, origin, count)


def gated(value: NDArray[np.float64], accepted: Mask) -> Mask:
    """Measurements that were looked at and not used; a NaN was not looked at."""
    looked_at = np.isfinite(value).all(axis=tuple(range(1, value.ndim)))
    return np.asarray(looked_at & ~accepted, dtype=np.bool_)


def of_start(contradiction: str, imu: Imu, origin: int) -> Row:
    """A start that the satellites contradict."""
    whole = float(imu.time[0]), float(imu.time[-1])
    return _row("gnss_position", "start contradicted", "error", contradiction, whole, origin)


def of_reference(imu: Imu, origin: int) -> Row:
    """What levelling by accelerometers cannot tell."""
    whole = float(imu.time[0]), float(imu.time[-1])
    detail = (
        "loops: reference A levels by the accelerometers, and takes a bias b of theirs in straight flight "
        "for a tilt of b/g: there the estimate of the bias does not converge to b"
    )
    return _row("accelerometer", "bias as tilt", "info", detail, whole, origin)


def of_idle_attitude(reference: str, imu: Imu, origin: int) -> Row:
    """An external attitude that the loops do not look at."""
    whole = float(imu.time[0]), float(imu.time[-1])
    detail = f"loops: with attitude_reference {reference!r} they do not use it; with 'X' they follow it"
    return _row("external_attitude", "not followed", "info", detail, whole, origin)


def not_done(method: str, reason: str, imu: Imu, origin: int) -> Row:
    """A method that failed where another did not."""
    whole = float(imu.time[0]), float(imu.time[-1])
    return _row("gyro", "method not done", "error", f"{method}: {reason}", whole, origin)


def _row(
    stream: str,
    kind: str,
    severity: Severity,
    detail: str,
    ends: tuple[float, float],
    origin: int,
    count: int = 1,
) -> Row:
    start, end = (origin + round(second * 1e9) for second in ends)
    return finding("navigate", stream, kind, severity, detail, start=start, end=end, count=count)
