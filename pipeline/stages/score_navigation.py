"""Score of the procedure `navigation`: errors by method and phase, settling times, and consistency.

Where truth was recorded the navigated state is held against it; a position or velocity by satellites gives
the residuals while they aid. The channel of a figure is the method with the phase (``filter.outage``), the
method alone (``filter``), or the method with the aid (``filter.position``). The transient at the beginning is
left out of the aided phase. Of a standard deviation that a method gives, the error over it is 1 in the root
mean square, and so is a normalised innovation in the mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic import Field

from pipeline import contracts
from pipeline.stages._navigation_outages import PHASES
from pipeline.stages._navigation_problem import columns
from pipeline.stages._navigation_residuals import innovation_figures, residual_figures
from pipeline.stages._navigation_streams import ATTITUDE, POSITION
from pipeline.stages._navigation_tables import AXES, NED
from pipeline.stages._navigation_truth import Errors, errors_of, truth_of
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand, Tables, finding, metric, rows

CONSUMES: tuple[str, ...] = ("navigation",)
MAY_CONSUME: tuple[str, ...] = (
    "innovations",
    "gnss_position",
    "gnss_velocity",
    "truth_position",
    "truth_velocity",
    "truth_attitude",
)
PRODUCES: tuple[str, ...] = ("navigation_errors", "findings", "metrics")
METRICS: tuple[str, ...] = (
    "horizontal_position_rms",
    "horizontal_position_max",
    "height_rms",
    "velocity_rms",
    "velocity_max",
    "tilt_rms",
    "yaw_rms",
    "position_error_ratio",
    "velocity_error_ratio",
    "attitude_error_ratio",
    "outage_drift",
    "reacquisition_time",
    "gyro_bias_settling_time_5",
    "gyro_bias_settling_time_1",
    "accelerometer_bias_settling_time_5",
    "accelerometer_bias_settling_time_1",
    "gyro_bias_error",
    "accelerometer_bias_error",
    "gyro_bias_error_ratio",
    "accelerometer_bias_error_ratio",
    "horizontal_residual_rms",
    "velocity_residual_rms",
    "normalised_innovations",
    "normalised_innovations_lower",
    "normalised_innovations_upper",
)

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]
Triple = tuple[float, float, float]

_BACK = 2.0
"""An error is back where it was when it is within so many root mean squares of the aided phase."""


class Settings(_Settings):
    """What is left out, and what is known of the biases."""

    settling_s: float = Field(
        180.0,
        ge=0,
        description="beginning of the aided phase that is left out of its figures, at most half of it, s",
    )
    gyro_bias_deg_s: Triple | None = Field(
        None, description="true biases of the gyros about body axes, where they are known, deg/s"
    )
    accelerometer_bias_m_s2: Triple | None = Field(
        None, description="true biases of the accelerometers along body axes, where they are known, m/s^2"
    )


@dataclass(frozen=True, slots=True)
class Scored:
    """One method's navigation and its errors.

    Attributes
    ----------
    method : str
    table : pyarrow.Table
        Its rows of ``navigation``.
    time : ndarray of int64, shape (n,)
        [ns].
    phase : ndarray of str, shape (n,)
    errors : Errors
    """

    method: str
    table: pa.Table
    time: Time
    phase: NDArray[np.str_]
    errors: Errors

    def within(self, phase: str, settling: float) -> Mask:
        """The instants that figures of a phase are from."""
        kept = self.phase == phase
        if phase == "aided" and kept.any():
            at = self.time[kept]
            wait = min(settling, (at[-1] - at[0]) / 2e9)
            kept &= self.time >= at[0] + round(wait * 1e9)
        return np.asarray(kept, dtype=np.bool_)

    def sigma(self, names: tuple[str, ...]) -> Float | None:
        """Standard deviations, shape (n, k); None where the method gives none."""
        if self.table.column(names[0]).null_count:
            return None
        return columns(self.table, names)


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Compute the errors and their figures.

    Parameters
    ----------
    tables : mapping
        ``navigation``; ``innovations``, the satellites' and the truth's tables where they are there.
    settings : Settings
    stand : Stand
        Not needed here.

    Returns
    -------
    dict
        The tables of `PRODUCES`; without truth ``navigation_errors`` has no row.
    """
    truth = truth_of(tables)
    figures: list[dict[str, Any]] = []
    scored = []
    for method in pc.unique(tables["navigation"]["method"]).to_pylist():
        own = tables["navigation"].filter(pc.equal(tables["navigation"]["method"], method))
        time = own.column("time").to_numpy()
        state = {
            "position": columns(own, POSITION),
            "velocity": columns(own, tuple(f"v_{a}" for a in NED)),
            "attitude": columns(own, ATTITUDE),
        }
        phase = np.array(own.column("phase").to_pylist())
        one = Scored(method, own, time, phase, errors_of(time, state, truth))
        if truth:
            scored.append(one)
            figures += _of_phases(one, settings.settling_s)
            figures += _of_outages(one, settings.settling_s)
        figures += _of_biases(one, settings)
        aided = one.within("aided", settings.settling_s) | (phase == "reacquired")
        figures += residual_figures(method, time, state, aided, tables)
    figures += innovation_figures(tables.get("innovations"), tables["navigation"], settings.settling_s)
    return {
        "navigation_errors": pa.concat_tables(
            [rows("navigation_errors", []), *(_error_rows(one) for one in scored)]
        ),
        "findings": rows("findings", list(_findings(tables, scored))),
        "metrics": rows("metrics", figures),
    }


def _findings(tables: Tables, scored: list[Scored]) -> Iterator[dict[str, Any]]:
    """Truth that is of no use."""
    if "truth_position" in tables and not any(np.isfinite(one.errors.position).any() for one in scored):
        detail = "no true position at a time of the navigation: errors are not known"
        yield finding("score_navigation", "truth_position", "no truth", "warning", detail)


def _figure(
    channel: str, name: str, value: float | None, unit: str, error: float | None = None
) -> dict[str, Any]:
    return metric("score_navigation", channel, name, value, unit, error)


def _rms(values: Float) -> float | None:
    """Root mean square of what is known, over all axes; None where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None


def _greatest(values: Float) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _of_phases(one: Scored, settling: float) -> Iterator[dict[str, Any]]:
    for phase in PHASES:
        kept = one.within(phase, settling)
        if not kept.any():
            continue
        channel = f"{one.method}.{phase}"
        position, velocity = one.errors.position[kept], one.errors.velocity[kept]
        horizontal = np.hypot(position[:, 0], position[:, 1])
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        yaw, tilt = np.rad2deg(one.errors.angles[kept, 0]), np.rad2deg(one.errors.angles[kept, 1:])
        yield _figure(channel, "horizontal_position_rms", _rms(horizontal), "m")
        yield _figure(channel, "horizontal_position_max", _greatest(horizontal), "m")
        yield _figure(channel, "height_rms", _rms(position[:, 2]), "m")
        yield _figure(channel, "velocity_rms", _rms(speed), "m/s")
        yield _figure(channel, "velocity_max", _greatest(speed), "m/s")
        # sqrt((roll^2 + pitch^2)/2) is the root mean square over both.
        yield _figure(channel, "tilt_rms", _rms(tilt), "deg")
        yield _figure(channel, "yaw_rms", _rms(yaw), "deg")
        for name, errors, letters in (
            ("position_error_ratio", position, ""),
            ("velocity_error_ratio", velocity, "v_"),
            ("attitude_error_ratio", one.errors.rotation[kept], "phi_"),
        ):
            sigma = one.sigma(tuple(f"sigma_{letters}{a}" for a in NED))
            if sigma is not None:
                yield _figure(channel, name, _rms(_over(errors, sigma[kept])), "1")


def _over(errors: Float, sigma: Float) -> Float:
    """Errors over their standard deviations; NaN where that is zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sigma > 0, errors / sigma, np.nan)


def _of_outages(one: Scored, settling: float) -> Iterator[dict[str, Any]]:
    """How far the outages let the position drift, and how long it takes to come back after the last."""
    horizontal = np.hypot(one.errors.position[:, 0], one.errors.position[:, 1])
    lost = np.flatnonzero(one.phase == "outage")
    if not lost.size:
        return
    ends = lost[np.append(np.diff(lost) > 1, True)]
    yield _figure(one.method, "outage_drift", _greatest(horizontal[ends]), "m")
    usual = _rms(horizontal[one.within("aided", settling)])
    again = np.flatnonzero(one.phase == "reacquired")
    again = again[again > lost[-1]]
    if usual is None or not again.size:
        return
    back = again[horizontal[again] <= _BACK * usual]
    seconds = (one.time[back[0]] - one.time[lost[-1]]) / 1e9 if back.size else None
    yield _figure(one.method, "reacquisition_time", seconds, "s")


def _of_biases(one: Scored, settings: Settings) -> Iterator[dict[str, Any]]:
    """Settling of the biases over the first aided phase, and their errors at the end."""
    in_degrees = settings.gyro_bias_deg_s
    given = {
        "gyro_bias": None if in_degrees is None else np.deg2rad(np.array(in_degrees)),
        "accelerometer_bias": None
        if settings.accelerometer_bias_m_s2 is None
        else np.array(settings.accelerometer_bias_m_s2),
    }
    for name, true in given.items():
        estimate = columns(one.table, tuple(f"{name}_{a}" for a in AXES))
        if not estimate.any():
            continue  # the method estimates none
        aided = np.flatnonzero(one.phase == "aided")
        if aided.size:
            final = estimate[aided[-max(1, aided.size // 10) :]].mean(axis=0) if true is None else true
            for percent in (5, 1):
                seconds = _settled(one.time[aided], estimate[aided], final, percent / 100)
                yield _figure(one.method, f"{name}_settling_time_{percent}", seconds, "s")
        if true is not None:
            error = estimate[-1] - true
            unit, factor = ("deg/s", 180 / np.pi) if name == "gyro_bias" else ("m/s^2", 1.0)
            sigma = one.sigma(tuple(f"sigma_{name}_{a}" for a in AXES))
            size = float(np.linalg.norm(error)) * factor
            spread = None if sigma is None else float(np.linalg.norm(sigma[-1])) * factor
            yield _figure(one.method, f"{name}_error", size, unit, spread)
            if sigma is not None:
                yield _figure(one.method, f"{name}_error_ratio", _rms(_over(error, sigma[-1])), "1")


def _settled(time: Time, estimate: Float, final: Float, part: float) -> float | None:
    """Seconds until an estimate stays within a part of its final value; None where it never does."""
    far = np.flatnonzero(np.linalg.norm(estimate - final, axis=1) > part * float(np.linalg.norm(final)))
    if not far.size:
        return 0.0
    return None if far[-1] == len(time) - 1 else float((time[far[-1] + 1] - time[0]) / 1e9)


def _error_rows(one: Scored) -> pa.Table:
    errors = one.errors
    named: dict[str, Any] = {}
    for names, values in (
        ([f"position_{a}" for a in NED], errors.position),
        ([f"velocity_{a}" for a in NED], errors.velocity),
        ([f"phi_{a}" for a in NED], errors.rotation),
        (ATTITUDE, errors.angles),
    ):
        named |= dict(zip(names, values.T, strict=True))
    copied = ("time", "method", "phase")
    sigmas = [c.name for c in contracts.contract("navigation_errors").columns if c.name.startswith("sigma_")]
    return contracts.table(
        "navigation_errors", named | {name: one.table.column(name) for name in (*copied, *sigmas)}
    )
