"""What a test plan says of a calibration, and what it must say together with its streams, runs and stand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.models.rate_table_model import Terms
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._rate_table_record import AXES
from pipeline.stages._runs import CaseAxis, Run
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.base import Stand
from pipeline.stages.channel_map import Name, Stream
from pipeline.stages.quantities import StreamName

Method = Literal["rates", "turns", "positions"]

HIGHEST_ORDER = 5
"""Of a nonlinearity: higher ones are no longer told apart by the rates of a table."""


class Stretch(_Settings):
    """A stretch of a run, or of the recording where the plan lists no runs."""

    run: Name | None = Field(None, description="name of the run, where the plan lists [[runs]]")
    start: float = Field(ge=0, description="beginning, s from the first gyro sample of the run")
    stop: float = Field(gt=0, description="end, counted as the beginning")

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.stop <= self.start:
            expected = f"a stop after start = {self.start:g}"
            refuse([Fault(("stop",), expected, f"{self.stop:g}", "correct one of them")])
        return self


class Turn(Stretch):
    """A stretch in which the case was turned by a known angle, at rest at either end."""

    axis: CaseAxis = Field(description="axis of the case about which it was turned, right-handed")
    angle_deg: float = Field(description="angle by which it was turned, degrees")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.angle_deg == 0:
            refuse([Fault(("angle_deg",), "an angle other than 0", "0", "list it in calibrate.rests")])
        return self


class Rest(Stretch):
    """A stretch in which the case rested."""


class Position(Stretch):
    """A stretch in which the case rested in a known position."""

    up: CaseAxis = Field(description="axis of the case that points up")
    north: CaseAxis = Field(description="axis of the case that points north")

    @model_validator(mode="after")
    def _is_a_position(self) -> Self:
        if self.up[-1] == self.north[-1]:
            expected = "an axis of the case square to up"
            refuse([Fault(("north",), expected, f"{self.north!r} beside {self.up!r}", "correct one of them")])
        return self


class Settings(_Settings):
    """What the gyro is calibrated by, and which terms its model has."""

    methods: tuple[Method, ...] = Field(
        ("rates",),
        min_length=1,
        description="rates: steps of a rate table; turns: by known angles; positions: at rest, by the "
        "Earth's rate; several are joined",
    )
    asymmetry: bool = Field(True, description="whether either direction has a scale factor of its own")
    nonlinearity: tuple[Annotated[int, Field(ge=2, le=HIGHEST_ORDER)], ...] = Field(
        (), description="orders of the scale factor's nonlinearity, 2 to 5"
    )
    bias_temperature: bool = Field(False, description="whether the bias depends on the temperature")
    scale_factor_temperature: bool = Field(
        False, description="whether the scale factor depends on the temperature"
    )
    reference_temperature: float | None = Field(
        None, gt=0, description="temperature at which bias and scale factor hold, K; None: the mean"
    )
    orientation_error_deg: float = Field(
        0.0,
        ge=0,
        le=10,
        description="of a triad: standard deviation of the case's orientation in each run on the table, and "
        "in each position, about each axis, degrees",
    )
    bias_error_deg_h: float = Field(
        0.0,
        ge=0,
        description="of a triad: standard deviation of the biases of a run about those of all, deg/h",
    )
    turns: tuple[Turn, ...] = Field((), description="stretches in which the case was turned")
    rests: tuple[Rest, ...] = Field((), description="stretches of rest beside the turns")
    turn_angle_error_deg: float = Field(
        0.0, ge=0, description="standard deviation of the angles of the turns, degrees"
    )
    turn_axis_error_deg: float = Field(
        0.0, ge=0, le=10, description="standard deviation of the axes of the turns, degrees"
    )
    positions: tuple[Position, ...] = Field((), description="stretches of rest in known positions")

    @model_validator(mode="after")
    def _methods_have_what_they_need(self) -> Self:
        faults = []
        lists: tuple[tuple[str, Method], ...] = (
            ("turns", "turns"),
            ("rests", "turns"),
            ("positions", "positions"),
        )
        for key, method in lists:
            listed = bool(getattr(self, key))
            if listed and method not in self.methods:
                expected, remedy = f"{method!r} in methods, beside {key}", f"add it, or remove {key}"
                faults.append(Fault(("methods",), expected, ", ".join(self.methods), remedy))
            elif not listed and method in self.methods:
                expected = f"[[calibrate.{key}]], for the method {method!r}"
                faults.append(Fault(("methods",), expected, "none", f"list them, or remove {method!r}"))
        for key, items in (("methods", self.methods), ("nonlinearity", self.nonlinearity)):
            if len(set(items)) < len(items):
                found = ", ".join(map(str, items))
                faults.append(Fault((key,), "each once", found, "remove what is there twice"))
        if faults:
            refuse(faults)
        return self

    @property
    def terms(self) -> Terms:
        """Of a gyro by the rates of a table."""
        return Terms(self.asymmetry, self.nonlinearity, self.bias_temperature, self.scale_factor_temperature)

    @property
    def triad_terms(self) -> Terms:
        """Of each gyro of a triad: those that what it is calibrated by can tell.

        The Earth's rate, and turns by hand, are too small or too rough for the scale factor to depend on
        anything; of a turn only the mean of the rate is known, none of its powers.
        """
        if "rates" not in self.methods:
            return Terms(bias_temperature=self.bias_temperature)
        orders = () if "turns" in self.methods else self.nonlinearity
        return replace(self.terms, nonlinearity=orders)

    @property
    def stretches(self) -> Iterator[tuple[str, int, Stretch]]:
        """All that are listed, with the key and place of each."""
        for key, listed in (("turns", self.turns), ("rests", self.rests), ("positions", self.positions)):
            for place, one in enumerate(listed):
                yield key, place, one


def rate_table_faults(
    streams: Mapping[StreamName, Stream], runs: Sequence[Run], settings: Settings, stand: Stand
) -> Iterator[Fault]:
    """What the calibration needs and the rest of the plan does not say; keys from the plan."""
    yield from _stream_faults(streams, runs, settings)
    yield from _run_faults(runs, settings)
    if "positions" in settings.methods and stand.latitude_deg is None:
        expected = "latitude_deg, for the method 'positions'"
        yield Fault(("stand",), expected, "none", "add latitude_deg = … to [stand]")
    if stand.latitude_deg is not None and stand.table_tilt_deg and stand.table_heading_deg is None:
        expected = "table_heading_deg, beside a tilt of the table's axis"
        yield Fault(("stand",), expected, "none", "add table_heading_deg = … to [stand]")


def _stream_faults(
    streams: Mapping[StreamName, Stream], runs: Sequence[Run], settings: Settings
) -> Iterator[Fault]:
    if "rates" in settings.methods and "turntable" not in streams:
        expected = "streams.turntable, the table's rate or angle, for the method 'rates' of [calibrate]"
        remedy = 'add [streams.turntable], or calibrate.methods = ["turns"] or ["positions"]'
        yield Fault(("streams",), expected, "none", remedy)
    elif "rates" not in settings.methods and "turntable" in streams:
        expected = "'rates' in methods, beside the stream turntable"
        remedy = "add it, or remove [streams.turntable]"
        yield Fault(("calibrate", "methods"), expected, ", ".join(settings.methods), remedy)
    if (settings.bias_temperature or settings.scale_factor_temperature) and "temperature" not in streams:
        expected = "streams.temperature, for terms of temperature in [calibrate]"
        yield Fault(("streams",), expected, "none", "add [streams.temperature], or leave the terms out")
    gyro = streams.get("gyro")
    if gyro is None:
        return
    if gyro.quantity != "angular_rate":
        expected = "'angular_rate' for the procedure 'rate_table'"
        yield Fault(("streams", "gyro", "quantity"), expected, repr(gyro.quantity), "record rates")
        return
    missing = [name for name in AXES if name not in gyro.channels]
    whole = [method for method in settings.methods if method != "rates"]
    if whole and missing:
        expected = f"the channels {', '.join(AXES)}, for the method {whole[0]!r}"
        remedy = f"add channels.{missing[0]} = {{ field = …, unit = … }}"
        yield Fault(("streams", "gyro", "channels"), expected, f"no {', '.join(missing)}", remedy)
    if "rates" in settings.methods and not runs and len(gyro.channels) > 1:
        expected = "which of its axes lies along the table's, of a gyro with several channels"
        remedy = 'add [[runs]] with name = … and axis = "p", "q" or "r"'
        yield Fault(("streams", "gyro", "channels"), expected, "no [[runs]]", remedy)


def _run_faults(runs: Sequence[Run], settings: Settings) -> Iterator[Fault]:
    if "rates" in settings.methods and runs and all(run.axis is None for run in runs):
        expected = "axis, in at least one run, for the method 'rates' of [calibrate]"
        remedy = 'add axis = "p", "q" or "r": which axis of the case lies along the table\'s'
        yield Fault(("runs",), expected, "none", remedy)
    if "rates" not in settings.methods:
        for place, run in enumerate(runs):
            if run.axis is not None:
                expected = "axis only beside the method 'rates' of [calibrate]"
                yield Fault(("runs", place, "axis"), expected, "it", "remove it, or add the method")
    names = [run.name for run in runs]
    for key, place, one in settings.stretches:
        if (one.run not in names) if names else (one.run is not None):
            expected = f"run, one of {', '.join(names)}" if names else "no run, where the plan lists none"
            found = "none" if one.run is None else repr(one.run)
            where = ("calibrate", key, place) if one.run is None else ("calibrate", key, place, "run")
            yield Fault(where, expected, found, "correct it")
