"""What the benchmarks share: candidates and peers by turns in one run, CPU time, medians of ratios.

A candidate is a call or a process. The ratio of two is taken within each round, where both met the same
machine, and the median of the rounds is printed; CPU time, so that a busy machine disturbs little.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryFile
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


@dataclass(frozen=True, slots=True)
class Runs:
    """Processes that were run by turns: their CPU seconds, largest memory, and what each printed."""

    timings: Timings
    peak_mib: Mapping[str, float]
    printed: Mapping[str, str]


def processes_by_turns(commands: Mapping[str, Sequence[str]], rounds: int) -> Runs:
    """Run the commands one after the other, ``rounds`` times, after once each to fill the caches.

    CPU time is that of user and system, all threads, from the start of the process; memory is the largest
    resident set. A command that fails ends the benchmark.
    """
    per_item: dict[str, list[float]] = {name: [] for name in commands}
    peak = dict.fromkeys(commands, 0.0)
    printed = dict.fromkeys(commands, "")
    for measured in [False] + [True] * rounds:
        for name, command in commands.items():
            with TemporaryFile("w+") as output:
                process = subprocess.Popen(command, stdout=output)
                _, status, used = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
                output.seek(0)
                printed[name] = output.read().strip()
            if process.returncode:
                raise SystemExit(f"{name}: exit status {process.returncode}")
            if measured:
                per_item[name].append(used.ru_utime + used.ru_stime)
            peak[name] = max(peak[name], used.ru_maxrss / 1024)
    return Runs(Timings(per_item), peak, printed)


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
