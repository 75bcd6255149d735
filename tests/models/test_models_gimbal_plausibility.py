import gimbal_records as gr
import numpy as np
import pytest

from pipeline.models.earth import RATE, Base, Scheme
from pipeline.models.gimbal_plausibility import (
    implied_earth_rate,
    judge,
    nominal_parameters,
    unexplained_steps,
    unwrapped,
)
from pipeline.models.gyro_drift import PARAMETERS, linear_model
from pipeline.models.record_length import driftless

SCHEMES = list(gr.STARTS)


def driftless_record(
    scheme: Scheme, hours: float = 24.0, count: int = 1441
) -> tuple[np.ndarray, np.ndarray, Base]:
    tau = np.linspace(0.0, hours * 3600 * RATE, count)
    base = Base.mounted(scheme, gr.LATITUDE)
    return tau, driftless(np.array(gr.STARTS[scheme]), base, tau), base


class TestImpliedEarthRate:
    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_a_rotor_without_drift_tells_the_earth_rate(self, scheme: Scheme) -> None:
        implied = implied_earth_rate(*driftless_record(scheme))
        assert implied is not None
        # The prior of s, 1e3 wide, draws it to nothing; the cubic over a minute is good to 1e-9.
        assert implied.scale == pytest.approx(1.0, abs=1e-5)
        assert implied.misfit < 1e-5
        assert implied.believed
        assert not implied.off

    @pytest.mark.parametrize("scheme", SCHEMES)
    @pytest.mark.parametrize("factor", [0.5, 2.0, -1.0])
    def test_a_clock_of_another_rate_is_seen(self, scheme: Scheme, factor: float) -> None:
        """Time scaled by 1/k is an Earth rate scaled by k, in any scheme and exactly."""
        tau, alpha, base = driftless_record(scheme)
        if factor < 0:
            alpha = alpha[::-1]
        implied = implied_earth_rate(tau / abs(factor), alpha, base)
        assert implied is not None
        assert implied.scale == pytest.approx(factor, abs=1e-4)
        assert implied.off

    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_jumps_spoil_no_more_than_their_rows(self, scheme: Scheme) -> None:
        tau, alpha, base = driftless_record(scheme)
        alpha[400:] += 0.1
        alpha[900:] -= [0.0, 0.05]
        implied = implied_earth_rate(tau, alpha, base)
        assert implied is not None
        # Behind a jump of 0.1 rad the model is evaluated 0.1 rad off, which changes rates by as much.
        assert implied.scale == pytest.approx(1.0, abs=0.3)
        assert implied.misfit < 0.1

    def test_too_few_samples_or_no_motion_say_nothing(self) -> None:
        tau, alpha, base = driftless_record("vertical")
        assert implied_earth_rate(tau[:10], alpha[:10], base) is None
        assert implied_earth_rate(tau, np.zeros_like(alpha), base) is None
        assert judge(tau[:10], alpha[:10], base) is None

    def test_standard_error_has_the_drift_in_it(self) -> None:
        """In the equatorial scheme mc2 turns alpha1 as the Earth does: s is known to its prior, 0.1."""
        tau, alpha, base = driftless_record("equatorial", hours=2.0)
        implied = implied_earth_rate(tau, alpha, base)
        assert implied is not None
        assert 0.1 <= implied.standard_error < 0.2


class TestJudge:
    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_spikes_do_not_make_another_unit_believed(self, scheme: Scheme) -> None:
        tau, alpha, base = driftless_record(scheme)
        rng = np.random.default_rng(1)
        for first in 20 + 70 * np.arange(20):
            alpha[first : first + 5, rng.integers(2)] += rng.choice([-1, 1])
        judged = judge(tau, alpha, base)
        assert judged is not None
        assert not judged.doubtful
        assert judged.cause is None

    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_units(self, scheme: Scheme) -> None:
        tau, alpha, base = driftless_record(scheme)
        for factor, cause in ((1.0, None), (180 / np.pi, "degrees"), (np.pi / 180, "radians")):
            judged = judge(tau, alpha * factor, base)
            assert judged is not None
            assert judged.cause == cause
            assert judged.doubtful == (cause is not None)
            if judged.otherwise is not None:
                assert judged.otherwise.scale == pytest.approx(1.0, abs=1e-5)


class TestSteps:
    def test_unwrapped_keeps_the_inner_angle_about_zero(self) -> None:
        alpha = np.array([[3.1, 6.2], [-3.1, 6.25], [-3.0, 0.01]])
        turned = unwrapped(alpha)
        expected = np.array(
            [[3.1, 6.2 - 2 * np.pi], [2 * np.pi - 3.1, 6.25 - 2 * np.pi], [2 * np.pi - 3.0, 0.01]]
        )
        assert turned == pytest.approx(expected, abs=1e-14)  # rounding of 2 pi

    @pytest.mark.parametrize("scheme", SCHEMES)
    def test_of_the_linear_models_own_motion_nothing_is_left(self, scheme: Scheme) -> None:
        """Drift that shows in `nominal_parameters` is taken off; what is left is the integral's error."""
        time, alpha = gr.record(scheme, 24, 60.0, noise=0.0)
        tau, base = (time - time[0]) * 1e-9 * RATE, Base.mounted(scheme, gr.LATITUDE)
        p = nominal_parameters(tau, alpha, base)
        assert p.shape == (len(PARAMETERS),)
        left = unexplained_steps(tau, alpha, alpha, base, p)
        plain = unexplained_steps(tau, alpha, alpha, base, np.zeros(11))
        assert left.shape == (len(tau) - 1, 2)
        # Terms of second order in drift 0.01 and tilt 0.003: 1e-4 of the Earth rate, over a minute 4e-7 rad.
        assert np.abs(left).max() < 4e-7
        assert np.abs(plain).max() > 20 * np.abs(left).max()

    def test_a_step_stands_out(self) -> None:
        tau, alpha, base = driftless_record("polar")
        moved = alpha.copy()
        moved[700:] += [1e-3, 2e-3]
        steps = unexplained_steps(tau, moved, alpha, base, np.zeros(11))
        c, _ = linear_model(alpha, base)
        assert np.abs(c).max() < 2  # rates are of order one, so that the step stands out by itself
        # The local cubic over a minute errs by (11/720) h^5 |rate''''|, below 1e-12.
        assert steps[699] == pytest.approx([1e-3, 2e-3], abs=1e-10)
        assert np.abs(np.delete(steps, 699, axis=0)).max() < 1e-10
