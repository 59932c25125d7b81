"""Verify a session: every sample, gap and trial agrees with the tables, every row with its digest.

A *problem* fails the check. A *note* is harmless: a part whose writer was killed before another
continued the session, or trials that are not recorded yet.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.config.text_file import read_bytes, refuse_link_outside
from rigctl.errors import RigctlError, SessionError, WrongUse
from rigctl.experiments import EXPERIMENTS
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.session.digests import (
    FIRST_DIGEST,
    PartDamage,
    RowRange,
    check_digests,
    describe_rows,
    name_attempts,
    touched_attempts,
)
from rigctl.session.extra_stream import STREAM_KIND, ExtraStream, stream_paths
from rigctl.session.ground_truth import PARTIAL, log_number, log_paths, open_truth, summarise_truth
from rigctl.session.header import session_wiring
from rigctl.session.layout import PROTOCOL_FILE, RIG_FILE, parse_trial, part_name, part_number
from rigctl.session.notes import damaged_notes
from rigctl.session.part import (
    PREVIOUS_DIGEST,
    PartReader,
    StructuredArray,
    part_paths,
    stray_files,
)
from rigctl.session.sensor_layout import layouts_match
from rigctl.session.session import Session, describe_ends, ended_early, open_session
from rigctl.session.session_reader import SessionReader, session_end
from rigctl.session.verify_part import check_part
from rigctl.session.verify_values import check_values
from rigctl.session.writer_lock import is_being_written

TRUTH_SHARE = 0.25
"""Measured share of the work if there is such a log."""
DIGESTS_SHARE = 0.5
"""Measured share of a part's work that its digests take."""
SAME_IN_ALL_PARTS = (
    "plan_hash",
    "seed",
    "trials_planned",
    "n_taxels",
    "sample_rate_hz",
    "reference_um_per_s",
)
WORLD = "the world's own log"
PROGRESS_INTERVAL_TRIALS = 500
MAX_LINES = 20
"""Ranges of altered rows that are named for each part; a count stands for the others."""
MAX_TEXT_BYTES = 16 << 20
"""Of a text beside the parts."""
WRITTEN, CUT_SHORT = "being written", "cut short"
LATER_PART_MISSING = "continued in a part that is missing"
_DIGEST = re.compile(r"[0-9a-f]{64}")

OnProgress = Callable[[float, str], None]
"""Takes the share of the work done, 0 to 1, and the next step."""
CheckPart = Callable[[PartReader, StructuredArray], tuple[list[str], list[str]]]
"""Returns problems and notes of a part and of its rows of /trials."""


@dataclass(slots=True)
class VerifyReport:
    """Findings of :func:`verify`.

    A problem is one line that begins with the file's name. ``outcome``: how the last sitting
    ended, in words. ``closing_digest``: the last digest of a session that was closed, else empty.
    """

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    samples: int = 0
    trials_committed: int = 0
    lost_samples: int = 0
    outcome: str = ""
    closing_digest: str = ""

    @property
    def whole(self) -> bool:
        """Whether there is no problem."""
        return not self.problems

    def lines(self) -> list[str]:
        """Return a line for each finding."""
        notes = [f"note: {line}" for line in self.notes]
        return notes + [f"problem: {line}" for line in self.problems]

    def answer(self, path: Path) -> str:
        """Return whether the session is whole, what it holds, and how it ended."""
        n = len(self.problems)
        verdict = f"not whole, {n} problem{'s' * (n > 1)}" if n else "whole"
        ending = f", {self.outcome}" if self.outcome else ""
        return f"{path} is {verdict}: {self.contents()}{ending}"

    def contents(self) -> str:
        """Return the numbers of trials and samples in words."""
        return (
            f"{self.trials_committed:,} trials committed, {self.samples:,} samples, "
            f"{self.lost_samples:,} lost"
        )


def verify(
    path: Path, on_progress: OnProgress = lambda share, what: None, digest: str = ""
) -> VerifyReport:
    """Check everything in a session. Raises SessionError for another kind of folder.

    ``digest``: its closing digest as it was kept elsewhere, "" for none.

    Calls ``on_progress`` with the share of the work done, 0 to 1, and the next step. Holds one
    block of samples at a time, however long the session is.
    """
    report = VerifyReport()
    part_paths(path)  # raises SessionError for another kind of folder
    try:
        with open_session(path) as session:
            _check_parts(session, report)
            if isinstance(session, Session):
                _check_drum(session, report, on_progress)
            else:
                _check_other(session, report, on_progress)
            _check_streams(session, report)
            _compare_digest(session.parts, digest, report)
    except SessionError as error:
        report.problems.append(str(error))
    return report


def parse_digest(text: str) -> str:
    """Return a closing digest as typed or pasted. Raises WrongUse for anything else."""
    digest = text.strip().lower()
    if not _DIGEST.fullmatch(digest):
        raise WrongUse(
            f"{text[:80]!r} is not a digest: give the 64 hexadecimal digits that were "
            "printed when the session was closed"
        )
    return digest


def _check_drum(session: Session, report: VerifyReport, on_progress: OnProgress) -> None:
    share = 1.0 - TRUTH_SHARE if log_paths(session.path) else 1.0
    _check_wiring(session, report)
    _check_contents(session, _check_drum_part, report, on_progress, share)
    _check_drum_plan(session, report)
    _check_truth(session, report, on_progress, share)


def _check_drum_part(part: PartReader, trials: StructuredArray) -> tuple[list[str], list[str]]:
    (problems, notes), (wrong, noted) = check_part(part, trials), check_values(part)
    return [*problems, *wrong], [*notes, *noted]


def _check_other(session: SessionReader, report: VerifyReport, on_progress: OnProgress) -> None:
    experiment = EXPERIMENTS[session.layout.experiment]
    _check_contents(session, experiment.load("check_part"), report, on_progress, 1.0)
    report.problems += experiment.load("check_plan")(session)
    _check_logs(session, report)


def _check_parts(session: SessionReader, report: VerifyReport) -> None:
    report.problems += [missing.sentence for missing in session.missing_parts]
    report.problems += damaged_notes(session.path)
    report.notes += [f"noted {note.made_utc}: {note.describe()}" for note in session.notes]
    report.notes += [
        f"{name}: is not a part of the session, its name is not that of one"
        for name in stray_files(session.path)
    ]
    for part in session.parts:
        report.problems += _wrong_header(session, part)
        report.problems += part.describe_cut()
        if not part.finished:
            _judge_unfinished(session, part, report)


def _judge_unfinished(session: SessionReader, part: PartReader, report: VerifyReport) -> None:
    name = part.path.name
    if part is not session.parts[-1]:
        report.notes.append(f"{name}: was not closed properly, a later part continues the session")
    elif is_being_written(session.path):
        report.problems.append(f"{name}: is still being written")
    elif not part.file.is_cut:
        report.notes.append(f"{name}: its writer was killed, and it was closed afterwards")
    else:
        by_hand = "what it has is safe, close it with rigctl recover"
        of_a_plan = (
            "committed trials are safe, continue with --resume of the command that made it, or "
            "close it with rigctl recover"
        )
        report.problems.append(
            f"{name}: was not closed properly, its writer was killed or could not write; "
            f"{of_a_plan if session.header.trials_planned else by_hand}"
        )


def _wrong_header(session: SessionReader, part: PartReader) -> Iterator[str]:
    for name in SAME_IN_ALL_PARTS:
        if getattr(part.header, name) != getattr(session.header, name):
            yield f"{part.path.name}: has another {name} than the first part"
    if not layouts_match(part.header.sensor_layout, session.header.sensor_layout):
        yield f"{part.path.name}: has another sensor_layout than the first part"


def _check_wiring(session: Session, report: VerifyReport) -> None:
    report.problems += [
        f"{part.path.name}: has its taxels in another order than the first"
        for part in session.parts
        if session_wiring(part.header, part.text("/rig_toml")) != session.wiring
    ]


def _check_contents(
    session: SessionReader,
    check: CheckPart,
    report: VerifyReport,
    on_progress: OnProgress,
    share: float,
) -> None:
    n_parts = len(session.parts)
    for done, part in enumerate(session.parts):
        what, size, checked = f"part {done + 1} of {n_parts}", part.path.stat().st_size, 0

        def on_bytes(n: int, done: int = done, what: str = what, size: int = size) -> None:
            nonlocal checked
            checked += n
            of_part = DIGESTS_SHARE * min(1.0, checked / max(1, size))
            on_progress(share / n_parts * (done + of_part), what)

        on_bytes(0)
        try:
            damage = check_digests(part, on_bytes=on_bytes)
            problems, noted = check(part, _trials_of(session, part))
            found = [*_damage_lines(part, damage), *problems]
            notes = [*_damage_notes(part, damage), *noted]
        except SessionError as error:
            report.problems.append(str(error))
            continue
        report.problems += [f"{part.path.name}: {line}" for line in found]
        report.notes += [f"{part.path.name}: {line}" for line in notes]
    on_progress(share, "the plan")
    _check_joints(session, report)
    report.samples = session.n_samples
    report.lost_samples = int(session.gaps["count"].sum())
    _check_committed(session, report)


def _trials_of(session: SessionReader, part: PartReader) -> StructuredArray:
    rows: StructuredArray = session.trials[session.trials["part"] == part.number]
    return rows


def _damage_lines(part: PartReader, damage: PartDamage) -> list[str]:
    """Return a line for each block of rows that a digest contradicts, with its trials."""
    lines = list(_named(part, damage.altered, describe_rows))
    lines += _named(part, damage.gone, _describe_gone)
    if part.finished:
        lines += _named(part, damage.uncovered, _describe_added)
    if damage.misplaced:
        listed = ", ".join(map(str, damage.misplaced[:5]))
        more = f" and {n} more" if (n := len(damage.misplaced) - 5) > 0 else ""
        lines.append(f"rows {listed}{more} of /digests were altered, removed or moved")
    return lines


def _damage_notes(part: PartReader, damage: PartDamage) -> list[str]:
    """Note rows without a digest: the last ones of a killed writer may lack it."""
    if part.finished or not damage.uncovered:
        return []
    listed = ", ".join(f"{place.n_rows} of {place.table}" for place in damage.uncovered)
    return [f"its last rows have no digest, because its writer was killed: {listed}"]


def _named(
    part: PartReader, places: Sequence[RowRange], describe: Callable[[RowRange], str]
) -> Iterator[str]:
    for place in places[:MAX_LINES]:
        yield f"{describe(place)}: {name_attempts(part, touched_attempts(part, place))}"
    if len(places) > MAX_LINES:
        tables = sorted({place.table for place in places[MAX_LINES:]})
        yield f"and {len(places) - MAX_LINES} more such blocks of rows of {', '.join(tables)}"


def _describe_gone(place: RowRange) -> str:
    rows = f"rows {place.first_row}–{place.end - 1}"
    return f"{rows} of {place.table} were removed or altered, the table is shorter"


def _describe_added(place: RowRange) -> str:
    rows = f"rows {place.first_row}–{place.end - 1}"
    return f"{rows} of {place.table} were added, no digest covers them"


def _check_joints(session: SessionReader, report: VerifyReport) -> None:
    """Check that each part continues the chain of the one before, and how the session ended."""
    last, is_written = session.parts[-1], is_being_written(session.path)
    for number, part in enumerate(session.parts):
        before = session.parts[number - 1] if number else None
        # Where the part before is missing, that is a problem of its own.
        if part.number == 1 or (before is not None and before.number == part.number - 1):
            # A writer that was stopped before its first flush left a part without digests.
            chain = [one.last_digest for one in session.parts[:number] if one.last_digest]
            expected = chain[-1] if chain else FIRST_DIGEST
            if part.attributes[PREVIOUS_DIGEST] != expected:
                name = before.path.name if before else "the beginning of a session"
                report.problems.append(
                    f"{part.path.name}: does not follow {name}: one of both was exchanged, or rows "
                    "at the end of the part before were"
                )
    try:
        _check_texts(session.path, session.parts[0], report)
        report.outcome = _describe_end(last, is_written)
    except SessionError as error:
        report.problems.append(str(error))
    if any(part_number(Path(part.name)) > last.number for part in session.missing_parts):
        report.outcome = LATER_PART_MISSING
    if session.finished and not is_written:
        report.closing_digest = last.last_digest


def _describe_end(last: PartReader, is_written: bool) -> str:
    """Return how a session ended, by its last part: finished, stopped, failed or another word.

    Raises SessionError for an event that no recording wrote.
    """
    if is_written:
        return WRITTEN
    if not last.finished:
        return CUT_SHORT
    end = session_end(last)
    return LATER_PART_MISSING if end is None else str(end["outcome"])


def _check_texts(folder: Path, first: PartReader, report: VerifyReport) -> None:
    """Compare the protocol and the rig beside the parts with the texts in part 1.

    Only part 1 was begun with them: a resumed session may have another rig.
    """
    for name, path in ((PROTOCOL_FILE, "/protocol_toml"), (RIG_FILE, "/rig_toml")):
        refuse_link_outside(folder / name, SessionError)
        if not (folder / name).exists():
            report.notes.append(f"{name}: is missing, {first.path.name} contains it")
        elif first.number == 1:
            beside = read_bytes(folder / name, MAX_TEXT_BYTES, SessionError)
            if _unix_lines(beside) != _unix_lines(first.text(path).encode()):
                report.problems.append(
                    f"{name}: was changed since the recording, {first.path.name} contains the text "
                    "that was used"
                )


def _unix_lines(text: bytes) -> bytes:
    return text.replace(b"\r\n", b"\n")


def _check_committed(session: SessionReader, report: VerifyReport) -> None:
    """Check that each committed trial occurs once."""
    counts = Counter(session.trials["trial_id"][session.committed()].tolist())
    report.trials_committed = len(counts)
    report.problems += [
        f"trial {number} is committed {count} times"
        for number, count in counts.items()
        if count > 1
    ]
    ended = ended_early(session) if isinstance(session, Session) else {}
    report.notes += describe_ends(ended)
    missing = session.header.trials_planned - len(counts) - len(ended)
    if missing > 0:
        report.notes.append(
            f"{missing} of {session.header.trials_planned} planned trials are not committed"
        )


def _check_drum_plan(session: Session, report: VerifyReport) -> None:
    """Check that each attempt is at a trial of the plan."""
    plan = _rebuild_plan(session, report)
    if plan is not None:
        planned = {trial.trial_id: trial for trial in plan.trials}
        for index, row in enumerate(map(parse_trial, session.trials)):
            if index not in session.left_out and planned.get(row.trial.trial_id) != row.trial:
                name = part_name(row.part)
                report.problems.append(f"{name}: trial {row.trial.trial_id} is not in the plan")


def _rebuild_plan(session: Session, report: VerifyReport) -> Plan | None:
    """Return the plan from the protocol and seed; its hash must match the recorded one."""
    if not session.protocol_text:
        report.notes.append("the session has no protocol, so its trials have no plan")
        return None
    try:
        protocol = parse_protocol(session.protocol_text, PROTOCOL_FILE, session.config)
    except RigctlError as error:
        report.problems.append(f"the protocol in the session is not readable: {error}")
        return None
    plan = protocol.plan(session.header.seed)
    if plan.hash != session.header.plan_hash:
        report.problems.append("the plan hash does not match the session's protocol and seed")
        return None
    return plan


def _check_truth(
    session: Session, report: VerifyReport, on_progress: OnProgress, done_share: float
) -> None:
    """Compare the committed trials with the simulated bench's own log.

    ``done_share`` is the share of the work that is done already.
    """

    def on_trial(done: int, trials: int) -> None:
        if done % PROGRESS_INTERVAL_TRIALS == 0:
            on_progress(done_share + (1.0 - done_share) * done / trials, WORLD)

    _check_logs(session, report)
    truth = summarise_truth(session, on_trial)
    if truth is None:
        if session.header.simulated:
            report.notes.append("recorded at a simulated bench; the world's own log is missing")
    elif not truth["trials"]:
        report.notes.append("recorded at a simulated bench; its log holds no committed trial")
    else:
        report.notes.append(
            f"recorded at a simulated bench; its log holds {truth['trials']} trials; largest "
            f"error {truth['max_speed_error_permille']} ‰ in speed, "
            f"{truth['max_force_error_permille']} ‰ in force"
        )


def _check_logs(session: SessionReader, report: VerifyReport) -> None:
    """Check that every log can be read to its end; note the partial ones."""
    for path in log_paths(session.path):
        try:
            with open_truth(path, session.layout.truth) as log:
                log.check()
                if log.sitting != log_number(path):
                    report.problems.append(
                        f"{path.name}: is the log of sitting {log.sitting}, it was copied or "
                        "renamed: give it its own name, or remove the copy"
                    )
                if path.suffix == PARTIAL:
                    report.notes.append(
                        f"{path.name}: the log of the simulated world was not closed, its writer "
                        f"was killed or could not write; it holds {log.n_rows / 1000:g} s"
                    )
        except SessionError as error:
            report.problems.append(str(error))


def _check_streams(session: SessionReader, report: VerifyReport) -> None:
    """Check the streams of other programs beside the session, against its record of them, too."""
    events = [event.data for event in session.events_of(STREAM_KIND)]
    recorded = {str(data["file"]): data.get("digest") for data in events if "file" in data}
    paths = {path.name: path for path in stream_paths(session.path)}
    report.problems += [f"{name}: is missing" for name in sorted(recorded.keys() - paths)]
    for name, path in paths.items():
        try:
            report.problems += _wrong_stream(path, recorded.get(name), report.notes)
        except SessionError as error:
            report.problems.append(str(error))


def _wrong_stream(path: Path, digest: object, notes: list[str]) -> list[str]:
    """Return what is wrong with a stream, of which the session recorded the last digest or None."""
    stream = ExtraStream(path)
    try:
        damage, last = check_digests(stream), stream.last_digest
    finally:
        stream.close()
    notes.append(stream.describe())
    places = [*damage.altered, *damage.gone, *(damage.uncovered if stream.finished else ())]
    found = [f"{path.name}: {describe_rows(place)}" for place in places[:MAX_LINES]]
    if damage.misplaced:
        found.append(f"{path.name}: rows of /digests were altered, removed or moved")
    if not found and digest not in (None, last):
        found.append(f"{path.name}: is not the file that was recorded with this session")
    return found


def _compare_digest(parts: Sequence[PartReader], digest: str, report: VerifyReport) -> None:
    """Compare a digest that was kept, if there is one, with those at the ends of the parts."""
    part = next((part for part in parts if part.last_digest == digest), None)
    if not digest:
        return
    if part is None:
        report.problems.append(
            f"the closing digest is {report.closing_digest or 'missing'}, not {digest}: this is "
            "not the session as it was when that digest was printed"
        )
    elif part is not parts[-1]:
        report.notes.append(
            f"the digest given is that of {part.path.name}: the session is proved up to there, "
            f"not the parts after it, which have the digest {report.closing_digest or 'of none'}"
        )
    elif not report.closing_digest:
        report.notes.append("the digest given is that of the last block of rows")
    elif report.whole:
        report.notes.append("the closing digest is the one given: nothing was altered since")
