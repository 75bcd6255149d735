import gimbal_records as gr
import numpy as np
import pytest

from pipeline.models.drift_trajectory import trajectory
from pipeline.models.earth import RATE, Base, Scheme
from pipeline.models.gyro_drift import DRIFT, Gyro, linear_model
from pipeline.models.record_length import driftless, sufficient_length, third_standard_error

SCHEMES = list(gr.STARTS)
STEP = 60.0 * RATE


class TestDriftless:
    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_is_the_exact_model_without_drift(self, scheme: Scheme) -> None:
        tau = np.linspace(0.0, 6.0, 500)
        base = Base.mounted(scheme, gr.LATITUDE)
        start = np.array([0.3, -0.4])
        expected = trajectory(Gyro(np.zeros(6), np.zeros(2)), base, start, tau)
        # The integration is good to 1e-12; near alpha2 = 90 deg the arcsine loses a few digits.
        assert driftless(start, base, tau) == pytest.approx(expected, abs=1e-10)

    def test_the_oracle_of_the_mathematics(self) -> None:
        """m = 0 from (0.3, -0.4) at tau = 1.7, to the twelve digits given."""
        for scheme, expected in (
            ("polar", (-0.446484785153, -0.221557125668)),
            ("horizontal", (-1.348712177016, 0.060034475091)),
            ("vertical", (-1.293042379393, -0.726207509876)),
        ):
            base = Base.mounted(scheme, gr.LATITUDE)
            # Unwrapped from the start on, in steps that are shorter than half a turn.
            end = driftless(np.array([0.3, -0.4]), base, np.linspace(0.0, 1.7, 50))[-1]
            assert end == pytest.approx(expected, abs=1e-12)


class TestThirdStandardError:
    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_is_that_of_a_regression_on_all_samples(self, scheme: Scheme) -> None:
        tau = STEP * np.arange(601)
        base = Base.mounted(scheme, gr.LATITUDE)
        alpha = driftless(np.array(gr.STARTS[scheme]), base, tau)
        F = linear_model(alpha, base)[1][:, :, : len(DRIFT)]
        integral = np.concatenate([np.zeros((1, 2, 6)), np.cumsum(0.5 * STEP * (F[1:] + F[:-1]), axis=0)])
        start = np.broadcast_to(np.eye(2), (601, 2, 2))
        rows = np.concatenate([start, integral], axis=2).reshape(-1, 8)
        covariance = np.linalg.inv(rows.T @ rows)[2:, 2:]
        expected = np.sqrt(np.linalg.eigvalsh(covariance)[2])
        # 300 nodes stand for 601 samples: the sums differ by one part in 300.
        assert third_standard_error([(tau, alpha)], base, 1.0, STEP) == pytest.approx(expected, rel=0.01)

    def test_no_third_while_nothing_turns(self) -> None:
        tau = STEP * np.arange(100)
        base = Base.mounted("vertical", gr.LATITUDE)
        # Bare rounding is left of a third singular value: a standard error beyond all use.
        assert third_standard_error([(tau, np.zeros((100, 2)))], base, gr.ARCSEC, STEP) > 1e6
        assert third_standard_error([], base, gr.ARCSEC, STEP) == np.inf


class TestSufficientLength:
    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_that_length_does_and_less_does_not(self, scheme: Scheme) -> None:
        base = Base.mounted(scheme, gr.LATITUDE)
        start, useful = np.array(gr.STARTS[scheme]), 0.01 / 15.041
        tau = STEP * np.arange(10)
        length = sufficient_length(
            tau, driftless(start, base, tau), base, sigma=gr.ARCSEC, step=STEP, useful=useful, longest=12.0
        )
        assert length is not None

        def error(of: float) -> float:
            at = np.arange(0.0, of, STEP)
            return third_standard_error([(at, driftless(start, base, at))], base, gr.ARCSEC, STEP)

        # Lengths are tried in steps of 10 %; the error falls with the 2.5th power of the length or faster.
        assert error(1.05 * length) <= useful
        assert error(0.8 * length) > useful

    def test_none_where_the_gimbal_never_turns(self) -> None:
        """A rotor that points to the pole without drift stays there for ever."""
        base = Base.mounted("polar", gr.LATITUDE)
        tau = STEP * np.arange(100)
        alpha = np.zeros((100, 2))
        assert sufficient_length(tau, alpha, base, sigma=1e-3, step=STEP, useful=1e-6, longest=12.0) is None
