"""Six static positions and turns by known angles, on simulated truth and on recordings of others."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import rate_table_records as records

from pipeline.models import earth
from pipeline.models.multi_position import (
    SIX_POSITIONS,
    Turn,
    observe_positions,
    observe_turns,
    position,
)
from pipeline.models.rate_table_observations import joined
from pipeline.models.rate_table_steps import RateTableError
from pipeline.models.rate_table_triad import Triad, fit_triad
from pipeline.numerics.sampling import runs

DEGREE = records.DEGREE
LATITUDE = 50 * DEGREE
S = np.array([[1.003, 0.002, -0.001], [0.0015, 0.998, 0.0025], [-0.002, 0.0005, 1.001]])


def test_positions_are_right_handed_and_point_where_they_say() -> None:
    for up, north in SIX_POSITIONS:
        C = position(up, north)
        np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(C) == pytest.approx(1.0, abs=1e-15)
        assert C[abs(up) - 1, 2] == np.sign(up)
        assert C[abs(north) - 1, 1] == np.sign(north)
    np.testing.assert_array_equal(position(3, 2), np.eye(3))
    with pytest.raises(ValueError, match="both up and north"):
        position(1, -1)


@cache
def six_positions(seed: int, tilt: float) -> Triad:
    """A gyro of 0.01 deg/sqrt(h), ten minutes at 1 Hz in each position, which is known to ``tilt`` [rad]."""
    rng = np.random.default_rng(seed)
    u = earth.RATE * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    stretches = []
    positions = [position(up, north) for up, north in SIX_POSITIONS]
    for C in positions:
        w = C @ u
        w = w + np.cross(records.white(rng, (3,), tilt), w)
        stretches.append(S @ w + BIAS + records.white(rng, (600, 3), 0.01 * DEGREE / 60))
    observed = observe_positions(stretches, positions, latitude=LATITUDE, orientation_error=tilt)
    return fit_triad(observed)


BIAS = DEGREE / 3600 * np.array([0.5, -1.0, 0.2])
TRUTH = np.concatenate([S.ravel(), BIAS])


@pytest.mark.parametrize("tilt", [0.0, 1e-3])
def test_six_positions_tell_s_and_b(tilt: float) -> None:
    fits = [six_positions(seed, tilt) for seed in range(60)]
    errors = np.array([(fit.value - TRUTH) / fit.standard_error for fit in fits])
    # 720 values: 2.6 %, three and a half times that
    assert 0.91 < errors.std() < 1.09
    # 0.01 deg/sqrt(h) over ten minutes is 0.025 deg/h of 15: 0.0016, by two opposite positions and the rest
    assert np.all(fits[0].standard_error[:9] < 0.002)
    assert fits[0].determined


def turned(rng: np.random.Generator, spread: float, slip: float) -> tuple[np.ndarray, np.ndarray, list[Turn]]:
    """Turns of two rounds by hand about each axis, rest between; rates nobody knows."""
    step, rest, length = 0.01, 5.0, 6.0
    gyro, turns, clock = [], [], 0.0
    for axis in (*np.eye(3), *-np.eye(3)):
        gyro.append(np.zeros((int(rest / step), 3)))
        turns.append(Turn(clock + 0.2, clock + rest - 0.2, axis, 0.0))
        clock += rest
        # any course from rest to rest: a raised cosine, skewed at random, of the whole angle
        t = np.arange(0.0, length, step)
        shape = (1 - np.cos(2 * np.pi * t / length)) * (
            1 + rng.uniform(-0.5, 0.5) * np.sin(np.pi * t / length)
        )
        angle = 4 * np.pi + rng.standard_normal() * slip
        true_axis = axis + np.cross(records.white(rng, (3,), spread), axis)
        gyro.append(np.outer(shape / (shape.sum() * step) * angle, true_axis))
        turns.append(Turn(clock - 0.1, clock + length + 0.1, axis, 4 * np.pi, slip, spread))
        clock += length
    rate = np.concatenate([*gyro, np.zeros((int(rest / step), 3))])
    time = step * np.arange(len(rate))
    output = rate @ S.T + 1000 * BIAS + records.white(rng, rate.shape, 0.05 * DEGREE)
    return time, output, turns


@pytest.mark.parametrize(("spread", "slip"), [(0.0, 0.0), (2e-3, 5e-3)])
def test_turns_tell_s_and_b_whatever_the_rate_was(spread: float, slip: float) -> None:
    truth = np.concatenate([S.ravel(), 1000 * BIAS])
    errors = []
    for seed in range(60):
        fit = fit_triad(observe_turns(*turned(np.random.default_rng(seed), spread, slip)))
        errors.append((fit.value - truth) / fit.standard_error)
    # 720 values, of which the three gyros of a turn share the slip: 3.5 %, three times that
    assert 0.89 < np.std(errors) < 1.11


def test_turns_and_positions_join() -> None:
    time, output, turns = turned(np.random.default_rng(3), 0.0, 0.0)
    together = joined([observe_turns(time, output, turns[:6]), observe_turns(time, output, turns[6:])])
    whole = observe_turns(time, output, turns)
    np.testing.assert_allclose(together.output, whole.output, rtol=1e-12)
    # the noise of each part is from its own rests
    np.testing.assert_allclose(fit_triad(together).S, fit_triad(whole).S, atol=1e-4)


def test_turns_without_rest_or_samples_are_errors() -> None:
    time, output, turns = turned(np.random.default_rng(5), 0.0, 0.0)
    with pytest.raises(RateTableError, match="rest before, between or after") as caught:
        observe_turns(time, output, [turn for turn in turns if turn.angle])
    assert caught.value.exit_code == 1
    with pytest.raises(RateTableError, match="samples of the gyro"):
        observe_turns(time, output, [Turn(1e4, 2e4, np.eye(3)[0], 0.0)])


def moved(time: np.ndarray, gyro: np.ndarray, threshold: float, shortest: float) -> np.ndarray:
    """Start and stop [s] of stretches in which the case turned, with a margin for slow ends, shape (m, 2).

    Rests that are shorter than ``shortest`` [s] are none, nor are stretches; the gyro's median is its bias.
    """
    moving = runs(np.linalg.norm(gyro - np.median(gyro, axis=0), axis=1) > threshold)
    start, stop = time[moving.start], time[moving.stop - 1]
    apart = start[1:] - stop[:-1] > shortest
    ends = np.stack([start[np.append(True, apart)], stop[np.append(apart, True)]], axis=1)
    ends = ends[ends[:, 1] - ends[:, 0] >= shortest] + np.array([-shortest, shortest])
    return np.clip(ends, time[0], time[-1])


BY_HAND = {"angle_error": 2 * DEGREE, "axis_error": 1 * DEGREE}
"""What a turn by hand on a desk is good to."""


def test_a_session_of_others_turned_by_hand(shared_data: Path) -> None:
    """imucal, Ferraris session at 102.4 Hz in deg/s: one round the negative way about each axis."""
    table = np.genfromtxt(shared_data / "turntable/imucal_ferraris_session.csv", delimiter=",", skip_header=1)
    time, gyro = table[:, 0] / 102.4, table[:, 1:4] * DEGREE
    moves = moved(time, gyro, threshold=5 * DEGREE, shortest=0.5)
    assert len(moves) == 12  # nine changes of position among them
    rounds = moves[[7, 9, 11]]
    turns = [Turn(*ends, axis, -2 * np.pi, **BY_HAND) for ends, axis in zip(rounds, np.eye(3), strict=True)]
    between = np.stack([moves[6:-1, 1], moves[7:, 0]], axis=1)
    turns += [Turn(*ends, np.eye(3)[0], 0.0) for ends in between]
    fit = fit_triad(observe_turns(time, gyro, turns))
    told = fit.decomposed()
    scale = told.value[:3]
    # what the turns by hand are good to, 3 standard errors of 0.6 %, and a MEMS gyro's own few per cent
    assert np.all(np.abs(scale - 1) < 0.05)
    assert np.all(told.standard_error[:3] < 0.01)
    # input axes of one chip are orthogonal to a degree, known to 1.4 degrees here
    assert np.all(np.abs(told.value[9:12]) < 3 * DEGREE)
    # quarter turns between the rounds, which the calibration did not see: again by hand
    corrected, _ = fit.apply(gyro)
    for move, axis in ((8, 2), (10, 0)):
        inside = (time >= moves[move, 0]) & (time <= moves[move, 1])
        angle = np.trapezoid(corrected[inside], time[inside], axis=0) / DEGREE
        assert angle[axis] == pytest.approx(-90.0, abs=3 * 2.0)
    # and the bias that of the rests
    np.testing.assert_allclose(fit.bias / DEGREE, np.median(gyro, axis=0) / DEGREE, atol=0.05)


def test_a_session_of_others_in_counts(shared_data: Path) -> None:
    """imucal, annotated session at 204.8 Hz in counts of 2000/32768 deg/s: one round about each axis."""
    with (shared_data / "turntable/imucal_annotated_session.csv").open() as lines:
        rows = [line.split(",") for line in lines][1:]
    part = np.array([row[0] for row in rows])
    gyro = np.array([[float(v) for v in row[5:8]] for row in rows])
    # one section after the other, as if recorded in a row: each is a record of its own
    time = np.arange(len(gyro)) / 204.8

    def ends(name: str) -> tuple[float, float]:
        inside = time[part == name]
        return float(inside[0]), float(inside[-1])

    turns = [
        Turn(*ends(f"{axis}_rot"), e, 2 * np.pi, **BY_HAND) for axis, e in zip("xyz", np.eye(3), strict=True)
    ]
    turns += [Turn(*ends(f"{axis}_{way}"), np.eye(3)[0], 0.0) for axis in "xyz" for way in "ap"]
    fit = fit_triad(observe_turns(time, gyro, turns))
    counts = fit.decomposed().value[:3] * DEGREE
    # 16.384 counts to a degree a second by its data sheet
    np.testing.assert_allclose(counts / 16.384, 1.0, atol=0.03)
    # the bias of six rests agrees to a tenth of a count or so: 0.01 deg/s
    assert np.abs(fit.residual[3:]).max() < 0.5


def test_a_quarter_turn_of_others(shared_data: Path) -> None:
    """tomisuarez2, MPU-6050 at 100 Hz, 131 counts to a degree a second: a quarter turn about axis 1."""
    path = shared_data / "turntable/tomi_mpu6050_90deg_x_rot.csv"
    gyro = np.genfromtxt(path, delimiter=",", skip_header=5)[:, 3:] / 131 * DEGREE
    time = np.arange(len(gyro)) / 100
    moves = moved(time, gyro, threshold=3 * DEGREE, shortest=0.4)
    assert len(moves) == 1
    rests = [Turn(0.0, moves[0, 0], np.eye(3)[0], 0.0), Turn(moves[0, 1], time[-1], np.eye(3)[0], 0.0)]
    quarter = Turn(*moves[0], np.eye(3)[0], np.pi / 2, **BY_HAND)
    observed = observe_turns(time, gyro, [quarter, *rests])
    bias = observed.output[1:].mean(axis=0)
    angle = (observed.output[0] - bias) * (quarter.stop - quarter.start)
    # 3 % of scale factor by its data sheet
    assert angle[0] == pytest.approx(np.pi / 2, rel=0.03)
    with pytest.raises(RateTableError, match="at least 4 mean rates"):
        fit_triad(observed)
