"""Whether a filter is as wrong as it says, in all its states together, where the truth was recorded.

The squared error over its covariance (NEES) is chi-squared; a state's share of it has the mean 1. Standard
deviations alone do not tell it: errors of attitude and velocity go together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.models.navigation_consistency import normalised_squares
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.stages._navigation_methods import Done
from pipeline.stages._navigation_outages import PHASES
from pipeline.stages._navigation_truth import Truth, errors_of
from pipeline.stages.base import metric

Integer = NDArray[np.intp]

_ORDER = ("attitude", "velocity", "position")
"""Of the columns of a factor."""

_AT_ONCE = 4096
"""Nodes whose factors are in memory a second time."""


def consistency_figures(
    done: Done, at: Integer, phase: Sequence[str], origin: int, truth: Truth
) -> Iterator[dict[str, Any]]:
    """Mean normalised squared error a state of attitude, velocity and position, phase by phase.

    Parameters
    ----------
    done : Done
        With the factors of its covariance.
    at : ndarray of int, shape (m,)
        Instants that are judged, where they are nodes.
    phase : sequence of str, of m
    origin : int
        Of the navigation's time [ns].
    truth : Truth
        Of which all that is known is judged.
    """
    if done.factor is None:
        return
    rows, ours, theirs = np.intersect1d(at, done.nodes, return_indices=True)
    here, time = done.navigation, done.navigation.time[rows]
    state = {
        "position": here.position[rows],
        "velocity": here.velocity[rows],
        "attitude": yaw_pitch_roll(here.attitude[rows]),
    }
    found = errors_of(origin + np.rint(time * 1e9).astype(np.int64), state, truth)
    known = {"attitude": found.rotation, "velocity": found.velocity, "position": found.position}
    known = {name: error for name, error in known.items() if np.isfinite(error).any()}
    if not known:
        return
    error = np.concatenate(list(known.values()), axis=1)
    places = np.concatenate([3 * _ORDER.index(name) + np.arange(3) for name in known])
    judged = np.flatnonzero(np.isfinite(error).all(axis=1))
    square = np.concatenate(
        [
            normalised_squares(error[some], done.factor[theirs[some]][:, :, places])
            for some in np.array_split(judged, len(judged) // _AT_ONCE + 1)
        ]
    )
    square /= error.shape[1]
    phases = np.array(phase)[ours[judged]]
    for name in PHASES:
        if (phases == name).any():
            channel = f"{here.method}.{name}"
            yield metric("navigate", channel, "normalised_errors", square[phases == name].mean(), "1")
