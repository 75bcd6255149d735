"""What in a recording may be a stream, by the names of its fields and the types of its messages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass

from pipeline import units
from pipeline.formats.base import Field, Topic
from pipeline.stages.quantities import Quantity, StreamName

_UNIT = re.compile(r"\s*(?:\([^()\[\]]*\)|\[[^()\[\]\d]+\])$")
_COMPONENT = re.compile(
    r"(?P<stem>.*?)[\s._-]*(?P<axis>[wxyzpqr]|\[\d\])(?:_(?:rad|deg|r|d)(?:s|_s|ps)?|_dps)?$", re.IGNORECASE
)
_GYRO = re.compile(
    r"gyr|omega|ω|ang(?:ular)?[\s_.]*(?:rate|vel)|body[\s_.]*rate|(?:^|[._\s\]])[gw]$", re.IGNORECASE
)
_ONE_GYRO = re.compile(
    r"(?:.*[\s._])?(?:gyro(?:scope)?(?:[\s_.-]*(?:rate|raw|out(?:put)?|counts?|data))?|ang(?:ular)?[\s_.-]*"
    r"(?:rate|vel(?:ocity)?)|omega|ω)",
    re.IGNORECASE,
)
"""A whole name of a gyro of one axis."""
_QUATERNION = re.compile(r"quat|orientation|attitude|rotation|(?:^|[._\s\]])q$", re.IGNORECASE)
_NO_CHANNEL = re.compile(r"covariance|bias|integral|variance|temp", re.IGNORECASE)
_REFERENCE = re.compile(r"quat|ref|truth|mocap|optic|vicon|encoder", re.IGNORECASE)
_GIMBAL = re.compile(r"gimbal|encoder|resolver|alpha|α|(?:^|[._\s])enc(?:[._\s\d\[]|$)", re.IGNORECASE)
_NO_ANGLE = re.compile(
    r"rate|vel|speed|acc|torque|effort|current|volt|error|status|valid|time|stamp|cmd|command", re.IGNORECASE
)
_TABLE = re.compile(
    r"turn[\s_-]?table|tisch|rate[\s_-]?table|(?:^|[\s._/])table(?:[\s._(\[/]|$)", re.IGNORECASE
)
_TABLE_ANGLE = re.compile(r"angle|winkel|position|encoder|(?:^|[._\s])[zθ]$", re.IGNORECASE)
_NO_TABLE = re.compile(
    r"acc|torque|current|volt|error|status|valid|time|stamp|cmd|command|temp|covariance", re.IGNORECASE
)
_TABLE_RATE = re.compile(r"rate|vel|speed|rpm", re.IGNORECASE)
_ENCODER = re.compile(
    r"(?:.*[\s._/])?(?:enc(?:oder)?|resolver|rpm)(?:[\s_.-]*(?:angle|pos(?:ition)?|counts?|raw|deg|rpm|data))?",
    re.IGNORECASE,
)
"""A whole name of what, beside a gyro and alone of its kind, may be that of a table."""
_VECTOR = re.compile(r"(?:.*\.)?vector", re.IGNORECASE)
_NUMBER = re.compile(r"\d+")
_MOST_AXES = 3
"""Encoders of a kind that a gimbal may have; more are an arm."""
_LAST_NUMBER = re.compile(r"(?<!\d)[01](?!\d)(?=\D*$)")
_OUTER = re.compile(r"outer", re.IGNORECASE)
_X = re.compile(r"(?:^|(?<=[._\s]))x$", re.IGNORECASE)
_AXES = {
    "angular_rate": (("p", "q", "r"), ("x", "y", "z"), ("[0]", "[1]", "[2]")),
    "quaternion": (("w", "x", "y", "z"),),
}
_EULER_KRYLOV = ("psi", "theta", "gamma")
_BY_TYPE: dict[str, tuple[StreamName, Quantity, tuple[str, ...]]] = {
    "Imu": ("accelerometer", "specific_force", tuple(f"linear_acceleration.{a}" for a in "xyz")),
    "NavSatFix": (
        "gnss_position",
        "geodetic_position",
        ("latitude", "longitude", "altitude", "status.status"),
    ),
    "MagneticField": ("magnetometer", "magnetic_field", tuple(f"magnetic_field.{a}" for a in "xyz")),
    "FluidPressure": ("barometer", "static_pressure", ("fluid_pressure",)),
}
"""Streams of a navigation that a message's type tells, and the fields of their channels."""

AIDS = tuple(stream for stream, *_ in _BY_TYPE.values())
"""Those streams: beside a gyro that does not move they are of no use."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """Fields of a topic that may be a stream; ``fields`` in the order of the quantity's channels.

    ``channels`` names them where they are not all of the quantity's; of a lone gyro that does not say its
    axis none are named.
    """

    stream: StreamName
    quantity: Quantity
    topic: Topic
    fields: tuple[Field, ...]
    channels: tuple[str, ...] | None = None

    @property
    def also_rates(self) -> bool:
        """Whether the message measures rates too: its attitude is then the sensor's own, no reference."""
        return any("angular_velocity" in f.path for f in self.topic.fields)

    @property
    def is_named_so(self) -> bool:
        """Whether more than the shape speaks for it: any pose in a bag holds a quaternion."""
        names = (self.topic.name, self.topic.message_type, self.fields[0].path)
        return not self.topic.name or any(_REFERENCE.search(name) for name in names)


def find_candidates(topics: Iterable[Topic]) -> list[Candidate]:
    """What may be a stream, by the names of fields and the types of messages, in their order."""
    listed, found = tuple(topics), list[Candidate]()
    for topic in listed:
        found += _gyros(topic)
        found += _references(topic)
        found += [Candidate("gimbal", "gimbal_angles", topic, pair) for pair in _gimbal_pairs(topic)]
        found += _by_type(topic)
        taken = {one.path for c in found if c.topic is topic for one in c.fields}
        found += _tables(topic, taken)
    streams = {c.stream for c in found}
    if "gyro" not in streams:
        tables = {one.path for c in found for one in c.fields if c.stream in ("turntable", "gimbal")}
        found += [c for topic in listed for c in _gyros_in_part(topic, tables)]
    if "turntable" not in streams and any(c.stream == "gyro" for c in found):
        found += _encoder(listed, {(c.topic.name, one.path) for c in found for one in c.fields})
    return found


def _by_type(topic: Topic) -> Iterator[Candidate]:
    """What the type of the message says that it is."""
    known = _BY_TYPE.get(topic.message_type.rsplit("/", maxsplit=1)[-1])
    if known is not None:
        stream, quantity, paths = known
        there = {one.path: one for one in topic.fields}
        if all(path in there for path in paths):
            yield Candidate(stream, quantity, topic, tuple(there[path] for path in paths))


def _gyros(topic: Topic) -> Iterator[Candidate]:
    """Three fields that look like the rates, or the increments, of three axes."""
    for stem, axes in _components(topic).items():
        for names in _AXES["angular_rate"]:
            alone = stem == "" and names[0] == "p"
            of_topic = (
                _VECTOR.fullmatch(stem) and _GYRO.search(topic.name) and not _NO_CHANNEL.search(topic.name)
            )
            if all(axis in axes for axis in names) and (alone or of_topic or _GYRO.search(stem)):
                fields = tuple(axes[axis] for axis in names)
                yield Candidate("gyro", _output(fields), topic, fields)
                break


def _gyros_in_part(topic: Topic, taken: Container[str]) -> Iterator[Candidate]:
    """Fields that look like the rates of one axis or two, by a unit that says so or by a whole name."""
    for stem, axes in _components(topic).items():
        for names in _AXES["angular_rate"]:
            there = {c: axes[a] for c, a in zip("pqr", names, strict=True) if a in axes and _is_rate(axes[a])}
            alone = stem == "" and names[0] == "p"
            if there and (alone or _GYRO.search(stem)) and not any(f.path in taken for f in there.values()):
                fields = tuple(there.values())
                yield Candidate("gyro", _output(fields), topic, fields, tuple(there))
                break
    for one in topic.fields:
        stated = units.dimension(one.unit) if one.unit else None
        named = _ONE_GYRO.fullmatch(bare(one.path)) and stated in (None, "angular rate", "angle")
        if named and one.path not in taken and not _NO_CHANNEL.search(one.path):
            yield Candidate("gyro", _output((one,)), topic, (one,), ())


def _is_rate(one: Field) -> bool:
    return one.unit is not None and units.dimension(one.unit) in ("angular rate", "angle")


def _output(fields: Sequence[Field]) -> Quantity:
    """Increments where the file states units of angle, else rates."""
    angles = all(one.unit is not None and units.dimension(one.unit) == "angle" for one in fields)
    return "angle_increment" if angles else "angular_rate"


def _references(topic: Topic) -> Iterator[Candidate]:
    """Fields that look like an attitude."""
    for stem, axes in _components(topic).items():
        names = _AXES["quaternion"][0]
        if all(axis in axes for axis in names) and (stem == "" or _QUATERNION.search(stem)):
            fields = tuple(axes[axis] for axis in names)
            yield Candidate("reference", "quaternion", topic, fields)
    angles = {bare(f.path).rsplit(".", 1)[-1].lower(): f for f in topic.fields}
    if all(angle in angles for angle in _EULER_KRYLOV):
        fields = tuple(angles[angle] for angle in _EULER_KRYLOV)
        yield Candidate("reference", "euler_krylov", topic, fields)


def _encoder(topics: Sequence[Topic], taken: Container[tuple[str, str]]) -> list[Candidate]:
    """The one encoder, or count of turns, beside a gyro; several are of something else."""
    found = []
    for topic in topics:
        for one in topic.fields:
            path = bare(one.path)
            named = _ENCODER.fullmatch(path) or _ENCODER.fullmatch(f"{topic.name}/{path}")
            if not named or (topic.name, one.path) in taken or _NO_TABLE.search(path):
                continue
            stated = units.dimension(one.unit) if one.unit else None
            if stated == "angular rate" or (stated is None and _TABLE_RATE.search(path)):
                found.append(Candidate("turntable", "table_rate", topic, (one,)))
            elif stated in (None, "angle"):
                found.append(Candidate("turntable", "table_angle", topic, (one,)))
    return found if len(found) == 1 else []


def bare(path: str) -> str:
    """The name without a unit in brackets."""
    return _UNIT.sub("", path)


def _components(topic: Topic) -> dict[str, dict[str, Field]]:
    """Fields by their stem and axis: ``imu.gyro.x`` is the x of ``imu.gyro``."""
    components: dict[str, dict[str, Field]] = {}
    for one in topic.fields:
        match = _COMPONENT.fullmatch(bare(one.path))
        if match and not _NO_CHANNEL.search(one.path):
            components.setdefault(match["stem"], {}).setdefault(match["axis"].lower(), one)
    return components


def _tables(topic: Topic, taken: Container[str]) -> Iterator[Candidate]:
    """Fields that look like the rate or the angle of a table that turns, and are not taken."""
    for one in topic.fields:
        path = bare(one.path)
        of_table = _TABLE.search(path) or _TABLE.search(topic.name)
        if not of_table or one.path in taken or _NO_TABLE.search(path):
            continue
        own = _TABLE.sub(" ", path)  # "rate table angle" is no rate
        stated = units.dimension(one.unit) if one.unit else None
        if stated == "angular rate" or (stated is None and _TABLE_RATE.search(own)):
            yield Candidate("turntable", "table_rate", topic, (one,))
        elif stated == "angle" or (stated is None and _TABLE_ANGLE.search(own)):
            yield Candidate("turntable", "table_angle", topic, (one,))


def _gimbal_pairs(topic: Topic) -> Iterator[tuple[Field, Field]]:
    """Fields that look like the outer and the inner angle of a gimbal: the first of few of a kind."""
    fields = {bare(f.path).casefold(): f for f in topic.fields}
    alike = Counter(_NUMBER.sub("#", path) for path in fields)
    taken: set[str] = set()
    for path, outer in fields.items():
        inner = fields.get(_inner(path, topic) or "")
        if (
            inner is None
            or alike[_NUMBER.sub("#", path)] > _MOST_AXES
            or {outer.path, inner.path} & taken
            or not (_may_be_angle(outer) and _may_be_angle(inner))
        ):
            continue
        taken |= {outer.path, inner.path}
        yield outer, inner


def _inner(path: str, topic: Topic) -> str | None:
    """What the inner angle would be called if this field were the outer one of a gimbal."""
    if _OUTER.search(path):
        return _OUTER.sub("inner", path)
    joint = topic.message_type.endswith("/JointState") and path.startswith("position[")
    number = _LAST_NUMBER.search(path)
    if number is not None and (joint or _GIMBAL.search(path)):
        return f"{path[: number.start()]}{int(number[0]) + 1}{path[number.end() :]}"
    if _X.search(path) and (_GIMBAL.search(topic.name) or _GIMBAL.search(path)):
        return _X.sub("y", path)
    return None


def _may_be_angle(one: Field) -> bool:
    stated = units.dimension(one.unit) if one.unit else None
    return stated in (None, "angle") and not (_NO_CHANNEL.search(one.path) or _NO_ANGLE.search(one.path))
