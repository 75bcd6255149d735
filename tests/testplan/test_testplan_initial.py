"""The first test plan of a recording: complete but for what must not be guessed."""

from __future__ import annotations

import gzip
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline import formats
from pipeline.formats.base import Field, Inspection, Series, Topic
from pipeline.testplan import load_plan
from pipeline.testplan.candidates import find_candidates
from pipeline.testplan.errors import PlanError
from pipeline.testplan.initial import escaped, initial_plan, quoted


def table(
    name: str, fields: str, clocks: dict[str, tuple[int, int]] | None = None, of: str = "x/msg/Y"
) -> Topic:
    return Topic(name, of, "cdr", 3, tuple(Field(f, "float64") for f in fields.split()), clocks or {})


def loads(tmp_path: Path, text: str) -> str:
    """What the plan is refused with; "" where it is accepted."""
    path = tmp_path / "begun.toml"
    path.write_text(text, encoding="utf-8")
    try:
        load_plan(path)
    except PlanError as error:
        return str(error)
    return ""


def test_a_text_file_with_units_and_one_time_needs_nothing_more(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text("Time (ms),Gyro X (dps),Gyro Y (dps),Gyro Z (dps),T (C)\n0,1,2,3,20\n1,1,2,3,20\n")
    text = initial_plan(formats.inspect(path))
    assert loads(tmp_path, text) == ""
    plan = tomllib.loads(text)
    assert plan["time"] == {"field": "Time (ms)", "unit": "ms"}
    assert plan["streams"]["gyro"]["channels"]["q"] == {"field": "Gyro Y (dps)", "unit": "deg/s"}
    assert "T (C)" in text


def test_what_the_simulator_of_text_writes_is_mapped_whole(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv.gz"
    header = "time (s),p (rad/s),q (rad/s),r (rad/s),psi (deg),theta (deg),gamma (deg)"
    path.write_bytes(gzip.compress(f"{header}\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n".encode()))
    text = initial_plan(formats.inspect(path))
    assert loads(tmp_path, text) == ""
    assert "gyrostand plan check run7.toml" in text
    reference = tomllib.loads(text)["streams"]["reference"]
    assert reference["quantity"] == "euler_krylov"
    assert reference["channels"]["theta"] == {"field": "theta (deg)", "unit": "deg"}


def test_units_that_the_file_does_not_state_are_blanks_that_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text("t,gyro_x,gyro_y,gyro_z\n0,1,2,3\n1,1,2,3\n")
    text = initial_plan(formats.inspect(path))
    refused = loads(tmp_path, text).splitlines()
    assert len(refused) == 4
    assert all(".unit: " in line or "time.unit" in line for line in refused)
    assert text.count("# FILL IN: rad/s or deg/s") == 3
    assert "# FILL IN: s, ms, us or ns" in text
    filled = text.replace('unit = "" }', 'unit = "deg/s" }').replace('unit = ""', 'unit = "s"')
    assert loads(tmp_path, filled) == ""


def test_a_unit_that_is_none_of_the_quantity_is_a_blank_that_quotes_it() -> None:
    fields = tuple(Field(f"gyro_{a}", "float64", "V") for a in "xyz")
    text = initial_plan(Inspection(Path("a.csv"), "text", (Topic("", "row", "", 2, fields, {}),)))
    assert "the file says 'V'" in text
    assert tomllib.loads(text)["streams"]["gyro"]["channels"]["p"]["unit"] == ""


def test_the_clocks_of_messages_are_offered_with_what_they_show(tmp_path: Path) -> None:
    time = np.arange(101, dtype=np.int64) * 10_000_000
    rates = dict.fromkeys(("angular_velocity.x", "angular_velocity.y", "angular_velocity.z"), np.zeros(101))
    attitude = {f"quaternion.{a}": np.full(101, 0.5) for a in "wxyz"}
    path = tmp_path / "run7.mcap"
    formats.write(
        path,
        [
            Series("/gyro", "sensor_msgs/msg/Imu", time + 1, np.zeros_like(time), rates),
            Series("/reference", "geometry_msgs/msg/QuaternionStamped", time, time, attitude),
        ],
    )
    text = initial_plan(formats.inspect(path))
    assert '# clock = "header_stamp"    # /gyro: all 0, never set' in text
    assert '# clock = "log_time"    # /gyro: 101 samples, 1 … 1000000001 ns, 1 s, mean 100 Hz' in text
    assert "the message is defined in rad/s" in text
    refused = loads(tmp_path, text)
    assert "no clock is chosen" in refused
    assert refused.count(".unit: ") == 3
    assert "streams.reference" not in refused
    filled = text.replace('unit = ""', 'unit = "rad/s"').replace("[time]", '[time]\nclock = "log_time"')
    assert loads(tmp_path, filled) == ""


def test_a_file_without_time_is_offered_a_rate_and_its_counter(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text(
        "Packet number,Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s)\n1,1,2,3\n2,1,2,3\n"
    )
    text = initial_plan(formats.inspect(path))
    assert '# counter = "Packet number"' in text
    assert "no clock is chosen" in loads(tmp_path, text)
    filled = text.replace("# rate = 400.0", "rate = 256").replace("# counter", "counter")
    assert loads(tmp_path, filled) == ""


@pytest.mark.parametrize(
    ("fields", "chosen"),
    [
        ("p q r", "p q r"),
        ("z y x gz gy gx", "gx gy gz"),
        ("gx_rads gy_rads gz_rads", "gx_rads gy_rads gz_rads"),
        ("accel_x accel_y accel_z omega_x omega_y omega_z", "omega_x omega_y omega_z"),
        ("gyro_rad[0] gyro_rad[1] gyro_rad[2]", "gyro_rad[0] gyro_rad[1] gyro_rad[2]"),
        ("imu.gyro.x imu.gyro.y imu.gyro.z", "imu.gyro.x imu.gyro.y imu.gyro.z"),
        (
            "angular_velocity_covariance[0] angular_velocity.x angular_velocity.y angular_velocity.z",
            "angular_velocity.x angular_velocity.y angular_velocity.z",
        ),
        ("x y z", ""),
        ("accel_x accel_y accel_z", ""),
        ("gyro_bias_x gyro_bias_y gyro_bias_z", ""),
        ("gx gy", ""),
    ],
)
def test_fields_that_look_like_a_gyro(fields: str, chosen: str) -> None:
    found = find_candidates([table("", fields)])
    assert [f.path for c in found if c.stream == "gyro" for f in c.fields] == chosen.split()


@pytest.mark.parametrize(
    ("topic", "message", "fields", "chosen"),
    [
        ("", "row", "t alpha1 alpha2", "alpha1 alpha2"),
        ("", "row", "alpha_2_deg alpha_1_deg", "alpha_1_deg alpha_2_deg"),
        ("", "row", "inner_angle outer_angle", "outer_angle inner_angle"),
        ("", "row", "Outer Inner", "Outer Inner"),
        ("", "row", "encoder1 encoder2 encoder1_status encoder2_status", "encoder1 encoder2"),
        ("", "row", "enc[0] enc[1] enc[2]", "enc[0] enc[1]"),
        ("", "row", "outer_temp inner_temp outer_rate inner_rate", ""),
        ("", "row", "alpha1", ""),
        ("", "row", "accel1 accel2 x y z", ""),
        (
            "/stand/gimbal",
            "geometry_msgs/msg/Vector3Stamped",
            "vector.x vector.y vector.z",
            "vector.x vector.y",
        ),
        ("/stand/force", "geometry_msgs/msg/Vector3Stamped", "vector.x vector.y vector.z", ""),
        (
            "/joint_states",
            "sensor_msgs/msg/JointState",
            "position[0] position[1] velocity[0] velocity[1] effort[0] effort[1]",
            "position[0] position[1]",
        ),
        ("/joint_states", "x/msg/Y", "position[0] position[1]", ""),
        (
            "/stand",
            "lab/msg/Encoders",
            "gimbal.outer.counts gimbal.inner.counts",
            "gimbal.outer.counts gimbal.inner.counts",
        ),
    ],
)
def test_fields_that_look_like_a_gimbal(topic: str, message: str, fields: str, chosen: str) -> None:
    found = find_candidates([table(topic, fields, of=message)])
    assert [f.path for c in found if c.stream == "gimbal" for f in c.fields] == chosen.split()


def test_a_field_in_another_unit_is_no_angle() -> None:
    fields = tuple(Field(f"alpha{k}", "float64", "deg/s") for k in (1, 2))
    assert find_candidates([Topic("", "row", "", 2, fields, {})]) == []


def test_gimbal_angles_begin_a_plan_of_drift(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text("time (s),alpha1 (deg),alpha2 (deg)\n0,1,2\n60,1,2\n")
    text = initial_plan(formats.inspect(path))
    refused = loads(tmp_path, text).splitlines()
    assert ["latitude_deg" in line or "scheme" in line for line in refused] == [True, True]
    assert text.count("FILL IN") == 3  # these two, and the word of what they are marked with
    filled = text.replace('latitude_deg = ""', "latitude_deg = 55.75").replace(
        'scheme = ""', 'scheme = "polar"'
    )
    assert loads(tmp_path, filled) == ""
    plan = tomllib.loads(filled)
    assert plan["procedure"] == "drift"
    assert plan["streams"]["gimbal"]["channels"]["alpha2"] == {"field": "alpha2 (deg)", "unit": "deg"}
    several = filled.replace("# [[runs]]", "[[runs]]").replace("# [[limits]]", "[[limits]]")
    for key in (
        "name = ",
        "recording",
        "start",
        "stop",
        "scheme",
        "metric",
        "channel = ",
        "upper",
        "marginal",
    ):
        several = several.replace(f"# {key}", key)
    assert loads(tmp_path, several) == ""  # what stands in the comments is right as well


def test_joints_and_counts_are_blanks_with_what_is_known_of_them() -> None:
    joints = table(
        "/joints", "position[0] position[1]", {"log_time": (0, 1)}, of="sensor_msgs/msg/JointState"
    )
    text = initial_plan(Inspection(Path("a.mcap"), "MCAP", (joints,)))
    assert text.count("# FILL IN: rad or deg; the message is defined in rad") == 2
    assert "wraps_at = 1048576" in text
    plan = tomllib.loads(text)
    assert (plan["procedure"], plan["streams"]["gimbal"]["topic"]) == ("drift", "/joints")


def test_a_gyro_comes_before_a_gimbal() -> None:
    text = initial_plan(Inspection(Path("a.csv"), "text", (table("", "t p q r outer inner"),)))
    assert tomllib.loads(text)["procedure"] == "coning"
    assert "# Also looks like a gimbal:" in text


@pytest.mark.parametrize(
    ("topic", "fields", "found"),
    [
        ("", "table_angle", [("table_angle", "table_angle")]),
        ("", "Turntable.rate time", [("table_rate", "Turntable.rate")]),
        ("", "rate_table_position rate_table_speed",
         [("table_angle", "rate_table_position"), ("table_rate", "rate_table_speed")]),
        ("/turntable", "vector.x vector.y vector.z", [("table_angle", "vector.z")]),
        ("/rate_table/encoder", "position velocity stamp",
         [("table_angle", "position"), ("table_rate", "velocity")]),
        ("", "table_angle_command table_temperature table tablet_angle stable_rate", []),
    ],
)  # fmt: skip
def test_fields_that_look_like_a_table(topic: str, fields: str, found: list[tuple[str, str]]) -> None:
    candidates = find_candidates([table(topic, fields)])
    assert [(c.quantity, c.fields[0].path) for c in candidates if c.stream == "turntable"] == found


def test_a_stated_unit_says_whether_a_table_s_field_is_an_angle_or_a_rate() -> None:
    fields = tuple(Field(f"table {k}", "float64", unit) for k, unit in enumerate(("deg", "rpm", "V")))
    found = find_candidates([Topic("", "row", "", 2, fields, {})])
    assert [(c.quantity, c.fields[0].path) for c in found] == [
        ("table_angle", "table 0"),
        ("table_rate", "table 1"),
    ]


def test_a_gyro_on_a_table_may_be_calibrated_on_it(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text("t (s),gyro x (dps),gyro y (dps),gyro z (dps),table rate (rpm)\n0,1,2,3,4\n1,1,2,3,4\n")
    text = initial_plan(formats.inspect(path))
    said = text[: text.index("procedure =")]
    assert '"static"' in said
    assert '"rate_table"' in said
    assert tomllib.loads(text)["streams"]["turntable"]["channels"] == {
        "rate": {"field": "table rate (rpm)", "unit": "rpm"}
    }
    assert "procedure: expected one of the procedures" in loads(tmp_path, text)  # which is not guessed
    own = text.replace('procedure = ""', 'procedure = "rate_table"')
    assert "add [[runs]]" in loads(tmp_path, own)
    offered = text[text.index("# [[runs]]") :].split("\n\n")[0]
    # what is offered, but for the further recording, is a plan of the procedure
    runs = "\n".join(line[2:] for line in offered.splitlines() if "recording =" not in line)
    own = (
        own.replace(offered, runs)
        .replace("# latitude_deg", "latitude_deg")
        .replace("# table_tilt", "table_tilt")
    )
    assert loads(tmp_path, own) == ""
    calibrate = text[text.index("# [calibrate]") :].split("\n\n")[0]
    limit = text[text.index("# [[limits]]", text.index("rate_table:")) :].split("\n\n")[0]
    for offered in (calibrate, limit):
        own = own.replace(offered, "\n".join(line[2:] for line in offered.splitlines()))
    assert loads(tmp_path, own) == ""
    assert "[calibrate]" in own.splitlines()


def test_a_gyro_on_a_table_begins_a_plan_of_static(tmp_path: Path) -> None:
    path = tmp_path / "run7.csv"
    path.write_text("t (s),gyro x (dps),gyro y (dps),gyro z (dps),table angle (deg)\n0,1,2,3,4\n1,1,2,3,4\n")
    begun = initial_plan(formats.inspect(path))
    text = begun.replace('procedure = ""', 'procedure = "static"')
    assert loads(tmp_path, text) == ""
    plan = tomllib.loads(text)
    assert plan["streams"]["turntable"] == {
        "quantity": "table_angle",
        "channels": {"angle": {"field": "table angle (deg)", "unit": "deg"}},
    }
    limit = text[text.index("# [[limits]]") :].split("\n\n")[0]
    text = text.replace(limit, "\n".join(line[2:] for line in limit.splitlines()))
    assert "[[limits]]" in text.splitlines()
    assert loads(tmp_path, text) == ""  # the limit that is offered is one of the procedure


def test_a_gyro_alone_is_told_of_both_procedures(tmp_path: Path) -> None:
    alone = initial_plan(Inspection(Path("a.csv"), "text", (table("", "gyro_x gyro_y gyro_z"),)))
    assert tomllib.loads(alone)["procedure"] == "coning"
    said = alone[: alone.index("procedure =")]
    assert '"coning"' in said
    assert '"static"' in said
    nothing = initial_plan(Inspection(Path("a.csv"), "text", (table("", "u v"),)))
    assert '"static"' in nothing
    assert "static does with any of p, q and r" in nothing
    with_reference = table("", "gyro_x gyro_y gyro_z psi theta gamma")
    assert "static" not in initial_plan(Inspection(Path("a.csv"), "text", (with_reference,)))


def test_a_plan_of_static_alone_offers_no_limit_of_coning() -> None:
    fields = (Field("p (deg/s)", "float64", "deg/s"),)
    text = initial_plan(Inspection(Path("a.csv"), "text", (Topic("", "row", "", 2, fields, {}),)))
    assert tomllib.loads(text)["procedure"] == "static"
    assert "relative_rms_error_corrected" not in text
    three = initial_plan(Inspection(Path("a.csv"), "text", (table("", "gyro_x gyro_y gyro_z"),)))
    assert "Of the procedure coning:" in three
    assert "Of the procedure static:" in three


@pytest.mark.parametrize(
    ("header", "quantity", "channels"),
    [
        ("t,Gyro [deg/s]", "angular_rate", {"p": "Gyro [deg/s]"}),
        ("t,Gyro", "angular_rate", {"p": "Gyro"}),
        ("t,p (deg/s)", "angular_rate", {"p": "p (deg/s)"}),
        ("t,p (rad),r (rad)", "angle_increment", {"p": "p (rad)", "r": "r (rad)"}),
        ("t,gyro_z (dps),gyro_temp (degC)", "angular_rate", {"r": "gyro_z (dps)"}),
        ("t,p (bar),q (V)", "angular_rate", {"p": "", "q": "", "r": ""}),
    ],
)
def test_a_gyro_of_fewer_than_three_axes(
    tmp_path: Path, header: str, quantity: str, channels: dict[str, str]
) -> None:
    path = tmp_path / "run7.csv"
    row = ",".join("123"[: header.count(",") + 1])
    path.write_text(f"{header}\n{row}\n{row}\n")
    text = initial_plan(formats.inspect(path))
    stream = tomllib.loads(text)["streams"]["gyro"]
    assert stream["quantity"] == quantity
    assert {name: one["field"] for name, one in stream["channels"].items()} == channels
    # that the axis was chosen is said where no name says it
    assert ("does not say which of p, q and r" in text) == ("Gyro" in header)


def test_a_vector_is_a_gyro_by_its_topic() -> None:
    of = "geometry_msgs/msg/Vector3Stamped"
    fields = "header.seq vector.x vector.y vector.z"
    found = find_candidates([table(name, fields, of=of) for name in ("/gyro", "/force", "/gyro_bias")])
    assert [(c.stream, c.topic.name, len(c.fields)) for c in found] == [("gyro", "/gyro", 3)]


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        ("gyro Encoder", [("table_angle", "Encoder")]),
        ("gyro tisch_rpm", [("table_rate", "tisch_rpm")]),
        ("gyro Drehtisch_Winkel", [("table_angle", "Drehtisch_Winkel")]),
        ("gyro enc_error encoder_status", []),
        ("gyro_x gyro_y gyro_z motor_rpm pump_rpm", []),  # several are of something else
        ("Encoder", []),  # without a gyro
    ],
)
def test_an_encoder_beside_a_gyro_may_be_a_table_s(fields: str, found: list[tuple[str, str]]) -> None:
    candidates = find_candidates([table("", fields)])
    assert [(c.quantity, c.fields[0].path) for c in candidates if c.stream == "turntable"] == found


def test_a_table_s_rate_without_a_unit_may_be_in_rpm() -> None:
    text = initial_plan(Inspection(Path("a.csv"), "text", (table("", "gyro tisch_rpm"),)))
    assert "# FILL IN: rad/s, deg/s or rpm" in text


def test_a_message_with_rates_is_no_reference_of_itself() -> None:
    imu = table(
        "/imu",
        "orientation.w orientation.x orientation.y orientation.z "
        "angular_velocity.x angular_velocity.y angular_velocity.z",
    )
    odometry = table("/odom", "pose.orientation.w pose.orientation.x pose.orientation.y pose.orientation.z")
    text = initial_plan(Inspection(Path("a.bag"), "ROS 1 bag", (imu, odometry)))
    assert set(tomllib.loads(text)["streams"]) == {"gyro"}
    assert text.count("# [streams.reference]") == 2
    assert "the sensor's own estimate" in text


def vehicle(*more: Topic) -> Inspection:
    imu = " ".join(f"{kind}.{a}" for kind in ("angular_velocity", "linear_acceleration") for a in "xyz")
    clocks = {"header_stamp": (1, 2)}
    fix = table("/fix", "latitude longitude altitude status.status", clocks, "sensor_msgs/msg/NavSatFix")
    topics = (table("/imu", imu, clocks, "sensor_msgs/msg/Imu"), fix, *more)
    return Inspection(Path("run7.mcap"), "MCAP", topics, ())


def test_a_gyro_with_satellites_begins_a_plan_of_navigation(tmp_path: Path) -> None:
    field = " ".join(f"magnetic_field.{a}" for a in "xyz")
    magnetic = table("/mag", field, {"header_stamp": (1, 2)}, "sensor_msgs/msg/MagneticField")
    text = initial_plan(vehicle(magnetic))
    plan = tomllib.loads(text)
    assert plan["procedure"] == "navigation"
    assert list(plan["streams"]) == ["gyro", "accelerometer", "gnss_position", "magnetometer"]
    assert plan["streams"]["accelerometer"]["topic"] == plan["streams"]["gyro"]["topic"] == "/imu"
    assert plan["streams"]["gnss_position"]["channels"]["fix"] == {"field": "status.status", "unit": "1"}
    assert "the message is defined in deg" in text
    assert "the message is defined in m/s^2" in text
    assert "start_attitude" in loads(tmp_path, text)  # what must not be guessed is refused
    for blank, filled in (
        ('latitude", unit = ""', 'latitude", unit = "deg"'),
        ('longitude", unit = ""', 'longitude", unit = "deg"'),
        ('altitude", unit = ""', 'altitude", unit = "m"'),
        ('start_attitude = ""', 'start_attitude = "levelled"'),
        ('strength_ut = ""', "strength_ut = 52.0"),
        ('dip_deg = ""', "dip_deg = 71.0"),
        ('declination_deg = ""', "declination_deg = 11.0"),
        ("# clock", "clock"),
        *((f'magnetic_field.{a}", unit = ""', f'magnetic_field.{a}", unit = "T"') for a in "xyz"),
        *((f'angular_velocity.{a}", unit = ""', f'angular_velocity.{a}", unit = "rad/s"') for a in "xyz"),
        *(
            (f'linear_acceleration.{a}", unit = ""', f'linear_acceleration.{a}", unit = "m/s^2"')
            for a in "xyz"
        ),
    ):
        assert blank in text
        text = text.replace(blank, filled, 1)
    assert loads(tmp_path, text) == ""


def test_an_attitude_beside_satellites_is_offered_as_external() -> None:
    pose = table("/reference", " ".join(f"quaternion.{a}" for a in "wxyz"), {"header_stamp": (1, 2)})
    text = initial_plan(vehicle(pose))
    assert tomllib.loads(text)["procedure"] == "navigation"
    assert "# Also looks like an external_attitude:" in text


def test_an_accelerometer_without_satellites_is_no_vehicle() -> None:
    imu = " ".join(f"{kind}.{a}" for kind in ("angular_velocity", "linear_acceleration") for a in "xyz")
    topic = table("/imu", imu, {"header_stamp": (1, 2)}, "sensor_msgs/msg/Imu")
    text = initial_plan(Inspection(Path("run7.mcap"), "MCAP", (topic,), ()))
    assert tomllib.loads(text)["procedure"] == "coning"
    assert "accelerometer" not in text


def test_a_recording_without_a_gyro_lists_what_it_holds(tmp_path: Path) -> None:
    joints = table("/joints", "position[0] velocity[0]", {"log_time": (0, 1)})
    lost = Topic("/lost", "a/B", "cdr", 1, (), {}, "no definition")
    text = initial_plan(Inspection(Path("a.mcap"), "MCAP", (joints, lost)))
    assert "Nothing in the recording looks like a gyro" in text
    assert "position[0], velocity[0]" in text
    assert "cannot be decoded: no definition" in text
    assert "streams.gyro.channels.p.field" in loads(tmp_path, text)
    assert "holds nothing" in initial_plan(Inspection(Path("a.mcap"), "MCAP", ()))


HOSTILE = st.text(min_size=1, max_size=8) | st.text(
    '"\\\n\r\t\x00\x7f\ud800]#=\u2028', min_size=1, max_size=8
)


@given(prefix=HOSTILE, topic=HOSTILE, unit=HOSTILE)
def test_hostile_names_are_strings_and_comments_and_nothing_else(prefix: str, topic: str, unit: str) -> None:
    fields = tuple(Field(f"{prefix}.gyro.{axis}", unit, unit) for axis in "xyz")
    recording = Topic(topic, prefix, unit, 3, fields, {"log_time": (0, 1)}, prefix)
    text = initial_plan(Inspection(Path(f"a{prefix}".replace("/", "")), "MCAP", (recording,)))
    plan = tomllib.loads(text)
    assert set(plan) == {"procedure", "title", "stand", "time", "streams"}
    assert set(plan["streams"]) == {"gyro"}
    assert plan["time"] == {}
    if "gyro" in prefix:  # else the field may not look like a gyro's
        return
    sayable = topic.encode("utf-8", "surrogatepass").decode("utf-8", "replace") == topic
    if sayable and plan["streams"]["gyro"]["topic"]:
        assert plan["streams"]["gyro"]["topic"] == topic


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_a_quoted_name_is_read_back_the_same(name: str) -> None:
    assert tomllib.loads(f"a = {quoted(name)}")["a"] == name
    assert escaped(name).isprintable()


def test_every_recording_of_others_begins_a_plan(shared_data: Path, tmp_path: Path) -> None:
    for path in sorted([*shared_data.glob("csv/*.csv"), *shared_data.glob("turntable/*.csv")]):
        text = initial_plan(formats.inspect(path))
        plan = tomllib.loads(text)
        assert set(plan["streams"]["gyro"]["channels"]) == {"p", "q", "r"}
        if path.name == "fusion_sensor_data.csv":
            assert loads(tmp_path, text) == ""
        else:  # a unit or a clock is not stated
            assert "FILL IN" in text
            assert loads(tmp_path, text)
