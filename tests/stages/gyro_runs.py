"""Runs of a non-contact gyro with known truth, as the tables that `resample` gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.drift_trajectory import Transient, trajectory
from pipeline.models.earth import RATE, Base, Scheme, mounting_angles
from pipeline.models.gyro_drift import DRIFT, TILT, Gyro

Float = NDArray[np.float64]

LATITUDE = np.deg2rad(55.75)
ARCMIN, ARCSEC = np.deg2rad(1 / 60), np.deg2rad(1 / 3600)
EARTH_RATE = 15.041067  # deg/h
GYRO = Gyro(np.array([0.01, -0.004, 0.006, 0.003, -0.002, 0.005]), np.array([8 * ARCMIN, -5 * ARCMIN]))
TRUTH = dict(zip((*DRIFT, *TILT), (*GYRO.m, *GYRO.theta), strict=True))


@dataclass(frozen=True)
class Run:
    """One run: mounting, initial angles [rad], hours, misalignment [rad]."""

    scheme: Scheme
    start: tuple[float, float]
    hours: float = 24.0
    delta_chi: tuple[float, float, float] = (ARCMIN, -0.5 * ARCMIN, 0.7 * ARCMIN)

    @property
    def base(self) -> Base:
        return Base.mounted(self.scheme, LATITUDE)

    @property
    def epsilon(self) -> Float:
        return np.cross(self.base.u, self.delta_chi)


def tables(
    runs: Sequence[Run],
    *,
    noise: float = 1.0,
    correlation: float = 0.0,
    gyro: Gyro = GYRO,
    interval: float = 60.0,
    seed: int = 0,
    transient: Transient | None = None,
    spikes: Sequence[int] = (),
) -> dict[str, pa.Table]:
    """``trajectory`` and ``runs``; noise [arcsec] of autoregression ``correlation``, spikes of 30."""
    rng = np.random.default_rng(seed)
    parts, mountings, clock = [], [], 0
    for number, run in enumerate(runs):
        count = round(run.hours * 3600 / interval) + 1
        since = np.round(np.arange(count) * interval * 1e9).astype(np.int64)
        standing = run.base.misaligned(np.array(run.delta_chi))
        alpha = trajectory(gyro, standing, np.array(run.start), since * (1e-9 * RATE), transient)
        white = rng.standard_normal(alpha.shape) * np.sqrt(1 - correlation**2)
        white[0] /= np.sqrt(1 - correlation**2)
        for j in range(1, count if correlation else 0):
            white[j] += correlation * white[j - 1]
        alpha = alpha + noise * ARCSEC * white
        alpha[list(spikes)] += 30 * ARCSEC
        parts.append(
            contracts.table(
                "trajectory",
                {
                    "run": np.full(count, number, dtype=np.int32),
                    "arc": np.full(count, number, dtype=np.int32),
                    "time": clock + since,
                    "alpha1": alpha[:, 0],
                    "alpha2": alpha[:, 1],
                    "measured": np.ones(count, dtype=np.bool_),
                },
            )
        )
        clock += int(since[-1]) + 3_600_000_000_000
        chi = mounting_angles(run.scheme, LATITUDE)
        mountings.append([number, f"run {number}", run.scheme, LATITUDE, *chi])
    names = [c.name for c in contracts.contract("runs").columns]
    columns = dict(zip(names, map(list, zip(*mountings, strict=True)), strict=True))
    return {"trajectory": pa.concat_tables(parts), "runs": contracts.table("runs", columns)}
