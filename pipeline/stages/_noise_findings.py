"""What the stage `noise` says of a record: gaps, motion, and what its estimates are worth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from scipy.stats import chi2

from pipeline.models.random_error import RandomError
from pipeline.models.random_error_fit import UNLIKELY, Candidate, Identified
from pipeline.models.rotation_record import HARMONICS, Demodulation
from pipeline.numerics.noise_coefficients import NoiseCoefficients, in_datasheet_units
from pipeline.stages._noise_motion import Motion
from pipeline.stages._noise_record import Channel, Record, usual_share
from pipeline.stages._noise_tables import CANDIDATES
from pipeline.stages.base import StageError, counted, finding

Findings = Iterator[dict[str, Any]]

_UNEVEN = 0.1
"""Jitter of the stamps, in intervals, that is worth a word: the samples are taken for even."""
_COARSE = 0.5
"""Share of one value from which on the resolution rules the noise."""
_FEWEST_TURNS = 3.0
"""Periods of a slow colour in the record from which on it is a line."""
_FAST_STEPS = 3.0
"""Samples in a time constant below which a colour is as fast as the samples: their steps look the same."""
_FAST_PART = 0.75
"""Part of Nyquist's frequency from which on a colour's period may as well be an alias of a faster one."""


def is_fast(model: RandomError, step: float) -> bool:
    """Whether samples every step [s] cannot tell the model's colour from quantisation or an alias."""
    return any(
        noise.mu * step * _FAST_STEPS > 1 or getattr(noise, "lambda_", 0.0) * step > _FAST_PART * np.pi
        for noise in model.coloured
    )


def stamps(record: Record) -> Findings:
    """Gaps, uneven stamps, coarse channels."""
    points = len(record.channels[0].rate)
    for channel in record.channels:
        missing = points - int(np.count_nonzero(channel.present))
        if missing:
            detail = f"{missing} of {points} points have no sample: left out, not interpolated"
            yield _finding(record.stream, channel.name, "gap", "info", detail, count=missing)
        same = usual_share(channel.rate[channel.present])
        if same > _COARSE:
            detail = f"{same:.0%} of the samples have one value: the resolution hides noise at short times"
            yield _finding(record.stream, channel.name, "coarse", "warning", detail)
    jitter = record.regular.jitter / record.regular.nominal
    if jitter > _UNEVEN:
        detail = (
            f"stamps scatter by {jitter:.2g} of their interval; samples taken for {record.step:.6g} s apart"
        )
        yield _finding(record.stream, None, "uneven stamps", "info", detail)


def table(stream: str) -> dict[str, Any]:
    """A record on a turning table."""
    detail = f"the table turns: a constant and harmonics 1 to {HARMONICS} of its angle are taken out"
    return _finding(stream, None, "turning table", "info", detail)


def moves(record: Record, moved: Sequence[Motion]) -> StageError:
    """The refusal of a record that moves, by its largest motion."""
    largest = max(moved, key=lambda motion: motion.size)
    others = f", and {counted(len(moved) - 1, 'other motion')}" if len(moved) > 1 else ""
    return StageError(
        f"stage noise, {record.stream}, channel {largest.channel}",
        expected="a gyro at rest",
        found=f"motion of {_deg_s(largest.size)} from {largest.start * record.step:.1f} s to "
        f"{largest.stop * record.step:.1f} s after the record's start{others}",
        remedy="set noise.motion = 'cut' to leave it out, or 'keep' if it is the sensor's own",
    )


def moved(record: Record, motion: Motion, action: str) -> dict[str, Any]:
    """A motion, and what was done about it."""
    did = "left out in every channel" if action == "cut" else "kept"
    count = motion.stop - motion.start
    return _finding(
        record.stream,
        motion.channel,
        "motion",
        "warning",
        f"motion of {_deg_s(motion.size)} over {count * record.step:.4g} s: {did}",
        start=record.at(motion.start),
        end=record.at(motion.stop - 1),
        count=count,
    )


def coefficients(stream: str, channel: str, found: NoiseCoefficients | str) -> Findings:
    """What the record does not show, and how large it may be at most."""
    if isinstance(found, str):
        yield _finding(stream, channel, "no coefficients", "warning", found)
        return
    bounds = [
        f"{one.name} (below {value:.2g} {unit})"
        for one in found.coefficients
        if one.value is None
        for value, unit in [in_datasheet_units(one.name, one.upper)]
    ]
    if bounds:
        detail = f"the Allan variance does not show {', '.join(bounds)}"
        yield _finding(stream, channel, "not significant", "info", detail, count=len(bounds))
    probability, tau = _fit_of_coefficients(found)
    if probability < UNLIKELY:
        detail = (
            f"no sum of Q, N, B, K and R has this Allan variance (probability {probability:.2g}, at "
            f"{tau:.3g} s): the coefficients describe the short times; see the noise model"
        )
        yield _finding(stream, channel, "coefficients do not fit", "warning", detail)


def _fit_of_coefficients(found: NoiseCoefficients) -> tuple[float, float]:
    """Probability of the worst Allan variance under the fitted coefficients, and its averaging time [s].

    A variance of nu degrees of freedom is chi-square over nu; its standard error under the fit tells nu. Both
    tails count, and that it is the worst of all.
    """
    model = found.model(found.tau)
    nu = 2 * (model / found.standard_error) ** 2
    ratio = nu * found.variance / model
    tail = 2 * np.minimum(chi2.cdf(ratio, nu), chi2.sf(ratio, nu))
    worst = int(np.argmin(tail))
    return float(min(tail[worst] * len(tail), 1.0)), float(found.tau[worst])


def model(record: Record, channel: Channel, found: Identified, told: NoiseCoefficients | None) -> Findings:
    """Why the chosen model is not to be trusted, where it is not."""
    step, duration = record.step, len(channel.rate) * record.step
    best, name = found.chosen, CANDIDATES[found.chosen.form]
    walks = any("K" in one.names for one in found.candidates)
    if best.slow and (not walks or "lambda" in best.names):
        detail = f"{name}: {_slow(best, duration, told)}; sigma and mu are not to be trusted"
        yield _finding(record.stream, channel.name, "slow colour", "warning", detail)
    if is_fast(best.model, step):
        detail = (
            f"{name}: the colour is as fast as the samples ({_speed(best)}, a sample every {step:.4g} s), "
            "which cannot tell it from the quantisation of the output or an alias; its parameters are not to "
            "be trusted"
        )
        yield _finding(record.stream, channel.name, "fast colour", "warning", detail)
    if not best.fits:
        detail = f"{name} does not describe the periodogram (probability {best.whiteness:.2g})"
        yield _finding(record.stream, channel.name, "model does not fit", "warning", detail)
    if not best.converged:
        detail = f"{name}: the likelihood's maximum was not reached"
        yield _finding(record.stream, channel.name, "not converged", "warning", detail)


def no_walk(stream: str, channel: str) -> dict[str, Any]:
    """Gaps that leave no runs."""
    detail = "gaps are so dense that a rate random walk is not among the candidates"
    return _finding(stream, channel, "dense gaps", "info", detail)


def demodulation(stream: str, channel: str, test: Demodulation | None) -> Findings:
    """A prediction that was not tested, or failed."""
    if test is None:
        detail = "the table does not turn evenly for long enough to hold the model against the integral"
        yield _finding(stream, channel, "no demodulation test", "warning", detail)
    elif test.probability < UNLIKELY:
        detail = (
            f"over {test.windows} windows of whole turns the integrated error has {test.ratio:.3g} times the "
            f"variance that the model predicts (probability {test.probability:.2g})"
        )
        yield _finding(stream, channel, "prediction fails", "warning", detail)


def _speed(best: Candidate) -> str:
    """Time constant and period of the colour."""
    told = f"1/mu {1 / best.parameters['mu']:.3g} s"
    period = best.parameters.get("lambda")
    return told if period is None else f"{told}, period {2 * np.pi / period:.4g} s"


def _slow(best: Candidate, duration: float, told: NoiseCoefficients | None) -> str:
    """What a colour with few time constants in the record is."""
    few = "fewer than 20 time constants in the record, which"
    turns = best.parameters.get("lambda", 0.0) * duration / (2 * np.pi)
    if turns > _FEWEST_TURNS:
        return f"{few} cannot tell this colour from a line at {turns / duration:.4g} Hz"
    if turns > 0:
        return f"{few} cannot tell this colour from a trend"
    K = None if told is None else next(one for one in told.coefficients if one.name == "K")
    instead = ""
    if K is not None and K.value is not None:
        value, unit = in_datasheet_units("K", K.value)
        instead = f", whose K is {value:.3g} {unit} by the Allan variance"
    return f"{few} cannot tell this colour from a rate random walk{instead}"


def _deg_s(rate: float) -> str:
    return f"{np.degrees(rate):.2g} deg/s"


def _finding(
    stream: str,
    channel: str | None,
    kind: str,
    severity: Literal["info", "warning"],
    detail: str,
    *,
    start: int | None = None,
    end: int | None = None,
    count: int = 1,
) -> dict[str, Any]:
    return finding(
        "noise", stream, kind, severity, detail, channel=channel, start=start, end=end, count=count
    )
