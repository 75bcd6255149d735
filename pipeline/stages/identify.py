"""Identify: the drift model of a non-contact gyro from its gimbal angles, by several methods side by side.

Gubarenko & Kuzmenko, *Mechanics of Solids* (1995), corrected. The cumulative least squares always runs: it
tells the noise, marks the outliers, says whether the residuals are coloured, and what the record determines.
The other methods of the plan see the same samples. At the end the last part of every arc is predicted with
the parameters that the rest gives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.errors import GyrostandError
from pipeline.models.drift_advice import Proposal, further_runs
from pipeline.models.drift_observability import drift_observability, expression, shown
from pipeline.models.drift_problem import Estimate, Mask, Parameter, Prior, Problem
from pipeline.models.earth import RATE
from pipeline.models.spiral_inversion import INVERSIONS
from pipeline.numerics.observability import Observability
from pipeline.stages import _drift_tables as as_table
from pipeline.stages._drift_methods import (
    ARCSEC,
    Identified,
    hold_out,
    identify,
    priors_of,
    useful_of,
    white_sigma,
)
from pipeline.stages._drift_settings import Method, Settings
from pipeline.stages._drift_tables import Time
from pipeline.stages.base import Severity, Stand, Tables, counted, finding, metric, rows

__all__ = ["CONSUMES", "MAY_CONSUME", "METRICS", "PRODUCES", "Settings", "run"]

CONSUMES = ("trajectory", "runs")
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES = (
    "drift_parameters",
    "observability",
    "combinations",
    "correlation",
    "further_runs",
    "drift_estimates",
    "residuals",
    "findings",
    "metrics",
)
METRICS = (
    "noise_level",
    "whiteness",
    "outlier_count",
    "condition",
    "undetermined_count",
    "normalised_innovations",
    "transient_time",
)


_FAR = 3.0
"""Prior standard deviations from which on a parameter is a surprise."""

_BEYOND_DOUBT = 1 / 3
"""Standard error of a decay over it: three of them from none."""

UNTOLD = ("combined", "undetermined")
"""States of a parameter that the record does not determine."""


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Identify the gyro.

    Parameters
    ----------
    tables : mapping
        ``trajectory`` and ``runs``.
    settings : Settings
    stand : Stand
        Not needed here; the mounting of each run is in ``runs``.

    Returns
    -------
    dict
        The tables of `PRODUCES`. A method that cannot be done is a finding.
    """
    priors, useful = priors_of(settings), useful_of(settings)
    problem, times = as_table.problem(tables, priors, installation=settings.installation_errors)
    found = identify(problem, settings)
    primary = _primary(found, settings)
    told = drift_observability(found.fits.linear.rows, found.fits.linear.cleaned, useful)
    states = dict(zip(told.names, told.states, strict=True))
    proposals = (
        further_runs(
            found.fits.linear.rows,
            found.fits.linear.cleaned,
            primary,
            sigma=white_sigma(found.fits.linear),
            interval=problem.arcs[0].step / RATE,
            useful=useful,
        )
        if settings.advice
        else ()
    )
    findings = [
        *_findings(found, times),
        *_unexpected(primary, priors),
        *_undetermined(told, proposals, problem),
    ]
    residuals = _residuals(problem, times, found)
    if settings.hold_out:
        try:
            residuals.append(_held_out(problem, times, found, primary, settings))
        except GyrostandError as error:
            findings.append(_finding("hold-out not done", "warning", str(error)))
    histories = {}
    if found.filtered is not None:
        histories["filter"] = found.filtered.history
        if found.filtered.smoothed_history is not None:
            histories["smoother"] = found.filtered.smoothed_history
    return {
        "drift_parameters": as_table.parameter_rows(found.estimates, states, priors, useful),
        "observability": as_table.observability_rows(told),
        "combinations": as_table.combination_rows(told, primary, len(problem.bases)),
        "correlation": pa.concat_tables([as_table.correlation_rows(e, states) for e in found.estimates]),
        "further_runs": as_table.proposal_rows(proposals),
        "drift_estimates": as_table.evolution_rows(histories, times),
        "residuals": pa.concat_tables(residuals),
        "findings": rows("findings", findings),
        "metrics": rows("metrics", list(_metrics(found, primary, told.states))),
    }


def _primary(found: Identified, settings: Settings) -> Estimate:
    """The estimate that the combinations and the hold-out are of."""
    wanted = settings.primary or ("transient" if _settles(found) else "gauss_newton")
    return next((e for e in found.estimates if e.method == wanted), found.fits.linear.estimate)


def _settles(found: Identified) -> bool:
    """Whether there is a transient, its decay beyond doubt: then no method of constant drift holds."""
    if found.fits.settling is None or "decay" not in found.fits.settling.figures:
        return False
    figures = found.fits.settling.figures
    return figures["decay_standard_error"] < _BEYOND_DOUBT * figures["decay"]


def _residuals(problem: Problem, times: Sequence[Time], found: Identified) -> list[pa.Table]:
    """Residuals of every method that predicts the angles."""
    outliers = found.fits.linear.outliers
    return [
        as_table.residual_rows(e.method, problem, times, e.predicted, outliers)
        for e in found.estimates
        if e.method not in INVERSIONS
    ]


def _held_out(
    problem: Problem, times: Sequence[Time], found: Identified, primary: Estimate, settings: Settings
) -> pa.Table:
    """Residuals of the last part of every arc, predicted from what came before."""
    _, predicted = hold_out(found.fits.linear.cleaned, _method(primary), settings)
    held = [_last(len(time), settings.hold_out) for time in times]
    return as_table.residual_rows(primary.method, problem, times, predicted, found.fits.linear.outliers, held)


def _method(estimate: Estimate) -> Method:
    """The plan's word for the method of the primary estimate, which it names itself."""
    method: Method = estimate.method  # type: ignore[assignment]
    return method


def _last(count: int, share: float) -> Mask:
    held = np.zeros(count, dtype=np.bool_)
    held[count - round(share * count) :] = True
    return held


def _findings(found: Identified, times: Sequence[Time]) -> Iterator[dict[str, Any]]:
    """What was marked, allowed for, refused, and what the methods say themselves."""
    for number, (marked, time) in enumerate(zip(found.fits.linear.outliers, times, strict=True)):
        at = time[marked]
        if at.size:
            detail = (
                f"{counted(at.size, 'sample')} of arc {number} farther from the model than noise: left out"
            )
            start, end = int(at.min()), int(at.max())
            yield _finding("outlier", "warning", detail, start=start, end=end, count=int(at.size))
    noise = found.fits.linear.autoregression
    if noise is not None:
        untried = (
            "" if found.fits.settling else "; a drift that settles looks the same: try the method transient"
        )
        yield _finding(
            "coloured residuals",
            "warning",
            f"the residuals are not white (probability {found.fits.linear.whiteness:.2g}): allowed for by an "
            f"autoregression of order {noise.order}{untried}",
        )
    if found.fits.settling is not None and _settles(found):
        figures = found.fits.settling.figures
        hours = 1 / (figures["decay"] * RATE * 3600)
        error = hours * figures["decay_standard_error"] / figures["decay"]
        detail = f"the drift settles, to 1/e in {hours:.3g} ± {error:.1g} h: a constant one does not hold"
        yield _finding("transient", "warning", detail)
    for method, reasons in found.refused.items():
        for reason in reasons:
            named = reason if reason.startswith("method ") else f"{method}: {reason}"
            yield _finding("method not done", "warning", named)
    for estimate in found.estimates:
        for note in estimate.notes:
            yield _finding("note", "warning", f"{estimate.method}: {note}")


def _unexpected(primary: Estimate, priors: Mapping[str, Prior]) -> Iterator[dict[str, Any]]:
    """Parameters far from what the plan expects: it pulls them, or the mounting is another."""
    far = [
        f"{parameter.name} by {abs(value - prior.mean) / prior.sigma:.2g}"
        for parameter, value in zip(primary.parameters, primary.value, strict=True)
        if (prior := priors.get("epsilon" if parameter.run is not None else parameter.name)) is not None
        and abs(value - prior.mean) > _FAR * prior.sigma
    ]
    if far:
        detail = (
            f"farther from what the plan expects than 3 standard deviations: {', '.join(far)}; "
            "raise the prior, or check latitude, scheme and the zeros of the encoders"
        )
        yield _finding("unexpected", "warning", detail, count=len(far))


def _undetermined(
    told: Observability[Parameter], proposals: Sequence[Proposal], problem: Problem
) -> Iterator[dict[str, Any]]:
    """What the record does not determine, what it does instead, and the further run that would."""
    label = partial(shown, runs=len(problem.bases))
    missing = [p for p, state in zip(told.names, told.states, strict=True) if state in UNTOLD]
    if not missing:
        return
    detail = f"the record does not determine {', '.join(map(label, missing))}"
    if told.combinations:
        detail += f", only {', '.join(expression(c, len(problem.bases)) for c in told.combinations)}"
    yield _finding("not determined", "warning", detail, count=len(missing))
    for proposal in proposals[:1]:
        alpha = np.rad2deg(proposal.alpha)
        then = zip(proposal.parameters, proposal.determined, strict=True)
        gained = [p for p, determined in then if determined and p in missing]
        what = f"determine {', '.join(map(label, gained))}" if gained else "make their errors less"
        detail = (
            f"one of the {proposal.scheme} scheme from alpha1, alpha2 = {alpha[0]:.0f}, {alpha[1]:.0f} deg "
            f"over {proposal.duration / 3600:g} h would {what}"
        )
        yield _finding("further run", "warning", detail)


def _finding(
    kind: str,
    severity: Severity,
    detail: str,
    start: int | None = None,
    end: int | None = None,
    count: int = 1,
) -> dict[str, Any]:
    return finding("identify", "gimbal", kind, severity, detail, start=start, end=end, count=count)


def _metrics(found: Identified, primary: Estimate, states: Sequence[str]) -> Iterator[dict[str, Any]]:
    fit = found.fits.linear

    def figure(channel: str, name: str, value: float, unit: str = "1") -> dict[str, Any]:
        return metric("identify", channel, name, value, unit)

    yield figure("gimbal", "noise_level", primary.sigma / ARCSEC, "arcsec")
    yield figure("gimbal", "whiteness", fit.whiteness)
    yield figure("gimbal", "outlier_count", sum(int(marked.sum()) for marked in fit.outliers))
    yield figure("gimbal", "condition", fit.estimate.figures["condition"])
    yield figure("gimbal", "undetermined_count", sum(s in UNTOLD for s in states))
    if found.filtered is not None:
        yield figure("filter", "normalised_innovations", found.filtered.normalised_innovations_squared)
    for estimate in found.estimates:
        if estimate.figures.get("decay"):
            hours = 1 / (estimate.figures["decay"] * RATE * 3600)
            yield figure(estimate.method, "transient_time", hours, "h")
