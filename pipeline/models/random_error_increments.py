"""Integrals of a random error over sampling steps, exact for any step: what a gyro of angle increments gives.

The state x of a term, ``x' = A x + w`` with w white of density D, of which the error is the first, gets its
integral y over the step as one more. Of ``z = (y, x)`` with ``z' = F z + (0, w)``::

    F = [[0, e1^T], [0, A]],   Phi = exp(F step),   Q = int_0^step exp(F s) diag(0, D) exp(F s)^T ds

and y begins anew at 0 with each step. ``D = -(A P + P A^T)`` of a stationary term, P its covariance; of the
rate random walk A = 0, D = K^2. The terms are those of `pipeline.models.random_error`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from pipeline.models.random_error import Noise1, Noise2, Noise3, Quantisation, RateRandomWalk, Term, White
from pipeline.numerics._kernels_state_recursion import first_state

Float = NDArray[np.float64]

_QUADRATURE = np.polynomial.legendre.leggauss(24)
"""Exact to rounding for the products of exponentials of a step that is below the time constants."""


def increments(term: Term, n: int, step: float, generator: np.random.Generator) -> Float:
    """Integrals of a term over n steps [s] that follow each other; shape (n,).

    In the unit of the error times s. A stationary term is so from the first step on; the rate random walk
    begins at 0.
    """
    if isinstance(term, White | Quantisation):
        return step * term.generate(n, step, generator)
    Phi, P, Q = transition(term, step)
    start = np.zeros(len(Phi))
    if P.any():
        start[1:] = np.linalg.cholesky(P) @ generator.standard_normal(len(P))
    white = generator.standard_normal((n, len(Phi)))
    factor = np.asarray(np.linalg.cholesky(Q), dtype=np.float64)
    integrals = np.empty(n + 1)
    first_state(Phi, factor, start, white, integrals)
    return integrals[1:]


def transition(term: Noise1 | Noise2 | Noise3 | RateRandomWalk, step: float) -> tuple[Float, Float, Float]:
    """One step of the integral and the state: ``z -> Phi z + w``.

    Parameters
    ----------
    term : Noise1, Noise2, Noise3 or RateRandomWalk
    step : float
        [s]

    Returns
    -------
    Phi : ndarray, shape (d + 1, d + 1)
        Its first column is 0: the integral begins anew.
    P : ndarray, shape (d, d)
        Covariance of the state at the start.
    Q : ndarray, shape (d + 1, d + 1)
        Covariance of w.
    """
    A, P, D = _system(term)
    d = len(A)
    F, density = np.zeros((d + 1, d + 1)), np.zeros((d + 1, d + 1))
    F[0, 1], F[1:, 1:], density[1:, 1:] = 1.0, A, D
    # over a part of the step that is below the time constants, then from each length to twice it
    doublings = max(0, int(np.ceil(np.log2(max(step * float(np.abs(np.linalg.eigvals(A)).max()), 1.0)))))
    part = step / 2**doublings
    node, weight = _QUADRATURE
    response = expm(F * (0.5 * part * (node + 1))[:, np.newaxis, np.newaxis])
    Q = np.einsum("j,jab,bc,jdc->ad", 0.5 * part * weight, response, density, response)
    Phi = expm(F * part)
    for _ in range(doublings):
        Q = Phi @ Q @ Phi.T + Q
        Phi = Phi @ Phi
    Phi[:, 0] = 0.0
    return Phi, P, Q


def _system(term: Noise1 | Noise2 | Noise3 | RateRandomWalk) -> tuple[Float, Float, Float]:
    """A, P and D of a term's state, each of shape (d, d)."""
    if isinstance(term, RateRandomWalk):
        return np.zeros((1, 1)), np.zeros((1, 1)), np.array([[term.K**2]])
    if isinstance(term, Noise1):
        A, P = np.array([[-term.mu]]), np.array([[term.sigma**2]])
    elif isinstance(term, Noise2):
        A, P = np.array([[-term.mu, -term.lambda_], [term.lambda_, -term.mu]]), term.sigma**2 * np.eye(2)
    else:
        stiffness = term.mu**2 + term.lambda_**2
        A = np.array([[0.0, 1.0], [-stiffness, -2 * term.mu]])
        P = term.sigma**2 * np.diag([1.0, stiffness])
    return A, P, -(A @ P + P @ A.T)
