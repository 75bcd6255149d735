"""The table of section 4.3: ours, the yardstick of another aircraft model, and what the paper prints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, TypedDict

from pipeline.reproduce._panov_runs import (
    FILTER_15,
    FILTER_18,
    METHODS,
    PRINTED_X,
    TUNED_A,
    Scores,
)

Cell = float | None


class Line(TypedDict):
    """One line of the table: errors with satellites (ON, 180 to 600 s) and in their outage (OFF).

    A cell is None where nothing is given.
    """

    level: str
    method: str
    source: Literal["printed", "yardstick", "ours"]
    on_h_rms: Cell
    on_v_rms: Cell
    on_tilt_rms: Cell
    on_yaw_rms: Cell
    off_h_max: Cell
    off_v_max: Cell
    off_v_rms: Cell


COLUMNS: Mapping[str, str] = MappingProxyType(
    {
        "on_h_rms": "ON H rms, m",
        "on_v_rms": "ON V rms, m/s",
        "on_tilt_rms": "ON tilt, deg",
        "on_yaw_rms": "ON yaw, deg",
        "off_h_max": "OFF H max, m",
        "off_v_max": "OFF V max, m/s",
        "off_v_rms": "OFF V rms, m/s",
    }
)
"""Errors of the table, and their heads."""

_PRINTED: tuple[Cell, ...] = (None, 0.1, 0.5, 0.3, 22.0, 0.2, None)
"""Of the horizontal position with satellites the paper says tenths of a metre, of the tilt at most 0.5."""

_YARDSTICK: Mapping[tuple[str, str], tuple[Cell, ...]] = MappingProxyType(
    {
        ("ideal", PRINTED_X): (0.00, 0.000, 0.00, 0.00, 34.0, 0.97, 0.37),
        ("ideal", TUNED_A): (0.04, 0.020, 0.88, 0.35, 55.0, 0.77, 0.34),
        ("ideal", FILTER_15): (0.00, 0.000, 0.02, 0.08, 54.0, 0.41, None),
        ("ideal", FILTER_18): (0.00, 0.000, 0.00, 0.01, 36.0, 0.41, None),
        ("diff", TUNED_A): (0.84, 0.148, 0.89, 0.52, 249.0, 3.3, 1.4),
        ("diff", FILTER_15): (0.62, 0.032, 0.14, 0.42, 210.0, 1.3, 0.66),
        ("diff", FILTER_18): (0.62, 0.032, 0.08, 0.15, 194.0, 1.3, 0.66),
        ("gps", TUNED_A): (4.7, 0.47, 0.89, 0.52, 267.0, 3.3, 1.4),
        ("gps", FILTER_15): (3.2, 0.055, 0.17, 0.78, 207.0, 1.4, 0.67),
    }
)
"""By an aircraft model that is not ours."""


def table(medians: Scores) -> list[Line]:
    """What the paper prints; for each method ours and, where there is one, the yardstick."""
    return [_line("paper", "loops", "printed", _PRINTED), *_ours(medians)]


def _ours(medians: Scores) -> Iterator[Line]:
    for method in METHODS:
        key = method.level, method.name
        yield _line(*key, "ours", [getattr(medians[key], name) for name in COLUMNS])
        if key in _YARDSTICK:
            yield _line(*key, "yardstick", _YARDSTICK[key])


def _line(
    level: str, method: str, source: Literal["printed", "yardstick", "ours"], cells: Sequence[Cell]
) -> Line:
    h, v, tilt, yaw, off_h, off_v, off_v_rms = cells
    return Line(
        level=level,
        method=method,
        source=source,
        on_h_rms=h,
        on_v_rms=v,
        on_tilt_rms=tilt,
        on_yaw_rms=yaw,
        off_h_max=off_h,
        off_v_max=off_v,
        off_v_rms=off_v_rms,
    )


def as_text(lines: Sequence[Line]) -> str:
    """The table for the terminal."""
    named = [(f"{line['level']}: {line['method']}", line) for line in lines]
    width = max(len(name) for name, _ in named)
    text = [" ".join([f"{'':<{width}} {'':<9}", *COLUMNS.values()])]
    for name, line in named:
        cells = [line["on_h_rms"], line["on_v_rms"], line["on_tilt_rms"], line["on_yaw_rms"]]
        cells += [line["off_h_max"], line["off_v_max"], line["off_v_rms"]]
        shown = (
            f"{'' if cell is None else f'{cell:.3g}':>{len(head)}}"
            for cell, head in zip(cells, COLUMNS.values(), strict=True)
        )
        text.append(" ".join([f"{name:<{width}} {line['source']:<9}", *shown]).rstrip())
    return "\n".join(text)
