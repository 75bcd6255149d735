"""What a calibration is made of, from the tables: the steps of a rate table, turns, positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models import earth
from pipeline.models.multi_position import Turn, observe_positions, observe_turns, position
from pipeline.models.rate_table_observations import Observations, joined, observe_runs, with_bias
from pipeline.models.rate_table_observations import Run as TriadRun
from pipeline.models.rate_table_steps import Steps, TableAxis
from pipeline.stages._calibration_settings import Method, Settings, Stretch
from pipeline.stages._mountings import direction
from pipeline.stages._rate_table_record import AXES, TableRun
from pipeline.stages._runs import CaseAxis
from pipeline.stages.base import StageError, Stand

Float = NDArray[np.float64]
Time = NDArray[np.int64]

_ANY_WAY = 1 / np.sqrt(3)
"""Standard deviation of a component of a unit vector that may point anywhere."""


@dataclass(frozen=True, slots=True)
class Stretches:
    """Where the observations of a calibration are from, m of them.

    Attributes
    ----------
    method : tuple of str
        Of each.
    run : tuple of int or None
    start, stop : ndarray of int64, shape (m,)
        By the gyro's clock [ns].
    temperature : ndarray, shape (m,), or None
        [K].
    """

    method: tuple[Method, ...]
    run: tuple[int | None, ...]
    start: Time
    stop: Time
    temperature: Float | None

    def __len__(self) -> int:
        """How many."""
        return len(self.method)

    @property
    def apart(self) -> Float:
        """Time between the middles of each two [s], shape (m, m); infinite between runs."""
        middle = (self.start - self.start[0]) / 2e9 + (self.stop - self.start[0]) / 2e9
        other = np.array([[a != b for b in self.run] for a in self.run])
        return np.where(other, np.inf, np.abs(middle[:, np.newaxis] - middle))

    @classmethod
    def joined(cls, parts: Sequence[Stretches]) -> Stretches:
        """Of several parts; without temperature where one has none."""
        temperatures = [part.temperature for part in parts if part.temperature is not None]
        return cls(
            tuple(method for part in parts for method in part.method),
            tuple(run for part in parts for run in part.run),
            np.concatenate([part.start for part in parts]),
            np.concatenate([part.stop for part in parts]),
            np.concatenate(temperatures) if len(temperatures) == len(parts) else None,
        )


@dataclass(frozen=True, slots=True)
class RateRun:
    """The steps of one run on the table.

    Attributes
    ----------
    axis : ndarray, shape (3,)
        Unit vector of the table's axis in the axes of the case.
    to_case : ndarray, shape (3, 3)
        From the axes of the table's rotor to those of the case.
    channels : tuple of str
        Of the gyro, in the order of the columns of ``steps``.
    steps : Steps
        In seconds from the first.
    stretches : Stretches
    """

    axis: Float
    to_case: Float
    channels: tuple[str, ...]
    steps: Steps
    stretches: Stretches

    @property
    def along(self) -> str:
        """The channel along the table's axis, either way."""
        return AXES[int(np.argmax(np.abs(self.axis)))]


def rate_runs(table: pa.Table, mountings: pa.Table | None) -> list[RateRun]:
    """The runs of ``rate_steps``."""
    found: dict[int | None, list[dict[str, Any]]] = {}
    for row in table.to_pylist():
        found.setdefault(row["run"], []).append(row)
    mounted = {} if mountings is None else {row["run"]: row for row in mountings.to_pylist()}
    return [_rate_run(number, rows, mounted.get(number)) for number, rows in found.items()]


def _rate_run(number: int | None, rows: Sequence[dict[str, Any]], mounted: dict[str, Any] | None) -> RateRun:
    channels = tuple(name for name in AXES if any(row["channel"] == name for row in rows))
    of = {name: [row for row in rows if row["channel"] == name] for name in channels}
    first = of[channels[0]]
    start, stop = (np.array([row[key] for row in first], dtype=np.int64) for key in ("start", "stop"))
    turn = np.array([[row[key] for key in ("cosine", "sine")] for row in first], dtype=np.float64)
    temperature = np.array([row["temperature"] for row in first], dtype=np.float64)
    known = None if np.isnan(temperature).any() else temperature

    def columns(key: str) -> Float:
        return np.array([[row[key] for row in of[name]] for name in channels]).T

    steps = Steps(
        (start - start[0]) * 1e-9,
        (stop - start[0]) * 1e-9,
        np.array([row["rate"] for row in first]),
        turn,
        columns("output"),
        columns("standard_error"),
        known,
    )
    axis = (
        np.array([float(name == channels[0]) for name in AXES])
        if mounted is None
        else np.array([mounted[f"axis_{i}"] for i in (1, 2, 3)])
    )
    across = None
    if mounted is not None and mounted["across_1"] is not None:
        across = np.array([mounted[f"across_{i}"] for i in (1, 2, 3)])
    method: tuple[Method, ...] = tuple("rates" for _ in first)
    stretches = Stretches(method, (number,) * len(first), start, stop, known)
    return RateRun(axis, _to_case(axis, across), channels, steps, stretches)


def _to_case(axis: Float, across: Float | None) -> Float:
    """From rotor to case: its columns are the rotor's axes. Any across does where none is known."""
    first = np.roll(np.abs(axis), 1) if across is None else across
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def table_axis(stand: Stand) -> TableAxis | None:
    """The table's axis on the Earth; None where latitude or tilt is not said."""
    if stand.latitude_deg is None or stand.table_tilt_deg is None:
        return None
    heading = 0.0 if stand.table_heading_deg is None else stand.table_heading_deg
    latitude, heading, tilt = np.radians([stand.latitude_deg, heading, stand.table_tilt_deg]).tolist()
    return TableAxis(latitude, heading, tilt)


def single_axis_steps(
    runs: Sequence[RateRun], channel: str, along: str, axis: TableAxis | None
) -> tuple[Steps, Stretches] | None:
    """The steps about one axis of the case, either way, and the outputs of one channel in them.

    Returns
    -------
    Steps
        Of one channel; ``rate`` is that about the axis of the case, the Earth's included.
    Stretches
        None together where there is no such run.
    """
    chosen = [run for run in runs if run.along == along and channel in run.channels]
    if not chosen:
        return None
    upward = 0.0 if axis is None else float(axis.earth_rate[2])
    stretches = Stretches.joined([run.stretches for run in chosen])
    k = [run.channels.index(channel) for run in chosen]
    steps = Steps(
        np.concatenate([run.steps.start for run in chosen]),
        np.concatenate([run.steps.stop for run in chosen]),
        np.concatenate([run.axis[AXES.index(along)] * (run.steps.rate + upward) for run in chosen]),
        np.concatenate([run.steps.turn for run in chosen]),
        np.concatenate([run.steps.gyro[:, c : c + 1] for run, c in zip(chosen, k, strict=True)]),
        np.concatenate([run.steps.standard_error[:, c : c + 1] for run, c in zip(chosen, k, strict=True)]),
        stretches.temperature,
    )
    return steps, stretches


def observe_rates(
    runs: Sequence[RateRun], settings: Settings, stand: Stand
) -> tuple[Observations, Stretches]:
    """The steps of runs as observations of a triad."""
    made = [
        TriadRun(
            _run_name(run.stretches.run[0]),
            run.steps,
            run.to_case,
            float(np.radians(settings.orientation_error_deg)),
            settings.bias_error_deg_h * earth.RATE / earth.DEGREES_PER_HOUR,
            table_axis(stand),
        )
        for run in runs
    ]
    return observe_runs(made), Stretches.joined([run.stretches for run in runs])


def observe_by_turns(runs: Sequence[TableRun], settings: Settings) -> tuple[Observations, Stretches]:
    """Turns by known angles and rest between them, run by run.

    The Earth's rate, of unknown direction in the case, is left in them. By themselves they tell the bias with
    it; beside another method each run of them has a bias of its own, about that of all, of that size.
    """
    angle_error, axis_error = np.radians(
        [settings.turn_angle_error_deg, settings.turn_axis_error_deg]
    ).tolist()
    parts, places = [], []
    for run in runs:
        turned = [turn for turn in settings.turns if _of_run(turn, run)]
        rested = [rest for rest in settings.rests if _of_run(rest, run)]
        if not turned and not rested:
            continue
        stretches = [
            Turn(
                turn.start,
                turn.stop,
                direction(turn.axis),
                float(np.radians(turn.angle_deg)),
                angle_error,
                axis_error,
            )
            for turn in turned
        ] + [Turn(rest.start, rest.stop, direction("p"), 0.0) for rest in rested]
        observed = observe_turns(run.seconds(run.gyro.time), run.gyro.values, stretches)
        if run.number is not None:  # turns of two runs share no error
            named = tuple(f"{name}_{_run_name(run.number)}" for name in observed.unknowns)
            observed = replace(observed, unknowns=named)
        left = earth.RATE * _ANY_WAY if len(settings.methods) > 1 else 0.0
        parts.append(with_bias(observed, left, f"turns_{_run_name(run.number)}"))
        places.append(_places("turns", run, [*turned, *rested]))
    return joined(parts), Stretches.joined(places)


def observe_in_positions(
    runs: Sequence[TableRun], settings: Settings, stand: Stand
) -> tuple[Observations, Stretches]:
    """Rest in known positions."""
    assert stand.latitude_deg is not None, "checked when the plan was read"
    outputs, matrices, places = [], [], []
    for run in runs:
        listed = [one for one in settings.positions if _of_run(one, run)]
        for one in listed:
            outputs.append(_samples(run, one))
            matrices.append(position(_signed(one.up), _signed(one.north)))
        if listed:
            places.append(_places("positions", run, listed))
    observed = observe_positions(
        outputs,
        matrices,
        latitude=float(np.radians(stand.latitude_deg)),
        orientation_error=float(np.radians(settings.orientation_error_deg)),
    )
    return observed, Stretches.joined(places)


def _run_name(number: int | None) -> str:
    """A run in the names of unknowns, counted as in the tables."""
    return "run" if number is None else f"run_{number}"


def _signed(axis: CaseAxis) -> int:
    return (-1 if axis.startswith("-") else 1) * (AXES.index(axis[-1]) + 1)


def _of_run(one: Stretch, run: TableRun) -> bool:
    return one.run is None or one.run == run.name


def _samples(run: TableRun, one: Stretch) -> Float:
    time = run.seconds(run.gyro.time)
    inside = (time >= one.start) & (time <= one.stop)
    if np.count_nonzero(inside) < 2:
        raise StageError(
            f"{run.where}position, {one.start:g} s to {one.stop:g} s",
            expected="samples of the gyro",
            found=f"{np.count_nonzero(inside)} in a record from 0 to {time[-1]:.6g} s",
            remedy="correct start and stop in the test plan",
            exit_code=ExitCode.USAGE,
        )
    return run.gyro.values[inside]


def _places(method: Method, run: TableRun, listed: Sequence[Stretch]) -> Stretches:
    ends = np.array([(one.start, one.stop) for one in listed])
    temperature = run.temperature_at(ends.mean(axis=1))
    start, stop = run.stamps(ends[:, 0]), run.stamps(ends[:, 1])
    return Stretches((method,) * len(listed), (run.number,) * len(listed), start, stop, temperature)
