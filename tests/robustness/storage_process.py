"""Runs that the tests of storage kill, starve or race: each a process of its own.

storage_process.py once OUT ID VERSION [FILE_LIMIT]   publish once, say what became of it
storage_process.py loop OUT ID                        publish both versions in turn until killed
storage_process.py steps OUT FOLDER                   kill a run of version 2 before each of its steps
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path

from small_outputs import publish

from pipeline.errors import GyrostandError

SAMPLES = 20_000
STEPS = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.listdir", "os.scandir")


def once(out: Path, recording_id: str, version: int, limit: int) -> int:
    if limit:  # a write beyond it fails, as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    try:
        publish(out, recording_id, version, SAMPLES)
    except GyrostandError as error:
        sys.stderr.write(f"{error}\n")
        return int(error.exit_code)
    return 0


def loop(out: Path, recording_id: str) -> None:
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for turn in count():
        publish(out, recording_id, 1 + turn % 2, SAMPLES)


def steps(out: Path, folder: Path) -> None:
    """Copy the output folder, kill a run on the copy before its n-th step; for n = 1, 2 … to the end."""
    for number in count(1):
        copy = folder / f"step-{number:03}"
        shutil.copytree(out, copy)
        child = os.fork()  # one fork costs less than one start of Python and its imports
        if child == 0:
            sys.addaudithook(_killer(copy, number))
            publish(copy, "run7", 2)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if status == 0:
            sys.stdout.write(f"{number - 1}\n")
            return


def _killer(out: Path, number: int) -> Callable[[str, tuple[object, ...]], None]:
    seen = 0

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal seen
        if event in STEPS and any(str(out) in str(a) for a in arguments):
            seen += 1
            if seen == number:
                os.kill(os.getpid(), signal.SIGKILL)

    return hook


if __name__ == "__main__":
    mode, where, *rest = sys.argv[1:]
    if mode == "once":
        sys.exit(once(Path(where), rest[0], int(rest[1]), int(rest[2]) if len(rest) > 2 else 0))
    elif mode == "loop":
        loop(Path(where), rest[0])
    else:
        steps(Path(where), Path(rest[0]))
