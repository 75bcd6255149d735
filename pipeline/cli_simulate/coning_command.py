"""``gyrostand simulate coning``: its options, parsed with their units."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli_simulate.options import (
    BackwardStamp,
    Gap,
    LogDelay,
    LogJitter,
    NanBurst,
    Output,
    RecordingPath,
    RepeatedSample,
    SampleJitter,
    Seed,
    StampNoise,
    quantity,
    timing_errors,
    triple,
)


def coning(
    path: RecordingPath,
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
    sample_jitter: SampleJitter = 0.0,
    stamp_noise: StampNoise = 0.0,
    clock_offset: Annotated[float, typer.Option(help="Gyro's clock minus the reference's, s.")] = 0.0,
    gap: Gap = None,
    nan_burst: NanBurst = None,
    backward_stamp: BackwardStamp = None,
    repeated_sample: RepeatedSample = None,
    log_delay: LogDelay = 0.0,
    log_jitter: LogJitter = 0.0,
    reference_noise: Annotated[
        str, typer.Option(help="1 sigma of the reference attitude, with unit.")
    ] = "0 rad",
    seed: Seed = 0,
) -> None:
    """Simulate a vibration stand; write the recording, its test plan (.toml) and its truth (.truth.json).

    The defaults are the experiment of Godorov & Lutmanov (2016).
    """
    from pipeline.simulate.coning import ConingSettings, simulate_coning
    from pipeline.simulate.imperfections import GyroErrors

    step = "angular rate" if output is Output.ANGULAR_RATE else "angle"
    settings = ConingSettings(
        cone_angle=quantity("--cone-angle", cone_angle, "angle"),
        frequency=frequency,
        rate=rate,
        reference_rate=reference_rate,
        duration=duration,
        first_time=first_time,
        onset=onset,
        smooth_slope=quantity("--smooth-slope", smooth_slope, "angular rate"),
        smooth_offset=quantity("--smooth-offset", smooth_offset, "angle"),
        output=output.value,
        gyro=GyroErrors(
            white_noise=quantity("--white-noise", white_noise, "angular rate"),
            white_angle_noise=quantity("--white-angle-noise", white_angle_noise, "angle"),
            bias=triple("--bias", bias, "angular rate"),
            quantum=0.0 if quantum is None else quantity("--quantum", quantum, step),
            mounting=triple("--mounting", mounting, "angle"),
        ),
        timing=timing_errors(
            gap,
            nan_burst,
            backward_stamp,
            repeated_sample,
            log_delay,
            log_jitter,
            stamp_noise=stamp_noise,
            clock_offset=clock_offset,
            sample_jitter=sample_jitter,
        ),
        reference_noise=quantity("--reference-noise", reference_noise, "angle"),
    )
    for written in simulate_coning(settings, seed).write(path):
        typer.echo(written)
