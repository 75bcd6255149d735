import numpy as np
import pytest
import wandering
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.numerics.alignment import (
    Cumulative,
    Increments,
    correlation,
    covered,
    gain,
    integrals_of_rate,
    wahba,
)
from pipeline.numerics.alignment_fit import Fit, fit
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_from_euler_krylov,
    quaternion_from_rotation_vector,
    quaternion_multiply,
)

Float = np.ndarray
OFFSET = 0.0237  # s
MOUNTING = (0.2, -0.3, 0.5)  # rad, from case to body
BIAS = np.array([0.01, -0.02, 0.005])  # rad/s
DURATION = 20.0  # s


def records(
    seed: int, rates_noise: float, angle_noise: float, *, rate: float = 100.0, reference_rate: float = 50.0
) -> tuple[Increments, Cumulative]:
    """A gyro with clock offset, mounting, bias and noise, and its reference."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(DURATION * rate)) / rate
    measured = (
        wandering.rates(t) @ wandering.matrix(MOUNTING) + BIAS + rates_noise * rng.normal(size=(len(t), 3))
    )
    at = np.arange(int(DURATION * reference_rate)) / reference_rate
    attitude = quaternion_from_euler_krylov(wandering.angles(at))
    error = quaternion_from_rotation_vector(angle_noise * rng.normal(size=(len(at), 3)))
    return integrals_of_rate(at, quaternion_multiply(attitude, error)), Cumulative.of_rates(
        t + OFFSET, measured
    )


def level(start: Float, stop: Float, angle: Float) -> Increments:
    """Increments of a reference whose axes are taken not to turn."""
    return Increments(start, stop, angle, np.broadcast_to(np.eye(3), (len(start), 3, 3)))


def estimate(reference: Increments, gyro: Cumulative) -> Fit:
    """The search and the fit, as the stage does them."""
    found = correlation(reference, gyro, 1.0, rotated=True)
    lag = float(found.lag[found.best])
    part = reference.only(covered(reference, gyro.time, lag, 0.07, 0.1))
    x, y = part.angle, gyro.over(part.start + lag, part.stop + lag)
    guess = wahba((x - x.mean(axis=0)).T @ (y - y.mean(axis=0)))
    return fit(part, gyro, lag, guess, free_offset=True, free_rotation=True)


def test_integrals_of_rate_are_those_of_the_motion() -> None:
    """Without the term of the second order they were wrong by up to 4e-6 rad here."""
    t = np.arange(2000) / 50
    found = integrals_of_rate(t, quaternion_from_euler_krylov(wandering.angles(t)))
    exact = Cumulative.of_rates(np.arange(40_001) / 1000, wandering.rates(np.arange(40_001) / 1000))
    # What is left is of the fourth order; at the two ends, where the gradient is one-sided, of the third.
    wrong = np.abs(found.angle - exact.over(found.start, found.stop))
    assert wrong[1:-1].max() < 1e-7
    assert wrong.max() < 1e-6


def test_increments_give_the_same_cumulative_angle_as_rates() -> None:
    t = np.arange(4000) / 100
    rates = Cumulative.of_rates(t, wandering.rates(t))
    increments = np.diff(rates.angle, axis=0, prepend=0)
    other = Cumulative.of_increments(t, increments)
    a, b = np.array([1.003, 7.77]), np.array([1.5, 20.123])
    # Two quintic splines of motions up to 2 Hz at 100 Hz: error about (2 pi 2/100)^6 = 4e-6 of 1 rad/s.
    assert np.allclose(rates.over(a, b), other.over(a, b), rtol=0, atol=1e-7)
    assert np.allclose(rates.rate_change(a, b), other.rate_change(a, b), rtol=0, atol=1e-5)


@settings(max_examples=50)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.integers(0, 2**32 - 1))
def test_wahba_finds_the_rotation(vector: tuple[float, float, float], seed: int) -> None:
    rotation = wandering.matrix(vector)
    y = np.random.default_rng(seed).normal(size=(20, 3))
    found = matrix_from_quaternion(wahba((y @ rotation.T).T @ y))
    # An eigenvector of a 4 by 4 matrix with a gap of the order of its norm: rounding times a hundred.
    assert np.allclose(found, rotation, rtol=0, atol=1e-13)


def test_wahba_refuses_one_axis() -> None:
    y = np.random.default_rng(1).normal(size=(20, 1)) * [1.0, 2.0, -1.0]
    with pytest.raises(ValueError, match="one axis"):
        wahba(y.T @ y)


def test_the_correlation_has_its_crest_at_the_offset() -> None:
    reference, gyro = records(1, 1e-3, 1e-4)
    found = correlation(reference, gyro, 1.0, rotated=True)
    assert abs(found.lag[found.best] - OFFSET) <= 0.01  # half a step of the grid
    assert found.value[found.best] > 0.99
    assert np.all(found.value <= 1 + 1e-9)  # Cauchy-Schwarz, and rounding of the Fourier transform
    assert found.within(0.5).lag.tolist() == found.lag[np.abs(found.lag) <= 0.5].tolist()


def test_a_periodic_motion_has_a_crest_every_period() -> None:
    t = np.arange(2000) / 100
    wave = np.stack([np.sin(2 * np.pi * 2.5 * t), np.zeros_like(t), np.cos(2 * np.pi * 2.5 * t)], axis=1)
    gyro = Cumulative.of_rates(t, wave)
    reference = level(t[:-1], t[1:], gyro.over(t[:-1], t[1:]))
    crests = correlation(reference, gyro, 1.0, rotated=False).crests(0.85)
    assert crests.tolist() == pytest.approx([-0.8, -0.4, 0.0, 0.4, 0.8], abs=1e-9)  # multiples of the step


def test_intervals_over_gaps_and_beyond_the_ends_are_not_covered() -> None:
    time = np.delete(np.arange(1000) / 100, slice(300, 350))
    edges = np.arange(0, 10, 0.02)
    reference = level(edges[:-1], edges[1:], np.zeros((len(edges) - 1, 3)))
    mask = covered(reference, time, 0.5, 0.03, 0.01)
    start = reference.start[mask] + 0.5
    assert start.min() >= 0.01
    assert start.max() + 0.02 <= 9.99 - 0.01
    assert not np.any((start + 0.02 > 2.99 - 0.01) & (start < 3.5 + 0.01))
    assert np.count_nonzero(mask) > 430  # of 499: 24 lie beyond the end, 26 over the gap, few at their edges


class TestEstimate:
    # Gyro and reference alike, a poor gyro, a poor reference, and both poor.
    @pytest.mark.parametrize(
        ("rates_noise", "angle_noise"), [(1e-3, 1e-4), (1e-2, 1e-6), (1e-5, 1e-3), (3e-2, 3e-3)], ids=str
    )
    def test_it_errs_as_it_says(self, rates_noise: float, angle_noise: float) -> None:
        """Offset and mounting, each over its standard error, at 100 seeds."""
        errors = []
        for seed in range(100):
            found = estimate(*records(seed, rates_noise, angle_noise))
            errors.append(
                [
                    (found.offset - OFFSET) / np.sqrt(found.covariance[0, 0]),
                    *((found.rotation_vector - MOUNTING) / found.rotation_vector_errors),
                ]
            )
        normalised = np.array(errors)
        # 400 values: standard error of their standard deviation 0.035, of each mean over 100 seeds 0.1.
        assert 0.9 < np.sqrt(np.mean(normalised**2)) < 1.1
        assert np.abs(normalised.mean(axis=0)).max() < 0.35

    def test_it_knows_what_it_should_know(self) -> None:
        """The standard errors are small: 1e-5 s and 1e-4 rad where the samples are 10 ms apart."""
        found = estimate(*records(1, 1e-3, 1e-4))
        assert np.sqrt(found.covariance[0, 0]) < 1e-5
        assert found.rotation_vector_errors.max() < 1e-4

    def test_what_is_held_has_no_variance_and_keeps_its_value(self) -> None:
        reference, gyro = records(1, 1e-3, 1e-4)
        part = reference.only(covered(reference, gyro.time, OFFSET, 0.07, 0.1))
        turn = quaternion_from_rotation_vector(np.array(MOUNTING))
        found = fit(part, gyro, OFFSET + 0.005, turn, free_offset=True, free_rotation=False)
        assert np.array_equal(found.quaternion, turn)
        assert not found.covariance[1:].any()
        assert abs(found.offset - OFFSET) < 5 * np.sqrt(found.covariance[0, 0])  # five standard errors

    def test_a_cone_does_not_tell_a_turn_about_its_axis_from_a_delay(self) -> None:
        t = np.arange(4000) / 100
        wave = np.stack([np.full_like(t, -0.1), np.sin(15 * t), np.cos(15 * t)], axis=1)
        gyro = Cumulative.of_rates(t, wave)
        inside = slice(20, -20)
        reference = level(t[:-1], t[1:], gyro.over(t[:-1], t[1:])).only(
            np.isin(np.arange(len(t) - 1), np.arange(len(t) - 1)[inside])
        )
        with pytest.raises(ValueError, match="leaves a combination free"):
            fit(reference, gyro, 0.0, np.array([1.0, 0, 0, 0]), free_offset=True, free_rotation=True)


class TestGain:
    def test_units_show_whatever_the_mounting(self) -> None:
        reference, gyro = records(1, 1e-3, 1e-4)
        part = reference.only(covered(reference, gyro.time, 0.0, 0.07, 0.1))
        ratio, determined = gain(part, gyro)
        # The offset of 24 ms and the bias leave a part unexplained; far less than a factor 57.
        assert ratio == pytest.approx(1.0, abs=0.05)
        assert determined > 0.95

    def test_noise_determines_nothing(self) -> None:
        rng = np.random.default_rng(2)
        t = np.arange(2001) / 100
        gyro = Cumulative.of_rates(t, 0.003 * rng.normal(size=(2001, 3)) + 0.02)
        angles = quaternion_from_rotation_vector(1e-3 * rng.normal(size=(2001, 3)))
        # Nine parameters of 6000 noisy values explain 9/6000 of them; the bias is explained by none.
        assert gain(integrals_of_rate(t, angles), gyro)[1] < 0.02

    def test_a_reference_at_rest_determines_nothing(self) -> None:
        t = np.arange(100) / 100
        still = level(t[:-1], t[1:], np.zeros((99, 3)))
        assert gain(still, Cumulative.of_rates(t, np.ones((100, 3))))[1] == 0.0
