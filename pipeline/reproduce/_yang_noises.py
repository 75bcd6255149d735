"""The noises on which the figures of Yang et al. (2014) are computed."""

from __future__ import annotations

import numpy as np

from pipeline.models.random_error import Noise, Noise1, Noise2, Noise3

SOURCE = "Yang et al., Chinese Journal of Sensors and Actuators 27(5) (2014) 637-642"

RATE = float(np.deg2rad(3.0))
"""Of the platform, rad/s."""

NOISES: tuple[Noise, ...] = (Noise1(0.01, 0.01), Noise2(0.01, 0.01, 0.01), Noise3(0.01, 0.01, 0.01))
RESONANT: tuple[Noise, ...] = (Noise2(0.01, 0.01, 0.05), Noise3(0.01, 0.01, 0.05))
"""Sigma in the sensor's unit, mu and lambda in rad/s."""


def title(noise: Noise) -> str:
    """Such as "noise 2, lambda = 0.05": sigma and mu are 0.01 throughout."""
    period = "" if noise.name == "noise1" else f", lambda = {-noise.decay.imag:g}"
    return f"noise {noise.name[-1]}{period}"
