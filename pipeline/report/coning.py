"""The figures of the procedure ``coning``: rates, angles against the reference, and the trend of an angle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models import Range1d
from bokeh.plotting import figure

from pipeline.report import scale, series, style, timeline
from pipeline.report.base import Clock, Section, Tables, record_clock
from pipeline.report.formatting import number, standard_error
from pipeline.report.series import Series
from pipeline.report.style import BLACK, BLUE, GREEN, PALE, VERMILION, Drawn
from pipeline.report.trend_lines import TrendLine, trend_lines

RATES = {"p": BLUE, "q": VERMILION, "r": GREEN}
ANGLES = {"psi": "ψ", "theta": "θ", "gamma": "γ"}
TIME = "time from the record's start [s]"

REFERENCE, INTEGRATED, CORRECTED = "reference", "integrated", "trend removed"
_LOOK = {REFERENCE: (PALE, 4.0), INTEGRATED: (VERMILION, 1.3), CORRECTED: (BLUE, 1.3)}

Angles = Mapping[str, Series]
"""The angles [rad] of a record by their origin: `INTEGRATED`, and `REFERENCE` and `CORRECTED` where known."""

_RATE_STREAMS = ("gyro", "gyro_increments", "rates")
_SAMPLES_SHOWN = 40
_PERIODS_SHOWN = 4
_DOTS_APART = 100  # samples of the reference over half the page that can be told apart
_FLOOR = 1e-9  # of the largest line of a spectrum: below lies rounding


def figures(tables: Tables) -> list[Section]:
    """The sections of the page; each is left out where its tables are missing or empty."""
    clock = record_clock(tables)
    if clock is None or clock.duration <= 0.0:
        return []
    x_range = style.span(0.0, clock.duration)
    sections = [_rates(tables, clock, x_range)]
    angles = _angles(tables, clock)
    if angles is not None:
        trends = trend_lines(tables, angles[INTEGRATED], clock)
        sections += [
            _whole(angles, x_range),
            *(_trend(angles, name, lines, x_range) for name, lines in trends.items()),
            *(_two_ends(angles, name, lines) for name, lines in trends.items()),
            _errors(angles, x_range),
        ]
    sections += [_samples(tables, clock), _spectrum(tables, clock)]
    return [section for section in sections if section is not None]


# ------------------------------------------------------------------------------------------------ rates


def _measured(tables: Tables, clock: Clock) -> Series | None:
    """The rates as recorded; a gyro that records increments has rates after interpolation only."""
    recorded = series.read(tables, "gyro", clock, tuple(RATES))
    return recorded or series.read(tables, "rates", clock, tuple(RATES))


def _rates(tables: Tables, clock: Clock, x_range: Range1d) -> Section | None:
    """One panel a rate, and the lanes of the findings, under one time axis."""
    measured = _measured(tables, clock)
    if measured is None:
        return None
    found = timeline.marks(tables["findings"], clock)
    in_rates = timeline.marks(tables["findings"], clock, _RATE_STREAMS)
    rows = []
    for name, colour in RATES.items():
        factor, unit = scale.rate([measured.values[name]])
        lowest = name == "r" and not found
        made = style.panel(f"{name} [{unit}]", x_range, height=130, x_label=TIME if lowest else None)
        timeline.shade(made, in_rates)
        style.curve(made, measured.time, measured.values[name] / factor, colour, gap=measured.gap)
        rows.append([made])
    if found:
        rows.append([timeline.lanes(found, x_range, TIME)])
    where = ", and the findings on the same time line." if found else "; no finding has a time."
    return Section("Angular rates", f"Rates about the body axes as recorded{where}", style.grid(rows))


def _samples(tables: Tables, clock: Clock) -> Section | None:
    """A few samples in the middle of the record, and the curve through them that is integrated."""
    measured = series.read(tables, "gyro", clock, tuple(RATES))
    rates = series.read(tables, "rates", clock, tuple(RATES))
    if measured is None or rates is None:
        return None
    middle = len(measured.time) // 2
    dots = measured.part(slice(max(middle - _SAMPLES_SHOWN // 2, 0), middle + _SAMPLES_SHOWN // 2))
    first, last = float(dots.time[0]), float(dots.time[-1])
    lines = rates.within(first, last)
    factor, unit = scale.rate(dots.values.values())
    made = style.panel(f"rate [{unit}]", style.span(first, last), height=220, x_label=TIME)
    items: list[tuple[str, list[Drawn]]] = []
    for name, colour in RATES.items():
        line = style.curve(made, lines.time, lines.values[name] / factor, colour, gap=rates.gap)
        items.append((name, [line, style.dots(made, dots.time, dots.values[name] / factor, colour)]))
    style.legend(made, items)
    return Section(
        "Samples and interpolation",
        f"{len(dots.time)} samples in the middle of the record (dots) and the curve through them that is "
        "integrated (lines).",
        style.grid([[made]]),
    )


def _spectrum(tables: Tables, clock: Clock) -> Section | None:
    measured = _measured(tables, clock)
    stretch = None if measured is None else series.longest_stretch(measured)
    if stretch is None:
        return None
    frequency, amplitude = series.spectrum(stretch)
    floor = max(max(float(a.max()) for a in amplitude.values()) * _FLOOR, np.finfo(np.float64).tiny)
    made = style.panel(
        "amplitude [rad/s]",
        style.span(0.0, float(frequency[-1])),
        height=220,
        x_label="frequency [Hz]",
        logarithmic=True,
    )
    drawn = {
        name: style.curve(made, frequency, np.where(amplitude[name] > floor, amplitude[name], np.nan), colour)
        for name, colour in RATES.items()
    }
    style.legend(made, [(name, [line]) for name, line in drawn.items()])
    length = number(float(stretch.time[-1] - stretch.time[0]))
    return Section(
        "Spectrum of the rates",
        f"Amplitudes over {length} s without interruption; mean removed, Hann window.",
        style.grid([[made]]),
    )


# ----------------------------------------------------------------------------------------------- angles


def _angles(tables: Tables, clock: Clock) -> Angles | None:
    origins = {REFERENCE: "reference", INTEGRATED: "attitude", CORRECTED: "attitude_corrected"}
    found = {word: series.read(tables, name, clock, tuple(ANGLES)) for word, name in origins.items()}
    angles = {word: s for word, s in found.items() if s is not None}
    if INTEGRATED not in angles:
        return None
    if REFERENCE in angles:
        angles[REFERENCE] = series.on_branch(angles[REFERENCE], angles[INTEGRATED])
    return angles


def _draw(made: figure, angles: Angles, name: str, factor: float) -> dict[str, Drawn]:
    """One angle from all its origins in one panel."""
    return {
        word: style.curve(made, s.time, s.values[name] / factor, colour, gap=s.gap, width=width)
        for word, (colour, width) in _LOOK.items()
        if (s := angles.get(word)) is not None
    }


def _whole(angles: Angles, x_range: Range1d) -> Section:
    """All angles over the whole record."""
    panels, drawn = [], []
    for name, symbol in ANGLES.items():
        factor, unit = scale.angle([angles[INTEGRATED].values[name]])
        label = TIME if name == "gamma" else None
        panels.append(style.panel(f"{symbol} [{unit}]", x_range, height=140, x_label=label))
        drawn.append(_draw(panels[-1], angles, name, factor))
    style.legend(panels[0], [(word, [lines[word] for lines in drawn]) for word in drawn[0]])
    against = ", against the stand's own reference." if REFERENCE in angles else "."
    return Section(
        "Angles",
        f"Euler–Krylov angles by integration of the rates, before and after the trend is removed{against}",
        style.grid([[made] for made in panels]),
    )


def _errors(angles: Angles, x_range: Range1d) -> Section | None:
    """Error of each angle, one panel before and one after the correction: they differ by orders."""
    if REFERENCE not in angles:
        return None
    computed = [word for word in (INTEGRATED, CORRECTED) if word in angles]
    errors = {word: series.difference(angles[word], angles[REFERENCE]) for word in computed}
    rows = []
    for name, symbol in ANGLES.items():
        row = []
        for word, error in errors.items():
            factor, unit = scale.angle([error.values[name]])
            label = TIME if name == "gamma" else None
            made = style.panel(f"error of {symbol} [{unit}]", x_range, height=130, x_label=label)
            if name == "psi":
                style.heading(made, word)
            style.curve(made, error.time, error.values[name] / factor, _LOOK[word][0], gap=error.gap)
            row.append(made)
        rows.append(row)
    return Section(
        "Errors against the reference",
        "Angle less reference at the reference's times. Each panel has a scale of its own.",
        style.grid(rows),
    )


# ------------------------------------------------------------------------------------------------ trend


def _trend(angles: Angles, name: str, lines: Sequence[TrendLine], x_range: Range1d) -> Section:
    """The angle over the whole record with its trend, the extremes it goes through and the onset."""
    symbol, integrated = ANGLES[name], angles[INTEGRATED]
    factor, unit = scale.angle([integrated.values[name]])
    made = style.panel(f"{symbol} [{unit}]", x_range, height=280, x_label=TIME)
    items = {word: [drawn] for word, drawn in _draw(made, angles, name, factor).items()}
    for line in lines:
        ends = np.array([line.start, line.end])
        items.setdefault("trend", []).append(
            style.curve(made, ends, line.total(ends) / factor, BLACK, width=1.8, dash="6 4")
        )
        if line.onset is not None:
            style.marker(made, line.onset, "onset of the vibration")
            smooth = np.array([line.segment_start, line.end])
            items.setdefault("smooth motion", []).append(
                style.curve(made, smooth, line.smooth(smooth) / factor, BLACK, width=1.4, dash="2 4")
            )
        if line.by_extremes:
            t, y = line.extremes(integrated, name)
            items.setdefault("extremes", []).append(style.dots(made, t, y / factor, BLACK, size=9))
    style.legend(made, list(items.items()))
    return Section(f"Trend of {symbol}", _drift(lines, symbol), style.grid([[made]]))


def _drift(lines: Sequence[TrendLine], symbol: str) -> str:
    """The slopes in a sentence; with more than one, each with the time that it holds for."""
    return f"{symbol} drifts by " + "; by ".join(_slope(line, alone=len(lines) == 1) for line in lines) + "."


def _slope(line: TrendLine, *, alone: bool) -> str:
    error = (
        ""
        if line.slope_error is None
        else f" (standard error {standard_error(line.slope_error, line.slope)})"
    )
    onset = "" if line.onset is None else f" from the onset of the vibration at {number(line.onset)} s on"
    span = "" if alone else f" between {number(line.segment_start)} s and {number(line.end)} s"
    return f"{number(line.slope)} rad/s{error}{onset}{span}, method {line.method}"


def _two_ends(angles: Angles, name: str, lines: Sequence[TrendLine]) -> Section:
    """The first periods, where the trend has not begun, and the last, where it has done its worst."""
    first, last = lines[0], lines[-1]
    width = min(_PERIODS_SHOWN * first.period, *(0.5 * (line.end - line.start) for line in (first, last)))
    begin = {word: s.within(first.start, first.start + width) for word, s in angles.items()}
    end = {word: s.within(last.end - width, last.end) for word, s in angles.items()}
    integrated = end.pop(INTEGRATED)
    away = float(np.mean(integrated.values[name] - last.smooth(integrated.time)))
    factor, unit = scale.angle([np.array([away])])
    beyond = f"last periods; the integrated angle lies {number(away / factor)} {unit} away"
    row = [
        _few_periods(begin, name, "first periods", (first.start, first.start + width)),
        _few_periods(end, name, beyond, (last.end - width, last.end)),
    ]
    return Section(
        f"{ANGLES[name]} at the two ends of the record",
        "The integrated angle begins on the vibration and leaves it; without its trend it stays there.",
        style.grid([row]),
    )


def _few_periods(angles: Angles, name: str, heading: str, ends: tuple[float, float]) -> figure:
    """An angle over a short time."""
    factor, unit = scale.angle([s.values[name] for s in angles.values()])
    made = style.panel(f"{ANGLES[name]} [{unit}]", style.span(*ends), height=240, x_label=TIME, ticks=5)
    style.heading(made, heading)
    samples: dict[str, list[Drawn]] = {}
    reference = angles.get(REFERENCE)
    if (
        reference is not None and len(reference.time) <= _DOTS_APART
    ):  # between them the line is no measurement
        samples[REFERENCE] = [style.dots(made, reference.time, reference.values[name] / factor, PALE)]
    curves = _draw(made, angles, name, factor)
    style.legend(made, [(word, [line, *samples.get(word, [])]) for word, line in curves.items()])
    return made
