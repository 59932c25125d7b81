"""Plates as people know them: letter, texture in a few words, and the profile of the print."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPixmap, QPolygonF
from PySide6.QtWidgets import QApplication, QLabel, QWidget

from gui.widgets.labels import label, show_text
from gui.widgets.layouts import EventWatch, hbox
from gui.widgets.theme import applied_theme, scaled_px
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.textures import (
    Texture,
    describe,
    find_texture,
    plate_names,
    printed_heights,
)
from rigctl.bench.world_file import world_from_header

World = WorldParameters | None
"""That of a simulated rig. A bench has none: its plates are those of the catalogue by name."""
SHOWN_MM = 32.0
"""Length of the profile in a picture: two ridges of the plates with double spacing."""
PICTURE_PX = (60, 15)
_BASE_PX = 2.0
_NOMINAL = WorldParameters()


def world_of(data: Mapping[str, Any]) -> World:
    """Return the world in what an engine says of its rig, None for a bench."""
    world = world_from_header(data.get("world") or {}, Path("engine"))
    return None if world is None else world.parameters


def texture_words(name: str, world: World) -> str:
    """Return the texture of a plate in a few words, empty for a plate that is not known."""
    texture = _texture(name, world)
    return "" if texture is None else describe(texture, world)


def plate_words(name: str, world: World) -> str:
    """Return the name of a plate, and its texture."""
    return " – ".join(filter(None, (name, texture_words(name, world))))


def plate_icon(name: str, world: World) -> QIcon:
    """Return the picture of a plate for a list, empty for a plate that is not known."""
    return QIcon(plate_picture(name, world))


def picture_size() -> QSize:
    """Return the size of a picture beside texts of the present size."""
    return QSize(*map(scaled_px, PICTURE_PX))


def plate_picture(name: str, world: World) -> QPixmap:
    """Return the profile of a plate along its travel; null for a plate that is not known.

    All plates of a world have one scale, higher than long, so that they can be compared.
    """
    texture = _texture(name, world)
    if texture is None:
        return QPixmap()
    parameters, size = world or _NOMINAL, picture_size()
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    sharp = application.devicePixelRatio()
    picture = QPixmap(size * sharp)
    picture.setDevicePixelRatio(sharp)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(applied_theme().text))
    painter.drawPolygon(_outline(texture, parameters, size.width(), size.height()))
    painter.end()
    return picture


def _texture(name: str, world: World) -> Texture | None:
    parameters = world or _NOMINAL
    return find_texture(name, parameters) if name in plate_names(parameters) else None


@lru_cache(maxsize=64)
def _outline(
    texture: Texture, parameters: WorldParameters, width_px: int, height_px: int
) -> QPolygonF:
    """Return the profile on its base, px."""
    along_mm = np.linspace(0.0, SHOWN_MM, 8 * width_px)
    heights_mm = printed_heights(texture, along_mm, parameters)
    plates = (find_texture(name, parameters) for name in plate_names(parameters))
    highest_mm = parameters.base_height_mm * max(plate.height for plate in plates)
    x_px = along_mm * width_px / SHOWN_MM
    y_px = height_px - _BASE_PX - heights_mm * (height_px - _BASE_PX) / highest_mm
    top = [QPointF(x, y) for x, y in zip(x_px.tolist(), y_px.tolist(), strict=True)]
    ends = [QPointF(width_px, height_px), QPointF(0.0, height_px)]
    return QPolygonF([*top, *ends])


class PlateSign(QWidget):
    """The picture of a plate and its words; hidden without one."""

    def __init__(self) -> None:
        super().__init__()
        self.picture, self.words = QLabel(), label("", "muted", wraps=True)
        self._name = ""
        self._world: World = None
        self.setLayout(hbox(self.picture, self.words, wide=1, spacing=6))
        kinds = QEvent.Type
        EventWatch(self, self._draw, kinds.PaletteChange, kinds.FontChange)
        self.hide()

    def show_plate(self, name: str, world: World) -> None:
        """Show another plate; none for an empty name."""
        self._name, self._world = name, world
        show_text(self.words, plate_words(name, world))
        self._draw()
        self.setVisible(bool(name))

    def _draw(self) -> None:
        self.picture.setPixmap(plate_picture(self._name, self._world))
