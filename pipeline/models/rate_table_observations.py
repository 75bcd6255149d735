"""What a triad of gyros is calibrated by: mean outputs at known mean rates of the case.

An observation is a step of a rate table, a turn about a known axis, or the Earth's rate in a known position
(`multi_position`). What is not quite known of the rate enters with its standard deviation, as parameters xi
of unit variance: ``w = w_known + B xi``. Observations that share an xi share the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models.rate_table_steps import RateTableError, Steps, TableAxis

Float = NDArray[np.float64]

AXES = (1, 2, 3)


@dataclass(frozen=True, slots=True)
class Observations:
    """Mean outputs of a triad at known mean rates, m of them.

    Attributes
    ----------
    rate : ndarray, shape (m, 3)
        Mean rate in the axes of the case, the Earth's included [rad/s].
    output, standard_error : ndarray, shape (m, 3)
        Mean of the three gyros, in their own units [out].
    unknown : ndarray, shape (m, 3, q)
        B: what a standard deviation of each of q unknowns adds to the rate [rad/s].
    unknowns : tuple of str
        Their names.
    temperature : ndarray, shape (m,), optional
        [K].
    apart : ndarray, shape (m, m), optional
        Time between each two [s], infinite between records. Where it is not known, what scatters between
        observations is taken as independent.
    """

    rate: Float
    output: Float
    standard_error: Float
    unknown: Float
    unknowns: tuple[str, ...]
    temperature: Float | None = None
    apart: Float | None = None

    def __len__(self) -> int:
        """How many observations."""
        return len(self.rate)


@dataclass(frozen=True, slots=True)
class Run:
    """The steps of a rate table with the case mounted in one way.

    Attributes
    ----------
    name : str
        Of the run, in the names of its unknowns.
    steps : Steps
        Of three channels.
    to_case : ndarray, shape (3, 3)
        From the axes of the table's rotor to those of the case.
    orientation_error : float
        Standard deviation of that orientation about each axis [rad]: of the fixture.
    bias_error : float
        Standard deviation of the biases of this run about those of all, as rates [rad/s]: what they repeat to
        from one mounting to the next.
    axis : TableAxis or None
        To take out the Earth's rate; None leaves it in.
    """

    name: str
    steps: Steps
    to_case: Float
    orientation_error: float
    bias_error: float
    axis: TableAxis | None


def joined(parts: Sequence[Observations]) -> Observations:
    """Observations of several runs or methods together; unknowns of the same name are the same.

    The time between them is not known here.

    Raises
    ------
    RateTableError
        If some have a temperature and others none.
    """
    names = tuple(dict.fromkeys(name for part in parts for name in part.unknowns))
    unknown = np.zeros((sum(map(len, parts)), 3, len(names)))
    first = 0
    for part in parts:
        columns = [names.index(name) for name in part.unknowns]
        unknown[first : first + len(part), :, columns] = part.unknown
        first += len(part)
    temperatures = [part.temperature for part in parts if part.temperature is not None]
    if 0 < len(temperatures) < len(parts):
        raise RateTableError(
            "temperature",
            expected="one in every run, or in none",
            found=f"{len(temperatures)} of {len(parts)} runs with one",
            remedy="give the temperature of each run, or of none",
        )
    return Observations(
        np.concatenate([part.rate for part in parts]),
        np.concatenate([part.output for part in parts]),
        np.concatenate([part.standard_error for part in parts]),
        unknown,
        names,
        np.concatenate(temperatures) if temperatures else None,
    )


def turned_by(rate: Float, error: float, name: str) -> tuple[Float, tuple[str, ...]]:
    """What an unknown small rotation of the case adds to its rate, ``psi x w``, and the unknowns' names.

    Parameters
    ----------
    rate : ndarray, shape (m, 3)
        All turned by the same rotation.
    error : float
        Its standard deviation about each axis [rad]; 0 gives no unknowns.
    name : str
        Of the orientation.

    Returns
    -------
    unknown : ndarray, shape (m, 3, 3) or (m, 3, 0)
    names : tuple of str
    """
    if error == 0:
        return np.zeros((len(rate), 3, 0)), ()
    unknown = error * np.stack([np.cross(e, rate) for e in np.eye(3)], axis=2)
    return unknown, tuple(f"orientation_{i}_{name}" for i in AXES)


def observe_runs(runs: Sequence[Run]) -> Observations:
    """The steps of runs with the case mounted in different ways, about as many axes.

    Where a step's table angle has no known zero and less than a turn was made, the Earth's rate across the
    table's axis is an unknown of its own.
    """
    return joined([_observe_run(run) for run in runs])


def with_bias(observed: Observations, error: float, name: str) -> Observations:
    """Observations whose biases differ from those of all others by unknowns that they share.

    Parameters
    ----------
    observed : Observations
    error : float
        Standard deviation of the biases about those of all, as rates [rad/s]; 0 gives no unknowns.
    name : str
        Of what they share.
    """
    if error == 0:
        return observed
    bias = np.tile(error * np.eye(3), (len(observed), 1, 1))
    return replace(
        observed,
        unknown=np.concatenate([observed.unknown, bias], axis=2),
        unknowns=(*observed.unknowns, *(f"bias_{i}_{name}" for i in AXES)),
    )


def _observe_run(run: Run) -> Observations:
    steps = run.steps
    on_rotor = np.outer(steps.rate, [0.0, 0.0, 1.0])
    free: list[int] = []
    across = 0.0
    if run.axis is not None:
        on_rotor += run.axis.on_rotor(np.nan_to_num(steps.turn))
        free = np.flatnonzero(np.isnan(steps.turn[:, 0])).tolist()
        across = run.axis.across
    rate = on_rotor @ run.to_case.T
    turned, names = turned_by(rate, run.orientation_error, run.name)
    phase = np.zeros((len(steps), 3, 2 * len(free)))
    for n, step in enumerate(free):
        # of random phase: a variance of half the square in either direction
        phase[step, :, 2 * n : 2 * n + 2] = across / np.sqrt(2) * run.to_case[:, :2]
    phases = [f"earth_rate_{i}_{run.name}_step_{step}" for step in free for i in (1, 2)]
    observed = Observations(
        rate,
        steps.gyro,
        steps.standard_error,
        np.concatenate([turned, phase], axis=2),
        (*names, *phases),
        steps.temperature,
    )
    return with_bias(observed, run.bias_error, run.name)
