"""Coloured residuals of a fit of the drift: recognised, and allowed for by an autoregression.

The parameters and the autoregression of their residuals are fitted in turn (Cochrane & Orcutt, *J. Am. Stat.
Assoc.* 44 (1949) 32-61), whatever the model that is fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_problem import Mask
from pipeline.numerics.whiteness import AutoRegression, fit_autoregression, ljung_box

Float = NDArray[np.float64]
Fit = TypeVar("Fit")

COLOURED = 0.01
"""Probability of the whiteness test below which residuals are taken for coloured."""
BELOW = 0.5
"""Part of a given sigma below which residuals are not noise whose colour could matter."""
_LAGS = 20
_SETTLED = 1e-3
"""Change of the autoregression's coefficients at which it has converged: their standard error is more."""


def whiteness(residuals: Sequence[Float], measured: Sequence[Mask]) -> float:
    """Probability of residuals as coloured as these from white noise (Ljung & Box).

    The smallest of an arc's, times the number of arcs (Bonferroni).

    Parameters
    ----------
    residuals : sequence of ndarray, each of shape (n, 2)
        One an arc.
    measured : sequence of ndarray of bool, each of shape (n,)
        Samples that count.
    """
    probabilities = [
        ljung_box(residual, min(_LAGS, int(there.sum()) // 5), there)[1]
        for residual, there in zip(residuals, measured, strict=True)
    ]
    return min(1.0, min(probabilities) * len(probabilities))


def whitened(
    fit: Fit,
    measured: Sequence[Mask],
    *,
    residuals: Callable[[Fit], Sequence[Float]],
    taken: Callable[[Fit], Sequence[Float]],
    refitted: Callable[[Fit, AutoRegression], Fit],
    most_rounds: int,
) -> tuple[Fit, AutoRegression | None]:
    """A fit weighted by the autoregression of its own residuals.

    Parameters
    ----------
    fit
        As if the noise were white.
    measured : sequence of ndarray of bool, one an arc
    residuals, taken : callable
        Of a fit: its residuals, each of shape (n, 2); and the factors of what it took out of the noise, see
        `fit_autoregression`.
    refitted : callable
        The next fit, from the last one and the autoregression.
    most_rounds : int

    Returns
    -------
    fit
    autoregression : AutoRegression or None
        None, with the fit as it was, where white noise explains the residuals best.
    """
    noise: AutoRegression | None = None
    now = fit
    for _ in range(most_rounds):
        found = fit_autoregression(residuals(now), measured, None if noise is None else taken(now))
        if found is None:
            return fit, None
        settled = (
            noise is not None
            and noise.order == found.order
            and float(np.abs(noise.coefficients - found.coefficients).max()) < _SETTLED
        )
        noise = found
        now = refitted(now, found)
        if settled:
            break
    return now, noise
