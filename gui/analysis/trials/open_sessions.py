"""The sessions that a worker process holds open. This module does not import Qt."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gui.analysis.tasks import finger_tasks
from gui.analysis.tasks.task_values import DRUM, FINGER, ScanPicture, SessionTable, TrialData
from gui.analysis.trials.trial_table import AttemptColumn
from gui.analysis.trials.verdicts import shown_reasons, shown_verdicts
from gui.widgets.file_browser import typed_path
from rigctl.errors import SessionError

if TYPE_CHECKING:
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.session.finger_session import FingerSession
    from rigctl.session.header import SessionHeader
    from rigctl.session.session import Session

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
    ("Why", "reasons", "Why the attempt does not count"),
)


class OpenSessions:
    """Sessions of the drum or the finger by their path; each stays open until it opens again."""

    def __init__(self) -> None:
        self._open: dict[str, Session | FingerSession] = {}
        self._ranges: dict[str, Normalisation] = {}

    def open(self, path: str) -> SessionTable:
        """Open a session, anew if it is open, and return its trials. Raises SessionError."""
        if path in self._open:
            self._open.pop(path).close()
        self._ranges.pop(path, None)
        return self._table(path)

    def _session(self, path: str) -> Session | FingerSession:
        """Return a session; a process that replaces another one opens it again."""
        from rigctl.session.finger_session import FingerSession, is_finger_session
        from rigctl.session.session import Session

        if path not in self._open:
            folder = typed_path(path)
            is_finger = is_finger_session(folder)
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
            if path in self._open:
                self._open.pop(path).close()

    def is_simulated(self, path: str) -> bool:
        """Return whether a session is of a simulated rig; False where it does not open."""
        try:
            return self._session(path).header.simulated
        except SessionError:
            return False

    def leave_out(self, path: str, reasons: dict[int, str]) -> SessionTable:
        """Leave attempts of an open session out, and return its trials again."""
        self._session(path).leave_out(reasons)
        return self._table(path)

    def trial(self, path: str, row: int, pictures: Path) -> TrialData | ScanPicture:
        """Read an attempt and encode it as the live encoder does.

        A scan of the moving finger becomes a picture in the folder ``pictures``.
        """
        from gui.analysis.trials.read_trial import read_trial
        from rigctl.session.session import Session

        session = self._session(path)
        if isinstance(session, Session):
            return read_trial(session, row, self.taxel_range(path))
        return finger_tasks.scan_picture(session, row, pictures)

    def drum_session(self, path: str) -> Session:
        """Return an open session of the drum. Raises SessionError for one of the finger."""
        from rigctl.session.session import Session

        session = self._session(path)
        if not isinstance(session, Session):
            raise SessionError(f"{path} is a session of the moving finger: open one of the drum")
        return session

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
            about, columns = finger_tasks.about(session), finger_tasks.columns(session)
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
    texts = {"verdict": shown_verdicts, "reasons": shown_reasons}
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
    found = {}
    for row in np.flatnonzero(session.trials["reasons"] != "").tolist():
        trial = session.trials[row]
        found[row] = f"Trial {trial['trial_id']} was {trial['verdict']}: {trial['reasons']}"
    for row, reason in session.left_out.items():
        found[row] = f"Trial {session.trials[row]['trial_id']} is left out: {reason}"
    return sorted(found.items())


def _taxel_range(session: Session) -> Normalisation:
    from rigctl.encoding.normalisation import Normalisation

    header = session.header
    if header.taxel_low and header.taxel_high:
        low, high = (np.array(side, np.uint16) for side in (header.taxel_low, header.taxel_high))
        return Normalisation(low, high, "calibration of the session")
    committed = session.committed()
    if not len(committed):
        raise SessionError(f"{session.path} has no committed trial to take taxel ranges from")
    chosen = committed[:: max(1, len(committed) // _RANGE_TRIALS)]
    return Normalisation.from_samples(
        map(session.samples, chosen.tolist()), "trials of the session"
    )
