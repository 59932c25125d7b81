"""Read a session of the drum, also while a writer appends to it, or open one of any experiment.

A session says too which planned trials were not recorded because their conditions ended early, by
rule.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from rigctl.boards.drum_states import State
from rigctl.config.rig_config import RigConfig, parse_config
from rigctl.encoder.reading import Reading, conductance, input_of_each
from rigctl.errors import RigctlError, SessionError
from rigctl.experiments import EXPERIMENTS
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import (
    QUANTITY_NAMES,
    Condition,
    EarlyEnd,
    Plan,
    Protocol,
    condition_of,
)
from rigctl.session import layout
from rigctl.session.header import ADC_COUNTS, IMPORTED, session_inputs, session_wiring
from rigctl.session.layout import SAMPLES, SessionLayout, parse_trial
from rigctl.session.notes import Mark, SessionNote, write_note
from rigctl.session.part import PartReader, StructuredArray, session_layout
from rigctl.session.sample_index import SampleFile, SampleRange, locate_samples, locate_windows
from rigctl.session.session_reader import NOTE_KIND, SessionReader, read_closing_digest
from rigctl.values import SAMPLE_RATE_HZ, Gap, TrialMark, TrialRow, Verdict

SCALING_KIND = "scaling"
"""Kind of an import's events with the scale of the stored counts, one for each taxel."""


@dataclass(frozen=True, slots=True)
class TrialSamples:
    """Received samples of one trial's window.

    ``samples``: uint16 (n, n_taxels); ``counters``: int64 (n,); ``flags``, ``edges``:
    uint8 (n,). n is ``count`` less the lost samples, which ``gaps`` lists by the board's counter.
    """

    first_counter: int
    count: int
    samples: NDArray[np.uint16]
    counters: NDArray[np.int64]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]

    @property
    def complete(self) -> bool:
        """Whether no sample of the window is missing."""
        return len(self.counters) == self.count

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Runs of missing samples in the window."""
        end = self.first_counter + self.count
        bounds = np.concatenate([[self.first_counter - 1], self.counters, [end]])
        before = np.flatnonzero(np.diff(bounds) > 1)
        return tuple(
            Gap(int(bounds[i]) + 1, int(bounds[i + 1] - bounds[i]) - 1, "missing") for i in before
        )


@dataclass(frozen=True, slots=True)
class TrialDrum:
    """Drum polls and load-cell samples of one attempt, with its approach and retraction.

    ``polls``: rows of /drum; ``loadcell``: rows of /loadcell. ``polls_s`` and ``loadcell_s``
    (float64) are seconds since the rise of sync by the drum's clock, NaN without a window.
    """

    polls: StructuredArray
    loadcell: StructuredArray
    polls_s: NDArray[np.float64]
    loadcell_s: NDArray[np.float64]


class Session(SessionReader):
    """Reader of a session of the drum."""

    layout: ClassVar[SessionLayout] = layout.DRUM_LAYOUT

    @property
    def config(self) -> RigConfig:
        """Parsed description of the rig. Raises ConfigError."""
        return parse_config(self.rig_text, str(self.path / layout.RIG_FILE))

    @property
    def wiring(self) -> tuple[int, ...]:
        """Reading of the taxel wire in each column of the samples; empty if unknown."""
        return session_wiring(self.header, self.parts[0].text("/rig_toml"))

    @property
    def inputs(self) -> tuple[int, ...]:
        """Analog input of each column of the samples, for conductances. Raises WrongUse."""
        is_counted = self.header.sample_unit == ADC_COUNTS and self.header.rig != IMPORTED
        wiring = self.header.wiring or self.wiring
        n_inputs = session_inputs(self.parts[0].text("/rig_toml"))
        return input_of_each(wiring if is_counted else (), n_inputs, str(self.path))

    def readings(self, index: int) -> NDArray[np.uint16]:
        """Return a trial's samples as the live encoder took them, uint16 (n, n_taxels)."""
        samples = np.ascontiguousarray(self.samples(index))
        if self.header.encoder_reading == Reading.COUNTS:
            return samples
        return conductance(samples, self.inputs)

    @property
    def scaling(self) -> tuple[tuple[float, float], ...]:
        """Offset and scale of each taxel's stored counts; empty if the counts are the readings."""
        data = [event.data for event in self.events_of(SCALING_KIND)]
        values = [each.get(name) for each in data for name in ("offset", "scale")]
        if not all(isinstance(value, float | int) for value in values):
            raise SessionError(f"{self.path} is damaged: a scaling in /events has no numbers")
        pairs = tuple((float(each["offset"]), float(each["scale"])) for each in data)
        return () if all(pair == (0.0, 1.0) for pair in pairs) else pairs

    def loadcell_lost(self) -> int:
        """Return the number of load-cell samples that the host never received."""
        return sum(int(part.rows(layout.DRUM)["loadcell_lost"].sum()) for part in self.parts)

    def trial_marks(self, index: int) -> tuple[TrialMark, ...]:
        """Return the notes on an attempt, and those that were written while it was recorded."""
        row = self.trials[index]
        about = int(row["trial_id"]), int(row["attempt"])
        notes = [note for note in self.notes if (note.trial_id, note.attempt) == about]
        marks = [TrialMark(note.at_s or 0.0, note.text) for note in notes]
        return tuple(sorted((*marks, *self._moments(index))))

    def _moments(self, index: int) -> list[TrialMark]:
        """Return the notes that were written while an attempt was recorded."""
        row, drum = self.trials[index], self.drum(index)
        known = np.isfinite(drum.polls_s)
        return [
            TrialMark(float(np.interp(event.at_s, drum.polls["at_s"], drum.polls_s)), event.text)
            for event in (self.events_of(NOTE_KIND) if known.any() else ())
            if row["started_s"] <= event.at_s <= row["ended_s"] and not event.data.get("trial_id")
        ]

    def trial_row(self, index: int) -> TrialRow:
        """Return one attempt."""
        return parse_trial(self.trials[index])

    def sample_files(self) -> tuple[SampleFile, ...]:
        """Return the chunk index of the samples of each of ``parts``."""
        return tuple(map(locate_samples, self.parts))

    def sample_ranges(self, indices: Sequence[int], first_file: int = 0) -> list[SampleRange]:
        """Return the rows of trials' windows; ``first_file`` is the first part's ``file``.

        Raises SessionError for a part that is missing or that HDF5 cannot read.
        """
        rows = self.trials[list(indices)]
        ranges: dict[int, SampleRange] = {}
        for number, part in enumerate(self.parts):
            chosen = np.flatnonzero(rows["part"] == part.number)
            windows = locate_windows(part, rows[chosen], first_file + number)
            ranges.update(zip(chosen.tolist(), windows, strict=True))
        if len(ranges) < len(rows):
            lost = rows[min(set(range(len(rows))) - set(ranges))]
            raise SessionError(
                f"{self.path}: trial {lost['trial_id']} should be in part {lost['part']}, "
                "which is missing"
            )
        return [ranges[i] for i in range(len(rows))]

    def window(self, index: int) -> TrialSamples:
        """Return one trial's window with counters, flags and gaps."""
        part, start, stop = self._rows_of(index)
        row = self.trials[index]
        return TrialSamples(
            int(row["first_counter"]),
            int(row["count"]),
            *(part.read(array.path, start, stop) for array in layout.TAXEL_ARRAYS),
        )

    def lifted_samples(self, index: int, drum: TrialDrum, n: int) -> NDArray[np.uint16]:
        """Return the last ``n`` readings before the approach, uint16 (up to n, n_taxels).

        ``drum``: that of the attempt. None are known where the drum was in contact already, or has
        no polls.
        """
        pressing = np.flatnonzero(drum.polls["state"] == State.APPROACH)
        if not len(pressing) or not np.isfinite(drum.polls_s[pressing[0]]):
            return np.zeros((0, self.header.n_taxels), np.uint16)
        part, start, _ = self._rows_of(index)
        end = max(0, start + int(drum.polls_s[pressing[0]] * SAMPLE_RATE_HZ))
        return part.read(SAMPLES, max(0, end - n), end)

    def drum(self, index: int, first_s: float = -np.inf, end_s: float = np.inf) -> TrialDrum:
        """Return the polls and load-cell samples between an attempt's start and end.

        ``first_s``, ``end_s``: read only the polls of this time since the rise of sync and one
        beyond each end, and the load-cell samples between them.
        """
        row = self.trials[index]
        part = self._part(int(row["part"]))
        polls = part.rows_between(layout.DRUM, "at_s", row["started_s"], row["ended_s"])
        rise_us = float(polls["sync_rise_us"][-1]) if len(polls) else np.nan
        if row["first_counter"] < 0:
            rise_us = np.nan
        outside_s = (polls["board_time_us"] - rise_us) * 1e-6
        before, after = (outside_s < first_s).sum(), (outside_s >= end_s).sum()
        polls = polls[max(0, before - 1) : len(polls) - max(0, after - 1)]
        loadcell = _loadcell_of(part, polls)
        return TrialDrum(
            polls,
            loadcell,
            (polls["board_time_us"] - rise_us) * 1e-6,
            (loadcell["board_time_us"] - rise_us) * 1e-6,
        )


def _loadcell_of(part: PartReader, polls: StructuredArray) -> StructuredArray:
    """Return the load-cell samples between the first and the last poll."""
    if not len(polls):
        return part.rows(layout.LOADCELL, 0, 0)
    board_us = polls["board_time_us"]
    return part.rows_between(layout.LOADCELL, "board_time_us", board_us[0], board_us[-1])


def open_session(path: Path) -> SessionReader:
    """Open a session with the reader of its experiment.

    Raises SessionError if no part can be read, and for another kind of folder.
    """
    reader: type[SessionReader] = EXPERIMENTS[session_layout(path).experiment].load("reader")
    return reader.open(path)


def add_note(folder: Path, note: SessionNote) -> Path:
    """Check a note against the session that it is about, and write it; return its path.

    Attempt 0 of a trial means its last committed attempt, else its last one. Raises SessionError
    for a wrong note and for another kind of folder, DiskFault where it cannot be written.
    """
    note = replace(note, closing_digest=read_closing_digest(folder))
    if note.trial_id:
        with open_session(folder) as session:
            note = _about_attempt(session, note)
    return write_note(folder, note)


def _about_attempt(session: SessionReader, note: SessionNote) -> SessionNote:
    """Return the note with its attempt. Raises SessionError where the session has none."""
    trials = session.trials
    rows = trials[trials["trial_id"] == note.trial_id]
    committed = rows["attempt"][rows["verdict"] == Verdict.COMMITTED.value].tolist()
    attempts = rows["attempt"].tolist()
    attempt = note.attempt or max(committed or attempts, default=0)
    if attempt not in attempts:
        what = f"attempt {attempt} at trial" if note.attempt else "trial"
        raise SessionError(f"{session.path} has no {what} {note.trial_id}: name one that it has")
    if note.mark is Mark.GOOD:
        _refuse_second(session, note.trial_id, attempt)
    return replace(note, attempt=attempt)


def _refuse_second(session: SessionReader, trial_id: int, attempt: int) -> None:
    """Raise SessionError where another attempt at a trial counts already."""
    counted = session.trials[session.committed()]
    others = counted["attempt"][counted["trial_id"] == trial_id]
    if np.any(others != attempt):
        raise SessionError(
            f"trial {trial_id} was recorded again and attempt {others[0]} counts: mark that one "
            "bad first"
        )


def describe_missing(path: Path) -> list[str]:
    """Return a sentence for each missing part of a session and for trials that are left out."""
    with open_session(path) as session:
        return session.describe_missing()


EARLY_END_KIND = "early_end"
"""Kind of the event with the condition, and with what its end was judged by."""
Amount = Annotated[float, Meta(ge=0)]


class ConditionEnd(msgspec.Struct, frozen=True):
    """A condition, and the mean of its first ``trials`` trials with half its interval."""

    texture: str
    speed_mm_s: Amount
    force_g: Amount
    depth_mm: Amount
    trials: Annotated[int, Meta(ge=0)]
    mean_hz: Amount
    half_width_hz: Amount

    @property
    def condition(self) -> Condition:
        """Plate, speed, force and depth."""
        return self.texture, self.speed_mm_s, self.force_g, self.depth_mm

    def describe(self, rule: EarlyEnd) -> str:
        """Return why the condition ends."""
        press = f"{self.depth_mm:g} mm" if self.depth_mm else f"{self.force_g:g} g"
        return (
            f"{self.texture}, {self.speed_mm_s:g} mm/s, {press} ends early after {self.trials} "
            f"trials: {QUANTITY_NAMES[rule.of]} {self.mean_hz:.2f} ± {self.half_width_hz:.2f} Hz"
        )


def rows_by_condition(session: Session, rows: Sequence[int]) -> dict[Condition, list[int]]:
    """Return rows of /trials by their condition, in their order."""
    found: defaultdict[Condition, list[int]] = defaultdict(list)
    for row in rows:
        trial = session.trials[row]
        speed, force, depth = (float(trial[name]) for name in ("speed_mm_s", "force_g", "depth_mm"))
        found[str(trial["texture"]), speed, force, depth].append(row)
    return found


def ended_early(session: Session) -> dict[int, str]:
    """Return the reason for each planned trial that a condition's early end left out, by its id.

    An end holds while the condition still has the trials that it was judged by, and if it keeps the
    rule of the session's protocol.
    """
    rule = _early_end_of(session)
    events = session.events_of(EARLY_END_KIND) if rule is not None else ()
    plan = plan_of(session) if events else None
    if plan is None or rule is None:
        return {}
    committed = _committed(session)
    planned: defaultdict[Condition, list[int]] = defaultdict(list)
    for trial in plan.trials:
        planned[condition_of(trial)].append(trial.trial_id)
    reasons: dict[int, str] = {}
    for event in events:
        try:
            end = msgspec.convert(event.data, ConditionEnd)
        except msgspec.ValidationError:  # no engine wrote it
            continue
        if end.half_width_hz > rule.half_width_hz:
            continue
        ids = planned[end.condition]
        counted = len(committed.intersection(ids))
        if counted >= max(end.trials, rule.least_trials):
            reasons |= dict.fromkeys(sorted(set(ids) - committed), event.text)
    return reasons


def describe_ends(reasons: dict[int, str]) -> list[str]:
    """Return a sentence for each condition that ended early."""
    by_reason: defaultdict[str, list[int]] = defaultdict(list)
    for trial_id, reason in reasons.items():
        by_reason[reason].append(trial_id)
    return [
        f"{reason}; {len(ids)} trial{'' if len(ids) == 1 else 's'} not recorded"
        for reason, ids in by_reason.items()
    ]


def plan_of(session: Session) -> Plan | None:
    """Return the plan from a session's protocol and seed, None if that cannot be read."""
    try:
        return _protocol_of(session).plan(session.header.seed)
    except RigctlError:
        return None


def _early_end_of(session: Session) -> EarlyEnd | None:
    """Return the rule of a session's protocol, None without one or if that cannot be read."""
    try:
        return _protocol_of(session).early_end
    except RigctlError:
        return None


def _protocol_of(session: Session) -> Protocol:
    return parse_protocol(session.protocol_text, layout.PROTOCOL_FILE, session.config)


def _committed(session: Session) -> set[int]:
    return set(session.trials["trial_id"][session.committed()].tolist())
