"""The table that each stream becomes: body and reference axes, encoders without wraps, unit quaternions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pyarrow as pa

from pipeline import contracts, units
from pipeline.formats.base import CLOCKS
from pipeline.numerics.rotation import (
    euler_krylov_from_quaternion,
    quaternion_conjugate,
    quaternion_from_euler_krylov,
    quaternion_from_matrix,
    quaternion_multiply,
)
from pipeline.stages._runs import unwrapped
from pipeline.stages._samples import Float, Samples
from pipeline.stages.base import ANGLES
from pipeline.stages.channel_map import Stream
from pipeline.stages.quantities import QUANTITIES

UNIT_NORM = 1e-3
"""A quaternion whose norm is farther from 1 than this is marked: single precision and four decimals are
nearer, a wrong column or scale is not."""


@np.errstate(all="ignore")  # infinities that were recorded
def columns_of(samples: Samples) -> tuple[str, Mapping[str, Float]]:
    """The table that the stream becomes, and its channels in body and reference axes."""
    match samples.stream.quantity:
        case "angular_rate":
            return "gyro", _named(samples.channels, _in_body_axes(samples))
        case "angle_increment":
            names = (f"increment_{channel}" for channel in samples.channels)
            return "gyro_increments", _named(names, _in_body_axes(samples))
        case "euler_krylov":
            return "reference", _named(ANGLES, _euler_krylov(samples))
        case "table_angle" | "table_rate":
            return "turntable", _named(samples.channels, _without_wraps(samples))
        case "temperature":
            return "temperature", _named(samples.channels, samples.values)
        case "gimbal_angles":
            angles = _without_wraps(samples)
            # Within a quarter turn of 0 wherever the gimbal can serve, so 350 deg is -10.
            if samples.stream.channels["alpha2"].wraps_at is not None:
                angles[:, 1] -= _whole_turns(angles[:, 1])
            return "gimbal", _named(samples.channels, angles)
        case "quaternion":
            angles = euler_krylov_from_quaternion(_turned(_unit_quaternions(samples), samples.stream))
            return "reference", _named(ANGLES, angles)


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


def _in_body_axes(samples: Samples) -> Float:
    """``v_body = R v_sensor``, R the stream's rotation."""
    R = samples.stream.rotation
    return samples.values if R is None else samples.values @ np.array(R).T


def _euler_krylov(samples: Samples) -> Float:
    """The angles as recorded, unless axes are to be turned: then through quaternions."""
    if samples.stream.rotation is None and samples.stream.reference_rotation is None:
        return samples.values
    quaternion = quaternion_from_euler_krylov(samples.values)
    return euler_krylov_from_quaternion(_turned(quaternion, samples.stream))


def _turned(quaternion: Float, stream: Stream) -> Float:
    """From what the reference reports to body and reference axes: ``R_ref A R_body^T``, as quaternions."""
    if stream.reference_rotation is not None:
        quaternion = quaternion_multiply(quaternion_from_matrix(stream.reference_rotation), quaternion)
    if stream.rotation is not None:
        to_sensor = quaternion_conjugate(quaternion_from_matrix(stream.rotation))
        quaternion = quaternion_multiply(quaternion, to_sensor)
    return quaternion


def _unit_quaternions(samples: Samples) -> Float:
    """The quaternions at norm 1; what had to be bent for it is said."""
    norm = np.sqrt(np.sum(samples.values**2, axis=1))
    usable = np.isfinite(norm) & (norm > 0)
    off = usable & (np.abs(norm - 1) > UNIT_NORM)
    unit = np.where(usable[:, np.newaxis], samples.values / norm[:, np.newaxis], np.nan)
    if off.any():
        detail = f"whose quaternion has a norm of {norm[off].min():.6g} to {norm[off].max():.6g}: normalised"
        samples.say("quaternion norm", "warning", detail, off)
    detail = "whose quaternion is zero, which is no attitude: it becomes NaN"
    samples.say("zero quaternion", "warning", detail, norm == 0)
    return unit


def stream_table(name: str, samples: Samples, columns: Mapping[str, Float]) -> pa.Table:
    """The table of a stream; a clock or channel that it does not have is null throughout."""
    clocks = {c: samples.table.column(c) for c in CLOCKS if c in samples.table.column_names}
    absent = dict.fromkeys(contracts.contract(name).schema.names, pa.nulls(samples.table.num_rows))
    return contracts.table(name, {**absent, "time": samples.time, **clocks, **columns})


def _named(names: Iterable[str], values: Float) -> dict[str, Float]:
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))
