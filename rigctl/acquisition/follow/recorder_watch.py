"""Whether the program that records a followed session is still there, and what to do if not."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from rigctl.acquisition.follow.states import RECORDER_GONE
from rigctl.session.layout import LOCK_FILE
from rigctl.session.session_reader import highest_number
from rigctl.session.writer_lock import Writer, lock_owner_computer, lock_owner_pid, writer_of

LOOK_EVERY_S = 1.0
SILENT_AFTER_S = 600.0
"""On another computer, a run without a part for this long may be gone. It may ask, too."""


class RecorderWatch:
    """Looks at the lock of one session about once a second.

    ``gone``: a sentence while the recorder is gone, else empty. ``silent``: one while a run on
    another computer may be gone. ``wall_s``: seconds since 1970, as the times of files have them.
    """

    def __init__(self, folder: Path, wall_s: Callable[[], float] = time.time) -> None:
        self.gone = self.silent = ""
        self._folder, self._wall_s = folder, wall_s
        self._looked_s: float | None = None
        self._was_gone = False

    def look(self, now_s: float, *, has_ended: bool) -> None:
        """Look, if it is time; ``now_s``: loop time, ``has_ended``: the session is closed.

        Two looks must agree: a new writer takes the lock before it writes its name into it.
        """
        if self._looked_s is not None and now_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = now_s
        writer = Writer.UNKNOWN if has_ended else writer_of(self._folder)
        is_gone = writer is Writer.GONE
        self.gone = self._gone() if is_gone and self._was_gone else ""
        self._was_gone = is_gone
        is_unknown = writer is Writer.UNKNOWN and not has_ended
        self.silent = self._silent() if is_unknown else ""

    def _gone(self) -> str:
        words = f"{RECORDER_GONE}: process {lock_owner_pid(self._folder)} ended"
        if not highest_number(self._folder):
            return (
                f"{words} before the first plate and recorded nothing: start the run again, into "
                "the same folder, and this window shows it"
            )
        return (
            f"{words} without closing the session, which is kept: continue it with --resume, and "
            f"this window shows it; or put it in order with rigctl recover {self._folder}"
        )

    def _silent(self) -> str:
        """Return a doubt about a run elsewhere that has recorded nothing for long, else nothing."""
        try:
            prepared_s = (self._folder / LOCK_FILE).stat().st_mtime
        except OSError:
            return ""
        silent_s = self._wall_s() - prepared_s
        if silent_s < SILENT_AFTER_S or highest_number(self._folder):
            return ""
        where = lock_owner_computer(self._folder) or "another computer"
        return (
            f"nothing has been recorded since the run was prepared on {where}: if it does not ask "
            "for its first plate there any more, start it again, into the same folder"
        )
