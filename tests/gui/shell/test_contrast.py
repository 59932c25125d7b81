"""Texts and lines stand out from what is behind them, in both themes."""

from __future__ import annotations

from dataclasses import fields
from itertools import chain

import pyqtgraph as pg
import pytest
from PySide6.QtGui import QColor

from gui.analysis.accuracy import COLOURS
from gui.analysis.confusion import cell_colour, number_colour
from gui.live.raster import DARK_INK_SHARE
from gui.widgets.data_ages import VEIL_ALPHA
from gui.widgets.theme import DARK, LIGHT, STOP_BACKS, Theme, blend, contrast

TEXT, LARGE = 4.5, 3.0
"""Least contrast of WCAG 2.2 for texts, and for large ones and lines."""
BACKS = ("window", "panel", "plot")
ON = {
    "text": (*BACKS, "bad_back", "right_back", "wrong_back", "unsure_back"),
    "muted": (*BACKS, "bad_back"),
    "bad": (*BACKS, "bad_back"),
    "warn": BACKS,
    "accent": BACKS,
    "plot": ("accent",),
}
"""Colours of texts, and what they stand on; that of plots is the text on a selection."""
LINES = ("force", "speed", "set_point", "accent", "bad", "muted", "ok", "warn", "groups", "layers")
DECORATION = {"line": "frames and grids", "gap": "lost samples, striped in the colour bad"}
THEMES = pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])


def _colours(theme: Theme, name: str) -> tuple[str, ...]:
    value = getattr(theme, name)
    return value if isinstance(value, tuple) else (value,)


@THEMES
def test_texts_are_readable_on_what_they_stand_on(theme: Theme) -> None:
    pairs = [(text, back) for text, backs in ON.items() for back in backs]
    weak = {
        pair: contrast(*(getattr(theme, name) for name in pair))
        for pair in pairs
        if contrast(*(getattr(theme, name) for name in pair)) < TEXT
    }
    assert not weak
    assert all(contrast("#ffffff", back) >= LARGE for back in STOP_BACKS)


@THEMES
def test_lines_and_marks_stand_out_from_plots_and_panels(theme: Theme) -> None:
    lines = chain.from_iterable(_colours(theme, name) for name in LINES)
    curves = [dark if theme is DARK else light for light, dark in COLOURS.values()]
    found = {line: contrast(line, theme.plot) for line in (*lines, *curves)}
    assert {line: value for line, value in found.items() if value < LARGE} == {}
    assert contrast(theme.bad, theme.gap) >= LARGE  # the stripes of lost samples


@THEMES
def test_every_colour_of_a_theme_is_judged(theme: Theme) -> None:
    judged = {*ON, *chain.from_iterable(ON.values()), *LINES, *DECORATION}
    assert {field.name for field in fields(theme)} - {"name"} == judged


@THEMES
def test_numbers_are_readable_on_a_heat_map_and_below_a_veil(theme: Theme) -> None:
    table = pg.colormap.get("viridis").getLookupTable(nPts=256)
    colours = [QColor(*map(int, entry)).name() for entry in table]
    for place, colour in enumerate(colours):
        ink = "#000000" if place / 255 > DARK_INK_SHARE else "#ffffff"
        assert contrast(ink, colour) >= TEXT, place
        veiled = blend(theme.line, colour, VEIL_ALPHA / 255)
        assert contrast(theme.text, veiled) >= TEXT, place


@THEMES
def test_a_number_is_readable_in_a_cell_of_any_share(theme: Theme) -> None:
    shares = [step / 100 for step in range(101)]
    weakest = min(contrast(number_colour(theme, s), cell_colour(theme, s)) for s in shares)
    assert weakest >= LARGE
