"""All code is compiled before a rig is armed, also at the first start after installation."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

FIRST_START = """
import sys
from pathlib import Path
from numba.core import event
from tests.acquisition.engine_harness import open_harness
from tests.acquisition.health.test_poll_retries import ONE

with open_harness(Path(sys.argv[1])) as harness:
    with event.install_recorder("numba:compile") as late:
        assert harness.record(ONE).outcome == "done"
print(sorted({str(each.data["dispatcher"]) for _, each in late.buffer}))
"""


def test_nothing_is_compiled_once_the_boards_are_connected(tmp_path: Path) -> None:
    empty = tmp_path / "compiled"
    empty.mkdir()
    (tmp_path / "work").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", FIRST_START, str(tmp_path / "work")],
        env=os.environ | {"NUMBA_CACHE_DIR": str(empty)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert any(empty.rglob("*.nbc")), "the kernels were kept elsewhere, so this test saw nothing"
    assert (done.stdout.strip(), done.returncode) == ("[]", 0), done.stderr
