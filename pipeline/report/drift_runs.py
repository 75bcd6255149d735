"""The runs and methods of a drift recording as the pictures want them: clocks, names, the fit of a run."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from bokeh.models import Range1d
from numpy.typing import NDArray

from pipeline.report import style
from pipeline.report.base import Clock, Tables, column, times

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

METHODS = {
    "gauss_newton": "Gauss–Newton",
    "cumulative": "cumulative",
    "filter": "filter",
    "smoother": "smoother",
    "segments": "segments",
    "transient": "transient",
    "spiral": "spiral",
    "spiral_six": "spiral, all six",
    "spiral_mc_known": "spiral, mc known",
    "spiral_m1_known": "spiral, m11 m21 known",
    "spiral_m2_known": "spiral, m12 m22 known",
}
"""Methods as one reads them; the first that a recording has is its primary one, where none is held out."""

HOURS = "time from the run's start [h]"
EARTH_RATE = 15.041067
"""Drift of an m of 1 [deg/h]; the models have it too, but the report stands on storage alone."""
DRIFT = ("m11", "m12", "m21", "m22", "mc1", "mc2")

SURE = ("determined", "given")
"""States of a parameter that need no further run."""
IDENTIFIED = ("m", "theta", "epsilon")
"""How the names of the parameters begin that the record is asked for. Delta chi is told by epsilon; the
spiral and the decay have figures of their own."""

_GREEK = {
    "theta": "θ",
    "epsilon": "ε",
    "alpha_": "α",
    "lambda": "λ",
    "nu": "ν",
    "psi": "ψ",
}
_WORD = re.compile(r"\b(theta|epsilon|alpha_|lambda|nu|psi)(?=[0-9c]|\b)")
_GAP = 3.0  # grid intervals; a longer pause interrupts a curve


@dataclass(frozen=True, slots=True)
class Run:
    """One run: its number, its heading, its own clock, and the time axis that its panels share [h]."""

    number: int
    title: str
    clock: Clock
    x_range: Range1d

    def hours(self, time: NDArray[np.int64]) -> Floats:
        """Hours from the run's start, of times in nanoseconds."""
        return self.clock.seconds(time) / 3600

    @property
    def duration(self) -> float:
        """Length of the run [h]."""
        return self.clock.duration / 3600


@dataclass(frozen=True, slots=True)
class Fit:
    """What one method makes of one run, by time.

    Attributes
    ----------
    hours : ndarray, shape (n,)
        Rising.
    predicted, residual : ndarray, shape (n, 2)
        Angles by the model, and measured less predicted [rad].
    outlier, bridged : ndarray of bool, shape (n,)
        Samples that were marked, and those that are no observation.
    gap : float
        A longer pause interrupts a curve [h].
    """

    hours: Floats
    predicted: Floats
    residual: Floats
    outlier: Mask
    bridged: Mask
    gap: float


def filled(tables: Tables, name: str) -> pa.Table | None:
    """A table that has rows, else None."""
    table = tables.get(name)
    return table if table is not None and table.num_rows else None


def runs(tables: Tables) -> list[Run]:
    """The runs that have times, in their order; one of a single sample is none."""
    timed = filled(tables, "trajectory") or filled(tables, "residuals")
    if timed is None:
        return []
    number, time = timed.column("run").to_numpy(), times(timed)
    found = []
    for run in np.unique(number).tolist():
        clock = Clock.of(time[number == run])
        if clock.duration > 0.0:
            x_range = style.span(0.0, clock.duration / 3600)
            found.append(Run(run, _title(tables, run), clock, x_range))
    return found


def _title(tables: Tables, run: int) -> str:
    known = filled(tables, "runs")
    rows = [] if known is None else [row for row in known.to_pylist() if row["run"] == run]
    words = [word for row in rows for word in (row["name"], row["scheme"]) if word]
    return f"run {run}: {', '.join(dict.fromkeys(words))}" if words else f"run {run}"


def primary(tables: Tables) -> str | None:
    """The method that the pictures are of: the one that was held out, else the first in `METHODS`."""
    for name in ("residuals", "drift_parameters"):
        table = filled(tables, name)
        if table is None:
            continue
        if name == "residuals":
            held_out = table.filter(pc.equal(table["state"], "held out"))
            table = held_out if held_out.num_rows else table
        there = set(table["method"].unique().to_pylist())
        return next((method for method in METHODS if method in there), None)
    return None


def fit(tables: Tables, method: str | None, run: Run, *, held_out: bool = False) -> Fit | None:
    """What a method makes of a run: by its fit, or of the part held out; None where there is nothing.

    The rows of the held-out part come after those of the fit and repeat its marked samples.
    """
    table = filled(tables, "residuals")
    if table is None or method is None:
        return None
    mine = pc.and_(pc.equal(table["method"], method), pc.equal(table["run"], run.number))
    apart = pc.equal(table["state"], "held out")
    table = table.filter(pc.and_(mine, apart if held_out else pc.invert(apart)))
    time, first = np.unique(times(table), return_index=True)
    if len(time) < 2:
        return None
    hours = run.hours(time)
    outlier, bridged = (
        pc.equal(table["state"], state).to_numpy(zero_copy_only=False)[first]
        for state in ("outlier", "bridged")
    )
    return Fit(
        hours,
        _angles(table, "predicted")[first],
        _angles(table, "residual")[first],
        outlier,
        bridged,
        _GAP * float(np.median(np.diff(hours))),
    )


def _angles(table: pa.Table, name: str) -> Floats:
    """Both angles, shape (n, 2)."""
    return np.column_stack([column(table, f"{name}{axis}") for axis in (1, 2)])


def symbol(text: str, run: int | None = None) -> str:
    """Parameters as one writes them: ``mc1 - theta1`` is ``mc1 − θ1``, epsilon1 of run 2 ``ε1 of run 2``."""
    written = _WORD.sub(lambda found: _GREEK[found[1]], text).replace(" - ", " − ").replace("_0", "(0)")
    return written if run is None else f"{written} of run {run}"
