"""The protocol's tasks of a worker process: plan a protocol, follow a session, write a note.

This module does not import Qt, and each task imports its own slow modules.
"""

from __future__ import annotations

import re
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gui.widgets.formatting import duration, grouped, size
from gui.widgets.typed_paths import typed_path
from rigctl.config import resources
from rigctl.config.text_file import read_text
from rigctl.config.toml_edit import replace_file
from rigctl.config.toml_reader import MAX_BYTES
from rigctl.errors import DiskFault, ProtocolError, SessionError, WrongUse

if TYPE_CHECKING:
    from rigctl.protocol.plan import Plan
    from rigctl.session.session import Session
    from rigctl.values import PlannedTrial

DISK_ROW = "Disk space"
PLAN_ROWS = (
    "Plates",
    "Speeds",
    "Forces",
    "Order",
    "Trials",
    "Plate changes",
    "Duration",
    DISK_ROW,
)
ORDER_COLUMNS = (
    "Trial",
    "Plate",
    "Speed (mm/s)",
    "Force (g)",
    "Depth (mm)",
    "Repeat",
    "Mounting",
)
TRIAL_COLUMNS = (
    "Trial",
    "Plate",
    "Speed\n(mm/s)",
    "Force\n(g)",
    "Repeat",
    "Attempt",
    "Mean speed\n(mm/s)",
    "Mean force\n(g)",
    "Lost\nsamples",
    "Verdict",
    "Remarks",
)
COMMITTED, BAD, REPEATED = "✓ committed", "✗ marked bad", "↻ repeated"

Row = tuple[str, ...]


class PlanSummary(NamedTuple):
    """The plan of a protocol: a text for each of ``PLAN_ROWS``, and the seed of its order.

    ``order``: a row of ``ORDER_COLUMNS`` for each trial. ``duration_s``: with the changes of
    plates. ``problem`` says why the protocol cannot run; it is empty if it can. ``free_bytes``: of
    the disk of the folder for the session.
    """

    texts: Row = ("–",) * len(PLAN_ROWS)
    seed: int = 0
    problem: str = ""
    description: str = ""
    order: tuple[Row, ...] = ()
    duration_s: float = 0.0
    plate_changes: int = 0
    free_bytes: int | None = None
    plates: tuple[str, ...] = ()


class AttemptRow(NamedTuple):
    """One attempt at a trial: its numbers, a text for each of ``TRIAL_COLUMNS``."""

    trial_id: int
    attempt: int
    texts: Row

    @property
    def verdict(self) -> str:
        """The text of its verdict."""
        return self.texts[TRIAL_COLUMNS.index("Verdict")]


class SessionNews(NamedTuple):
    """The attempts of a session from number ``first`` on, and all its notes as lines.

    Where ``first`` is 0, the rows replace those before. ``committed``: trials that count in the
    whole session. ``problem``: why it cannot be read, empty if it can. ``early_ends``: a sentence
    for each condition that ended early, with the trials that are not recorded.
    """

    folder: str
    first: int = 0
    rows: tuple[AttemptRow, ...] = ()
    notes: tuple[str, ...] = ()
    committed: int = 0
    problem: str = ""
    early_ends: tuple[str, ...] = ()


class ProtocolText(NamedTuple):
    """The text of a protocol's file, and the path under which a changed one is saved."""

    path: str
    text: str = ""
    own_path: str = ""


class CheckedText(NamedTuple):
    """A text, what it plans, and why it is no protocol; empty if it is one.

    ``key_path`` and ``reason``: which key is wrong, and what is wrong with it; ``line``: from 1.
    """

    text: str
    summary: str = ""
    problem: str = ""
    key_path: tuple[str | int, ...] = ()
    reason: str = ""
    line: int = 0


def plan_protocol(path: str, seed: int | None, out: str = "", rig_toml: str = "") -> PlanSummary:
    """Plan a protocol as ``rigctl check`` does; None takes the protocol's own seed.

    ``out``: the folder whose disk has to hold the session, empty for none. ``rig_toml`` describes
    the rig, empty for the nominal one.
    """
    from rigctl.config.rig_config import parse_config
    from rigctl.protocol.loader import load_protocol

    plan = load_protocol(Path(path), parse_config(rig_toml)).plan(seed)
    return summarise(plan)._replace(free_bytes=free_space(out))


def summarise(plan: Plan) -> PlanSummary:
    """Return the summary of a plan."""
    from rigctl.protocol.steps import PLATE_CHANGE_S

    changes_s = plan.plate_changes * PLATE_CHANGE_S
    rig, total = duration(plan.duration_s), duration(plan.duration_s + changes_s)
    time = f"{rig}, {total} with plate changes" if changes_s else rig
    texts = (
        *_conditions(plan),
        grouped(len(plan.trials)),
        f"{plan.plate_changes}",
        time,
        size(plan.bytes_estimate),
    )
    description, order = plan.protocol.description, tuple(map(_planned, plan.trials))
    total_s, changes = plan.duration_s + changes_s, plan.plate_changes
    plates = tuple(dict.fromkeys(plan.protocol.textures))
    return PlanSummary(texts, plan.seed, "", description, order, total_s, changes, plates=plates)


def _conditions(plan: Plan) -> Row:
    from rigctl.protocol.plan import ORDER_WORDS

    protocol = plan.protocol
    speeds, forces, depths = protocol.speeds_mm_s, protocol.forces_g, protocol.depths_mm
    mounts = f", each mounted {protocol.mounts} times" if protocol.mounts > 1 else ""
    across = " across plates" if protocol.across_plates else ""
    return (
        f"{' '.join(protocol.textures) or 'none'}{mounts}",
        _numbers(speeds, "mm/s"),
        _numbers(depths, "mm deep") if depths else _numbers(forces, "g"),
        f"{ORDER_WORDS[protocol.order]}{across}, {protocol.repeats} of each",
    )


def _numbers(values: tuple[float, ...], unit: str) -> str:
    return f"{', '.join(f'{value:g}' for value in values)} {unit}" if values else "none"


def free_space(out: str) -> int | None:
    """Return the free bytes of the disk of a folder, made or not; None for no whole path."""
    path = typed_path(out) if out.strip() else None
    if path is None or not path.is_absolute():
        return None
    existing = next(folder for folder in (path, *path.parents) if folder.is_dir())
    return shutil.disk_usage(existing).free


def _planned(trial: PlannedTrial) -> Row:
    in_position = trial.force_mode == "position"
    return (
        f"{trial.trial_id}",
        trial.texture,
        f"{trial.speed_mm_s:g}",
        "–" if in_position else f"{trial.force_g:g}",
        f"{trial.depth_mm:g}" if in_position else "–",
        f"{trial.repeat}",
        f"{trial.mount}",
    )


def write_note(folder: str, text: str, author: str, trial_id: int, attempt: int, mark: str) -> None:
    """Add a note to a session; trial 0 is the whole session, attempt 0 the one that counts."""
    from rigctl.session.notes import Mark, SessionNote
    from rigctl.session.session import add_note

    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    note = SessionNote(now, text.strip(), trial_id, attempt, Mark(mark), author.strip())
    add_note(Path(folder), note)


class SessionFollower:
    """Reads a session that grows: only what is new after the first time."""

    def __init__(self) -> None:
        self._session: Session | None = None
        self._notes: tuple[str, ...] = ()
        self._repeated: frozenset[int] = frozenset()

    def read(self, folder: str, known: int = 0) -> SessionNews:
        """Return the attempts after the first ``known`` ones; all if a verdict has changed."""
        from rigctl.session.part import existing_parts

        if not existing_parts(Path(folder)):
            return SessionNews(folder)
        try:
            session = self._open(Path(folder))
            return self._news(session, folder, known)
        except SessionError as error:
            self._close()
            return SessionNews(folder, problem=str(error))

    def _open(self, folder: Path) -> Session:
        from rigctl.session.session import Session

        if self._session is None or self._session.path != folder:
            self._close()
            self._session = Session.open(folder)
        else:
            self._session.refresh()
        return self._session

    def _close(self) -> None:
        if self._session is not None:
            self._session.close()
        self._session, self._notes = None, ()

    def _news(self, session: Session, folder: str, known: int) -> SessionNews:
        from rigctl.session.session import describe_ends, ended_early

        notes = tuple(f"{note.made_utc}  {note.describe()}" for note in session.notes)
        repeated = session.repeated
        has_changed = (notes, repeated) != (self._notes, self._repeated)
        if has_changed or known > len(session.trials):
            self._notes, self._repeated, known = notes, repeated, 0
        gaps, marks = session.gaps, session.trial_notes()
        rows = tuple(
            _attempt(session, index, gaps, marks.get(index, ""), index in repeated)
            for index in range(known, len(session.trials))
        )
        ends = tuple(describe_ends(ended_early(session)))
        committed = len(session.committed())
        return SessionNews(folder, known, rows, notes, committed, early_ends=ends)


def _attempt(session: Session, index: int, gaps: Any, note: str, is_repeated: bool) -> AttemptRow:
    row = session.trials[index]
    verdict, reasons = str(row["verdict"]), session.left_out.get(index, str(row["reasons"]))
    if is_repeated:
        verdict = REPEATED if index in session.left_out else f"{REPEATED}, {verdict}"
    elif index in session.left_out:
        verdict = BAD if reasons.startswith("marked bad") else "left out"
    elif verdict == "committed":
        verdict = COMMITTED
    else:
        verdict = f"✗ {verdict}"
    texts = (
        f"{row['trial_id']}",
        f"{row['texture']}",
        f"{row['speed_mm_s']:g}",
        f"{row['force_g']:g}",
        f"{row['repeat']}",
        f"{row['attempt']}",
        _measured(row["mean_speed_mm_s"], 2),
        _measured(row["mean_force_g"], 1),
        f"{_lost(row, gaps)}",
        verdict,
        "; ".join(dict.fromkeys(filter(None, (reasons, note)))),
    )
    return AttemptRow(int(row["trial_id"]), int(row["attempt"]), texts)


def _measured(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if np.isfinite(value) else "–"


def _lost(row: Any, gaps: Any) -> int:
    """Return the samples of an attempt's window that are missing."""
    if row["first_counter"] < 0 or not len(gaps):
        return 0
    first, end = int(row["first_counter"]), int(row["first_counter"] + row["count"])
    of_part = gaps[gaps["part"] == row["part"]]
    begins = np.maximum(of_part["first_counter"], first)
    ends = np.minimum(of_part["first_counter"] + of_part["count"], end)
    return int(np.maximum(ends - begins, 0).sum())


_LINE = re.compile(r"\bline (\d+)")
OWN_FOLDER = "rigctl-protocols"


def read_protocol(path: str) -> ProtocolText:
    """Return the text of a protocol's file. Raises ProtocolError."""
    file = Path(path)
    own = Path.home() / OWN_FOLDER / file.name
    built_in = (resources.protocols().resolve(), resources.finger_protocols().resolve())
    is_built_in = file.parent.resolve() in built_in
    text = read_text(file, MAX_BYTES, ProtocolError)
    return ProtocolText(path, text, str(own) if is_built_in else path)


def check_text(text: str, rig_toml: str, name: str) -> CheckedText:
    """Return whether a text is a protocol of drum or finger, and the numbers of its plan.

    ``rig_toml`` describes the drum's rig, empty for the nominal one; ``name``: the text's file.
    """
    from rigctl.config.rig_config import parse_config
    from rigctl.protocol.form_content import read_content
    from rigctl.protocol.loader import parse_protocol

    try:
        config = parse_config(rig_toml)
        if read_content(text, config, name).is_finger:
            return CheckedText(text, _finger_summary(text, name))
        plan = parse_protocol(text, name, config).plan()
    except WrongUse as error:
        return CheckedText(
            text, "", str(error), error.key_path, error.reason, _line_of(error, name)
        )
    rows = dict(zip(PLAN_ROWS, summarise(plan).texts, strict=True))
    numbers = (f"{rows[name]} {name.lower()}" for name in ("Trials", "Plate changes"))
    return CheckedText(
        text, f"No errors: {', '.join(numbers)}, {rows['Duration']}, {rows[DISK_ROW]} on disk"
    )


def _line_of(error: WrongUse, name: str) -> int:
    """Return the line of a mistake, 0 for none; the TOML library has it in its sentence only."""
    found = _LINE.search(str(error).removeprefix(name))
    return error.line or (int(found[1]) if found else 0)


def _finger_summary(text: str, name: str) -> str:
    from rigctl.finger.plan import parse_finger_protocol
    from rigctl.finger.values import Stage

    plan = parse_finger_protocol(text, name).plan(list(Stage))
    time, disk = duration(plan.duration_s), size(plan.bytes_estimate)
    return (
        f"No errors: {grouped(len(plan.trials))} scans of the moving finger, {time}, {disk} on disk"
    )


def save_protocol(path: str, text: str, may_replace: bool) -> str:
    """Save a protocol and return its path; only the file that was opened is ever replaced.

    Raises WrongUse or DiskFault.
    """
    file = Path(path)
    if not file.is_absolute() or file.suffix != ".toml":
        raise WrongUse("Save as: give the whole path of a file that ends with .toml")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if not may_replace and file.exists():
            raise WrongUse(f"{path} exists: choose another name")
        replace_file(file, text)
    except OSError as error:
        raise DiskFault(f"{path} cannot be saved: {error.strerror}") from error
    return path
