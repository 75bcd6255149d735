"""The spiral and the ellipse about the pole: convergence, honest uncertainty, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from pipeline.models.drift_problem import Arc
from pipeline.models.earth import RATE
from pipeline.models.polar_spiral import SpiralError, fit_ellipse, fit_spiral

Float = NDArray[np.float64]
FIGURES = np.array([-7e-4, -2.1e-3, 0.022, 9e-4, 0.9946, 0.364])  # MATH 2.6
ARCSEC = np.deg2rad(1 / 3600)


def times(hours: float, minutes: float = 5.0) -> Float:
    return float(minutes * 60 * RATE) * np.arange(round(hours * 60 / minutes) + 1, dtype=np.float64)


def spiral(tau: Float, figures: Float = FIGURES) -> Float:
    c1, c2, r, decay, nu, psi = figures
    z = c1 + 1j * c2 + r * np.exp(-1j * psi - (decay + 1j * nu) * tau)
    return np.stack([z.real, z.imag], axis=1)


def arc_of(tau: Float, alpha: Float) -> Arc:
    return Arc(0, tau, alpha, np.ones(len(tau), dtype=np.bool_))


@pytest.mark.parametrize("hours", [6, 12, 24, 48, 72])
@pytest.mark.parametrize("truth", [(9e-4, 0.9946), (0.05, 1.03), (-0.02, 0.97)])
def test_converges_from_afar(hours: int, truth: tuple[float, float]) -> None:
    """MATH 2.6: nu0 in [0.2, 3], lambda0 in [-1, 2], records of 6 to 72 h."""
    figures = FIGURES.copy()
    figures[3:5] = truth
    arc = arc_of(times(hours, 15), spiral(times(hours, 15), figures))
    decay, nu = truth
    for nu0 in (0.2, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0):
        for decay0 in (-1.0, 0.0, 1.0, 2.0):
            found = fit_spiral(arc, guess=(decay0, nu0))
            # rounding, 1e-16 over r = 0.02; over 6 h the figures are told a hundred times worse
            np.testing.assert_allclose(found.value, figures, atol=1e-11)
    for guess in ((-1.0, 0.2), (-1.0, 3.0), (2.0, 0.2), (2.0, 3.0)):
        np.testing.assert_allclose(fit_ellipse(arc, guess=guess).A, [[-decay, nu], [-nu, -decay]], atol=1e-10)


def test_the_ellipse_is_exact() -> None:
    """Angles of ``alpha' = A alpha + b`` by the matrix exponential; A with a counter-rotating part."""
    A = np.array([[-5e-4, 0.9953], [-0.9939, -1.4e-3]])
    b = np.array([2.1e-3, -7e-4])
    tau = times(24)
    centre = -np.linalg.solve(A, b)
    alpha = np.array([centre + expm(A * t) @ (np.array([0.02, -0.01]) - centre) for t in tau])
    found = fit_ellipse(arc_of(tau, alpha))
    np.testing.assert_allclose(found.A, A, atol=1e-11)  # expm is good to 1e-14, the amplitude is 0.02
    np.testing.assert_allclose(found.b, b, atol=1e-12)
    np.testing.assert_allclose(found.predicted, alpha, atol=1e-14)


def test_knows_its_error() -> None:
    """The truth is the spiral, noise of 1 arcsec: error over standard error is a standard normal."""
    tau = times(24, 15)
    exact = spiral(tau)
    measured = np.arange(len(tau)) % 7 != 3
    scores, sigmas = [], []
    for seed in range(200):
        noise = ARCSEC * np.random.default_rng(seed).standard_normal(exact.shape)
        found = fit_spiral(Arc(0, tau, exact + noise, measured))
        scores.append((found.value - FIGURES) / np.sqrt(np.diag(found.covariance)))
        sigmas.append(found.sigma)
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.9) & (spread < 1.1)), spread  # two sigma of what 200 seeds tell
    # 160 degrees of freedom spread a sigma by 6 %, the mean of 200 by 0.4 %
    assert np.mean(sigmas) == pytest.approx(ARCSEC, rel=0.015)


def test_what_is_not_measured_is_no_observation() -> None:
    tau = times(24)
    measured = np.ones(len(tau), dtype=np.bool_)
    measured[50:90] = False
    alpha = spiral(tau)
    alpha[~measured] += 1.0
    found = fit_spiral(Arc(0, tau, alpha, measured))
    np.testing.assert_allclose(found.value, FIGURES, atol=1e-12)  # rounding over r = 0.02
    np.testing.assert_allclose(found.predicted, spiral(tau), atol=1e-14)
    np.testing.assert_allclose(fit_ellipse(Arc(0, tau, alpha, measured)).predicted, spiral(tau), atol=1e-14)


@pytest.mark.parametrize("fit", [fit_spiral, fit_ellipse])
def test_what_is_no_spiral_is_refused(fit: object) -> None:
    assert callable(fit)
    tau = times(24)
    with pytest.raises(SpiralError, match="expected 5 measured samples or more, found 4 measured samples"):
        fit(arc_of(tau[:4], spiral(tau[:4])))
    with pytest.raises(SpiralError, match=r"of some amplitude.*start further from the pole"):
        fit(arc_of(tau, np.full((len(tau), 2), 1e-3)))


def test_noise_is_no_spiral() -> None:
    tau = times(24)
    for seed in range(5):
        noise = ARCSEC * np.random.default_rng(seed).standard_normal((len(tau), 2))
        with pytest.raises(SpiralError, match="stands out of the noise"):
            fit_spiral(arc_of(tau, 1e-3 + noise))
