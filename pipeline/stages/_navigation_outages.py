"""When an aid is lost, and the phases of a navigation that this makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.navigation_problem import Fixes, Imu

Float = NDArray[np.float64]

Phase = Literal["aided", "outage", "reacquired"]
PHASES: tuple[Phase, ...] = get_args(Phase)

_AT_LEAST = 0.5
"""An aid is not lost sooner [s], however often it measures."""


@dataclass(frozen=True, slots=True)
class Outage:
    """A time without a usable measurement of an aid, from where the next was due to the next there is [s]."""

    start: float
    end: float


def outages(fixes: Fixes, imu: Imu, stale: float) -> tuple[Outage, ...]:
    """The outages of an aid while the inertial sensors record.

    Parameters
    ----------
    fixes : Fixes
        With at least one that is usable, all within the time of the increments.
    imu : Imu
    stale : float
        An aid is lost after so many of its usual intervals.
    """
    at = fixes.time[fixes.usable]
    usual = float(np.median(np.diff(at))) if len(at) > 1 else 0.0
    longest = max(stale * usual, _AT_LEAST)
    known = np.concatenate([[imu.time[0] - usual], at, [imu.time[-1]]])
    before = np.flatnonzero(np.diff(known) > longest)
    return tuple(Outage(float(known[i] + usual), float(known[i + 1])) for i in before)


def phases(time: Float, lost: Sequence[Outage] | None) -> list[Phase]:
    """The phase of each instant.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Increasing [s].
    lost : sequence of Outage, or None
        Of the satellites, in their order; None where there are none at all.
    """
    if lost is None:
        return ["outage"] * len(time)
    found = np.full(len(time), "aided", dtype=object)
    for one in lost:
        inside = (time >= one.start) & (time < one.end)
        # Satellites that were never there are not there again, but for the first time.
        if (found[time < one.start] == "aided").any():
            found[time >= one.end] = "reacquired"
        found[inside] = "outage"
    if lost and lost[-1].end >= time[-1]:
        found[(time >= lost[-1].start)] = "outage"
    return found.tolist()
