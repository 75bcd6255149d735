"""The table that each stream becomes: body and reference axes, encoders without wraps, unit quaternions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from pipeline import contracts, units
from pipeline.formats.base import CLOCKS
from pipeline.numerics.rotation import (
    euler_krylov_from_quaternion,
    quaternion_from_euler_krylov,
)
from pipeline.stages._axes import in_body_axes, named, turned, unit_quaternions
from pipeline.stages._navigation_streams import navigation_columns
from pipeline.stages._runs import unwrapped
from pipeline.stages._samples import Float, Samples
from pipeline.stages.base import ANGLES
from pipeline.stages.quantities import QUANTITIES


@np.errstate(all="ignore")  # infinities that were recorded
def columns_of(samples: Samples) -> tuple[str, Mapping[str, Float]]:
    """The table that the stream becomes, and its channels in body and reference axes."""
    match samples.stream.quantity:
        case "angular_rate":
            return "gyro", named(samples.channels, in_body_axes(samples))
        case "angle_increment":
            names = (f"increment_{channel}" for channel in samples.channels)
            return "gyro_increments", named(names, in_body_axes(samples))
        case "euler_krylov":
            return "reference", named(ANGLES, _euler_krylov(samples))
        case "table_angle" | "table_rate":
            return "turntable", named(samples.channels, _without_wraps(samples))
        case "temperature":
            return "temperature", named(samples.channels, samples.values)
        case "gimbal_angles":
            angles = _without_wraps(samples)
            # Within a quarter turn of 0 wherever the gimbal can serve, so 350 deg is -10.
            if samples.stream.channels["alpha2"].wraps_at is not None:
                angles[:, 1] -= _whole_turns(angles[:, 1])
            return "gimbal", named(samples.channels, angles)
        case "quaternion" if samples.name == "reference":
            angles = euler_krylov_from_quaternion(turned(unit_quaternions(samples), samples.stream))
            return "reference", named(ANGLES, angles)
        case _:
            return navigation_columns(samples)


def _without_wraps(samples: Samples) -> Float:
    """Angles of encoders, the beginnings of a count undone where the plan says that it wraps."""
    values = samples.values.copy()
    kinds = QUANTITIES[samples.stream.quantity]
    for k, name in enumerate(samples.channels):
        channel = samples.stream.channels[name]
        if channel.wraps_at is not None:
            factor = units.FACTORS[kinds[name]][units.canonical(channel.unit)]
            period = channel.wraps_at * abs(channel.scale) * factor
            values[:, k] = unwrapped(values[:, k], samples.time, period, f"{samples.where}, channel {name!r}")
    return values


def _whole_turns(angle: Float) -> float:
    """The whole turns by which an angle lies away from 0, judged by its median [rad]."""
    finite = angle[np.isfinite(angle)]
    return float(2 * np.pi * np.rint(np.median(finite) / (2 * np.pi))) if finite.size else 0.0


def _euler_krylov(samples: Samples) -> Float:
    """The angles as recorded, unless axes are to be turned: then through quaternions."""
    if samples.stream.rotation is None and samples.stream.reference_rotation is None:
        return samples.values
    quaternion = quaternion_from_euler_krylov(samples.values)
    return euler_krylov_from_quaternion(turned(quaternion, samples.stream))


def stream_table(name: str, samples: Samples, columns: Mapping[str, Float]) -> pa.Table:
    """The table of a stream; a clock or channel that it does not have is null throughout."""
    clocks = {c: samples.table.column(c) for c in CLOCKS if c in samples.table.column_names}
    absent = dict.fromkeys(contracts.contract(name).schema.names, pa.nulls(samples.table.num_rows))
    return contracts.table(name, {**absent, "time": samples.time, **clocks, **columns})
