"""Navigate: a moving body from its inertial sensors and whatever aids them, by several methods side by side.

``strapdown``
    The inertial sensors alone, on the ellipsoid of WGS-84.
``loops``
    The multi-loop correction of Panov (dissertation, Rybinsk 2007), made stable where its source leaves that
    open. Gains that are not stable are refused.
``filter``, ``smoother``
    An error-state Kalman filter of 15 or 18 states with a square-root covariance, and its fixed-interval
    smoother.

All see the same increments, the same aids and the same start. Any subset of aids will do. What aids and when
is judged by the data: a measurement that is missing, not a number, without a fix or frozen does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.models.correction_response import Analysis
from pipeline.models.navigation_problem import AidName, Fixes, Imu, Navigation, Problem
from pipeline.stages import _navigation_findings as about
from pipeline.stages import _navigation_tables as as_table
from pipeline.stages._navigation_consistency import consistency_figures
from pipeline.stages._navigation_methods import analyses_of, navigations_of
from pipeline.stages._navigation_outages import Outage, outages, phases
from pipeline.stages._navigation_problem import aids, earth_field, inertial
from pipeline.stages._navigation_settings import Settings
from pipeline.stages._navigation_start import contradiction, start_of
from pipeline.stages._navigation_streams import TABLES
from pipeline.stages._navigation_truth import truth_of
from pipeline.stages.base import Stand, Tables, metric, rows

__all__ = ["CONSUMES", "MAY_CONSUME", "METRICS", "PRODUCES", "Settings", "run"]

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME: tuple[str, ...] = ("gyro", "gyro_increments", *TABLES)
PRODUCES: tuple[str, ...] = ("navigation", "innovations", "poles", "loops", "findings", "metrics")
METRICS: tuple[str, ...] = (
    "duration",
    "step_count",
    "coasted_count",
    "error_count",
    "normalised_errors",
    "usable_count",
    "outage_count",
    "outage_time",
    "refused_count",
    "refused_share",
    "spectral_radius",
)


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Navigate.

    Parameters
    ----------
    tables : mapping
        ``gyro`` and ``accelerometer``, or the increments of both; every aid that there is; truth, where the
        start is taken from it.
    settings : Settings
    stand : Stand
        Not needed here.

    Returns
    -------
    dict
        The tables of `PRODUCES`; ``poles`` and ``loops`` have rows where the loops are among the methods.

    Raises
    ------
    StageError
        If sensors are missing or share no time, or the start is not known.
    NavigationError
        At a pole, at a gap too long to coast over, or if every method of the plan fails.
    CorrectionGainsError
        If the gains of the plan are not stable; with the limit.
    """
    sensors, findings = inertial(tables)
    found, said = aids(tables, sensors, settings)
    begin, start, at_start = start_of(tables, sensors, found, settings)
    imu, origin = sensors.imu(begin, settings.max_coast_s), sensors.origin
    whole = {aid: _within(fixes, imu) for aid, fixes in found.items()}
    serving = {aid: fixes for aid, fixes in whole.items() if fixes.usable.any()}
    problem = Problem(imu, start, serving, earth_field(serving, settings))
    analyses = analyses_of(problem, settings)
    truth = truth_of(tables)
    done, failed = navigations_of(problem, settings, judged=bool(truth))
    navigations = [one.navigation for one in done]
    lost = {aid: outages(fixes, imu, settings.stale) for aid, fixes in serving.items()}
    findings += [
        *said,
        *at_start,
        *about.of_sensors(imu, origin),
        *about.of_aids(whole, lost, imu, origin),
        *about.of_gates(navigations, origin),
        *_of_loops(problem, settings, origin),
        *(about.not_done(method, reason, imu, origin) for method, reason in failed.items()),
    ]
    at = as_table.chosen(imu.time, settings.output_interval_s)
    phase = phases(imu.time[at], lost.get("position", lost.get("velocity")))
    figures = [
        *_metrics(imu, serving, lost, navigations, analyses),
        *(row for one in done for row in consistency_figures(one, at, phase, origin, truth)),
    ]
    contradicted = contradiction(begin, start, serving.get("position"), settings)
    if contradicted:
        findings.append(about.of_start(contradicted, imu, origin))
        figures.append(_figure("start", "error_count", 1))
    # As errors of the audit do, these fail the recording unless the plan allows them.
    figures += [_figure(method, "error_count", 1) for method in failed]
    return {
        "navigation": _navigation(navigations, imu, origin, at, phase),
        "innovations": _innovations(navigations, origin),
        "poles": as_table.pole_rows(analyses),
        "loops": as_table.loop_rows(analyses),
        "findings": rows("findings", findings),
        "metrics": rows("metrics", figures),
    }


def _within(fixes: Fixes, imu: Imu) -> Fixes:
    """The measurements from the first instant of the increments to the last."""
    kept = (fixes.time >= imu.time[0]) & (fixes.time <= imu.time[-1])
    return Fixes(fixes.time[kept], fixes.value[kept], fixes.usable[kept])


def _navigation(
    navigations: Sequence[Navigation], imu: Imu, origin: int, at: NDArray[np.intp], phase: Sequence[str]
) -> pa.Table:
    """All methods, one after the other, at the same instants."""
    stamps = origin + np.rint(imu.time[at] * 1e9).astype(np.int64)
    coasted = np.append(imu.coasted, False)
    coasted[1:] |= imu.coasted
    return pa.concat_tables(
        [as_table.navigation_rows(one, at, stamps, phase, coasted[at]) for one in navigations]
    )


def _innovations(navigations: Sequence[Navigation], origin: int) -> pa.Table:
    tried = [
        as_table.innovation_rows(one.method, aid, innovations, origin)
        for one in navigations
        for aid, innovations in one.innovations.items()
    ]
    return pa.concat_tables([rows("innovations", []), *tried])


def _of_loops(problem: Problem, settings: Settings, origin: int) -> Iterator[dict[str, Any]]:
    reference = settings.loops.attitude_reference
    if "loops" not in settings.methods:
        return
    if reference == "A":
        yield about.of_reference(problem.imu, origin)
    if reference != "X" and "attitude" in problem.aids:
        yield about.of_idle_attitude(reference, problem.imu, origin)


def _figure(channel: str, name: str, value: float, unit: str = "1") -> dict[str, Any]:
    return metric("navigate", channel, name, value, unit)


def _metrics(
    imu: Imu,
    aids: Mapping[AidName, Fixes],
    lost: Mapping[AidName, Sequence[Outage]],
    navigations: Sequence[Navigation],
    analyses: Sequence[Analysis],
) -> Iterator[dict[str, Any]]:
    yield _figure("gyro", "duration", imu.time[-1] - imu.time[0], "s")
    yield _figure("gyro", "step_count", len(imu))
    yield _figure("gyro", "coasted_count", int(imu.coasted.sum()))
    for aid, fixes in aids.items():
        yield _figure(aid, "usable_count", int(fixes.usable.sum()))
        yield _figure(aid, "outage_count", len(lost[aid]))
        yield _figure(aid, "outage_time", sum(one.end - one.start for one in lost[aid]), "s")
    for one in navigations:
        for aid, tried in one.innovations.items():
            refused, accepted = int(about.gated(tried.value, tried.accepted).sum()), int(tried.accepted.sum())
            yield _figure(f"{one.method}.{aid}", "refused_count", refused)
            if refused + accepted:
                yield _figure(f"{one.method}.{aid}", "refused_share", refused / (refused + accepted))
    for analysis in analyses:
        yield _figure(analysis.channel.name, "spectral_radius", analysis.radius)
