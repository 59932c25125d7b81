"""Spikes become clicks at their frames, late by no more than is said, and never hold the window."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.live.live_page import LISTEN, LivePage
from gui.live.sample_history import SampleHistory
from gui.live.spike_clicks import (
    CLICKS,
    EARS,
    FRAME_RATE_HZ,
    FRAMES_A_SAMPLE,
    MOST_FRAMES,
    QUEUE_MS,
    STALLED_FRAMES,
    TONES_HZ,
    Channel,
    FrameQueue,
    Frames,
    SpikeListener,
)
from gui.live.spike_sound import LAG_MS, OPENING, STOPPED, Take, open_device
from gui.widgets.theme import LIGHT
from rigctl.errors import WrongUse
from tests.gui.fake_engine import FakeEngine
from tests.gui.live.speaker import Speaker
from tests.gui.steps import click, wait_until

SA, RA, BOTH = (np.array(EARS[channel]) for channel in (Channel.SA, Channel.RA, Channel.BOTH))


def history(spikes: NDArray[np.uint8], at: NDArray[np.int64] | None = None) -> SampleHistory:
    """Return a history of two taxels with these spikes, SA then RA, at these positions."""
    made = SampleHistory(2, 4, 10_000)
    add(made, spikes, np.arange(len(spikes)) if at is None else at)
    return made


def add(made: SampleHistory, spikes: NDArray[np.uint8], at: NDArray[np.int64]) -> None:
    """Append spikes at positions."""
    n = len(spikes)
    made.append(at / 1000, at, np.zeros((n, 2), np.uint16), np.zeros(n, np.uint8), spikes)


def spikes_at(n: int, *places: tuple[int, int]) -> NDArray[np.uint8]:
    """Return n samples with a spike at each of some samples and trains."""
    spikes = np.zeros((n, 4), np.uint8)
    for sample, train in places:
        spikes[sample, train] = 1
    return spikes


def expected(n_frames: int, kind: int, *begins: int) -> NDArray[np.float64]:
    """Return the sum of clicks at these frames."""
    sound = np.zeros(n_frames + len(CLICKS[0]))
    for begin in begins:
        sound[begin : begin + len(CLICKS[0])] += CLICKS[kind]
    return np.rint(sound[:n_frames])


def heard(
    made: SampleHistory, stops: list[int], ears: NDArray[np.float64], speed: float = 1.0
) -> Frames:
    """Return what taxel 1 sounds like, listened to up to each of some positions."""
    listener = SpikeListener()
    return np.concatenate([listener.hear(made, stop, 1, ears, speed) for stop in stops])


def test_each_click_begins_at_its_frame_whatever_the_blocks_are() -> None:
    made = history(spikes_at(61, (1, 1), (2, 1), (30, 1), (41, 0), (42, 3), (59, 1)))
    for stops in ([0, 60], [0, 1, 2, 3, 10, 31, 32, 59, 60], [0, *range(7, 61, 7), 60]):
        sound = heard(made, stops, SA)
        assert np.array_equal(sound[:, 0], expected(60 * 48, 0, 0, 48, 29 * 48, 58 * 48))
        assert np.array_equal(sound[:, 0], sound[:, 1])


def test_ra_is_higher_and_both_stand_left_and_right() -> None:
    made = history(spikes_at(61, (1, 1), (30, 3)))
    sound = heard(made, [0, 60], BOTH)
    assert np.array_equal(sound[:, 0], expected(60 * 48, 0, 0))
    assert np.array_equal(sound[:, 1], expected(60 * 48, 1, 29 * 48))
    assert np.array_equal(heard(made, [0, 60], RA)[:, 0], sound[:, 1])
    for click_sound, tone_hz in zip(CLICKS, TONES_HZ, strict=True):
        power = np.abs(np.fft.rfft(click_sound, FRAME_RATE_HZ))
        assert abs(int(power.argmax()) - tone_hz) < 0.2 * tone_hz


def test_lost_samples_are_silence_of_their_length() -> None:
    at = np.concatenate([np.arange(10), np.arange(40, 61)])
    made = history(spikes_at(31, (1, 1), (15, 1)), at)  # at positions 1 and 45
    assert np.array_equal(heard(made, [0, 60], SA)[:, 0], expected(60 * 48, 0, 0, 44 * 48))


def test_what_is_older_than_the_queue_is_not_heard() -> None:
    made = history(spikes_at(1001, (5, 1), (990, 1)))
    sound = heard(made, [0, 1000], SA)
    assert len(sound) == MOST_FRAMES == QUEUE_MS * FRAMES_A_SAMPLE and LAG_MS <= 100
    assert np.array_equal(sound[:, 0], expected(MOST_FRAMES, 0, (QUEUE_MS - 11) * 48))
    assert len(heard(made, [900, 100], SA)) == 0, "a step back is a new beginning"


def test_a_replay_is_heard_at_its_speed() -> None:
    made = history(spikes_at(201, (1, 1), (21, 1), (41, 1)))
    slow = heard(made, [0, *range(10, 61, 10)], SA, speed=0.5)
    assert np.array_equal(slow[:, 0], expected(60 * 96, 0, 0, 20 * 96, 40 * 96))
    assert len(heard(made, [0, 3, 60, 63], SA, speed=1 / 3)) == 6 * 144 + int(QUEUE_MS / 3) * 144
    assert len(heard(made, [0, 100], SA, speed=1000.0)) == 0


def test_the_queue_is_bounded_and_gives_silence_where_nothing_waits() -> None:
    queue = FrameQueue()
    ramp = np.repeat(np.arange(1, MOST_FRAMES + 501, dtype=np.int16)[:, None], 2, axis=1)
    for first in range(0, len(ramp), 100):
        queue.put(ramp[first : first + 100])
    queue.put(ramp[:0])
    taken = np.concatenate([queue.take(77) for _ in range(-(-MOST_FRAMES // 77) + 1)])
    assert np.array_equal(taken[:MOST_FRAMES], ramp[-MOST_FRAMES:])
    assert not taken[MOST_FRAMES:].any() and not queue.is_stalled
    for _ in range(STALLED_FRAMES // 480 + 1):
        queue.put(ramp[:480])
    assert queue.is_stalled
    queue.take(1)
    assert not queue.is_stalled


def test_a_device_takes_frames_until_it_is_closed(qapp: QApplication) -> None:
    miniaudio = pytest.importorskip("miniaudio")
    asked: list[int] = []

    def take(n_frames: int) -> Frames:
        asked.append(n_frames)
        return np.zeros((n_frames, 2), np.int16)

    device = open_device(take, [miniaudio.Backend.NULL])
    wait_until(lambda: len(asked) > 3)
    device.close()
    n = len(asked)
    assert all(frames > 0 for frames in asked) and len(asked) == n


def test_a_missing_package_or_device_is_a_sentence_with_the_cure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    miniaudio = pytest.importorskip("miniaudio")

    def refuse(*_: object, **__: object) -> None:
        raise miniaudio.MiniaudioError("failed to init device", -200)

    with monkeypatch.context() as patch:
        patch.setattr(miniaudio, "PlaybackDevice", refuse)
        with pytest.raises(WrongUse, match=r"failed to init device.*connect speakers"):
            open_device(lambda n: np.zeros((n, 2), np.int16))
    monkeypatch.setitem(sys.modules, "miniaudio", None)
    with pytest.raises(WrongUse, match="pip install miniaudio"):
        open_device(lambda n: np.zeros((n, 2), np.int16))


@pytest.fixture
def speaker() -> Speaker:
    """Return a sound device without sound."""
    return Speaker()


@pytest.fixture
def page(qapp: QApplication, engine: FakeEngine, speaker: Speaker) -> Iterator[LivePage]:
    """Yield a page with the strip Listen."""
    page = LivePage(LIGHT)
    page.sound.open_device = speaker.open
    page.resize(900, 700)
    page.show()
    engine.write_samples(1000)
    page.refresh(engine.live)
    click(page.bar.buttons[LISTEN])
    yield page
    page.close_files()
    assert not speaker.is_open
    page.close()
    engine.close()


def test_spikes_of_the_chosen_taxel_are_heard_from_the_choice_on(
    page: LivePage, engine: FakeEngine, speaker: Speaker
) -> None:
    sound = page.sound
    assert sound.chosen is Channel.NONE and speaker.take is None, "off at first"
    for _ in range(4):
        QTest.keyClick(page.plots.graphics, Qt.Key.Key_Down)
    sound.channel.setCurrentText(Channel.RA)
    assert page.sound_strip.sentence.text() == OPENING
    wait_until(lambda: "T5, RA: a click for each spike" in page.sound_strip.sentence.text())
    assert f"at most {LAG_MS} ms later" in page.sound_strip.sentence.text()
    engine.write_samples(1000)
    page.refresh(engine.live)
    speaker.listen()
    engine.write_samples(50, dense=0.2)
    page.refresh(engine.live)
    trains = engine.live.taxels(50).spikes[:, 18 + 4]
    begins = [48 * at for at in np.flatnonzero(trains).tolist()]
    loud, ended = speaker.listen()[: 50 * 48], len(CLICKS[0])  # of a click from before
    half = expected(50 * 48, 1, *begins) / 4
    assert half.any() and np.allclose(loud[ended:, 0], half[ended:], atol=1)
    sound.volume.setValue(0)
    engine.write_samples(50, dense=0.2)
    page.refresh(engine.live)
    speaker.listen()
    engine.write_samples(50, dense=0.2)
    page.refresh(engine.live)
    assert not speaker.listen().any()
    sound.channel.setCurrentText(Channel.NONE)
    wait_until(lambda: not speaker.is_open)


def test_a_device_that_cannot_be_opened_is_a_sentence_and_nothing_else(
    page: LivePage, engine: FakeEngine
) -> None:
    reports: list[tuple[str, str]] = []
    page.reported.connect(lambda *report: reports.append(report))

    def refuse(_: Take) -> Speaker:
        raise WrongUse("no sound: connect speakers")

    page.sound.open_device = refuse
    page.sound.channel.setCurrentText(Channel.SA)
    wait_until(lambda: bool(reports))
    assert reports == [("refused", "no sound: connect speakers")]
    assert page.sound.chosen is Channel.NONE
    assert page.sound_strip.sentence.text() == "no sound: connect speakers"
    engine.write_samples(100)
    page.refresh(engine.live)
    assert page.plots.data.history.newest == 1099


def test_a_device_that_stops_is_told_and_switched_off(
    page: LivePage, engine: FakeEngine, speaker: Speaker
) -> None:
    page.sound.channel.setCurrentText(Channel.SA)
    wait_until(lambda: "a click for each" in page.sound_strip.sentence.text())
    for _ in range(40):
        engine.write_samples(50)
        page.refresh(engine.live)
    assert page.sound_strip.sentence.text() == STOPPED
    assert page.sound.chosen is Channel.NONE
    wait_until(lambda: not speaker.is_open)


def test_a_choice_that_is_taken_back_while_the_device_opens_leaves_none_open(
    page: LivePage, speaker: Speaker
) -> None:
    page.sound.channel.setCurrentText(Channel.SA)
    page.sound.channel.setCurrentText(Channel.NONE)
    wait_until(lambda: speaker.take is not None and not speaker.is_open)
