"""Listen to the spikes of a taxel: the controls, and the sound device behind them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from PySide6.QtCore import QObject, QSignalBlocker, Signal
from PySide6.QtWidgets import QWidget

from gui.live.sample_history import SampleHistory
from gui.live.spike_clicks import (
    EARS,
    FRAME_RATE_HZ,
    QUEUE_MS,
    Channel,
    FrameQueue,
    Frames,
    SpikeListener,
)
from gui.widgets.background import Background
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import ComboBox, FlowLayout, vbox
from gui.widgets.number_box import WholeNumberBox
from rigctl.errors import WrongUse

PERIOD_MS, PERIODS = 10, 3
LAG_MS = QUEUE_MS + PERIOD_MS * PERIODS
"""Between a spike in the window and its click, at most."""
NULL = "Null"
"""The backend without a device."""
NO_PACKAGE = (
    "no sound: the Python package miniaudio is not installed; install it (pip install miniaudio), "
    "then choose the neuron again"
)
NO_DEVICE = (
    "no sound: no sound device can be opened ({reason}); connect speakers or headphones and see "
    "that other programs are heard, then choose the neuron again"
)
STOPPED = "no sound: the sound device has stopped; connect it, then choose the neuron again"
OPENING = "opening the sound device …"
SILENT = "Choose a neuron: each of its spikes becomes a click."
TIP = (
    "Spikes of the taxel that is chosen in the plots (a click on its band, or the keys Up and "
    "Down): a low click for SA, a high one for RA; of both SA left, RA right"
)
CLOSE_TIMEOUT_S = 5.0
"""A sound server may hang."""
Take = Callable[[int], Frames]


class SoundDevice(Protocol):
    """A device that takes frames by itself, until it is closed."""

    def close(self) -> None:
        """Take no more."""


def open_device(take: Take, backends: Sequence[Any] = ()) -> SoundDevice:
    """Let the computer's sound device take frames from a thread of its own.

    Opening one may take a second. Raises WrongUse where there is none.
    """
    try:
        import miniaudio
    except ImportError as error:
        raise WrongUse(NO_PACKAGE) from error
    try:
        device = miniaudio.PlaybackDevice(
            miniaudio.SampleFormat.SIGNED16,
            nchannels=2,
            sample_rate=FRAME_RATE_HZ,
            buffersize_msec=PERIOD_MS,
            callback_periods=PERIODS,
            backends=list(backends),
            app_name="rigctl",
        )
        if device.backend == NULL and not backends:
            device.close()
            raise WrongUse(NO_DEVICE.format(reason="the system knows none"))
        frames = _frames(take)
        next(frames)
        device.start(frames)
    except miniaudio.MiniaudioError as error:
        raise WrongUse(NO_DEVICE.format(reason=", ".join(map(str, error.args)))) from error
    opened: SoundDevice = device
    return opened


def _frames(take: Take) -> Generator[Frames, int, None]:
    sound = np.zeros((0, 2), np.int16)
    while True:
        n_frames = yield sound
        sound = take(n_frames)


class SpikeSound(QObject):
    """The controls, off at first; the device is open while a neuron is chosen."""

    told = Signal(str)
    """What is heard, or why nothing is."""
    failed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.open_device: Callable[[Take], SoundDevice] = open_device
        self.channel, self.volume = ComboBox(), WholeNumberBox(minimum=0, maximum=100, value=50)
        self.channel.addItems(list(Channel))
        self.channel.setToolTip(TIP)
        self.channel.setAccessibleName("Neuron to listen to")
        self.volume.setPrefix("Volume ")
        self.volume.setSuffix(" %")
        self.volume.setToolTip("Volume of the clicks")
        self._taxel = 0
        self._device: SoundDevice | None = None
        self._queue, self._listener = FrameQueue(), SpikeListener()
        self._background = Background("rigctl-sound")
        self._is_opening = False
        self.channel.currentIndexChanged.connect(lambda _: self._switch())

    @property
    def controls(self) -> tuple[QWidget, ...]:
        """Neuron and volume."""
        return label("Listen to"), self.channel, self.volume

    @property
    def chosen(self) -> Channel:
        """The neurons that are to be heard."""
        return Channel(self.channel.currentText())

    def show_taxel(self, taxel: int) -> None:
        """Listen to another taxel, from 0."""
        self._taxel = taxel
        self._tell()

    def follow(self, history: SampleHistory, position: int, speed: float = 1.0) -> None:
        """Let the spikes be heard up to a position, at a speed of the replay."""
        if self._device is None:
            return
        if self._queue.is_stalled:
            self._fail(STOPPED)
        elif self._taxel < history.spikes.between(0, 0).shape[1] // 2:
            loudness = (self.volume.value() / 100) ** 2  # as loudness is heard
            ears = loudness * np.array(EARS[self.chosen])
            self._queue.put(self._listener.hear(history, position, self._taxel, ears, speed))

    def close_files(self) -> None:
        """Close the device, as before the window closes."""
        self._background.close(CLOSE_TIMEOUT_S)
        if self._device is not None:
            self._device.close()

    def _switch(self) -> None:
        if self.chosen is Channel.NONE:
            self._close()
        elif self._device is None and not self._is_opening:
            self._is_opening = True
            self._queue.clear()
            self._background.run(self._open, self._end_opening, self._fail)
        self._tell()

    def _open(self) -> None:
        self._device = self.open_device(self._queue.take)

    def _end_opening(self, _: None) -> None:
        """Go on with what is chosen by now."""
        self._is_opening = False
        self._switch()

    def _fail(self, sentence: str) -> None:
        self._is_opening = False
        with QSignalBlocker(self.channel):
            self.channel.setCurrentText(Channel.NONE)
        self._close()
        self.told.emit(sentence)
        self.failed.emit(sentence)

    def _close(self) -> None:
        """Close the device in a thread: the system may take a while."""
        device, self._device = self._device, None
        if device is not None:
            self._background.run(device.close, _ignore, _ignore)

    def _tell(self) -> None:
        if self.chosen is Channel.NONE:
            self.told.emit(SILENT)
        elif self._is_opening:
            self.told.emit(OPENING)
        else:
            heard = f"T{self._taxel + 1}, {self.chosen}"
            self.told.emit(f"{heard}: a click for each spike, at most {LAG_MS} ms later")


class SoundStrip(QWidget):
    """The controls in a row above what is heard."""

    def __init__(self, sound: SpikeSound) -> None:
        super().__init__()
        self.sentence = ElidedLabel(SILENT, "muted")
        row = FlowLayout(*sound.controls)
        self.setLayout(vbox(row, self.sentence, spacing=2, margins=(6, 0, 6, 0)))
        sound.told.connect(partial(show_text, self.sentence))


def _ignore(_: object) -> None:
    pass
