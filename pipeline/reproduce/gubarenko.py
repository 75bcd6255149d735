"""The figures of Gubarenko & Kuzmenko (1995), and of the methods beside theirs, by the pipeline's models."""

from __future__ import annotations

from pipeline.reproduce._gubarenko_exact import exact
from pipeline.reproduce._gubarenko_filter import kalman_filter
from pipeline.reproduce._gubarenko_observability import observability
from pipeline.reproduce._gubarenko_regression import regression
from pipeline.reproduce._gubarenko_spiral import spiral
from pipeline.reproduce._gubarenko_tables import tables
from pipeline.reproduce.rows import Row


def gubarenko() -> list[Row]:
    """Tables 2 and 3, the spiral of section 4, the accuracy statements of sections 6 and 7, observability.

    The runs are of a day at 55.75 degrees north, all m = 0.01, and are computed in memory.

    Returns
    -------
    list of Row
    """
    return [*tables(), *spiral(), *regression(), *observability(), *exact(), *kalman_filter()]
