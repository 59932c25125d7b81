"""Figures as Vega-Lite: the same specification is the page's chart and the figure's file.

In files colours are those of paper, on the page variables of its style sheet.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import count, pairwise
from pathlib import Path
from textwrap import wrap
from typing import Any

from rigctl.analysis.report.figure import (
    COLOURS,
    Bars,
    Figure,
    Image,
    Matrix,
    Panel,
    Raster,
    Series,
    Traces,
)

Spec = dict[str, Any]
Colours = Mapping[str, str]

THEMED: Colours = {name: f"var(--{name})" for name in (*COLOURS, "sa", "ra")}
EMPTY_PATH = re.compile(r'<path [^>]*d=""[^>]*/>')
"""Vega draws them in front of each group; Qt warns of them."""
PLACES = re.compile(r' (?:d|transform|x2|y2)="[^"]*"')
MANY_DIGITS = re.compile(r"(\.\d\d)\d{4,}")
"""Of places: a fraction of a pixel does not show."""
FONT = "Liberation Sans, Arial, Helvetica, sans-serif"
SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
VERSION = "6.4"
"""Of Vega-Lite, for drawings and for the scripts of the page."""
LICENCES = (
    "/* Vega, Vega-Lite, Vega-Embed: BSD-3-Clause, University of Washington Interactive Data Lab. "
    "D3: ISC, Mike Bostock. */"
)
PNG_PPI = 144
PANEL_WIDTH, PANEL_HEIGHT = 330, 200
STAR_ROW = 10
BAR_HEIGHT = 7
RASTER_ROW, MOST_RASTER = 16, 360
"""Heights of a train, and of all trains."""
TRACE = 0.95
"""Of a row: the highest value of traces."""
IMAGE_SIDE = 240
MOST_NAMES = 18
"""Names on an axis of an image."""
NOTE_LETTERS = 68
"""Of a note above the width of a panel."""
LEGEND_LETTER, LEGEND_SYMBOL = 6, 40
"""Pixels of a letter, and of the piece of a curve with the space beside it, in a legend."""
MATRIX_SIDE, SMALLEST_CELL, LARGEST_CELL = 320, 20, 44
MOST_ANNOTATED = 40
"""Classes of a matrix whose cells have texts."""
FAINTEST_TEXT, DARK_SHARE = 0.005, 0.55


def save_figure(figure: Figure, stem: Path, origin: str) -> Path:
    """Write a figure to ``stem``.svg and .png; return the PNG. Equal figures give equal files.

    ``origin``: the source of the data in a few words, at the foot.
    """
    import vl_convert

    spec = specify(figure, COLOURS)
    spec["background"] = COLOURS["page"]
    columns = spec["columns"]
    if len(figure.panels) == len(figure.plots) == 1:
        columns = 2
        spec["config"]["legend"]["columns"] = legend_columns(figure, columns)
        spec["concat"][0] |= {"title": "", "width": 2 * PANEL_WIDTH, "height": 1.5 * PANEL_HEIGHT}
    notes = [
        line for note in (*figure.notes, origin) for line in wrap(note, NOTE_LETTERS * columns)
    ]
    title = {"text": figure.title, "subtitle": notes, "anchor": "start", "fontSize": 14}
    spec["title"] = {**title, "offset": 14}
    stem.parent.mkdir(parents=True, exist_ok=True)
    stem.with_suffix(".svg").write_text(still(spec), "utf-8")
    png = stem.with_suffix(".png")
    png.write_bytes(vl_convert.vegalite_to_png(spec, VERSION, ppi=PNG_PPI))
    return png


def still(spec: Spec) -> str:
    """Return a specification drawn as SVG."""
    import vl_convert

    svg = EMPTY_PATH.sub("", vl_convert.vegalite_to_svg(spec, VERSION))
    return PLACES.sub(lambda found: MANY_DIGITS.sub(r"\1", found[0]), svg)


def specify(figure: Figure, colours: Colours = THEMED, *, pointer: bool = False) -> Spec:
    """Return the Vega-Lite specification of a figure; ``pointer``: shows the values there."""
    legend = list(figure.legend.values())
    plots = count()
    panels = [
        _drawn(
            panel,
            next(plots) if isinstance(panel, Panel) else 0,
            legend,
            colours,
            pointer=pointer,
        )
        for panel in figure.panels
    ]
    settings = config(colours)
    columns = min(figure.columns, len(panels))
    settings["legend"]["columns"] = legend_columns(figure, columns)
    has_images = any(isinstance(panel, Image) for panel in figure.panels)
    if has_images:  # Their scales stand beside them, and a legend each above the other panels.
        settings["legend"]["disable"] = True
    return {
        "$schema": SCHEMA,
        "background": None,
        "padding": 4,
        "columns": columns,
        "concat": panels,
        "spacing": {"row": 16, "column": 20},
        "resolve": {"scale": {"color": "independent"}} if has_images else {},
        "config": settings,
        "usermeta": {"legend_columns": [legend_columns(figure, n + 1) for n in range(columns)]},
    }


def _drawn(
    panel: Panel | Matrix | Bars | Raster | Traces | Image,
    number: int,
    legend: Sequence[Series],
    colours: Colours,
    *,
    pointer: bool,
) -> Spec:
    if isinstance(panel, Matrix):
        return _matrix(panel, colours)
    if isinstance(panel, Bars):
        return _bars(panel, legend, colours)
    if isinstance(panel, Image):
        return _image(panel)
    if isinstance(panel, Traces):
        return _traces(panel, colours)
    if isinstance(panel, Raster):
        return _raster(panel, legend, colours)
    return _lines(panel, number, legend, colours, pointer=pointer)


def legend_columns(figure: Figure, panels: int) -> int:
    """Return how many names of curves stand side by side above so many panels."""
    longest = max(map(len, figure.legend), default=1)
    fitting = panels * PANEL_WIDTH // (LEGEND_LETTER * longest + LEGEND_SYMBOL)
    return int(min(max(fitting, 1), panels + 1))


def config(colours: Colours) -> Spec:
    """Return fonts and colours of every figure."""
    muted, text = colours["muted"], colours["text"]
    labels = {"labelColor": muted, "titleColor": muted, "labelFontSize": 10, "titleFontSize": 10}
    return {
        "font": FONT,
        "view": {"stroke": None},
        "title": {"color": text, "subtitleColor": muted, "fontSize": 12, "subtitleFontSize": 10},
        "axis": {
            **labels,
            "titleFontWeight": "normal",
            "gridColor": colours["line"],
            "domainColor": muted,
            "tickColor": muted,
        },
        "legend": {
            **labels,
            "labelFontSize": 11,
            "orient": "top",
            "symbolType": "stroke",
            "symbolStrokeWidth": 2,
            "labelLimit": 0,
            "title": None,
            "columnPadding": 20,
        },
        "text": {"font": FONT, "color": muted},
    }


def _lines(
    panel: Panel, number: int, legend: Sequence[Series], colours: Colours, *, pointer: bool
) -> Spec:
    """Return a panel of curves; the first one has the switches of the legend."""
    whole = all(float(x).is_integer() for one in panel.series for x in one.x)
    ticks = {"tickMinStep": 1} if whole else {}
    x = _axis("x", panel.x_label, panel.x_range, **ticks)
    y = _axis("y", panel.y_label, panel.y_range)
    shown = {"condition": {"param": "shown", "value": 1}, "value": 0.08}
    curve = {"x": x, "y": y, "color": _hues(legend, colours), "opacity": shown}
    lines = {
        "mark": {"type": "line", "strokeWidth": 1.5, "aria": False},
        "encoding": {**curve, "strokeDash": _dashes(legend)},
    }
    bars: Spec = {
        "transform": [{"filter": "isValid(datum.low)"}],
        "mark": {"type": "rule", "strokeWidth": 0.7, "aria": False},
        "encoding": {**curve, "y": {**y, "field": "low"}, "y2": {"field": "high"}},
    }
    if number == 0:
        select = {"type": "point", "fields": ["name"]}
        bars["params"] = [{"name": "shown", "select": select, "bind": "legend"}]
    layers = [bars, lines, _published(panel, curve), *_stars(panel, x, shown, colours)]
    if panel.level:
        layers = [*_level(panel.level, colours), *layers]
    if pointer:
        layers = [*layers, _pointer(panel, number, x, colours)]
    return {
        "title": {"text": panel.title, "anchor": "start", "offset": 6},
        "width": PANEL_WIDTH,
        "height": PANEL_HEIGHT,
        "data": {"values": list(_rows(panel))},
        "layer": layers,
    }


def _hues(legend: Sequence[Series], colours: Colours) -> Spec:
    """Return each curve's colour, with the legend."""
    hues = {one.name: colours[one.colour] for one in legend}
    return {
        "field": "name",
        "type": "nominal",
        "scale": {"domain": list(hues), "range": list(hues.values())},
    }


def _dashes(legend: Sequence[Series]) -> Spec:
    dashes = {one.name: [4, 3] if one.dashed else [1, 0] for one in legend}
    scale = {"domain": list(dashes), "range": list(dashes.values())}
    return {"field": "name", "type": "nominal", "scale": scale}


def _axis(field: str, title: str, domain: tuple[float, float], **axis: Any) -> Spec:
    return {
        "field": field,
        "type": "quantitative",
        "title": title,
        "scale": {"domain": domain, "nice": False},
        "axis": {"tickCount": 6, "grid": True, **axis},
    }


def _rows(panel: Panel) -> Iterator[Spec]:
    """Yield each point with the ends of its bar; none leaves the plot."""
    low, high = panel.y_range
    for one in panel.series:
        for i, (x, y) in enumerate(zip(one.x, one.y, strict=True)):
            row = {"y": y}
            if (ends := one.ends(i)) is not None:
                row |= {"low": ends[0], "high": ends[1]}
            inside = {key: round(min(max(value, low), high), 2) for key, value in row.items()}
            yield {"name": one.name, "x": round(x, 3), **inside}


def _image(image: Image) -> Spec:
    """Return a coloured cell for each value: from blue below the middle to red above it."""
    cells: list[Spec] = [
        {"row": row, "column": column, "value": round(value, 5)}
        for row, line in zip(image.rows, image.values, strict=True)
        for column, value in zip(image.columns, line, strict=True)
        if value is not None
    ]
    middle = image.middle or 0.0
    reach = max((abs(one["value"] - middle) for one in cells), default=1.0) or 1.0
    hues = {"domain": [middle - reach, middle + reach], "range": "diverging", "reverse": True}
    if image.middle is None:
        hues = {"domain": [0.0, reach], "scheme": "viridis"}
    shade = {
        "field": "value",
        "type": "quantitative",
        "scale": hues,
        "legend": {"orient": "right", "gradientLength": IMAGE_SIDE / 2, "title": None},
    }

    def axis(field: str, names: Sequence[str], title: str) -> Spec:
        kind = {"field": field, "type": "nominal", "sort": None, "title": title}
        return {**kind, "scale": {"domain": list(names)}, "axis": _some_names(names)}

    place = {
        "x": axis("column", image.columns, image.x_label),
        "y": axis("row", image.rows, image.y_label),
    }
    return {
        "title": {"text": image.title, "anchor": "start", "offset": 6},
        "width": IMAGE_SIDE,
        "height": IMAGE_SIDE,
        "data": {"values": cells},
        "mark": {"type": "rect", "aria": False},
        "encoding": {**place, "color": shade},
    }


def _some_names(names: Sequence[str]) -> Spec:
    """Return an axis with as many names as are legible."""
    every = len(names) // MOST_NAMES + 1
    return {"values": list(names[::every]), "labelAngle": 0, "labelLimit": 0}


def _raster(raster: Raster, legend: Sequence[Series], colours: Colours) -> Spec:
    """Return a tick for each spike in the plot, a row for each train."""
    low, high = raster.x_range
    values = [
        {"name": one.name, "row": raster.rows[int(row)], "x": round(x, 3)}
        for one in raster.series
        for x, row in zip(one.x, one.y, strict=True)
        if low <= x <= high
    ]
    rows = {
        "field": "row",
        "type": "nominal",
        "title": None,
        "scale": {"domain": list(raster.rows)},
        "axis": _some_names(raster.rows),
    }
    row_px = min(RASTER_ROW, MOST_RASTER / len(raster.rows))
    x = _axis("x", raster.x_label, raster.x_range)
    return {
        "title": {"text": raster.title, "anchor": "start", "offset": 6},
        "width": PANEL_WIDTH,
        "height": row_px * len(raster.rows),
        "data": {"values": values},
        "mark": {"type": "tick", "thickness": 1, "bandSize": 0.75 * row_px, "aria": False},
        "encoding": {"x": x, "y": rows, "color": _hues(legend, colours)},
    }


def _traces(traces: Traces, colours: Colours) -> Spec:
    """Return a line for each row, in the room of its row, as shares of the highest value."""
    highest = max((max(line, default=0.0) for line in traces.values), default=0.0) or 1.0
    values = [
        {"row": row, "x": x, "y": round(row + 0.5 - TRACE * value / highest, 4)}
        for row, line in enumerate(traces.values, start=1)
        for x, value in enumerate(line)
    ]
    every = range(1, len(traces.values) + 1, len(traces.values) // MOST_NAMES + 1)
    ends = (len(traces.values) + 0.6, 0.4)
    rows = _axis("y", traces.y_label, ends, grid=False, values=list(every))
    x = _axis("x", traces.x_label, traces.x_range)
    return {
        "title": {"text": traces.title, "anchor": "start", "offset": 6},
        "width": PANEL_WIDTH,
        "height": MOST_RASTER,
        "data": {"values": values},
        "mark": {"type": "line", "strokeWidth": 0.8, "color": colours["ink"], "aria": False},
        "encoding": {"x": x, "y": rows, "detail": {"field": "row"}},
    }


def _bars(bars: Bars, legend: Sequence[Series], colours: Colours) -> Spec:
    """Return a group of lying bars for each category; ends of the error bars stay in the plot."""
    low, high = bars.x_range
    rows = []
    for one in bars.series:
        for i, (at, value) in enumerate(zip(one.x, one.y, strict=True)):
            row: Spec = {"name": one.name, "category": bars.categories[int(at)]}
            ends = one.ends(i) or (value, value)
            each = {"x": value, "low": ends[0], "high": ends[1]}
            rows.append(row | {k: round(min(max(v, low), high), 2) for k, v in each.items()})
    x = _axis("x", bars.x_label, bars.x_range)
    names = [one.name for one in bars.series]
    place = {
        "y": {
            "field": "category",
            "type": "nominal",
            "sort": None,
            "title": None,
            "scale": {"domain": list(bars.categories), "paddingInner": 0.25},
            "axis": {"labelLimit": 0},
        },
        "yOffset": {"field": "name", "sort": names, "scale": {"domain": names}},
    }
    shown = {"symbolType": "square"} if len(bars.series) > 1 else None
    bar = {**place, "x": x, "color": {**_hues(legend, colours), "legend": shown}}
    dashed = [one.name for one in legend if one.dashed]
    faded = {"condition": {"test": f"indexof({dashed}, datum.name) >= 0", "value": 0.5}, "value": 1}
    error = {**place, "x": {**x, "field": "low"}, "x2": {"field": "high"}}
    layers: list[Spec] = [
        {"mark": {"type": "bar", "aria": False}, "encoding": {**bar, "opacity": faded}},
        {"mark": {"type": "rule", "color": colours["text"], "strokeWidth": 0.7}, "encoding": error},
    ]
    return {
        "title": {"text": bars.title, "anchor": "start", "offset": 6},
        "width": PANEL_WIDTH,
        "height": BAR_HEIGHT * (len(names) + 1) * len(bars.categories),
        "data": {"values": rows},
        "layer": layers,
    }


def _level(level: tuple[float, str], colours: Colours) -> list[Spec]:
    at = {"y": {"datum": level[0]}}
    dotted = {"type": "rule", "strokeDash": [1, 3], "color": colours["muted"]}
    words = {
        "type": "text",
        "align": "right",
        "baseline": "top",
        "dx": -2,
        "dy": 3,
        "text": level[1],
        "aria": False,
    }
    return [
        {"data": {"values": [{}]}, "mark": dotted, "encoding": at},
        {"data": {"values": [{}]}, "mark": words, "encoding": {**at, "x": {"value": "width"}}},
    ]


def _published(panel: Panel, curve: Spec) -> Spec:
    """Return the paper's values, filled for curves that are drawn through."""
    rows = [
        {"name": one.name, "x": value.x, "y": value.y, "fill": 0 if one.dashed else 1}
        for one in panel.series
        for value in one.published
    ]
    fill = {"field": "fill", "type": "quantitative", "scale": None}
    mark = {"type": "point", "shape": "diamond", "size": 70, "aria": False}
    return {
        "data": {"values": rows},
        "mark": mark,
        "encoding": {**curve, "fill": curve["color"], "fillOpacity": fill},
    }


def _stars(panel: Panel, x: Spec, shown: Spec, colours: Colours) -> list[Spec]:
    """Return a row of asterisks above the plot for each starred curve, grey where it is worse."""
    layers = []
    for row, one in enumerate(panel.starred):
        values = [
            {"name": one.name, "x": at, "stars": stars, "worse": worse}
            for at, stars, worse in zip(one.x, one.stars, one.worse, strict=True)
            if stars
        ]
        grey = {"test": "datum.worse", "value": colours["muted"]}
        encoding = {
            "x": x,
            "y": {"value": -5 - STAR_ROW * row},
            "text": {"field": "stars"},
            "color": {"condition": grey, "value": colours[one.colour]},
            "opacity": shown,
        }
        mark = {"type": "text", "angle": 90, "fontSize": 9, "baseline": "middle", "aria": False}
        layers.append({"data": {"values": values}, "mark": mark, "encoding": encoding})
    return layers


def _pointer(panel: Panel, number: int, x: Spec, colours: Colours) -> Spec:
    """Return a band at the pointer that says the values of every curve there."""
    places = panel.places()
    middles = [(a + b) / 2 for a, b in pairwise(places)]
    edges = pairwise([panel.x_range[0], *middles, panel.x_range[1]])
    rows = [
        {"x": left, "right": right, "at": f"{at:g}"}
        | {f"s{i}": one.words_at(at, panel.unit) for i, one in enumerate(panel.series)}
        for at, (left, right) in zip(places, edges, strict=True)
    ]
    head = {"field": "at", "title": panel.x_name or panel.x_label}
    values = [{"field": f"s{i}", "title": one.name} for i, one in enumerate(panel.series)]
    here = {"param": f"at{number}", "value": 0.15, "empty": False}
    select = {"type": "point", "on": "pointerover", "clear": "pointerout"}
    return {
        "data": {"values": rows},
        "params": [{"name": f"at{number}", "select": select}],
        "mark": {"type": "rect", "color": colours["muted"], "aria": False},
        "encoding": {
            "x": x,
            "x2": {"field": "right"},
            "opacity": {"condition": here, "value": 0},
            "tooltip": [head, *values],
        },
    }


def _matrix(matrix: Matrix, colours: Colours) -> Spec:
    """Return the shares of a matrix's rows; the description of a cell says its trials."""
    classes = list(matrix.classes)
    annotated = len(classes) <= MOST_ANNOTATED
    cell = min(max(MATRIX_SIDE / len(classes), SMALLEST_CELL), LARGEST_CELL) if annotated else 8
    axis = {"type": "nominal", "sort": None, "scale": {"domain": classes}}
    turned = 0 if max(map(len, classes)) <= 2 else -90
    place = {
        "x": {**axis, "field": "column", "title": "predicted", "axis": {"labelAngle": turned}},
        "y": {**axis, "field": "row", "title": "true"},
    }
    share = {"field": "share", "type": "quantitative", "scale": {"domain": [0, 1], "range": [0, 1]}}
    shade = {**place, "fillOpacity": {**share, "legend": None}, "description": {"field": "words"}}
    dark = {"test": f"datum.share > {DARK_SHARE}", "value": colours["page"]}
    digits = {"text": {"field": "percent"}, "color": {"condition": dark, "value": colours["text"]}}
    layers = [{"mark": {"type": "rect", "color": colours["blue"]}, "encoding": shade}]
    if annotated:
        mark = {"type": "text", "fontSize": 9, "aria": False}
        layers.append({"mark": mark, "encoding": {**place, **digits}})
    return {
        "title": {"text": matrix.title, "subtitle": list(matrix.subtitle), "anchor": "start"},
        "width": {"step": cell},
        "height": {"step": cell},
        "view": {"stroke": colours["muted"]},
        "data": {"values": _cells(matrix)},
        "layer": layers,
    }


def _cells(matrix: Matrix) -> list[Spec]:
    """Return the cells with trials: names, share of the row, its per cent, and all in words."""
    cells = []
    for row, true in enumerate(matrix.classes):
        for column, predicted in enumerate(matrix.classes):
            if not matrix.counts[row][column]:
                continue
            share = matrix.share(row, column)
            percent = f"{100 * share:.0f}" if share >= FAINTEST_TEXT else ""
            cell = {"row": true, "column": predicted, "share": round(share, 3)}
            cells.append({**cell, "percent": percent, "words": matrix.words(row, column)})
    return cells


@cache
def scripts() -> str:
    """Return the scripts of Vega, Vega-Lite and Vega-Embed that vl-convert has in it."""
    import vl_convert

    return f"{LICENCES}\n{vl_convert.javascript_bundle('window.vegaEmbed = vegaEmbed;', VERSION)}"
