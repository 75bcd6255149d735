"""The runs of one gyro, in a gimbal or on a rate table: of which recording each is, and from when to when.

A test plan lists them as ``[[runs]]``; one that lists none has one run, the whole recording. How the base of
a gimbal is mounted in each is said here; how a case is mounted on a rate table, in `_mountings`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.errors import ExitCode
from pipeline.formats.base import RecordingError
from pipeline.models.earth import mounting_angles
from pipeline.plan_faults import Fault, refuse
from pipeline.stages.base import Mounting, StageError, Stand, rows
from pipeline.stages.channel_map import Name

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]
CaseAxis = Literal["p", "q", "r", "-p", "-q", "-r"]
"""An axis of the case of the gyro, or its opposite."""

WHOLE = "run"
"""Name of the one run of a plan that lists none."""

_ROUNDING = 1e-6
"""Of a turn: a text file writes the last value before the end of one as the end itself."""

_STRAY = 0.01
"""Share of the readings at each end that may be disturbed: they do not speak for the encoder's turn."""

_LONGEST = 1e9
"""Seconds, three decades: a time beyond it is a stamp that was taken for one."""


class Run(Mounting):
    """A run of the gyro; its mounting, where it is stated, stands in place of the stand's."""

    name: Name = Field(description="what the run is called")
    recording: Name | None = Field(
        None, description="name of a further recording, beside the one that the plan is for, that holds it"
    )
    start: float | None = Field(
        None,
        ge=0,
        le=_LONGEST,
        description="beginning, s from the first sample of the gimbal, or else of the gyro, in its recording",
    )
    stop: float | None = Field(
        None, gt=0, le=_LONGEST, description="end, counted as the beginning; what is recorded then is outside"
    )
    axis: CaseAxis | None = Field(
        None,
        description="of a gyro on a rate table: which axis of its case lies along the axis about which the "
        "table turns; left out where the case is not on the table",
    )
    across: CaseAxis | None = Field(
        None,
        description="beside axis: which axis of the case lies along axis 1 of the table (at "
        "stand.table_heading_deg) when the table's angle is 0",
    )

    @model_validator(mode="after")
    def _is_a_stretch_of_a_neighbour(self) -> Self:
        faults = []
        if self.recording is not None and not is_bare(self.recording):
            expected = "the bare name of a file or rosbag2 folder beside the recording"
            remedy = "put it there, and leave the folder out"
            faults.append(Fault(("recording",), expected, repr(self.recording), remedy))
        begin, end = self.stretch
        if end <= begin:
            expected = f"a stop after start = {begin:g}"
            faults.append(Fault(("stop",), expected, f"{end:g}", "correct one of them"))
        if self.across is not None and (self.axis is None or self.across[-1] == self.axis[-1]):
            found = f"{self.across!r} beside axis = {self.axis!r}" if self.axis else "no axis"
            remedy = "name another axis, or leave across out"
            faults.append(Fault(("across",), "an axis of the case square to axis", found, remedy))
        if faults:
            refuse(faults)
        return self

    @property
    def stretch(self) -> tuple[float, float]:
        """Beginning and end [s]; 0 and infinity where they are not given."""
        return self.start or 0.0, np.inf if self.stop is None else self.stop


def is_bare(name: str) -> bool:
    """Whether a name is one of a file in the same folder, and leads nowhere else."""
    return name not in (".", "..") and not set(name) & set("/\\\0")


def run_faults(runs: Sequence[Run]) -> Iterator[Fault]:
    """Runs of one name, and runs that share a stretch of their recording; keys from ``[[runs]]``."""
    for place, run in enumerate(runs):
        before = runs[:place]
        if run.name in (other.name for other in before):
            yield Fault(
                (place, "name"), "a name of its own for each run", repr(run.name), "rename one of them"
            )
        for other in before:
            if other.recording == run.recording and _overlap(other.stretch, run.stretch):
                expected = "runs of one recording that do not overlap"
                found = f"{run.name!r}, {_stretch(run)}, beside {other.name!r}, {_stretch(other)}"
                yield Fault((place,), expected, found, "correct recording, start or stop of one of them")
                break


def mounting_faults(runs: Sequence[Run], stand: Stand) -> Iterator[Fault]:
    """What is not said of how the runs are mounted, though gimbal angles mean nothing without it."""
    needed = (
        ("latitude_deg, the geodetic latitude", "none", ("latitude_deg",), "latitude_deg = …"),
        (
            "scheme or chi_deg, how the base is mounted",
            "neither",
            ("scheme", "chi_deg"),
            "scheme = … (polar, equatorial, horizontal or vertical) or chi_deg = [chi1, chi2, chi3]",
        ),
    )
    for meaning, found, keys, key in needed:
        if any(getattr(stand, k) is not None for k in keys):
            continue
        lacking = [r.name for r in runs if all(getattr(r, k) is None for k in keys)]
        if lacking or not runs:
            of = f", nor one of the run {lacking[0]!r}" if lacking else ""
            yield Fault(("stand",), f"{meaning}, of the gimbal", f"{found}{of}", f"add {key} to [stand]")


def neighbour(recording: Path, name: str) -> Path:
    """A recording beside another one, by its bare name."""
    return (recording.resolve() if recording.name in ("", "..") else recording).with_name(name)


def further_recordings(recording: Path, runs: Sequence[Run]) -> dict[str, Path]:
    """The further recordings that runs name, each once, in the order of the plan.

    Raises
    ------
    RecordingError
        If one of them is not there (exit code 3), or is the recording itself (exit code 2).
    """
    found = {}
    for name in dict.fromkeys(run.recording for run in runs if run.recording is not None):
        path = neighbour(recording, name)
        if not path.exists():
            near = get_close_matches(name, [p.name for p in path.parent.iterdir()], n=1)
            raise RecordingError(
                str(path),
                expected="the further recording that [[runs]] of the test plan names",
                found="no such file or folder",
                remedy=f"did you mean {near[0]!r}?" if near else "check the name",
            )
        if path.samefile(recording):
            raise RecordingError(
                str(path),
                expected="a further recording in [[runs]] of the test plan",
                found="the one that the plan is for",
                remedy=f"leave recording = {name!r} out",
                exit_code=ExitCode.USAGE,
            )
        found[name] = path
    return found


def listed(runs: Sequence[Run]) -> tuple[Run, ...]:
    """The runs of a plan; the whole recording where it lists none."""
    return tuple(runs) or (Run(name=WHOLE),)


def runs_table(runs: Sequence[Run], stand: Stand) -> pa.Table:
    """The table ``runs``: the mounting of each, from its own keys, else from the stand's.

    Raises
    ------
    StageError
        If a mounting is not said (exit code 2).
    """
    for fault in mounting_faults(runs, stand):
        raise StageError("[stand]", **_words(fault), exit_code=ExitCode.USAGE)
    return rows(
        "runs", [{"run": place, "name": run.name, **_mounted(run, stand)} for place, run in enumerate(runs)]
    )


def within(run: Run, time: Time, first: int) -> Mask:
    """Which samples belong to a run, counted from a first sample of its recording: up to, not with, its stop.

    Parameters
    ----------
    run : Run
    time : ndarray of int64, shape (n,)
    first : int
        [ns].
    """
    of: Mask = np.ones(len(time), dtype=np.bool_)
    if run.start is not None:
        of &= time >= first + round(run.start * 1e9)
    if run.stop is not None:
        of &= time < first + round(run.stop * 1e9)
    return of


def inside(run: Run, time: Time, where: str) -> Mask:
    """Which samples of the stream by which runs are counted belong to a run.

    Parameters
    ----------
    run : Run
    time : ndarray of int64, shape (n,)
        Times of the recording's samples [ns], in its order, n > 0.
    where : str
        Recording and stream, for the error.

    Raises
    ------
    StageError
        If there is none (exit code 2).
    """
    first = int(time[0])
    of = within(run, time, first)
    if not of.any():
        last = (int(time.max()) - first) * 1e-9
        raise StageError(
            where,
            expected=f"samples of the run {run.name!r}, {_stretch(run)}",
            found=f"none in a record from 0 to {last:.6g} s",
            remedy="correct start and stop of the run in the test plan",
            exit_code=ExitCode.USAGE,
        )
    return of


def unwrapped(values: Float, time: Time, period: float, where: str) -> Float:
    """Readings of an encoder that begins again after a period: in order of time each step is the shortest.

    ``y_j = x_j - P sum_{i <= j} rint((x_i - x_{i-1}) / P)``; readings that never step by more than half a
    period stay as they are.

    Parameters
    ----------
    values : ndarray, shape (n,)
        What is not finite stays so, and is passed over.
    time : ndarray of int64, shape (n,)
        [ns], in any order; of samples of one time the one recorded first comes first.
    period : float
        In the unit of the values.
    where : str
        Recording, stream and channel, for the error.

    Raises
    ------
    StageError
        If the readings, but for stray ones, lie farther apart than a period (exit code 2).
    """
    order = np.argsort(time, kind="stable")
    order = order[np.isfinite(values[order])]
    if not order.size:
        return values
    low = np.quantile(values[order], _STRAY, method="higher")
    high = np.quantile(values[order], 1 - _STRAY, method="lower")
    turns = float(high - low) / period
    if turns > 1 + _ROUNDING:
        raise StageError(
            where,
            expected="an encoder that begins again at wraps_at",
            found=f"values over {turns:.6g} times that",
            remedy="correct wraps_at in the test plan, or remove it where the angle is not wrapped",
            exit_code=ExitCode.USAGE,
        )
    steps = np.rint(np.diff(values[order]) / period)
    result = values.copy()
    result[order[1:]] -= period * np.cumsum(steps)
    return result


def _mounted(run: Run, stand: Stand) -> dict[str, object]:
    own = run if run.scheme is not None or run.chi_deg is not None else stand
    degrees = stand.latitude_deg if run.latitude_deg is None else run.latitude_deg
    assert degrees is not None, "checked by mounting_faults"
    latitude = float(np.deg2rad(degrees))
    if own.scheme is not None:
        chi = mounting_angles(own.scheme, latitude)
    else:
        assert own.chi_deg is not None, "checked by mounting_faults"
        chi1, chi2, chi3 = np.deg2rad(own.chi_deg).tolist()
        chi = (chi1, chi2, chi3)
    return {
        "scheme": own.scheme,
        "latitude": latitude,
        **dict(zip(("chi1", "chi2", "chi3"), chi, strict=True)),
    }


def _overlap(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] < other[1] and other[0] < one[1]


def _stretch(run: Run) -> str:
    """A stretch in the words of an error."""
    begin = f"from {run.stretch[0]:g} s"
    return begin + (" on" if run.stop is None else f" to {run.stop:g} s")


def _words(fault: Fault) -> dict[str, str]:
    return {"expected": fault.expected, "found": fault.found, "remedy": fault.remedy}
