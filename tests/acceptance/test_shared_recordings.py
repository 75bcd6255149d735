"""Recordings of others, as their makers left them, through the commands: inspected, audited and integrated
by the plans in ``plans/`` to the facts that are known of them, or refused in one clear line.

The facts are those of the recordings' manifest, or read here by another way (NumPy, rosbags).
"""

from __future__ import annotations

import io
import json
import re
import subprocess
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

from pipeline.cli import main

Completed = subprocess.CompletedProcess[str]
Command = Callable[..., Completed]
Float = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
PLANS = Path(__file__).parent / "plans"
DEGREE = np.pi / 180

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recordings of others are not beside this checkout"
)


def command(*arguments: object) -> Completed:
    """The command line without a process of its own, of which hundreds would take minutes to start."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    code = ended.value.code
    assert code is None or isinstance(code, int)
    return subprocess.CompletedProcess([], code or 0, out.getvalue(), err.getvalue())


def assert_refused(result: Completed, code: int, *says: str) -> None:
    assert result.returncode == code, result.stdout + result.stderr
    assert result.stdout == ""
    assert re.fullmatch(r"gyrostand: [^\n]+: expected [^\n]+, found [^\n]+; [^\n]+\n", result.stderr)
    assert all(text in result.stderr for text in says), result.stderr


# inspect --------------------------------------------------------------------

REFUSED = {
    "malformed/rosbagjs_asci-file.bag": "a binary recording",
    "malformed/rosbagjs_empty-file.bag": "an empty file",
    "rosbag2_resources/rosbag2_tests/resources/empty_dir": "metadata.yaml",
    "rosbag2_resources/rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files": "metadata.yaml",
    "rosbag2_resources/rosbag2_py/test/resources/sqlite3/reindex_test_bags/multiple_files": "metadata.yaml",
}
"""Whose content is no recording, and what the refusal speaks of."""

COUNTS = {
    ("bags/plotjuggler_tilt_laser.bag", "/imu_data"): 356,
    ("bags/robot_localization_test1.bag", "/imu/data"): 11865,
    ("mcap/mbp_alternate_bagfile_0.mcap", "/robot/joint_state"): 3795,
    ("mcap/mbp_controlled_data_0.mcap", "/BNO055_imu/quaternion"): 250,
    ("mcap/mbp_torque_ripple_data_0.mcap", "/robot/joint_state"): 12780,
    ("mcap/mbp_uncontrolled_data_0.mcap", "/BNO055_imu/quaternion"): 250,
    ("csv/bennyjhui_Gyroscope.csv", ""): 1038,
    ("csv/broad_02_slow_rotation_B.csv", ""): 53240,
    ("csv/sk_xio_00033_CalInertialAndMag.csv", ""): 12626,
    ("turntable/tomi_mpu6050_static_test.csv", ""): 9986,
}
"""Samples of a topic."""


def recordings() -> list[str]:
    """Every file, every folder of a ROS 2 bag, and twenty of the 416 conformance files, by relative name."""
    conformance = sorted((DATA / "mcap_conformance").rglob("*.mcap"))[::21]
    files = [p for p in DATA.rglob("*") if p.is_file() and "mcap_conformance" not in p.parts]
    files = [p for p in files if p.name not in ("manifest.tsv", "metadata.yaml", ".gitkeep")]
    folders = [p.parent for p in DATA.rglob("metadata.yaml")]
    found = [*files, *folders, *conformance, *(DATA / name for name in REFUSED)]
    return sorted({str(path.relative_to(DATA)) for path in found})


@pytest.mark.parametrize("name", recordings() if DATA.is_dir() else [])
def test_every_recording_is_inspected_or_refused(name: str) -> None:
    text, data = command("inspect", DATA / name), command("inspect", DATA / name, "--json")
    if name in REFUSED:
        assert_refused(text, 3, REFUSED[name], Path(name).name)
        assert_refused(data, 3, REFUSED[name], Path(name).name)
        return
    assert text.returncode == data.returncode == 0, text.stderr
    assert text.stderr == data.stderr == ""
    held = json.loads(data.stdout)
    for topic in held["topics"]:
        assert f"{topic['count']} samples" in text.stdout
        assert topic["name"] in text.stdout
        assert COUNTS.get((name, topic["name"]), topic["count"]) == topic["count"]
    assert {topic for file, topic in COUNTS if file == name} <= {topic["name"] for topic in held["topics"]}
    # Settings of ROS 2 look like columns of words and numbers; what does not fit is said.
    assert bool(held["losses"]) == ("lost: " in text.stdout) == name.endswith(".yaml")


@pytest.mark.parametrize(
    "name",
    [
        "csv/px4_sample_log_small_sensor_combined_0.csv",
        "bags/robot_localization_test1.bag",
        "rosbag2_resources/rosbag2_tests/resources/sqlite3/cdr_test",
        "malformed/rosbagjs_empty-file.bag",
    ],
)
def test_a_process_of_its_own_says_the_same(gyrostand: Command, name: str) -> None:
    within, own = command("inspect", DATA / name), gyrostand("inspect", DATA / name)
    assert (own.returncode, own.stdout, own.stderr) == (within.returncode, within.stdout, within.stderr)


# recordings with angular rates ----------------------------------------------


@dataclass(frozen=True)
class Case:
    """What is known of a recording, under the clock that its plan chooses.

    Attributes
    ----------
    recording : str
    samples : int
    rate : float
        Of the nominal interval [Hz], to the four or more digits that the manifest or the stamps give.
    found : mapping of kind to int
        Warnings of the audit about the gyro, but for spikes, and the samples that they concern.
    split : mapping of kind to int
        Warnings of the later stages, and how many.
    """

    recording: str
    samples: int
    rate: float
    found: dict[str, int] = field(default_factory=dict)
    split: dict[str, int] = field(default_factory=dict)


CASES = {
    # The recorder's clock jumps by 0.63 s against the sensor's, which is regular.
    "tilt_laser_header_stamp": Case("bags/plotjuggler_tilt_laser.bag", 356, 20.03, {"clocks differ": 356}),
    # 181 samples seem lost, because as many come too late and at once; what remains are crumbs.
    "tilt_laser_log_time": Case(
        "bags/plotjuggler_tilt_laser.bag",
        356,
        21.7685,
        {"batched stamps": 356, "gap": 181, "clocks differ": 356},
        {"gap": 175, "segment left out": 174, "outside the attitude": 1},
    ),
    "robot_localization": Case("bags/robot_localization_test1.bag", 11865, 30.0117),
    "phone": Case("csv/bennyjhui_Gyroscope.csv", 1038, 99.7108),
    "fusion": Case("csv/fusion_sensor_data.csv", 13514, 99.2125, {"gap": 20}),
    "quadruped_header_stamp": Case("csv/gtsam_quadruped_rostopic_echo.csv", 2635, 400.0),
    "quadruped_log_time": Case(
        "csv/gtsam_quadruped_rostopic_echo.csv",
        2635,
        400.0,
        {"repeated stamp": 248, "gap": 233},
        {"repeated stamp": 1, "time not advancing": 1, "gap": 13, "segment left out": 2},
    ),
    "px4": Case(
        "csv/px4_sample_log_small_sensor_combined_0.csv",
        1298,
        204.583,
        {"gap": 32},
        {"gap": 1, "segment left out": 1},
    ),
    "xio_rows": Case("csv/sk_xio_00033_CalInertialAndMag.csv", 12626, 256.0),
    # The counter counts packets of other kinds too: half of the intervals are one count, the median is two.
    "xio_packets": Case("csv/sk_xio_00033_CalInertialAndMag.csv", 12626, 128.0, {"jitter": 12626}),
    # Sections sorted by name: of those that stand out of order the later ones are kept.
    "imucal_sections": Case(
        "turntable/imucal_annotated_session.csv",
        9414,
        204.8,
        {"backward stamp": 4535, "gap": 3507},
        {"backward stamp": 1, "gap": 1, "relative attitude": 1},
    ),
    "imucal_ferraris": Case("turntable/imucal_ferraris_session.csv", 10376, 102.4),
    "mpu6050_90deg_x_rot": Case("turntable/tomi_mpu6050_90deg_x_rot.csv", 9987, 100.0),
    # 10 samples of gx and 6 of gz are -32768.
    "mpu6050_multipose": Case("turntable/tomi_mpu6050_multipose.csv", 10245, 100.0, {"clipped": 16}),
    "mpu6050_static_test": Case("turntable/tomi_mpu6050_static_test.csv", 9986, 100.0),
    "mpu6050_tinit_static": Case("turntable/tomi_mpu6050_tinit_static.csv", 44930, 100.0),
}
"""By the id of the run, which begins with its plan's name."""


def plan_of(name: str) -> Path:
    return PLANS / f"{'mpu6050' if name.startswith('mpu6050') else name}.toml"


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every case run, into one output folder."""
    out = tmp_path_factory.mktemp("others")
    for name, case in CASES.items():
        run = command("run", DATA / case.recording, "--plan", plan_of(name), "--out", out, "--id", name)
        assert run.returncode == 0, run.stderr
        assert run.stderr == ""
        assert run.stdout.startswith(f"{name}: coning: pass\n")
    return out


def published(output: Path, name: str, table: str) -> pa.Table:
    return pq.read_table(output / table / f"recording={name}" / "part-0.parquet", partitioning=None)


def figures(output: Path, name: str) -> dict[tuple[str, str], float]:
    return {(m["channel"], m["name"]): m["value"] for m in published(output, name, "metrics").to_pylist()}


def warnings(output: Path, name: str, *stages: str) -> list[dict[str, object]]:
    """Findings of the stages that are not mere information."""
    findings = published(output, name, "findings").to_pylist()
    return [f for f in findings if f["stage"] in stages and f["severity"] != "info"]


def test_a_process_of_its_own_writes_the_same_bytes(gyrostand: Command, output: Path, tmp_path: Path) -> None:
    recording = DATA / CASES["px4"].recording
    run = gyrostand("run", recording, "--plan", plan_of("px4"), "--out", tmp_path, "--id", "px4")
    assert (run.returncode, run.stderr) == (0, "")
    files = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.parquet"))
    assert {"attitude", "findings", "gyro", "metrics", "provenance", "rates"} <= {f.parts[0] for f in files}
    for file in files:
        if file.parts[0] != "provenance":  # which holds durations
            assert (tmp_path / file).read_bytes() == (output / file).read_bytes(), file


def test_outputs_keep_their_contracts(output: Path) -> None:
    result = command("check", output)
    assert (result.returncode, result.stdout, result.stderr) == (0, "all tables keep their contracts\n", "")


@pytest.mark.parametrize("name", CASES)
def test_audit_finds_what_is_known_and_nothing_else(output: Path, name: str) -> None:
    case = CASES[name]
    figure = figures(output, name)
    assert figure["gyro", "sample_count"] == case.samples
    assert figure["gyro", "sample_rate"] == pytest.approx(case.rate, rel=5e-6)  # six digits above
    found = Counter[str]()
    for finding in warnings(output, name, "ingest", "audit"):
        if finding["stream"] == "gyro":
            found[str(finding["kind"])] += int(str(finding["count"]))
    spikes = found.pop("spike", 0)
    assert found == case.found
    # Single samples far from their neighbours are knocks here: turns by hand, steps of a robot.
    assert spikes <= case.samples / 250


@pytest.mark.parametrize("name", CASES)
def test_later_stages_say_what_they_leave_out(output: Path, name: str) -> None:
    said = Counter(str(f["kind"]) for f in warnings(output, name, "interpolate", "integrate", "score"))
    assert said == CASES[name].split


@pytest.mark.parametrize("name", CASES)
def test_validate_says_the_same_and_writes_nothing(output: Path, name: str) -> None:
    before = {path: path.stat().st_mtime_ns for path in output.rglob("*")}
    result = command("validate", DATA / CASES[name].recording, "--plan", plan_of(name))
    assert (result.returncode, result.stderr) == (0, "")
    for kind in CASES[name].found:
        assert re.search(rf" gyro(\.\w+)?: {re.escape(kind)}: ", result.stdout)
    assert {path: path.stat().st_mtime_ns for path in output.rglob("*")} == before


# the samples are those of the file ------------------------------------------


def read_text(name: str, head: int, *columns: int) -> Float:
    return np.genfromtxt(DATA / name, delimiter=",", skip_header=head, usecols=columns)


def read_bag(name: str, topic: str) -> tuple[list[int], list[int], Float]:
    """Header stamps and log times [ns], and rates, by rosbags."""
    with AnyReader([DATA / name]) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        read: list[tuple[int, Any]] = [
            (log, reader.deserialize(data, c.msgtype)) for c, log, data in reader.messages(connections)
        ]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in read]
    rates = [[getattr(m.angular_velocity, axis) for axis in "xyz"] for _, m in read]
    return stamps, [log for log, _ in read], np.array(rates)


def whole_numbers(name: str, column: int) -> list[int]:
    """A column of whole numbers, which float64 would round."""
    lines = (DATA / name).read_text().splitlines()[1:]
    return [int(line.split(",")[column]) for line in lines]


def by_rate(counts: list[int], rate: str) -> list[int]:
    """Time of counts at a rate [ns], exactly."""
    return [round(count * 10**9 / Fraction(rate)) for count in counts]


def expected_samples(name: str) -> tuple[list[int], Float]:
    """Time [ns] and rates [rad/s] of a recording under its plan."""
    file = CASES[name].recording
    match name:
        case "tilt_laser_header_stamp" | "robot_localization":
            stamps, _, rates = read_bag(file, "/imu_data" if name.startswith("tilt") else "/imu/data")
            return stamps, rates
        case "tilt_laser_log_time":
            _, log, rates = read_bag(file, "/imu_data")
            return log, rates
        case "phone":
            return whole_numbers(file, 0), read_text(file, 1, 4, 3, 2)
        case "fusion":
            seconds = [Fraction(line.split(",")[0]) for line in (DATA / file).read_text().splitlines()[1:]]
            return [round(t * 10**9) for t in seconds], read_text(file, 1, 1, 2, 3) * DEGREE
        case "quadruped_header_stamp" | "quadruped_log_time":
            header = (DATA / file).read_text().splitlines()[0].split(",")
            clock = header.index("field.header.stamp") if "header" in name else 0
            columns = [header.index(f"field.angular_velocity.{axis}") for axis in "xyz"]
            return whole_numbers(file, clock), read_text(file, 1, *columns)
        case "px4":
            return [1000 * t for t in whole_numbers(file, 0)], read_text(file, 1, 1, 2, 3)
        case "xio_rows":
            return by_rate(list(range(12626)), "256"), read_text(file, 1, 1, 2, 3) * DEGREE
        case "xio_packets":
            return by_rate(whole_numbers(file, 0), "256"), read_text(file, 1, 1, 2, 3) * DEGREE
        case "imucal_sections":
            return by_rate(whole_numbers(file, 1), "204.8"), read_text(file, 1, 5, 6, 7) / 16.4 * DEGREE
        case "imucal_ferraris":
            return by_rate(whole_numbers(file, 0), "102.4"), read_text(file, 1, 1, 2, 3) * DEGREE
    counts = read_text(file, 5, 3, 4, 5)
    rates = (counts / 131 + [3.26826, -1.11757, 0.50384]) * DEGREE
    return by_rate(list(range(len(counts))), "100"), rates


@pytest.mark.parametrize("name", CASES)
def test_samples_are_those_of_the_file(output: Path, name: str) -> None:
    time, rates = expected_samples(name)
    table = published(output, name, "gyro")
    # A nanosecond: counts over a rate that binary floating point rounds.
    np.testing.assert_allclose(table["time"].to_numpy() - np.array(time), 0, atol=1)
    found = np.column_stack([table[channel].to_numpy() for channel in "pqr"])
    # Scale, offset and unit are three roundings, of up to 250 deg/s (4.4 rad/s).
    np.testing.assert_allclose(found, rates, rtol=1e-15, atol=4e-15)


# what the motion was --------------------------------------------------------


def turned(output: Path, name: str, start: float, end: float) -> Float:
    """Integral of p, q, r between two times of the record [deg]."""
    rates = published(output, name, "rates")
    time = rates["time"].to_numpy() * 1e-9
    inside = (time > start) & (time <= end)
    return np.array([rates[f"increment_{c}"].to_numpy()[inside].sum() for c in "pqr"]) / DEGREE


def test_full_turns_are_full_turns(output: Path) -> None:
    """Each axis was turned by 360 degrees; 16.4 counts a degree a second hold within the sensor's 3 %."""
    sections = {"x_rot": (5596, 6900), "y_rot": (6901, 7993), "z_rot": (7994, 9413)}
    for axis, (first, last) in enumerate(sections.values()):
        found = turned(output, "imucal_sections", first / 204.8, last / 204.8)
        assert found[axis] == pytest.approx(360, rel=0.03)
        assert np.abs(np.delete(found, axis)).max() < 15  # turned by hand on a table


def test_a_quarter_turn_is_a_quarter_turn(output: Path) -> None:
    """The sensor stood until 16 s, was turned about x, and stood again from 24 s."""
    found = turned(output, "mpu6050_90deg_x_rot", 0, 24)
    assert found[0] == pytest.approx(90, rel=0.03)  # the data sheet's scale factor tolerance


def test_a_static_sensor_less_its_mean_returns(output: Path) -> None:
    # Offsets to five decimals leave 5e-4 deg in 100 s; the first and the last sample, of up to 0.5 deg/s,
    # count half in an integral and whole in a mean: 5e-3 deg.
    assert np.abs(turned(output, "mpu6050_static_test", 0, 100)).max() < 6e-3


def test_the_exact_clock_agrees_best_with_the_reference(output: Path) -> None:
    """The robot's own attitude is the reference: by the stamps in the messages it is met to its noise."""
    exact, written = (figures(output, f"quadruped_{clock}") for clock in ("header_stamp", "log_time"))
    assert exact["psi", "relative_rms_error"] < 1e-4
    assert exact["psi", "peak_error"] < 2e-3
    assert written["psi", "relative_rms_error"] > 5 * exact["psi", "relative_rms_error"]
    assert written["gyro", "longest_gap"] == pytest.approx(0.055, rel=1e-12)  # whole milliseconds
    assert exact["gyro", "gap_count"] == exact["gyro", "repeated_stamp_count"] == 0


def test_a_score_of_crumbs_is_not_taken_for_a_good_one(output: Path) -> None:
    """Batches cut the record to pieces that begin at the reference: the figures are good, and say nothing."""
    crumbs, whole = (figures(output, f"tilt_laser_{clock}") for clock in ("log_time", "header_stamp"))
    assert crumbs["psi", "relative_rms_error"] < 0.1 * whole["psi", "relative_rms_error"]
    said = [
        f for f in warnings(output, "tilt_laser_log_time", "score") if f["kind"] == "outside the attitude"
    ]
    assert len(said) == 1
    assert int(str(said[0]["count"])) > 300  # of 356


# wrong units ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "right", "wrong", "code", "says"),
    [
        ("quadruped_header_stamp", "rad/s", "deg/s", 1, "radians where degrees are stated"),
        ("robot_localization", "rad/s", "deg/s", 1, "radians where degrees are stated"),
        # Nothing contradicts these but that no gyro turns so fast.
        ("fusion", "deg/s", "rad/s", 0, "degrees where radians are stated?"),
        ("xio_rows", "deg/s", "rad/s", 0, "degrees where radians are stated?"),
        ("imucal_ferraris", "deg/s", "rad/s", 0, "degrees where radians are stated?"),
    ],
)
def test_a_wrong_unit_is_marked(
    name: str, right: str, wrong: str, code: int, says: str, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(plan_of(name).read_text().replace(f'"{right}"', f'"{wrong}"'))
    result = command("validate", DATA / CASES[name].recording, "--plan", plan)
    assert (result.returncode, result.stderr) == (code, "")
    assert "implausible unit" in result.stdout
    assert says in result.stdout


# plan init ------------------------------------------------------------------

BLANK_GYRO = ("csv/bennyjhui_Gyroscope.csv",)
"""Recordings of which no column looks like a gyro's, though three are one."""


def filled(plan: str) -> str:
    """A begun plan with its blanks filled: the first clock that is offered, and a unit that fits."""
    plan = re.sub(r'unit = "" }(?=.*the message is defined in (\S+))', r'unit = "\1" }', plan)
    plan = plan.replace('start_attitude = ""', 'start_attitude = "levelled"')
    for axis in "xyz":
        plan = plan.replace('{ field = "", unit = "" }', f'{{ field = "{axis}", unit = "" }}', 1)
    plan = plan.replace('unit = "" }', 'unit = "rad/s" }')
    if "[time]    # FILL IN" in plan:
        offered = (
            r'^# (clock = "\w+")(?!.*no clock)',
            r'^# (field = ".*")\n# unit = ""',
            r"^# (rate = [\d.]+)",
        )
        chosen = next(m for m in (re.search(o, plan, re.MULTILINE) for o in offered) if m)
        unit = '\nunit = "ns"' if chosen[1].startswith("field") else ""
        plan = plan.replace(chosen[0], chosen[1] + unit, 1)
    return plan.replace('unit = ""', 'unit = "s"')


OF_VEHICLES = ("bags/plotjuggler_tilt_laser.bag", "bags/robot_localization_test1.bag")
"""Recordings with an accelerometer and satellites beside the gyro."""

WITH_RATES = sorted({case.recording for case in CASES.values()} | {"csv/broad_02_slow_rotation_B.csv"})


@pytest.mark.parametrize("name", WITH_RATES)
def test_a_begun_plan_needs_its_blanks_alone(name: str, tmp_path: Path) -> None:
    begun = command("plan", "init", DATA / name)
    assert (begun.returncode, begun.stderr) == (0, "")
    plan = tmp_path / "begun.toml"
    plan.write_text(begun.stdout, encoding="utf-8")
    if "FILL IN:" in begun.stdout:
        refused = command("plan", "check", plan)
        assert refused.returncode == 2
        assert all(line.startswith(("gyrostand: ", str(plan))) for line in refused.stderr.splitlines())
    plan.write_text(filled(begun.stdout), encoding="utf-8")
    checked = command("plan", "check", plan)
    assert (checked.returncode, checked.stderr) == (0, "")
    assert f"procedure {'navigation' if name in OF_VEHICLES else 'coning'}" in checked.stdout
    assert ("looks like a gyro;" in begun.stdout) == (name in BLANK_GYRO)
    audited = command("validate", DATA / name, "--plan", plan)
    # Its axes are forward, left, up: the begun plan has no rotation, and the audit says so.
    wrong_axes = name == "bags/plotjuggler_tilt_laser.bag"
    assert (audited.returncode, audited.stderr) == (int(wrong_axes), "")
    assert ("implausible axes" in audited.stdout) == wrong_axes


@pytest.mark.parametrize("name", ["mcap/mbp_torque_ripple_data_0.mcap"])
def test_without_a_gyro_a_begun_plan_says_so_and_is_refused(name: str, tmp_path: Path) -> None:
    begun = command("plan", "init", DATA / name)
    assert begun.returncode == 0
    assert "Nothing in the recording looks like a gyro" in begun.stdout
    plan = tmp_path / "begun.toml"
    plan.write_text(begun.stdout, encoding="utf-8")
    assert command("plan", "check", plan).returncode == 2


# refusals -------------------------------------------------------------------

IMU = "tilt_laser_header_stamp"
ABSENT = "the topic '/imu_data' in the test plan"


@pytest.mark.parametrize(
    ("name", "plan", "code", "says"),
    [
        ("mcap/mbp_alternate_bagfile_0.mcap", IMU, 2, (ABSENT, "'/robot/joint_state'")),
        ("mcap/mbp_controlled_data_0.mcap", IMU, 2, (ABSENT, "'/BNO055_imu/quaternion'")),
        ("mcap/mbp_torque_ripple_data_0.mcap", IMU, 2, (ABSENT, "'/robot/joint_state'")),
        ("mcap/mbp_uncontrolled_data_0.mcap", IMU, 2, (ABSENT, "'/BNO055_imu/quaternion'")),
        ("bags/plotjuggler_tilt_laser.bag", "robot_localization", 2, ("did you mean '/imu_data'",)),
        ("rosbag2_resources/rosbag2_tests/resources/mcap/cdr_test", IMU, 2, (ABSENT, "'/test_topic'")),
        ("rosbag2_resources/rosbag2_tests/resources/sqlite3/cdr_test", IMU, 2, (ABSENT, "'/test_topic'")),
        (
            "rosbag2_resources/rosbag2_transport/test/resources/qos_profile_overrides.yaml",
            "px4",
            2,
            ("column",),
        ),
        ("csv/px4_sample_log_small_sensor_combined_0.csv", "quadruped_log_time", 2, ("'gyro_rad[0]'",)),
        ("csv/px4_sample_log_small_sensor_combined_0.csv", IMU, 2, ("a text file has none",)),
        ("malformed/rosbagjs_example-bz2.bag", IMU, 2, (ABSENT, "'/turtle1/pose'")),
        ("malformed/rosbagjs_example-lz4.bag", IMU, 2, (ABSENT, "'/turtle1/pose'")),
        ("malformed/rosbagjs_example-unsorted-chunks.bag", IMU, 2, (ABSENT, "'foo'")),
        ("malformed/webviz_empty_message_definition.bag", IMU, 2, (ABSENT, "'/led_array_status'")),
        ("malformed/rosbagjs_no-messages.bag", IMU, 3, ("no topic at all",)),
        ("malformed/rosbagjs_empty-file.bag", IMU, 3, ("an empty file",)),
        ("malformed/rosbagjs_asci-file.bag", IMU, 3, ("a binary recording",)),
        ("rosbag2_resources/rosbag2_tests/resources/empty_dir", IMU, 3, ("metadata.yaml",)),
    ],
)
def test_what_has_no_rates_is_refused_in_one_line(
    name: str, plan: str, code: int, says: tuple[str, ...], tmp_path: Path
) -> None:
    for arguments in (("run", DATA / name, "--out", tmp_path / "out"), ("validate", DATA / name)):
        if arguments[0] == "validate" and name.endswith("empty_dir"):
            continue  # there a folder without a bag is one of recordings
        assert_refused(command(*arguments, "--plan", plan_of(plan)), code, *says, Path(name).name)
    assert not list(tmp_path.rglob("*.parquet"))


def test_a_topic_that_cannot_be_decoded_is_unreadable_input(tmp_path: Path) -> None:
    """The definition of the message is empty: its fields cannot be known."""
    plan = tmp_path / "plan.toml"
    plan.write_text(plan_of(IMU).read_text().replace("/imu_data", "/led_array_status"))
    name = "malformed/webviz_empty_message_definition.bag"
    assert_refused(command("validate", DATA / name, "--plan", plan), 3, "led_array_msgs/Status")
