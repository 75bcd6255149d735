"""The correction loops as the papers write them, in plain NumPy: V_b in body axes, C and L uncorrected.

References are integrated beside the system, from fix to fix; attitude reference X. Slow, and of no other use
than to be compared with.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.models import ellipsoid
from pipeline.models.correction_gains import LoopGains
from pipeline.models.navigation_problem import Problem

Float = np.ndarray

SIZES = {
    "L": 3, "V_b": 3, "C": 9, "c_X": 3, "c_V": 3, "c_U": 3, "n": 3, "w": 3,
    "L_ext": 3, "V_ext": 3, "C_ref": 9,
}  # fmt: skip
PLACE = dict(
    zip(SIZES, np.split(np.arange(sum(SIZES.values())), np.cumsum(list(SIZES.values()))[:-1]), strict=True)
)


def _split(x: Float) -> dict[str, Float]:
    parts = {name: x[place] for name, place in PLACE.items()}
    return parts | {"C": parts["C"].reshape(3, 3), "C_ref": parts["C_ref"].reshape(3, 3)}


def _skew(a: Float) -> Float:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def _corrected(s: dict[str, Float], k_LV: float) -> tuple[Float, Float, Float]:
    """C_k, V_kV, V_k."""
    C_k = Rotation.from_rotvec(-s["c_U"]).as_matrix() @ s["C"]
    V_kV = C_k @ s["V_b"] - s["c_V"]
    return C_k, V_kV, V_kV - k_LV * s["c_X"]


def _slope(x: Float, f_m: Float, w_m: Float, gains: LoopGains) -> Float:
    """x' by (2.12) to (2.18) of MATH 4.1."""
    s, g, a = _split(x), gains.gnss, gains.attitude
    C_k, V_kV, V_k = _corrected(s, g.k_LV)
    latitude, _, height = ellipsoid.displaced(s["L"], -s["c_X"])
    w_ie = ellipsoid.earth_rate_ned(latitude)
    w_en = ellipsoid.transport_rate(latitude, height, V_k)
    down = np.array([0.0, 0.0, float(ellipsoid.gravity(latitude, height))])
    meridian, prime = (float(r) for r in ellipsoid.radii(latitude, height))
    d = s["c_V"] + g.k_LV * s["c_X"]
    f, w = f_m - s["n"], w_m - s["w"]
    w_c = w - C_k.T @ (a.K_U * s["c_U"])
    over = np.array([1 / meridian, 1 / (prime * np.cos(latitude)), -1.0])
    dX = ellipsoid.metres_between(s["L_ext"], ellipsoid.displaced(s["L"], -s["c_X"]))
    dU = Rotation.from_matrix(C_k @ s["C_ref"].T).as_rotvec()
    slope = np.empty_like(x)
    slope[PLACE["L"]] = V_k * over
    slope[PLACE["V_b"]] = f - C_k.T @ (g.K * d) + C_k.T @ down - np.cross(w_c + C_k.T @ w_ie, s["V_b"])
    slope[PLACE["C"]] = (s["C"] @ _skew(w_c) - _skew(w_ie + w_en) @ s["C"]).ravel()
    slope[PLACE["c_X"]] = (g.k_L * dX - s["c_X"]) / g.T
    slope[PLACE["c_V"]] = (g.k_V * (V_kV - s["V_ext"]) - s["c_V"]) / g.T_V
    slope[PLACE["c_U"]] = (a.k_U * dU - s["c_U"]) / a.T_U
    slope[PLACE["n"]] = g.k_n * g.K * (C_k.T @ d)
    slope[PLACE["w"]] = a.k_omega * a.K_U * (C_k.T @ s["c_U"])
    slope[PLACE["L_ext"]] = s["V_ext"] * over
    slope[PLACE["V_ext"]] = C_k @ f + down - np.cross(2 * w_ie + w_en, s["V_ext"])
    slope[PLACE["C_ref"]] = (s["C_ref"] @ _skew(w) - _skew(w_ie + w_en) @ s["C_ref"]).ravel()
    return slope


def navigate(problem: Problem, gains: LoopGains) -> dict[str, Float]:
    """By Runge and Kutta's fourth order, a step a sample; fixes at instants of the samples.

    Returns
    -------
    dict
        ``position`` (n + 1, 3), ``velocity``, ``attitude`` as matrices (n + 1, 3, 3), ``gyro_bias``,
        ``accelerometer_bias``, ``c_X``, ``c_V``, ``c_U``.
    """
    start, imu = problem.start, problem.imu
    C = Rotation.from_quat(start.attitude, scalar_first=True).as_matrix()
    x = np.zeros(sum(SIZES.values()))
    x[PLACE["L"]] = x[PLACE["L_ext"]] = start.latitude, start.longitude, start.height
    x[PLACE["C"]] = x[PLACE["C_ref"]] = C.ravel()
    x[PLACE["V_b"]], x[PLACE["V_ext"]] = C.T @ start.velocity, start.velocity
    seen: dict[str, list[Float]] = {
        name: [] for name in
        ("position", "velocity", "attitude", "gyro_bias", "accelerometer_bias", "c_X", "c_V", "c_U")
    }  # fmt: skip
    for i, t in enumerate(imu.time):
        if i:
            h = t - imu.time[i - 1]
            w_m = imu.rotation[i - 1] / h
            # Increments stand in the axes of the step's beginning.
            u = imu.velocity[i - 1] / h
            f_m = u - np.cross(imu.rotation[i - 1], u) / 2
            k1 = _slope(x, f_m, w_m, gains)
            k2 = _slope(x + h / 2 * k1, f_m, w_m, gains)
            k3 = _slope(x + h / 2 * k2, f_m, w_m, gains)
            k4 = _slope(x + h * k3, f_m, w_m, gains)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        for name, place in (("position", "L_ext"), ("velocity", "V_ext"), ("attitude", "C_ref")):
            fixes = problem.aids[name]
            k = np.flatnonzero(np.abs(fixes.time - t) < 1e-6)
            if k.size:
                value = fixes.value[k[0]]
                if name == "attitude":
                    value = Rotation.from_quat(value, scalar_first=True).as_matrix().ravel()
                x[PLACE[place]] = value
        s = _split(x)
        C_k, _, V_k = _corrected(s, gains.gnss.k_LV)
        now = (ellipsoid.displaced(s["L"], -s["c_X"]), V_k, C_k, s["w"], s["n"], s["c_X"], s["c_V"], s["c_U"])
        for name, value in zip(seen, now, strict=True):
            seen[name].append(np.array(value))
    return {name: np.array(values) for name, values in seen.items()}
