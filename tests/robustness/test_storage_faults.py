"""Storage under real kills, real full disks, real damage, and runs at the same time."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pytest
from small_outputs import files, publish, tables
from storage_process import SAMPLES

from pipeline import storage
from pipeline.errors import ExitCode, GyrostandError
from pipeline.storage import parquet
from pipeline.storage.check import check

HERE = Path(__file__).resolve().parent
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{HERE.parents[1]}{os.pathsep}{HERE.parent}"}


def start(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, str(HERE / "storage_process.py"), *map(str, arguments)]
    return subprocess.Popen(
        command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


@pytest.fixture(scope="module")
def versions(tmp_path_factory: pytest.TempPathFactory) -> dict[int, dict[str, bytes]]:
    """The files of a run of each version, small as `steps` publishes them."""
    return {v: _published(tmp_path_factory.mktemp(f"v{v}"), v, 500) for v in (1, 2)}


def _published(out: Path, version: int, samples: int) -> dict[str, bytes]:
    publish(out, "run7", version, samples)
    return files(out)


def test_killed_before_any_step_the_next_run_writes_the_same_bytes(
    tmp_path: Path, versions: dict[int, dict[str, bytes]]
) -> None:
    """Version 1 is published; a run of version 2 is killed before each of its file operations."""
    publish(tmp_path / "start", "run7", 1)
    code, out, err = finish(start("steps", tmp_path / "start", tmp_path))
    assert code == 0, err
    killed = sorted(tmp_path.glob("step-*"))
    # 39 steps: five tables written, hashed, renamed, their folders synced; one removed; provenance removed.
    assert int(out) == len(killed) - 1 >= 30

    old, new = versions[1], versions[2]
    states = set()
    for folder in killed:
        present = files(folder)
        # Whatever can be seen is a whole file of the one version or the other …
        assert all(content in (old.get(name), new.get(name)) for name, content in present.items()), folder
        # … and where there is provenance, all are of the same.
        finished = "provenance/recording=run7/part-0.parquet" in present
        if finished:
            assert present in (old, new), folder
        states.add("new" if present == new else "old" if present == old else "unfinished")
        publish(folder, "run7", 2)
        assert files(folder) == new, folder
        assert [p.name for p in (folder / ".publishing").iterdir()] == [".run7.lock"]
        assert check([folder]) == []
    assert states == {"old", "unfinished", "new"}


def test_killed_at_random_moments_no_reader_ever_sees_a_short_file(tmp_path: Path) -> None:
    """Two versions are published in turn and the process is killed, while this one reads."""
    pick = random.Random(20160101)
    expected = {v: tables(v, SAMPLES)["gyro"] for v in (1, 2)}
    reference = _published(tmp_path / "reference", 2, SAMPLES)
    out = tmp_path / "out"
    publish(out, "run7", 1, SAMPLES)
    seen, whole = 0, 0
    for _ in range(8):
        process = start("loop", out, "run7")
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        end = time.monotonic() + pick.uniform(0.0, 0.4)
        while time.monotonic() < end:
            # The file alone, as an analyst's tool reads it: never missing, never short, never mixed.
            gyro = parquet.read(storage.table_file(out, "run7", "gyro"))
            assert any(gyro.equals(e) for e in expected.values())
            seen += 1
            try:
                gyro = storage.read(out, "run7", "gyro")
            except GyrostandError:  # the recording is between two runs
                continue
            assert any(gyro.equals(e) for e in expected.values())
            whole += 1
        process.send_signal(signal.SIGKILL)
        assert finish(process)[0] == -signal.SIGKILL
        publish(out, "run7", 2, SAMPLES)
        assert files(out) == reference
    assert seen >= whole > 0


def test_runs_of_different_recordings_do_not_disturb_each_other(tmp_path: Path) -> None:
    processes = [start("once", tmp_path / "out", f"run{n}", 1 + n % 2) for n in range(4)]
    assert [finish(p) for p in processes] == [(0, "", "")] * 4
    assert check([tmp_path / "out"]) == []
    for n in range(4):
        alone = tmp_path / f"alone{n}"
        publish(alone, f"run{n}", 1 + n % 2, SAMPLES)
        together = {k: v for k, v in files(tmp_path / "out").items() if f"recording=run{n}/" in k}
        assert together == files(alone)


def test_a_second_run_of_the_same_recording_is_told_so(tmp_path: Path) -> None:
    with storage.publication(tmp_path, "run7"):
        code, _, err = finish(start("once", tmp_path, "run7", 1))
    assert code == ExitCode.USAGE
    assert err.count("\n") == 1
    assert "found one at work" in err
    assert finish(start("once", tmp_path, "run7", 1))[0] == 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB, which needs the right to mount."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    try:
        done = subprocess.run(mount, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no mount command")
    if done.returncode:
        pytest.skip(f"a small disk cannot be mounted here: {done.stderr.strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_is_one_line_and_leaves_what_was(small_disk: Path) -> None:
    out = small_disk / "out"
    publish(out, "run7", 1)
    before = files(out)
    with pytest.raises(storage.StorageError, match="No space left on device; what was published") as caught:
        publish(out, "run7", 2, 100_000)
    assert caught.value.exit_code == ExitCode.FAULT
    assert "\n" not in str(caught.value)
    assert files(out) == before
    assert check([out]) == []
    publish(out, "run7", 2)  # there is room again for a smaller one
    assert check([out]) == []


def test_a_disk_that_fills_between_tables_leaves_what_was(small_disk: Path) -> None:
    out = small_disk / "out"
    publish(out, "run7", 1)
    before = files(out)
    free = os.statvfs(small_disk)
    (small_disk / "filler").write_bytes(bytes(free.f_bavail * free.f_bsize - 40_000))
    with pytest.raises(storage.StorageError, match="make room and run again"):
        publish(out, "run7", 2, 2_000)
    assert files(out) == before


def test_a_file_larger_than_allowed_is_one_line_and_leaves_what_was(tmp_path: Path) -> None:
    publish(tmp_path, "run7", 1)
    before = files(tmp_path)
    code, _, err = finish(start("once", tmp_path, "run7", 2, 100_000))
    assert code == ExitCode.FAULT
    assert err.count("\n") == 1
    assert "File too large; what was published before is untouched" in err
    assert files(tmp_path) == before


def _changed(content: bytes, pick: random.Random) -> bytes:
    place = pick.randrange(len(content))
    return content[:place] + bytes([content[place] ^ pick.randrange(1, 256)]) + content[place + 1 :]


def test_a_changed_byte_is_never_read_as_data(tmp_path: Path) -> None:
    """200 changes of a published recording's files: an error of exit code 1, or the same data."""
    pick = random.Random(7)
    publish(tmp_path, "run7", 1)
    expected: dict[str, pa.Table] = {
        name: storage.read(tmp_path, "run7", name) for name in (*tables(1), storage.PROVENANCE)
    }
    refused: list[GyrostandError] = []
    for _ in range(200):
        name = pick.choice(sorted(expected))
        path = storage.table_file(tmp_path, "run7", name)
        sound = path.read_bytes()
        path.write_bytes(_changed(sound, pick))
        try:
            assert storage.read(tmp_path, "run7", name).equals(expected[name])
            assert name == storage.PROVENANCE  # the one file whose SHA-256 nothing names
        except GyrostandError as error:
            refused.append(error)
            assert check([tmp_path]) != []
        path.write_bytes(sound)
    assert {error.exit_code for error in refused} == {ExitCode.NOT_MET}
    assert not any("\n" in str(error) for error in refused)
    # Of provenance a part of the changes lie in bytes that hold no data: padding, statistics, page headers.
    assert len(refused) > 180


def test_a_changed_byte_of_a_file_alone_is_never_read_as_data(tmp_path: Path) -> None:
    """The same where no provenance names the SHA-256: the page checksums and the footer must tell."""
    pick = random.Random(8)
    table = tables(1)["gyro"]
    path = tmp_path / "gyro.parquet"
    parquet.write(path, "gyro", table)
    sound = path.read_bytes()
    refused = 0
    for _ in range(200):
        path.write_bytes(_changed(sound, pick))
        if check([path]):
            refused += 1
        else:
            assert parquet.read(path).equals(table)
    assert refused > 100  # most bytes are data


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    publish(tmp_path, "run7", 1)
    path = storage.table_file(tmp_path, "run7", "gyro")
    sound = path.read_bytes()
    for length in (0, 4, 8, len(sound) // 2, len(sound) - 8, len(sound) - 1):
        path.write_bytes(sound[:length])
        with pytest.raises(storage.StorageError) as caught:
            storage.read(tmp_path, "run7", "gyro")
        assert caught.value.exit_code == ExitCode.NOT_MET
        with pytest.raises(storage.StorageError):
            parquet.read(path)
