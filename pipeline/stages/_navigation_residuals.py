"""Figures that need no truth: the navigation against the satellites that aid it, and its innovations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pipeline.models.ellipsoid import metres_between
from pipeline.models.navigation_consistency import mean_band
from pipeline.numerics.time_grid import advancing
from pipeline.stages._navigation_problem import columns
from pipeline.stages._navigation_streams import POSITION, VELOCITY
from pipeline.stages._navigation_tables import COMPONENTS
from pipeline.stages.base import Tables, metric

Float = NDArray[np.float64]
Time = NDArray[np.int64]
Mask = NDArray[np.bool_]


def residual_figures(
    method: str, time: Time, state: Mapping[str, Float], aided: Mask, tables: Tables
) -> Iterator[dict[str, Any]]:
    """Root mean squares of what is navigated less what satellites measure, horizontally, while they aid.

    Parameters
    ----------
    method : str
    time : ndarray of int64, shape (n,)
        Of the navigation [ns].
    state : mapping of str to ndarray, each of shape (n, 3)
        ``position`` and ``velocity``.
    aided : ndarray of bool, shape (n,)
        Instants at which they aid, without the transient.
    tables : mapping
        ``gnss_position``, ``gnss_velocity``, as far as they are there.
    """
    for name, table, names, unit in (
        ("horizontal_residual_rms", "gnss_position", POSITION, "m"),
        ("velocity_residual_rms", "gnss_velocity", VELOCITY, "m/s"),
    ):
        if table not in tables:
            continue
        at, measured = _usable(tables[table], names)
        place, part = _between(time, at)
        kept = aided[place] & aided[np.minimum(place + 1, len(time) - 1)] & (part >= 0) & (part <= 1)
        place, u, measured = place[kept], part[kept, np.newaxis], measured[kept]
        of = state["position" if unit == "m" else "velocity"]
        navigated = of[place] + u * (of[np.minimum(place + 1, len(of) - 1)] - of[place])
        difference = metres_between(measured, navigated) if unit == "m" else navigated - measured
        square = np.sum(difference[:, :2] ** 2, axis=1)
        value = float(np.sqrt(square.mean())) if len(square) else None
        yield metric("score_navigation", method, name, value, unit)


def _usable(table: pa.Table, names: tuple[str, ...]) -> tuple[Time, Float]:
    time, values = table.column("time").to_numpy(), columns(table, names)
    finite = np.isfinite(values).all(axis=1)
    time, values = time[finite], values[finite]
    kept = advancing(time).kept
    return time[kept], values[kept]


def _between(time: Time, at: Time) -> tuple[NDArray[np.int64], Float]:
    """The instant before each time, and how far towards the next."""
    place = np.clip(np.searchsorted(time, at, side="right") - 1, 0, max(len(time) - 2, 0)).astype(np.int64)
    length = np.maximum(time[np.minimum(place + 1, len(time) - 1)] - time[place], 1)
    return place, np.asarray((at - time[place]) / length, dtype=np.float64)


def innovation_figures(
    innovations: pa.Table | None, navigation: pa.Table, settling: float
) -> Iterator[dict[str, Any]]:
    """Mean normalised innovation squared a component, of the accepted ones after the transient; and its band.

    The band is that in which 95 % of such means lie if innovations are white and as large as they are said
    to be.
    """
    if innovations is None or not innovations.num_rows:
        return
    begin = pc.min(navigation["time"]).as_py()
    end = pc.max(navigation["time"]).as_py()
    after = begin + round(min(settling * 1e9, (end - begin) / 2))
    kept = pc.and_(innovations["accepted"], pc.greater_equal(innovations["time"], after))
    kept = pc.and_(kept, pc.is_valid(innovations["normalised_squared"]))
    judged = innovations.filter(kept)
    pairs = judged.group_by(["method", "aid"], use_threads=False).aggregate(
        [("normalised_squared", "mean"), ("normalised_squared", "count")]
    )
    for row in pairs.to_pylist():
        size = len(COMPONENTS[row["aid"]][0])
        low, high = mean_band(size, row["normalised_squared_count"] // size)
        for suffix, square in (("", row["normalised_squared_mean"]), ("_lower", low), ("_upper", high)):
            yield metric(
                "score_navigation",
                f"{row['method']}.{row['aid']}",
                f"normalised_innovations{suffix}",
                square / size,
                "1",
            )
