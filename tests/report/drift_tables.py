"""Tables of a drift run as its stages would leave them: two runs of one gyro, made from the linear model.

Estimates are the truth plus an error drawn from the covariance that the record gives; predictions are the
noise-free trajectory. So everything is as large as in earnest, and no stage is needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from report_tables import START, finding, from_rows, metric, provenance

from pipeline import contracts
from pipeline.models.earth import RATE, Base, Scheme, mounting_angles
from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, PARAMETERS, TILT, linear_model, misalignment_basis

LATITUDE = np.deg2rad(55.75)
DEG_H = np.rad2deg(RATE) * 3600
ARCSEC = np.pi / 180 / 3600
SIGMA = ARCSEC
TRUTH = np.array([0.010, -0.007, 0.005, 0.003, -0.002, 0.004, 2.9e-3, -1.5e-3])
EPSILON = np.array([3e-4, -2e-4])  # of each run, across u
PRIORS = {**dict.fromkeys(DRIFT, 0.1), **dict.fromkeys(TILT, 15 * 60 * ARCSEC)}
PRIOR_MISALIGNMENT = 1.5 * 60 * ARCSEC
USEFUL = (0.01 / DEG_H, 60 * ARCSEC)  # standard errors of a drift and an angle that are just useful
METHODS = ("cumulative", "gauss_newton", "segments", "filter", "smoother", "transient")
OUTLIERS = (100, 101, 333)

Float = np.ndarray
Key = tuple[str, int | None]


@dataclass(frozen=True)
class Run:
    """A run: its times [ns], noise-free and measured angles, and the columns of its regression."""

    number: int
    scheme: Scheme
    time: Float
    true: Float
    measured: Float
    rows: Float


def simulated(number: int, scheme: Scheme, start: Sequence[float], hours: float, step: float) -> Run:
    """A run by the linear model, by Runge and Kutta: good to far less than the noise."""
    base = Base.mounted(scheme, LATITUDE)
    B = misalignment_basis(base)
    p = np.concatenate([TRUTH, B @ EPSILON])
    n, h = round(hours * 3600 / step) + 1, step * RATE
    coarse = max(1, round(60 / step))  # the integration is at 1 min
    alpha = [np.array(start, dtype=np.float64)]

    def rate(a: Float) -> Float:
        c, F = linear_model(a[np.newaxis], base)
        return (c + F @ p)[0]

    for _ in range(-(-n // coarse)):
        a, H = alpha[-1], h * coarse
        k1 = rate(a)
        k2 = rate(a + H / 2 * k1)
        k3 = rate(a + H / 2 * k2)
        alpha.append(a + H / 6 * (k1 + 2 * k2 + 2 * k3 + rate(a + H * k3)))
    knots = np.arange(len(alpha)) * coarse
    true = np.column_stack([np.interp(np.arange(n), knots, a) for a in np.array(alpha).T])
    _, F = linear_model(true, base)
    Q = np.zeros((11, 10))
    Q[:8, :8], Q[8:, 8:] = np.eye(8), B
    rows = np.concatenate([np.zeros((1, 2, 10)), np.cumsum((F[1:] + F[:-1]) / 2 * h, axis=0) @ Q])
    rows -= rows.mean(axis=0)  # the initial angles are free
    rng = np.random.default_rng(number)
    measured = true + SIGMA * rng.standard_normal((n, 2))
    measured[[i for i in OUTLIERS if i < n]] += 20 * SIGMA
    time = START + number * 10**15 + np.round(np.arange(n) * step * 1e9).astype(np.int64)
    return Run(number, scheme, time, true, measured, rows)


def two_runs(step: float = 60.0) -> list[Run]:
    return [
        simulated(0, "polar", (0.02, -0.01), 24.0, step),
        simulated(1, "vertical", (0.5, -0.4), 12.0, step),
    ]


def design(runs: Sequence[Run], until: Sequence[float] | None = None) -> tuple[list[Key], Float, Float]:
    """Parameters, Q from free ones to all of them, rows of unit variance up to a share of each run."""
    shares = [1.0] * len(runs) if until is None else until
    keys: list[Key] = [(name, None) for name in (*DRIFT, *TILT)]
    keys += [(name, run.number) for run in runs for name in MISALIGNMENT]
    k = 8 + 2 * len(runs)
    Q = np.zeros((len(keys), k))
    Q[:8, :8] = np.eye(8)
    parts = []
    for i, (run, share) in enumerate(zip(runs, shares, strict=True)):
        B = misalignment_basis(Base.mounted(run.scheme, LATITUDE))
        Q[8 + 3 * i : 11 + 3 * i, 8 + 2 * i : 10 + 2 * i] = B
        part = np.zeros((round(share * len(run.rows)), 2, k))
        part[..., :8] = run.rows[: len(part), :, :8]
        part[..., 8 + 2 * i : 10 + 2 * i] = run.rows[: len(part), :, 8:]
        parts.append(part.reshape(-1, k))
    return keys, Q, np.concatenate(parts) / SIGMA


def prior(key: Key) -> float:
    return PRIORS.get(key[0], PRIOR_MISALIGNMENT)


def covariance(rows: Float, keys: Sequence[Key], Q: Float) -> Float:
    """With the priors."""
    weights = np.array([prior(key) for key in keys])
    information = rows.T @ rows + Q.T @ np.diag(weights**-2.0) @ Q
    return Q @ np.linalg.inv(information) @ Q.T


def truth(runs: Sequence[Run]) -> Float:
    _, Q, _ = design(runs)
    return Q @ np.concatenate([TRUTH, *[EPSILON for _ in runs]])


def make_drift_tables(runs: Sequence[Run] | None = None, text: str = "") -> dict[str, pa.Table]:
    """All tables; ``text`` is put into every text that a recording or its plan can bring."""
    runs = two_runs() if runs is None else runs
    keys, Q, rows = design(runs)
    C = covariance(rows, keys, Q)
    weights = np.where(np.arange(rows.shape[1]) < len(DRIFT), USEFUL[0], USEFUL[1])
    _, singular, Vt = np.linalg.svd(np.linalg.qr(rows * weights, mode="r"))
    states = state_of(keys, C)
    return {
        "runs": from_rows("runs", [run_row(run, text) for run in runs]),
        "trajectory": pa.concat_tables(trajectory(run) for run in runs),
        "residuals": pa.concat_tables(residuals(runs)),
        "drift_parameters": from_rows("drift_parameters", parameters(runs, keys, C, states)),
        "drift_estimates": from_rows("drift_estimates", estimates(runs, keys)),
        "observability": from_rows("observability", observability(keys, Q, singular, Vt)),
        "combinations": from_rows("combinations", combinations()),
        "correlation": from_rows("correlation", correlation(keys, C)),
        "further_runs": from_rows("further_runs", further_runs(keys, C, states)),
        "findings": from_rows(
            "findings", [finding(f"outlier{text}", "info", 6000.0, 6060.0, stream="gimbal")]
        ),
        "metrics": from_rows(
            "metrics",
            [
                metric(
                    "residual_rms",
                    "alpha1",
                    SIGMA,
                    unit="rad",
                    upper_limit=2 * SIGMA,
                    verdict="pass",
                    procedure="drift",
                )
            ],
        ),
        "provenance": drift_provenance(text),
    }


def drift_provenance(text: str = "") -> pa.Table:
    (row,) = provenance(text).to_pylist()
    return from_rows("provenance", [row | {"procedure": "drift"}])


def run_row(run: Run, text: str) -> dict[str, Any]:
    chi = mounting_angles(run.scheme, LATITUDE)
    angles = {f"chi{i + 1}": angle for i, angle in enumerate(chi)}
    named = {"run": run.number, "name": f"stand {run.number}{text}", "scheme": run.scheme}
    return {**named, "latitude": LATITUDE, **angles}


def trajectory(run: Run) -> pa.Table:
    number = np.full(len(run.time), run.number, np.int32)
    angles = {f"alpha{i + 1}": run.measured[:, i] for i in range(2)}
    measured = np.ones(len(run.time), np.bool_)
    return contracts.table(
        "trajectory", {"run": number, "arc": number, "time": run.time, **angles, "measured": measured}
    )


def residuals(runs: Sequence[Run]) -> Iterable[pa.Table]:
    for method in METHODS:
        for run in runs:
            yield residual_table(run, method, 0, 0.0, "used")
    for run in runs:
        yield residual_table(run, "gauss_newton", round(0.7 * len(run.time)), 3 * SIGMA, "held out")
    biased = residual_table(runs[0], "spiral", 0, 200 * SIGMA, "used")
    yield biased


def residual_table(run: Run, method: str, first: int, bias: float, state: str) -> pa.Table:
    """The rows of a run from a sample on; the prediction grows wrong by ``bias`` to its end."""
    n = len(run.time) - first
    wrong = bias * np.linspace(0, 1, n)[:, np.newaxis] * np.array([1.0, -0.6])
    predicted = run.true[first:] + wrong
    residual = run.measured[first:] - predicted
    marked = np.isin(np.arange(first, len(run.time)), OUTLIERS)
    number = np.full(n, run.number, np.int32)
    columns = {
        f"{name}{i + 1}": v[:, i]
        for name, v in (("predicted", predicted), ("residual", residual))
        for i in (0, 1)
    }
    fixed = {"method": [method] * n, "run": number, "arc": number, "time": run.time[first:]}
    return contracts.table("residuals", {**fixed, **columns, "state": np.where(marked, "outlier", state)})


def state_of(keys: Sequence[Key], C: Float) -> dict[Key, str]:
    states = {}
    for key, error in zip(keys, np.sqrt(np.diag(C)), strict=True):
        useful = USEFUL[key[0] not in DRIFT]
        untouched = error > 0.9 * prior(key)  # the record has hardly told more than was known
        states[key] = "determined" if error <= useful else "undetermined" if untouched else "combined"
    return states


def parameters(
    runs: Sequence[Run], keys: Sequence[Key], C: Float, states: dict[Key, str]
) -> list[dict[str, Any]]:
    rng = np.random.default_rng(7)
    eigenvalues, V = np.linalg.eigh(C)  # C is singular: u.epsilon = 0
    root, p = V * np.sqrt(np.maximum(eigenvalues, 0.0)), truth(runs)
    rows = []
    for method, worse in zip(METHODS, (1.0, 1.0, 6.0, 1.0, 1.0, 40.0), strict=True):
        value = p + root @ rng.standard_normal(len(p)) * (1.0 if worse == 1.0 else 0.7 * worse)
        error = np.sqrt(np.diag(C)) * worse
        rows += [
            parameter_row(method, k, v, e, states[k]) for k, v, e in zip(keys, value, error, strict=True)
        ]
    for name, v in zip(DRIFT, p, strict=False):
        rows.append(parameter_row("transient", (f"{name}_0", None), v + 0.04, 3e-3, "determined"))
        error = 1e-5 if name.startswith("m1") else 4e-5
        rows.append(parameter_row("spiral_six", (name, None), v * 1.1 + 5e-4, error, "determined"))
        given = name.startswith("mc")
        rows.append(
            parameter_row(
                "spiral_mc_known", (name, None), v if given else v * 1.2, 0.0 if given else 2e-5,
                "given" if given else "determined",
            )
        )  # fmt: skip
    spiral = {"alpha_c1": -7e-4, "alpha_c2": -2.1e-3, "r": 0.022, "lambda": 9e-4, "nu": 0.9946, "psi": 0.364}
    return rows + [parameter_row("spiral", (name, 0), v, 1e-6, "determined") for name, v in spiral.items()]


def parameter_row(method: str, key: Key, value: float, error: float, state: str) -> dict[str, Any]:
    name, run = key
    drift = name.removesuffix("_0") in DRIFT
    return {
        "method": method,
        "run": run,
        "parameter": name,
        "value": value,
        "standard_error": error,
        "unit": "1" if drift or name in ("lambda", "nu") else "rad",
        "drift": value * DEG_H if drift else None,
        "drift_standard_error": error * DEG_H if drift else None,
        "prior": prior(key) if name in PARAMETERS and state != "given" else None,
        "state": state,
    }


def estimates(runs: Sequence[Run], keys: Sequence[Key], instants: int = 60) -> list[dict[str, Any]]:
    """A filter's history by the information up to each instant, and a smoother's that is constant."""
    rng = np.random.default_rng(11)
    p = truth(runs)
    whole = covariance(design(runs)[2], keys, design(runs)[1])
    draw = rng.standard_normal(len(p))
    rows = []
    for r, run in enumerate(runs):
        for part in np.linspace(1 / instants, 1, instants):
            shares = [1.0] * r + [part] + [0.0] * (len(runs) - r - 1)
            _, Q, A = design(runs, shares)
            time = int(run.time[round(part * (len(run.time) - 1))])
            for method, C in (("filter", covariance(A, keys, Q)), ("smoother", whole)):
                error = np.sqrt(np.diag(C))
                for (name, of), v, e, z in zip(keys, p, error, draw, strict=True):
                    if of is not None and of > run.number:
                        continue
                    rows.append(
                        {
                            "method": method, "time": time, "run": of, "parameter": name, "value": v + e * z,
                            "standard_error": e, "unit": "1" if name in DRIFT else "rad",
                        }
                    )  # fmt: skip
    return sorted(rows, key=lambda row: row["method"])  # stable: by method, then in time


def observability(keys: Sequence[Key], Q: Float, singular: Float, Vt: Float) -> list[dict[str, Any]]:
    rows = []
    for i, s in enumerate(singular):
        # 1e-12: rounding, beside which the columns of theta in the equatorial scheme are exactly zero
        state = "determined" if s >= 1 else "weak" if s > 1e-12 * singular[0] else "null"
        vector = Q @ Vt[i]
        for (name, run), component in zip(keys, vector / np.linalg.norm(vector), strict=True):
            rows.append(
                {
                    "direction": i, "singular_value": s,
                    "standard_deviation": None if state == "null" else 1 / s, "state": state,
                    "run": run, "parameter": name, "component": component,
                }
            )  # fmt: skip
    return rows


def combinations() -> list[dict[str, Any]]:
    terms = {
        "mc1 - theta1 - epsilon2": ((("mc1", None), 1.0), (("theta1", None), -1.0), (("epsilon2", 0), -1.0)),
        "mc2 - theta2 + epsilon1": ((("mc2", None), 1.0), (("theta2", None), -1.0), (("epsilon1", 0), 1.0)),
    }
    return [
        {
            "combination": i, "expression": expression, "value": -0.00412 + 0.01 * i,
            "standard_error": 3.1e-7, "run": run, "parameter": name, "coefficient": coefficient,
        }
        for i, (expression, parts) in enumerate(terms.items())
        for (name, run), coefficient in parts
    ]  # fmt: skip


def correlation(keys: Sequence[Key], C: Float) -> list[dict[str, Any]]:
    error = np.sqrt(np.diag(C))
    R = np.clip(C / np.outer(error, error), -1, 1)
    return [
        {
            "method": "gauss_newton", "run_a": a[1], "parameter_a": a[0], "run_b": b[1], "parameter_b": b[0],
            "correlation": R[i, j],
        }
        for i, a in enumerate(keys)
        for j, b in enumerate(keys)
        if i < j
    ]  # fmt: skip


def further_runs(keys: Sequence[Key], C: Float, states: dict[Key, str]) -> list[dict[str, Any]]:
    error = np.sqrt(np.diag(C))
    rows = []
    for rank, (scheme, start, gain) in enumerate(
        (("horizontal", (0.0, 0.6), 30.0), ("vertical", (0.5, -0.5), 12.0), ("equatorial", (0.0, 0.8), 2.0))
    ):
        for key, e in zip(keys, error, strict=True):
            told = e / gain <= USEFUL[key[0] not in DRIFT]
            rows.append(
                {
                    "rank": rank, "scheme": scheme, "alpha1": start[0], "alpha2": start[1],
                    "duration": 12 * 3600.0, "run": key[1], "parameter": key[0],
                    "unit": "1" if key[0] in DRIFT else "rad",
                    "standard_error_now": None if states[key] == "undetermined" else e,
                    "standard_error_then": e / gain if told else None, "determined": told,
                }
            )  # fmt: skip
    return rows
