"""The steps of a rate table: found where the table held its rate, with honest standard errors."""

from __future__ import annotations

import numpy as np
import pytest
import rate_table_records as records

from pipeline.models import earth
from pipeline.models.rate_table_noise import standard_errors
from pipeline.models.rate_table_steps import (
    Motion,
    RateTableError,
    TableAxis,
    constant_stretches,
    measure_steps,
    quantum,
)

DEGREE = records.DEGREE
RATES = DEGREE * np.array([20.0, -20.0, 0.0, 50.0, -50.0, 3.0])
HOLD, STEP = 40.0, 0.02


def test_steps_are_the_stretches_of_constant_rate() -> None:
    time, rate, _ = records.table(records.corners(RATES, HOLD), STEP)
    found = constant_stretches(Motion.of_rate(time, rate), shortest=20.0, settling=2.0)
    assert len(found) == len(RATES)
    for (begin, end), held, number in zip(found, RATES, range(len(RATES)), strict=True):
        start = records.RAMP + number * (HOLD + records.RAMP)
        # a tenth of the shortest at either end counts as change
        assert start + 2.0 <= begin <= start + 4.0 + STEP
        turns = (end - begin) * abs(held) / (2 * np.pi)
        if abs(held) * (HOLD - 6.0) > 2 * np.pi:
            # to the tolerance of interpolation in the angle
            assert turns == pytest.approx(round(turns), abs=1e-6)
            assert turns > (HOLD - 6.0 - STEP) * abs(held) / (2 * np.pi) - 1
        else:
            assert start + HOLD - 2.0 - STEP <= end <= start + HOLD + STEP


@pytest.mark.parametrize("noise", [0.0, 1e-3 * DEGREE, 0.1 * DEGREE])
def test_rates_are_those_held(noise: float) -> None:
    rng = np.random.default_rng(3)
    time, rate, _ = records.table(records.corners(RATES, HOLD), STEP)
    motion = Motion.of_rate(time, rate + records.white(rng, rate.shape, noise))
    stretches = constant_stretches(motion, shortest=20.0, settling=1.0)
    steps = measure_steps(motion, stretches, time, np.stack([2.0 * rate + 0.1], axis=1))
    # the mean of 1000 samples or more, five standard deviations; noise-free the rounding of the angle
    np.testing.assert_allclose(steps.rate, RATES, atol=5 * noise / np.sqrt(1000) + 1e-11)
    np.testing.assert_allclose(steps.gyro[:, 0], 2.0 * RATES + 0.1, atol=1e-9)
    np.testing.assert_allclose(steps.duration, stretches[:, 1] - stretches[:, 0], atol=2 * STEP)


def test_the_turn_is_zero_over_whole_turns_and_that_of_the_encoder_at_rest() -> None:
    time, rate, angle = records.table(records.corners(RATES, HOLD), STEP)
    gyro = np.zeros((len(time), 1))
    stood = float(np.interp(3 * (HOLD + records.RAMP) - 1.0, time, angle)) + 0.7
    for motion, at_rest in (
        (Motion.of_angle(time, angle + 0.7), stood),
        (Motion.of_rate(time, rate), np.nan),
    ):
        stretches = constant_stretches(motion, shortest=20.0, settling=1.0)
        turn = measure_steps(motion, stretches, time, gyro).turn
        np.testing.assert_allclose(turn[2], [np.cos(at_rest), np.sin(at_rest)], atol=1e-9)
        # a sum over samples misses a whole turn by one sample of 900 at most
        np.testing.assert_allclose(turn[[0, 1, 3, 4]], 0.0, atol=1 / 900)


def test_a_ripple_of_the_table_is_no_noise_of_the_gyro() -> None:
    rng = np.random.default_rng(4)
    time, rate, _ = records.table(records.corners(RATES, HOLD), STEP)
    rippled = rate + 0.5 * DEGREE * np.sin(2 * np.pi * 0.7 * time)
    motion = Motion.of_rate(time, rippled)
    stretches = constant_stretches(motion, shortest=20.0, settling=1.0, tolerance=0.5 * DEGREE)
    sigma = 0.01 * DEGREE
    steps = measure_steps(motion, stretches, time, (rippled + records.white(rng, rate.shape, sigma))[:, None])
    expected = sigma / np.sqrt(steps.duration / STEP)
    # the noise level of 6 x 64 block means is known to 1 / sqrt(2 x 384) = 4 %, three times that
    np.testing.assert_allclose(steps.standard_error[:, 0], expected, rtol=0.12)


@pytest.mark.parametrize("warmed", [True, False])
def test_a_drift_with_the_temperature_or_with_time_is_no_noise_of_the_gyro(warmed: bool) -> None:
    rng = np.random.default_rng(5)
    time, rate, angle = records.table(records.corners(RATES, HOLD), STEP)
    temperature = 290.0 + 0.08 * time
    sigma = 0.01 * DEGREE
    # 25 and 50 deg/h over a step of a noise of 0.4 deg/h in its mean
    drift = (2e-3 * DEGREE + 5e-5 * rate) * (temperature - 290.0)
    gyro = (rate + drift + records.white(rng, rate.shape, sigma))[:, None]
    motion = Motion.of_angle(time, angle)
    stretches = constant_stretches(motion, shortest=20.0, settling=1.0)
    read = temperature + records.white(rng, time.shape, 0.05)
    steps = measure_steps(motion, stretches, time, gyro, read if warmed else None)
    expected = sigma / np.sqrt(steps.duration / STEP)
    # as in the test above
    np.testing.assert_allclose(steps.standard_error[:, 0], expected, rtol=0.12)
    # of the mean nothing is taken
    middle = (steps.start + steps.stop) / 2
    told = steps.gyro[:, 0] - steps.rate - (2e-3 * DEGREE + 5e-5 * steps.rate) * 0.08 * middle
    assert np.all(np.abs(told) < 5 * expected)


@pytest.mark.parametrize("rest", [30.0, 60.0, 300.0])
@pytest.mark.parametrize("bits", [12, 14, 17, 20, 24])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_an_encoder_that_rests_long_keeps_the_steps(rest: float, bits: int, noise: float) -> None:
    rates = DEGREE * np.array([20.0, -20.0, 100.0, 5.0])
    held = records.corners(rates, 12.0, 2.0)[1:] + np.array([rest, 0.0])
    after = held[-1, 0] + 2.0 + np.array([0.0, rest])
    at = np.concatenate([[[0.0, 0.0], [rest, 0.0]], held, np.stack([after, np.zeros(2)], axis=1)])
    time, _, angle = records.table(at, STEP)
    count = 2 * np.pi / 2**bits
    # of a count: far too little for the encoder to show any of it at rest
    shaken = angle + records.white(np.random.default_rng(6), angle.shape, noise * count)
    motion = Motion.of_angle(time, count * np.rint(shaken / count))
    # whole counts, by the rounding of an angle of 1e2 rad; a few, where the samples never differ by one
    counts = quantum(motion.angle) / count
    assert counts == pytest.approx(max(1, round(counts)), rel=1e-6)
    assert counts < 2 or bits == 24
    stretches = constant_stretches(motion, shortest=6.0, settling=0.0)
    told = measure_steps(motion, stretches, time, np.zeros((len(time), 1))).rate
    # two counts, of either end, over 6 s or more
    np.testing.assert_allclose(told, [0.0, *rates, 0.0], atol=2 * count / 6.0 + 1e-9)


def test_without_constant_rate_there_is_an_error() -> None:
    time = np.arange(0.0, 200.0, STEP)
    swing = Motion.of_rate(time, DEGREE * 50 * np.sin(2 * np.pi * time / 20))
    with pytest.raises(RateTableError, match="stretches of constant rate of at least 10 s") as caught:
        constant_stretches(swing, shortest=10.0, settling=0.0)
    assert caught.value.exit_code == 1
    with pytest.raises(RateTableError, match=r"a record of 199\.98 s"):
        constant_stretches(swing, shortest=2000.0, settling=0.0)


def test_a_gyro_without_samples_in_a_step_is_an_error() -> None:
    time, rate, _ = records.table(records.corners(RATES, HOLD), STEP)
    motion = Motion.of_rate(time, rate)
    stretches = constant_stretches(motion, shortest=20.0, settling=1.0)
    with pytest.raises(RateTableError, match="samples in each step"):
        measure_steps(motion, stretches, time + 1000.0, np.zeros((len(time), 1)))


def test_earth_rate_on_the_rotor() -> None:
    latitude = 50 * DEGREE
    U, c, s = earth.RATE, np.cos(latitude), np.sin(latitude)
    vertical = TableAxis(latitude, 0.0, 0.0)
    np.testing.assert_allclose(vertical.earth_rate, U * np.array([c, 0.0, s]), atol=1e-20)
    # axis 1 of the rotor looks West after a quarter turn to the left: it sees nothing of North
    quarter = vertical.on_rotor(np.array([[0.0, 1.0]]))[0]
    np.testing.assert_allclose(quarter, U * np.array([0.0, -c, s]), atol=1e-20)
    # a horizontal axis to the North sees the horizontal part
    north = TableAxis(latitude, 0.0, np.pi / 2)
    np.testing.assert_allclose(north.earth_rate, U * np.array([-s, 0.0, c]), atol=1e-20)
    # one to the East sees none
    assert TableAxis(latitude, np.pi / 2, np.pi / 2).earth_rate[2] == pytest.approx(0.0, abs=1e-20)
    assert TableAxis(latitude, 1.0, 0.7).across ** 2 + TableAxis(latitude, 1.0, 0.7).earth_rate[
        2
    ] ** 2 == pytest.approx(U**2, rel=1e-12)


NOISES = {
    # coloured over white standard deviation of a sample, correlation time in samples; band of the normalised
    # errors: 150 records of 7 stretches make the sample deviation good to 2 %, and the model is an average
    "white": (0.0, 1.0, (0.93, 1.07)),
    "mixed": (0.2, 40.0, (0.9, 1.15)),
    "quick": (0.5, 10.0, (0.9, 1.15)),
    "coloured alone": (1e3, 40.0, (0.75, 1.1)),
}


@pytest.mark.parametrize("kind", NOISES)
def test_standard_errors_of_means(kind: str) -> None:
    share, memory, (low, high) = NOISES[kind]
    rng = np.random.default_rng(5)
    normalised = []
    for _ in range(150):
        noise = records.white(rng, (7, 480, 1), 1.0)
        if share:
            noise += np.stack([records.coloured(rng, (480, 1), share, memory, 1.0) for _ in noise])
        normalised.append(noise.mean(axis=1) / standard_errors(list(noise)))
    assert low < np.std(normalised) < high


def test_stretches_of_plainly_different_noise_have_their_own_errors() -> None:
    rng = np.random.default_rng(6)
    sigma = np.array([1.0, 1.0, 10.0])
    errors = standard_errors([records.white(rng, (6400, 1), s) for s in sigma])
    # 64 blocks a stretch: 1 / sqrt(128) = 9 %, three times that
    np.testing.assert_allclose(errors[:, 0], sigma / 80.0, rtol=0.27)


def test_a_channel_that_never_changes_has_no_noise() -> None:
    assert np.all(standard_errors([np.full((100, 2), 3.0)] * 3) == 0.0)
