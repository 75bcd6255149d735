"""The channel map of a test plan: which topic or column feeds which channel, in which unit, by which clock.

Nothing here is guessed: a missing unit or clock is a fault of the plan.
"""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from pipeline import units
from pipeline.formats.base import CLOCKS, TextLayout
from pipeline.plan_faults import Fault, refuse
from pipeline.stages.base import Settings as _Settings
from pipeline.stages.quantities import (
    ATTITUDES,
    IN_PART,
    OPTIONAL,
    QUANTITIES,
    STREAMS,
    TURNED,
    WRAPPING,
    Quantity,
    StreamName,
)

ORTHONORMAL = 1e-6
"""Largest deviation of ``R Rᵀ`` from unity: a matrix written with seven decimals passes, one with six may
not, since its rounding alone would turn the axes by 1e-6 rad."""


def _rotation(matrix: Matrix) -> Matrix:
    """Pass a matrix if it is a rotation: rows orthonormal, determinant +1."""
    R = np.array(matrix)
    with np.errstate(all="ignore"):  # absurd numbers give inf or NaN, which are refused
        deviation = float(np.abs(R @ R.T - np.eye(3)).max())
        determinant = float(np.linalg.det(R))
    if not deviation <= ORTHONORMAL:
        refuse(
            [
                Fault(
                    (),
                    f"orthonormal rows, to {ORTHONORMAL:g}",
                    f"a deviation of {deviation:.3g} from orthonormal, determinant {determinant:.6g}",
                    "give every number with seven decimals or more, and each row of length 1",
                )
            ]
        )
    if determinant < 0:
        refuse(
            [
                Fault(
                    (),
                    "a rotation, determinant +1",
                    f"determinant {determinant:.6g}: the axes it leads to are left-handed",
                    "turn the sign of one row, or of the channel that the sensor counts the other way",
                )
            ]
        )
    return matrix


Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
Rotation = Annotated[Matrix, AfterValidator(_rotation)]
Name = Annotated[str, Field(min_length=1)]


class Channel(_Settings):
    """Where one channel comes from. value = sign * (scale * raw + offset), then the unit is converted."""

    field: Name = Field(description="field path of the topic, or column of the text file")
    unit: str = Field(description="unit of the value after scale and offset, e.g. rad/s, deg/s, deg, 1")
    scale: float = Field(1.0, description="unit per raw count")
    offset: float = Field(0.0, description="added after the scale, in the unit")
    sign: Literal[-1, 1] = Field(1, description="-1 turns the channel round")
    wraps_at: float | None = Field(
        None,
        gt=0,
        description="of gimbal and table angles: the raw value, before scale and offset, at which the "
        "encoder begins again at 0, e.g. 1048576 counts",
    )

    @field_validator("scale")
    @classmethod
    def _scale_is_not_zero(cls, scale: float) -> float:
        if scale == 0:
            raise ValueError("a scale other than 0, which would erase the channel; found 0")
        return scale


class Clock(_Settings):
    """Which clock gives the samples their time: exactly one of clock, field and rate."""

    clock: Literal["header_stamp", "log_time", "publish_time"] | None = Field(
        None, description="a clock of the message"
    )
    field: Name | None = Field(None, description="a field or column that holds the time")
    unit: str | None = Field(None, description="unit of that field: s, ms, us, ns, min, h")
    rate: float | None = Field(None, gt=0, description="samples a second, for a file without time, Hz")
    counter: Name | None = Field(
        None, description="with rate: a field that counts samples, so that lost ones leave a gap"
    )
    wraps_at: int | None = Field(
        None, ge=2, le=2**53, description="with counter: the count at which it begins again at 0, e.g. 65536"
    )

    @model_validator(mode="after")
    def _one_source_of_time(self) -> Self:
        sources = [key for key in ("clock", "field", "rate") if getattr(self, key) is not None]
        faults = list(self._misplaced_keys())
        if len(sources) > 1:
            keep = f"keep the one that is meant; {' and '.join(sources)} exclude each other"
            faults.append(Fault((sources[1],), "one of clock, field and rate", " and ".join(sources), keep))
        elif not sources:
            faults.append(Fault((), "a clock", "none chosen", NO_CLOCK))
        if faults:
            refuse(faults)
        return self

    def _misplaced_keys(self) -> list[Fault]:
        """Keys without the one that they belong to, and a unit that is missing or not of time."""
        faults = []
        known = f"units of time: {', '.join(units.FACTORS['time'])}"
        if self.field is not None and self.unit is None:
            faults.append(Fault((), f"key 'unit' beside field = {self.field!r}", "none", f"add it; {known}"))
        elif self.unit is not None and units.factor(self.unit, "time") is None:
            found = repr(self.unit)
            faults.append(Fault(("unit",), "a unit of time", found, units.nearest(self.unit, "time")))
        for key, owner in (("unit", "field"), ("counter", "rate"), ("wraps_at", "counter")):
            if getattr(self, key) is not None and getattr(self, owner) is None:
                faults.append(
                    Fault(
                        (key,), f"{key} only beside {owner}", f"no {owner}", f"add {owner}, or remove {key}"
                    )
                )
        return faults


class Stream(_Settings):
    """One stream: its topic, its clock, its channels and the axes they are measured in."""

    topic: str = Field("", description="topic; leave out for a text file")
    quantity: Quantity = Field(description="what the channels are")
    time: Clock | None = Field(None, description="clock of this stream, in place of [time]")
    delay_s: float = Field(
        0.0,
        ge=-4e9,
        le=4e9,
        description="by which the stamps of this stream are late, or its clock ahead of the others, s",
    )
    channels: dict[str, Channel] = Field(
        min_length=1,
        description="of the quantity: p, q, r; psi, theta, gamma; w, x, y, z; alpha1, alpha2; x, y, z; …",
    )
    rotation: Rotation | None = Field(
        None, description="rows of the rotation matrix from the sensor's axes to the body axes"
    )
    reference_rotation: Rotation | None = Field(
        None,
        description="rows of the rotation matrix from the axes that the reference reports in to the "
        "reference axes (axis 2 is that of psi); of navigation to north, east, down",
    )
    calibration: Name | None = Field(
        None,
        description="of the gyro's rates: name of the calibration file beside the recording that corrects "
        "them, as 'gyrostand calibration export' writes it",
    )


class Text(_Settings):
    """How a text file is laid out, where it should not be found out by itself."""

    delimiter: str | None = Field(None, description='one character, or "whitespace" for runs of blanks')
    decimal: Literal[".", ","] | None = Field(None, description="decimal mark")
    comment: Name | None = Field(None, description="lines that begin with this are passed over")
    skip_lines: int | None = Field(
        None, ge=0, description="lines before the header, or before the first row where there is none"
    )
    header: bool | None = Field(None, description="whether a line above the rows names the columns")
    columns: tuple[Name, ...] | None = Field(
        None, min_length=1, description="column names, for a file without a header"
    )

    @field_validator("delimiter")
    @classmethod
    def _delimiter_is_one_character(cls, delimiter: str | None) -> str | None:
        if delimiter not in (None, "whitespace") and len(delimiter) != 1:
            raise ValueError(f'one character, or "whitespace"; found {delimiter!r}')
        return delimiter

    @property
    def layout(self) -> TextLayout:
        """The same as the readers want it."""
        return TextLayout(**self.model_dump())


NO_CLOCK = (
    "no clock is chosen: add [time] with "
    + f"clock = … ({', '.join(CLOCKS)}), field = … and unit = …, or rate = …"
)


def channel_faults(name: StreamName, stream: Stream) -> list[Fault]:
    """Whether quantity, channels, units and axes of a stream are such as the stream of that name needs.

    Returns
    -------
    list of Fault
        With keys from ``[streams]``.
    """
    known = STREAMS[name]
    if stream.quantity not in known:
        expected = f"{' or '.join(map(repr, known))} for the stream {name!r}"
        remedy = "correct the quantity, or put the channels into the stream that they belong to"
        return [Fault((name, "quantity"), expected, repr(stream.quantity), remedy)]
    faults = [
        *_name_faults(name, stream),
        *_unit_faults(stream),
        *_field_faults(stream),
        *_wrap_faults(stream),
        *_axes_faults(name, stream),
    ]
    return [fault._replace(key=(name, *fault.key)) for fault in faults]


def _axes_faults(name: StreamName, stream: Stream) -> Iterator[Fault]:
    """Rotations of axes in a stream that has none to turn."""
    if stream.reference_rotation is not None and name not in ATTITUDES:
        expected = f"reference_rotation only in the streams {', '.join(map(repr, ATTITUDES))}"
        remedy = "use rotation, which turns the sensor's axes to the body axes"
        if name == "gimbal":
            remedy = "remove it; scheme or chi_deg of [stand] says how the base is turned"
        yield Fault(("reference_rotation",), expected, f"it in the stream {name!r}", remedy)
    if stream.rotation is None:
        return
    if name == "gimbal":
        expected = "no rotation in the stream 'gimbal', whose angles are about the gimbal's own axes"
        remedy = "remove it; sign and offset of a channel turn it, scheme or chi_deg of [stand] the base"
        yield Fault(("rotation",), expected, "one", remedy)
    elif name not in TURNED:
        expected = f"no rotation in the stream {name!r}, which has no axes to turn"
        yield Fault(("rotation",), expected, "one", "remove it; sign of a channel turns it round")


def _wrap_faults(stream: Stream) -> Iterator[Fault]:
    """Counters that begin again, where none is expected."""
    for name, channel in stream.channels.items():
        if channel.wraps_at is not None and stream.quantity not in WRAPPING:
            expected = f"wraps_at only for quantity {' or '.join(map(repr, WRAPPING))}"
            yield Fault(("channels", name, "wraps_at"), expected, repr(stream.quantity), "remove it")


def missing_channels(stream: Stream) -> Iterator[Fault]:
    """The channels that a stream lacks, as one fault; its key is from the stream."""
    optional = OPTIONAL.get(stream.quantity, ())
    needed = [channel for channel in QUANTITIES[stream.quantity] if channel not in optional]
    missing = [channel for channel in needed if channel not in stream.channels]
    if missing:
        expected = f"the channels {', '.join(needed)} for quantity {stream.quantity!r}"
        remedy = f"add channels.{missing[0]} = {{ field = …, unit = … }}"
        yield Fault(("channels",), expected, f"no {', '.join(missing)}", remedy)


def _name_faults(name: StreamName, stream: Stream) -> Iterator[Fault]:
    """Channels that the quantity does not have, else those that are missing."""
    known = QUANTITIES[stream.quantity]
    strange = [channel for channel in stream.channels if channel not in known]
    expected = f"the channels {', '.join(known)} for quantity {stream.quantity!r}"
    for channel in strange:
        near = get_close_matches(channel, known, n=1, cutoff=0.5)
        remedy = f"did you mean {near[0]!r}?" if near else "remove it, or correct its name"
        yield Fault(("channels", channel), expected, repr(channel), remedy)
    if strange:
        return
    if name not in IN_PART:
        yield from missing_channels(stream)
    elif stream.rotation is not None:
        for fault in missing_channels(stream):
            expected = f"all of {', '.join(known)} beside rotation, which mixes them"
            yield fault._replace(expected=expected, remedy=f"{fault.remedy}, or remove rotation")


def _field_faults(stream: Stream) -> Iterator[Fault]:
    """Channels that are fed from the field of another: a slip of the pen that no figure would show."""
    first: dict[str, str] = {}
    for name, channel in stream.channels.items():
        owner = first.setdefault(channel.field, name)
        if owner != name:
            found = f"{channel.field!r}, which already feeds {owner}"
            yield Fault(
                ("channels", name, "field"), "a field of its own", found, "name the channel's own field"
            )


def _unit_faults(stream: Stream) -> Iterator[Fault]:
    """Units that do not measure what the quantity is."""
    for name, of in QUANTITIES[stream.quantity].items():
        channel = stream.channels.get(name)
        if channel is not None and units.factor(channel.unit, of) is None:
            found = repr(channel.unit) if channel.unit else "'', not filled in"
            expected = f"a unit of {of} for quantity {stream.quantity!r}"
            yield Fault(("channels", name, "unit"), expected, found, units.nearest(channel.unit, of))
