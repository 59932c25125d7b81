"""Spikes of a neuron as clicks: from a history to frames of sound, and the queue of a device.

This module does not import Qt, and no device is needed for it.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from gui.live.sample_history import SampleHistory
from rigctl.values import SAMPLE_RATE_HZ

FRAME_RATE_HZ = 48_000
FRAMES_A_SAMPLE = FRAME_RATE_HZ // SAMPLE_RATE_HZ
QUEUE_MS = 70
"""Sound that waits for the device at most; what is older is not heard."""
MOST_FRAMES = QUEUE_MS * FRAMES_A_SAMPLE
STALLED_FRAMES = FRAME_RATE_HZ
"""A device that takes nothing of so many frames has stopped."""
SLOWEST, FASTEST = 0.1, 4.0
"""Speeds of a replay that is heard: beyond them, clicks stand apart or become a noise."""
CLICK_MS = 5
TONES_HZ = (600.0, 2400.0)
"""Pitch of the clicks of SA and of RA."""
DECAY_MS = 1.2
PEAK = 12_000.0
"""Of a click at full volume: two and more at a time do not clip."""

Frames = NDArray[np.int16]
Positions = NDArray[np.int64]


class Channel(StrEnum):
    """Neurons of a taxel that are heard."""

    NONE = "off"
    SA = "SA"
    RA = "RA"
    BOTH = "SA, RA"


EARS = {
    Channel.NONE: ((0.0, 0.0), (0.0, 0.0)),
    Channel.SA: ((1.0, 1.0), (0.0, 0.0)),
    Channel.RA: ((0.0, 0.0), (1.0, 1.0)),
    Channel.BOTH: ((1.0, 0.0), (0.0, 1.0)),
}
"""How loud SA and RA are, each in the left ear and in the right one."""


def _click(tone_hz: float) -> NDArray[np.float64]:
    time_s = np.arange(CLICK_MS * FRAMES_A_SAMPLE) / FRAME_RATE_HZ
    fades = np.exp(-1000 * time_s / DECAY_MS)
    return np.asarray(PEAK * np.sin(2 * np.pi * tone_hz * time_s) * fades, np.float64)


CLICKS = tuple(map(_click, TONES_HZ))
"""Sound of a spike of SA and of RA, float64 (frames,)."""


class ClickTrack:
    """Adds clicks up, block after block: one that its block ends in goes on in the next."""

    def __init__(self) -> None:
        self._rest = np.zeros((len(CLICKS[0]), 2))

    def render(
        self, onsets: tuple[Positions, Positions], n_frames: int, ears: NDArray[np.float64]
    ) -> Frames:
        """Return the next frames, int16 (n_frames, 2), left and right.

        ``onsets``: frames of the block in which spikes of SA and of RA begin. ``ears``: float64
        (2, 2), loudness of SA and of RA in each ear.
        """
        sound = np.concatenate([self._rest, np.zeros((n_frames, 2))])
        for click, loudness, begins in zip(CLICKS, ears, onsets, strict=True):
            shape = click[:, None] * loudness
            for begin in begins.tolist():
                sound[begin : begin + len(click)] += shape
        self._rest = sound[n_frames:]
        whole = np.rint(sound[:n_frames])
        return np.asarray(np.clip(whole, -32_768, 32_767), np.int16)


class SpikeListener:
    """Takes the spikes of a taxel from a history as its positions come to be shown."""

    def __init__(self) -> None:
        self._track = ClickTrack()
        self._source: tuple[SampleHistory | None, int] = (None, -1)
        self._heard = 0

    def hear(
        self,
        history: SampleHistory,
        position: int,
        taxel: int,
        ears: NDArray[np.float64],
        speed: float = 1.0,
    ) -> Frames:
        """Return the sound of the positions since the last call up to this one.

        At most the newest :data:`QUEUE_MS` of it; none in another history, after a step back, and
        at a speed that is not heard.
        """
        source, first = (history, history.generation), self._heard
        is_new = source != self._source or position < first or not SLOWEST <= speed <= FASTEST
        self._source, self._heard = source, position
        if is_new or position == first:
            return np.zeros((0, 2), np.int16)
        first = max(first, position - int(QUEUE_MS * speed))
        rows = history.counters.count_below(np.array([first + 1, position + 1]))
        positions = history.counters.between(int(rows[0]), int(rows[1]))
        spikes = history.spikes.between(int(rows[0]), int(rows[1]))
        trains = spikes[:, [taxel, spikes.shape[1] // 2 + taxel]] > 0
        frames = self._frame_of(positions - 1, speed) - self._frame_of(first, speed)
        n_frames = int(self._frame_of(position, speed) - self._frame_of(first, speed))
        return self._track.render((frames[trains[:, 0]], frames[trains[:, 1]]), n_frames, ears)

    @staticmethod
    def _frame_of(position: int | Positions, speed: float) -> Positions:
        return np.floor(np.asarray(position) * (FRAMES_A_SAMPLE / speed)).astype(np.int64)


class FrameQueue:
    """Frames between the window and the thread of a device, at most :data:`QUEUE_MS` of them."""

    def __init__(self) -> None:
        self._blocks: deque[Frames] = deque()
        self._lock, self._n_frames, self._since_taken = Lock(), 0, 0

    @property
    def is_stalled(self) -> bool:
        """Whether the device takes nothing any more."""
        return self._since_taken > STALLED_FRAMES

    def clear(self) -> None:
        """Remove all frames, as before another device."""
        with self._lock:
            self._blocks.clear()
            self._n_frames = self._since_taken = 0

    def put(self, block: Frames) -> None:
        """Append frames; the oldest go where too many wait."""
        with self._lock:
            self._since_taken += len(block)
            self._blocks.append(block)
            self._n_frames += len(block)
            self._drop(self._n_frames - MOST_FRAMES)

    def take(self, n_frames: int) -> Frames:
        """Return the next frames, int16 (n_frames, 2), silence where too few wait."""
        with self._lock:
            self._since_taken = 0
            waiting = np.concatenate([*self._blocks, np.zeros((n_frames, 2), np.int16)])
            self._drop(n_frames)
        return waiting[:n_frames]

    def _drop(self, n_frames: int) -> None:
        """Remove so many of the oldest frames, or all."""
        while self._blocks and n_frames > 0:
            block = self._blocks.popleft()
            if len(block) > n_frames:
                self._blocks.appendleft(block[n_frames:])
            self._n_frames -= min(len(block), n_frames)
            n_frames -= len(block)
