"""Gimbal angles of a gyro with known drift, as the tables ``gimbal`` and ``runs``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.drift_trajectory import trajectory
from pipeline.models.earth import RATE, Base, Scheme, mounting_angles
from pipeline.models.gyro_drift import Gyro

Float = NDArray[np.float64]
Record = tuple[NDArray[np.int64], Float]

LATITUDE = np.radians(55.75)
ARCSEC = np.pi / 648_000
STARTS: dict[Scheme, tuple[float, float]] = {
    "polar": (0.6, 0.5),
    "equatorial": (0.0, 0.6),
    "horizontal": (0.0, 0.0),
    "vertical": (0.0, 0.0),
}
"""Initial angles from which the gimbal turns far in every scheme [rad]."""


def record(
    scheme: Scheme,
    hours: float,
    step: float,
    *,
    noise: float = 1.0,
    quantum: float = 0.0,
    seed: int = 0,
    start: tuple[float, float] | None = None,
    drift: float = 0.01,
    jitter: float = 0.0,
) -> Record:
    """Times [ns] and angles [rad]: equal drifts, tilt 10', misalignment 1', noise [arcsec], quantum [rad].

    ``jitter`` is the standard deviation of the stamps [s], at which the angles are true.
    """
    rng = np.random.default_rng(seed)
    count = round(hours * 3600 / step) + 1
    time = np.rint((np.arange(count) * step + jitter * rng.normal(size=count)) * 1e9).astype(np.int64)
    alpha = true_angles(scheme, (time - time[0]) * 1e-9, start=start, drift=drift)
    alpha = alpha + noise * ARCSEC * rng.normal(size=alpha.shape)
    if quantum:
        alpha = np.round(alpha / quantum) * quantum
    return time + 10**18, alpha


def true_angles(
    scheme: Scheme, seconds: Float, *, start: tuple[float, float] | None = None, drift: float = 0.01
) -> Float:
    """The angles of `record` at times from its first sample on, without noise [rad]."""
    base = Base.mounted(scheme, LATITUDE).misaligned(np.full(3, 60 * ARCSEC))
    gyro = Gyro(np.full(6, drift), np.full(2, 600 * ARCSEC))
    tau = seconds * RATE
    if tau[0] == 0:
        return trajectory(gyro, base, np.array(start or STARTS[scheme]), tau)
    return trajectory(gyro, base, np.array(start or STARTS[scheme]), np.append(0.0, tau))[1:]


def tables(records: Sequence[Record], schemes: Sequence[Scheme]) -> dict[str, pa.Table]:
    """``gimbal`` and ``runs``, one run a record."""
    time = np.concatenate([t for t, _ in records])
    alpha = np.concatenate([a for _, a in records])
    chi = np.array([mounting_angles(scheme, LATITUDE) for scheme in schemes])
    none = pa.nulls(len(time), pa.int64())
    numbers = np.arange(len(records), dtype=np.int32)
    gimbal = {
        "run": np.repeat(numbers, [len(t) for t, _ in records]),
        "time": time,
        "log_time": none,
        "publish_time": none,
        "header_stamp": none,
        "alpha1": alpha[:, 0],
        "alpha2": alpha[:, 1],
    }
    runs = {
        "run": numbers,
        "name": [f"run {k}" for k in numbers],
        "scheme": list(schemes),
        "latitude": np.full(len(records), LATITUDE),
        "chi1": chi[:, 0],
        "chi2": chi[:, 1],
        "chi3": chi[:, 2],
    }
    return {"gimbal": contracts.table("gimbal", gimbal), "runs": contracts.table("runs", runs)}
