"""The methods of identification that a test plan asks for, on the same samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import GyrostandError
from pipeline.models.drift_filter import Filtered, kalman
from pipeline.models.drift_gauss_newton import gauss_newton_and_noise, predict_arc
from pipeline.models.drift_linear import LinearFit, cumulative
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Prior, Problem
from pipeline.models.drift_relinearised import relinearised
from pipeline.models.drift_rows import nominal_of
from pipeline.models.drift_segments import segments
from pipeline.models.drift_trajectory import Transient, linear_trajectory
from pipeline.models.drift_transient import transient
from pipeline.models.earth import DEGREES_PER_HOUR, RATE
from pipeline.models.gyro_drift import DRIFT, TILT
from pipeline.models.spiral_inversion import spiral_estimates
from pipeline.stages._drift_settings import Method, Settings
from pipeline.stages.base import StageError

Float = NDArray[np.float64]

ARCMIN, ARCSEC = float(np.deg2rad(1 / 60)), float(np.deg2rad(1 / 3600))

STARTING = tuple(f"{name}_0" for name in DRIFT)
"""The drift at the beginning of a transient, m0."""


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
    """

    linear: LinearFit
    exact: Estimate | GyrostandError | None


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
    """The linear fit, and by the plan's choice the exact one and the linear one about it."""
    linear = _linear(problem, settings)
    if "gauss_newton" not in settings.methods:
        return Fits(linear, None)
    try:
        exact, _ = gauss_newton_and_noise(
            linear.cleaned, linear.estimate, sigma=_given_sigma(settings), coloured=settings.coloured
        )
    except GyrostandError as error:
        return Fits(linear, error)
    # Without installation errors the linear model is exact: it neglects their products with the drift alone.
    if not (exact.figures["converged"] and settings.installation_errors):
        return Fits(linear, exact)
    return Fits(_linear(relinearised(problem, exact), settings), exact)


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
                filtered = _filtered(fits.linear, settings, _decay(fits, settings, estimates))
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
            return transient(
                fit.cleaned,
                quadrature=settings.quadrature,
                sigma=_given_sigma(settings),
                decay=_given_decay(settings),
            )
        case "filter":
            without = settings.model_copy(update={"smooth": False})
            return _filtered(fit, without, _decay(fits, without, ())).estimate
        case "spiral":
            return spiral_estimates(fit.cleaned, known_of(settings))[0][0]


def _filtered(fit: LinearFit, settings: Settings, decay: float | None) -> Filtered:
    """The filter; of coloured noise it takes the white noise of the same power at low frequencies."""
    walks = settings.process_noise != "none"
    return kalman(
        fit.cleaned,
        sigma=_given_sigma(settings) or (_short_term_sigma(fit) if walks else white_sigma(fit)),
        quadrature=settings.quadrature,
        nominal=np.array(fit.nominal),
        process_noise=settings.process_noise,
        process_sigma=settings.process_sigma,
        decay=decay,
        smooth=settings.smooth,
        instants=settings.instants,
    )


def _short_term_sigma(fit: LinearFit) -> float:
    """Standard deviation of an angle from second differences of the residuals, [1, -2, 1], of variance 6.

    Where the drift walks, the residuals of constant parameters hold its slow course, which these do not.
    """
    squares, count = 0.0, 0
    for arc, predicted in zip(fit.cleaned.arcs, fit.estimate.predicted, strict=True):
        told = arc.measured[2:] & arc.measured[1:-1] & arc.measured[:-2]
        second = np.diff(arc.alpha - predicted, n=2, axis=0)[told]
        squares, count = squares + float(np.sum(second**2)), count + second.size
    return float(np.sqrt(squares / (6 * count))) if count else fit.estimate.sigma


def white_sigma(fit: LinearFit) -> float:
    """Standard deviation of white noise on the angles that would move the parameters like the noise."""
    if fit.autoregression is None:
        return fit.estimate.sigma
    return fit.estimate.figures["innovation_sigma"] * fit.autoregression.gain


def _given_decay(settings: Settings) -> float | None:
    """Decay k of the transient from the plan, in units of the Earth rate."""
    return None if settings.transient_hours is None else 1 / (settings.transient_hours * 3600 * RATE)


def _decay(fits: Fits, settings: Settings, estimates: Sequence[Estimate]) -> float | None:
    """Decay k for the filter: from the plan, else as the method transient finds it."""
    given = _given_decay(settings)
    if given is not None or settings.process_noise != "decaying":
        return given
    found = next((e for e in estimates if e.method == "transient"), None) or one("transient", fits, settings)
    if "decay" not in found.figures:
        raise StageError(
            "method filter",
            expected="a transient, for process_noise = 'decaying'",
            found="none: a constant drift explains the record as well",
            remedy='set identify.process_noise = "none", or give transient_hours',
        )
    return found.figures["decay"]


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
    estimate = one(method, fitted(first, settings), settings)
    predicted = tuple(
        _continued(estimate, problem, arc, estimate.predicted[number][0])
        for number, arc in enumerate(problem.arcs)
    )
    return estimate, predicted


def _beginning(arc: Arc, share: float) -> Arc:
    """An arc without its last part."""
    kept = slice(0, len(arc.tau) - round(share * len(arc.tau)))
    return Arc(arc.run, arc.tau[kept], arc.alpha[kept], arc.measured[kept])


def _continued(estimate: Estimate, problem: Problem, arc: Arc, start: Float) -> Float:
    """Angles of an arc by the model that the method fits."""
    base = problem.bases[arc.run]
    if estimate.method == "gauss_newton":
        return predict_arc(estimate, base, start, arc.tau, arc.run)
    change = None
    if estimate.method == "transient" and Parameter(STARTING[0]) in estimate.parameters:
        change = Transient(estimate.of(STARTING), estimate.figures["decay"])
    return linear_trajectory(nominal_of(estimate, arc.run), base, start, arc.tau, change)
