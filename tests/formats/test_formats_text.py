"""Text recordings: layouts found out, exact times, damage said, and the way back."""

from __future__ import annotations

import gzip
import math
from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import zstandard
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.errors import ExitCode
from pipeline.formats import text, text_bytes
from pipeline.formats.base import RecordingError, Request, Series, TextLayout, TimeField
from pipeline.formats.text_layout import find_layout

SHARED = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
FOUND_OUT = TextLayout()

REAL = [
    # file, rows, columns of numbers, one of them with its unit
    ("csv/bennyjhui_Gyroscope.csv", 1038, 5, ("x", None)),
    ("csv/broad_02_slow_rotation_B.csv", 53240, 9, ("gx_rads", None)),
    ("csv/fusion_sensor_data.csv", 13514, 10, ("Gyroscope X (deg/s)", "deg/s")),
    ("csv/gtsam_quadruped_rostopic_echo.csv", 2635, 40, ("field.angular_velocity.x", None)),
    ("csv/px4_sample_log_small_sensor_combined_0.csv", 1298, 11, ("gyro_rad[0]", None)),
    ("csv/sk_xio_00033_CalInertialAndMag.csv", 12626, 10, ("Gyroscope X (deg/s)", "deg/s")),
    ("turntable/imucal_annotated_session.csv", 9414, 7, ("gyr_x", None)),
    ("turntable/imucal_ferraris_session.csv", 10376, 7, ("gyr_x", None)),
    ("turntable/tomi_mpu6050_90deg_x_rot.csv", 9987, 6, ("gx", None)),
    ("turntable/tomi_mpu6050_multipose.csv", 10245, 6, ("gx", None)),
    ("turntable/tomi_mpu6050_static_test.csv", 9986, 6, ("gx", None)),
    ("turntable/tomi_mpu6050_tinit_static.csv", 44930, 6, ("gx", None)),
]


def shared(name: str) -> Path:
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"{name} is not beside this checkout")
    return path


def recording(folder: Path, content: str | bytes, name: str = "run.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def columns(path: Path, *fields: str, layout: TextLayout = FOUND_OUT) -> dict[str, list[float]]:
    table = text.read(path, [Request("", fields)], layout).tables[""]
    assert all(table.schema.field(field).type == pa.float64() for field in fields)
    return {field: table[field].to_pylist() for field in fields}


def losses(path: Path, *fields: str, layout: TextLayout = FOUND_OUT) -> list[tuple[str, int, str]]:
    found = text.read(path, [Request("", fields)], layout).losses
    return [(loss.unit, loss.count, loss.detail) for loss in found]


def times(path: Path, column: str, unit: str) -> list[int | None]:
    table = text.read(path, [Request("", (), (TimeField(column, unit),))], FOUND_OUT).tables[""]
    assert table.schema.field(column).type == pa.int64()
    found: list[int | None] = table[column].to_pylist()
    return found


class TestRealFiles:
    @pytest.mark.parametrize(("name", "rows", "width", "field"), REAL)
    def test_is_inspected_and_read(self, name: str, rows: int, width: int, field: tuple[str, str]) -> None:
        path = shared(name)
        assert text.recognises(path)
        found = text.inspect(path, FOUND_OUT)
        (topic,) = found.topics
        assert (topic.name, topic.count, len(topic.fields), found.losses) == ("", rows, width, ())
        assert field in [(f.path, f.unit) for f in topic.fields]
        samples = text.read(path, [Request("", tuple(f.path for f in topic.fields))], FOUND_OUT)
        assert (samples.tables[""].num_rows, samples.losses) == (rows, ())

    def test_optical_quaternion_has_its_nan_rows(self) -> None:
        table = text.read(
            shared("csv/broad_02_slow_rotation_B.csv"),
            [Request("", ("gx_rads",), (TimeField("t_s", "s"),)), Request("", ("qw", "qz"))],
            FOUND_OUT,
        ).tables[""]
        assert int(np.isnan(table["qw"].to_numpy()).sum()) == 1706  # manifest.tsv
        assert table["qw"].null_count == 0
        assert table["t_s"][:3].to_pylist() == [0, 3_500_000, 7_000_000]

    def test_phone_log_has_its_columns_the_other_way_round(self) -> None:
        table = text.read(
            shared("csv/bennyjhui_Gyroscope.csv"),
            [Request("", ("x", "z"), (TimeField("time", "ns"), TimeField("seconds_elapsed", "s")))],
            FOUND_OUT,
        ).tables[""]
        assert table["x"][0].as_py() == -0.539340615272522
        assert table["z"][0].as_py() == -0.839608907699585
        assert table["time"][0].as_py() == 1760565906248623000
        assert table["seconds_elapsed"][0].as_py() == 103_623_047  # 0.103623046875 s

    def test_header_in_a_comment_line_and_stamps_that_no_float_holds(self) -> None:
        path = shared("csv/gtsam_quadruped_rostopic_echo.csv")
        stamps, logged = times(path, "field.header.stamp", "ns"), times(path, "time", "ns")
        assert str(stamps[1]) in path.read_text().splitlines()[2].split(",")
        assert int(np.sum(np.diff(np.array(logged)) == 0)) == 248  # manifest.tsv: 248 repeats
        assert set(np.diff(np.array(stamps)) > 0) == {True}

    def test_preamble_is_passed_over(self) -> None:
        path = shared("turntable/tomi_mpu6050_90deg_x_rot.csv")
        assert columns(path, "gx", "gz") == {
            name: [float(line.split(",")[place]) for line in path.read_text().splitlines()[5:]]
            for name, place in (("gx", 3), ("gz", 5))
        }

    def test_packet_numbers_that_skip(self) -> None:
        (numbers,) = columns(shared("csv/sk_xio_00033_CalInertialAndMag.csv"), "Packet number").values()
        assert set(np.diff(np.array(numbers))) == {1.0, 2.0, 3.0}  # manifest.tsv

    def test_column_of_words_is_no_field(self) -> None:
        found = text.inspect(shared("turntable/imucal_annotated_session.csv"), FOUND_OUT)
        assert "part" not in [field.path for field in found.topics[0].fields]

    @pytest.mark.parametrize("name", ["bags/plotjuggler_tilt_laser.bag", "mcap/mbp_controlled_data_0.mcap"])
    def test_other_containers_are_not_recognised(self, name: str) -> None:
        assert not text.recognises(shared(name))


class TestLayout:
    @pytest.mark.parametrize(
        ("content", "delimiter", "decimal"),
        [
            ("t,x\n0.1,1.5\n0.2,-2.5\n", ",", "."),
            ("t;x\n0.1;1.5\n0.2;-2.5\n", ";", "."),
            ("t;x\n0,1;1,5\n0,2;-2,5\n", ";", ","),
            ("t\tx\n0.1\t1.5\n0.2\t-2.5\n", "\t", "."),
            ("t\tx\n0,1\t1,5\n0,2\t-2,5\n", "\t", ","),
            ("t|x\n0.1|1.5\n0.2|-2.5\n", "|", "."),
            ("  t    x\n  0.1  1.5\n  0.2 -2.5\n", "whitespace", "."),
            ("t x\n0,1 1,5\n0,2  -2,5 \n", "whitespace", ","),
            ("t, x\n0.1, 1.5\n0.2, -2.5\n", ",", "."),
        ],
    )
    def test_delimiter_and_decimal_mark(
        self, tmp_path: Path, content: str, delimiter: str, decimal: str
    ) -> None:
        layout = find_layout(content.encode(), FOUND_OUT, "run")
        assert (layout.delimiter, layout.decimal) == (delimiter, decimal)
        assert columns(recording(tmp_path, content), "t", "x") == {"t": [0.1, 0.2], "x": [1.5, -2.5]}

    def test_decimal_mark_that_shows_late(self, tmp_path: Path) -> None:
        """Whole numbers for longer than the head, then a decimal comma."""
        path = recording(tmp_path, "t;x\n" + "1;2\n" * 2000 + "1,5;2,25\n")
        assert columns(path, "t", "x")["x"][-1] == 2.25
        assert losses(path, "t", "x") == []

    @pytest.mark.parametrize(
        ("content", "key"),
        [
            ("0,5,1,25\n0,6,1,26\n", "delimiter and decimal"),  # 0.5 and 1.25, or four whole numbers?
            ("a,b\n0,5,1,25\n0,6,1,26\n", "delimiter and decimal"),
            ("a;b\n1,234;2,345\n1,235;2,346\n", "decimal"),  # 1.234, or one thousand two hundred …?
        ],
    )
    def test_ambiguous_commas_are_refused(self, tmp_path: Path, content: str, key: str) -> None:
        with pytest.raises(RecordingError, match=key) as error:
            text.inspect(recording(tmp_path, content), FOUND_OUT)
        assert error.value.exit_code == ExitCode.INPUT

    def test_ambiguous_commas_are_read_as_stated(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "a;b\n1,234;2,345\n1,235;2,346\n")
        assert columns(path, "a", layout=TextLayout(decimal=","))["a"] == [1.234, 1.235]
        path = recording(tmp_path, "0,5,1,25\n0,6,1,26\n")
        assert columns(path, "column_4", layout=TextLayout(delimiter=","))["column_4"] == [25, 26]

    def test_preamble_comments_units_row_and_blank_lines(self, tmp_path: Path) -> None:
        content = (
            "Fs,100\nOperator,Jane\n\n# made by hand\nRange,250,deg/s\n"
            "time,gyro x,temperature\n[s],[deg/s],[°C]\n// a remark\n0,1.5,20\n# another\n\n0.01,2.5,21\n"
        )
        path = recording(tmp_path, content)
        found = text.inspect(path, FOUND_OUT)
        assert [(f.path, f.unit) for f in found.topics[0].fields] == [
            ("time", "s"),
            ("gyro x", "deg/s"),
            ("temperature", "°C"),
        ]
        assert columns(path, "gyro x")["gyro x"] == [1.5, 2.5]
        assert found.losses == ()

    def test_units_row_without_brackets(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t\tp\tn\ns\trad/s\t1\n0.5\t1.5\t7\n0.6\t1.6\t8\n")
        assert [f.unit for f in text.inspect(path, FOUND_OUT).topics[0].fields] == ["s", "rad/s", "1"]

    @pytest.mark.parametrize(
        ("name", "unit"),
        [
            ("Gyroscope X (deg/s)", "deg/s"),
            ("gyro_x [rad/s]", "rad/s"),
            ("rate[°/s]", "°/s"),
            ("gyro_rad[0]", None),
            ("t_s", None),
        ],
    )
    def test_unit_in_the_header(self, tmp_path: Path, name: str, unit: str | None) -> None:
        path = recording(tmp_path, f'n,"{name}"\n1,2.5\n2,3.5\n')
        assert text.inspect(path, FOUND_OUT).topics[0].fields[1].unit == unit
        assert columns(path, name)[name] == [2.5, 3.5]

    def test_name_without_its_unit_serves_where_unique(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t (s),x (deg/s),x (rad/s)\n1,2,3\n2,3,4.5\n")
        assert columns(path, "t") == {"t": [1, 2]}
        with pytest.raises(RecordingError, match="with its unit") as error:
            columns(path, "x")
        assert error.value.exit_code == ExitCode.USAGE

    def test_units_in_brackets_between_blanks(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t (s) x (deg/s)\n0.1 1.5\n0.2 2.5\n")
        assert columns(path, "x (deg/s)") == {"x (deg/s)": [1.5, 2.5]}

    def test_equal_and_empty_names(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "x,x,,x\n1,2,3,4\n5,6,7,8.5\n")
        names = [field.path for field in text.inspect(path, FOUND_OUT).topics[0].fields]
        assert names == ["x", "x.1", "column_3", "x.2"]

    def test_no_header(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "0.1,1.5\n0.2,2.5\n")
        assert columns(path, "column_2") == {"column_2": [1.5, 2.5]}
        assert columns(path, "p", layout=TextLayout(columns=("t", "p"))) == {"p": [1.5, 2.5]}
        with pytest.raises(RecordingError, match="3 columns"):
            columns(path, "p", layout=TextLayout(columns=("t", "p", "q")))
        with pytest.raises(RecordingError, match="header"):
            columns(path, "p", layout=TextLayout(header=True))

    def test_as_stated(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "junk~1\n1~2\nt~x\n! no\n3~4\n5~6\n")
        layout = TextLayout(delimiter="~", skip_lines=2, comment="!")
        assert columns(path, "x", layout=layout) == {"x": [4, 6]}

    @pytest.mark.parametrize(
        "layout",
        [TextLayout(delimiter=", "), TextLayout(delimiter="§"), TextLayout(delimiter=",", decimal=",")],
    )
    def test_impossible_layout_is_an_error_of_the_plan(self, tmp_path: Path, layout: TextLayout) -> None:
        with pytest.raises(RecordingError) as error:
            text.inspect(recording(tmp_path, "1,2\n"), layout)
        assert error.value.exit_code == ExitCode.USAGE

    def test_delimiter_at_the_end_of_every_row(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x\n0.1,1.5,\n0.2,2.5,\n")
        assert columns(path, "t", "x") == {"t": [0.1, 0.2], "x": [1.5, 2.5]}

    def test_row_names_do_not_shift_the_header(self, tmp_path: Path) -> None:
        """A header one name short says nothing of which column lacks it."""
        path = recording(tmp_path, "t,x\n1,0.1,1.5\n2,0.2,2.5\n")
        assert [f.path for f in text.inspect(path, FOUND_OUT).topics[0].fields] == [
            "column_1",
            "column_2",
            "column_3",
        ]

    @pytest.mark.parametrize(
        "content", ["", "\n\n", "# only\n# comments\n", "some words\nand more words\n", "a,b\n"]
    )
    def test_no_numbers_is_unreadable_input(self, tmp_path: Path, content: str) -> None:
        with pytest.raises(RecordingError, match="rows of numbers") as error:
            text.inspect(recording(tmp_path, content), FOUND_OUT)
        assert error.value.exit_code == ExitCode.INPUT
        assert "\n" not in str(error.value)

    def test_lines_of_which_none_is_a_row_are_unreadable_input(self, tmp_path: Path) -> None:
        """A quote within a cell leaves open where the cell ends, here in every line."""
        path = recording(tmp_path, 'f("t",p)\n1,2"x,3\n4,5"y,6\n')
        with pytest.raises(
            RecordingError, match="rows of 3 columns, as its first numbers suggest, found none"
        ):
            text.inspect(path, FOUND_OUT)


class TestEncoding:
    CONTENT = "t (s),ω (°/s)\n0.1,1.5\n0.2,2.5\n"

    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
    @pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
    def test_unicode(self, tmp_path: Path, encoding: str, ending: str) -> None:
        path = recording(tmp_path, self.CONTENT.replace("\n", ending).encode(encoding))
        assert text.recognises(path)
        assert columns(path, "t", "ω (°/s)") == {"t": [0.1, 0.2], "ω (°/s)": [1.5, 2.5]}
        assert losses(path, "t") == []

    def test_latin_1(self, tmp_path: Path) -> None:
        path = recording(tmp_path, self.CONTENT.replace("ω", "w").encode("latin-1"))
        assert columns(path, "w (°/s)") == {"w (°/s)": [1.5, 2.5]}

    def test_damaged_utf_8_stays_utf_8(self, tmp_path: Path) -> None:
        path = recording(tmp_path, self.CONTENT.encode() + b"0.3,\xff\xfe\n0.4,4.5\n")
        assert columns(path, "ω (°/s)") == {"ω (°/s)": [1.5, 2.5, None, 4.5]}
        assert [(unit, count) for unit, count, _ in losses(path, "ω (°/s)")] == [("cells", 1)]

    def test_binary_is_not_recognised(self, tmp_path: Path) -> None:
        path = recording(tmp_path, bytes(range(256)))
        assert not text.recognises(path)
        with pytest.raises(RecordingError, match="zero byte"):
            text.inspect(path, FOUND_OUT)
        assert not text.recognises(tmp_path)


class TestCells:
    def test_empty_is_null_and_nan_is_nan(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x,y\n1,,0.5\n2,nan,0.5\n3,NaN,\n4,NA,1e-3\n5, ,+2\n6,-inf,.5\n")
        found = columns(path, "x", "y")
        assert [value is None for value in found["x"]] == [True, False, False, True, True, False]
        assert math.isnan(found["x"][1])
        assert math.isnan(found["x"][2])
        assert found["x"][5] == -math.inf
        assert found["y"] == [0.5, 0.5, None, 1e-3, 2.0, 0.5]
        assert losses(path, "x", "y") == []

    def test_quoted_fields(self, tmp_path: Path) -> None:
        path = recording(tmp_path, '"t","note","x"\n"1","a, b","1.5"\n2,"say ""no""",2.5\n')
        assert columns(path, "t", "x") == {"t": [1, 2], "x": [1.5, 2.5]}
        assert losses(path, "t", "x") == []

    def test_garbled_lines_are_left_out_and_said(self, tmp_path: Path) -> None:
        rows = "5,5.5\n" * 300
        content = "t,x\n1,1.5\n2,2.5,9\n3\n4,4.5\n" + rows + "\0\0\0,\n" + rows
        path = recording(tmp_path, content)
        assert columns(path, "t", "x") == {"t": [1, 4] + [5] * 600, "x": [1.5, 4.5] + [5.5] * 600}
        ((unit, count, detail),) = losses(path, "t")
        assert (unit, count) == ("lines", 3)
        assert "line 3, 4, 306" in detail

    def test_garbled_cells_are_null_and_said(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x\n1,1.5\n2,2x5\n3,3.5\n4,?\n")
        assert columns(path, "t", "x") == {"t": [1, 2, 3, 4], "x": [1.5, None, 3.5, None]}
        ((unit, count, detail),) = losses(path, "t", "x")
        assert (unit, count) == ("cells", 2)
        assert "line 3, 5" in detail
        assert losses(path, "t") == []  # what is not asked for is not looked at

    def test_open_quote_swallows_nothing(self, tmp_path: Path) -> None:
        path = recording(tmp_path, 'x,note\n1,"a"\n2,"b\n3,"c\n4,"d"\n5,"e"\n')
        assert columns(path, "x") == {"x": [1, 4, 5]}
        assert [(unit, count) for unit, count, _ in losses(path, "x")] == [("lines", 2)]

    def test_characters_beside_a_quoted_cell_are_not_joined_to_it(self, tmp_path: Path) -> None:
        path = recording(tmp_path, 'x,y\n"1","1.5"\n"2","2"5\n""3,3.5\n"4","4.5"\n')
        assert columns(path, "x", "y") == {"x": [1, 4], "y": [1.5, 4.5]}
        assert [(unit, count) for unit, count, _ in losses(path, "x")] == [("lines", 2)]

    @given(
        st.lists(
            st.tuples(
                st.integers(0, 400),
                st.sampled_from(
                    [",", ";", "\n", '"', '""', "\0", "\r", "ÿ", "#", "nan", "1e999", " ", "9" * 40, "("]
                ),
            ),
            max_size=8,
        ),
        st.integers(20, 500),
    )
    def test_damage_never_goes_unsaid(
        self, tmp_path_factory: pytest.TempPathFactory, damage: list[tuple[int, str]], length: int
    ) -> None:
        """Whatever is put in or cut off: one clear error, or as many rows for a channel as for a time."""
        content = "t,x,y\n" + "".join(f"{k}.5,{k},0.25\n" for k in range(40))
        for place, characters in damage:
            content = content[:place] + characters + content[place:]
        path = recording(tmp_path_factory.getbasetemp(), content[:length])
        try:
            found = text.inspect(path, FOUND_OUT)
            names = [field.path for field in found.topics[0].fields]
            request = Request("", tuple(names[1:]), (TimeField(names[0], "s"),))
            samples = text.read(path, [request], FOUND_OUT)
        except RecordingError:
            return
        assert samples.tables[""].num_rows == found.topics[0].count

    def test_repeated_header_and_comments_are_no_loss(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x\n1,1.5\n#2,2.5\nt,x\n3,3.5\n")
        assert columns(path, "x") == {"x": [1.5, 3.5]}
        assert losses(path, "x") == []

    def test_cut_last_line(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x,y\n1,1.5,1\n2,2.5,2\n3,3")
        assert columns(path, "t") == {"t": [1, 2]}
        ((unit, count, detail),) = losses(path, "t")
        assert (unit, count) == ("lines", 1)
        assert "4" in detail
        whole = recording(tmp_path, "t,x\n1,1.5\n2,2.5")  # no newline at the end, but nothing is missing
        assert columns(whole, "t") == {"t": [1, 2]}
        assert losses(whole, "t") == []

    def test_first_row_garbled(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x,y\n1,1.5\n2,2.5,1\n3,3.5,2\n")
        assert columns(path, "t") == {"t": [2, 3]}
        assert [(unit, count) for unit, count, _ in losses(path, "t")] == [("lines", 1)]
        headless = recording(tmp_path, "1,1.5\n2,2.5,1\n3,3.5,2\n")
        assert [(unit, count) for unit, count, _ in losses(headless, "column_1")] == [("lines", 1)]


class TestPacked:
    ROWS = "t,x\n" + "".join(f"{k},{k / 7!r}\n" for k in range(20_000))

    @pytest.mark.parametrize("suffix", [".gz", ".zst"])
    def test_whole(self, tmp_path: Path, suffix: str) -> None:
        plain = recording(tmp_path, self.ROWS)
        path = tmp_path / f"run.csv{suffix}"
        text_bytes.save(path, self.ROWS.encode())
        assert text.recognises(path)
        assert columns(path, "t", "x") == columns(plain, "t", "x")
        assert losses(path, "t") == []

    @pytest.mark.parametrize("pack", [gzip.compress, zstandard.compress])
    def test_frames_in_a_row(self, tmp_path: Path, pack: object) -> None:
        assert callable(pack)
        path = recording(tmp_path, pack(b"t,x\n1,2\n") + pack(b"3,4\n"), "run.gz")
        assert columns(path, "x") == {"x": [2, 4]}
        assert losses(path, "x") == []

    @pytest.mark.parametrize("pack", [gzip.compress, zstandard.compress])
    @pytest.mark.parametrize("share", [0.5, 0.99])
    def test_cut(self, tmp_path: Path, pack: object, share: float) -> None:
        assert callable(pack)
        packed = pack(self.ROWS.encode())
        path = recording(tmp_path, packed[: int(len(packed) * share)], "run.csv.gz")
        ((unit, _, detail),) = losses(path, "x")
        assert unit == "bytes"
        assert "end early" in detail
        found = columns(path, "t", "x")
        assert len(found["t"]) > 100
        assert found["x"] == [k / 7 for k in range(len(found["t"]))]

    def test_wrong_checksum(self, tmp_path: Path) -> None:
        packed = bytearray(gzip.compress(b"t,x\n1,2\n3,4\n" * 1000))
        packed[-8] ^= 1
        assert losses(recording(tmp_path, bytes(packed), "run.gz"), "x")[0][0] == "bytes"

    def test_bomb_is_refused(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(text_bytes, "MAX_BYTES", 100_000)
        path = recording(tmp_path, zstandard.compress(b"1,2\n" * 1_000_000), "run.zst")
        with pytest.raises(RecordingError, match="100000 bytes"):
            text.inspect(path, FOUND_OUT)


NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


class TestTimes:
    @pytest.mark.parametrize(
        ("cell", "unit", "nanoseconds"),
        [
            ("0.103623046875", "s", 103_623_047),
            ("1760565906.248623123", "s", 1_760_565_906_248_623_123),
            ("1760565906248623123", "ns", 1_760_565_906_248_623_123),
            ("1760565906248623.123", "us", 1_760_565_906_248_623_123),
            ("1.760565906248623123e+09", "s", 1_760_565_906_248_623_123),
            ("-0.0000000015", "s", -2),
            ("0.0000000004999999999999", "s", 0),
            ("1.5", "h", 5_400_000_000_000),
            ("0.1", "msec", 100_000),
            ("+2", "min", 120_000_000_000),
            ("9223372036.854775806", "s", 9_223_372_036_854_775_806),
        ],
    )
    def test_exact(self, tmp_path: Path, cell: str, unit: str, nanoseconds: int) -> None:
        path = recording(tmp_path, f"t,x\n{cell},1\n{cell},2\n")
        assert times(path, "t", unit) == [nanoseconds, nanoseconds]

    @given(
        st.lists(st.decimals(min_value=-9_000_000, max_value=9_000_000, places=14), min_size=1, max_size=5),
        st.sampled_from(sorted(NANOSECONDS)),
    )
    @example([Decimal("0.00000000000000000000000000001"), Decimal("1E-7")], "s")
    def test_to_the_nearest_nanosecond(
        self, tmp_path_factory: pytest.TempPathFactory, cells: list[Decimal], unit: str
    ) -> None:
        path = recording(tmp_path_factory.mktemp("t"), "t,x\n" + "".join(f"{cell},1\n" for cell in cells))
        exact = [cell * NANOSECONDS[unit] for cell in cells]
        for found, truth in zip(times(path, "t", unit), exact, strict=True):
            assert found is not None
            assert abs(found - truth) <= Decimal("0.5")

    def test_decimal_comma(self, tmp_path: Path) -> None:
        assert times(recording(tmp_path, "t;x\n0,25;1,5\n0,5;1,5\n"), "t", "s") == [250_000_000, 500_000_000]

    def test_what_is_no_time_is_null_and_said(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x\n1,1\n,2\nnan,3\n1e30,4\n99999999999,5\n0.1234567890123456789012,6\n")
        assert times(path, "t", "s") == [10**9, None, None, None, None, 123_456_789]
        found = text.read(path, [Request("", ("x",), (TimeField("t", "s"),))], FOUND_OUT)
        assert [(loss.unit, loss.count) for loss in found.losses] == [("cells", 3)]

    def test_unknown_unit(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x\n1,1\n2,2\n")
        for wrong in (TimeField("t", "rad"), TimeField("t", "fortnight")):
            with pytest.raises(RecordingError, match="unit of time") as error:
                text.read(path, [Request("", ("x",), (wrong,))], FOUND_OUT)
            assert error.value.exit_code == ExitCode.USAGE

    def test_a_column_is_a_channel_or_a_time(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x\n1,1\n2,2\n")
        with pytest.raises(RecordingError, match="both"):
            text.read(path, [Request("", ("t",), (TimeField("t", "s"),))], FOUND_OUT)


class TestRequests:
    def test_topic_or_column_that_is_not_there(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "time,gyro_x\n1,1\n2,2\n")
        with pytest.raises(RecordingError, match="leave topic out") as error:
            text.read(path, [Request("/imu", ("gyro_x",))], FOUND_OUT)
        assert error.value.exit_code == ExitCode.USAGE
        with pytest.raises(RecordingError, match="did you mean 'gyro_x'") as error:
            columns(path, "gyro_X")
        assert error.value.exit_code == ExitCode.USAGE

    def test_column_of_words_is_no_channel(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "part,x\na,1\nb,2\n")
        with pytest.raises(RecordingError, match="column 'part': expected numbers, found words") as error:
            columns(path, "part")
        assert error.value.exit_code == ExitCode.USAGE

    def test_requests_make_one_table(self, tmp_path: Path) -> None:
        path = recording(tmp_path, "t,x,y\n1,2,3\n4,5,6\n")
        requests = [
            Request("", ("x",), (TimeField("t", "s"),)),
            Request("", ("y", "x"), (TimeField("t", "s"),)),
        ]
        assert text.read(path, requests, FOUND_OUT).tables[""].column_names == ["x", "y", "t"]


class TestWriter:
    @staticmethod
    def series(name: str, log: list[int], stamps: list[int], values: list[float]) -> Series:
        return Series(
            topic=f"/{name}",
            message_type="",
            log_time=np.array(log, dtype=np.int64),
            header_stamp=np.array(stamps, dtype=np.int64),
            columns={f"{name} (rad/s)": np.array(values)},
        )

    def test_rows_are_the_union_in_order_of_log_time(self, tmp_path: Path) -> None:
        path = tmp_path / "run.csv"
        p = self.series("p", [10, 20, 30, 30], [10, 5, 30, 30], [0.1, math.nan, 0.3, 0.4])
        q = self.series("q", [10, 15], [10, 15], [1 / 3, 1e-300])
        text.write(path, [p, q])
        assert path.read_text().splitlines() == [
            "time (s),p (rad/s),q (rad/s)",
            "0.000000010,0.1,0.3333333333333333",
            "0.000000015,,1e-300",
            "0.000000005,nan,",  # the stamp goes back
            "0.000000030,0.3,",
            "0.000000030,0.4,",  # a repeated sample has its own row
        ]
        first = path.read_bytes()
        text.write(path, [p, q])
        assert path.read_bytes() == first

    @pytest.mark.parametrize("name", ["run.csv", "run.tsv", "run.csv.gz", "run.csv.zst"])
    def test_what_is_written_is_read_back(self, tmp_path: Path, name: str) -> None:
        rng = np.random.default_rng(1)
        stamps = 1_767_225_600_000_000_000 + np.cumsum(rng.integers(1, 10**7, 500))
        values = rng.normal(size=500) * 10.0 ** rng.integers(-300, 300, 500)
        path = tmp_path / name
        text.write(path, [self.series("p", stamps.tolist(), stamps.tolist(), values.tolist())])
        table = text.read(path, [Request("", ("p",), (TimeField("time", "s"),))], FOUND_OUT).tables[""]
        np.testing.assert_array_equal(table["time"].to_numpy(), stamps)
        np.testing.assert_array_equal(table["p"].to_numpy(), values)
        assert text.inspect(path, FOUND_OUT).topics[0].fields[1].unit == "rad/s"

    @pytest.mark.parametrize("name", ["run.csv", "run.tsv"])
    def test_two_series_of_different_rates_are_read_back(self, tmp_path: Path, name: str) -> None:
        """Most cells of the slow series are empty: they must not be taken for runs of blanks."""
        fast = list(range(0, 10**9, 10**7))
        slow = fast[::10]
        path = tmp_path / name
        text.write(path, [
            self.series("p", fast, fast, [0.5] * len(fast)),
            self.series("q", slow, slow, [1.5] * len(slow)),
            self.series("r", slow, slow, [2.5] * len(slow)),
        ])  # fmt: skip
        table = text.read(path, [Request("", ("p", "q", "r"))], FOUND_OUT).tables[""]
        assert table["p"].to_pylist() == [0.5] * 100
        assert table["q"].to_pylist() == ([1.5] + [None] * 9) * 10
        assert table["r"].to_pylist() == ([2.5] + [None] * 9) * 10

    def test_equal_names_are_refused(self, tmp_path: Path) -> None:
        one = self.series("p", [1], [1], [1.0])
        with pytest.raises(RecordingError, match="name of its own"):
            text.write(tmp_path / "run.csv", [one, one])
