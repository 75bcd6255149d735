"""The step beyond the paper: Gauss-Newton on the exact model, all parameters, from a day's run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np

from pipeline.models.drift_gauss_newton import gauss_newton
from pipeline.models.drift_linear import cumulative
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Prior, Problem
from pipeline.models.earth import DEGREES_PER_HOUR, Base, Scheme
from pipeline.models.gyro_drift import DRIFT
from pipeline.reproduce._gubarenko_runs import (
    ARCMIN,
    ARCSEC,
    LATITUDE,
    SCHEMES,
    SOURCE,
    STARTS,
    Start,
    exact_run,
    instants,
    largest_error,
)
from pipeline.reproduce.rows import Row, at_most, near

_PRIORS = (
    dict.fromkeys(DRIFT, Prior(0.0, 0.1))
    | {"theta1": Prior(0.0, 15 * ARCMIN), "theta2": Prior(0.0, 15 * ARCMIN)}
    | {"epsilon": Prior(0.0, 1.5 * ARCMIN)}
)

_LARGE_ERRORS: Mapping[Scheme, Mapping[str, float]] = MappingProxyType(
    {
        "polar": {"mc2": 8e-4},
        "equatorial": {"m11": 1e-3, "mc2": 7e-4},
        "horizontal": {},
        "vertical": {"mc2": 2.3e-3},
    }
)
"""Standard errors [deg/h] with noise of an arcsec, of what is less well determined than the rest."""


def exact() -> Iterator[Row]:
    """Error without noise, and standard errors with noise of an arcsec; tilt and misalignment unknown."""
    for scheme in SCHEMES:
        item = f"Gauss-Newton, {scheme}"
        found = _identified(scheme, STARTS[scheme], 1e-3 * ARCSEC)
        error = largest_error(found.of(DRIFT))
        yield at_most(5e-8).beside(SOURCE, item, "noise-free: max error of m, deg/h, at most", error)
        steps = found.figures["iterations"]
        yield at_most(4).beside(SOURCE, item, "noise-free: iterations, at most", steps)
        yield from _standard_errors(scheme, item)
    ill = _identified("polar", (0.0, 0.0), 1e-3 * ARCSEC)
    refused = float(any("ill-determined" in note for note in ill.notes))
    yield near(1.0, 0.0).beside(
        SOURCE, "Gauss-Newton, polar from 0, 0", "ill-determined, and said so (1: yes)", refused
    )


def _standard_errors(scheme: Scheme, item: str) -> Iterator[Row]:
    found = _identified(scheme, STARTS[scheme], ARCSEC)
    places = {p: k for k, p in enumerate(found.parameters)}
    errors = {name: found.standard_errors[places[Parameter(name)]] * DEGREES_PER_HOUR for name in DRIFT}
    for name, oracle in _LARGE_ERRORS[scheme].items():
        # one digit is given, or two
        yield near(oracle, 0.1).beside(SOURCE, item, f"1 arcsec: sigma of {name}, deg/h", errors.pop(name))
    rest = max(errors.values())
    yield at_most(2e-4, 1.1).beside(SOURCE, item, "1 arcsec: sigma of the others, deg/h, at most", rest)


def _identified(scheme: Scheme, start: Start, sigma: float) -> Estimate:
    """From a noise-free day weighted as if its noise were sigma [rad]."""
    alpha = exact_run(scheme, start, tilted=True, misaligned=True)
    arc = Arc(0, instants(1), alpha, np.ones(len(alpha), dtype=np.bool_))
    problem = Problem((Base.mounted(scheme, LATITUDE),), (arc,), _PRIORS)
    begun = cumulative(problem, sigma=sigma, robust=False, coloured=False).estimate
    return gauss_newton(problem, begun, sigma=sigma)
