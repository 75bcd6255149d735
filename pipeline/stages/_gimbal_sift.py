"""What of a run's angles is no motion of a servoed gimbal: stuck, spiking and jumping samples, a lost servo.

Judged is what the platform turns against the stars beyond the drift that shows
(`gimbal_plausibility.unexplained_steps`), so that neither the Earth's rotation nor a nonlinear trajectory is
taken for a fault.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import DEGREES_PER_HOUR
from pipeline.models.gimbal_plausibility import unexplained_steps
from pipeline.numerics.local_polynomial import LocalPolynomial
from pipeline.numerics.sample_faults import resolution
from pipeline.numerics.sampling import runs
from pipeline.numerics.steps import classify, detrended, noise_scale, stuck_runs, without_large_spikes
from pipeline.stages._gimbal_samples import Bool, Findings, Float, GimbalRun, Samples, Time, said
from pipeline.stages.base import StageError, counted

_FEWEST = 8
"""Samples of a stretch of which something can be judged; shorter ones are left out as arcs."""

_UNMODELLED = 0.02
"""What the running median leaves of rates that the model does not have (tilt 0.003, a transient, 0.05) in
units of the Earth rate squared, times the square of a step: 4e-7 rad at a minute, 4e-5 rad at ten. Where
the inner gimbal is steep, the model's derivatives go with 1/cos alpha2, one power each: so does the step."""

_RATE_STEPS = 10
_RATE_SURE = 10.0
"""A rate is judged over so many steps at least, and so long that noise is a tenth of ``max_rate``."""

_MOST_ROWS = 20
"""Jumps with a finding of their own."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What is bridged, split or refused: the settings of the stage, in SI and units of the Earth rate."""

    max_gap: float
    """Longest interval that is bridged [s]."""
    max_rate: float
    """In units of the Earth rate."""
    spike_factor: float
    spike_samples: int
    stuck_samples: int
    split: bool


@dataclass(frozen=True, slots=True)
class Sifted:
    """What is left of a run.

    Attributes
    ----------
    samples : Samples
        The sound ones.
    breaks : ndarray of int64
        Times [ns] from which on an arc is another one.
    noise : float
        Standard deviation of an angle [rad], white, from the differences of neighbours.
    """

    samples: Samples
    breaks: Time
    noise: float


def sift(samples: Samples, of: GimbalRun, limits: Limits, p: Float, findings: Findings) -> Sifted:
    """Leave out what is no motion of a servoed gimbal, and say so.

    Parameters
    ----------
    samples : Samples
        Finite, advancing, unwrapped.
    of : GimbalRun
    limits : Limits
    p : ndarray, shape (11,)
        Parameters with which steps are predicted.
    findings : list
        Takes what is said.

    Raises
    ------
    StageError
        If the servo was lost, and the limits do not let the run be split there.
    """
    stuck = _stuck(samples.alpha, limits.stuck_samples)
    _say(of, findings, "frozen", "that hold an angle while it turns", samples.time, stuck)
    samples = samples.only(~stuck)
    quantum = max(resolution(samples.alpha[:, k]) for k in (0, 1)) if len(samples.time) else 0.0
    kept = np.ones(len(samples.time), dtype=np.bool_)
    spiking = np.zeros(len(samples.time), dtype=np.bool_)
    breaks: list[int] = []
    noises = []
    for piece in _between_gaps(samples.time, limits.max_gap):
        part = samples.only(piece)
        if len(part.time) < _FEWEST:
            continue
        judged = _judge(part, of, limits, p, quantum)
        noises.append((judged.noise, len(part.time)))
        _refuse_or_say_jumps(part, judged, of, limits, findings)
        _refuse_or_say_lost(part, judged, of, limits, findings)
        spiking[piece] = judged.spikes
        kept[piece] = ~(judged.spikes | judged.lost)
        breaks += [int(part.time[i + 1]) for i in judged.jumps]
        breaks += [int(part.time[i]) for i in runs(judged.lost).start]
    _say(of, findings, "spike", "away from the motion, to which the angle returns", samples.time, spiking)
    weights = [count for _, count in noises]
    noise = float(np.average([n for n, _ in noises], weights=weights)) if noises else 0.0
    return Sifted(samples.only(kept), np.array(breaks, dtype=np.int64), noise)


def arcs(sifted: Sifted, max_gap: float, of: GimbalRun, findings: Findings) -> Iterator[Samples]:
    """The stretches between breaks and gaps [s]; a gap that splits the run is said."""
    time = sifted.samples.time
    starts = np.flatnonzero(np.diff(time) > max_gap * 1e9) + 1
    for start in starts.tolist():
        before, after = int(time[start - 1]), int(time[start])
        gap = f"{(after - before) / 1e9:.6g} s without a usable sample, longer than max_gap, {max_gap:.6g} s"
        text = f"the run is split: {gap}"
        findings.append(said(of, "gap", "warning", text, time[[start - 1, start]], count=1))
    bounds = np.unique([0, *starts, *np.searchsorted(time, sifted.breaks), len(time)])
    for first, last in pairwise(bounds.tolist()):
        yield sifted.samples.only(slice(first, last))


@dataclass(frozen=True, slots=True)
class _Steps:
    """Steps between the samples of a stretch, shapes (n - 1, 2) [rad]."""

    unexplained: Float
    """Beyond what the model says."""
    left: Float
    """Without their smooth rate."""
    scale: Float
    """Standard deviation of noise."""
    threshold: Float


@dataclass(frozen=True, slots=True)
class _Judged:
    steps: _Steps
    spikes: Bool
    jumps: Time
    lost: Bool
    rate: float
    """Largest rate against the stars, in units of the Earth rate."""
    noise: float


def _judge(part: Samples, of: GimbalRun, limits: Limits, p: Float, quantum: float) -> _Judged:
    """Spikes, jumps and a lost servo in a stretch without gaps."""
    at = without_large_spikes(part.alpha, limits.spike_samples)
    steps = _steps(part, at, of, limits, p, quantum)
    outlying = np.any(np.abs(steps.left) > steps.threshold, axis=1)
    if outlying.any():
        # Now that it is known where spikes are, the motion is bridged there.
        at = _bridged(part, outlying, limits.spike_samples)
        steps = _steps(part, at, of, limits, p, quantum)
    found = classify(steps.left, steps.threshold, limits.spike_samples)
    noise = max(float(np.median(steps.scale)) / np.sqrt(2), quantum / np.sqrt(12))
    smooth = steps.unexplained.copy()
    smooth[found.jumps] = 0.0
    lost, rate = _lost(part.tau, smooth, np.cos(at[:, 1]), found.spikes, limits.max_rate, noise)
    return _Judged(steps, found.spikes, found.jumps, lost, rate, noise)


def _steps(part: Samples, at: Float, of: GimbalRun, limits: Limits, p: Float, quantum: float) -> _Steps:
    """Steps of a stretch with the model evaluated at given angles."""
    length = np.diff(part.tau)
    unexplained = unexplained_steps(part.tau, part.alpha, at, of.base, p)
    left = detrended(unexplained, length)
    scale = noise_scale(left)
    # Noise, coarse steps, what the model does not know, and the integral over a long step.
    allowed = limits.spike_factor * np.maximum(scale, quantum)
    cos = np.maximum(np.cos(at[:, 1]), 1e-3)
    h = length / np.minimum(cos[1:], cos[:-1])
    unknown = _UNMODELLED * h**2 + h**3 / 12
    return _Steps(unexplained, left, scale, allowed + unknown[:, np.newaxis])


def _bridged(part: Samples, outlying: Bool, longest: int) -> Float:
    """Angles with those around outlying steps taken from the cubic through the nearest others."""
    reach = np.ones(2 * longest, dtype=np.int64)
    sound = np.convolve(outlying, reach)[longest - 1 : longest + len(outlying)] == 0
    at = part.alpha.copy()
    if 4 <= np.count_nonzero(sound) < len(sound):
        through = LocalPolynomial(part.tau[sound], part.alpha[sound], 3)
        at[~sound] = through.sample(part.tau[~sound])[0]
    return at


def _lost(
    tau: Float, steps: Float, cos: Float, spikes: Bool, max_rate: float, noise: float
) -> tuple[Bool, float]:
    """Samples of windows in which the platform turns faster than that, and the largest rate.

    About the axes of the platform the outer gimbal turns it with ``cos alpha2``.
    """
    typical = float(np.median(np.diff(tau)))
    window = max(_RATE_STEPS, int(np.ceil(_RATE_SURE * np.sqrt(2) * noise / (typical * max_rate))))
    lost = np.zeros(len(tau), dtype=np.bool_)
    sound = np.flatnonzero(~spikes)
    if window >= len(sound):
        return lost, 0.0
    level = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])[sound]
    turned1, turned2 = (level[window:] - level[:-window]).T
    turned = np.hypot(turned1 * cos[sound[:-window]], turned2)
    rate = turned / (tau[sound[window:]] - tau[sound[:-window]])
    for first in np.flatnonzero(rate > max_rate).tolist():
        lost[sound[first] : sound[first + window] + 1] = True
    return lost, float(rate.max())


def _stuck(alpha: Float, minimum: int) -> Bool:
    mask = np.zeros(len(alpha), dtype=np.bool_)
    for channel in alpha.T:
        found = stuck_runs(channel, minimum)
        for start, stop in zip(found.start.tolist(), found.stop.tolist(), strict=True):
            mask[start + 1 : stop] = True  # the first sample was still true
    return mask


def _between_gaps(time: Time, max_gap: float) -> Iterator[slice]:
    starts = np.flatnonzero(np.diff(time) > max_gap * 1e9) + 1
    for first, last in pairwise([0, *starts.tolist(), len(time)]):
        yield slice(first, last)


def _say(
    of: GimbalRun, findings: Findings, kind: str, what: str, time: Time, mask: NDArray[np.bool_]
) -> None:
    if mask.any():
        places = counted(len(runs(mask)), "place")
        text = f"{counted(int(mask.sum()), 'sample')} {what}, at {places}: left out"
        findings.append(said(of, kind, "warning", text, time[mask]))


def _refuse_or_say_jumps(
    part: Samples, judged: _Judged, of: GimbalRun, limits: Limits, findings: Findings
) -> None:
    for place, i in enumerate(judged.jumps.tolist()):
        channel = int(np.argmax(np.abs(judged.steps.left[i]) / judged.steps.threshold[i]))
        expected, height = (
            np.degrees(judged.steps.threshold[i, channel]),
            np.degrees(abs(judged.steps.left[i, channel])),
        )
        if not limits.split:
            raise _servo_lost(
                of,
                int(part.time[i]),
                f"alpha{channel + 1} to move by at most {expected:.3g} deg between samples beyond the "
                "Earth's rotation",
                f"a jump of {height:.4g} deg that does not return: the servo was lost",
            )
        text = f"alpha{channel + 1} jumps by {height:.4g} deg: the run is split, the servo was lost"
        if place == _MOST_ROWS:
            rest = judged.jumps[place:]
            text = f"{counted(len(rest), 'more jump')}: the run is split at each"
            findings.append(said(of, "jump", "warning", text, part.time[rest]))
            break
        findings.append(said(of, "jump", "warning", text, part.time[i : i + 2], count=1))


def _refuse_or_say_lost(
    part: Samples, judged: _Judged, of: GimbalRun, limits: Limits, findings: Findings
) -> None:
    if not judged.lost.any():
        return
    allowed, rate = (f"{each * DEGREES_PER_HOUR:.4g} deg/h" for each in (limits.max_rate, judged.rate))
    if not limits.split:
        raise _servo_lost(
            of,
            int(part.time[int(np.argmax(judged.lost))]),
            f"a platform that turns by less than {allowed} against the stars",
            f"{rate}: the servo was lost, or the time is in another unit than the test plan states",
        )
    text = (
        f"the platform turns by up to {rate} against the stars, the servo was lost: "
        f"{counted(int(judged.lost.sum()), 'sample')} left out, and the run split"
    )
    findings.append(said(of, "servo lost", "warning", text, part.time[judged.lost]))


def _servo_lost(of: GimbalRun, time: int, expected: str, found: str) -> StageError:
    hours = (time - int(of.table.column("time")[0].as_py())) / 3.6e12
    return StageError(
        f"stage resample, run {of.name!r}, {hours:.4f} h from its start",
        expected=expected,
        found=found,
        remedy='cut the run by start and stop in the test plan, or set resample.jumps = "split"',
    )
