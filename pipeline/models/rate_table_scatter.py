"""The noise between observations of a triad, which may be slower than they follow each other.

What scatters between steps beyond the noise within them (a bias that wanders) is alike in neighbouring ones.
A term whose derivative rises or falls through the record, as |w| does where the rates grow, then takes more
of it than if the scatter were independent. The noise of the means y of one gyro is modelled as ::

    V = diag(s^2) + tau^2 exp(-|t_i - t_j| / T) + E E^T

s their own standard errors, E what unknowns of the input of unit variance add. With r the residual of
generalised least squares, the restricted likelihood of tau and T is (Patterson & Thompson, *Biometrika* 58
(1971) 545-554) ::

    -2 ln L = ln |V| + ln |A^T V^-1 A| + r^T V^-1 r

Some twenty observations do not tell tau and T. V is therefore no most likely one but the average over a grid
by likelihood: before the data `_QUIET` of the weight is on tau = 0, the rest even in ln tau and ln T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_QUIET = 0.2
"""Weight of no scatter before the data. In 200 records of seven steps of 10 s about each of three axes, in a
fixture that is not quite known, the errors of the asymmetry over their standard errors come to 1.13 with a
noise of 20 s (1.44 if its scatter is taken as independent); with white noise and a known fixture to 0.8."""
_TIMES = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
"""T on the grid, in distances between neighbours; 0: independent."""
_SIZES = 12
"""Values of tau on the grid."""
_SMALLEST, _LARGEST = 0.4, 3.0
"""The smallest tau on the grid over the usual standard error, the largest over that or the usual residual."""
_FEWEST = 10
"""Degrees of freedom below which the scatter would be that of the weights before the data."""
_NULL = 1e-9
"""Of the largest singular value: a direction that the observations do not tell."""


def covariance_of_means(A: Float, y: Float, error: Float, effect: Float, apart: Float) -> Float | None:
    """Covariance of the outputs of one gyro, without the unknowns of the input, averaged over its noises.

    Parameters
    ----------
    A : ndarray, shape (m, p)
        Derivatives of the outputs by the gyro's parameters.
    y, error : ndarray, shape (m,)
        Outputs and their own standard errors.
    effect : ndarray, shape (m, q)
        E.
    apart : ndarray, shape (m, m)
        Time between each two [s]; infinite between records.

    Returns
    -------
    ndarray, shape (m, m), or None
        None where the observations are too few to tell.
    """
    basis = _basis(A)
    freedom = len(y) - basis.shape[1]
    if freedom < _FEWEST:
        return None
    own, known = np.diag(error**2), effect @ effect.T
    square, quiet = _deviance(own + known, basis, y)
    usual = float(np.median(error))
    sizes = usual * np.geomspace(_SMALLEST, _LARGEST * max(1.0, np.sqrt(square / freedom)), _SIZES)
    spacing = float(np.median(np.min(apart + np.diag(np.full(len(y), np.inf)), axis=1)))
    times = _TIMES[:1] if not np.isfinite(spacing) else spacing * _TIMES
    alike = [np.exp(-apart / time) if time else np.eye(len(y)) for time in times.tolist()]
    deviance = np.array(
        [[sum(_deviance(own + known + size**2 * R, basis, y)) for size in sizes.tolist()] for R in alike]
    )
    least = min(float(deviance.min()), square + quiet)
    weight = (1 - _QUIET) / deviance.size * np.exp(-(deviance - least) / 2)
    whole = float(weight.sum()) + _QUIET * float(np.exp(-(square + quiet - least) / 2))
    variance = weight @ sizes**2 / whole
    return np.asarray(own + sum(v * R for v, R in zip(variance, alike, strict=True)), dtype=np.float64)


def _basis(A: Float) -> Float:
    """Orthonormal basis of what the columns span."""
    size = np.linalg.norm(A, axis=0)
    U, singular, _ = np.linalg.svd(A / np.where(size > 0, size, 1.0), full_matrices=False)
    return np.asarray(U[:, singular > _NULL * singular[0]], dtype=np.float64)


def _deviance(V: Float, basis: Float, y: Float) -> tuple[float, float]:
    """``r^T V^-1 r``, and the logarithms of the determinants."""
    L = np.linalg.cholesky(V)
    whitened = np.linalg.solve(L, np.column_stack([basis, y]))
    Q, R = np.linalg.qr(whitened[:, :-1])
    r = whitened[:, -1] - Q @ (Q.T @ whitened[:, -1])
    determinants = np.log(np.diag(L)).sum() + np.log(np.abs(np.diag(R))).sum()
    return float(r @ r), float(2 * determinants)
