"""Navigation with closed loops of correction.

Panov, dissertation, Rybinsk (2007), (2.12) to (2.18), completed where the source leaves it open. Velocity and
position are corrected by differences from a reference, and so are the biases of accelerometers and gyros::

    V_b' = f - K d_b + C_kᵀ g - (ω_c + C_kᵀ ω_ie) x V_b        f = f_m - n̂,  n̂' = k_n K d_b
    V_g = C_k V_b,  V_kV = V_g - c_V,  V_k = V_kV - k_LV c_X,  L' = V_k,  L_k = L - c_X
    T c_X' = -c_X + k_L J_L dX,  T_V c_V' = -c_V + k_V J_V dV,  d_b = C_kᵀ (c_V + k_LV c_X)
    C' = C [ω_c x] - [(ω_ie + ω_en) x] C,  C_k = exp(-[c_U x]) C,  ω_c = ω - C_kᵀ K_U c_U
    T_U c_U' = -c_U + k_U J_U dU,  ω = ω_m - ω̂,  ω̂' = k_ω C_kᵀ K_U c_U

Which reference, and when:

- Position and velocity from satellites while they are valid; one without the other where only one is.
- In their outage ``V_ext = C_k V_a + ŵ`` with the air velocity V_a (air speed, and the angle of attack that
  the lift gives), the gains for air, n̂ frozen. The wind ŵ is the mean of ``V_k - C_k V_a`` while satellites
  are valid.
- Height always from the barometer, if there is one, less its bias, which satellites tell. Without them the
  bias is what the first reading and the height at the start tell.
- Attitude, dU the rotation vector of ``C_k C_refᵀ`` in N, E, D:

  ``A``: gravity seen by the accelerometers, ``g_b = V_a' + (ω + C_kᵀ ω_ie) x V_a - f_m``, filtered, gives the
  tilt: ``dU = (-ĝ_E, ĝ_N, .)`` with ``ĝ = C_k g_b/|g_b|``. Without air speed V_a = 0: right at rest, and
  where the vehicle accelerates ``|g_b|`` is not g, and it is not used. The magnetometer, levelled by C_k,
  gives the yaw.

  ``M``: the direction of the Earth's magnetic field first, gravity as in A second: C_ref takes the field to
  where it is seen exactly, and turns about it so that gravity fits best. Where gravity is not seen the turn
  about the field is not corrected. It does not mind a bias of the accelerometers so much, but the field's.

  ``X``: an external attitude.

  A component that nothing tells is not corrected. n̂ is never fed back into levelling.
- Any of the aids may be missing.

Validity is taken from the data: a fix counts if it is usable and within its gate, and until it is stale.
After an outage the integrators are set anew: ``L_k = L_ext``, ``V_k = V_ext``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models import _kernels_correction_aids as _aids
from pipeline.models import _kernels_correction_loops as _kernels
from pipeline.models.air_data import Lift
from pipeline.models.correction_gains import TUNED, Channel, ChannelGains, LoopGains, channels
from pipeline.models.correction_response import (
    FOLLOWING,
    REFERENCES,
    Analysis,
    Reference,
    Sampling,
    analyse,
    check,
)
from pipeline.models.navigation_errors import check_start, field_of, lost
from pipeline.models.navigation_problem import AidName, Fixes, Innovations, Navigation, Problem
from pipeline.units import STANDARD_GRAVITY

Float = NDArray[np.float64]
Integer = NDArray[np.int64]

AttitudeReference = Literal["A", "M", "X"]

AIDS: tuple[AidName, ...] = get_args(AidName)
"""In the order of the compiled loops."""

_IDLE: Mapping[AttitudeReference | None, tuple[AidName, ...]] = MappingProxyType(
    {
        "A": ("attitude",),
        "M": ("attitude",),
        "X": ("magnetic_field",),
        None: ("magnetic_field", "attitude"),
    }
)
"""Aids that drive no loop, by the reference of the attitude."""

_COMPONENTS = {"airspeed": 1, "altitude": 1}
"""Of an innovation, where it has not three."""


@dataclass(frozen=True, slots=True)
class Gate:
    """How far a fix may be from what is navigated: ``base + growth age + curvature age²/2``.

    Attributes
    ----------
    base, growth, curvature : float
        [m or m/s or rad], and that a second and a second squared; age is the time since the last fix that was
        accepted, so that after an outage more is believed.
    """

    base: float
    growth: float
    curvature: float = 0.0


@dataclass(frozen=True, slots=True)
class Gates:
    """Against a jump; wide, because the loops know no deviation of their own.

    Attributes
    ----------
    position, velocity, altitude, attitude : Gate
        Of the innovation.
    airspeed : Gate
        Of the change since the last: a catapult's acceleration at few readings a second passes.
    gravity, field : float
        Relative difference of the size of g_b from gravity, of the field's strength from the Earth's.
    """

    position: Gate = Gate(50.0, 5.0, 0.2)
    velocity: Gate = Gate(10.0, 0.2)
    altitude: Gate = Gate(30.0, 5.0)
    airspeed: Gate = Gate(15.0, 60.0)
    attitude: Gate = Gate(0.35, 0.02)
    gravity: float = 0.1
    field: float = 0.25


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How the loops correct.

    Attributes
    ----------
    gains : LoopGains
    attitude : str or None
        Reference ``A``, ``M`` or ``X``; None to leave the attitude as it is.
    reference : str
        What references of position and velocity do between fixes; see `correction_response`.
    wind_time_constant, barometer_time_constant : float
        Of the means of the wind and of the barometer's bias [s].
    gravity_time_constant : float
        Of the filter of g_b and of the lift [s].
    stale_intervals : float
        A fix is stale after so many usual intervals of its aid,
    stale_at_least : float
        but not before [s].
    reseat_after : float
        Outage after which the integrators are set anew [s].
    lift : Lift or None
        The lift curve; None for no angle of attack.
    gates : Gates
    """

    gains: LoopGains = TUNED
    attitude: AttitudeReference | None = "A"
    reference: Reference = "propagated"
    wind_time_constant: float = 180.0
    barometer_time_constant: float = 100.0
    gravity_time_constant: float = 1.0
    stale_intervals: float = 2.5
    stale_at_least: float = 0.5
    reseat_after: float = 10.0
    lift: Lift | None = field(default_factory=Lift)
    gates: Gates = field(default_factory=Gates)


def navigate(problem: Problem, settings: LoopSettings | None = None) -> Navigation:
    """Navigate with the loops, if they are stable.

    Parameters
    ----------
    problem : Problem
    settings : LoopSettings, optional

    Returns
    -------
    Navigation
        Method ``loops``, with the aids that drive one. Innovations have no deviations (NaN), and are NaN
        where a fix was not looked at because it is not usable, lies outside the record or another one
        followed in the same step.

    Raises
    ------
    CorrectionGainsError
        If a loop that may be at work is not stable; the limit by name.
    NavigationError
        At a pole, or if what is navigated is not a number.
    """
    settings = settings or LoopSettings()
    check_problem(problem, settings)
    return follow(problem, settings)


def check_problem(problem: Problem, settings: LoopSettings) -> None:
    """Refuse gains with which a loop is not stable at the problem's sampling period and its aids' intervals.

    Raises
    ------
    CorrectionGainsError
    """
    for channel, sampling in _sampled(problem, settings):
        check(channel, **sampling)


def analyses(problem: Problem, settings: LoopSettings) -> tuple[Analysis, ...]:
    """Limits, poles, damping, settling time and noise gain of every loop that may be at work.

    Raises
    ------
    CorrectionGainsError
        If a gain is not a positive number.
    """
    return tuple(analyse(channel, **sampling) for channel, sampling in _sampled(problem, settings))


def _driven(problem: Problem, settings: LoopSettings) -> Problem:
    """The problem with those aids alone that drive a loop."""
    aids = {name: fixes for name, fixes in problem.aids.items() if name not in _IDLE[settings.attitude]}
    return replace(problem, aids=aids)


def _sampled(problem: Problem, settings: LoopSettings) -> Iterator[tuple[Channel, Sampling]]:
    """The channels that may be at work, with the sampling period and the interval between their fixes."""
    problem = _driven(problem, settings)
    step = float(np.median(np.diff(problem.imu.time)))
    intervals = {name: _interval(fixes) for name, fixes in problem.aids.items()}
    for channel in channels(settings.gains, problem.aids):
        of_attitude = "attitude" in channel.driven_by
        if of_attitude and settings.attitude is None:
            continue
        # Differences of the attitude are propagated whatever is said of position and velocity.
        reference = "propagated" if of_attitude else settings.reference
        slowest = max((intervals[name] for name in channel.driven_by if name in intervals), default=step)
        yield channel, Sampling(step=step, interval=max(slowest, step), reference=reference)


def follow(problem: Problem, settings: LoopSettings) -> Navigation:
    """Navigate as the settings say, stable or not.

    Parameters and errors as for `navigate`, which see; unstable loops end as numbers that say so.
    """
    check_start(problem)
    problem = _driven(problem, settings)
    time = np.ascontiguousarray(problem.imu.time, dtype=np.float64)
    count, start = len(time), problem.start
    at, fix_time, fix_value, place = _fixes(problem, time)
    position, velocity, quaternion = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 4))
    position[0] = start.latitude, start.longitude, start.height
    velocity[0], quaternion[0] = start.velocity, start.attitude
    bias, correction, air = np.empty((count, 2, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    used = np.zeros((count, len(AIDS)), dtype=np.bool_)
    accepted = np.zeros(len(fix_time), dtype=np.bool_)
    innovation = np.full((len(fix_time), 3), np.nan)
    failed = _kernels.follow(
        time,
        np.ascontiguousarray(problem.imu.rotation),
        np.ascontiguousarray(problem.imu.velocity),
        at,
        fix_time,
        fix_value,
        np.array([_row(g) for g in _rows(settings.gains)]),
        _options(problem, settings),
        _gates(settings.gates),
        _stale(problem, settings),
        position,
        velocity,
        quaternion,
        bias,
        correction,
        air,
        used,
        accepted,
        innovation,
    )
    if failed >= 0:
        raise lost("loops", float(time[failed] - time[0]), float(position[failed - 1, 0]))
    return Navigation(
        method="loops",
        time=problem.imu.time,
        position=position,
        velocity=velocity,
        attitude=quaternion,
        gyro_bias=bias[:, 0].copy(),
        accelerometer_bias=bias[:, 1].copy(),
        wind=air[:, :2].copy() if "airspeed" in problem.aids else None,
        barometer_bias=air[:, 2].copy() if "altitude" in problem.aids else None,
        corrections={
            name: correction[:, i].copy() for i, name in enumerate(("position", "velocity", "attitude"))
        },
        used={name: used[:, AIDS.index(name)].copy() for name in problem.aids},
        innovations={
            name: _innovations(name, fixes, innovation[place[name]], accepted[place[name]])
            for name, fixes in problem.aids.items()
        },
    )


def _rows(gains: LoopGains) -> tuple[ChannelGains, ChannelGains, ChannelGains]:
    return gains.gnss, gains.outage, gains.attitude.channel


def _row(g: ChannelGains) -> tuple[float, ...]:
    return g.T, g.k_L, g.T_V, g.k_V, g.K, g.k_LV, g.k_n


def _fixes(problem: Problem, time: Float) -> tuple[Integer, Float, Float, dict[AidName, slice]]:
    """Which fix is used at which instant: of those of one step the last; instants, values, places by aid."""
    at = np.full((len(time), len(AIDS)), -1, dtype=np.int64)
    times, values, place, first = [np.empty(0)], [np.empty((0, 4))], {}, 0
    for aid, name in enumerate(AIDS):
        fixes = problem.aids.get(name)
        if fixes is None:
            continue
        value = np.atleast_2d(np.asarray(fixes.value, dtype=np.float64).reshape(len(fixes.time), -1))
        good = fixes.usable & np.isfinite(value).all(axis=1) & np.isfinite(fixes.time)
        good &= (fixes.time >= time[0]) & (fixes.time <= time[-1])
        index = np.flatnonzero(good)
        # Where a row is named twice the last one stays.
        at[np.searchsorted(time, fixes.time[index]), aid] = first + index
        times.append(fixes.time)
        values.append(np.pad(value, ((0, 0), (0, 4 - value.shape[1]))))
        place[name] = slice(first, first + len(value))
        first += len(value)
    return at, np.concatenate(times), np.ascontiguousarray(np.concatenate(values)), place


def _interval(fixes: Fixes) -> float:
    """The usual interval between fixes [s]; 0 where there are fewer than two."""
    between = np.diff(fixes.time)
    return float(np.median(between)) if between.size else 0.0


def _stale(problem: Problem, settings: LoopSettings) -> Float:
    """Seconds after which a fix of each aid is stale."""
    usual = [_interval(problem.aids[name]) if name in problem.aids else 0.0 for name in AIDS]
    return np.maximum(settings.stale_at_least, settings.stale_intervals * np.array(usual))


def _gates(gates: Gates) -> Float:
    """One row an aid; that of the magnetic field is among the options."""
    found = np.zeros((len(AIDS), 3))
    for name in ("position", "velocity", "altitude", "airspeed", "attitude"):
        gate: Gate = getattr(gates, name)
        found[AIDS.index(name)] = gate.base, gate.growth, gate.curvature
    return found


def _options(problem: Problem, settings: LoopSettings) -> Float:
    """The options in the order of the compiled loops."""
    options = np.zeros(_aids.OPTIONS)
    attitude = {None: _aids.NO_REFERENCE, "A": _aids.BY_GRAVITY, "M": _aids.BY_FIELD, "X": _aids.EXTERNAL}
    options[_aids.REFERENCE_OF_ATTITUDE] = attitude[settings.attitude]
    options[_aids.REFERENCE] = REFERENCES.index(settings.reference)
    options[_aids.WIND_CONSTANT] = settings.wind_time_constant
    options[_aids.BAROMETER_CONSTANT] = settings.barometer_time_constant
    options[_aids.GRAVITY_CONSTANT] = settings.gravity_time_constant
    options[_aids.RESEAT_AFTER] = settings.reseat_after
    options[_aids.FOLLOWING] = FOLLOWING
    fastest = max(max((1 + g.k_L) / g.T, (1 + g.k_V) / g.T_V, g.K + g.k_LV) for g in _rows(settings.gains))
    # A quarter of the fastest time constant: the fourth order errs by 1e-5 of what a step corrects.
    options[_aids.LONGEST] = 0.25 / fastest
    options[_aids.GRAVITY_GATE] = settings.gates.gravity
    options[_aids.FIELD_GATE] = settings.gates.field
    if settings.lift is not None:
        lift = settings.lift
        slope = (lift.cruise - lift.zero_lift) * lift.cruise_speed**2 / STANDARD_GRAVITY
        options[_aids.ZERO_LIFT], options[_aids.LIFT] = lift.zero_lift, slope
        options[_aids.STALL_SQUARED] = lift.stall_speed**2
    else:
        options[_aids.STALL_SQUARED] = 1.0
    options[_aids.FIELD : _aids.FIELD + 3] = field_of(problem)
    return options


def _innovations(name: AidName, fixes: Fixes, value: Float, accepted: NDArray[np.bool_]) -> Innovations:
    value = value[:, : _COMPONENTS.get(name, 3)].copy()
    return Innovations(
        time=fixes.time,
        value=value,
        sigma=np.full_like(value, np.nan),
        normalised_squared=np.full(len(value), np.nan),
        accepted=accepted.copy(),
    )
