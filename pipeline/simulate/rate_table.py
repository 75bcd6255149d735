"""Recordings of gyros on a rate table, or turned by hand, with known truth, in every format.

The motion is that of `pipeline.simulate.rate_table_motion`, the gyros' model that of
`pipeline.simulate.rate_table_settings`, their noise exact for any step (`pipeline.models.random_error`).
Each mounting of the case on the table is a run; the runs lie in one recording, or each in its own. What is
wrong with the stamps is stated in `pipeline.simulate.imperfections`; the files are those of
`pipeline.simulate.recording`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import formats
from pipeline.models.multi_position import SIX_POSITIONS
from pipeline.simulate.imperfections import (
    even_instants,
    generator,
    in_seconds,
    nanoseconds,
    quantised,
)
from pipeline.simulate.plan import Processing, plan_text
from pipeline.simulate.rate_table_motion import (
    HandMotion,
    Motion,
    TableMotion,
    mean_over,
    turned_by_error,
)
from pipeline.simulate.rate_table_plan import rate_table_stages, said_of_runs, said_of_stand
from pipeline.simulate.rate_table_settings import RateTableSettings
from pipeline.simulate.recording import recorded_as_text, transmitted, write_recording
from pipeline.simulate.static_settings import AXES
from pipeline.simulate.streams import (
    AngleUnit,
    Recorded,
    RecordedStream,
    as_columns,
    as_messages,
    in_counts,
    thermometer,
    turntable,
)

Float = NDArray[np.float64]
Time = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Run:
    """A run: motion, beginning [s], instants [ns from there], biases [rad/s], errors of orientation [rad]."""

    motion: Motion
    begin: float
    instants: Time
    bias: Float
    errors: Float


@dataclass(frozen=True, slots=True)
class SimulatedRateTable:
    """A simulated record and its truth.

    Attributes
    ----------
    settings : RateTableSettings
        What was simulated.
    gyro : Recorded
        The recorded gyros, in order [rad/s]; counts where they are recorded so.
    exact : ndarray, shape (n, k)
        Rates of the case about the axes of the gyros at every sample before anything went wrong [rad/s]:
        the means, where samples are means.
    table : Recorded or None
        Of the table, in the unit of its record, shape (n, 1); None where there is none.
    temperature : Recorded or None
        [K], shape (n, 1).
    edges : tuple of (int, int)
        Unix time of the first and the last sample of each run [ns].
    truth : dict
        Settings, seed, the calibration that is to be found, and where each fault lies.
    """

    settings: RateTableSettings
    gyro: Recorded
    exact: Float
    table: Recorded | None
    temperature: Recorded | None
    edges: tuple[tuple[int, int], ...]
    truth: dict[str, Any]

    def streams(self, *, text: bool, angle_unit: AngleUnit = "rad") -> list[RecordedStream]:
        """Gyro, table and temperature as they are recorded.

        Parameters
        ----------
        text : bool
            For a text file: columns with their units in the header. Else ROS messages.
        angle_unit : {"rad", "deg"}, optional
            Unit of the gyro's angle in a text file.
        """
        return self._streams(slice(None), text=text, angle_unit=angle_unit)

    def write(
        self,
        path: Path,
        *,
        processing: Processing | None = None,
        angle_unit: AngleUnit = "rad",
        apart: bool = False,
    ) -> tuple[Path, ...]:
        """Write the recording, or one for each run, its test plan and its truth.

        Parameters
        ----------
        path : Path
            The recording, in the format that the name's end asks for, see
            `pipeline.simulate.recording.SUFFIXES`: a file, or for db3 a folder that is not there yet.
        processing : Processing, optional
            Title, settings of the stages and limits for the test plan; by default what the stages must be
            told, without limits. Settings of a stage are added to these.
        angle_unit : {"rad", "deg"}, optional
            Unit of the gyro's angle in a text file.
        apart : bool, optional
            Whether each run has a recording of its own: the second of ``table.bag`` is ``table_2.bag``.

        Returns
        -------
        tuple of Path
            Recording, plan, truth, and the further recordings.

        Raises
        ------
        SimulationError
            If the name ends otherwise.
        pipeline.formats.base.RecordingError
            If it cannot be written.
        """
        text = recorded_as_text(path)
        further = self._further(path) if apart else ()
        streams = self._streams(0 if further else slice(None), text=text, angle_unit=angle_unit)
        processing = processing or Processing("Simulated rate table", "simulated rate table")
        processing = Processing(
            processing.title,
            processing.stand,
            rate_table_stages(self.settings, processing.stages),
            processing.limits,
        )
        plan = plan_text(
            "rate_table",
            streams,
            processing,
            said_of_stand(self.settings),
            said_of_runs(self.settings, self.edges, [other.name for other in further]),
        )
        written = write_recording(path, streams, plan, self.truth)
        for number, other in enumerate(further, start=1):
            formats.write(other, [s.series for s in self._streams(number, text=text, angle_unit=angle_unit)])
        return (*written, *further)

    def _further(self, path: Path) -> tuple[Path, ...]:
        count = len(self.edges)
        return tuple(path.with_name(f"{path.stem}_{k}{path.suffix}") for k in range(2, count + 1))

    def _streams(self, run: int | slice, *, text: bool, angle_unit: AngleUnit) -> list[RecordedStream]:
        """The streams, of one run or of all."""
        settings, gyro = self.settings, self._part(self.gyro, run)
        if text:
            unit_of_angle: AngleUnit = "rad" if settings.counts_per_unit else angle_unit
            rates = as_columns("gyro", "angular_rate", gyro, unit_of_angle, settings.axes)
        else:
            rates = as_messages("gyro", "angular_rate", gyro, settings.axes)
        if settings.counts_per_unit is not None:
            rates = in_counts(rates, "deg/s", settings.counts_per_unit)
        streams = [rates]
        if self.table is not None:
            encoder, quantity = settings.table.encoder, settings.table.quantity
            unit = encoder.unit if quantity == "table_angle" else f"{encoder.unit}/s"
            streams.append(
                turntable(
                    self._part(self.table, run),
                    quantity,
                    unit,
                    text=text,
                    wraps_at=encoder.turn if encoder.wrapped else None,
                    counts=encoder.counts if encoder.as_counts else None,
                )
            )
        if self.temperature is not None:
            streams.append(thermometer(self._part(self.temperature, run), text=text))
        return streams

    def _part(self, recorded: Recorded, run: int | slice) -> Recorded:
        """The samples of one run: those nearer to it than to the others."""
        if isinstance(run, slice):
            return recorded
        middles = [(a[1] + b[0]) // 2 for a, b in zip(self.edges[:-1], self.edges[1:], strict=True)]
        mine = np.searchsorted(np.array(middles), recorded.header_stamp) == run
        return Recorded(recorded.log_time[mine], recorded.header_stamp[mine], recorded.values[mine])


def simulate_rate_table(settings: RateTableSettings, seed: int = 0) -> SimulatedRateTable:
    """Simulate a record of gyros on a rate table, or turned by hand.

    Parameters
    ----------
    settings : RateTableSettings
        The gyros, how they are turned, and what is wrong with the record.
    seed : int, optional
        Seed of all that is random; the same seed gives the same record.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    """
    runs = list(_runs(settings, seed))
    parts = [_outputs(settings, run, number, seed) for number, run in enumerate(runs, start=1)]
    instants = np.concatenate([run.instants + _nanoseconds(run.begin) for run in runs])
    values = quantised(np.concatenate([outputs for _, outputs in parts]), settings.quantum, "angular_rate")
    if settings.counts_per_unit is not None:
        values = np.rint(np.degrees(values) * settings.counts_per_unit)
    recorded, faults = transmitted(instants, values, settings.rate, settings.start, settings.timing, seed)
    begins = [settings.start + _nanoseconds(run.begin) for run in runs]
    edges = tuple((b, b + int(run.instants[-1])) for b, run in zip(begins, runs, strict=True))
    table = _table(settings, runs, seed) if settings.method == "rates" else None
    temperature = _temperature(settings, runs, seed)
    exact = np.concatenate([inputs for inputs, _ in parts])
    truth = _truth(settings, seed, runs, edges) | {
        "samples": {
            name: len(one.log_time)
            for name, one in (("gyro", recorded), ("turntable", table), ("temperature", temperature))
            if one is not None
        },
        "faults": faults,
    }
    return SimulatedRateTable(settings, recorded, exact, table, temperature, edges, truth)


def _runs(settings: RateTableSettings, seed: int) -> Iterator[_Run]:
    """The runs of the method, one after the other."""
    begin = 0.0
    for number, (motion, errors) in enumerate(_motions(settings, seed), start=1):
        count = int(motion.duration * settings.rate * (1 + 1e-12)) + 1
        bias = settings.bias_error * generator(seed, "bias of a run", number).standard_normal(3)
        yield _Run(motion, begin, even_instants(count, settings.rate), bias, errors)
        begin += motion.duration + settings.pause


def _motions(settings: RateTableSettings, seed: int) -> Iterator[tuple[Motion, Float]]:
    """Motion of each run, and the errors of its orientation, or of its turns or positions [rad]."""
    if settings.method == "rates":
        for number, mounting in enumerate(settings.mountings, start=1):
            error = settings.orientation_error * generator(seed, "orientation", number).standard_normal(3)
            to_case = turned_by_error(mounting.to_case, error)
            yield (
                TableMotion.of_profile(settings.profile, to_case, settings.table_axis),
                error[np.newaxis],
            )
        return
    turns = settings.method == "turns"
    count = 3 * len(settings.hand.turns) if turns else len(SIX_POSITIONS)
    errors = settings.orientation_error * generator(seed, "orientation", 1).standard_normal((count, 3))
    if turns:
        angles = settings.angle_error * generator(seed, "angle of a turn").standard_normal(count)
        yield HandMotion.of_turns(settings.hand, settings.latitude, errors, angles), errors
    else:
        yield HandMotion.of_positions(settings.hand, settings.latitude, errors), errors


def _outputs(settings: RateTableSettings, run: _Run, number: int, seed: int) -> tuple[Float, Float]:
    """Rates of the case about the gyros' axes, and the gyros' outputs, each of shape (n, k) [rad/s]."""
    t = in_seconds(run.instants)
    places = [AXES.index(axis) for axis in settings.axes]

    def both(at: Float) -> Float:
        rate = run.motion.rate(at)
        warmth = _warmth(settings, run.begin + at)
        outputs = [
            gyro.output(rate @ gyro.input_axis(axis), warmth, settings.largest)
            for axis, gyro in ((axis, settings.gyros[axis]) for axis in settings.axes)
        ]
        return np.column_stack([rate[:, places], *outputs])

    if settings.means:
        edges = np.concatenate([[t[0] - 1 / settings.rate], t])
        bends = [] if settings.temperature is None else [at for at, _ in settings.temperature.profile]
        corners = np.union1d(run.motion.corners, np.array(bends) - run.begin)
        values = mean_over(lambda at: both(np.maximum(at, 0.0)), edges, corners)
    else:
        values = both(t)
    exact, outputs = np.split(values, 2, axis=1)
    for k, axis in enumerate(settings.axes):
        outputs[:, k] += run.bias[places[k]]
        for place, term in enumerate(settings.gyros[axis].terms, start=1):
            drawn = generator(seed, "random error", places[k] + 1, place, number)
            outputs[:, k] += term.generate(len(t), 1 / settings.rate, drawn)
    return exact, outputs


def _warmth(settings: RateTableSettings, time: Float) -> Float:
    if settings.temperature is None:
        return np.zeros(len(time))
    return settings.temperature.at(time) - settings.reference_temperature


def _table(settings: RateTableSettings, runs: Sequence[_Run], seed: int) -> Recorded:
    """What the table's sensor gives."""
    sensor = settings.table

    def read(number: int, run: _Run, t: Float) -> Float:
        assert isinstance(run.motion, TableMotion)
        angle, rate = run.motion.table(t)
        noise = sensor.noise * generator(seed, "table noise", number).standard_normal(len(t))
        if sensor.quantity == "table_angle":
            return sensor.encoder.read(angle + noise)
        return np.degrees(rate + noise) if sensor.encoder.unit == "deg" else rate + noise

    return _sampled(settings, runs, sensor.rate, read)


def _temperature(settings: RateTableSettings, runs: Sequence[_Run], seed: int) -> Recorded | None:
    """What the thermometer gives."""
    sensor = settings.temperature
    if sensor is None:
        return None

    def read(number: int, run: _Run, t: Float) -> Float:
        noise = sensor.noise * generator(seed, "temperature noise", number).standard_normal(len(t))
        return sensor.at(run.begin + t) + noise

    return _sampled(settings, runs, sensor.rate, read)


def _sampled(
    settings: RateTableSettings,
    runs: Sequence[_Run],
    rate: float,
    read: Callable[[int, _Run, Float], Float],
) -> Recorded:
    """A sensor beside the gyros, at even instants of its own [Hz], while a run lasts.

    ``read`` gives its readings in a run, by the run's number from 1, at times from its start [s].
    """
    stamps, values = [], []
    for number, run in enumerate(runs, start=1):
        instants = even_instants(int(run.motion.duration * rate * (1 + 1e-12)) + 1, rate)
        values.append(read(number, run, in_seconds(instants)))
        stamps.append(settings.start + _nanoseconds(run.begin) + instants)
    time = np.concatenate(stamps)
    return Recorded(time, time, np.concatenate(values)[:, np.newaxis])


def _truth(
    settings: RateTableSettings, seed: int, runs: list[_Run], edges: tuple[tuple[int, int], ...]
) -> dict[str, Any]:
    gyros = {
        axis: {k: v for k, v in asdict(gyro).items() if k != "terms"}
        | {"terms": [{"model": term.name, **term.parameters} for term in gyro.terms]}
        for axis, gyro in settings.gyros.items()
    }
    offset = settings.timing.clock_offset + (0.5 / settings.rate if settings.means else 0.0)
    return {
        "generator": "gyrostand simulate rate_table",
        "seed": seed,
        "settings": {k: v for k, v in asdict(settings).items() if k != "gyros"},
        "units": "angles in rad, rates in rad/s, temperatures in K, times in s, start and end in ns of Unix "
        "time; outputs in rad/s, so that scale factors are pure numbers",
        "gyros": gyros,
        "sensitivity": [
            (settings.gyros[axis].scale_factor * settings.gyros[axis].input_axis(axis)).tolist()
            for axis in settings.axes
        ],
        "largest_rate": settings.largest,
        # of a mean the instant is the middle
        "time_offset": offset,
        "runs": [
            {
                "name": settings.mountings[k].name or settings.mountings[k].axis
                if settings.method == "rates"
                else settings.method,
                "start": edge[0],
                "end": edge[1],
                "orientation_errors": run.errors.tolist(),
                "bias_errors": run.bias.tolist(),
            }
            for k, (run, edge) in enumerate(zip(runs, edges, strict=True))
        ],
    }


def _nanoseconds(seconds: float) -> int:
    return int(nanoseconds(np.array([seconds]))[0])
