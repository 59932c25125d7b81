"""The sessions that a worker process holds open, and their trials; without Qt."""

from __future__ import annotations

import time
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis.task_values import (
    DRUM,
    FINGER,
    FingerSessionInfo,
    JudgedTrials,
    ScanPicture,
    SessionTable,
    TrialData,
)
from gui.analysis.trial_sections import (
    COURSE_NAMES,
    EncodedTrial,
    read_trial,
    reading_names,
    sample_blocks,
    table_parts,
)
from gui.analysis.trial_table import AttemptColumn
from gui.analysis.value_file import SIMULATED, write_parts, yes_or_no
from gui.widgets.typed_paths import typed_path
from rigctl.errors import SessionError, WrongUse
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.executors import Progress
    from rigctl.analysis.options import AnalysisOptions
    from rigctl.analysis.session_quality import SessionJudge
    from rigctl.encoder.normalisation import Normalisation
    from rigctl.finger.analysis.report import FingerReport
    from rigctl.finger.session import FingerSession
    from rigctl.session.header import SessionHeader
    from rigctl.session.session import Session


LEFT_OUT, REPEATED, QUARANTINE = "left out", "repeated", "quarantine"


def shown_verdicts(session: Any) -> list[str]:
    """Return the verdict of each attempt of an open session.

    An attempt that does not count though the recorder committed it (marked bad by a note, or cut
    short) is left out; where another attempt at its trial counts it is repeated.
    """
    verdicts, repeated = session.trials["verdict"].tolist(), session.repeated
    for row in repeated:
        verdicts[row] = f"{verdicts[row]}, {REPEATED}"
    for row in session.quarantined():
        verdicts[row] = QUARANTINE
    for row in session.left_out:
        verdicts[row] = REPEATED if row in repeated else LEFT_OUT
    return list(map(str, verdicts))


def shown_reasons(session: Any) -> list[str]:
    """Return why each attempt of an open session does not count, empty for one that does."""
    reasons = session.trials["reasons"].tolist()
    for row, reason in (session.quarantined() | session.left_out).items():
        reasons[row] = reason
    return list(map(str, reasons))


def shown_notes(session: Any) -> list[str]:
    """Return what people noted on each attempt of an open session."""
    notes = session.trial_notes()
    return [notes.get(row, "") for row in range(len(session.trials))]


def finger_about(session: FingerSession) -> str:
    """Return a sentence about a session of the moving finger."""
    header = session.header
    return (
        f"{session.path.name}: moving finger, {', '.join(header.stages)}; "
        f"{len(session.committed())} of {header.trials_planned} scans committed, "
        f"{'simulated' if header.simulated else 'real'} finger, started {header.start_utc}"
    )


def finger_columns(session: FingerSession) -> tuple[AttemptColumn, ...]:
    """Return the trial table of a session of the moving finger."""
    trials = session.trials
    return (
        AttemptColumn("Scan", np.array(trials["trial_id"]), (), "Number in the planned order"),
        AttemptColumn.of_texts("Plate", trials["texture"]),
        AttemptColumn.of_texts("Profile", trials["profile"], "Planned profile of the velocity"),
        AttemptColumn.of_texts(
            "Named", list(map(_named, trials)), "The answer, and whether it was right"
        ),
        AttemptColumn.of_texts("Verdict", shown_verdicts(session), "Whether the attempt counts"),
        AttemptColumn.of_texts("Notes", shown_notes(session), "What people noted on the attempt"),
        AttemptColumn.of_texts("Why", shown_reasons(session), "Why the attempt does not count"),
    )


def scan_picture(session: FingerSession, row: int, folder: Path) -> ScanPicture:
    """Draw the scan of an attempt into a folder: the last frame of its movie.

    Raises WrongUse for an attempt without a scan.
    """
    from rigctl.finger.analysis.movie import read_timeline, write_movie

    trial_id = int(session.trials[row]["trial_id"])
    path = session.path
    figure = folder / f"{path.name}-{trial_id}.png"
    if not figure.exists():
        write_movie(read_timeline(path, trial_id), figure, lambda *_: None)
    return ScanPicture(str(figure))


def finger_session_info(path: str) -> FingerSessionInfo:
    """Read whose scans a session of the moving finger has. Raises SessionError."""
    from rigctl.finger.session import FingerSession

    with FingerSession.open(typed_path(path)) as session:
        header, slides = session.header, session.slides
    person = header.simulation
    return FingerSessionInfo(
        path, header.stages, int(person.get("seed", 0)), int(person.get("session", 0)), slides
    )


def make_finger_models(session: str, source: str, components: int) -> tuple[str, ...]:
    """Train the models of a session, or centre those of ``source`` by its calibration.

    Return their paths. Raises WrongUse where the session has neither stage.
    """
    from rigctl.finger.models import calibrate_models, train_models
    from rigctl.finger.values import Stage

    folder, stages = Path(session), finger_session_info(session).stages
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if Stage.TRAIN in stages:
        return tuple(map(str, train_models(folder, components, now)))
    if Stage.CALIBRATE in stages:
        return tuple(map(str, calibrate_models(typed_path(source), folder)))
    raise WrongUse(f"{folder} has no training or calibration scans: choose another session")


def report_on_finger(options: AnalysisOptions, resources: Resources) -> FingerReport:
    """Write the report of the real-time experiment."""
    from rigctl.finger.analysis.report import report_on

    return report_on(options, datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), resources)


def _named(row: Any) -> str:
    marks = {1: " ✓", 0: " ✗"}
    return f"{row['predicted']}{marks.get(int(row['correct']), '')}" or "–"


N_WARM_TAXELS = 18


def load_encoder() -> None:
    """Load the compiled encoder, so that the first trial is drawn at once."""
    from rigctl.encoder.encoder import Encoder
    from rigctl.encoder.normalisation import Normalisation

    Encoder(Normalisation.full_scale(N_WARM_TAXELS)).warm_up()
    import_module("rigctl.encoder.features")


MOST_CONDITIONS, MOST_TRIALS = 6, 20
BIN_S = 0.05
Floats = NDArray[np.float64]


class NeuronResponse(NamedTuple):
    """Spikes of one neuron in the trials of a condition.

    ``trial_ids``: the trials' numbers in their sessions. ``spikes_s``: of each trial, seconds since
    its first sample. ``at_s`` float64 (bins,): middle of
    each bin of ``BIN_S`` that every trial fills; ``mean_hz``, ``sd_hz`` float64 (bins,): rate over
    trials, divisor n − 1 (0 for one trial).
    """

    name: str
    trial_ids: tuple[int, ...]
    spikes_s: tuple[Floats, ...]
    at_s: Floats
    mean_hz: Floats
    sd_hz: Floats


class ResponseGrid(NamedTuple):
    """Conditions in their order, and what was left out, as a sentence or empty.

    ``simulated``: whether any of the trials is.
    """

    neuron: str
    conditions: tuple[NeuronResponse, ...]
    left_out: str
    simulated: bool = False


def compare_responses(
    sessions: OpenSessions, trials: Iterable[tuple[str, int]], train: int, neuron: str
) -> ResponseGrid:
    """Return the responses of a train (SA 1 … n, RA 1 … n) by plate, speed and force.

    ``trials``: paths of open sessions of the drum, and rows in them; only the first trials and
    conditions are read. Raises SessionError.
    """
    groups: dict[tuple[str, float, float], list[tuple[str, int]]] = {}
    simulated = False
    for path, row in trials:
        session = sessions.drum_session(path)
        trial = session.trials[row]
        simulated |= session.header.simulated
        if trial["first_sample"] >= 0:
            key = str(trial["texture"]), float(trial["speed_mm_s"]), float(trial["force_g"])
            groups.setdefault(key, []).append((path, row))
    keys = sorted(groups)
    found = [
        _response(sessions, key, groups[key][:MOST_TRIALS], train) for key in keys[:MOST_CONDITIONS]
    ]
    left_out = _left_out(len(keys), map(len, groups.values()))
    return ResponseGrid(neuron, tuple(found), left_out, simulated)


def _left_out(n_conditions: int, lengths: Iterable[int]) -> str:
    parts = []
    if n_conditions > MOST_CONDITIONS:
        parts.append(f"the first {MOST_CONDITIONS} of {n_conditions} conditions")
    if max(lengths, default=0) > MOST_TRIALS:
        parts.append(f"the first {MOST_TRIALS} trials of each condition")
    return f"Shown are {' and '.join(parts)}: filter or select trials for others" if parts else ""


def _response(
    sessions: OpenSessions,
    key: tuple[str, float, float],
    trials: list[tuple[str, int]],
    train: int,
) -> NeuronResponse:
    ids, spikes, lengths = [], [], []
    for path, row in trials:
        session = sessions.drum_session(path)
        ids.append(int(session.trials[row]["trial_id"]))
        trial = EncodedTrial(session, row, sessions.taxel_range(path))
        spikes.append(trial.train(train) / SAMPLE_RATE_HZ)
        lengths.append(trial.n_samples / SAMPLE_RATE_HZ)
    edges = BIN_S * np.arange(int(min(lengths) / BIN_S + 1e-9) + 1, dtype=np.float64)
    at_s: Floats = np.asarray(edges[:-1] + BIN_S / 2, np.float64)
    rates = np.array([np.histogram(one, edges)[0] for one in spikes]) / BIN_S
    sd = rates.std(axis=0, ddof=1) if len(rates) > 1 else np.zeros(len(edges) - 1)
    name = f"{key[0]}, {key[1]:g} mm/s, {key[2]:g} g"
    return NeuronResponse(name, tuple(ids), tuple(spikes), at_s, rates.mean(axis=0), sd)


_RANGE_TRIALS = 100
_COLUMNS = (
    ("Trial", "trial_id", "Number in the planned order"),
    ("Plate", "texture", ""),
    ("mm/s", "speed_mm_s", "Planned speed"),
    ("g", "force_g", "Planned force"),
    ("Verdict", "verdict", "Whether the attempt counts"),
    ("Attempt", "attempt", "1 for the first attempt at a trial"),
    ("Mean mm/s", "mean_speed_mm_s", "Measured over the trial"),
    ("Mean g", "mean_force_g", "Measured over the trial"),
    ("Mounting", "mount", "Mounting of this plate, from 1"),
    ("Notes", "notes", "What people noted on the attempt"),
    ("Why", "reasons", "Why the attempt does not count"),
)


JUDGED_AT_ONCE = 100
"""Attempts that are judged in one task, of about two seconds: trials are read between them."""


class OpenSessions:
    """Sessions of the drum or the finger by their path; each stays open until it opens again."""

    def __init__(self) -> None:
        self._open: dict[str, Session | FingerSession] = {}
        self._ranges: dict[str, Normalisation] = {}
        self._judges: dict[str, SessionJudge] = {}
        self._encoded: tuple[tuple[str, int], EncodedTrial] | None = None

    def open(self, path: str) -> SessionTable:
        """Open a session, anew if it is open, and return its trials. Raises SessionError."""
        if path in self._open:
            self._open.pop(path).close()
        self._ranges.pop(path, None)
        self._judges.pop(path, None)
        self._encoded = None
        return self._table(path)

    def _session(self, path: str) -> Session | FingerSession:
        """Return a session; a process that replaces another one opens it again."""
        from rigctl.finger.layout import FINGER_LAYOUT
        from rigctl.finger.session import FingerSession
        from rigctl.session.part import session_layout
        from rigctl.session.session import Session

        if path not in self._open:
            folder = typed_path(path)
            is_finger = session_layout(folder) is FINGER_LAYOUT
            self._open[path] = FingerSession.open(folder) if is_finger else Session.open(folder)
        return self._open[path]

    def follow(self, path: str) -> SessionTable | None:
        """Return the trials of an open session again, None if there is no new one.

        Raises SessionError.
        """
        session = self._session(path)
        before = len(session.trials)
        session.refresh()
        table = self._table(path)
        return table if not table.is_growing or len(session.trials) > before else None

    def age_s(self, path: str) -> float:
        """Return the time since the newest data of an open session were written."""
        newest = self._session(path).parts[-1].path
        return max(0.0, time.time() - newest.stat().st_mtime)

    def altered(self, path: str) -> dict[int, str]:
        """Return index and reason of each attempt whose rows are not those that were recorded.

        Empty where the session does not open, which its check says.
        """
        from rigctl.session.digests import damaged_trials

        try:
            return damaged_trials(self._session(path))
        except SessionError:
            return {}
        finally:
            self._encoded = None
            if path in self._open:
                self._open.pop(path).close()

    def is_simulated(self, path: str) -> bool:
        """Return whether a session is of a simulated rig; False where it does not open."""
        try:
            return self._session(path).header.simulated
        except SessionError:
            return False

    def note(
        self, path: str, row: int, text: str, author: str, mark: str, at_s: float | None = None
    ) -> SessionTable:
        """Write a note on an attempt of an open session, and return its trials again."""
        from rigctl.session.notes import Mark, SessionNote
        from rigctl.session.session import add_note

        session = self._session(path)
        trial = session.trials[row]
        about = int(trial["trial_id"]), int(trial["attempt"])
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        add_note(session.path, SessionNote(now, text, *about, Mark(mark), author, at_s=at_s))
        session.refresh()
        return self._table(path)

    def leave_out(self, path: str, altered: tuple[tuple[int, str], ...]) -> SessionTable:
        """Leave attempts of an open session out, and return its trials again, which marks them."""
        self._session(path).leave_out(dict(altered))
        return self._table(path)

    def trial(self, path: str, row: int, pictures: Path) -> TrialData | ScanPicture:
        """Read an attempt and encode it as the live encoder does.

        A scan of the moving finger becomes a picture in the folder ``pictures``.
        """
        from rigctl.session.session import Session

        session = self._session(path)
        if isinstance(session, Session):
            return read_trial(self.encoded(path, row), path)
        return scan_picture(session, row, pictures)

    def judge(self, path: str) -> JudgedTrials:
        """Judge the next attempts of an open session of the drum; return all judged so far."""
        from rigctl.analysis.session_quality import SessionJudge, commonest_reasons, picture_of

        session = self.drum_session(path)
        judge = self._judges.setdefault(path, SessionJudge(session))
        found = judge.judge(most=JUDGED_AT_ONCE)
        why = "; ".join(f"{reason} ({n:,} times)" for reason, n in commonest_reasons(found)[:1])
        left = len(session.trials) - len(found.trials)
        picture, counts = picture_of(found), found.counts()
        return JudgedTrials(path, found.simulated, picture, counts, why, left)

    def drum_session(self, path: str) -> Session:
        """Return an open session of the drum. Raises SessionError for one of the finger."""
        from rigctl.session.session import Session

        session = self._session(path)
        if not isinstance(session, Session):
            raise SessionError(f"{path} is a session of the moving finger: open one of the drum")
        return session

    def encoded(self, path: str, row: int) -> EncodedTrial:
        """Return an attempt of the drum; the last one is kept."""
        if self._encoded is None or self._encoded[0] != (path, row):
            session = self.drum_session(path)
            self._encoded = (path, row), EncodedTrial(session, row, self.taxel_range(path))
        return self._encoded[1]

    def taxel_range(self, path: str) -> Normalisation:
        """Return the calibrated range of a session, else that of evenly chosen trials."""
        if path not in self._ranges:
            self._ranges[path] = _taxel_range(self.drum_session(path))
        return self._ranges[path]

    def _table(self, path: str) -> SessionTable:
        from rigctl.session.session import Session
        from rigctl.session.session_reader import read_closing_digest

        session, first = self._session(path), 0
        if isinstance(session, Session):
            about, columns, experiment = _about(session), _columns(session), DRUM
            first = _first_with_texture(session)
        else:
            about, columns = finger_about(session), finger_columns(session)
            experiment = FINGER
        return SessionTable(
            path,
            about,
            columns,
            experiment,
            read_closing_digest(session.path) if session.finished else "",
            ". ".join(session.describe_missing()),
            tuple(_reasons(session)),
            not session.finished and _may_grow(session.path),
            first,
        )


def _may_grow(folder: Path) -> bool:
    """Return whether a session has a writer that is not known to be gone.

    Another computer often does not see the lock, so there the lock's file alone counts.
    """
    from rigctl.session.writer_lock import Writer, lock_owner_pid, writer_of

    return lock_owner_pid(folder) is not None and writer_of(folder) is not Writer.GONE


def _first_with_texture(session: Session) -> int:
    """Return the row of the first committed trial of another plate than the smooth one, else 0.

    The paper's plate A is smooth: its spikes show force and no texture.
    """
    from rigctl.analysis.published import SMOOTH

    committed = session.committed()
    textured = committed[session.trials["texture"][committed] != SMOOTH]
    return int(textured[0]) if len(textured) else 0


def _about(session: Session) -> str:
    from rigctl.session.session import ended_early

    header, ended = session.header, len(ended_early(session))
    if not header.trials_planned:
        return (
            f"{session.path.name}: recorded by hand, so it has no trials to show or to classify: "
            f"rigctl info {session.path.name} says what it holds. {_origin(header)}"
        )
    early = f", {ended} left out by an early end" if ended else ""
    return (
        f"{session.path.name}: {len(session.committed())} of {header.trials_planned} trials "
        f"committed{early}, {_origin(header)}"
    )


def _origin(header: SessionHeader) -> str:
    return f"{'simulated' if header.simulated else 'real'} rig, started {header.start_utc}"


def _columns(session: Session) -> tuple[AttemptColumn, ...]:
    texts = {"verdict": shown_verdicts, "reasons": shown_reasons, "notes": shown_notes}
    return tuple(
        AttemptColumn.of_texts(name, texts[field](session), tip)
        if field in texts
        else _column(name, session.trials[field], tip)
        for name, field, tip in _COLUMNS
    )


def _column(name: str, values: Any, meaning: str) -> AttemptColumn:
    if values.dtype.kind == "U":
        return AttemptColumn.of_texts(name, values, meaning)
    return AttemptColumn(name, np.array(values), (), meaning)


def _reasons(session: Any) -> list[tuple[int, str]]:
    """Return row and sentence of each attempt that does not count."""
    from rigctl.session.session import Session

    found, what = {}, "Trial" if isinstance(session, Session) else "Scan"
    repeated = session.repeated
    for row in np.flatnonzero(session.trials["reasons"] != "").tolist():
        trial = session.trials[row]
        verdict = f"{trial['verdict']}{' and repeated' if row in repeated else ''}"
        found[row] = f"{what} {trial['trial_id']} was {verdict}: {trial['reasons']}"
    for row, reason in session.left_out.items():
        verdict = f"was {REPEATED}" if row in repeated else f"is {LEFT_OUT}"
        found[row] = f"{what} {session.trials[row]['trial_id']} {verdict}: {reason}"
    return sorted(found.items())


def _taxel_range(session: Session) -> Normalisation:
    from rigctl.encoder.normalisation import Normalisation

    header = session.header
    if header.taxel_low and header.taxel_high:
        low, high = (np.array(side, np.uint16) for side in (header.taxel_low, header.taxel_high))
        return Normalisation(low, high, "calibration of the session")
    committed = session.committed()
    if not len(committed):
        raise SessionError(f"{session.path} has no committed trial to take taxel ranges from")
    chosen = committed[:: max(1, len(committed) // _RANGE_TRIALS)]
    blocks = (block for row in chosen.tolist() for block in sample_blocks(session, row))
    return Normalisation.from_samples(blocks, "trials of the session")


def write_trial(path: str, row: int, of_course: bool, out: Path) -> None:
    """Write all numbers of an attempt: readings and spikes, or force and speed."""
    trial = OpenSessions().encoded(path, row)
    said = yes_or_no(trial.session.header.simulated)
    names = COURSE_NAMES if of_course else reading_names(trial.session.sensor_layout.n_taxels)
    parts = table_parts(trial, of_course=of_course)
    with_origin = ((*columns, np.full(len(columns[0]), said)) for columns in parts)
    write_parts((*names, SIMULATED), with_origin, out)


def write_movie(
    session: Session, row: int, taxel: int, section_s: tuple[float, float], out: str, show: Progress
) -> str:
    """Write the movie of a taxel, from 0, as ``rigctl encode --movie`` does; return its path.

    ``section_s``: where the shown part of the trial begins, and its length. Raises WrongUse for an
    attempt that does not count.
    """
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.taxel import EncodeRequest, encode_taxel

    if row not in session.committed():
        raise WrongUse("this attempt does not count: choose a committed one for a movie")
    request = EncodeRequest(
        (session.path,),
        trial=int(session.trials[row]["trial_id"]),
        taxel=taxel + 1,
        start_s=section_s[0],
        seconds=section_s[1],
        movie=typed_path(out),
    )
    encode_taxel(request, Resources(progress=show))
    return out
