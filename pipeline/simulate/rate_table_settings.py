"""What is simulated of a gyro on a rate table, or turned by hand: the gyro, its motion, and the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import Term
from pipeline.models.rate_table_steps import TableAxis
from pipeline.simulate.drift_settings import Encoder
from pipeline.simulate.imperfections import SimulationError, TimingErrors, check_errors, require
from pipeline.simulate.recording import START
from pipeline.simulate.static_settings import AXES, Axis

Float = NDArray[np.float64]
Method = Literal["rates", "turns", "positions"]
CaseAxis = Literal["p", "q", "r", "-p", "-q", "-r"]

CASE_AXES: tuple[CaseAxis, ...] = get_args(CaseAxis)
"""The axes of the case, either way."""
_HIGHEST = 5
"""Order of non-linearity that a test plan may ask for."""
_MOST = 0.5
"""Largest misalignment, ripple or error of scale: beyond it nothing is small any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableGyro:
    """One gyro of the case; its model is that of `pipeline.models.rate_table`.

    Attributes
    ----------
    scale_factor : float
        K [1]; negative for a gyro that counts the other way.
    asymmetry : float
        a, the difference of the scale factors of either direction over K [1].
    nonlinearity : mapping of int to float
        c of each order, 2 to 5, at the full scale of the settings [1].
    bias : float
        b [rad/s].
    misalignment : tuple of float
        Components of the unit vector of the input axis along the other two axes of the case, in their order
        [1].
    bias_temperature_sensitivity : float
        d [rad/s/K].
    scale_factor_temperature_sensitivity : float
        e [1/K].
    terms : tuple of Term
        Random errors of the rate, see `pipeline.models.random_error`; each run draws its own.
    """

    scale_factor: float = 1.0
    asymmetry: float = 0.0
    nonlinearity: Mapping[int, float] = field(default_factory=dict)
    bias: float = 0.0
    misalignment: tuple[float, float] = (0.0, 0.0)
    bias_temperature_sensitivity: float = 0.0
    scale_factor_temperature_sensitivity: float = 0.0
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        for name in ("scale_factor", "bias", "bias_temperature_sensitivity"):
            require(self, name, least=-np.inf)
        for name in ("asymmetry", "misalignment", "scale_factor_temperature_sensitivity"):
            require(self, name, least=-_MOST, most=_MOST)
        if not self.scale_factor:
            raise _wrong("scale_factor", "a scale factor other than 0", "0", "give another")
        for order, value in self.nonlinearity.items():
            if not (2 <= order <= _HIGHEST and abs(value) <= _MOST):
                expected = f"orders from 2 to {_HIGHEST}, parts up to {_MOST:g}"
                raise _wrong("nonlinearity", expected, f"{value:g} of order {order}", "choose another")

    def input_axis(self, axis: Axis) -> Float:
        """Its unit vector in the axes of the case, where it is the gyro of that axis, shape (3,)."""
        along, (one, other) = AXES.index(axis), self.misalignment
        return np.insert(np.array([one, other]), along, np.sqrt(1 - one**2 - other**2))

    def output(self, rate: Float, warmth: Float, full_scale: float) -> Float:
        """What it gives without noise for input rates [rad/s] at T - T0 [K], same shape.

        ``y = K { w + a |w| / 2 + sum_k c_k w_m (w / w_m)^k + e (T - T0) w } + b + d (T - T0)``
        """
        bent = [full_scale * c * (rate / full_scale) ** k for k, c in self.nonlinearity.items()]
        changed = self.scale_factor_temperature_sensitivity * warmth * rate
        braces = rate + self.asymmetry * np.abs(rate) / 2 + sum(bent, np.zeros_like(rate)) + changed
        return np.asarray(
            self.scale_factor * braces + self.bias + self.bias_temperature_sensitivity * warmth,
            dtype=np.float64,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """What the table does in each run: from rest it ramps to each rate in turn, holds it, and stops.

    Attributes
    ----------
    rates : tuple of float
        [rad/s].
    dwell : float
        For which each is held [s].
    acceleration : float
        Of the ramps between [rad/s^2].
    ripple : float
        Part of the rate by which it swings with the angle: for the angle phi that was commanded the table
        stands at ``phi + (ripple / n) sin(n phi)``. The table's sensor sees it as the gyro does.
    ripple_harmonic : int
        n, swings a turn.
    """

    rates: tuple[float, ...] = tuple(np.deg2rad([0.0, 50.0, -50.0, 100.0, -100.0]).tolist())
    dwell: float = 20.0
    acceleration: float = np.deg2rad(50.0)
    ripple: float = 0.0
    ripple_harmonic: int = 12

    def __post_init__(self) -> None:
        require(self, "rates", least=-np.inf)
        for name in ("dwell", "acceleration"):
            require(self, name, above=True)
        require(self, "ripple", most=_MOST)
        require(self, "ripple_harmonic", least=1)
        if not any(self.rates):
            raise _wrong("rates", "one rate other than 0 at least", "none", "add a rate")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """How the case stands on the table in a run.

    Attributes
    ----------
    axis : {"p", "q", "r", "-p", "-q", "-r"}
        Which axis of the case points along the table's axis of rotation.
    name : str
        Of the run; "": as the axis.
    """

    axis: CaseAxis = "r"
    name: str = ""

    def __post_init__(self) -> None:
        if self.axis not in CASE_AXES:
            raise _wrong("axis", f"one of {', '.join(CASE_AXES)}", repr(self.axis), "choose one")

    @property
    def to_case(self) -> Float:
        """Matrix from the axes of the table's rotor to those of the case, fixture without errors, (3, 3).

        Axes 3, 1, 2 of the rotor are the axis of the case and the two after it; for an opposite the case is
        turned over about axis 1 of the rotor.
        """
        along = AXES.index(self.axis.removeprefix("-"))
        over = np.diag([1.0, -1.0, -1.0]) if self.axis.startswith("-") else np.eye(3)
        return np.asarray(np.roll(np.eye(3), along + 1, axis=0) @ over, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """Turns by hand, each from rest to rest.

    Attributes
    ----------
    turns : tuple of float
        Angles of the turns about each axis of the case, p, q and r in turn [rad].
    rest, moving : float
        For how long the case rests before, between and after, and for how long it is turned [s].
    """

    turns: tuple[float, ...] = (2 * np.pi, -2 * np.pi)
    rest: float = 20.0
    moving: float = 5.0

    def __post_init__(self) -> None:
        require(self, "turns", least=-np.inf)
        for name in ("rest", "moving"):
            require(self, name, above=True)
        if not all(self.turns):
            raise _wrong("turns", "angles other than 0", "0", "leave it out")


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSensor:
    """What is recorded of the table.

    Attributes
    ----------
    quantity : {"table_angle", "table_rate"}
    rate : float
        Samples a second [Hz].
    noise : float
        Standard deviation of white noise on each sample [rad or rad/s].
    encoder : Encoder
        How it gives an angle; of a rate its unit of the angle only.
    """

    quantity: Literal["table_angle", "table_rate"] = "table_angle"
    rate: float = 100.0
    noise: float = 0.0
    encoder: Encoder = field(default_factory=Encoder)

    def __post_init__(self) -> None:
        require(self, "rate", above=True)
        require(self, "noise")
        if self.quantity == "table_rate" and (self.encoder.counts is not None or self.encoder.wrapped):
            found, remedy = "a rate with counts", "record the table's angle"
            raise _wrong("encoder", "counts and beginnings of a count of an angle", found, remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class Thermometer:
    """The temperature of the gyros, and its record.

    Attributes
    ----------
    profile : sequence of (time, temperature)
        From the record's start [s], and in K; straight between the points, constant beyond. At least one.
    rate : float
        Samples a second [Hz].
    noise : float
        Standard deviation of white noise on each sample [K].
    """

    profile: Sequence[tuple[float, float]]
    rate: float = 1.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        require(self, "rate", above=True)
        require(self, "noise")
        require(self, "profile")
        times = [time for time, _ in self.profile]
        if not times or times != sorted(set(times)):
            found = ", ".join(f"{time:g}" for time in times) or "none"
            raise _wrong("profile", "points at increasing times", found, "put them in order")

    def at(self, time: Float) -> Float:
        """Temperature [K] at times from the record's start [s]."""
        times, temperatures = np.array(self.profile).T
        return np.asarray(np.interp(time, times, temperatures), dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class RateTableSettings:
    """The gyros, how they are turned, and what is recorded.

    Attributes
    ----------
    gyros : mapping of axis to TableGyro
        Those that are recorded.
    method : {"rates", "turns", "positions"}
        On a rate table; by known angles by hand; at rest in six positions.
    profile, mountings : Profile, tuple of Mounting
        Of the table, for the method rates: each mounting is a run.
    hand : Hand
        For the other two, without a table; axis r begins up, p to the north.
    pause : float
        Between runs, unrecorded [s]; the table's angle begins at 0 in each.
    rate : float
        Samples of the gyros a second [Hz].
    means : bool
        Whether a sample is the mean over the step before it; else it is the rate at the instant. White noise
        is such a mean in either case.
    full_scale : float, optional
        w_m, to which non-linearity refers [rad/s]; None: the largest rate of the profile.
    quantum : float
        Least step of the outputs [rad/s]; 0 for none.
    counts_per_unit : float, optional
        Counts of the outputs for one deg/s: they are recorded as whole counts. None: as rates.
    latitude : float, optional
        Of the stand [rad]; None: the Earth does not turn.
    heading, tilt : float
        Azimuth of the table's axis 1, to which its axis of rotation leans, and by how much [rad], see
        `pipeline.models.rate_table_steps`.
    orientation_error : float
        Standard deviation of each mounting (position, or axis of a turn) about each axis [rad].
    angle_error : float
        Standard deviation of the angle of a turn by hand [rad].
    bias_error : float
        Standard deviation of each run's biases about those of the gyros [rad/s].
    table : TableSensor
    temperature : Thermometer, optional
        None: it is the reference temperature, and not recorded.
    reference_temperature : float
        T0 [K].
    start : int
        Unix time of the first sample [ns].
    timing : TimingErrors
        What is wrong with the gyros' stamps and transport; their clock offset is against the table.
    """

    gyros: Mapping[Axis, TableGyro] = field(default_factory=lambda: {axis: TableGyro() for axis in AXES})
    method: Method = "rates"
    profile: Profile = field(default_factory=Profile)
    mountings: tuple[Mounting, ...] = (Mounting(axis="p"), Mounting(axis="q"), Mounting(axis="r"))
    hand: Hand = field(default_factory=Hand)
    pause: float = 60.0
    rate: float = 100.0
    means: bool = False
    full_scale: float | None = None
    quantum: float = 0.0
    counts_per_unit: float | None = None
    latitude: float | None = None
    heading: float = 0.0
    tilt: float = 0.0
    orientation_error: float = 0.0
    angle_error: float = 0.0
    bias_error: float = 0.0
    table: TableSensor = field(default_factory=TableSensor)
    temperature: Thermometer | None = None
    reference_temperature: float = 293.15
    start: int = START
    timing: TimingErrors = field(default_factory=TimingErrors)

    def __post_init__(self) -> None:
        for name in ("pause", "rate", "full_scale", "counts_per_unit", "reference_temperature"):
            require(self, name, above=True)
        for name in ("quantum", "angle_error", "bias_error"):
            require(self, name)
        require(self, "orientation_error", most=_MOST)
        require(self, "latitude", least=-np.pi / 2, most=np.pi / 2)
        require(self, "heading", least=-np.inf)
        require(self, "tilt", most=np.pi)
        check_errors(self.timing)
        self._check_gyros_and_runs()

    def _check_gyros_and_runs(self) -> None:
        strange = [axis for axis in self.gyros if axis not in AXES]
        if strange or not self.gyros:
            found = repr(strange[0]) if strange else "none"
            raise _wrong("gyros", f"axes among {', '.join(AXES)}", found, "name the axes that are recorded")
        if not self.mountings:
            raise _wrong("mountings", "one at least", "none", "add one")
        names = [mounting.name or mounting.axis for mounting in self.mountings]
        if len(set(names)) < len(names):
            raise _wrong("mountings", "a name of its own for each", ", ".join(names), "name them apart")
        if self.timing.sample_jitter:
            found = f"{self.timing.sample_jitter:g} s"
            remedy = "give noise of the stamps instead"
            raise _wrong("sample_jitter", "0: noise is exact at even instants", found, remedy)
        if abs(self.timing.clock_offset) >= self.pause / 2:
            found, remedy = f"{self.timing.clock_offset:g} s", "choose a smaller one, or a longer pause"
            expected = f"less than half of the pause between runs, {self.pause:g} s"
            raise _wrong("clock_offset", expected, found, remedy)
        if self.quantum and self.counts_per_unit:
            found, remedy = "both", "keep the one that is meant"
            raise _wrong("quantum", "a quantum or counts, which are steps themselves", found, remedy)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Those of the gyros that are recorded, in their order."""
        return tuple(axis for axis in AXES if axis in self.gyros)

    @property
    def largest(self) -> float:
        """w_m, to which non-linearity refers [rad/s]."""
        return self.full_scale or float(np.abs(self.profile.rates).max())

    @property
    def table_axis(self) -> TableAxis | None:
        """The table's axis on the Earth; None where that does not turn."""
        return None if self.latitude is None else TableAxis(self.latitude, self.heading, self.tilt)


def _wrong(setting: str, expected: str, found: str, remedy: str) -> SimulationError:
    return SimulationError(f"simulation setting {setting}", expected=expected, found=found, remedy=remedy)
