"""Align: take the gyro's clock offset and the rotation of its case out, by comparison with the reference.

Off by default: each of the two must be asked for, since each can hide a fault of the gyro that is to be
judged. What is found is a row of ``alignment``, a metric and a finding, and is applied to the gyro: its times
become those of the reference's clock, its rates those about body axes. A sample that is NaN in one channel
becomes NaN in all when it is rotated.

The mathematics is that of `pipeline.numerics.alignment` and `pipeline.numerics.alignment_fit`. The rates are
correlated as vectors rather than by their magnitudes, because a cone has a rate of constant magnitude.

A motion that repeats itself fits as well one period later. Where ``max_offset`` leaves more than one crest
of the correlation the stage refuses; where it leaves one, and there are others outside, a finding says so:
the setting then decided, not the data.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field

from pipeline.errors import ExitCode
from pipeline.numerics.alignment import Correlation, Increments, correlation, covered, wahba
from pipeline.numerics.alignment_fit import Fit, fit
from pipeline.stages._streams import CHANNELS, Pair, channels, pair
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import StageError, Stand, Tables, finding, metric, rows

CONSUMES: tuple[str, ...] = ()
MAY_CONSUME: tuple[str, ...] = ("gyro", "gyro_increments", "reference")
PRODUCES: tuple[str, ...] = ("gyro", "gyro_increments", "alignment", "metrics", "findings")
METRICS = ("clock_offset", "mounting_1", "mounting_2", "mounting_3")

Float = NDArray[np.float64]

_FEWEST = 30
"""Intervals in common below which a standard error is a guess."""

_RIVAL = 0.85
"""A crest of the correlation this high against the best may be the true one: between two lags of a grid with
4 steps a period, the parabola gives a crest at least 0.88 of its height."""

_WIDER = 10.0
"""Crests are looked for this many times beyond ``max_offset``, to say that there are others."""


class Settings(_Settings):
    """What to estimate and take out; nothing by default."""

    clock_offset: bool = Field(
        False,
        description="estimate the gyro's clock minus the reference's, and take it out of the gyro's times",
    )
    mounting_rotation: bool = Field(
        False,
        description="estimate the rotation from the gyro's case to the body axes, and turn the rates by it",
    )
    max_offset: float = Field(1.0, gt=0, description="largest clock offset to be looked for either way, s")
    max_mounting_error: float = Field(
        0.05,
        gt=0,
        description="refuse a mounting rotation known worse than this about any axis (1 sigma), rad",
    )


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Estimate what the settings ask for and apply it to the gyro.

    Returns
    -------
    dict
        Empty where nothing is asked for; else the gyro's table, ``alignment``, ``metrics``, ``findings``.

    Raises
    ------
    StageError
        If there is no gyro or reference (exit code 2), if they have no time in common (3), or if the motion
        does not determine what is asked for (1).
    """
    if not (settings.clock_offset or settings.mounting_rotation):
        return {}
    records = _records(tables)
    findings: list[dict[str, Any]] = []
    offset, guess = 0.0, np.array([1.0, 0.0, 0.0, 0.0])
    if settings.clock_offset:
        offset = _search(records, settings, findings)
    if settings.mounting_rotation:
        guess = _first_rotation(records, offset)
    found = _estimate(records, settings, offset, guess)
    table = _applied(tables[records.stream], records.stream, found)
    estimates = _estimates(found, settings)
    findings.append(_taken_out(records.stream, estimates, table))
    return {
        records.stream: table,
        "alignment": rows("alignment", estimates),
        "metrics": rows(
            "metrics",
            [
                metric("align", records.stream, e["quantity"], e["value"], e["unit"], e["standard_error"])
                for e in estimates
            ],
        ),
        "findings": rows("findings", findings),
    }


def _refusal(expected: str, found: str, remedy: str, code: ExitCode = ExitCode.NOT_MET) -> StageError:
    return StageError("stage align", expected=expected, found=found, remedy=remedy, exit_code=code)


def _records(tables: Tables) -> Pair:
    have = [name for name in MAY_CONSUME if name in tables]
    if "reference" not in have or len(have) < 2:
        raise _refusal(
            "the streams gyro and reference",
            ", ".join(have) or "none",
            "map both in the test plan, or switch clock_offset and mounting_rotation off in [align]",
            ExitCode.USAGE,
        )
    records = pair(tables, _FEWEST)
    if records is None:
        raise _refusal(
            f"at least {_FEWEST} finite samples of advancing time in gyro and reference",
            "fewer",
            "record longer, or switch the alignment off",
            ExitCode.INPUT,
        )
    if records.gyro_intervals.batched or records.reference_intervals.batched:
        raise _refusal(
            "sample times that tell when each sample was taken",
            "stamps that come in batches",
            "choose another clock in [time] of the test plan",
        )
    return records


def _search(records: Pair, settings: Settings, findings: list[dict[str, Any]]) -> float:
    """The lag of the only crest of the correlation within ``max_offset``."""
    reference, gyro = records.reference, records.gyro
    apart = max(reference.start[0] - gyro.time[-1], gyro.time[0] - reference.stop[-1])
    if apart > settings.max_offset:
        raise _refusal(
            f"gyro and reference within max_offset = {settings.max_offset:g} s of each other",
            f"records that are {apart:.6g} s apart",
            "check the clocks of both streams in the test plan",
            ExitCode.INPUT,
        )
    wide = correlation(reference, gyro, _WIDER * settings.max_offset, rotated=settings.mounting_rotation)
    near = wide.within(settings.max_offset)
    best = float(near.lag[near.best])
    weakest = max(0.2, 5 / np.sqrt(len(reference.start)))
    if not near.value[near.best] >= weakest:
        raise _refusal(
            f"rates of gyro and reference that correlate (by {weakest:.2f} or more)",
            f"{near.value[near.best]:.2f} at best, at {best:.6g} s",
            "check axes, signs and clocks in the test plan, or enlarge max_offset",
        )
    if near.best in (0, len(near.lag) - 1):
        raise _refusal(
            f"a crest of the correlation within max_offset = {settings.max_offset:g} s",
            f"that it still rises at {best:.6g} s",
            "enlarge max_offset in [align]",
        )
    if len(near.crests(_RIVAL)) > 1:
        alone = ", or ask for clock_offset alone: a cone that is turned looks delayed"
        raise _refusal(
            "one clock offset",
            f"several that fit as well within max_offset = {settings.max_offset:g} s: {_repeats(near, best)}",
            "state max_offset below half of that in [align], if the clocks are known so well"
            + (alone if settings.mounting_rotation else ""),
        )
    if np.isfinite(_nearest(wide, best)):
        findings.append(
            finding(
                "align", records.stream, "ambiguous clock offset", "warning",
                f"{_repeats(wide, best)}: an offset different by so much fits as well, and max_offset = "
                f"{settings.max_offset:g} s decided",
            )
        )  # fmt: skip
    return best


def _repeats(found: Correlation, best: float) -> str:
    return f"the motion repeats itself after about {_nearest(found, best):.3g} s"


def _nearest(found: Correlation, best: float) -> float:
    """Distance from the best lag to the next crest that fits as well [s]; inf where there is none."""
    apart = np.abs(found.crests(_RIVAL) - best)
    apart = apart[apart > 1.5 * (found.lag[1] - found.lag[0])]
    return float(apart.min(initial=np.inf))


def _covered(records: Pair, offset: float) -> Increments:
    """The reference's intervals over which the gyro has samples."""
    mask = covered(records.reference, records.gyro.time, offset, records.longest, records.margin)
    if np.count_nonzero(mask) < _FEWEST:
        raise _refusal(
            f"at least {_FEWEST} intervals of the reference over which the gyro has samples without a gap",
            f"{np.count_nonzero(mask)} of {len(mask)}",
            "check the clocks of both streams in the test plan, or switch the alignment off",
            ExitCode.INPUT,
        )
    return records.reference.only(mask)


def _first_rotation(records: Pair, offset: float) -> Float:
    reference = _covered(records, offset)
    x, y = reference.angle, records.gyro.over(reference.start + offset, reference.stop + offset)
    try:
        return wahba((x - x.mean(axis=0)).T @ (y - y.mean(axis=0)))
    except ValueError as error:
        raise _one_axis(str(error)) from None


def _one_axis(found: str) -> StageError:
    return _refusal(
        "a motion about at least two axes, which the mounting rotation needs",
        found,
        "switch mounting_rotation off in [align], or record a motion about two axes",
    )


def _estimate(records: Pair, settings: Settings, offset: float, guess: Float) -> Fit:
    """Refine the first guess; refuse what the motion does not determine."""
    reference = _covered(records, offset)
    try:
        found = fit(
            reference,
            records.gyro,
            offset,
            guess,
            free_offset=settings.clock_offset,
            free_rotation=settings.mounting_rotation,
        )
    except ValueError as error:
        raise _refusal(
            "a motion that determines what [align] asks for",
            str(error),
            "ask for one of clock_offset and mounting_rotation only, or record a motion about two axes",
        ) from None
    step = float(np.median(reference.length))
    if not abs(found.offset - offset) <= 2 * step:
        raise _refusal(
            f"a clock offset within {2 * step:.3g} s of the crest of the correlation at {offset:.6g} s",
            f"{found.offset:.6g} s by least squares",
            "check axes and signs in the test plan",
        )
    variance, axis = np.linalg.eigh(found.covariance[1:, 1:])
    if not np.sqrt(variance[2]) <= settings.max_mounting_error:
        x, y, z = axis[:, 2] * np.sign(axis[np.argmax(np.abs(axis[:, 2])), 2])
        raise _one_axis(
            f"that the turn about the axis ({x:.3f}, {y:.3f}, {z:.3f}) is known to "
            f"{np.sqrt(variance[2]):.2g} rad only, max_mounting_error is {settings.max_mounting_error:g} rad"
        )
    return found


def _applied(table: pa.Table, stream: str, found: Fit) -> pa.Table:
    """The gyro by the reference's clock and about body axes."""
    time = table.column("time").to_numpy() - round(found.offset * 1e9)
    values = channels(table, stream) @ found.matrix.T
    table = table.set_column(0, table.schema.field("time"), pa.array(time))
    for axis, name in enumerate(CHANNELS[stream]):
        place = table.schema.get_field_index(name)
        table = table.set_column(place, table.schema.field(name), pa.array(values[:, axis]))
    return table


def _estimates(found: Fit, settings: Settings) -> list[dict[str, Any]]:
    """The rows of ``alignment``."""
    every: list[tuple[str, float, float, str]] = []
    if settings.clock_offset:
        every.append(("clock_offset", found.offset, float(np.sqrt(found.covariance[0, 0])), "s"))
    if settings.mounting_rotation:
        angles, errors = found.rotation_vector, found.rotation_vector_errors
        every += [(f"mounting_{i + 1}", float(angles[i]), float(errors[i]), "rad") for i in range(3)]
    return [
        {"quantity": quantity, "value": value, "standard_error": error, "unit": unit}
        for quantity, value, error, unit in every
    ]


def _taken_out(stream: str, estimates: list[dict[str, Any]], table: pa.Table) -> dict[str, Any]:
    """The finding that the gyro is no longer as recorded."""
    figures = "; ".join(
        f"{e['quantity']} {e['value']:.9g} ± {e['standard_error']:.2g} {e['unit']}" for e in estimates
    )
    return finding(
        "align", stream, "aligned", "info", f"taken out of the gyro: {figures}", count=table.num_rows
    )
