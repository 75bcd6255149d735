"""Figures as a reader wants them: four significant digits, powers of a thousand, units as one writes them."""

from __future__ import annotations

import math

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_THIN_SPACE = "\u202f"
_DIGITS = 4
_SMALLEST_SHOWN, _LARGEST_SHOWN = 1e-8, 1e9  # beyond, a standard error has a power of its own
_MOST_DECIMALS = 9  # an error that is smaller than these is none that a reader compares
_LARGEST_POWER = 300  # beyond, a power of ten is no longer exact


def number(value: float | None, error: float | None = None) -> str:
    """A figure in four significant digits; beyond 0.001 … 1 000 000 times a power of a thousand.

    A whole number is given whole, a missing one as a dash; digits that are only zeros are left out. Beside a
    standard error that is smaller than these digits show, there are as many as the error has.
    """
    if value is None or not math.isfinite(value):
        return "–"
    if value == int(value) and abs(value) < 1e15:
        return _spaced(f"{int(value):,}")
    mantissa, magnitude, power = _split(value)
    decimals = max(_DIGITS - 1 - magnitude + power, _decimals(error, power), 0)
    text = f"{mantissa * 10.0 ** (magnitude - power) if power else value:,.{decimals}f}"
    exact = float(f"{mantissa}e{magnitude}") == value
    return _spaced(_stripped(text) if exact else text) + _times(power)


def _decimals(error: float | None, power: int) -> int:
    """Decimals that show a standard error in two digits, beside a power of ten; 0 if too many."""
    if error is None or not 0.0 < error < math.inf or abs(power) > _LARGEST_POWER:
        return 0
    decimals = 1 - math.floor(math.log10(error)) + power
    return decimals if decimals <= _MOST_DECIMALS else 0


def standard_error(error: float | None, value: float | None) -> str:
    """A standard error in two significant digits, times the same power of a thousand as its value."""
    if error is None or value is None or not 0.0 < error < math.inf:
        return number(error)
    power = _split(value)[-1]
    shown = error / 10.0**power if abs(power) <= _LARGEST_POWER else 0.0
    if not _SMALLEST_SHOWN <= shown < _LARGEST_SHOWN:
        return number(float(f"{error:.1e}"))
    decimals = max(1 - math.floor(math.log10(shown)), 0)
    return _spaced(f"{shown:,.{decimals}f}") + _times(power)


def measured(value: float | None, error: float | None) -> str:
    """A value in as many decimals as its standard error in two digits: ``0.15041 ± 0.00012``.

    Both times a power of a thousand where they are small; the value alone where there is no error.
    """
    if value is None or error is None or not 0.0 < error < math.inf or not math.isfinite(value):
        return number(value)
    largest = math.floor(math.log10(max(abs(value), error)))
    power = 0 if -4 < largest < 6 else 3 * (largest // 3)
    shown = error / 10.0**power
    decimals = max(1 - math.floor(math.log10(shown)), 0)
    if decimals > _MOST_DECIMALS:
        return number(value)
    rounded = round(value / 10.0**power, decimals) + 0.0  # no minus before a zero
    text = f"{_spaced(f'{rounded:,.{decimals}f}')} ± {_spaced(f'{shown:,.{decimals}f}')}"
    return f"({text}){_times(power)}" if power else text


def power_of_ten(power: int) -> str:
    """``10⁻³``."""
    return f"10{str(power).translate(_SUPERSCRIPT)}"


def unit(name: str) -> str:
    """A unit as one writes it: nothing for a pure number, a root sign for ``sqrt``."""
    return "" if name == "1" else name.replace("sqrt(s)", "√s").replace("sqrt(h)", "√h")


def words(name: str) -> str:
    """A name of the tables as words: ``peak_error_corrected`` is ``peak error corrected``."""
    return name.replace("_", " ")


def plural(count: int, noun: str) -> str:
    """``1 finding``, ``20 findings``."""
    return f"{number(count)} {noun}" if count == 1 else f"{number(count)} {noun}s"


def size(count: int) -> str:
    """A size in bytes in the nearest power of a thousand."""
    for power, name in ((9, "GB"), (6, "MB"), (3, "kB")):
        if count >= 10**power:
            return f"{count / 10**power:.1f}{_THIN_SPACE}{name}"
    return f"{count}{_THIN_SPACE}bytes"


def _split(value: float) -> tuple[float, int, int]:
    """Mantissa and decimal magnitude of the rounded figure, and the power of ten to be written behind it."""
    mantissa, exponent = f"{value:.{_DIGITS - 1}e}".split("e")
    magnitude = int(exponent)
    return float(mantissa), magnitude, 0 if -4 < magnitude < 6 else 3 * (magnitude // 3)


def _times(power: int) -> str:
    return f"×{power_of_ten(power)}" if power else ""


def _stripped(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def _spaced(text: str) -> str:
    """Typographic minus; thin spaces between thousands from five digits on."""
    whole, dot, decimals = text.replace("-", "−").partition(".")
    digits = whole.replace(",", "")
    grouped = whole.replace(",", _THIN_SPACE) if len(digits.lstrip("−")) > 4 else digits
    return grouped + dot + decimals
