"""Which recordings a folder holds, and rules for make under names that are safe for it.

A file name may hold a blank, a colon, a dollar sign: make takes none of them. So each recording gets a
safe id and a small listing file, ``<out>/.recordings/<id>.json``, that is rewritten only when the
recording, its test plan, its calibration or the code has changed; make's rules depend on the listing alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from pipeline import runner, storage
from pipeline.errors import ExitCode, GyrostandError, writing
from pipeline.formats.base import RecordingError
from pipeline.storage.naming import COMPRESSIONS, SUFFIXES
from pipeline.testplan import PlanError, find_plan, named_calibration, named_recordings, own_plan

RULES = "recordings.mk"


class DiscoveryError(GyrostandError):
    """The recordings of a folder cannot be told apart, or listed."""

    exit_code = ExitCode.USAGE


def recordings(folder: Path) -> list[Path]:
    """The recordings directly in a folder, by name: known suffixes, and rosbag2 folders.

    One that another's test plan names among its runs, and that has no test plan of its own, is part of that
    other, and is not listed.

    Raises
    ------
    RecordingError
        If there is none: no input is never a pass.
    """
    found = [p for p in sorted(folder.iterdir()) if _is_recording(p)] if folder.is_dir() else []
    if not found:
        raise RecordingError(
            repr(str(folder)),
            expected=f"a folder with recordings ({', '.join(SUFFIXES)}, or a rosbag2 folder)",
            found="none" if folder.is_dir() else "no such folder",
            remedy="name a folder that holds recordings",
        )
    parts = {part for path in found if path.exists() for part in _further(path) if part != path}
    whole = [path for path in found if path not in parts or own_plan(path).is_file()]
    return whole or found  # of plans that name each other's: each says itself what is wrong


def recordings_of(plan: Path) -> list[Path]:
    """The recordings beside a test plan that are taken by it, by name."""
    beside = [path for path in sorted(plan.parent.iterdir()) if _is_recording(path) and path.exists()]
    return [path for path in beside if _is_plan_of(plan, path)]


def expand(paths: Sequence[Path]) -> list[Path]:
    """Recordings as they are, and for each plain folder the recordings in it."""
    expanded: list[Path] = []
    for path in paths:
        plain_folder = path.is_dir() and not _is_recording(path)
        expanded.extend(recordings(path) if plain_folder else [path])
    return expanded


def write_rules(folder: Path, out: Path) -> Path:
    """Write ``<out>/recordings.mk`` and the listing of each recording; give the rules' path.

    Raises
    ------
    PlanError
        If a recording has no test plan; the rules of the others are written nevertheless.
    DiscoveryError
        If two recordings cannot be told apart, or nothing can be written.
    """
    listings: dict[str, Path] = {}
    taken: set[str] = set()
    unplanned: list[PlanError] = []
    for recording in recordings(folder):
        name = storage.recording_id(recording)
        if name.casefold() in taken:  # one file to a file system without case
            raise DiscoveryError(
                repr(str(recording)),
                expected="one recording of each name in a folder",
                found=f"two that are both called {name!r} in the tables",
                remedy="rename one of them",
            )
        taken.add(name.casefold())
        try:
            text = _listing(recording)
        except PlanError as error:
            unplanned.append(error)
        else:
            listings[name] = out / ".recordings" / f"{name}.json"
            _write_if_changed(listings[name], text)
    rules = out / RULES
    if listings:
        _write_if_changed(rules, _rules(listings))
    if unplanned:
        unplanned[0].faults = tuple(unplanned)
        raise unplanned[0]
    return rules


def listed(listing: Path) -> Path:
    """The recording that a listing names.

    Raises
    ------
    DiscoveryError
        If the file is no listing.
    """
    try:
        return Path(json.loads(listing.read_text(encoding="utf-8"))["recording"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DiscoveryError(
            repr(str(listing)),
            expected="a listing by 'gyrostand discover'",
            found=error.strerror or "none" if isinstance(error, OSError) else "another file",
            remedy="leave --listed out to name a recording itself",
        ) from error


def _is_recording(path: Path) -> bool:
    if path.name.startswith("."):
        return False
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    name = path.name.lower()
    packed = next((c for c in COMPRESSIONS if name.endswith(c)), "")
    return name.removesuffix(packed).endswith(SUFFIXES)


def _is_plan_of(plan: Path, recording: Path) -> bool:
    try:
        return find_plan(recording) == plan
    except PlanError:
        return False


def _files(recording: Path) -> list[Path]:
    return [p for p in sorted(recording.rglob("*")) if p.is_file()] if recording.is_dir() else [recording]


def _further(recording: Path) -> tuple[Path, ...]:
    """The further recordings that the test plan of a recording names; none where it has no test plan."""
    try:
        return named_recordings(find_plan(recording), recording)
    except PlanError:
        return ()


def _listing(recording: Path) -> str:
    plan = find_plan(recording)
    of = (recording, *(part for part in named_recordings(plan, recording) if part.exists()))
    files = [file for path in of for file in _files(path)]
    calibration = named_calibration(plan, recording)
    also = [plan] if calibration is None or not calibration.is_file() else [plan, calibration]
    stamps = {str(p): [p.stat().st_size, p.stat().st_mtime_ns] for p in (*files, *also)}
    facts = {"recording": str(recording), "files": stamps, "code": runner.code_fingerprint()}
    return json.dumps(facts, indent=1) + "\n"


def _rules(names: Iterable[str]) -> str:
    """Rules of make, which runs them in the output folder.

    The names are safe by `storage.recording_id`; the output folder, and the folder that the recordings' names
    start from, may hold a blank, and so are variables of the shell, $OUT and $ROOT.
    """
    lines = ["# Written by gyrostand discover; do not edit.", "pages:"]
    for name in names:
        listing, page = f".recordings/{name}", f"report/{name}.html"
        lines += [
            f"pages: {page}",
            f"{listing}.done: {listing}.json",
            # The verdicts are judged together, after all recordings have their tables.
            f'\t@cd "$$ROOT" && $(GYROSTAND) run --listed "$$OUT"/$< --id {name} --out "$$OUT" '
            "--defer-verdict",
            "\t@touch $@",
            f"{page}: {listing}.done",
            f'\t@cd "$$ROOT" && $(GYROSTAND) report "$$OUT" --recording {name}',
        ]
    return "\n".join(lines) + "\n"


def _write_if_changed(path: Path, text: str) -> None:
    with writing(path, DiscoveryError):
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
