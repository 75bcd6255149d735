"""How the audit writes down what it marks: one finding a run of samples, and a figure for each kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics.sampling import Runs
from pipeline.stages.base import Severity, counted, finding, metric

Int = NDArray[np.int64]
Row = dict[str, Any]


@dataclass(slots=True)
class StreamReport:
    """Findings and metrics of one stream, as they are found."""

    stream: str
    time: Int
    """Stamps of the record [ns], shape (n,), as recorded."""
    most_rows: int
    """Findings of one kind in one channel; the rest are summed."""
    about: str = ""
    """What every sentence begins with: the run, where there are several."""
    findings: list[Row] = field(default_factory=list)
    metrics: list[Row] = field(default_factory=list)

    def say(
        self,
        kind: str,
        severity: Severity,
        detail: str,
        *,
        channel: str | None = None,
        count: int | None = None,
    ) -> None:
        """One finding about the whole record; ``count`` is by default that of its samples."""
        ends = (int(self.time.min()), int(self.time.max())) if len(self.time) else (None, None)
        self.findings.append(
            finding(
                "audit", self.stream, kind, severity, self.about + detail,
                channel=channel, start=ends[0], end=ends[1], count=len(self.time) if count is None else count,
            )
        )  # fmt: skip

    def figure(
        self,
        name: str,
        value: float | None,
        unit: str = "1",
        *,
        channel: str | None = None,
        standard_error: float | None = None,
    ) -> None:
        """One metric of the stream, or of one of its channels or clocks."""
        about = self.stream if channel is None else f"{self.stream}.{channel}"
        self.metrics.append(metric("audit", about, name, value, unit, standard_error))

    def mark(
        self,
        kind: str,
        severity: Severity,
        found: Runs,
        detail: Callable[[int], str],
        *,
        channel: str | None = None,
        count: Int | None = None,
    ) -> None:
        """One finding a run of samples.

        Parameters
        ----------
        kind, severity, channel
            As in ``findings``.
        found : Runs
            Indices into the record.
        detail : callable
            The sentence for the i-th run.
        count : ndarray, optional
            Samples concerned by each run, where that is not its length.

        Notes
        -----
        Beyond ``most_rows`` the runs with the greatest counts have their own row, and one more row sums the
        others, so that a record full of faults gives a table that can be read and nothing is left out.
        """
        counts = found.length if count is None else count
        own = np.argsort(-counts, kind="stable")[: self.most_rows]
        own.sort()
        for i in own:
            ends = self.time[[found.start[i], found.stop[i] - 1]]
            self.findings.append(
                finding(
                    "audit", self.stream, kind, severity, self.about + detail(int(i)),
                    channel=channel, start=int(ends.min()), end=int(ends.max()), count=int(counts[i]),
                )
            )  # fmt: skip
        if len(found) > len(own):
            self._sum_up(kind, severity, np.setdiff1d(np.arange(len(found)), own), found, counts, channel)

    def _sum_up(
        self, kind: str, severity: Severity, rest: Int, found: Runs, counts: Int, channel: str | None
    ) -> None:
        """One finding for all the runs that have no row of their own."""
        ends = self.time[np.concatenate([found.start[rest], found.stop[rest] - 1])]
        total = int(counts[rest].sum())
        self.findings.append(
            finding(
                "audit", self.stream, kind, severity,
                f"{self.about}{len(rest)} more, {counted(total, 'sample')} together, none with more than "
                f"{counts[rest].max()}",
                channel=channel, start=int(ends.min()), end=int(ends.max()), count=total,
            )
        )  # fmt: skip
