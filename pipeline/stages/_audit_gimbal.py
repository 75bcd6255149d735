"""The audit of gimbal angles: whether they turn with the Earth, as the unit and the mounting of the plan say.

The other marks are those of every stream, run by run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import DEGREES_PER_HOUR, Base, Scheme, mounting_angles
from pipeline.models.gimbal_plausibility import (
    Implied,
    Judgement,
    implied_earth_rate,
    judge,
    unwrapped,
)
from pipeline.models.gyro_drift import linear_model
from pipeline.numerics.time_grid import advancing
from pipeline.stages._audit_rows import Row, StreamReport
from pipeline.stages._gimbal_samples import GimbalRun, Samples
from pipeline.stages.base import counted

Float = NDArray[np.float64]


def _largest(values: Sequence[float]) -> float:
    return max(values, key=abs)


_OF_ALL_RUNS: Mapping[str, Callable[[Sequence[float]], float]] = {
    "sample_rate": min,
    "rate_jitter": max,
    "longest_gap": max,
    "clock_offset": _largest,
    "clock_jump": _largest,
    "clock_drift": _largest,
}
"""What a figure of several runs is, where it is not their sum."""


_WORTH_EXPLAINING, _BETTER = 0.05, 5.0
"""Misfit from which on another mounting is tried, and how many times smaller its own must be."""

_HOPELESS = 0.5
"""Misfit of angles that contradict the plan from which on they are no gyro's, explained or not."""

_TURNED = np.radians(1.0)
"""Angle by which the Earth must turn an axis over a record for a resting one to be an error [rad]."""

_AS_GOOD = 3.0
"""Times the least misfit up to which another explanation is named too."""


def audit_earth_rate(report: StreamReport, of: GimbalRun) -> None:
    """Say where the angles of a run contradict the unit, or the mounting, that the plan states."""
    samples = of.samples
    samples = samples.only(samples.finite)
    samples = samples.only(advancing(samples.time).kept)
    if not len(samples.time):
        return
    _say_at_rest(report, samples, of)
    judged = judge(samples.tau, samples.alpha, of.base)
    if judged is None:
        return
    implied = judged.declared
    error = implied.standard_error * DEGREES_PER_HOUR
    report.figure("implied_earth_rate", implied.deg_h, "deg/h", standard_error=error)
    if judged.cause is not None:
        _contradicted(report, judged)
        return
    beyond = int(np.count_nonzero(np.abs(unwrapped(samples.alpha)[:, 1]) >= np.pi / 2))
    if beyond:
        text = f"alpha2 reaches 90 deg in {counted(beyond, 'sample')}, where the axes of the gimbal coincide"
        report.say("singular", "error", text, channel="alpha2", count=beyond)
        return
    explained = _explanations(samples, of) if judged.doubtful or implied.misfit > _WORTH_EXPLAINING else []
    if judged.doubtful or any(_BETTER * found.misfit < implied.misfit for _, found in explained):
        words = [f"{change}: {found}" for change, found in explained]
        text = (
            f"the angles imply an Earth rate of {implied} against {DEGREES_PER_HOUR:.3f} deg/h: check "
            "scheme, latitude and the signs of alpha1 and alpha2"
        )
        # Where one change of the plan explains what the plan does not, the plan is wrong.
        wrong = bool(words) or implied.misfit > _HOPELESS
        report.say("implausible Earth rate", "error" if wrong else "warning", "; ".join([text, *words]))


def _say_at_rest(report: StreamReport, samples: Samples, of: GimbalRun) -> None:
    """An angle that rests bit for bit where the Earth turns it: the encoder, or the servo, is dead."""
    earth, _ = linear_model(samples.alpha, of.base)
    turned = np.trapezoid(np.abs(earth), samples.tau, axis=0)
    for index, name in enumerate(("alpha1", "alpha2")):
        if np.ptp(samples.alpha[:, index]) == 0 and turned[index] > _TURNED:
            text = (
                f"{np.degrees(samples.alpha[0, index]):.6g} deg throughout, where the Earth turns it by "
                f"{np.degrees(turned[index]):.3g} deg: the encoder is dead, or the gimbal does not follow"
            )
            report.say("constant", "error", text, channel=name)


def _contradicted(report: StreamReport, judged: Judgement) -> None:
    stated = "radians" if judged.cause == "degrees" else "degrees"
    report.say(
        "implausible unit",
        "error",
        f"the angles imply an Earth rate of {judged.declared} against {DEGREES_PER_HOUR:.3f} deg/h; "
        f"{judged.otherwise} if they are {judged.cause} where {stated} are stated",
    )


def _explanations(samples: Samples, of: GimbalRun) -> list[tuple[str, Implied]]:
    """Which single changes of the plan would explain the angles best."""
    alpha = unwrapped(samples.alpha)
    changes: list[tuple[str, Float, Base]] = [
        ("alpha1 negated", alpha * np.array([-1, 1]), of.base),
        ("alpha2 negated", alpha * np.array([1, -1]), of.base),
        ("alpha1 and alpha2 negated", -alpha, of.base),
        ("alpha1 and alpha2 exchanged", alpha[:, ::-1], of.base),
    ]
    for scheme in get_args(Scheme):
        base = Base.at(of.latitude, mounting_angles(scheme, of.latitude))
        changes.append((f"scheme {scheme}", alpha, base))
    if of.scheme is not None:
        other = Base.at(-of.latitude, mounting_angles(cast("Scheme", of.scheme), -of.latitude))
        changes.append(("the other hemisphere", alpha, other))
    implied = [(words, implied_earth_rate(samples.tau, angles, base)) for words, angles, base in changes]
    believed = [(words, found) for words, found in implied if found is not None and found.believed]
    best = min((found.misfit for _, found in believed), default=0.0)
    return [(words, found) for words, found in believed if found.misfit <= _AS_GOOD * best]


def of_all_runs(reports: Sequence[StreamReport]) -> list[Row]:
    """Metrics of the runs together: counts are summed, of the others the worst is taken."""
    by_figure: dict[tuple[str, str], list[Row]] = {}
    for report in reports:
        for row in report.metrics:
            by_figure.setdefault((row["channel"], row["name"]), []).append(row)
    return [_together(rows) for rows in by_figure.values()]


def _together(rows: Sequence[Row]) -> Row:
    valued = [row for row in rows if row["value"] is not None]
    if len(valued) < 2:
        return valued[0] if valued else rows[0]
    name = rows[0]["name"]
    if name == "implied_earth_rate":
        return max(valued, key=lambda row: abs(row["value"] - DEGREES_PER_HOUR))
    value = _OF_ALL_RUNS.get(name, sum)([row["value"] for row in valued])
    error = next((row["standard_error"] for row in valued if row["value"] == value), None)
    return {**valued[0], "value": value, "standard_error": error}
