"""Which pictures a static run has, and that they show what its tables hold."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bokeh.models import GridPlot
from bokeh.models.annotations import BoxAnnotation, Label, Span
from bokeh.models.glyphs import Line, Scatter, Text, VArea
from bokeh.models.renderers import GlyphRenderer
from report_tables import HOSTILE, START, from_rows, metric, raw
from static_tables import (
    COEFFICIENTS,
    DEG,
    MODELS,
    ROOT,
    SIGMA,
    allan_model,
    make_static_tables,
    rate_of,
)

from pipeline.models.random_error_growth import growth, variance, worse_bands
from pipeline.report import page, static, static_allan, static_models, static_rotation
from pipeline.report.base import Section, record_clock
from pipeline.report.static_panels import log_span

ALL = [
    "Allan deviation",
    "Noise coefficients",
    "Spectrum",
    "Noise models",
    "What rotation does",
    "Growth of the angle error",
]
TABLES = ["allan", "noise_coefficients", "spectrum", "noise_model", "modulation", "growth"]
DEG_H = 3600 / DEG
DEG_ROOT_H = 60 / DEG


@cache
def _tables(channels: str) -> dict[str, pa.Table]:
    return make_static_tables(channels)


@pytest.fixture
def tables() -> dict[str, pa.Table]:
    return dict(_tables("pqr"))


@pytest.fixture
def single() -> dict[str, pa.Table]:
    """A sensor of one axis."""
    return dict(_tables("q"))


def section(tables: dict[str, pa.Table], title: str) -> Section:
    makers = (
        static_allan.deviations,
        static_allan.coefficients,
        static_models.spectrum,
        static_models.models,
        static_rotation.growth_by_rate,
        static_rotation.angle_error,
    )
    made = makers[ALL.index(title)](tables)
    assert made is not None
    assert made.title == title
    return made


def panels(section: Section) -> list[Any]:
    assert section.picture is not None
    (grid,) = section.picture.select({"type": GridPlot})
    return [child[0] for child in grid.children]


def legend(section: Section) -> dict[str, int]:
    """The names in the legend, and how many curves each shows and hides."""
    assert section.picture is not None
    items = section.picture.children[0].legend[0].items
    return {item.label.value: len(item.renderers) - 1 for item in items}  # one is the sample in the legend


def drawn(panel: Any, glyph: type) -> list[GlyphRenderer]:
    return [r for r in panel.renderers if isinstance(r.glyph, glyph)]


def curve(section: Section, panel: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """The curve of a panel that has a name in the legend."""
    assert section.picture is not None
    (item,) = [i for i in section.picture.children[0].legend[0].items if i.label.value == name]
    (found,) = [r for r in item.renderers if r in panel.renderers and isinstance(r.glyph, Line)]
    return np.asarray(found.data_source.data["x"]), np.asarray(found.data_source.data["y"])


def rows_of(tables: dict[str, pa.Table], name: str, **wanted: Any) -> list[dict[str, Any]]:
    return [r for r in tables[name].to_pylist() if all(r[k] == v for k, v in wanted.items())]


def text_of(panel: Any) -> list[str]:
    return [title.text.text for title in panel.above]


# ------------------------------------------------------------------------------------------ which pictures


def test_a_whole_run_has_all_sections(tables: dict[str, pa.Table]) -> None:
    assert [s.title for s in static.figures(tables)] == ALL


@pytest.mark.parametrize(("missing", "gone"), [*zip(TABLES, ALL, strict=True), ("metrics", None)])
def test_what_a_run_did_not_make_is_left_out(
    single: dict[str, pa.Table], missing: str, gone: str | None
) -> None:
    empty = static.figures({**single, missing: single[missing].slice(0, 0)})
    del single[missing]
    found = static.figures(single)
    assert [s.title for s in found] == [title for title in ALL if title != gone]
    assert [(s.title, s.text, s.below) for s in empty] == [(s.title, s.text, s.below) for s in found]


def test_a_recording_without_any_table_has_no_picture() -> None:
    assert static.figures({}) == []


def test_a_page_of_words_alone_needs_no_script(tables: dict[str, pa.Table]) -> None:
    words = {n: t for n, t in tables.items() if n not in TABLES or n in ("noise_model", "noise_coefficients")}
    written = page.render("run-7", words)
    assert "Noise models" in written
    assert "<script" not in written


@pytest.mark.parametrize("channels", ["r", "pq", "pqr"])
def test_there_is_one_panel_for_each_channel(channels: str) -> None:
    tables = _tables(channels)
    for title in ("Allan deviation", "Spectrum", "What rotation does"):
        headings = [text_of(panel) for panel in panels(section(tables, title))]
        assert headings == [[f"channel {channel}"] for channel in channels]


def test_panels_of_one_picture_have_the_same_scales(tables: dict[str, pa.Table]) -> None:
    for title in (ALL[0], ALL[2], ALL[4], ALL[5]):
        made = panels(section(tables, title))
        assert len({panel.x_range.id for panel in made}) == len({panel.y_range.id for panel in made}) == 1


def test_the_clock_of_the_page_is_that_of_the_gyro(tables: dict[str, pa.Table]) -> None:
    assert record_clock(tables) is None
    seconds = np.arange(3.0)
    tables["gyro"] = raw("gyro", seconds, dict.fromkeys("pqr", seconds))
    clock = record_clock(tables)
    assert clock is not None
    assert (clock.origin, clock.duration) == (START, 2.0)


def test_the_page_of_a_long_record_is_small(tables: dict[str, pa.Table]) -> None:
    """As many rows as a stage can think of: each curve is thinned to its panel."""
    for name in ("spectrum", "growth", "modulation"):
        copies = [row for row in tables[name].to_pylist() for _ in range(60)]
        tables[name] = from_rows(name, copies)
    assert tables["spectrum"].num_rows > 20_000
    assert len(page.render("run-7", tables).encode()) < 2e6  # of which Bokeh is 1.27 MB


# ---------------------------------------------------------------------------------------- Allan deviation


def test_the_deviation_is_drawn_in_deg_h_with_its_interval_and_fit(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Allan deviation")
    for panel, channel in zip(panels(shown), "pqr", strict=True):
        rows = rows_of(tables, "allan", channel=channel, estimator="allan")
        tau, deviation = curve(shown, panel, "Allan deviation")
        # 1e-12: roundings of a logarithm and its inverse, and of the unit
        np.testing.assert_allclose(tau, [r["tau"] for r in rows], rtol=1e-12)
        np.testing.assert_allclose(deviation, [r["deviation"] * DEG_H for r in rows], rtol=1e-12)
        (shaded,) = drawn(panel, VArea)
        data = shaded.data_source.data
        np.testing.assert_allclose(data["high"], [r["upper"] * DEG_H for r in rows], rtol=1e-12)
        np.testing.assert_allclose(data["low"], [r["lower"] * DEG_H for r in rows], rtol=1e-12)
        x, fit = curve(shown, panel, "fit of the coefficients")
        np.testing.assert_allclose(fit, allan_model(channel, x) * DEG_H, rtol=1e-12)
        x, fitted = curve(shown, panel, "noise model")
        np.testing.assert_allclose(fitted, 1.1 * allan_model(channel, x) * DEG_H, rtol=1e-12)


def test_the_other_estimators_can_be_shown_and_hidden(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Allan deviation")
    assert legend(shown) == {
        "Allan deviation": 6,  # curve and band
        "fit of the coefficients": 3,
        "noise model": 3,
        "terms of the fit": 18,  # lines and letters: three terms a channel
        "modified": 3,
        "Hadamard": 3,
        "total": 3,
    }
    x, y = curve(shown, panels(shown)[1], "Hadamard")
    rows = rows_of(tables, "allan", channel="q", estimator="hadamard")
    np.testing.assert_allclose(x, [r["tau"] for r in rows], rtol=1e-12)
    np.testing.assert_allclose(y, [r["deviation"] * DEG_H for r in rows], rtol=1e-12)


def test_the_terms_are_lines_of_their_slope_that_make_up_the_fit(tables: dict[str, pa.Table]) -> None:
    slopes = {"Q": -1.0, "N": -0.5, "B": 0.0, "K": 0.5, "R": 1.0}
    shown = section(tables, "Allan deviation")
    for panel, channel in zip(panels(shown), "pqr", strict=True):
        letters = [str(r.data_source.data["word"][0]) for r in drawn(panel, Text)]
        assert set(letters) == {name for name, value in COEFFICIENTS[channel].items() if value}
        terms = [r.data_source.data for r in drawn(panel, Line) if r.glyph.line_width == 0.8]
        for letter, term in zip(letters, terms, strict=True):
            slope = np.diff(np.log(term["y"])) / np.diff(np.log(term["x"]))
            np.testing.assert_allclose(slope, slopes[letter], atol=1e-9)  # roundings over a step of 0.2
        total = np.sqrt(sum(np.asarray(term["y"]) ** 2 for term in terms))
        np.testing.assert_allclose(total, allan_model(channel, terms[0]["x"]) * DEG_H, rtol=1e-12)


def test_the_letter_of_a_term_lies_on_its_line_inside_the_panel(tables: dict[str, pa.Table]) -> None:
    (first, *_) = panels(section(tables, "Allan deviation"))
    for word in drawn(first, Text):
        x, y = (float(word.data_source.data[name][0]) for name in "xy")
        assert first.x_range.start < x < first.x_range.end
        assert first.y_range.start < y < first.y_range.end
        lines = [r.data_source.data for r in drawn(first, Line) if r.glyph.line_width == 0.8]
        # 1e-12: a logarithm and its inverse
        assert any(np.any(np.isclose(d["x"], x, rtol=1e-12) & np.isclose(d["y"], y)) for d in lines)


def test_terms_are_named_only_where_there_are_coefficients(tables: dict[str, pa.Table]) -> None:
    assert "R rate ramp (+1)" in section(tables, "Allan deviation").text
    assert "R rate ramp" not in section(dict(_tables("q")), "Allan deviation").text
    del tables["noise_coefficients"]
    shown = section(tables, "Allan deviation")
    assert "slopes" not in shown.text
    assert "terms of the fit" not in legend(shown)


def test_deviations_without_interval_fit_and_order_are_drawn_too(single: dict[str, pa.Table]) -> None:
    rows = [
        {**row, "lower": None, "upper": None, "model": None, "noise_model": None, "degrees_of_freedom": None}
        for row in reversed(rows_of(single, "allan", estimator="allan"))
    ]
    single["allan"] = from_rows("allan", rows)
    shown = section(single, "Allan deviation")
    assert list(legend(shown)) == ["Allan deviation", "terms of the fit"]
    (panel,) = panels(shown)
    x, _ = curve(shown, panel, "Allan deviation")
    assert np.all(np.diff(x) > 0)
    (shaded,) = drawn(panel, VArea)
    assert len(shaded.data_source.data["x"]) == 0


def test_only_other_estimators_are_shown_by_themselves(single: dict[str, pa.Table]) -> None:
    single["allan"] = from_rows("allan", rows_of(single, "allan", estimator="total"))
    assert legend(section(single, "Allan deviation")) == {"total": 1}


def test_deviations_of_zero_are_drawn_as_none(single: dict[str, pa.Table]) -> None:
    rows = [{**row, "deviation": 0.0, "lower": 0.0, "upper": 0.0} for row in single["allan"].to_pylist()]
    single["allan"] = from_rows("allan", rows)
    shown = section(single, "Allan deviation")
    _, y = curve(shown, panels(shown)[0], "Allan deviation")
    assert np.all(np.isnan(y))


# ------------------------------------------------------------------------------------- noise coefficients


def test_coefficients_stand_in_the_units_of_data_sheets(tables: dict[str, pa.Table]) -> None:
    below = section(tables, "Noise coefficients").below
    # N of p is 0.01 deg/sqrt(h), its error 3 %
    assert "<td>N</td><td>angle random walk</td><td>deg/√h</td>" in below
    assert f"<td class=num title={ROOT!r}>0.01000 ± 0.00030</td>" in below
    for name in (
        "bias instability</td><td>deg/h<",
        "rate random walk</td><td>deg/h/√h<",
        "arcsec",
        "deg/h/h",
    ):
        assert name in below


def test_what_is_not_significant_is_pale(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Noise coefficients")
    lacking = sum(value == 0.0 for of in COEFFICIENTS.values() for value in of.values())
    assert shown.below.count('class="num pale"') == lacking == 6
    assert "Pale" in shown.text
    significant = [row for row in tables["noise_coefficients"].to_pylist() if row["significant"]]
    tables["noise_coefficients"] = from_rows("noise_coefficients", significant)
    shown = section(tables, "Noise coefficients")
    assert shown.below.count("<td class=num>–</td>") == lacking
    assert "Pale" not in shown.text


# ------------------------------------------------------------------------------- spectrum and noise models


def test_the_spectrum_is_the_root_of_the_density_with_the_chosen_model(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Spectrum")
    panel = panels(shown)[0]
    rows = rows_of(tables, "spectrum", channel="p")
    (dots,) = drawn(panel, Scatter)
    expected = [np.sqrt(r["density"]) * DEG_ROOT_H for r in rows]
    np.testing.assert_allclose(dots.data_source.data["y"], expected, rtol=1e-12)
    frequency, model = curve(shown, panel, "chosen model")
    # white noise of 0.01 deg/sqrt(h) lies at 0.01: at 5 Hz the colour is 1e-5 of it
    assert model[-1] == pytest.approx(0.01, rel=1e-4)
    of = MODELS["p"].psd(2 * np.pi * frequency)
    np.testing.assert_allclose(model, np.sqrt(of) * DEG_ROOT_H, rtol=1e-9)  # of a logarithm and its inverse


def test_the_recommended_rate_is_marked_in_hertz(tables: dict[str, pa.Table]) -> None:
    made = panels(section(tables, "Spectrum"))
    spans = [[float(s.location) for s in panel.center if isinstance(s, Span)] for panel in made]
    assert spans[2] == []  # r has none
    for channel, (at,) in zip("pq", spans[:2], strict=True):
        assert at == pytest.approx(rate_of(channel) / (2 * np.pi), rel=1e-12)
    del tables["metrics"]
    assert "Dashed" not in section(tables, "Spectrum").text


def test_a_dense_spectrum_is_a_line(single: dict[str, pa.Table]) -> None:
    rows = single["spectrum"].to_pylist()
    dense = [{**r, "frequency": r["frequency"] * (1 + 1e-3 * i)} for r in rows for i in range(5)]
    single["spectrum"] = from_rows("spectrum", dense)
    shown = section(single, "Spectrum")
    (panel,) = panels(shown)
    assert drawn(panel, Scatter) == []
    x, _ = curve(shown, panel, "periodogram, means about a frequency")
    assert np.all(np.diff(x) > 0)


def test_the_candidates_stand_with_their_differences_and_the_chosen_one_is_bold(
    tables: dict[str, pa.Table],
) -> None:
    below = section(tables, "Noise models").below
    assert (
        "<td>white + noise 1</td><td class=num><strong>0</strong></td><td class=num>111.1</td>"
        "<td class=num>111.1</td>"
    ) in below
    assert below.count("<strong>0</strong>") == 3
    assert below.index("<strong>white + noise 1<") < below.index("<strong>white + noise 2<")
    for head, name in {"K [deg/h/√h]": "K", "Q [″]": "Q"}.items():
        assert f"<th scope=col class=num>{head}</th>" in below
        (row,) = rows_of(tables, "noise_model", chosen=True, channel="r", parameter=name)
        assert f"<div title={row['value']!r}>" in below


def test_parameters_of_the_chosen_model_are_times_and_rates(single: dict[str, pa.Table]) -> None:
    below = section(single, "Noise models").below
    heads = ("√N [deg/√h]", "σ [deg/h]", "1/μ [s]", "2π/λ [s]")
    assert all(f"<th scope=col class=num>{head}</th>" in below for head in heads)
    # N = (0.01 deg/sqrt(h))^2 +- 10 %, so its root +- 5 %; sigma = 0.006 deg/sqrt(h)/sqrt(s)
    assert ">0.01000 ± 0.00050<" in below
    sigma = SIGMA * DEG_H
    assert f">{sigma:.3f} ± {0.1 * sigma:.3f}<" in below
    assert ">250 ± 25<" in below  # mu = 0.004 /s
    assert ">206 to 304<" in below  # 250 exp(+-0.196), the smaller first
    assert ">209 ± 21<" in below  # lambda = 0.03 rad/s


def test_parameters_without_error_or_interval_are_shown_too(single: dict[str, pa.Table]) -> None:
    rows = [
        {**row, "standard_error": None, "lower": None, "upper": 1.0, "value": 0.0 if i == 0 else row["value"]}
        for i, row in enumerate(rows_of(single, "noise_model", chosen=True))
    ]
    single["noise_model"] = from_rows("noise_model", rows)
    below = section(single, "Noise models").below
    assert ">0</div>" in below
    assert " to " not in below
    none = [{**row, "chosen": False} for row in rows]
    single["noise_model"] = from_rows("noise_model", none)
    assert "chosen model" not in section(single, "Noise models").below


# ------------------------------------------------------------------------------------------------ rotation


def test_growth_is_drawn_against_the_rate_with_the_level_at_rest(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "What rotation does")
    for panel, channel in zip(panels(shown), "pqr", strict=True):
        rate, root = curve(shown, panel, "constant rotation")
        expected = np.sqrt(growth(MODELS[channel], rate * DEG)) * DEG_ROOT_H
        np.testing.assert_allclose(root, expected, rtol=1e-9)  # of a logarithm and its inverse
    # at rest the rate random walk grows without end: r has no such line
    assert legend(shown)["without rotation"] == 2
    _, level = curve(shown, panels(shown)[0], "without rotation")
    np.testing.assert_allclose(level, np.sqrt(growth(MODELS["p"], 0.0)) * DEG_ROOT_H, rtol=1e-12)
    assert legend(shown)["to and fro, one turn each way"] == 3


def test_the_rates_that_make_worse_are_shaded(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "What rotation does")
    boxes = [[b for b in panel.center if isinstance(b, BoxAnnotation)] for panel in panels(shown)]
    assert [len(of) for of in boxes] == [0, 1, 0]
    (band,) = worse_bands(MODELS["q"])
    ((box,),) = (of for of in boxes if of)
    assert box.left < panels(shown)[1].x_range.start  # from rest on
    # the rates of the table are 5 % apart, and the edge lies between two of them
    assert float(box.right) == pytest.approx(band.high / DEG, rel=0.05)
    assert "Shaded" in shown.text
    assert "Shaded" not in section(dict(_tables("p")), "What rotation does").text


def test_bands_between_other_rates_are_shaded_each(single: dict[str, pa.Table]) -> None:
    rows = single["modulation"].to_pylist()
    for i, row in enumerate(rows):
        row["worse"] = i in (5, 6, len(rows) - 1)
    single["modulation"] = from_rows("modulation", rows)
    (panel,) = panels(section(single, "What rotation does"))
    first, last = (b for b in panel.center if isinstance(b, BoxAnnotation))
    rate = [row["rotation_rate"] / DEG for row in rows]
    ends = [np.sqrt(rate[4] * rate[5]), np.sqrt(rate[6] * rate[7])]
    np.testing.assert_allclose([first.left, first.right], ends, rtol=1e-12)
    assert last.right > panel.x_range.end


def test_the_recommended_rate_is_marked_with_its_value(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "What rotation does")
    words = [[b.text.text for b in p.center if isinstance(b, Label)] for p in panels(shown)]
    spoken = [f"{rate_of(channel) / DEG:.2f} deg/s" for channel in "pq"]
    assert words == [[spoken[0]], [spoken[1]], []]
    assert f"Recommended: {spoken[0]} for p, {spoken[1]} for q." in shown.text


def test_no_rotation_can_be_the_advice_and_its_unit_is_heeded(tables: dict[str, pa.Table]) -> None:
    rows = [
        metric("recommended_rate", "p", 0.0, unit="deg/s", procedure="static"),
        metric("recommended_rate", "q", 0.1, unit="rad/s", procedure="static"),
        metric("recommended_rate", "r", 7.0, unit="1", procedure="static"),  # no rate
    ]
    tables["metrics"] = from_rows("metrics", rows)
    shown = section(tables, "What rotation does")
    assert "Recommended: 5.73 deg/s for q. No rotation is needed for p." in shown.text
    assert [sum(isinstance(b, Span) for b in p.center) for p in panels(shown)] == [0, 1, 0]
    assert [sum(isinstance(b, Span) for b in p.center) for p in panels(section(tables, "Spectrum"))] == [
        0,
        1,
        0,
    ]


def test_growth_at_rest_alone_and_without_interval_is_drawn(single: dict[str, pa.Table]) -> None:
    bare = {"lower": None, "upper": None, "schuler_growth": None, "reversing_growth": None}
    single["modulation"] = from_rows("modulation", [single["modulation"].to_pylist()[0] | bare])
    shown = section(single, "What rotation does")
    assert legend(shown) == {"constant rotation": 2, "without rotation": 1}


def test_the_error_is_drawn_with_and_without_rotation(tables: dict[str, pa.Table]) -> None:
    shown = section(tables, "Growth of the angle error")
    for panel, channel in zip(panels(shown), "pqr", strict=True):
        time, turning = curve(shown, panel, "with rotation")
        _, rest = curve(shown, panel, "without rotation")
        # r, at rest for eight hours, is wrong by more than two degrees: that sets the unit
        expected = np.sqrt(variance(MODELS[channel], time, rate_of(channel))) / DEG
        np.testing.assert_allclose(turning, expected, rtol=1e-9)
        np.testing.assert_allclose(rest, np.sqrt(variance(MODELS[channel], time, 0.0)) / DEG, rtol=1e-9)
        assert text_of(panel) == [f"channel {channel}, turning at {rate_of(channel) / DEG:.4g} deg/s"]
    assert panels(shown)[0].yaxis.axis_label.text == "standard deviation [°]"
    one = panels(section(dict(_tables("q")), "Growth of the angle error"))[0]
    assert one.yaxis.axis_label.text == "standard deviation [arcmin]"


def test_several_rates_have_a_curve_each(single: dict[str, pa.Table]) -> None:
    rows = single["growth"].to_pylist()
    single["growth"] = from_rows("growth", rows + [{**row, "rotation_rate": DEG} for row in rows])
    shown = section(single, "Growth of the angle error")
    assert legend(shown)["with rotation"] == 4
    assert text_of(panels(shown)[0]) == [f"channel q, turning at 1 deg/s, {rate_of('q') / DEG:.4g} deg/s"]


@pytest.mark.parametrize(
    ("values", "ends"),
    [
        ([], (0.1, 10.0)),
        ([np.nan, 0.0, np.inf], (0.1, 10.0)),
        ([1.0, 100.0], (0.5, 200.0)),
        ([1e-30, 1.0], (0.5e-8, 2.0)),  # eight decades are enough
    ],
)
def test_a_logarithmic_scale_is_always_one(values: list[float], ends: tuple[float, float]) -> None:
    assert log_span([np.array(values)], 2.0) == pytest.approx(ends, rel=1e-12)


def test_hostile_text_stays_text() -> None:
    tables = make_static_tables("p", HOSTILE)
    for name in TABLES:
        rows = [{**row, "channel": HOSTILE} for row in tables[name].to_pylist()]
        tables[name] = from_rows(name, rows)
    tables["noise_model"] = from_rows(
        "noise_model", [{**row, "candidate": HOSTILE} for row in tables["noise_model"].to_pylist()]
    )
    written = page.render("run-7", tables)
    assert "<img" not in written
    assert written.count("&lt;img") >= 4
