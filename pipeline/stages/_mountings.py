"""How the case of a gyro was mounted on a rate table in each run, and which streams runs may part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.plan_faults import Fault
from pipeline.stages._runs import CaseAxis, Run
from pipeline.stages.base import rows
from pipeline.stages.channel_map import Stream
from pipeline.stages.quantities import QUANTITIES, StreamName

Float = NDArray[np.float64]

ON_TABLE: tuple[StreamName, ...] = ("gyro", "turntable", "temperature")
"""The streams of a rate table, which its runs part."""

_OF_GIMBAL = ("scheme", "chi_deg", "latitude_deg")
_CHANNELS = tuple(QUANTITIES["angular_rate"])


def direction(axis: CaseAxis) -> Float:
    """Unit vector of an axis of the case, shape (3,)."""
    vector = np.zeros(3)
    vector[_CHANNELS.index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return vector


def mountings_table(runs: Sequence[Run]) -> pa.Table:
    """The table ``mountings`` of the runs that a plan lists."""
    return rows(
        "mountings",
        [
            {
                "run": place,
                "name": run.name,
                **_components("axis", run.axis),
                **_components("across", run.across),
            }
            for place, run in enumerate(runs)
        ],
    )


def run_stream_faults(runs: Sequence[Run], streams: Mapping[StreamName, Stream]) -> Iterator[Fault]:
    """Runs without a stream to part, and what runs say that is not of their stream; keys from the plan."""
    if not runs:
        return
    if "gimbal" in streams:
        for place, run in enumerate(runs):
            if run.axis is not None:
                expected = "axis only of a gyro on a rate table"
                remedy = "remove it; scheme or chi_deg says how the base of a gimbal is mounted"
                yield Fault(("runs", place, "axis"), expected, "it beside the stream gimbal", remedy)
        return
    if "gyro" not in streams:
        expected = "[[runs]] only beside the stream gimbal or gyro"
        remedy = "add [streams.gimbal] or [streams.gyro], or remove [[runs]]"
        yield Fault(("runs",), expected, f"the streams {', '.join(streams)}", remedy)
        return
    for name, stream in streams.items():
        if name not in ON_TABLE:
            expected = f"only the streams {', '.join(ON_TABLE)} beside [[runs]] of a gyro"
            yield Fault(("streams", name), expected, repr(name), "remove it, or [[runs]]")
        elif stream.quantity == "angle_increment":
            expected = "'angular_rate' beside [[runs]]"
            remedy = "record rates, or remove [[runs]]"
            yield Fault(("streams", name, "quantity"), expected, "'angle_increment'", remedy)
    for place, run in enumerate(runs):
        for key in _OF_GIMBAL:
            if getattr(run, key) is not None:
                expected = f"{key} of a run only beside the stream gimbal"
                remedy = "remove it; axis says how the case is mounted on a rate table, [stand] the rest"
                yield Fault(("runs", place, key), expected, "it beside the stream gyro", remedy)


def _components(name: str, axis: CaseAxis | None) -> dict[str, float | None]:
    values = [None] * 3 if axis is None else direction(axis).tolist()
    return {f"{name}_{i}": value for i, value in enumerate(values, start=1)}
