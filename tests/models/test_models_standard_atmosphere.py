"""Altitude from pressure, against the tables of ISO 2533."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.standard_atmosphere import altitude_of_pressure


@pytest.mark.parametrize(
    ("pressure", "altitude"),
    [
        (101325.0, 0.0),
        (113929.0, -1000.0),
        (89874.6, 1000.0),
        (54019.9, 5000.0),
        (22632.1, 11_000.0),
        (12044.6, 15_000.0),
        (5474.89, 20_000.0),
    ],
)
def test_the_tables_of_the_standard_atmosphere(pressure: float, altitude: float) -> None:
    """The tables have six digits of the pressure, and 5e-6 of it is 4 cm."""
    assert altitude_of_pressure(pressure) == pytest.approx(altitude, abs=0.05)


def test_the_two_layers_meet() -> None:
    just_below, just_above = altitude_of_pressure([22632.07, 22632.05])
    # a pressure step of 1e-6 of itself is 6 mm
    assert just_above - just_below == pytest.approx(0.0056, abs=0.001)


def test_no_pressure_has_no_altitude() -> None:
    found = altitude_of_pressure([0.0, -1.0, np.nan, np.inf])
    assert np.isnan(found).all()
