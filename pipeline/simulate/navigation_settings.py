"""What is simulated of a navigation: the flight, the air, the inertial sensors, the aids."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.air_data import Lift
from pipeline.models.navigation_problem import AidName, EarthField
from pipeline.simulate.imperfections import SimulationError, Span, TimingErrors, check_errors, require
from pipeline.simulate.recording import START

Float = NDArray[np.float64]
Triple = tuple[float, float, float]
Kind = Literal["turn", "climb", "accelerate"]
SwayAngle = Literal["yaw", "pitch", "roll"]
ImuOutput = Literal["rates", "increments"]

AIDS: tuple[AidName, ...] = get_args(AidName)
"""The aids there may be."""

COMPONENTS: Mapping[AidName, int] = MappingProxyType(
    {"position": 3, "velocity": 3, "airspeed": 1, "altitude": 1, "magnetic_field": 3, "attitude": 3}
)
"""Components of the error of each."""

_DEGREE = float(np.deg2rad(1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvre:
    """A change of heading, height or speed, smooth to the fifth derivative, that begins and ends at rest.

    Attributes
    ----------
    kind : {"turn", "climb", "accelerate"}
        Of what.
    start, length : float
        From the record's start; how long it takes [s]. Its rate rises and falls within 4 s, or half of it.
    amount : float
        By which the heading changes, to the right [rad], the height, up [m], or the speed [m/s].
    """

    kind: Kind
    start: float
    length: float
    amount: float

    def __post_init__(self) -> None:
        for name in ("start", "amount"):
            require(self, name, least=-np.inf)
        require(self, "length", above=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sway:
    """A steady oscillation of the attitude, ``amplitude sin(2 pi frequency t + phase)``, set on the motion.

    Attributes
    ----------
    angle : {"yaw", "pitch", "roll"}
    amplitude, phase : float
        [rad].
    frequency : float
        [Hz].
    """

    angle: SwayAngle
    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "phase"):
            require(self, name, least=-np.inf)
        require(self, "frequency", above=True, most=50.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSettings:
    """Where the vehicle moves, and how; see `pipeline.simulate.navigation_flight` for the model.

    Attributes
    ----------
    duration : float
        [s].
    latitude, longitude, height : float
        Of the start [rad, rad, m].
    yaw : float
        At the start [rad].
    speed : float
        Through the air, once it has been reached; of a vehicle without lift, over the ground [m/s].
    catapult : float or None
        Time in which the speed is reached from rest [s]; None: it is there from the first.
    standing : float
        Rest before the catapult [s].
    wind : tuple of float
        Mean velocity of the air N, E [m/s], which carries an aircraft with it.
    lift : Lift or None
        What carries an aircraft, which then banks in turns; None: a vehicle on the ground or on a stand,
        which stays level.
    manoeuvres : tuple of Manoeuvre
    sways : tuple of Sway
    """

    duration: float = 1800.0
    latitude: float = 58.05 * _DEGREE
    longitude: float = 38.85 * _DEGREE
    height: float = 100.0
    yaw: float = 55.0 * _DEGREE
    speed: float = 40.0
    catapult: float | None = 2.0
    standing: float = 1.0
    wind: tuple[float, float] = (0.0, 0.0)
    lift: Lift | None = field(default_factory=Lift)
    manoeuvres: tuple[Manoeuvre, ...] = ()
    sways: tuple[Sway, ...] = ()

    def __post_init__(self) -> None:
        require(self, "duration", above=True, most=1e6)
        require(self, "latitude", least=-89 * _DEGREE, most=89 * _DEGREE)
        require(self, "longitude", least=-np.pi, most=np.pi)
        require(self, "height", least=-1000.0, most=1e5)
        require(self, "yaw", least=-2 * np.pi, most=2 * np.pi)
        require(self, "speed", above=self.lift is not None, most=3000.0)
        require(self, "catapult", above=True)
        require(self, "standing")
        require(self, "wind", least=-100.0, most=100.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussMarkov:
    """A first-order Gauss-Markov process.

    Attributes
    ----------
    sigma : float
        Its standard deviation.
    time : float
        In which its autocorrelation falls to 1/e [s].
    """

    sigma: float
    time: float

    def __post_init__(self) -> None:
        require(self, "sigma")
        require(self, "time", above=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """How the air moves about its mean wind, which is the flight's.

    Attributes
    ----------
    wander : GaussMarkov
        Of the wind, N and E alike [m/s].
    gust, vertical_gust : GaussMarkov
        Turbulence, N and E alike, and D [m/s].
    """

    wander: GaussMarkov = GaussMarkov(sigma=0.0, time=300.0)
    gust: GaussMarkov = GaussMarkov(sigma=0.0, time=6.6)
    vertical_gust: GaussMarkov = GaussMarkov(sigma=0.0, time=2.5)

    @classmethod
    def turbulent(cls, gust: float, wander: float = 0.0) -> Air:
        """Gusts of a standard deviation [m/s], vertically 0.73 of it, and a wandering wind."""
        return cls(
            wander=GaussMarkov(sigma=wander, time=300.0),
            gust=GaussMarkov(sigma=gust, time=6.6),
            vertical_gust=GaussMarkov(sigma=0.73 * gust, time=2.5),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuErrors:
    """Errors of the inertial sensors; axes forward, right, down.

    Attributes
    ----------
    gyro_bias, accelerometer_bias : tuple of float
        [rad/s], [m/s^2].
    gyro_noise, accelerometer_noise : float
        Standard deviation of white noise of a sample [rad/s], [m/s^2]; of an increment it acts over the step.
    gyro_wander, accelerometer_wander : GaussMarkov or None
        Of the bias of each axis [rad/s], [m/s^2].
    """

    gyro_bias: Triple = (0.0, 0.0, 0.0)
    accelerometer_bias: Triple = (0.0, 0.0, 0.0)
    gyro_noise: float = 0.0
    accelerometer_noise: float = 0.0
    gyro_wander: GaussMarkov | None = None
    accelerometer_wander: GaussMarkov | None = None

    def __post_init__(self) -> None:
        for name in ("gyro_bias", "accelerometer_bias"):
            require(self, name, least=-np.inf)
        for name in ("gyro_noise", "accelerometer_noise"):
            require(self, name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Aid:
    """How one aid measures: (1 + scale) times the truth, plus bias, wander and noise.

    The unit of an error is that of the quantity: m of position, about N, E, D and along them; m/s; m; T; of
    an attitude rad, about N, E, D.

    Attributes
    ----------
    rate : float
        Measurements a second [Hz].
    first : float
        Time of the first [s].
    noise : float
        Standard deviation of white noise, of each component.
    wander : GaussMarkov or None
        Of each component.
    bias : float
        Of each component.
    drawn_bias : float
        Standard deviation of a further bias of each component, drawn once a run.
    scale : float
        Relative error; not of position and attitude.
    outages : tuple of (start, length)
        When there are no measurements [s].
    timing : TimingErrors
        What is wrong with the stamps and the transport.
    clock_rate : float
        Seconds that its clock gains a second.
    """

    rate: float = 1.0
    first: float = 0.0
    noise: float = 0.0
    wander: GaussMarkov | None = None
    bias: float = 0.0
    drawn_bias: float = 0.0
    scale: float = 0.0
    outages: tuple[Span, ...] = ()
    timing: TimingErrors = field(default_factory=TimingErrors)
    clock_rate: float = 0.0

    def __post_init__(self) -> None:
        require(self, "rate", above=True, most=1e4)
        for name in ("first", "noise", "drawn_bias", "outages"):
            require(self, name)
        for name in ("bias", "scale"):
            require(self, name, least=-np.inf)
        require(self, "clock_rate", least=-0.01, most=0.01)
        check_even(self.timing)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartErrors:
    """Standard deviations of the errors of the state with which a navigation starts, drawn once a run.

    Attributes
    ----------
    attitude : tuple of float
        Of yaw, pitch and roll [rad].
    velocity, position : float
        Of each component [m/s], [m].
    """

    attitude: Triple = (1.0 * _DEGREE, 0.5 * _DEGREE, 0.5 * _DEGREE)
    velocity: float = 0.0
    position: float = 0.0

    def __post_init__(self) -> None:
        for name in ("attitude", "velocity", "position"):
            require(self, name)


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationSettings:
    """The vehicle, its sensors, and what is recorded.

    Attributes
    ----------
    flight : FlightSettings
    air : Air
    rate : float
        Samples of the inertial sensors a second [Hz].
    output : {"rates", "increments"}
        What they give: angular rates and specific forces at the sampling instants, or their integrals over
        the step before, in body axes.
    errors : ImuErrors
    timing : TimingErrors
        What is wrong with their stamps and transport.
    clock_rate : float
        Seconds that their clock gains a second.
    aids : mapping of str to Aid
        Those that there are.
    earth_field : EarthField
        That the magnetometer measures.
    start_errors : StartErrors
    truth_rate : float
        Samples a second of the truth in a recording [Hz].
    start : int
        Unix time of the first sample [ns].
    """

    flight: FlightSettings = field(default_factory=FlightSettings)
    air: Air = field(default_factory=Air)
    rate: float = 100.0
    output: ImuOutput = "rates"
    errors: ImuErrors = field(default_factory=ImuErrors)
    timing: TimingErrors = field(default_factory=TimingErrors)
    clock_rate: float = 0.0
    aids: Mapping[AidName, Aid] = field(default_factory=dict)
    earth_field: EarthField = field(
        default_factory=lambda: EarthField(52e-6, float(np.deg2rad(71.0)), float(np.deg2rad(11.0)))
    )
    start_errors: StartErrors = field(default_factory=StartErrors)
    truth_rate: float = 10.0
    start: int = START

    def __post_init__(self) -> None:
        require(self, "rate", above=True, most=1e4)
        require(self, "truth_rate", above=True, most=1e4)
        require(self, "clock_rate", least=-0.01, most=0.01)
        check_even(self.timing)
        strange = [name for name in self.aids if name not in AIDS]
        if strange:
            raise wrong("aids", f"some of {', '.join(AIDS)}", repr(strange[0]), "correct the name")
        if self.flight.duration * self.rate < 2:
            found = f"{self.flight.duration:g} s at {self.rate:g} Hz"
            raise wrong(
                "duration", "three samples at least", found, "choose a longer record or a higher rate"
            )

    @property
    def count(self) -> int:
        """Samples of the inertial sensors."""
        return samples(self.flight.duration, self.rate)


def samples(duration: float, rate: float) -> int:
    """How many samples there are from 0 to a duration [s], both included, at a rate [Hz]."""
    return int(duration * rate * (1 + 1e-12)) + 1


def check_even(timing: TimingErrors) -> None:
    """Raise a `SimulationError` if a value cannot be, or the sampling itself is uneven."""
    check_errors(timing)
    if timing.sample_jitter:
        found = f"{timing.sample_jitter:g} s"
        raise wrong("sample_jitter", "0: the samples are even", found, "give noise of the stamps instead")


def wrong(setting: str, expected: str, found: str, remedy: str) -> SimulationError:
    """The error for a setting that cannot be."""
    return SimulationError(f"simulation setting {setting}", expected=expected, found=found, remedy=remedy)
