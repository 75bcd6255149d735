"""Recordings of a vibration stand, with known truth, in every format.

The motion is that of `pipeline.models.coning`; what is wrong with the record is stated in
`pipeline.simulate.imperfections`. The files are those of `pipeline.simulate.recording`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models.coning import ConingMotion, Motion, SmoothConing
from pipeline.numerics.rotation import (
    euler_krylov_from_quaternion,
    matrix_from_quaternion,
    quaternion_from_rotation_vector,
    quaternion_multiply,
)
from pipeline.simulate.imperfections import (
    GyroErrors,
    Output,
    SimulationError,
    TimingErrors,
    check_errors,
    even_instants,
    generator,
    in_seconds,
    require,
    sampling_instants,
    spoil,
)
from pipeline.simulate.plan import Processing, paper_stages, plan_text
from pipeline.simulate.recording import START, recorded_as_text, transmitted, write_recording
from pipeline.simulate.streams import AngleUnit, Recorded, RecordedStream, as_columns, as_messages

Float = NDArray[np.float64]
Time = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ConingSettings:
    """What the stand does and what is recorded; the defaults are the paper's experiment.

    Attributes
    ----------
    cone_angle : float
        Opening angle of the cone [rad].
    frequency : float
        Frequency of the coning [Hz].
    rate : float
        Samples of the gyro a second [Hz].
    reference_rate : float
        Samples of the reference attitude a second [Hz]. Gamma vibrates at twice the frequency: a reference
        slower than some twenty samples a vibration, or commensurate with it, does not show it.
    duration : float
        Of the record [s]; samples at both ends.
    first_time : float
        Time of the motion at the record's first sample [s].
    onset : float, optional
        Time of the motion t* at which the coning begins [s]; before it the body only rolls. None: it always
        cones.
    smooth_slope, smooth_offset : float
        a [rad/s] and b [rad] of the smooth roll ``a t + b`` on which the coning is set.
    start : int
        Unix time of the first sample [ns].
    output : {"angular_rate", "angle_increment"}
        What the gyro gives.
    gyro, timing : GyroErrors, TimingErrors
        What is wrong with it.
    reference_noise : float
        Standard deviation of white noise on the reference attitude, about each axis [rad].
    """

    cone_angle: float = np.pi / 180
    frequency: float = 100.0
    rate: float = 400.0
    reference_rate: float = 20_000.0
    duration: float = 1.0
    first_time: float = 0.0
    onset: float | None = None
    smooth_slope: float = 0.0
    smooth_offset: float = 0.0
    start: int = START
    output: Output = "angular_rate"
    gyro: GyroErrors = field(default_factory=GyroErrors)
    timing: TimingErrors = field(default_factory=TimingErrors)
    reference_noise: float = 0.0

    def __post_init__(self) -> None:
        for name in ("rate", "reference_rate", "duration"):
            require(self, name, above=True)
        for name in ("first_time", "onset", "smooth_slope", "smooth_offset"):
            require(self, name, least=-np.inf)
        require(self, "reference_noise")
        check_errors(self.gyro)
        check_errors(self.timing)
        if self.duration * self.rate < 1:
            raise SimulationError(
                "simulation setting duration",
                expected="two samples of the gyro at least",
                found=f"{self.duration:g} s at {self.rate:g} Hz",
                remedy="choose a longer record or a higher rate",
            )

    @property
    def motion(self) -> Motion:
        """What the stand does."""
        coning = ConingMotion(self.cone_angle, self.frequency)
        if self.onset is None and not self.smooth_slope and not self.smooth_offset:
            return coning
        if self.onset is None:
            raise SimulationError(
                "simulation setting onset",
                expected="the time at which the coning is set on the smooth roll",
                found="none",
                remedy="give an onset, or leave the smooth roll out",
            )
        return SmoothConing(coning, self.onset, self.smooth_slope, self.smooth_offset)


@dataclass(frozen=True, slots=True)
class SimulatedConing:
    """A simulated record and its truth.

    Attributes
    ----------
    settings : ConingSettings
        What was simulated.
    gyro : Recorded
        p, q, r: rates [rad/s] or angle increments [rad].
    reference : Recorded
        Quaternion w, x, y, z.
    reference_angles : Recorded
        The same attitude as Euler-Krylov angles psi, theta, gamma [rad].
    truth : dict
        Settings, seed, the motion's constants, and where each fault lies.
    """

    settings: ConingSettings
    gyro: Recorded
    reference: Recorded
    reference_angles: Recorded
    truth: dict[str, Any]

    def streams(self, *, text: bool, angle_unit: AngleUnit = "rad") -> tuple[RecordedStream, RecordedStream]:
        """Gyro and reference as they are recorded.

        Parameters
        ----------
        text : bool
            For a text file: columns with their units in the header, and the reference in angles. Else ROS
            messages, in SI.
        angle_unit : {"rad", "deg"}, optional
            Unit of the angle in a text file.
        """
        if text:
            return (
                as_columns("gyro", self.settings.output, self.gyro, angle_unit),
                as_columns("reference", "euler_krylov", self.reference_angles, angle_unit),
            )
        return (
            as_messages("gyro", self.settings.output, self.gyro),
            as_messages("reference", "quaternion", self.reference),
        )

    def write(
        self,
        path: Path,
        *,
        processing: Processing | None = None,
        angle_unit: AngleUnit = "rad",
    ) -> tuple[Path, Path, Path]:
        """Write the recording, its test plan and its truth.

        Parameters
        ----------
        path : Path
            The recording, in the format that the name's end asks for, see
            `pipeline.simulate.recording.SUFFIXES`: a file, or for db3 a folder that is not there yet.
        processing : Processing, optional
            Title, settings of the stages and limits for the test plan; by default as in the paper, on a grid
            as fine as the reference, without limits.
        angle_unit : {"rad", "deg"}, optional
            Unit of the angle in a text file.

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
        text = recorded_as_text(path)
        streams = self.streams(text=text, angle_unit=angle_unit)
        if processing is None:
            finer = max(1, round(self.settings.reference_rate / self.settings.rate))
            processing = Processing(stages=paper_stages(finer))
        return write_recording(path, streams, plan_text("coning", streams, processing), self.truth)


def simulate_coning(settings: ConingSettings, seed: int = 0) -> SimulatedConing:
    """Simulate a record of a vibration stand.

    Parameters
    ----------
    settings : ConingSettings
        The motion, the rates and what is wrong with the record.
    seed : int, optional
        Seed of all that is random; the same seed gives the same record.

    Raises
    ------
    SimulationError, pipeline.models.coning.MotionError
        If a setting is out of its range.
    """
    motion = settings.motion
    gyro, faults = _gyro(settings, motion, seed)
    count = int(settings.duration * settings.reference_rate * (1 + 1e-12)) + 1
    instants = even_instants(count, settings.reference_rate)
    t = settings.first_time + instants * 1e-9
    attitude, angles = motion.quaternion(t), motion.angles(t)
    if settings.reference_noise:
        noise = generator(seed, "reference noise").standard_normal((count, 3))
        attitude = quaternion_multiply(
            attitude, quaternion_from_rotation_vector(settings.reference_noise * noise)
        )
        angles = euler_krylov_from_quaternion(attitude)
    stamps = settings.start + instants
    coning = ConingMotion(settings.cone_angle, settings.frequency)
    truth = {
        "generator": "gyrostand simulate coning",
        "seed": seed,
        "settings": asdict(settings),
        "units": "angles in rad, rates in rad/s, times in s, start in ns of Unix time",
        "motion": {
            "roll_rate": coning.roll_rate,
            "rate_amplitude": coning.rate_amplitude,
            "angular_frequency": coning.angular_frequency,
        },
        "samples": {"gyro": len(gyro.log_time), "reference": count},
        "faults": faults,
    }
    return SimulatedConing(
        settings, gyro, Recorded(stamps, stamps, attitude), Recorded(stamps, stamps, angles), truth
    )


def _gyro(settings: ConingSettings, motion: Motion, seed: int) -> tuple[Recorded, dict[str, Any]]:
    """The gyro's samples in the order in which they are recorded, and where their faults lie."""
    timing = settings.timing
    count = int(settings.duration * settings.rate * (1 + 1e-12)) + 1
    instants = sampling_instants(count, settings.rate, timing, seed)
    seconds = in_seconds(instants)
    t = settings.first_time + seconds
    before = np.concatenate(([t[0] - 1 / settings.rate], t[:-1]))
    exact = motion.rates(t) if settings.output == "angular_rate" else motion.increments(before, t)
    body_from_gyro = matrix_from_quaternion(quaternion_from_rotation_vector(settings.gyro.mounting))
    values = spoil(exact @ body_from_gyro, t - before, settings.output, settings.gyro, seed)
    return transmitted(instants, values, settings.rate, settings.start, timing, seed)
