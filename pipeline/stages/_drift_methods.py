"""The methods of identification that a test plan asks for, on the same samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import GyrostandError
from pipeline.models.drift_exact_rows import misalignment_of, values
from pipeline.models.drift_filter import Filtered, kalman
from pipeline.models.drift_gauss_newton import gauss_newton_and_noise
from pipeline.models.drift_linear import LinearFit, cumulative
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Prior, Problem
from pipeline.models.drift_relinearised import relinearised
from pipeline.models.drift_rows import nominal_of
from pipeline.models.drift_segments import segments
from pipeline.models.drift_trajectory import Transient, linear_trajectory, trajectory
from pipeline.models.drift_transient import STARTING, transient
from pipeline.models.earth import DEGREES_PER_HOUR, RATE
from pipeline.models.gyro_drift import DRIFT, TILT, Gyro
from pipeline.models.spiral_inversion import spiral_estimates
from pipeline.stages._drift_settings import Method, Settings
from pipeline.stages.base import StageError

Float = NDArray[np.float64]

ARCMIN, ARCSEC = float(np.deg2rad(1 / 60)), float(np.deg2rad(1 / 3600))

_ENOUGH = 4000
"""Samples of an arc that tell what the linear model neglects: one in 0.1 degrees of a day."""

_MORE_THAN_NOISE = 10.0
"""Residuals over short-term noise: noise of a correlation of 0.99 has 10, a drift that settles hundreds."""


@dataclass(frozen=True, slots=True)
class Fits:
    """What every method starts from.

    Attributes
    ----------
    linear : LinearFit
        The cumulative least squares: what it marked is no observation to any method.
    exact : Estimate or GyrostandError, optional
        Of gauss_newton, or why it cannot be done; None where the plan has not that method. The linear fit has
        what it neglects from the estimate.
    settling : Estimate, optional
        Of transient, where the plan has that method or a filter that wants its decay.
    settled : Problem
        The samples with what the linear model neglects at that estimate, or as in the linear fit.
    """

    linear: LinearFit
    exact: Estimate | GyrostandError | None
    settling: Estimate | None
    settled: Problem


@dataclass(frozen=True, slots=True)
class Identified:
    """What the methods give.

    Attributes
    ----------
    fits : Fits
    estimates : tuple of Estimate
        In the order of the plan; a method may give several.
    filtered : Filtered, optional
        What the filter tells beside its estimate.
    refused : mapping of Method to tuple of str
        What could not be done, and why.
    """

    fits: Fits
    estimates: tuple[Estimate, ...]
    filtered: Filtered | None
    refused: Mapping[Method, tuple[str, ...]]


def known_of(settings: Settings) -> dict[str, Prior]:
    """The drift parameters that the plan knows."""
    return {
        name: Prior(known.value_deg_h / DEGREES_PER_HOUR, known.sigma_deg_h / DEGREES_PER_HOUR)
        for name, known in settings.known.items()
    }


def priors_of(settings: Settings) -> dict[str, Prior]:
    """Priors of all parameters."""
    priors = {name: Prior(0.0, settings.prior_drift_deg_h / DEGREES_PER_HOUR) for name in DRIFT}
    priors |= {name: Prior(0.0, settings.prior_tilt_arcmin * ARCMIN) for name in TILT}
    priors["epsilon"] = Prior(0.0, settings.prior_misalignment_arcmin * ARCMIN)
    return priors | known_of(settings)


def useful_of(settings: Settings) -> Float:
    """Standard errors above which a drift [1] and an angle [rad] are not determined, shape (2,)."""
    return np.array([settings.useful_drift_deg_h / DEGREES_PER_HOUR, settings.useful_angle_arcmin * ARCMIN])


def fitted(problem: Problem, settings: Settings) -> Fits:
    """The linear fit; by the plan's choice the exact one and a transient, and the linear one about them.

    Raises
    ------
    StageError
        If no sample was measured.
    """
    if not any(arc.measured.any() for arc in problem.arcs):
        raise StageError(
            "stage identify",
            expected="measured angles",
            found="none: all were bridged",
            remedy="lower resample.max_gap or identify.hold_out, or record anew",
        )
    linear = _linear(problem, settings)
    exact = _exact(linear, settings) if "gauss_newton" in settings.methods else None
    described = isinstance(exact, Estimate) and _describes(exact, linear.cleaned)
    if isinstance(exact, Estimate) and described and settings.installation_errors:
        linear = _linear(relinearised(problem, exact), settings)
    settling, settled = None, linear.cleaned
    if "transient" in settings.methods or _wants_decay(settings):
        known = described or not settings.installation_errors
        settling, settled = _settling(linear.cleaned, settings, linearise=not known)
    return Fits(linear, exact, settling, settled)


def _exact(linear: LinearFit, settings: Settings) -> Estimate | GyrostandError:
    try:
        return gauss_newton_and_noise(
            linear.cleaned, linear.estimate, sigma=_given_sigma(settings), coloured=settings.coloured
        )[0]
    except GyrostandError as error:
        return error


def _settling(problem: Problem, settings: Settings, *, linearise: bool) -> tuple[Estimate, Problem]:
    """The transient; where asked for, with what the linear model neglects at a first estimate of it."""

    def of(problem: Problem, bracket: tuple[float, float] | None = None, *, coloured: bool) -> Estimate:
        return transient(
            problem,
            quadrature=settings.quadrature,
            sigma=_given_sigma(settings),
            decay=_given_decay(settings),
            bracket=bracket,
            coloured=coloured,
        )

    if not linearise:
        return of(problem, coloured=settings.coloured), problem
    # What the linear model neglects looks like coloured noise: no account of that before it is known. It is
    # smooth, and known well enough from some of the samples.
    coarse = _thinned(problem)
    found, about = of(coarse, coloured=False), problem
    for record, coloured in ((coarse, False), (problem, settings.coloured)):
        if "decay" not in found.figures:
            return of(problem, coloured=settings.coloured), problem
        k = found.figures["decay"]
        about = relinearised(record, found)
        found = of(about, (k / 2, 2 * k), coloured=coloured)
    return found, about if "decay" in found.figures else problem


def _thinned(problem: Problem) -> Problem:
    """The problem with no more than some thousand samples an arc."""
    every = max(max(len(arc.tau) for arc in problem.arcs) // _ENOUGH, 1)
    arcs = [Arc(a.run, a.tau[::every], a.alpha[::every], a.measured[::every]) for a in problem.arcs]
    return replace(problem, arcs=tuple(arcs))


def _describes(exact: Estimate, problem: Problem) -> bool:
    """Whether a fit leaves little more than noise: only then does it tell what the linear model neglects."""
    left = np.concatenate(
        [(a.alpha - model)[a.measured] for a, model in zip(problem.arcs, exact.predicted, strict=True)]
    )
    noise = _short_term_sigma(problem, exact.predicted)
    within = float(np.sqrt(np.mean(left**2))) <= _MORE_THAN_NOISE * noise
    return bool(exact.figures["converged"]) and within


def _linear(problem: Problem, settings: Settings) -> LinearFit:
    return cumulative(
        problem,
        quadrature=settings.quadrature,
        sigma=_given_sigma(settings),
        robust=settings.robust,
        coloured=settings.coloured,
    )


def _given_sigma(settings: Settings) -> float | None:
    return None if settings.noise_arcsec is None else settings.noise_arcsec * ARCSEC


def identify(problem: Problem, settings: Settings) -> Identified:
    """Every method of the plan, in its order."""
    fits = fitted(problem, settings)
    estimates: list[Estimate] = []
    refused: dict[Method, tuple[str, ...]] = {}
    filtered = None
    for method in settings.methods:
        try:
            if method == "spiral":
                found, reasons = spiral_estimates(fits.linear.cleaned, known_of(settings))
                estimates += found
                refused[method] = tuple(str(reason) for reason in reasons)
            elif method == "filter":
                filtered = _filtered(fits, settings)
                estimates += [e for e in (filtered.estimate, filtered.smoothed) if e is not None]
            else:
                estimates.append(one(method, fits, settings))
        except GyrostandError as error:
            refused[method] = (str(error),)
    return Identified(fits, tuple(estimates), filtered, refused)


def one(method: Method, fits: Fits, settings: Settings) -> Estimate:
    """The estimate of one method from screened samples."""
    fit = fits.linear
    match method:
        case "cumulative":
            return fit.estimate
        case "gauss_newton":
            assert fits.exact is not None, "fitted where the plan has the method"
            if isinstance(fits.exact, GyrostandError):
                raise fits.exact
            return fits.exact
        case "segments":
            return segments(
                fit.cleaned,
                length=settings.segment_length,
                quadrature=settings.quadrature,
                sigma=_given_sigma(settings),
                autoregression=fit.autoregression,
            )
        case "transient":
            assert fits.settling is not None, "fitted where the plan has the method"
            return fits.settling
        case "filter":
            return _filtered(fits, settings.model_copy(update={"smooth": False})).estimate
        case "spiral":
            return spiral_estimates(fit.cleaned, known_of(settings))[0][0]


def _filtered(fits: Fits, settings: Settings) -> Filtered:
    """The filter; of coloured noise it takes the white noise of the same power at low frequencies."""
    walks, linear = settings.process_noise != "none", fits.linear
    problem = fits.settled if walks else linear.cleaned
    told = _short_term_sigma(problem, linear.estimate.predicted) if walks else white_sigma(linear)
    return kalman(
        problem,
        sigma=_given_sigma(settings) or told,
        quadrature=settings.quadrature,
        nominal=np.array(linear.nominal),
        process_noise=settings.process_noise,
        process_sigma=settings.process_sigma,
        decay=_decay(fits, settings),
        smooth=settings.smooth,
        instants=settings.instants,
    )


def _short_term_sigma(problem: Problem, predicted: Sequence[Float]) -> float:
    """Standard deviation of an angle from second differences of the residuals, [1, -2, 1], of variance 6.

    Where the model lacks something slow, a drift that walks or settles, the residuals hold it, and these do
    not.
    """
    squares, count = 0.0, 0
    for arc, model in zip(problem.arcs, predicted, strict=True):
        told = arc.measured[2:] & arc.measured[1:-1] & arc.measured[:-2]
        second = np.diff(arc.alpha - model, n=2, axis=0)[told]
        squares, count = squares + float(np.sum(second**2)), count + second.size
    return float(np.sqrt(squares / (6 * max(count, 1))))


def white_sigma(fit: LinearFit) -> float:
    """Standard deviation of white noise on the angles that would move the parameters like the noise."""
    if fit.autoregression is None:
        return fit.estimate.sigma
    return fit.estimate.figures["innovation_sigma"] * fit.autoregression.gain


def _given_decay(settings: Settings) -> float | None:
    """Decay k of the transient from the plan, in units of the Earth rate."""
    return None if settings.transient_hours is None else 1 / (settings.transient_hours * 3600 * RATE)


def _wants_decay(settings: Settings) -> bool:
    return (
        "filter" in settings.methods
        and settings.process_noise == "decaying"
        and settings.transient_hours is None
    )


def _decay(fits: Fits, settings: Settings) -> float | None:
    """Decay k for the filter: from the plan, else as the method transient finds it."""
    if not _wants_decay(settings):
        return _given_decay(settings)
    assert fits.settling is not None, "fitted where the filter wants it"
    if "decay" not in fits.settling.figures:
        raise StageError(
            "method filter",
            expected="a transient, for process_noise = 'decaying'",
            found="none: a constant drift explains the record as well",
            remedy='set identify.process_noise = "none", or give transient_hours',
        )
    return fits.settling.figures["decay"]


def hold_out(problem: Problem, method: Method, settings: Settings) -> tuple[Estimate, tuple[Float, ...]]:
    """Fit one method to the first part of every arc, and predict the whole of it.

    Parameters
    ----------
    problem : Problem
        With the outliers marked.
    method : str
    settings : Settings

    Returns
    -------
    estimate : Estimate
        Of the first parts.
    predicted : tuple of ndarray, one an arc, each of shape (n, 2)
        Angles of the whole arcs by the model with that estimate [rad].
    """
    first = replace(problem, arcs=tuple(_beginning(arc, settings.hold_out) for arc in problem.arcs))
    needed = [m for m in (method, "gauss_newton") if m in settings.methods]
    estimate = one(method, fitted(first, settings.model_copy(update={"methods": tuple(needed)})), settings)
    # As the method's model was: exact, but for a linear one that knows nothing of what it neglects.
    exactly = "gauss_newton" in settings.methods or method == "transient"
    follow = _exactly if exactly and settings.installation_errors else _linearly
    predicted = tuple(
        follow(estimate, problem, arc, estimate.predicted[number][0])
        for number, arc in enumerate(problem.arcs)
    )
    return estimate, predicted


def _beginning(arc: Arc, share: float) -> Arc:
    """An arc without its last part."""
    kept = slice(0, len(arc.tau) - round(share * len(arc.tau)))
    return Arc(arc.run, arc.tau[kept], arc.alpha[kept], arc.measured[kept])


def _exactly(estimate: Estimate, problem: Problem, arc: Arc, start: Float) -> Float:
    """Angles of an arc by the exact model."""
    base = problem.bases[arc.run]
    standing = base.misaligned(misalignment_of(estimate, base, arc.run))
    gyro = Gyro(values(estimate, DRIFT), values(estimate, TILT))
    return trajectory(gyro, standing, start, arc.tau, _change(estimate))


def _linearly(estimate: Estimate, problem: Problem, arc: Arc, start: Float) -> Float:
    """Angles of an arc by the linear model."""
    base = problem.bases[arc.run]
    return linear_trajectory(nominal_of(estimate, arc.run), base, start, arc.tau, _change(estimate))


def _change(estimate: Estimate) -> Transient | None:
    """How the drift settles, of an estimate that knows of it."""
    if Parameter(STARTING[0]) not in estimate.parameters:
        return None
    return Transient(values(estimate, STARTING), estimate.figures["decay"])
