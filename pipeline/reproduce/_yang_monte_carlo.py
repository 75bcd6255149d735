"""The closed forms beside generated records, at fixed seeds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import Noise, RandomError
from pipeline.models.random_error_growth import variance, variance_by_axis
from pipeline.reproduce._yang_noises import NOISES, RATE, SOURCE, title
from pipeline.reproduce.rows import Row, at_most

Float = NDArray[np.float64]

_SEED = 638
_RECORDS, _SAMPLES = 1500, 1001
"""In steps of 1 s, by the trapezium: (omega step)^2/12 = 2e-4 of the variance is neglected; that from so many
records deviates by 4e-2 of it."""


def monte_carlo() -> Iterator[Row]:
    """Deviation of the mean square of the integral from the variance, over its standard error, |z|."""
    for k, noise in enumerate(NOISES):
        item = f"{title(noise)}, {_RECORDS} records of {_SAMPLES - 1} s"
        for quantity, z in _deviations(noise, np.random.default_rng([_SEED, k])):
            yield at_most(3.0).beside(SOURCE, item, f"{quantity}: |z|, at most", z)


def _deviations(noise: Noise, generator: np.random.Generator) -> Iterator[tuple[str, float]]:
    t = np.arange(_SAMPLES, dtype=np.float64)
    weights = np.ones(_SAMPLES)
    weights[[0, -1]] = 0.5
    x = weights * np.stack([noise.generate(_SAMPLES, 1.0, generator) for _ in range(_RECORDS)])
    model, end = RandomError((noise,)), t[-1:]
    yield "variance at rest", _z(x.sum(axis=1) ** 2, variance(model, end))
    along, across = (x @ np.cos(RATE * t)) ** 2, (x @ np.sin(RATE * t)) ** 2
    yield "variance at 3 deg/s", _z(along + across, variance(model, end, RATE))
    for name, square, expected in zip(
        ("along", "across"), (along, across), variance_by_axis(model, end, RATE), strict=True
    ):
        yield f"variance at 3 deg/s {name}", _z(square, expected)


def _z(square: Float, expected: Float) -> float:
    error = float(square.std(ddof=1)) / np.sqrt(len(square))
    return abs(float(square.mean() - expected[0])) / float(error)
