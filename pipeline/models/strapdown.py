"""Strapdown navigation: samples of gyros and accelerometers to increments, increments to a trajectory.

Attitude C and velocity increment u within a step obey ``C' = C [ω x]``, ``u' = C f``: together one motion
of a rigid body, whose Magnus series of order four (Blanes, Casas, Oteo & Ros, Physics Reports 470, 2009,
section 5.4) is, with the integrals α, υ of rate and force over the step h and their first moments β, σ about
its middle, divided by h::

    φ = α + α × β                       (the term of coning)
    η = υ + α × σ + υ × β               (those of sculling)
    u = η + (1 - cos φ)/φ² φ × η + (φ - sin φ)/φ³ φ × (φ × η)                 (rotation, exact)

For rate and force linear in time these are the terms of Savage, J. Guidance, Control, and Dynamics 21 (1998),
19-28 and 208-221, with β = h (ω1 - ω0)/12. The integrals:

`increments`, from instantaneous samples
    ``α = h (ω0 + ω1)/2 - h³ κ/12``: the trapezoid of the linear model, and what curvature κ takes from it,
    found from four samples so that a cubic is integrated exactly.
`from_increments`, from samples that are integrals already
    ``β = h² ω'/12`` with the slope ω' in the middle of the parabola that has the integrals of the step and of
    both its neighbours; at an end, beside a gap, of the line through two.

Both are of fourth order in the sampling interval, be it even or not. Where samples are missing or not
numbers, rate and force are interpolated linearly, in steps of the usual length, marked as `coasted`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.models import _inertial_samples as _samples
from pipeline.models import _kernels_strapdown as _kernels
from pipeline.models.navigation_errors import check_start, lost
from pipeline.models.navigation_problem import Imu, Navigation, Problem
from pipeline.numerics.rotation import euler_krylov_from_quaternion, quaternion_from_euler_krylov

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SIGNS = np.array([1.0, -1.0, 1.0])
"""Of yaw, pitch and roll against psi, theta and gamma."""


def increments(
    time: Float, rate: Float, force: Float, *, max_step: float | None = None, max_coast: float = 1.0
) -> Imu:
    """Increments over the intervals between instantaneous samples.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Instants of the samples, strictly increasing [s].
    rate : ndarray, shape (n, 3)
        Angular rate about body axes [rad/s]; NaN where it is not usable.
    force : ndarray, shape (n, 3)
        Specific force in body axes [m/s^2]; NaN where it is not usable. Rate and force are judged and bridged
        each by itself.
    max_step : float, optional
        A longer interval is a gap and is filled with steps of the median length [s]; 1.8 medians if None.
    max_coast : float, optional
        Longest time from one usable sample to the next that is bridged [s].

    Returns
    -------
    Imu
        From the first to the last instant at which both rate and force are usable.

    Raises
    ------
    NavigationError
        If the instants do not increase, fewer than two samples are usable, or a gap is longer than max_coast.
    """
    t = _samples.instants(time)
    good = np.stack([_samples.numbers(rate), _samples.numbers(force)])
    kept = _samples.between_usable(good[0] & good[1], 2)
    t, good = t[kept], good[:, kept]
    usual, longest = _samples.usual_and_longest(t, max_step)
    for name, usable in zip(("gyros", "accelerometers"), good, strict=True):
        _samples.refuse_gaps(name, t[usable][:-1], t[usable][1:], max(max_coast, longest))
    grid, index = _samples.filled(t, usual, longest)
    sound = np.zeros((2, len(grid)), dtype=np.bool_)
    sound[:, index] = good
    integrals, moments = [], []
    for value, measured, usable in zip((rate[kept], force[kept]), good, sound, strict=True):
        everywhere = _samples.bridged(grid, t[measured], value[measured])
        integral, moment = _samples.of_samples(grid, everywhere, usable)
        integrals.append(integral)
        moments.append(moment)
    both = sound[0] & sound[1]
    return _imu(grid, integrals, moments, ~(both[:-1] & both[1:]))


def from_increments(
    time: Float,
    angle_increments: Float,
    velocity_increments: Float,
    *,
    max_step: float | None = None,
    max_coast: float = 1.0,
) -> Imu:
    """Increments from the integrals that integrating sensors give: coning, sculling and rotation added.

    Parameters
    ----------
    time : ndarray, shape (n + 1,)
        Ends of the intervals, strictly increasing [s]; the first sample began at the first of them.
    angle_increments : ndarray, shape (n, 3)
        Integrals of the angular rate about body axes [rad]; NaN where not usable.
    velocity_increments : ndarray, shape (n, 3)
        Integrals of the specific force in body axes [m/s]; NaN where not usable.
    max_step : float, optional
        A sample over a longer interval [s] is not used, for nothing tells whether it holds all of it or only
        its end; 1.8 medians if None.
    max_coast : float, optional
        Longest time without a usable sample that is bridged [s].

    Returns
    -------
    Imu
        From the beginning of the first usable sample to the end of the last.

    Raises
    ------
    NavigationError
        If the instants do not increase, no sample is usable, or a gap is longer than max_coast.
    """
    t = _samples.instants(time)
    usual, longest = _samples.usual_and_longest(t, max_step)
    good = (
        _samples.numbers(angle_increments) & _samples.numbers(velocity_increments) & (np.diff(t) <= longest)
    )
    kept = _samples.between_usable(good, 1)
    t, good = t[kept.start : kept.stop + 1], good[kept]
    _samples.refuse_gaps("gyros and accelerometers", t[1:][good][:-1], t[:-1][good][1:], max_coast)
    grid, index = _samples.filled(t, usual, longest)
    h, middle = np.diff(grid), (grid[1:] + grid[:-1]) / 2
    usable = np.zeros(len(h), dtype=np.bool_)
    usable[index[:-1][good]] = True  # a usable sample is one step of the grid
    integrals, moments = [], []
    for value in (angle_increments[kept], velocity_increments[kept]):
        mean = _samples.bridged(middle, middle[usable], value[good] / h[usable, np.newaxis])
        integrals.append(mean * h[:, np.newaxis])
        moments.append(_samples.slopes(h, mean, usable) * np.square(h)[:, np.newaxis] / 12)
    return _imu(grid, integrals, moments, ~usable)


def _imu(time: Float, integrals: list[Float], moments: list[Float], coasted: Mask) -> Imu:
    """φ and u from the integrals α, υ and the moments β, σ."""
    rotation, velocity = np.empty_like(integrals[0]), np.empty_like(integrals[0])
    (alpha, upsilon), (beta, sigma) = integrals, moments
    _kernels.increments(alpha, upsilon, beta, sigma, rotation, velocity)
    return Imu(time, rotation, velocity, coasted)


def navigate(problem: Problem) -> Navigation:
    """Navigate with the inertial sensors alone.

    Parameters
    ----------
    problem : Problem
        Its aids are not looked at.

    Returns
    -------
    Navigation
        Of method ``strapdown``; longitude is continuous and may leave [-pi, pi].

    Raises
    ------
    NavigationError
        If the start is no number, or the way leads to a pole.
    """
    check_start(problem)
    imu, start = problem.imu, problem.start
    count = len(imu) + 1
    position, velocity, attitude = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 4))
    position[0] = start.latitude, start.longitude, start.height
    velocity[0] = start.velocity
    attitude[0] = start.attitude / np.linalg.norm(start.attitude)
    row = _kernels.navigate(np.diff(imu.time), imu.rotation, imu.velocity, position, velocity, attitude)
    if row >= 0:
        raise lost("strapdown navigation", imu.time[row] - imu.time[0], position[row - 1, 0])
    bias = np.zeros((count, 3))
    return Navigation("strapdown", imu.time, position, velocity, attitude, bias, bias.copy())


def yaw_pitch_roll(quaternion: ArrayLike) -> Float:
    """Yaw from north to east, pitch up and roll to the right, of attitudes.

    ``C = R3(yaw) R2(pitch) R1(roll)``, accurate up to pitch = ±90°: see
    `pipeline.numerics.rotation.euler_krylov_from_quaternion`, whose axes 2 and 3 are 3 and -2 here.

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        Body axes to N, E, D; need not be exactly unit.

    Returns
    -------
    ndarray, shape (..., 3)
        Yaw and roll in [-pi, pi], pitch in [-pi/2, pi/2] [rad].
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    return np.asarray(euler_krylov_from_quaternion(np.stack([w, x, z, -y], axis=-1)) * _SIGNS)


def quaternion_from_yaw_pitch_roll(angles: ArrayLike) -> Float:
    """Attitudes, shape (..., 4), from yaw, pitch and roll [rad], shape (..., 3)."""
    w, x, y, z = np.moveaxis(quaternion_from_euler_krylov(np.asarray(angles) * _SIGNS), -1, 0)
    return np.stack([w, x, -z, y], axis=-1)
