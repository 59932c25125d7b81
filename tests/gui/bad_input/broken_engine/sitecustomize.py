"""Python imports this at its start where it lies on the path: make the fault that a file names.

The environment names a file. While it holds ``full disk``, nothing more can be written into parts;
if it holds ``other firmware``, this program speaks another register map than the drum board.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from unittest import mock

VARIABLE = "RIGCTL_TEST_FAULT"


def _break_engine(fault: Path) -> None:
    from rigctl.boards import identity
    from rigctl.session.writer import PartWriter

    write = PartWriter.write

    def write_or_fail(self: PartWriter, covers: bool = True) -> None:
        if fault.read_text() == "full disk":
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, covers)

    mock.patch.object(PartWriter, "write", write_or_fail).start()
    if fault.read_text() == "other firmware":
        mock.patch.object(identity, "MAP_VERSION", 99).start()


if VARIABLE in os.environ and "engine" in sys.orig_argv:
    _break_engine(Path(os.environ[VARIABLE]))
