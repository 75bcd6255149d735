"""Figures of the drift from tables that are written by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pipeline import contracts
from pipeline.stages import score_drift
from pipeline.stages.base import Stand, rows

ARCSEC = np.deg2rad(1 / 3600)


def parameter(name: str, value: float, error: float, **more: Any) -> dict[str, Any]:
    drift = name.startswith("m")
    row = {
        "method": "gauss_newton",
        "run": None,
        "parameter": name,
        "value": value,
        "standard_error": error,
        "unit": "1" if drift else "rad",
        "drift": 15.041067 * value if drift else None,
        "drift_standard_error": 15.041067 * error if drift else None,
        "prior": None,
        "state": "determined",
    }
    return row | more


def residuals(*states: tuple[str, float]) -> pa.Table:
    """One row for each state, both angles off by so many arcsec."""
    off = np.array([size for _, size in states]) * ARCSEC
    nothing = np.zeros(len(states))
    columns = {
        "method": ["gauss_newton"] * len(states),
        "run": nothing.astype(np.int32),
        "arc": nothing.astype(np.int32),
        "time": np.arange(len(states)),
        "predicted1": nothing,
        "predicted2": nothing,
        "residual1": off,
        "residual2": -off,
        "state": [state for state, _ in states],
    }
    return contracts.table("residuals", columns)


def score(parameters: list[dict[str, Any]], table: pa.Table) -> dict[str, dict[str, Any]]:
    tables = {"drift_parameters": rows("drift_parameters", parameters), "residuals": table}
    out = score_drift.run(tables, score_drift.Settings(), Stand())
    return {row["name"]: row for row in out["metrics"].to_pylist()}


def test_residuals_are_of_the_samples_used_and_of_those_held_out() -> None:
    table = residuals(("used", 3.0), ("used", 4.0), ("outlier", 1e3), ("bridged", 1e3), ("held out", 2.0))
    found = score([], table)
    assert found["residual_rms"]["value"] == pytest.approx(np.sqrt(12.5), rel=1e-12)  # rounding
    assert found["hold_out_rms"]["value"] == pytest.approx(2.0, rel=1e-12)
    assert found["residual_rms"]["unit"] == "arcsec"


def test_drift_in_degrees_an_hour_and_angles_in_arc_minutes() -> None:
    found = score([parameter("m11", 0.01, 1e-5), parameter("theta1", 1e-3, 1e-4)], residuals(("used", 1.0)))
    assert found["m11"]["value"] == pytest.approx(0.15041067)
    assert found["m11"]["standard_error"] == pytest.approx(1.5041067e-4)
    assert (found["m11"]["unit"], found["theta1"]["unit"]) == ("deg/h", "arcmin")
    assert found["theta1"]["value"] == pytest.approx(np.rad2deg(1e-3) * 60)


def test_what_is_not_determined_has_no_figure() -> None:
    found = score([parameter("m11", 0.0, 0.1, state="undetermined")], residuals(("used", 1.0)))
    assert found["m11"]["value"] is None
    assert found["m11"]["standard_error"] is None


def test_of_several_runs_the_largest_misalignment_and_nothing_that_is_bound() -> None:
    of_runs = [parameter("epsilon2", value, 1e-6, run=run) for run, value in enumerate((1e-4, -3e-4, 2e-4))]
    bound = parameter("epsilon1", 0.0, 0.0, run=0, state="given")
    found = score([*of_runs, bound, parameter("lambda", 0.1, 0.1)], residuals(("used", 1.0)))
    assert found["epsilon2"]["value"] == pytest.approx(-np.rad2deg(3e-4) * 60)
    assert set(found) == {"residual_rms", "epsilon2"}
