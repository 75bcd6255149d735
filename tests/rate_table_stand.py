"""Records of a gyro on a rate table with known truth: as the tables that ingest gives, and as a text file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.rate_table_steps import TableAxis
from pipeline.stages._mountings import direction, mountings_table
from pipeline.stages._runs import CaseAxis, Run

Float = NDArray[np.float64]

DEG = np.pi / 180
START = 1_700_000_000_000_000_000
STEP = 0.02
RAMP = 3.0
HOLD = 20.0
SIGMA = 0.02 * DEG
RATES = DEG * np.array([0.0, 30.0, -30.0, 60.0, -60.0, 100.0, -100.0])
S = np.array([[1.003, 0.002, -0.001], [0.0015, 0.998, 0.0025], [-0.002, 0.0005, 1.001]])
BIAS = DEG * np.array([0.01, -0.02, 0.03])
ASYMMETRY = np.array([2e-4, -1e-4, 3e-4])


@dataclass(frozen=True)
class Stand:
    """What is recorded: each run of ``axes`` begins at rest, ramps to each rate in turn and holds it.

    ``offset`` is the gyro's clock minus the table's [s]; ``warm`` the temperature [K] against the seconds of
    a run, of which ``bias_temperature`` [rad/s/K] about 293.15 K makes bias.
    """

    axes: Sequence[CaseAxis] = ("r",)
    across: Sequence[CaseAxis | None] | None = None
    channels: str = "pqr"
    rates: Float = field(default_factory=lambda: RATES)
    sigma: float = SIGMA
    asymmetry: Float = field(default_factory=lambda: np.zeros(3))
    offset: float = 0.0
    earth: TableAxis | None = None
    by_angle: bool = False
    tachometer: float = 0.0
    gain: float = 1.0
    warm: tuple[float, float] | None = None
    bias_temperature: Float = field(default_factory=lambda: np.zeros(3))
    hold: float = HOLD


@dataclass(frozen=True)
class Recorded:
    """One run: times [s] of gyro and table, rates [rad/s] of p, q, r, the table's rate and angle."""

    time: Float
    gyro: Float
    table_time: Float
    rate: Float
    angle: Float
    temperature: Float | None


def recorded(stand: Stand, number: int, rng: np.random.Generator) -> Recorded:
    """One run of a stand."""
    begin = (stand.hold + RAMP) * np.arange(len(stand.rates)) + RAMP
    inner = np.stack([np.stack([begin, stand.rates], 1), np.stack([begin + stand.hold, stand.rates], 1)], 1)
    corners = np.concatenate([[[0.0, 0.0]], inner.reshape(-1, 2)])
    time = np.arange(0.0, corners[-1, 0], STEP)
    rate = np.interp(time, corners[:, 0], corners[:, 1])
    angle = np.concatenate([[0.0], np.cumsum(STEP * (rate[1:] + rate[:-1]) / 2)])
    axis = direction(stand.axes[number])
    asked = None if stand.across is None else stand.across[number]
    across = np.roll(np.abs(axis), 1) if asked is None else direction(asked)
    rotor = np.zeros((len(time), 3))
    if stand.earth is not None:
        rotor += stand.earth.on_rotor(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    rotor[:, 2] += rate
    case = rotor @ np.stack([across, np.cross(axis, across), axis], axis=1).T
    warm = None if stand.warm is None else stand.warm[0] + stand.warm[1] * time
    gyro = case @ S.T + BIAS + stand.asymmetry * np.abs(case) / 2
    if warm is not None:
        gyro += np.outer(warm - 293.15, stand.bias_temperature)
    gyro = stand.gain * (gyro + stand.sigma * rng.standard_normal(gyro.shape))
    table = rate + stand.tachometer * rng.standard_normal(rate.shape)
    return Recorded(time + stand.offset, gyro, time, table, angle, warm)


def tables(stand: Stand, seed: int = 0, *, named: bool = True) -> dict[str, pa.Table]:
    """The tables of all runs; not ``named``: of one, the whole recording, of a plan without [[runs]]."""
    rng = np.random.default_rng(seed)
    parts: dict[str, list[pa.Table]] = {"gyro": [], "turntable": []}
    begin = 0.0
    for number in range(len(stand.axes)):
        one = recorded(stand, number, rng)
        run = number if named else None
        values = {name: one.gyro[:, "pqr".index(name)] for name in stand.channels}
        parts["gyro"].append(_table("gyro", begin + one.time, run, values))
        turned = {"angle": one.angle} if stand.by_angle else {"rate": one.rate}
        parts["turntable"].append(_table("turntable", begin + one.table_time, run, turned))
        if one.temperature is not None:
            warm = {"temperature": one.temperature[::50]}
            at = begin + one.table_time[::50]
            parts.setdefault("temperature", []).append(_table("temperature", at, run, warm))
        begin += 1000.0
    made = {name: pa.concat_tables(of) for name, of in parts.items()}
    if named:
        given = stand.across or [None] * len(stand.axes)
        runs = [
            Run(name=f"about {axis}", axis=axis, across=across)
            for axis, across in zip(stand.axes, given, strict=True)
        ]
        made["mountings"] = mountings_table(runs)
    return made


def _table(name: str, time: Float, run: int | None, columns: Mapping[str, Float]) -> pa.Table:
    absent = dict.fromkeys(contracts.contract(name).schema.names, pa.nulls(len(time)))
    stamps = START + np.rint(time * 1e9).astype(np.int64)
    numbers = pa.nulls(len(time)) if run is None else np.full(len(time), run)
    return contracts.table(name, {**absent, "run": numbers, "time": stamps, **columns})


PLAN = """\
procedure = "rate_table"

[stand]

[time]
field = "time"
unit = "s"

[streams.gyro]
quantity = "angular_rate"
{gyro}

[streams.turntable]
quantity = "table_rate"
channels.rate = {{ field = "table", unit = "rpm" }}
"""


def write_text(path: Path, stand: Stand, seed: int = 0) -> Path:
    """The first run of a stand as a text file with its plan: gyro in deg/s, the table's rate in rpm."""
    one = recorded(stand, 0, np.random.default_rng(seed))
    gyro = one.gyro[:, ["pqr".index(name) for name in stand.channels]] / DEG
    content = np.column_stack([one.time, one.rate / DEG / 6, gyro])
    header = ",".join(["time", "table", *stand.channels])
    np.savetxt(path, content, delimiter=",", header=header, comments="", fmt="%.12g")
    lines = [f'channels.{name} = {{ field = "{name}", unit = "deg/s" }}' for name in stand.channels]
    path.with_suffix(".toml").write_text(PLAN.format(gyro="\n".join(lines)), encoding="utf-8")
    return path
