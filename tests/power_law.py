"""Records of power-law noise, exact at their sample points: the truth that the Allan family is held to."""

import numpy as np

BINOMIALS = {2: [1, -2, 1], 4: [1, -4, 6, -4, 1]}


class PowerLaw:
    """The integral of a rate whose noise has the density f^alpha, of unit N, B or K (or Q for alpha = 2).

    Differences of the integral of order d are stationary, with the difference of order 2d of its generalised
    covariance for autocovariance; they are made by circulant embedding (Davies & Harte, Biometrika 74 (1987)
    95) and summed again d times. What that leaves free, a start and a mean rate, no Allan variance sees.
    """

    def __init__(self, alpha, n):
        self.alpha, self.n = alpha, n
        self.order = 2 if alpha < 0 else 1
        if alpha == 2:
            return
        lag = np.arange(n + 1)
        weights = BINOMIALS[2 * self.order]
        autocovariance = (-1) ** self.order * sum(
            w * self.covariance(np.abs(lag + k - self.order).astype(float)) for k, w in enumerate(weights)
        )
        spectrum = np.fft.rfft(np.concatenate([autocovariance, autocovariance[-2:0:-1]])).real
        self.amplitude = np.sqrt(np.maximum(spectrum, 0))

    def covariance(self, t):
        if self.alpha == 0:
            return -t / 2
        if self.alpha == -1:
            return t**2 * np.log(np.where(t > 0, t, 1)) / (2 * np.pi)
        return t**3 / 12

    def draw(self, rng):
        """One record of n + 1 points at unit steps."""
        if self.alpha == 2:
            return rng.standard_normal(self.n + 1)
        white = np.fft.rfft(rng.standard_normal(2 * self.n))
        differences = np.fft.irfft(self.amplitude * white, 2 * self.n)[: self.n + 1]
        for _ in range(self.order):
            differences = np.cumsum(differences)
        return differences
