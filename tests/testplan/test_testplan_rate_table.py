"""Test plans of the procedure rate_table: mountings, methods, what they need and how it is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import ExitCode
from pipeline.procedures import PROCEDURES
from pipeline.stages import _calibration_settings as calibration
from pipeline.stages import ingest
from pipeline.testplan import PlanError, load_plan, named_recordings

GYRO = """\
[streams.gyro]
topic = "/gyro"
quantity = "angular_rate"
channels.p = { field = "x", unit = "deg/s", scale = 0.06097560975609756 }
channels.q = { field = "y", unit = "deg/s", scale = 0.06097560975609756 }
channels.r = { field = "z", unit = "deg/s", scale = 0.06097560975609756 }
"""
TABLE = """\
[streams.turntable]
topic = "/table"
quantity = "table_rate"
channels.rate = { field = "rate", unit = "rpm" }
"""
HEAD = """\
procedure = "rate_table"
time = { clock = "header_stamp" }
"""
RUNS = """\
[[runs]]
name = "up"
axis = "r"
across = "-p"
stop = 600

[[runs]]
name = "side"
axis = "-q"
recording = "run8.mcap"
"""
STAND = """\
[stand]
latitude_deg = 55.75
table_tilt_deg = 0.0
table_heading_deg = 12.5

"""
GOOD = HEAD + STAND + GYRO + TABLE + RUNS
TURNS = """\
[calibrate]
methods = ["turns"]

[[calibrate.turns]]
axis = "p"
angle_deg = 360
start = 5
stop = 10

[[calibrate.rests]]
start = 0
stop = 4
"""
POSITIONS = """\
[calibrate]
methods = ["positions"]

[[calibrate.positions]]
up = "r"
north = "-p"
start = 0
stop = 600
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return tmp_path / "run7.toml"


def refused(plan: Path, text: str) -> list[str]:
    plan.write_text(text, encoding="utf-8")
    with pytest.raises(PlanError) as caught:
        load_plan(plan)
    assert caught.value.exit_code is ExitCode.USAGE
    return str(caught.value).splitlines()


def test_a_good_plan_is_typed(plan: Path) -> None:
    plan.write_text(GOOD, encoding="utf-8")
    read = load_plan(plan)
    assert tuple(read.settings) == PROCEDURES["rate_table"]
    settings = read.settings["ingest"]
    assert isinstance(settings, ingest.Settings)
    assert [(run.axis, run.across) for run in settings.runs] == [("r", "-p"), ("-q", None)]
    assert (read.stand.table_tilt_deg, read.stand.table_heading_deg) == (0.0, 12.5)
    for section in read.settings.values():  # what provenance keeps of them says all
        assert type(section).model_validate_json(section.model_dump_json()) == section
    assert named_recordings(plan, plan.with_name("run7.mcap")) == (plan.with_name("run8.mcap"),)


ONE = HEAD + "".join(line for line in GYRO.splitlines(keepends=True) if "channels.p" not in line)


@pytest.mark.parametrize(
    "text",
    [
        HEAD + GYRO + TURNS,
        HEAD + STAND + GYRO + POSITIONS,
        HEAD
        + GYRO.replace('channels.q = { field = "y", unit = "deg/s", scale = 0.06097560975609756 }\n', "")
        .replace('channels.p = { field = "x", unit = "deg/s", scale = 0.06097560975609756 }\n', "")
        + TABLE,
        HEAD + GYRO + RUNS.replace("axis", "# axis").replace("across", "# across")
        + TURNS.replace("start = 5", 'run = "up"\nstart = 5').replace("start = 0", 'run = "up"\nstart = 0'),
    ],
    ids=["turns", "positions", "one channel", "turns in runs"],
)  # fmt: skip
def test_other_good_plans(plan: Path, text: str) -> None:
    plan.write_text(text, encoding="utf-8")
    settings = load_plan(plan).settings["calibrate"]
    assert isinstance(settings, calibration.Settings)
    assert settings.methods in (("turns",), ("positions",), ("rates",))


BROKEN = [
    # what is replaced, by what, the key, words of the line
    (TABLE, "", "streams", ["streams.turntable", "for the method 'rates'", "add [streams.turntable]"]),
    ('unit = "rpm"', 'unit = ""', "streams.turntable.channels.rate.unit",
     ["a unit of angular rate", "'', not filled in", "rpm"]),
    (', unit = "rpm"', "", "streams.turntable.channels.rate", ["the key 'unit'"]),
    ('unit = "rpm"', 'unit = "deg"', "streams.turntable.channels.rate.unit", ["a unit of angular rate"]),
    (RUNS, "", "streams.gyro.channels", ["which of its axes lies along the table's", "add [[runs]]"]),
    ('axis = "r"', 'axis = "z"', "runs[1].axis", ["'p', 'q', 'r', '-p', '-q' or '-r'", "'z'"]),
    ('across = "-p"', 'across = "-r"', "runs[1].across", ["square to axis", "'-r' beside axis = 'r'"]),
    ('axis = "r"\n', "", "runs[1].across", ["square to axis", "found no axis"]),
    ('axis = "-q"', 'scheme = "polar"', "runs[2].scheme", ["only beside the stream gimbal"]),
    ("table_tilt_deg = 0.0\ntable_heading_deg = 12.5", "table_tilt_deg = 90.0", "stand",
     ["table_heading_deg, beside a tilt"]),
    ("table_tilt_deg = 0.0", "table_tilt_deg = -1.0", "stand.table_tilt_deg", ["at least 0"]),
    (RUNS, RUNS + "[calibrate]\nbias_temperature = true\n", "streams", ["streams.temperature"]),
    (RUNS, RUNS + "[calibrate]\nnonlinearity = [1]\n", "calibrate.nonlinearity[1]", ["at least 2"]),
    (RUNS, RUNS + "[calibrate]\nnonlinearity = [3, 3]\n", "calibrate.nonlinearity", ["each once"]),
    (RUNS, RUNS + TURNS, "calibrate.methods", ["'rates' in methods, beside the stream turntable"]),
    (RUNS, RUNS + '[calibrate]\nmethods = ["turns"]\n', "calibrate.methods", ["[[calibrate.turns]]"]),
    (RUNS, RUNS + TURNS.replace('methods = ["turns"]', ""), "calibrate",
     ["'turns' in methods, beside turns"]),
    (RUNS, RUNS + '[steps]\ntime_offset = "guess"\n', "steps.time_offset", ["'estimate'"]),
    (RUNS, RUNS + "[steps]\nshortest = 3\n", "steps.shortest", ["did you mean 'shortest_s'?"]),
    (RUNS, RUNS + '[[limits]]\nmetric = "scale_factor_eror"\nchannel = "r"\nupper = 1\n',
     "limits[1].metric", ["did you mean 'scale_factor_error'?"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "words"), BROKEN)
def test_a_broken_plan_says_where_and_what(
    plan: Path, old: str, new: str, key: str, words: list[str]
) -> None:
    assert old in GOOD
    lines = refused(plan, GOOD.replace(old, new, 1))
    at = [line for line in lines if f": {key}: expected " in line]
    assert at, lines
    for word in words:
        assert any(word in line for line in at), lines


def test_turns_and_positions_need_every_channel_and_runs_that_are_there(plan: Path) -> None:
    (line,) = refused(plan, ONE + TURNS)
    assert "the channels p, q, r, for the method 'turns', found no p" in line
    (line,) = refused(plan, HEAD + GYRO + TURNS.replace("start = 5", 'run = "a"\nstart = 5'))
    assert "calibrate.turns[1].run: expected no run, where the plan lists none, found 'a'" in line
    runs = RUNS.replace("axis", "# axis").replace("across", "# across")
    lines = refused(plan, HEAD + GYRO + runs + TURNS)
    assert len(lines) == 2
    assert all("expected run, one of up, side, found none" in line for line in lines)


def test_a_turn_turns_and_a_position_has_two_axes(plan: Path) -> None:
    (line,) = refused(plan, HEAD + GYRO + TURNS.replace("angle_deg = 360", "angle_deg = 0"))
    assert "an angle other than 0" in line
    (line,) = refused(plan, HEAD + GYRO + TURNS.replace("stop = 10", "stop = 5"))
    assert "a stop after start = 5" in line
    (line,) = refused(plan, HEAD + STAND + GYRO + POSITIONS.replace('"-p"', '"-r"'))
    assert "square to up" in line
    (line,) = refused(plan, HEAD + GYRO + POSITIONS)
    assert "latitude_deg, for the method 'positions'" in line


def test_runs_of_a_gyro_are_of_no_other_procedure(plan: Path) -> None:
    (line,) = refused(plan, GOOD.replace('"rate_table"', '"static"'))
    assert "[[runs]] only in the procedures drift, rate_table, found 'static'" in line


def test_no_other_stream_beside_runs_of_a_gyro(plan: Path) -> None:
    reference = '[streams.reference]\ntopic = "/a"\nquantity = "quaternion"\n' + "".join(
        f'channels.{c} = {{ field = "{c}", unit = "1" }}\n' for c in "wxyz"
    )
    (line,) = refused(plan, HEAD + STAND + GYRO + TABLE + reference + RUNS)
    assert "only the streams gyro, turntable, temperature beside [[runs]] of a gyro" in line


def test_angle_increments_are_refused(plan: Path) -> None:
    gyro = GYRO.replace("angular_rate", "angle_increment").replace("deg/s", "deg")
    (line,) = refused(plan, HEAD + gyro + TABLE)
    assert "streams.gyro.quantity: expected 'angular_rate' for the procedure 'rate_table'" in line
    (line,) = refused(plan, HEAD + gyro + TABLE + RUNS)
    assert "streams.gyro.quantity: expected 'angular_rate' beside [[runs]]" in line
