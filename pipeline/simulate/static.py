"""Recordings of a gyro at rest, or on an evenly turning platform, with known truth, in every format.

The random errors are exact for any step: those of `pipeline.models.random_error`, and their integrals of
`pipeline.models.random_error_increments`. What is wrong with the record is stated in
`pipeline.simulate.imperfections`; the files are those of `pipeline.simulate.recording`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error_increments import increments
from pipeline.simulate.imperfections import even_instants, generator, in_seconds, quantised
from pipeline.simulate.plan import Processing, plan_text
from pipeline.simulate.recording import recorded_as_text, transmitted, write_recording
from pipeline.simulate.static_settings import AXES, Axis, StaticSettings, turn_in
from pipeline.simulate.streams import (
    AngleUnit,
    Recorded,
    RecordedStream,
    as_columns,
    as_messages,
    turntable,
)

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SimulatedStatic:
    """A simulated record and its truth.

    Attributes
    ----------
    settings : StaticSettings
        What was simulated.
    gyro : Recorded
        The recorded axes, in order: rates [rad/s] or angle increments [rad].
    table : Recorded or None
        Angle [rad] or rate [rad/s] of the platform, shape (n, 1); None where it rests.
    truth : dict
        Settings, seed, the errors by axis, and where each fault lies.
    """

    settings: StaticSettings
    gyro: Recorded
    table: Recorded | None
    truth: dict[str, Any]

    def streams(self, *, text: bool, angle_unit: AngleUnit = "rad") -> list[RecordedStream]:
        """Gyro and platform as they are recorded.

        Parameters
        ----------
        text : bool
            For a text file: columns with their units in the header. Else ROS messages, in SI.
        angle_unit : {"rad", "deg"}, optional
            Unit of the angle in a text file.
        """
        output, axes = self.settings.output, self.settings.axes
        if text:
            streams = [as_columns("gyro", output, self.gyro, angle_unit, axes)]
        else:
            angle_unit = "rad"
            streams = [as_messages("gyro", output, self.gyro, axes)]
        turning = self.settings.turning
        if turning is not None and self.table is not None:
            turn = turn_in(angle_unit)
            values = self.table.values * (turn / (2 * np.pi))
            if turning.wrapped:
                values = np.mod(values, turn)
            recorded = Recorded(self.table.log_time, self.table.header_stamp, values)
            unit = angle_unit if turning.quantity == "table_angle" else f"{angle_unit}/s"
            wraps_at = turn if turning.wrapped else None
            streams.append(turntable(recorded, turning.quantity, unit, text=text, wraps_at=wraps_at))
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
            Title, settings of the stages and limits for the test plan; by default those of the stages,
            without limits.
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
        streams = self.streams(text=recorded_as_text(path), angle_unit=angle_unit)
        processing = processing or Processing("Simulated static record", "simulated stand")
        latitude = self.settings.latitude
        stand = {} if latitude is None else {"latitude_deg": float(np.rad2deg(latitude))}
        return write_recording(path, streams, plan_text("static", streams, processing, stand), self.truth)


def simulate_static(settings: StaticSettings, seed: int = 0) -> SimulatedStatic:
    """Simulate a record of a gyro at rest, or on an evenly turning platform.

    Parameters
    ----------
    settings : StaticSettings
        The errors of its axes, the platform and what is wrong with the record.
    seed : int, optional
        Seed of all that is random; the same seed gives the same record, and an axis is the same whatever the
        others are.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    """
    instants = even_instants(settings.count, settings.rate)
    exact = np.column_stack(
        [_motion(settings, axis) + _errors(settings, axis, seed) for axis in settings.axes]
    )
    values = quantised(exact, settings.quantum, settings.output)
    recorded, faults = transmitted(instants, values, settings.rate, settings.start, settings.timing, seed)
    table = None
    if settings.turning is not None:
        t, turning = in_seconds(instants), settings.turning
        shown = turning.rate * (t if turning.quantity == "table_angle" else np.ones_like(t))
        stamps = settings.start + instants
        table = Recorded(stamps, stamps, shown[:, np.newaxis])
    return SimulatedStatic(settings, recorded, table, _truth(settings, seed, len(recorded.log_time), faults))


def _motion(settings: StaticSettings, axis: Axis) -> Float:
    """What one axis really turns: the rate at each sampling instant, or its integral over the step before."""
    t = np.arange(-1, settings.count) / settings.rate
    across, along = settings.earth
    w = 0.0 if settings.turning is None else settings.turning.rate
    if settings.output == "angular_rate":
        t = t[1:]
        turns = {"p": across * np.cos(w * t), "q": -across * np.sin(w * t), "r": np.full_like(t, w + along)}
        return turns[axis] + sum((each.rate(t) for each in settings.disturbances), np.zeros_like(t))
    # of (sin(w b) - sin(w a)) / w over a step: no difference of near numbers, and the limit w = 0 with it
    step, middle = 1 / settings.rate, (t[1:] + t[:-1]) / 2
    chord = step * np.sinc(w * step / (2 * np.pi))
    turned = {
        "p": across * chord * np.cos(w * middle),
        "q": -across * chord * np.sin(w * middle),
        "r": np.full_like(middle, (w + along) * step),
    }
    moved = sum((np.diff(each.turned(t)) for each in settings.disturbances), np.zeros_like(middle))
    return turned[axis] + moved


def _errors(settings: StaticSettings, axis: Axis, seed: int) -> Float:
    """What the output of one axis has beside its motion, shape (n,)."""
    errors = settings.errors[axis]
    n, step, number = settings.count, 1 / settings.rate, AXES.index(axis) + 1
    t = np.asarray(step * np.arange(n), dtype=np.float64)
    rates = settings.output == "angular_rate"
    total = errors.bias + errors.ramp * (t if rates else t - step / 2)
    if not rates:
        total = step * total
    for place, term in enumerate(errors.terms, start=1):
        of_term = generator(seed, "random error", number, place)
        drawn = term.generate(n, step, of_term) if rates else increments(term, n, step, of_term)
        total = total + drawn
    if errors.quantisation:
        noise = generator(seed, "random angle error", number).standard_normal(n + 1)
        total = total + errors.quantisation * np.diff(noise) / (step if rates else 1.0)
    return np.asarray(total, dtype=np.float64)


def _truth(settings: StaticSettings, seed: int, count: int, faults: dict[str, Any]) -> dict[str, Any]:
    said = {name: value for name, value in asdict(settings).items() if name != "errors"}
    return {
        "generator": "gyrostand simulate static",
        "seed": seed,
        "settings": said,
        "units": "angles in rad, rates in rad/s, N of terms in rad^2/s, K in rad/s/sqrt(s), mu and lambda in "
        "rad/s, ramp in rad/s^2, times in s, start in ns of Unix time; coefficients in rad/sqrt(s), "
        "rad/s/sqrt(s), rad and rad/s^2",
        "axes": {
            axis: {
                "terms": [{"model": term.name, **term.parameters} for term in settings.errors[axis].terms],
                "quantisation": settings.errors[axis].quantisation,
                "bias": settings.errors[axis].bias,
                "ramp": settings.errors[axis].ramp,
                "coefficients": settings.errors[axis].coefficients,
            }
            for axis in settings.axes
        },
        "samples": {"gyro": count} | ({} if settings.turning is None else {"turntable": settings.count}),
        "faults": faults,
    }
