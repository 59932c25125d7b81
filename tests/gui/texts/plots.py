"""The texts of plots: labels, titles and ticks of axes, and texts inside a plot."""

from __future__ import annotations

from collections.abc import Iterator

import pyqtgraph as pg
from PySide6.QtCore import QRectF
from PySide6.QtGui import QPainter, QPixmap
from PySide6.QtWidgets import (
    QGraphicsItem,
    QGraphicsSimpleTextItem,
    QGraphicsTextItem,
    QGraphicsView,
)

from tests.gui.texts.piece import CutText, path_of

_SLACK_PX, _APART_PX = 1.0, 3.0


def cut_plot_texts(view: QGraphicsView) -> list[CutText]:
    """Return the texts of a view that its plots or other texts cover or cut."""
    where, found = path_of(view), []
    port = view.mapToScene(view.viewport().rect()).boundingRect()
    beside: list[tuple[QRectF, str]] = []
    for item in view.scene().items():
        if not item.isVisible() or not item.opacity():
            continue
        if isinstance(item, QGraphicsTextItem | QGraphicsSimpleTextItem):
            found += _text(where, item, port)
        elif isinstance(item, pg.AxisItem):
            found += _ticks(where, item, port)
            if item.orientation == "bottom":
                ticks = [(item.mapRectToScene(place), text) for place, text in _tick_texts(item)]
                found += [
                    CutText(f"{where}/AxisItem", text, f"runs into {other!r} of the next axis")
                    for place, text in ticks
                    for there, other in beside
                    if _overlap(place.adjusted(-_APART_PX, 0, _APART_PX, 0), there)
                ]
                beside += ticks
    return found


def _text(
    where: str, item: QGraphicsTextItem | QGraphicsSimpleTextItem, port: QRectF
) -> Iterator[CutText]:
    margin = 0.0
    if isinstance(item, QGraphicsTextItem):
        text, margin = item.toPlainText().strip(), item.document().documentMargin()
    else:
        text = item.text().strip()
    if not text:
        return
    inner = item.boundingRect().adjusted(margin, margin, -margin, -margin)
    needs = item.mapRectToScene(inner)
    has = _clip(item, port)
    if not _holds(has, needs):
        yield CutText(where, text, f"covers {_words(needs)} but the plot shows {_words(has)}")


def _clip(item: QGraphicsItem, port: QRectF) -> QRectF:
    """Return the part of the scene that an item may use: an axis keeps its label to itself."""
    clip, parent = port, item.parentItem()
    while parent is not None:
        clips = parent.flags() & QGraphicsItem.GraphicsItemFlag.ItemClipsChildrenToShape
        if clips or isinstance(parent, pg.AxisItem):
            clip = clip.intersected(parent.sceneBoundingRect())
        parent = parent.parentItem()
    return clip


def _ticks(where: str, axis: pg.AxisItem, port: QRectF) -> Iterator[CutText]:
    cached = axis.cacheMode() is not QGraphicsItem.CacheMode.NoCache
    has = axis.mapRectFromScene(port)
    if cached:
        has = has.intersected(axis.boundingRect())
    previous: tuple[QRectF, str] | None = None
    name = axis.label.toPlainText().replace("\n", " ")
    margin = axis.label.document().documentMargin()
    inner = axis.label.boundingRect().adjusted(margin, margin, -margin, -margin)
    name_place = axis.mapRectFromItem(axis.label, inner) if axis.label.isVisible() else QRectF()
    for rect, text in _tick_texts(axis):
        if _overlap(name_place, rect):
            yield CutText(f"{where}/AxisItem", text, f"overlaps the name {name!r} of its axis")
        if not _holds(has, rect):
            reason = f"covers {_words(rect)} but the axis shows {_words(has)}"
            yield CutText(f"{where}/AxisItem", text, reason)
        if previous is not None and _overlap(previous[0], rect):
            yield CutText(f"{where}/AxisItem", text, f"overlaps the tick {previous[1]!r}")
        previous = rect, text


def _tick_texts(axis: pg.AxisItem) -> list[tuple[QRectF, str]]:
    """Return place, in the axis, and text of each of its numbers."""
    if not axis.style["showValues"]:
        return []
    canvas = QPixmap(1, 1)
    painter = QPainter(canvas)
    specs = axis.generateDrawSpecs(painter)
    painter.end()
    return [(QRectF(place), text) for place, _, text in specs[2]] if specs else []


def _overlap(one: QRectF, other: QRectF) -> bool:
    common = one.intersected(other)
    return common.width() > _SLACK_PX and common.height() > min(one.height(), other.height()) / 3


def _holds(outer: QRectF, inner: QRectF) -> bool:
    slack = outer.adjusted(-_SLACK_PX, -_SLACK_PX, _SLACK_PX, _SLACK_PX)
    return slack.contains(inner)


def _words(rect: QRectF) -> str:
    return (
        f"{rect.left():.0f} to {rect.right():.0f} px across and "
        f"{rect.top():.0f} to {rect.bottom():.0f} px down"
    )
