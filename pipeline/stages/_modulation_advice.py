"""At what rate a platform should turn, why, and what it gains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.models.random_error import RandomError
from pipeline.models.random_error_fit import Candidate
from pipeline.models.random_error_growth import Band, growth, recommended_rate, worse_bands
from pipeline.stages._noise_findings import is_fast

_BEYOND = 100.0
"""Times the highest rate from which on a figure says nothing to anybody."""


@dataclass(frozen=True, slots=True)
class Advice:
    """A rotation rate and what it is worth.

    Attributes
    ----------
    rate : float or None
        [rad/s]; 0 where no rotation is needed, None where the platform cannot turn fast enough, or the model
        does not describe the record.
    rate_error : float or None
        Its standard error; None where it has none or the record does not tell it.
    suppression, suppression_error : float or None
        Growth at the rate over that at rest; None where that has no bound.
    reason : str
        In one sentence.
    """

    rate: float | None
    rate_error: float | None
    suppression: float | None
    suppression_error: float | None
    reason: str


def known_bands(model: RandomError, step: float) -> tuple[Band, ...]:
    """Rates at which rotation makes worse, as far as samples every step [s] show them: below pi / step.

    A step of 0 bounds nothing; of a colour as fast as the samples none are known.
    """
    if is_fast(model, step):
        return ()
    nyquist = np.pi / step if step else np.inf
    return tuple(Band(b.low, min(b.high, nyquist)) for b in worse_bands(model) if b.low < nyquist)


def advise(chosen: Candidate, fraction: float, highest: float, step: float) -> Advice:
    """Advise on a rate up to the highest [rad/s] that leaves colour a fraction of white noise's growth.

    What samples every step [s] do not show, 0 if that is unknown, is not advised.
    """
    model = chosen.model
    if not chosen.fits:
        reason = (
            f"none: the chosen model does not describe the record (probability {chosen.whiteness:.2g}); "
            "growth and its intervals are the model's, not the gyro's"
        )
        return Advice(None, None, None, None, reason)
    if is_fast(model, step):
        reason = (
            f"none: the colour is as fast as the samples, one every {step:.4g} s, which cannot tell it from "
            "the quantisation of the output or an alias: record with a finer resolution, or faster"
        )
        return Advice(None, None, None, None, reason)
    rate = recommended_rate(model, fraction)
    at_rest = _colour(model, 0.0) / model.N
    if rate == 0.0:
        reason = "no colour: white noise, which rotation does not change" if at_rest == 0.0 else (
            f"no rotation needed: coloured noise adds {at_rest:.2g} of white noise's growth at rest, no more "
            f"than the fraction {fraction:g}"
        )  # fmt: skip
        return Advice(0.0, None, 1.0, None, reason)
    bands = known_bands(model, step)
    if step * rate > np.pi:
        reason = (
            f"none: coloured noise falls to the fraction {fraction:g} of white noise's growth beyond "
            f"{180 / step:.3g} deg/s only, which samples every {step:.4g} s do not show"
        )
        return Advice(None, None, None, None, reason)
    if rate > highest:
        only = f"only at {np.degrees(rate):.3g} deg/s" if rate < _BEYOND * highest else "at no rate in reach"
        reason = (
            f"none: coloured noise falls to the fraction {fraction:g} of white noise's growth {only}; at the "
            f"highest rate, {np.degrees(highest):.3g} deg/s, it has "
            f"{_colour(model, highest) / model.N:.2g}"
        )
        return Advice(None, None, None, None, reason)
    of_rate = chosen.standard_error(lambda one: np.array(recommended_rate(one, fraction)))
    reason = (
        f"{np.degrees(rate):.3g} deg/s: the lowest rate{_outside(bands)} at which coloured noise adds no "
        f"more than {fraction:g} of white noise's growth"
    )
    if model.K > 0:
        reason += "; at rest the variance of a rate random walk grows with the cube of time"
        return Advice(rate, _known(float(of_rate)), None, None, reason)
    suppression = _suppression(model, rate)
    error = chosen.standard_error(lambda one: np.array(_suppression(one, rate)))
    reason += f" ({at_rest:.3g} at rest); the whole grows {suppression:.2g} times as fast as at rest"
    return Advice(rate, _known(float(of_rate)), suppression, _known(float(error)), reason)


def _colour(model: RandomError, rate: float) -> float:
    return float(growth(model, rate)) - model.N


def _suppression(model: RandomError, rate: float) -> float:
    return float(growth(model, rate) / growth(model, 0.0))


def _outside(bands: tuple[Band, ...]) -> str:
    if not bands:
        return ""
    said = " and ".join(f"{np.degrees(b.low):.3g} to {np.degrees(b.high):.3g} deg/s" for b in bands)
    return f" outside {said}, where rotation makes worse,"


def _known(error: float) -> float | None:
    return error if np.isfinite(error) and error > 0 else None
