"""Rauch-Tung-Striebel smoother in square-root form, after `pipeline.numerics.square_root_filter`.

It goes back over the samples and gives each state all measurements. A step of the filter is a transition,
which has an inverse, and a step w of the process noise, which has none: that alone is estimated. The QR of
the predicted state and of w together gives the gain and what is left uncertain (P. Park and T. Kailath, *IEEE
Trans. Automatic Control* 40, 1995; the two halves of a step as in G. J. Bierman, *Automatica* 19, 1983)::

    [[S, Gamma D], [0, D]] -> [[A, 0], [B, C]],    w | x ~ N(B A^-1 (x - mean), C C^T)

Where no parameter moves nothing is estimated: they are what the filter found at the end, to the last bit.
P is never inverted, and may be singular: a direction of no variance is left out of the substitution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics._kernels_square_root_smoother import (
    negligible,
    predict_samples,
    regress,
    smooth_samples,
)
from pipeline.numerics.square_root_filter import Forward, State, System, triangular

Float = NDArray[np.float64]
Integer = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Backward:
    """What the smoother found.

    Attributes
    ----------
    state : State
        At the first sample.
    means : ndarray, shape (t, k + 2)
    factors : ndarray, shape (t, k + 2, k + 2)
        State at the instants of the filter.
    rows : ndarray, shape (n, 2)
        Means of the two measured rows at all samples.
    """

    state: State
    means: Float
    factors: Float
    rows: Float


def checkpoints(samples: int) -> Integer:
    """Samples at which the filter should keep its state, so that the smoother needs little memory.

    What lies between two of them is filtered again when the smoother comes to it: of n samples it holds
    about sqrt(n) states at a time, besides the sqrt(n) kept.
    """
    return np.arange(0, samples, math.isqrt(samples - 1) + 1, dtype=np.int64)


def run_smoother(system: System, forward: Forward, end: State) -> Backward:
    """Smooth the samples of a system.

    Parameters
    ----------
    system : System
        As filtered.
    forward : Forward
        Its instants begin with sample 0 and hold `checkpoints`, or there is memory for all that lies between.
    end : State
        The smoothed state of the last sample: that of the filter, where nothing follows.

    Returns
    -------
    Backward
    """
    instants = forward.instants
    if len(instants) == 0 or instants[0] != 0:
        raise ValueError(f"instants of the filter: expected the first to be 0, found {instants[:1]}")
    n, m = len(end.mean), system.noise.shape[1]
    Phi, F, d, q, y, measured, variance = system.arrays()
    x, W = end.mean.copy(), np.zeros((n + m, n))
    W[:n] = triangular(end.factor).T
    means, factors = np.empty_like(forward.means), np.empty_like(forward.factors)
    rows = np.empty_like(y)
    last = len(y) - 1
    for i in range(len(instants) - 1, -1, -1):
        begin, stop = int(instants[i]), int(instants[i + 1]) if i + 1 < len(instants) else last
        block = (Phi[begin:stop], F[begin:stop], d[begin:stop], q[begin:stop])
        predicted, joint = np.empty((stop - begin, n)), np.empty((stop - begin, n + m, n + m))
        before, V = forward.means[i].copy(), np.zeros((n + m, n + m))
        V[:n, :n] = forward.factors[i].T
        samples = slice(begin, stop + 1)
        predict_samples(before, V, *block, y[samples], measured[samples], variance, predicted, joint)
        smooth_samples(x, W, *block, predicted, joint, rows[samples])
        means[i], factors[i] = x, W[:n].T
    return Backward(State(x, W[:n].T), means, factors, rows)


def before_renewal(filtered: State, after: State) -> State:
    """The smoothed state before `State.renewed`, from the smoothed state after it.

    The parameters are the same; of the old rows the filter knew how they hang together with them.
    """
    k = len(after.mean) - 2
    joint = np.ascontiguousarray(triangular(filtered.factor).T)
    tolerance, v = np.empty(k), np.empty(k + 2)
    negligible(joint, k, tolerance)

    def rows_explained(p: Float) -> Float:
        v[:k] = p
        regress(joint, k, 0, tolerance, v)
        return -v[k:]

    a = filtered.mean[k:] + rows_explained(after.mean[:k] - filtered.mean[:k])
    S = np.zeros((k + 2, k + 4))
    S[:k, : k + 2] = after.factor[:k]
    S[k:, : k + 2] = np.stack([rows_explained(column) for column in after.factor[:k].T], axis=1)
    S[k:, k + 2 :] = joint[k:, k:].T
    return State(np.concatenate([after.mean[:k], a]), triangular(S))
