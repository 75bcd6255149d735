"""Navigation smoothed over the whole record: the filter of `navigation_filter`, and back.

The filter corrects its state at every measurement, so that its error is of another state after it than
before. The smoother therefore passes whole states: with the smoothed state x^s_{k+1} of a node, what is
predicted there x⁻_{k+1}, and the filter's x_k::

    x^s_k = x_k (+) G_k (x^s_{k+1} (-) x⁻_{k+1}),    G_k = P_k Φ_k^T (P⁻_{k+1})^-1
    S^s_k = [G_k S^s_{k+1}, C_k],                    C_k C_k^T = P_k - G_k P⁻_{k+1} G_k^T

(H. E. Rauch, F. Tung, C. T. Striebel, *AIAA Journal* 3, 1965), where (-) is the error of one whole state
against another and (+) puts it right. G and C come from one triangular factor of x⁻_{k+1} and x_k together,
``[[A, 0], [B, C]]``, G = B A^-1, so that no covariance is formed, inverted or subtracted (T. Kailath,
A. H. Sayed, B. Hassibi, *Linear Estimation*, 2000, ch. 12). Between two nodes the correction is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models._kernels_navigation_filter import between_nodes
from pipeline.models._kernels_navigation_smoother import smooth_nodes
from pipeline.models.ellipsoid import displaced
from pipeline.models.navigation_filter import Filtered, deviations, run
from pipeline.models.navigation_filter_settings import FilterSettings
from pipeline.models.navigation_problem import Navigation, Problem
from pipeline.models.navigation_states import States
from pipeline.numerics.rotation import quaternion_from_rotation_vector, quaternion_multiply

Float = NDArray[np.float64]
Integer = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Smoothed:
    """The smoother's navigation, and its nodes.

    Attributes
    ----------
    navigation : Navigation
        Method ``smoother``; innovations and what is used are the filter's.
    states : States
    rows : ndarray of int, shape (K,)
        The nodes.
    factor : ndarray, shape (K, n, n), or (0, n, n)
        Of the covariance at the nodes, by columns: ``factor[k].T @ factor[k]`` is the covariance.
    """

    navigation: Navigation
    states: States
    rows: Integer
    factor: Float


def smooth(problem: Problem, settings: FilterSettings | None = None) -> Navigation:
    """Navigate by the smoother.

    Parameters
    ----------
    problem : Problem
    settings : FilterSettings, optional

    Returns
    -------
    Navigation
        Method ``smoother``.

    Raises
    ------
    NavigationError
        As the filter does.
    """
    filtered = run(problem, settings or FilterSettings(), keep_history=True)
    return run_back(filtered, keep_factors=False).navigation


def run_back(filtered: Filtered, *, keep_factors: bool) -> Smoothed:
    """Smooth what the filter found.

    Parameters
    ----------
    filtered : Filtered
        With its history.
    keep_factors : bool
        Whether to keep the factors of all nodes: 8 n^2 bytes each.

    Returns
    -------
    Smoothed
    """
    history, rows, nav = filtered.history, filtered.rows, filtered.navigation
    if history is None:
        raise ValueError("the run kept no history")
    K, n = len(rows), len(filtered.states)
    after, before, sigma = np.empty((K, n)), np.empty((K, n)), np.empty((K, n))
    factors = np.empty((K if keep_factors else 0, n, n))
    smooth_nodes(
        np.ascontiguousarray(nav.time[rows]),
        filtered.states.rate,
        (nav.position[rows], nav.velocity[rows], nav.attitude[rows]),
        filtered.slow,
        (history.before, history.factor, history.transition, history.sensor_noise, history.own_noise),
        after,
        before,
        sigma,
        factors,
    )
    error = np.empty((len(nav.time), n))
    between_nodes(nav.time, rows, before, after, error)
    smoothed = _put_right(nav, filtered.states, error)
    found = replace(smoothed, deviations=deviations(filtered.states, nav.time, rows, sigma, sigma))
    return Smoothed(found, filtered.states, rows, factors)


def _put_right(nav: Navigation, states: States, error: Float) -> Navigation:
    """The filter's navigation less its errors, shape (N + 1, n)."""
    group = states.groups
    turn = quaternion_from_rotation_vector(error[:, group["attitude"]])
    attitude = quaternion_multiply(turn, nav.attitude)
    sign = np.where(attitude[:, :1] < 0, -1.0, 1.0)
    wind, barometer = nav.wind, nav.barometer_bias
    return replace(
        nav,
        method="smoother",
        position=displaced(nav.position, error[:, group["position"]]),
        velocity=nav.velocity + error[:, group["velocity"]],
        attitude=sign * attitude,
        gyro_bias=nav.gyro_bias + error[:, group["gyro_bias"]],
        accelerometer_bias=nav.accelerometer_bias + error[:, group["accelerometer_bias"]],
        wind=None if wind is None else wind + error[:, group["wind"]],
        barometer_bias=None if barometer is None else barometer + error[:, group["barometer_bias"]][:, 0],
    )
