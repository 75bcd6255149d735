"""Calibrations of gyros as tables and as files: what the tests of their file and of their use share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.models.rate_table_model import Terms
from pipeline.models.rate_table_triad_model import triad_names
from pipeline.stages._calibration_file import text_of
from pipeline.stages.base import rows

Float = NDArray[np.float64]

S = np.array([[1.003, 0.002, -0.001], [0.0015, 0.998, 0.0025], [-0.002, 0.0005, 1.001]])
BIAS = np.array([2e-4, -3e-4, 5e-4])
WARM = np.array([1e-6, -2e-6, 3e-6])
T0 = 293.15
WARMTH = (-5.0, 20.0)
"""Between which it was calibrated, about `T0` [K]."""
TRIAD = (*(f"S{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), *(f"bias_{c}" for c in "pqr"))
TRIAD_WARM = (*TRIAD, *(f"bias_temperature_sensitivity_{c}" for c in "pqr"))
BENT = Terms(asymmetry=True, nonlinearity=(3,), scale_factor_temperature=True)
OWN = np.array([[2e-4, -1e-4, 3e-4], [1.5e-4, -2e-4, 1e-4], [3e-5, -2e-5, 5e-5]])
"""Of `BENT`, for p, q and r."""
TERMS = Terms(asymmetry=True, nonlinearity=(3,), bias_temperature=True, scale_factor_temperature=True)
AXIS = np.array([3e-4, 1.002, 200e-6, 150e-6, 1e-6, 5e-5])
"""Of `TERMS`, in their order."""
LARGEST = 2.0
PROVENANCE = {
    "recording_name": "table.mcap",
    "recording_sha256": "ab" * 32,
    "plan_sha256": "cd" * 32,
    "made_with": "gyrostand 1.2.3",
}


def covariance_of(size: Float, seed: int = 0) -> Float:
    """A covariance whose standard errors are a millionth of the given sizes, with correlations."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((len(size), 3 * len(size)))
    C = A @ A.T
    deviation = np.sqrt(np.diag(C))
    return C / np.outer(deviation, deviation) * np.outer(1e-6 * size, 1e-6 * size)


def unit(name: str) -> str:
    if name.startswith("bias_temperature"):
        return "rad/s/K"
    if name.startswith("bias"):
        return "rad/s"
    return "1/K" if "temperature" in name else "1"


def tables_of(
    gyro: str,
    names: tuple[str, ...],
    value: Float,
    covariance: Float,
    *,
    states: Mapping[str, str] | None = None,
) -> tuple[pa.Table, pa.Table]:
    """The tables ``calibration`` and ``calibration_covariance``, with a derived row that is for people."""
    thermal = any("temperature" in name for name in names)
    common: dict[str, Any] = {"method": "rates", "gyro": gyro, "largest_rate": LARGEST}
    low, high = WARMTH
    temperatures = {"reference": T0, "lowest": T0 + low, "highest": T0 + high}
    common |= {f"{key}_temperature": value if thermal else None for key, value in temperatures.items()}
    parameters: list[dict[str, Any]] = [
        {
            **common,
            "parameter": name,
            "value": None if state == "undetermined" else float(one),
            "standard_error": None if state == "undetermined" else float(np.sqrt(covariance[k, k])),
            "unit": unit(name),
            "state": state,
            "role": "model",
        }
        for k, (name, one) in enumerate(zip(names, value, strict=True))
        for state in [(states or {}).get(name, "determined")]
    ]
    derived = {"parameter": "step_scatter", "value": 1e-9, "standard_error": None, "unit": "rad/s"}
    parameters.append({**common, **derived, "state": "determined", "role": "derived"})
    products = [
        {
            "gyro": gyro,
            "row": a,
            "column": b,
            "value": float(covariance[j, k]),
            "unit": f"{unit(a)} {unit(b)}",
        }
        for j, a in enumerate(names)
        for k, b in enumerate(names)
    ]
    return rows("calibration", parameters), rows("calibration_covariance", products)


def triad_tables(*, warm: bool = False, **more: Any) -> tuple[pa.Table, pa.Table]:
    value = np.concatenate([S.ravel(), BIAS, WARM if warm else []])
    covariance = covariance_of(np.abs(value))
    return tables_of("", TRIAD_WARM if warm else TRIAD, value, covariance, **more)


def triad_text(*, warm: bool = False, **more: Any) -> str:
    return text_of("table", *triad_tables(warm=warm, **more), PROVENANCE)


def bent_text() -> str:
    """A triad whose gyros have terms of their own."""
    value = np.concatenate([S.ravel(), BIAS, OWN.ravel()])
    names = triad_names(BENT, "pqr")
    return text_of("table", *tables_of("", names, value, covariance_of(np.abs(value))), PROVENANCE)


def bent_output(rate: Float, warmth: Float) -> Float:
    """What the gyros of `bent_text` give, by the formula of the standards; shapes (n, 3) and (n,)."""
    K = np.linalg.norm(S, axis=1)
    w = rate @ (S / K[:, np.newaxis]).T
    a, c, e = OWN
    braces = w + a * np.abs(w) / 2 + c * LARGEST * (w / LARGEST) ** 3 + e * warmth[:, np.newaxis] * w
    return np.asarray(K * braces + BIAS, dtype=np.float64)


def axis_tables(gyro: str = "q") -> tuple[pa.Table, pa.Table]:
    return tables_of(gyro, TERMS.names, AXIS, covariance_of(np.abs(AXIS)))


def axis_text(gyro: str = "q") -> str:
    return text_of("single", *axis_tables(gyro), PROVENANCE)


def axis_output(rate: Float, temperature: Float) -> Float:
    """What the gyro of `axis_text` gives, by the formula of the standards."""
    b, K, a, c, d, e = AXIS
    braces = rate + a * np.abs(rate) / 2 + c * LARGEST * (rate / LARGEST) ** 3 + e * (temperature - T0) * rate
    return np.asarray(K * braces + b + d * (temperature - T0), dtype=np.float64)
