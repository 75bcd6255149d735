"""Navigation by an error-state Kalman filter with a square-root covariance.

The state is carried by the strapdown equations; the filter estimates its error and puts it right at every
measurement. It has 15 states - position, velocity, attitude, gyro and accelerometer bias - or 18 with the
wind and the bias of the barometer, and more where errors of the aids are coloured. A factor of the
covariance is carried in place of the covariance, which therefore can not lose its symmetry or become
negative; a measurement is taken in one row at a time.

At every step of the inertial sensors the state moves, and what links the errors is summed up; the factor
itself is carried on at *nodes*: at every measurement, and at least every ``covariance_step``. Standard
deviations between two nodes are interpolated.

A measurement is refused where its squared innovation over its covariance exceeds the quantile of chi-squared
of the gate. It is taken in at the first step that ends at its time or after, with what is predicted
interpolated to its time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.models import _kernels_navigation_aids as aids_kernel
from pipeline.models._kernels_navigation_filter import between_nodes, filter_steps, mark_nodes, spaced
from pipeline.models.navigation_errors import check_start, field_of, lost
from pipeline.models.navigation_filter_settings import FilterSettings
from pipeline.models.navigation_problem import (
    AidName,
    Deviations,
    Fixes,
    Innovations,
    Navigation,
    Problem,
)
from pipeline.models.navigation_states import States, states_of

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]

KINDS: tuple[AidName, ...] = get_args(AidName)
"""Aids in the order of their numbers in the compiled loops."""

_ROWS = {"position": 3, "velocity": 3, "airspeed": 1, "altitude": 1, "magnetic_field": 3, "attitude": 3}


@dataclass(frozen=True, slots=True)
class History:
    """What a smoother needs of each of the K nodes.

    Attributes
    ----------
    before : ndarray, shape (K, 10)
        Position, velocity and quaternion before the node's measurements.
    factor : ndarray, shape (K, n, n)
        After them, by columns: ``factor[k].T @ factor[k]`` is the covariance.
    transition : ndarray, shape (K, 15, 9)
        From the node before, of the last nine states, by columns of the last fifteen.
    sensor_noise : ndarray, shape (K, 6, 9)
        Columns of the factor of the noise of the last nine states on the way.
    own_noise : ndarray, shape (K, n)
        Standard deviation that each state gathered by itself on the way.
    """

    before: Float
    factor: Float
    transition: Float
    sensor_noise: Float
    own_noise: Float


@dataclass(frozen=True, slots=True)
class Filtered:
    """The filter's navigation, and its nodes.

    Attributes
    ----------
    navigation : Navigation
    states : States
        Which states there are.
    rows : ndarray of int, shape (K,)
        Of the navigation, at which the covariance was carried on; first and last among them.
    slow : ndarray, shape (K, n - 9)
        States before φ, at the nodes.
    history : History or None
    """

    navigation: Navigation
    states: States
    rows: Integer
    slow: Float
    history: History | None


@dataclass(frozen=True, slots=True)
class _Events:
    """Measurements to be tried, by ascending row; ``index`` is that of the fix in its aid."""

    row: Integer
    kind: Integer
    lag: Float
    value: Float
    index: Integer


def navigate(problem: Problem, settings: FilterSettings | None = None) -> Navigation:
    """Navigate by the filter.

    Parameters
    ----------
    problem : Problem
        Any subset of aids, or none.
    settings : FilterSettings, optional

    Returns
    -------
    Navigation
        Method ``filter``, with deviations and innovations.

    Raises
    ------
    NavigationError
        If the state comes to a pole or ceases to be a number, or there is a magnetometer without a field.
    """
    return run(problem, settings or FilterSettings(), keep_history=False).navigation


def run(problem: Problem, settings: FilterSettings, *, keep_history: bool) -> Filtered:
    """Navigate by the filter and keep its nodes; parameters and errors as of `navigate`.

    With ``keep_history`` the factors of all nodes are kept: 8 n^2 bytes each.
    """
    imu = problem.imu
    check_start(problem)
    field = field_of(problem)
    states = states_of(settings, problem.aids)
    events = _events(problem, settings)
    n, rows = len(states), len(imu.time)
    nodes = mark_nodes(imu.time, events.row, settings.covariance_step)
    at = np.flatnonzero(nodes)
    path = (np.empty((rows, 3)), np.empty((rows, 3)), np.empty((rows, 4)))
    start = problem.start
    path[0][0] = start.latitude, start.longitude, start.height
    path[1][0], path[2][0] = start.velocity, start.attitude
    kept = (np.zeros((len(at), n - 9)), np.empty((len(at), n)), np.empty((len(at), n)))
    tried = len(events.row)
    innovations = (np.zeros((tried, 3)), np.zeros((tried, 3)), np.zeros(tried), np.full(tried, -1.0))
    history = _room(len(at) if keep_history else 0, n)
    W = np.zeros((2 * n + 6, n))
    W[:n] = np.diag(states.start)
    failed = filter_steps(
        (imu.time, np.ascontiguousarray(imu.rotation), np.ascontiguousarray(imu.velocity), imu.coasted),
        nodes,
        (events.row, events.kind, events.lag, events.value),
        (states.slots, states.walk, states.stationary, states.rate),
        _sensor_variance(settings),
        _options(problem, settings),
        _variances(settings),
        _gates(settings),
        field,
        W,
        path,
        kept,
        innovations,
        (history.before, history.factor, history.transition, history.sensor_noise, history.own_noise),
    )
    if failed >= 0:
        raise lost("navigation filter", imu.time[failed] - imu.time[0], path[0][failed - 1, 0])
    navigation = _navigation(problem, settings, states, events, at, path, kept, innovations)
    return Filtered(navigation, states, at, kept[0], history if keep_history else None)


def deviations(states: States, time: Float, rows: Integer, before: Float, after: Float) -> Deviations:
    """Standard deviations at all instants, from those at the nodes before and after their measurements.

    Parameters
    ----------
    states : States
    time : ndarray, shape (N + 1,)
    rows : ndarray of int, shape (K,)
        The nodes.
    before, after : ndarray, shape (K, n)

    Returns
    -------
    Deviations
        Interpolated linearly between two nodes.
    """
    whole = np.empty((len(time), len(states)))
    between_nodes(time, rows, before, after, whole)
    group = states.groups
    return Deviations(
        position=whole[:, group["position"]],
        velocity=whole[:, group["velocity"]],
        attitude=whole[:, group["attitude"]],
        gyro_bias=whole[:, group["gyro_bias"]],
        accelerometer_bias=whole[:, group["accelerometer_bias"]],
        wind=whole[:, group["wind"]] if "wind" in group else None,
        barometer_bias=whole[:, group["barometer_bias"]][:, 0] if "barometer_bias" in group else None,
    )


def _events(problem: Problem, settings: FilterSettings) -> _Events:
    """Usable measurements within the record, thinned as the settings say, in the order of time."""
    time = problem.imu.time
    parts = []
    for kind, aid in enumerate(KINDS):
        fixes = problem.aids.get(aid)
        if fixes is None:
            continue
        index = np.flatnonzero(usable(fixes) & (fixes.time >= time[0]) & (fixes.time <= time[-1]))
        interval = settings.least_interval.get(aid, 0.0) - 0.5 * median_interval(fixes)
        index = index[spaced(fixes.time[index], interval)]
        row = np.searchsorted(time, fixes.time[index], side="left")
        value = np.zeros((len(index), 4))
        value[:, : _values(fixes).shape[1]] = _values(fixes)[index]
        parts.append((row, np.full(len(index), kind), time[row] - fixes.time[index], value, index))
    if not parts:
        none = np.zeros(0, dtype=np.int64)
        return _Events(none, none, np.zeros(0), np.zeros((0, 4)), none)
    row, kinds, lag, value, index = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((kinds, -lag, row))
    return _Events(row[order], kinds[order].astype(np.int64), lag[order], value[order], index[order])


def _values(fixes: Fixes) -> Float:
    """Values as a table: one column where there is but one number a fix."""
    return np.asarray(fixes.value, dtype=np.float64).reshape(len(fixes.time), -1)


def usable(fixes: Fixes) -> Mask:
    """Fixes that are usable and finite."""
    return np.asarray(fixes.usable & np.isfinite(_values(fixes)).all(axis=1), dtype=np.bool_)


def median_interval(fixes: Fixes) -> float:
    """Between fixes [s]; 0 where there are less than two."""
    return float(np.median(np.diff(fixes.time))) if len(fixes.time) > 1 else 0.0


def _sensor_variance(settings: FilterSettings) -> Float:
    noise = settings.noise
    return np.square(
        [noise.velocity, noise.attitude, noise.coasted_velocity, noise.coasted_attitude], dtype=np.float64
    )


def _variances(settings: FilterSettings) -> Float:
    told = settings.measurement
    return np.square([*(getattr(told, aid) for aid in KINDS), told.sideslip], dtype=np.float64)


def _gates(settings: FilterSettings) -> Float:
    if settings.gate <= 0:
        return np.full(len(KINDS), np.inf)
    return np.asarray(chi2.isf(settings.gate, [_ROWS[aid] for aid in KINDS]), dtype=np.float64)


def _options(problem: Problem, settings: FilterSettings) -> Float:
    gnss = [problem.aids[aid] for aid in KINDS[:2] if aid in problem.aids]
    options = np.zeros(aids_kernel.OPTIONS)
    options[aids_kernel.LEVER_ARM : aids_kernel.LEVER_ARM + 3] = settings.lever_arm
    options[aids_kernel.LEAST_AIRSPEED] = settings.least_airspeed
    options[aids_kernel.CALIBRATION_TIME] = settings.calibration_time
    options[aids_kernel.OUTAGE] = settings.stale * max(
        (median_interval(fixes) for fixes in gnss), default=0.0
    )
    options[aids_kernel.CALIBRATES] = settings.states == 15
    options[aids_kernel.RESEAT_AFTER] = settings.reseat_after
    return options


def _room(nodes: int, n: int) -> History:
    return History(
        before=np.empty((nodes, 10)),
        factor=np.empty((nodes, n, n)),
        transition=np.empty((nodes, 15, 9)),
        sensor_noise=np.empty((nodes, 6, 9)),
        own_noise=np.empty((nodes, n)),
    )


def _navigation(
    problem: Problem,
    settings: FilterSettings,
    states: States,
    events: _Events,
    at: Integer,
    path: tuple[Float, Float, Float],
    kept: tuple[Float, Float, Float],
    innovations: tuple[Float, Float, Float, Float],
) -> Navigation:
    time, group = problem.imu.time, states.groups
    slow, before, after = kept
    held = np.repeat(slow, np.diff(np.append(at, len(time))), axis=0)
    used, by_aid = {}, {}
    for kind, aid in enumerate(KINDS):
        if aid in problem.aids:
            mine = events.kind == kind
            state = innovations[3][mine]
            used[aid] = aiding(time, problem.aids[aid], events.index[mine], state, settings.stale)
            by_aid[aid] = _innovations(problem.aids[aid], events.index[mine], mine, _ROWS[aid], innovations)
    return Navigation(
        method="filter",
        time=time,
        position=path[0],
        velocity=path[1],
        attitude=path[2],
        gyro_bias=held[:, group["gyro_bias"]],
        accelerometer_bias=held[:, group["accelerometer_bias"]],
        wind=held[:, group["wind"]] if "wind" in group else None,
        barometer_bias=held[:, group["barometer_bias"]][:, 0] if "barometer_bias" in group else None,
        used=used,
        deviations=deviations(states, time, at, before, after),
        innovations=by_aid,
    )


def _innovations(
    fixes: Fixes, index: Integer, mine: Mask, rows: int, innovations: tuple[Float, Float, Float, Float]
) -> Innovations:
    """Of one aid: the measurements that were tried."""
    value, sigma, normalised, state = innovations
    tried = state[mine] >= 0
    return Innovations(
        time=fixes.time[index][tried],
        value=value[mine][tried, :rows],
        sigma=sigma[mine][tried, :rows],
        normalised_squared=normalised[mine][tried],
        accepted=state[mine][tried] > 0,
    )


def aiding(time: Float, fixes: Fixes, index: Integer, state: Float, stale: float) -> Mask:
    """Whether an aid aids at each instant: its last fix was taken in, and is not stale.

    Parameters
    ----------
    time : ndarray, shape (N + 1,)
        [s].
    fixes : Fixes
    index : ndarray of int
        Those fixes that were tried, ascending; those between, if usable, count as the one before them.
    state : ndarray
        Of these: 1 accepted, else not.
    stale : float
        In median intervals of the fixes.

    Returns
    -------
    ndarray of bool, shape (N + 1,)
    """
    if len(fixes.time) == 0 or len(index) == 0:
        return np.zeros(len(time), dtype=np.bool_)
    before = np.searchsorted(index, np.arange(len(fixes.time)), side="right") - 1
    good = usable(fixes) & (before >= 0) & (state > 0)[np.maximum(before, 0)]
    last = np.searchsorted(fixes.time, time, side="right") - 1
    recent = time - fixes.time[np.maximum(last, 0)] <= stale * median_interval(fixes)
    return np.asarray((last >= 0) & good[np.maximum(last, 0)] & recent, dtype=np.bool_)


def covariances(filtered: Filtered) -> Float:
    """Covariances at the nodes, measurements taken in, shape (K, n, n), of a run that kept its history."""
    if filtered.history is None:
        raise ValueError("the run kept no history")
    factor = filtered.history.factor
    return np.asarray(factor.transpose(0, 2, 1) @ factor, dtype=np.float64)
