"""Speed and memory of the overlapping Allan deviation beside allantools, from rates with a bias.

All take the same rates at the same 48 tau, up to a third of the record, and integrate them first. The
memory is what a call holds beside its input, at most, over the memory of the input.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import allantools
import numpy as np
from _timing import Candidate, by_turns, machine, show, wants_json
from numpy.typing import NDArray

from pipeline.numerics.allan import KINDS, Kind, from_rates, variances

Float = NDArray[np.float64]

SAMPLES = 10_000_000
TAUS = 48
STEP = 0.01
ROUNDS = 3
SPACED = np.geomspace(1, SAMPLES // 3, TAUS + 2)
FACTORS = np.unique(np.round(SPACED).astype(np.int64))[:TAUS]


def main() -> None:
    as_json = wants_json("speed and memory of the overlapping Allan deviation beside allantools")
    rates = np.random.default_rng(4).standard_normal(SAMPLES) + 0.1
    ours: dict[str, Callable[[], Float]] = {kind: deviations(rates, kind) for kind in KINDS}
    peer = theirs(rates)
    apart = np.abs(ours["allan"]() / peer() - 1).max()
    candidates = {**ours, "allantools oadev": peer}
    timings = by_turns({name: Candidate(call, SAMPLES) for name, call in candidates.items()}, ROUNDS)
    show(
        {
            "machine": machine("allantools", "numba", "numpy"),
            "samples": SAMPLES,
            "tau": len(FACTORS),
            "CPU time a sample [ns]": {name: timings.nanoseconds(name) for name in candidates},
            "allantools over ours": timings.ratio("allantools oadev", "allan"),
            "memory beside the input, over it": {
                "allan": memory(ours["allan"]) / rates.nbytes,
                "allantools oadev": memory(peer) / rates.nbytes,
            },
            "largest relative difference": float(apart),
        },
        as_json,
    )


def deviations(rates: Float, kind: Kind) -> Callable[[], Float]:
    def call() -> Float:
        return variances(from_rates(rates, STEP), FACTORS, kind).deviation

    return call


def theirs(rates: Float) -> Callable[[], Float]:
    def call() -> Float:
        _, deviation, _, _ = allantools.oadev(rates, 1 / STEP, "freq", FACTORS * STEP)
        return np.asarray(deviation, dtype=np.float64)

    return call


def memory(call: Callable[[], Float]) -> float:
    """Largest memory [byte] that a call holds beside what was there before."""
    tracemalloc.start()
    call()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return float(peak)


if __name__ == "__main__":
    main()
