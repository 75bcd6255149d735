"""The calibration in figures: of each gyro, and the sensitivity matrix of the triad."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pipeline.report.base import Section, Tables
from pipeline.report.formatting import measured, number, unit
from pipeline.report.parts import html_table
from pipeline.report.rate_table_runs import CELSIUS, CHANNELS, DEG_H, DEG_S, PPM, Row, rows_of

_HIGHEST = 9
"""Order of a nonlinearity: more than any calibration has."""
_METHODS = {
    "rates": "the rates of a table",
    "turns": "turns by known angles",
    "positions": "the Earth's rate in known positions",
    "joined": "several methods together",
}
_STATES = {"combined": "only weakly or in combination", "undetermined": "not determined"}


class Shown(NamedTuple):
    """How a parameter is shown: its words, its unit, and ``factor * (value - zero)``, which is in it."""

    words: str
    unit: str
    factor: float
    zero: float = 0.0


_SHOWN: tuple[tuple[str, Shown], ...] = (
    ("bias", Shown("bias", "deg/h", DEG_H)),
    ("scale_factor", Shown("scale factor", "", 1.0)),
    ("scale_factor", Shown("its error against 1", "ppm", PPM, 1.0)),
    ("scale_factor_asymmetry", Shown("asymmetry", "ppm", PPM)),
    *(
        (f"scale_factor_nonlinearity_{k}", Shown(f"nonlinearity of order {k}", "ppm", PPM))
        for k in range(2, _HIGHEST + 1)
    ),
    ("bias_temperature_sensitivity", Shown("bias by temperature", "deg/h/K", DEG_H)),
    ("scale_factor_temperature_sensitivity", Shown("scale factor by temperature", "ppm/K", PPM)),
    ("linearity_error", Shown("largest deviation from a straight line", "ppm", PPM)),
    ("step_scatter", Shown("scatter between observations", "deg/h", DEG_H)),
)


def calibration(tables: Tables) -> Section | None:
    """The parameters with standard errors and states, one column a gyro."""
    rows = rows_of(tables, "calibration")
    if not rows:
        return None
    triad = {row["parameter"]: row for row in rows if not row["gyro"]}
    names = [name for name, _ in _SHOWN]
    of_triad = {
        (name, axis): triad[f"{name}_{axis}"]
        for name in names
        for axis in CHANNELS
        if f"{name}_{axis}" in triad
    }
    of_axes = {(row["parameter"], row["gyro"]): row for row in rows if row["gyro"]}
    return Section(
        "Calibration",
        _text(rows),
        None,
        '<div class="matrices">'
        + _parameters("the triad", of_triad)
        + _parameters("each gyro by its own axis", of_axes)
        + _sensitivity(triad)
        + "</div>",
    )


def _text(rows: Sequence[Row]) -> str:
    """By what, which part corrects records, and for which temperature and rates."""
    model = [row for row in rows if row["role"] == "model"]
    used = "the triad's matrix and biases" if model and not model[0]["gyro"] else "each gyro's own model"
    if all(row["state"] == "determined" for row in model):
        corrects = f"What corrects a later record is {used}."
    elif all(row["standard_error"] is not None for row in model):
        corrects = f"What may correct a later record, to what its errors allow, is {used}."
    else:
        corrects = "It cannot correct a later record."
    text = f"By {_METHODS[rows[0]['method']]}, ± one standard error. {corrects}"
    temperatures = {row["reference_temperature"] for row in rows} - {None}
    if temperatures:
        celsius = min(temperatures) - CELSIUS
        text += f" Bias and scale factor hold at {number(float(f'{celsius:.4g}'))} °C."
    largest = max(row["largest_rate"] for row in rows)
    text += f" Largest input rate: {number(float(f'{DEG_S * largest:.4g}'))} deg/s."
    if any(row["state"] != "determined" for row in rows):
        text += (
            " Pale: not determined by these observations, or only weakly or in combination; see the findings."
        )
    return text


def _parameters(title: str, rows: Mapping[tuple[str, str], Row]) -> str:
    """One row a parameter, one column a gyro; nothing where there is none."""
    channels = [channel for channel in CHANNELS if any(axis == channel for _, axis in rows)]
    body = ""
    for name, shown in _SHOWN:
        mine = [rows.get((name, channel)) for channel in channels]
        if any(mine):
            cells = "".join(_cell(row, shown) for row in mine)
            body += f"<tr><td>{shown.words}</td><td>{shown.unit}</td>{cells}</tr>"
    return html_table((title, "unit", *channels), body, range(2, 2 + len(channels)), "matrix") if body else ""


def _sensitivity(triad: Mapping[str, Row]) -> str:
    """The matrix S: what each gyro tells of the rate about each axis of the case."""
    axes = range(1, len(CHANNELS) + 1)
    if not any(f"S{i}{j}" in triad for i in axes for j in axes):
        return ""
    body = ""
    for i, channel in zip(axes, CHANNELS, strict=True):
        cells = "".join(_cell(triad.get(f"S{i}{j}"), Shown("", "", 1.0)) for j in axes)
        body += f"<tr><td>{channel}</td>{cells}</tr>"
    heads = ("output of, by the rate about", *CHANNELS)
    return html_table(heads, body, range(1, 1 + len(CHANNELS)), "matrix")


def _cell(row: Row | None, shown: Shown) -> str:
    if row is None:
        return "<td></td>"
    if row["value"] is None:
        return f'<td class=num><span class="pale">{_STATES["undetermined"]}</span></td>'
    error = row["standard_error"]
    text = measured(
        shown.factor * (row["value"] - shown.zero), None if error is None else shown.factor * error
    )
    sure = row["state"] == "determined"
    title = f"{row['value']!r} {unit(row['unit'])}".strip() + ("" if sure else f", {_STATES[row['state']]}")
    return (
        f'<td class=num title="{title}">' + (text if sure else f'<span class="pale">{text}</span>') + "</td>"
    )
