"""The drift parameters that a spiral about the pole tells.

Gubarenko & Kuzmenko, Mechanics of Solids (1995), (4.5) and (4.6), corrected. To first order in m, at latitude
phi and with ``D = 1 - 3 sin^2 phi``, four of the figures of the spiral (4.4) tell the drift::

    alpha_c1 = mc1 + m21 cos phi - m22 sin 2 phi,     lambda = m21 sin phi + m22 D
    alpha_c2 = mc2 - m11 cos phi + m12 sin 2 phi,     1 - nu = m11 sin phi + m12 D

so that two of the six must be known. The ellipse ``alpha' = A alpha + b`` tells two more, and none need be::

    b2 as alpha_c1,  -b1 as alpha_c2,  -(A11 + A22) / 2 as lambda,  1 - (A12 - A21) / 2 as 1 - nu
    (A11 - A22) / 2 = m22 cos^2 phi,   -(A12 + A21) / 2 = m12 cos^2 phi

What both neglect, the square of the angles and of m, biases them by some 1e-2 degrees an hour: they are a
first guess and a picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_problem import Arc, Estimate, Parameter, Prior, Problem
from pipeline.models.earth import Base
from pipeline.models.gyro_drift import DRIFT
from pipeline.models.polar_spiral import SPIRAL, Ellipse, Spiral, SpiralError, fit_ellipse, fit_spiral

Float = NDArray[np.float64]

INVERSIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "spiral_mc_known": ("mc1", "mc2"),
        "spiral_m1_known": ("m11", "m21"),
        "spiral_m2_known": ("m12", "m22"),
        "spiral_six": (),
    }
)
"""The inversions, and the parameters that must be known for each; the last is of the ellipse."""

_AMPLIFICATION = 1e3
"""An inversion that magnifies the errors of the figures more is refused: neglected terms of O(m r) >= 1e-4
alone would make the drift wrong by a tenth of the Earth's rate, more than any drift is."""
_POLE = 1e-6
"""How far the third axis of the base may be from the pole [rad]: a fifth of an arc second."""
_SMALL = 0.1
"""Angles [rad] from which on the spiral is a picture only: their square is 1e-2."""


def invert_spiral(
    spiral: Spiral, latitude: float, method: str, known: Mapping[str, Prior]
) -> tuple[Float, Float]:
    """Drift from a spiral, two of its parameters known.

    Parameters
    ----------
    spiral : Spiral
    latitude : float
        [rad]
    method : {"spiral_mc_known", "spiral_m1_known", "spiral_m2_known"}
        The pair that is known, as in `INVERSIONS`.
    known : mapping of str to Prior
        Values and standard deviations of that pair, by name [1].

    Returns
    -------
    m : ndarray, shape (6,)
        In the order of `DRIFT`, the known ones as given [1].
    covariance : ndarray, shape (6, 6)
        From that of the spiral and of the known values.

    Raises
    ------
    SpiralError
        Where the latitude leaves too little of the parameters in the figures: near 35.26 degrees, where
        D = 0, for m11 and m21 known; near the equator for m12 and m22; near the poles for mc1 and mc2.
    """
    chosen, sign = np.array([0, 1, 3, 4]), np.array([1.0, 1.0, 1.0, -1.0])
    figures = sign * spiral.value[chosen] + np.array([0.0, 0.0, 0.0, 1.0])
    covariance = spiral.covariance[np.ix_(chosen, chosen)] * np.outer(sign, sign)
    return _invert(figures, covariance, latitude, method, known)


def invert_ellipse(ellipse: Ellipse, latitude: float) -> tuple[Float, Float]:
    """All six parameters of the drift from an ellipse.

    Parameters
    ----------
    ellipse : Ellipse
    latitude : float
        [rad]

    Returns
    -------
    m : ndarray, shape (6,)
        In the order of `DRIFT` [1].
    covariance : ndarray, shape (6, 6)

    Raises
    ------
    SpiralError
        Near the equator and near the poles, as `invert_spiral`.
    """
    # rows as in the head of the module, columns A11, A12, A21, A22, b1, b2
    T = np.array(
        [
            [0, 0, 0, 0, 0, 1],
            [0, 0, 0, 0, -1, 0],
            [-0.5, 0, 0, -0.5, 0, 0],
            [0, -0.5, 0.5, 0, 0, 0],
            [0.5, 0, 0, -0.5, 0, 0],
            [0, -0.5, -0.5, 0, 0, 0],
        ]
    )
    figures = T @ np.concatenate([ellipse.A.ravel(), ellipse.b]) + np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    return _invert(figures, T @ ellipse.covariance @ T.T, latitude, "spiral_six", {})


def spiral_estimates(
    problem: Problem, known: Mapping[str, Prior]
) -> tuple[tuple[Estimate, ...], tuple[SpiralError, ...]]:
    """The spiral of the longest polar arc, and every inversion whose known values are all there.

    Parameters
    ----------
    problem : Problem
    known : mapping of str to Prior
        Drift parameters that are known well enough to be taken as such [1].

    Returns
    -------
    estimates : tuple of Estimate
        ``spiral`` with the parameters of `SPIRAL`, of which lambda and nu are common to all runs; then the
        inversions with all of `DRIFT`, the known ones as given. ``predicted`` is NaN in all other arcs.
    refused : tuple of SpiralError
        Why an inversion is not among them.

    Raises
    ------
    SpiralError
        If no arc is of the polar scheme, or there is no spiral in it.
    """
    chosen = _longest_polar(problem)
    arc, base = problem.arcs[chosen], problem.bases[problem.arcs[chosen].run]
    latitude = base.latitude
    spiral, ellipse = fit_spiral(arc), fit_ellipse(arc)
    notes = _notes(arc)

    def estimate(method: str, names: tuple[Parameter, ...], value: Float, covariance: Float) -> Estimate:
        fit = ellipse if method == "spiral_six" else spiral
        nothing = [np.full_like(a.alpha, np.nan) for a in problem.arcs]
        predicted = (*nothing[:chosen], fit.predicted, *nothing[chosen + 1 :])
        return Estimate(method, names, value, covariance, fit.sigma, predicted, {}, notes)

    figures = tuple(Parameter(name, None if name in ("lambda", "nu") else arc.run) for name in SPIRAL)
    drift = tuple(Parameter(name) for name in DRIFT)
    found, refused = [estimate("spiral", figures, spiral.value, spiral.covariance)], []
    for method, needed in INVERSIONS.items():
        if not set(needed) <= set(known):
            continue
        try:
            inverse = (
                invert_spiral(spiral, latitude, method, known)
                if needed
                else invert_ellipse(ellipse, latitude)
            )
        except SpiralError as error:
            refused.append(error)
        else:
            found.append(estimate(method, drift, *inverse))
    return tuple(found), tuple(refused)


def _relations(latitude: float) -> Float:
    """Figures by m in the order of `DRIFT`, shape (6, 6); the last two are of the ellipse alone."""
    s, c, double = np.sin(latitude), np.cos(latitude), np.sin(2 * latitude)
    D = 1 - 3 * s**2
    return np.array(
        [
            # m11, m12, m21, m22, mc1, mc2
            [0, 0, c, -double, 1, 0],
            [-c, double, 0, 0, 0, 1],
            [0, 0, s, D, 0, 0],
            [s, D, 0, 0, 0, 0],
            [0, 0, 0, c**2, 0, 0],
            [0, c**2, 0, 0, 0, 0],
        ]
    )


def _invert(
    figures: Float, covariance: Float, latitude: float, method: str, known: Mapping[str, Prior]
) -> tuple[Float, Float]:
    """Solve ``figures = G m`` for what is not known of m; the whole of m and its covariance."""
    G = _relations(latitude)[: len(figures)]
    given = [DRIFT.index(name) for name in INVERSIONS[method]]
    sought = [k for k in range(len(DRIFT)) if k not in given]
    if np.linalg.norm(G[:, sought], -2) * _AMPLIFICATION < 1:
        raise SpiralError(
            f"method {method}",
            expected=f"a latitude where the spiral tells {', '.join(DRIFT[k] for k in sought)}",
            found=f"{np.rad2deg(latitude):.2f} deg, where it does not tell all of them",
            remedy="leave out what is known for this inversion, and use another or cumulative",
        )
    inverse = np.linalg.inv(G[:, sought])
    # m = L figures + N known, in the order of DRIFT
    L, N = np.zeros((6, len(figures))), np.zeros((6, len(given)))
    L[sought], N[sought], N[given] = inverse, -inverse @ G[:, given], np.eye(len(given))
    values = np.array([known[name].mean for name in INVERSIONS[method]])
    variances = np.diag([known[name].sigma ** 2 for name in INVERSIONS[method]])
    return L @ figures + N @ values, L @ covariance @ L.T + N @ variances @ N.T


def _longest_polar(problem: Problem) -> int:
    """Index of the polar arc with the most measured samples."""
    polar = [k for k, arc in enumerate(problem.arcs) if _is_polar(problem.bases[arc.run])]
    if not polar:
        raise SpiralError(
            "method spiral",
            expected="a run of the polar scheme",
            found="none",
            remedy="leave the method out, or add a polar run",
        )
    return max(polar, key=lambda k: int(problem.arcs[k].measured.sum()))


def _is_polar(base: Base) -> bool:
    ideal = Base.mounted("polar", base.latitude)
    return bool(max(np.abs(base.u - ideal.u).max(), np.abs(base.g - ideal.g).max()) < _POLE)


def _notes(arc: Arc) -> tuple[str, ...]:
    largest = float(np.abs(arc.alpha[arc.measured]).max())
    if largest <= _SMALL:
        return ()
    return (
        f"the angles reach {np.rad2deg(largest):.0f} deg, where the axis' path about the pole is no spiral",
    )
