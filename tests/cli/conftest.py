"""The command line called within the tests' own process, where nothing depends on its being another."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator

import pytest
from in_process import Completed

from pipeline.cli import main


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., Completed]]:
    """Run the command line as `gyrostand` does, but some twenty times as quick."""

    def call(*arguments: object) -> Completed:
        words = list(map(str, arguments))
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(words)
        out, err = capsys.readouterr()
        code = ended.value.code
        assert isinstance(code, int)
        return subprocess.CompletedProcess(words, code, out, err)

    before = signal.getsignal(signal.SIGINT)
    yield call
    signal.signal(signal.SIGINT, before)
