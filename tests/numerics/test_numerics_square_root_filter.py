"""Square-root filter and smoother against plain recursions, a dense Gaussian solution, simulated truth."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.numerics.square_root_filter import State, System, run_filter, triangular
from pipeline.numerics.square_root_smoother import before_renewal, checkpoints, run_smoother

Float = NDArray[np.float64]
K = 5
N = K + 2


def random_system(seed: int, samples: int, noisy: int) -> System:
    """Transitions away from the identity, samples without measurement, steps without noise."""
    rng = np.random.default_rng(seed)
    steps = samples - 1
    return System(
        np.eye(2) + 0.05 * rng.standard_normal((steps, 2, 2)),
        rng.standard_normal((steps, 2, K)),
        rng.standard_normal((steps, 2)),
        rng.uniform(0, 0.1, (steps, noisy)) * (rng.random((steps, 1)) < 0.7),
        rng.standard_normal((samples, 2)),
        rng.random(samples) < 0.8,
        np.array([0.1, 0.2]),
    )


def random_state(seed: int) -> State:
    rng = np.random.default_rng(seed)
    return State(0.1 * rng.standard_normal(N), 0.5 * rng.standard_normal((N, N)))


def whole_transition(system: System, j: int) -> Float:
    T = np.eye(system.drive.shape[2] + 2)
    T[-2:, -2:], T[-2:, :-2] = system.transition[j], system.drive[j]
    return T


def plain_filter(system: System, start: State) -> tuple[Float, Float, float]:
    """Kalman's recursion with P itself: means and covariances of all samples, and the log-likelihood."""
    x, P, R = start.mean, start.factor @ start.factor.T, np.diag(system.sigma**2)
    noisy = slice(len(x) - 2 - system.noise.shape[1], len(x) - 2)
    means, covariances, likelihood = [], [], 0.0
    for j, measured in enumerate(system.measured):
        if j > 0:
            T = whole_transition(system, j - 1)
            x, P = T @ x, T @ P @ T.T
            x[-2:] += system.offset[j - 1]
            P[noisy, noisy] += np.diag(system.noise[j - 1] ** 2)
        if measured:
            V, nu = P[-2:, -2:] + R, system.measurement[j] - x[-2:]
            gain = P[:, -2:] @ np.linalg.inv(V)
            x, P = x + gain @ nu, P - gain @ V @ gain.T
            likelihood -= 0.5 * (nu @ np.linalg.solve(V, nu) + np.log(np.linalg.det(2 * np.pi * V)))
        means.append(x)
        covariances.append(P)
    return np.array(means), np.array(covariances), likelihood


def potter_deviations(system: System, start: State) -> Float:
    """Standard deviations at the end by Potter's recursion in long double, without process noise."""
    S, sigma = start.factor.astype(np.longdouble), system.sigma.astype(np.longdouble)
    for j, measured in enumerate(system.measured):
        if j > 0:
            S = whole_transition(system, j - 1).astype(np.longdouble) @ S
        for row, r in zip((-2, -1), sigma**2, strict=True):
            if measured:
                f = S[row].copy()
                s = f @ f + r
                S -= np.outer(S @ f, f) / (s + np.sqrt(r * s))
    return np.sqrt(np.sum(S * S, axis=1)).astype(np.float64)


def dense_solution(systems: Sequence[System], start: State) -> list[tuple[Float, Float]]:
    """All states of all samples as one Gaussian vector, a linear image of independent unit normals.

    Each system begins with fresh rows of mean 0 and standard deviation sigma, the first with ``start``.
    Returns means and standard deviations of each system's states given all measurements.
    """
    k = len(start.mean) - 2
    total = k + 2 + sum(2 + s.noise.size for s in systems)
    M, c = np.zeros((k + 2, total)), start.mean.copy()
    M[:, : k + 2] = start.factor
    used, images = k + 2, []
    for number, s in enumerate(systems):
        if number:
            M, c = M.copy(), c.copy()
            M[k:], c[k:] = 0.0, 0.0
            M[k:, used : used + 2] = np.diag(s.sigma)
        used += 2
        way = [(M, c)]
        for j in range(len(s.drive)):
            T = whole_transition(s, j)
            M, c = T @ M, T @ c
            c[k:] += s.offset[j]
            for q in range(s.noise.shape[1]):
                M[k - s.noise.shape[1] + q, used] = s.noise[j, q]
                used += 1
            way.append((M, c))
        images.append((np.array([m for m, _ in way]), np.array([v for _, v in way])))
    pairs = list(zip(systems, images, strict=True))
    rows = [(m[s.measured, k:] / s.sigma[:, None]).reshape(-1, total) for s, (m, _) in pairs]
    right = [((s.measurement - v[:, k:]) / s.sigma)[s.measured].ravel() for s, (_, v) in pairs]
    A, b = np.concatenate([*rows, np.eye(total)]), np.concatenate([*right, np.zeros(total)])
    Q, R = np.linalg.qr(A)
    z, half = np.linalg.solve(R, Q.T @ b), np.linalg.inv(R)
    return [(m @ z + v, np.linalg.norm(m @ half, axis=2)) for m, v in images]


@pytest.mark.parametrize("noisy", [0, 2, K])
def test_filter_is_kalmans(noisy: int) -> None:
    """Means, covariances, innovations and likelihood of the plain recursion with P."""
    system, start = random_system(1, 60, noisy), random_state(2)
    found = run_filter(system, start, np.arange(60))
    means, covariances, likelihood = plain_filter(system, start)
    # P is conditioned like 1e6 here and the plain recursion loses that many digits of 16
    np.testing.assert_allclose(found.means, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        found.factors @ found.factors.transpose(0, 2, 1), covariances, rtol=0, atol=1e-9
    )
    assert found.log_likelihood == pytest.approx(likelihood, rel=1e-9)
    np.testing.assert_array_equal(np.isfinite(found.innovations).all(axis=1), system.measured)
    np.testing.assert_array_equal(found.state.mean, found.means[-1])


def test_standard_deviations_at_a_condition_of_1e12() -> None:
    """To 1e-8 of Potter's recursion in long double; the recursion with P in double has lost them there."""
    if np.finfo(np.longdouble).eps > 1e-18:
        pytest.skip("long double has no more digits than double here")
    rng = np.random.default_rng(3)
    samples = 400
    drive = rng.standard_normal((samples - 1, 2, K))
    drive[:, :, 1] = drive[:, :, 0] + 3e-6 * drive[:, :, 1]  # only their sum is seen well
    system = replace(random_system(4, samples, 0), drive=drive, measured=np.ones(samples, dtype=bool))
    system = replace(
        system, transition=np.broadcast_to(np.eye(2), (samples - 1, 2, 2)), sigma=np.full(2, 1e-3)
    )
    start = State(np.zeros(N), np.diag([1e2] * K + [1e-3] * 2))
    found = run_filter(system, start, np.empty(0, dtype=np.int64)).state
    spectrum = np.linalg.svd(found.factor, compute_uv=False)
    assert 1e12 < (spectrum[0] / spectrum[-1]) ** 2 < 1e13
    truth = potter_deviations(system, start)
    np.testing.assert_allclose(found.standard_deviations, truth, rtol=1e-8)
    _, P, _ = plain_filter(system, start)
    with np.errstate(invalid="ignore"):  # a variance may come out below zero
        lost = np.abs(np.sqrt(np.diagonal(P[-1])) / truth - 1)
    assert not np.all(lost < 1e-4), lost


def test_shapes_are_checked() -> None:
    system = random_system(0, 10, 2)
    with pytest.raises(ValueError, match=r"offset: expected shape \(9, 2\), found \(8, 2\)"):
        replace(system, offset=system.offset[1:])
    with pytest.raises(ValueError, match="noise: expected shape"):
        replace(system, noise=np.zeros((9, K + 1)))


@pytest.mark.parametrize("noisy", [0, 2, K])
def test_smoother_is_the_dense_gaussian_solution(noisy: int) -> None:
    """With every state kept, some, or only the first: what lies between is filtered again."""
    system, start = random_system(5, 50, noisy), random_state(6)
    ((means, deviations),) = dense_solution([system], start)
    for instants in (np.arange(50), checkpoints(50), np.array([0])):
        forward = run_filter(system, start, instants)
        backward = run_smoother(system, forward, forward.state)
        # all of order 1, a few hundred operations on each: 1e-13 is what was found
        np.testing.assert_allclose(backward.means, means[instants], rtol=0, atol=1e-11)
        np.testing.assert_allclose(np.linalg.norm(backward.factors, axis=2), deviations[instants], rtol=1e-11)
        np.testing.assert_allclose(backward.rows, means[:, K:], rtol=0, atol=1e-11)
        filtered = np.linalg.norm(forward.factors, axis=2)
        assert np.all(np.linalg.norm(backward.factors, axis=2) <= filtered * (1 + 1e-12))  # rounding


def test_constant_parameters_are_those_of_the_end() -> None:
    system, start = random_system(7, 80, 0), random_state(8)
    forward = run_filter(system, start, checkpoints(80))
    backward = run_smoother(system, forward, forward.state)
    np.testing.assert_array_equal(
        backward.means[:, :K], np.tile(forward.state.mean[:K], (len(forward.instants), 1))
    )
    deviations = np.linalg.norm(backward.factors[:, :K], axis=2)
    expected = np.tile(forward.state.standard_deviations[:K], (len(deviations), 1))
    np.testing.assert_allclose(deviations, expected, rtol=1e-13)  # the factor was made triangular in between


@pytest.mark.parametrize("noisy", [0, 2, K])
def test_rows_begun_anew(noisy: int) -> None:
    """Two stretches with common parameters against the dense solution of both."""
    first, second, start = random_system(9, 30, noisy), random_system(10, 20, noisy), random_state(11)
    expected = dense_solution([first, second], start)
    forward = run_filter(first, start, np.array([0, 29]))
    renewed = forward.state.renewed(np.zeros(2), second.sigma)
    later = run_filter(second, renewed, np.array([0]))
    backward = run_smoother(second, later, later.state)
    np.testing.assert_allclose(backward.rows, expected[1][0][:, K:], rtol=0, atol=1e-11)
    end = before_renewal(forward.state, backward.state)
    earlier = run_smoother(first, forward, end)
    np.testing.assert_allclose(earlier.means, expected[0][0][[0, 29]], rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(earlier.factors, axis=2), expected[0][1][[0, 29]], rtol=1e-10)


def test_singular_covariances() -> None:
    """A parameter known exactly, and two that are one: the latter as a system with their columns added."""
    system = random_system(12, 40, 2)
    factor = np.diag([0.0, 0.3, 0.0, 0.5, 0.5, 0.1, 0.1])
    factor[2, 1] = 0.3  # p2 = p1
    start = State(np.zeros(N), factor)
    forward = run_filter(system, start, np.arange(40))
    backward = run_smoother(system, forward, forward.state)
    np.testing.assert_array_equal(backward.means[:, 0], 0.0)
    np.testing.assert_allclose(backward.means[:, 2], backward.means[:, 1], rtol=1e-12)
    added = system.drive[:, :, 1:].copy()
    added[:, :, 0] += added[:, :, 1]
    reduced = replace(system, drive=np.delete(added, 1, axis=2))
    begun = State(np.zeros(5), np.diag([0.3, 0.5, 0.5, 0.1, 0.1]))
    fewer = run_filter(reduced, begun, np.arange(40))
    expected = run_smoother(reduced, fewer, fewer.state)
    kept = [1, 3, 4, 5, 6]
    np.testing.assert_allclose(backward.means[:, kept], expected.means, rtol=0, atol=1e-12)
    deviations = np.linalg.norm(backward.factors, axis=2)[:, kept]
    np.testing.assert_allclose(deviations, np.linalg.norm(expected.factors, axis=2), rtol=1e-10)


def test_triangular_keeps_the_covariance() -> None:
    wide = np.random.default_rng(0).standard_normal((4, 7))
    L = triangular(wide)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)
    np.testing.assert_allclose(L @ L.T, wide @ wide.T, rtol=0, atol=1e-14)  # rounding of numbers of order 1


def test_a_walk_with_its_true_noise() -> None:
    """100 simulated walks: innovations and smoothed errors are what filter and smoother say they are."""
    samples, runs = 300, 100
    model = random_system(13, samples, 2)
    # rows that do not grow: else they would drown the parameters
    model = replace(model, transition=np.broadcast_to(0.9 * np.eye(2), (samples - 1, 2, 2)))
    squares, count, scores = 0.0, 0, []
    instants = np.array([0, 10, 150, 290, 299])
    for seed in range(100, 100 + runs):
        rng = np.random.default_rng(seed)
        start = random_state(14)
        x = start.mean + start.factor @ rng.standard_normal(N)
        truth, y = [], np.empty((samples, 2))
        for j in range(samples):
            if j > 0:
                x = whole_transition(model, j - 1) @ x
                x[K:] += model.offset[j - 1]
                x[K - 2 : K] += model.noise[j - 1] * rng.standard_normal(2)
            truth.append(x)
            y[j] = x[K:] + model.sigma * rng.standard_normal(2)
        system = replace(model, measurement=y)
        forward = run_filter(system, start, instants)
        backward = run_smoother(system, forward, forward.state)
        squares += float(np.nansum(forward.innovations**2))
        count += 2 * int(model.measured.sum())
        errors = backward.means - np.array(truth)[instants]
        scores.append(errors / np.linalg.norm(backward.factors, axis=2))
    low, high = chi2.ppf([0.025, 0.975], count)
    assert low < squares < high
    # sum of 100 squares of standard normals: 1 +- 0.14; 35 of them, so 3.5 sigma
    spread = np.mean(np.square(scores), axis=0)
    assert np.all(np.abs(spread - 1) < 0.5), spread


def test_a_day_at_a_second_needs_little_memory() -> None:
    """86,400 samples of 13 states: the smoother holds some hundreds of states at a time."""
    samples = 86_400
    rng = np.random.default_rng(0)
    system = System(
        np.broadcast_to(np.eye(2), (samples - 1, 2, 2)),
        1e-3 * rng.standard_normal((samples - 1, 2, 11)),
        np.zeros((samples - 1, 2)),
        np.full((samples - 1, 6), 1e-6),
        1e-4 * rng.standard_normal((samples, 2)),
        np.ones(samples, dtype=np.bool_),
        np.full(2, 1e-4),
    )
    tracemalloc.start()
    forward = run_filter(system, State(np.zeros(13), 0.1 * np.eye(13)), checkpoints(samples))
    backward = run_smoother(system, forward, forward.state)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.isfinite(backward.rows).all()
    assert peak < 50e6  # asked for: 100 MB; all states would take 120 MB, with their factors of the noise 250
