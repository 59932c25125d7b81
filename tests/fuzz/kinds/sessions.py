"""Sessions of both experiments: parts, folders, truth of a simulated bench, notes."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import h5py

from rigctl.analysis.trial_set import join_sessions, open_trials
from rigctl.errors import SessionError
from rigctl.finger.session import FingerSession
from rigctl.protocol.loader import parse_protocol
from rigctl.session.analysis_file import content_digest
from rigctl.session.notes import PATTERN as NOTES
from rigctl.session.notes import Mark, SessionNote, damaged_notes, read_notes
from rigctl.session.session import Session, add_note
from rigctl.session.summary import summarise_session
from rigctl.session.verify import WORLD, VerifyReport, verify
from rigctl.synth.dataset import DatasetRequest, generate
from tests.finger import finger_building
from tests.fuzz.kind import Kind, Place
from tests.fuzz.kinds.contents import folder_content
from tests.fuzz.mutations.data_bits import WITHOUT_DATA, flip_data_bit
from tests.fuzz.mutations.folders import FOLDER
from tests.fuzz.mutations.hdf5 import HDF5
from tests.fuzz.mutations.texts import TEXT
from tests.session import building

PROTOCOL = """\
name = "tiny"
textures = ["A", "L"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 1
[trial]
travel_mm = 24
"""


def build_drum(folder: Path) -> None:
    """Record a small session of the drum from synthetic blocks, one part for each plate."""
    building.record_plan(folder)


def build_finger(folder: Path) -> None:
    """Record a small session of the finger with the board's firmware."""
    finger_building.record_plan(folder)


def build_simulated(folder: Path) -> None:
    """Make a small virtual data set, with the truth of its bench."""
    plan = parse_protocol(PROTOCOL, "tiny.toml").plan()
    request = DatasetRequest(plan, 3, folder, "2026-11-21T12:00:00Z")
    generate(request, lambda progress: None, lambda: False)


def build_noted(folder: Path) -> None:
    """Record a small session, add a note on it and mark one of its trials bad."""
    building.record_plan(folder)
    add_note(folder, SessionNote("2026-11-24T09:00:00Z", "the room was warm"))
    why = "the sensor slipped"
    add_note(folder, SessionNote("2026-11-24T09:00:01Z", why, 1, 1, Mark.BAD, "Jörg"))


def read_all_notes(folder: Path) -> object:
    """Read the notes. Raises SessionError for one that is damaged."""
    if lines := damaged_notes(folder):
        raise SessionError(lines[0])
    return read_notes(folder)


def check(folder: Path) -> VerifyReport:
    """Verify a session."""
    return verify(folder)


def summarise(folder: Path) -> object:
    """Summarise a session, as ``rigctl info`` does."""
    return summarise_session(folder)


def read_drum(folder: Path) -> object:
    """Read everything that the interface for programs offers of a session of the drum."""
    with Session.open(folder) as session:
        read: list[object] = [session.header, session.protocol_text, session.config]
        read += [session.wiring, session.scaling, session.events, session.gaps, session.finished]
        read += [session.loadcell_lost(), session.committed(), session.n_samples]
        for index in range(min(4, len(session.trials))):
            read += [session.trial_row(index), session.window(index), session.drum(index)]
            read += [session.samples(index)]
        return read


def read_trials(folder: Path) -> object:
    """Read the trials as an analysis does, without HDF5 where it can."""
    trials = join_sessions([folder])
    with open_trials(trials.files) as reader:
        total = sum(int(reader.read(trial).sum()) for trial in trials.trials)
    return total, content_digest(folder)


def read_finger(folder: Path) -> object:
    """Read everything that the interface for programs offers of a session of the finger."""
    with FingerSession.open(folder) as session:
        read: list[object] = [session.header, session.events, session.gaps, session.committed()]
        read += [session.protocol_text, session.rig_text, session.n_samples]
        for index in range(min(4, len(session.trials))):
            read += [session.trial_row(index), session.samples(index), session.spikes(index)]
            read += [session.scan_spikes(index), session.track(index), session.windows(index)]
            read += [session.velocities_um_s(index), session.predictions(index)]
            read += [session.normalisation(index), session.scan_start_s(index)]
        return read


def drum_content(folder: Path, report: VerifyReport) -> object:
    """Return all that a session of the drum says if ``verify`` misses nothing."""
    if any(WORLD in note for note in report.notes):
        return None
    return parts_content(folder, report)


def parts_content(folder: Path, report: VerifyReport) -> object:
    """Return all that the parts say if ``verify`` misses nothing.

    The parts hold both texts, so their copies are not compared; nor are files whose names nothing
    of a session bears: no reader opens them.
    """
    if not report.whole or not _proves_itself(folder):
        return None
    found: dict[str, object] = dict(folder_content(folder, "*.h5"))
    return {name: value for name, value in found.items() if FILES.match(name)}


def bytes_called_whole(folder: Path, report: VerifyReport) -> object:
    """Return the bytes of all files if ``verify`` calls the session whole, None if it does not."""
    if not report.whole or not _proves_itself(folder):
        return None
    files = [path for path in folder.iterdir() if path.name not in WITHOUT_DATA]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def _proves_itself(folder: Path) -> bool:
    def has_digests(path: Path) -> Any:
        with h5py.File(path, "r") as file:
            return "digests" in file

    parts = sorted(folder.glob("part-*.h5"))
    return any(map(has_digests, parts))


FILES = re.compile(r"part-\d{4}\.h5(/|$)")
TEXTS = (Place("*.toml", TEXT),)
DRUM_DOORS = (check, summarise, read_drum, read_trials)
FINGER_DOORS = (check, summarise, read_finger)
PARTS = (Place("part-*.h5", HDF5),)

SESSION_KINDS = (
    Kind(
        "data-bits",
        build_simulated,
        (Place(".", (flip_data_bit,)),),
        (check,),
        bytes_called_whole,
        most=1,
    ),
    Kind(
        "finger-data-bits",
        build_finger,
        (Place(".", (flip_data_bit,)),),
        (check,),
        bytes_called_whole,
        most=1,
    ),
    Kind("drum-part", build_drum, PARTS, DRUM_DOORS, drum_content),
    Kind("finger-part", build_finger, PARTS, FINGER_DOORS, parts_content),
    Kind(
        "drum-session",
        build_simulated,
        (*(Place(".", FOLDER),) * 3, *TEXTS),
        DRUM_DOORS,
        drum_content,
    ),
    Kind(
        "finger-session",
        build_finger,
        (*(Place(".", FOLDER),) * 3, *TEXTS),
        FINGER_DOORS,
        parts_content,
    ),
    Kind(
        "truth",
        build_simulated,
        (Place("world*.h5", HDF5),),
        (check, summarise),
    ),
    Kind(
        "notes",
        build_noted,
        (Place(NOTES, TEXT),),
        (read_all_notes, *DRUM_DOORS),
    ),
)
