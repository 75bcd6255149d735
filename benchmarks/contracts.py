"""Holding a file of ten million rows against its contract, beside the same rules in plain pandas.

Each is a process of its own, its imports included, that reads the file with page checksums verified. Two
rows break a rule, one a value and one the rise of time; both must find them. Of the two only the contract's
check names them, and looks at schema, units and metadata.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from _contract_peers import PEERS
from _timing import machine, processes_by_turns, show, wants_json

from pipeline import contracts
from pipeline.storage import parquet

ROWS = 10_000_000
ROUNDS = 3
PLANTED = 2


def main() -> None:
    as_json = wants_json("speed and memory of the check of a contract beside pandas")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "attitude.parquet"
        write_table(path)
        size = path.stat().st_size
        script = str(Path(__file__).with_name("_contract_peers.py"))
        runs = processes_by_turns({name: [sys.executable, script, name, str(path)] for name in PEERS}, ROUNDS)
    if set(runs.printed.values()) != {str(PLANTED)}:
        raise SystemExit(f"{PLANTED} rows break a rule, found: {runs.printed}")
    show(
        {
            "machine": machine("numpy", "pyarrow", "pandas"),
            "rows": ROWS,
            "file [MiB]": size / 2**20,
            "CPU time [s]": {name: runs.timings.nanoseconds(name) / 1e9 for name in PEERS},
            "peak memory [MiB]": runs.peak_mib,
            "pandas takes, times gyrostand's": {
                "CPU time": runs.timings.ratio("pandas", "gyrostand"),
                "peak memory": runs.peak_mib["pandas"] / runs.peak_mib["gyrostand"],
            },
        },
        as_json,
    )


def write_table(path: Path) -> None:
    """An attitude at 20 kHz in the pipeline's own kind of file, with two rows that break a rule."""
    time = np.arange(ROWS, dtype=np.int64) * 50_000
    time[ROWS // 3] = time[ROWS // 3 - 1]
    angles = np.random.default_rng(0).normal(size=(3, ROWS))
    angles[1, ROWS // 2] = np.inf
    columns = dict(zip(("psi", "theta", "gamma"), angles, strict=True))
    segment = np.zeros(ROWS, dtype=np.int32)
    parquet.write(
        path, "attitude", contracts.table("attitude", {"time": time, "segment": segment, **columns})
    )


if __name__ == "__main__":
    main()
