"""CPU time of ``gyrostand --help`` as a process, beside Python that does nothing and that imports NumPy."""

from __future__ import annotations

import sys

from _timing import machine, processes_by_turns, show, wants_json

ROUNDS = 15

COMMANDS = {
    "nothing": [sys.executable, "-c", "pass"],
    "import numpy": [sys.executable, "-c", "import numpy"],
    "gyrostand --help": [sys.executable, "-m", "pipeline", "--help"],
}


def main() -> None:
    as_json = wants_json("CPU time of gyrostand --help")
    timings = processes_by_turns(COMMANDS, ROUNDS).timings
    show(
        {
            "machine": machine("numpy", "typer"),
            "CPU time [ms]": {name: timings.nanoseconds(name) / 1e6 for name in COMMANDS},
            "gyrostand --help takes, times that of": {
                name: timings.ratio("gyrostand --help", name) for name in COMMANDS if "--help" not in name
            },
        },
        as_json,
    )


if __name__ == "__main__":
    main()
