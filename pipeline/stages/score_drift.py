"""Score of the procedure `drift`: its parameters, residuals and hold-out as figures that a plan can limit.

Drift is given in deg/h, angles in arcmin, residuals in arcsec, as the field reads them. The channel is the
method. Of the misalignments of several runs the largest is given. What the record does not determine at all
has no value, which no limit accepts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, TILT
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand, Tables, metric, rows

CONSUMES = ("drift_parameters", "residuals")
MAY_CONSUME: tuple[str, ...] = ()
PRODUCES = ("metrics",)
METRICS: tuple[str, ...] = ("residual_rms", "hold_out_rms", *DRIFT, *TILT, *MISALIGNMENT)

_ARCMIN = float(np.rad2deg(1) * 60)
_ARCSEC = float(np.rad2deg(1) * 3600)


class Settings(_Settings):
    """Nothing to choose."""


def run(tables: Tables, settings: Settings, stand: Stand) -> dict[str, pa.Table]:  # noqa: ARG001
    """Compute the figures.

    Parameters
    ----------
    tables : mapping
        ``drift_parameters`` and ``residuals``.

    Returns
    -------
    dict
        ``metrics``: residual_rms, hold_out_rms (arcsec) of each method; each drift parameter (deg/h) and
        installation error (arcmin) with its standard error.
    """
    figures = [*_residuals(tables["residuals"]), *_parameters(tables["drift_parameters"])]
    return {"metrics": rows("metrics", figures)}


def _residuals(residuals: pa.Table) -> Iterator[dict[str, Any]]:
    """Root mean square over both angles, of the samples used and of those held out."""
    for name, state in (("residual_rms", "used"), ("hold_out_rms", "held out")):
        of = residuals.filter(pc.equal(residuals["state"], state))
        for method in pc.unique(of["method"]).to_pylist():
            rows_of = of.filter(pc.equal(of["method"], method))
            both = np.concatenate([rows_of[c].to_numpy() for c in ("residual1", "residual2")])
            yield metric("score_drift", method, name, float(np.sqrt(np.mean(both**2))) * _ARCSEC, "arcsec")


def _parameters(parameters: pa.Table) -> Iterator[dict[str, Any]]:
    largest: dict[tuple[str, str], dict[str, Any]] = {}
    for row in parameters.to_pylist():
        if row["parameter"] not in METRICS or row["value"] is None or row["state"] == "given":
            continue
        place = row["method"], row["parameter"]
        if place not in largest or abs(row["value"]) > abs(largest[place]["value"]):
            largest[place] = row
    for (method, name), row in largest.items():
        if row["state"] == "undetermined":
            yield metric("score_drift", method, name, None, "deg/h" if name in DRIFT else "arcmin")
        elif name in DRIFT:
            error = row["drift_standard_error"]
            yield metric("score_drift", method, name, row["drift"], "deg/h", error)
        else:
            value, error = row["value"] * _ARCMIN, row["standard_error"] * _ARCMIN
            yield metric("score_drift", method, name, value, "arcmin", error)
