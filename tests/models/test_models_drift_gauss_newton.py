"""Gauss-Newton on the exact model against simulated truth: exact without noise, honest with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.drift_exact_rows import DELTA_CHI
from pipeline.models.drift_gauss_newton import gauss_newton, gauss_newton_and_noise, predict_arc
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Prior, Problem
from pipeline.models.drift_regression import integrals
from pipeline.models.drift_trajectory import TrajectoryError, Transient, trajectory
from pipeline.models.earth import Base, Scheme, mounting_angles, rotation_vector_from_increments
from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, PARAMETERS, TILT, Gyro, misalignment_basis
from pipeline.numerics.least_squares import solve
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]
SCHEMES: tuple[Scheme, ...] = ("polar", "equatorial", "horizontal", "vertical")
LATITUDE, DAY, ARCMIN = np.deg2rad(55.75), 6.300387, np.deg2rad(1 / 60)
ARCSEC = ARCMIN / 60
DEGREES_PER_HOUR = 15.041067
START = {"polar": (0.6, 0.5), "equatorial": (0.0, 0.6), "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)}
M, THETA = np.full(6, 0.01), np.full(2, 10 * ARCMIN)
PRIORS = {
    **{name: Prior(0.0, 0.1) for name in DRIFT},
    **{name: Prior(0.0, 15 * ARCMIN) for name in TILT},
    "epsilon": Prior(0.0, 1.5 * ARCMIN),
}


def increments(scheme: Scheme) -> Float:
    """Delta chi of one arc minute in each of the angles chi."""
    return rotation_vector_from_increments((ARCMIN, ARCMIN, ARCMIN), mounting_angles(scheme, LATITUDE))


def recorded(
    scheme: Scheme,
    start: Sequence[float],
    tau: Float,
    *,
    run: int = 0,
    gyro: Gyro | None = None,
    misalignment: Float | None = None,
    noise: Float | float = 0.0,
) -> Arc:
    """An arc of the exact model, by default with the installation errors of MATH 2.5."""
    turn = increments(scheme) if misalignment is None else misalignment
    standing = Base.mounted(scheme, LATITUDE).misaligned(turn)
    alpha = trajectory(
        Gyro(M, THETA) if gyro is None else gyro, standing, np.asarray(start, dtype=float), tau
    )
    return Arc(run, tau, alpha + noise, np.ones(len(tau), dtype=np.bool_))


def white(seed: int, count: int) -> Float:
    return ARCSEC * np.random.default_rng(seed).standard_normal((count, 2))


def linear(problem: Problem, sigma: float) -> Estimate:
    """Cumulative least squares of the first arc weighted by the priors: where Gauss-Newton starts."""
    arc, base = problem.arcs[0], problem.bases[0]
    A, b, names = integrals(arc.tau, arc.alpha, base, "quintic_spline", errors=True).cumulative(arc.alpha)
    prior = [np.inf] * 2 + [0.1] * 6 + [15 * ARCMIN] * 2 + [1.5 * ARCMIN] * 2
    found = solve(A, b, names, prior=np.array(prior), sigma=sigma).estimate
    parameters = [Parameter(name, 0 if name in MISALIGNMENT else None) for name in PARAMETERS]
    value = np.concatenate([found[2:10], misalignment_basis(base) @ found[10:]])
    for run in range(1, len(problem.bases)):
        parameters += [Parameter(name, run) for name in MISALIGNMENT]
        value = np.concatenate([value, np.zeros(3)])
    predicted = (found[np.newaxis, :2], *(other.alpha[:1] for other in problem.arcs[1:]))
    return Estimate("cumulative", tuple(parameters), value, np.zeros((len(value),) * 2), sigma, predicted)


def identified(problem: Problem, sigma: float, **options: AutoRegression | int) -> Estimate:
    return gauss_newton(problem, linear(problem, sigma), sigma=sigma, **options)  # type: ignore[arg-type]


def one_run(arc: Arc, scheme: Scheme) -> Problem:
    return Problem((Base.mounted(scheme, LATITUDE),), (arc,), PRIORS)


def test_the_parameters_by_name() -> None:
    estimate = identified(one_run(recorded("vertical", (0, 0), np.linspace(0, DAY, 145)), "vertical"), ARCSEC)
    own = [Parameter(name, 0) for name in (*DELTA_CHI, *MISALIGNMENT)]
    assert estimate.parameters == (*map(Parameter, (*DRIFT, *TILT)), *own)
    assert estimate.method == "gauss_newton"
    u = Base.mounted("vertical", LATITUDE).u
    epsilon = estimate.of(MISALIGNMENT, 0)
    np.testing.assert_allclose(epsilon, np.cross(u, estimate.value[8:11]), rtol=0, atol=1e-18)
    # bound to u.epsilon = 0, so is the covariance
    np.testing.assert_allclose(estimate.covariance[11:, 11:] @ u, 0, atol=1e-15 * estimate.covariance.max())


@pytest.mark.parametrize("scheme", SCHEMES)
def test_without_noise_it_is_exact(scheme: Scheme) -> None:
    """MATH 2.5: at most 5e-8 degrees an hour in 2 to 4 iterations, weighted with 1e-3 arcsec."""
    problem = one_run(recorded(scheme, START[scheme], np.linspace(0, DAY, 1441)), scheme)
    estimate = identified(problem, 1e-3 * ARCSEC)
    assert np.abs(estimate.of(DRIFT) - M).max() * DEGREES_PER_HOUR < 5e-8
    assert 2 <= estimate.figures["iterations"] <= 4
    assert estimate.figures["converged"] == 1
    assert estimate.notes == ()
    # the priors pull by (standard error / prior)^2 of what they are wrong by: in scheme II, where theta and
    # Delta chi along u have standard errors of 0.2 to 0.3 arcsec, by 1e-3 arcsec
    np.testing.assert_allclose(estimate.of(TILT), THETA, rtol=0, atol=5e-3 * ARCSEC)
    np.testing.assert_allclose(estimate.value[8:11], increments(scheme), rtol=0, atol=5e-3 * ARCSEC)
    # of what is fitted nothing is left: 1e-3 of the noise that it was weighted with
    assert estimate.figures["residual_sigma"] < 1e-6 * ARCSEC
    np.testing.assert_allclose(estimate.predicted[0], problem.arcs[0].alpha, rtol=0, atol=1e-5 * ARCSEC)


def test_scheme_1_from_zero_is_reported_as_ill_determined() -> None:
    """From the pole itself a combination rests on the priors, however small the noise."""
    problem = one_run(recorded("polar", (0, 0), np.linspace(0, DAY, 1441)), "polar")
    estimate = identified(problem, 1e-3 * ARCSEC, max_iterations=30)
    assert any("ill-determined" in note for note in estimate.notes)
    assert any("little of epsilon1 of run 0" in note for note in estimate.notes)
    assert estimate.figures["condition"] > 1e7  # MATH 2.5: 1.1e7 without Delta chi along u
    # what it says is no lie: the error is within its standard errors, thousands of times those elsewhere
    errors = (estimate.of(DRIFT) - M) / estimate.standard_errors[:6]
    assert np.abs(errors).max() < 3
    assert estimate.standard_errors[5] * DEGREES_PER_HOUR > 1e-3


@pytest.mark.parametrize(
    ("scheme", "others", "special"),
    [
        ("polar", (1e-5, 2e-4), {"mc2": 8e-4}),
        ("equatorial", (1e-5, 2e-4), {"m11": 1e-3, "mc2": 7e-4}),
        ("horizontal", (1e-5, 2e-4), {}),
        ("vertical", (1e-5, 2e-4), {"mc2": 2.3e-3}),
    ],
)
def test_standard_errors(scheme: Scheme, others: tuple[float, float], special: dict[str, float]) -> None:
    """MATH 2.5, with noise of 1 arcsec each minute of a day, in degrees an hour; one digit is given."""
    arc = recorded(scheme, START[scheme], np.linspace(0, DAY, 1441), noise=white(1, 1441))
    estimate = identified(one_run(arc, scheme), ARCSEC)
    for name, error in zip(DRIFT, estimate.standard_errors[:6] * DEGREES_PER_HOUR, strict=True):
        if name in special:
            assert error == pytest.approx(special[name], rel=0.15), name
        else:
            assert others[0] < error < others[1], name


def spread(scheme: Scheme) -> Float:
    """Standard deviation over 200 seeds of each error in its standard errors.

    Installation errors are drawn from their priors, as the priors say: then a parameter that the record
    says little of has an honest standard error too, and none needs to be left out.
    """
    scores = []
    for seed in range(200):
        generator = np.random.default_rng([seed, SCHEMES.index(scheme)])
        theta, turn = 15 * ARCMIN * generator.standard_normal(2), 1.5 * ARCMIN * generator.standard_normal(3)
        arc = recorded(
            scheme,
            START[scheme],
            np.linspace(0, DAY, 1441),
            gyro=Gyro(M, theta),
            misalignment=turn,
            noise=ARCSEC * generator.standard_normal((1441, 2)),
        )
        problem = one_run(arc, scheme)
        estimate = identified(problem, ARCSEC)
        assert estimate.figures["converged"] == 1
        truth = np.concatenate([M, theta, turn, np.cross(problem.bases[0].u, turn)])
        # across u in the equatorial scheme one of epsilon is 0 exactly, with no error
        certain = estimate.standard_errors < 1e-12
        scores.append(
            np.where(
                certain, np.nan, (estimate.value - truth) / np.where(certain, 1, estimate.standard_errors)
            )
        )
    deviation = np.std(scores, axis=0)
    return deviation[np.isfinite(deviation)]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_standard_errors_are_honest(scheme: Scheme) -> None:
    """Two standard deviations of what as many seeds tell."""
    found = spread(scheme)
    assert len(found) >= 13
    assert np.all(np.abs(found - 1) < 0.1), found


def test_several_runs_and_arcs_determine_what_one_does_not() -> None:
    """Scheme II from 0 and from 0.8, each its own misalignment; the second is interrupted, with outliers."""
    tau = np.linspace(0, DAY / 2, 721)
    turns = [increments("equatorial"), -0.5 * increments("equatorial")]
    first = recorded("equatorial", (0, 0), tau, misalignment=turns[0])
    second = recorded("equatorial", (0, 0.8), tau, run=1, misalignment=turns[1])
    marked = np.ones(300, dtype=np.bool_)
    marked[[20, 21, 150]] = False
    spoilt = second.alpha[:300].copy()
    spoilt[~marked] += 0.1
    base = Base.mounted("equatorial", LATITUDE)
    arcs = (
        first,
        Arc(1, tau[:300], spoilt, marked),
        replace(second, tau=tau[400:], alpha=second.alpha[400:], measured=np.ones(321, dtype=np.bool_)),
    )
    problem = Problem((base, base), arcs, PRIORS)
    both = identified(problem, 1e-3 * ARCSEC)
    alone = identified(Problem((base,), arcs[:1], PRIORS), 1e-3 * ARCSEC)
    assert both.figures["condition"] < alone.figures["condition"] / 3
    assert np.all(both.standard_errors[:6] < alone.standard_errors[:6])
    assert np.abs(both.of(DRIFT) - M).max() * DEGREES_PER_HOUR < 5e-8  # as for one run
    np.testing.assert_allclose(both.of(TILT), THETA, rtol=0, atol=5e-3 * ARCSEC)
    for run, turn in enumerate(turns):
        np.testing.assert_allclose(
            both.of(MISALIGNMENT, run), np.cross(base.u, turn), rtol=0, atol=5e-3 * ARCSEC
        )
    assert [len(predicted) for predicted in both.predicted] == [721, 300, 321]
    # what was not measured is predicted, and does not count
    np.testing.assert_allclose(both.predicted[1], second.alpha[:300], rtol=0, atol=1e-5 * ARCSEC)
    assert both.figures["degrees_of_freedom"] < 2 * (721 + 297 + 321)


def test_coloured_noise() -> None:
    """Of an autoregression of 0.9, 1 arcsec of noise is as bad as 4: with it that is said, without not."""
    colour = AutoRegression(np.array([0.9]))
    scores: dict[bool, list[Float]] = {True: [], False: []}
    for seed in range(40):
        noise = lfilter([1.0], [1.0, -0.9], white(seed, 1541), axis=0)[100:] / colour.spread
        problem = one_run(
            recorded("horizontal", (0, 0), np.linspace(0, DAY, 1441), noise=noise), "horizontal"
        )
        for known, found in scores.items():
            estimate = identified(problem, ARCSEC, **({"autoregression": colour} if known else {}))
            found.append((estimate.of(DRIFT) - M) / estimate.standard_errors[:6])
            # chi-square of 2865 degrees has a spread of 2.6 %, and of coloured noise four times that
            assert estimate.figures["residual_sigma"] == pytest.approx(ARCSEC, rel=0.2)
    assert np.all(np.abs(np.std(scores[True], axis=0) - 1) < 0.34)  # as above
    # slow noise has (1 + 0.9) / (1 - 0.9) = 19 times the variance of white noise: 4.4 times the error
    assert np.all(np.std(scores[False], axis=0) > 2.5)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_noise_is_told_by_the_residuals(scheme: Scheme) -> None:
    """White noise of 1 arcsec, started as of 100; what the linear model neglects is not in it."""
    problem = one_run(
        recorded(scheme, START[scheme], np.linspace(0, DAY, 1441), noise=white(7, 1441)), scheme
    )
    estimate, colour = gauss_newton_and_noise(problem, linear(problem, 100 * ARCSEC))
    assert colour is None
    assert estimate.figures["order"] == 0
    assert estimate.figures["whiteness"] > 0.01
    # 1 / sqrt(2 * 2865) = 1.3 %, three of which
    assert estimate.sigma == pytest.approx(ARCSEC, rel=0.04)
    known = identified(problem, estimate.sigma)
    # the same minimum from another start: steps end at 1e-3 standard errors
    np.testing.assert_allclose(estimate.value, known.value, rtol=0, atol=2e-3 * known.standard_errors.max())
    np.testing.assert_allclose(estimate.standard_errors, known.standard_errors, rtol=1e-3, atol=1e-15)


def test_coloured_noise_is_recognised() -> None:
    colour = AutoRegression(np.array([0.9]))
    scores = []
    for seed in range(20):
        noise = lfilter([1.0], [1.0, -0.9], white(seed, 1541), axis=0)[100:] / colour.spread
        problem = one_run(recorded("vertical", (0, 0), np.linspace(0, DAY, 1441), noise=noise), "vertical")
        estimate, found = gauss_newton_and_noise(problem, linear(problem, ARCSEC))
        assert found is not None
        assert found.order == estimate.figures["order"]
        assert any("coloured residuals" in note for note in estimate.notes)
        # a coefficient is known to sqrt(1 - 0.9^2) / sqrt(2880) = 0.008; of higher orders their sum counts
        assert found.gain == pytest.approx(10, rel=0.5)
        scores.append((estimate.of(DRIFT) - M) / estimate.standard_errors[:6])
    # 20 seeds of 6 parameters: a spread is known to 1/sqrt(40), three times which is 0.47
    assert np.all(np.abs(np.std(scores, axis=0) - 1) < 0.47)


def test_a_given_noise_is_kept_and_what_is_below_it_has_no_colour() -> None:
    problem = one_run(recorded("vertical", (0, 0), np.linspace(0, DAY, 1441)), "vertical")
    estimate, colour = gauss_newton_and_noise(problem, linear(problem, ARCSEC), sigma=1e-3 * ARCSEC)
    assert colour is None
    assert estimate.sigma == 1e-3 * ARCSEC
    assert np.abs(estimate.of(DRIFT) - M).max() * DEGREES_PER_HOUR < 5e-8
    estimate, colour = gauss_newton_and_noise(problem, linear(problem, ARCSEC))
    assert colour is None
    assert estimate.sigma == pytest.approx(1e-9)  # the least: of noise there is none


def test_a_drift_that_has_not_settled_is_not_passed_over() -> None:
    """A transient of e-fold 1.9 h that the model lacks, without any noise: residuals as smooth as can be."""
    base, tau = Base.mounted("vertical", LATITUDE), np.linspace(0, DAY, 721)
    alpha = trajectory(Gyro(M, THETA), base, np.zeros(2), tau, Transient(np.full(6, 0.02), 2.0))
    problem = one_run(Arc(0, tau, alpha, np.ones(721, dtype=np.bool_)), "vertical")
    estimate, colour = gauss_newton_and_noise(problem, linear(problem, ARCSEC))
    assert colour is not None
    assert estimate.figures["whiteness"] < 1e-6
    assert any("has not settled" in note for note in estimate.notes)


def test_a_sample_a_second() -> None:
    """86,400 samples are all used: the standard errors fall as the square root of their number."""
    many, few = (
        identified(
            one_run(recorded("horizontal", (0, 0), np.linspace(0, DAY, n), noise=white(5, n)), "horizontal"),
            ARCSEC,
        )
        for n in (86401, 1441)
    )
    ratio = many.standard_errors[:6] / few.standard_errors[:6]
    np.testing.assert_allclose(ratio, 60**-0.5, rtol=0.02)  # the ends weigh a little more in few
    assert np.all(np.abs(many.of(DRIFT) - M) < 4 * many.standard_errors[:6])  # four standard errors, one seed
    assert many.figures["degrees_of_freedom"] == pytest.approx(2 * 86401, abs=15)


def test_without_installation_errors_only_the_drift_is_sought() -> None:
    none = np.zeros(3)
    arc = recorded(
        "vertical", (0.1, 0.2), np.linspace(0, DAY, 721), gyro=Gyro(M, none[:2]), misalignment=none
    )
    problem = replace(one_run(arc, "vertical"), installation=False)
    estimate = identified(problem, 1e-3 * ARCSEC)
    assert estimate.parameters == tuple(map(Parameter, DRIFT))
    assert np.abs(estimate.value - M).max() * DEGREES_PER_HOUR < 5e-8


def test_a_parameter_known_before_stays() -> None:
    """A prior far sharper than the record decides, mean and all."""
    arc = recorded("vertical", (0, 0), np.linspace(0, DAY, 721), noise=white(2, 721))
    problem = one_run(arc, "vertical")
    known = replace(problem, priors={**PRIORS, "mc2": Prior(0.0101, 1e-7)})
    estimate = identified(known, ARCSEC)
    # its pull by the record is (1e-7 / 1.5e-4)^2 of an error of 1e-4
    assert estimate.of(["mc2"])[0] == pytest.approx(0.0101, abs=1e-9)
    assert estimate.standard_errors[5] == pytest.approx(1e-7, rel=1e-3)
    assert any("little of mc2" in note for note in estimate.notes)


def test_a_far_start_is_reached_by_halving_steps() -> None:
    """From a drift of 1.5 deg/h and a tilt of 6 degrees the linearised steps are too long."""
    problem = one_run(recorded("vertical", (0, 0), np.linspace(0, DAY, 721)), "vertical")
    near = linear(problem, 1e-3 * ARCSEC)
    away = near.value + np.concatenate([np.full(6, 0.1), [0.1, -0.1], np.zeros(3)])
    estimate = gauss_newton(problem, replace(near, value=away), sigma=1e-3 * ARCSEC, max_iterations=30)
    assert estimate.figures["converged"] == 1
    assert np.abs(estimate.of(DRIFT) - M).max() * DEGREES_PER_HOUR < 5e-8


def test_too_few_iterations_are_said() -> None:
    problem = one_run(recorded("polar", START["polar"], np.linspace(0, DAY, 721)), "polar")
    estimate = identified(problem, 1e-3 * ARCSEC, max_iterations=1)
    assert estimate.figures["iterations"] == 1
    assert estimate.figures["converged"] == 0
    assert any("did not converge in 1 iterations" in note for note in estimate.notes)


def test_without_priors_what_nothing_determines_is_said() -> None:
    """Delta chi along u acts by way of gravity alone: without drift not at all."""
    still = Gyro(np.zeros(6), np.zeros(2))
    arc = recorded("equatorial", (0.2, 0.0), np.linspace(0, DAY, 721), gyro=still, misalignment=np.zeros(3))
    problem = replace(one_run(arc, "equatorial"), priors={})
    start = linear(problem, ARCSEC)
    estimate = gauss_newton(problem, replace(start, value=np.zeros(11)), sigma=ARCSEC)
    assert any("nothing determines" in note for note in estimate.notes)
    assert estimate.figures["condition"] > 1e12


def test_a_start_that_cannot_be_is_an_error() -> None:
    problem = one_run(recorded("vertical", (0, 0), np.linspace(0, DAY, 145)), "vertical")
    start = replace(linear(problem, ARCSEC), predicted=(np.array([[0.0, np.pi / 2]]),))
    with pytest.raises(TrajectoryError, match="90 degrees"):
        gauss_newton(problem, start, sigma=ARCSEC)


def test_samples_that_were_not_seen_are_predicted() -> None:
    """Fit on 16 hours, predict the other 8 without noise; also from epsilon alone, as of a linear method."""
    tau, base = np.linspace(0, DAY, 1441), Base.mounted("horizontal", LATITUDE)
    whole = recorded("horizontal", (0, 0), tau)
    part = replace(whole, tau=tau[:961], alpha=whole.alpha[:961], measured=whole.measured[:961])
    estimate = identified(one_run(part, "horizontal"), 1e-3 * ARCSEC)
    predicted = predict_arc(estimate, base, estimate.predicted[0][-1], tau[960:], 0)
    np.testing.assert_allclose(predicted, whole.alpha[960:], rtol=0, atol=1e-5 * ARCSEC)
    kept = [p.name not in DELTA_CHI for p in estimate.parameters]
    without = Estimate(
        "cumulative",
        tuple(p for p in estimate.parameters if p.name not in DELTA_CHI),
        estimate.value[kept],
        estimate.covariance[np.ix_(kept, kept)],
        estimate.sigma,
        estimate.predicted,
    )
    predicted = predict_arc(without, base, estimate.predicted[0][-1], tau[960:], 0)
    # Delta chi along u acts by m of it: 0.01 of 1 arcmin, for 2 rad
    assert 1e-3 * ARCSEC < np.abs(predicted - whole.alpha[960:]).max() < 2 * ARCSEC
