"""Section 4: the drift from the spiral that the rotor draws about the pole."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.models.drift_problem import Arc, Prior
from pipeline.models.drift_trajectory import trajectory
from pipeline.models.earth import Base
from pipeline.models.gyro_drift import DRIFT, Gyro
from pipeline.models.polar_spiral import Spiral, fit_spiral
from pipeline.models.spiral_inversion import invert_spiral
from pipeline.reproduce._gubarenko_runs import LATITUDE, SOURCE, instants, largest_error
from pipeline.reproduce.rows import Row, near

_FIGURES = (-7e-4, -2.1e-3, 0.022, 9e-4, 0.9946, 0.364)
"""alpha_c1, alpha_c2 [rad], r [rad], lambda, nu, psi [rad]."""

_INVERSIONS: tuple[tuple[str, dict[str, float], dict[str, float]], ...] = (
    (
        "spiral_mc_known",
        {"mc1": -0.001, "mc2": 0.002},
        {"m11": 0.004040, "m12": -0.001963, "m21": 0.002931, "m22": 0.001450},
    ),
    (
        "spiral_m1_known",
        {"m11": 0.004, "m21": 0.003},
        {"m12": -0.001994, "m22": 0.001505, "mc1": -0.000988, "mc2": 0.002007},
    ),
    (
        "spiral_m2_known",
        {"m12": -0.002, "m22": 0.0015},
        {"m11": 0.003993, "m21": 0.002994, "mc1": -0.000989, "mc2": 0.002008},
    ),
)
"""Inversion, what is known, and what follows, to the digits given."""

_TRUTH = (0.004, -0.002, 0.003, 0.0015, -0.001, 0.002)


def spiral() -> Iterator[Row]:
    """The three inversions, and the bias of a fitted spiral."""
    fitted = Spiral(*_FIGURES, np.zeros((6, 6)), 0.0, np.zeros((0, 2)))
    for method, known, oracles in _INVERSIONS:
        m, _ = invert_spiral(fitted, LATITUDE, method, _known(known))
        given = " and ".join(known)
        for name, oracle in oracles.items():
            # six decimals are given
            expected = near(oracle, abs(0.51e-6 / oracle))
            yield expected.beside(SOURCE, f"spiral, {given} known", name, float(m[DRIFT.index(name)]))
    # one digit is given
    yield near(8e-3, 0.1).beside(SOURCE, "spiral alone, mc known", "max error of m, deg/h", _bias())


def _known(values: dict[str, float]) -> dict[str, Prior]:
    return {name: Prior(value, 0.0) for name, value in values.items()}


def _bias() -> float:
    """Largest error of m [deg/h] from a day about the pole by the exact model."""
    gyro, base = Gyro(np.array(_TRUTH), np.zeros(2)), Base.mounted("polar", LATITUDE)
    alpha = trajectory(gyro, base, np.array([0.02, -0.01]), instants(1))
    fitted = fit_spiral(Arc(0, instants(1), alpha, np.ones(len(alpha), dtype=np.bool_)))
    m, _ = invert_spiral(fitted, LATITUDE, "spiral_mc_known", _known({"mc1": _TRUTH[4], "mc2": _TRUTH[5]}))
    return largest_error(m, np.array(_TRUTH))
