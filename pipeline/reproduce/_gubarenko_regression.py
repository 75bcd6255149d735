"""Section 6: how accurate the regression is, and how well its equations are conditioned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_regression import Quadrature, integrals
from pipeline.models.earth import Base, Scheme
from pipeline.numerics.least_squares import solve
from pipeline.reproduce._gubarenko_runs import (
    LATITUDE,
    SCHEMES,
    SOURCE,
    STARTS,
    Start,
    instants,
    largest_error,
    linear_run,
)
from pipeline.reproduce.rows import Expected, Row, about, at_most, near

Float = NDArray[np.float64]

_FACTOR = 3
"""The table of quadrature errors holds within this factor."""

_ERRORS: Mapping[int, tuple[tuple[float, ...], tuple[float, ...], float]] = MappingProxyType(
    {
        1: ((2e-4, 2e-6, 6e-4, 2e-4), (4e-9, 1e-11, 2e-8, 2e-9), 5e-12),
        5: ((5e-3, 5e-5, 2e-2, 4e-3), (2e-6, 8e-9, 2e-5, 1e-6), 1e-9),
        10: ((2e-2, 2e-4, 6e-2, 2e-2), (4e-5, 1e-7, 2e-4, 2e-5), 8e-8),
    }
)
"""Minutes between samples: error of m [deg/h] by the trapezoid and Simpson's rule in each scheme, and the
most by quintic splines in any."""

_CONDITIONS: tuple[tuple[Scheme, Start, float, float], ...] = (
    ("polar", (0.0, 0.0), 731, 1.1e7),
    ("polar", (0.02, -0.01), 299, 1.8e6),
    ("polar", (0.6, 0.5), 6.6, 277),
    ("polar", (1.0, 0.2), 4.1, 79),
    ("equatorial", (0.0, 0.0), 4.4, 2.5e3),
    ("equatorial", (0.0, 0.6), 4.8, 318),
    ("horizontal", (0.0, 0.0), 18.7, 72),
    ("vertical", (0.0, 0.0), 9.9, 801),
    ("vertical", (0.5, -0.5), 5.3, 46),
)
"""Scheme, start, condition number of the equations for m alone, and with the installation errors. In the
equatorial scheme the columns of theta are zero, and left out."""


def regression() -> Iterator[Row]:
    """Error by each quadrature, condition number of each run, and of two runs together."""
    yield from _quadratures()
    yield from _conditions()
    yield from _stacked()


def _quadratures() -> Iterator[Row]:
    """Noise-free, truth by the linear model with installation errors, segments of an hour."""
    for minutes, (trapezoid, simpson, quintic) in _ERRORS.items():
        for k, scheme in enumerate(SCHEMES):
            item = f"quadrature, {minutes} min, {scheme}"
            cells: Mapping[Quadrature, Expected] = {
                "trapezoid": about(trapezoid[k], _FACTOR),
                "simpson": about(simpson[k], _FACTOR),
                "quintic_spline": at_most(quintic, _FACTOR),
            }
            for quadrature, expected in cells.items():
                error = _error(scheme, minutes, quadrature)
                yield expected.beside(SOURCE, item, f"{quadrature}: max error of m, deg/h", error)


def _error(scheme: Scheme, minutes: int, quadrature: Quadrature) -> float:
    alpha = linear_run(scheme, STARTS[scheme])[::minutes]
    rows = integrals(instants(minutes), alpha, Base.mounted(scheme, LATITUDE), quadrature, errors=True)
    return largest_error(solve(*rows.segments(alpha, 60 // minutes), rows.names).estimate[:6])


def _conditions() -> Iterator[Row]:
    """Segments of ten minutes, Simpson's rule."""
    for scheme, start, drift, whole in _CONDITIONS:
        item = f"condition, {scheme} from {start[0]:g}, {start[1]:g}"
        alpha = linear_run(scheme, start)
        for errors, oracle, what in ((False, drift, "of m"), (True, whole, "with theta and epsilon")):
            A, _ = _segments(scheme, alpha, errors=errors)
            # two digits are given
            yield near(oracle, 0.05).beside(SOURCE, item, f"condition {what}", _condition(A))


def _stacked() -> Iterator[Row]:
    """Two equatorial runs of 12 h, free of installation errors: alone, and together."""
    runs = [
        _segments("equatorial", linear_run("equatorial", (0.0, alpha2), 12.0, errors=False), errors=True)[0]
        for alpha2 in (0.0, 0.8)
    ]
    runs = [np.delete(A, (6, 7), axis=1) for A in runs]  # theta, whose columns are zero
    own = [np.hstack([A[:, :6], *(A[:, 6:] * (k == j) for j in range(2))]) for k, A in enumerate(runs)]
    for quantity, A, oracle in (
        ("alpha2(0) = 0 alone", runs[0], 4.1e4),
        ("alpha2(0) = 0.8 alone", runs[1], 1.8e3),
        ("both, each with its own epsilon", np.vstack(own), 29.6),
        ("both, with a common epsilon", np.vstack(runs), 22.5),
    ):
        # two digits are given
        yield near(oracle, 0.05).beside(SOURCE, "condition, equatorial, 12 h", quantity, _condition(A))


def _segments(scheme: Scheme, alpha: Float, *, errors: bool) -> tuple[Float, Float]:
    tau = instants(1, (len(alpha) - 1) / 60)
    rows = integrals(tau, alpha, Base.mounted(scheme, LATITUDE), "simpson", errors=errors)
    return rows.segments(alpha, 10)


def _condition(A: Float) -> float:
    """Largest over smallest singular value; columns that are zero to rounding do not count."""
    told = A[:, np.abs(A).max(axis=0) > 1e-12]
    values = np.linalg.svd(told, compute_uv=False)
    return float(values[0] / values[-1])
