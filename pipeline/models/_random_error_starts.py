"""Where the fits of random errors begin: the best of a lattice of forms on a coarse periodogram.

The level at a given ratio of colour to its background has a closed form, ``mean of I / (b (1 + kappa g))``
with b the background, so that the lattice has mu, lambda and kappa alone. The background is white noise, or
what was fitted without the colour. Units are those of samples: the step is 1.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import Noise, Noise1
from pipeline.models.random_error_forms import colour_of, names, noise_of, terms_of
from pipeline.numerics.cosine_spectrum import Periodogram

Float = NDArray[np.float64]

STARTS = 3
"""Starts of a form: the best of the lattice that lie apart."""
_STARTS_BESIDE = 2
"""Of the lattice where the smaller forms give starts as well."""
_COARSE = 0.03
"""Relative width of a coarse bin."""
_NARROWEST, _LATTICE = 0.03, 0.08
"""Narrowest line mu/lambda of the lattice, and its relative distance in lambda: lines of it overlap."""
_RATIOS = np.geomspace(1e-2, 1e6, 17)
"""Kappa: peak of the colour over the background."""
_OF_LEVELS = np.append(0.0, np.geomspace(1e-2, 1e12, 29))
"""Walk and quantisation over the white level, each where it is largest."""
_ADDED = 0.3
"""Of the smaller form's largest ordinate near: what an added term begins with."""
_APART = 0.7
"""Distance in the logarithms of mu and lambda of starts that lie apart."""


def bounds(spectrum: Periodogram, form: str) -> tuple[Float, Float]:
    """Least and greatest logarithms of the parameters, with step 1.

    mu from a hundredth of a record to the sample, lambda from half a turn a record to Nyquist's frequency;
    the levels from a millionth of the record's own, of a walk over the record.
    """
    level = float(np.log(_mean_level(spectrum)))
    n = float(spectrum.length)
    of = {
        "sigma": (0.5 * level - 14.0, 0.5 * level + 7.0),
        "mu": (np.log(0.01 / n), np.log(3.0)),
        "lambda": (np.log(np.pi / n), np.log(np.pi)),
        "K": (0.5 * level - np.log(n) - 14.0, 0.5 * level + 3.0),
        "Q": (0.5 * level - 14.0, 0.5 * level + 3.0),
        "N": (level - 28.0, level + 5.0),
    }
    rows = [of[name] for name in names(form)]
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def parts(form: str) -> tuple[str, ...]:
    """The forms of a term less that a fit of two terms or more begins from."""
    terms = terms_of(form)
    if len(terms) < 2:
        return ()
    return tuple("+".join(other for other in terms if other != term) for term in terms)


def starts(spectrum: Periodogram, form: str, smaller: Mapping[str, Float]) -> list[Float]:
    """Logarithms of the parameters, with step 1, from which to search.

    Parameters
    ----------
    spectrum : Periodogram
    form : str
    smaller : mapping of str to ndarray
        The parameters of `parts` that were fitted.
    """
    terms = terms_of(form)
    if not terms:
        return [np.array([np.log(_mean_level(spectrum))])]
    omega, value, count = _coarse(spectrum)
    colour = colour_of(form)
    if colour is None:
        return [_of_levels(form, omega, value, count)]
    beside = "+".join(term for term in terms if term != colour) or "white"
    if beside == "white":
        return _of_colour(form, colour, omega, value, count, spectrum.length, np.zeros(1))[:STARTS]
    background = smaller[beside] if beside in smaller else _of_levels(beside, omega, value, count)
    found = _of_colour(form, colour, omega, value, count, spectrum.length, background)[:_STARTS_BESIDE]
    for part, theta in smaller.items():
        if part != beside:
            found.append(_with_added(form, part, theta, omega))
    return found


def _of_colour(
    form: str, colour: str, omega: Float, value: Float, count: Float, n: int, background: Float
) -> list[Float]:
    """A lattice of the colour on a background, which are the last of the form's parameters."""
    behind = _levels(names(form)[-len(background) :], background, omega)
    noises = _lattice(colour, n)
    shapes = np.stack([noise.psd(omega) for noise in noises]) / behind
    tops = shapes.max(axis=1, keepdims=True)
    found: list[tuple[float, Float]] = []
    for kappa in _RATIOS:
        f = 1 + kappa * shapes / tops
        level = (value / behind / f) @ count / count.sum()
        loss = np.log(f) @ count + count.sum() * np.log(level)
        for i in np.argsort(loss)[: 4 * STARTS]:
            noise = noises[i]
            sigma = np.sqrt(kappa * level[i] / tops[i, 0])
            rates = [noise.mu] if colour == "noise1" else [noise.mu, -noise.decay.imag]
            power = np.array([1.0 if name == "N" else 0.5 for name in names(form)[-len(background) :]])
            theta = np.append(np.log([sigma, *rates]), background + power * np.log(level[i]))
            found.append((float(loss[i]), theta))
    chosen: list[Float] = []
    size = 2 if colour == "noise1" else 3
    for _, theta in sorted(found, key=lambda one: one[0]):
        if all(np.abs(theta[1:size] - other[1:size]).max() > _APART for other in chosen):
            chosen.append(theta)
    return chosen


def _of_levels(form: str, omega: Float, value: Float, count: Float) -> Float:
    """The best of a lattice of walk and quantisation over white noise."""
    order = names(form)
    units = [_levels((name,), np.zeros(1), omega) for name in order[:-1]]
    tops = [float(unit.max()) for unit in units]
    best = (np.inf, np.zeros(len(order)))
    for ratios in np.stack(np.meshgrid(*[_OF_LEVELS] * len(units)), axis=-1).reshape(-1, len(units)):
        f = 1 + sum(r * unit / top for r, unit, top in zip(ratios, units, tops, strict=True))
        level = float((value / f) @ count / count.sum())
        loss = float(np.log(f) @ count + count.sum() * np.log(level))
        if loss < best[0]:
            squares = np.maximum(ratios, 0.1 * _OF_LEVELS[1]) * level / np.array(tops)
            best = (loss, np.append(0.5 * np.log(squares), np.log(level)))
    return best[1]


def _with_added(form: str, part: str, theta: Float, omega: Float) -> Float:
    """The parameters of a smaller form, and a modest walk or quantisation."""
    value = dict(zip(names(part), theta.tolist(), strict=True))
    colour = colour_of(part)
    levels = {name: x for name, x in value.items() if name in "KQN"}
    f = _levels(tuple(levels), np.array(list(levels.values())), omega)
    if colour is not None:
        f = f + noise_of(colour, {name: float(np.exp(x)) for name, x in value.items()}).psd(omega)
    for name, at in (("K", 0), ("Q", -1)):
        if name in names(form) and name not in value:
            unit = _levels((name,), np.zeros(1), omega)
            value[name] = 0.5 * float(np.log(_ADDED * f[at] / unit[at]))
    return np.array([value[name] for name in names(form)])


def _levels(order: tuple[str, ...], theta: Float, omega: Float) -> Float:
    """Density of walk, quantisation and white noise, but for what the record's ends add."""
    square = 4 * np.sin(0.5 * omega) ** 2
    of = {"N": np.ones_like(square), "K": 1 / square, "Q": square}
    power = {"N": 1.0, "K": 2.0, "Q": 2.0}
    total = np.zeros_like(square)
    for name, x in zip(order, theta.tolist(), strict=True):
        total += np.exp(power[name] * x) * of[name]
    return total


def _mean_level(spectrum: Periodogram) -> float:
    return float(spectrum.value @ spectrum.count / spectrum.count.sum()) / spectrum.share


def _coarse(spectrum: Periodogram) -> tuple[Float, Float, Float]:
    """Frequency, level and count of coarse bins."""
    label = np.floor(np.log(spectrum.omega) / _COARSE).astype(np.intp)
    label -= label.min()
    count = np.bincount(label, spectrum.count)
    there = count > 0
    count = count[there]
    value = np.bincount(label, spectrum.count * spectrum.value)[there] / (count * spectrum.share)
    omega = np.bincount(label, spectrum.count * spectrum.omega)[there] / count
    return omega, np.asarray(value, dtype=np.float64), np.asarray(count, dtype=np.float64)


def _lattice(colour: str, n: int) -> list[Noise]:
    low, high = 2.0 / n, 2.5
    if colour == "noise1":
        return [Noise1(1.0, float(mu)) for mu in np.geomspace(0.5 * low, high, 30)]
    noises: list[Noise] = []
    for breadth in (_NARROWEST, 0.1, 0.3, 1.0, 3.0):
        distance = max(2 * breadth, _LATTICE) if breadth < 1 else 0.7
        size = int(np.log(high / low) / distance) + 2
        lines = np.geomspace(low, high, size).tolist()
        noises += [noise_of(colour, {"sigma": 1.0, "mu": breadth * w, "lambda": w}) for w in lines]
    return noises
