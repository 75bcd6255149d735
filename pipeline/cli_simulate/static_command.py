"""``gyrostand simulate static``: its options, parsed with their units.

An option about the errors of an axis holds for all axes, or, begun by ``p:``, ``q:`` or ``r:``, for one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli_simulate.axis_options import (
    ANGLE_RANDOM_WALK,
    DEFAULT_WHITE,
    RAMP,
    RATE_RANDOM_WALK,
    coefficient,
    known_axes,
    noise_term,
    of_axis,
)
from pipeline.cli_simulate.options import (
    BackwardStamp,
    Gap,
    LogDelay,
    LogJitter,
    NanBurst,
    OptionError,
    Output,
    RecordingPath,
    RepeatedSample,
    Seed,
    StampNoise,
    Table,
    angle,
    only_with,
    quantity,
    timing_errors,
)

if TYPE_CHECKING:
    from pipeline.models.random_error import Term
    from pipeline.simulate.static_settings import Axis, AxisErrors, Disturbance


def static(
    path: RecordingPath,
    axes: Annotated[str, typer.Option(help="Those that the gyro has, of p q r.")] = "p q r",
    hours: Annotated[float, typer.Option(help="Length of the record, h.")] = 4.0,
    rate: Annotated[float, typer.Option(help="Samples a second, Hz.")] = 1.0,
    output: Annotated[Output, typer.Option(help="What the gyro gives.")] = Output.ANGLE_INCREMENT,
    white: Annotated[
        list[str] | None,
        typer.Option(
            help="Angle random walk N, such as 'q: 0.02 deg/sqrt(h)'; 0.01 deg/sqrt(h) for "
            "an axis without any noise."
        ),
    ] = None,
    noise1: Annotated[
        list[str] | None,
        typer.Option(help="sigma, mu, such as '2 deg/h, 0.01 rad/s'; repeatable, also for one axis."),
    ] = None,
    noise2: Annotated[
        list[str] | None,
        typer.Option(help="sigma, mu and lambda, such as '2 deg/h, 0.01 0.05 rad/s'; repeatable."),
    ] = None,
    noise3: Annotated[list[str] | None, typer.Option(help="The same.")] = None,
    rate_random_walk: Annotated[
        list[str] | None, typer.Option(help="K, such as '1 deg/h/sqrt(h)'; also for one axis.")
    ] = None,
    quantisation: Annotated[
        list[str] | None,
        typer.Option(help="Q, white noise of the angle, such as '0.1 arcsec'; also for one axis."),
    ] = None,
    bias: Annotated[
        list[str] | None, typer.Option(help="Such as '3 deg/h' or 'r: -1 deg/h'; also for one axis.")
    ] = None,
    ramp: Annotated[
        list[str] | None, typer.Option(help="R of the bias, such as '0.1 deg/h/h'; also for one axis.")
    ] = None,
    quantum: Annotated[
        str | None,
        typer.Option(help="Least step of the output, with its unit (of an angle for increments)."),
    ] = None,
    latitude: Annotated[
        str | None, typer.Option(help="Of the stand, with unit: the gyro measures the Earth's rotation.")
    ] = None,
    tilt: Annotated[
        str | None, typer.Option(help="Of axis r from the vertical to the north; with --latitude.")
    ] = None,
    turning: Annotated[
        str | None, typer.Option(help="Rate at which the platform turns about axis r, with unit.")
    ] = None,
    table: Annotated[
        Table | None,
        typer.Option(help="What is recorded of the platform; table_angle where nothing is said."),
    ] = None,
    wrapped: Annotated[bool, typer.Option("--wrapped", help="Its angle begins again after a turn.")] = False,
    motion: Annotated[
        list[str] | None,
        typer.Option(help="A disturbance that stays, 'START:LENGTH:ANGLE UNIT', times in s; repeatable."),
    ] = None,
    tap: Annotated[
        list[str] | None, typer.Option(help="One that returns, written as a motion; repeatable.")
    ] = None,
    stamp_noise: StampNoise = 0.0,
    gap: Gap = None,
    nan_burst: NanBurst = None,
    backward_stamp: BackwardStamp = None,
    repeated_sample: RepeatedSample = None,
    log_delay: LogDelay = 0.0,
    log_jitter: LogJitter = 0.0,
    seed: Seed = 0,
) -> None:
    """Simulate a gyro at rest or on a turning platform; write recording, test plan (.toml) and truth.

    An error's option holds for all axes, or for one: 'q: 0.02 deg/sqrt(h)'. The last that fits stands; of
    noise 1, 2 and 3 all are summed.
    """
    from pipeline.simulate.static import simulate_static
    from pipeline.simulate.static_settings import StaticSettings, Turning

    only_with("--latitude", latitude, tilt=tilt is not None)
    only_with("--turning", turning, table=table is not None, wrapped=wrapped)
    step = "angular rate" if output is Output.ANGULAR_RATE else "angle"
    known = known_axes(axes)
    coloured = (("--noise1", noise1), ("--noise2", noise2), ("--noise3", noise3))
    sizes = {
        "--white": white, "--rate-random-walk": rate_random_walk, "--quantisation": quantisation,
        "--bias": bias, "--ramp": ramp,
    }  # fmt: skip
    settings = StaticSettings(
        errors={axis: _errors(axis, known, sizes, coloured) for axis in known},
        rate=rate,
        duration=3600.0 * hours,
        output=output.value,
        quantum=0.0 if quantum is None else quantity("--quantum", quantum, step),
        latitude=None if latitude is None else angle("--latitude", latitude, -90, 90),
        tilt=angle("--tilt", tilt or "0 deg", -90, 90),
        turning=None
        if turning is None
        else Turning(
            rate=quantity("--turning", turning, "angular rate"),
            quantity=(table or Table.TABLE_ANGLE).value,
            wrapped=wrapped,
        ),
        disturbances=[
            *(_disturbance("--motion", text, returns=False) for text in motion or ()),
            *(_disturbance("--tap", text, returns=True) for text in tap or ()),
        ],
        timing=timing_errors(
            gap,
            nan_burst,
            backward_stamp,
            repeated_sample,
            log_delay,
            log_jitter,
            stamp_noise=stamp_noise,
        ),
    )
    for written in simulate_static(settings, seed).write(path):
        typer.echo(written)


def _errors(
    axis: Axis,
    known: Sequence[Axis],
    sizes: Mapping[str, Sequence[str] | None],
    coloured: Sequence[tuple[str, Sequence[str] | None]],
) -> AxisErrors:
    """The errors of one axis, of the options that hold for it."""
    from pipeline.models.random_error import RateRandomWalk, White
    from pipeline.simulate.static_settings import AxisErrors

    last = dict.fromkeys(sizes, "") | {
        option: text for option, texts in sizes.items() for text in of_axis(axis, known, option, texts)
    }
    noises = [last[option] for option in ("--white", "--rate-random-walk", "--quantisation")]
    for option, texts in coloured:
        noises += of_axis(axis, known, option, texts)
    N = coefficient("--white", last["--white"] or ("" if any(noises) else DEFAULT_WHITE), ANGLE_RANDOM_WALK)
    K = coefficient("--rate-random-walk", last["--rate-random-walk"], RATE_RANDOM_WALK)
    terms: list[Term] = [White(N**2)] if N else []
    for option, texts in coloured:
        terms += [noise_term(option, text) for text in of_axis(axis, known, option, texts)]
    if K:
        terms.append(RateRandomWalk(K))
    return AxisErrors(
        terms=tuple(terms),
        quantisation=quantity("--quantisation", last["--quantisation"] or "0 rad", "angle"),
        bias=quantity("--bias", last["--bias"] or "0 rad/s", "angular rate"),
        ramp=coefficient("--ramp", last["--ramp"], RAMP, signed=True),
    )


def _disturbance(option: str, text: str, *, returns: bool) -> Disturbance:
    """``START:LENGTH:ANGLE UNIT`` in s and rad."""
    from pipeline.simulate.static_settings import Disturbance

    start, _, rest = text.partition(":")
    length, _, turned = rest.partition(":")
    try:
        if not turned.strip():
            raise ValueError
        times = float(start), float(length)
    except ValueError:
        raise OptionError(
            option,
            expected="START:LENGTH:ANGLE UNIT, times in s",
            found=repr(text),
            remedy="for example '3600:2:10 arcsec'",
        ) from None
    return Disturbance(
        start=times[0], length=times[1], angle=quantity(option, turned, "angle"), returns=returns
    )
