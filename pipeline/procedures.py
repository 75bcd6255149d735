"""The procedures: the whole way of the data on one page."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

PROCEDURES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "coning": ("ingest", "audit", "align", "interpolate", "integrate", "detrend", "score"),
        "drift": ("ingest", "audit", "resample", "identify", "score_drift"),
        "static": ("ingest", "audit", "noise", "modulation", "score_static"),
        "rate_table": ("ingest", "audit", "steps", "calibrate", "score_rate_table"),
        "navigation": ("ingest", "audit", "navigate", "score_navigation"),
    }
)
"""The stages of each procedure, in order; each is the module of that name in `pipeline.stages`."""

NEEDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "drift": ("streams.gimbal",),
        "static": ("streams.gyro",),
        "rate_table": ("streams.gyro",),
        "navigation": ("streams.gyro", "streams.accelerometer"),
    }
)
"""What a plan must say for a procedure, beyond what its stages' settings demand themselves: keys of its
streams and its stand, such as ``streams.gimbal`` and ``stand.latitude_deg``."""

WITH_RUNS: tuple[str, ...] = ("drift", "rate_table")
"""Procedures whose plans may list ``[[runs]]``."""

WHOLE: Mapping[str, tuple[str, ...]] = MappingProxyType({"coning": ("gyro",), "navigation": ("gyro",)})
"""Streams of which a procedure needs every channel, though others do with some of them."""
