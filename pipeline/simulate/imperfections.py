"""What is wrong with a simulated record: errors of the gyro or the encoders, of the stamps and the transport.

Each random effect has a generator of its own, `generator`, so that switching one on leaves the others as
they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Output = Literal["angular_rate", "angle_increment"]
Span = tuple[float, float]

_EFFECTS = (
    *("rate noise", "angle noise", "sample jitter", "stamp noise", "log jitter", "reference noise"),
    *("encoder noise", "coloured encoder noise", "outliers"),
    *("random error", "random angle error"),
    *("orientation", "angle of a turn", "bias of a run", "table noise", "temperature noise"),
    *(
        "inertial noise",
        "inertial wander",
        "aid noise",
        "aid wander",
        "aid bias",
        "air",
        "start",
        "transport",
    ),
)
"""New ones go to the end: the place is part of the seed."""
_MOST_JITTER = 0.45  # of a sample interval: the samples stay in their order
_LONGEST = 1e9
"""Most of any time [s], some thirty years: its nanoseconds, and their sum with a date, fit into 64 bits."""


class SimulationError(GyrostandError):
    """A simulation that cannot be: a setting out of its range."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroErrors:
    """Errors of the gyro's output.

    Attributes
    ----------
    white_noise : float
        Standard deviation of white noise on each sample of the rate [rad/s]; on an angle increment it acts
        over the sample interval.
    white_angle_noise : float
        Standard deviation of white noise on the angle at each sampling instant [rad]: its differences
        appear in the output.
    bias : tuple of float
        Added to p, q, r [rad/s].
    quantum : float
        Least step of the output: of the rate [rad/s], or of the summed angle whose differences the
        increments are [rad], so that no remainder is lost. 0 for none.
    mounting : tuple of float
        Rotation vector m [rad] of the gyro's axes against the body: body components are ``Exp([m]x)`` times
        those that the gyro gives.
    """

    white_noise: float = 0.0
    white_angle_noise: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quantum: float = 0.0
    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderErrors:
    """Errors of the gimbal's encoders, in each angle by itself.

    Attributes
    ----------
    white_noise : float
        Standard deviation of white noise on each sample [rad].
    coloured_noise : float
        Standard deviation of a first-order Gauss-Markov process [rad].
    correlation_time : float
        In which its autocorrelation falls to 1/e [s].
    outlier_share : float
        Of the samples that are outliers, each by chance and for both angles.
    outlier_size : float
        Standard deviation of an outlier's error [rad].
    """

    white_noise: float = 0.0
    coloured_noise: float = 0.0
    correlation_time: float = 600.0
    outlier_share: float = 0.0
    outlier_size: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingErrors:
    """Errors of the sensor's stamps and of its transport; instants in seconds from the record's start.

    Attributes
    ----------
    sample_jitter : float
        Standard deviation of the true sampling instants about the even ones [s]; stamped as they are.
        Cut at 0.45 sample intervals.
    stamp_noise : float
        Standard deviation of the stamps about the true instants [s].
    clock_offset : float
        The gyro's stamps minus those of the reference at one instant [s].
    gaps : sequence of (start, length)
        Samples that were lost [s].
    nan_bursts : sequence of (start, length)
        Samples whose channels are all NaN [s].
    backward_stamps : sequence of float
        The sample at or after this instant is stamped 1.5 sample intervals early, so before its predecessor.
    repeated_samples : sequence of float
        The sample at or after this instant is recorded twice.
    log_delay, log_jitter : float
        The recorder's time is the true one plus the delay plus the size of a normal deviate of this standard
        deviation [s]; it never steps back.
    """

    sample_jitter: float = 0.0
    stamp_noise: float = 0.0
    clock_offset: float = 0.0
    gaps: Sequence[Span] = ()
    nan_bursts: Sequence[Span] = ()
    backward_stamps: Sequence[float] = ()
    repeated_samples: Sequence[float] = ()
    log_delay: float = 0.0
    log_jitter: float = 0.0


def generator(seed: int, effect: str, *part: int) -> np.random.Generator:
    """The generator of one random effect, or of a part of it, the same whatever else is random.

    Parameters
    ----------
    seed : int
        Of the record.
    effect : str
        One of those above.
    part : int, optional
        Numbers from 1, such as the axis.
    """
    return np.random.Generator(np.random.PCG64([seed, _EFFECTS.index(effect), *part]))


def require(
    settings: object, name: str, *, least: float = 0.0, most: float = np.inf, above: bool = False
) -> None:
    """Raise a `SimulationError` if a number of the settings, or one of several, is out of its range.

    Parameters
    ----------
    settings : object
        What holds the number.
    name : str
        Its name: a number or an array of them, or None, which is in any range.
    least, most : float, optional
        The range; NaN and infinities are never in it.
    above : bool, optional
        Whether the least value itself is out of it.
    """
    value = getattr(settings, name)
    for one in () if value is None else np.ravel(value):
        if not (np.isfinite(one) and (one > least if above else one >= least) and one <= most):
            low = [f"{'more than' if above else 'at least'} {least:g}"] if least > -np.inf else []
            high = [f"at most {most:g}"] if most < np.inf else []
            raise SimulationError(
                f"simulation setting {name}",
                expected=" and ".join(low + high) or "a finite number",
                found=f"{one:g}",
                remedy="choose another value",
            )


def check_errors(errors: GyroErrors | EncoderErrors | TimingErrors) -> None:
    """Raise a `SimulationError` if a value cannot be; bias, mounting and clock offset may be negative."""
    if isinstance(errors, EncoderErrors):
        for name in ("white_noise", "coloured_noise", "outlier_size"):
            require(errors, name)
        require(errors, "correlation_time", above=True)
        require(errors, "outlier_share", most=1.0)
    elif isinstance(errors, GyroErrors):
        for name in ("white_noise", "white_angle_noise", "quantum"):
            require(errors, name)
        for name in ("bias", "mounting"):
            require(errors, name, least=-np.inf)
    else:
        require(errors, "clock_offset", least=-_LONGEST, most=_LONGEST)
        for one in fields(errors):
            if one.name != "clock_offset":
                require(errors, one.name, most=_LONGEST)


def nanoseconds(seconds: Float) -> Time:
    """Seconds, rounded to whole nanoseconds."""
    whole: Time = np.rint(1e9 * seconds).astype(np.int64)
    return whole


def in_seconds(time: Time) -> Float:
    """Nanoseconds as seconds."""
    return np.asarray(time * 1e-9, dtype=np.float64)


def even_instants(count: int, rate: float) -> Time:
    """Instants of even samples [ns from the first]."""
    return nanoseconds(np.arange(count) / rate)


def sampling_instants(count: int, rate: float, timing: TimingErrors, seed: int) -> Time:
    """True instants of the samples [ns from the record's start], strictly increasing."""
    noise = timing.sample_jitter * generator(seed, "sample jitter").standard_normal(count)
    most = _MOST_JITTER / rate
    return even_instants(count, rate) + nanoseconds(np.clip(noise, -most, most))


def spoil(exact: Float, interval: Float, output: Output, errors: GyroErrors, seed: int) -> Float:
    """The gyro's output.

    Parameters
    ----------
    exact : ndarray, shape (n, 3)
        Exact rates [rad/s] or angle increments [rad], in the gyro's axes.
    interval : ndarray, shape (n,)
        Time since the sample before [s].
    output : {"angular_rate", "angle_increment"}
        Which of them.
    errors : GyroErrors
        What is wrong.
    seed : int
        Seed.

    Returns
    -------
    ndarray, shape (n, 3)
        In the unit of ``exact``.
    """
    over = interval[:, None] if output == "angle_increment" else np.ones((len(exact), 1))
    spoilt = exact + np.array(errors.bias) * over
    if errors.white_noise:
        noise = generator(seed, "rate noise").standard_normal(exact.shape)
        spoilt = spoilt + errors.white_noise * noise * over
    if errors.white_angle_noise:
        noise = generator(seed, "angle noise").standard_normal((len(exact) + 1, 3))
        spoilt = spoilt + errors.white_angle_noise * np.diff(noise, axis=0) * (over / interval[:, None])
    return quantised(spoilt, errors.quantum, output)


def quantised(exact: Float, quantum: float, output: Output) -> Float:
    """The output in whole steps: of the rate, or of the summed angle whose differences the increments are.

    Parameters
    ----------
    exact : ndarray, shape (n, k)
    quantum : float
        In the unit of ``exact``; 0 for none.
    output : {"angular_rate", "angle_increment"}
        Which of them.
    """
    if not quantum:
        return exact
    if output == "angular_rate":
        return np.asarray(quantum * np.rint(exact / quantum), dtype=np.float64)
    counts = np.rint(np.cumsum(exact, axis=0) / quantum)
    return np.asarray(quantum * np.diff(counts, axis=0, prepend=0.0), dtype=np.float64)


def encoder_noise(t: Float, errors: EncoderErrors, seed: int) -> tuple[Float, NDArray[np.bool_]]:
    """What the encoders add to the angles, before they are quantised.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Instants of the samples, increasing [s].
    errors : EncoderErrors
        What is wrong.
    seed : int
        Seed.

    Returns
    -------
    noise : ndarray, shape (n, 2)
        Error of each angle [rad].
    outliers : ndarray of bool, shape (n,)
        Which samples are outliers.
    """
    shape = (len(t), 2)
    noise = errors.white_noise * generator(seed, "encoder noise").standard_normal(shape)
    if errors.coloured_noise:
        drawn = generator(seed, "coloured encoder noise").standard_normal(shape)
        noise += errors.coloured_noise * _gauss_markov(t, errors.correlation_time, drawn)
    chance = generator(seed, "outliers")
    outliers = chance.random(len(t)) < errors.outlier_share
    noise[outliers] += errors.outlier_size * chance.standard_normal(shape)[outliers]
    return noise, outliers


def _gauss_markov(t: Float, correlation_time: float, drawn: Float) -> Float:
    """Stationary process of unit variance, autocorrelation exp(-|dt|/T), from independent normal deviates."""
    fall = np.exp(-np.diff(t) / correlation_time)
    renewal = np.sqrt(1 - fall**2)[:, np.newaxis] * drawn[1:]
    process = drawn.copy()
    for j, kept in enumerate(fall.tolist()):
        process[j + 1] = kept * process[j] + renewal[j]
    return process


def within(spans: Sequence[Span], t: Float) -> NDArray[np.bool_]:
    """Which instants lie in one of the spans (start included, end not)."""
    inside = np.zeros(len(t), dtype=np.bool_)
    for start, length in spans:
        inside |= (t >= start) & (t < start + length)
    return inside


def samples_at(instants: Sequence[float], t: Float, what: str) -> NDArray[np.intp]:
    """Indices of the samples at or after the instants."""
    indices = np.searchsorted(t, np.array(instants, dtype=np.float64))
    if np.any(indices >= len(t)):
        raise SimulationError(
            f"simulation setting {what}",
            expected=f"instants up to {t[-1]:g} s, where the record ends",
            found=f"{max(instants):g} s",
            remedy="choose an earlier instant, or a longer record",
        )
    return indices
