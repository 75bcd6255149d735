"""What is to be said of a calibration, beside its figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.models.earth import DEGREES_PER_HOUR, RATE
from pipeline.models.rate_table import SingleAxis
from pipeline.models.rate_table_triad import USEFUL, Triad
from pipeline.numerics.sampling import MAD_TO_SIGMA
from pipeline.stages._calibration_observations import Stretches, table_axis
from pipeline.stages._calibration_settings import Settings
from pipeline.stages._calibration_tables import lettered
from pipeline.stages._rate_table_record import AXES
from pipeline.stages.base import Stand, counted, finding

Rows = Iterator[dict[str, Any]]

_OUTLYING = 6.0
"""Robust standard deviations of the residuals, and of its own, from which on a residual is marked."""
_FEWEST = 8
"""Steps of which one can be told to lie apart from the others."""


def about_plan(settings: Settings, stand: Stand, *, triad: bool) -> Rows:
    """What the calibration leaves in its figures because the plan does not say more."""
    if "rates" in settings.methods and table_axis(stand) is None:
        lacking = [key for key in ("latitude_deg", "table_tilt_deg") if getattr(stand, key) is None]
        yield _said(
            "Earth's rate",
            f"up to {DEGREES_PER_HOUR:.2f} deg/h of it is left in the bias: add {' and '.join(lacking)} to "
            "[stand]",
        )
    if "turns" in settings.methods:
        text = f"up to {DEGREES_PER_HOUR:.2f} deg/h of it is left in the turns and rests"
        if len(settings.methods) > 1:
            text += ": counted as an error of their biases against those of the rest"
        yield _said("Earth's rate", text)
    ignored = [name for name in ("orientation_error_deg", "bias_error_deg_h") if getattr(settings, name)]
    if ignored and not triad:
        text = (
            f"{' and '.join(ignored)} of [calibrate]: counted in a triad only, not in these standard errors"
        )
        yield finding("calibrate", "gyro", "not counted", "warning", text)
    left = [name for name in settings.terms.names if name not in settings.triad_terms.names]
    if "rates" not in settings.methods and "scale_factor_asymmetry" in left:
        left.remove("scale_factor_asymmetry")  # which nobody has to ask for
    if triad and left:
        methods = " and ".join(method for method in settings.methods if method != "rates")
        yield _said("terms", f"the triad is without {', '.join(left)}, which {methods} do not tell")


def about_single_axis(fit: SingleAxis, channel: str, stretches: Stretches) -> Rows:
    """Whether any step is left to check it by, scatter of the steps, and steps far from the model."""
    yield from _unchecked(channel, len(fit.residual), len(fit.names), "step")
    if fit.scatter:
        yield _scatter(channel, fit.scatter)
    # without the scatter, which such a step makes
    own = np.sqrt(np.maximum(fit.residual_error**2 - fit.scatter**2, 0.0))
    usual = np.maximum(own, MAD_TO_SIGMA * np.median(np.abs(fit.residual)))
    apart = (np.abs(fit.residual) > _OUTLYING * usual) & (len(stretches) >= _FEWEST)
    for k in np.flatnonzero(apart).tolist():
        text = (
            f"{channel} in the step at {np.degrees(fit.input_rate[k]):.6g} deg/s lies "
            f"{fit.residual_ppm[k]:.3g} ppm of full scale from the model, {fit.residual[k] / usual[k]:+.3g} "
            "times what is usual"
        )
        yield finding(
            "calibrate", "rate_steps", "outlying step", "warning", text, channel=channel,
            start=int(stretches.start[k]), end=int(stretches.stop[k]),
        )  # fmt: skip


def about_triad(fit: Triad) -> Rows:
    """What is not determined, what is in combination, and the scatter of the observations."""
    yield from _unchecked("each gyro of the triad", len(fit.residual), len(fit.names) // 3, "observation")
    told = fit.observability
    unsure = {name for name, state in zip(told.names, told.states, strict=True) if state != "determined"}
    open_ = [
        lettered(name)
        for name, error in zip(fit.names, fit.standard_error, strict=True)
        if not np.isfinite(error)
    ]
    weak = [lettered(n) for n in fit.names if n in unsure and lettered(n) not in open_]
    if open_:
        text = f"the observations do not determine {', '.join(open_)}"
        yield finding("calibrate", "gyro", "not determined", "warning", text, count=len(open_))
    if weak:
        text = (
            f"the observations determine {', '.join(weak)} no better than to {USEFUL:.0%} of scale factor or "
            "full scale"
        )
        yield finding("calibrate", "gyro", "weakly determined", "warning", text, count=len(weak))
    known = [c for c in told.combinations if len(set(c.terms) & set(fit.names)) > 1]
    for combination in known:
        words = combination.read(lambda name: lettered(name) if name in fit.names else name)
        yield _said("combination", f"determined together: {words}")
    for channel, scatter in zip(AXES, fit.scatter.tolist(), strict=True):
        if scatter:
            yield _scatter(channel, scatter)


def _unchecked(of: str, count: int, unknowns: int, noun: str) -> Rows:
    """As many observations as unknowns fit any model."""
    if count <= unknowns:
        text = (
            f"{of}: {counted(count, noun)} for {unknowns} unknowns: no {noun} is left to check the model by, "
            "and its residuals say nothing"
        )
        yield finding("calibrate", "gyro", "not checked", "warning", text)


def without_terms(channel: str, why: str) -> dict[str, Any]:
    """A gyro of a triad that cannot be calibrated by its own axis as the plan wants."""
    text = f"{channel} has no calibration by its own axis: {why}"
    return finding("calibrate", "rate_steps", "single axis", "warning", text, channel=channel)


def without_cross_axis(channel: str, along: str, why: str) -> dict[str, Any]:
    """A gyro that does not tell what it sees of the rate about another axis."""
    text = f"{channel} does not tell what it sees of the rate about {along}: {why}"
    return finding("calibrate", "rate_steps", "cross axis", "info", text, channel=channel)


def _scatter(channel: str, scatter: float) -> dict[str, Any]:
    size = scatter / RATE * DEGREES_PER_HOUR
    text = (
        f"{channel} scatters between observations by {size:.3g} deg/h beyond its noise in them: counted in "
        "the standard errors"
    )
    return finding("calibrate", "rate_steps", "scatter", "info", text, channel=channel)


def _said(kind: str, detail: str) -> dict[str, Any]:
    return finding("calibrate", "gyro", kind, "info", detail)
