"""Which pictures a rate-table run has, and that they show what its tables hold."""

from __future__ import annotations

import re
from functools import cache
from html import unescape
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bokeh.models import GridPlot
from bokeh.models.glyphs import Line, Patch, Scatter, Segment, VStrip
from bokeh.models.renderers import GlyphRenderer
from rate_table_tables import (
    BIAS,
    CHANNELS,
    DEG,
    FULL_SCALE,
    LENGTH,
    RATES,
    S_ERROR,
    STEP_ERROR,
    TEMPERATURE,
    S,
    bent,
    ends,
    gyro,
    make_rate_table_tables,
    make_turn_tables,
    mounting,
)
from report_tables import HOSTILE, from_rows

from pipeline.report import (
    page,
    rate_table,
    rate_table_axes,
    rate_table_parameters,
    rate_table_record,
    rate_table_residuals,
    rate_table_runs,
)
from pipeline.report.base import FIGURES, Section

ALL = [
    "The record",
    "Calibration residuals",
    "Residuals in time",
    "Residuals against temperature",
    "Calibration",
    "Input axes",
]
MAKERS = (
    rate_table_record.record,
    rate_table_residuals.by_rate,
    rate_table_residuals.in_time,
    rate_table_residuals.by_temperature,
    rate_table_parameters.calibration,
    rate_table_axes.axes,
)
PPM = 1e6 / FULL_SCALE
"""A residual of a gyro whose scale factor is 1 to parts per million of full scale."""


@cache
def _tables(runs: str, triad: bool) -> dict[str, pa.Table]:
    return make_rate_table_tables(runs, triad=triad)


@pytest.fixture
def tables() -> dict[str, pa.Table]:
    """A triad, by runs about each of its axes."""
    return dict(_tables("pqr", triad=True))


@pytest.fixture
def one_run() -> dict[str, pa.Table]:
    """The same with one run."""
    return dict(_tables("p", triad=True))


@pytest.fixture
def single() -> dict[str, pa.Table]:
    """The gyro p by its own axis."""
    return dict(_tables("p", triad=False))


def section(tables: dict[str, pa.Table], title: str) -> Section:
    made = MAKERS[ALL.index(title)](tables)
    assert made is not None
    assert made.title == title
    return made


def rows_of_panels(section: Section) -> list[list[Any]]:
    assert section.picture is not None
    (grid,) = section.picture.select({"type": GridPlot})
    height = 1 + max(child[1] for child in grid.children)
    return [[child[0] for child in grid.children if child[1] == row] for row in range(height)]


def drawn(panel: Any, glyph: type) -> list[GlyphRenderer]:
    return [r for r in panel.renderers if isinstance(r.glyph, glyph)]


def legend(section: Section) -> list[str]:
    assert section.picture is not None
    return [item.label.value for item in section.picture.children[0].legend[0].items]


def points(panel: Any) -> dict[str, np.ndarray]:
    """All points of a panel in the order of x, with their bars and shapes."""
    found = [r.data_source.data for r in drawn(panel, Scatter)]
    joined = {k: np.concatenate([np.asarray(d[k]) for d in found]) for k in ("x", "y", "low", "high")}
    shapes = [np.asarray(d["shape"]) for d in found if "shape" in d]
    order = np.argsort(joined["x"], kind="stable")
    return {k: v[order] for k, v in joined.items()} | (
        {"shape": np.concatenate(shapes)[order]} if shapes else {}
    )


def residuals(tables: dict[str, pa.Table], **wanted: Any) -> list[dict[str, Any]]:
    rows = tables["calibration_residuals"].to_pylist()
    return [r for r in rows if all(r[k] == v for k, v in wanted.items())]


def cells(html: str) -> list[list[str]]:
    """The texts of tables, row by row."""
    rows = re.findall(r"<tr>(.*?)</tr>", html)
    return [
        [unescape(re.sub(r"<.*?>", "", cell)) for cell in re.findall(r"<t[dh].*?</t[dh]>", row)]
        for row in rows
    ]


# ------------------------------------------------------------------------------------------ which pictures


def test_the_procedure_has_its_figures(tables: dict[str, pa.Table]) -> None:
    assert FIGURES["rate_table"] == rate_table.__name__
    assert [s.title for s in rate_table.figures(tables)] == ALL
    written = page.render("run-7", tables)
    assert all(f"<h2>{title}</h2>" in written for title in ALL)


@pytest.mark.parametrize(
    ("missing", "gone"),
    [
        ("gyro", ["The record"]),
        ("turntable", []),
        ("rate_steps", []),
        ("calibration", ["Calibration", "Input axes"]),
        ("calibration_covariance", []),
        ("calibration_residuals", ["Calibration residuals", *ALL[2:4]]),
        ("metrics", []),
    ],
)
def test_what_a_run_did_not_make_is_left_out(
    one_run: dict[str, pa.Table], missing: str, gone: list[str]
) -> None:
    empty = rate_table.figures({**one_run, missing: one_run[missing].slice(0, 0)})
    del one_run[missing]
    found = rate_table.figures(one_run)
    assert [s.title for s in found] == [title for title in ALL if title not in gone]
    assert [(s.title, s.text, s.below) for s in empty] == [(s.title, s.text, s.below) for s in found]


def test_a_recording_without_any_table_has_no_picture() -> None:
    assert rate_table.figures({}) == []


def test_turns_by_hand_need_neither_table_nor_runs() -> None:
    tables = make_turn_tables()
    found = {s.title: s for s in rate_table.figures(tables)}
    assert list(found) == ["The record", "Residuals in time", "Calibration"]
    assert "The gyros as recorded" in found["The record"].text
    assert "turns (blue) and rests (grey)" in found["The record"].text
    assert found["The record"].below == ""
    assert legend(found["Residuals in time"]) == ["rest", "turn"]
    assert "It cannot correct a later record" in found["Calibration"].text


# ---------------------------------------------------------------------------------------------- the record


def test_each_run_has_a_column_of_the_table_and_the_gyros(tables: dict[str, pa.Table]) -> None:
    rows = rows_of_panels(section(tables, "The record"))
    labels = [row[0].yaxis[0].axis_label.text for row in rows]
    assert labels == ["table [deg/s]", "p [deg/s]", "q [deg/s]", "r [deg/s]"]
    assert [panel.above[0].text.text for panel in rows[0]] == [
        f"run {i}: {axis} along the table's axis" for i, axis in enumerate("pqr")
    ]
    for run, axis in enumerate("pqr"):
        for row, channel in zip(rows[1:], CHANNELS, strict=True):
            (curve,) = drawn(row[run], Line)
            value = np.asarray(curve.data_source.data["y"])
            i, j = CHANNELS.index(channel), CHANNELS.index(axis)
            known = S[i, j] * RATES + BIAS[i]
            # 1e-9 deg/s: roundings of 100 deg/s
            assert np.nanmax(value) == pytest.approx(known.max() / DEG, abs=1e-9)
            assert np.nanmin(value) == pytest.approx(known.min() / DEG, abs=1e-9)


def test_the_rate_of_a_table_is_taken_from_its_angle(single: dict[str, pa.Table]) -> None:
    (panel, *_) = (row[0] for row in rows_of_panels(section(single, "The record")))
    (curve,) = drawn(panel, Line)
    x, y = (np.asarray(curve.data_source.data[k]) for k in "xy")
    # between the samples of which one is the last of a step, the other the first of the next
    away = np.abs((x + 0.125) % 20) > 0.5
    np.testing.assert_allclose(y[away], RATES[(x[away] // 20).astype(int)] / DEG, rtol=1e-9, atol=1e-9)


def test_the_steps_are_shaded(tables: dict[str, pa.Table]) -> None:
    for run, panel in enumerate(rows_of_panels(section(tables, "The record"))[0]):
        (strips,) = drawn(panel, VStrip)
        data = strips.data_source.data
        known = np.array([ends(run, step) for step in range(len(RATES))]) - ends(run, 0)[0] + 1
        # 1e-6 s: stamps of 1e-9 s as float64 seconds
        np.testing.assert_allclose(np.column_stack([data["start"], data["stop"]]), known, atol=1e-6)
        assert panel.x_range.end == pytest.approx(LENGTH - 0.25)


def test_the_time_offset_is_in_milliseconds(tables: dict[str, pa.Table]) -> None:
    told = cells(section(tables, "The record").below)
    names = [f"run {i}: {axis} along the table's axis" for i, axis in enumerate("pqr")]
    assert told[1:] == [[name, str(len(RATES)), "13.1000 ± 0.0060"] for name in names]
    unknown = {"value": None, "standard_error": None}
    rows = [r | unknown if r["name"] == "time_offset" else r for r in tables["metrics"].to_pylist()]
    tables["metrics"] = from_rows("metrics", rows)
    assert cells(section(tables, "The record").below)[1][-1] == "not estimated"


# ------------------------------------------------------------------------------------------- the residuals


def test_residuals_by_rate_have_bars_and_the_direction(single: dict[str, pa.Table]) -> None:
    shown = section(single, "Calibration residuals")
    assert legend(shown) == ["turning +", "turning −", "at rest", "model"]
    (upper,), (lower,) = rows_of_panels(shown)
    rows = sorted(residuals(single, fit="single axis"), key=lambda r: r["rate"])
    for panel, name in ((upper, "deviation"), (lower, "residual")):
        found = points(panel)
        # 1e-9: roundings of the factor to parts per million
        np.testing.assert_allclose(found["x"], [r["rate"] / DEG for r in rows], rtol=1e-9, atol=1e-9)
        scale = PPM / S[0, 0]
        # 1e-6 ppm: differences of outputs of 1e6 of them
        np.testing.assert_allclose(found["y"], [r[name] * scale for r in rows], atol=1e-6)
        np.testing.assert_allclose((found["high"] - found["low"]) / 2, STEP_ERROR * scale, rtol=1e-9)
        assert len(drawn(panel, Segment)) == len(drawn(panel, Scatter)) == 3
    # up the staircase, then down; the first step has none before it
    assert (
        sorted(points(lower)["shape"].tolist()) == ["circle"] + ["inverted_triangle"] * 4 + ["triangle"] * 4
    )


def test_the_model_is_drawn_through_the_deviations(single: dict[str, pa.Table]) -> None:
    (upper,), _ = rows_of_panels(section(single, "Calibration residuals"))
    (curve,) = drawn(upper, Line)
    x, y = (np.asarray(curve.data_source.data[k]) for k in "xy")
    rows = residuals(single, fit="single axis")
    line = np.polyfit([r["rate"] for r in rows], [r["output"] - r["deviation"] for r in rows], 1)
    expected = (bent(x * DEG, 0) - np.polyval(line, x * DEG)) * PPM / S[0, 0]
    np.testing.assert_allclose(y, expected, atol=1e-6)  # ppm: differences of outputs of 1e6 of them


@pytest.mark.parametrize("straight", [False, True])
def test_what_the_temperature_does_is_not_taken_for_hysteresis(
    single: dict[str, pa.Table], straight: bool
) -> None:
    """It is in the deviation, and in no residual."""
    if straight:
        told = single["calibration"].to_pylist()
        bias = next(row for row in told if row["parameter"] == "bias" and row["gyro"])
        kept = [row for row in told if "asymm" not in row["parameter"] and "linear" not in row["parameter"]]
        thermal = bias | {"parameter": "bias_temperature_sensitivity", "value": 1e-4, "unit": "rad/s/K"}
        single["calibration"] = from_rows("calibration", [*kept, thermal])
    before = points(rows_of_panels(section(single, "Calibration residuals"))[0][0])
    rows = residuals(single)
    warm = [1e-4 * (r["temperature"] - TEMPERATURE) for r in rows]
    moved = [
        r | {"output": r["output"] + w, "deviation": r["deviation"] + w}
        for r, w in zip(rows, warm, strict=True)
    ]
    single["calibration_residuals"] = from_rows("calibration_residuals", moved)
    after = points(rows_of_panels(section(single, "Calibration residuals"))[0][0])
    np.testing.assert_allclose(after["y"], before["y"], atol=1e-6)  # ppm, as above


def test_a_straight_model_has_no_curve(single: dict[str, pa.Table]) -> None:
    rows = [r for r in single["calibration"].to_pylist() if "asymm" not in r["parameter"]]
    single["calibration"] = from_rows("calibration", [r for r in rows if "linear" not in r["parameter"]])
    assert "model" not in legend(section(single, "Calibration residuals"))


def test_residuals_in_time_are_of_the_triad_and_told_apart_by_run(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Residuals in time")
    assert legend(shown) == ["run p", "run q", "run r"]
    assert "the triad" in shown.text
    for (panel,), channel in zip(rows_of_panels(shown), CHANNELS, strict=True):
        assert panel.yaxis[0].axis_label.text == f"{channel} [ppm]"
        rows = residuals(tables, fit="triad", channel=channel)
        np.testing.assert_allclose(points(panel)["y"], [r["residual_ppm"] for r in rows], rtol=1e-12)
        middles = [sum(ends(k // len(RATES), k % len(RATES))) / 2 for k in range(len(rows))]
        # minutes from the first observation, which begins a second after the record
        np.testing.assert_allclose(points(panel)["x"], (np.array(middles) - 1) / 60, atol=1e-6)


def test_one_run_needs_no_legend(single: dict[str, pa.Table]) -> None:
    shown = section(single, "Residuals in time")
    assert "each gyro by its own axis" in shown.text
    assert isinstance(shown.picture, GridPlot)


def test_a_temperature_that_varies_has_a_picture(tables: dict[str, pa.Table]) -> None:
    (row,) = rows_of_panels(section(tables, "Residuals against temperature"))
    assert [panel.above[0].text.text for panel in row] == list(CHANNELS)
    assert np.unique(points(row[0])["x"]).tolist() == pytest.approx(
        (TEMPERATURE - 273.15 + np.arange(len(RATES))).tolist()
    )
    for temperature in (TEMPERATURE, None):
        rows = [r | {"temperature": temperature} for r in residuals(tables)]
        tables["calibration_residuals"] = from_rows("calibration_residuals", rows)
        assert rate_table_residuals.by_temperature(tables) is None


# ---------------------------------------------------------------------------------- calibration and axes


def test_the_calibration_is_a_table_with_errors(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Calibration")
    told = {row[0]: row[1:] for row in cells(shown.below)}
    assert told["the triad"] == ["unit", "p", "q", "r"]
    assert told["its error against 1"][:2] == ["ppm", "1000.0 ± 5.0"]
    assert told["asymmetry"] == ["ppm", *["120.0 ± 5.0"] * 3]
    assert told["nonlinearity of order 3"][1] == "−40.0 ± 5.0"
    assert told["p"][:2] == ["1.0010000 ± 0.0000050", "0.0010000 ± 0.0000050"]
    assert "the triad's matrix and biases" in shown.text
    assert "Pale" not in shown.text


def test_a_run_that_is_called_as_its_axis_is_named_once() -> None:
    over = mounting(1, "-q", "q") | {"axis_2": -1.0}
    of = {"mountings": from_rows("mountings", [over]), "gyro": gyro(1, "q")}
    assert [run.title for run in rate_table_runs.runs(of)] == ["run 1: −q along the table's axis"]


def test_what_is_not_determined_is_said_and_pale(tables: dict[str, pa.Table]) -> None:
    states = {"S12": ("combined", 0.001), "S13": ("undetermined", None)}
    rows = []
    for row in tables["calibration"].to_pylist():
        state, value = states.get(row["parameter"], (row["state"], row["value"]))
        error = None if value is None else row["standard_error"]
        rows.append(row | {"state": state, "value": value, "standard_error": error})
    tables["calibration"] = from_rows("calibration", rows)
    shown = section(tables, "Calibration")
    assert "Pale" in shown.text
    assert "It cannot correct a later record" in shown.text
    weak = [row | {"state": "combined"} for row in rows if row["value"] is not None]
    tables["calibration"] = from_rows("calibration", weak)
    assert "What may correct a later record" in section(tables, "Calibration").text
    assert '<span class="pale">0.0010000 ± 0.0000050</span>' in shown.below
    assert '<span class="pale">not determined</span>' in shown.below


def test_the_reference_temperature_is_in_celsius(tables: dict[str, pa.Table]) -> None:
    rows = [r | {"reference_temperature": TEMPERATURE} for r in tables["calibration"].to_pylist()]
    tables["calibration"] = from_rows("calibration", rows)
    assert "hold at 20 °C" in section(tables, "Calibration").text


def test_the_tips_of_the_input_axes_have_their_ellipses(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Input axes")
    (row,) = rows_of_panels(shown)
    arcmin = DEG / 60
    for i, panel in enumerate(row):
        assert panel.xaxis[0].axis_label.text.endswith("[arcmin]")
        n = np.delete(S[i] / np.linalg.norm(S[i]), i)
        (ellipse,) = drawn(panel, Patch)
        data = np.array([ellipse.data_source.data[k] for k in "xy"]) * arcmin - n[:, np.newaxis]
        K = np.linalg.norm(S[i])
        C = np.eye(2) + (0.5 * (1 - np.eye(2)) if i == 0 else 0.0)
        distance = np.einsum("in,ij,jn->n", data, np.linalg.inv(C * (S_ERROR / K) ** 2), data)
        np.testing.assert_allclose(distance, 4.0, rtol=1e-6)  # two standard errors; a difference of angles
    told = {row[0]: row[1] for row in cells(shown.below)}
    assert told["p towards q"] == "3.434 ± 0.017"
    assert told["p and r"].startswith("−6.8")


def test_the_scale_of_the_tips_is_one_and_holds_them(tables: dict[str, pa.Table]) -> None:
    (row,) = rows_of_panels(section(tables, "Input axes"))
    corners = [drawn(panel, Scatter)[0].data_source.data["x"] for panel in row]
    assert all(list(corner) == list(corners[0]) for corner in corners)
    assert all(panel.match_aspect for panel in row)


# ------------------------------------------------------------------------------------------ texts, and size


def test_texts_of_a_recording_do_no_harm() -> None:
    written = page.render("run-7", make_rate_table_tables("pq", HOSTILE))
    body = re.sub(r"<script.*?</script>", "", written, flags=re.DOTALL)
    assert "<img" not in body
    assert "window.hacked" in body  # it is there, as text


def test_the_page_of_a_long_record_is_small(single: dict[str, pa.Table]) -> None:
    """An hour at 100 Hz: the curves are thinned to their panels."""
    long = single["gyro"].to_pandas()
    repeated = pa.concat_tables([single["gyro"]] * (360_000 // len(long)))
    time = single["gyro"]["time"][0].as_py() + np.arange(repeated.num_rows) * 10**7
    place = repeated.column_names.index("time")
    single["gyro"] = repeated.set_column(place, repeated.schema.field("time"), pa.array(time))
    assert len(page.render("run-7", single).encode()) < 2e6  # of which Bokeh is 1.27 MB
