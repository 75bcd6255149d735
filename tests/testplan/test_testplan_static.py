"""Test plans of the procedure static: axes and table; what is refused, and in which words."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import ExitCode
from pipeline.procedures import PROCEDURES, WHOLE
from pipeline.stages.quantities import STREAMS
from pipeline.testplan import PlanError, load_plan

GOOD = """\
procedure = "static"

[time]
clock = "header_stamp"

[streams.gyro]
topic = "/gyro"
quantity = "angle_increment"
channels.q = { field = "vector.y", unit = "arcsec" }

[streams.turntable]
topic = "/table"
quantity = "table_angle"
channels.angle = { field = "vector.z", unit = "deg", wraps_at = 360 }
"""
TABLE = GOOD[GOOD.index("[streams.turntable]") :]
RATE = TABLE.replace("table_angle", "table_rate").replace(
    'angle = { field = "vector.z", unit = "deg", wraps_at = 360 }', "rate = { RATE }"
)


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "run7.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_a_gyro_of_one_axis_on_a_table_is_a_plan(plan: Path) -> None:
    read = load_plan(plan)
    assert tuple(read.settings) == PROCEDURES["static"]
    assert tuple(read.streams["gyro"].channels) == ("q",)
    assert read.streams["turntable"].channels["angle"].wraps_at == 360


@pytest.mark.parametrize("axes", ["p", "r", "pq", "rp", "pqr"])
def test_any_axes_will_do(plan: Path, axes: str) -> None:
    lines = "\n".join(f'channels.{a} = {{ field = "{a}", unit = "rad" }}' for a in axes)
    text = GOOD.replace('channels.q = { field = "vector.y", unit = "arcsec" }', lines)
    plan.write_text(text, encoding="utf-8")
    assert set(load_plan(plan).streams["gyro"].channels) == set(axes)


BROKEN = [
    # what is changed: from, to; line; key; words
    (GOOD[GOOD.index("[streams.gyro]") : GOOD.index("[streams.turntable]")], "", 6, "streams",
     ["streams.gyro, for the procedure 'static'", "found none", "add [streams.gyro]"]),
    ('"static"', '"coning"', 9, "streams.gyro.channels",
     ["the channels p, q, r", "found no p, r", "add channels.p"]),
    ("channels.q", "channels.s", 9, "streams.gyro.channels.s", ["p, q, r", "found 's'"]),
    ('channels.q = { field = "vector.y", unit = "arcsec" }', "channels = {}", 9, "streams.gyro.channels",
     ["at least 1", "an empty table"]),
    ('"angle_increment"', '"angle_increment"\nrotation = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]', 10,
     "streams.gyro.channels", ["all of p, q, r beside rotation", "no p, r", "or remove rotation"]),
    ('unit = "arcsec" }', 'unit = "arcsec", wraps_at = 10 }', 9, "streams.gyro.channels.q.wraps_at",
     ["'gimbal_angles' or 'table_angle'", "'angle_increment'"]),
    (TABLE, RATE.replace("RATE", 'field = "vector.z"'), 14, "streams.turntable.channels.rate",
     ["the key 'unit'", "found none", "add unit = …"]),
    (TABLE, RATE.replace("RATE", 'field = "vector.z", unit = ""'), 14,
     "streams.turntable.channels.rate.unit", ["a unit of angular rate", "not filled in", "rpm"]),
    (TABLE, RATE.replace("RATE", 'field = "vector.z", unit = "rpms"'), 14,
     "streams.turntable.channels.rate.unit", ["'rpms'", "did you mean 'rpm'?"]),
    (TABLE, RATE.replace("RATE", 'field = "vector.z", unit = "deg"'), 14,
     "streams.turntable.channels.rate.unit", ["a unit of angular rate", "found 'deg'"]),
    (TABLE, RATE.replace("RATE", 'field = "vector.z", unit = "rpm", wraps_at = 1'), 14,
     "streams.turntable.channels.rate.wraps_at", ["found 'table_rate'", "remove it"]),
    ("channels.angle", "channels.rate", 14, "streams.turntable.channels.rate", ["the channels angle"]),
    ('"table_angle"', '"table_angel"', 13, "streams.turntable.quantity", ["did you mean 'table_angle'?"]),
    ('"table_angle"', '"gimbal_angles"', 13, "streams.turntable.quantity",
     ["'table_angle' or 'table_rate' for the stream 'turntable'"]),
    ('topic = "/table"', "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", 12, "streams.turntable.rotation",
     ["no axes to turn", "remove it"]),
    ("[streams.turntable]", "[streams.turntabel]", 11, "streams.turntabel", ["did you mean 'turntable'?"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "key", "words"), BROKEN)
def test_a_broken_plan_gives_one_line(
    plan: Path, old: str, new: str, line: int, key: str, words: list[str]
) -> None:
    assert old in GOOD
    plan.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(PlanError) as caught:
        load_plan(plan)
    message = str(caught.value)
    assert "\n" not in message
    assert caught.value.exit_code is ExitCode.USAGE
    assert message.startswith(f"{plan}:{line}: {key}: expected "), message
    for word in words:
        assert word in message


def test_every_stream_that_must_be_whole_is_one_of_a_plan() -> None:
    for procedure, streams in WHOLE.items():
        assert procedure in PROCEDURES
        assert set(streams) <= set(STREAMS)
