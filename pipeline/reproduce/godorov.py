"""The figures of Godorov & Lutmanov (2016), by the pipeline's own stages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.coning import ConingMotion, Motion, SmoothConing
from pipeline.numerics.interpolation import MethodName
from pipeline.reproduce.rows import Expected, Row, at_most, near
from pipeline.stages import detrend, integrate, interpolate, score
from pipeline.stages.base import ANGLES, StageError, Stand

Float = NDArray[np.float64]
Time = NDArray[np.int64]

SOURCE = "Godorov & Lutmanov, Problems of Mechanics and Control 48 (2016)"

_RATE = 400
_OVERSAMPLING = 50
_CONING = ConingMotion(np.deg2rad(1.0), 100.0)
_SECTION_5 = SmoothConing(_CONING, onset=0.0, slope=-0.05, offset=0.5)


@dataclass(frozen=True, slots=True)
class _Figure:
    """A figure of the stages: its name and channel there, and what is expected of it."""

    quantity: str
    metric: str
    channel: str
    expected: Expected

    def beside(self, item: str, ours: float) -> Row:
        """The row of the figure."""
        return self.expected.beside(SOURCE, item, self.quantity, ours)


_BEFORE, _AFTER = "relative_rms_error", "relative_rms_error_corrected"

_CUBIC = (
    _Figure("I_psi", _BEFORE, "psi", near(0.2619, 0.01)),
    _Figure("I_theta", _BEFORE, "theta", near(0.07429, 0.01)),
    _Figure("I_gamma", _BEFORE, "gamma", near(143.6247, 1e-4, printed=143.637)),
    _Figure("a, rad/s", "trend_a", "gamma", near(-0.013467, 0.02, printed=-0.01347)),
    _Figure("b, rad", "trend_b", "gamma", near(4.69e-5, 0.02, printed=0.00005)),
    _Figure("I_gamma corrected", _AFTER, "gamma", near(0.12387, 0.002, printed=0.123842)),
)
_HARMONIC = (
    _Figure("I_psi, at most", _BEFORE, "psi", at_most(1e-6)),
    _Figure("I_theta, at most", _BEFORE, "theta", at_most(2e-6)),
    _Figure("I_gamma, at most", _BEFORE, "gamma", at_most(6e-6)),
)
# Before t* = 0 nothing is known of b but that it is small; which sample falls on t* decides its sign.
_ONSET = (
    _Figure("I_gamma", _BEFORE, "gamma", near(0.0110, 0.01, printed=0.0109768)),
    _Figure("a, rad/s", "trend_a", "gamma", near(-0.0135, 0.0001 / 0.0135)),
    _Figure("|b|, rad, at most", "trend_b", "gamma", at_most(1e-4)),
    _Figure("I_gamma corrected, at most", _AFTER, "gamma", at_most(3e-4, printed=0.00474172)),
)

_INTERPOLANTS: tuple[tuple[str, MethodName, int | None, float, float], ...] = (
    ("linear", "linear", None, 354.45, 0.301),
    ("spline of degree 2", "spline", 2, 55.30, 0.412),
    ("spline of degree 3", "spline", 3, 29.19, 0.0562),
    ("spline of degree 5", "spline", 5, 2.463, 0.514),
    ("spline of degree 7", "spline", 7, 1.100, 0.303),
    ("PCHIP", "pchip", None, 122.8, 0.994),
    ("Akima", "akima", None, 122.8, 0.715),
    ("local polynomial of degree 2", "local_polynomial", 2, 144.37, 0.900),
    ("local polynomial of degree 4", "local_polynomial", 4, 62.4, 0.469),
    ("local polynomial of degree 5", "local_polynomial", 5, 60.9, 0.547),
)
"""Interpolant, its method and degree, I_γ before and after the removal of the trend."""


def godorov() -> list[Row]:
    """Every figure of the coning experiments of Godorov & Lutmanov (2016), and of the methods beside theirs.

    Cone 1°, 100 Hz, rates at 400 Hz, reference and attitude at 20 kHz; the motion is built in memory and
    goes through interpolate, integrate, detrend (by extremes) and score.

    Returns
    -------
    list of Row
    """
    return [*_section_3(), *_other_interpolants(), *_harmonic(), *_section_5()]


def _section_3() -> Iterator[Row]:
    figures = _run(_CONING, 0.0, _local_cubic(), "none")
    for figure in _CUBIC:
        yield figure.beside("sections 3 and 4, local cubic", figures[figure.metric, figure.channel])


def _other_interpolants() -> Iterator[Row]:
    for name, method, degree, before, after in _INTERPOLANTS:
        settings = interpolate.Settings(method=method, degree=degree, oversampling=_OVERSAMPLING)
        figures = _run(_CONING, 0.0, settings, "none")
        for quantity, metric, oracle in (("I_gamma", _BEFORE, before), ("I_gamma corrected", _AFTER, after)):
            yield near(oracle, 0.01).beside(SOURCE, name, quantity, figures[metric, "gamma"])


def _harmonic() -> Iterator[Row]:
    """The harmonic model, and its refusal of harmonics that the samples cannot tell."""
    figures = _run(_CONING, 0.0, _harmonic_settings(1), "none")
    for figure in _HARMONIC:
        yield figure.beside("harmonic model", figures[figure.metric, figure.channel])
    for harmonics in (2, 3):
        refused = 0.0
        try:
            interpolate.run({"gyro": _gyro(_CONING, 0.0)}, _harmonic_settings(harmonics), Stand())
        except StageError:
            refused = 1.0
        quantity = f"harmonic {harmonics} refused (1: yes)"
        yield near(1.0, 0.0).beside(SOURCE, "harmonic model", quantity, refused)


def _section_5() -> Iterator[Row]:
    figures = _run(_SECTION_5, -1.0, _local_cubic(), 1.0)
    for figure in _ONSET:
        ours = figures[figure.metric, figure.channel]
        yield figure.beside("section 5, local cubic", abs(ours) if figure.metric == "trend_b" else ours)


def _local_cubic() -> interpolate.Settings:
    return interpolate.Settings(method="local_polynomial", degree=3, oversampling=_OVERSAMPLING)


def _harmonic_settings(harmonics: int) -> interpolate.Settings:
    return interpolate.Settings(method="harmonic", harmonics=harmonics, oversampling=_OVERSAMPLING)


def _run(
    motion: Motion, start: float, settings: interpolate.Settings, onset: Literal["none"] | float
) -> dict[tuple[str, str], float]:
    """The figures of a motion on [start, 1] s, by name and channel."""
    stand = Stand()
    tables = {"gyro": _gyro(motion, start), "reference": _reference(motion, start)}
    tables |= interpolate.run(tables, settings, stand)
    tables |= integrate.run(tables, integrate.Settings(), stand)
    tables |= detrend.run(tables, detrend.Settings(method="extremes", onset=onset), stand)
    metrics = score.run(tables, score.Settings(), stand)["metrics"]
    return {(row["name"], row["channel"]): row["value"] for row in metrics.to_pylist()}


def _gyro(motion: Motion, start: float) -> pa.Table:
    """The body rates at 400 Hz."""
    time, t = _clock(start, _RATE)
    return _table("gyro", time, ("p", "q", "r"), motion.rates(t))


def _reference(motion: Motion, start: float) -> pa.Table:
    """The angles on the grid of the attitude."""
    time, t = _clock(start, _RATE * _OVERSAMPLING)
    return _table("reference", time, ANGLES, motion.angles(t))


def _clock(start: float, rate: int) -> tuple[Time, Float]:
    """Nanoseconds from the start to 1 s, and the same in the motion's seconds."""
    n = round((1.0 - start) * rate) + 1
    time = np.arange(n, dtype=np.int64) * (1_000_000_000 // rate)
    return time, np.asarray((time + round(start * 1e9)) * 1e-9, dtype=np.float64)


def _table(name: str, time: Time, channels: tuple[str, ...], values: Float) -> pa.Table:
    """A stream without clocks of a recorder; values (n, 3)."""
    absent = dict.fromkeys(contracts.contract(name).schema.names, pa.nulls(len(time)))
    return contracts.table(name, {**absent, "time": time, **dict(zip(channels, values.T, strict=True))})
