"""What is simulated in the samples of the procedure `rate_table`, and what their gyros may be."""

from __future__ import annotations

from math import radians

from pipeline.models.random_error import Noise1, White
from pipeline.simulate.drift_settings import Encoder
from pipeline.simulate.imperfections import TimingErrors
from pipeline.simulate.plan import Limit
from pipeline.simulate.rate_table_settings import (
    Mounting,
    Profile,
    RateTableSettings,
    TableGyro,
    TableSensor,
    Thermometer,
)

_PPM, _MRAD = 1e-6, 1e-3
_DEG_H = radians(1 / 3600)
_WALK = White((radians(0.05) / 60) ** 2)
"""Angle random walk of 0.05 deg/sqrt(h)."""
_RATES = tuple(radians(rate) for rate in (0.0, 20.0, -20.0, 60.0, -60.0, 100.0, -100.0))


def _gyro(scale: float, misalignment: tuple[float, float], bias: float) -> TableGyro:
    """A gyro by the error of its scale factor [ppm], misalignment [mrad] and bias [deg/h]."""
    one, other = misalignment
    return TableGyro(
        scale_factor=1 + scale * _PPM,
        misalignment=(one * _MRAD, other * _MRAD),
        bias=bias * _DEG_H,
        terms=(_WALK, Noise1(1.0 * _DEG_H, 0.05)),
    )


CASE_OF_THREE = RateTableSettings(
    gyros={
        "p": _gyro(800.0, (1.5, -2.0), 12.0),
        "q": _gyro(-400.0, (0.7, 1.1), -20.0),
        "r": _gyro(150.0, (-0.9, 0.4), 35.0),
    },
    profile=Profile(rates=_RATES, dwell=10.0, acceleration=radians(100.0)),
    rate=10.0,
    latitude=radians(55.75),
    heading=radians(30.0),
    orientation_error=0.1 * _MRAD,
    bias_error=1.0 * _DEG_H,
    table=TableSensor(rate=10.0, encoder=Encoder(counts=1_296_000, as_counts=True, unit="deg", wrapped=True)),
    timing=TimingErrors(clock_offset=0.012),
)
"""Three gyros, mounted about each axis of their case on a table with an encoder of one arcsec."""

WARMING_GYRO = RateTableSettings(
    gyros={
        "p": TableGyro(
            scale_factor=1 - 900 * _PPM,
            asymmetry=400 * _PPM,
            nonlinearity={3: 250 * _PPM},
            bias=25 * _DEG_H,
            bias_temperature_sensitivity=1.5 * _DEG_H,
            scale_factor_temperature_sensitivity=30 * _PPM,
            terms=(_WALK,),
        )
    },
    profile=Profile(rates=2 * _RATES, dwell=10.0, acceleration=radians(100.0)),
    mountings=(Mounting(axis="p"),),
    rate=10.0,
    means=True,
    latitude=radians(55.75),
    table=TableSensor(quantity="table_rate", rate=10.0, noise=radians(2e-4), encoder=Encoder(unit="deg")),
    temperature=Thermometer(profile=((0.0, 293.15), (80.0, 296.15), (160.0, 298.15)), noise=0.05),
    reference_temperature=296.15,
)
"""One gyro with every term of the model, against the table's own rate; so slow a warming that what it changes
within a step is below the noise."""


def specified(axes: str) -> tuple[Limit, ...]:
    """Limits of gyros by what their specification may be, and that the model holds."""
    return tuple(
        limit
        for axis in axes
        for limit in (
            Limit("scale_factor_error", axis, 2000.0, None, "ppm; the gyro's specification", lower=-2000.0),
            Limit("bias", axis, 60.0, None, "deg/h; the gyro's specification", lower=-60.0),
            Limit("residual_rms", axis, 50.0, None, "ppm of the largest rate"),
        )
    )
