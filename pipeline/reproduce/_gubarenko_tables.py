"""Tables 2 and 3: what the installation errors do to the angles, and to a regression that ignores them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np

from pipeline.models.drift_regression import integrals
from pipeline.models.earth import Base, Scheme
from pipeline.numerics.least_squares import solve
from pipeline.reproduce._gubarenko_runs import (
    ARCSEC,
    LATITUDE,
    SCHEMES,
    SOURCE,
    exact_run,
    instants,
    largest_error,
)
from pipeline.reproduce.rows import Expected, Row, near

_MISALIGNED, _TILTED = "Delta chi = 1'", "theta = 10'"


def _cells(*figures: tuple[float, float]) -> tuple[Expected, ...]:
    return tuple(near(oracle, 0.01, printed) for oracle, printed in figures)


_TABLE_2: Mapping[str, tuple[Expected, ...]] = MappingProxyType(
    {
        _MISALIGNED: _cells((205.85, 200), (125.44, 125), (293.40, 291), (121.72, 120)),
        _TILTED: _cells((1457.2, 1500), (43.34, 45), (1004.8, 1000), (1656.8, 1700)),
    }
)
_TABLE_3: Mapping[str, tuple[Expected, ...]] = MappingProxyType(
    {
        _MISALIGNED: _cells((0.006862, 0.0069), (0.007882, 0.0079), (0.012817, 0.014), (0.003945, 0.004)),
        _TILTED: _cells((0.043869, 0.044), (0.001442, 0.0014), (0.144208, 0.14), (0.044220, 0.046)),
    }
)


def tables() -> Iterator[Row]:
    """All cells of Tables 2 and 3: exact model, all m = 0.01, from the zero of the angles, a day."""
    for error in (_MISALIGNED, _TILTED):
        for scheme, cell in zip(SCHEMES, _TABLE_2[error], strict=True):
            yield cell.beside(
                SOURCE, f"Table 2, {scheme}", f"{error}: max |Delta alpha|, arcsec", _shift(scheme, error)
            )
    for error in (_MISALIGNED, _TILTED):
        for scheme, cell in zip(SCHEMES, _TABLE_3[error], strict=True):
            yield cell.beside(
                SOURCE, f"Table 3, {scheme}", f"{error}: max error of m, deg/h", _bias(scheme, error)
            )


def _shift(scheme: Scheme, error: str) -> float:
    """Largest difference that the error makes to an angle [arcsec]."""
    with_error = exact_run(scheme, (0.0, 0.0), tilted=error == _TILTED, misaligned=error == _MISALIGNED)
    without = exact_run(scheme, (0.0, 0.0), tilted=False, misaligned=False)
    return float(np.abs(with_error - without).max()) / ARCSEC


def _bias(scheme: Scheme, error: str) -> float:
    """Largest error of m [deg/h] of a regression for m alone: segments of ten minutes, Simpson's rule."""
    alpha = exact_run(scheme, (0.0, 0.0), tilted=error == _TILTED, misaligned=error == _MISALIGNED)
    rows = integrals(instants(1), alpha, Base.mounted(scheme, LATITUDE), "simpson", errors=False)
    return largest_error(solve(*rows.segments(alpha, 10), rows.names).estimate)
