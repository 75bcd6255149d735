"""The runner: what a run depends on."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from pipeline import storage
from pipeline.errors import ExitCode
from pipeline.formats.base import RecordingError
from pipeline.runner import fingerprint, run
from pipeline.storage import StorageError

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data" / "vertical.csv"
"""A run of 1441 samples, of the procedure drift."""
RUNS = """
[[runs]]
name = "one"

[[runs]]
name = "two"
recording = "run2.csv"
"""


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """A recording whose plan names another as its second run."""
    recording = tmp_path / "run1.csv"
    for name in ("run1.csv", "run2.csv"):
        shutil.copyfile(SAMPLE, tmp_path / name)
    plan, _, _ = SAMPLE.with_suffix(".toml").read_text().partition("# arcsec; that of the encoders")
    recording.with_suffix(".toml").write_text(plan + RUNS)
    return recording


def test_a_run_is_up_to_date_until_a_further_recording_changes(pair: Path, tmp_path: Path) -> None:
    out, second = tmp_path / "out", pair.with_name("run2.csv")
    assert not run(pair, out).up_to_date
    assert storage.read(out, "run1", "gimbal").num_rows == 2882
    content = second.read_text()
    second.write_text(content)
    os.utime(second, (0, 0))
    assert run(pair, out).up_to_date  # the same bytes, whatever their date
    second.write_text("\n".join(content.splitlines()[:-1]) + "\n")
    assert not run(pair, out).up_to_date
    assert storage.read(out, "run1", "gimbal").num_rows == 2881
    assert run(pair, out).up_to_date
    provenance = storage.read(out, "run1", "provenance").to_pylist()[0]
    assert provenance["recording_bytes"] == pair.stat().st_size + second.stat().st_size


def test_a_fingerprint_tells_recordings_their_names_and_their_order_apart(tmp_path: Path) -> None:
    for name, content in (("a", "1"), ("b", "2"), ("c", "2")):
        (tmp_path / name).write_text(content)
    a, b, c = (tmp_path / name for name in "abc")
    prints = [fingerprint(a), fingerprint(b), fingerprint(a, b), fingerprint(b, a), fingerprint(a, c)]
    assert len({digest for digest, _ in prints}) == len(prints)
    assert [size for _, size in prints] == [1, 1, 2, 2, 2]
    assert fingerprint(b) == fingerprint(c)


def test_a_further_recording_must_be_there(pair: Path, tmp_path: Path) -> None:
    pair.with_name("run2.csv").unlink()
    with pytest.raises(RecordingError, match=r"run2\.csv: expected the further recording") as caught:
        run(pair, tmp_path / "out")
    assert caught.value.exit_code is ExitCode.INPUT
    assert not (tmp_path / "out").exists()


def test_a_further_bag_takes_no_tables(pair: Path) -> None:
    second = pair.with_name("run2.csv")
    second.unlink()
    second.mkdir()
    with pytest.raises(StorageError, match="outside the recording"):
        run(pair, second / "out")
