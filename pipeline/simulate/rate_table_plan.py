"""What the test plan of a simulated rate table says of the stand, the runs and the stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.models.multi_position import SIX_POSITIONS
from pipeline.simulate.plan import Value
from pipeline.simulate.rate_table_motion import nominal_turns
from pipeline.simulate.rate_table_settings import RateTableSettings
from pipeline.simulate.static_settings import AXES

_STEADY = 0.5
"""Part of a dwell that a step must last: the rest is for settling and for finding its ends."""


def said_of_stand(settings: RateTableSettings) -> dict[str, Value]:
    """Keys of ``[stand]``: where it is, and how the table's axis lies."""
    if settings.latitude is None:
        return {}
    stand: dict[str, Value] = {"latitude_deg": float(np.rad2deg(settings.latitude))}
    if settings.method == "rates":
        stand["table_heading_deg"] = float(np.rad2deg(settings.heading))
        stand["table_tilt_deg"] = float(np.rad2deg(settings.tilt))
    return stand


def said_of_runs(
    settings: RateTableSettings, edges: Sequence[tuple[int, int]], further: Sequence[str]
) -> list[dict[str, Value]]:
    """``[[runs]]``: the mounting of each, and its recording or its stretch of the one.

    Parameters
    ----------
    settings : RateTableSettings
    edges : sequence of (int, int)
        Unix time of the first and the last sample of each run [ns].
    further : sequence of str
        Recordings of the runs after the first, where each has its own.
    """
    if settings.method != "rates":
        return []
    runs = []
    for number, mounting in enumerate(settings.mountings):
        said: dict[str, Value] = {
            "name": mounting.name or mounting.axis,
            "axis": mounting.axis,
            "across": AXES[int(np.argmax(mounting.to_case[:, 0]))],
        }
        if further:
            if number > 0:
                said["recording"] = further[number - 1]
        else:
            # a run ends, and the next begins, in the middle of the pause between them
            if number > 0:
                said["start"] = (edges[number - 1][1] + edges[number][0] - 2 * edges[0][0]) / 2e9
            if number < len(edges) - 1:
                said["stop"] = (edges[number][1] + edges[number + 1][0] - 2 * edges[0][0]) / 2e9
        runs.append(said)
    return runs


def rate_table_stages(
    settings: RateTableSettings, given: Mapping[str, Mapping[str, Value]]
) -> dict[str, Mapping[str, Value]]:
    """Settings of the stages that the record asks for, with those given."""
    stages: dict[str, Mapping[str, Value]] = {}
    calibrate = {"methods": [settings.method], **_terms(settings), **_errors(settings)}
    if settings.method == "rates":
        stages["steps"] = {"shortest_s": _STEADY * settings.profile.dwell}
    elif settings.method == "turns":
        calibrate |= {"turns": _turns(settings), "rests": _rests(settings)}
    else:
        calibrate["positions"] = _positions(settings)
    stages["calibrate"] = calibrate
    for stage, keys in given.items():
        stages[stage] = {**stages.get(stage, {}), **keys}
    return stages


def _terms(settings: RateTableSettings) -> dict[str, Value]:
    """Which terms the gyros have, beside bias and scale factor."""
    gyros = settings.gyros.values()
    terms: dict[str, Value] = {}
    orders = sorted({order for gyro in gyros for order in gyro.nonlinearity})
    if orders:
        terms["nonlinearity"] = orders
    if any(gyro.bias_temperature_sensitivity for gyro in gyros):
        terms["bias_temperature"] = True
    if any(gyro.scale_factor_temperature_sensitivity for gyro in gyros):
        terms["scale_factor_temperature"] = True
    if terms.keys() - {"nonlinearity"}:
        terms["reference_temperature"] = settings.reference_temperature
    return terms


def _errors(settings: RateTableSettings) -> dict[str, Value]:
    """What is not quite known of orientations, turns and biases."""
    turns = settings.method == "turns"
    sizes = {
        "turn_axis_error_deg" if turns else "orientation_error_deg": settings.orientation_error,
        "turn_angle_error_deg": settings.angle_error if turns else 0.0,
        "bias_error_deg_h": 3600.0 * settings.bias_error,
    }
    return {key: float(np.rad2deg(size)) for key, size in sizes.items() if size}


def _turns(settings: RateTableSettings) -> list[dict[str, str | int | float]]:
    """The turns, times in s from the record's start."""
    hand = settings.hand
    axes, angles = nominal_turns(hand)
    begin = hand.rest + (hand.rest + hand.moving) * np.arange(len(angles))
    return [
        {
            "axis": AXES[int(np.argmax(axis))],
            "angle_deg": float(np.rad2deg(angle)),
            "start": start,
            "stop": start + hand.moving,
        }
        for axis, angle, start in zip(axes, angles, begin.tolist(), strict=True)
    ]


def _rests(settings: RateTableSettings) -> list[dict[str, str | int | float]]:
    """Rest before, between and after the turns."""
    hand = settings.hand
    begin = (hand.rest + hand.moving) * np.arange(3 * len(hand.turns) + 1)
    return [{"start": start, "stop": start + hand.rest} for start in begin.tolist()]


def _positions(settings: RateTableSettings) -> list[dict[str, str | int | float]]:
    """The six positions, times in s from the record's start."""
    period = settings.hand.rest + settings.hand.moving
    return [
        {
            "up": _case_axis(up),
            "north": _case_axis(north),
            "start": k * period,
            "stop": k * period + settings.hand.rest,
        }
        for k, (up, north) in enumerate(SIX_POSITIONS)
    ]


def _case_axis(number: int) -> str:
    return f"{'-' if number < 0 else ''}{AXES[abs(number) - 1]}"
