"""Resample: gimbal angles as recorded become arcs on an even grid, unwrapped, without spikes.

Samples that are not finite, whose time does not advance, that are stuck at a value or leave the motion and
return (spikes) are left out; gaps up to ``max_gap`` are bridged, and the bridged points are marked: they
are no observations. A longer gap begins a new arc. A jump that does not return is a servo that lost its
rotor: the record is refused, or split there where the test plan says so.

Samples that lie on an even grid within a twentieth of their noise are taken as they are; others are
interpolated by the local cubic; and where a longer ``interval`` is asked for they are averaged. Times are
whole nanoseconds, even to their rounding, which moves an angle by 4e-14 rad: whoever wants the exact grid
divides first to last.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from pydantic import Field

from pipeline import contracts
from pipeline.errors import ExitCode
from pipeline.models.earth import DEGREES_PER_HOUR, RATE
from pipeline.models.gimbal_plausibility import judge, nominal_parameters, unwrapped
from pipeline.models.gyro_drift import PARAMETERS
from pipeline.models.record_length import sufficient_length, third_standard_error
from pipeline.numerics.even_grid import FEWEST, EvenSamples, as_they_are, averaged, interpolated
from pipeline.numerics.sampling import intervals, runs
from pipeline.numerics.steps import without_large_spikes
from pipeline.numerics.time_grid import advancing
from pipeline.stages._gimbal_samples import Findings, GimbalRun, Samples, gimbal_runs, said
from pipeline.stages._gimbal_sift import Limits, arcs, sift
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import StageError, Stand, Tables, counted, metric, rows

CONSUMES = ("gimbal", "runs")
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES = ("trajectory", "findings", "metrics")
METRICS = ("sample_interval", "arc_count", "bridged_count", "span_hours")

_FEWEST_POINTS = 16
"""Grid points of an arc: a quintic spline needs six, and is at its worst in the three next to either end."""

_LONGEST_INTERVAL = 3600.0
"""Nominal interval up to which samples are followed [s]: in an hour the Earth turns 15 degrees."""

_LONGEST_HOURS = 48.0
"""Records up to this long are thought of when one is too short."""

_AVERAGES = 1.5
"""Sample intervals in one of the grid from which on there is something to average."""

_SAME = 1e-2
"""Part of the nominal interval by which one that is asked for may differ and mean it: 0.033 s for 30 Hz."""

_FINEST_NOISE = np.radians(0.1 / 3600)
"""No record is taken for quieter than 0.1 arcsec: a simulated one without noise would never be too short."""

_EVEN = 0.05
"""Part of the noise that a sample may be wrong by for not being moved to the grid: it adds 0.1 % to it."""

_FINEST = 1e3
"""Deviation from an even grid [ns] that is always allowed: 1 us, in which the Earth turns 1.5e-5 arcsec."""


class Settings(_Settings):
    """What is bridged, split or refused, and the grid."""

    interval: float | None = Field(
        None, gt=0, description="interval of the grid, s; None: the nominal interval of the samples"
    )
    max_gap: float = Field(
        10.0, ge=1, description="longest interval between samples that is bridged, in nominal intervals"
    )
    jumps: Literal["refuse", "split"] = Field(
        "refuse", description="what to do where an angle jumps and does not return: the servo was lost"
    )
    max_rate: float = Field(
        60.0,
        gt=0,
        description="rate of the platform against the stars at which the servo counts as lost, deg/h "
        "(a base mounted otherwise than planned shows up to 30)",
    )
    spike_factor: float = Field(
        6.0, gt=1, description="step between samples that is a spike or a jump, in standard deviations"
    )
    spike_samples: int = Field(
        5, ge=1, description="most samples that a spike lasts; what lasts longer is a jump"
    )
    stuck_samples: int = Field(
        10, ge=2, description="fewest samples that hold an angle bit for bit, while it turns, to be left out"
    )
    useful_drift_deg_h: float = Field(
        0.01,
        gt=0,
        description="standard error that the third best determined combination of the drift must reach, or "
        "the record is too short, deg/h",
    )


@dataclass(frozen=True, slots=True)
class _Resampled:
    """A run on its grids."""

    run: GimbalRun
    arcs: list[EvenSamples]
    interval: float
    """Of the grids [s]."""
    too_short: StageError | None


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Resample every run of ``gimbal``.

    Returns
    -------
    dict
        ``trajectory``; ``findings``: what was left out, bridged or split; ``metrics``.

    Raises
    ------
    StageError
        If the angles are in another unit than declared (exit code 2), the inner gimbal passes 90 degrees,
        the servo was lost, or all runs are too short (1); if there are no samples (3).
    """
    findings: Findings = []
    resampled = [_resampled(of, settings, findings) for of in gimbal_runs(tables["gimbal"], tables["runs"])]
    if not resampled:
        raise _nothing("stage resample", "no run")
    refusals = [r.too_short for r in resampled if r.too_short is not None]
    if len(refusals) == len(resampled):
        raise refusals[0]
    for short in (r for r in resampled if r.too_short is not None):
        text = f"too short for more than two mean rates by itself: {short.too_short}"
        findings.append(said(short.run, "short run", "info", text))
    return {
        "trajectory": _table(resampled),
        "findings": rows("findings", findings),
        "metrics": rows("metrics", _figures(resampled)),
    }


def _resampled(of: GimbalRun, settings: Settings, findings: Findings) -> _Resampled:
    """A run on its grids."""
    usable = _usable(of, findings)
    nominal = _nominal(usable, settings, of)
    sound = _refuse_unit(usable, of)
    samples = Samples(usable.time, unwrapped(usable.alpha))
    _say_unwrapped(usable, samples, of, findings)
    _refuse_singular(samples, of, settings.spike_samples)
    smooth = without_large_spikes(samples.alpha, settings.spike_samples)
    p = nominal_parameters(samples.tau, smooth, of.base) if sound else np.zeros(len(PARAMETERS))
    limits = Limits(
        max_gap=settings.max_gap * nominal,
        max_rate=settings.max_rate / DEGREES_PER_HOUR,
        spike_factor=settings.spike_factor,
        spike_samples=settings.spike_samples,
        stuck_samples=settings.stuck_samples,
        split=settings.jumps == "split",
    )
    sifted = sift(samples, of, limits, p, findings)
    interval = settings.interval or nominal
    noise = max(sifted.noise, _FINEST_NOISE) / np.sqrt(max(interval / nominal, 1.0))
    even = []
    for arc in arcs(sifted, limits.max_gap, of, findings):
        points = _on_grid(arc, settings.interval, nominal, sifted.noise)
        if points is None or len(points.time) < _FEWEST_POINTS:
            text = (
                f"{counted(len(arc.time), 'sample')} between gaps or jumps give fewer than {_FEWEST_POINTS} "
                "grid points: left out"
            )
            findings.append(said(of, "short arc", "warning", text, arc.time))
        else:
            even.append(points)
    _say_bridged(even, of, findings)
    if even:
        interval = (int(even[0].time[-1]) - int(even[0].time[0])) * 1e-9 / (len(even[0].time) - 1)
    return _Resampled(of, even, interval, _too_short(samples, even, of, noise, interval, settings))


def _usable(of: GimbalRun, findings: Findings) -> Samples:
    """The finite samples whose time strictly advances; what is left out becomes findings."""
    recorded = of.samples
    finite = recorded.finite
    samples = recorded.only(finite)
    advance = advancing(samples.time)
    for kind, what, stamps in (
        ("NaN", "with an angle that is not finite", recorded.time[~finite]),
        ("repeated stamp", "whose time repeats another's", samples.time[advance.repeated]),
        ("backward stamp", "whose time is out of order", samples.time[advance.out_of_order]),
    ):
        if len(stamps):
            text = f"{counted(len(stamps), 'sample')} {what}: left out"
            findings.append(said(of, kind, "warning", text, stamps))
    usable = samples.only(advance.kept)
    if len(usable.time) < FEWEST:
        raise _nothing(f"stage resample, run {of.name!r}", f"{len(usable.time)} of {len(recorded.time)}")
    return usable


def _nothing(where: str, found: str) -> StageError:
    return StageError(
        where,
        expected=f"at least {FEWEST} samples with finite angles and advancing time",
        found=found,
        remedy="check the recording, and the clock and the channels in the test plan",
        exit_code=ExitCode.INPUT,
    )


def _nominal(usable: Samples, settings: Settings, of: GimbalRun) -> float:
    """Nominal interval of the samples [s]."""
    regular = intervals(usable.time)
    if regular.batched:
        raise StageError(
            f"stage resample, run {of.name!r}",
            expected="samples that are stamped one by one",
            found="most of them stamped at once, in batches",
            remedy="choose another clock in the test plan",
            exit_code=ExitCode.USAGE,
        )
    if regular.nominal > _LONGEST_INTERVAL:
        raise StageError(
            f"stage resample, run {of.name!r}",
            expected=f"samples at most {_LONGEST_INTERVAL:g} s apart, in which the Earth turns 15 deg",
            found=f"a nominal interval of {regular.nominal:.6g} s",
            remedy="check the unit of the time, or the rate, in the test plan, or record more often",
            exit_code=ExitCode.USAGE,
        )
    if settings.interval is not None and settings.interval < (1 - _SAME) * regular.nominal:
        raise StageError(
            f"test plan, key resample.interval, run {of.name!r}",
            expected=f"no less than the interval of the samples, {regular.nominal:.6g} s",
            found=f"{settings.interval:g} s",
            remedy="raise it, or leave it out",
            exit_code=ExitCode.USAGE,
        )
    return regular.nominal


def _refuse_unit(usable: Samples, of: GimbalRun) -> bool:
    """Refuse angles in another unit than declared (exit code 2); else whether they bear the plan out."""
    judged = judge(usable.tau, usable.alpha, of.base)
    if judged is None or judged.cause is None or judged.otherwise is None:
        return judged is not None and not judged.doubtful
    stated = "radians" if judged.cause == "degrees" else "degrees"
    raise StageError(
        f"run {of.name!r}, key streams.gimbal.channels.alpha1.unit",
        expected=f"angles that imply the Earth rate, {DEGREES_PER_HOUR:.3f} deg/h",
        found=f"{judged.declared} as declared, but {judged.otherwise} if the numbers are {judged.cause} "
        f"where {stated} are stated",
        remedy="correct the units of alpha1 and alpha2",
        exit_code=ExitCode.USAGE,
    )


def _say_unwrapped(usable: Samples, samples: Samples, of: GimbalRun, findings: Findings) -> None:
    turns = np.rint((samples.alpha - usable.alpha) / (2 * np.pi))
    moved = np.any(turns != 0, axis=1)
    if moved.any():
        wraps = int(np.count_nonzero(np.any(np.diff(turns, axis=0) != 0, axis=1)))
        many = counted(int(moved.sum()), "sample")
        text = f"{many} moved by whole turns; the record wraps {counted(wraps, 'time')}"
        findings.append(said(of, "unwrapped", "info", text, usable.time[moved]))


def _refuse_singular(samples: Samples, of: GimbalRun, longest_spike: int) -> None:
    """Refuse a run whose inner gimbal comes to 90 degrees, where alpha1 means nothing."""
    beyond = runs(np.abs(samples.alpha[:, 1]) >= np.pi / 2)
    long = np.flatnonzero(beyond.length > longest_spike)
    if len(long):
        at = int(beyond.start[long[0]])
        hours = (int(samples.time[at]) - int(samples.time[0])) / 3.6e12
        raise StageError(
            f"stage resample, run {of.name!r}, {hours:.4f} h from its start",
            expected="alpha2 within 90 deg: at 90 deg the axes of the gimbal coincide",
            found=f"{np.degrees(samples.alpha[at, 1]):.4g} deg",
            remedy="cut the run by start and stop in the test plan, or check channels.alpha2",
        )


def _on_grid(arc: Samples, interval: float | None, nominal: float, noise: float) -> EvenSamples | None:
    """An arc on its grid; None where it is too short for one."""
    if len(arc.time) < FEWEST:
        return None
    ratio = 1.0 if interval is None else interval / nominal
    if ratio >= _AVERAGES:
        return averaged(arc.time, arc.alpha, round(ratio * nominal * 1e9), nominal * 1e9)
    if interval is None or abs(ratio - 1) <= _SAME:
        # No angle turns faster than twice the Earth while alpha2 is below 60 degrees.
        tolerance = max(_FINEST, _EVEN * noise / (2 * RATE) * 1e9)
        even = as_they_are(arc.time, arc.alpha, nominal * 1e9, tolerance)
        if even is not None:
            return even
    return interpolated(arc.time, arc.alpha, ratio * nominal * 1e9, nominal * 1e9)


def _say_bridged(even: list[EvenSamples], of: GimbalRun, findings: Findings) -> None:
    missing = np.concatenate([points.time[~points.measured] for points in even]) if even else np.array([])
    if len(missing):
        text = f"{counted(len(missing), 'grid point')} bridged: no observations"
        findings.append(said(of, "bridged", "info", text, missing))


def _too_short(
    samples: Samples,
    even: list[EvenSamples],
    of: GimbalRun,
    noise: float,
    interval: float,
    settings: Settings,
) -> StageError | None:
    """Why a run is too short, and how long would do; None where it is not, or where no length would do."""
    useful, step = settings.useful_drift_deg_h / DEGREES_PER_HOUR, interval * RATE
    own = [Samples(points.time[points.measured], points.values[points.measured]) for points in even]
    if third_standard_error([(a.tau, a.alpha) for a in own], of.base, noise, step) <= useful:
        return None
    enough = sufficient_length(
        samples.tau,
        samples.alpha,
        of.base,
        sigma=noise,
        step=step,
        useful=useful,
        longest=_LONGEST_HOURS * 3600 * RATE,
    )
    if enough is None and even:
        return None
    hours = max(enough / RATE / 3600 if enough else 0.0, 2 * _FEWEST_POINTS * interval / 3600)
    hours = float(f"{1.05 * hours:.1e}")  # two digits, not rounded below what it takes
    span = (int(samples.time[-1]) - int(samples.time[0])) / 3.6e12
    return StageError(
        f"stage resample, run {of.name!r}",
        expected="a record long enough to tell drift from the Earth's rotation: at its noise, "
        f"{np.degrees(noise) * 3600:.2g} arcsec every {interval:.4g} s, {hours:g} h would do",
        found=f"{span:.3g} h in {counted(len(even), 'arc')}, which determines two mean rates and no third "
        f"combination of the drift to {settings.useful_drift_deg_h:g} deg/h",
        remedy="record longer, or raise resample.useful_drift_deg_h",
    )


def _table(resampled: list[_Resampled]) -> pa.Table:
    """The arcs of all runs, numbered through."""
    pairs = [(r.run.number, points) for r in resampled for points in r.arcs]
    lengths = [len(points.time) for _, points in pairs]
    alpha = np.concatenate([points.values for _, points in pairs])
    return contracts.table(
        "trajectory",
        {
            "run": np.repeat(np.array([number for number, _ in pairs], dtype=np.int32), lengths),
            "arc": np.repeat(np.arange(len(pairs), dtype=np.int32), lengths),
            "time": np.concatenate([points.time for _, points in pairs]),
            "alpha1": alpha[:, 0],
            "alpha2": alpha[:, 1],
            "measured": np.concatenate([points.measured for _, points in pairs]),
        },
    )


def _figures(resampled: list[_Resampled]) -> list[dict[str, Any]]:
    """Of all runs together; the interval is the longest of them."""
    even = [points for r in resampled for points in r.arcs]
    span = sum(int(points.time[-1]) - int(points.time[0]) for points in even) / 3.6e12
    return [
        metric("resample", "gimbal", "sample_interval", max(r.interval for r in resampled), "s"),
        metric("resample", "gimbal", "arc_count", len(even), "1"),
        metric("resample", "gimbal", "bridged_count", sum(int((~p.measured).sum()) for p in even), "1"),
        metric("resample", "gimbal", "span_hours", span, "h"),
    ]
