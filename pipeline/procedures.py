"""The procedures: the whole way of the data on one page."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

PROCEDURES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "coning": ("ingest", "audit", "align", "interpolate", "integrate", "detrend", "score"),
    }
)
"""The stages of each procedure, in order; each is the module of that name in `pipeline.stages`."""
