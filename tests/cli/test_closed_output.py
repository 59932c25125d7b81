"""A reader that closes the pipe early, as ``head`` does."""

from __future__ import annotations

import subprocess
import sys

import pytest

from rigctl.cli import OUTPUT_CLOSED


@pytest.mark.parametrize("command", [["check", "paper"], ["world"]])
def test_a_closed_pipe_ends_the_command_without_a_traceback(command: list[str]) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "rigctl", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    with process.stderr:
        assert process.stderr.read() == b""
    assert process.wait() == OUTPUT_CLOSED
