"""The calibration of a finished recording as a file, beside which recordings can be corrected by it."""

from __future__ import annotations

import json
from pathlib import Path

from pipeline import storage
from pipeline.errors import ExitCode
from pipeline.stages._calibration_file import CalibrationError, text_of


def exported(out: Path, recording: str | None = None) -> str:
    """The text of the calibration file of one finished recording.

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
        If there are several and none is named (exit code 2), the calibration does not tell all that
        correcting a record needs (1), or it is not of the gyro's own outputs, because they were turned or
        corrected before (2).
    """
    name = _the_calibrated(out) if recording is None else recording
    parameters = storage.read(out, name, "calibration")
    covariance = storage.read(out, name, "calibration_covariance")
    first = storage.read(out, name, "provenance").slice(0, 1).to_pylist()[0]
    _require_own_outputs(name, first["settings"])
    versions = json.loads(first["versions"])
    said = {key: first[key] for key in ("recording_name", "recording_sha256", "plan_sha256")}
    return text_of(name, parameters, covariance, said | {"made_with": f"gyrostand {versions['gyrostand']}"})


def _the_calibrated(out: Path) -> str:
    having = [name for name in storage.recordings(out) if "calibration" in storage.published(out, name)]
    if len(having) == 1:
        return having[0]
    raise CalibrationError(
        repr(str(out)),
        expected="a recording with the table calibration",
        found=f"{', '.join(having)}" if having else "none",
        remedy="name one with --recording" if having else "run a recording of the procedure 'rate_table'",
        exit_code=ExitCode.USAGE if having else ExitCode.INPUT,
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
