"""Whether a gyro on a rate table follows it, and in the units that the test plan states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode
from pipeline.models.rate_table_steps import Motion, Steps
from pipeline.stages._rate_table_record import AXES, TableRun
from pipeline.stages.base import StageError, counted, finding

Float = NDArray[np.float64]

_STILL = 0.01
"""Rotation [rad] within which a table has not turned: more than an encoder's noise, or that of a rate over an
hour; less than any step of a calibration."""
_JUMP = 8.0
"""Times the changes beside it, by which an angle jumps: at more than 40 deg a sample it is not told."""
_ALIKE = 0.01
"""Part by which the jumps of an angle that begins again differ: the changes beside them are added."""
_NEAR = 0.1
"""Part by which a scale factor may miss a ratio of units to be taken for it: more than any gyro's error."""
_FOLLOWS = 5e-3
"""Scale factor below which a gyro does not follow the table: less than deg/s read as rad/s make of 1."""
_SURE = 3.0
"""Standard errors."""
_ACROSS = 0.2
"""Part of another channel's scale factor below which it is that channel that lies along the table's axis."""
_USUAL = 2.0
"""Factor by which a scale factor may miss 1 without a word."""

_DEGREES = "degrees where radians are stated"
_RADIANS = "radians where degrees are stated"
_RATE_RATIOS: Mapping[float, str] = MappingProxyType(
    {
        6.0: "the table's rate looks like rpm where deg/s is stated",
        np.pi / 30: "the table's rate looks like rpm where rad/s is stated",
        1 / 6: "the table's rate looks like deg/s where rpm is stated",
        30 / np.pi: "the table's rate looks like rad/s where rpm is stated",
        3600.0: "the gyro's values look like deg/h where deg/s is stated, or the table's the other way round",
        1
        / 3600: "the table's values look like deg/h where deg/s is stated, or the gyro's the other way round",
    }
)
_ANGLE_RATIOS: Mapping[float, str] = MappingProxyType(
    {
        2 * np.pi: "the table's angle looks like turns where rad is stated",
        1 / (2 * np.pi): "the table's angle looks like rad where turns are stated",
        360.0: "the table's angle looks like turns where deg is stated",
        1 / 360: "the table's angle looks like deg where turns are stated",
    }
)
_RATIOS: Mapping[float, str] = MappingProxyType(
    {
        180 / np.pi: f"the gyro's values look like {_DEGREES}, or the table's like {_RADIANS}",
        np.pi / 180: f"the table's values look like {_DEGREES}, or the gyro's like {_RADIANS}",
    }
)


def refuse_still(run: TableRun, motion: Motion) -> None:
    """Refuse a table that never turns.

    Raises
    ------
    StageError
    """
    turned = float(np.ptp(motion.angle))
    if turned < _STILL:
        raise StageError(
            f"{run.where}stream 'turntable'",
            expected="a table that turns",
            found=f"one that stays within {np.degrees(turned):.3g} deg throughout",
            remedy="check which channel is the table's, and its unit and scale",
        )


def refuse_jumps(run: TableRun, motion: Motion) -> None:
    """Refuse an angle that begins again, where the plan does not say after how much.

    Raises
    ------
    StageError
    """
    change = np.diff(motion.angle)
    before, here, after = change[:-2], change[1:-1], change[2:]
    back = (here * before < 0) & (here * after < 0)
    jumps = back & (np.abs(here) > np.maximum(_STILL, _JUMP * np.maximum(np.abs(before), np.abs(after))))
    sizes = np.abs(here[jumps]) + (np.abs(before[jumps]) + np.abs(after[jumps])) / 2
    if not len(sizes):
        return
    size = float(np.median(sizes))
    turn = abs(size / (2 * np.pi) - 1) < _ALIKE
    if turn or (len(sizes) > 1 and np.ptp(sizes) < _ALIKE * size):
        jump = "a turn" if turn else f"{np.degrees(size):.6g} deg"
        raise StageError(
            f"{run.where}stream 'turntable'",
            expected="an angle that goes on, or wraps_at of its channel",
            found=f"one that jumps back by {jump}, {counted(len(sizes), 'time')}",
            remedy=f"set wraps_at to what {jump} is in raw values, before scale and unit",
            exit_code=ExitCode.USAGE,
        )


def refuse_only_rest(run: TableRun, steps: Steps, motion: Motion) -> None:
    """Refuse steps in none of which the table turns, though it does between them.

    Raises
    ------
    StageError
    """
    if np.any(np.abs(steps.rate) * steps.duration > _STILL):
        return
    speed = np.abs(np.diff(motion.angle) / np.diff(motion.time))
    raise StageError(
        f"{run.where}stream 'turntable'",
        expected="a step in which the table turns",
        found=f"{counted(len(steps), 'step')} at rest only, beside rates up to "
        f"{np.degrees(float(speed.max())):.3g} deg/s",
        remedy="lower steps.shortest_s, or raise steps.tolerance_deg_s",
    )


def followed(run: TableRun, steps: Steps) -> Iterator[dict[str, Any]]:
    """Findings about the scale factor of the gyro along the table's axis.

    Raises
    ------
    StageError
        If it does not follow the table (exit code 1), or only in another unit (exit code 2).
    """
    assert run.axis is not None, "only runs on the table have steps"
    along = int(np.argmax(np.abs(run.axis)))
    if AXES[along] not in run.channels:
        return
    values = run.gyro.values[:, run.channels.index(AXES[along])]
    if not np.ptp(values):
        raise StageError(
            f"{run.where}gyro {AXES[along]} against the table",
            expected="a gyro that follows the table",
            found=f"one that gives {np.degrees(values[0]):.6g} deg/s throughout",
            remedy="check that it was working, and its channel",
        )
    rate = run.axis[along] * steps.rate
    told = {
        name: _gain(rate, steps.gyro[:, k], steps.standard_error[:, k]) for k, name in enumerate(run.channels)
    }
    name = AXES[along]
    gain, error = told[name]
    where = f"{run.where}gyro {name} against the table"
    others = {c: g for c, (g, e) in told.items() if abs(g) > max(_SURE * e, 1 / _USUAL)}
    best = max(others, key=lambda c: abs(others[c]), default=None)
    # A gyro across the table's axis sees some of the rate, which is no question of its unit.
    crossed = best is not None and abs(gain) < _ACROSS * abs(others[best])
    words = None if crossed else _unit_words(abs(gain), run.by_angle)
    if words is not None and abs(gain) > _SURE * error:
        raise StageError(
            where,
            expected="a scale factor near 1, by the units of the test plan",
            found=f"{gain:.4g}: {words}",
            remedy="correct the unit in the test plan",
            exit_code=ExitCode.USAGE,
        )
    if crossed or not abs(gain) > max(_SURE * error, _FOLLOWS):
        beside = f", and {others[best]:.3g} of {best}" if best else ""
        raise StageError(
            where,
            expected="a gyro that follows the table",
            found=f"a scale factor of {gain:.3g} with a standard error of {error:.2g}{beside}",
            remedy="correct axis of the run in the test plan"
            if best
            else "check that the gyro was on the table, its channel, and the clocks",
        )
    if gain < 0:
        text = f"{name} turns against the table: check axis of the run, or the sign of the channel"
        yield finding("steps", "gyro", "negative scale factor", "warning", run.about + text, channel=name)
    elif not 1 / _USUAL < gain < _USUAL:
        text = f"a scale factor of {gain:.4g}: check unit and scale of the channel"
        yield finding("steps", "gyro", "implausible unit", "warning", run.about + text, channel=name)


def _gain(rate: Float, output: Float, error: Float) -> tuple[float, float]:
    """Slope of the output over the rate, and its standard error; through 0 where the rate is always one."""
    x = rate - rate.mean()
    if not float(x @ x) > 1e-6 * float(rate @ rate):  # steps of one rate
        x = rate
    power = float(x @ x)
    if power == 0:
        return 0.0, 0.0
    return float(x @ output) / power, float(np.sqrt(x**2 @ error**2)) / power


def _unit_words(gain: float, by_angle: bool) -> str | None:
    """The slip of the pen that the scale factor tells, if it is near one."""
    ratios = {**_RATIOS, **(_ANGLE_RATIOS if by_angle else _RATE_RATIOS)}
    if gain <= 0:
        return None
    nearest = min(ratios, key=lambda ratio: abs(np.log(gain / ratio)))
    return ratios[nearest] if abs(gain / nearest - 1) <= _NEAR else None
