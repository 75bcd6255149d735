"""Time of the procedure drift: a day at one sample a second through all its methods, and a thousand gyros.

No public tool does either, so there is no peer; the figures are seconds, of CPU and on the clock.

a day at 1 s
    A simulated run of the horizontal scheme, 86,401 samples, MCAP, through the runner: ingest, audit,
    resample, every method of identify with hold-out and advice, score, tables. The second of two runs: the
    first compiles.
a thousand gyros
    Table 3 of Gubarenko & Kuzmenko (1995) as a Monte-Carlo: gyros of random drift with a tilted rotor on a
    misaligned base, a day at 1 min by the exact model, then the regression that ignores the tilt.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from _timing import machine, show, wants_json

from pipeline import runner
from pipeline.models.drift_regression import integrals
from pipeline.models.drift_trajectory import trajectory
from pipeline.models.earth import RATE, Base
from pipeline.models.gyro_drift import Gyro
from pipeline.numerics.least_squares import solve
from pipeline.simulate.drift import simulate_drift
from pipeline.simulate.drift_settings import DriftRun, DriftSettings
from pipeline.simulate.imperfections import EncoderErrors
from pipeline.simulate.plan import Processing

GYROS = 1000
METHODS = ("cumulative", "gauss_newton", "segments", "filter", "transient")
ARCSEC = np.deg2rad(1 / 3600)


def main() -> None:
    as_json = wants_json("time of the procedure drift")
    show(
        {
            "machine": machine("numpy", "numba"),
            "a day at 1 s, all methods (asked: 10 s on the clock)": a_day(),
            f"{GYROS} gyros of Table 3 (asked: 60 s on the clock)": a_thousand_gyros(),
        },
        as_json,
    )


def a_day() -> dict[str, object]:
    settings = DriftSettings(
        latitude=np.deg2rad(55.75),
        m=(0.01, -0.004, 0.006, 0.003, -0.002, 0.005),
        theta=(2e-3, -1e-3),
        runs=(DriftRun(scheme="horizontal"),),
        interval=1.0,
        errors=EncoderErrors(white_noise=ARCSEC),
    )
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder, "day.mcap")
        plan = Processing(stages={"identify": {"methods": METHODS}})
        simulate_drift(settings).write(recording, processing=plan)
        runner.run(recording, Path(folder, "first"))
        return timed(lambda: runner.run(recording, Path(folder, "second")))


def a_thousand_gyros() -> dict[str, object]:
    worst: list[float] = []
    figures = timed(lambda: worst.extend(monte_carlo()))
    return {**figures, "largest error of m, median over the gyros [deg/h]": float(np.median(worst))}


def monte_carlo() -> list[float]:
    """Largest error of m of each gyro, horizontal scheme [deg/h]."""
    rng = np.random.default_rng(0)
    base = Base.mounted("horizontal", np.deg2rad(55.75))
    tau = np.arange(24 * 60 + 1) * (60 * RATE)
    errors = []
    for _ in range(GYROS):
        m, theta = rng.normal(0, 0.01, 6), rng.normal(0, 3e-3, 2)
        standing = base.misaligned(rng.normal(0, 3e-4, 3))
        alpha = trajectory(Gyro(m, theta), standing, np.zeros(2), tau)
        rows = integrals(tau, alpha, base, "simpson", errors=False)
        found = solve(*rows.segments(alpha, 10), rows.names).estimate
        errors.append(float(np.abs(found - m).max() * np.rad2deg(RATE) * 3600))
    return errors


def timed(call: Callable[[], object]) -> dict[str, object]:
    """Seconds of a call: CPU of all threads, and on the clock."""
    cpu, clock = time.process_time(), time.perf_counter()
    call()
    return {"CPU [s]": time.process_time() - cpu, "clock [s]": time.perf_counter() - clock}


if __name__ == "__main__":
    main()
