"""The figures of Panov (2007), of the loops that it describes and of the filter beside them."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.reproduce import _panov_table as _table
from pipeline.reproduce._panov_oracle import alone, reached
from pipeline.reproduce._panov_runs import INVENTED, SEEDS, Progress, scores
from pipeline.reproduce._panov_stability import stability
from pipeline.reproduce._panov_table import Line
from pipeline.reproduce.rows import Row, as_text


@dataclass(frozen=True, slots=True)
class Panov:
    """What is reproduced.

    Attributes
    ----------
    figures : list of Row
        Those with something to be held to.
    table : list of Line
        That of section 4.3, medians over the seeds; beside it a yardstick, which is no oracle.
    seeds : int
        Flights of each level of the aids.
    """

    figures: list[Row]
    table: list[Line]
    seeds: int

    def as_dict(self) -> dict[str, object]:
        """The same for JSON, with what the aircraft model invents."""
        return {
            "figures": self.figures,
            "table": self.table,
            "seeds": self.seeds,
            "invented": INVENTED,
        }

    def as_text(self) -> str:
        """The same for the terminal."""
        spans = "ON: 180 to 600 s, with satellites; OFF: 600 to 1200 s, without"
        head = f"Errors, medians over seeds 0 to {self.seeds - 1}. {spans}"
        return "\n".join([as_text(self.figures), "", head, _table.as_text(self.table), INVENTED])


def panov(seeds: int = SEEDS, progress: Progress | None = None) -> Panov:
    """Stability of the loops, sensors alone, and the scenario of section 4.3 by loops and filters.

    Parameters
    ----------
    seeds : int, optional
        Flights of each level, from seed 0 on. The bounds are meant for eight.
    progress : callable, optional
        Told what is done, how much has been, and of how much.

    Returns
    -------
    Panov
    """
    medians = scores(seeds, progress)
    return Panov([*stability(), *alone(), *reached(medians)], _table.table(medians), seeds)
