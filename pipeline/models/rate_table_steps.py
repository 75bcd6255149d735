"""The steps of a rate-table test: where the table turned at a constant rate, and what the gyro told there.

The table's motion is an angle Theta(t): that of its encoder, or its rate integrated. With the mean rate over
a window w before and after an instant ::

    D(t) = [Theta(t + w) - Theta(t)] / w - [Theta(t) - Theta(t - w)] / w

the rate is constant where |D| stays below a tolerance. Of each constant stretch the settling is left out, and
of one that turns once round or more, what is left over beyond whole turns: so whatever goes round with the
table (the horizontal Earth rate, gravity on a tilted axis) has mean zero.

Frames. ``T`` is fixed to the table's base: axis 3 is the axis of rotation, which leans by ``tilt`` towards
the azimuth ``heading`` (clockwise from North); axis 1 at that azimuth, leaning down as axis 3 leans out.
The rotor's axes are those of T turned by the table's angle about axis 3, right-handed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models import earth
from pipeline.models.rate_table_noise import standard_errors
from pipeline.numerics.sampling import MAD_TO_SIGMA, runs

Float = NDArray[np.float64]

_WINDOWS = 10
"""Of the shortest stretch, in w: so much of it at most is lost at either end beside a change of rate."""
_NOISE = 6.0
"""Standard deviations of D within which it is noise: less than once in 1e8 samples beyond."""
_LARGEST = 0.01
"""Of the largest rate: the largest tolerance that is chosen from the record itself."""
_ROUNDING = 1e-9
"""Of the largest rate: an angle of 1e5 rad is rounded to 1e-11 rad."""
_TURNING = 0.01
"""Of the largest rate: above it the table turns, below it an encoder at rest has no noise at all."""
_COUNTS = 3.0
"""Of the angle's quantum, by which an encoder without noise changes the difference of two angles by rounding,
over w: at most two, of three angles that are each rounded by half of one, and one for a little noise."""
_COARSE = 0.1
"""Of the largest rate: the largest tolerance that is chosen for the angle's quantum."""
_FEWEST = 2
"""Samples of either record in a step."""


class RateTableError(GyrostandError):
    """A rate-table test that cannot tell what is asked of it."""

    exit_code = ExitCode.NOT_MET


@dataclass(frozen=True, slots=True)
class TableAxis:
    """The axis of a rate table on the Earth.

    Attributes
    ----------
    latitude : float
        [rad].
    heading : float
        Azimuth of axis 1 of T, and to which the axis of rotation leans, clockwise from North [rad].
    tilt : float
        Of the axis of rotation from the vertical [rad]: 0 points up.
    """

    latitude: float
    heading: float
    tilt: float

    @property
    def earth_rate(self) -> Float:
        """The Earth's rate in axes T [rad/s], shape (3,).

        ``u_T = R2(tilt) R3(-heading) (cos phi, 0, sin phi)`` from axes (North, West, Up), passive rotations.
        """
        u = np.array([np.cos(self.latitude), 0.0, np.sin(self.latitude)])
        turned = earth.passive_rotation(2, self.tilt) @ earth.passive_rotation(3, -self.heading) @ u
        return np.asarray(earth.RATE * turned, dtype=np.float64)

    def on_rotor(self, turn: Float) -> Float:
        """Mean of the Earth's rate in the rotor's axes [rad/s], shape (m, 3).

        Parameters
        ----------
        turn : ndarray, shape (m, 2)
            Mean cosine and sine of the table's angle.
        """
        u1, u2, u3 = self.earth_rate
        c, s = turn.T
        return np.stack([c * u1 + s * u2, c * u2 - s * u1, np.full(len(turn), u3)], axis=1)

    @property
    def across(self) -> float:
        """The Earth's rate across the axis of rotation [rad/s], 0 or more."""
        return float(np.hypot(*self.earth_rate[:2]))


@dataclass(frozen=True, slots=True)
class Motion:
    """What the table did.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Strictly increasing [s], by the gyro's clock but for a time offset.
    angle : ndarray, shape (n,)
        Of the table, unwrapped [rad].
    absolute : bool
        Whether the angle is one from the table's zero, by an encoder; else its zero is anywhere.
    """

    time: Float
    angle: Float
    absolute: bool

    @classmethod
    def of_angle(cls, time: Float, angle: Float) -> Motion:
        """From an encoder's angle [rad], unwrapped, zero where the rotor's axes are those of T."""
        return cls(time, angle, absolute=True)

    @classmethod
    def of_rate(cls, time: Float, rate: Float) -> Motion:
        """From the table's own rate [rad/s], by the trapezoidal rule."""
        steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
        return cls(time, np.concatenate([[0.0], np.cumsum(steps)]), absolute=False)

    def at(self, time: Float) -> Float:
        """Angle at instants within the record [rad]."""
        return np.interp(time, self.time, self.angle)


@dataclass(frozen=True, slots=True)
class Steps:
    """Stretches of constant rate, m of them, and c channels of a gyro.

    Attributes
    ----------
    start, stop : ndarray, shape (m,)
        [s].
    rate : ndarray, shape (m,)
        Mean rate of the table [rad/s].
    turn : ndarray, shape (m, 2)
        Mean cosine and sine of the table's angle; NaN where less than a turn was made and the angle's zero is
        not known.
    gyro : ndarray, shape (m, c)
        Mean of each channel.
    standard_error : ndarray, shape (m, c)
        Of that mean beside the table's.
    temperature : ndarray, shape (m,), optional
        Mean [K].
    """

    start: Float
    stop: Float
    rate: Float
    turn: Float
    gyro: Float
    standard_error: Float
    temperature: Float | None = None

    def __len__(self) -> int:
        """How many steps."""
        return len(self.rate)

    @property
    def duration(self) -> Float:
        """Length of each step [s]."""
        return self.stop - self.start


def constant_stretches(
    motion: Motion, *, shortest: float, settling: float, lag: float = 0.0, tolerance: float | None = None
) -> Float:
    """Where the table turned at a constant rate.

    Parameters
    ----------
    motion : Motion
    shortest : float
        Shortest stretch that counts, settling not included, before it is cut to whole turns [s].
    settling : float
        To be left out at the beginning of each stretch, where table and gyro settle [s].
    lag : float
        Largest time offset between gyro and table; left out at both ends [s].
    tolerance : float, optional
        Largest change of the mean rate from one window to the next [rad/s]; by default six standard
        deviations of what it changes by most of the time, or most of the time that the table turns, and no
        more than a hundredth of the largest rate; but no less than the quantum of the angle makes of it.

    Returns
    -------
    ndarray, shape (m, 2)
        Start and stop [s]; whole turns where there is one or more.

    Raises
    ------
    RateTableError
        If there is none.
    """
    t, w = motion.time, shortest / _WINDOWS
    w = max(w, 2 * float(np.median(np.diff(t))))
    inner = t[(t >= t[0] + w) & (t <= t[-1] - w)]
    if not len(inner):
        raise _no_stretch(f"a record of {t[-1] - t[0]:.6g} s", shortest)
    after = (motion.at(inner + w) - motion.at(inner)) / w
    before = (motion.at(inner) - motion.at(inner - w)) / w
    change = np.abs(after - before)
    allowed = _tolerance(change, after, quantum(motion.angle) / w) if tolerance is None else tolerance
    steady = runs(change <= allowed)
    found = []
    for first, stop in zip(steady.start.tolist(), steady.stop.tolist(), strict=True):
        begin = (inner[first] if first else t[0]) + settling + lag
        end = (inner[stop - 1] if stop < len(inner) else t[-1]) - lag
        if end - begin >= shortest:
            found.append((begin, _whole_turns(motion, begin, end)))
    if not found:
        raise _no_stretch(f"none within {np.degrees(allowed):.3g} deg/s", shortest)
    return np.array(found, dtype=np.float64)


def measure_steps(
    motion: Motion,
    stretches: Float,
    time: Float,
    gyro: Float,
    temperature: Float | None = None,
) -> Steps:
    """Means of the gyro over the table's constant stretches, with their standard errors.

    The noise is that of the gyro less what the table's own motion within a stretch explains, so that a ripple
    of the rate, which both see, is none, and the noise of the table's sensor is; less what goes round with
    the table; and less a drift of bias and scale factor that goes straight with the temperature, or with time
    where there is none: the mean of it is that at the mean temperature.

    Parameters
    ----------
    motion : Motion
    stretches : ndarray, shape (m, 2)
        As of `constant_stretches`.
    time : ndarray, shape (n,)
        Of the gyro's samples [s].
    gyro : ndarray, shape (n, c)
    temperature : ndarray, shape (n,), optional
        [K].

    Returns
    -------
    Steps

    Raises
    ------
    RateTableError
        If the gyro has less than two samples in a stretch.
    """
    places = [slice(*np.searchsorted(time, ends, side="left").tolist()) for ends in stretches]
    for place, (begin, end) in zip(places, stretches, strict=True):
        if place.stop - place.start < _FEWEST:
            raise RateTableError(
                f"gyro, {begin:.6g} s to {end:.6g} s",
                expected="samples in each step of the table",
                found=f"{place.stop - place.start}",
                remedy="check the time offset between gyro and table",
            )
    angles = [motion.at(time[place]) for place in places]
    # Over the gyro's own samples, so that gyro and table are means over the same time.
    rate = np.array([_slope(time[p], angle) for p, angle in zip(places, angles, strict=True)])
    mean = np.stack([gyro[place].mean(axis=0) for place in places])
    turn = np.stack([(np.cos(angle).mean(), np.sin(angle).mean()) for angle in angles])
    if not motion.absolute:
        less = np.abs(rate) * (stretches[:, 1] - stretches[:, 0]) < 2 * np.pi * (1 - 1e-6)
        turn = np.where(less[:, np.newaxis], np.nan, np.zeros_like(turn))
    return Steps(
        np.array([time[p.start] for p in places]),
        np.array([time[p.stop - 1] for p in places]),
        rate,
        turn,
        mean,
        _errors(places, time, gyro, angles, rate, mean, temperature, absolute=motion.absolute),
        None if temperature is None else np.array([temperature[place].mean() for place in places]),
    )


def _no_stretch(found: str, shortest: float) -> RateTableError:
    return RateTableError(
        "table rate",
        expected=f"stretches of constant rate of at least {shortest:g} s",
        found=found,
        remedy="lower steps.shortest_s, raise steps.tolerance_deg_s, or check which channel is the table's",
    )


def quantum(angle: Float) -> float:
    """Least difference of two angles of a record that is more than their rounding; 0 where there is none."""
    differences = np.diff(np.unique(angle))
    differences = differences[differences > 1e-12 * np.abs(angle).max()]
    return float(differences.min()) if len(differences) else 0.0


def _tolerance(change: Float, rate: Float, count: float) -> float:
    """Tolerance by the record itself; ``count`` is the angle's quantum over w [rad/s]."""
    speed = np.abs(rate)
    largest = float(speed.max())
    turning = change[speed > _TURNING * largest]
    usual = _NOISE * MAD_TO_SIGMA * max(float(np.median(part)) for part in (change, turning) if len(part))
    # A record that is never steady would be called steady by its own median.
    least = max(min(_COUNTS * count, _COARSE * largest), _ROUNDING * largest)
    return max(min(usual, _LARGEST * largest), least)


def _whole_turns(motion: Motion, begin: float, end: float) -> float:
    """Where the last whole turn of a stretch ends; the end, where none is made."""
    turned = float(np.diff(motion.at(np.array([begin, end])))[0])
    turns = np.floor(abs(turned) / (2 * np.pi) + 1e-9)
    return begin + (end - begin) * float(turns) * 2 * np.pi / abs(turned) if turns else end


def _slope(time: Float, angle: Float) -> float:
    """Mean rate of the table from the gyro's first sample of a step to its last [rad/s]."""
    return float((angle[-1] - angle[0]) / (time[-1] - time[0]))


def _errors(
    places: Sequence[slice],
    time: Float,
    gyro: Float,
    angles: Sequence[Float],
    rate: Float,
    mean: Float,
    temperature: Float | None,
    *,
    absolute: bool,
) -> Float:
    """Standard error of each mean beside the table's, shape (m, c)."""
    spread = rate - rate.mean()
    power = float(spread @ spread)
    gain = spread @ mean / power if power > 0 else np.zeros(mean.shape[1])
    ripples = [
        np.gradient(angle, time[place]) - constant
        for place, angle, constant in zip(places, angles, rate, strict=True)
    ]
    alone = [gyro[place] for place in places]
    beside = [g - np.outer(ripple, gain) for g, ripple in zip(alone, ripples, strict=True)]
    turning = [_going_round(angle) for angle in angles]
    drifts = [
        _drifting(time[place], None if temperature is None else temperature[place], constant)
        for place, constant in zip(places, rate, strict=True)
    ]
    if not absolute:
        return standard_errors(_less(beside, turning, drifts))
    # The noise of an encoder, differentiated, looks large, and has no share in the mean rate.
    pairs = (_less(one, turning, drifts) for one in (alone, beside))
    both = standard_errors([np.concatenate(pair, axis=1) for pair in zip(*pairs, strict=True)])
    without, with_ripple = np.split(both, 2, axis=1)
    return np.where(without.sum(axis=0) < with_ripple.sum(axis=0), without, with_ripple)


def _going_round(angle: Float) -> Float:
    """Cosine and sine of the table's angle in a stretch of half a turn or more, else zeros, shape (n, 2).

    The horizontal Earth rate, or gravity on a tilted axis, is no noise, though it would pass for a slow one.
    """
    if abs(angle[-1] - angle[0]) <= np.pi:
        return np.zeros((len(angle), 2))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _drifting(time: Float, temperature: Float | None, rate: float) -> Float:
    """Straight drift in a stretch, by itself and times the rate, shape (n, 2)."""
    late = time - time.mean()
    power = float(late @ late)
    # The thermometer's own noise about its line is no drift of the gyro.
    slope = 1.0 if temperature is None or not power else float(late @ temperature) / power
    return np.outer(slope * late, [1.0, rate])


def _less(stretches: Sequence[Float], *explaining: Sequence[Float]) -> list[Float]:
    """The stretches less what columns of mean zero explain of them, by coefficients that all share."""
    columns = [np.concatenate(parts, axis=1) for parts in zip(*explaining, strict=True)]
    columns = [part - part.mean(axis=0) for part in columns]
    levels = [stretch - stretch.mean(axis=0) for stretch in stretches]
    whole = np.concatenate(columns)
    size = np.linalg.norm(whole, axis=0)
    size = np.where(size > 0, size, 1.0)
    shared = np.linalg.lstsq(whole / size, np.concatenate(levels), rcond=None)[0] / size[:, np.newaxis]
    return [stretch - part @ shared for stretch, part in zip(stretches, columns, strict=True)]
