"""Random errors of a sensor by their autocorrelation: white, noise 1, 2 and 3, rate random walk, and sums.

Yang et al., *Chinese Journal of Sensors and Actuators* 27(5) (2014) 637-642; their noise 3 was lost in the
source, and the one here is the only candidate consistent with their conclusions. With c and p of each::

    noise 1   R(tau) = sigma^2 exp(-mu |tau|)
    noise 2   R(tau) = sigma^2 exp(-mu |tau|) cos(lambda tau)
    noise 3   R(tau) = sigma^2 exp(-mu |tau|) (cos(lambda tau) + (mu/lambda) sin(lambda |tau|))

    R(tau) = Re[c exp(-p |tau|)],  p = mu - i lambda,  c = sigma^2, of noise 3 sigma^2 (1 - i mu/lambda)

White noise has ``R = N delta(tau)``, the rate random walk b' = K w no autocorrelation, and quantisation is
white noise of the angle. S(omega) is two-sided: the integral of R(tau) exp(-i omega tau) over all tau.

A unit is that of the sensor (rad/s for a gyro): sigma in it, N in its square times s, K in it over sqrt(s),
Q in it times s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.numerics import _kernels_state_recursion as kernels

Float = NDArray[np.float64]

_QUADRATURE = np.polynomial.legendre.leggauss(24)
"""Exact to rounding for the products of exponentials of a step that is below the time constants."""


class RandomErrorError(GyrostandError):
    """A model of random error that cannot be."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True, slots=True)
class _Term:
    """What all terms share: parameters are positive numbers."""

    def __post_init__(self) -> None:
        for name, value in self.parameters.items():
            if not 0 < value < np.inf:
                raise RandomErrorError(
                    f"{name} of {self.name}",
                    expected="a positive number",
                    found=f"{value:g}",
                    remedy="leave the term out, or give it a size",
                )

    name: ClassVar[str]

    @property
    def parameters(self) -> dict[str, float]:
        """By name: sigma, mu, lambda, N, K, Q."""
        return {field.name.rstrip("_"): float(getattr(self, field.name)) for field in fields(self)}


@dataclass(frozen=True, slots=True)
class White(_Term):
    """White noise of two-sided spectral density N."""

    name: ClassVar[str] = "white"
    N: float

    def autocorrelation(self, tau: Float) -> Float:
        """0: the part N delta(tau) is no number, see N. Same shape as tau."""
        return np.zeros(np.shape(tau))

    def psd(self, omega: Float) -> Float:
        """S(omega) = N, same shape as omega."""
        return np.full(np.shape(omega), self.N, dtype=np.float64)

    def generate(self, n: int, step: float, generator: np.random.Generator) -> Float:
        """Means over steps [s] of the noise, of variance ``N / step``; shape (n,)."""
        return generator.normal(0.0, np.sqrt(self.N / step), n)


@dataclass(frozen=True, slots=True)
class RateRandomWalk(_Term):
    """A random walk, of variance ``K^2 t``, 0 at the record's start."""

    name: ClassVar[str] = "rate_random_walk"
    K: float

    def autocorrelation(self, tau: Float) -> Float:
        """Not stationary: there is none.

        Raises
        ------
        RandomErrorError
            Always.
        """
        raise RandomErrorError(
            f"autocorrelation at {np.size(tau)} lags",
            expected="a stationary random error",
            found="a rate random walk",
            remedy="take its variance instead",
        )

    def psd(self, omega: Float) -> Float:
        """``S(omega) = K^2 / omega^2``, of the walk between its ends; infinite at 0."""
        with np.errstate(divide="ignore"):
            S: Float = self.K**2 / np.asarray(omega, dtype=np.float64) ** 2
        return S

    def generate(self, n: int, step: float, generator: np.random.Generator) -> Float:
        """Samples every step [s]; shape (n,)."""
        walk = np.zeros(n)
        np.cumsum(self.K * np.sqrt(step) * generator.standard_normal(n - 1), out=walk[1:])
        return walk


@dataclass(frozen=True, slots=True)
class Quantisation(_Term):
    """White noise of the integral, of variance Q^2 at each reading: what a sensor of angle increments rounds.

    Its error of the integral is bounded: the less it counts in a rate, the longer that is integrated, and the
    more often it is read the less of it is at any one frequency. So its density is 0 here; in samples of
    a given step it is ``Q^2 (2 sin(omega step/2))^2 / step``.
    """

    name: ClassVar[str] = "quantisation"
    Q: float

    def autocorrelation(self, tau: Float) -> Float:
        """0, as the density. Same shape as tau."""
        return np.zeros(np.shape(tau))

    def psd(self, omega: Float) -> Float:
        """0 of a sensor that is read ever more often; same shape as omega."""
        return np.zeros(np.shape(omega))

    def generate(self, n: int, step: float, generator: np.random.Generator) -> Float:
        """Means over steps [s]; shape (n,)."""
        return np.diff(self.Q / step * generator.standard_normal(n + 1))


@dataclass(frozen=True, slots=True)
class Coloured(_Term):
    """What noises 1, 2 and 3 share: ``R(tau) = Re[c exp(-p |tau|)]``."""

    sigma: float
    mu: float

    @property
    def amplitude(self) -> complex:
        """C, of which sigma^2 is the real part."""
        return complex(self.sigma**2)

    @property
    def decay(self) -> complex:
        """``p = mu - i lambda`` [rad/s]."""
        return complex(self.mu)

    def autocorrelation(self, tau: Float) -> Float:
        """R(tau) at lags tau [s], same shape."""
        R: Float = (self.amplitude * np.exp(-self.decay * np.abs(tau))).real
        return R

    def generate(self, n: int, step: float, generator: np.random.Generator) -> Float:
        """Samples every step [s] of the stationary noise, exact for any step.

        ``x_(j+1) = Phi x_j + w_j`` with ``Phi = exp(A step)`` and w of covariance ``Q = P - Phi P Phi^T``,
        from a state of the stationary covariance P.

        Returns
        -------
        ndarray, shape (n,)
        """
        Phi, P, Q = self.transition(step)
        start = np.linalg.cholesky(P) @ generator.standard_normal(len(P))
        white = generator.standard_normal((n - 1, len(P)))
        samples = np.empty(n)
        L = np.asarray(np.linalg.cholesky(Q), dtype=np.float64)
        kernels.first_state(Phi, L, np.asarray(start, dtype=np.float64), white, samples)
        return samples

    def transition(self, step: float) -> tuple[Float, Float, Float]:
        """Phi, P and Q of the state, of which the first is the noise; each of shape (d, d)."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Noise1(Coloured):
    """``R(tau) = sigma^2 exp(-mu |tau|)``."""

    name: ClassVar[str] = "noise1"

    def psd(self, omega: Float) -> Float:
        """``S(omega) = 2 sigma^2 mu / (mu^2 + omega^2)``."""
        return 2 * self.sigma**2 * self.mu / (self.mu**2 + np.asarray(omega, dtype=np.float64) ** 2)

    def transition(self, step: float) -> tuple[Float, Float, Float]:
        """Phi, P and Q of the noise itself, shape (1, 1)."""
        one = np.eye(1)
        kept = -np.expm1(-2 * self.mu * step)
        return np.exp(-self.mu * step) * one, self.sigma**2 * one, self.sigma**2 * kept * one


@dataclass(frozen=True, slots=True)
class _Periodic(Coloured):
    """What noises 2 and 3 share: a frequency lambda [rad/s]."""

    lambda_: float

    @property
    def decay(self) -> complex:
        """``p = mu - i lambda`` [rad/s]."""
        return complex(self.mu, -self.lambda_)

    def _denominator(self, omega: Float) -> Float:
        """``D = (mu^2 + (omega - lambda)^2)(mu^2 + (omega + lambda)^2)``."""
        w = np.asarray(omega, dtype=np.float64)
        D: Float = (self.mu**2 + (w - self.lambda_) ** 2) * (self.mu**2 + (w + self.lambda_) ** 2)
        return D


@dataclass(frozen=True, slots=True)
class Noise2(_Periodic):
    """``R(tau) = sigma^2 exp(-mu |tau|) cos(lambda tau)``."""

    name: ClassVar[str] = "noise2"

    def psd(self, omega: Float) -> Float:
        """``S(omega) = 2 sigma^2 mu (mu^2 + lambda^2 + omega^2) / D``."""
        square = self.mu**2 + self.lambda_**2 + np.asarray(omega, dtype=np.float64) ** 2
        return 2 * self.sigma**2 * self.mu * square / self._denominator(omega)

    def transition(self, step: float) -> tuple[Float, Float, Float]:
        """Phi, P and Q of ``A = [[-mu, -lambda], [lambda, -mu]]``, ``P = sigma^2 I``."""
        c, s = np.cos(self.lambda_ * step), np.sin(self.lambda_ * step)
        Phi = np.exp(-self.mu * step) * np.array([[c, -s], [s, c]])
        P = self.sigma**2 * np.eye(2)
        return Phi, P, -np.expm1(-2 * self.mu * step) * P


@dataclass(frozen=True, slots=True)
class Noise3(_Periodic):
    """``R(tau) = sigma^2 exp(-mu |tau|) (cos(lambda tau) + (mu/lambda) sin(lambda |tau|))``."""

    name: ClassVar[str] = "noise3"

    @property
    def amplitude(self) -> complex:
        """``sigma^2 (1 - i mu / lambda)``."""
        return complex(self.sigma**2, -(self.sigma**2) * self.mu / self.lambda_)

    def psd(self, omega: Float) -> Float:
        """``S(omega) = 4 sigma^2 mu (mu^2 + lambda^2) / D``."""
        return 4 * self.sigma**2 * self.mu * (self.mu**2 + self.lambda_**2) / self._denominator(omega)

    def transition(self, step: float) -> tuple[Float, Float, Float]:
        """Phi, P and Q of ``x'' + 2 mu x' + k x = w``, ``P = sigma^2 diag(1, k)``, k = mu^2 + lambda^2."""
        stiffness = self.mu**2 + self.lambda_**2
        P = self.sigma**2 * np.diag([1.0, stiffness])
        Phi = self._propagator(np.array([step]))[0]
        if abs(self.decay) * step > 1:
            return Phi, P, P - Phi @ P @ Phi.T
        # Of a short step P - Phi P Phi^T keeps no digits, being of its third power: the integral that it
        # equals
        node, weight = _QUADRATURE
        response = self._propagator(0.5 * step * (node + 1))[:, :, 1]
        density = 4 * self.sigma**2 * self.mu * stiffness
        Q = np.einsum("j,ja,jb->ab", 0.5 * step * density * weight, response, response)
        return Phi, P, Q

    def _propagator(self, t: Float) -> Float:
        """``exp(A t)``, shape (n, 2, 2)."""
        c, s = np.cos(self.lambda_ * t), np.sin(self.lambda_ * t) / self.lambda_
        stiffness = self.mu**2 + self.lambda_**2
        rows = np.array([[c + self.mu * s, s], [-stiffness * s, c - self.mu * s]])
        return np.moveaxis(np.exp(-self.mu * t) * rows, -1, 0)


Noise = Noise1 | Noise2 | Noise3
Term = White | Noise1 | Noise2 | Noise3 | RateRandomWalk | Quantisation


@dataclass(frozen=True, slots=True)
class RandomError:
    """A sum of independent terms.

    Attributes
    ----------
    terms : tuple of Term
    """

    terms: tuple[Term, ...]

    @property
    def N(self) -> float:  # noqa: N802
        """Two-sided spectral density of all white noise in it."""
        return float(sum(term.N for term in self.terms if isinstance(term, White)))

    @property
    def K(self) -> float:  # noqa: N802
        """Of all rate random walk in it."""
        return float(np.sqrt(sum(term.K**2 for term in self.terms if isinstance(term, RateRandomWalk))))

    @property
    def Q(self) -> float:  # noqa: N802
        """Of all quantisation in it."""
        return float(np.sqrt(sum(term.Q**2 for term in self.terms if isinstance(term, Quantisation))))

    @property
    def coloured(self) -> tuple[Noise, ...]:
        """The terms that are noise 1, 2 or 3."""
        return tuple(term for term in self.terms if isinstance(term, Noise1 | Noise2 | Noise3))

    def autocorrelation(self, tau: Float) -> Float:
        """R(tau) without the N delta(tau) of white noise; same shape as tau [s].

        Raises
        ------
        RandomErrorError
            If there is a rate random walk in it.
        """
        return self._sum([term.autocorrelation(tau) for term in self.terms], tau)

    def psd(self, omega: Float) -> Float:
        """Two-sided S at angular frequencies omega [rad/s], same shape."""
        return self._sum([term.psd(omega) for term in self.terms], omega)

    def generate(self, n: int, step: float, generator: np.random.Generator) -> Float:
        """Samples of the whole every step [s], exact for any step; shape (n,)."""
        return self._sum([term.generate(n, step, generator) for term in self.terms], np.empty(n))

    @staticmethod
    def _sum(parts: Sequence[Float], like: Float) -> Float:
        total: Float = np.zeros(np.shape(like))
        for part in parts:
            total = total + part
        return total
