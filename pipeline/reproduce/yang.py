"""The figures of Yang et al. (2014), and of the identification beside theirs, by the pipeline's models."""

from __future__ import annotations

from pipeline.reproduce._yang_monte_carlo import monte_carlo
from pipeline.reproduce._yang_records import records
from pipeline.reproduce._yang_rotation import rotation
from pipeline.reproduce._yang_variance import variances
from pipeline.reproduce.rows import Row


def yang() -> list[Row]:
    """Variances and growth of noises 1, 2 and 3 under rotation, and their identification from records.

    Closed forms; generated records at fixed seeds beside them; the Whittle fit on generated records of
    4 h at 1 Hz, beside the bound of Cramér and Rao. The paper's own figures are graphs: none is printed.

    Returns
    -------
    list of Row
    """
    return [*variances(), *rotation(), *monte_carlo(), *records()]
