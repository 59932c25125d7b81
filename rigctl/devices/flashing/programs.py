"""The programs that write boards, avrdude and teensy_loader_cli: found, run and timed."""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import WrongUse

AVRDUDE, TEENSY_LOADER = "avrdude", "teensy_loader_cli"
_INSTALL = {
    AVRDUDE: {
        "linux": "sudo apt install avrdude",
        "darwin": "brew install avrdude",
        "win32": "winget install AVRDudes.AVRDUDE",
    },
    TEENSY_LOADER: {
        "linux": "sudo apt install teensy-loader-cli",
        "darwin": "brew install teensy_loader_cli",
        "win32": "get it from https://www.pjrc.com/teensy/loader_cli.html and put it on the PATH",
    },
}
_ARDUINO_IDE = {"darwin": "~/Library/Arduino15", "win32": "~/AppData/Local/Arduino15"}
"""Where the IDE keeps its tools; ``~/.arduino15`` on other systems."""


@dataclass(frozen=True, slots=True)
class ProgramRun:
    """How a run of a program ended: its exit code, None where it was ended, and its last words."""

    exit_code: int | None
    output: str


def find_program(name: str) -> list[str]:
    """Return the command of a program: that of the PATH, or avrdude of the Arduino IDE.

    Raises WrongUse with the line that installs it.
    """
    if path := shutil.which(name):
        return [path]
    folder = Path(_ARDUINO_IDE.get(sys.platform, "~/.arduino15")).expanduser()
    suffix = ".exe" if sys.platform == "win32" else ""
    for tool in sorted(folder.glob(f"packages/*/tools/{name}/*/bin/{name}{suffix}"), reverse=True):
        return [str(tool), "-C", str(tool.parents[1] / "etc" / f"{name}.conf")]
    line = _INSTALL[name].get(sys.platform, _INSTALL[name]["linux"])
    raise WrongUse(f"{name} is not installed: {line}")


async def run_program(
    command: Sequence[str], stall_s: float, progressed: Callable[[str], bool]
) -> ProgramRun:
    """Run a program and return how it ended; it is ended after ``stall_s`` without progress.

    ``progressed(text)`` gets what the program prints, as it comes, and returns whether that shows
    progress.
    """
    loop = asyncio.get_running_loop()
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env=os.environ | {"LC_ALL": "C"},
    )
    assert process.stdout is not None
    output = ""
    deadline_s = loop.time() + stall_s
    try:
        while True:
            async with asyncio.timeout_at(deadline_s):
                data = await process.stdout.read(256)
            if not data:
                return ProgramRun(await process.wait(), output)
            text = data.decode(errors="replace")
            output += text
            if progressed(text):
                deadline_s = loop.time() + stall_s
    except TimeoutError:
        return ProgramRun(None, output)
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
