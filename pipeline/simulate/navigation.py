"""Recordings of a navigation with known truth: inertial sensors, aids and the flight itself, in every format.

The flight is that of `pipeline.simulate.navigation_profile`, its errors those of
`pipeline.simulate.navigation_settings`. `NavigationRecord.problem` gives what a method of navigation works
on, straight from the recorded samples; `NavigationRecord.write` the files of `pipeline.simulate.recording`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models import strapdown
from pipeline.models.ellipsoid import displaced
from pipeline.models.navigation_problem import AidName, Fixes, Imu, Navigation, Problem, Start
from pipeline.simulate.imperfections import TimingErrors, even_instants, generator, nanoseconds
from pipeline.simulate.navigation_flight import Flight
from pipeline.simulate.navigation_plan import sections
from pipeline.simulate.navigation_profile import fly
from pipeline.simulate.navigation_sensors import Wind, bias_of, inertial, measured, wind_along
from pipeline.simulate.navigation_settings import AIDS, Aid, NavigationSettings, samples, wrong
from pipeline.simulate.navigation_streams import AID_STREAMS, TRUTH_STREAMS, inertial_streams, stream
from pipeline.simulate.plan import Processing, plan_text
from pipeline.simulate.recording import recorded_as_text, transmitted, write_recording
from pipeline.simulate.streams import AngleUnit, Recorded, RecordedStream

Float = NDArray[np.float64]
Time = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class NavigationRecord:
    """A simulated record and its truth.

    Attributes
    ----------
    settings : NavigationSettings
        What was simulated.
    seed : int
        Of all that is random in it.
    flight : Flight
        The motion itself, at any time.
    imu : Recorded
        Rates [rad/s] and specific forces [m/s^2], or their increments [rad], [m/s]; shape (n, 6).
    aids : mapping of str to Recorded
        Values as in `pipeline.models.navigation_problem.Fixes`.
    truth : Navigation
        At the instants of the inertial samples, by the true clock; method ``truth``. Its biases are those
        that the sensors had, its wind the mean and its wandering, without gusts; the
        barometer's is the constant one.
    faults : dict
        Where the faults of each sensor lie.
    """

    settings: NavigationSettings
    seed: int
    flight: Flight
    imu: Recorded
    aids: Mapping[AidName, Recorded]
    truth: Navigation
    faults: dict[str, Any]

    def problem(self, *, start_error: bool = True) -> Problem:
        """What a method of navigation is given: the recorded samples, by their stamps.

        Of inertial samples and fixes whose stamps do not increase only the first are kept.

        Parameters
        ----------
        start_error : bool, optional
            Whether it starts from the erroneous state of the settings, or from the true one.
        """
        imu = self.increments()
        aids = {name: _fixes(*self._in_order(recorded)) for name, recorded in self.aids.items()}
        start = self.start(float(imu.time[0]), error=start_error)
        return Problem(imu, start, aids, self.settings.earth_field)

    def increments(self) -> Imu:
        """The recorded inertial samples as increments."""
        t, values = self._in_order(self.imu)
        if self.settings.output == "increments":
            return strapdown.from_increments(t, values[1:, :3], values[1:, 3:])
        return strapdown.increments(t, values[:, :3], values[:, 3:])

    def start(self, time: float = 0.0, *, error: bool) -> Start:
        """The state at an instant [s], true or with the errors of the settings."""
        at = np.array([time])
        angles, position = self.flight.angles(at)[0], self.flight.position(at)[0]
        velocity = self.flight.velocity(at)[0]
        if error:
            sigma, drawn = self.settings.start_errors, generator(self.seed, "start")
            angles = angles + np.array(sigma.attitude) * drawn.standard_normal(3)
            velocity = velocity + sigma.velocity * drawn.standard_normal(3)
            position = displaced(position, sigma.position * drawn.standard_normal(3))
        latitude, longitude, height = position.tolist()
        return Start(latitude, longitude, height, velocity, strapdown.quaternion_from_yaw_pitch_roll(angles))

    def streams(self, *, text: bool, angle_unit: AngleUnit = "rad") -> list[RecordedStream]:
        """Sensors, aids and truth as they are recorded.

        Parameters
        ----------
        text : bool
            For a text file: columns with their units in the header. Else ROS messages.
        angle_unit : {"rad", "deg"}, optional
            Unit of angles in a text file.
        """
        streams = inertial_streams(self.imu, self.settings.output, text=text, angle_unit=angle_unit)
        for aid, recorded in self.aids.items():
            streams.append(stream(*AID_STREAMS[aid], recorded, text=text, angle_unit=angle_unit))
        duration, rate = self.settings.flight.duration, self.settings.truth_rate
        instants = even_instants(samples(duration, rate), rate)
        stamps = self.settings.start + instants
        motion = self.flight.at(np.asarray(instants / 1e9, dtype=np.float64))
        for names, values in zip(
            TRUTH_STREAMS, (motion.position, motion.velocity, motion.attitude), strict=True
        ):
            recorded = Recorded(stamps, stamps, values)
            streams.append(stream(*names, recorded, text=text, angle_unit=angle_unit))
        return streams

    def write(
        self, path: Path, *, processing: Processing | None = None, angle_unit: AngleUnit = "rad"
    ) -> tuple[Path, Path, Path]:
        """Write the recording, its test plan and its truth.

        Parameters
        ----------
        path : Path
            The recording, in the format that the name's end asks for, see
            `pipeline.simulate.recording.SUFFIXES`: a file, or for db3 a folder that is not there yet.
        processing : Processing, optional
            Title, settings of the stages and limits for the test plan, beside those that state the start, the
            field, the lift and the biases; by default no others.
        angle_unit : {"rad", "deg"}, optional
            Unit of angles in a text file.

        Returns
        -------
        recording, plan, truth : Path

        Raises
        ------
        SimulationError
            If the name ends otherwise.
        pipeline.formats.base.RecordingError
            If it cannot be written.
        """
        streams = self.streams(text=recorded_as_text(path), angle_unit=angle_unit)
        processing = processing or Processing("Simulated navigation", "simulated vehicle")
        usual = sections(self.settings, self.start(error=True))
        stated = {name: {**usual.get(name, {}), **keys} for name, keys in processing.stages.items()}
        processing = replace(processing, stages=usual | stated)
        return write_recording(path, streams, plan_text("navigation", streams, processing), self.account())

    def account(self) -> dict[str, Any]:
        """What the file of the truth says: settings, seed, the start, and where each fault lies."""
        start, errors = self.start(error=True), self.settings.errors
        return {
            "generator": "gyrostand simulate navigation",
            "seed": self.seed,
            "settings": asdict(self.settings),
            "units": "angles in rad, rates in rad/s, lengths in m, speeds in m/s, specific force in m/s^2, "
            "field in T, times in s, rates of sampling in Hz, start in ns of Unix time",
            "start_with_errors": {
                "latitude": start.latitude,
                "longitude": start.longitude,
                "height": start.height,
                "velocity": start.velocity.tolist(),
                "yaw_pitch_roll": strapdown.yaw_pitch_roll(start.attitude).tolist(),
            },
            "biases": {
                "gyro": list(errors.gyro_bias),
                "accelerometer": list(errors.accelerometer_bias),
                **{n: bias_of(n, aid, self.seed).tolist() for n, aid in self.settings.aids.items()},
            },
            "samples": {
                "imu": len(self.imu.log_time),
                **{name: len(recorded.log_time) for name, recorded in self.aids.items()},
            },
            "faults": self.faults,
        }

    def _in_order(self, recorded: Recorded) -> tuple[Float, Float]:
        """Times [s] and values of the samples whose stamps increase."""
        latest = np.maximum.accumulate(recorded.header_stamp)
        new = np.r_[True, recorded.header_stamp[1:] > latest[:-1]]
        seconds = (recorded.header_stamp[new] - self.settings.start) / 1e9
        return np.asarray(seconds, dtype=np.float64), recorded.values[new]


def simulate_navigation(settings: NavigationSettings, seed: int = 0) -> NavigationRecord:
    """Simulate the record of a moving vehicle.

    Parameters
    ----------
    settings : NavigationSettings
        The flight, the sensors and what is wrong with the record.
    seed : int, optional
        Seed of all that is random; the same seed gives the same record, and a sensor has the same errors
        whatever the others have.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    """
    flight = fly(settings.flight)
    instants = even_instants(settings.count, settings.rate)
    t = np.asarray(instants / 1e9, dtype=np.float64)
    motion = flight.at(t)
    wind = wind_along(settings.air, settings.flight.wind, t, seed)
    given = inertial(settings, flight, motion, t, seed)
    stamping = settings.timing, settings.clock_rate, settings.start
    imu, faults = _transmitted(instants, given.values, settings.rate, *stamping, seed, 0)
    aids, of_aids = _aids(settings, flight, wind, seed)
    altimeter = settings.aids.get("altitude", Aid())
    (bias,) = bias_of("altitude", altimeter, seed)
    truth = Navigation(
        "truth",
        t,
        motion.position,
        motion.velocity,
        motion.attitude,
        given.gyro_bias,
        given.accelerometer_bias,
        wind.wind,
        np.full(len(t), bias),
    )
    return NavigationRecord(settings, seed, flight, imu, aids, truth, {"imu": faults} | of_aids)


def _aids(
    settings: NavigationSettings, flight: Flight, wind: Wind, seed: int
) -> tuple[dict[AidName, Recorded], dict[str, Any]]:
    """What the aids recorded, and where their faults lie."""
    aids: dict[AidName, Recorded] = {}
    faults: dict[str, Any] = {}
    for name, aid in settings.aids.items():
        if aid.first > settings.flight.duration:
            found = f"{aid.first:g} s of {name}"
            raise wrong("first", "a measurement before the record's end", found, "begin earlier")
        count = samples(settings.flight.duration - aid.first, aid.rate)
        instants = even_instants(count, aid.rate) + nanoseconds(np.array(aid.first))
        t = np.asarray(instants / 1e9, dtype=np.float64)
        values = measured(name, aid, settings, t, flight.at(t), wind, seed)
        timing = replace(aid.timing, gaps=(*aid.timing.gaps, *aid.outages))
        number = AIDS.index(name) + 1
        aids[name], faults[name] = _transmitted(
            instants, values, aid.rate, timing, aid.clock_rate, settings.start, seed, number
        )
    return aids, faults


def _transmitted(
    instants: Time,
    values: Float,
    rate: float,
    timing: TimingErrors,
    clock_rate: float,
    start: int,
    seed: int,
    number: int,
) -> tuple[Recorded, dict[str, Any]]:
    """A sensor's samples as recorded, its clock gaining, its transport random by itself."""
    own = int(generator(seed, "transport", number).integers(2**62))
    recorded, faults = transmitted(instants, values, rate, start, timing, own)
    gained = np.rint(clock_rate * (recorded.header_stamp - start)).astype(np.int64)
    return Recorded(recorded.log_time, recorded.header_stamp + gained, recorded.values), faults


def _fixes(time: Float, values: Float) -> Fixes:
    return Fixes(time, values, np.asarray(np.isfinite(values).all(axis=1)))
