"""The file of a calibration: what ``gyrostand calibration export`` writes and a test plan's gyro names.

It is JSON, one parameter a line, so that versions of it can be compared: each model of
`models.rate_table_model` (a gyro) or `models.rate_table_triad_model` (a case of three) with its parameters,
their standard errors and correlations, and from which recording it came. The outputs that it corrects are
rates in rad/s by unit and scale of a test plan, before its rotation.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models.rate_table_model import AxisCalibration, Terms, axis_calibration
from pipeline.models.rate_table_triad_model import SENSITIVITY, TriadCalibration, triad_names, triad_terms
from pipeline.stages.base import Settings as _Settings

Float = NDArray[np.float64]
Channels = Literal["p q r", "p", "q", "r"]

SUFFIX = ".calibration.json"
"""How the name of such a file ends, by custom."""
FORMAT: Literal["gyrostand calibration"] = "gyrostand calibration"
VERSION: Literal[1] = 1

_TRIAD: Channels = "p q r"
_LARGEST = 2**20
"""Bytes of a file: a triad takes some 4 kB."""
_ROUNDING = 1e-9
"""Eigenvalue below zero of a matrix of correlations that is still none but rounding."""
_INVERTIBLE = 0.1
"""Of the scale factor: the standard error of a sensitivity up to which that of a rate is of first order in
it; the second is a hundredth then."""
_SENSITIVITIES = frozenset({*SENSITIVITY, "scale_factor"})
_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "bias": "rad/s",
        "bias_temperature_sensitivity": "rad/s/K",
        "scale_factor_temperature_sensitivity": "1/K",
    }
)
"""Units of parameters, channel not written; those of the others are pure numbers."""


class CalibrationError(GyrostandError):
    """A calibration is damaged, does not tell enough, or does not fit the record."""

    exit_code = ExitCode.INPUT


class _Parameter(_Settings):
    name: str
    value: float
    standard_error: float = Field(ge=0)
    unit: Literal["1", "rad/s", "rad/s/K", "1/K"]

    @model_validator(mode="after")
    def _unit_is_that_of_the_model(self) -> Self:
        known = unit_of(self.name)
        if self.unit != known:
            raise ValueError(f"{self.name} in {known!r}; found {self.unit!r}")
        return self


class _Model(_Settings):
    channels: Channels
    method: Literal["rates", "turns", "positions", "joined"]
    reference_temperature: float | None = Field(ge=0)
    lowest_temperature: float | None = Field(None, ge=0)
    highest_temperature: float | None = Field(None, ge=0)
    largest_rate: float = Field(gt=0)
    parameters: tuple[_Parameter, ...]
    correlation: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _is_a_model(self) -> Self:
        names = tuple(parameter.name for parameter in self.parameters)
        if _terms(self.channels, names) is None:
            raise ValueError(f"the parameters of a model, in order; found {', '.join(names) or 'none'}")
        if self.reference_temperature is None and any("temperature" in name for name in names):
            raise ValueError("a reference_temperature beside terms of temperature; found null")
        low, high = self.lowest_temperature, self.highest_temperature
        if (low is None) != (high is None) or (low is not None and high is not None and low > high):
            raise ValueError(f"lowest_temperature up to highest_temperature, or neither; found {low}, {high}")
        if tuple(map(len, self.correlation)) != tuple(range(1, len(names) + 1)):
            raise ValueError(f"the lower triangle of {len(names)} correlations; found another shape")
        R = self.correlations
        if not np.array_equal(np.diag(R), np.ones(len(names))) or np.linalg.eigvalsh(R)[0] < -_ROUNDING:
            raise ValueError("correlations, 1 on the diagonal and positive definite; found others")
        told = [parameter.value for parameter in self.parameters if parameter.name in _SENSITIVITIES]
        S = np.array(told).reshape((3, 3) if self.channels == _TRIAD else (1, 1))
        if np.linalg.matrix_rank(S) < len(S):
            raise ValueError("sensitivities that can be inverted; found a singular matrix")
        return self

    @property
    def correlations(self) -> Float:
        """Both triangles, shape (k, k)."""
        L = np.array([(*row, *[0.0] * (len(self.correlation) - len(row))) for row in self.correlation])
        return np.asarray(L + np.tril(L, -1).T, dtype=np.float64)

    @property
    def temperatures(self) -> tuple[float, float] | None:
        """Between which it was calibrated [K]."""
        if self.lowest_temperature is None or self.highest_temperature is None:
            return None
        return self.lowest_temperature, self.highest_temperature

    @property
    def calibration(self) -> AxisCalibration | TriadCalibration:
        """The model itself."""
        value = np.array([parameter.value for parameter in self.parameters])
        error = np.array([parameter.standard_error for parameter in self.parameters])
        covariance = error[:, np.newaxis] * self.correlations * error
        T0 = float("nan") if self.reference_temperature is None else self.reference_temperature
        terms = _terms(self.channels, tuple(parameter.name for parameter in self.parameters))
        assert terms is not None, "checked when the model was made"
        if self.channels == _TRIAD:
            names = triad_names(terms)
            return TriadCalibration(terms, names, value, covariance, error, T0, self.largest_rate)
        return axis_calibration(
            terms, value, covariance, reference_temperature=T0, largest_rate=self.largest_rate
        )


class _File(_Settings):
    format: Literal["gyrostand calibration"]
    version: Literal[1]
    recording: str
    recording_name: str
    recording_sha256: str
    plan_sha256: str
    made_with: str
    outputs: Literal["rad/s"]
    models: tuple[_Model, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _each_channel_has_one_model(self) -> Self:
        channels = self.channels
        if len(set(channels)) < len(channels):
            raise ValueError(f"one model for each channel; found {' and '.join(channels)}")
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """Those that have a model."""
        return tuple(channel for model in self.models for channel in model.channels.split())


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibration as its file holds it.

    Attributes
    ----------
    where : str
        The file, for errors.
    recording, recording_name, recording_sha256 : str
        The recording that it came from: its id, its file name, and the SHA-256 of its bytes.
    models : mapping of str to AxisCalibration or TriadCalibration
        By channel, ``"p q r"`` for the triad.
    methods : mapping of str to str
        By what each was calibrated.
    largest_rate : mapping of str to float
        Up to which each was calibrated [rad/s].
    temperatures : mapping of str to (float, float)
        Between which each that has a term of temperature was calibrated [K]; not all files say it.
    """

    where: str
    recording: str
    recording_name: str
    recording_sha256: str
    models: Mapping[str, AxisCalibration | TriadCalibration]
    methods: Mapping[str, str]
    largest_rate: Mapping[str, float]
    temperatures: Mapping[str, tuple[float, float]]

    @property
    def channels(self) -> tuple[str, ...]:
        """Those that it corrects."""
        return tuple(channel for model in self.models for channel in model.split())

    @property
    def thermal(self) -> bool:
        """Whether it needs the temperature."""
        return any("temperature" in name for model in self.models.values() for name in model.names)


def read(path: Path) -> Calibration:
    """Read the file of a calibration.

    Raises
    ------
    CalibrationError
        If it is not there, not readable, or not such a file (exit code 3).
    """
    where = repr(str(path))
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        raise CalibrationError(
            where,
            expected="the file of a calibration",
            found=error.strerror or str(error),
            remedy="put it beside the recording; 'gyrostand calibration export' writes one",
        ) from error
    return _checked(content, where)


def _checked(content: bytes, where: str) -> Calibration:
    try:
        if len(content) > _LARGEST:
            raise ValueError("more than 1 MiB")
        # not by pydantic: it takes NaN and keys that occur twice
        data = json.loads(content.decode(), object_pairs_hook=_once, parse_constant=_refuse_constant)
        file = _File.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        raise _damaged(where, *_first_fault(error)) from None
    except (ValueError, RecursionError) as error:
        raise _damaged(where, "JSON, as 'gyrostand calibration export' writes it", str(error)) from None
    return Calibration(
        where=where,
        recording=file.recording,
        recording_name=file.recording_name,
        recording_sha256=file.recording_sha256,
        models={model.channels: model.calibration for model in file.models},
        methods={model.channels: model.method for model in file.models},
        largest_rate={model.channels: model.largest_rate for model in file.models},
        temperatures={model.channels: model.temperatures for model in file.models if model.temperatures},
    )


def model_rows(parameters: pa.Table) -> list[dict[str, Any]]:
    """The rows of ``calibration`` that correct a record: the triad's where there is one, else each gyro's."""
    kept = [row for row in parameters.to_pylist() if row["role"] == "model"]
    triad = [row for row in kept if not row["gyro"]]
    return triad or kept


def text_of(recording: str, parameters: pa.Table, covariance: pa.Table, provenance: Mapping[str, str]) -> str:
    """The file's text, from the tables of a calibrated recording.

    Parameters
    ----------
    recording : str
        Its id.
    parameters, covariance : pyarrow.Table
        The tables ``calibration`` and ``calibration_covariance``.
    provenance : mapping
        ``recording_name``, ``recording_sha256``, ``plan_sha256`` and ``made_with``.

    Raises
    ------
    CalibrationError
        If a parameter that correcting a record needs has no figure, or a sensitivity is too uncertain (exit
        code 1).
    """
    where = f"recording {recording!r}"
    kept = model_rows(parameters)
    _require_told(kept, where)
    products = {(row["gyro"], row["row"], row["column"]): row["value"] for row in covariance.to_pylist()}
    models = [
        _lines_of_model(gyro, [row for row in kept if row["gyro"] == gyro], products)
        for gyro in dict.fromkeys(row["gyro"] for row in kept)
    ]
    head = {
        "format": FORMAT,
        "version": VERSION,
        "recording": recording,
        **provenance,
        "outputs": "rad/s",
    }
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}," for key, value in head.items()]
    text = "\n".join(["{", *lines, '  "models": [', ",\n".join(models), "  ]", "}"]) + "\n"
    _checked(text.encode(), where)
    return text


def _require_told(kept: Sequence[Mapping[str, Any]], where: str) -> None:
    """Refuse what has no figure, and sensitivities too uncertain for the inverse of the model."""
    sizes = [abs(row["value"] or 0.0) for row in kept if row["parameter"] in _SENSITIVITIES]
    lacking = [row for row in kept if row["standard_error"] is None]
    told = [row for row in kept if row not in lacking and row["parameter"] in _SENSITIVITIES]
    vague = [row for row in told if row["standard_error"] > _INVERTIBLE * max(sizes)]
    found = [f"none of {_named(lacking)}"] if lacking else []
    if vague:
        worst = max(row["standard_error"] for row in vague)
        up_to = "up to " if len(vague) > 1 else ""
        found.append(f"{_named(vague)} with a standard error of {up_to}{worst:.2g}")
    if not found:
        return
    expected = f"all that correcting a record needs, sensitivities to {_INVERTIBLE:.0%} of the scale factor"
    remedy = "calibrate with rotation about all axes that the gyro has"
    raise CalibrationError(
        where, expected=expected, found=", and ".join(found), remedy=remedy, exit_code=ExitCode.NOT_MET
    )


def _named(told: Sequence[Mapping[str, Any]]) -> str:
    """Parameters in words, those of the triad together."""
    return ", ".join(
        f"{', '.join(row['parameter'] for row in told if row['gyro'] == gyro)} of {gyro or 'the triad'}"
        for gyro in dict.fromkeys(row["gyro"] for row in told)
    )


def _lines_of_model(
    gyro: str, parameters: Sequence[Mapping[str, Any]], products: Mapping[tuple[str, str, str], float]
) -> str:
    """One model as JSON, one parameter and one row of correlations a line."""
    first, names = parameters[0], [row["parameter"] for row in parameters]
    error = [row["standard_error"] for row in parameters]
    head = {
        "channels": gyro or _TRIAD,
        "method": first["method"],
        **{key: first[key] for key in ("reference_temperature", "lowest_temperature", "highest_temperature")},
        "largest_rate": first["largest_rate"],
    }
    stated = [
        {"name": row["parameter"], **{key: row[key] for key in ("value", "standard_error", "unit")}}
        for row in parameters
    ]
    correlation = [
        [_correlation(products[gyro, a, b], s, error[k]) for k, b in enumerate(names[:j])] + [1.0]
        for j, (a, s) in enumerate(zip(names, error, strict=True))
    ]
    return "\n".join(
        [
            "    {",
            *(f"      {json.dumps(key)}: {json.dumps(value)}," for key, value in head.items()),
            '      "parameters": [',
            ",\n".join(f"        {json.dumps(one)}" for one in stated),
            "      ],",
            '      "correlation": [',
            ",\n".join(f"        {json.dumps(one)}" for one in correlation),
            "      ]",
            "    }",
        ]
    )


def _correlation(product: float, one: float, other: float) -> float:
    return product / (one * other) if one and other else 0.0


def _terms(channels: Channels, names: tuple[str, ...]) -> Terms | None:
    """The terms of the model of these channels that has these parameters, in order; None: there is none."""
    return triad_terms(names, channels.split()) if channels == _TRIAD else Terms.of_names(names)


def unit_of(name: str) -> str:
    """Unit of a parameter of a gyro, or of a gyro of the triad."""
    return _UNITS.get(name[:-2] if name[-2:] in ("_p", "_q", "_r") else name, "1")


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """The pairs as a mapping, each key once."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        raise ValueError("a key that occurs twice")
    return mapping


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word}, which is no number")


def _first_fault(error: ValidationError) -> tuple[str, str]:
    """What was expected, and what found, of the first thing that is wrong."""
    details = error.errors(include_url=False)[0]
    if details["type"] == "value_error":
        expected, _, found = str(details["ctx"]["error"]).partition("; found ")
        return expected, found
    key = ".".join(str(part) for part in details["loc"]) or "the file"
    if details["type"] == "missing":
        return f"the key {key}", "none"
    if details["type"] == "extra_forbidden":
        return "no key beside those that 'gyrostand calibration export' writes", repr(key)
    found = repr(details["input"])
    said = details["msg"][:1].lower() + details["msg"][1:]
    return f"{key}: {said}", found if len(found) < 60 else f"{found[:60]}…"


def _damaged(where: str, expected: str, found: str) -> CalibrationError:
    remedy = "restore the file, or make it anew with 'gyrostand calibration export'"
    return CalibrationError(where, expected=expected, found=found, remedy=remedy)
