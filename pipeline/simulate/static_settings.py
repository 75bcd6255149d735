"""What is simulated of a gyro at rest, or on a platform that turns evenly: its errors, and the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import RATE
from pipeline.models.random_error import RateRandomWalk, Term, White
from pipeline.simulate.imperfections import (
    Output,
    SimulationError,
    TimingErrors,
    check_errors,
    require,
)
from pipeline.simulate.recording import START
from pipeline.simulate.streams import AngleUnit, TableQuantity

Float = NDArray[np.float64]
Axis = Literal["p", "q", "r"]

AXES: tuple[Axis, ...] = get_args(Axis)
"""The axes that a gyro may have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisErrors:
    """The errors of one axis, independent of those of the others.

    Attributes
    ----------
    terms : tuple of Term
        White noise, noise 1, 2, 3 and rate random walk of the rate, see `pipeline.models.random_error`: sigma
        in rad/s, N in rad^2/s, K in rad/s/sqrt(s); of white noise N is the square of the angle random walk.
    quantisation : float
        Q, the standard deviation of white noise on the angle at each sampling instant [rad]: its differences
        appear in the output. A step q of the angle has ``Q = q / sqrt(12)``.
    bias : float
        [rad/s]
    ramp : float
        R, by which the bias grows from the record's start on [rad/s^2].
    """

    terms: tuple[Term, ...] = ()
    quantisation: float = 0.0
    bias: float = 0.0
    ramp: float = 0.0

    def __post_init__(self) -> None:
        require(self, "quantisation")
        for name in ("bias", "ramp"):
            require(self, name, least=-np.inf)

    @property
    def coefficients(self) -> dict[str, float]:
        """N [rad/sqrt(s)], K [rad/s/sqrt(s)], Q [rad] and R [rad/s^2] as data sheets mean them."""
        N = sum(term.N for term in self.terms if isinstance(term, White))
        K = sum(term.K**2 for term in self.terms if isinstance(term, RateRandomWalk))
        return {
            "N": float(np.sqrt(N)),
            "K": float(np.sqrt(K)),
            "Q": self.quantisation,
            "R": abs(self.ramp),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """A motion of the stand that is not meant, about all axes alike.

    With s = (t - start) / length from 0 to 1 the angle is ``a (s - sin(2 pi s) / (2 pi))``, which stays at a,
    or, of a motion that returns, as a tap does, ``a sin^2(pi s)``.

    Attributes
    ----------
    start : float
        From the record's start [s].
    length : float
        [s]
    angle : float
        a [rad].
    returns : bool
        Whether the angle returns to what it was.
    """

    start: float
    length: float
    angle: float
    returns: bool = False

    def __post_init__(self) -> None:
        for name in ("start", "angle"):
            require(self, name, least=-np.inf)
        require(self, "length", above=True)

    def turned(self, t: Float) -> Float:
        """Angle [rad] at times t [s], same shape."""
        s = np.clip((t - self.start) / self.length, 0.0, 1.0)
        if self.returns:
            return np.asarray(self.angle * np.sin(np.pi * s) ** 2, dtype=np.float64)
        return np.asarray(self.angle * (s - np.sin(2 * np.pi * s) / (2 * np.pi)), dtype=np.float64)

    def rate(self, t: Float) -> Float:
        """Its derivative [rad/s], same shape as t."""
        s = np.clip((t - self.start) / self.length, 0.0, 1.0)
        shape = np.pi * np.sin(2 * np.pi * s) if self.returns else 1 - np.cos(2 * np.pi * s)
        return np.asarray(self.angle / self.length * shape, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Turning:
    """A platform that turns evenly about axis r, from angle 0 at the first sample on, and how it is recorded.

    Attributes
    ----------
    rate : float
        [rad/s]
    quantity : {"table_angle", "table_rate"}
        What is recorded of it, at the gyro's instants.
    wrapped : bool
        Whether a recorded angle begins again at 0 after a full turn.
    """

    rate: float
    quantity: TableQuantity = "table_angle"
    wrapped: bool = False

    def __post_init__(self) -> None:
        require(self, "rate", least=-np.inf)
        if not self.rate:
            raise _wrong("rate", "a rate of the platform other than 0", "0", "leave the platform out")
        if self.wrapped and self.quantity == "table_rate":
            raise _wrong("wrapped", "an angle that wraps", "a rate", "record the table's angle")


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticSettings:
    """The gyro, its platform, and what is recorded.

    Attributes
    ----------
    errors : mapping of axis to AxisErrors
        Of the axes that are recorded; of those left out nothing is.
    rate : float
        Samples a second [Hz].
    duration : float
        Of the record [s]; samples at both ends.
    output : {"angular_rate", "angle_increment"}
        What the gyro gives. Rates are those at the sampling instants, their white noise its mean over the
        step before; increments are integrals over the step before.
    quantum : float
        Least step of the output: of the rate [rad/s], or of the summed angle [rad]; 0 for none.
    latitude : float, optional
        Of the stand [rad]: axis r up, p to the north at angle 0, the gyro measures the Earth's rotation.
        None: it does not.
    tilt : float
        Of axis r from the vertical to the north [rad].
    turning : Turning, optional
        The platform; None: it rests.
    disturbances : sequence of Disturbance
        What else moves.
    start : int
        Unix time of the first sample [ns].
    timing : TimingErrors
        What is wrong with the gyro's stamps and its transport; the samples themselves are even.
    """

    errors: Mapping[Axis, AxisErrors] = field(default_factory=lambda: {axis: AxisErrors() for axis in AXES})
    rate: float = 1.0
    duration: float = 14_400.0
    output: Output = "angle_increment"
    quantum: float = 0.0
    latitude: float | None = None
    tilt: float = 0.0
    turning: Turning | None = None
    disturbances: Sequence[Disturbance] = ()
    start: int = START
    timing: TimingErrors = field(default_factory=TimingErrors)

    def __post_init__(self) -> None:
        for name in ("rate", "duration"):
            require(self, name, above=True)
        require(self, "quantum")
        require(self, "latitude", least=-np.pi / 2, most=np.pi / 2)
        require(self, "tilt", least=-np.pi / 2, most=np.pi / 2)
        check_errors(self.timing)
        strange = [axis for axis in self.errors if axis not in AXES]
        if strange or not self.errors:
            found = repr(strange[0]) if strange else "none"
            raise _wrong("errors", f"axes among {', '.join(AXES)}", found, "name the axes that are recorded")
        if self.duration * self.rate < 2:
            found = f"{self.duration:g} s at {self.rate:g} Hz"
            raise _wrong(
                "duration", "three samples at least", found, "choose a longer record or a higher rate"
            )
        if self.timing.sample_jitter:
            found = f"{self.timing.sample_jitter:g} s"
            remedy = "give noise of the stamps instead"
            raise _wrong("sample_jitter", "0: noise is exact at even instants", found, remedy)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Those that are recorded, in their order."""
        return tuple(axis for axis in AXES if axis in self.errors)

    @property
    def count(self) -> int:
        """Samples of the record."""
        return int(self.duration * self.rate * (1 + 1e-12)) + 1

    @property
    def earth(self) -> tuple[float, float]:
        """Earth rate across the platform's axis, and along it [rad/s]."""
        if self.latitude is None:
            return 0.0, 0.0
        elevation = self.latitude + self.tilt
        return RATE * float(np.cos(elevation)), RATE * float(np.sin(elevation))


def turn_in(unit: AngleUnit) -> float:
    """A full turn in a unit of angle."""
    return 360.0 if unit == "deg" else 2 * np.pi


def _wrong(setting: str, expected: str, found: str, remedy: str) -> SimulationError:
    return SimulationError(f"simulation setting {setting}", expected=expected, found=found, remedy=remedy)
