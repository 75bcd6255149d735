"""What a run of each kind can tell: the paper's variants 1 to 4, corrected by the null vector of (6.9)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_regression import Integrals
from pipeline.models.drift_trajectory import linear_trajectory
from pipeline.models.earth import Base, Scheme
from pipeline.models.gyro_drift import PARAMETERS, linear_model, misalignment_basis
from pipeline.reproduce._gubarenko_runs import LATITUDE, SCHEMES, SOURCE, STARTS, Start, instants, parameters
from pipeline.reproduce.rows import Row, at_most, near

Float = NDArray[np.float64]

_TOLD = 1e-3
"""Of the largest singular value: what lies above is told, in units in which m and the angles are alike."""

_FREEDOMS: tuple[tuple[str, Scheme, Start, int], ...] = (
    ("1, polar, small angles", "polar", (0.02, -0.01), 6),
    ("2, polar, arbitrary angles", "polar", (0.6, 0.5), 10),
    ("3, equatorial, small alpha2", "equatorial", (0.0, 0.0), 7),
)
"""Variant, scheme, start, and how many freedoms are told: in variant 1 of the paper's seven all but a
direction, in variant 3 of its eight."""

_SIN, _COS = float(np.sin(LATITUDE)), float(np.cos(LATITUDE))
_DRIFT = ("m11", "m12", "m21", "m22", "mc1", "mc2")

_WEAKEST: tuple[tuple[str, Scheme, Start, Float, tuple[float, float, float]], ...] = (
    ("1, polar, small angles", "polar", (0.02, -0.01), parameters("polar"), (1.0, _COS, _SIN)),
    ("3, equatorial, small alpha2", "equatorial", (0.0, 0.0), parameters("equatorial"), (1.0, _SIN, _COS)),
    # mc2 stands in row 1 over cos alpha2, epsilon1 alone: mc2' = mc2 / cos alpha2 + epsilon1
    (
        "4, equatorial, alpha2 = 0.6",
        "equatorial",
        (0.0, 0.6),
        np.zeros(len(PARAMETERS)),
        (1.0, _SIN * float(np.cos(0.6)), _COS),
    ),
)
"""Variant, scheme, start, parameters of the run, and its weakest direction in m11, mc2', epsilon3. Without
drift alpha2 is constant, and the direction of variant 4 a null vector."""


def observability() -> Iterator[Row]:
    """Null vectors, how many freedoms are told, and the direction that is told worst."""
    for scheme in SCHEMES:
        A, base = _rows(scheme, STARTS[scheme], parameters(scheme))
        null = np.concatenate([[1.0], np.zeros(7), -base.g])
        size = float(np.linalg.norm(A @ null) / np.linalg.norm(null) / np.linalg.norm(A, 2))
        # eleven products of rounded columns
        yield at_most(1e-14).beside(
            SOURCE, f"(6.9), {scheme}", "m11 = 1, epsilon = -g: |A v| over the largest, at most", size
        )
    for variant, scheme, start, told in _FREEDOMS:
        A, base = _rows(scheme, start, parameters(scheme))
        count = _told(np.hstack([A[:, :8], A[:, 8:] @ misalignment_basis(base)]))
        yield near(told, 0.0).beside(
            SOURCE, f"variant {variant}", "freedoms told, of 10 with u.epsilon = 0", count
        )
    yield from _directions()


def _directions() -> Iterator[Row]:
    """The weakest direction of the paper's set, theta1, theta2 and what else is bound to another left out."""
    for variant, scheme, start, p, direction in _WEAKEST:
        names = (*_DRIFT, "epsilon3") if scheme == "polar" else (*_DRIFT, "epsilon2", "epsilon3")
        A, _ = _rows(scheme, start, p)
        weakest = np.linalg.svd(A[:, [PARAMETERS.index(name) for name in names]])[2][-1]
        expected = dict(zip(("m11", "mc2", "epsilon3"), direction, strict=True))
        cosine = _cosine(dict(zip(names, weakest, strict=True)), expected)
        yield near(1.0, 1e-3).beside(
            SOURCE, f"variant {variant}", "|cos| of the weakest direction to the known one", cosine
        )


def _rows(scheme: Scheme, start: Start, p: Float) -> tuple[Float, Base]:
    """Rows of a day by segments of ten minutes, a column a parameter, epsilon not bound."""
    base, tau = Base.mounted(scheme, LATITUDE), instants(1)
    c, F = linear_model(linear_trajectory(p, base, np.array(start), tau), base)
    h = tau[1] / 2
    steps = Integrals(PARAMETERS, h * (c[1:] + c[:-1]), h * (F[1:] + F[:-1]))
    return steps.segments(np.zeros((len(tau), 2)), 10)[0], base


def _told(A: Float) -> float:
    values = np.linalg.svd(A, compute_uv=False)
    return float(np.sum(values > _TOLD * values[0]))


def _cosine(one: Mapping[str, float], other: Mapping[str, float]) -> float:
    """Of the angle between two directions, without sign."""
    product = sum(value * one.get(name, 0.0) for name, value in other.items())
    lengths = np.linalg.norm(list(one.values())) * np.linalg.norm(list(other.values()))
    return float(abs(product) / lengths)
