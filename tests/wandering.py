"""A motion with exact truth that never repeats itself, and stream tables made of arrays."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.numerics.rotation import matrix_from_quaternion, quaternion_from_rotation_vector
from pipeline.stages._streams import CHANNELS

Float = NDArray[np.float64]
_WAVES = np.random.default_rng(5)
_FREQUENCY = _WAVES.uniform(0.05, 2.0, size=(3, 8))  # Hz
_PHASE = _WAVES.uniform(0, 2 * np.pi, size=(3, 8))
_AMPLITUDE = 0.2 / _FREQUENCY / (2 * np.pi)  # rad; each sinusoid has a rate of 0.2 rad/s


def angles(t: Float, axes: tuple[int, ...] = (0, 1, 2)) -> Float:
    """Psi, theta, gamma [rad], shape (n, 3): eight sinusoids each, 0 for the axes that are not asked for."""
    wave = _AMPLITUDE * np.sin(2 * np.pi * _FREQUENCY * t[:, None, None] + _PHASE)
    return wave.sum(axis=2) * np.isin([0, 1, 2], axes)


def rates(t: Float, axes: tuple[int, ...] = (0, 1, 2)) -> Float:
    """Body rates p, q, r [rad/s] of that motion, by the equations of the package's docstring."""
    wave = 2 * np.pi * _FREQUENCY * _AMPLITUDE * np.cos(2 * np.pi * _FREQUENCY * t[:, None, None] + _PHASE)
    psi, theta, gamma = (wave.sum(axis=2) * np.isin([0, 1, 2], axes)).T
    _, at_theta, at_gamma = angles(t, axes).T
    return np.stack(
        [
            gamma + psi * np.sin(at_theta),
            psi * np.cos(at_gamma) * np.cos(at_theta) + theta * np.sin(at_gamma),
            theta * np.cos(at_gamma) - psi * np.cos(at_theta) * np.sin(at_gamma),
        ],
        axis=1,
    )


def matrix(rotation_vector: tuple[float, float, float]) -> Float:
    """Exp of a rotation vector, shape (3, 3)."""
    return matrix_from_quaternion(quaternion_from_rotation_vector(np.array(rotation_vector)))


def nanoseconds(t: Float) -> NDArray[np.int64]:
    return np.rint(t * 1e9).astype(np.int64)


def table(stream: str, time: NDArray[np.int64], values: Float, **clocks: NDArray[np.int64]) -> pa.Table:
    """A stream table; clocks that are not given are null."""
    columns: dict[str, object] = {
        name: clocks.get(name, pa.nulls(len(time), pa.int64()))
        for name in ("run", "header_stamp", "log_time", "publish_time")
        if name in contracts.contract(stream).units
    }
    return contracts.table(
        stream, {"time": time, **columns, **dict(zip(CHANNELS[stream], values.T, strict=True))}
    )
