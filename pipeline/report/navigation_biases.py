"""How the biases of the sensors, the wind and the barometer become known."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Section, Tables
from pipeline.report.navigation_panels import AXES, HALF, Board, Rows, band, drawn, level, methods
from pipeline.report.series import Floats

_DEG_S = np.pi / 180
_DEG_H = _DEG_S / 3600
_COARSE = 0.01 * _DEG_S  # rad/s; smaller biases are in deg/h
_FINE = 5e-3  # m/s^2; smaller biases are in mm/s^2
_SIGMAS = 3.0
_TRANSIENT = 0.2  # of the record, after which bands set the scale: before, they are the start's
_NAMES = {"x": "forward", "y": "right", "z": "down"}


class Quantity(NamedTuple):
    """What a panel shows: a column of `navigation`, words above and beside it, unit in SI, truth [SI]."""

    name: str
    heading: str
    label: str
    unit: float
    true: float | None


def biases(tables: Tables) -> Section | None:
    """Gyros at the left, accelerometers at the right; below them wind and the barometer's bias."""
    board = Board.of(tables)
    found = [rows for rows in methods(tables, "navigation") if rows.method != "strapdown"]
    if not found or board is None:
        return None
    true = true_biases(tables)
    gyro, accelerometer = _gyros(found, true), _accelerometers(found, true)
    pairs: list[list[Quantity]] = [list(pair) for pair in zip(gyro, accelerometer, strict=True)]
    wind = [Quantity(f"wind_{a}", f"wind {a}", "[m/s]", 1.0, None) for a in ("north", "east")]
    barometer = [Quantity("barometer_bias", "barometer", "[m]", 1.0, None)]
    pairs += [known for known in (_known(found, wind), _known(found, barometer)) if known]
    for place, pair in enumerate(pairs):
        # All in a row have the axis's words, or none: their frames are equally high.
        lowest = place == len(pairs) - 1 or len(pairs[place + 1]) < len(pair)
        panels: list[figure | None] = []
        for quantity in pair:
            made = board.panel(quantity.label, heading=quantity.heading, x_label=lowest)
            _draw(made, board, found, quantity)
            panels.append(made)
        board.row(*panels, *[None] * (2 - len(panels)))
    given = " Dashed: the true value." if true else ""
    return Section(
        "Biases",
        f"Estimates by each method; band: ±{_SIGMAS:.0f}σ that a method states of itself.{given}",
        board.arranged(),
    )


def true_biases(tables: Tables) -> dict[str, float]:
    """What the test plan says that the biases are [SI], by column; it is in the provenance of the score."""
    settings: dict[str, Sequence[float] | None] = {}
    for row in tables["provenance"].to_pylist() if "provenance" in tables else []:
        if row["stage"] == "score_navigation":
            settings = json.loads(row["settings"])
    keys = (("gyro_bias", "gyro_bias_deg_s", _DEG_S), ("accelerometer_bias", "accelerometer_bias_m_s2", 1.0))
    return {
        f"{name}_{axis}": value * unit
        for name, key, unit in keys
        for axis, value in zip(AXES, settings.get(key) or (), strict=False)
    }


def _gyros(found: list[Rows], true: dict[str, float]) -> list[Quantity]:
    names = [f"gyro_bias_{axis}" for axis in AXES]
    unit, word = (_DEG_S, "°/s") if _largest(found, names, true) >= _COARSE else (_DEG_H, "°/h")
    return _three("gyros", names, unit, word, true)


def _accelerometers(found: list[Rows], true: dict[str, float]) -> list[Quantity]:
    names = [f"accelerometer_bias_{axis}" for axis in AXES]
    unit, word = (1.0, "m/s²") if _largest(found, names, true) >= _FINE else (1e-3, "mm/s²")
    return _three("accelerometers", names, unit, word, true)


def _three(
    heading: str, names: Sequence[str], unit: float, word: str, true: dict[str, float]
) -> list[Quantity]:
    """The three axes; the heading stands above the first."""
    return [
        Quantity(name, "" if place else heading, f"{_NAMES[name[-1]]} [{word}]", unit, true.get(name))
        for place, name in enumerate(names)
    ]


def _largest(found: list[Rows], names: Sequence[str], true: dict[str, float]) -> float:
    """The largest final estimate or true value."""
    last = [abs(float(rows[name][-1])) for rows in found for name in names]
    return max([*last, *(abs(true.get(name, 0.0)) for name in names)])


def _known(found: list[Rows], quantities: list[Quantity]) -> list[Quantity]:
    return [q for q in quantities if any(rows.has(q.name) for rows in found)]


def _draw(made: figure, board: Board, found: list[Rows], of: Quantity) -> None:
    shown: list[Floats] = [np.zeros(1)]
    if of.true is not None:
        board.note("true", level(made, board, of.true / of.unit))
        shown.append(np.array([of.true / of.unit]))
    for rows in found:
        if not rows.has(of.name):
            continue
        value, sigma = rows[of.name] / of.unit, _SIGMAS * rows[f"sigma_{of.name}"] / of.unit
        shade = band(made, rows, value, sigma, columns=HALF)
        board.note(rows.method, drawn(made, rows, value, columns=HALF), *([shade] if shade else []))
        late = rows.time >= _TRANSIENT * board.clock.duration
        shown.append(value[rows.time >= _TRANSIENT / 2 * board.clock.duration])
        shown += [value[late] - sigma[late], value[late] + sigma[late]] if shade else []
    made.y_range = style.span(*_ends(shown))


def _ends(shown: list[Floats]) -> tuple[float, float]:
    there = np.concatenate(shown)
    there = there[np.isfinite(there)]
    low, high = float(there.min()), float(there.max())
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room
