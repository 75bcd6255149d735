"""What rotation is worth: worse bands, their peaks, the recommended rate, Schuler, the reversing carousel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.models.random_error import Noise, RandomError, White
from pipeline.models.random_error_growth import (
    growth,
    peak,
    recommended_rate,
    reversing_growth,
    schuler_growth,
    worse_bands,
)
from pipeline.reproduce._yang_noises import NOISES, RATE, RESONANT, SOURCE, title
from pipeline.reproduce.rows import Row, at_most, near

_TOLERANCE = 1e-9
"""Ten digits are given."""

_BANDS: tuple[tuple[Noise, float, float], ...] = (
    (RESONANT[0], 8.602325267e-2, 4.999019417e-2),
    (RESONANT[1], 6.928203230e-2, 4.898979486e-2),
    (NOISES[1], 1.414213562e-2, 9.101797211e-3),
)
"""Noise, upper edge of the worse band, rate of the peak [rad/s]: the roots of 3 lambda^2 - mu^2 and
2 (lambda^2 - mu^2), of -(mu^2 + lambda^2) + 2 lambda sqrt(mu^2 + lambda^2) and lambda^2 - mu^2."""

_SCHULER = (
    (9.848386654e-3, 3.524653547e-4),
    (5.038188338e-3, 3.900331731e-4),
    (9.999407540e-3, 5.323086717e-5),
)
"""Growth beyond Schuler's period at rest, S(omega_s)/2, and at 3 deg/s, (S(omega - omega_s) + S(omega +
omega_s))/4, computed from the table of S in MATH's form."""

_REVERSING = (1.86, 2.16, 5.87)
"""Growth of one turn each way at 3 deg/s over that of constant rotation."""


def rotation() -> Iterator[Row]:
    """Bands, peaks, the recommended rate, Schuler's growth and the price of reversing."""
    yield from _bands()
    yield from _never_worse()
    # sqrt(2 sigma^2 mu / (epsilon N) - mu^2)
    best = recommended_rate(RandomError((NOISES[0], White(1e-4))), 0.1)
    yield near(0.4471017781, _TOLERANCE).beside(
        SOURCE, f"{title(NOISES[0])}, N = 1e-4", "rate that leaves a tenth of N, rad/s", best
    )
    for noise, oracles in zip(NOISES, _SCHULER, strict=True):
        for at, rate, oracle in zip(("at rest", "at 3 deg/s"), (0.0, RATE), oracles, strict=True):
            found = float(schuler_growth(RandomError((noise,)), rate))
            yield near(oracle, _TOLERANCE).beside(
                SOURCE, title(noise), f"growth beyond Schuler's period {at}", found
            )
    for noise, oracle in zip(NOISES, _REVERSING, strict=True):
        model = RandomError((noise,))
        ratio = reversing_growth(model, RATE) / float(growth(model, RATE))
        # three digits are given
        yield near(oracle, 0.005 / oracle).beside(
            SOURCE, title(noise), "reversing after each turn over constant rotation", ratio
        )


def _bands() -> Iterator[Row]:
    for noise, edge, top in _BANDS:
        model = RandomError((noise,))
        [band] = worse_bands(model)
        yield near(edge, _TOLERANCE).beside(
            SOURCE, title(noise), "upper edge of the worse band, rad/s", band.high
        )
        ratio = float(growth(model, band.high) / growth(model, 0.0))
        yield near(1.0, _TOLERANCE).beside(SOURCE, title(noise), "S at the edge over S at rest", ratio)
        yield near(top, _TOLERANCE).beside(SOURCE, title(noise), "rate of the largest S, rad/s", peak(noise))
        # of any rate on a grid
        rates = np.linspace(0.0, 2 * edge, 20_001)
        least = float(growth(model, rates).max() / growth(model, peak(noise)))
        yield at_most(1.0, 1 + 1e-12).beside(
            SOURCE, title(noise), "S of any rate over S at that one, at most", least
        )


def _never_worse() -> Iterator[Row]:
    """Noise 1, and noise 3 with lambda = mu, are never worse for rotation."""
    rates = np.linspace(1e-5, 0.2, 20_001)
    for noise in (NOISES[0], NOISES[2]):
        model = RandomError((noise,))
        worst = float(growth(model, rates).max() / growth(model, 0.0))
        yield at_most(1.0).beside(SOURCE, title(noise), "S of any rate over S at rest, at most", worst)
