"""Recordings of a non-contact gyro's stand, with known truth, in every format.

The gimbal angles are those of the exact model, `pipeline.models.drift_trajectory`; what is wrong with the
record is stated in `pipeline.simulate.imperfections`. The files are those of `pipeline.simulate.recording`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_trajectory import Transient, trajectory
from pipeline.models.earth import DEGREES_PER_HOUR, RATE, Base
from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, TILT, Gyro
from pipeline.simulate.drift_settings import DriftRun, DriftSettings
from pipeline.simulate.imperfections import encoder_noise, in_seconds, sampling_instants
from pipeline.simulate.plan import Processing, Value, plan_text
from pipeline.simulate.recording import recorded_as_text, transmitted, write_recording
from pipeline.simulate.streams import Recorded, RecordedStream, gimbal

Float = NDArray[np.float64]
Time = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class SimulatedDrift:
    """A simulated record and its truth.

    Attributes
    ----------
    settings : DriftSettings
        What was simulated.
    gimbal : Recorded
        What the encoders gave, in the unit of their values.
    alpha : ndarray, shape (n, 2)
        The exact angles at every true instant, before anything went wrong [rad].
    edges : tuple of (int, int)
        Unix time of the first and the last sample of each run [ns].
    truth : dict
        Settings, seed, the parameters under their names, and where each fault lies.
    """

    settings: DriftSettings
    gimbal: Recorded
    alpha: Float
    edges: tuple[tuple[int, int], ...]
    truth: dict[str, Any]

    def stream(self, *, text: bool) -> RecordedStream:
        """The angles as columns of a text file, or as ROS messages."""
        encoder = self.settings.encoder
        counts = encoder.counts if encoder.as_counts else None
        wraps_at = encoder.turn if encoder.wrapped else None
        return gimbal(self.gimbal, encoder.unit, text=text, counts=counts, wraps_at=wraps_at)

    def write(self, path: Path, *, processing: Processing | None = None) -> tuple[Path, Path, Path]:
        """Write the recording, its test plan and its truth.

        Parameters
        ----------
        path : Path
            The recording, in the format that the name's end asks for, see
            `pipeline.simulate.recording.SUFFIXES`: a file, or for db3 a folder that is not there yet.
        processing : Processing, optional
            Title, settings of the stages and limits for the test plan; by default those of the stages,
            without limits.

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
        streams = [self.stream(text=recorded_as_text(path))]
        processing = processing or Processing("Simulated drift", "simulated gimbal stand")
        stand, runs = _plan_of_runs(self.settings, self.edges)
        return write_recording(
            path, streams, plan_text("drift", streams, processing, stand, runs), self.truth
        )


def simulate_drift(settings: DriftSettings, seed: int = 0) -> SimulatedDrift:
    """Simulate a record of a non-contact gyro's stand.

    Parameters
    ----------
    settings : DriftSettings
        The gyro, its runs and what is wrong with the record.
    seed : int, optional
        Seed of all that is random; the same seed gives the same record.

    Raises
    ------
    SimulationError
        If a setting is out of its range.
    pipeline.errors.GyrostandError
        If the inner gimbal would pass 90 degrees.
    """
    instants, angles = [], []
    begin = 0
    for number, run in enumerate(settings.runs):
        offsets, alpha = _run(settings, run, begin, seed + number)
        instants.append(begin + offsets)
        angles.append(alpha)
        begin += round(1e9 * (run.duration + settings.pause))
    whole, alpha = np.concatenate(instants), np.concatenate(angles)
    noise, outliers = encoder_noise(in_seconds(whole), settings.errors, seed)
    values = settings.encoder.read(alpha + noise)
    recorded, faults = transmitted(
        whole, values, 1 / settings.interval, settings.start, settings.timing, seed
    )
    faults["outliers"] = [int(stamp) for stamp in settings.start + whole[outliers]]
    edges = tuple((settings.start + int(i[0]), settings.start + int(i[-1])) for i in instants)
    truth = {
        "generator": "gyrostand simulate drift",
        "seed": seed,
        "settings": asdict(settings),
        "units": "angles in rad, drift m in units of the Earth rate (drift in deg/h), times in s, "
        "start and end in ns of Unix time",
        **_parameters(settings),
        "runs": [
            _truth_of_run(settings, run, *edge, len(i))
            for run, edge, i in zip(settings.runs, edges, instants, strict=True)
        ],
        "samples": {"gimbal": len(recorded.log_time)},
        "faults": faults,
    }
    return SimulatedDrift(settings, recorded, alpha, edges, truth)


def _run(settings: DriftSettings, run: DriftRun, begin: int, seed: int) -> tuple[Time, Float]:
    """Instants of a run's samples [ns from its beginning] and the exact angles at them [rad]."""
    count = int(run.duration / settings.interval * (1 + 1e-12)) + 1
    instants = sampling_instants(count, 1 / settings.interval, settings.timing, seed)
    return instants, _with_jumps(settings, run, in_seconds(instants), begin * 1e-9)


def _with_jumps(settings: DriftSettings, run: DriftRun, t: Float, begin: float) -> Float:
    """Angles at instants [s from the run's beginning], the servo's jumps within it included."""
    base = Base.at(settings.latitude, run.mounting(settings.latitude))
    base = base.misaligned(run.delta_chi(settings.latitude))
    gyro = Gyro(np.array(settings.m), np.array(settings.theta))
    decaying = None
    if settings.transient is not None:
        decaying = Transient(np.array(settings.transient), 1 / (RATE * settings.transient_time))
    tau = RATE * t
    alpha = trajectory(gyro, base, np.array(run.start), tau, decaying)
    for at, *jump in sorted(settings.servo_jumps):
        j = int(np.searchsorted(t, at - begin))
        if begin <= at and j < len(t) - 1:
            alpha[j:] = trajectory(gyro, base, alpha[j] + np.array(jump), tau[j:], decaying)
    return alpha


def _plan_of_runs(
    settings: DriftSettings, edges: Sequence[tuple[int, int]]
) -> tuple[dict[str, Value], list[dict[str, Value]]]:
    """What the test plan says of the stand, and of each run where there are several."""
    stand: dict[str, Value] = {"latitude_deg": float(np.rad2deg(settings.latitude))}
    if len(settings.runs) == 1:
        return stand | _mounting(settings.runs[0]), []
    runs = []
    for number, run in enumerate(settings.runs):
        said: dict[str, Value] = {"name": run.name or f"run {number}"} | _mounting(run)
        # a run ends, and the next begins, in the middle of the pause between them
        if number > 0:
            said["start"] = (edges[number - 1][1] + edges[number][0] - 2 * edges[0][0]) / 2e9
        if number < len(edges) - 1:
            said["stop"] = (edges[number][1] + edges[number + 1][0] - 2 * edges[0][0]) / 2e9
        runs.append(said)
    return stand, runs


def _mounting(run: DriftRun) -> dict[str, Value]:
    if run.scheme is not None:
        return {"scheme": run.scheme}
    return {"chi_deg": [float(np.rad2deg(angle)) for angle in run.chi or ()]}


def _parameters(settings: DriftSettings) -> dict[str, Any]:
    """The parameters that all runs share, under their names."""
    m = dict(zip(DRIFT, settings.m, strict=True))
    return {
        "parameters": m | dict(zip(TILT, settings.theta, strict=True)),
        "drift": {name: value * DEGREES_PER_HOUR for name, value in m.items()},
    }


def _truth_of_run(
    settings: DriftSettings, run: DriftRun, first: int, last: int, count: int
) -> dict[str, Any]:
    """Edges of a run, and the misalignment of its base: ``epsilon = u x Delta chi``."""
    base = Base.at(settings.latitude, run.mounting(settings.latitude))
    delta_chi = run.delta_chi(settings.latitude)
    epsilon = np.cross(base.u, delta_chi).tolist()
    return {
        "start": first,
        "end": last,
        "samples": count,
        "delta_chi": delta_chi.tolist(),
        "parameters": dict(zip(MISALIGNMENT, epsilon, strict=True)),
    }
