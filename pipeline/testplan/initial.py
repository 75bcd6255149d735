"""A first test plan from what a recording holds: ``gyrostand plan init``.

Types of messages and names of fields suggest which of them are the gyro and the reference; the plan says so
in comments, for the engineer to confirm. A unit is written where the file itself states it, and a clock
where there is but one; every other is a blank, marked FILL IN, that ``gyrostand plan check`` refuses.

Every name comes from the recording, and is hostile: it is escaped, in strings and in comments.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from pipeline import units
from pipeline.formats.base import Field, Inspection, Topic
from pipeline.stages.channel_map import CHANNELS, DIMENSIONS, Quantity, StreamName
from pipeline.testplan.load import own_plan

_WIDTH = 110
_LISTED = 100
"""Fields of one topic that are listed in the comments at the end."""

_UNIT = re.compile(r"\s*(?:\([^()\[\]]*\)|\[[^()\[\]\d]+\])$")
_COMPONENT = re.compile(
    r"(?P<stem>.*?)[\s._-]*(?P<axis>[wxyzpqr]|\[\d\])(?:_(?:rad|deg|r|d)(?:s|_s|ps)?|_dps)?$", re.IGNORECASE
)
_GYRO = re.compile(
    r"gyr|omega|ω|ang(?:ular)?[\s_.]*(?:rate|vel)|body[\s_.]*rate|(?:^|[._\s\]])[gw]$", re.IGNORECASE
)
_QUATERNION = re.compile(r"quat|orientation|attitude|rotation|(?:^|[._\s\]])q$", re.IGNORECASE)
_NO_CHANNEL = re.compile(r"covariance|bias|integral|variance|temp", re.IGNORECASE)
_REFERENCE = re.compile(r"quat|ref|truth|mocap|optic|vicon|encoder", re.IGNORECASE)
_TIME = re.compile(r"^t(?:_(?:s|sec|ms|us|ns))?$|^(?i:seconds)$|(?i:time|stamp|elapsed)")
"""A lower-case t alone is a time, a capital one a temperature."""
_COUNTER = re.compile(r"packet|count|seq|sample|index|frame", re.IGNORECASE)
_AXES = {
    "angular_rate": (("p", "q", "r"), ("x", "y", "z"), ("[0]", "[1]", "[2]")),
    "quaternion": (("w", "x", "y", "z"),),
}
_EULER_KRYLOV = ("psi", "theta", "gamma")


@dataclass(frozen=True, slots=True)
class Candidate:
    """Fields of a topic that may be a stream; ``fields`` in the order of the quantity's channels."""

    stream: StreamName
    quantity: Quantity
    topic: Topic
    fields: tuple[Field, ...]

    @property
    def also_rates(self) -> bool:
        """Whether the message measures rates too: its attitude is then the sensor's own, no reference."""
        return any("angular_velocity" in f.path for f in self.topic.fields)

    @property
    def is_named_so(self) -> bool:
        """Whether more than the shape speaks for it: any pose in a bag holds a quaternion."""
        names = (self.topic.name, self.topic.message_type, self.fields[0].path)
        return not self.topic.name or any(_REFERENCE.search(name) for name in names)


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
    gyro = next((c for c in candidates if c.stream == "gyro"), None)
    references = [c for c in candidates if c.stream == "reference" and not c.also_rates and c.is_named_so]
    reference = next(iter(references), None)
    chosen = [c for c in (gyro, reference) if c is not None]
    name = own_plan(inspection.path).name
    plan = _Plan()
    plan.add(
        f"# Test plan for {escaped(inspection.path.name)} ({inspection.format}), by 'gyrostand plan init'.",
        "# Confirm every line, fill in what is marked FILL IN, then: gyrostand plan check " + escaped(name),
        "",
        'procedure = "coning"',
        'title = ""',
        "",
        "[stand]",
        'name = ""',
        "# returns_to_start = true    # the stand ends the record in the attitude in which it began it",
        "",
    )
    _add_time(plan, chosen, inspection.topics)
    _add_stream(plan, "gyro", gyro, inspection.topics)
    if reference is not None:
        _add_stream(plan, "reference", reference, inspection.topics)
    _add_alternatives(plan, [c for c in candidates if c not in chosen])
    _add_limits(plan)
    _add_rest(plan, inspection.topics)
    return "\n".join(plan.lines) + "\n"


def find_candidates(topics: Iterable[Topic]) -> list[Candidate]:
    """What may be a gyro or a reference, by the names of fields; in the order of the recording."""
    found = []
    for topic in topics:
        components = _components(topic)
        for stem, axes in components.items():
            for names in _AXES["angular_rate"]:
                bare = stem == "" and names[0] == "p"
                if all(axis in axes for axis in names) and (bare or _GYRO.search(stem)):
                    fields = tuple(axes[axis] for axis in names)
                    found.append(Candidate("gyro", "angular_rate", topic, fields))
                    break
            names = _AXES["quaternion"][0]
            if all(axis in axes for axis in names) and (stem == "" or _QUATERNION.search(stem)):
                fields = tuple(axes[axis] for axis in names)
                found.append(Candidate("reference", "quaternion", topic, fields))
        angles = {_bare(f.path).rsplit(".", 1)[-1].lower(): f for f in topic.fields}
        if all(angle in angles for angle in _EULER_KRYLOV):
            fields = tuple(angles[angle] for angle in _EULER_KRYLOV)
            found.append(Candidate("reference", "euler_krylov", topic, fields))
    return found


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


def _bare(path: str) -> str:
    """The name without a unit in brackets."""
    return _UNIT.sub("", path)


def _components(topic: Topic) -> dict[str, dict[str, Field]]:
    """Fields by their stem and axis: ``imu.gyro.x`` is the x of ``imu.gyro``."""
    components: dict[str, dict[str, Field]] = {}
    for one in topic.fields:
        match = _COMPONENT.fullmatch(_bare(one.path))
        if match and not _NO_CHANNEL.search(one.path):
            components.setdefault(match["stem"], {}).setdefault(match["axis"].lower(), one)
    return components


def _add_time(plan: _Plan, chosen: Sequence[Candidate], topics: Sequence[Topic]) -> None:
    """The clock: written where there is but one, else all of them as comments."""
    with_streams = {c.topic.name: c.topic for c in chosen} or {t.name: t for t in topics}
    text = next((t for t in with_streams.values() if not t.name and not t.clocks), None)
    if text is not None:
        _add_text_time(plan, text)
        return
    plan.add("[time]    # FILL IN: take the # from one clock; a stream may have its own, [streams.gyro.time]")
    for topic in with_streams.values():
        for clock, (first, last) in topic.clocks.items():
            plan.add(f'# clock = "{clock}"    # {escaped(topic.name)}: {_span(topic.count, first, last)}')
    plan.add("# field = … and unit = …    # a field of the message that holds the time", "")


def _add_text_time(plan: _Plan, topic: Topic) -> None:
    times = [f for f in topic.fields if _TIME.search(_bare(f.path))]
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
    plan.add(
        "# rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]    # rows: from the sensor's axes to the body axes"
    )
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
    of = DIMENSIONS[candidate.quantity]
    channels = CHANNELS[candidate.stream][candidate.quantity]
    for channel, one in zip(channels, candidate.fields, strict=True):
        unit, remark = _unit(one, of, topic.message_type)
        yield f"channels.{channel} = {{ field = {quoted(one.path)}, unit = {quoted(unit)} }}{remark}"


def _add_blank_gyro(plan: _Plan, topics: Sequence[Topic]) -> None:
    """A gyro that nothing in the recording looks like."""
    plan.add("# Nothing in the recording looks like a gyro; what it holds is listed at the end.")
    if any(t.name for t in topics):
        plan.add('topic = ""    # FILL IN')
    plan.add('quantity = "angular_rate"    # or angle_increment')
    for channel in CHANNELS["gyro"]["angular_rate"]:
        plan.add(f'channels.{channel} = {{ field = "", unit = "" }}    # FILL IN')


def _unit(one: Field, of: str, message_type: str = "") -> tuple[str, str]:
    """The unit that the file states, or a blank and what may be filled in."""
    if of == "pure number":
        return "1", ""
    if one.unit and units.factor(one.unit, of) is not None:
        return units.canonical(one.unit), ""
    usual = {"angular rate": "rad/s or deg/s", "angle": "rad or deg", "time": "s, ms, us or ns"}[of]
    stated = f"; the file says {escaped(one.unit)!r}" if one.unit else ""
    imu = "; the message is defined in rad/s" if message_type.endswith("/Imu") else ""
    return "", f"    # FILL IN: {usual}{stated}{imu}"


def _add_alternatives(plan: _Plan, others: Sequence[Candidate]) -> None:
    """Further candidates, as comments."""
    for candidate in others:
        why = " (of the message that holds rates: the sensor's own estimate, seldom a reference)"
        plan.add(
            f"# Also looks like a {candidate.stream}"
            + (why if candidate.stream == "reference" and candidate.also_rates else "")
            + ":",
            f"# [streams.{candidate.stream}]",
            *(f"# {line}" for line in _stream_lines(candidate)),
            "",
        )


def _add_limits(plan: _Plan) -> None:
    plan.add(
        "# What a figure must be for the recording to pass; any number of these.",
        "# [[limits]]",
        '# metric = "relative_rms_error_corrected"',
        '# channel = "gamma"',
        "# upper = 0.2",
        "# marginal_upper = 0.15",
        "",
    )


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
