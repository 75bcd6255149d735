"""What the benchmarks share: candidates and peers by turns in one run, CPU time, medians of ratios.

The ratio of two candidates is taken within each round, where both met the same machine, and the median of
the rounds is printed; CPU time of the process, so that a busy machine disturbs little.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Candidate:
    """Something to be timed: ``call`` does the work of ``items`` items."""

    call: Callable[[], object]
    items: int


@dataclass(frozen=True, slots=True)
class Timings:
    """CPU seconds an item of each candidate, by round."""

    per_item: Mapping[str, list[float]]

    def ratio(self, slow: str, quick: str) -> float:
        """How many times longer ``slow`` takes than ``quick``: median over the rounds."""
        pairs = zip(self.per_item[slow], self.per_item[quick], strict=True)
        return statistics.median(a / b for a, b in pairs)

    def nanoseconds(self, name: str) -> float:
        """Median CPU time an item [ns]."""
        return 1e9 * statistics.median(self.per_item[name])


def by_turns(candidates: Mapping[str, Candidate], rounds: int) -> Timings:
    """Time the candidates one after the other, ``rounds`` times.

    Each is called once more just before it is timed: else the first pages of its arrays would be counted or
    not, by what the candidate before it has left to the allocator.
    """
    per_item: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, candidate in candidates.items():
            candidate.call()
            start = time.process_time()
            candidate.call()
            per_item[name].append((time.process_time() - start) / candidate.items)
    return Timings(per_item)


def machine(*packages: str) -> dict[str, str]:
    """Processor, Python and the versions of the packages that take part."""
    return {
        "processor": _processor(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
    }


def wants_json(purpose: str) -> bool:
    """Parse the command line of a benchmark: ``--json`` and nothing else."""
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return bool(parser.parse_args().json)


def show(result: Mapping[str, Any], as_json: bool) -> None:
    """Print a result: nested mappings become indented lines."""
    if as_json:
        print(json.dumps(result, indent=2))
        return
    _show_lines(result, "")


def _show_lines(result: Mapping[str, Any], indent: str) -> None:
    width = max(len(str(key)) for key in result)
    for key, value in result.items():
        if isinstance(value, Mapping):
            print(f"{indent}{key}")
            _show_lines(value, indent + "  ")
        else:
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
            print(f"{indent}{key:<{width}}  {text}")


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
