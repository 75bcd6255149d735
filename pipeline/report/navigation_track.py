"""The way over the ground, by every method, and where the satellites were lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure

from pipeline.report import style
from pipeline.report.base import Clock, Section, Tables, column, times
from pipeline.report.navigation_panels import (
    AMBER,
    BORDER,
    FIX,
    LOST,
    METHODS,
    Board,
    Ends,
    drawn,
    extent,
    methods,
    outages,
)
from pipeline.report.series import Floats
from pipeline.report.style import BLACK, Drawn

_RADIUS, _FLATTENING = (
    6378137.0,
    1 / 298.257223563,
)  # WGS-84; the models have it too, the report has storage alone
_LINE = 1500  # points of a way
_FIXES = 90  # that can be told apart on it
_FAR = 3000.0  # m; a wider map is in km
_NEAR = 1.6  # times the farthest error at an outage's end, to which the second map reaches
_SMALLEST = 5.0  # m, half its height at least
_CLOSED = 0.03  # of the track's size: an end so near to the start has no word of its own
_LARGEST = 0.2  # of the whole map, half its height at most


class Way(NamedTuple):
    """Places over the ground and above it from the start [m], with their times [s]; each (n,)."""

    time: Floats
    east: Floats
    north: Floats
    height: Floats

    def within(self, start: float, end: float) -> Way:
        """The part from one time to another."""
        kept = (self.time >= start) & (self.time <= end)
        return Way(*(one[kept] for one in self))

    def at(self, time: float) -> Floats:
        """East and north at a time, shape (2,)."""
        return np.array([np.interp(time, self.time, one) for one in (self.east, self.north)])

    def thinned(self, most: int) -> Way:
        """At most so many of the places, the first and the last among them."""
        kept = np.unique(
            np.linspace(0, len(self.time) - 1, min(len(self.time), most)).round().astype(np.int64)
        )
        return Way(*(one[kept] for one in self))


class Ways(NamedTuple):
    """Every way there is: of the methods, the truth, the fixes; and the one that stands for all."""

    methods: dict[str, Way]
    truth: Way | None
    fixes: Way | None
    lost: list[Ends]

    @property
    def leading(self) -> Way:
        """The truth; without it the way of the best method."""
        return self.truth or next(self.methods[m] for m in reversed(tuple(METHODS)) if m in self.methods)

    @property
    def corrected(self) -> dict[str, Way]:
        """The methods that stay near: all but strapdown, where there are others."""
        others = {method: way for method, way in self.methods.items() if method != "strapdown"}
        return others or self.methods


def track(tables: Tables) -> Section | None:
    """A map of the whole track, one of where the last outage ends, and the height over time."""
    board = Board.of(tables)
    ways = None if board is None else _ways(tables, board.clock)
    if ways is None or board is None:
        return None
    whole = [ways.leading, *ways.corrected.values()]
    east, north = extent([way.east for way in whole]), extent([way.north for way in whole])
    size = max(east[1] - east[0], north[1] - north[0])
    maps = [_whole(ways, board, east, north), *_near(ways, board, size)]
    _height(tables, board, ways)
    lost = " The amber band marks the track without satellites." if ways.lost else ""
    near = " The right-hand map shows where the last outage ends." if len(maps) > 1 else ""
    return Section(
        "Track",
        f"East and north from the start, on one scale.{lost}{near} Below: the height.",
        board.arranged(style.grid([maps])),
    )


def _ways(tables: Tables, clock: Clock) -> Ways | None:
    found = methods(tables, "navigation")
    if not found:
        return None
    first = found[0]
    origin = (float(first["latitude"][0]), float(first["longitude"][0]), float(first["height"][0]))
    of_methods = {
        rows.method: _way((rows.time, rows["latitude"], rows["longitude"], rows["height"]), origin)
        for rows in found
    }
    truth, fixes = (_recorded(tables, name, clock, origin) for name in ("truth_position", "gnss_position"))
    return Ways(of_methods, truth, fixes, outages(tables))


def _recorded(tables: Tables, name: str, clock: Clock, origin: tuple[float, float, float]) -> Way | None:
    """The way of a stream while the navigation lasts; None where it has fewer than two places."""
    table = tables.get(name)
    if table is None or not table.num_rows:
        return None
    time = clock.seconds(times(table))
    latitude, longitude, height = (column(table, c) for c in ("latitude", "longitude", "height"))
    kept = (time >= 0.0) & (time <= clock.duration) & np.isfinite(latitude + longitude + height)
    order = np.argsort(time[kept], kind="stable")
    if len(order) < 2:
        return None
    places = (time[kept], latitude[kept], longitude[kept], height[kept])
    return _way(tuple(one[order] for one in places), origin)


def _way(places: tuple[Floats, ...], origin: tuple[float, float, float]) -> Way:
    """Times, latitudes, longitudes [rad] and heights as a map about the origin, by its radii of curvature."""
    time, latitude, longitude, height = places
    square = _FLATTENING * (2 - _FLATTENING)
    curvature = 1 - square * np.sin(origin[0]) ** 2
    meridian = _RADIUS * (1 - square) / curvature**1.5 + origin[2]
    vertical = _RADIUS / np.sqrt(curvature) + origin[2]
    turned = np.pi - np.mod(np.pi - (longitude - origin[1]), 2 * np.pi)
    return Way(time, turned * vertical * np.cos(latitude), (latitude - origin[0]) * meridian, height)


def _whole(ways: Ways, board: Board, east: Ends, north: Ends) -> figure:
    far = max(east[1] - east[0], north[1] - north[0]) > _FAR
    unit, word = (1e3, "km") if far else (1.0, "m")
    made = _map(word)
    style.frame(made, (east[0] / unit, east[1] / unit), (north[0] / unit, north[1] / unit))
    _draw(made, board, ways, unit)
    _ends(made, ways.leading, unit)
    return made


def _near(ways: Ways, board: Board, size: float) -> list[figure]:
    """The last outage's end: the methods are apart there, and come back.

    Nothing where none ends, or where the whole map, of a size [m], is not much larger.
    """
    ended = [end for _, end in ways.lost if end < ways.leading.time[-1]]
    if not ended:
        return []
    # The last row before: at the end itself a method may already have the fix.
    time = next(iter(ways.corrected.values())).time
    last = float(time[max(int(np.searchsorted(time, ended[-1])) - 1, 0)])
    here = ways.leading.at(last)
    apart = max(float(np.hypot(*(way.at(last) - here))) for way in ways.corrected.values())
    reach = max(_NEAR * apart, _SMALLEST)
    if reach > _LARGEST * size:
        return []
    made = _map("m")
    style.frame(made, (here[0] - reach, here[0] + reach), (here[1] - reach, here[1] + reach))
    corners = [here - 3 * reach, here + 3 * reach]
    _draw(made, board, Ways(ways.corrected, ways.truth, ways.fixes, ways.lost), 1.0, inside=corners)
    return [made]


def _map(unit: str) -> figure:
    made = style.plane(f"east [{unit}]", f"north [{unit}]", height=440, equal=True)
    made.min_border_left = BORDER
    return made


def _draw(
    made: figure, board: Board, ways: Ways, unit: float, inside: Sequence[Floats] | None = None
) -> None:
    """Everything on one map, the outages under all; with ``inside`` only what is between two corners."""

    def near(way: Way) -> Way:
        if inside is None:
            return way
        (left, bottom), (right, top) = inside
        kept = (way.east > left) & (way.east < right) & (way.north > bottom) & (way.north < top)
        return Way(*(one[kept] for one in way))

    for ends in ways.lost:
        part = near(ways.leading.within(*ends))
        board.note(LOST, _line(made, part, unit, AMBER, 14.0, alpha=0.35))
    if ways.fixes is not None:
        fixes = near(ways.fixes).thinned(_FIXES)
        board.note("fixes", style.dots(made, fixes.east / unit, fixes.north / unit, FIX, size=6))
    for method, way in ways.methods.items():
        board.note(method, _line(made, near(way), unit, METHODS[method], 2.0))
    if ways.truth is not None:
        board.note("truth", _line(made, near(ways.truth), unit, BLACK, 1.3, dash="3 3"))


def _line(
    made: figure, way: Way, unit: float, colour: str, width: float, *, alpha: float = 0.9, dash: str = "solid"
) -> Drawn:
    way = way.thinned(_LINE)
    source = ColumnDataSource({"x": way.east / unit, "y": way.north / unit})
    return made.line(
        "x",
        "y",
        source=source,
        line_color=colour,
        line_width=width,
        line_alpha=alpha,
        line_dash=dash,
        line_join="round",
    )


def _ends(made: figure, way: Way, unit: float) -> None:
    """Start and end of the track; their words stand towards its middle. A closed one has a start."""
    middle = (way.east.min() + way.east.max()) / 2
    size = max(np.ptp(way.east), np.ptp(way.north))
    closed = np.hypot(way.east[-1] - way.east[0], way.north[-1] - way.north[0]) <= _CLOSED * size
    for place, word, shape in ((0, "start", "circle"), (-1, "end", "square"))[: 1 if closed else 2]:
        x, y = way.east[[place]] / unit, way.north[[place]] / unit
        source = ColumnDataSource({"x": x, "y": y, "word": [word]})
        made.scatter("x", "y", source=source, marker=shape, size=10, fill_color=BLACK, line_color="white")
        side: Literal["left", "right"] = "right" if way.east[place] > middle else "left"
        onwards = way.north[-1] >= way.north[0]
        style.words(made, source, "x", "y", "word", align=side, drop=14 if onwards == (place == 0) else -14)


def _height(tables: Tables, board: Board, ways: Ways) -> None:
    made = board.panel("height [m]", x_label=True, height=120)
    shown = []
    if ways.fixes is not None:
        fixes = ways.fixes.thinned(2 * _FIXES)
        board.note("fixes", style.dots(made, fixes.time, fixes.height, FIX, size=5))
        shown.append(ways.fixes.height)
    for rows in methods(tables, "navigation"):
        board.note(rows.method, drawn(made, rows, rows["height"], columns=style.COLUMNS))
        shown += [rows["height"]] if rows.method in ways.corrected else []
    if ways.truth is not None:
        line = style.curve(made, ways.truth.time, ways.truth.height, BLACK, width=1.2, dash="3 3")
        board.note("truth", line)
        shown.append(ways.truth.height)
    made.y_range = style.span(*extent(shown))
    board.row(made)
