"""Calibrate: scale factor, bias and what they depend on, of each gyro or of a triad.

By the rates of a table about one axis of the case, each gyro along that axis by itself
(`pipeline.models.rate_table`). By rates about two axes or three, by turns or positions, p, q and r together
(`pipeline.models.rate_table_triad`): a triad, beside which each gyro by the steps about its own axis stands,
for people. The rows of role ``model`` of the table ``calibration`` are what a later plan corrects rates by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models.rate_table import SingleAxis, fit_single_axis
from pipeline.models.rate_table_model import Terms
from pipeline.models.rate_table_observations import Observations, joined
from pipeline.models.rate_table_steps import RateTableError
from pipeline.models.rate_table_triad import fit_triad
from pipeline.stages import _calibration_findings as about
from pipeline.stages import _calibration_tables as as_table
from pipeline.stages._calibration_observations import (
    RateRun,
    Stretches,
    observe_by_turns,
    observe_in_positions,
    observe_rates,
    rate_runs,
    single_axis_steps,
    table_axis,
)
from pipeline.stages._calibration_settings import Settings
from pipeline.stages._rate_table_record import AXES, table_runs
from pipeline.stages.base import StageError, Stand, Tables, rows

__all__ = ["CONSUMES", "MAY_CONSUME", "METRICS", "PRODUCES", "Settings", "run"]

CONSUMES: tuple[str, ...] = ("gyro", "rate_steps")
MAY_CONSUME: tuple[str, ...] = ("temperature", "mountings")
PRODUCES: tuple[str, ...] = (
    "calibration",
    "calibration_covariance",
    "calibration_residuals",
    "findings",
)
METRICS: tuple[str, ...] = ()

Float = NDArray[np.float64]
Made = dict[str, list[dict[str, Any]]]

_ROTOR = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class _Single:
    """A gyro calibrated by steps about one axis, and where these are."""

    fit: SingleAxis
    output: Float
    stretches: Stretches


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:
    """Calibrate what the recording allows.

    Parameters
    ----------
    tables : mapping
        ``gyro`` and ``rate_steps``; ``temperature`` and ``mountings``.
    settings : Settings
    stand : Stand
        Latitude, and how the table's axis stands: without them the Earth's rate stays in the bias.

    Returns
    -------
    dict
        The tables of `PRODUCES`.

    Raises
    ------
    StageError
        If no gyro lies along the table's axis in any run (exit code 2), or a stretch of the plan has no
        samples.
    RateTableError
        If steps, turns or positions are fewer than the unknowns, or do not tell them apart (exit code 1).
    """
    runs = rate_runs(tables["rate_steps"], tables.get("mountings"))
    channels = tuple(name for name in AXES if tables["gyro"].column(name).null_count == 0)
    triad = len(channels) == 3 and (len({one.along for one in runs}) > 1 or settings.methods != ("rates",))
    made: Made = {name: [] for name in PRODUCES}
    made["findings"] += about.about_plan(settings, stand, triad=triad)
    if triad:
        _add_triad(made, tables, runs, settings, stand)
    _add_single_axes(made, runs, channels, settings, stand, beside_triad=triad)
    return {name: rows(name, items) for name, items in made.items()}


def _add_triad(made: Made, tables: Tables, runs: Sequence[RateRun], settings: Settings, stand: Stand) -> None:
    parts: list[tuple[Observations, Stretches]] = []
    if runs:
        parts.append(observe_rates(runs, settings, stand))
    if settings.turns or settings.positions:
        recorded = list(table_runs(tables))
        if settings.turns:
            parts.append(observe_by_turns(recorded, settings))
        if settings.positions:
            parts.append(observe_in_positions(recorded, settings, stand))
    stretches = Stretches.joined([places for _, places in parts])
    # The means of turns and positions bring no temperature of their own; without a term it is no matter.
    bare = [replace(observed, temperature=None) for observed, _ in parts]
    terms = settings.triad_terms
    temperature = stretches.temperature if terms.thermal else None
    observed = replace(joined(bare), temperature=temperature, apart=stretches.apart)
    fit = fit_triad(observed, terms, reference_temperature=settings.reference_temperature)
    method = settings.methods[0] if len(settings.methods) == 1 else "joined"
    names = [as_table.lettered(name) for name in fit.names]
    made["calibration"] += as_table.triad_rows(fit, method, stretches)
    made["calibration_covariance"] += as_table.covariance_rows("", names, fit.covariance)
    made["calibration_residuals"] += as_table.triad_residuals(fit, observed, stretches)
    made["findings"] += about.about_triad(fit)


def _add_single_axes(
    made: Made,
    runs: Sequence[RateRun],
    channels: Sequence[str],
    settings: Settings,
    stand: Stand,
    *,
    beside_triad: bool,
) -> None:
    """Each gyro by the steps about its own axis; without a triad also what it tells of other axes."""
    along = {one.along for one in runs}
    if not beside_triad and not along & set(channels):
        raise StageError(
            "stage calibrate",
            expected=f"a run about the axis of one of the gyro's channels, {', '.join(channels)}",
            found=f"runs about {', '.join(sorted(along)) or 'none'}",
            remedy="add the channel to [streams.gyro], or correct axis of the runs",
            exit_code=ExitCode.USAGE,
        )
    for channel in channels:
        for axis in AXES:
            if axis not in along or (beside_triad and axis != channel):
                continue
            terms = settings.terms if axis == channel else Terms()
            try:
                single = _fitted(runs, channel, axis, terms, settings, stand)
            except RateTableError as error:
                why = f"expected {error.expected}, found {error.found}"
                if axis != channel:  # a gyro of coarse resolution, for one, tells nothing of other axes
                    made["findings"].append(about.without_cross_axis(channel, axis, why))
                elif beside_triad:
                    made["findings"].append(about.without_terms(channel, why))
                else:
                    raise
                continue
            if axis != channel:
                made["calibration"].append(
                    as_table.cross_axis_row(single.fit, channel, axis, single.stretches)
                )
                continue
            _add_single(made, single, channel, beside_triad=beside_triad)


def _fitted(
    runs: Sequence[RateRun], channel: str, axis: str, terms: Terms, settings: Settings, stand: Stand
) -> _Single:
    """One channel against the rate about one axis of the case."""
    chosen = single_axis_steps(runs, channel, axis, table_axis(stand))
    assert chosen is not None, "the caller knows of a run about it"
    steps, stretches = chosen
    fit = fit_single_axis(
        steps,
        0,
        terms,
        input_axis=_ROTOR,
        axis=None,  # the Earth's rate is in that of the steps
        reference_temperature=settings.reference_temperature,
    )
    return _Single(fit, steps.gyro[:, 0], stretches)


def _add_single(made: Made, single: _Single, channel: str, *, beside_triad: bool) -> None:
    fit = single.fit
    role: as_table.Role = "derived" if beside_triad else "model"
    made["calibration"] += as_table.single_axis_rows(fit, channel, role, single.stretches)
    if not beside_triad:
        made["calibration_covariance"] += as_table.covariance_rows(channel, fit.names, fit.covariance)
    made["calibration_residuals"] += as_table.single_axis_residuals(
        fit, channel, single.output, single.stretches
    )
    made["findings"] += about.about_single_axis(fit, channel, single.stretches)
