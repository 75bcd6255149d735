"""Whiteness: the test's false alarms, and autoregressions that are recovered from what they coloured."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.numerics.whiteness import AutoRegression, fit_autoregression, ljung_box

Float = NDArray[np.float64]


def coloured(phi: list[float], shape: tuple[int, ...], seed: int) -> Float:
    """Stationary autoregressive noise of unit innovations: the first 2000 samples are dropped."""
    white = np.random.default_rng(seed).standard_normal((shape[0] + 2000, *shape[1:]))
    return np.asarray(lfilter([1.0], [1.0, *(-c for c in phi)], white, axis=0)[2000:])


def test_statistic_by_hand() -> None:
    """e = 1, -1, 2, 0: r1 = -3/6, r2 = 2/6; Q = 4 * 6 * (r1^2/3 + r2^2/2)."""
    statistic, probability = ljung_box(np.array([1.0, -1.0, 2.0, 0.0]), 2)
    assert statistic == pytest.approx(24 * (0.25 / 3 + 1 / 9 / 2), rel=1e-14)
    assert probability == pytest.approx(np.exp(-statistic / 2), rel=1e-12)  # chi-square, two degrees


@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_false_alarms_are_as_many_as_said(missing: float) -> None:
    rng = np.random.default_rng(1)
    probabilities = []
    for _ in range(1000):
        seen = rng.random(500) >= missing
        probabilities.append(ljung_box(rng.standard_normal((500, 2)), 20, seen)[1])
    for level in (0.01, 0.1, 0.5):
        count = float(np.mean(np.array(probabilities) < level))
        # binomial, and the statistic is chi-square only for long records
        assert count == pytest.approx(level, abs=3.5 * (level * (1 - level) / 1000) ** 0.5 + 0.005)


def test_colour_is_seen() -> None:
    assert ljung_box(coloured([0.3], (500, 2), 2), 20)[1] < 1e-6
    assert ljung_box(np.zeros(50), 10) == (0.0, 1.0)


@pytest.mark.parametrize("phi", [[0.9], [0.5, -0.3], [1.2, -0.5, 0.2]])
def test_the_autoregression_is_recovered(phi: list[float]) -> None:
    found = fit_autoregression([coloured(phi, (20_000, 2), 3), coloured(phi, (5000, 2), 4)])
    assert found is not None
    assert found.order == len(phi)
    np.testing.assert_allclose(found.coefficients, phi, atol=0.03)  # five times sqrt(1/50,000) = 0.0045
    assert found.gain == pytest.approx(1 / (1 - sum(phi)), rel=0.1)
    assert found.spread == pytest.approx(np.std(coloured(phi, (400_000,), 5)), rel=0.02)
    white = found.whiten(coloured(phi, (20_000, 2), 6))
    assert len(white) == 20_000 - found.order
    assert ljung_box(white, 20)[1] > 1e-3
    assert np.std(white) == pytest.approx(1, rel=0.02)  # 1/sqrt(80,000) = 0.0035


def test_spread_of_first_and_second_order() -> None:
    """sigma^2 = 1/(1 - phi^2); for two, (1 - b)/((1 + b)((1 - b)^2 - a^2)) (Box & Jenkins, 3.2.28)."""
    first = AutoRegression(np.array([0.9]))
    assert first.spread == pytest.approx((1 - 0.81) ** -0.5, rel=1e-13)
    assert 0.9**first.memory < 1e-3
    a, b = 0.5, -0.3
    expected = (1 - b) / ((1 + b) * ((1 - b) ** 2 - a**2))
    assert AutoRegression(np.array([a, b])).spread == pytest.approx(expected**0.5, rel=1e-13)


def test_white_noise_has_none() -> None:
    # by Schwarz' criterion log(n) = 9.9 has to be gained: chance 0.17 % for the first order
    found = [fit_autoregression([np.random.default_rng(s).standard_normal((10_000, 2))]) for s in range(50)]
    assert sum(f is not None for f in found) <= 2
    assert fit_autoregression([np.random.default_rng(0).standard_normal(100)]) is None  # too few rows
    assert fit_autoregression([np.zeros((1000, 2))]) is None


def test_rows_beside_what_is_missing_are_left_out() -> None:
    noise = AutoRegression(np.array([0.5, 0.2]))
    rows = np.arange(10.0)
    seen = np.ones(10, dtype=np.bool_)
    seen[4] = False
    white = noise.whiten(rows, seen)
    # rows 4, 5 and 6 need sample 4
    expected = [rows[j] - 0.5 * rows[j - 1] - 0.2 * rows[j - 2] for j in (2, 3, 7, 8, 9)]
    np.testing.assert_allclose(white, expected, rtol=1e-14)
    np.testing.assert_array_equal(noise.whole(seen), [True, True, False, False, False, True, True, True])
    with_wrong = np.where(seen[:, np.newaxis], coloured([0.9], (10, 1), 1), 1e6)
    assert np.abs(noise.whiten(with_wrong, seen)).max() < 100


def test_missing_samples_do_not_mislead_the_fit() -> None:
    e = coloured([0.9], (20_000, 2), 7)
    seen = np.random.default_rng(8).random(len(e)) > 0.02
    e[~seen] = 1e3
    found = fit_autoregression([e], [seen])
    assert found is not None
    np.testing.assert_allclose(found.coefficients[:1], 0.9, atol=0.05)


def test_what_fitting_took_is_given_back() -> None:
    """Ten slow columns fitted to AR(1) noise take its slowest part; without account phi is too small."""
    n, x = 600, np.linspace(-1, 1, 600)
    A = np.stack([np.polynomial.Legendre.basis(k)(x) for k in range(10)], axis=1)
    noise = AutoRegression(np.array([0.9]))
    plain, corrected = [], []
    for seed in range(60):
        e = coloured([0.9], (n, 1), 100 + seed)
        W = noise.whiten(np.column_stack([A, e]))
        R = np.linalg.qr(W[:, :-1], mode="r")
        residual = e - A @ np.linalg.lstsq(W[:, :-1], W[:, -1:], rcond=None)[0]
        taken = (A @ np.linalg.inv(R))[:, np.newaxis, :]
        for found, into in (
            (fit_autoregression([residual]), plain),
            (fit_autoregression([residual], None, [taken]), corrected),
        ):
            assert found is not None
            into.append(found.coefficients.sum())
    # the spread of each is sqrt(0.19/600) = 0.018, of the mean 0.0023
    assert np.mean(corrected) == pytest.approx(0.9, abs=0.01)
    assert np.mean(plain) < 0.88


def test_an_unstable_fit_is_drawn_in() -> None:
    """A growing residual has no stationary autoregression; what is returned has a spread."""
    grown = 1.01 ** np.arange(2000.0) * (1 + 1e-3 * np.random.default_rng(9).standard_normal(2000))
    found = fit_autoregression([grown])
    assert found is not None
    assert np.abs(np.roots([1.0, *-found.coefficients])).max() < 1
    assert np.isfinite(found.spread)
