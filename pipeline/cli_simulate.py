"""``gyrostand simulate``: its many options, parsed with their units."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pipeline.errors import ExitCode, GyrostandError

app = typer.Typer(help="Recordings with known truth.", no_args_is_help=True, rich_markup_mode=None)


class Output(StrEnum):
    """What the gyro gives."""

    ANGULAR_RATE = "angular_rate"
    ANGLE_INCREMENT = "angle_increment"


class OptionError(GyrostandError):
    """An option's value is not what it should be."""

    exit_code = ExitCode.USAGE


@app.command()
def samples(out: Annotated[Path, typer.Option("--out", help="Folder for the samples.")]) -> None:
    """Write the project's own sample recordings with their test plans and truth."""
    from pipeline.simulate.samples import write_samples

    for path in write_samples(out):
        typer.echo(path)


@app.command()
def coning(
    path: Annotated[
        Path,
        typer.Argument(
            help="The recording; the suffix says its format: .mcap, .bag, .csv, none for a ROS 2 bag (db3).",
            show_default=False,
        ),
    ],
    cone_angle: Annotated[str, typer.Option(help="Opening angle of the cone, with unit.")] = "1 deg",
    frequency: Annotated[float, typer.Option(help="Of the coning, Hz.")] = 100.0,
    rate: Annotated[float, typer.Option(help="Samples of the gyro a second, Hz.")] = 400.0,
    reference_rate: Annotated[float, typer.Option(help="Samples of the reference a second, Hz.")] = 20_000.0,
    duration: Annotated[float, typer.Option(help="Of the record, s.")] = 1.0,
    first_time: Annotated[float, typer.Option(help="Time of the motion at the first sample, s.")] = 0.0,
    onset: Annotated[
        float | None,
        typer.Option(help="Time of the motion at which the coning begins, s; by default always."),
    ] = None,
    smooth_slope: Annotated[
        str, typer.Option(help="Slope of the roll under the coning, with unit.")
    ] = "0 rad/s",
    smooth_offset: Annotated[str, typer.Option(help="Roll under the coning at time 0, with unit.")] = "0 rad",
    output: Annotated[Output, typer.Option(help="What the gyro gives.")] = Output.ANGULAR_RATE,
    white_noise: Annotated[str, typer.Option(help="1 sigma on each rate sample, with unit.")] = "0 rad/s",
    white_angle_noise: Annotated[str, typer.Option(help="1 sigma on the angle, with unit.")] = "0 rad",
    bias: Annotated[str, typer.Option(help="Of p, q, r: three numbers with one unit.")] = "0 0 0 rad/s",
    quantum: Annotated[
        str | None,
        typer.Option(help="Least step of the output, with its unit (of an angle for increments)."),
    ] = None,
    mounting: Annotated[
        str, typer.Option(help="Rotation vector of the gyro against the body: three numbers with unit.")
    ] = "0 0 0 rad",
    sample_jitter: Annotated[float, typer.Option(help="1 sigma of the sampling instants, s.")] = 0.0,
    stamp_noise: Annotated[float, typer.Option(help="1 sigma of the stamps, s.")] = 0.0,
    clock_offset: Annotated[float, typer.Option(help="Gyro's clock minus the reference's, s.")] = 0.0,
    gap: Annotated[
        list[str] | None, typer.Option(help="Lost samples, START:LENGTH in s; repeatable.")
    ] = None,
    nan_burst: Annotated[
        list[str] | None, typer.Option(help="NaN samples, START:LENGTH in s; repeatable.")
    ] = None,
    backward_stamp: Annotated[list[float] | None, typer.Option(help="A stamp that goes back, at s.")] = None,
    repeated_sample: Annotated[
        list[float] | None, typer.Option(help="A sample recorded twice, at s.")
    ] = None,
    log_delay: Annotated[float, typer.Option(help="Of the recorder's clock behind the stamps, s.")] = 0.0,
    log_jitter: Annotated[float, typer.Option(help="1 sigma of the recorder's delay, s.")] = 0.0,
    reference_noise: Annotated[
        str, typer.Option(help="1 sigma of the reference attitude, with unit.")
    ] = "0 rad",
    seed: Annotated[int, typer.Option(min=0, help="Of all that is random.")] = 0,
) -> None:
    """Simulate a vibration stand; write the recording, its test plan (.toml) and its truth (.truth.json).

    The defaults are the experiment of Godorov & Lutmanov (2016).
    """
    from pipeline.simulate.coning import ConingSettings, simulate_coning
    from pipeline.simulate.imperfections import GyroErrors, TimingErrors

    step = "angular rate" if output is Output.ANGULAR_RATE else "angle"
    settings = ConingSettings(
        cone_angle=_quantity("--cone-angle", cone_angle, "angle"),
        frequency=frequency,
        rate=rate,
        reference_rate=reference_rate,
        duration=duration,
        first_time=first_time,
        onset=onset,
        smooth_slope=_quantity("--smooth-slope", smooth_slope, "angular rate"),
        smooth_offset=_quantity("--smooth-offset", smooth_offset, "angle"),
        output=output.value,
        gyro=GyroErrors(
            white_noise=_quantity("--white-noise", white_noise, "angular rate"),
            white_angle_noise=_quantity("--white-angle-noise", white_angle_noise, "angle"),
            bias=_triple("--bias", bias, "angular rate"),
            quantum=0.0 if quantum is None else _quantity("--quantum", quantum, step),
            mounting=_triple("--mounting", mounting, "angle"),
        ),
        timing=TimingErrors(
            sample_jitter=sample_jitter,
            stamp_noise=stamp_noise,
            clock_offset=clock_offset,
            gaps=[_span("--gap", text) for text in gap or ()],
            nan_bursts=[_span("--nan-burst", text) for text in nan_burst or ()],
            backward_stamps=backward_stamp or (),
            repeated_samples=repeated_sample or (),
            log_delay=log_delay,
            log_jitter=log_jitter,
        ),
        reference_noise=_quantity("--reference-noise", reference_noise, "angle"),
    )
    for written in simulate_coning(settings, seed).write(path):
        typer.echo(written)


def _quantity(option: str, text: str, dimension: str) -> float:
    (value,) = _numbers(option, text, dimension, 1)
    return value


def _triple(option: str, text: str, dimension: str) -> tuple[float, float, float]:
    p, q, r = _numbers(option, text, dimension, 3)
    return p, q, r


def _numbers(option: str, text: str, dimension: str, count: int) -> list[float]:
    """Numbers that share a unit, such as ``1e-4 0 0 rad/s``, in SI and radians."""
    from pipeline import units

    *numbers, unit = text.split() or [""]
    factor = units.factor(unit, dimension)
    try:
        values = [float(number) for number in numbers]
    except ValueError:
        values = []
    if factor is None or len(values) != count:
        raise OptionError(
            option,
            expected=f"{count} number{'s' * (count > 1)} and a unit of {dimension}",
            found=repr(text),
            remedy=units.nearest(unit, dimension) if factor is None else "give the numbers before the unit",
        )
    return [value * factor for value in values]


def _span(option: str, text: str) -> tuple[float, float]:
    start, _, length = text.partition(":")
    try:
        return float(start), float(length)
    except ValueError:
        raise OptionError(
            option, expected="START:LENGTH in seconds", found=repr(text), remedy="for example 0.5:0.02"
        ) from None
