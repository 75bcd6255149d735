"""``gyrostand simulate navigation``: its options, parsed with their units.

A scenario gives every setting; an option changes one. An option of an aid is begun by its name:
``position: 0.5 m``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli_simulate.options import (
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
    pair,
    quantity,
    span,
    triple,
)

if TYPE_CHECKING:
    from pipeline.models.navigation_problem import AidName
    from pipeline.simulate.navigation_settings import (
        Aid,
        FlightSettings,
        Kind,
        Manoeuvre,
        NavigationSettings,
        Sway,
        SwayAngle,
    )


class Level(StrEnum):
    """What the aids are like."""

    IDEAL = "ideal"
    DIFF = "diff"
    GPS = "gps"


class Output(StrEnum):
    """What the inertial sensors give."""

    RATES = "rates"
    INCREMENTS = "increments"


_DIMENSIONS: Mapping[AidName, str] = MappingProxyType(
    {
        "position": "length",
        "velocity": "speed",
        "airspeed": "speed",
        "altitude": "length",
        "magnetic_field": "magnetic flux density",
        "attitude": "angle",
    }
)
"""The aids, and what their errors measure."""


def navigation(
    path: RecordingPath,
    level: Annotated[Level, typer.Option(help="Of the aids and the air.")] = Level.DIFF,
    sensors: Annotated[int, typer.Option(help="Sensor set, 1 or 2.")] = 2,
    duration: Annotated[float, typer.Option(help="Length of the record, s.")] = 1800.0,
    rate: Annotated[float, typer.Option(help="Inertial samples a second, Hz.")] = 100.0,
    output: Annotated[Output, typer.Option(help="What the inertial sensors give.")] = Output.RATES,
    latitude: Annotated[str | None, typer.Option(help="Of the start, with unit.")] = None,
    longitude: Annotated[str | None, typer.Option(help="Of the start, with unit.")] = None,
    height: Annotated[str | None, typer.Option(help="Above the ellipsoid, with unit.")] = None,
    yaw: Annotated[str | None, typer.Option(help="At the start, with unit.")] = None,
    speed: Annotated[str | None, typer.Option(help="Through the air, with unit.")] = None,
    cruise: Annotated[bool, typer.Option("--cruise", help="Begin at speed, without the catapult.")] = False,
    stand: Annotated[
        bool,
        typer.Option("--stand", help="A level stand or vehicle in place of an aircraft; rests at first."),
    ] = False,
    turn: Annotated[
        list[str] | None, typer.Option(help="'START:LENGTH:ANGLE UNIT', to the right, s; repeatable.")
    ] = None,
    climb: Annotated[list[str] | None, typer.Option(help="'START:LENGTH:HEIGHT UNIT'; repeatable.")] = None,
    accelerate: Annotated[
        list[str] | None, typer.Option(help="'START:LENGTH:SPEED UNIT'; repeatable.")
    ] = None,
    sway: Annotated[
        list[str] | None,
        typer.Option(help="'yaw:FREQUENCY:ANGLE UNIT', Hz, or of pitch or roll; repeatable."),
    ] = None,
    wind: Annotated[str | None, typer.Option(help="Mean, north and east, such as '4 -3 m/s'.")] = None,
    wind_wander: Annotated[str | None, typer.Option(help="1 sigma of its wandering, with unit.")] = None,
    gust: Annotated[str | None, typer.Option(help="1 sigma of the turbulence, with unit.")] = None,
    gyro_bias: Annotated[str | None, typer.Option(help="Of the three axes, such as '0.1 0 0 deg/s'.")] = None,
    accelerometer_bias: Annotated[str | None, typer.Option(help="The same, such as '0 0 5 mg'.")] = None,
    gyro_noise: Annotated[str | None, typer.Option(help="1 sigma of a sample, with unit.")] = None,
    accelerometer_noise: Annotated[str | None, typer.Option(help="The same.")] = None,
    start_error: Annotated[
        str | None, typer.Option(help="1 sigma of yaw, pitch and roll at the start, such as '1 0.5 0.5 deg'.")
    ] = None,
    aids: Annotated[
        str, typer.Option(help="Those that there are; there is attitude too, of an external reference.")
    ] = "position velocity airspeed altitude magnetic_field",
    outage: Annotated[
        list[str] | None, typer.Option(help="Of position and velocity, START:LENGTH in s; repeatable.")
    ] = None,
    aid_outage: Annotated[
        list[str] | None, typer.Option(help="Of one aid: 'airspeed: START:LENGTH', s; repeatable.")
    ] = None,
    aid_rate: Annotated[
        list[str] | None, typer.Option(help="Measurements a second: 'position: 5', Hz; repeatable.")
    ] = None,
    aid_noise: Annotated[
        list[str] | None, typer.Option(help="1 sigma of white noise: 'position: 1 m'; repeatable.")
    ] = None,
    aid_bias: Annotated[list[str] | None, typer.Option(help="'altitude: 3 m'; repeatable.")] = None,
    aid_clock_offset: Annotated[
        list[str] | None, typer.Option(help="Its stamps less the true time: 'position: 0.1', s; repeatable.")
    ] = None,
    aid_clock_rate: Annotated[
        list[str] | None, typer.Option(help="What its clock gains: 'position: 2e-5', s a second; repeatable.")
    ] = None,
    aid_nan_burst: Annotated[
        list[str] | None, typer.Option(help="NaN of one aid: 'position: START:LENGTH', s; repeatable.")
    ] = None,
    truth_rate: Annotated[float, typer.Option(help="Samples of the truth a second, Hz.")] = 10.0,
    stamp_noise: StampNoise = 0.0,
    gap: Gap = None,
    nan_burst: NanBurst = None,
    backward_stamp: BackwardStamp = None,
    repeated_sample: RepeatedSample = None,
    log_delay: LogDelay = 0.0,
    log_jitter: LogJitter = 0.0,
    seed: Seed = 0,
) -> None:
    """Simulate a vehicle with inertial sensors and aids; write recording, test plan (.toml) and truth.

    A level and a sensor set give all settings; the options change them. GNSS, position and velocity, is off
    from 600 s to 1200 s if no outage is stated; '--outage 0:0' is none.
    """
    from pipeline.simulate.imperfections import TimingErrors
    from pipeline.simulate.navigation import simulate_navigation
    from pipeline.simulate.navigation_scenarios import OUTAGE, scenario

    flight = _flight(
        {"latitude": latitude, "longitude": longitude, "height": height, "yaw": yaw, "speed": speed},
        duration,
        cruise=cruise,
        stand=stand,
        changes={"turn": turn, "climb": climb, "accelerate": accelerate},
        sways=[_sway(text) for text in sway or ()],
    )
    gaps = tuple(span("--outage", text) for text in outage) if outage else OUTAGE
    settings = scenario(level.value, sensors, flight=flight, outages=gaps)
    settings = _in_air(settings, wind, wind_wander, gust)
    settings = _with_imu(settings, gyro_bias, accelerometer_bias, gyro_noise, accelerometer_noise)
    settings = replace(settings, aids=_chosen(settings.aids, aids))
    for option, texts, change in (
        ("--aid-outage", aid_outage, _outage),
        ("--aid-rate", aid_rate, _number("rate")),
        ("--aid-noise", aid_noise, _size("noise")),
        ("--aid-bias", aid_bias, _size("bias")),
        ("--aid-clock-offset", aid_clock_offset, _clock_offset),
        ("--aid-clock-rate", aid_clock_rate, _number("clock_rate")),
        ("--aid-nan-burst", aid_nan_burst, _nan_burst),
    ):
        settings = replace(settings, aids=_changed(settings.aids, option, texts, change))
    if start_error is not None:
        drawn = replace(settings.start_errors, attitude=triple("--start-error", start_error, "angle"))
        settings = replace(settings, start_errors=drawn)
    settings = replace(
        settings,
        rate=rate,
        output=output.value,
        truth_rate=truth_rate,
        timing=TimingErrors(
            stamp_noise=stamp_noise,
            gaps=[span("--gap", text) for text in gap or ()],
            nan_bursts=[span("--nan-burst", text) for text in nan_burst or ()],
            backward_stamps=backward_stamp or (),
            repeated_samples=repeated_sample or (),
            log_delay=log_delay,
            log_jitter=log_jitter,
        ),
    )
    for written in simulate_navigation(settings, seed).write(path):
        typer.echo(written)


_OF_START = {
    "latitude": "angle", "longitude": "angle", "height": "length", "yaw": "angle", "speed": "speed"
}  # fmt: skip


def _flight(
    start: Mapping[str, str | None],
    duration: float,
    *,
    cruise: bool,
    stand: bool,
    changes: Mapping[Kind, Sequence[str] | None],
    sways: Sequence[Sway],
) -> FlightSettings:
    """The flight: straight as the scenarios have it, but for what the options say."""
    from pipeline.simulate.navigation_scenarios import CRUISE, STRAIGHT

    stated: dict[str, Any] = {
        name: quantity(f"--{name}", text, _OF_START[name]) for name, text in start.items() if text is not None
    }
    if stand:
        stated = {"speed": 0.0, "lift": None} | stated
    manoeuvres = [_manoeuvre(kind, text) for kind, texts in changes.items() for text in texts or ()]
    return replace(
        CRUISE if cruise or stand else STRAIGHT,
        duration=duration,
        manoeuvres=tuple(manoeuvres),
        sways=tuple(sways),
        **stated,
    )


def _manoeuvre(kind: Kind, text: str) -> Manoeuvre:
    """``START:LENGTH:AMOUNT UNIT``, times in s."""
    from pipeline.simulate.navigation_settings import Manoeuvre

    dimension, example = {
        "turn": ("angle", "90 deg"),
        "climb": ("length", "100 m"),
        "accelerate": ("speed", "10 m/s"),
    }[kind]
    start, _, rest = text.partition(":")
    length, _, amount = rest.partition(":")
    try:
        times = float(start), float(length)
    except ValueError:
        raise OptionError(
            f"--{kind}",
            expected="START:LENGTH:AMOUNT UNIT, times in s",
            found=repr(text),
            remedy=f"for example '100:30:{example}'",
        ) from None
    amount_si = quantity(f"--{kind}", amount, dimension)
    return Manoeuvre(kind=kind, start=times[0], length=times[1], amount=amount_si)


def _sway(text: str) -> Sway:
    """``ANGLE:FREQUENCY:AMPLITUDE UNIT``."""
    from pipeline.simulate.navigation_settings import Sway

    angle, _, rest = text.partition(":")
    frequency, _, amplitude = rest.partition(":")
    known: tuple[SwayAngle, ...] = ("yaw", "pitch", "roll")
    try:
        name = known[known.index(angle)]
        hertz = float(frequency)
    except ValueError:
        raise OptionError(
            "--sway",
            expected="yaw, pitch or roll, a frequency in Hz and an angle, with colons between",
            found=repr(text),
            remedy="for example 'roll:0.2:5 deg'",
        ) from None
    return Sway(angle=name, frequency=hertz, amplitude=quantity("--sway", amplitude, "angle"))


def _in_air(
    settings: NavigationSettings, wind: str | None, wander: str | None, gust: str | None
) -> NavigationSettings:
    """The settings with the wind and the turbulence that are stated."""
    from pipeline.simulate.navigation_settings import Air

    if wind is not None:
        settings = replace(settings, flight=replace(settings.flight, wind=pair("--wind", wind, "speed")))
    gusts, wandering = settings.air.gust.sigma, settings.air.wander.sigma
    return replace(
        settings,
        air=Air.turbulent(
            gusts if gust is None else quantity("--gust", gust, "speed"),
            wandering if wander is None else quantity("--wind-wander", wander, "speed"),
        ),
    )


def _with_imu(
    settings: NavigationSettings,
    gyro_bias: str | None,
    accelerometer_bias: str | None,
    gyro_noise: str | None,
    accelerometer_noise: str | None,
) -> NavigationSettings:
    """The settings with those errors of the inertial sensors that are stated."""
    stated: dict[str, Any] = {}
    if gyro_bias is not None:
        stated["gyro_bias"] = triple("--gyro-bias", gyro_bias, "angular rate")
    if accelerometer_bias is not None:
        stated["accelerometer_bias"] = triple("--accelerometer-bias", accelerometer_bias, "acceleration")
    if gyro_noise is not None:
        stated["gyro_noise"] = quantity("--gyro-noise", gyro_noise, "angular rate")
    if accelerometer_noise is not None:
        stated["accelerometer_noise"] = quantity("--accelerometer-noise", accelerometer_noise, "acceleration")
    return replace(settings, errors=replace(settings.errors, **stated))


def _chosen(aids: Mapping[AidName, Aid], text: str) -> dict[AidName, Aid]:
    """The aids that are named."""
    words = text.replace(",", " ").split()
    for word in words:
        if word not in _DIMENSIONS:
            raise _no_aid("--aids", word)
    return {name: aid for name, aid in aids.items() if name in words}


def _changed(
    aids: Mapping[AidName, Aid],
    option: str,
    texts: Sequence[str] | None,
    change: Callable[[str, AidName, Aid, str], Aid],
) -> dict[AidName, Aid]:
    """The aids with what an option says of them, each time ``AID: TEXT``."""
    changed = dict(aids)
    for word, text in _said(texts):
        name = next((name for name in changed if name == word), None)
        if name is None:
            raise _no_aid(option, word)
        changed[name] = change(option, name, changed[name], text)
    return changed


def _said(texts: Sequence[str] | None) -> Iterator[tuple[str, str]]:
    for text in texts or ():
        word, _, rest = text.partition(":")
        yield word.strip(), rest.strip()


def _no_aid(option: str, word: str) -> OptionError:
    return OptionError(
        option,
        expected="an aid of --aids" if word in _DIMENSIONS else f"an aid of {', '.join(_DIMENSIONS)}",
        found=repr(word),
        remedy="add it to --aids" if word in _DIMENSIONS else "correct it",
    )


def _number(name: str) -> Callable[[str, AidName, Aid, str], Aid]:
    """Change a setting that has no unit."""

    def change(option: str, aid_name: AidName, aid: Aid, text: str) -> Aid:
        changed: dict[str, Any] = {name: _float(option, aid_name, text)}
        return replace(aid, **changed)

    return change


def _size(name: str) -> Callable[[str, AidName, Aid, str], Aid]:
    """Change an error, stated with its unit."""

    def change(option: str, aid_name: AidName, aid: Aid, text: str) -> Aid:
        changed: dict[str, Any] = {name: quantity(option, text, _DIMENSIONS[aid_name])}
        return replace(aid, **changed)

    return change


def _outage(option: str, name: AidName, aid: Aid, text: str) -> Aid:
    del name
    return replace(aid, outages=(*aid.outages, span(option, text)))


def _nan_burst(option: str, name: AidName, aid: Aid, text: str) -> Aid:
    del name
    bursts = (*aid.timing.nan_bursts, span(option, text))
    return replace(aid, timing=replace(aid.timing, nan_bursts=bursts))


def _clock_offset(option: str, name: AidName, aid: Aid, text: str) -> Aid:
    return replace(aid, timing=replace(aid.timing, clock_offset=_float(option, name, text)))


def _float(option: str, name: AidName, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise OptionError(
            option, expected=f"a number after '{name}:'", found=repr(text), remedy=f"for example '{name}: 1'"
        ) from None
