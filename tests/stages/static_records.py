"""Records of a gyro at rest with known truth, as the tables that `ingest` gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.random_error import Noise1, Noise2, RandomError, RateRandomWalk, White
from pipeline.models.random_error_increments import increments

Float = NDArray[np.float64]

DEG = np.pi / 180
N = (0.05 * DEG / 60) ** 2
"""White noise, rad^2/s, of 0.05 deg/sqrt(h)."""

WHITE = RandomError((White(N),))
COLOURED = RandomError((White(N), Noise1(float(np.sqrt(20 * N * 0.02)), 0.01)))
"""Noise 1 that grows 80 times as fast as the white noise, of a correlation time of 100 s."""
PERIODIC = RandomError((White(N), Noise2(float(np.sqrt(N * 0.2)), 0.01, 0.05)))
WALKING = RandomError((White(N), RateRandomWalk(float(2e-2 * np.sqrt(N)))))
BIAS = 1e-4


def record(
    models: Mapping[str, RandomError],
    *,
    n: int = 14_400,
    step: float = 1.0,
    seed: int = 0,
    stream: str = "gyro",
    lost: Sequence[slice] = (),
    added: Mapping[str, Float] | None = None,
    quantum: float = 0.0,
) -> dict[str, pa.Table]:
    """The stream of some channels: each its random error and a bias.

    ``added`` is a rate on top [rad/s], ``lost`` is not recorded, ``quantum`` the resolution.
    """
    rng = np.random.default_rng(seed)
    kept = np.ones(n, dtype=np.bool_)
    for part in lost:
        kept[part] = False
    time = np.round(np.arange(n) * step * 1e9).astype(np.int64)[kept]
    prefix = "increment_" if stream == "gyro_increments" else ""
    columns: dict[str, object] = {"time": time}
    for absent in ("header_stamp", "log_time", "publish_time", *(["run"] if stream == "gyro" else [])):
        columns[absent] = pa.nulls(len(time), pa.int64())
    for name in "pqr":
        if name not in models:
            columns[prefix + name] = pa.nulls(len(time), pa.float64())
            continue
        extra = np.zeros(n) if added is None or name not in added else added[name]
        if stream == "gyro":
            values = BIAS + extra + models[name].generate(n, step, rng)
        else:
            drawn = sum((increments(term, n, step, rng) for term in models[name].terms), np.zeros(n))
            values = step * (BIAS + extra) + drawn
        if quantum:
            values = np.round(values / quantum) * quantum
        columns[prefix + name] = values[kept]
    return {stream: contracts.table(stream, columns)}
