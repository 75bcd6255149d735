"""Tables of a gyro on a rate table as its stages would leave them, made from the model alone.

Three runs, one about each axis of the case, each up and down a staircase of rates; the scatter of the steps
is drawn once, and the estimates are the truth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from report_tables import finding, from_rows, metric, provenance, raw, stamps

Float = np.ndarray

DEG = np.pi / 180
CHANNELS = ("p", "q", "r")
RATES = DEG * np.array([-100.0, -50.0, 0.0, 50.0, 100.0, 50.0, 0.0, -50.0, -100.0])
FULL_SCALE = float(np.abs(RATES).max())
DWELL, PAUSE = 20.0, 300.0  # s, of a step, and from run to run
LENGTH = DWELL * len(RATES)
S = np.array([[1.001, 0.001, -0.002], [0.0005, 1.0, 0.001], [0.0, 0.0, 0.998]])
BIAS = DEG / 3600 * np.array([20.0, -5.0, 8.0])
S_ERROR, BIAS_ERROR, STEP_ERROR = 5e-6, 1e-6, 8e-6
ASYMMETRY, QUADRATIC, CUBIC = 120e-6, 60e-6, -40e-6
OFFSET = 0.0131  # s
TEMPERATURE = 293.15  # K, of the first step; each is warmer by a kelvin


def make_rate_table_tables(runs: str = "pqr", text: str = "", *, triad: bool = True) -> dict[str, pa.Table]:
    """All tables of runs about some axes; ``text`` is put into every text that a recording can bring.

    Without ``triad`` each gyro is calibrated by its own axis alone.
    """
    names = [f"{axis}{text}" for axis in runs]
    return {
        "gyro": pa.concat_tables(gyro(number, axis) for number, axis in enumerate(runs)),
        "turntable": pa.concat_tables(turntable(number) for number in range(len(runs))),
        "mountings": from_rows("mountings", [mounting(k, names[k], axis) for k, axis in enumerate(runs)]),
        "rate_steps": from_rows("rate_steps", [row for k, axis in enumerate(runs) for row in steps(k, axis)]),
        "calibration": from_rows("calibration", [*(triad_rows() if triad else ()), *axis_rows(runs, triad)]),
        "calibration_covariance": from_rows("calibration_covariance", covariance() if triad else []),
        "calibration_residuals": from_rows("calibration_residuals", residuals(runs, triad)),
        "findings": from_rows("findings", [finding(f"scatter{text}", "info", None, None)]),
        "metrics": from_rows("metrics", [row for name in names for row in clock(name)]),
        "provenance": rate_table_provenance(text),
    }


def make_turn_tables() -> dict[str, pa.Table]:
    """A triad turned by hand about p alone, without runs and without a table."""
    time = np.arange(0.0, 60.0, 0.1)
    rows = []
    for place, (start, stop, rate) in enumerate([(0, 20, 0.0), (20, 40, 0.3), (40, 60, 0.0)]):
        for channel in CHANNELS:
            error = 0.0 if rate else STEP_ERROR
            row = residual_row(
                "triad", None, place, channel, start, stop, rate if channel == "p" else 0.0, error
            )
            rows.append(row | {"method": "turns", "temperature": None})
    told = [
        row if row["parameter"] in ("S11", "S21", "S31", "bias_p", "bias_q", "bias_r") else untold(row)
        for row in triad_rows("turns")
    ]
    return {
        "gyro": raw("gyro", time, {c: np.where((time > 20) & (time < 40), 0.3, 0.0) for c in CHANNELS}),
        "calibration": from_rows("calibration", told),
        "calibration_covariance": from_rows("calibration_covariance", []),
        "calibration_residuals": from_rows("calibration_residuals", rows),
        "findings": from_rows("findings", []),
        "metrics": from_rows("metrics", [metric("step_count", "", 0, stage="steps")]),
        "provenance": rate_table_provenance(),
    }


def rate_table_provenance(text: str = "") -> pa.Table:
    (row,) = provenance(text).to_pylist()
    return from_rows("provenance", [row | {"procedure": "rate_table"}])


def begin(run: int) -> float:
    """Of a run [s]."""
    return run * (LENGTH + PAUSE)


def rate_at(seconds: Float) -> Float:
    """Of the table, from a run's start [rad/s]."""
    return RATES[np.minimum((seconds // DWELL).astype(int), len(RATES) - 1)]


def gyro(run: int, axis: str) -> pa.Table:
    seconds = np.arange(0.0, LENGTH, 0.25)
    output = np.outer(rate_at(seconds), S[:, CHANNELS.index(axis)]) + BIAS
    columns = {"run": np.full(len(seconds), run, np.int32), **dict(zip(CHANNELS, output.T, strict=True))}
    return raw("gyro", begin(run) + seconds, columns)


def turntable(run: int) -> pa.Table:
    seconds = np.arange(0.0, LENGTH, 0.25)
    angle = np.append(0.0, np.cumsum(rate_at(seconds)[:-1]) * 0.25)
    columns = {"run": np.full(len(seconds), run, np.int32), "angle": angle}
    return raw("turntable", begin(run) + seconds, columns)


def mounting(run: int, name: str, axis: str) -> dict[str, Any]:
    along = {f"axis_{i}": float(CHANNELS[i - 1] == axis) for i in (1, 2, 3)}
    return {"run": run, "name": name, **along, **{f"across_{i}": None for i in (1, 2, 3)}}


def ends(run: int, step: int) -> tuple[float, float]:
    return begin(run) + step * DWELL + 1, begin(run) + (step + 1) * DWELL


def steps(run: int, axis: str) -> list[dict[str, Any]]:
    rows = []
    for step, rate in enumerate(RATES):
        start, stop = (int(t) for t in stamps(np.array(ends(run, step))))
        output = S[:, CHANNELS.index(axis)] * rate + BIAS
        rows += [
            {
                "run": run, "step": step, "channel": channel, "start": start, "stop": stop, "rate": rate,
                "cosine": None, "sine": None, "output": output[i], "standard_error": STEP_ERROR,
                "temperature": TEMPERATURE + step,
            }
            for i, channel in enumerate(CHANNELS)
        ]  # fmt: skip
    return rows


def calibration_row(parameter: str, value: float, error: float | None, **other: Any) -> dict[str, Any]:
    fixed = {"method": "rates", "gyro": "", "unit": "1", "state": "determined", "role": "model"}
    place = dict.fromkeys(("reference_temperature", "lowest_temperature", "highest_temperature"))
    place |= {"largest_rate": FULL_SCALE}
    return fixed | place | {"parameter": parameter, "value": value, "standard_error": error} | other


def untold(row: dict[str, Any]) -> dict[str, Any]:
    return row | {"value": None, "standard_error": None, "state": "undetermined"}


def triad_rows(method: str = "rates") -> list[dict[str, Any]]:
    """S, the biases, and the same in other terms."""
    rows = [calibration_row(f"S{i + 1}{j + 1}", S[i, j], S_ERROR) for i in range(3) for j in range(3)]
    rows += [
        calibration_row(f"bias_{c}", b, BIAS_ERROR, unit="rad/s") for c, b in zip(CHANNELS, BIAS, strict=True)
    ]
    K = np.linalg.norm(S, axis=1)
    n = S / K[:, np.newaxis]
    other = {f"scale_factor_{c}": (K[i], "1") for i, c in enumerate(CHANNELS)}
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    other |= {f"misalignment_{CHANNELS[i]}{CHANNELS[j]}": (n[i, j], "rad") for i, j in pairs}
    other |= {
        f"nonorthogonality_{CHANNELS[i]}{CHANNELS[j]}": (np.arcsin(n[i] @ n[j]), "rad")
        for i, j in pairs
        if i < j
    }
    other |= {f"triad_rotation_{c}": (1e-4, "rad") for c in CHANNELS}
    rows += [calibration_row(k, v, S_ERROR, unit=u, role="derived") for k, (v, u) in other.items()]
    return [row | {"method": method} for row in rows]


def axis_rows(runs: str, beside_triad: bool) -> list[dict[str, Any]]:
    role = "derived" if beside_triad else "model"
    rows = []
    for axis in dict.fromkeys(runs):
        i = CHANNELS.index(axis)
        for name, value, unit in (
            ("bias", BIAS[i], "rad/s"),
            ("scale_factor", S[i, i], "1"),
            ("scale_factor_asymmetry", ASYMMETRY, "1"),
            ("scale_factor_nonlinearity_2", QUADRATIC, "1"),
            ("scale_factor_nonlinearity_3", CUBIC, "1"),
        ):
            rows.append(calibration_row(name, value, 5e-6, unit=unit, gyro=axis, role=role))
        rows.append(calibration_row("linearity_error", 90e-6, None, gyro=axis, role="derived"))
    return rows


def covariance() -> list[dict[str, Any]]:
    """Of S alone, independent errors but for one pair."""
    names = [f"S{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    return [
        {"gyro": "", "row": a, "column": b, "value": S_ERROR**2 * share, "unit": "1"}
        for a in names
        for b in names
        for share in [1.0 if a == b else 0.5 if {a, b} == {"S12", "S13"} else 0.0]
    ]


def bent(rate: Float, axis: int) -> Float:
    """Output of one gyro by its own model [rad/s]."""
    share = rate / FULL_SCALE
    more = ASYMMETRY * np.abs(rate) / 2 + FULL_SCALE * (QUADRATIC * share**2 + CUBIC * share**3)
    return S[axis, axis] * (rate + more) + BIAS[axis]


def residual_row(
    fit: str, run: int | None, place: int, channel: str, start: float, stop: float, rate: float, error: float
) -> dict[str, Any]:
    """Of a residual that is drawn by its place."""
    rng = np.random.default_rng([place, CHANNELS.index(channel), 0 if run is None else run])
    residual = error * rng.standard_normal()
    first, last = (int(t) for t in stamps(np.array([start, stop], dtype=float)))
    scale = S[CHANNELS.index(channel), CHANNELS.index(channel)] * FULL_SCALE
    return {
        "fit": fit, "method": "rates", "run": run, "observation": place, "channel": channel, "start": first,
        "stop": last, "rate": rate, "temperature": TEMPERATURE + place % len(RATES),
        "output": rate + residual, "residual": residual, "residual_error": error,
        "residual_ppm": 1e6 * residual / scale, "deviation": None,
    }  # fmt: skip


def residuals(runs: str, triad: bool) -> list[dict[str, Any]]:
    rows = []
    for run, axis in enumerate(runs):
        for step, rate in enumerate(RATES):
            for channel in CHANNELS if triad else ():
                input_ = rate if channel == axis else 0.0
                place = run * len(RATES) + step
                rows.append(residual_row("triad", run, place, channel, *ends(run, step), input_, STEP_ERROR))
    for run, axis in enumerate(runs):
        mine = [
            residual_row("single axis", run, step, axis, *ends(run, step), rate, STEP_ERROR)
            for step, rate in enumerate(RATES)
        ]
        output = bent(RATES, CHANNELS.index(axis)) + [row["residual"] for row in mine]
        line = np.polyval(np.polyfit(RATES, output, 1), RATES)
        for row, value, straight in zip(mine, output, line, strict=True):
            rows.append(row | {"output": value, "deviation": value - straight})
    return rows


def clock(name: str) -> list[dict[str, Any]]:
    return [
        metric("step_count", name, len(RATES), stage="steps"),
        metric("time_offset", name, OFFSET, stage="steps", unit="s", standard_error=6e-6),
    ]
