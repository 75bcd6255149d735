"""The poles of the correction loops, in continuous time and from fix to fix, and how far the gains may go."""

from __future__ import annotations

from html import escape

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models import BasicTicker, BasicTickFormatter, ColumnDataSource
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline.report import style
from pipeline.report.base import Section, Tables, column
from pipeline.report.formatting import number, unit
from pipeline.report.navigation_panels import METHODS
from pipeline.report.parts import html_table
from pipeline.report.series import Floats
from pipeline.report.style import BLACK, INK

Complex = NDArray[np.complex128]

_DAMPINGS = (0.2, 0.5, 0.8)
_ABREAST = 2  # loops, each of two panels
_HEIGHT, _BORDER = 250, 66
_LINE = 26  # letters that fit above a panel
_FAINT = "#b4bbc5"
_DEADBEAT = 0.02  # a pole so near to zero is a reference that a fix sets anew, and sets no scale
_CLOSE = 0.2  # poles all within this of one are shown from near by

_FIGURES = (
    ("k_n", "k_n"),
    ("k_n_limit", "its limit"),
    ("damping", "damping"),
    ("settling_time", "settling time"),
    ("spectral_radius", "radius"),
    ("noise_velocity_by_velocity", "V by V"),
    ("noise_velocity_by_position", "V by X"),
    ("noise_position_by_position", "X by X"),
    ("noise_position_by_velocity", "X by V"),
    ("noise_attitude_by_attitude", "U by U"),
)
"""Columns of the table: their name in ``loops`` and their head."""

_RATIOS = {
    "(m/s)/(m/s)": "",
    "(m)/(m)": "",
    "(rad)/(rad)": "",
    "(m/s)/(m)": "1/s",
    "(m)/(m/s)": "s",
}


def poles(tables: Tables) -> Section | None:
    """Both planes of each loop, and the limits of Routh and Hurwitz beside its gains."""
    table = tables.get("poles")
    if table is None or not table.num_rows:
        return None
    found, rows = _loops(table), []
    for first in range(0, len(found), _ABREAST):
        loops = found[first : first + _ABREAST]
        lines = max(len(_lines(name)) for name, _, _ in loops)
        panels: list[figure | None] = []
        for name, continuous, discrete in loops:
            panels += [_continuous(name, continuous, lines), _discrete(discrete, lines)]
        rows.append([*panels, *[None] * (2 * _ABREAST - len(panels))])
    return Section(
        "Poles of the loops",
        "Of each loop at the left in continuous time, stable left of the vertical; at the right from one "
        "measurement to the next, stable within the circle, with what the references do between them. Thin "
        "lines: damping 0.2, 0.5, 0.8. Loops of the same poles are drawn once.",
        style.grid(rows),
        _limits(tables),
    )


def _loops(table: pa.Table) -> list[tuple[str, Complex, Complex]]:
    """Name, continuous and discrete poles of each loop that has poles of its own."""
    found: list[tuple[str, Complex, Complex]] = []
    for name in pc.unique(table["loop"]).to_pylist():
        mine = table.filter(pc.equal(table["loop"], name))
        kinds = [mine.filter(pc.equal(mine["kind"], kind)) for kind in ("continuous", "discrete")]
        one, two = map(_complex, kinds)
        if not any(_same(one, a) and _same(two, b) for _, a, b in found):
            found.append((name, one, two))
    return found


def _complex(table: pa.Table) -> Complex:
    return np.asarray(column(table, "real") + 1j * column(table, "imaginary"))


def _same(one: Complex, other: Complex) -> bool:
    # Poles are printed in four digits.
    return len(one) == len(other) and bool(
        np.allclose(np.sort_complex(one), np.sort_complex(other), rtol=1e-5, atol=1e-9)
    )


def _continuous(name: str, found: Complex, lines: int) -> figure:
    reach = 1.2 * float(np.abs(found).max(initial=0.0)) or 1.0
    right = max(0.25 * reach, 1.3 * float(found.real.max(initial=0.0)))
    made = _plane("real [1/s]", "imaginary [1/s]", (-reach, right), (-reach, reach))
    far = 2 * reach
    for zeta in _DAMPINGS:
        _damping(made, -zeta * np.array([0, far]), np.sqrt(1 - zeta**2) * np.array([0, far]))
        _name(made, zeta, complex(-zeta, np.sqrt(1 - zeta**2)) * 0.93 * reach)
    _curve(made, np.zeros(2), np.array([-far, far]), BLACK, 1.2)
    _marks(made, found, found.real >= 0.0)
    _heading(made, _lines(name), lines)
    return made


def _discrete(found: Complex, lines: int) -> figure:
    shown = found[np.abs(found) > _DEADBEAT]
    apart = float(np.abs(shown - 1).max(initial=0.0)) or 1.0
    close = apart < _CLOSE
    reach = 1.25 * apart if close else 1.1 * max(1.0, float(np.abs(found).max(initial=0.0)))
    ends = (1 - reach, 1 + 0.25 * reach) if close else (-reach, reach)
    made = _plane("real", "imaginary", ends, (-reach, reach))
    angle = np.geomspace(1e-6, np.pi, 400)
    for zeta in _DAMPINGS:
        radius = np.exp(-angle * zeta / np.sqrt(1 - zeta**2))
        _damping(made, radius * np.cos(angle), radius * np.sin(angle))
    whole = np.concatenate([-angle[::-1], angle])
    _curve(made, np.cos(whole), np.sin(whole), BLACK, 1.2)
    _marks(made, found, np.abs(found) >= 1.0)
    radius = float(np.abs(found).max(initial=0.0))
    _heading(made, [f"radius {number(float(f'{radius:.5g}'))}"], lines)
    return made


def _plane(x_label: str, y_label: str, x: tuple[float, float], y: tuple[float, float]) -> figure:
    made = style.plane(x_label, y_label, height=_HEIGHT, equal=True)
    made.min_border_left = _BORDER
    made.xaxis.ticker, made.yaxis.ticker = BasicTicker(desired_num_ticks=3), BasicTicker(desired_num_ticks=4)
    made.xaxis.formatter = made.yaxis.formatter = BasicTickFormatter(use_scientific=False)
    style.frame(made, x, y)
    return made


def _heading(made: figure, words: list[str], lines: int) -> None:
    """Lines above a panel, as many as above those beside it."""
    for line in reversed([*words, *[" "] * (lines - len(words))]):
        style.heading(made, line)


def _lines(name: str) -> list[str]:
    if len(name) <= _LINE:
        return [name]
    middle = name.find(", ") + 1 or name.rfind(" by ")
    return [name[:middle], name[middle:].strip()] if middle > 0 else [name]


def _damping(made: figure, x: Floats, y: Floats) -> None:
    for sign in (1, -1):
        _curve(made, x, sign * y, _FAINT, 0.8)


def _name(made: figure, zeta: float, at: complex) -> None:
    source = ColumnDataSource({"x": [at.real], "y": [at.imag], "word": [f"{zeta:g}"]})
    style.words(made, source, "x", "y", "word", colour=INK, align="center")


def _curve(made: figure, x: Floats, y: Floats, colour: str, width: float) -> None:
    source = ColumnDataSource({"x": x, "y": y})
    made.line("x", "y", source=source, line_color=colour, line_width=width)


def _marks(made: figure, found: Complex, unstable: NDArray[np.bool_]) -> None:
    for which, colour in ((~unstable, METHODS["loops"]), (unstable, "#b3261e")):
        if which.any():
            source = ColumnDataSource({"x": found[which].real, "y": found[which].imag})
            drawn = made.scatter(
                "x", "y", source=source, marker="x", size=10, line_color=colour, line_width=2.4
            )
            style.hover(made, drawn, [("real", "x"), ("imaginary", "y")])


def _limits(tables: Tables) -> str:
    """One row a loop: the gain of the bias, its limit, and what follows from the gains."""
    table = tables.get("loops")
    if table is None or not table.num_rows:
        return ""
    of: dict[str, dict[str, tuple[float | None, str]]] = {}
    for row in table.to_pylist():
        of.setdefault(row["loop"], {})[row["name"]] = (row["value"], row["unit"])
    there = [(name, head) for name, head in _FIGURES if any(name in figures for figures in of.values())]
    units = {name: next(f[name][1] for f in of.values() if name in f) for name, _ in there}
    heads = ["loop", *(_head(head, units[name]) for name, head in there)]
    body = "".join(
        f"<tr><td>{escape(loop)}</td>{''.join(_cell(figures.get(name)) for name, _ in there)}</tr>"
        for loop, figures in of.items()
    )
    note = (
        '<p class="note">k_n is the gain of the bias (of the attitude k_ω): beyond its limit by Routh and '
        "Hurwitz the loop is not stable. Settling time: until 5 % is left. The radius, spectral, is for one "
        "measurement. V by X and the like: standard deviation of the navigated by white noise of the "
        "measured, V velocity, X position, U attitude.</p>"
    )
    return html_table(heads, body, range(1, len(heads)), "matrix") + note


def _head(head: str, of: str) -> str:
    shown = _RATIOS.get(of, unit(of))
    return f"{head} [{shown}]" if shown else head


def _cell(figure_of: tuple[float | None, str] | None) -> str:
    if figure_of is None:
        return "<td></td>"
    value = figure_of[0]
    if value is None:
        return "<td class=num>∞</td>"
    return f"<td class=num title={value!r}>{number(value)}</td>"
