"""One look for all figures: colours that everybody can tell apart, plain axes, units on every one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from bokeh.core import properties
from bokeh.layouts import gridplot
from bokeh.models import (
    Axis,
    BasicTicker,
    BoxZoomTool,
    ColumnDataSource,
    DataRange1d,
    GridPlot,
    HoverTool,
    LinearAxis,
    PanTool,
    PlainText,
    Range1d,
    ResetTool,
    SaveTool,
    WheelZoomTool,
)
from bokeh.models.annotations import Label, Legend, LegendItem, Span, Title
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from numpy.typing import NDArray

from pipeline.report.decimate import min_max

# Okabe & Ito (2008), darkened where the original is too light for a line on white.
BLUE, VERMILION, GREEN, BLACK, PALE = "#0067a5", "#d1520a", "#00805e", "#23272e", "#b4bbc5"
SEVERITY = {"error": "#b3261e", "warning": "#c77700", "info": "#5b7083"}

COLUMNS = 1200
"""Columns of pixels to which a curve is thinned: the width of the page."""

FONT = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', 'DejaVu Sans', Arial, sans-serif"
INK, _GRID = "#3d4450", "#e8ebef"


Drawn: TypeAlias = "GlyphRenderer[Any]"
"""What a curve has become; a legend can hide it."""


def span(start: float, end: float) -> Range1d:
    """A range of an axis; panels that share one are moved and zoomed together."""
    return Range1d(start=start, end=end)


def plain(text: str) -> PlainText:
    """A label that is never taken for a formula, whatever it holds."""
    return PlainText(text=text)


def panel(
    label: str,
    x_range: Range1d,
    *,
    height: int = 150,
    x_label: str | None = None,
    ticks: int = 10,
    logarithmic: bool = False,
    x_logarithmic: bool = False,
) -> figure:
    """An empty figure with zoom along x alone; without ``x_label`` it stands above another that has one."""
    zoom = BoxZoomTool(dimensions="width")
    tools = [PanTool(dimensions="width"), zoom, WheelZoomTool(dimensions="width"), ResetTool(), SaveTool()]
    made = figure(
        height=height + (38 if x_label else 0),
        x_range=x_range,
        x_axis_type="log" if x_logarithmic else "linear",
        y_axis_type="log" if logarithmic else "linear",
        tools=tools,
        active_drag=zoom,
        active_scroll=None,
        sizing_mode="stretch_width",
        min_border_left=112,
        min_border_right=12,
        min_border_top=8,
        min_border_bottom=8,
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color="#c9ced6",
    )
    made.toolbar.logo = None
    made.yaxis.axis_label = plain(label)
    if x_label is None:
        made.xaxis.major_label_text_font_size = "0px"
    else:
        made.xaxis.axis_label = plain(x_label)
    if not x_logarithmic:
        made.xaxis.ticker = BasicTicker(desired_num_ticks=ticks)
    if not logarithmic:
        made.yaxis.ticker = BasicTicker(desired_num_ticks=4)
    _dress(made)
    return made


def plane(x_label: str, y_label: str, *, height: int, equal: bool) -> figure:
    """An empty figure of two like quantities, with zoom along both; ``equal`` gives them one scale."""
    made = panel(y_label, span(0.0, 1.0), height=height, x_label=x_label, ticks=6)
    made.x_range = DataRange1d(range_padding=0.06)
    made.match_aspect = equal
    zoom = BoxZoomTool(match_aspect=equal)
    made.tools = [PanTool(), zoom, WheelZoomTool(), ResetTool(), SaveTool()]
    made.toolbar.active_drag = zoom
    made.yaxis.ticker = BasicTicker(desired_num_ticks=6)
    return made


def frame(made: figure, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Let a plane show at least this; of one scale for both, one range goes farther.

    The ranges follow points at the corners, since Bokeh keeps only ranges that follow data to one scale.
    """
    source = ColumnDataSource({"x": list(x), "y": list(y)})
    corners = made.scatter("x", "y", source=source, size=0, fill_alpha=0.0, line_alpha=0.0)
    made.x_range = DataRange1d(renderers=[corners], range_padding=0.0)
    made.y_range = DataRange1d(renderers=[corners], range_padding=0.0)


def curve(
    made: figure,
    time: NDArray[np.float64],
    value: NDArray[np.float64],
    colour: str,
    *,
    gap: float = np.inf,
    width: float = 1.3,
    dash: str = "solid",
    columns: int = COLUMNS,
) -> Drawn:
    """Draw a curve, thinned to the page or to fewer columns of pixels; ``gap`` as in `decimate.min_max`."""
    x, y = min_max(time, value, columns, gap)
    return made.line(
        "x",
        "y",
        source=_source(x, y),
        line_color=colour,
        line_alpha=0.85,
        line_width=width,
        line_dash=dash,
        line_join="round",
    )


def dots(
    made: figure, time: NDArray[np.float64], value: NDArray[np.float64], colour: str, *, size: int = 6
) -> Drawn:
    """Draw single samples."""
    source = _source(time, value)
    return made.scatter(
        "x", "y", source=source, size=size, fill_color="white", line_color=colour, line_width=1.6
    )


def marker(made: figure, time: float, word: str) -> None:
    """Mark a moment by a vertical line with a word beside it."""
    made.add_layout(Span(location=time, dimension="height", line_color=BLACK, line_width=1, line_dash="4 3"))
    made.add_layout(
        Label(
            x=time,
            y=6,
            y_units="screen",
            x_offset=6,
            text=plain(word),
            text_font=FONT,
            text_font_size="12px",
            text_color=INK,
        )
    )


def rows(made: figure, left: Sequence[str], right: Sequence[str] = ()) -> None:
    """Rows of a panel instead of a vertical scale, from the top down, with words at either side."""
    made.y_range = span(len(left) - 0.4, -0.6)
    made.ygrid.grid_line_color = None
    made.yaxis.axis_label = None
    made.yaxis.major_label_overrides = {i: plain(word) for i, word in enumerate(left)}
    if right:
        axis = LinearAxis(major_label_overrides={i: plain(word) for i, word in enumerate(right)})
        made.add_layout(axis, "right")
        _dress_axis(axis)
        axis.major_tick_out = 0
        axis.major_label_text_font_size = "12px"
    made.yaxis.ticker = list(range(len(left)))


def words(
    made: figure,
    source: ColumnDataSource,
    x: str,
    y: str,
    text: str,
    *,
    colour: str = INK,
    align: Literal["left", "center", "right"] = "left",
    drop: int = 0,
) -> Drawn:
    """Words of a column, shown as they are, at points of a panel: from them on, centred, or up to them.

    ``drop`` shifts them down by pixels.
    """
    return made.text(
        x,
        y,
        text=text,
        source=source,
        text_font=properties.value(FONT),
        text_font_size="12px",
        text_color=colour,
        text_baseline="middle",
        text_align=align,
        x_offset={"left": 9, "center": 0, "right": -9}[align],
        y_offset=drop,
    )


def heading(made: figure, word: str) -> None:
    """A few words above a panel."""
    made.add_layout(
        Title(text=plain(word), text_font=FONT, text_font_size="13px", text_color=INK, align="center"),
        "above",
    )
    make_room(made, 22)


def legend(made: figure, items: Sequence[tuple[str, Sequence[Drawn]]]) -> None:
    """A legend above the figure; a click hides or shows what an item names, in every figure."""
    made.add_layout(
        Legend(
            items=[LegendItem(label=label, renderers=list(lines)) for label, lines in items if lines],
            orientation="horizontal",
            click_policy="hide",
            location="left",
            border_line_color=None,
            background_fill_color=None,
            label_text_font=FONT,
            label_text_font_size="13px",
            label_text_color=INK,
            glyph_width=26,
            spacing=18,
            margin=2,
        ),
        "above",
    )
    make_room(made, 30)


def strip(items: Mapping[str, Sequence[Drawn]], border: int) -> figure:
    """A legend without a frame, for panels side by side, whose frames begin ``border`` pixels from the left.

    What it shows beside a name is drawn in it once more, out of its sight; of markers that differ from point
    to point (field ``shape``) a circle.
    """
    made = figure(
        height=1,
        x_range=span(-2.0, -1.0),
        y_range=span(-2.0, -1.0),
        toolbar_location=None,
        sizing_mode="stretch_width",
        min_border=0,
        min_border_left=border,
        outline_line_color=None,
    )
    made.axis.visible = made.grid.visible = False
    point = ColumnDataSource({"x": [0.0], "y": [0.0], "shape": ["circle"]})
    own = {word: made.add_glyph(point, drawn[0].glyph) for word, drawn in items.items()}
    legend(made, [(word, [own[word], *drawn]) for word, drawn in items.items()])
    return made


def grid(rows: Sequence[Sequence[figure | None]]) -> GridPlot:
    """Figures in rows and columns under one toolbar."""
    return gridplot(
        [list(row) for row in rows],
        sizing_mode="stretch_width",
        merge_tools=True,
        toolbar_location="right",
        toolbar_options={"logo": None},
    )


def hover(made: figure, on: Drawn, fields: Sequence[tuple[str, str]]) -> None:
    """Show fields of the data source where the pointer is, as plain text."""
    tooltips = [(name, f"@{{{field}}}") for name, field in fields]
    made.add_tools(HoverTool(renderers=[on], tooltips=tooltips, visible=False))


def _source(x: NDArray[np.float64], y: NDArray[np.float64]) -> ColumnDataSource:
    """The data of a glyph. One that Bokeh makes by itself has its columns in no fixed order."""
    return ColumnDataSource({"x": x, "y": y})


def make_room(made: figure, pixels: int) -> None:
    """Let what stands above the frame take nothing from it."""
    made.height = (made.height or 0) + pixels


def _dress(made: figure) -> None:
    for axis in (*made.xaxis, *made.yaxis):
        _dress_axis(axis)
    made.yaxis.major_label_text_font_size = "12px"
    if made.xaxis.axis_label is not None:
        made.xaxis.major_label_text_font_size = "12px"
    made.grid.grid_line_color = _GRID


def _dress_axis(axis: Axis) -> None:
    axis.axis_label_text_font = axis.major_label_text_font = FONT
    axis.axis_label_text_font_size = "13px"
    axis.axis_label_text_font_style = "normal"
    axis.axis_label_text_color = axis.major_label_text_color = INK
    axis.axis_line_color = None
    axis.minor_tick_line_color = None
    axis.major_tick_line_color = "#9aa1ac"
    axis.major_tick_in = 0
    axis.major_tick_out = 4
