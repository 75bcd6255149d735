"""``gyrostand simulate drift``: its options, parsed with their units."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli_simulate.options import (
    AngleUnit,
    BackwardStamp,
    Gap,
    LogDelay,
    LogJitter,
    NanBurst,
    OptionError,
    RecordingPath,
    RepeatedSample,
    SampleJitter,
    Seed,
    StampNoise,
    angle,
    numbers,
    pair,
    quantity,
    timing_errors,
    triple,
)

if TYPE_CHECKING:
    from pipeline.simulate.drift_settings import DriftRun


class Scheme(StrEnum):
    """How the base of the gimbal is mounted."""

    POLAR = "polar"
    EQUATORIAL = "equatorial"
    HORIZONTAL = "horizontal"
    VERTICAL = "vertical"


_RUN_KEYS: Mapping[str, str] = MappingProxyType(
    {
        "name": "a word",
        "scheme": ", ".join(Scheme),
        "chi": "three numbers and a unit of angle",
        "start": "two numbers and a unit of angle",
        "delta_chi": "three numbers and a unit of angle",
        "delta_chi_increments": "three numbers and a unit of angle",
        "hours": "a number",
    }
)
"""What a run may say of itself, and how; what it leaves out is as the command's other options say."""


def drift(
    path: RecordingPath,
    latitude: Annotated[str, typer.Option(help="Of the stand, north positive, with unit.")] = "55.75 deg",
    scheme: Annotated[
        Scheme | None, typer.Option(help="How the base is mounted; polar where nothing is said.")
    ] = None,
    chi: Annotated[
        str | None, typer.Option(help="Mounting angles in place of a scheme: three numbers with unit.")
    ] = None,
    m11: Annotated[str, typer.Option(help="Drift, a pure number (of the Earth rate) or with unit.")] = "0",
    m12: Annotated[str, typer.Option(help="The same.")] = "0",
    m21: Annotated[str, typer.Option(help="The same.")] = "0",
    m22: Annotated[str, typer.Option(help="The same.")] = "0",
    mc1: Annotated[str, typer.Option(help="The same.")] = "0",
    mc2: Annotated[str, typer.Option(help="The same.")] = "0",
    theta: Annotated[str, typer.Option(help="Tilt of the rotor: two numbers with unit.")] = "0 0 rad",
    delta_chi: Annotated[
        str, typer.Option(help="Misalignment of the base, a rotation vector: three numbers with unit.")
    ] = "0 0 0 rad",
    delta_chi_increments: Annotated[
        str, typer.Option(help="Misalignment as increments of the mounting angles: three numbers with unit.")
    ] = "0 0 0 rad",
    start: Annotated[str, typer.Option(help="alpha1 and alpha2 at the start, with unit.")] = "0 0 rad",
    hours: Annotated[float, typer.Option(help="Length of a run, h.")] = 24.0,
    interval: Annotated[str, typer.Option(help="Between samples, with unit.")] = "10 s",
    run: Annotated[
        list[str] | None,
        typer.Option(help="A run, such as 'scheme=equatorial,start=0 0.8 rad,hours=12'; repeatable."),
    ] = None,
    pause: Annotated[str, typer.Option(help="Between runs, with unit.")] = "1 h",
    transient: Annotated[
        str | None,
        typer.Option(
            help="Drift m11 m12 m21 m22 mc1 mc2 at a run's start: six numbers, with or without unit."
        ),
    ] = None,
    transient_time: Annotated[str, typer.Option(help="In which it falls to 1/e, with unit.")] = "1 h",
    servo_jump: Annotated[
        list[str] | None,
        typer.Option(help="The servo loses the rotor: 'TIME:JUMP1 JUMP2 UNIT', time in s; repeatable."),
    ] = None,
    noise: Annotated[str, typer.Option(help="1 sigma of each angle, white, with unit.")] = "0 rad",
    coloured_noise: Annotated[str, typer.Option(help="1 sigma, of first order, with unit.")] = "0 rad",
    correlation_time: Annotated[str, typer.Option(help="Of the coloured noise, with unit.")] = "10 min",
    outlier_share: Annotated[float, typer.Option(help="Of the samples.")] = 0.0,
    outlier_size: Annotated[str, typer.Option(help="1 sigma of an outlier, with unit.")] = "1 arcmin",
    counts_per_turn: Annotated[int | None, typer.Option(help="Of the encoders; none: no steps.")] = None,
    as_counts: Annotated[bool, typer.Option("--as-counts", help="Record counts, not angles.")] = False,
    unit: Annotated[AngleUnit, typer.Option(help="Of the recorded angles.")] = AngleUnit.RAD,
    wrapped: Annotated[bool, typer.Option("--wrapped", help="The values begin again after a turn.")] = False,
    sample_jitter: SampleJitter = 0.0,
    stamp_noise: StampNoise = 0.0,
    gap: Gap = None,
    nan_burst: NanBurst = None,
    backward_stamp: BackwardStamp = None,
    repeated_sample: RepeatedSample = None,
    log_delay: LogDelay = 0.0,
    log_jitter: LogJitter = 0.0,
    seed: Seed = 0,
) -> None:
    """Simulate a non-contact gyro in a gimbal; write the recording, its test plan (.toml) and its truth."""
    from pipeline.simulate.drift import simulate_drift
    from pipeline.simulate.drift_settings import DriftSettings, Encoder
    from pipeline.simulate.imperfections import EncoderErrors

    of_all_runs = {
        "name": "",
        "scheme": scheme.value if scheme else "" if chi else Scheme.POLAR.value,
        "chi": chi or "",
        "start": start,
        "delta_chi": delta_chi,
        "delta_chi_increments": delta_chi_increments,
        "hours": str(hours),
    }
    drifts = {"m11": m11, "m12": m12, "m21": m21, "m22": m22, "mc1": mc1, "mc2": mc2}
    settings = DriftSettings(
        latitude=angle("--latitude", latitude, -90, 90),
        m=_six([_drift(f"--{name}", text, 1)[0] for name, text in drifts.items()]),
        theta=pair("--theta", theta, "angle"),
        runs=tuple(_run(of_all_runs | _of_one_run(text)) for text in run or [""]),
        interval=quantity("--interval", interval, "time"),
        pause=quantity("--pause", pause, "time"),
        transient=None if transient is None else _six(_drift("--transient", transient, 6)),
        transient_time=quantity("--transient-time", transient_time, "time"),
        servo_jumps=[_servo_jump(text) for text in servo_jump or ()],
        encoder=Encoder(counts=counts_per_turn, as_counts=as_counts, unit=unit.value, wrapped=wrapped),
        errors=EncoderErrors(
            white_noise=quantity("--noise", noise, "angle"),
            coloured_noise=quantity("--coloured-noise", coloured_noise, "angle"),
            correlation_time=quantity("--correlation-time", correlation_time, "time"),
            outlier_share=outlier_share,
            outlier_size=quantity("--outlier-size", outlier_size, "angle"),
        ),
        timing=timing_errors(
            gap,
            nan_burst,
            backward_stamp,
            repeated_sample,
            log_delay,
            log_jitter,
            stamp_noise=stamp_noise,
            sample_jitter=sample_jitter,
        ),
    )
    for written in simulate_drift(settings, seed).write(path):
        typer.echo(written)


def _drift(option: str, text: str, count: int) -> list[float]:
    """Drift in units of the Earth rate, from pure numbers or numbers with a unit of angular rate."""
    from pipeline import units
    from pipeline.models.earth import RATE

    words = text.split()
    if words and units.factor(words[-1], "angular rate") is not None:
        return [value / RATE for value in numbers(option, text, "angular rate", count)]
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count:
        raise OptionError(
            option,
            expected=f"{count} number{'s' * (count > 1)}, pure or with a unit of angular rate",
            found=repr(text),
            remedy="for example 0.01, or 0.15 deg/h",
        )
    return values


def _six(values: list[float]) -> tuple[float, float, float, float, float, float]:
    m11, m12, m21, m22, mc1, mc2 = values
    return m11, m12, m21, m22, mc1, mc2


def _of_one_run(text: str) -> dict[str, str]:
    """``key=value,key=value`` as a mapping; one of scheme and chi takes the other's place."""
    said = {}
    for part in text.split(",") if text else ():
        key, equals, value = part.partition("=")
        key = key.strip().replace("-", "_")
        if not equals or key not in _RUN_KEYS:
            raise OptionError(
                "--run",
                expected=f"key=value with one of the keys {', '.join(_RUN_KEYS)}",
                found=repr(part),
                remedy="part them by commas, for example 'scheme=polar,start=0.6 0.5 rad,hours=24'",
            )
        said[key] = value.strip()
    return ({"scheme": "", "chi": ""} if {"scheme", "chi"} & said.keys() else {}) | said


def _run(said: Mapping[str, str]) -> DriftRun:
    """A run from what the options say of it, as text."""
    from pipeline.simulate.drift_settings import DriftRun

    if said["scheme"] and said["scheme"] not in tuple(Scheme):
        raise _not_so("scheme", said["scheme"])
    try:
        hours = float(said["hours"])
    except ValueError:
        raise _not_so("hours", said["hours"]) from None
    return DriftRun(
        name=said["name"],
        scheme=Scheme(said["scheme"]).value if said["scheme"] else None,
        chi=triple("--chi", said["chi"], "angle") if said["chi"] else None,
        start=pair("--start", said["start"], "angle"),
        misalignment=triple("--delta-chi", said["delta_chi"], "angle"),
        increments=triple("--delta-chi-increments", said["delta_chi_increments"], "angle"),
        duration=3600.0 * hours,
    )


def _not_so(key: str, found: str) -> OptionError:
    return OptionError(
        f"--run {key}", expected=_RUN_KEYS[key], found=repr(found), remedy="correct the run's value"
    )


def _servo_jump(text: str) -> tuple[float, float, float]:
    """``TIME:JUMP1 JUMP2 UNIT`` in s and rad."""
    time, _, jumps = text.partition(":")
    first, second = pair("--servo-jump", jumps, "angle")
    try:
        return float(time), first, second
    except ValueError:
        raise OptionError(
            "--servo-jump",
            expected="TIME:JUMP1 JUMP2 UNIT",
            found=repr(text),
            remedy="for example '3600:1 0 deg'",
        ) from None
