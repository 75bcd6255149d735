"""Calibration of a triad without a rate table: static positions, and turns by known angles.

Static positions: at rest the triad sees the Earth's rate, ``w = C (0, U cos phi, U sin phi)`` with C from
(East, North, Up) to the case; six positions, each axis up and down, tell S and b of gyros that see it well.

Turns (after Ferraris, Grimaldi & Parvis, *Sensors and Materials* 7 (1995) 311-330): the case is turned by a
known angle A about a known axis a, by hand or by a table whose rate nobody recorded. Whatever the rate was,
the integrals are ::

    int y dt = S (a A + w_E t) + b t

as if the rate had been ``a A / t + w_E`` throughout. Rest, A = 0, tells b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.models import earth
from pipeline.models.rate_table_noise import noise_of_means, standard_errors
from pipeline.models.rate_table_observations import Observations, joined, turned_by
from pipeline.models.rate_table_steps import RateTableError

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Turn:
    """A stretch of a record in which the case turned by a known angle, or rested.

    Attributes
    ----------
    start, stop : float
        [s]; at rest at either end.
    axis : ndarray, shape (3,)
        Unit vector in the axes of the case, right-handed.
    angle : float
        [rad]; 0 for rest.
    angle_error, axis_error : float
        Standard deviations of the angle, and of the axis about either direction across it [rad].
    earth_rate : ndarray, shape (3,)
        Mean of the Earth's rate in the axes of the case [rad/s]; zero where the gyros are too poor to see it.
    """

    start: float
    stop: float
    axis: Float
    angle: float
    angle_error: float = 0.0
    axis_error: float = 0.0
    earth_rate: Float = field(default_factory=lambda: np.zeros(3))


def position(up: int, north: int) -> Float:
    """Matrix from (East, North, Up) to the case in a position.

    Parameters
    ----------
    up, north : int
        Which axis of the case points there: 1 to 3, or -1 to -3 for its opposite.

    Returns
    -------
    ndarray, shape (3, 3)

    Raises
    ------
    ValueError
        If both are the same axis.
    """
    if abs(up) == abs(north):
        raise ValueError(f"axis {abs(up)} of the case cannot point both up and north")
    U, N = (np.sign(axis) * np.eye(3)[abs(axis) - 1] for axis in (up, north))
    return np.stack([np.cross(N, U), N, U], axis=1)


SIX_POSITIONS = tuple((up, up % 3 + 1) for up in (1, 2, 3)) + tuple((-up, up % 3 + 1) for up in (1, 2, 3))
"""Each axis up and down, with the one after it to the North: pairs for `position`."""


def observe_positions(
    stretches: Sequence[Float], positions: Sequence[Float], *, latitude: float, orientation_error: float
) -> Observations:
    """Mean outputs at rest against the Earth's rate.

    Parameters
    ----------
    stretches : sequence of ndarray, each of shape (n_i, 3)
        Outputs in each position, in a row.
    positions : sequence of ndarray, each of shape (3, 3)
        From (East, North, Up) to the case.
    latitude : float
        [rad].
    orientation_error : float
        Standard deviation of each position about each axis [rad].
    """
    u = earth.RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    errors = standard_errors(stretches)
    parts = []
    for number, (stretch, C, error) in enumerate(zip(stretches, positions, errors, strict=True)):
        rate = (C @ u)[np.newaxis]
        unknown, names = turned_by(rate, orientation_error, f"position_{number}")
        parts.append(Observations(rate, stretch.mean(axis=0)[np.newaxis], error[np.newaxis], unknown, names))
    return joined(parts)


def observe_turns(time: Float, gyro: Float, turns: Sequence[Turn]) -> Observations:
    """Integrals of outputs over turns by known angles, and over rest between them.

    The noise is that of rest: while the case turns the outputs vary by right.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Strictly increasing, without a gap within a turn [s].
    gyro : ndarray, shape (n, 3)
    turns : sequence of Turn
        Rest among them, for the bias and its noise.

    Raises
    ------
    RateTableError
        If there is no rest, or a turn has less than two samples.
    """
    places = [_samples(time, turn) for turn in turns]
    rest = [place for place, turn in zip(places, turns, strict=True) if turn.angle == 0]
    if not rest:
        raise RateTableError(
            "turns",
            expected="rest before, between or after the turns, for the bias",
            found="none",
            remedy="name a stretch in which the case rests",
        )
    noise = noise_of_means([gyro[place] for place in rest])
    parts = []
    for number, (place, turn) in enumerate(zip(places, turns, strict=True)):
        t = time[place]
        mean = np.trapezoid(gyro[place], t, axis=0) / (t[-1] - t[0])
        error = np.array([channel.standard_error(len(t)) for channel in noise])
        known = (turn.angle / (t[-1] - t[0]) * turn.axis)[np.newaxis]
        unknown, names = _unknown(turn, known, t[-1] - t[0], number)
        rate = known + turn.earth_rate
        parts.append(Observations(rate, mean[np.newaxis], error[np.newaxis], unknown, names))
    return joined(parts)


def _samples(time: Float, turn: Turn) -> slice:
    place = slice(
        int(np.searchsorted(time, turn.start, side="left")),
        int(np.searchsorted(time, turn.stop, side="right")),
    )
    if place.stop - place.start < 2:
        raise RateTableError(
            f"turn, {turn.start:.6g} s to {turn.stop:.6g} s",
            expected="samples of the gyro",
            found=f"{place.stop - place.start}",
            remedy="check the times against those of the record",
        )
    return place


def _unknown(turn: Turn, known: Float, length: float, number: int) -> tuple[Float, tuple[str, ...]]:
    """What the errors of angle and axis add to the mean rate, and their names."""
    turned, names = turned_by(known, turn.axis_error if turn.angle else 0.0, f"turn_{number}")
    if not turn.angle_error or not turn.angle:
        return turned, names
    along = (turn.angle_error / length * turn.axis)[np.newaxis, :, np.newaxis]
    return np.concatenate([turned, along], axis=2), (*names, f"angle_turn_{number}")
