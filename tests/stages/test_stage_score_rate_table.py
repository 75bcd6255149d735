"""Score of a rate-table calibration: each figure in its unit, and none where nothing is determined."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.stages import base, score_rate_table
from pipeline.storage.contract_check import violations

DEG = np.pi / 180
FIXED = {
    "method": "rates",
    "state": "determined",
    "role": "model",
    "reference_temperature": None,
    "lowest_temperature": None,
    "highest_temperature": None,
    "largest_rate": 1.0,
}


def parameter(
    gyro: str, name: str, value: float | None, error: float | None = None, unit: str = "1"
) -> dict[str, Any]:
    return {
        **FIXED,
        "gyro": gyro,
        "parameter": name,
        "value": value,
        "standard_error": error,
        "unit": unit,
    }


def residual(fit: str, channel: str, ppm: float, size: float, should: float) -> dict[str, Any]:
    return {
        "fit": fit,
        "method": "rates",
        "run": None,
        "observation": 0,
        "channel": channel,
        "start": 0,
        "stop": 1,
        "rate": 1.0,
        "temperature": None,
        "output": 1.0,
        "residual": size,
        "residual_error": should,
        "residual_ppm": ppm,
        "deviation": None,
    }


def scored(
    parameters: list[dict[str, Any]], residuals: list[dict[str, Any]] | None = None
) -> dict[tuple[str, str], tuple[float | None, float | None, str]]:
    """Value, standard error and unit by channel and metric."""
    made = {
        "calibration": base.rows("calibration", parameters),
        "calibration_residuals": base.rows("calibration_residuals", residuals or []),
    }
    out = score_rate_table.run(made, score_rate_table.Settings(), base.Stand())
    assert violations("metrics", out["metrics"]) == []
    found = {
        (row["channel"], row["name"]): (row["value"], row["standard_error"], row["unit"])
        for row in out["metrics"].to_pylist()
    }
    assert len(found) == out["metrics"].num_rows
    assert {name for _, name in found} <= set(score_rate_table.METRICS)
    return found


def test_a_single_axis_in_the_units_of_data_sheets() -> None:
    found = scored(
        [
            parameter("r", "bias", 2 * DEG / 3600, 0.5 * DEG / 3600, "rad/s"),
            parameter("r", "scale_factor", 1.002, 1e-5),
            parameter("r", "scale_factor_asymmetry", 3e-4, 1e-6),
            parameter("r", "scale_factor_nonlinearity_3", -2e-5, 1e-6),
            parameter("r", "bias_temperature_sensitivity", DEG / 3600, DEG / 36000, "rad/s/K"),
            parameter("r", "scale_factor_temperature_sensitivity", 1e-5, 1e-6, "1/K"),
            parameter("r", "linearity_error", 5e-5),
            parameter("r", "step_scatter", 0.1 * DEG / 3600, None, "rad/s"),
        ]
    )
    expected = {
        "bias": (2.0, 0.5, "deg/h"),
        "scale_factor": (1.002, 1e-5, "1"),
        "scale_factor_error": (2000.0, 10.0, "ppm"),
        "scale_factor_asymmetry": (300.0, 1.0, "ppm"),
        "scale_factor_nonlinearity_3": (-20.0, 1.0, "ppm"),
        "bias_temperature_sensitivity": (1.0, 0.1, "deg/h/K"),
        "scale_factor_temperature_sensitivity": (10.0, 1.0, "ppm/K"),
        "linearity_error": (50.0, None, "ppm"),
        "step_scatter": (0.1, None, "deg/h"),
    }
    assert set(found) == {("r", name) for name in expected}
    for name, (value, error, unit) in expected.items():
        got = found["r", name]
        # rounding of two products
        assert got[0] == pytest.approx(value, rel=1e-9)
        assert got[1] == (None if error is None else pytest.approx(error, rel=1e-9))
        assert got[2] == unit


def test_the_triad_stands_before_the_single_axes() -> None:
    found = scored(
        [
            parameter("", "S11", 1.003, 1e-5),
            parameter("", "bias_p", DEG / 3600, 0.1 * DEG / 3600, "rad/s"),
            parameter("", "scale_factor_p", 1.0031, 1e-5),
            parameter("", "misalignment_pq", 1e-3, 1e-5, "rad"),
            parameter("", "nonorthogonality_pq", 2e-3, 1e-5, "rad"),
            parameter("", "triad_rotation_p", -1e-3, 1e-5, "rad"),
            parameter("", "step_scatter_p", 0.0, None, "rad/s"),
            parameter("p", "bias", 9.0, 1.0, "rad/s"),
            parameter("p", "scale_factor", 9.0, 1.0),
            parameter("p", "scale_factor_asymmetry", 1e-4, 1e-6),
        ]
    )
    arcsec = 1e-3 / DEG * 3600
    assert found["p", "scale_factor"][0] == pytest.approx(1.0031)
    assert found["p", "bias"][0] == pytest.approx(1.0)
    assert found["p", "scale_factor_asymmetry"][0] == pytest.approx(100.0)
    assert found["pq", "misalignment"] == (pytest.approx(arcsec), pytest.approx(arcsec / 100), "arcsec")
    assert found["pq", "nonorthogonality"][0] == pytest.approx(2 * arcsec)
    assert found["p", "triad_rotation"][0] == pytest.approx(-arcsec)
    assert not any("S11" in key for key in found)


def test_what_is_not_determined_has_no_value() -> None:
    found = scored([parameter("", "scale_factor_r", None), parameter("", "misalignment_rp", None)])
    assert found["r", "scale_factor"][0] is None
    assert found["r", "scale_factor_error"][0] is None
    assert found["rp", "misalignment"][0] is None


def test_residuals_are_the_triad_s_where_there_is_one() -> None:
    of_both = [
        residual("single axis", "p", 90.0, 1.0, 1.0),
        residual("triad", "p", 3.0, 1.0, 2.0),
        residual("triad", "p", -4.0, -3.0, 2.0),
        residual("triad", "q", 1.0, 0.0, 0.0),
    ]
    found = scored([], of_both)
    assert found["p", "residual_rms"] == (pytest.approx(np.sqrt(12.5)), None, "ppm")
    assert found["p", "largest_residual"][0] == pytest.approx(4.0)
    assert found["p", "normalised_residual"] == (pytest.approx(np.sqrt((0.25 + 2.25) / 2)), None, "1")
    assert found["q", "normalised_residual"][0] is None
    assert found["q", "residual_rms"][0] == 1.0
    alone = scored([], of_both[:1])
    assert alone["p", "largest_residual"][0] == 90.0


def test_without_observations_there_are_no_figures() -> None:
    assert scored([]) == {}
