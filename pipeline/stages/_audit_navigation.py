"""The audit of a navigation's streams: stamps, missing and frozen samples, and what cannot be true.

What cannot be true is told by comparing streams that measure the same in different ways: the way between two
positions against the velocity (latitude and longitude exchanged, north and east exchanged), the specific
force against gravity, the magnetic field against that of the Earth, the time of an aid against that of the
gyro. Nothing of it is corrected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.models.ellipsoid import POLAR_LIMIT, metres_between
from pipeline.numerics.sample_faults import frozen_runs
from pipeline.numerics.sampling import Intervals, Runs
from pipeline.numerics.time_grid import advancing
from pipeline.stages._audit_rows import StreamReport
from pipeline.stages._audit_values import audit_missing
from pipeline.stages._navigation_streams import CHANNELS
from pipeline.stages.base import Tables, counted
from pipeline.units import STANDARD_GRAVITY

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

SENSORS = ("accelerometer", "accelerometer_increments", "magnetometer")
"""Streams that are audited as a gyro is: spikes, clipped and frozen samples channel by channel."""

AIDS = ("gnss_position", "gnss_velocity", "airspeed", "barometer", "external_attitude")
"""Streams of which a measurement may be frozen in all its channels together."""

_ACCELERATION_UNITS: Mapping[str, float] = MappingProxyType(
    {
        "g where m/s^2 are stated": 1 / STANDARD_GRAVITY,
        "m/s^2 where g are stated": STANDARD_GRAVITY,
        "mg where m/s^2 are stated": 1000 / STANDARD_GRAVITY,
        "mg where g are stated": 1000.0,
        "g where mg are stated": 1e-3,
        "m/s^2 where mg are stated": STANDARD_GRAVITY / 1000,
    }
)
_NEAR = 1.5
"""A ratio within this factor of one that a wrong unit gives is explained by it."""

_WEIGHT = (0.2, 5.0)
"""Median specific force over gravity, beyond which it is no vehicle's."""

_FIELD = (20e-6, 70e-6)
"""The Earth's magnetic field [T]; 22 to 67 uT over the whole of it."""

_FIELD_UNITS: Mapping[str, float] = MappingProxyType(
    {
        "gauss where tesla are stated": 1e4,
        "microtesla where tesla are stated": 1e6,
        "nanotesla where tesla are stated": 1e9,
        "milligauss where microtesla are stated": 10.0,
        "microtesla where milligauss are stated": 0.1,
        "nanotesla where microtesla are stated": 1e3,
        "microtesla where nanotesla are stated": 1e-3,
        "tesla where microtesla are stated": 1e-6,
        "gauss where microtesla are stated": 1e-2,
    }
)
_TYPICAL_FIELD = float(np.sqrt(_FIELD[0] * _FIELD[1]))

_ALTITUDES = (-1000.0, 20_000.0)
"""Median altitude by pressure [m], beyond which it is none; and how far it may be from the height by
satellites, of which the day's pressure and temperature make some hundred metres and a tenth."""
_ALTITUDE_OFF, _ALTITUDE_SCALE = 1000.0, 0.2

_VELOCITY_OF: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "gnss_position": ("gnss_velocity", "velocity by satellites"),
        "truth_position": ("truth_velocity", "true velocity"),
    }
)
"""The stream that says how the positions of another move, and what it is called."""

_FASTEST = 1000.0
"""A speed [m/s] that no vehicle with an air speed has."""

_SLOWEST = 2.0
"""Root mean square speed [m/s] below which noise hides which way a vehicle moves."""

_FEWEST = 10
"""Ways between positions from which on their velocity is judged."""

_BASELINE = 10.0
"""Time over which a way is taken [s]: a position's noise of 3 m is 0.4 m/s of it."""

_GAP = 3.0
"""Usual intervals of the velocity from which on the way between two of them is not known."""

_EXPLAINED = 0.3
"""Part of the velocity's root mean square within which positions move as it says; and the same for what
explains them better."""


def audit_aid(report: StreamReport, table: pa.Table, frozen_samples: int) -> None:
    """Missing and frozen measurements of an aid, or of the truth, whose value may well rest."""
    names = CHANNELS[report.stream]
    channels = {name: table.column(name).to_numpy() for name in names}
    finite = audit_missing(report, channels)
    if report.stream not in AIDS:
        return
    index = np.flatnonzero(np.all(list(finite.values()), axis=0))
    count = 0
    if len(index):
        values = np.stack([channels[name][index] for name in names], axis=1)
        found = frozen_runs(values, frozen_samples)
        whole = Runs(index[found.start], index[found.stop - 1] + 1)
        count = int(found.length.sum())
        report.mark(
            "frozen",
            "warning",
            whole,
            lambda i: (
                f"all channels hold their values for {counted(int(found.length[i]), 'measurement')}, bit for "
                "bit, far longer than elsewhere"
            ),
            count=found.length,
        )
    report.figure("frozen_count", count)


def audit_size(report: StreamReport, channels: Mapping[str, Float], regular: Intervals | None) -> None:
    """Whether a sensor's values are of the size that they must have, by what it measures."""
    values = np.column_stack(list(channels.values()))
    values = values[np.isfinite(values).all(axis=1)]
    if report.stream == "magnetometer":
        audit_field(report, values)
    else:
        audit_force(report, values, regular)


def judge_together(reports: Sequence[StreamReport], tables: Tables) -> None:
    """What several streams tell together: positions that contradict velocities, times that do not meet."""
    gyro = next((tables[name] for name in ("gyro", "gyro_increments") if name in tables), None)
    for report in reports:
        if report.stream in CHANNELS and gyro is not None:
            audit_overlap(report, gyro.column("time").to_numpy())
        if report.stream in _VELOCITY_OF:
            audit_position(report, tables[report.stream], tables)
        if report.stream == "barometer":
            audit_altitude(report, tables)


def audit_force(report: StreamReport, values: Float, regular: Intervals | None) -> None:
    """Whether specific force is of the size of gravity, and points as it does for axes that look down.

    Parameters
    ----------
    report : StreamReport
    values : ndarray, shape (n, 3)
        Finite specific forces [m/s^2], or their increments [m/s].
    regular : Intervals, optional
        Of the stamps, which make forces of increments.
    """
    if report.stream == "accelerometer_increments":
        if regular is None:
            return
        values = values / regular.nominal
    if len(values) < 2:
        return
    size = float(np.median(np.linalg.norm(values, axis=1)))
    report.figure("specific_force_ratio", size / STANDARD_GRAVITY)
    if not _WEIGHT[0] < size / STANDARD_GRAVITY < _WEIGHT[1]:
        guess = _guess(size / STANDARD_GRAVITY, _ACCELERATION_UNITS)
        report.say(
            "implausible unit",
            "error",
            f"the median specific force is {size:.4g} m/s^2, {size / STANDARD_GRAVITY:.3g} times "
            f"gravity{guess}",
        )
        return
    along = np.median(values, axis=0)
    if along[2] > 0.5 * STANDARD_GRAVITY:
        report.say(
            "implausible axes",
            "error",
            f"the median specific force along body axis 3 is {along[2]:+.4g} m/s^2: upside down, or axes "
            "forward, left, up where forward, right, down are meant (rotation = "
            "[[1, 0, 0], [0, -1, 0], [0, 0, -1]])",
        )


def audit_field(report: StreamReport, values: Float) -> None:
    """Whether the magnetic field is of the size of the Earth's; ``values`` finite [T], shape (n, 3)."""
    if len(values) < 2:
        return
    size = float(np.median(np.linalg.norm(values, axis=1)))
    report.figure("magnetic_field", size * 1e6, "uT")
    if _FIELD[0] <= size <= _FIELD[1]:
        return
    far = not _FIELD[0] / 2 <= size <= _FIELD[1] * 2
    guess = _guess(size / _TYPICAL_FIELD, _FIELD_UNITS, 2.5)
    report.say(
        "implausible unit",
        "error" if far else "warning",
        f"the median magnetic field is {size * 1e6:.4g} uT, where the Earth's is 20 to 70 uT"
        + (guess or (": wrong unit?" if far else ": hard iron, or a scale?")),
    )


def audit_altitude(report: StreamReport, tables: Tables) -> None:
    """Whether the altitude by pressure is one, and not far from the height by satellites."""
    altitude = _median(tables["barometer"], "altitude")
    height = _median(tables["gnss_position"], "height") if "gnss_position" in tables else None
    if altitude is None:
        return
    off = None if height is None else abs(altitude - height)
    far = off is not None and off > _ALTITUDE_OFF + _ALTITUDE_SCALE * abs(height or 0.0)
    if far or not _ALTITUDES[0] <= altitude <= _ALTITUDES[1]:
        beside = "" if height is None else f", the height by satellites {height:.6g} m"
        text = f"the median altitude by pressure is {altitude:.6g} m{beside}: wrong unit?"
        report.say("implausible unit", "error", text)


def _median(table: pa.Table, name: str) -> float | None:
    values = table.column(name).to_numpy()
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None


def _guess(ratio: float, known: Mapping[str, float], near: float = _NEAR) -> str:
    """The confusion of units that explains a ratio best, as the end of a sentence."""
    if not ratio > 0:
        return ""
    name, away = min(((n, abs(np.log(ratio / r))) for n, r in known.items()), key=lambda pair: pair[1])
    return f": {name}?" if away < np.log(near) else ""


def audit_overlap(report: StreamReport, gyro: Int) -> None:
    """Whether a stream records while the gyro does."""
    own = report.time
    if not len(own) or not len(gyro) or max(own.min(), gyro.min()) <= min(own.max(), gyro.max()):
        return
    report.say(
        "no common time",
        "error",
        f"records from {own.min() / 1e9:.3f} to {own.max() / 1e9:.3f} s, the gyro from "
        f"{gyro.min() / 1e9:.3f} to {gyro.max() / 1e9:.3f} s: choose the same clock for both",
    )


def audit_position(report: StreamReport, table: pa.Table, tables: Tables) -> None:
    """Whether a latitude is one, and positions move as the velocity beside them says."""
    names = CHANNELS["gnss_position"]
    values = np.stack([table.column(name).to_numpy() for name in names], axis=1)
    finite = np.isfinite(values).all(axis=1)
    time, values = report.time[finite], values[finite]
    beyond = int(np.count_nonzero(np.abs(values[:, 0]) > np.pi / 2))
    if beyond:
        largest = float(np.degrees(np.abs(values[:, 0]).max()))
        swapped = largest <= 180 and bool((np.abs(values[:, 1]) <= np.pi / 2).all())
        report.say(
            "implausible position",
            "error",
            f"latitudes up to {largest:.6g} deg in {counted(beyond, 'measurement')}: "
            + ("latitude and longitude exchanged?" if swapped else "wrong unit, or wrong columns?"),
            channel="latitude",
            count=beyond,
        )
        return
    if len(values) and float(np.abs(values[:, 0]).max()) > POLAR_LIMIT:
        limit = np.degrees(POLAR_LIMIT)
        text = f"latitudes beyond {limit:g} deg: at a pole north and east have no meaning"
        report.say("pole", "error", text, channel="latitude")
        return
    kept = advancing(time).kept
    time, values = time[kept], values[kept]
    if len(time) > _FEWEST:
        _audit_ways(report, time, values, tables)


def _audit_ways(report: StreamReport, time: Int, values: Float, tables: Tables) -> None:
    seconds = np.asarray((time - time[0]) / 1e9, dtype=np.float64)
    fast = int(np.count_nonzero(np.linalg.norm(_moved(seconds, values, 1), axis=1) > _FASTEST))
    if fast:
        report.say(
            "position jump",
            "warning",
            f"{counted(fast, 'step')} between positions faster than {_FASTEST:g} m/s: wrong fixes, or a "
            "wrong unit?",
            count=fast,
        )
    stride = max(1, min(round(_BASELINE / float(np.median(np.diff(seconds)))), len(time) // 3))
    velocity, called = _VELOCITY_OF[report.stream]
    told, known = _told(time, stride, tables, velocity)
    if np.count_nonzero(known) < _FEWEST:
        return
    told = told[known]
    moved = _moved(seconds, values, stride)[known][:, :2]
    scale, off = _size(told), _size(moved - told)
    if scale < _SLOWEST:
        return
    report.figure("position_velocity_mismatch", off / scale)
    if off <= _EXPLAINED * scale:
        return
    candidates = {
        "the velocity's north and east exchanged?": moved - told[:, ::-1],
        "the velocity's sign turned round?": moved + told,
    }
    if (np.abs(values[:, 1]) < POLAR_LIMIT).all():
        exchanged = _moved(seconds, values[:, [1, 0, 2]], stride)[known][:, :2]
        candidates["latitude and longitude exchanged?"] = exchanged - told
    name, best = min(((n, _size(d)) for n, d in candidates.items()), key=lambda pair: pair[1])
    explained = best <= min(_EXPLAINED * scale, 0.5 * off)
    report.say(
        "implausible position",
        "error" if explained else "warning",
        f"positions move at {_size(moved):.4g} m/s (root mean square), {off:.4g} m/s away from the "
        f"{called}, {scale:.4g} m/s: " + (name if explained else "wrong columns, unit or clock?"),
    )


def _size(velocity: Float) -> float:
    """Root of the mean of the squared lengths; the tenth that is largest does not count."""
    square = np.sort(np.sum(velocity**2, axis=1))
    return float(np.sqrt(square[: max(1, len(square) * 9 // 10)].mean()))


def _moved(seconds: Float, position: Float, stride: int) -> Float:
    """Mean velocity N, E, D from each position to the one so many later [m/s]."""
    length = (seconds[stride:] - seconds[:-stride])[:, np.newaxis]
    return metres_between(position[:-stride], position[stride:]) / length


def _told(time: Int, stride: int, tables: Tables, velocity: str) -> tuple[Float, Mask]:
    """Mean velocity N, E of a stream over the same times [m/s], and where it is known throughout."""
    start, end = time[:-stride], time[stride:]
    nowhere = np.zeros((len(start), 2)), np.zeros(len(start), dtype=np.bool_)
    if velocity not in tables:
        return nowhere
    table = tables[velocity]
    own = table.column("time").to_numpy()
    values = np.stack([table.column(name).to_numpy() for name in ("north", "east")], axis=1)
    kept = advancing(own).kept & np.isfinite(values).all(axis=1)
    own, values = own[kept], values[kept]
    if len(own) < 2:
        return nowhere
    steps = np.diff(own) / 1e9
    gone = np.cumsum((values[1:] + values[:-1]) / 2 * steps[:, np.newaxis], axis=0)
    way = np.concatenate([np.zeros((1, 2)), gone])
    # Seconds spent in gaps: a way that has any is not known.
    missing = np.concatenate([[0.0], np.cumsum(np.where(steps > _GAP * np.median(steps), steps, 0.0))])
    x = (own - own[0]) / 1e9
    length = (end - start)[:, np.newaxis] / 1e9
    at = [(t - own[0]) / 1e9 for t in (start, end)]
    ways = np.stack([np.interp(at[1], x, c) - np.interp(at[0], x, c) for c in way.T], axis=1)
    lost = np.interp(at[1], x, missing) - np.interp(at[0], x, missing)
    known = (start >= own[0]) & (end <= own[-1]) & (lost <= 0)
    return ways / length, np.asarray(known, dtype=np.bool_)
