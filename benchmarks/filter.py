"""Speed of the square-root Kalman filter beside filterpy and statsmodels.

13 states, two of them measured and driven by the other eleven, as in the identification of drift; each step
has a transition of its own. With process noise on six of the parameters, and without.

square-root filter
    ``run_filter`` as the drift filter calls it: innovations, likelihood, the state at 500 instants.
filterpy
    Its ``SquareRootKalmanFilter``, ``predict`` and ``update`` a step, on a slice of the record, scaled by the
    sample.
statsmodels
    ``tsa.statespace.KalmanFilter.filter`` with its defaults: compiled, the states of all samples kept. It
    carries P itself, and without process noise loses digits by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from _timing import Candidate, by_turns, machine, show, wants_json
from filterpy.kalman import SquareRootKalmanFilter
from numpy.typing import NDArray
from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

from pipeline.numerics.square_root_filter import Forward, State, System, run_filter

Float = NDArray[np.float64]

SAMPLES = 100_000
SLICE = 2_000
INSTANTS = 500
ROUNDS = 5
STATES, PARAMETERS, MOVING = 13, 11, 6
SIGMA = 5e-6
"""A second of arc."""
STEP = 1e-6
PRIOR = np.concatenate([np.full(PARAMETERS, 0.1), np.full(2, SIGMA)])


def main() -> None:
    as_json = wants_json("speed of the square-root Kalman filter beside filterpy and statsmodels")
    rng = np.random.default_rng(0)
    moving, constant = simulated(rng, STEP), simulated(rng, 0.0)
    candidates = {
        "square-root filter": Candidate(ours(moving), SAMPLES),
        "square-root filter, Q = 0": Candidate(ours(constant), SAMPLES),
        "filterpy": Candidate(filterpy(moving), SLICE),
        "statsmodels": Candidate(statsmodels(moving), SAMPLES),
        "statsmodels, Q = 0": Candidate(statsmodels(constant), SAMPLES),
    }
    timings = by_turns(candidates, ROUNDS)
    pairs = [
        ("filterpy", "square-root filter", "40"),
        ("statsmodels", "square-root filter", "2"),
        ("statsmodels, Q = 0", "square-root filter, Q = 0", "2"),
    ]
    show(
        {
            "machine": machine("numpy", "numba", "filterpy", "statsmodels"),
            "samples": SAMPLES,
            "samples of filterpy, scaled": SLICE,
            "ns a sample": {name: timings.nanoseconds(name) for name in candidates},
            "times quicker than its peer (asked for)": {
                f"{quick}, than {slow} ({asked})": timings.ratio(slow, quick) for slow, quick, asked in pairs
            },
            "largest difference of a last state in its standard deviations": differences(moving, constant),
        },
        as_json,
    )


def simulated(rng: np.random.Generator, step: float) -> System:
    """Rows that turn slowly and are driven by slow sines; six of the parameters walk."""
    tau = np.linspace(0, 6.3, SAMPLES)
    h = tau[1]
    turn = np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])
    phase, rate = rng.uniform(0, 2 * np.pi, (2, PARAMETERS)), rng.uniform(0, 2, (2, PARAMETERS))
    drive = h * np.cos(tau[:-1, np.newaxis, np.newaxis] * rate + phase)
    noise = np.full((SAMPLES - 1, MOVING), step)
    p = np.tile(0.01 * rng.standard_normal(PARAMETERS), (SAMPLES, 1))
    p[1:, -MOVING:] += np.cumsum(noise * rng.standard_normal(noise.shape), axis=0)
    a = np.zeros((SAMPLES, 2))
    driven = np.einsum("jik,jk->ji", drive, p[:-1])
    for j in range(SAMPLES - 1):
        a[j + 1] = turn @ a[j] + driven[j]
    return System(
        np.broadcast_to(turn, (SAMPLES - 1, 2, 2)).copy(),
        drive,
        np.zeros((SAMPLES - 1, 2)),
        noise if step > 0 else noise[:, :0],
        a + SIGMA * rng.standard_normal(a.shape),
        np.ones(SAMPLES, dtype=np.bool_),
        np.full(2, SIGMA),
    )


def matrices(system: System, samples: int) -> tuple[Float, Float]:
    """Whole transitions, shape (13, 13, samples), and Q, as the peers take them."""
    T = np.zeros((STATES, STATES, samples), order="F")
    T[np.arange(STATES), np.arange(STATES)] = 1.0
    steps = min(samples, SAMPLES - 1)
    T[-2:, -2:, :steps] = system.transition[:steps].transpose(1, 2, 0)
    T[-2:, :-2, :steps] = system.drive[:steps].transpose(1, 2, 0)
    q = np.zeros(STATES)
    q[PARAMETERS - system.noise.shape[1] : PARAMETERS] = STEP**2
    return T, np.diag(q)


def ours(system: System) -> Callable[[], Forward]:
    instants = np.linspace(0, len(system.measured) - 1, INSTANTS).astype(np.int64)
    start = State(np.zeros(STATES), np.diag(PRIOR))
    return lambda: run_filter(system, start, instants)


def filterpy(system: System) -> Callable[[], tuple[Float, Float]]:
    T, Q = matrices(system, SLICE)
    transitions = np.ascontiguousarray(T.transpose(2, 0, 1))

    def call() -> tuple[Float, Float]:
        peer = SquareRootKalmanFilter(dim_x=STATES, dim_z=2)
        peer.x, peer.P = np.zeros((STATES, 1)), np.diag(PRIOR**2)
        peer.H, peer.R = np.eye(STATES)[-2:], np.diag(system.sigma**2)
        # its setter takes the Cholesky factor, which a Q with zeros does not have
        peer._Q1_2 = np.sqrt(Q)
        peer.update(system.measurement[0][:, np.newaxis])
        for j in range(1, SLICE):
            peer.F = transitions[j - 1]
            peer.predict()
            peer.update(system.measurement[j][:, np.newaxis])
        return peer.x[:, 0], np.linalg.norm(peer.P1_2, axis=1)

    return call


def statsmodels(system: System) -> Callable[[], Any]:
    T, Q = matrices(system, SAMPLES)
    peer = KalmanFilter(k_endog=2, k_states=STATES)
    peer.bind(np.ascontiguousarray(system.measurement))
    peer["design"], peer["obs_cov"] = np.eye(STATES)[-2:], np.diag(system.sigma**2)
    peer["transition"], peer["selection"], peer["state_cov"] = T, np.eye(STATES), Q
    peer.initialize_known(np.zeros(STATES), np.diag(PRIOR**2))
    call: Callable[[], Any] = peer.filter
    return call


def differences(moving: System, constant: System) -> dict[str, float]:
    """Largest over the states: of the mean, and of the standard deviation, both in standard deviations."""
    found = {}
    for name, system in (("statsmodels", moving), ("statsmodels, Q = 0", constant)):
        peer = statsmodels(system)()
        deviations = np.sqrt(np.diagonal(peer.filtered_state_cov[:, :, -1]))
        found[name] = apart(ours(system)().state, peer.filtered_state[:, -1], deviations)
    first = slice(SLICE)
    short = System(
        moving.transition[: SLICE - 1],
        moving.drive[: SLICE - 1],
        moving.offset[: SLICE - 1],
        moving.noise[: SLICE - 1],
        moving.measurement[first],
        moving.measured[first],
        moving.sigma,
    )
    found["filterpy"] = apart(ours(short)().state, *filterpy(moving)())
    return found


def apart(state: State, mean: Float, deviations: Float) -> float:
    own = state.standard_deviations
    return float(max(np.abs((state.mean - mean) / own).max(), np.abs(deviations / own - 1).max()))


if __name__ == "__main__":
    main()
