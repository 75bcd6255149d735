from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.report import scale
from pipeline.report.formatting import measured, number, plural, size, standard_error, unit


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "–"),
        (0.0, "0"),
        (400.0, "400"),
        (12345.0, "12\u202f345"),
        (143.6247, "143.6"),
        (-0.013467, "−0.01347"),
        (0.2, "0.2"),
        (0.19999999, "0.2000"),
        (4.69e-5, "46.9×10⁻⁶"),
        (9.99999e-4, "0.001000"),
        (123456.7, "123\u202f457"),
        (1234567.8, "1.235×10⁶"),
        (5e-324, "4.941×10⁻³²⁴"),
    ],
)
def test_a_figure_has_four_significant_digits(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.0007993, 2.0e-6, "1.0007993"),
        (1.00146623, 3.8e-6, "1.0014662"),
        (11.27, 0.70, "11.27"),
        (1.2345e-7, 1e-10, "123.50×10⁻⁹"),
        (0.5, 1e-14, "0.5"),  # no reader compares as many digits
        (0.123456, 0.0, "0.1235"),
        (0.123456, None, "0.1235"),
    ],
)
def test_a_figure_has_the_digits_that_its_standard_error_has(
    value: float, error: float | None, text: str
) -> None:
    assert number(value, error) == text


@given(st.floats(-1e308, 1e308))
def test_a_figure_reads_back_to_four_digits(value: float) -> None:
    text = number(value).replace("−", "-").replace("\u202f", "").replace("×10", "e")
    read = float(text.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    # half a unit of the fourth digit is 5e-4 of the smallest mantissa, 1.000; subnormal numbers are coarser
    assert read == pytest.approx(value, rel=5.001e-4, abs=5e-324)


@pytest.mark.parametrize(
    ("error", "value", "text"),
    [
        (5.5e-5, -0.0134, "0.000055"),
        (2e-6, 4.69e-5, "2.0×10⁻⁶"),
        (0.5, 0.0, "0.50"),
        (1e-20, 1.0, "10×10⁻²¹"),
        (1e300, 1e-300, "1×10³⁰⁰"),
        (0.0, 1.0, "0"),
        (None, 1.0, "–"),
    ],
)
def test_a_standard_error_is_written_as_its_value_is(error: float | None, value: float, text: str) -> None:
    assert standard_error(error, value) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.150412, 1.23e-4, "0.15041 ± 0.00012"),
        (-0.150412, 0.3, "−0.15 ± 0.30"),
        (0.0, 2.0, "0.0 ± 2.0"),
        (123456.7, 12.0, "123\u202f457 ± 12"),
        (4.12e-6, 3.1e-8, "(4.120 ± 0.031)×10⁻⁶"),
        (2e-9, 5e-4, "(0 ± 500)×10⁻⁶"),
        (-1e-9, 15.0, "0 ± 15"),
        (0.25, 0.0, "0.25"),
        (0.25, None, "0.25"),
        (0.25, 1e-15, "0.25"),
        (None, 1.0, "–"),
    ],
)
def test_a_value_has_as_many_decimals_as_its_error_allows(
    value: float | None, error: float | None, text: str
) -> None:
    assert measured(value, error) == text


def test_words_around_figures() -> None:
    assert (unit("1"), unit("rad/sqrt(s)"), unit("Hz")) == ("", "rad/√s", "Hz")
    assert (plural(1, "limit"), plural(0, "limit")) == ("1 limit", "0 limits")
    assert (size(12), size(4_560_000)) == ("12\u202fbytes", "4.6\u202fMB")


@pytest.mark.parametrize(
    ("peak", "name"),
    [(1.0, "°"), (math.radians(0.5), "arcmin"), (7e-5, "arcsec"), (4e-7, "mas"), (1e-15, "µas"), (0.0, "°")],
)
def test_an_angle_is_drawn_in_the_unit_in_which_it_reads_best(peak: float, name: str) -> None:
    factor, found = scale.angle([np.array([0.0, -peak, np.nan])])
    assert found == name
    assert scale.rate([np.array([-0.1])])[1] == "mrad/s"
    assert factor > 0
