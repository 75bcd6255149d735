"""How long a run must be to tell drift from the Earth's rotation.

While the gimbal hardly turns, c and F of the linear model ``alpha' = c + F p`` are constant, and all that a
record tells are the two mean rates of its angles, in which drift and a misaligned Earth rate are one. Only
as the angles turn does a third combination of the drift m come out. Its predicted standard error is the
measure of a record here: with the initial angles free and white noise sigma, ``sigma / s_3`` with the third
singular value of the rows ``int F`` of the cumulative least squares (Gubarenko & Kuzmenko, 1995, (6.3)
summed up).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import Base
from pipeline.models.gyro_drift import DRIFT, linear_model

Float = NDArray[np.float64]

_NODES = 300
"""Samples of an arc that stand for all of it."""

_LENGTHS = 60
"""Lengths tried, each a tenth longer than the one before or so."""

_STEEP = np.radians(89)
"""Inner angle beyond which the gimbal is lost."""


def third_standard_error(arcs: Sequence[tuple[Float, Float]], base: Base, sigma: float, step: float) -> float:
    """Standard error of the third best determined combination of the drift m.

    Parameters
    ----------
    arcs : sequence of (tau (n,), alpha (n, 2))
        Time in units of the Earth rate and gimbal angles [rad]; each arc has initial angles of its own.
    base : Base
    sigma : float
        Standard deviation of an angle [rad], white.
    step : float
        Interval of the samples, in units of the Earth rate.

    Returns
    -------
    float
        In units of the Earth rate; infinite where there is no third.
    """
    rows = [_rows(tau, alpha, base, step) for tau, alpha in arcs if len(tau) > 1]
    if not rows:
        return float("inf")
    values = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    return float(sigma / values[2]) if values[2] > 0 else float("inf")


def _rows(tau: Float, alpha: Float, base: Base, step: float) -> Float:
    """``int F`` without its mean, which the initial angles take; a node has the weight of its samples."""
    nodes = np.unique(np.linspace(0, len(tau) - 1, min(len(tau), _NODES)).astype(np.int64))
    t = tau[nodes]
    F = linear_model(alpha[nodes], base)[1][:, :, : len(DRIFT)]
    steps = 0.5 * np.diff(t)[:, np.newaxis, np.newaxis] * (F[1:] + F[:-1])
    integral = np.concatenate([np.zeros_like(F[:1]), np.cumsum(steps, axis=0)])
    weight = np.sqrt(max((t[-1] - t[0]) / step, 1.0) / len(t))
    return np.asarray(weight * (integral - integral.mean(axis=0)).reshape(-1, len(DRIFT)), dtype=np.float64)


def sufficient_length(
    tau: Float, alpha: Float, base: Base, *, sigma: float, step: float, useful: float, longest: float
) -> float | None:
    """How long a run like this one must be for its third combination to be of use.

    Predicted with a rotor without drift. Where the run so far tells less than that, the factor is taken
    along; where it tells more, because drift turns the gimbal, only if nothing else would ever do.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time of the run, in units of the Earth rate.
    alpha : ndarray, shape (n, 2)
        Its gimbal angles [rad].
    base : Base
    sigma, step : float
        As `third_standard_error`.
    useful : float
        Standard error that is of use, in units of the Earth rate.
    longest : float
        Lengths up to this are tried, in units of the Earth rate.

    Returns
    -------
    float or None
        In units of the Earth rate. None where no such length would do: it is the place, not the time.
    """
    length = float(tau[-1] - tau[0])
    found = third_standard_error([(tau, alpha)], base, sigma, step)
    predicted = _predicted(alpha[0], base, sigma, step, length)
    ratio = found / predicted if np.isfinite(found) and 0 < predicted < np.inf else 1.0
    lengths = np.geomspace(length, longest, _LENGTHS)[1:] if length < longest else np.empty(0)
    errors = np.array([_predicted(alpha[0], base, sigma, step, float(each)) for each in lengths])
    for factor in (max(ratio, 1.0), ratio):
        enough = np.flatnonzero(factor * errors <= useful)
        if len(enough):
            return float(lengths[enough[0]])
    return None


def _predicted(start: Float, base: Base, sigma: float, step: float, length: float) -> float:
    tau = np.linspace(0.0, length, _NODES)
    alpha = driftless(start, base, tau)
    lost = np.abs(alpha[:, 1]) > _STEEP
    stop = int(np.argmax(lost)) if lost.any() else len(tau)
    return third_standard_error([(tau[:stop], alpha[:stop])], base, sigma, step)


def driftless(start: Float, base: Base, tau: Float) -> Float:
    """Gimbal angles of a rotor without drift: its axis turns about u by -tau (Rodrigues).

    Parameters
    ----------
    start : ndarray, shape (2,)
        Angles at tau = 0 [rad].
    base : Base
    tau : ndarray, shape (n,)
        Time in units of the Earth rate.

    Returns
    -------
    ndarray, shape (n, 2)
        Unwrapped [rad].
    """
    s1, c1, s2, c2 = np.sin(start[0]), np.cos(start[0]), np.sin(start[1]), np.cos(start[1])
    e = np.array([s2, -s1 * c2, c1 * c2])
    along = base.u * (base.u @ e)
    across = e - along
    turned = along + np.outer(np.cos(tau), across) - np.outer(np.sin(tau), np.cross(base.u, e))
    alpha2 = np.arcsin(np.clip(turned[:, 0], -1.0, 1.0))
    return np.stack([np.unwrap(np.arctan2(-turned[:, 1], turned[:, 2])), alpha2], axis=1)
