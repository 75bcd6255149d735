"""Kalman filter in square-root form for two measured rows that are driven by parameters.

::

    a_{j+1} = Phi_j a_j + F_j p_j + d_j        two rows, driven by k parameters
    p_{j+1} = p_j + (0, w_j)                   w ~ N(0, diag(q_j^2)) moves the last m of them
    y_j     = a_j + v_j                        v ~ N(0, diag(sigma^2)), or no measurement

The covariance ``P = S S^T`` is never formed: between its largest and its smallest direction P spans twice
the digits that S does, and a filter that carries it loses the small ones. Measurements are taken in one at a
time by Carlson's update (N. A. Carlson, *AIAA Journal* 11, 1973), which keeps S triangular, process noise by
Householder reflections (T. Kailath, A. H. Sayed, B. Hassibi, *Linear Estimation*, 2000, ch. 12). A transition
changes two rows of S, and the noise no row of a parameter that has none: with these first and the two rows
last, most of an array algorithm's work falls away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics._kernels_square_root_filter import filter_samples

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class System:
    """n samples of two measured rows, and how they follow each other.

    Attributes
    ----------
    transition : ndarray, shape (n - 1, 2, 2)
        Phi.
    drive : ndarray, shape (n - 1, 2, k)
        F.
    offset : ndarray, shape (n - 1, 2)
        d.
    noise : ndarray, shape (n - 1, m)
        q, standard deviation of the steps of the last m parameters; m = 0 where all are constant.
    measurement : ndarray, shape (n, 2)
        y; not looked at where there is none.
    measured : ndarray of bool, shape (n,)
        Whether there is a measurement.
    sigma : ndarray, shape (2,)
        Standard deviation of a measurement of each row, above 0.
    """

    transition: Float
    drive: Float
    offset: Float
    noise: Float
    measurement: Float
    measured: Mask
    sigma: Float

    def __post_init__(self) -> None:
        """Compiled loops check no index: the shapes are checked here."""
        n, k = len(self.measured), self.drive.shape[-1]
        shapes = {
            "transition": (n - 1, 2, 2),
            "drive": (n - 1, 2, k),
            "offset": (n - 1, 2),
            "noise": (n - 1, min(self.noise.shape[-1], k)),
            "measurement": (n, 2),
            "sigma": (2,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, found {getattr(self, name).shape}")

    def arrays(self) -> tuple[Float, Float, Float, Float, Float, Mask, Float]:
        """As the compiled loops take them: contiguous, and variances for standard deviations."""
        whole = (self.transition, self.drive, self.offset, self.noise, self.measurement)
        Phi, F, d, q, y = (np.ascontiguousarray(part, dtype=np.float64) for part in whole)
        return Phi, F, d, q, y, np.ascontiguousarray(self.measured), np.square(self.sigma, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class State:
    """A Gaussian state, ``N(mean, factor factor^T)``: the k parameters p, then the two rows a.

    Attributes
    ----------
    mean : ndarray, shape (k + 2,)
    factor : ndarray, shape (k + 2, k + 2)
        S; any square root of the covariance.
    """

    mean: Float
    factor: Float

    @property
    def standard_deviations(self) -> Float:
        """Of each component, shape (k + 2,)."""
        return np.asarray(np.linalg.norm(self.factor, axis=1), dtype=np.float64)

    @classmethod
    def started(cls, p: Float, factor: Float, a: Float, sigma: Float) -> State:
        """Parameters and rows that nothing links as yet.

        Parameters
        ----------
        p : ndarray, shape (k,)
            Mean of the parameters.
        factor : ndarray, shape (k, c), c >= k
            A factor of their covariance.
        a, sigma : ndarray, shape (2,)
            Mean and standard deviations of the rows.
        """
        k = len(p)
        S = np.zeros((k + 2, k + 2))
        S[:k, :k] = triangular(factor)
        S[k:, k:] = np.diag(sigma)
        return cls(np.concatenate([p, a]), S)

    def renewed(self, a: Float, sigma: Float) -> State:
        """The same parameters with rows begun anew: the old rows are marginalised, by QR."""
        return State.started(self.mean[:-2], self.factor[:-2], a, sigma)


@dataclass(frozen=True, slots=True)
class Forward:
    """What the filter found.

    Attributes
    ----------
    state : State
        After the last sample.
    instants : ndarray of int, shape (t,)
        Samples at which the state was kept, ascending.
    means : ndarray, shape (t, k + 2)
    factors : ndarray, shape (t, k + 2, k + 2)
        State at these, their measurement taken in.
    innovations : ndarray, shape (n, 2)
        Over their standard deviation, the second after the first of its sample was taken in: independent and
        standard normal if the model is true. NaN where there is no measurement.
    log_likelihood : float
        Natural logarithm of the density of the measurements.
    """

    state: State
    instants: Integer
    means: Float
    factors: Float
    innovations: Float
    log_likelihood: float


def run_filter(system: System, start: State, instants: Integer) -> Forward:
    """Filter the samples of a system.

    Parameters
    ----------
    system : System
        The samples.
    start : State
        Before the first sample's measurement.
    instants : ndarray of int, shape (t,)
        Samples at which to keep the state, ascending.

    Returns
    -------
    Forward
    """
    n = len(start.mean)
    x, W = start.mean.copy(), np.zeros((n + system.noise.shape[1], n))
    W[:n] = triangular(start.factor).T
    instants = np.ascontiguousarray(instants, dtype=np.int64)
    means, factors = np.empty((len(instants), n)), np.empty((len(instants), n, n))
    innovations = np.full((len(system.measured), 2), np.nan)
    likelihood = filter_samples(x, W, *system.arrays(), instants, means, factors, innovations)
    return Forward(
        State(x, W[:n].T), instants, means, factors.transpose(0, 2, 1), innovations, float(likelihood)
    )


def triangular(factor: Float) -> Float:
    """The lower triangular L with ``L L^T = factor factor^T``, by QR; shapes (k, c), c >= k, and (k, k)."""
    return np.linalg.qr(factor.T).R.T
