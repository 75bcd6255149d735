"""Integrate: rates become the attitude, segment by segment.

Method ``quaternion`` (the default) multiplies the rotations of the steps, coning term included, and knows no
singularity; ``euler_krylov`` integrates equations (1.1) of Godorov & Lutmanov (2016) as the paper does, and
refuses to come near theta = ±90°. Both are of fourth order; `pipeline.numerics.integration` has the formulas.

The constant that integration leaves open is the attitude at one instant of the segment: that of the
reference's first sample within the segment; in a segment too short to hold one, that between the samples on
either side; else the angles that the test plan states, at the segment's start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field

from pipeline import contracts
from pipeline.numerics.integration import (
    SingularityError,
    euler_krylov_along,
    integrate_euler_krylov,
    integrate_quaternion,
)
from pipeline.numerics.local_polynomial import LocalPolynomial
from pipeline.numerics.rotation import (
    euler_krylov_from_quaternion,
    quaternion_conjugate,
    quaternion_from_euler_krylov,
    quaternion_multiply,
)
from pipeline.stages._streams import usable
from pipeline.stages.base import ANGLES, Severity, StageError, Stand, Tables, counted, finding, rows
from pipeline.stages.base import Settings as _Settings

Float = NDArray[np.float64]
Time = NDArray[np.int64]

CONSUMES = ("rates",)
MAY_CONSUME = ("reference",)
PRODUCES = ("attitude", "findings")
METRICS: tuple[str, ...] = ()

_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])

_REFERENCE_GAP = 3.5
"""The reference is interpolated to a segment's start across at most so many of its median intervals, as
the gyro is by default (`pipeline.stages.interpolate`)."""

_DEGREE = 3
"""Of the polynomial by which it is interpolated."""

_NEAR_SINGULAR = np.deg2rad(89.9)
"""Beyond this |theta| an error of the attitude is 570 times as large in psi and gamma: said as a finding."""


class Settings(_Settings):
    """How to integrate, and from which attitude."""

    method: Literal["quaternion", "euler_krylov"] = Field(
        "quaternion", description="quaternion, without singularity; or the paper's equations (1.1)"
    )
    initial: Literal["reference", "angles"] = Field(
        "reference",
        description="attitude to begin with: that of the reference where there is one, or initial_angles",
    )
    initial_angles: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0),
        description="psi, theta, gamma at the start of each segment without a reference, rad",
    )
    singularity_margin_deg: float = Field(
        1.0, gt=0, lt=90, description="method euler_krylov: refuse |theta| nearer than this to 90 degrees"
    )


@dataclass(frozen=True, slots=True)
class _Segment:
    """One uninterrupted stretch of ``rates``."""

    number: int
    time: Time
    rates: Float
    increments: Float

    @property
    def steps(self) -> Float:
        """Duration of the step that ends at the row [s]; the first is not used."""
        return np.diff(self.time, prepend=self.time[:1]) / 1e9


@dataclass(frozen=True, slots=True)
class _Reference:
    """The finite samples of the reference whose time advances: time [ns] and quaternions (n, 4)."""

    time: Time
    quaternion: Float
    longest_interval: float
    """Across which it may be interpolated [ns]."""


@dataclass(frozen=True, slots=True)
class _Anchor:
    """A known attitude at an instant of the segment [ns], and where it is from."""

    time: int
    quaternion: Float
    from_reference: bool


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Integrate ``rates`` to ``attitude``.

    Returns
    -------
    dict
        ``attitude``, and ``findings``: segments whose attitude is only relative, and nearness to the
        singularity.

    Raises
    ------
    StageError
        If method euler_krylov comes near theta = ±90°; the message names the time.
    """
    reference = _reference(tables) if settings.initial == "reference" else None
    findings: list[dict[str, Any]] = []
    segments = _segments(tables["rates"])
    angles = []
    for segment in segments:
        anchor = _anchor(segment, reference, settings)
        findings += _about_start(segment, anchor, settings, reference)
        solve = _by_quaternion if settings.method == "quaternion" else _by_angles
        angles.append(solve(segment, anchor, settings))
        findings += _about_singularity(segment, angles[-1])
    joined = angles[0] if len(angles) == 1 else np.concatenate(angles)
    columns: dict[str, Float] = {name: joined[:, k] for k, name in enumerate(ANGLES)}
    keys = {name: tables["rates"].column(name) for name in ("time", "segment")}
    return {
        "attitude": contracts.table("attitude", {**keys, **columns}),
        "findings": rows("findings", findings),
    }


def _segments(table: pa.Table) -> list[_Segment]:
    time = table.column("time").to_numpy()
    number = table.column("segment").to_numpy()
    rates = np.stack([table.column(name).to_numpy() for name in "pqr"])
    increments = np.stack([table.column("increment_" + name).to_numpy() for name in "pqr"])
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    ends = np.append(starts[1:], len(time))
    return [
        _Segment(int(number[a]), time[a:b], rates[:, a:b].T, increments[:, a:b].T)
        for a, b in zip(starts, ends, strict=True)
    ]


def _reference(tables: Tables) -> _Reference | None:
    if "reference" not in tables:
        return None
    time, angles = usable(tables["reference"], "reference")
    longest = _REFERENCE_GAP * float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return _Reference(time, quaternion_from_euler_krylov(angles), longest)


def _anchor(segment: _Segment, reference: _Reference | None, settings: Settings) -> _Anchor:
    """Where the segment's attitude is known, and what it is there."""
    start, end = int(segment.time[0]), int(segment.time[-1])
    stated = _Anchor(start, quaternion_from_euler_krylov(settings.initial_angles), False)
    if reference is None:
        return stated
    after = int(np.searchsorted(reference.time, start))
    if after == reference.time.size:
        return stated
    if reference.time[after] <= end:  # a sample is exact where an interpolation between samples is not
        return _Anchor(int(reference.time[after]), reference.quaternion[after], True)
    if after > 0 and reference.time[after] - reference.time[after - 1] <= reference.longest_interval:
        return _Anchor(start, _attitude_at(reference.time, reference.quaternion, start), True)
    return stated


def _attitude_at(time: Time, quaternion: Float, instant: int) -> Float:
    """Attitude at an instant within the times, by the local cubic of the quaternion's components.

    The components are smooth where the angles jump; signs are made continuous first.
    """
    nearest = int(np.searchsorted(time, instant))
    if nearest < time.size and time[nearest] == instant:
        return np.asarray(quaternion[nearest], dtype=np.float64)
    first = max(0, min(nearest - (_DEGREE + 1) // 2, time.size - _DEGREE - 1))
    near = slice(first, first + _DEGREE + 1)
    q = quaternion[near].copy()
    for k in range(1, len(q)):
        q[k] *= 1.0 if q[k] @ q[k - 1] >= 0 else -1.0
    t = (time[near] - instant) / 1e9
    values, _ = LocalPolynomial(t, q, min(_DEGREE, len(t) - 1)).sample(np.zeros(1))
    return np.asarray(values[0] / np.linalg.norm(values[0]), dtype=np.float64)


def _by_quaternion(segment: _Segment, anchor: _Anchor, settings: Settings) -> Float:  # noqa: ARG001
    """Angles of the segment by the quaternion path."""
    start = _attitude_at_start(segment, anchor)
    return euler_krylov_along(integrate_quaternion(segment.rates, segment.increments, segment.steps, start))


def _by_angles(segment: _Segment, anchor: _Anchor, settings: Settings) -> Float:
    """Angles of the segment by the paper's equations."""
    start = euler_krylov_from_quaternion(_attitude_at_start(segment, anchor))
    limit = np.pi / 2 - np.deg2rad(settings.singularity_margin_deg)
    try:
        return integrate_euler_krylov(segment.rates, segment.increments, segment.steps, start, limit)
    except SingularityError as error:
        time = int(segment.time[error.row])
        raise StageError(
            f"stage integrate, {time / 1e9:.6f} s ({(time - int(segment.time[0])) / 1e9:.6f} s into segment "
            f"{segment.number})",
            expected=f"|theta| below {np.rad2deg(limit):g} degrees for method euler_krylov",
            found="a closer approach to its singularity at 90 degrees",
            remedy="choose method = 'quaternion' under [integrate]",
        ) from error


def _attitude_at_start(segment: _Segment, anchor: _Anchor) -> Float:
    """The initial attitude that leads to the anchor: q(start) = q(anchor) · [start → anchor]⁻¹."""
    if anchor.time == segment.time[0]:
        return anchor.quaternion
    turned = integrate_quaternion(segment.rates, segment.increments, segment.steps, _IDENTITY)
    relative = _attitude_at(segment.time, turned, anchor.time)
    return quaternion_multiply(anchor.quaternion, quaternion_conjugate(relative))


def _about_start(
    segment: _Segment, anchor: _Anchor, settings: Settings, reference: _Reference | None
) -> list[dict[str, Any]]:
    """What must be said of the segment's initial attitude."""
    start = int(segment.time[0])
    severity: Severity = "info"
    if reference is not None and anchor.from_reference:
        if anchor.time - start <= reference.longest_interval:
            return []
        kind, late = "initial attitude", (anchor.time - start) / 1e9
        detail = f"no reference until {late:.6g} s into segment {segment.number}: tied to it there"
    else:
        if settings.initial == "angles" and segment.number == 0:
            return []
        # Without any reference a record in one piece is only told from where its angles count.
        alone = reference is None and segment.number == 0
        kind, severity = "relative attitude", "info" if alone else "warning"
        why = "" if settings.initial == "angles" else "no reference to begin with; "
        detail = f"segment {segment.number}: {why}its attitude is relative to initial_angles at its own start"
    return [finding("integrate", "rates", kind, severity, detail, start=start, end=anchor.time)]


def _about_singularity(segment: _Segment, angles: Float) -> list[dict[str, Any]]:
    near = np.flatnonzero(np.abs(angles[:, 1]) > _NEAR_SINGULAR)
    if not near.size:
        return []
    return [
        finding(
            "integrate",
            "attitude",
            "near singularity",
            "warning",
            f"|theta| exceeds {np.rad2deg(_NEAR_SINGULAR):.1f} degrees in {counted(near.size, 'row')} of "
            f"segment {segment.number}: there psi and gamma are ill-determined, only their sum or difference "
            "is not",
            start=int(segment.time[near[0]]),
            end=int(segment.time[near[-1]]),
            count=int(near.size),
        )
    ]
