"""What the window has done in other processes: planning, reading, encoding, classifying.

No Qt in here, and what is slow to import is imported by the task that needs it.
"""

from __future__ import annotations

from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis import results
from gui.analysis.results import AnalysisRequest, AnalysisResults
from gui.widgets.formatting import duration, size
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.session.read.session import Session

Progress = Callable[[str, float], None]


class SessionTable(NamedTuple):
    """A session's trials as text, ready to be shown; ``about`` says what it is."""

    path: str = ""
    about: str = ""
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


class TrialData(NamedTuple):
    """One trial: readings and spikes.

    ``samples``: uint16 (n, 18). ``spike_row`` and ``spike_sample``: int64 (k,), one entry a
    spike; rows are SA taxel 1 … 18, then RA 1 … 18.
    """

    title: str
    samples: NDArray[np.uint16]
    spike_row: NDArray[np.int64]
    spike_sample: NDArray[np.int64]


class Classified(NamedTuple):
    """The classification's answer in a sentence, and the path of its figure."""

    sentence: str
    figure: str


class Summary(NamedTuple):
    """What a protocol asks for, in words, and the seed of its order.

    ``problem`` is the sentence that says why it cannot be run, empty where it can.
    """

    trials: str = "–"
    plates: str = "–"
    time: str = "–"
    disk: str = "–"
    seed: int = 0
    problem: str = ""


def serve(pipe: Connection) -> None:
    """Answer (task, args) with ("done", result) or ("failed", sentence) until the window goes."""
    analyst = Analyst(lambda stage, share: pipe.send(("progress", stage, share)))
    while True:
        try:
            task, args = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            return
        pipe.send(_answer(getattr(analyst, task), args))


def _answer(task: Callable[..., Any], args: dict[str, Any]) -> tuple[str, Any]:
    try:
        return "done", task(**args)
    except RigctlError as error:
        return "failed", str(error)
    except Exception as error:  # noqa: BLE001  # top of a process: shown in the window
        return "failed", f"{type(error).__name__} in the analysis: {error}"


class Analyst:
    """Keeps the last session in mind; ``progress`` is told a stage and a share of 1."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._path = Path()
        self._range: Normalisation | None = None

    def summarise(self, path: str, seed: int | None) -> Summary:
        """Plan a protocol as ``rigctl check`` does; by its own seed where None is given."""
        from rigctl.protocol import load_protocol

        try:
            plan = load_protocol(Path(path)).plan(seed)
        except RigctlError as error:
            return Summary(problem=str(error))
        time, disk = duration(plan.duration_s), size(plan.bytes_estimate)
        return Summary(f"{len(plan.trials)}", f"{plan.plate_changes}", time, disk, plan.seed)

    def open_session(self, path: str) -> SessionTable:
        """Read a session's trial table. Raises SessionError."""
        from rigctl.session.read.session import Session

        self._path, self._range = Path(path).expanduser(), None
        with Session.open(self._path) as session:
            header, committed = session.header, len(session.committed())
            rows = tuple(map(_trial_texts, session.trials))
        about = (
            f"{self._path.name}: {committed} of {header.trials_planned} trials committed, "
            f"{'simulated' if header.simulated else 'real'} rig, begun {header.start_utc}"
        )
        return SessionTable(str(self._path), about, COLUMNS, rows)

    def load_trial(self, row: int) -> TrialData:
        """Readings of one attempt and the spikes that the live encoder makes of them."""
        from rigctl.encoding.encoder import Encoder
        from rigctl.session.read.session import Session

        with Session.open(self._path) as session:
            samples = np.ascontiguousarray(session.samples(row))
            texts = _trial_texts(session.trials[row])
            if self._range is None:
                self._range = _taxel_range(session)
        title = "Trial {}: plate {}, {} mm/s, {} g, {}".format(*texts)
        counts = Encoder(self._range).encode(samples)
        at, lane = np.nonzero(counts)
        times = counts[at, lane]
        return TrialData(title, samples, np.repeat(lane, times), np.repeat(at, times))

    def classify(self, path: str) -> Classified:
        """The demo's classification of a session's textures; its figures lie in the session."""
        from rigctl.analysis.report.demo import analyse_session

        answer = analyse_session(Path(path), Path(path) / FIGURES, progress=self._progress)
        sentence = ". ".join((answer.sentence, *answer.remarks))
        return Classified(sentence, str(answer.accuracy.with_suffix(".png")))

    def analyse(self, order: AnalysisRequest) -> AnalysisResults:
        """A report of chosen sessions, as ``rigctl analyse`` makes it."""
        return results.analyse(order, self._progress)

    def ask_model(self, model: str, sessions: tuple[str, ...]) -> AnalysisResults:
        """What a trained model says of chosen sessions, as ``rigctl classify`` asks it."""
        return results.ask_model(model, sessions, self._progress)

    def discard(self, folder: str) -> None:
        """Remove what a cancelled analysis left."""
        results.discard(folder)


FIGURES = "figures"
COLUMNS = ("Trial", "Plate", "mm/s", "g", "Verdict")


def _trial_texts(row: Any) -> tuple[str, ...]:
    return (
        f"{row['trial_id']}",
        f"{row['texture']}",
        f"{row['speed_mm_s']:g}",
        f"{row['force_g']:g}",
        f"{row['verdict']}",
    )


def _taxel_range(session: Session) -> Normalisation:
    """The calibrated range that stands in the session, else that of trials spread over it."""
    from rigctl.encoding.normalisation import Normalisation

    header = session.header
    if header.taxel_low:
        low, high = (np.array(side, np.uint16) for side in (header.taxel_low, header.taxel_high))
        return Normalisation(low, high, "calibration of the session")
    committed = session.committed()
    spread = committed[:: max(1, len(committed) // _RANGE_TRIALS)]
    return Normalisation.over(map(session.samples, spread.tolist()), "trials of the session")


_RANGE_TRIALS = 100
