"""Looks at a session while it is recorded: what is new, and the newest trial's spikes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from rigctl.cli.progress import clock
from rigctl.config.text_file import is_plain_file
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.engine.rpc.client import find_engines
from rigctl.engine.rpc.messages import RunStatus, reason_words
from rigctl.errors import SessionError, WrongUse
from rigctl.experiments import EXPERIMENTS
from rigctl.session import layout
from rigctl.session.layout import PROTOCOL_FILE, parse_event
from rigctl.session.part import existing_parts
from rigctl.session.session import Session, open_session
from rigctl.session.session_reader import SessionReader
from rigctl.session.writer_lock import LOCK_FILE, Writer, lock_owner_pid, writer_of
from rigctl.values import Spikes, Verdict

PAST_EVENTS = 20
"""Of the time before, which are shown first."""
RASTER_ROWS = 9
"""Lines of each channel; neighbouring taxels share one."""
BLOCKS, LETTERS = " ▁▂▃▄▅▆▇█", " .:-=+*#@"
"""Few spikes to many, for terminals with and without Unicode."""
NOTHING_YET = "nothing is recorded yet: it begins with the first plate"


class TrialRaster(NamedTuple):
    """Spikes of a trial: for each channel its name, and of each taxel the samples with a spike."""

    title: str
    channels: Sequence[tuple[str, Sequence[NDArray[np.int32]]]]
    n_samples: int

    def lines(self, columns: int, marks: str = BLOCKS) -> list[str]:
        """Return the title and the spikes as lines of text, time from left to right."""
        lines = [self.title]
        for name, trains in self.channels:
            lines += channel_lines(name, trains, self.n_samples, columns, marks)
        return lines


class Look(NamedTuple):
    """What one look at a session found: what is new, a line about it, and the writer's fate.

    ``doing``: what the run does or waits for, empty where no engine tells; ``not_good``: what was
    repeated, given up or put into quarantine; ``raster``: of the newest trial; ``simulated``: the
    session is of a simulated bench.
    """

    news: list[str]
    line: str
    has_ended: bool = False
    is_gone: bool = False
    doing: str = ""
    not_good: Sequence[str] = ()
    raster: TrialRaster | None = None
    simulated: bool = False


def looks(
    folder: Path, columns: int = 0, marks: str = BLOCKS, *, with_raster: bool = False
) -> Iterator[Look]:
    """Yield what is new in a session's folder each time; at first its latest events.

    ``columns``: of the raster of each new trial as text, 0 for none; ``marks``: those of few spikes
    to many. ``with_raster``: each look has the spikes themselves. Before its first part, and while
    the folder cannot be read, only the line says so. Raises SessionError for a folder that is no
    session.
    """
    was_gone, doing = False, ""
    while _is_prepared(folder):
        is_gone = writer_of(folder) is Writer.GONE
        before, doing = doing, doing_words(run_of(folder))
        news = _if_new(before, doing)
        yield Look(news, NOTHING_YET, is_gone=is_gone and was_gone, doing=doing)
        was_gone = is_gone
    with open_session(folder) as session:
        watched = _Watched(session, columns, marks, doing, with_raster)
        while True:
            try:
                yield watched.look()
                session.refresh()
            except (SessionError, OSError) as error:
                yield Look([], f"the session cannot be read now: {error}")
                with suppress(SessionError, OSError):
                    session.refresh()  # what failed would fail again: its file is opened anew


class _Watched:
    """A session with a part, of which each look finds what is new since the one before."""

    def __init__(
        self, session: SessionReader, columns: int, marks: str, doing: str, with_raster: bool
    ) -> None:
        self._session = session
        self._columns, self._marks = columns, marks
        self._draws = with_raster or bool(columns)
        self._raster: TrialRaster | None = None
        self._part, self._row = session.parts[-1].number, max(0, self._n_events - PAST_EVENTS)
        self._earlier = not_good(session)
        self._newest = -1
        self._doing = doing
        self._was_gone = False

    def look(self) -> Look:
        """Return what is new. Raises SessionError or OSError while the folder cannot be read."""
        session, run = self._session, run_of(self._session.path)
        before, self._doing = self._doing, doing_words(run)
        news = [*self._new_events(), *self._new_raster(), *_if_new(before, self._doing)]
        is_gone = not session.finished and writer_of(session.path) is Writer.GONE
        was_gone, self._was_gone = self._was_gone, is_gone
        has_ended = session.finished and lock_owner_pid(session.path) is None
        # Two looks must agree that it is gone: a new writer takes the lock first.
        found = (self._doing, not_good(session), self._raster, session.header.simulated)
        return Look(news, _line(session, run), has_ended, is_gone and was_gone, *found)

    @property
    def _n_events(self) -> int:
        return self._session.parts[-1].n_rows(layout.EVENTS)

    def _new_events(self) -> list[str]:
        """Return the texts of new events; at first after what was not good before them."""
        found: list[str] = []
        for part in self._session.parts:
            if part.number >= self._part:
                rows = part.rows(layout.EVENTS, self._row if part.number == self._part else 0)
                found += [parse_event(event, part.path).text for event in rows]
        self._part, self._row = self._session.parts[-1].number, self._n_events
        earlier, self._earlier = [text for text in self._earlier if text not in found], []
        return earlier + [text for text in found if text]

    def _new_raster(self) -> list[str]:
        """Return the spikes of the newest trial, once."""
        newest = int(self._session.committed().max(initial=-1))
        if not self._draws or newest == self._newest:
            return []
        self._newest = newest
        read = EXPERIMENTS[self._session.layout.experiment].load("raster")
        raster: TrialRaster = read(self._session, newest)
        self._raster = raster
        return raster.lines(self._columns, self._marks) if self._columns else []


def trial_raster(session: Session, index: int) -> TrialRaster:
    """Return the spikes of a trial, as the live encoder gives them.

    Without a calibration of the taxels, the trial's own range is theirs.
    """
    readings, parameters = session.readings(index), session.header.encoder_parameters
    own = Normalisation.from_samples([readings], "this trial", parameters.reading)
    ranges = session.header.calibrated_ranges or own
    gain = session.header.gain(ranges)
    (spikes,) = encode_trials([readings], ranges, parameters, gains=[gain] if gain else ())
    trial = session.trial_row(index).trial
    press = f"{trial.depth_mm:g} mm" if trial.depth_mm else f"{trial.force_g:g} g"
    title = (
        f"trial {trial.trial_id} ({trial.texture}, {trial.speed_mm_s:g} mm/s, {press}), "
        f"{len(readings)} ms:"
    )
    return spike_raster(title, spikes)


def spike_raster(title: str, spikes: Spikes) -> TrialRaster:
    """Return spikes by channel, SA above RA."""
    n = spikes.n_trains // 2
    channels = [
        (name, [spikes.train(first + taxel) for taxel in range(n)])
        for name, first in (("SA ", 0), ("RA ", n))
    ]
    return TrialRaster(title, channels, spikes.n_samples)


def channel_lines(
    name: str, trains: Sequence[NDArray[np.int32]], n_samples: int, columns: int, marks: str
) -> list[str]:
    """Return the spikes of one channel, lines that begin with its name.

    ``trains``: of each taxel the samples with a spike. A mark is the count of some taxels in a
    share of the time, beside the channel's largest.
    """
    n_rows = min(len(trains), RASTER_ROWS)
    counts = np.zeros((n_rows, columns - len(name)), np.int64)
    for taxel, train in enumerate(trains):
        at = train.astype(np.int64) * counts.shape[1] // n_samples
        np.add.at(counts[taxel * n_rows // len(trains)], at, 1)
    levels = -(-counts * (len(marks) - 1) // max(1, counts.max()))
    return [name + "".join(marks[level] for level in row) for row in levels]


def run_of(folder: Path) -> RunStatus:
    """Return the run that an engine of this computer records into a folder, an idle one if none."""
    with suppress(WrongUse):  # there is no folder for engines, so there is none
        for found in find_engines():
            if found.has_run and Path(str(found.run["session"])).resolve() == folder.resolve():
                return msgspec.convert(found.run, RunStatus)
    return RunStatus()


def doing_words(run: RunStatus) -> str:
    """Return what a run does or waits for, empty where no engine tells."""
    if run.prompt:
        return f"waits for an answer: {run.prompt.text}"
    if run.state == "paused":
        return f"paused: {reason_words(run.reasons)}"
    if now := run.current:
        return f"trial {run.trial_id}: {now.texture}, {now.speed_mm_s:g} mm/s, {now.force_g:g} g"
    return ""


def due_words(run: RunStatus) -> list[str]:
    """Return when the next plate is due and when the run ends, as far as an engine tells."""
    words = []
    if plate := run.next_plate:
        more = f" and {plate.trials} more" if plate.trials else ""
        words.append(f"plate {plate.texture} in {clock(plate.left_s)}, after this trial{more}")
    return [*words, f"end in {clock(run.eta_s)}"] if run.eta_s is not None else words


def _if_new(before: str, text: str) -> list[str]:
    return [text] if text not in ("", before) else []


def not_good(session: SessionReader) -> list[str]:
    """Return what was repeated or given up so far, or put into quarantine, and why."""
    rows = session.trials
    rejected = np.flatnonzero(rows["verdict"] == Verdict.REJECTED.value).tolist()
    texts = {i: f"trial {rows[i]['trial_id']} rejected: {rows[i]['reasons']}" for i in rejected}
    texts |= session.quarantined()
    return [texts[index] for index in sorted(texts)[-PAST_EVENTS:]]


def _is_prepared(folder: Path) -> bool:
    """Return whether a recorder has prepared a folder, and no part was ever begun in it."""
    prepared = all(is_plain_file(folder / name) for name in (LOCK_FILE, PROTOCOL_FILE))
    return prepared and not existing_parts(folder)


def _line(session: SessionReader, run: RunStatus) -> str:
    committed, planned = len(session.committed()), session.header.trials_planned
    rejected = int((session.trials["verdict"] == Verdict.REJECTED.value).sum())
    lost = int(session.gaps["count"].sum())
    age_s = max(0.0, time.time() - session.parts[-1].path.stat().st_mtime)
    parts = [f"{committed} of {planned} trials, {rejected} rejected"]
    if n_quarantined := len(session.quarantined()):
        parts[0] += f", {n_quarantined} in quarantine"
    parts += due_words(run)
    parts += [f"{session.n_samples} samples, {lost} lost", f"newest data {age_s:.1f} s old"]
    return "; ".join(parts)
