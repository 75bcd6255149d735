"""The correction loops in time: steps, sampled poles, settling and noise, against the compiled equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from pipeline.models._kernels_correction_channel import channel as compiled
from pipeline.models._kernels_correction_channel import response
from pipeline.models.correction_gains import (
    MEASURED,
    PRINTED,
    TUNED,
    Channel,
    ChannelGains,
    CorrectionGainsError,
    Measured,
    channels,
)
from pipeline.models.correction_response import (
    CX,
    DV,
    DX,
    REFERENCES,
    L,
    N,
    Reference,
    V,
    analyse,
    check,
    noise_gain,
    rates_matrix,
    sampled_matrix,
    settling_time,
    spectral_radius,
    step_matrix,
)

UNEVEN = ChannelGains(T=7.0, T_V=4.0, k_L=2.5, k_V=1.5, K=0.4, k_LV=0.6, k_n=0.03)

# 1 m/s^2 of bias, T = k = 3, K = k_LV = 1, k_n = 0.02, zero start: n̂, V_k, L_k at t.
STEPS = {
    ("velocity", 50): (0.632140682, 0.118249361, 10.913738832),
    ("position", 5): (0.086474207, -0.878049927, 0.081861322),
    ("position", 50): (0.631835656, 0.040563870, 0.128103373),
    ("both", 5): (0.080570651, -0.021482111, -0.019840047),
    ("both", 50): (0.632089404, -0.002448843, 0.028590722),
}


def row(g: ChannelGains) -> np.ndarray:
    return np.array([g.T, g.k_L, g.T_V, g.k_V, g.K, g.k_LV, g.k_n])


@pytest.mark.parametrize(("measured", "t"), STEPS)
def test_the_compiled_channel_answers_a_step_as_it_should(measured: Measured, t: int) -> None:
    x = np.zeros(7)
    x[N] = -1.0
    out = np.empty((100 * t + 1, 7))
    response(
        x, row(PRINTED.gnss), measured != "velocity", measured != "position", False, 1, 0, 0.01, 1.0, out
    )
    end = out[-1]
    found = 1 + end[N], end[V] - PRINTED.gnss.k_LV * end[CX], end[L]
    assert found == pytest.approx(STEPS[measured, t], abs=1e-9)  # all the digits that are stated


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("measured", MEASURED)
@pytest.mark.parametrize("frozen", [False, True])
def test_the_compiled_step_is_the_polynomial(measured: Measured, reference: Reference, frozen: bool) -> None:
    columns = np.empty((7, 7))
    for i in range(7):
        x = np.eye(7)[i].copy()
        compiled(
            x, row(UNEVEN), measured != "velocity", measured != "position", frozen,
            REFERENCES.index(reference), 0.0, 0.0, 0.2, 1.0,
        )  # fmt: skip
        columns[:, i] = x
    expected = step_matrix(Channel("", UNEVEN, measured, frozen=frozen), reference, 0.2)
    # What is not measured the compiled channel lets decay; the analysis leaves it out.
    out = {"velocity": [CX], "position": [3], "both": []}[measured]
    kept = [i for i in range(7) if i not in out]
    np.testing.assert_allclose(columns[np.ix_(kept, kept)], expected[np.ix_(kept, kept)], atol=1e-15)


def test_a_long_step_is_made_of_short_ones() -> None:
    whole, parts = np.ones(7), np.ones(7)
    compiled(whole, row(UNEVEN), True, True, False, 0, 0.0, 0.0, 0.95, 0.2)
    for _ in range(5):
        compiled(parts, row(UNEVEN), True, True, False, 0, 0.0, 0.0, 0.19, 0.2)
    np.testing.assert_allclose(whole, parts, rtol=1e-14)  # the same arithmetic


def test_a_reference_that_stays_is_left_behind() -> None:
    x = np.zeros(7)
    compiled(x, row(UNEVEN), True, True, False, 1, 40.0, 0.5, 0.01, 1.0)
    # V_k' and L_k' of the sensors alone; what the loops correct in one step is of the order of its square
    assert (x[DX], x[DV]) == pytest.approx((0.4, 0.005), rel=0.02)


@pytest.mark.parametrize(("T", "radius"), [(3.0, 1.029), (5.0, 1.108), (10.0, 1.170)])
def test_held_differences_diverge_with_the_printed_gains(T: float, radius: float) -> None:
    channel = Channel("both", ChannelGains(T=T, T_V=T, k_L=T, k_V=T, K=1.0, k_LV=1.0, k_n=0.02), "both")
    sampling = {"step": 0.01, "interval": 1.0}
    # printed with three decimals
    assert spectral_radius(channel, reference="held_difference", **sampling) == pytest.approx(
        radius, abs=1e-3
    )
    assert spectral_radius(channel, reference="propagated", **sampling) < 0.981
    assert spectral_radius(channel, reference="held", **sampling) < 0.981
    velocity = replace(channel, measured="velocity")
    assert spectral_radius(velocity, reference="held_difference", **sampling) < 0.981
    with pytest.raises(CorrectionGainsError, match=f"below 1 a fix, with fixes each 1 s, found {radius:.3f}"):
        check(channel, reference="held_difference", **sampling)


def test_held_differences_are_stable_with_the_tuned_gains() -> None:
    channel = Channel("both", TUNED.gnss, "both")
    for reference in REFERENCES:
        radius = spectral_radius(channel, step=0.01, interval=1.0, reference=reference)
        assert radius == pytest.approx(0.979, abs=1e-3)


@pytest.mark.parametrize("gains", [PRINTED, TUNED])
def test_propagated_references_are_stable_in_every_channel(gains) -> None:
    for channel in channels(gains):
        for interval in (0.1, 1.0):
            check(channel, step=0.01, interval=interval, reference="propagated")


@pytest.mark.parametrize("measured", MEASURED)
def test_a_fix_at_every_step_is_the_continuous_loop(measured: Measured) -> None:
    channel = Channel("", UNEVEN, measured)
    A = rates_matrix(channel, "held")
    A[:, L] += A[:, DX]
    A[:, V] += A[:, DV]
    places = {"velocity": [1, 3, 4], "position": [0, 1, 2, 4], "both": [0, 1, 2, 3, 4]}[measured]
    slowest = np.abs(np.linalg.eigvals(expm(0.01 * A[np.ix_(places, places)]))).max()
    for reference in REFERENCES:
        radius = spectral_radius(channel, step=0.01, interval=0.01, reference=reference)
        # A reference that is held over a step, or propagated, errs by a step's second order.
        assert radius == pytest.approx(slowest, abs=1e-4 if reference != "held" else 1e-11)


@pytest.mark.parametrize("measured", MEASURED)
def test_settling_is_when_a_twentieth_is_left(measured: Measured) -> None:
    channel = Channel("", PRINTED.gnss, measured)
    x = np.zeros(7)
    x[N] = -1.0
    out = np.empty((40001, 7))
    response(
        x, row(PRINTED.gnss), measured != "velocity", measured != "position", False, 1, 0, 0.01, 1.0, out
    )
    last = np.flatnonzero(np.abs(out[:, N]) > 0.05)[-1] * 0.01
    # one of the 4000 points over 500 s
    assert settling_time(channel) == pytest.approx(last, abs=0.15)


@pytest.mark.parametrize("measured", MEASURED)
def test_noise_gain_is_what_noisy_fixes_make(measured: Measured) -> None:
    channel = Channel("", TUNED.gnss, measured)
    predicted = noise_gain(channel, step=0.1, interval=1.0, reference="propagated")
    rng = np.random.default_rng(1)
    Phi = np.linalg.matrix_power(step_matrix(channel, "propagated", 0.1), 10)
    count = 200_000
    for source, place in (("position", DX), ("velocity", DV)):
        if (source, "velocity") not in predicted:
            continue
        noise = rng.standard_normal(count)
        x, seen = np.zeros(7), np.empty((count, 2))
        for i in range(count):
            before = x[DX]
            x[DX] = x[L] - (noise[i] if place == DX else 0.0)
            if measured == "position":
                x[DV] += 0.2 * (x[DX] - before)
            else:
                x[DV] = x[V] - (noise[i] if place == DV else 0.0)
            x = Phi @ x
            if measured == "velocity":
                x[L] = 0.0
            seen[i] = x[L], x[V] - (channel.gains.k_LV * x[CX] if measured != "velocity" else 0.0)
        found = seen.std(axis=0)
        # 200,000 fixes over some 60 of correlation: 1.3 % of a standard deviation, three of them
        for output, value in zip(("position", "velocity"), found, strict=True):
            if (source, output) in predicted:
                assert predicted[source, output] == pytest.approx(value, rel=0.04)


def test_an_unstable_channel_is_analysed_too() -> None:
    found = analyse(
        Channel("", replace(PRINTED.gnss, k_n=2.0), "both"), step=0.01, interval=1.0, reference="propagated"
    )
    assert found.radius > 1
    assert found.damping < 0
    assert found.settling_time == float("inf")
    assert set(found.noise_gain.values()) == {float("inf")}


def test_a_frozen_bias_is_no_state() -> None:
    channel = Channel("", replace(PRINTED.gnss, k_n=0.0), "both", frozen=True)
    assert sampled_matrix(channel, step=0.01, interval=1.0, reference="held").shape == (6, 6)
    check(channel, step=0.01, interval=1.0, reference="propagated")
    # The slow pole of the bias is gone: an error of the velocity is forgotten in seconds.
    assert settling_time(channel) < 20
