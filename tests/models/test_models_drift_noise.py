"""Coloured residuals: the test over several arcs, and the rounds of fit and autoregression."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.drift_noise import COLOURED, whitened, whiteness
from pipeline.numerics.whiteness import AutoRegression, ljung_box

Float = NDArray[np.float64]


def noise(seed: int, phi: float = 0.0) -> Float:
    white = np.random.default_rng(seed).standard_normal((600, 2))
    return np.asarray(lfilter([1.0], [1.0, -phi], white, axis=0))[100:]


def test_one_coloured_arc_of_three_is_enough() -> None:
    arcs, measured = [noise(1), noise(2, 0.5), noise(3)], [np.ones(500, dtype=np.bool_)] * 3
    assert whiteness(arcs, measured) == pytest.approx(3 * ljung_box(arcs[1], 20)[1], rel=1e-12)
    assert whiteness(arcs, measured) < COLOURED < whiteness(arcs[::2], measured[::2])


def test_the_mean_of_coloured_noise_by_its_own_autoregression() -> None:
    """The least model there is: a level of 5, AR(1) of 0.6; and white noise, which stays as it was fitted."""

    def fitted(y: Float) -> tuple[Float, AutoRegression | None]:
        def weighted(_: Float, found: AutoRegression) -> Float:
            return np.asarray(found.whiten(y).mean(axis=0) * found.gain)

        return whitened(
            y.mean(axis=0),
            [np.ones(len(y), dtype=np.bool_)],
            residuals=lambda level: [y - level],
            taken=lambda level: [np.zeros((len(y), 2, 1))],
            refitted=weighted,
            most_rounds=10,
        )

    level, found = fitted(5 + noise(4, 0.6))
    assert found is not None
    assert found.coefficients[0] == pytest.approx(0.6, abs=0.1)  # 1000 samples: 0.025 of standard error
    np.testing.assert_allclose(level, 5, atol=4 * 2.5 / 500**0.5)  # white noise behind it, gain 2.5
    plain, none = fitted(5 + noise(5))
    assert none is None
    np.testing.assert_array_equal(plain, (5 + noise(5)).mean(axis=0))
