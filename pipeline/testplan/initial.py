"""A first test plan from what a recording holds: ``gyrostand plan init``.

Types of messages and names of fields suggest which are the gyro and the reference, the table or the gimbal,
and with that the procedure; the plan says so in comments, for the engineer to confirm. A unit is written
where the file itself states it, and a clock where there is but one; every other is a blank, marked FILL IN,
that ``gyrostand plan check`` refuses.

Every name comes from the recording, and is hostile: it is escaped, in strings and in comments.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pipeline import units
from pipeline.formats.base import Field, Inspection, Topic
from pipeline.stages.quantities import QUANTITIES, TURNED, StreamName
from pipeline.testplan import initial_texts as texts
from pipeline.testplan.candidates import AIDS, Candidate, bare, find_candidates
from pipeline.testplan.load import own_plan

_WIDTH = 110
_LISTED = 100
"""Fields of one topic that are listed in the comments at the end."""

_TIME = re.compile(r"^t(?:_(?:s|sec|ms|us|ns))?$|^(?i:seconds)$|(?i:time|stamp|elapsed)")
"""A lower-case t alone is a time, a capital one a temperature."""
_COUNTER = re.compile(r"packet|count|seq|sample|index|frame", re.IGNORECASE)

_OF_VEHICLE: Mapping[StreamName, StreamName] = {"reference": "external_attitude"}
"""What a stream is called where the gyro moves."""


@dataclass(slots=True)
class _Plan:
    """Lines of the plan, and the fields that are in it."""

    lines: list[str] = field(default_factory=list)
    used: set[tuple[str, str]] = field(default_factory=set)

    def add(self, *lines: str) -> None:
        self.lines.extend(lines)


def initial_plan(inspection: Inspection) -> str:
    """A commented test plan for a recording.

    Parameters
    ----------
    inspection : Inspection
        What it holds.

    Returns
    -------
    str
        TOML. Where nothing is left to fill in, `load_plan` accepts it as it is.
    """
    candidates = find_candidates(inspection.topics)
    gyro = _first(candidates, "gyro")
    gimbal = _first(candidates, "gimbal")
    moving = _moving(candidates, gyro)
    if moving:
        candidates = [replace(c, stream=_OF_VEHICLE.get(c.stream, c.stream)) for c in candidates]
    else:
        candidates = [c for c in candidates if c.stream not in AIDS]
    second = _first([c for c in candidates if not c.also_rates and c.is_named_so], "reference")
    table = _first(candidates, "turntable") if second is None and not moving else None
    procedures = ("navigation",) if moving else _procedures(gyro, gimbal, second, table)
    procedure = procedures[0]
    wanted = (gimbal,) if procedure == "drift" else (gyro, second, table, *moving)
    chosen = [c for c in wanted if c is not None]
    name = own_plan(inspection.path).name
    plan = _Plan()
    plan.add(
        f"# Test plan for {escaped(inspection.path.name)} ({inspection.format}), by 'gyrostand plan init'.",
        "# Confirm every line, fill in what is marked FILL IN, then: gyrostand plan check " + escaped(name),
        "",
        *(texts.GYRO_ALONE if procedure not in ("drift", "navigation") and second is None else ()),
        f'procedure = "{procedure}"'
        if table is None
        else f'procedure = ""    # FILL IN: {_either(procedures)}',
        'title = ""',
        "",
        "[stand]",
        'name = ""',
        *texts.STAND[procedure],
        "",
    )
    _add_time(plan, chosen, inspection.topics)
    if procedure != "drift" and gyro is None:
        _add_stream(plan, "gyro", None, inspection.topics)
    for candidate in chosen:
        _add_stream(plan, candidate.stream, candidate, inspection.topics)
    if procedure == "navigation":
        plan.add(*texts.NAVIGATE, *(texts.EARTH_FIELD if _first(chosen, "magnetometer") else ()))
    _add_alternatives(plan, [c for c in candidates if c not in chosen])
    _add_limits(plan, procedures)
    _add_rest(plan, inspection.topics)
    return "\n".join(plan.lines) + "\n"


def _procedures(
    gyro: Candidate | None, gimbal: Candidate | None, second: Candidate | None, table: Candidate | None
) -> tuple[str, ...]:
    """What these streams may be for, the likeliest first."""
    if gyro is None and gimbal is not None:
        return ("drift",)
    if table is not None:
        return "static", "rate_table"
    if second is not None:
        return ("coning",)
    return ("coning", "static") if gyro is None or gyro.channels is None else ("static", "rate_table")


def _either(names: Sequence[str]) -> str:
    return " or ".join(f'"{name}"' for name in names)


def _first(candidates: Sequence[Candidate], stream: StreamName) -> Candidate | None:
    return next((c for c in candidates if c.stream == stream), None)


def _moving(candidates: Sequence[Candidate], gyro: Candidate | None) -> tuple[Candidate, ...]:
    """The further streams of a vehicle, where satellites tell its place; else none."""
    if gyro is None or _first(candidates, "gnss_position") is None:
        return ()
    own = [c for c in candidates if c.stream == "accelerometer" and c.topic is gyro.topic]
    force = _first(own or candidates, "accelerometer")
    if force is None:
        return ()
    aids: tuple[StreamName, ...] = ("gnss_position", "magnetometer", "barometer")
    return (force, *(c for c in (_first(candidates, aid) for aid in aids) if c is not None))


def quoted(text: str) -> str:
    """A name as a TOML string."""
    return f'"{escaped(text)}"'


def escaped(text: str) -> str:
    """A name as it may stand in a TOML string or comment: one line, nothing that ends either."""
    return "".join(_escape(character) for character in text)


def _escape(character: str) -> str:
    code = ord(character)
    if character in '"\\':
        return f"\\{character}"
    if 0xD800 <= code <= 0xDFFF:  # half a character, as a broken file name has it; TOML cannot say it
        return "\\uFFFD"
    if character.isprintable():
        return character
    return f"\\u{code:04X}" if code <= 0xFFFF else f"\\U{code:08X}"


def _add_time(plan: _Plan, chosen: Sequence[Candidate], topics: Sequence[Topic]) -> None:
    """The clock: written where there is but one, else all of them as comments."""
    with_streams = {c.topic.name: c.topic for c in chosen} or {t.name: t for t in topics}
    text = next((t for t in with_streams.values() if not t.name and not t.clocks), None)
    if text is not None:
        _add_text_time(plan, text)
        return
    own = f"[streams.{chosen[0].stream if chosen else 'gyro'}.time]"
    plan.add(f"[time]    # FILL IN: take the # from one clock; a stream may have its own, {own}")
    for topic in with_streams.values():
        for clock, (first, last) in topic.clocks.items():
            plan.add(f'# clock = "{clock}"    # {escaped(topic.name)}: {_span(topic.count, first, last)}')
    plan.add("# field = … and unit = …    # a field of the message that holds the time", "")


def _add_text_time(plan: _Plan, topic: Topic) -> None:
    times = [f for f in topic.fields if _TIME.search(bare(f.path))]
    counters = [f for f in topic.fields if _COUNTER.search(f.path) and f not in times]
    if len(times) == 1:
        unit, remark = _unit(times[0], "time")
        plan.add("[time]", f"field = {quoted(times[0].path)}", f"unit = {quoted(unit)}{remark}", "")
        plan.used.add((topic.name, times[0].path))
        return
    plan.add(f"[time]    # FILL IN: {'one of' if times else 'no column of the file looks like a time; give'}")
    for one in times:
        unit = units.canonical(one.unit) if one.unit and units.factor(one.unit, "time") else ""
        plan.add(f"# field = {quoted(one.path)}", f'# unit = "{unit}"    # s, ms, us or ns')
    plan.add("# rate = 400.0    # samples a second")
    for one in counters:
        plan.add(f"# counter = {quoted(one.path)}    # with rate: counts the samples, lost ones leave a gap")
    plan.add("")


def _span(count: int, first: int, last: int) -> str:
    """What a clock shows, so that an engineer sees which is sound."""
    if first == last == 0:
        return "all 0, never set: no clock"
    seconds = (last - first) * 1e-9
    rate = f", mean {(count - 1) / seconds:.6g} Hz" if count > 1 and seconds > 0 else ""
    return f"{count} samples, {first} … {last} ns, {seconds:.6g} s{rate}"


def _add_stream(plan: _Plan, name: StreamName, candidate: Candidate | None, topics: Sequence[Topic]) -> None:
    plan.add(f"[streams.{name}]")
    if candidate is None:
        _add_blank_gyro(plan, topics)
    else:
        plan.add(*_stream_lines(candidate))
        plan.used |= {(candidate.topic.name, f.path) for f in candidate.fields}
    if name == "gimbal":
        plan.add(*texts.GIMBAL, "")
        return
    if name == "turntable":
        plan.add(*texts.TABLE, "")
        return
    if name in TURNED:
        plan.add(texts.ROTATION)
    if name == "reference":
        plan.add(
            "# reference_rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]    # rows: to axes of which 2 is psi's"
        )
    plan.add("")


def _stream_lines(candidate: Candidate) -> Iterator[str]:
    topic = candidate.topic
    if topic.name:
        about = f"{escaped(topic.message_type)}, {topic.count} messages"
        yield f"topic = {quoted(topic.name)}    # {about}"
    yield f'quantity = "{candidate.quantity}"'
    dimensions = QUANTITIES[candidate.quantity]
    if candidate.channels == ():
        yield "# One gyro, taken for p: the name does not say which of p, q and r it is."
    names = tuple(dimensions) if candidate.channels is None else candidate.channels or ("p",)
    for channel, one in zip(names, candidate.fields, strict=False):  # some may lack
        unit, remark = _unit(one, dimensions[channel], topic.message_type)
        if candidate.stream == "turntable":
            remark = remark.replace("rad/s or deg/s", "rad/s, deg/s or rpm")
        yield f"channels.{channel} = {{ field = {quoted(one.path)}, unit = {quoted(unit)} }}{remark}"


def _add_blank_gyro(plan: _Plan, topics: Sequence[Topic]) -> None:
    """A gyro that nothing in the recording looks like."""
    plan.add("# Nothing in the recording looks like a gyro; what it holds is listed at the end.")
    if any(t.name for t in topics):
        plan.add('topic = ""    # FILL IN')
    plan.add('quantity = "angular_rate"    # or angle_increment', texts.PART)
    for channel in QUANTITIES["angular_rate"]:
        plan.add(f'channels.{channel} = {{ field = "", unit = "" }}    # FILL IN')


def _unit(one: Field, of: str, message_type: str = "") -> tuple[str, str]:
    """The unit that the file states, or a blank and what may be filled in."""
    if of == "pure number":
        return "1", ""
    if one.unit and units.factor(one.unit, of) is not None:
        return units.canonical(one.unit), ""
    stated = f"; the file says {escaped(one.unit)!r}" if one.unit else ""
    kind = message_type.rsplit("/", maxsplit=1)[-1], of
    defined = f"; the message is defined in {texts.DEFINED[kind]}" if kind in texts.DEFINED else ""
    return "", f"    # FILL IN: {texts.USUAL[of]}{stated}{defined}"


def _add_alternatives(plan: _Plan, others: Sequence[Candidate]) -> None:
    """Further candidates, as comments."""
    for candidate in others:
        why = " (of the message that holds rates: the sensor's own estimate, seldom a reference)"
        plan.add(
            f"# Also looks like {'an' if candidate.stream[0] in 'ae' else 'a'} {candidate.stream}"
            + (why if candidate.stream == "reference" and candidate.also_rates else "")
            + ":",
            f"# [streams.{candidate.stream}]",
            *(f"# {line}" for line in _stream_lines(candidate)),
            "",
        )


def _add_limits(plan: _Plan, procedures: Sequence[str]) -> None:
    for name in procedures:
        of = f" Of the procedure {name}:" if len(procedures) > 1 else ""
        plan.add(
            f"# What a figure must be for the recording to pass; any number of these.{of}", "# [[limits]]"
        )
        plan.add(*(f"# {line}" for line in texts.LIMIT[name]), "")


def _add_rest(plan: _Plan, topics: Sequence[Topic]) -> None:
    """Everything else that the recording holds, as comments."""
    plan.add("# What else the recording holds:" if topics else "# The recording holds nothing.")
    for topic in topics:
        rest = [f for f in topic.fields if (topic.name, f.path) not in plan.used]
        head = f"{escaped(topic.name) or 'columns'}: "
        if topic.name:
            head = f"{escaped(topic.name)}  {escaped(topic.message_type)}  {topic.count} messages: "
        listed = [escaped(f.path) for f in rest[:_LISTED]]
        if len(rest) > _LISTED:
            listed.append(f"and {len(rest) - _LISTED} more, see 'gyrostand inspect'")
        if topic.problem:
            listed.append(f"cannot be decoded: {escaped(topic.problem)}")
        plan.add(
            *textwrap.wrap(
                head + ", ".join(listed),
                _WIDTH,
                initial_indent="#   ",
                subsequent_indent="#       ",
                break_long_words=False,
                break_on_hyphens=False,
            )
        )
