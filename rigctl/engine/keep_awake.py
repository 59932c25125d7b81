"""Keep the computer from sleeping and restarting while a run goes on, by the system's own means.

A helper program holds the wish for as long as its standard input is open, so that the wish ends
with this process, however that ends: ``systemd-inhibit`` (logind) on Linux, ``caffeinate`` on
macOS. Windows keeps it for a thread.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

WHY = "a rig is recording"
HOLD = ("sh", "-c", "echo held; exec cat")
HELPERS: dict[str, Sequence[str]] = {
    "linux": (
        "systemd-inhibit",
        "--what=sleep:idle:shutdown",
        "--who=rigctl",
        f"--why={WHY}",
        *HOLD,
    ),
    "darwin": ("caffeinate", "-i", "-m", "-s", *HOLD),
}
Tell = Callable[[str], None]
"""Gets a sentence where the computer cannot be kept awake, from any thread."""
KeepAwake = Callable[[Tell], AbstractContextManager[None]]
CURE = "switch sleep and automatic restarts off for the time of the run"


@contextmanager
def not_kept_awake(tell: Tell) -> Iterator[None]:
    """Let the computer sleep when it likes, as beside a simulated rig."""
    yield


@contextmanager
def kept_awake(tell: Tell) -> Iterator[None]:
    """Keep the computer awake; ``tell`` gets a sentence, from any thread, where that cannot be."""
    if sys.platform == "win32":
        with _awake_windows(tell):
            yield
        return
    helper = HELPERS.get(sys.platform)
    if helper is None:
        tell(f"this computer may sleep during the run: {CURE}")
        yield
        return
    with _held_by(helper, tell):
        yield


@contextmanager
def _held_by(helper: Sequence[str], tell: Tell) -> Iterator[None]:
    pipe = subprocess.PIPE
    try:
        process = subprocess.Popen(helper, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    except OSError:
        tell(f"this computer may sleep or restart during the run, {helper[0]} is not there: {CURE}")
        yield
        return
    thread = threading.Thread(target=_await_hold, args=(process, helper[0], tell), daemon=True)
    thread.start()
    try:
        yield
    finally:
        assert process.stdin is not None
        process.stdin.close()
        process.terminate()  # one that waits for the system bus does not read
        thread.join()
        process.wait()
        for stream in (process.stdout, process.stderr):
            assert stream is not None
            stream.close()


def _await_hold(process: subprocess.Popen[str], name: str, tell: Tell) -> None:
    """Tell where the helper ends without a hold."""
    assert process.stdout is not None and process.stderr is not None
    if not process.stdout.readline():
        reason = (process.stderr.readline().strip() or "no reason").rstrip(".")
        tell(f"this computer may sleep or restart during the run, {name} says: {reason}: {CURE}")


if sys.platform == "win32":
    import ctypes

    CONTINUOUS, SYSTEM_REQUIRED = 0x80000000, 0x00000001

    @contextmanager
    def _awake_windows(tell: Tell) -> Iterator[None]:
        set_state = ctypes.windll.kernel32.SetThreadExecutionState
        if not set_state(CONTINUOUS | SYSTEM_REQUIRED):
            tell(f"this computer may sleep during the run: {CURE}")
        tell(
            "Windows may restart for updates during the run: set its active hours, or pause updates"
        )
        try:
            yield
        finally:
            set_state(CONTINUOUS)
