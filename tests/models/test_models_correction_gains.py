"""Gains of the correction loops: limits and polynomials against printed figures and eigenvalues."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from pipeline.errors import ExitCode
from pipeline.models.correction_gains import (
    MEASURED,
    PRINTED,
    TUNED,
    Channel,
    ChannelGains,
    CorrectionGainsError,
    LoopGains,
    Measured,
    bias_limit,
    channels,
    characteristic_polynomial,
    check_channel,
    damping,
    poles,
)
from pipeline.models.correction_response import rates_matrix

PLACES = {"velocity": [1, 3, 4], "position": [0, 1, 2, 4], "both": [0, 1, 2, 3, 4]}
"""L, V, c_X, c_V, n of a channel that is compared continuously."""

# Limits of k_n with k = T, K = k_LV = 1: velocity, position, both.
ORACLE = {3.0: (1.3333, 0.1875, 0.8499), 5.0: (1.2000, 0.1389, 0.7724), 10.0: (1.1000, 0.0826, 0.7012)}

UNEVEN = ChannelGains(T=7.0, T_V=4.0, k_L=2.5, k_V=1.5, K=0.4, k_LV=0.6, k_n=0.03)
"""All different, so that none can stand for another."""


def paper(T: float, k_n: float = 0.02) -> ChannelGains:
    return ChannelGains(T=T, T_V=T, k_L=T, k_V=T, K=1.0, k_LV=1.0, k_n=k_n)


def continuous(channel: Channel) -> np.ndarray:
    """The matrix of a channel with ``dX = L_k`` and ``dV = V_kV`` always."""
    A = rates_matrix(channel, "held")
    A[:, 0] += A[:, 5]
    A[:, 1] += A[:, 6]
    places = [p for p in PLACES[channel.measured] if not (p == 4 and channel.frozen)]
    return A[np.ix_(places, places)]


@pytest.mark.parametrize("T", ORACLE)
def test_limits_are_the_printed_ones(T: float) -> None:
    limits = [bias_limit(Channel("", paper(T), measured)) for measured in MEASURED]
    assert limits == pytest.approx(ORACLE[T], abs=5e-5)  # printed with four decimals


@pytest.mark.parametrize("gains", [paper(3.0), paper(10.0), PRINTED.gnss, TUNED.gnss, UNEVEN])
@pytest.mark.parametrize("measured", MEASURED)
def test_a_limit_is_where_an_eigenvalue_crosses(gains: ChannelGains, measured: Measured) -> None:
    def rightmost(k_n: float) -> float:
        found = np.linalg.eigvals(continuous(Channel("", replace(gains, k_n=k_n), measured)))
        # Beside the limit the pair that crosses is the only one that is not well damped.
        return float(found.real.max())

    limit = bias_limit(Channel("", gains, measured))
    # The root is found to 1e-12; the real part moves by at least hundredths of k_n.
    assert brentq(rightmost, 0.5 * limit, 2.0 * limit, xtol=1e-12) == pytest.approx(limit, abs=1e-6)


@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("measured", MEASURED)
def test_the_polynomial_is_that_of_the_matrix(measured: Measured, frozen: bool) -> None:
    channel = Channel("", UNEVEN, measured, frozen=frozen)
    polynomial = characteristic_polynomial(channel)
    # np.poly of a matrix of 5 x 5 with eigenvalues of the order 1 errs by 1e-14
    np.testing.assert_allclose(polynomial / polynomial[0], np.poly(continuous(channel)), atol=1e-12)


def test_the_attitude_is_a_channel_with_its_own_limit() -> None:
    attitude = next(c for c in channels(TUNED) if c.name == "attitude")
    assert bias_limit(attitude) == pytest.approx((1 + 3) / 120, abs=1e-15)  # the formula itself
    assert poles(attitude).real.max() < 0


def test_poles_begin_with_the_slowest() -> None:
    channel = Channel("", TUNED.gnss, "both")
    real = poles(channel).real
    assert (np.diff(real) < 1e-9).all()  # a pair has one real part but for rounding
    oscillating = poles(channel)[np.abs(poles(channel).imag) > 0]
    expected = np.min(-oscillating.real / np.abs(oscillating))
    assert damping(channel) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("gains", [PRINTED, TUNED])
def test_printed_and_tuned_gains_are_stable(gains: LoopGains) -> None:
    for channel in channels(gains, ("position", "velocity", "airspeed", "altitude")):
        check_channel(channel)
        assert poles(channel).real.max() < 0


def test_the_printed_condition_is_not_sufficient() -> None:
    channel = Channel("position", paper(3.0, k_n=0.9), "position")
    assert poles(channel).real.max() > 0
    with pytest.raises(CorrectionGainsError, match=r"k_n < 0\.1875 1/s \(Routh\), found 0\.9 1/s") as refused:
        check_channel(channel)
    assert refused.value.exit_code is ExitCode.USAGE


def test_too_much_damping_is_refused_by_name() -> None:
    channel = Channel("position", replace(paper(3.0), K=1.4), "position", frozen=True)
    assert poles(channel).real.max() > 0
    with pytest.raises(CorrectionGainsError, match=r"1 \+ k_L > K T \(Routh\), that is K < 1\.33333 1/s"):
        check_channel(channel)


def test_where_no_bias_gain_is_small_enough_the_limit_is_zero() -> None:
    channel = Channel(
        "", ChannelGains(T=12.0, T_V=0.04, k_L=5.0, k_V=0.1, K=12.0, k_LV=1.3, k_n=1e-4), "both"
    )
    assert poles(replace(channel, frozen=True)).real.max() > 0
    assert bias_limit(channel) == 0.0
    with pytest.raises(CorrectionGainsError, match="unstable with the bias frozen"):
        check_channel(channel)


@pytest.mark.parametrize(
    ("name", "value", "measured"),
    [
        ("T", 0.0, "position"),
        ("k_LV", 0.0, "both"),
        ("K", -1.0, "velocity"),
        ("k_V", float("nan"), "velocity"),
    ],
)
def test_gains_that_are_not_positive_are_refused(name: str, value: float, measured: Measured) -> None:
    channel = Channel("", replace(PRINTED.gnss, **{name: value}), measured)
    with pytest.raises(CorrectionGainsError, match=f"{name} > 0"):
        check_channel(channel)


@pytest.mark.parametrize("value", [1e300, float("inf"), 1e-300])
def test_gains_out_of_all_measure_are_refused_before_they_overflow(value: float) -> None:
    for measured in MEASURED:
        with pytest.raises(CorrectionGainsError, match=r"K from 1e-09 to 1e\+06, found"):
            check_channel(Channel("", replace(PRINTED.gnss, K=value), measured))


def test_the_symbols_of_the_attitude_are_its_own() -> None:
    gains = replace(TUNED, attitude=replace(TUNED.attitude, k_omega=0.05))
    attitude = channels(gains, ("attitude",))[-1]
    with pytest.raises(CorrectionGainsError, match=r"attitude: expected k_omega < 0\.0333333 1/s"):
        check_channel(attitude)


def test_only_channels_that_can_be_at_work_are_looked_at() -> None:
    assert [c.name for c in channels(PRINTED, ("velocity",))] == ["velocity by satellites", "attitude"]
    assert [c.name for c in channels(PRINTED, ("airspeed", "altitude"))] == [
        "height by barometer",
        "velocity by air data",
        "height by barometer, velocity by air data",
        "attitude",
    ]
