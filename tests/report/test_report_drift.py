"""Which pictures a drift run has, and that they show what its tables hold."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bokeh.models import GridPlot
from bokeh.models.glyphs import HBar, Line, Rect, Scatter, Segment, Text
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from drift_tables import ARCSEC, DEG_H, SIGMA, Run, design, make_drift_tables, simulated, truth, two_runs
from report_tables import HOSTILE, START, from_rows

from pipeline import contracts
from pipeline.models.earth import RATE
from pipeline.models.gyro_drift import DRIFT
from pipeline.report import (
    drift,
    drift_correlation,
    drift_estimates,
    drift_observability,
    drift_parameters,
    drift_residuals,
    drift_runs,
    drift_trajectory,
    page,
)
from pipeline.report.base import Section, record_clock

ALL = [
    "The trajectory",
    "The sky plane",
    "Residuals",
    "Drift parameters",
    "Installation errors",
    "Estimates in time",
    "What the record can tell",
    "Correlation of the parameters",
]


@cache
def runs() -> tuple[Run, ...]:
    return tuple(two_runs())


@cache
def _tables() -> dict[str, pa.Table]:
    return make_drift_tables(runs())


@pytest.fixture
def tables() -> dict[str, pa.Table]:
    return dict(_tables())


@cache
def _polar() -> dict[str, pa.Table]:
    """One run near the pole: weak directions, and parameters that it does not determine."""
    return make_drift_tables([simulated(0, "polar", (0.02, -0.01), 24.0, 300.0)])


@cache
def _equatorial() -> dict[str, pa.Table]:
    """One run that tells nothing of theta."""
    return make_drift_tables([simulated(0, "equatorial", (0.0, 0.2), 24.0, 300.0)])


@pytest.fixture
def equatorial() -> dict[str, pa.Table]:
    return dict(_equatorial())


@pytest.fixture
def polar() -> dict[str, pa.Table]:
    return dict(_polar())


def section(tables: dict[str, pa.Table], title: str) -> Section:
    """One section alone: all of them take a second."""
    makers = (
        drift_trajectory.trajectory,
        drift_trajectory.sky_plane,
        drift_residuals.residuals,
        drift_parameters.drift,
        drift_parameters.installation,
        drift_estimates.estimates,
        drift_observability.observability,
        drift_correlation.correlation,
    )
    made = makers[ALL.index(title)](tables)
    assert made is not None
    assert made.title == title
    return made


def drawn(picture: Any, glyph: type) -> list[GlyphRenderer]:
    """What is drawn, in the order in which it was drawn."""
    # of one panel its own: its legend knows the curves of the others too
    found = picture.renderers if isinstance(picture, figure) else picture.select({"type": GlyphRenderer})
    renderers = sorted(found, key=lambda r: int(r.id[1:]))
    return [r for r in renderers if isinstance(r.glyph, glyph)]


def panels(section: Section) -> list[Any]:
    assert isinstance(section.picture, GridPlot)
    return [child[0] for child in section.picture.children]


def legend(panel: Any) -> list[str]:
    return [item.label.value for item in panel.legend[0].items]


def x_label(panel: Any) -> str:
    return str(panel.xaxis[0].axis_label.text)


def changed(table: pa.Table, **columns: Any) -> pa.Table:
    old = {name: table[name] for name in table.column_names}
    name = next(n for n in contracts.names() if contracts.contract(n).schema.names == table.column_names)
    return contracts.table(name, {**old, **columns})


# ------------------------------------------------------------------------------------------ which pictures


def test_a_whole_run_has_all_pictures(tables: dict[str, pa.Table]) -> None:
    assert [s.title for s in drift.figures(tables)] == ALL


@pytest.mark.parametrize(
    ("missing", "gone"),
    [
        (["trajectory"], ALL[:2]),
        (["residuals"], ["Residuals"]),
        (["drift_parameters"], ["Drift parameters", "Installation errors"]),
        (["drift_estimates"], ["Estimates in time"]),
        (["observability"], ["What the record can tell"]),
        (["correlation"], ["Correlation of the parameters"]),
        (["runs", "combinations", "further_runs"], []),
        (["trajectory", "residuals"], [*ALL[:3], "Estimates in time"]),
        (["drift_parameters", "residuals"], ["Residuals", "Drift parameters", "Installation errors"]),
    ],
)
def test_what_a_run_did_not_make_is_left_out(
    polar: dict[str, pa.Table], missing: list[str], gone: list[str]
) -> None:
    kept = {name: table for name, table in polar.items() if name not in missing}
    assert [s.title for s in drift.figures(kept)] == [title for title in ALL if title not in gone]


@pytest.mark.parametrize("name", ["trajectory", "residuals", "drift_parameters", "runs", "further_runs"])
def test_an_empty_table_is_as_a_missing_one(polar: dict[str, pa.Table], name: str) -> None:
    empty = drift.figures({**polar, name: polar[name].slice(0, 0)})
    del polar[name]
    assert [(s.title, s.text) for s in empty] == [(s.title, s.text) for s in drift.figures(polar)]


def test_a_recording_without_any_table_has_no_picture() -> None:
    assert drift.figures({}) == []


def test_a_run_of_one_sample_is_none(tables: dict[str, pa.Table]) -> None:
    for name in ("trajectory", "residuals"):
        tables[name] = tables[name].slice(0, 1)
    assert [s.title for s in drift.figures(tables)] == [ALL[3], ALL[4], ALL[6], ALL[7]]


def test_the_page_is_small_even_of_a_day_at_one_second() -> None:
    tables = make_drift_tables([simulated(0, "polar", (0.6, 0.5), 24.0, 1.0)])
    assert tables["residuals"].num_rows > 6 * 86_400
    # 1.27 MB is Bokeh; the curves are thinned to the page
    assert len(page.render("run-7", tables).encode()) < 2.5e6


# -------------------------------------------------------------------------------------- what they show


def test_the_clock_of_the_page_is_that_of_the_trajectory(tables: dict[str, pa.Table]) -> None:
    clock = record_clock(tables)
    assert clock is not None
    assert clock.origin == START


def test_every_run_has_its_own_clock_and_heading(tables: dict[str, pa.Table]) -> None:
    first, second = drift_runs.runs(tables)
    assert (first.title, second.title) == ("run 0: stand 0, polar", "run 1: stand 1, vertical")
    assert (first.duration, second.duration) == (24.0, 12.0)
    assert second.hours(runs()[1].time)[0] == 0.0
    assert drift_runs.runs({"trajectory": tables["trajectory"]})[1].title == "run 1"


def test_the_trajectory_is_drawn_as_measured_and_as_predicted(tables: dict[str, pa.Table]) -> None:
    block = panels(section(tables, "The trajectory"))
    assert len(block) == 4
    assert legend(block[0]) == ["measured", "predicted"]
    run = runs()[1]
    hours = (run.time - run.time[0]) / 3600e9
    for line, angle in zip(drawn(block[1], Line), (run.measured, run.true), strict=True):
        x, y = (np.asarray(line.data_source.data[name]) for name in "xy")
        # 1e-9: roundings of hours and degrees; the curve is thinned, so not every sample is in it
        np.testing.assert_allclose(y, np.degrees(np.interp(x, hours, angle[:, 0])), atol=1e-9)


def test_bridged_points_are_not_drawn_as_measured(tables: dict[str, pa.Table]) -> None:
    flags = np.ones(tables["trajectory"].num_rows, np.bool_)
    flags[50:60] = False
    tables["trajectory"] = changed(tables["trajectory"], measured=flags)
    run = drift_runs.runs(tables)[0]
    points = drift_trajectory.measured(tables, run)
    assert points is not None
    assert len(points.hours) == len(runs()[0].time) - 10
    line = drawn(panels(section(tables, "The trajectory"))[0], Line)[0].data_source.data
    assert np.isnan(np.asarray(line["y"])).sum() == 1  # the pause of ten minutes interrupts the curve


def test_the_sky_plane_has_one_scale_the_ends_and_the_spiral(tables: dict[str, pa.Table]) -> None:
    first, second = panels(section(tables, "The sky plane"))
    assert first.match_aspect
    assert legend(first) == ["measured", "Gauss–Newton", "spiral", "its centre"]
    assert legend(second) == ["measured", "Gauss–Newton"]
    centre, start, end = (r.data_source.data for r in drawn(first, Scatter)[1:])
    arcmin = 60 * ARCSEC
    np.testing.assert_allclose([centre["x"][0], centre["y"][0]], [-7e-4 / arcmin, -2.1e-3 / arcmin])
    np.testing.assert_allclose([start["x"][0], start["y"][0]], runs()[0].measured[0] / arcmin)
    np.testing.assert_allclose([end["x"][0], end["y"][0]], runs()[0].measured[-1] / arcmin)
    words = [w for r in drawn(first, Text) for w in r.data_source.data["word"]]
    assert words == ["start", "end"]
    assert "0.9946000 ± 0.0000010" in section(tables, "The sky plane").below


def test_a_flat_path_gets_two_scales(equatorial: dict[str, pa.Table]) -> None:
    shown = section(equatorial, "The sky plane")
    assert not panels(shown)[0].match_aspect
    assert "on a scale of its own" in shown.text


def test_the_residuals_tell_their_rms_the_outliers_and_the_prediction(tables: dict[str, pa.Table]) -> None:
    made = panels(section(tables, "Residuals"))[0]
    used, foretold, outliers = legend(made)
    residual = runs()[0].measured[:, 0] - runs()[0].true[:, 0]
    kept = np.delete(residual, [100, 101, 333])
    assert used == f"residual, RMS {np.sqrt(np.mean(kept**2)) / ARCSEC:.3g}″"
    n = len(residual) - round(0.7 * len(residual))
    error = residual[-n:] - 3 * SIGMA * np.linspace(0, 1, n)
    assert foretold == f"prediction, RMS {np.sqrt(np.mean(error**2)) / ARCSEC:.3g}″"
    assert outliers == "3 outliers"
    marks = drawn(made, Scatter)[0].data_source.data
    np.testing.assert_allclose(marks["residual"], residual[[100, 101, 333]] / ARCSEC, rtol=1e-9)
    assert set(marks["shape"]) == {"triangle"}  # at 20 sigma they lie beyond the panel
    assert np.max(marks["y"]) < 10
    line = drawn(made, Line)[0].data_source.data
    assert np.nanmax(np.abs(line["y"])) < 6  # sigma, of 1440 samples: no outlier is among them


def test_the_method_that_was_held_out_is_the_primary_one(tables: dict[str, pa.Table]) -> None:
    assert drift_runs.primary(tables) == "gauss_newton"
    states = tables["residuals"]["state"].to_numpy(zero_copy_only=False)
    tables["residuals"] = tables["residuals"].filter(pa.array(states != "held out"))
    methods = tables["residuals"]["method"].to_numpy(zero_copy_only=False)
    tables["residuals"] = tables["residuals"].filter(pa.array(methods != "gauss_newton"))
    assert drift_runs.primary(tables) == "cumulative"
    assert "shaded" not in section(tables, "Residuals").text


def test_parameters_stand_in_deg_h_with_bars_of_two_standard_errors(tables: dict[str, pa.Table]) -> None:
    block = panels(section(tables, "Drift parameters"))
    assert [x_label(p) for p in block] == [f"{name} [deg/h]" for name in DRIFT]
    methods = [label.text for _, label in sorted(block[0].yaxis[0].major_label_overrides.items())]
    assert methods[:2] == ["Gauss–Newton", "cumulative"]
    assert "transient, at the start" in methods
    rows = tables["drift_parameters"].to_pylist()
    (mine,) = [r for r in rows if (r["method"], r["parameter"]) == ("gauss_newton", "m12")]
    bar = drawn(block[1], Segment)[0].data_source.data
    ends = [mine["drift"] + sign * 2 * mine["drift_standard_error"] for sign in (-1, 1)]
    assert [bar["left"][0], bar["right"][0]] == ends
    # a value far from the others is an arrow at the edge, and leaves the scale to them
    far = methods.index("transient, at the start")
    assert bar["shape"][far] == "triangle"
    assert bar["shown"][far] < block[1].x_range.end < rows[-7]["drift"] + 1e3


def test_what_is_not_determined_is_pale_and_starred(polar: dict[str, pa.Table]) -> None:
    shown = section(polar, "Installation errors")
    rows = [r for r in polar["drift_parameters"].to_pylist() if r["method"] == "gauss_newton"]
    doubtful = {r["parameter"] for r in rows if r["state"] != "determined"}
    assert doubtful
    starred = {p for p in map(x_label, panels(shown)) if "*" in p}
    symbols = {f"{drift_runs.symbol(name)} * [arcmin]" for name in doubtful if name not in DRIFT}
    assert starred == symbols
    assert "asterisk" in shown.text
    (hollow,) = drawn(next(p for p in panels(shown) if "*" in x_label(p)), Scatter)
    assert hollow.glyph.fill_color == "white"
    assert all(word.startswith(("not", "determined only")) for word in hollow.data_source.data["state"])


def test_a_component_of_epsilon_along_u_is_not_drawn(polar: dict[str, pa.Table]) -> None:
    labels = [x_label(p).split()[0] for p in panels(section(polar, "Installation errors"))]
    assert labels == ["θ1", "θ2", "ε1", "ε2"]  # near the pole u is axis 3, and u.epsilon = 0


def test_a_parameter_without_any_error_has_a_scale_all_the_same(polar: dict[str, pa.Table]) -> None:
    rows = polar["drift_parameters"].to_pylist()
    none = {"standard_error": None, "drift_standard_error": None, "prior": None, "state": "given"}
    tiny = {"standard_error": 1e-30, "drift_standard_error": 1e-30}
    for other in (none, tiny):
        alone = [{**row, **other} for row in rows if row["method"] == "gauss_newton"]
        polar["drift_parameters"] = from_rows("drift_parameters", alone)
        for made in panels(section(polar, "Drift parameters")):
            (drawn_at,) = drawn(made, Scatter)[0].data_source.data["shown"]
            assert made.x_range.start < drawn_at < made.x_range.end


def test_estimates_run_through_the_runs_one_after_the_other(tables: dict[str, pa.Table]) -> None:
    block = panels(section(tables, "Estimates in time"))
    assert len(block) == 6
    assert legend(block[0]) == ["filter", "smoother", "final value by Gauss–Newton"]
    history = drawn(block[0], Line)[0].data_source.data
    assert history["hours"][-1] == 36.0
    assert np.all(np.diff(history["hours"]) > 0)
    # at the end the filter knows what the whole record tells; 1e-9: roundings
    rows = tables["drift_estimates"].to_pylist()
    last = [r for r in rows if (r["method"], r["parameter"]) == ("filter", "m11")][-1]
    np.testing.assert_allclose(history["value"][-1], last["value"] * DEG_H, rtol=1e-9)
    np.testing.assert_allclose(
        history["high"][-1] - history["low"][-1], 2 * last["standard_error"] * DEG_H, rtol=1e-6
    )
    assert pytest.approx(np.rad2deg(RATE) * 3600, rel=1e-15) == drift_runs.EARTH_RATE  # one rounding


def test_runs_whose_clocks_overlap_are_told_apart_by_the_step_back(tables: dict[str, pa.Table]) -> None:
    table = tables["trajectory"]
    time = table["time"].to_numpy() - np.where(table["run"].to_numpy() == 1, 10**15, 0)
    tables["trajectory"] = changed(table, time=time)
    found = drift_runs.runs(tables)
    hour = 3_600_000_000_000
    stamps = START + hour * np.array([0, 12, 24, 1, 12])
    np.testing.assert_allclose(drift_estimates.elapsed(stamps, found), [0, 12, 24, 25, 36], atol=1e-12)


def test_weak_directions_are_named_by_their_largest_components(equatorial: dict[str, pa.Table]) -> None:
    shown = section(equatorial, "What the record can tell")
    bars = drawn(shown.picture, HBar)
    assert [r.data_source.data["state"][0] for r in bars] == ["determined", "weak", "null"]
    weak, null = ([str(n) for n in r.data_source.data["name"]] for r in drawn(shown.picture, Text))
    rows = equatorial["observability"].to_pylist()
    first = min(row["direction"] for row in rows if row["state"] == "weak")
    vector = {row["parameter"]: row["component"] for row in rows if row["direction"] == first}
    largest = max(vector, key=lambda name: abs(vector[name]))
    assert weak[0].startswith(f"{abs(vector[largest]):.2f} {drift_runs.symbol(largest)}")
    # the columns of theta are exactly zero in this scheme: any mixture of the two is a null vector
    assert all(set(name.split()) & {"θ1", "θ2"} for name in null)
    assert "2 null" in shown.text
    assert "Only in combination: m11. Not at all: θ1, θ2, ε3." in shown.text


@pytest.mark.parametrize(
    ("components", "text"),
    [
        ({"m11": 0.708, "mc2": 0.58, "ε3": -0.4, "m12": 0.01}, "0.71 m11 + 0.58 mc2 − 0.40 ε3"),
        ({"m11": -0.6, "mc2": 0.8}, "0.80 mc2 − 0.60 m11"),
        ({"m11": -1.0}, "1.00 m11"),
        (dict.fromkeys("abcdef", 0.40825), "0.41 a + 0.41 b + 0.41 c + 0.41 d + …"),
    ],
)
def test_a_direction_in_words(components: dict[str, float], text: str) -> None:
    assert drift_observability.named(components) == text


def test_combinations_and_further_runs_are_listed(equatorial: dict[str, pa.Table]) -> None:
    below = section(equatorial, "What the record can tell").below
    assert "mc1 − θ1 − ε2" in below
    assert "−0.00412000 ± 0.00000031" in below
    assert "−0.0619692 ± 0.0000047" in below  # 0.00412 of 15.041067 deg/h
    assert "<td>horizontal</td>" in below
    assert "34.38" in below  # 0.6 rad
    assert "θ1 unknown → ± 0.50 arcmin" in below  # its prior of 15 arcmin by 30
    assert "m22" not in below  # is determined by the record
    without = {n: t for n, t in equatorial.items() if n not in ("combinations", "further_runs")}
    assert section(without, "What the record can tell").below == ""


def test_a_record_that_tells_nothing_is_drawn_too(polar: dict[str, pa.Table]) -> None:
    rows = [
        {**row, "state": "null", "singular_value": 0.0, "standard_deviation": None}
        for row in polar["observability"].to_pylist()
    ]
    polar["observability"] = from_rows("observability", rows)
    shown = section(polar, "What the record can tell")
    assert "0 of 10 are determined, 10 null" in shown.text
    assert len(drawn(shown.picture, HBar)) == 1


def test_the_correlation_is_drawn_as_it_is(tables: dict[str, pa.Table]) -> None:
    matrix = drift_correlation.read(tables["correlation"])
    assert len(matrix.names) == len(design(runs())[0]) == 14
    assert matrix.names[-1] == "ε3 of run 1"
    np.testing.assert_array_equal(matrix.values, matrix.values.T)
    pair = tables["correlation"].to_pylist()[3]
    cells = drawn(section(tables, "Correlation of the parameters").picture, Rect)[0].data_source.data
    assert len(cells["value"]) == 14 * 15 // 2
    (place,) = np.flatnonzero((np.asarray(cells["column"]) == 0) & (np.asarray(cells["row"]) == 4))
    assert (pair["parameter_a"], pair["parameter_b"]) == ("m11", "mc1")
    assert cells["value"][place] == pair["correlation"]


def test_what_is_given_is_not_in_the_correlation_map(polar: dict[str, pa.Table]) -> None:
    bound = [
        {**row, "state": "given"} if row["parameter"] == "epsilon3" else row
        for row in polar["drift_parameters"].to_pylist()
    ]
    polar["drift_parameters"] = from_rows("drift_parameters", bound)
    (made,) = panels(section(polar, "Correlation of the parameters"))
    shown = [label.text for label in made.yaxis[0].major_label_overrides.values()]
    assert shown == [*DRIFT, "θ1", "θ2", "ε1", "ε2"]


def test_a_correlation_of_another_method_serves_where_the_primary_has_none(
    polar: dict[str, pa.Table],
) -> None:
    rows = [{**row, "method": "cumulative"} for row in polar["correlation"].to_pylist()]
    polar["correlation"] = from_rows("correlation", rows)
    assert "by cumulative" in section(polar, "Correlation of the parameters").text


def test_the_tables_of_this_test_are_honest() -> None:
    """The estimates drawn lie where their bars say: else the pictures would be looked at in vain."""
    p = dict(zip(design(runs())[0], truth(runs()), strict=True))
    rows = [r for r in _tables()["drift_parameters"].to_pylist() if r["method"] == "gauss_newton"]
    error = [
        (row["value"] - p[row["parameter"], row["run"]]) / row["standard_error"]
        for row in rows
        if row["standard_error"] > 1e-12  # not epsilon along u
    ]
    assert len(error) == 13
    assert np.max(np.abs(error)) < 4  # of 13 normal errors one in a thousand cases is larger


def test_hostile_text_stays_text() -> None:
    tables = make_drift_tables([simulated(0, "polar", (0.02, -0.01), 24.0, 600.0)], HOSTILE)
    combined = [{**row, "expression": HOSTILE} for row in tables["combinations"].to_pylist()]
    tables["combinations"] = from_rows("combinations", combined)
    written = page.render("run-7", tables)
    assert "<img" not in written
    assert written.count("&lt;img") >= 1
