"""Tables of a navigated flight as its stages would leave them, made from formulas alone.

A vehicle goes north-east at a steady speed for five minutes; satellites are lost from 100 s to 160 s. Every
method is the truth plus an error that is stated here, with the standard deviation that it says it has; the
poles are the roots of the polynomial of the velocity channel.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from report_tables import finding, from_rows, metric, provenance, raw, stamps

from pipeline import contracts

Float = np.ndarray

DEG = np.pi / 180
LENGTH, STEP = 300.0, 0.5  # s
LOST = (100.0, 160.0)  # s
SPEED, HEIGHT, HEADING = 20.0, 100.0, 45 * DEG  # m/s, m, rad
LATITUDE, LONGITUDE = 58 * DEG, 39 * DEG
MERIDIAN, VERTICAL = 6_381_540.0, 6_393_530.0  # m, radii of curvature there, to some metres
METHODS = ("strapdown", "loops", "filter", "smoother")
GYRO_BIAS, ACCELEROMETER_BIAS = (0.035, -0.015, -0.025), (0.15, -0.15, 0.0)  # deg/s, m/s^2
GAINS = {"T_V": 3.0, "k_V": 3.0, "K": 1.0, "k_n": 0.02}
CIRCLING = 8.0  # s, of the period of the errors
REFUSED = (40, 41)  # of the fixes

NED, AXES, ANGLES = ("north", "east", "down"), ("x", "y", "z"), ("yaw", "pitch", "roll")


def instants() -> Float:
    return np.arange(0.0, LENGTH + STEP / 2, STEP)


def phase(t: Float) -> list[str]:
    return ["outage" if LOST[0] <= s < LOST[1] else "aided" if s < LOST[0] else "reacquired" for s in t]


def in_outage(t: Float) -> Float:
    """Seconds since the satellites were lost; 0 with them."""
    return np.where((t >= LOST[0]) & (t < LOST[1]), t - LOST[0], 0.0)


def size(method: str, t: Float) -> Float:
    """How large the horizontal error of a method is [m]."""
    lost = in_outage(t)
    return {
        "strapdown": 0.01 + 0.1 * t**2,
        "loops": 1.0 + 0.02 * lost**2,
        "filter": 0.5 + 0.002 * lost**2,
        "smoother": np.full_like(t, 0.3),
    }[method]


def errors(method: str, t: Float) -> dict[str, Float]:
    """Errors of position [m], velocity [m/s] and attitude [rad] of a method; their direction goes round."""
    turn = 2 * np.pi * t / CIRCLING
    horizontal = size(method, t)
    round_about = (np.cos(turn), np.sin(turn), np.full_like(t, 0.2))
    found = {f"position_{axis}": horizontal * one for axis, one in zip(NED, round_about, strict=True)}
    found |= {f"velocity_{axis}": 0.1 * horizontal * one for axis, one in zip(NED, round_about, strict=True)}
    found |= {f"phi_{axis}": 0.1 * DEG * horizontal * one for axis, one in zip(NED, round_about, strict=True)}
    return found | {angle: found[f"phi_{axis}"] for angle, axis in zip(ANGLES, reversed(NED), strict=True)}


def sigmas(method: str, t: Float) -> dict[str, Float]:
    """What a method says of its errors; NaN where it says nothing."""
    says = size(method, t) if method in ("filter", "smoother") else np.full_like(t, np.nan)
    scales = {"sigma": 1.0, "sigma_v": 0.1, "sigma_phi": 0.1 * DEG}
    return {f"{name}_{axis}": scale * says for name, scale in scales.items() for axis in NED}


def truth(t: Float) -> dict[str, Float]:
    """Position, velocity and attitude."""
    north, east = (SPEED * t * one for one in (np.cos(HEADING), np.sin(HEADING)))
    return {
        "latitude": LATITUDE + north / MERIDIAN,
        "longitude": LONGITUDE + east / (VERTICAL * np.cos(LATITUDE)),
        "height": np.full_like(t, HEIGHT),
        "north": np.full_like(t, SPEED * np.cos(HEADING)),
        "east": np.full_like(t, SPEED * np.sin(HEADING)),
        "down": np.zeros_like(t),
        "yaw": np.full_like(t, HEADING),
        "pitch": np.full_like(t, 2 * DEG),
        "roll": np.zeros_like(t),
    }


def biases(method: str, t: Float) -> dict[str, Float]:
    """Estimates that go from nothing to the true value; strapdown has none."""
    known = np.zeros_like(t) if method == "strapdown" else 1 - np.exp(-t / 20.0)
    says = np.full_like(t, np.nan) if method in ("strapdown", "loops") else np.exp(-t / 20.0) + 0.01
    found = {}
    for axis, gyro, accelerometer in zip(AXES, GYRO_BIAS, ACCELEROMETER_BIAS, strict=True):
        found[f"gyro_bias_{axis}"] = gyro * DEG * known
        found[f"accelerometer_bias_{axis}"] = accelerometer * known
        found[f"sigma_gyro_bias_{axis}"] = 0.03 * DEG * says
        found[f"sigma_accelerometer_bias_{axis}"] = 0.1 * says
    for name, value in (("wind_north", 4.0), ("wind_east", -3.0), ("barometer_bias", 3.0)):
        found[name] = np.full_like(t, np.nan) if method == "strapdown" else value * known
        found[f"sigma_{name}"] = says
    return found


def navigation(method: str) -> pa.Table:
    t = instants()
    wrong, true = errors(method, t), truth(t)
    columns: dict[str, Any] = {
        "time": stamps(t),
        "method": [method] * len(t),
        "phase": phase(t),
        "latitude": true["latitude"] + wrong["position_north"] / MERIDIAN,
        "longitude": true["longitude"] + wrong["position_east"] / (VERTICAL * np.cos(LATITUDE)),
        "height": true["height"] - wrong["position_down"],
        "coasted": (t >= 50.0) & (t < 51.0),
    }
    columns |= {f"v_{axis}": true[axis] + wrong[f"velocity_{axis}"] for axis in NED}
    columns |= {angle: true[angle] + wrong[angle] for angle in ANGLES}
    columns |= biases(method, t) | sigmas(method, t)
    absent = np.full(len(t), np.nan)
    columns |= {f"c_{letter}_{axis}": absent for letter in "xvu" for axis in NED}
    aided, corrected = np.array(phase(t)) != "outage", np.full(len(t), method != "strapdown")
    columns |= {f"used_{aid}": aided & corrected for aid in ("position", "velocity")}
    columns |= {f"used_{aid}": corrected for aid in ("airspeed", "altitude", "magnetic_field")}
    return contracts.table("navigation", columns | {"used_attitude": np.zeros(len(t), dtype=bool)})


def navigation_errors(method: str) -> pa.Table:
    t = instants()
    common = {"time": stamps(t), "method": [method] * len(t), "phase": phase(t)}
    return contracts.table("navigation_errors", common | errors(method, t) | sigmas(method, t))


def fixes() -> Float:
    """When the satellites measure [s]."""
    t = np.arange(0.0, LENGTH + 0.5)
    return t[np.array(phase(t)) != "outage"]


def innovations() -> pa.Table:
    """Of the filter, standard normal but for two that were refused; of the loops, without a sigma."""
    rng = np.random.default_rng(1)
    t = fixes()
    parts = []
    for method in ("loops", "filter"):
        for aid, names, unit, sigma in (
            ("position", NED, "m", 1.5),
            ("velocity", NED, "m/s", 0.08),
            ("altitude", ("altitude",), "m", 0.5),
        ):
            for name in names:
                ratio = rng.standard_normal(len(t))
                ratio[list(REFUSED)] = (30.0, -4.0) if aid == "position" else ratio[list(REFUSED)]
                accepted = np.ones(len(t), dtype=bool)
                accepted[list(REFUSED)] = aid != "position"
                filtered = method == "filter"
                columns = {
                    "time": stamps(t),
                    "method": [method] * len(t),
                    "aid": [aid] * len(t),
                    "component": [name] * len(t),
                    "value": ratio * sigma,
                    "sigma": np.full(len(t), sigma if filtered else np.nan),
                    "unit": [unit] * len(t),
                    "normalised_squared": ratio**2 if filtered else np.full(len(t), np.nan),
                    "accepted": accepted,
                }
                parts.append(contracts.table("innovations", columns))
    return pa.concat_tables(parts)


def velocity_poles(k_n: float = GAINS["k_n"]) -> Float:
    """Of T s^3 + (1 + k) s^2 + K k s + K k k_n."""
    T, k, K = GAINS["T_V"], GAINS["k_V"], GAINS["K"]
    return np.roots([T, 1 + k, K * k, K * k * k_n])


def pole_rows(loop: str, continuous: Sequence[complex], interval: float) -> list[dict[str, Any]]:
    """Poles in continuous time [1/s], and sampled so often."""
    kinds = (("continuous", "1/s", continuous), ("discrete", "1", np.exp(np.asarray(continuous) * interval)))
    return [
        {"loop": loop, "kind": kind, "real": float(p.real), "imaginary": float(p.imag), "unit": unit}
        for kind, unit, found in kinds
        for p in found
    ]


def loop_rows(loop: str, **figures: tuple[float | None, str]) -> list[dict[str, Any]]:
    return [
        {"loop": loop, "name": name, "value": value, "unit": unit} for name, (value, unit) in figures.items()
    ]


def score() -> list[dict[str, Any]]:
    """Some figures of the score."""
    t = instants()
    found = []
    for method in METHODS:
        for name in ("aided", "outage", "reacquired"):
            mine = size(method, t)[[one == name for one in phase(t)]]
            where = f"{method}.{name}"
            found.append(metric("horizontal_position_rms", where, float(np.sqrt(np.mean(mine**2))), unit="m"))
    found.append(metric("normalised_innovations", "filter.position", 1.2))
    return found


def make_navigation_tables(
    methods: Sequence[str] = METHODS, *, with_truth: bool = True, text: str = ""
) -> dict[str, pa.Table]:
    """All tables; ``text`` is put into every text that a recording or its plan can bring."""
    t, at = np.arange(0.0, LENGTH + 0.5), fixes()
    settings = {"gyro_bias_deg_s": GYRO_BIAS, "accelerometer_bias_m_s2": ACCELEROMETER_BIAS}
    tables = {
        "navigation": pa.concat_tables([navigation(method) for method in methods]),
        "navigation_errors": pa.concat_tables([navigation_errors(m) for m in methods if with_truth])
        if with_truth
        else from_rows("navigation_errors", []),
        "innovations": innovations() if "filter" in methods else from_rows("innovations", []),
        "poles": from_rows("poles", pole_rows("velocity by satellites", velocity_poles(), 1.0)),
        "loops": from_rows(
            "loops", loop_rows("velocity by satellites", k_n=(0.02, "1/s"), k_n_limit=(4 / 3, "1/s"))
        ),
        "gnss_position": raw(
            "gnss_position",
            at,
            {name: truth(at)[name] for name in ("latitude", "longitude", "height")}
            | {"fix": np.full(len(at), np.nan)},
        ),
        "gnss_velocity": raw("gnss_velocity", at, {name: truth(at)[name] for name in NED}),
        "findings": from_rows("findings", [finding(f"gap{text}", "warning", *LOST)]),
        "metrics": from_rows("metrics", [metric(f"duration{text}", "gyro", LENGTH, unit="s"), *score()]),
        "provenance": navigation_provenance(settings, text),
    }
    if with_truth:
        places = {name: truth(t)[name] for name in ("latitude", "longitude", "height")}
        tables["truth_position"] = raw("truth_position", t, places | {"fix": np.full(len(t), np.nan)})
        tables["truth_velocity"] = raw("truth_velocity", t, {name: truth(t)[name] for name in NED})
        tables["truth_attitude"] = raw("truth_attitude", t, {name: truth(t)[name] for name in ANGLES})
    return tables


def navigation_provenance(settings: dict[str, Any], text: str = "") -> pa.Table:
    """Of the first stage and of the score, with its settings."""
    (first,) = provenance(text).to_pylist()
    first |= {"procedure": "navigation"}
    last = first | {"order": 1, "stage": "score_navigation", "settings": json.dumps(settings)}
    return from_rows("provenance", [first, last])
