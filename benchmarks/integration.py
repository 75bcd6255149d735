"""Speed and accuracy of the way from rate samples to attitude, beside pyins and SciPy.

A 1° cone at 20 Hz, its rates sampled at 1 kHz without error.

quaternion
    Local cubic, exact increments, quaternions; "to angles" converts them to Euler-Krylov angles besides.
Euler-Krylov
    Local cubic, exact increments, equations (1.1).
pyins complete
    ``compute_increments_from_imu`` and ``Integrator.integrate`` as its user calls them. Besides the attitude
    they integrate velocity and position over the rotating Earth, which cannot be left out.
pyins attitude only
    Its coning formula on the gyro columns alone, then its own compiled ``mat_from_rotvec`` and a matrix
    product a step: no Earth, no velocity, no angles, no pandas.
solve_ivp
    Equations (1.1) with SciPy's cubic spline of the rates, RK45, rtol 1e-8, on a slice of the record, scaled
    by the sample. SciPy bounds the error by atol + rtol |x|; psi and theta reach 0.017 rad, so from atol
    1e-10 on it is rtol that counts, and that one is the peer. Greater ones ask for less: they are timed and
    their errors given beside ours, so that who wants to can compare at equal error.
bare product
    The running product of given quaternions, one after the other, compiled in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pandas as pd
from _timing import Candidate, Timings, by_turns, machine, show, wants_json
from numpy.typing import NDArray
from pyins import strapdown, util
from pyins._numba_integrate import mat_from_rotvec
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from pipeline.models.coning import ConingMotion
from pipeline.numerics._kernels_rotation import quaternion_product
from pipeline.numerics.integration import euler_krylov_along, integrate_euler_krylov, integrate_quaternion
from pipeline.numerics.interpolation import Method, fit
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_euler_krylov,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

Float = NDArray[np.float64]

SAMPLES = 1_000_000
SLICE = 10_000
RATE = 1000.0
ROUNDS = 5
MOTION = ConingMotion(cone_angle=np.radians(1.0), frequency=20.0)
CUBIC = Method("local_polynomial", 3)
TOLERANCES = (1e-6, 1e-8, 1e-10)
"""atol of solve_ivp; the first is SciPy's default."""


def main() -> None:
    as_json = wants_json("speed of the integration of attitude beside pyins and SciPy")
    t = np.arange(SAMPLES) / RATE
    rates = np.asfortranarray(MOTION.rates(t))
    start = quaternion_from_euler_krylov(MOTION.angles(t[:1])[0])
    quaternion, angles = ours_quaternion(t, rates, start), ours_angles(t, rates)
    pyins = pyins_attitude(t, rates, start)
    candidates = {
        "bare product": Candidate(bare_product(rates), SAMPLES),
        "quaternion": Candidate(quaternion, SAMPLES),
        "quaternion to angles": Candidate(lambda: euler_krylov_along(quaternion()), SAMPLES),
        "Euler-Krylov": Candidate(angles, SAMPLES),
        "pyins complete": Candidate(pyins_complete(t, rates), SAMPLES),
        "pyins attitude only": Candidate(pyins, SAMPLES),
    } | {
        scipy_name(atol): Candidate(scipy_angles(t[:SLICE], rates[:SLICE], atol), SLICE)
        for atol in TOLERANCES
    }
    timings = by_turns(candidates, ROUNDS)
    show(
        {
            "machine": machine("numpy", "numba", "scipy", "python-ins"),
            "samples": SAMPLES,
            "ns a sample": {name: timings.nanoseconds(name) for name in candidates},
            "times quicker than its peer": ratios(timings),
            "times the bare product": {name: timings.ratio(name, "bare product") for name in candidates},
            "coning error": coning_errors(t, quaternion(), angles(), pyins()),
            f"largest error of an angle in the first {SLICE} samples [rad]": angle_errors(t, rates),
        },
        as_json,
    )


def ratios(timings: Timings) -> dict[str, float]:
    pairs = [
        ("pyins complete", "quaternion to angles"),
        ("pyins attitude only", "quaternion"),
        *((scipy_name(atol), "Euler-Krylov") for atol in TOLERANCES),
        *((scipy_name(atol), "quaternion to angles") for atol in TOLERANCES),
    ]
    return {f"{quick}, than {slow}": timings.ratio(slow, quick) for slow, quick in pairs}


def ours_quaternion(t: Float, rates: Float, start: Float) -> Callable[[], Float]:
    steps = np.diff(t, prepend=0.0)

    def call() -> Float:
        values, increments = fit(CUBIC, t, rates).sample(t)
        return integrate_quaternion(values, increments, steps, start)

    return call


def ours_angles(t: Float, rates: Float) -> Callable[[], Float]:
    steps, start = np.diff(t, prepend=0.0), MOTION.angles(t[:1])[0]

    def call() -> Float:
        values, increments = fit(CUBIC, t, rates).sample(t)
        return integrate_euler_krylov(values, increments, steps, start, limit=1.5)

    return call


def bare_product(rates: Float) -> Callable[[], object]:
    factors = np.ascontiguousarray(quaternion_from_rotation_vector(rates / RATE).T)
    product = np.empty_like(factors)
    product[:, 0] = [1.0, 0.0, 0.0, 0.0]
    return lambda: running_product(factors, product)


@numba.njit(error_model="numpy")
def running_product(factors: Float, product: Float) -> None:
    """One product after the other, from the first column of ``product`` on: the yardstick."""
    fw, fx, fy, fz = factors[0], factors[1], factors[2], factors[3]
    pw, px, py, pz = product[0], product[1], product[2], product[3]
    w, x, y, z = pw[0], px[0], py[0], pz[0]
    for i in range(1, fw.size):
        w, x, y, z = quaternion_product(w, x, y, z, fw[i], fx[i], fy[i], fz[i])
        pw[i], px[i], py[i], pz[i] = w, x, y, z


def pyins_complete(t: Float, rates: Float) -> Callable[[], Any]:
    readings = np.hstack([rates, np.zeros_like(rates)])
    imu = pd.DataFrame(readings, index=t, columns=[*util.GYRO_COLS, *util.ACCEL_COLS])
    pva = pd.Series(np.zeros(9), index=util.TRAJECTORY_COLS)

    def call() -> Any:
        increments = strapdown.compute_increments_from_imu(imu, "rate")
        return strapdown.Integrator(pva).integrate(increments)

    return call


def pyins_attitude(t: Float, rates: Float, start: Float) -> Callable[[], Float]:
    gyro = np.ascontiguousarray(rates)
    first = matrix_from_quaternion(start)

    def call() -> Float:
        dt = np.diff(t)[:, np.newaxis]
        a, b = gyro[:-1], gyro[1:] - gyro[:-1]
        vectors = (a + 0.5 * b) * dt + np.cross(a, b) * dt**2 / 12  # strapdown.py, sensor_type "rate"
        matrices = np.empty((len(t), 3, 3))
        matrices[0] = first
        multiply_matrices(vectors, matrices)
        return matrices

    return call


@numba.njit(error_model="numpy")
def multiply_matrices(vectors: Float, matrices: Float) -> None:
    """The attitude part of ``pyins._numba_integrate.integrate``."""
    turn = np.empty((3, 3))
    for i in range(len(vectors)):
        mat_from_rotvec(vectors[i], turn)
        np.dot(matrices[i], turn, matrices[i + 1])


def scipy_name(atol: float) -> str:
    return f"solve_ivp, atol {atol:g}"


def scipy_angles(t: Float, rates: Float, atol: float) -> Callable[[], Float]:
    start = MOTION.angles(t[:1])[0]

    def call() -> Float:
        spline = CubicSpline(t, rates)

        def slope(time: float, x: Float) -> list[float]:
            p, q, r = spline(time)
            sine, cosine = np.sin(x[2]), np.cos(x[2])
            across = q * cosine - r * sine
            return [across / np.cos(x[1]), q * sine + r * cosine, p - np.tan(x[1]) * across]

        solution = solve_ivp(slope, (t[0], t[-1]), start, t_eval=t, method="RK45", rtol=1e-8, atol=atol)
        return np.asarray(solution.y.T, dtype=np.float64)

    return call


def coning_errors(t: Float, quaternion: Float, angles: Float, matrices: Float) -> dict[str, float]:
    """Drift about axis 1 left after the whole record [°/h], and how much smaller ours is."""
    truth = MOTION.quaternion(t[-1:])[0]
    last = Rotation.from_matrix(matrices[-1]).as_quat(scalar_first=True)
    ours = drift(truth, quaternion[-1], t[-1])
    peer = drift(truth, last, t[-1])
    return {
        "quaternion [deg/h]": ours,
        "Euler-Krylov [deg/h]": drift(truth, quaternion_from_euler_krylov(angles[-1]), t[-1]),
        "pyins [deg/h]": peer,
        "pyins to quaternion": peer / ours,
    }


def angle_errors(t: Float, rates: Float) -> dict[str, float]:
    """The largest of psi, theta and gamma against the exact motion [rad], interpolation included."""
    t, rates = t[:SLICE], np.asfortranarray(rates[:SLICE])
    truth = MOTION.angles(t)
    start = quaternion_from_euler_krylov(truth[0])
    found = {
        "quaternion to angles": euler_krylov_along(ours_quaternion(t, rates, start)()),
        "Euler-Krylov": ours_angles(t, rates)(),
        **{scipy_name(atol): scipy_angles(t, rates, atol)() for atol in TOLERANCES},
    }
    return {name: float(np.abs(angles - truth).max()) for name, angles in found.items()}


def drift(truth: Float, found: Float, duration: float) -> float:
    apart = rotation_vector_from_quaternion(quaternion_multiply(found, quaternion_conjugate(truth)))
    return float(np.degrees(abs(apart[0])) / duration * 3600)


if __name__ == "__main__":
    main()
