"""Time and memory of the noise models: ten million samples, every candidate, the choice among them.

No public tool fits these models by the debiased Whittle likelihood, so there is no peer; the figures are CPU
seconds, and the largest memory of the process.
"""

from __future__ import annotations

import resource
import time

import numpy as np
from _timing import machine, show, wants_json

from pipeline.models.random_error import Noise2, RandomError, White
from pipeline.models.random_error_fit import identify

SAMPLES = 10_000_000
STEP = 0.01


def main() -> None:
    as_json = wants_json("time and memory of the noise models")
    truth = RandomError((Noise2(0.01, 0.01, 0.3), White(1e-4)))
    identify(truth.generate(10_000, STEP, np.random.default_rng(0)), STEP)  # compiles
    rate = truth.generate(SAMPLES, STEP, np.random.default_rng(1))
    begun = time.process_time()
    found = identify(rate, STEP)
    show(
        {
            "machine": machine("numpy", "numba", "scipy"),
            "samples": SAMPLES,
            "chosen": found.chosen.form,
            "CPU [s] (asked: 60)": time.process_time() - begun,
            "peak memory of the process [GB] (asked: 2)": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            / 1e6,
        },
        as_json,
    )


if __name__ == "__main__":
    main()
