"""The streams that a recording may hold, the quantities that each may record, and their channels.

A quantity's channels are measured in units of the dimension beside each (`pipeline.units`). A new stream is a
line here, a contract in ``schemas/`` and its case in `stages._stream_tables`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

StreamName = Literal[
    "gyro",
    "reference",
    "gimbal",
    "turntable",
    "temperature",
]
Quantity = Literal[
    "angular_rate",
    "angle_increment",
    "euler_krylov",
    "quaternion",
    "gimbal_angles",
    "table_angle",
    "table_rate",
    "temperature",
]

_ANGLE, _RATE, _NUMBER = "angle", "angular rate", "pure number"

QUANTITIES: Mapping[Quantity, Mapping[str, str]] = MappingProxyType(
    {
        "angular_rate": {"p": _RATE, "q": _RATE, "r": _RATE},
        "angle_increment": {"p": _ANGLE, "q": _ANGLE, "r": _ANGLE},
        "euler_krylov": {"psi": _ANGLE, "theta": _ANGLE, "gamma": _ANGLE},
        "quaternion": {"w": _NUMBER, "x": _NUMBER, "y": _NUMBER, "z": _NUMBER},
        "gimbal_angles": {"alpha1": _ANGLE, "alpha2": _ANGLE},
        "table_angle": {"angle": _ANGLE},
        "table_rate": {"rate": _RATE},
        "temperature": {"temperature": "temperature"},
    }
)
"""The channels of each quantity, in order, and what their units measure."""

STREAMS: Mapping[StreamName, tuple[Quantity, ...]] = MappingProxyType(
    {
        "gyro": ("angular_rate", "angle_increment"),
        "reference": ("euler_krylov", "quaternion"),
        "gimbal": ("gimbal_angles",),
        "turntable": ("table_angle", "table_rate"),
        "temperature": ("temperature",),
    }
)
"""The quantities that each stream may record."""

IN_PART: tuple[StreamName, ...] = ("gyro",)
"""Streams that need not have all their channels: a sensor may have one axis."""

WRAPPING: tuple[Quantity, ...] = ("gimbal_angles", "table_angle")
"""Quantities of encoders, which may begin again at 0."""

TURNED: tuple[StreamName, ...] = ("gyro", "reference")
"""Streams whose axes a rotation of the plan may turn to those of the body."""
