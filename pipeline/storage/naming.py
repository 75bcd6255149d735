"""The name of a recording in the tables, made from a file name that may be hostile."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

LONGEST = 100
"""Characters of an id."""

COMPRESSIONS = (".gz", ".zst")
SUFFIXES = (".mcap", ".bag", ".db3", ".csv", ".tsv", ".txt", ".dat")
_SAFE = re.compile(rf"[A-Za-z][A-Za-z0-9._-]{{0,{LONGEST - 1}}}")


def recording_id(path: Path) -> str:
    """A name for a recording that is safe in a path, a URL, a make rule and as a Hive partition.

    Known suffixes are taken off. The id holds only ``A-Z a-z 0-9 . _ -`` and begins with a letter (otherwise
    ``rec-`` is put before it: readers of Hive partitions take ``recording=007`` for a number and
    ``recording=2026-11-22`` for a date). Where a character had to be replaced, or the id would have more than
    100 characters, eight digits of the name's SHA-256 keep it apart from other such names.

    Parameters
    ----------
    path : Path
        The recording; it need not exist.
    """
    name = path.name if path.name not in ("", "..") else path.resolve().name
    stem = _without_suffix(_without_suffix(name, COMPRESSIONS), SUFFIXES)
    kept = re.sub(r"[^A-Za-z0-9._-]", "_", stem)
    safe = kept if kept[:1].isalpha() else f"rec-{kept}"
    if kept != stem or not stem or len(safe) > LONGEST:
        digest = hashlib.sha256(os.fsencode(name)).hexdigest()[:8]
        safe = f"{safe[: LONGEST - 9]}-{digest}"
    return safe


def is_safe(recording_id: str) -> bool:
    """Whether an id is one that `recording_id` could have made."""
    return _SAFE.fullmatch(recording_id) is not None


def _without_suffix(name: str, suffixes: tuple[str, ...]) -> str:
    for suffix in suffixes:
        if name.lower().endswith(suffix) and len(name) > len(suffix):
            return name[: -len(suffix)]
    return name
