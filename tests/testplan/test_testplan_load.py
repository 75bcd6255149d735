"""Test plans: what is read, what is refused and in which words, where plans are found."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline import contracts
from pipeline.errors import ExitCode, GyrostandError
from pipeline.procedures import PROCEDURES
from pipeline.stages import ingest, interpolate
from pipeline.testplan.errors import PlanError
from pipeline.testplan.load import SCHEMA, find_plan, load_plan, schema_text

GOOD = """\
procedure = "coning"
title = "Coning run 7"

[stand]
name = "vibration stand 3"
latitude_deg = 55

[time]
clock = "header_stamp"

[streams.gyro]
topic = "/gyro"
quantity = "angular_rate"
rotation = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
channels.p = { field = "angular_velocity.x", unit = "rad/s" }
channels.q = { field = "angular_velocity.y", unit = "dps", scale = 2, offset = -1.5, sign = -1 }
channels.r = { field = "angular_velocity.z", unit = "°/s" }

[streams.reference]
quantity = "quaternion"
time = { field = "t", unit = "ms" }
channels = { w = { field = "w", unit = "1" }, x = { field = "x", unit = "1" }, \
y = { field = "y", unit = "1" }, z = { field = "z", unit = "1" } }

[text]
delimiter = ";"

[interpolate]
method = "spline"
degree = 5

[detrend]
onset = 0.25

[[limits]]
metric = "relative_rms_error_corrected"
channel = "gamma"
upper = 0.2
marginal_upper = 0.15

[[limits]]
metric = "peak_error"
channel = "gamma"
lower = -1
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "run7.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_a_good_plan_is_typed(plan: Path) -> None:
    read = load_plan(plan)
    assert (read.procedure, read.title, read.stand.latitude_deg) == ("coning", "Coning run 7", 55.0)
    assert read.sha256 == hashlib.sha256(plan.read_bytes()).hexdigest()
    assert tuple(read.settings) == PROCEDURES["coning"]
    assert read.streams["gyro"].channels["q"].offset == -1.5
    channel_map = read.settings["ingest"]
    assert isinstance(channel_map, ingest.Settings)
    assert channel_map.clock("gyro").clock == "header_stamp"
    assert channel_map.clock("reference").field == "t"
    assert channel_map.text.layout.delimiter == ";"
    interpolation = read.settings["interpolate"]
    assert isinstance(interpolation, interpolate.Settings)
    assert (interpolation.method, interpolation.degree) == ("spline", 5)
    assert read.limits[0].marginal_upper == 0.15
    for section in read.settings.values():  # what provenance keeps of them says all
        assert type(section).model_validate_json(section.model_dump_json()) == section


@pytest.mark.parametrize("spoil", [lambda t: "\ufeff" + t, lambda t: t.replace("\n", "\r\n")])
def test_what_editors_of_windows_do_to_a_plan(plan: Path, spoil: object) -> None:
    assert callable(spoil)
    plan.write_bytes(spoil(GOOD).encode())
    assert load_plan(plan).title == "Coning run 7"


BROKEN = [
    # what is changed: from, to; line; key; words
    ('title = "Coning run 7"', 'title = "Coning run 7', 2, "", ["TOML", "illegal character"]),
    ("[[limits]]", "[[limits]", 34, "", ["TOML"]),
    ('name = "vib', 'name = 1\nname = "vib', 6, "", ["TOML", "overwrite"]),
    ('procedure = "coning"', "", 1, "", ["'procedure'", "coning"]),
    ('procedure = "coning"', 'procedure = "conning"', 1, "procedure", ["'conning'", "did you mean 'coning'"]),
    ('procedure = "coning"', "procedure = 3", 1, "procedure", ["coning", "found 3"]),
    ("[detrend]", "[detrent]", 31, "detrent", ["found 'detrent'", "did you mean 'detrend'"]),
    ("onset = 0.25", "onsett = 0.25", 32, "detrend.onsett", ["did you mean 'onset'"]),
    ("onset = 0.25", 'onset = "auot"', 32, "detrend.onset", ["'auto'", "or a number", "did you mean 'auto'"]),
    ('clock = "header_stamp"', 'clock = "heder_stamp"', 9, "time.clock", ["did you mean 'header_stamp'"]),
    ('clock = "header_stamp"', "", 8, "time", ["no clock is chosen", "field = …", "rate = …"]),
    (
        '[time]\nclock = "header_stamp"\n', "", 9, "streams.gyro",
        ["a clock for gyro", "no clock is chosen: add [time]"],
    ),
    (
        'clock = "header_stamp"', 'clock = "log_time"\nrate = 400', 10, "time.rate",
        ["one of clock, field and rate", "clock and rate"],
    ),
    ('clock = "header_stamp"', "rate = -400", 9, "time.rate", ["above 0", "found -400"]),
    ('clock = "header_stamp"', 'field = "t"', 8, "time", ["'unit' beside field", "ms, us, ns"]),
    ('clock = "header_stamp"', 'field = "t"\nunit = "sex"', 10, "time.unit", ["did you mean 's"]),
    ('clock = "header_stamp"', 'rate = 1\nwraps_at = 9', 10, "time.wraps_at", ["beside counter"]),
    (
        "time = { field", "time = { counter = 'n', field", 21, "streams.reference.time.counter",
        ["beside rate"],
    ),
    ('"angular_velocity.y", unit = "dps"', '"angular_velocity.y", unit = "dsp"', 16,
     "streams.gyro.channels.q.unit", ["unit of angular rate", "'dsp'", "did you mean"]),
    ('"angular_velocity.y", unit = "dps"', '"angular_velocity.y", unit = ""', 16,
     "streams.gyro.channels.q.unit", ["not filled in", "rad/s"]),
    ('unit = "dps", ', "", 16, "streams.gyro.channels.q", ["the key 'unit'", "found none"]),
    ('unit = "dps"', 'unit = "deg"', 16, "streams.gyro.channels.q.unit", ["angular rate", "'deg'"]),
    ("scale = 2", "scale = '2'", 16, "streams.gyro.channels.q.scale", ["a number", "without quotes"]),
    ("scale = 2", "scale = 0", 16, "streams.gyro.channels.q.scale", ["other than 0"]),
    ("sign = -1", "sign = 2", 16, "streams.gyro.channels.q.sign", ["-1 or 1", "found 2"]),
    ("channels.q", "channels.qq", 16, "streams.gyro.channels.qq", ["p, q, r", "did you mean 'q'"]),
    ("channels.r = {", "# {", 15, "streams.gyro.channels", ["found no r", "add channels.r"]),
    (
        'w = { field = "w", unit = "1" }, ', "", 22, "streams.reference.channels",
        ["w, x, y, z", "found no w"],
    ),
    ('"angular_rate"', '"angular_rates"', 13, "streams.gyro.quantity", ["did you mean 'angular_rate'"]),
    ('"angular_rate"', '"quaternion"', 13, "streams.gyro.quantity", ["for the stream 'gyro'"]),
    ("[streams.gyro]", "[streams.gryo]", 11, "streams.gryo", ["gyro, reference", "did you mean 'gyro'"]),
    ("[0, 0, 1]]", "[0, 0, 1.1]]", 14, "streams.gyro.rotation", ["orthonormal", "0.21", "determinant 1.1"]),
    ("[0, 0, 1]]", "[0, 0, -1]]", 14, "streams.gyro.rotation", ["determinant -1", "left-handed"]),
    ("[0, 0, 1]]", "[1e200, 0, -1e200]]", 14, "streams.gyro.rotation", ["orthonormal"]),
    ("[0, 0, 1]]", "[0, 0]]", 14, "streams.gyro.rotation[3]", ["an element 3", "found 2"]),
    ("rotation = [[", "reference_rotation = [[", 14, "streams.gyro.reference_rotation", ["'reference'"]),
    ('delimiter = ";"', 'delimiter = ";;"', 25, "text.delimiter", ["one character", "';;'"]),
    ("degree = 5", "degree = 4", 27, "interpolate", ["degree", "found 4"]),
    ("degree = 5", "degree = 5.0", 29, "interpolate.degree", ["whole number", "write 5"]),
    ("degree = 5", "oversampling = 0", 29, "interpolate.oversampling", ["at least 1", "found 0"]),
    ("upper = 0.2", "", 34, "limits[1]", ["'lower' or 'upper'"]),
    ("marginal_upper = 0.15", "lower = 0.3", 38, "limits[1].lower", ["not above upper = 0.2", "0.3"]),
    ("marginal_upper = 0.15", "marginal_upper = 0.3", 38, "limits[1].marginal_upper", ["not above upper"]),
    ("marginal_upper = 0.15", "marginal_lower = 0", 38, "limits[1].marginal_lower", ["lower beside"]),
    ("upper = 0.2", "upper = nan", 37, "limits[1].upper", ["finite"]),
    ("upper = 0.2", "upper = 2024-01-01", 37, "limits[1].upper", ["a number", "2024-01-01"]),
    (
        '"peak_error"', '"relative_rms_error_corrected"', 40, "limits[2]",
        ["one limit for each", "limits[1]"],
    ),
    ('channel = "gamma"\nlower', "lower", 40, "limits[2]", ["the key 'channel'"]),
    ("latitude_deg = 55", "latitude_deg = 91", 6, "stand.latitude_deg", ["at most 90"]),
    ('name = "vibration stand 3"', "name = 3", 5, "stand.name", ["a string", "in quotes"]),
    ("[stand]", "[[stand]]", 4, "stand", ["a table", "an array of 1"]),
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
    where = f"{plan}:{line}: {key}: expected " if key else f"{plan}:{line}: expected "
    assert message.startswith(where), message
    for word in words:
        assert word in message, message


def test_a_plan_with_three_faults_gives_three_lines_in_the_order_of_the_file(plan: Path) -> None:
    text = GOOD.replace("onset =", "onsett =").replace('"dps"', "3").replace("name =", "names =")
    plan.write_text(text, encoding="utf-8")
    with pytest.raises(PlanError) as caught:
        load_plan(plan)
    lines = str(caught.value).splitlines()
    assert [int(re.findall(r"toml:(\d+): ", line)[0]) for line in lines] == [5, 16, 32]
    assert len(caught.value.faults) == 3


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfet\0i\0", [":1:", "UTF-8", "0xff"]),
        (b"a = 1\nb = '\xe9'", [":2:", "0xe9"]),
        (b"a = " + b"[" * 100_000, [":1:", "nested too deeply"]),
        (b"", ["'procedure'"]),
        (b"x" * (2**20 + 1), ["at most 1 MiB"]),
    ],
)
def test_what_is_no_plan_at_all(plan: Path, content: bytes, words: list[str]) -> None:
    plan.write_bytes(content)
    with pytest.raises(PlanError) as caught:
        load_plan(plan)
    for word in words:
        assert word in str(caught.value)


def test_a_plan_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="no such file"):
        load_plan(tmp_path / "none.toml")
    with pytest.raises(PlanError, match="directory"):
        load_plan(tmp_path)


VALUES = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.text(max_size=5), st.lists(st.integers(), max_size=3)
)


def refusal(path: Path) -> str | None:
    """What the plan is refused with."""
    try:
        load_plan(path)
    except PlanError as error:
        return str(error)
    return None


@given(st.data())
def test_any_value_anywhere_is_accepted_or_refused_as_a_plan(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """The right side of one line is exchanged for anything; no other error than a plan's comes out."""
    lines = GOOD.splitlines()
    places = [i for i, line in enumerate(lines) if " = " in line and "{" not in line]
    place = data.draw(st.sampled_from(places))
    name = lines[place].split(" = ")[0]
    value = json.dumps(data.draw(VALUES)).replace("Infinity", "inf").replace("NaN", "nan")
    value = re.sub(r"\\ud[89ab]..\\ud[c-f]..", "?", value).replace(
        "\x7f", ""
    )  # JSON's pairs are none of TOML's
    lines[place] = f"{name} = {value}"
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    refused = refusal(path)
    assert refused is None or refused.startswith(f"{path}:")


def test_the_schema_is_current() -> None:
    """If this fails: ``python -c "from pipeline.testplan.load import write_schema; write_schema()"``."""
    assert (contracts.folder() / SCHEMA).read_text(encoding="utf-8") == schema_text()
    schema = json.loads(schema_text())
    assert [choice["$ref"].rsplit("/")[-1] for choice in schema["oneOf"]] == list(PROCEDURES)
    assert set(schema["$defs"]["coning"]["properties"]) >= {
        "streams",
        "time",
        "limits",
        *PROCEDURES["coning"][1:],
    }
    assert "testplan" not in " ".join(contracts.names())


@pytest.mark.parametrize(
    ("recording", "own"),
    [
        ("run7.mcap", "run7.toml"),
        ("run7.csv.gz", "run7.toml"),
        ("run7.CSV.ZST", "run7.toml"),
        ("2026-11-22T10.30.bag", "2026-11-22T10.30.toml"),
        ("a b.tsv", "a b.toml"),
        ("bare", "bare.toml"),
    ],
)
def test_a_plan_beside_the_recording_comes_first(tmp_path: Path, recording: str, own: str) -> None:
    path = tmp_path / recording
    path.touch()
    (tmp_path / "testplan.toml").touch()
    assert find_plan(path) == tmp_path / "testplan.toml"
    (tmp_path / own).touch()
    assert find_plan(path) == tmp_path / own


def test_the_plan_of_a_folder_stands_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = tmp_path / "bag.v2"
    bag.mkdir()
    (tmp_path / "bag.v2.toml").touch()
    assert find_plan(bag) == tmp_path / "bag.v2.toml"
    monkeypatch.chdir(bag)
    assert find_plan(Path()) == tmp_path / "bag.v2.toml"


def test_without_a_plan_the_error_says_how_to_begin(tmp_path: Path) -> None:
    path = tmp_path / "run 7.mcap"
    path.touch()
    with pytest.raises(PlanError) as caught:
        find_plan(path)
    assert caught.value.exit_code is ExitCode.USAGE
    assert f"gyrostand plan init '{path}' > '{tmp_path}/run 7.toml'" in str(caught.value)


def test_without_a_recording_that_is_said_first(tmp_path: Path) -> None:
    with pytest.raises(GyrostandError, match="no such file") as caught:
        find_plan(tmp_path / "none.mcap")
    assert caught.value.exit_code is ExitCode.INPUT
