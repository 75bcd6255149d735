"""The calibration of a finished recording as a file, beside which recordings can be corrected by it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from pipeline import storage
from pipeline.errors import ExitCode
from pipeline.stages._calibration_file import CalibrationError, model_rows, text_of


class Exported(NamedTuple):
    """The text of a calibration file, and the parameters in it that are only *combined*."""

    text: str
    weak: tuple[str, ...]


def exported(out: Path, recording: str | None = None) -> Exported:
    """The calibration file of one finished recording.

    What is weakly determined has a standard error, by which it may be judged: it is exported, and named. What
    is not determined has none, and is refused; so is a sensitivity that is not known to a tenth.

    Parameters
    ----------
    out : Path
        The folder given to ``gyrostand run --out``.
    recording : str, optional
        Its id; by default the only one that has a calibration.

    Raises
    ------
    pipeline.storage.StorageError
        If the recording or its tables are not there, or a table is damaged.
    CalibrationError
        If there are several and none is named (exit code 2), a parameter that correcting a record needs has
        no figure or a sensitivity is too uncertain (1), or it is not of the gyro's own outputs, because they
        were turned or corrected before (2).
    """
    name = _the_calibrated(out, recording)
    parameters = storage.read(out, name, "calibration")
    covariance = storage.read(out, name, "calibration_covariance")
    first = storage.read(out, name, "provenance").slice(0, 1).to_pylist()[0]
    _require_own_outputs(name, first["settings"])
    versions = json.loads(first["versions"])
    said = {key: first[key] for key in ("recording_name", "recording_sha256", "plan_sha256")}
    said["made_with"] = f"gyrostand {versions['gyrostand']}"
    weak = tuple(row["parameter"] for row in model_rows(parameters) if row["state"] != "determined")
    return Exported(text_of(name, parameters, covariance, said), weak)


def _the_calibrated(out: Path, recording: str | None) -> str:
    """The recording that is named, or the only one that is calibrated."""
    finished = storage.recordings(out)
    if recording in finished:
        return recording
    having = [name for name in finished if "calibration" in storage.published(out, name)]
    if recording is None and len(having) == 1:
        return having[0]
    raise CalibrationError(
        repr(str(out)),
        expected=f"the recording {recording!r}" if recording else "a recording with the table calibration",
        found=f"{', '.join(having)}" if having else "none",
        remedy="name one with --recording" if having else "run a recording of the procedure 'rate_table'",
        exit_code=ExitCode.INPUT if recording or not having else ExitCode.USAGE,
    )


def _require_own_outputs(recording: str, settings: str) -> None:
    """Refuse a calibration of rates that were turned to other axes, or corrected, before it was made."""
    gyro = json.loads(settings)["streams"]["gyro"]
    for key, what in (("rotation", "turned to other axes"), ("calibration", "corrected by a calibration")):
        if gyro.get(key) is not None:
            raise CalibrationError(
                f"recording {recording!r}",
                expected="a calibration of the gyro's own outputs",
                found=f"one of rates that were {what} before",
                remedy=f"remove {key} from [streams.gyro] of its test plan, and run it again",
                exit_code=ExitCode.USAGE,
            )
