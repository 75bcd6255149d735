"""The advice on further runs: what it promises is what such a run gives."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.models.drift_advice import HOURS, Proposal, further_runs
from pipeline.models.drift_linear import LinearFit, cumulative
from pipeline.models.drift_problem import Arc, Parameter, Prior, Problem
from pipeline.models.drift_trajectory import linear_trajectory, trajectory
from pipeline.models.earth import RATE, Base, Scheme
from pipeline.models.gyro_drift import DRIFT, TILT, Gyro

Float = NDArray[np.float64]
LATITUDE = np.deg2rad(55.75)
ARCMIN, ARCSEC = float(np.deg2rad(1 / 60)), float(np.deg2rad(1 / 3600))
USEFUL = np.array([0.01 / 15.041067, ARCMIN])
"""0.01 degrees an hour, and 1 arc minute."""
PRIORS = (
    {name: Prior(0.0, 0.1) for name in DRIFT}
    | {name: Prior(0.0, 15 * ARCMIN) for name in TILT}
    | {"epsilon": Prior(0.0, 1.5 * ARCMIN)}
)
M, THETA = np.array([0.011, -0.007, 0.005, 0.003, -0.002, 0.004]), np.array([6, -4]) * ARCMIN
INTERVAL = 300.0


def epsilon(base: Base, seed: int) -> Float:
    return np.cross(base.u, np.random.default_rng(seed).normal(0, ARCMIN, 3))


def arc(run: int, base: Base, start: Float, hours: float, noise: float, seed: int) -> Arc:
    """A run by the linear model, which is then the truth for the linear fit."""
    tau = np.arange(round(hours * 3600 / INTERVAL) + 1) * (INTERVAL * RATE)
    p = np.concatenate([M, THETA, epsilon(base, run)])
    alpha = linear_trajectory(p, base, start, tau)
    alpha += noise * np.random.default_rng((seed, run)).standard_normal(alpha.shape)
    return Arc(run, tau, alpha, np.ones(len(tau), dtype=np.bool_))


def fitted(problem: Problem, noise: float) -> LinearFit:
    return cumulative(problem, sigma=noise, robust=False, coloured=False)


@cache
def advised(
    scheme: Scheme, start: tuple[float, float], noise: float, installation: bool = True
) -> tuple[Problem, tuple[Proposal, ...]]:
    base = Base.mounted(scheme, LATITUDE)
    problem = Problem((base,), (arc(0, base, np.array(start), 24, noise, 0),), PRIORS, installation)
    fit = fitted(problem, noise)
    return problem, further_runs(
        fit.rows, problem, fit.estimate, sigma=noise, interval=INTERVAL, useful=USEFUL
    )


def missing(proposal: Proposal) -> set[str]:
    bounds = [USEFUL[0] if p.name in DRIFT else USEFUL[1] for p in proposal.parameters]
    now = proposal.standard_error_now > bounds
    return {p.name for p, lacks in zip(proposal.parameters, now, strict=True) if lacks}


def test_the_run_that_is_advised_determines_what_was_missing() -> None:
    """Equatorial from alpha2 = 0, theta and more is missing: the advised run gives what was promised."""
    noise = 10 * ARCSEC
    problem, proposals = advised("equatorial", (0.0, 0.0), noise)
    best = proposals[0]
    assert {"theta1", "theta2", "epsilon3"} <= missing(best)
    assert np.isinf(best.standard_error_now[[6, 7]]).all()
    assert best.determined.all()
    other = Base.mounted(best.scheme, LATITUDE)
    bases = (problem.bases[0], other)
    truth = np.concatenate([M, THETA, epsilon(bases[0], 0)])
    errors, own = [], []
    for seed in range(80):
        first = arc(0, bases[0], np.zeros(2), 24, noise, seed)
        second = arc(1, other, best.alpha, best.duration / 3600, noise, seed)
        estimate = fitted(Problem(bases, (first, second), PRIORS), noise).estimate
        errors.append(estimate.value[: len(truth)] - truth)
        own.append(estimate.standard_errors[: len(truth)])
    told = best.standard_error_then > 0
    promised = best.standard_error_then[told]
    # the scatter of 80 seeds is good to 8 %, 3.7 sigma; the rest is what the first run said of m and theta
    np.testing.assert_allclose(np.std(errors, axis=0)[told], promised, rtol=0.3)
    np.testing.assert_allclose(np.mean(own, axis=0)[told], promised, rtol=0.3)


@pytest.mark.parametrize(
    ("scheme", "start"), [("equatorial", (0.0, 0.0)), ("equatorial", (0.0, 0.6)), ("polar", (0.02, -0.01))]
)
def test_proposals_can_be_followed_and_are_ordered(scheme: Scheme, start: tuple[float, float]) -> None:
    _, proposals = advised(scheme, start, 10 * ARCSEC)
    assert 1 <= len(proposals) <= 3
    assert len({p.scheme for p in proposals}) == len(proposals)
    gained = [int(np.sum(p.determined & (p.standard_error_now > p.standard_error_then))) for p in proposals]
    assert gained == sorted(gained, reverse=True)
    for proposal in proposals:
        assert proposal.duration / 3600 in HOURS
        assert abs(proposal.alpha[1]) <= np.deg2rad(60) + 1e-12
        tau = np.arange(0, proposal.duration, INTERVAL) * RATE
        alpha = trajectory(Gyro(M, THETA), Base.mounted(proposal.scheme, LATITUDE), proposal.alpha, tau)
        assert np.abs(alpha[:, 1]).max() < np.deg2rad(81)  # 80, by parameters estimated to a degree at worst
        assert np.all(proposal.standard_error_then <= proposal.standard_error_now)
        assert proposal.parameters[0] == Parameter("m11")


def test_nothing_is_missing_and_nothing_advised() -> None:
    _, proposals = advised("horizontal", (0.0, 0.0), ARCSEC)
    assert proposals == ()


def test_without_installation_errors() -> None:
    """Six parameters, near the pole with noise of an arc minute."""
    _, proposals = advised("polar", (0.02, -0.01), ARCMIN, installation=False)
    assert proposals[0].parameters == tuple(Parameter(name) for name in DRIFT)
    assert missing(proposals[0]) == set(DRIFT)
    assert proposals[0].determined.all()


def test_noise_that_no_run_overcomes() -> None:
    """Five degrees: no further run determines m11, and the best that there is says so."""
    _, proposals = advised("equatorial", (0.0, 0.0), np.deg2rad(5.0))
    for proposal in proposals:
        assert not proposal.determined[0]
        lacking = ~proposal.determined & (proposal.standard_error_now > 0)
        improved = proposal.standard_error_then[lacking] < 0.5 * proposal.standard_error_now[lacking]
        assert improved.any()
    assert proposals[0].duration == 24 * 3600  # where hours buy nothing else, the most of them
