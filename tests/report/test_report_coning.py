"""Which pictures a coning run has, and that they show what its tables hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bokeh.models.glyphs import Line, Scatter
from bokeh.models.renderers import GlyphRenderer
from report_tables import START, TREND, from_rows, make_tables, trend_row

from pipeline import contracts
from pipeline.report import coning
from pipeline.report.base import Section, record_clock
from pipeline.report.series import Series
from pipeline.report.trend_lines import trend_lines

ALL = [
    "Angular rates",
    "Angles",
    "Trend of γ",
    "γ at the two ends of the record",
    "Errors against the reference",
    "Samples and interpolation",
    "Spectrum of the rates",
]


def drawn(section: Section, glyph: type) -> list[tuple[np.ndarray, np.ndarray]]:
    """Curves in the order in which they were drawn."""
    renderers = sorted(section.picture.select({"type": GlyphRenderer}), key=lambda r: int(r.id[1:]))
    found = [r.data_source.data for r in renderers if isinstance(r.glyph, glyph)]
    return [(np.asarray(data["x"]), np.asarray(data["y"])) for data in found]


def section(tables: dict[str, pa.Table], title: str) -> Section:
    return next(s for s in coning.figures(tables) if s.title == title)


def test_a_whole_run_has_all_pictures() -> None:
    assert [s.title for s in coning.figures(make_tables())] == ALL


@pytest.mark.parametrize(
    ("missing", "gone"),
    [
        (["reference"], ["Errors against the reference"]),
        (["trend", "attitude_corrected"], ["Trend of γ", "γ at the two ends of the record"]),
        (["gyro"], ["Samples and interpolation"]),
        (["attitude", "attitude_corrected", "trend"], ALL[1:5]),
        (["gyro", "rates", "attitude", "attitude_corrected", "trend", "reference"], ALL),
    ],
)
def test_what_a_run_did_not_make_is_left_out(missing: list[str], gone: list[str]) -> None:
    tables = {name: table for name, table in make_tables().items() if name not in missing}
    assert [s.title for s in coning.figures(tables)] == [title for title in ALL if title not in gone]


@pytest.mark.parametrize("name", ["gyro", "rates", "reference", "trend", "findings", "attitude_corrected"])
def test_an_empty_table_is_no_fault(name: str) -> None:
    tables = make_tables()
    assert coning.figures({**tables, name: tables[name].slice(0, 0)})


def test_the_errors_drawn_are_those_of_the_tables() -> None:
    curves = drawn(section(make_tables(), "Errors against the reference"), Line)
    (time, before), (_, after) = curves[-2:]  # of gamma
    # the error before is the trend; 1e-9 arcmin are roundings of it
    np.testing.assert_allclose(before, np.degrees(TREND * time) * 60, atol=1e-9)
    assert np.abs(after).max() == 0.0


def test_the_trend_is_drawn_through_the_extremes_of_the_angle() -> None:
    picture = section(make_tables(), "Trend of γ")
    (ends, line) = drawn(picture, Line)[-1]
    np.testing.assert_allclose(line, np.degrees(TREND * ends) * 60, atol=1e-9)  # roundings of arcmin
    ((times, _),) = drawn(picture, Scatter)
    # gamma is greatest at 3/8 of a vibration period; the trend takes the first and the last such sample
    assert times[0] < 0.01
    assert 0.25 <= times[1] < 0.26
    assert times[2] > 0.49


def test_a_trend_with_an_onset_stands_on_the_smooth_motion() -> None:
    tables = make_tables()
    onset = trend_row(onset=START + 200_000_000, origin=START + 200_000_000, smooth_a=-0.05, smooth_b=0.5)
    tables["trend"] = from_rows("trend", [onset])
    clock = record_clock(tables)
    assert clock is not None
    attitude = Series(clock.seconds(tables["attitude"]["time"].to_numpy()), {}, 1e-4)
    (line,) = trend_lines(tables, attitude, clock)["gamma"]
    assert (line.start, line.end, line.onset) == (0.2, 0.5, 0.2)
    time = np.array([0.2, 0.5])
    # 1e-15: a rounding of numbers below 1
    np.testing.assert_allclose(line.smooth(time), 0.5 - 0.05 * time, atol=1e-15)
    np.testing.assert_allclose(line.total(time), 0.5 - 0.05 * time + TREND * (time - 0.2), atol=1e-15)
    picture = section(tables, "Trend of γ")
    assert "from the onset of the vibration at 0.2 s on" in picture.text


def test_every_segment_has_its_own_trend_and_nothing_is_drawn_between_them() -> None:
    tables = make_tables()
    for name in ("attitude", "attitude_corrected", "rates"):
        columns: dict[str, Any] = {c: tables[name][c].to_numpy() for c in tables[name].column_names}
        seconds = (columns["time"] - START) * 1e-9
        kept = (seconds <= 0.2) | (seconds >= 0.25)
        columns["segment"] = (seconds > 0.22).astype(np.int32)
        tables[name] = contracts.table(name, {c: v[kept] for c, v in columns.items()})
    tables["trend"] = from_rows("trend", [trend_row(), trend_row(segment=1)])
    picture = section(tables, "Trend of γ")
    assert picture.text == (
        "γ drifts by −0.0135 rad/s (standard error 0.000050) between 0 s and 0.2 s, method extremes; "
        "by −0.0135 rad/s (standard error 0.000050) between 0.25 s and 0.5 s, method extremes."
    )
    whole = drawn(picture, Line)[1]
    inside = (whole[0] > 0.2001) & (whole[0] < 0.2499)
    assert not inside.any()
    assert np.isnan(whole[1]).sum() == 1


def test_a_recording_of_one_sample_has_no_picture() -> None:
    tables = {name: table.slice(0, 1) for name, table in make_tables().items()}
    assert coning.figures(tables) == []
