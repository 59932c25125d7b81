"""A state of the window that is worth a picture."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gui.screenshots.camera import Camera
from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice
from rigctl.acquisition.rpc.engine_files import FOLDER_VARIABLE

FINGER_SEED = "1"
_FINGER = ("--protocol", "quick", "--yes", "--seed", FINGER_SEED, "--out")


class Recordings:
    """A session of the drum, and models of the finger, below a folder; made one after the other.

    Their engines are not among those that the window finds.
    """

    def __init__(self, work: Path) -> None:
        self.session, self.model = work / "quick", work / "finger-calibrate"
        train = str(work / "finger-train")
        commands = (
            ("run", "quick", "--yes", "--seed", "1", "--out", str(self.session)),
            ("realtime", "train", *_FINGER, train),
            ("realtime", "calibrate", *_FINGER, str(self.model), "--model", train),
        )
        self._waiting = list(commands)
        self._environment = os.environ | {FOLDER_VARIABLE: str(work / "recording")}
        self._present: subprocess.Popen[bytes] | None = None
        self.n_done = 0
        self.advance()

    @property
    def has_session(self) -> bool:
        """Whether the session of the drum is complete."""
        self.advance()
        return self.n_done >= 1

    @property
    def has_model(self) -> bool:
        """Whether the finger's models are complete."""
        self.advance()
        return self.n_done == 3

    def advance(self) -> None:
        """Begin the next recording where one has ended. Raises SystemExit if that failed."""
        if self._present is not None:
            if (code := self._present.poll()) is None:
                return
            if code:
                raise SystemExit(f"a recording failed with exit code {code}: see above")
            self.n_done += 1
            self._present = None
        if self._waiting:
            words = [sys.executable, "-m", "rigctl", *self._waiting.pop(0)]
            self._present = subprocess.Popen(
                words, stdout=subprocess.DEVNULL, env=self._environment
            )

    def end(self) -> None:
        """End what still records."""
        if self._present is not None:
            self._present.terminate()
            self._present.wait()


SAVE_IN = "~/rigctl-sessions"
"""What fields for folders show, on whatever computer."""


def always() -> bool:
    """Return that a scene that does not move is ready."""
    return True


@dataclass(frozen=True, slots=True)
class Scene:
    """A name, and when to take the picture. ``choice``: the only theme, None for both."""

    name: str
    ready: Callable[[], bool] = field(default=always)
    choice: ThemeChoice | None = None


@dataclass(frozen=True, slots=True)
class Studio:
    """The window, its camera, a folder to work in, and what is recorded there."""

    window: MainWindow
    camera: Camera
    work: Path
    recordings: Recordings
