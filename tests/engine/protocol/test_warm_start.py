"""All code is compiled before a rig is armed, also at the first start after installation.

A fresh process shows it without an empty cache: numba asks a kernel to compile for the types of its
first call, and only then looks whether the cache has it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

FIRST_START = """
import json
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from tests.engine.engine_harness import open_harness
from tests.engine.health.test_poll_retries import ONE

asked, compile_for = [], Dispatcher.compile

def note(kernel, types):
    asked.append(str(kernel))
    return compile_for(kernel, types)

Dispatcher.compile = note
with open_harness(Path(sys.argv[1])) as harness:
    before = len(asked)
    assert harness.record(ONE).outcome == "done"
print(json.dumps([asked[:before], asked[before:]]))
"""


def test_nothing_is_compiled_once_the_boards_are_connected(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FIRST_START, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    before, late = json.loads(done.stdout)
    assert late == []
    assert before, "no kernel was compiled before either, so this test saw nothing"
