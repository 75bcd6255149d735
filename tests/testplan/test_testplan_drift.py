"""Test plans of the procedure drift: mounting, wraps and runs; what is refused, and in which words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ExitCode
from pipeline.procedures import NEEDS, PROCEDURES
from pipeline.stages import ingest
from pipeline.stages.base import Stand
from pipeline.stages.quantities import STREAMS
from pipeline.testplan import PlanError, load_plan, named_recordings

GOOD = """\
procedure = "drift"

[stand]
latitude_deg = 55.75
scheme = "polar"

[time]
clock = "header_stamp"

[streams.gimbal]
topic = "/gimbal"
quantity = "gimbal_angles"
channels.alpha1 = { field = "vector.x", unit = "deg", scale = 0.00034332275, wraps_at = 1048576 }
channels.alpha2 = { field = "vector.y", unit = "deg" }

[[runs]]
name = "first"
stop = 36000

[[runs]]
name = "second"
start = 36000

[[runs]]
name = "third"
recording = "run8.mcap"
chi_deg = [0, -90, 12.5]
latitude_deg = -3
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "run7.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_a_good_plan_is_typed(plan: Path) -> None:
    read = load_plan(plan)
    assert tuple(read.settings) == PROCEDURES["drift"]
    assert read.stand.scheme == "polar"
    settings = read.settings["ingest"]
    assert isinstance(settings, ingest.Settings)
    assert [run.name for run in settings.runs] == ["first", "second", "third"]
    assert settings.runs[0].stretch == (0.0, 36000.0)
    assert settings.runs[2].chi_deg == (0.0, -90.0, 12.5)
    assert read.streams["gimbal"].channels["alpha1"].wraps_at == 1048576
    for section in read.settings.values():  # what provenance keeps of them says all
        assert type(section).model_validate_json(section.model_dump_json()) == section


def test_the_mounting_may_be_each_run_s_own(plan: Path) -> None:
    text = GOOD.replace('latitude_deg = 55.75\nscheme = "polar"\n', "")
    for name in ("first", "second"):
        text = text.replace(f'name = "{name}"', f'name = "{name}"\nscheme = "vertical"\nlatitude_deg = 1')
    plan.write_text(text, encoding="utf-8")
    assert load_plan(plan).stand == Stand()


ONE_RUN = GOOD[: GOOD.index("\n[[runs]]")]
GYRO = """
[streams.gyro]
quantity = "angular_rate"
channels.p = { field = "p", unit = "deg/s", wraps_at = 65536 }
channels.q = { field = "q", unit = "deg/s" }
channels.r = { field = "r", unit = "deg/s" }
"""

BROKEN = [
    # what is changed: from, to; line; key; words
    ("latitude_deg = 55.75\n", "", 3, "stand",
     ["latitude_deg", "nor one of the run 'first'", "add latitude_deg = … to [stand]"]),
    ("latitude_deg = 55.75", "latitude_deg = 90.1", 4, "stand.latitude_deg", ["at most 90", "found 90.1"]),
    ("latitude_deg = 55.75", "latitude_deg = -91", 4, "stand.latitude_deg", ["at least -90", "found -91"]),
    ("latitude_deg = 55.75", 'latitude_deg = ""', 4, "stand.latitude_deg", ["a number", "fill it in"]),
    ("latitude_deg = 55.75", 'latitude_deg = "55°45\'"', 4, "stand.latitude_deg",
     ["a number", "without quotes"]),
    ('scheme = "polar"\n', "", 3, "stand",
     ["scheme or chi_deg", "neither", "'first'", "horizontal", "chi_deg = ["]),
    ('scheme = "polar"', 'scheme = "ploar"', 5, "stand.scheme", ["'vertical'", "did you mean 'polar'?"]),
    ('scheme = "polar"', "scheme = 1", 5, "stand.scheme", ["'polar'", "found 1"]),
    ('scheme = "polar"', 'scheme = ""', 5, "stand.scheme", ["'polar'", "found ''"]),
    ('scheme = "polar"', 'scheme = "polar"\nchi_deg = [0, 0, 0]', 6, "stand.chi_deg",
     ["one of scheme and chi_deg"]),
    ('scheme = "polar"', "chi_deg = [0, 0]", 5, "stand.chi_deg", ["an element 3"]),
    ('scheme = "polar"', "chi_deg = [0, 0, 0, 1]", 5, "stand.chi_deg", ["3 elements", "an array of 4"]),
    ('scheme = "polar"', "chi_deg = [0, inf, 0]", 5, "stand.chi_deg[2]", ["finite"]),
    ('"gimbal_angles"', '"gimbal_angle"', 12, "streams.gimbal.quantity", ["did you mean 'gimbal_angles'?"]),
    ('"gimbal_angles"', '"euler_krylov"', 12, "streams.gimbal.quantity",
     ["'gimbal_angles' for the stream 'gimbal'"]),
    ("channels.alpha2", "channels.alpha3", 14, "streams.gimbal.channels.alpha3",
     ["alpha1, alpha2", "did you mean"]),
    ("channels.alpha2 = {", "# {", 13, "streams.gimbal.channels", ["found no alpha2"]),
    ('"vector.y", unit = "deg"', '"vector.y", unit = "deg/s"', 14, "streams.gimbal.channels.alpha2.unit",
     ["unit of angle"]),
    ('"vector.y"', '"vector.x"', 14, "streams.gimbal.channels.alpha2.field", ["already feeds alpha1"]),
    ("wraps_at = 1048576", "wraps_at = 0", 13, "streams.gimbal.channels.alpha1.wraps_at", ["above 0"]),
    ("wraps_at = 1048576", "wraps_at = true", 13, "streams.gimbal.channels.alpha1.wraps_at", ["a number"]),
    ('topic = "/gimbal"', "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", 11, "streams.gimbal.rotation",
     ["no rotation", "scheme or chi_deg"]),
    ('topic = "/gimbal"', "reference_rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]", 11,
     "streams.gimbal.reference_rotation", ["'reference'", "remove it"]),
    ("\n[[runs]]\nname = \"first\"", GYRO + "\n[[runs]]\nname = \"first\"", 18,
     "streams.gyro.channels.p.wraps_at", ["only for quantity 'gimbal_angles'", "'angular_rate'"]),
    ('name = "second"', 'name = "first"', 21, "runs[2].name", ["a name of its own", "'first'"]),
    ('name = "second"', 'name = ""', 21, "runs[2].name", ["not empty", "fill it in"]),
    ('name = "second"\n', "", 20, "runs[2]", ["the key 'name'", "what the run is called"]),
    ("start = 36000", "start = 35999.5", 20, "runs[2]",
     ["do not overlap", "'second', from 35999.5 s on", "'first', from 0 s to 36000 s"]),
    ("start = 36000", "", 20, "runs[2]", ["do not overlap"]),
    ("start = 36000", "start = -1", 22, "runs[2].start", ["at least 0"]),
    ("start = 36000", "start = 1e300", 22, "runs[2].start", ["at most 1e+09"]),
    ("start = 36000", "start = 36000\nstop = 36000", 23, "runs[2].stop",
     ["after start = 36000", "found 36000"]),
    ("stop = 36000", "stop = 0", 18, "runs[1].stop", ["above 0"]),
    ("start = 36000", "begin = 36000", 22, "runs[2].begin", ["name", "recording", "start"]),
    ('"run8.mcap"', '"../run8.mcap"', 26, "runs[3].recording",
     ["bare name", "'../run8.mcap'", "leave the folder out"]),
    ('"run8.mcap"', '".."', 26, "runs[3].recording", ["bare name"]),
    ('"run8.mcap"', "'a\\b.mcap'", 26, "runs[3].recording", ["bare name"]),
    ('"run8.mcap"', '"/run8.mcap"', 26, "runs[3].recording", ["bare name"]),
    ('"run8.mcap"', '"a\\u0000"', 26, "runs[3].recording", ["bare name"]),
    ('"run8.mcap"', '""', 26, "runs[3].recording", ["not empty"]),
    ("chi_deg = [0, -90, 12.5]\nlatitude_deg = -3", '[identify]\nmethods = ["kalman"]', 28,
     "identify.methods[1]", ["'cumulative'", "found 'kalman'"]),
    ("latitude_deg = -3", "latitude_deg = 93", 28, "runs[3].latitude_deg", ["at most 90"]),
    ("latitude_deg = -3", 'scheme = "polar"', 27, "runs[3].chi_deg", ["one of scheme and chi_deg"]),
    (GOOD[GOOD.index("[[runs]]") : GOOD.rindex("[[runs]]") + 8], "[runs]", 16, "runs", ["an array", "table"]),
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
        assert word in message, message


def refused(plan: Path, text: str) -> list[str]:
    plan.write_text(text, encoding="utf-8")
    with pytest.raises(PlanError) as caught:
        load_plan(plan)
    return str(caught.value).splitlines()


def test_all_that_drift_needs_is_told_at_once(plan: Path) -> None:
    reference = 'quantity = "quaternion"\n' + "".join(
        f'channels.{c} = {{ field = "{c}", unit = "1" }}\n' for c in "wxyz"
    )
    lines = refused(plan, f'procedure = "drift"\ntime = {{ rate = 1.0 }}\n[streams.reference]\n{reference}')
    assert len(lines) == 3
    assert all(re.match(rf"{re.escape(str(plan))}:[13]: (stand|streams): expected ", line) for line in lines)
    for word in ("latitude_deg", "scheme or chi_deg", "add [streams.gimbal]"):
        assert sum(word in line for line in lines) == 1


def test_a_gimbal_needs_its_mounting_in_every_procedure(plan: Path) -> None:
    text = ONE_RUN.replace('"drift"', '"coning"').replace('scheme = "polar"\n', "")
    (line,) = refused(plan, text)
    assert "scheme or chi_deg" in line


def test_runs_without_a_gimbal_are_refused(plan: Path) -> None:
    text = GYRO.replace(", wraps_at = 65536", "")
    (line,) = refused(plan, f'procedure = "coning"\ntime = {{ rate = 1.0 }}\n{text}\n[[runs]]\nname = "a"\n')
    assert line.startswith(
        f"{plan}:10: runs: expected [[runs]] only in the procedures drift, rate_table, found 'coning'; "
    )


def test_every_need_is_a_key_of_a_plan() -> None:
    for procedure, needs in NEEDS.items():
        assert procedure in PROCEDURES
        for section, name in (need.split(".") for need in needs):
            known = Stand.model_fields if section == "stand" else STREAMS
            assert section in ("stand", "streams")
            assert name in known


def test_further_recordings_are_known_without_judging_the_plan(plan: Path) -> None:
    recording = plan.with_name("run7.mcap")
    assert named_recordings(plan, recording) == (plan.with_name("run8.mcap"),)
    plan.write_text(
        'runs = [{recording = "b"}, {recording = "b"}, {recording = "../c"}, {recording = 3}, 4, {}]'
    )
    assert named_recordings(plan, recording) == (plan.with_name("b"),)
    for broken in ("runs = 3", "runs = [", "", '[runs]\nrecording = "b"'):
        plan.write_text(broken)
        assert named_recordings(plan, recording) == ()
    assert named_recordings(plan.with_name("none.toml"), recording) == ()


VALUES = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.text(max_size=5), st.lists(st.floats(), max_size=4)
)


def refusal_of(plan: Path) -> str | None:
    """What the plan is refused with."""
    try:
        load_plan(plan)
    except PlanError as error:
        return str(error)
    return None


@given(st.data())
def test_any_value_anywhere_is_accepted_or_refused_as_a_plan(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """The right side of one line is exchanged for anything; no other error than a plan's comes out."""
    lines = GOOD.splitlines()
    place = data.draw(
        st.sampled_from([i for i, line in enumerate(lines) if " = " in line and "{" not in line])
    )
    value = json.dumps(data.draw(VALUES)).replace("Infinity", "inf").replace("NaN", "nan")
    value = re.sub(r"\\ud[89ab]..\\ud[c-f]..", "?", value).replace("\x7f", "")  # pairs are none of TOML's
    lines[place] = f"{lines[place].split(' = ')[0]} = {value}"
    path = tmp_path_factory.getbasetemp() / "any_drift.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    refusal = refusal_of(path)
    assert refusal is None or refusal.startswith(f"{path}:")
