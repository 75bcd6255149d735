"""The motion of a vibration stand: coning, alone or set upon a smooth roll, in closed form.

Godorov & Lutmanov, *Problems of Mechanics and Control* 48 (2016), (3.1) and section 5. With the cone's
opening angle ΔΦ, frequency f, ``ω = 2πf``, ``c = cos(ΔΦ/2)``, ``s = sin(ΔΦ/2)``, body axis 1 runs round a
cone::

    ψ = atan( 2 c s cos ωt / (2c² − 1) )
    θ = asin( 2 c s sin ωt )
    γ = −atan( 2 s² cos ωt sin ωt / (2c² − 1 + 2 s² cos² ωt) )

(The paper prints ``cos² ωt`` for ``c²`` in the denominator of γ.) This is the rotation by ΔΦ about an axis
that itself turns in the plane of the axes 2 and 3: the quaternion is ``(c, 0, s cos ωt, s sin ωt)``. From
``2 q* q'`` follow the body rates, exactly::

    p = −2 ω s²        q = −2 c s ω sin ωt        r = 2 c s ω cos ωt
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.numerics.rotation import quaternion_multiply

Float = NDArray[np.float64]


class MotionError(GyrostandError):
    """A motion that cannot be: a cone angle, a frequency or a time out of its range."""

    exit_code = ExitCode.USAGE


class Motion(Protocol):
    """What a stand does; times in seconds, arrays with the components along the last axis."""

    def angles(self, t: ArrayLike) -> Float:
        """Euler-Krylov angles psi, theta, gamma [rad], shape (n, 3)."""
        ...

    def quaternion(self, t: ArrayLike) -> Float:
        """Body-to-reference quaternion w, x, y, z, shape (n, 4)."""
        ...

    def rates(self, t: ArrayLike) -> Float:
        """Body rates p, q, r [rad/s], shape (n, 3)."""
        ...

    def increments(self, start: ArrayLike, end: ArrayLike) -> Float:
        """Integrals of the body rates from start to end [rad], shape (n, 3)."""
        ...


@dataclass(frozen=True, slots=True)
class ConingMotion:
    """Coning about axis 1 of the reference.

    Parameters
    ----------
    cone_angle : float
        Opening angle ΔΦ [rad], above 0 and below pi. From pi/2 on theta passes its singularity, and psi and
        gamma come wrapped to ±pi.
    frequency : float
        Revolutions round the cone a second [Hz], above 0.

    Raises
    ------
    MotionError
        If either is out of its range.
    """

    cone_angle: float
    frequency: float

    def __post_init__(self) -> None:
        if not 0 < self.cone_angle < np.pi:
            raise MotionError(
                "cone angle",
                expected="more than 0 and less than pi rad",
                found=f"{self.cone_angle:g} rad",
                remedy="choose a smaller cone",
            )
        if not 0 < self.frequency < np.inf:
            raise MotionError(
                "coning frequency",
                expected="more than 0 Hz",
                found=f"{self.frequency:g} Hz",
                remedy="choose another frequency",
            )

    @property
    def angular_frequency(self) -> float:
        """ω [rad/s]."""
        return 2 * np.pi * self.frequency

    @property
    def roll_rate(self) -> float:
        """The constant rate p = −2 ω s² [rad/s], which is also the drift of gamma if it is not recorded."""
        return float(-2 * self.angular_frequency * np.sin(self.cone_angle / 2) ** 2)

    @property
    def rate_amplitude(self) -> float:
        """Amplitude 2 c s ω of q and r [rad/s]."""
        return float(self.angular_frequency * np.sin(self.cone_angle))

    def angles(self, t: ArrayLike) -> Float:
        """Euler-Krylov angles (3.1) [rad].

        Parameters
        ----------
        t : array_like, shape (n,)
            Time [s].

        Returns
        -------
        ndarray, shape (n, 3)
            psi, theta, gamma.
        """
        phase = self.angular_frequency * np.asarray(t, dtype=np.float64)
        cosine, sine = np.cos(phase), np.sin(phase)
        s2 = np.sin(self.cone_angle / 2) ** 2
        cos_cone, sin_cone = np.cos(self.cone_angle), np.sin(self.cone_angle)  # 2c² − 1, 2 c s
        # arctan2 is the atan of (3.1) as long as its denominators are positive: for cones below 90 degrees
        psi = np.arctan2(sin_cone * cosine, cos_cone)
        theta = np.arcsin(sin_cone * sine)
        gamma = -np.arctan2(2 * s2 * cosine * sine, cos_cone + 2 * s2 * cosine**2)
        return np.stack((psi, theta, gamma), axis=-1)

    def quaternion(self, t: ArrayLike) -> Float:
        """Body-to-reference quaternion ``(c, 0, s cos ωt, s sin ωt)``, shape (n, 4)."""
        phase = self.angular_frequency * np.asarray(t, dtype=np.float64)
        c, s = np.cos(self.cone_angle / 2), np.sin(self.cone_angle / 2)
        return np.stack(
            (np.full_like(phase, c), np.zeros_like(phase), s * np.cos(phase), s * np.sin(phase)), -1
        )

    def rates(self, t: ArrayLike) -> Float:
        """Body rates p, q, r [rad/s], shape (n, 3)."""
        return self._rates_in_rolled_axes(np.asarray(t, dtype=np.float64), 0.0, 0.0)

    def increments(self, start: ArrayLike, end: ArrayLike) -> Float:
        """Integrals of p, q, r from start to end [rad], shape (n, 3)."""
        return self._increments_in_rolled_axes(
            np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64), 0.0, 0.0
        )

    def _rates_in_rolled_axes(self, t: Float, slope: float, offset: float) -> Float:
        """Rates of the coning body rolled on by ``φ = slope t + offset``.

        ``p + φ'``, and (q, r) turned by −φ: sinusoids at ``ω − slope``::

            q = −A sin(ωt − φ),   r = A cos(ωt − φ),   A = 2 c s ω
        """
        phase = (self.angular_frequency - slope) * t - offset
        q, r = -self.rate_amplitude * np.sin(phase), self.rate_amplitude * np.cos(phase)
        return np.stack((np.full_like(phase, self.roll_rate + slope), q, r), axis=-1)

    def _increments_in_rolled_axes(self, start: Float, end: Float, slope: float, offset: float) -> Float:
        """Integrals of those rates.

        With ``Ω = ω − slope``, phases u, v at start and end, the integrals of −sin and cos over the step are
        ``−2 sin((u+v)/2) sin((v−u)/2)/Ω`` and ``2 cos((u+v)/2) sin((v−u)/2)/Ω``: no digits cancel, and at
        Ω = 0 the limit is that of sinc.
        """
        rate = self.angular_frequency - slope
        middle = rate * (start + end) / 2 - offset
        chord = (end - start) * np.sinc(rate * (end - start) / (2 * np.pi))
        q, r = -self.rate_amplitude * chord * np.sin(middle), self.rate_amplitude * chord * np.cos(middle)
        return np.stack(((self.roll_rate + slope) * (end - start), q, r), axis=-1)


@dataclass(frozen=True, slots=True)
class SmoothConing:
    """A smooth roll, with coning upon it from an onset t* on (section 5).

    In the paper's symbols::

        γ = a t + b                before t*, with ψ = θ = 0
        γ = γ_coning + a t + b     from t* on, with ψ, θ of the coning

    The coning's own time begins at t*. ψ jumps by ΔΦ at t*, which no rate shows.

    Parameters
    ----------
    coning : ConingMotion
        The motion from t* on.
    onset : float
        t* [s].
    slope, offset : float
        a [rad/s] and b [rad] of the smooth roll.
    """

    coning: ConingMotion
    onset: float
    slope: float
    offset: float

    def angles(self, t: ArrayLike) -> Float:
        """Euler-Krylov angles psi, theta, gamma [rad], shape (n, 3); gamma is not wrapped."""
        t = np.asarray(t, dtype=np.float64)
        angles = np.where(self._conic(t), self.coning.angles(t - self.onset), 0.0)
        angles[..., 2] += self.slope * t + self.offset
        return angles

    def quaternion(self, t: ArrayLike) -> Float:
        """Body-to-reference quaternion w, x, y, z, shape (n, 4): the coning's, rolled on by a t + b."""
        t = np.asarray(t, dtype=np.float64)
        half = (self.slope * t + self.offset) / 2
        zero = np.zeros_like(half)
        roll = np.stack((np.cos(half), np.sin(half), zero, zero), axis=-1)
        coning = np.where(self._conic(t), self.coning.quaternion(t - self.onset), (1.0, 0.0, 0.0, 0.0))
        return quaternion_multiply(coning, roll)

    def rates(self, t: ArrayLike) -> Float:
        """Body rates p, q, r [rad/s], shape (n, 3); at t* itself those of the coning."""
        t = np.asarray(t, dtype=np.float64)
        rolled = self.coning._rates_in_rolled_axes(t - self.onset, self.slope, self._roll_at_onset)
        return np.where(self._conic(t), rolled, (self.slope, 0.0, 0.0))

    def increments(self, start: ArrayLike, end: ArrayLike) -> Float:
        """Integrals of p, q, r from start to end [rad], shape (n, 3); end not before start."""
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        conic_start, conic_end = np.maximum(start, self.onset), np.maximum(end, self.onset)
        increments = self.coning._increments_in_rolled_axes(
            conic_start - self.onset, conic_end - self.onset, self.slope, self._roll_at_onset
        )
        increments[..., 0] += self.slope * ((end - start) - (conic_end - conic_start))
        return increments

    @property
    def _roll_at_onset(self) -> float:
        return self.slope * self.onset + self.offset

    def _conic(self, t: Float) -> NDArray[np.bool_]:
        return (t >= self.onset)[..., None]
