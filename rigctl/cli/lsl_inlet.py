"""``rigctl lsl-inlet``: record the LSL streams of other programs beside a session.

An engine starts it with a run. Each line of its input is the session's clock, read just before;
the input's end is that of the session.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.cli.arguments import a_path, add_option, number
from rigctl.cli.lsl import load_lsl
from rigctl.config.rig_config import stream_predicate
from rigctl.errors import DiskFault
from rigctl.session.extra_stream import (
    CLOCK,
    END,
    MARKERS,
    SESSION_CLOCK,
    TEXT_CODE,
    marker_row,
    next_stream_path,
    stream_attributes,
    stream_layout,
)
from rigctl.session.hdf5_file import system_reason
from rigctl.session.layout import clip_text
from rigctl.session.writer import PartWriter
from rigctl.values import Gap

LOOK_S = 0.05
FLUSH_S = 1.0
CORRECT_S = 5.0
"""How often the sender's clock is compared; liblsl measures in the background."""
ABSENT_S = 5.0
"""A stream that is not there for so long, or sends nothing, is told once."""
CONNECT_S = 5.0
MOST_ROWS = 4096
XML_BYTES = 60_000
"""HDF5 keeps no longer attribute."""
LONGEST_NAME = 120
WRITE_ERRORS = (OSError, RuntimeError, DiskFault)
"""What a full disk and HDF5 raise."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path)
    parser.add_argument("--stream", action="append", default=[])
    parser.add_argument("--start-utc", default="")
    add_option(parser, "--start-loop-s", number(0.0, 1e12), default=0.0)


def run(args: argparse.Namespace) -> int:
    """Record until the input ends. Raises WrongUse without pylsl."""
    lsl = load_lsl()
    begun = {"start_utc": args.start_utc, "start_loop_s": args.start_loop_s}
    clock = _SessionClock(lsl)
    streams = [_Wanted(lsl, words, args.session, begun, clock) for words in args.stream]
    while True:
        has_ended = clock.has_ended
        for stream in streams:
            stream.update()
        if has_ended:
            break
        time.sleep(LOOK_S)
    for stream in streams:
        stream.end("ended with the session")
    return 0


class _SessionClock:
    """The readings of the session's clock: a thread takes the time at which each arrives."""

    def __init__(self, lsl: Any) -> None:
        self._lsl = lsl
        self.readings: deque[tuple[float, float]] = deque(maxlen=100_000)
        self.count = 0
        self.has_ended = False
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            self.readings.append((float(line), self._lsl.local_clock()))
            self.count += 1
        self.has_ended = True

    def since(self, seen: int) -> list[tuple[float, float]]:
        """Return the readings after the first ``seen``."""
        new = self.count - seen
        return list(self.readings)[-new:] if new else []


@dataclass(frozen=True, slots=True)
class _Block:
    """Rows of a stream of numbers, as :class:`~rigctl.session.writer.SampleBlock` wants them."""

    counters: NDArray[np.int64]
    values: NDArray[Any]
    lsl_s: NDArray[np.float64]
    gaps: tuple[Gap, ...] = ()
    arrived_s: float = 0.0

    def __len__(self) -> int:
        return len(self.counters)


class _Wanted:
    """One stream that is asked for: looked for, recorded, and looked for again where it ends."""

    def __init__(
        self, lsl: Any, words: str, folder: Path, begun: dict[str, Any], clock: _SessionClock
    ) -> None:
        self._lsl, self._words, self._folder = lsl, words, folder
        self._begun, self._clock = begun, clock
        self._resolver = lsl.ContinuousResolver(pred=stream_predicate(words))
        self._since_s = lsl.local_clock()
        self._is_told = False
        self._lost: set[str] = set()
        self._recording: _Recording | None = None
        self._has_failed = False

    def update(self) -> None:
        """Take what has come; connect where the stream has appeared."""
        if self._has_failed:
            return
        try:
            if self._recording is None:
                self._look()
            else:
                self._take(self._recording)
        except self._lsl.util.LostError:
            self._lose()
        except WRITE_ERRORS as error:
            self._fail(error)

    def end(self, reason: str) -> None:
        """Close the file, if there is one."""
        recording, self._recording = self._recording, None
        if recording is None:
            return
        try:
            recording.close(reason)
        except WRITE_ERRORS as error:
            self._recording = recording
            self._fail(error)

    def _look(self) -> None:
        found = sorted(self._resolver.results(), key=lambda info: str(info.uid()))
        new = [info for info in found if info.uid() not in self._lost]
        if not new:
            self._tell_once(
                f"there is no LSL stream {self._words}: the run goes on without it, and records it "
                "as soon as it is there"
            )
            return
        uid = new[0].uid()
        try:
            inlet = self._lsl.StreamInlet(new[0], max_buflen=360, recover=False)
            info = inlet.info(timeout=CONNECT_S)
            inlet.open_stream(timeout=CONNECT_S)
            correction_s = inlet.time_correction(timeout=CONNECT_S)
        except (self._lsl.util.LostError, self._lsl.util.TimeoutError):
            self._lost.add(uid)  # it went away while it was being connected
            return
        begun = {**self._begun, "asked": self._words}
        self._recording = _Recording(self._lsl, inlet, info, correction_s, self._folder, begun)
        self._restart()
        _say(f"recording {self._recording.title}")

    def _take(self, recording: _Recording) -> None:
        n_rows = recording.take(self._clock)
        if n_rows:
            if self._is_told:
                _say(f"{recording.title} sends again")
            self._restart()
        elif recording.is_regular:
            self._tell_once(f"{recording.title} sends nothing: look at its sender")

    def _lose(self) -> None:
        assert self._recording is not None
        title, self._lost = self._recording.title, {*self._lost, self._recording.uid}
        self.end("its sender has ended")
        self._is_told = True
        _say(f"{title} has ended: the run goes on, and records it again when it is back")

    def _fail(self, error: Exception) -> None:
        reason = error if isinstance(error, DiskFault) else system_reason(error)
        recording, self._recording, self._has_failed = self._recording, None, True
        if recording is not None:
            recording.abandon()
        _say(f"the stream {self._words} cannot be written ({reason}): its record ends here")

    def _restart(self) -> None:
        self._since_s, self._is_told = self._lsl.local_clock(), False

    def _tell_once(self, sentence: str) -> None:
        if not self._is_told and self._lsl.local_clock() - self._since_s > ABSENT_S:
            self._is_told = True
            _say(sentence)


class _Recording:
    """The file of one sender, from its connection to its end."""

    def __init__(
        self,
        lsl: Any,
        inlet: Any,
        info: Any,
        correction_s: float,
        folder: Path,
        begun: dict[str, Any],
    ) -> None:
        self._lsl, self._inlet = lsl, inlet
        self.uid = info.uid()
        self.title = f"the stream {info.name()[:LONGEST_NAME]} of {info.hostname()}"
        self.is_regular = info.nominal_srate() != lsl.IRREGULAR_RATE
        type_code = _type_code(lsl, info)
        self._is_text = type_code == TEXT_CODE
        n_channels = info.channel_count()
        attributes = stream_attributes(
            type_code=type_code,
            channels=_named(info.get_channel_labels(), n_channels, "channel"),
            units=_named(info.get_channel_units(), n_channels, ""),
            name=info.name()[:LONGEST_NAME],
            kind=info.type()[:LONGEST_NAME],
            host=info.hostname()[:LONGEST_NAME],
            source_id=info.source_id()[:LONGEST_NAME],
            rate_hz=float(info.nominal_srate()),
            description=clip_text(info.as_xml(), XML_BYTES).decode(),
            **begun,
        )
        layout = stream_layout(type_code)
        path = next_stream_path(folder)
        self._part = PartWriter(path, layout, attributes, n_channels, ("", ""))
        self._n_rows = self._n_readings = 0
        self._flushed_s = self._corrected_s = lsl.local_clock()
        self._part.add_rows(CLOCK, [(self._corrected_s, correction_s)])

    def take(self, clock: _SessionClock) -> int:
        """Record what has come; return the number of its rows."""
        n_rows = 0
        while count := self._pull():
            n_rows += count
            if count < MOST_ROWS:
                break
        self._add_clocks(clock)
        if self._lsl.local_clock() - self._flushed_s > FLUSH_S:
            self._part.write()
            self._flushed_s = self._lsl.local_clock()
        return n_rows

    def _pull(self) -> int:
        """Record at most :data:`MOST_ROWS` rows; return their number."""
        is_numbers = not self._is_text
        values, stamps = self._inlet.pull_chunk(0.0, MOST_ROWS, as_numpy=is_numbers)
        count = len(stamps)
        if not count:
            return 0
        if self._is_text:
            self._part.add_rows(MARKERS, list(map(marker_row, stamps, values)))
        else:
            counters = np.arange(self._n_rows, self._n_rows + count, dtype=np.int64)
            self._part.add_samples(_Block(counters, values.copy(), stamps.copy()))
        self._n_rows += count
        return count

    def _add_clocks(self, clock: _SessionClock) -> None:
        new = clock.since(self._n_readings)
        self._n_readings += len(new)
        self._part.add_rows(SESSION_CLOCK, new)
        if self._lsl.local_clock() - self._corrected_s > CORRECT_S:
            self._corrected_s = self._lsl.local_clock()
            correction_s = self._inlet.time_correction(timeout=0.1)
            self._part.add_rows(CLOCK, [(self._corrected_s, correction_s)])

    def close(self, reason: str) -> None:
        """Write what is left, close the file and print its last digest."""
        self._part.add_rows(END, [(self._n_rows, clip_text(reason, 128))])
        self._part.write()
        self._part.sync()
        self._part.close()
        print(json.dumps({self._part.path.name: self._part.last_digest}), flush=True)

    def abandon(self) -> None:
        """Leave the file as its last whole flush was."""
        self._part.abandon()


def _type_code(lsl: Any, info: Any) -> str:
    codes = {
        lsl.cf_float32: "f4",
        lsl.cf_double64: "f8",
        lsl.cf_int8: "i1",
        lsl.cf_int16: "i2",
        lsl.cf_int32: "i4",
        lsl.cf_int64: "i8",
    }
    return codes.get(info.channel_format(), TEXT_CODE)


def _named(given: list[str | None] | None, n_channels: int, default: str) -> tuple[str, ...]:
    """Return a text for each channel; with a ``default``, all differ and none is empty."""
    texts = [str(each or "")[:LONGEST_NAME] for each in (given or [])[:n_channels]]
    texts += [""] * (n_channels - len(texts))
    if not default:
        return tuple(texts)
    numbered = [text or f"{default} {n}" for n, text in enumerate(texts, start=1)]
    if len(set(numbered)) < n_channels:
        numbered = [f"{text} {n}" for n, text in enumerate(numbered, start=1)]
    return tuple(numbered)


def _say(sentence: str) -> None:
    print(sentence, flush=True)
