"""The forms of random error among which one is chosen: white noise, a coloured noise, a walk, quantisation.

A form is white noise with any of the terms of `FORMS`: at most one of the noises 1, 2 and 3, with or
without a rate random walk, with or without quantisation (`pipeline.models.random_error`). Its parameters
are logarithms, whose uncertainty is symmetric, in the order of `names`::

    sigma, mu, lambda of the noise; K; Q; N
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import (
    Noise,
    Noise1,
    Noise2,
    Noise3,
    Quantisation,
    RandomError,
    RateRandomWalk,
    Term,
    White,
)
from pipeline.numerics import cosine_spectrum, whittle

Float = NDArray[np.float64]

COLOURS: dict[str, type[Noise1] | type[Noise2] | type[Noise3]] = {
    "noise1": Noise1,
    "noise2": Noise2,
    "noise3": Noise3,
}
"""The coloured noises, of which a form has one at most."""

BESIDES: dict[str, type[RateRandomWalk] | type[Quantisation]] = {
    "rate_random_walk": RateRandomWalk,
    "quantisation": Quantisation,
}
"""The terms that each form has with and without."""

_SCALES = {"sigma": 0.0, "mu": -1.0, "lambda": -1.0, "K": -0.5, "Q": 1.0, "N": 1.0}
"""Powers of the step by which a parameter in units of samples becomes one in seconds."""


def forms(
    colours: tuple[str, ...] = ("white", *COLOURS), besides: tuple[str, ...] = tuple(BESIDES)
) -> tuple[str, ...]:
    """The forms of some coloured noises ("white": none) and terms; each form its terms joined by "+"."""
    found = []
    for *others, colour in product(*((False, True) for _ in besides), colours):
        terms = [colour] if colour in COLOURS else []
        terms += [name for name, there in zip(besides, others, strict=True) if there]
        found.append("+".join(terms) or "white")
    return tuple(found)


FORMS: tuple[str, ...] = forms()
"""All of them, the fewest terms first."""


def terms_of(form: str) -> tuple[str, ...]:
    """Names of the terms beside white noise."""
    return () if form == "white" else tuple(form.split("+"))


def colour_of(form: str) -> str | None:
    """Its coloured noise."""
    return next((name for name in terms_of(form) if name in COLOURS), None)


def names(form: str) -> tuple[str, ...]:
    """Of the parameters, in their order."""
    of = {"noise1": ("sigma", "mu"), "rate_random_walk": ("K",), "quantisation": ("Q",)}
    return (*(name for term in terms_of(form) for name in of.get(term, ("sigma", "mu", "lambda"))), "N")


def in_seconds(form: str, theta: Float, step: float) -> Float:
    """Logarithms of parameters of samples every second as those of samples every step [s]."""
    scale = np.array([_SCALES[name] for name in names(form)])
    return np.asarray(theta + np.log(step) * scale, dtype=np.float64)


def model_of(form: str, theta: Float) -> RandomError:
    """The random error at the logarithms of its parameters, shape (k,)."""
    value = dict(zip(names(form), np.exp(theta).tolist(), strict=True))
    found: list[Term] = []
    noise = _noise(form, value)
    if noise is not None:
        found.append(noise)
    found += [RateRandomWalk(value["K"])] if "K" in value else []
    found += [Quantisation(value["Q"])] if "Q" in value else []
    return RandomError((*found, White(value["N"])))


def process(form: str, theta: Float, step: float) -> whittle.Process:
    """What samples every step are, and its derivatives by the logarithms of the parameters.

    Parameters
    ----------
    form : str
        Of `FORMS`.
    theta : ndarray, shape (k,)
    step : float
        [s].

    Returns
    -------
    Process
        ``white = N / step, walk = K^2 step, difference = Q^2 / step^2``, c of
        `pipeline.models.random_error`, p times the step.
    """
    order = names(form)
    k, value = len(order), dict(zip(order, np.exp(theta).tolist(), strict=True))
    levels, d_levels = np.zeros(len(cosine_spectrum.LEVELS)), np.zeros((k, len(cosine_spectrum.LEVELS)))
    for place, (name, power, unit) in enumerate((("N", 1, 1 / step), ("K", 2, step), ("Q", 2, step**-2))):
        if name in value:
            levels[place] = value[name] ** power * unit
            d_levels[order.index(name), place] = power * levels[place]
    noise = _noise(form, value)
    if noise is None:
        none = np.zeros((k, 0), dtype=np.complex128)
        return whittle.Process(levels, none[0], none[0], d_levels, none, none)
    c, p = noise.amplitude, noise.decay * step
    d_c, d_p = np.zeros((k, 1), dtype=np.complex128), np.zeros((k, 1), dtype=np.complex128)
    d_c[0], d_p[1] = 2 * c, p.real
    if "lambda" in value:
        d_c[1], d_c[2], d_p[2] = 1j * c.imag, -1j * c.imag, 1j * p.imag
    return whittle.Process(levels, np.array([c]), np.array([p]), d_levels, d_c, d_p)


def noise_of(colour: str, value: Mapping[str, float]) -> Noise:
    """A coloured noise by its parameters' names."""
    if colour == "noise1":
        return Noise1(value["sigma"], value["mu"])
    return COLOURS[colour](*(value[name] for name in ("sigma", "mu", "lambda")))


def _noise(form: str, value: Mapping[str, float]) -> Noise | None:
    colour = colour_of(form)
    return None if colour is None else noise_of(colour, value)
