"""What `contracts` times: ``_contract_peers.py NAME FILE`` prints how many rows break a rule."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path


def gyrostand(path: Path) -> int:
    """Hold the file against its contract, as ``gyrostand check`` does."""
    from pipeline.storage.contract_check import violations

    return sum(violation.count for violation in violations("attitude", path))


def pandas(path: Path) -> int:
    """The rules of that contract on rows, written out for a data frame of the whole file."""
    import numpy as np
    import pandas as pd

    frame = pd.read_parquet(path, page_checksum_verification=True)
    angles = frame[["psi", "theta", "gamma"]]
    breaches = [
        *frame.isna().sum(),
        *(~np.isfinite(angles)).sum(),
        (frame["segment"] < 0).sum(),
        (frame["segment"].diff() < 0).sum(),
        (frame["time"].diff() <= 0).sum(),
    ]
    return int(sum(breaches))


PEERS: Mapping[str, Callable[[Path], int]] = {"gyrostand": gyrostand, "pandas": pandas}

if __name__ == "__main__":
    name, file = sys.argv[1:]
    print(PEERS[name](Path(file)))
