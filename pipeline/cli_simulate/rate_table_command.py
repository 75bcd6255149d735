"""``gyrostand simulate rate_table``: its options, parsed with their units.

An option about a gyro holds for all axes, or, begun by ``p:``, ``q:`` or ``r:``, for one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli_simulate.axis_options import (
    ANGLE_RANDOM_WALK,
    DEFAULT_WHITE,
    RATE_RANDOM_WALK,
    coefficient,
    known_axes,
    noise_term,
    of_axis,
)
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
    Seed,
    StampNoise,
    Table,
    angle,
    numbers,
    only_with,
    pair,
    quantity,
    timing_errors,
)

if TYPE_CHECKING:
    from pipeline.models.random_error import Term
    from pipeline.simulate.rate_table_settings import Mounting, TableGyro, Thermometer
    from pipeline.simulate.static_settings import Axis


class Method(StrEnum):
    """How the gyro is turned."""

    RATES = "rates"
    TURNS = "turns"
    POSITIONS = "positions"


_OWN: Mapping[tuple[Method, ...], tuple[str, ...]] = MappingProxyType(
    {
        (Method.RATES,): (
            "mounting", "apart", "rates", "dwell", "acceleration", "ripple", "ripple_harmonic", "heading",
            "tilt", "table", "table_rate", "table_noise", "counts_per_turn", "as_counts", "wrapped",
        ),
        (Method.TURNS,): ("turns", "angle_error"),
        (Method.TURNS, Method.POSITIONS): ("rest", "moving"),
    }
)  # fmt: skip
"""Options that mean something for these methods only."""
_DEGREE = math.pi / 180
_PART: Mapping[str, float] = MappingProxyType({"ppm": 1e-6, "%": 1e-2, "1": 1.0})
_ACCELERATION: Mapping[str, float] = MappingProxyType({"deg/s/s": _DEGREE, "rad/s/s": 1.0})
_BIAS_BY_TEMPERATURE: Mapping[str, float] = MappingProxyType(
    {"deg/h/K": _DEGREE / 3600, "deg/s/K": _DEGREE, "rad/s/K": 1.0}
)
_PART_BY_TEMPERATURE: Mapping[str, float] = MappingProxyType({"ppm/K": 1e-6, "%/K": 1e-2, "1/K": 1.0})


def rate_table(
    context: typer.Context,
    path: RecordingPath,
    method: Annotated[
        Method, typer.Option(help="By rates of a table, turns by hand, or six positions.")
    ] = Method.RATES,
    axes: Annotated[str, typer.Option(help="Gyros of the case, of p q r.")] = "p q r",
    mounting: Annotated[
        list[str] | None,
        typer.Option(
            help="A run: axis of the case along the table's, as 'p', '-p' or 'p:NAME'; by default each of "
            "--axes; repeatable."
        ),
    ] = None,
    apart: Annotated[bool, typer.Option("--apart", help="Each run in a recording of its own.")] = False,
    rates: Annotated[str, typer.Option(help="Of the table, in turn, with unit.")] = "0 50 -50 100 -100 deg/s",
    dwell: Annotated[str, typer.Option(help="For which each is held, with unit.")] = "20 s",
    acceleration: Annotated[str, typer.Option(help="Between them, with unit.")] = "50 deg/s/s",
    ripple: Annotated[str, typer.Option(help="Part of the rate that swings with the angle.")] = "0 ppm",
    ripple_harmonic: Annotated[int, typer.Option(help="Swings a turn.")] = 12,
    turns: Annotated[str, typer.Option(help="By hand about each axis, with unit.")] = "360 -360 deg",
    rest: Annotated[str, typer.Option(help="Between turns or in a position, with unit.")] = "20 s",
    moving: Annotated[str, typer.Option(help="Time that a turn by hand takes, with unit.")] = "5 s",
    pause: Annotated[str, typer.Option(help="Between runs, unrecorded, with unit.")] = "1 min",
    rate: Annotated[float, typer.Option(help="Samples of the gyros a second, Hz.")] = 100.0,
    means: Annotated[
        bool, typer.Option("--means", help="Samples are means over the step before, not instants.")
    ] = False,
    scale_factor_error: Annotated[
        list[str] | None, typer.Option(help="K - 1, such as '500 ppm' or 'q: -0.1 %'; also for one axis.")
    ] = None,
    asymmetry: Annotated[list[str] | None, typer.Option(help="Such as '200 ppm'; also for one axis.")] = None,
    nonlinearity: Annotated[
        list[str] | None, typer.Option(help="Order and part, such as '3 150 ppm'; repeatable.")
    ] = None,
    full_scale: Annotated[
        str | None, typer.Option(help="Rate that non-linearity refers to; the largest of --rates.")
    ] = None,
    bias: Annotated[list[str] | None, typer.Option(help="Such as '3 deg/h'; also for one axis.")] = None,
    misalignment: Annotated[
        list[str] | None, typer.Option(help="Along the two other axes, such as 'p: 1 -2 mrad'.")
    ] = None,
    bias_temperature: Annotated[list[str] | None, typer.Option(help="Such as '5 deg/h/K'.")] = None,
    scale_factor_temperature: Annotated[list[str] | None, typer.Option(help="Such as '50 ppm/K'.")] = None,
    temperature: Annotated[
        list[str] | None, typer.Option(help="Point of its course, TIME:VALUE, as '600:35 degC'; repeatable.")
    ] = None,
    temperature_rate: Annotated[float, typer.Option(help="Samples of it a second, Hz.")] = 1.0,
    temperature_noise: Annotated[float, typer.Option(help="1 sigma of it, K.")] = 0.0,
    reference_temperature: Annotated[str, typer.Option(help="Of bias and scale factor.")] = "20 degC",
    white: Annotated[
        list[str] | None,
        typer.Option(
            help="Angle random walk N, such as '0.02 deg/sqrt(h)'; 0.01 deg/sqrt(h) for "
            "an axis without any noise."
        ),
    ] = None,
    noise1: Annotated[
        list[str] | None, typer.Option(help="sigma, mu, such as '2 deg/h, 0.01 rad/s'; repeatable.")
    ] = None,
    rate_random_walk: Annotated[
        list[str] | None, typer.Option(help="K, such as '1 deg/h/sqrt(h)'; also for one axis.")
    ] = None,
    quantum: Annotated[str | None, typer.Option(help="Least step of the outputs, with unit.")] = None,
    counts_per_unit: Annotated[
        float | None, typer.Option(help="Record the outputs as whole counts, so many for 1 deg/s.")
    ] = None,
    latitude: Annotated[
        str | None, typer.Option(help="Of the stand, with unit: the gyros measure the Earth's rotation.")
    ] = None,
    heading: Annotated[
        str | None, typer.Option(help="Azimuth of the table's axis 1, with unit; with --latitude.")
    ] = None,
    tilt: Annotated[
        str | None, typer.Option(help="Of the axis of rotation from the vertical; with --latitude.")
    ] = None,
    orientation_error: Annotated[
        str, typer.Option(help="1 sigma of a mounting, position or axis of a turn, with unit.")
    ] = "0 rad",
    angle_error: Annotated[str, typer.Option(help="1 sigma of turns by hand, with unit.")] = "0 rad",
    bias_error: Annotated[str, typer.Option(help="1 sigma of a run's biases, with unit.")] = "0 rad/s",
    table: Annotated[Table, typer.Option(help="What is recorded of the table.")] = Table.TABLE_ANGLE,
    table_rate: Annotated[float, typer.Option(help="Samples of the table a second, Hz.")] = 100.0,
    table_noise: Annotated[str | None, typer.Option(help="1 sigma of its record, with unit.")] = None,
    counts_per_turn: Annotated[int | None, typer.Option(help="Of its encoder; none: no steps.")] = None,
    as_counts: Annotated[bool, typer.Option("--as-counts", help="Record counts, not angles.")] = False,
    wrapped: Annotated[bool, typer.Option("--wrapped", help="Its angle begins again after a turn.")] = False,
    unit: Annotated[
        AngleUnit, typer.Option(help="Of the table's record, and of a text file.")
    ] = AngleUnit.DEG,
    clock_offset: Annotated[float, typer.Option(help="The gyros' stamps minus the table's, s.")] = 0.0,
    stamp_noise: StampNoise = 0.0,
    gap: Gap = None,
    nan_burst: NanBurst = None,
    backward_stamp: BackwardStamp = None,
    repeated_sample: RepeatedSample = None,
    log_delay: LogDelay = 0.0,
    log_jitter: LogJitter = 0.0,
    seed: Seed = 0,
) -> None:
    """Simulate gyros on a rate table, or turned by hand; write recording, test plan (.toml) and truth.

    A gyro's option holds for all axes, or for one: 'q: 0.02 deg/sqrt(h)'. The last that fits stands; of
    non-linearity and noise 1 all are summed.
    """
    from pipeline.simulate.drift_settings import Encoder
    from pipeline.simulate.rate_table import simulate_rate_table
    from pipeline.simulate.rate_table_settings import Hand, Profile, RateTableSettings, TableSensor

    only_with("--latitude", latitude, tilt=tilt is not None, heading=heading is not None)
    known = known_axes(axes)
    _refuse_unused(context, method)
    if method is Method.POSITIONS and latitude is None:
        raise OptionError(
            "--latitude", expected="it, for six positions", found="none", remedy="for example '55.75 deg'"
        )
    if temperature is None and (bias_temperature or scale_factor_temperature):
        raise OptionError(
            "--bias-temperature" if bias_temperature else "--scale-factor-temperature",
            expected="a course of the temperature beside it",
            found="no --temperature",
            remedy="for example --temperature '0:15 degC' --temperature '600:35 degC'",
        )
    single = {
        "--scale-factor-error": scale_factor_error, "--asymmetry": asymmetry, "--bias": bias,
        "--misalignment": misalignment, "--bias-temperature": bias_temperature,
        "--scale-factor-temperature": scale_factor_temperature, "--white": white,
        "--rate-random-walk": rate_random_walk,
    }  # fmt: skip
    summed = {"--nonlinearity": nonlinearity, "--noise1": noise1}
    settings = RateTableSettings(
        gyros={axis: _gyro(axis, known, single, summed) for axis in known},
        method=method.value,
        profile=Profile(
            rates=tuple(_several("--rates", rates, "angular rate")),
            dwell=quantity("--dwell", dwell, "time"),
            acceleration=coefficient("--acceleration", acceleration, _ACCELERATION),
            ripple=coefficient("--ripple", ripple, _PART),
            ripple_harmonic=ripple_harmonic,
        ),
        mountings=tuple(_mounting(text) for text in mounting or known),
        hand=Hand(
            turns=tuple(_several("--turns", turns, "angle")),
            rest=quantity("--rest", rest, "time"),
            moving=quantity("--moving", moving, "time"),
        ),
        pause=quantity("--pause", pause, "time"),
        rate=rate,
        means=means,
        full_scale=None if full_scale is None else quantity("--full-scale", full_scale, "angular rate"),
        quantum=0.0 if quantum is None else quantity("--quantum", quantum, "angular rate"),
        counts_per_unit=counts_per_unit,
        latitude=None if latitude is None else angle("--latitude", latitude, -90, 90),
        heading=quantity("--heading", heading or "0 deg", "angle"),
        tilt=angle("--tilt", tilt or "0 deg", 0, 180),
        orientation_error=quantity("--orientation-error", orientation_error, "angle"),
        angle_error=quantity("--angle-error", angle_error, "angle"),
        bias_error=quantity("--bias-error", bias_error, "angular rate"),
        table=TableSensor(
            quantity=table.value,
            rate=table_rate,
            noise=_table_noise(table, table_noise),
            encoder=Encoder(counts=counts_per_turn, as_counts=as_counts, unit=unit.value, wrapped=wrapped),
        ),
        temperature=_thermometer(temperature, temperature_rate, temperature_noise),
        reference_temperature=_kelvin("--reference-temperature", reference_temperature),
        timing=timing_errors(
            gap,
            nan_burst,
            backward_stamp,
            repeated_sample,
            log_delay,
            log_jitter,
            stamp_noise=stamp_noise,
            clock_offset=clock_offset,
        ),
    )
    written = simulate_rate_table(settings, seed).write(path, angle_unit=unit.value, apart=apart)
    for one in written:
        typer.echo(one)


def _refuse_unused(context: typer.Context, method: Method) -> None:
    """Refuse options that are given and mean nothing for the method."""
    for other, names in _OWN.items():
        given = [name for name in names if _is_given(context, name)]
        if method not in other and given:
            raise OptionError(
                f"--{given[0].replace('_', '-')}",
                expected=f"it only beside --method {' or '.join(other)}",
                found=f"--method {method}",
                remedy="remove it, or choose another method",
            )


def _is_given(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _gyro(
    axis: Axis,
    known: Sequence[Axis],
    single: Mapping[str, Sequence[str] | None],
    summed: Mapping[str, Sequence[str] | None],
) -> TableGyro:
    """One gyro, of the options that hold for it."""
    from pipeline.models.random_error import RateRandomWalk, White
    from pipeline.simulate.rate_table_settings import TableGyro

    last = dict.fromkeys(single, "") | {
        option: text for option, texts in single.items() for text in of_axis(axis, known, option, texts)
    }
    noises = [last["--white"], last["--rate-random-walk"]]
    noises += of_axis(axis, known, "--noise1", summed["--noise1"])
    N = coefficient("--white", last["--white"] or ("" if any(noises) else DEFAULT_WHITE), ANGLE_RANDOM_WALK)
    K = coefficient("--rate-random-walk", last["--rate-random-walk"], RATE_RANDOM_WALK)
    terms: list[Term] = [White(N**2)] if N else []
    terms += [noise_term("--noise1", text) for text in of_axis(axis, known, "--noise1", summed["--noise1"])]
    if K:
        terms.append(RateRandomWalk(K))
    bent = of_axis(axis, known, "--nonlinearity", summed["--nonlinearity"])

    def signed(option: str, factors: Mapping[str, float]) -> float:
        return coefficient(option, last[option], factors, signed=True)

    return TableGyro(
        scale_factor=1 + signed("--scale-factor-error", _PART),
        asymmetry=signed("--asymmetry", _PART),
        nonlinearity=dict(_of_order(text) for text in bent),
        bias=quantity("--bias", last["--bias"] or "0 rad/s", "angular rate"),
        misalignment=pair("--misalignment", last["--misalignment"] or "0 0 rad", "angle"),
        bias_temperature_sensitivity=signed("--bias-temperature", _BIAS_BY_TEMPERATURE),
        scale_factor_temperature_sensitivity=signed("--scale-factor-temperature", _PART_BY_TEMPERATURE),
        terms=tuple(terms),
    )


def _of_order(text: str) -> tuple[int, float]:
    """``ORDER VALUE UNIT``."""
    order, _, value = text.strip().partition(" ")
    if not order.isdecimal() or " " not in value.strip():
        raise OptionError(
            "--nonlinearity",
            expected="an order and a part",
            found=repr(text),
            remedy="for example '3 150 ppm'",
        )
    return int(order), coefficient("--nonlinearity", value, _PART, signed=True)


def _several(option: str, text: str, dimension: str) -> list[float]:
    """Numbers that share a unit, one or more."""
    return numbers(option, text, dimension, max(1, len(text.split()) - 1))


def _mounting(text: str) -> Mounting:
    """``AXIS`` or ``AXIS:NAME``."""
    from pipeline.simulate.rate_table_settings import CASE_AXES, Mounting

    axis, _, name = text.partition(":")
    for known in CASE_AXES:
        if axis.strip() == known:
            return Mounting(axis=known, name=name.strip())
    raise OptionError(
        "--mounting",
        expected=f"one of {', '.join(CASE_AXES)}, and a colon before a name",
        found=repr(text),
        remedy="for example '-p' or '-p:upside down'",
    )


def _table_noise(table: Table, text: str | None) -> float:
    dimension = "angle" if table is Table.TABLE_ANGLE else "angular rate"
    return 0.0 if text is None else quantity("--table-noise", text, dimension)


def _thermometer(points: Sequence[str] | None, rate: float, noise: float) -> Thermometer | None:
    """The course of the temperature by its points; None where there are none."""
    from pipeline.simulate.rate_table_settings import Thermometer

    profile = [_point(text) for text in points or ()]
    return Thermometer(profile=profile, rate=rate, noise=noise) if profile else None


def _point(text: str) -> tuple[float, float]:
    """``TIME:VALUE UNIT`` in s and K."""
    time, colon, value = text.partition(":")
    try:
        return float(time if colon else ""), _kelvin("--temperature", value)
    except ValueError:
        raise OptionError(
            "--temperature", expected="TIME:VALUE UNIT", found=repr(text), remedy="for example '600:35 degC'"
        ) from None


def _kelvin(option: str, text: str) -> float:
    """A temperature with its unit, in K."""
    from pipeline import units

    value = quantity(option, text, "temperature")
    return value + units.zero(text.rsplit(maxsplit=1)[-1])
