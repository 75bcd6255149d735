"""Variance of the integrated error, with and without rotation, and the coefficient by which it grows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.models.random_error import RandomError, RateRandomWalk, Term, White
from pipeline.models.random_error_growth import growth, variance, variance_by_axis
from pipeline.reproduce._yang_noises import NOISES, RATE, RESONANT, SOURCE, title
from pipeline.reproduce.rows import Row, near

_TOLERANCE = 1e-9
"""Ten digits are given."""

_TIMES = (100.0, 1000.0, 10000.0)
_VARIANCES = (
    ((7.357588823e-1, 18.00009080, 198.0000000), (1.320426640e-1, 7.692700525e-1, 7.103825398)),
    ((6.904401243e-1, 10.00002470, 100.0000000), (1.559558571e-1, 8.496167138e-1, 7.856906707)),
    ((8.892062347e-1, 18.99998660, 199.0000000), (9.629483444e-2, 1.926709155e-1, 1.145540093)),
)
"""Of each noise at the times, at rest and at 3 deg/s."""
_GROWTH = (7.038395345e-4, 7.785878192e-4, 1.058742534e-4)
"""S(3 deg/s)."""
_RESONANCE = ((0.8402339281, 9.108759897), (1.603547966, 9.306387640))
"""Variance after 1000 s at rest, and at 0.05 rad/s."""

_N, _K, _TURNS = 1e-4, 1e-4, 10


def variances() -> Iterator[Row]:
    """All cells of the tables, the resonance, the growth law, and the terms that have no table."""
    for noise, cells in zip(NOISES, _VARIANCES, strict=True):
        for at, rate, row in zip(("at rest", "at 3 deg/s"), (0.0, RATE), cells, strict=True):
            for t, oracle in zip(_TIMES, row, strict=True):
                found = _variance(noise, t, rate)
                yield near(oracle, _TOLERANCE).beside(
                    SOURCE, title(noise), f"variance {at}, t = {t:g} s", found
                )
    for noise, (at_rest, turning) in zip(RESONANT, _RESONANCE, strict=True):
        for at, rate, oracle in (("at rest", 0.0, at_rest), ("at 0.05 rad/s", 0.05, turning)):
            found = _variance(noise, 1000.0, rate)
            yield near(oracle, _TOLERANCE).beside(
                SOURCE, title(noise), f"resonance: variance {at}, t = 1000 s", found
            )
    yield from _law()
    yield from _without_table()


def _law() -> Iterator[Row]:
    """S at the rotation rate, and the slope of the variance between 100 and 200 turns, which is the same."""
    turn = 2 * np.pi / RATE
    for noise, oracle in zip(NOISES, _GROWTH, strict=True):
        model, expected = RandomError((noise,)), near(oracle, _TOLERANCE)
        yield expected.beside(SOURCE, title(noise), "S(3 deg/s)", float(growth(model, RATE)))
        slope = (_variance(noise, 200 * turn, RATE) - _variance(noise, 100 * turn, RATE)) / (100 * turn)
        yield expected.beside(SOURCE, title(noise), "slope of the variance after 100 turns", slope)
    for noise in NOISES:
        along, across = variance_by_axis(RandomError((noise,)), np.array([100.0]), RATE)
        whole = _variance(noise, 100.0, RATE)
        yield near(1.0, _TOLERANCE).beside(
            SOURCE,
            title(noise),
            "sum of both axes over the variance, t = 100 s",
            float(along[0] + across[0]) / whole,
        )


def _without_table() -> Iterator[Row]:
    """White noise, which rotation leaves as it is, and the rate random walk after ten whole turns."""
    white, walk, t = White(_N), RateRandomWalk(_K), _TURNS * 2 * np.pi / RATE
    for term, at, rate, oracle in (
        (white, "at rest", 0.0, _N * t),
        (white, "at 3 deg/s", RATE, _N * t),
        (walk, "at rest", 0.0, _K**2 * t**3 / 3),
        (walk, "at 3 deg/s", RATE, 2 * _K**2 * t / RATE**2),
    ):
        name = "white noise, N = 1e-4" if term is white else "rate random walk, K = 1e-4"
        yield near(oracle, _TOLERANCE).beside(
            SOURCE, name, f"variance {at}, t = {t:g} s", _variance(term, t, rate)
        )


def _variance(term: Term, t: float, rate: float) -> float:
    return float(variance(RandomError((term,)), np.array([t]), rate)[0])
