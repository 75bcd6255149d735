"""Which pictures a navigation has, and that they show what its tables hold."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from bokeh.models import GridPlot
from bokeh.models.glyphs import Line, Quad, Scatter, Text, VArea, VStrip
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from navigation_tables import (
    ACCELEROMETER_BIAS,
    DEG,
    GYRO_BIAS,
    HEADING,
    HEIGHT,
    LENGTH,
    LOST,
    METHODS,
    NED,
    REFUSED,
    SPEED,
    STEP,
    biases,
    errors,
    fixes,
    instants,
    loop_rows,
    make_navigation_tables,
    navigation_provenance,
    pole_rows,
    size,
    velocity_poles,
)
from report_tables import HOSTILE, START, from_rows

from pipeline import contracts
from pipeline.report import (
    navigation,
    navigation_aids,
    navigation_biases,
    navigation_errors,
    navigation_innovations,
    navigation_poles,
    navigation_states,
    navigation_track,
    page,
)
from pipeline.report.base import Section, record_clock
from pipeline.report.navigation_panels import METHODS as COLOURS
from pipeline.report.navigation_panels import methods, outages

ALL = [
    "Track",
    "What aids",
    "How large the errors are",
    "Errors by component",
    "Velocity and attitude",
    "Biases",
    "Poles of the loops",
    "Innovations",
]


@cache
def _tables() -> dict[str, pa.Table]:
    return make_navigation_tables()


@pytest.fixture
def tables() -> dict[str, pa.Table]:
    return dict(_tables())


def section(tables: dict[str, pa.Table], title: str) -> Section:
    makers = (
        navigation_track.track,
        navigation_aids.aids,
        navigation_errors.sizes,
        navigation_errors.errors,
        navigation_states.states,
        navigation_biases.biases,
        navigation_poles.poles,
        navigation_innovations.innovations,
    )
    made = makers[ALL.index(title)](tables)
    assert made is not None
    assert made.title == title
    return made


@cache
def unchanged(title: str) -> Section:
    """A section of the tables as they are."""
    return section(_tables(), title)


def panels(made: Section) -> list[Any]:
    assert made.picture is not None
    if isinstance(made.picture, figure):
        return [made.picture]
    grids = sorted(made.picture.select({"type": GridPlot}), key=lambda grid: int(grid.id[1:]))
    return [child[0] for grid in grids for child in grid.children]


def drawn(panel: Any, glyph: type, colour: str | None = None) -> list[GlyphRenderer]:
    """What one panel shows, in the order in which it was drawn."""
    renderers = [r for r in panel.renderers if isinstance(r.glyph, glyph)]
    if colour is None:
        return renderers
    name = "line_color" if glyph is Line else "fill_color"
    return [r for r in renderers if getattr(r.glyph, name) == colour]


def legend(made: Section) -> list[str]:
    assert made.picture is not None
    shown = [p for p in made.picture.select({"type": figure}) if p.legend]
    return [item.label.value for item in shown[0].legend[0].items]


def label(panel: Any) -> str:
    return str(panel.yaxis[0].axis_label.text)


def heading(panel: Any) -> list[str]:
    """Words above a panel, from the top down."""
    titles = [one for one in panel.above if type(one).__name__ == "Title"]
    return [one.text.text for one in titles]


def at(curve: GlyphRenderer, time: float) -> float:
    """What a curve shows at one of its samples."""
    x, y = (np.asarray(curve.data_source.data[name]) for name in "xy")
    return float(y[int(np.argmin(np.abs(x - time)))])


def without(tables: dict[str, pa.Table], method: str) -> dict[str, pa.Table]:
    kept = dict(tables)
    for name in ("navigation", "navigation_errors", "innovations"):
        kept[name] = tables[name].filter(pc.not_equal(tables[name]["method"], method))
    return kept


def changed(name: str, table: pa.Table, **columns: Any) -> pa.Table:
    return contracts.table(name, {**{c: table[c] for c in table.column_names}, **columns})


# ------------------------------------------------------------------------------------------ which pictures


def test_all_sections_in_their_order(tables: dict[str, pa.Table]) -> None:
    assert [one.title for one in navigation.figures(tables)] == ALL


BESIDE = ("gnss_position", "gnss_velocity", "truth_position", "truth_velocity", "truth_attitude", "loops")


@pytest.mark.parametrize(
    ("missing", "left_out"),
    [
        (("navigation",), {"Track", "What aids", "Velocity and attitude", "Biases"}),
        (("navigation_errors", "innovations"), {*ALL[2:4], "Innovations"}),
        (("poles",), {"Poles of the loops"}),
        ((*BESIDE, "provenance"), set()),
    ],
)
def test_what_cannot_be_drawn_is_left_out(
    tables: dict[str, pa.Table], missing: tuple[str, ...], left_out: set[str]
) -> None:
    tables["gyro"] = tables["gnss_position"]  # something keeps time
    for name in missing:
        del tables[name]
    expected = [title for title in ALL if title not in left_out]
    assert [one.title for one in navigation.figures(tables)] == expected


def test_without_truth_there_are_no_errors() -> None:
    made = navigation.figures(make_navigation_tables(with_truth=False))
    assert [one.title for one in made] == [title for title in ALL if "rrors" not in title]


def test_strapdown_alone_has_its_track_its_errors_and_its_states() -> None:
    made = navigation.figures(make_navigation_tables(("strapdown",)))
    assert [one.title for one in made] == [
        "Track",
        "How large the errors are",
        "Errors by component",
        "Velocity and attitude",
        "Poles of the loops",
    ]


def test_tables_without_a_row_make_a_page_of_words(tables: dict[str, pa.Table]) -> None:
    for name in ("navigation", "navigation_errors", "innovations", "poles", "loops"):
        tables[name] = tables[name].slice(0, 0)
    assert navigation.figures(tables) == []


def test_the_page_is_the_same_twice_and_trusts_no_text() -> None:
    hostile = make_navigation_tables(("loops", "filter"), text=HOSTILE)
    first = page.render("run-7", hostile)
    assert page.render("run-7", hostile) == first
    assert "<img src=x" not in first


def test_time_is_that_of_the_navigation(tables: dict[str, pa.Table]) -> None:
    clock = record_clock(tables)
    assert clock is not None
    assert (clock.origin, clock.duration) == (START, pytest.approx(LENGTH))
    assert [rows.method for rows in methods(tables, "navigation")] == list(METHODS)
    assert outages(tables) == [LOST]


def test_an_outage_may_last_to_the_end(tables: dict[str, pa.Table]) -> None:
    table = tables["navigation"]
    seconds = (table["time"].to_numpy() - START) * 1e-9
    lost = ["outage" if t >= LOST[0] else "aided" for t in seconds]
    tables["navigation"] = changed("navigation", table, phase=lost)
    assert outages(tables) == [(LOST[0], LENGTH)]
    (whole, height) = panels(section(tables, "Track"))  # no map of where it ends
    assert (label(whole), label(height)) == ("north [km]", "height [m]")


@pytest.mark.parametrize("title", ["Errors by component", "Velocity and attitude", "Biases", "Innovations"])
def test_the_outage_is_shaded_in_every_panel(title: str) -> None:
    made = unchanged(title)
    for panel in panels(made):
        (strip,) = drawn(panel, VStrip)
        assert [list(strip.data_source.data[name]) for name in "xy"] == [[LOST[0]], [LOST[1]]]
    assert legend(made)[-1] == "satellites lost"


def test_a_method_has_one_colour_in_every_picture() -> None:
    for title in ("Track", "How large the errors are", "Errors by component", "Velocity and attitude"):
        for panel in panels(unchanged(title)):
            for colour in COLOURS.values():
                assert drawn(panel, Line, colour) or (label(panel) == "north [m]" and title == "Track")


# ------------------------------------------------------------------------------------------------- track


def test_the_map_is_in_metres_over_the_ground() -> None:
    whole, _, _ = panels(unchanged("Track"))
    assert whole.match_aspect
    (truth,) = [r for r in drawn(whole, Line) if r.glyph.line_dash == [3, 3]]
    end = [1e3 * truth.data_source.data[name][-1] for name in "xy"]
    # The map takes cos(latitude) where it is, the tables that of the start: (4.2 km)^2 tan(58°) / R = 4.5 m
    expected = [SPEED * LENGTH * np.sin(HEADING), SPEED * LENGTH * np.cos(HEADING)]
    assert end == pytest.approx(expected, abs=5.0)


def test_the_way_without_satellites_is_a_band_under_the_track() -> None:
    whole, near, _ = panels(unchanged("Track"))
    (band,) = [r for r in drawn(whole, Line) if r.glyph.line_width > 10]
    x = 1e3 * np.asarray(band.data_source.data["x"])
    step = SPEED * np.sin(HEADING)  # the truth is drawn by the second
    assert [x[0], x[-1]] == pytest.approx([s * step for s in LOST], abs=1.01 * step)
    assert whole.renderers.index(band) < min(whole.renderers.index(r) for r in drawn(whole, Scatter)[1:2])
    # the second map goes as far as the loops are off where the satellites come back
    (frame,) = [r for r in drawn(near, Scatter) if r.glyph.size == 0]
    width = np.ptp(frame.data_source.data["x"])
    assert width == pytest.approx(2 * 1.6 * size("loops", np.array([LOST[1] - STEP]))[0], rel=0.05)


def test_the_map_shows_the_fixes_and_where_it_starts_and_ends() -> None:
    whole, _, height = panels(unchanged("Track"))
    assert [r.data_source.data["word"][0] for r in drawn(whole, Text)] == ["start", "end"]
    assert legend(unchanged("Track")) == ["fixes", *METHODS, "truth", "satellites lost"]
    (dots,) = drawn(height, Scatter)
    assert np.asarray(dots.data_source.data["y"]) == pytest.approx(HEIGHT)


def test_a_body_at_rest_has_no_end_of_its_own(tables: dict[str, pa.Table]) -> None:
    table = tables["truth_position"]
    still = {name: np.full(table.num_rows, table[name][0].as_py()) for name in ("latitude", "longitude")}
    tables["truth_position"] = changed("truth_position", table, **still)
    tables["navigation"] = changed(
        "navigation",
        tables["navigation"],
        **{name: np.full(tables["navigation"].num_rows, value[0]) for name, value in still.items()},
    )
    whole, *_ = panels(section(tables, "Track"))
    assert [r.data_source.data["word"][0] for r in drawn(whole, Text)] == ["start"]
    assert label(whole) == "north [m]"


def test_a_track_may_cross_the_meridian_of_180_degrees(tables: dict[str, pa.Table]) -> None:
    for name in ("navigation", "truth_position", "gnss_position"):
        moved = tables[name]["longitude"].to_numpy() + np.pi - 39.02 * DEG
        wrapped = np.pi - np.mod(np.pi - moved, 2 * np.pi)
        assert np.ptp(wrapped) > 6  # it does cross
        tables[name] = changed(name, tables[name], longitude=wrapped)
    whole, *_ = panels(section(tables, "Track"))
    (frame,) = [r for r in drawn(whole, Scatter) if r.glyph.size == 0]
    assert np.ptp(frame.data_source.data["x"]) < 6.0  # km, not 40000


# ---------------------------------------------------------------------------------------------- aids


def test_an_aid_has_a_bar_while_it_is_used() -> None:
    (panel,) = panels(unchanged("What aids"))
    names = [word.text for word in panel.yaxis[0].major_label_overrides.values()]
    assert names == ["inertial samples", "position", "velocity", "air speed", "height", "magnetic field"]
    position = next(
        r for r in drawn(panel, Quad, COLOURS["loops"]) if abs(r.data_source.data["top"][0] - 1) < 0.5
    )
    assert list(position.data_source.data["x"]) == [0.0, LOST[1]]
    assert list(position.data_source.data["y"]) == [LOST[0], LENGTH]
    inertial = drawn(panel, Quad)[-1]
    assert list(inertial.data_source.data["y"]) == [50.0, LENGTH]  # bridged from 50 s to 51 s
    assert list(inertial.data_source.data["x"]) == [0.0, 51.0]


# ------------------------------------------------------------------------------------------------ errors


def test_the_size_of_an_error_is_its_root_mean_square() -> None:
    panel = panels(unchanged("How large the errors are"))[0]
    solid = [r for r in drawn(panel, Line) if r.glyph.line_width > 1.5]
    for method, curve in zip(METHODS, solid, strict=True):
        for time in (30.0, 130.0, 250.0):
            # within 1.5 s the size bends by (1.5/30)^2 at most; the sample nearest may be 0.5 s away: 3 %
            assert at(curve, time) == pytest.approx(size(method, np.array([time]))[0], rel=0.03)


def test_a_stated_deviation_is_dotted() -> None:
    panel = panels(unchanged("How large the errors are"))[0]
    said = [r for r in drawn(panel, Line) if r.glyph.line_width == 1.0]
    assert [r.glyph.line_color for r in said] == [COLOURS["filter"], COLOURS["smoother"]]
    # north and east together
    assert at(said[0], 50.0) == pytest.approx(np.sqrt(2) * size("filter", np.array([50.0]))[0])


def test_a_scale_of_decades_holds_what_is_corrected() -> None:
    panel = panels(unchanged("How large the errors are"))[0]
    assert panel.y_range.start < 0.3  # the smoother's
    assert panel.y_range.end > size("loops", np.array([LOST[1] - STEP]))[0]
    assert panel.y_range.end / panel.y_range.start < 1e6


def test_the_table_has_the_figures_of_each_phase(tables: dict[str, pa.Table]) -> None:
    below = unchanged("How large the errors are").below
    assert below.count("<tr>") == 1 + 3 * len(METHODS)
    assert all(below.count(f">{phase}<") == 1 for phase in ("aided", "outage", "reacquired"))
    (value,) = [
        row["value"]
        for row in tables["metrics"].to_pylist()
        if (row["channel"], row["name"]) == ("filter.outage", "horizontal_position_rms")
    ]
    assert f"title={value!r}" in below


@pytest.mark.parametrize(("place", "name", "unit"), [(0, "position_north", 1.0), (4, "velocity_east", 1.0)])
def test_a_curve_is_the_error_of_its_component(place: int, name: str, unit: float) -> None:
    panel = panels(unchanged("Errors by component"))[place]
    for method, colour in COLOURS.items():
        (curve,) = drawn(panel, Line, colour)
        x, y = (np.asarray(curve.data_source.data[axis]) for axis in "xy")
        # Thinned to extremes, a curve consists of samples. Sines near 0 of 9000 m hold to 1e-9 m.
        assert y == pytest.approx(errors(method, x)[name] / unit, abs=1e-9)
        assert len(x) > 300


def test_the_band_is_three_sigma_of_a_method_that_states_one() -> None:
    panel = panels(unchanged("Errors by component"))[0]
    assert [r.glyph.fill_color for r in drawn(panel, VArea)] == [COLOURS["filter"], COLOURS["smoother"]]
    data = drawn(panel, VArea)[0].data_source.data
    last = np.searchsorted(data["x"], LOST[1] - STEP)
    assert data["high"][last] == pytest.approx(3 * size("filter", np.array([LOST[1] - STEP]))[0], rel=0.05)
    assert np.asarray(data["low"]) == pytest.approx(-np.asarray(data["high"]))


def test_the_scale_shows_the_whole_band_and_strapdown_leaves_it() -> None:
    panel = panels(unchanged("Errors by component"))[0]
    widest = 3 * size("filter", np.array([LOST[1] - STEP]))[0]
    assert widest < panel.y_range.end < 3 * widest
    assert panel.y_range.start == -panel.y_range.end


def test_without_a_stated_deviation_the_loops_set_the_scale(tables: dict[str, pa.Table]) -> None:
    alone = without(without(tables, "filter"), "smoother")
    panel = panels(section(alone, "Errors by component"))[0]
    t = instants()
    largest = np.abs(errors("loops", t)["position_north"][t >= 0.1 * LENGTH]).max()
    assert panel.y_range.end == pytest.approx(1.1 * largest)
    assert not drawn(panel, VArea)


def test_errors_before_there_is_truth_are_left_open(tables: dict[str, pa.Table]) -> None:
    table = tables["navigation_errors"]
    value = table["position_north"].to_numpy().copy()
    value[table["time"].to_numpy() < START + 20 * 10**9] = np.nan
    tables["navigation_errors"] = changed("navigation_errors", table, position_north=value)
    (curve,) = drawn(panels(section(tables, "Errors by component"))[0], Line, COLOURS["filter"])
    x, y = (np.asarray(curve.data_source.data[name]) for name in "xy")
    assert np.isnan(y[x < 20.0]).all()
    assert np.isfinite(y[x >= 20.0]).all()


# ------------------------------------------------------------------------------------------------ states


def test_states_are_beside_fixes_and_truth() -> None:
    made = unchanged("Velocity and attitude")
    assert legend(made) == ["fixes", *METHODS, "truth", "satellites lost"]
    assert [label(p) for p in panels(made)] == [
        "north [m/s]",
        "yaw [°]",
        "east [m/s]",
        "pitch [°]",
        "down [m/s]",
        "roll [°]",
    ]
    (dots,) = drawn(panels(made)[0], Scatter)
    assert np.asarray(dots.data_source.data["y"]) == pytest.approx(SPEED * np.cos(HEADING))


def test_a_yaw_that_passes_south_is_interrupted_there(tables: dict[str, pa.Table]) -> None:
    table = tables["navigation"]
    turning = np.mod((table["time"].to_numpy() - START) * 1e-9 * 3 * DEG + np.pi, 2 * np.pi) - np.pi
    tables["navigation"] = changed("navigation", table, yaw=turning)
    (curve,) = drawn(panels(section(tables, "Velocity and attitude"))[1], Line, COLOURS["filter"])
    y = np.asarray(curve.data_source.data["y"])
    assert np.count_nonzero(np.isnan(y)) == 3  # 900 degrees: at 60 s, 180 s and 300 s
    assert np.nanmax(np.abs(np.diff(y))) < 10


# ------------------------------------------------------------------------------------------------ biases


def test_biases_run_to_the_value_that_the_plan_says() -> None:
    made = unchanged("Biases")
    names = [label(p) for p in panels(made)]
    assert names[:6] == [
        "forward [°/s]",
        "forward [m/s²]",
        "right [°/s]",
        "right [m/s²]",
        "down [°/s]",
        "down [m/s²]",
    ]
    assert [heading(p) for p in panels(made)[6:]] == [["wind north"], ["wind east"], ["barometer"]]
    expected = [value for pair in zip(GYRO_BIAS, ACCELEROMETER_BIAS, strict=True) for value in pair]
    for panel, true in zip(panels(made), expected, strict=False):
        (line,) = [r for r in drawn(panel, Line) if r.glyph.line_dash == [5, 4]]
        assert np.asarray(line.data_source.data["y"]) == pytest.approx(true)
        assert panel.y_range.start < true < panel.y_range.end
    (filtered,) = drawn(panels(made)[0], Line, COLOURS["filter"])
    assert at(filtered, 60.0) == pytest.approx(biases("filter", np.array([60.0]))["gyro_bias_x"][0] / DEG)


def test_without_a_known_bias_no_line_is_drawn(tables: dict[str, pa.Table]) -> None:
    tables["provenance"] = navigation_provenance({"gyro_bias_deg_s": None, "settling_s": 180.0})
    made = section(tables, "Biases")
    assert "true" not in legend(made)
    assert "Dashed" not in made.text


def test_small_biases_are_in_small_units(tables: dict[str, pa.Table]) -> None:
    table = tables["navigation"]
    small = {
        c: table[c].to_numpy() * 1e-3 for c in table.column_names if c.removeprefix("sigma_")[:8] in NAMES
    }
    tables["navigation"] = changed("navigation", table, **small)
    tables["provenance"] = navigation_provenance({})
    made = panels(section(tables, "Biases"))
    assert [label(p) for p in made[:2]] == ["forward [°/h]", "forward [mm/s²]"]
    (filtered,) = drawn(made[0], Line, COLOURS["filter"])
    assert at(filtered, LENGTH) == pytest.approx(GYRO_BIAS[0] * 3.6, rel=1e-3)  # 1 - exp(-15) of it


NAMES = ("gyro_bia", "accelero")


def test_what_no_method_estimates_has_no_panel(tables: dict[str, pa.Table]) -> None:
    table = tables["navigation"]
    none = np.full(table.num_rows, np.nan)
    gone = [c for c in table.column_names if "wind" in c or "barometer" in c]
    tables["navigation"] = changed("navigation", table, **dict.fromkeys(gone, none))
    assert len(panels(section(tables, "Biases"))) == 6


# ------------------------------------------------------------------------------------------------- poles


def test_the_pole_map_has_both_planes() -> None:
    left, right = panels(unchanged("Poles of the loops"))
    found = velocity_poles()
    for panel, expected in ((left, found), (right, np.exp(found))):
        (marks,) = [r for r in drawn(panel, Scatter) if r.glyph.marker == "x"]
        shown = marks.data_source.data["x"] + 1j * np.asarray(marks.data_source.data["y"])
        assert np.sort_complex(shown) == pytest.approx(np.sort_complex(expected))
    assert heading(left) == ["velocity by satellites"]
    assert heading(right) == [f"radius {np.abs(np.exp(found)).max():.4f}"]


def test_the_circle_is_one_and_the_lines_are_of_constant_damping() -> None:
    left, right = panels(unchanged("Poles of the loops"))
    (circle,) = [r for r in drawn(right, Line) if r.glyph.line_width > 1]
    assert np.hypot(circle.data_source.data["x"], circle.data_source.data["y"]) == pytest.approx(1.0)
    for line, zeta in zip(drawn(left, Line)[::2], (0.2, 0.5, 0.8), strict=False):
        x, y = (np.asarray(line.data_source.data[name])[-1] for name in "xy")
        assert -x / np.hypot(x, y) == pytest.approx(zeta)
    for line, zeta in zip(drawn(right, Line)[:-1:2], (0.2, 0.5, 0.8), strict=False):
        z = line.data_source.data["x"][200] + 1j * line.data_source.data["y"][200]
        s = np.log(z)
        assert -s.real / abs(s) == pytest.approx(zeta)


def test_poles_that_are_sampled_often_are_shown_from_near_by(tables: dict[str, pa.Table]) -> None:
    tables["poles"] = from_rows("poles", pole_rows("attitude", velocity_poles(), 0.01))
    (frame,) = [
        r for r in drawn(panels(section(tables, "Poles of the loops"))[1], Scatter) if r.glyph.size == 0
    ]
    x = frame.data_source.data["x"]
    assert 0.9 < x[0] < 1.0 < x[1] < 1.1


def test_a_pole_that_is_not_stable_is_red(tables: dict[str, pa.Table]) -> None:
    found = velocity_poles(k_n=2.0)  # the limit is 4/3
    tables["poles"] = from_rows("poles", pole_rows("velocity by satellites", found, 1.0))
    left, right = panels(section(tables, "Poles of the loops"))
    for panel in (left, right):
        red = [r for r in drawn(panel, Scatter) if r.glyph.line_color == "#b3261e"]
        assert [len(r.data_source.data["x"]) for r in red] == [2]


def test_loops_of_the_same_poles_are_drawn_once(tables: dict[str, pa.Table]) -> None:
    rows = [
        *pole_rows("position and velocity by satellites", velocity_poles(), 1.0),
        *pole_rows("height by barometer, velocity by satellites", velocity_poles()[::-1], 1.0),
        *pole_rows("height by barometer, velocity by air data", velocity_poles(0.1), 1.0),
    ]
    tables["poles"] = from_rows("poles", rows)
    made = panels(section(tables, "Poles of the loops"))
    assert [" ".join(heading(p)).strip() for p in made[::2]] == [
        "by satellites position and velocity",
        "velocity by air data height by barometer,",
    ]


def test_limits_stand_below_the_map(tables: dict[str, pa.Table]) -> None:
    rows = loop_rows("attitude<", k_n=(0.02, "1/s"), k_n_limit=(None, "1/s"), damping=(0.66, "1"))
    tables["loops"] = pa.concat_tables([tables["loops"], from_rows("loops", rows)])
    below = section(tables, "Poles of the loops").below
    assert f"title={4 / 3!r}>1.333</td>" in below
    assert "attitude&lt;" in below
    assert "∞" in below
    assert below.count("<td></td>") == 1  # the first has no damping


def test_the_noise_of_an_attitude_s_loop_has_its_own_column(tables: dict[str, pa.Table]) -> None:
    rows = loop_rows("attitude", noise_attitude_by_attitude=(0.125, "(rad)/(rad)"))
    tables["loops"] = from_rows("loops", rows)
    below = section(tables, "Poles of the loops").below
    assert "U by U</th>" in below
    assert "title=0.125>0.125</td>" in below


# ------------------------------------------------------------------------------------------- innovations


def test_innovations_are_those_of_the_filter_over_their_sigma(tables: dict[str, pa.Table]) -> None:
    made = panels(unchanged("Innovations"))
    assert [" ".join(heading(p)) for p in made] == [
        *(f"position {axis} (1.2), 2 refused" for axis in NED),
        *(f"velocity {axis}" for axis in NED),
        "height",
    ]
    table = tables["innovations"]
    mine = table.filter(
        pc.and_(
            pc.and_(pc.equal(table["method"], "filter"), pc.equal(table["aid"], "velocity")),
            pc.equal(table["component"], "east"),
        )
    )
    (dots,) = drawn(made[4], Scatter)
    ratio = mine["value"].to_numpy() / mine["sigma"].to_numpy()
    assert np.asarray(dots.data_source.data["y"]) == pytest.approx(ratio)


def test_refused_measurements_are_crosses_at_their_time() -> None:
    panel = panels(unchanged("Innovations"))[0]
    (crosses,) = [r for r in drawn(panel, Scatter) if r.glyph.marker == "x"]
    assert list(crosses.data_source.data["x"]) == pytest.approx(fixes()[list(REFUSED)])
    first, second = crosses.data_source.data["y"]
    assert first < panel.y_range.end  # 30 sigma: at the edge
    assert first == pytest.approx(0.96 * panel.y_range.end)
    assert second == pytest.approx(max(-4.0, -first))


def test_many_dots_are_thinned_evenly_but_for_the_refused(tables: dict[str, pa.Table]) -> None:
    rng = np.random.default_rng(2)
    n = 5000
    accepted = np.ones(n, dtype=bool)
    accepted[2500] = False
    columns = {
        "time": START + np.linspace(0, LENGTH * 1e9, n).astype(np.int64),
        "method": ["filter"] * n,
        "aid": ["altitude"] * n,
        "component": ["altitude"] * n,
        "value": rng.standard_normal(n),
        "sigma": np.ones(n),
        "unit": ["m"] * n,
        "normalised_squared": np.ones(n),
        "accepted": accepted,
    }
    tables["innovations"] = contracts.table("innovations", columns)
    (panel,) = panels(section(tables, "Innovations"))
    dots, crosses = drawn(panel, Scatter)
    assert len(dots.data_source.data["x"]) == 600
    # of 600 normal numbers the standard deviation is known to 3 %; the extremes of columns would have 2
    assert np.std(dots.data_source.data["y"]) == pytest.approx(1.0, abs=0.12)
    assert len(crosses.data_source.data["x"]) == 1
