"""What is simulated of a non-contact gyro on its stand: the gyro, its runs, the encoders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import Scheme, mounting_angles, rotation_vector_from_increments
from pipeline.simulate.imperfections import (
    EncoderErrors,
    SimulationError,
    TimingErrors,
    check_errors,
    require,
)
from pipeline.simulate.recording import START
from pipeline.simulate.streams import AngleUnit

Float = NDArray[np.float64]
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftRun:
    """One run of the gyro: how its base stands, where it begins, how long it lasts.

    Attributes
    ----------
    name : str
        What the test plan calls it; "" for the scheme.
    scheme : {"polar", "equatorial", "horizontal", "vertical"}, optional
        Mounting scheme; None where ``chi`` is given.
    chi : tuple of float, optional
        Mounting angles chi1, chi2, chi3 [rad], in place of a scheme.
    start : tuple of float
        alpha1, alpha2 at the run's first sample [rad].
    misalignment : tuple of float
        Rotation vector Delta chi of the base [rad].
    increments : tuple of float
        The same as increments of the angles chi [rad], added to the rotation vector; for chi1 = 0.
    duration : float
        Of the run [s]; samples at both ends.
    """

    name: str = ""
    scheme: Scheme | None = "polar"
    chi: Triple | None = None
    start: Pair = (0.0, 0.0)
    misalignment: Triple = (0.0, 0.0, 0.0)
    increments: Triple = (0.0, 0.0, 0.0)
    duration: float = 86_400.0

    def __post_init__(self) -> None:
        require(self, "duration", above=True)
        require(self, "start", least=-np.inf)
        for name in ("misalignment", "increments"):
            require(self, name, least=-0.5, most=0.5)
        require(self, "chi", least=-np.inf)
        if (self.scheme is None) == (self.chi is None):
            found = "neither" if self.scheme is None else f"both {self.scheme!r} and the angles"
            raise _wrong("scheme", "a scheme or the angles chi", found, "give one of the two")
        if self.chi is not None and self.chi[0] and any(self.increments):
            remedy = "give the misalignment as a rotation vector"
            raise _wrong("increments", "chi1 = 0 beside increments", f"{self.chi[0]:g} rad", remedy)

    def mounting(self, latitude: float) -> Triple:
        """Mounting angles chi1, chi2, chi3 [rad] at a latitude [rad]."""
        if self.chi is not None:
            return self.chi
        assert self.scheme is not None
        return mounting_angles(self.scheme, latitude)

    def delta_chi(self, latitude: float) -> Float:
        """The whole misalignment as a rotation vector [rad], shape (3,)."""
        chi = self.mounting(latitude)
        return np.array(self.misalignment) + rotation_vector_from_increments(self.increments, chi)


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoder:
    """How the encoders give the angles.

    Attributes
    ----------
    counts : int, optional
        Counts a turn: the angle is rounded to whole ones; None for an encoder without steps.
    as_counts : bool
        Whether the recorded value is the count, not the angle.
    unit : {"rad", "deg"}
        Unit of a recorded angle, and of the counts after their scale.
    wrapped : bool
        Whether the value begins again at 0 after a full turn.
    """

    counts: int | None = None
    as_counts: bool = False
    unit: AngleUnit = "rad"
    wrapped: bool = False

    def __post_init__(self) -> None:
        require(self, "counts", least=2, most=2**53)
        if self.as_counts and self.counts is None:
            raise _wrong("counts", "the counts a turn of an encoder that gives counts", "none", "give them")

    @property
    def turn(self) -> float:
        """A full turn as recorded."""
        if self.as_counts:
            return float(self.counts or 1)
        return 360.0 if self.unit == "deg" else 2 * np.pi

    def read(self, angle: Float) -> Float:
        """What the encoder gives for angles [rad]."""
        if self.counts is None:
            value = np.degrees(angle) if self.unit == "deg" else angle
        else:
            whole = np.rint(angle * (self.counts / (2 * np.pi)))
            value = whole * (self.turn / self.counts)
        return np.mod(value, self.turn) if self.wrapped else np.asarray(value, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftSettings:
    """The gyro, its runs on the stand, and what is recorded.

    Attributes
    ----------
    latitude : float
        Of the stand, north positive [rad].
    m : tuple of float
        m11, m12, m21, m22, mc1, mc2, in units of the Earth rate [1].
    theta : tuple of float
        Tilt of the rotor theta1, theta2 [rad].
    runs : tuple of DriftRun
        In the order of time.
    interval : float
        Between samples [s].
    pause : float
        Between the last sample of a run and the first of the next [s].
    transient : tuple of float, optional
        Drift m0 at the beginning of each run, which decays to m; None: m throughout.
    transient_time : float
        In which the transient falls to 1/e [s].
    servo_jumps : sequence of (time, jump1, jump2)
        The servo loses the rotor at this instant from the record's start [s] and holds it again with the
        gimbal turned by the jumps [rad].
    start : int
        Unix time of the first sample [ns].
    encoder, errors, timing : Encoder, EncoderErrors, TimingErrors
        How the angles are recorded, and what is wrong with them.
    """

    latitude: float = np.deg2rad(55.75)
    m: Six = (0.01,) * 6
    theta: Pair = (0.0, 0.0)
    runs: tuple[DriftRun, ...] = (DriftRun(),)
    interval: float = 10.0
    pause: float = 3600.0
    transient: Six | None = None
    transient_time: float = 3600.0
    servo_jumps: Sequence[Triple] = ()
    start: int = START
    encoder: Encoder = field(default_factory=Encoder)
    errors: EncoderErrors = field(default_factory=EncoderErrors)
    timing: TimingErrors = field(default_factory=TimingErrors)

    def __post_init__(self) -> None:
        require(self, "latitude", least=-np.pi / 2, most=np.pi / 2)
        for name in ("m", "transient"):
            require(self, name, least=-1.0, most=1.0)
        require(self, "theta", least=-0.5, most=0.5)
        for name in ("interval", "pause", "transient_time"):
            require(self, name, above=True)
        require(self, "servo_jumps", least=-np.inf)
        check_errors(self.errors)
        check_errors(self.timing)
        if not self.runs:
            raise _wrong("runs", "one run at least", "none", "add a run")
        shortest = min(run.duration for run in self.runs)
        if shortest < 2 * self.interval:
            found = f"{shortest:g} s at {self.interval:g} s a sample"
            raise _wrong(
                "duration", "three samples at least", found, "choose a longer run or a shorter interval"
            )


def _wrong(setting: str, expected: str, found: str, remedy: str) -> SimulationError:
    return SimulationError(f"simulation setting {setting}", expected=expected, found=found, remedy=remedy)
