"""The axes of a stream's samples, turned as its plan says: to the body, and to the axes of reference."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pipeline.numerics.rotation import (
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_multiply,
)
from pipeline.stages._samples import Float, Samples
from pipeline.stages.channel_map import Stream

UNIT_NORM = 1e-3
"""A quaternion whose norm is farther from 1 than this is marked: single precision and four decimals are
nearer, a wrong column or scale is not."""


def in_body_axes(samples: Samples) -> Float:
    """``v_body = R v_sensor``, R the stream's rotation."""
    R = samples.stream.rotation
    return samples.values if R is None else samples.values @ np.array(R).T


def turned(quaternion: Float, stream: Stream) -> Float:
    """From what the reference reports to body and reference axes: ``R_ref A R_body^T``, as quaternions."""
    if stream.reference_rotation is not None:
        quaternion = quaternion_multiply(quaternion_from_matrix(stream.reference_rotation), quaternion)
    if stream.rotation is not None:
        to_sensor = quaternion_conjugate(quaternion_from_matrix(stream.rotation))
        quaternion = quaternion_multiply(quaternion, to_sensor)
    return quaternion


def unit_quaternions(samples: Samples) -> Float:
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


def named(names: Iterable[str], values: Float) -> dict[str, Float]:
    """The columns of an array, shape (n, k), by k names."""
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))
