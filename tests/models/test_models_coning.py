"""The stand's motion: angles, quaternion, rates and increments agree with each other and with (1.1)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ExitCode
from pipeline.models.coning import ConingMotion, Motion, MotionError, SmoothConing
from pipeline.numerics.rotation import quaternion_from_euler_krylov

PAPER = ConingMotion(cone_angle=np.radians(1.0), frequency=100.0)
WIDE = ConingMotion(cone_angle=np.radians(70.0), frequency=3.0)
SMOOTH = SmoothConing(PAPER, onset=0.0, slope=-0.05, offset=0.5)
LATE = SmoothConing(WIDE, onset=0.7, slope=2.0, offset=-0.3)
MOTIONS = pytest.mark.parametrize(
    "motion", [PAPER, WIDE, SMOOTH, LATE], ids=["paper", "wide", "smooth", "late"]
)


def frequency_of(motion: Motion) -> float:
    coning = motion.coning if isinstance(motion, SmoothConing) else motion
    assert isinstance(coning, ConingMotion)
    return coning.frequency


def rates_from_angles(motion: Motion, t: np.ndarray) -> np.ndarray:
    """(2.2), with the angles differentiated numerically (eighth-order central differences)."""
    h = 1e-3 / frequency_of(motion)
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    differences = [w * (motion.angles(t + k * h) - motion.angles(t - k * h)) for k, w in weights.items()]
    d_psi, d_theta, d_gamma = np.sum(differences, axis=0).T / h
    _, theta, gamma = motion.angles(t).T
    p = d_gamma + d_psi * np.sin(theta)
    q = d_psi * np.cos(gamma) * np.cos(theta) + d_theta * np.sin(gamma)
    r = d_theta * np.cos(gamma) - d_psi * np.cos(theta) * np.sin(gamma)
    return np.stack([p, q, r], axis=-1)


@MOTIONS
def test_rates_are_those_of_the_angles(motion: Motion) -> None:
    """Rounding: 1e-16 of the angle over h = 1e-3/f, i.e. 1e-13 f times a few; truncation is below it."""
    t = np.linspace(0.71, 0.93, 1001)
    tolerance = 1e-11 * frequency_of(motion)
    np.testing.assert_allclose(motion.rates(t), rates_from_angles(motion, t), rtol=0, atol=tolerance)


@MOTIONS
def test_quaternion_is_that_of_the_angles(motion: Motion) -> None:
    t = np.linspace(-1.0, 1.0, 2001)
    from_angles = quaternion_from_euler_krylov(motion.angles(t))
    quaternion = motion.quaternion(t)
    np.testing.assert_allclose(np.sum(quaternion**2, axis=1), 1.0, rtol=0, atol=1e-15)
    same = np.abs(np.sum(from_angles * quaternion, axis=1))  # q and -q are one attitude
    np.testing.assert_allclose(same, 1.0, rtol=0, atol=1e-15)  # a few roundings of unit numbers


@MOTIONS
def test_increments_are_the_integrals_of_the_rates(motion: Motion) -> None:
    """Gauss-Legendre of 20 points on a tenth of a period is exact to rounding; no step holds the onset."""
    step = 0.1 / frequency_of(motion)
    start = np.arange(-50, 50) * step + (motion.onset if isinstance(motion, SmoothConing) else 0.0)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    t = start[:, None] + step * (nodes + 1) / 2
    integral = np.einsum("k,nkc->nc", weights, motion.rates(t)) * step / 2
    np.testing.assert_allclose(motion.increments(start, start + step), integral, rtol=0, atol=1e-14)


def test_roll_rate_is_constant_and_gamma_does_not_run_away() -> None:
    t = np.linspace(0, 1, 999)
    p = PAPER.rates(t)[:, 0]
    s = np.sin(np.radians(0.5))
    np.testing.assert_array_equal(p, -2 * (2 * np.pi * 100) * s**2)
    # the trend that lost rates leave, -0.0135 rad/s in the paper, is of the size of the p not recorded
    assert np.ptp(PAPER.angles(t)[:, 2]) < 2 * np.tan(np.radians(0.5)) ** 2


def test_as_printed_in_the_paper_gamma_would_be_singular() -> None:
    """The erratum of (3.1): with cos² ωt for cos²(ΔΦ/2), the denominator 2cos² − 1 + … changes sign."""
    t = np.linspace(0, 0.01, 1001)
    s2, phase = np.sin(np.radians(0.5)) ** 2, 2 * np.pi * 100 * t
    printed = 2 * np.cos(phase) ** 2 - 1 + 2 * s2 * np.cos(phase) ** 2
    assert np.count_nonzero(np.diff(np.sign(printed))) == 4
    assert np.all(2 * np.cos(np.radians(0.5)) ** 2 - 1 + 2 * s2 * np.cos(phase) ** 2 > 0)


@given(
    st.floats(1e-4, 3.1),
    st.floats(1e-2, 1e4),
    st.lists(st.floats(-1, 1), min_size=2, max_size=20),
    st.floats(-100, 100),
)
def test_increments_add_up(cone: float, frequency: float, times: list[float], slope: float) -> None:
    motion = SmoothConing(ConingMotion(cone, frequency), onset=0.1, slope=slope, offset=0.2)
    t = np.sort(np.array(times))
    whole = motion.increments(t[:1], t[-1:])[0]
    parts = motion.increments(t[:-1], t[1:]).sum(axis=0)
    # phases up to 2e5 rad carry 1e-16 of themselves into the increments, once a part
    scale = 1 + 2 * np.pi * frequency + abs(slope)
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-14 * len(t) * scale)


def test_roll_as_quick_as_the_coning_has_constant_rates() -> None:
    """Ω = ω − a = 0: (q, r) stand still in the body, and the limit of the sinc is met."""
    motion = SmoothConing(WIDE, onset=0.0, slope=WIDE.angular_frequency, offset=0.3)
    expected = motion.rates([0.2])[0] * 0.5
    np.testing.assert_allclose(motion.increments([0.1], [0.6])[0], expected, rtol=1e-15, atol=1e-15)


def test_wide_cone_beyond_the_singularity() -> None:
    """A cone of 120 degrees: the angles wrap, yet are the quaternion's."""
    motion = ConingMotion(np.radians(120.0), 1.0)
    t = np.linspace(0, 1, 400)
    same = np.abs(np.sum(quaternion_from_euler_krylov(motion.angles(t)) * motion.quaternion(t), axis=1))
    np.testing.assert_allclose(same, 1.0, rtol=0, atol=1e-14)  # roundings grow with 1/cos theta = 2


def test_smooth_roll_before_the_onset() -> None:
    t = np.array([-1.0, -0.5, -1e-12, 0.0])
    np.testing.assert_array_equal(SMOOTH.angles(t)[:3], [[0, 0, 0.55], [0, 0, 0.525], [0, 0, 0.5 + 5e-14]])
    np.testing.assert_array_equal(SMOOTH.rates(t)[:3], [[-0.05, 0, 0]] * 3)
    jump = SMOOTH.angles(t)[3] - SMOOTH.angles(t)[2]
    np.testing.assert_allclose(jump, [np.radians(1.0), 0, 0], rtol=0, atol=1e-12)  # a of 1e-12 s


@pytest.mark.parametrize(
    ("cone", "frequency"), [(0.0, 1.0), (-0.1, 1.0), (np.pi, 1.0), (np.nan, 1.0), (0.1, 0.0), (0.1, np.inf)]
)
def test_impossible_motion_is_refused(cone: float, frequency: float) -> None:
    with pytest.raises(MotionError) as error:
        ConingMotion(cone, frequency)
    assert error.value.exit_code == ExitCode.USAGE
