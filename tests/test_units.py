"""Units against their definitions."""

from __future__ import annotations

import math

import pytest

from pipeline import units


@pytest.mark.parametrize(
    ("unit", "of", "factor"),
    [
        ("rad/s", "angular rate", 1.0),
        ("deg/s", "angular rate", math.pi / 180),
        ("deg/h", "angular rate", math.pi / 180 / 3600),
        ("mdps", "angular rate", math.pi / 180_000),
        ("arcsec/s", "angular rate", math.pi / 180 / 3600),
        ("rpm", "angular rate", math.pi / 30),
        ("rev/min", "angular rate", math.pi / 30),
        ("deg", "angle", math.pi / 180),
        ("arcmin", "angle", math.pi / 180 / 60),
        ("rev", "angle", 2 * math.pi),
        ("us", "time", 1e-6),
        ("h", "time", 3600.0),
        ("1", "pure number", 1.0),
    ],
)
def test_factor_is_that_of_the_definition(unit: str, of: str, factor: float) -> None:
    # both sides are products of at most three rounded factors
    assert units.factor(unit, of) == pytest.approx(factor, rel=1e-15)
    assert units.dimension(unit) == of


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("°/s", "deg/s"),
        ("dps", "deg/s"),
        ("degrees/sec", "deg/s"),
        ("degrees per second", "deg/s"),
        (" rad / s ", "rad/s"),
        ("rad s^-1", "rad/s"),
        ("rad·s⁻¹", "rad/s"),
        ("°/hr", "deg/h"),
        ("radians", "rad"),
        ("µs", "us"),
        ("μrad/s", "urad/s"),
        ("r/min", "rpm"),
        ("″", "arcsec"),
    ],
)
def test_spellings(written: str, meant: str) -> None:
    assert units.canonical(written) == meant


@pytest.mark.parametrize("unit", ["", "gn", "counts", "rads/s", "rps", "Deg", "s/rad", "deg/s/s", "m/rad"])
def test_what_is_unknown_or_could_mean_two_things_has_no_factor(unit: str) -> None:
    assert units.dimension(unit) is None


def test_a_unit_of_another_dimension_has_no_factor() -> None:
    assert units.factor("deg", "angular rate") is None
    assert units.factor("rad/s", "time") is None


def test_no_unit_measures_two_things() -> None:
    names = [name for of in units.FACTORS.values() for name in of]
    assert len(names) == len(set(names))
    assert all(units.canonical(name) == name for name in names)


def test_nearest_says_the_unit_meant_and_all_that_would_do() -> None:
    sentence = units.nearest("rads/s", "angular rate")
    assert sentence.startswith("did you mean 'rad/s'?")
    assert "deg/s" in sentence
    assert "per min and h" in sentence
    assert units.nearest("", "time") == "known units of time: s, ms, us, ns, min, h"
