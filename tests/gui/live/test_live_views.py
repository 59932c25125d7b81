"""The live plots show what the engine wrote, with every short event and every gap."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from gui.live.live_plots import LivePlots
from gui.live.raster import Raster, RateBars, ScrollingImage, TrainRows, layer_titles
from gui.live.sample_history import SampleHistory, TimeWindow
from gui.live.time_plots import Traces
from gui.widgets.theme import DARK, LIGHT, rgb
from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.session.sensor_layout import SensorLayout
from tests.gui.fake_engine import FakeEngine

WIDTH, HEIGHT = 500, 180
PAPER, ONE_LAYER = SensorLayout.default(18), SensorLayout(3, 6, ("skin",))


def _write(
    writer: LiveWriter, first: int, samples: np.ndarray, spikes: np.ndarray | None = None
) -> None:
    n = len(samples)
    counters = np.arange(first, first + n, dtype=np.int64)
    none = np.zeros((n, 36), np.uint8)
    writer.add_taxels(
        time_s=counters / 1000,
        counters=counters,
        samples=samples.astype(np.uint16),
        flags=np.zeros(n, np.uint8),
        spikes=none if spikes is None else spikes,
    )


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[LiveWriter]:
    buffer = LiveWriter(tmp_path / "live", 18)
    yield buffer
    buffer.close()


@pytest.fixture
def view(writer: LiveWriter) -> Iterator[LiveReader]:
    buffer = LiveReader(writer.path)
    yield buffer
    buffer.close()


def test_pulls_of_any_length_give_the_same_timeline(engine: FakeEngine) -> None:
    whole, pieces = (SampleHistory(n_taxels=18, n_rows=36, capacity=3000) for _ in range(2))
    for n in (1, 7, 500, 2999, 3000, 4500, 10):
        engine.write_samples(n)
        pieces.pull(engine.live)
    whole.pull(engine.live)
    for name in ("counters", "samples", "spikes"):
        one, other = getattr(whole, name), getattr(pieces, name)
        assert np.array_equal(
            one.between(one.end - 3000, one.end), other.between(other.end - 3000, other.end)
        )
    assert len(whole) == 3000


def test_one_sample_of_a_spike_in_a_trace_is_visible(
    qapp: QApplication, writer: LiveWriter, view: LiveReader
) -> None:
    samples = np.full((10_000, 18), 100)
    samples[5000, 4] = 1000
    _write(writer, 0, samples)
    history, traces = SampleHistory(18, 36, 20_000), Traces(LIGHT, PAPER)
    history.pull(view)
    refresh(traces, history)
    ink = traces._pixels[:, traces_column(5000)] == rgb(LIGHT.layers[0])
    assert ink[4 * HEIGHT // 18 : 5 * HEIGHT // 18].sum() >= 7
    assert ink[5 * HEIGHT // 18 : 6 * HEIGHT // 18].sum() == 1


def refresh(image: ScrollingImage, history: SampleHistory, right: int | None = None) -> None:
    """Draw ten seconds up to a position, by default the newest."""
    at = history.newest if right is None else right
    image.refresh(history, TimeWindow(at, 10_000, at), WIDTH, HEIGHT, 1.0)


def traces_column(counter: int) -> int:
    """Ring column of a sample in a picture of ten seconds."""
    return counter * WIDTH // 10_000 % WIDTH


def test_every_spike_is_a_tick_in_its_row(
    qapp: QApplication, writer: LiveWriter, view: LiveReader
) -> None:
    spikes = np.zeros((10_000, 36), np.uint8)
    for row in range(36):
        spikes[100 + 250 * row, row] = 1
    _write(writer, 0, np.zeros((10_000, 18)), spikes)
    history, raster = SampleHistory(18, 36, 20_000), Raster(DARK, PAPER)
    history.pull(view)
    refresh(raster, history)
    inks = {rgb(colour) for colour in DARK.groups}
    for shown, source in enumerate(raster.rows.order):
        column = raster._pixels[:, traces_column(100 + 250 * int(source))]
        lit = [y for y in range(HEIGHT) if int(column[y]) in inks]
        assert lit and all(y * 36 // HEIGHT == shown for y in lit)


def test_incremental_drawing_gives_the_same_image(qapp: QApplication, engine: FakeEngine) -> None:
    history, steps, once = SampleHistory(18, 36, 20_000), Raster(LIGHT, PAPER), Raster(LIGHT, PAPER)
    engine.write_samples(9000)
    for n in (33, 1, 700, 5000, 40):
        engine.write_samples(n, skip=n // 30)
        history.pull(engine.live)
        refresh(steps, history)
    refresh(once, history)
    assert np.array_equal(steps._pixels, once._pixels)


def test_gaps_are_coloured(qapp: QApplication, engine: FakeEngine) -> None:
    history, traces = SampleHistory(18, 36, 20_000), Traces(LIGHT, PAPER)
    engine.write_samples(3000)
    engine.write_samples(3000, skip=400)
    history.pull(engine.live)
    refresh(traces, history)
    gap = np.isin(traces._pixels, (rgb(LIGHT.gap), rgb(LIGHT.bad))).all(axis=0)
    assert len(np.unique(traces._pixels[:, gap])) == 2  # stripes tell it without colours
    assert gap.sum() == 400 * WIDTH // 10_000


def test_rows_are_named_and_ordered_as_in_the_paper() -> None:
    names = [TrainRows(PAPER).label(row) for row in range(36)]
    assert names[0] == "T_SA-1" and names[9] == "T_RA-1"
    assert names[18] == "T_SA-10" and names[35] == "T_RA-18"


def test_one_layer_is_one_group_of_each_channel() -> None:
    rows = TrainRows(ONE_LAYER)
    assert [name for _, name in rows.group_ticks()] == ["SA", "RA"]
    assert [rows.label(row) for row in (9, 18)] == ["T_SA-10", "T_RA-1"]
    assert rows.group_colours(LIGHT) == list(LIGHT.groups[:2])
    assert layer_titles(ONE_LAYER) == ("Readings now, counts",)
    assert layer_titles(PAPER)[1] == "Bottom layer (type II), counts"
    named = SensorLayout(3, 3, ("skin", "core"))
    assert layer_titles(named) == ("Top layer (skin), counts", "Bottom layer (core), counts")


def test_the_plots_follow_the_layers_of_the_sensor(qapp: QApplication, engine: FakeEngine) -> None:
    scene = LivePlots(LIGHT)
    scene.resize(900, 600)
    engine.write_samples(4000)
    scene.set_sensor_layout(ONE_LAYER)
    scene.refresh(engine.live)
    picture = scene.grab().toImage()
    colours = {picture.pixel(x, y) for x in range(0, 900, 2) for y in range(0, 600, 2)}
    assert {rgb(colour) for colour in (*LIGHT.groups[:2], LIGHT.layers[0])} <= colours
    assert not {rgb(colour) for colour in (*LIGHT.groups[2:], LIGHT.layers[1])} & colours
    scene.set_sensor_layout(SensorLayout.default(9))
    scene.refresh(engine.live)  # of 18 taxels: another engine's, whose status comes next
    assert len(scene.data.history) == 0
    scene.hide()
    engine.close()


def test_rates_are_spikes_per_second(qapp: QApplication) -> None:
    bars = RateBars(LIGHT, PAPER)
    spikes = np.zeros((3000, 36), np.uint8)
    spikes[2000::10, 0] = 1
    spikes[::2, 1] = 0
    bars.refresh(spikes)
    assert bars.rates_hz[0] == 100.0 and bars.rates_hz[1:].sum() == 0


def test_live_plots_draw_in_both_themes(qapp: QApplication, engine: FakeEngine) -> None:
    scene = LivePlots(LIGHT)
    scene.resize(900, 600)
    engine.write_samples(4000)
    for theme in (LIGHT, DARK):
        scene.set_theme(theme)
        scene.refresh(engine.live)
        picture = scene.grab().toImage()
        colours = {picture.pixel(x, y) for x in range(0, 900, 2) for y in range(0, 600, 2)}
        assert {rgb(colour) for colour in (*theme.groups, *theme.layers)} <= colours
    scene.set_span(2)
    scene.refresh(engine.live)
    scene.hide()
    engine.close()
