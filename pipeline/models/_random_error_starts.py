"""Where the fits of random errors begin: the best of a lattice of forms on a coarse periodogram.

The white level at a given ratio of colour to white noise has a closed form, ``N = mean of I / (1 + kappa
g)``, so that the lattice has mu, lambda and kappa alone. Units are those of samples: the step is 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.models.random_error import Noise, Noise1, Noise2, Noise3
from pipeline.numerics.whittle import Periodogram

Float = NDArray[np.float64]

STARTS = 3
"""Starts of a form: the best of the lattice that lie apart."""
_COARSE = 0.03
"""Relative width of a coarse bin."""
_NARROWEST, _LATTICE = 0.03, 0.08
"""Narrowest line mu/lambda of the lattice, and its relative distance in lambda: lines of it overlap."""
_RATIOS = np.geomspace(1e-2, 1e6, 17)
"""Kappa: peak of the colour over the white level."""
_APART = 0.7
"""Distance in the logarithms of mu and lambda of starts that lie apart."""


def bounds(spectrum: Periodogram, form: str) -> tuple[Float, Float]:
    """Least and greatest logarithms of the parameters, with step 1.

    mu from a hundredth of a record to the sample, lambda from half a turn a record to Nyquist's frequency;
    the levels from a millionth of the record's own.
    """
    level = float(np.log(_mean_level(spectrum)))
    n = float(spectrum.length)
    sigma = (0.5 * level - 14.0, 0.5 * level + 7.0)
    mu, lambda_, N = (
        (np.log(0.01 / n), np.log(3.0)),
        (np.log(np.pi / n), np.log(np.pi)),
        (level - 28.0, level + 5.0),
    )
    rows = {"white": [N], "noise1": [sigma, mu, N]}.get(form, [sigma, mu, lambda_, N])
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def starts(spectrum: Periodogram, form: str) -> list[Float]:
    """Logarithms of the parameters, with step 1, from which to search."""
    if form == "white":
        return [np.array([np.log(_mean_level(spectrum))])]
    omega, value, count = _coarse(spectrum)
    noises = _lattice(form, spectrum.length)
    shapes = np.stack([noise.psd(omega) for noise in noises])
    tops = shapes.max(axis=1, keepdims=True)
    found: list[tuple[float, Float]] = []
    for kappa in _RATIOS:
        f = 1 + kappa * shapes / tops
        N = (value / f) @ count / count.sum()
        loss = np.log(f) @ count + count.sum() * np.log(N)
        for i in np.argsort(loss)[: 4 * STARTS]:
            noise = noises[i]
            sigma = np.sqrt(kappa * N[i] / tops[i, 0])
            rates = [noise.mu] if form == "noise1" else [noise.mu, -noise.decay.imag]
            found.append((float(loss[i]), np.log([sigma, *rates, N[i]])))
    chosen: list[Float] = []
    for _, theta in sorted(found, key=lambda one: one[0]):
        if all(np.abs(theta[1:-1] - other[1:-1]).max() > _APART for other in chosen):
            chosen.append(theta)
        if len(chosen) == STARTS:
            break
    return chosen


def _mean_level(spectrum: Periodogram) -> float:
    share = 1.0 if spectrum.window is None else float(spectrum.window[0])
    return float(spectrum.value @ spectrum.count / spectrum.count.sum()) / share


def _coarse(spectrum: Periodogram) -> tuple[Float, Float, Float]:
    """Frequency, level and count of coarse bins."""
    label = np.unique(np.floor(np.log(spectrum.omega) / _COARSE), return_index=True)[1]
    count = np.add.reduceat(spectrum.count, label)
    share = 1.0 if spectrum.window is None else float(spectrum.window[0])
    value = np.add.reduceat(spectrum.count * spectrum.value, label) / (count * share)
    omega = np.add.reduceat(spectrum.count * spectrum.omega, label) / count
    return omega, value, count


def _lattice(form: str, n: int) -> list[Noise]:
    low, high = 2.0 / n, 2.5
    if form == "noise1":
        return [Noise1(1.0, float(mu)) for mu in np.geomspace(0.5 * low, high, 30)]
    kind = Noise2 if form == "noise2" else Noise3
    noises: list[Noise] = []
    for breadth in (_NARROWEST, 0.1, 0.3, 1.0, 3.0):
        distance = max(2 * breadth, _LATTICE) if breadth < 1 else 0.7
        size = int(np.log(high / low) / distance) + 2
        noises += [kind(1.0, float(breadth * w), float(w)) for w in np.geomspace(low, high, size)]
    return noises
