"""Settings and fixtures of all tests: no leaked threads, and folders apart from the user's."""

from __future__ import annotations

import asyncio
import fcntl
import inspect
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before the plug-in starts Qt's application

# There is no deadline because the first call compiles kernels.
settings.register_profile("rigctl", deadline=None, derandomize=True)
settings.load_profile("rigctl")

BEGUN_FIRST = (
    "endurance/test_endurance.py",
    "endurance/test_faults.py",
    "attack/test_attack.py",
    "boards/test_flash.py",
    "gui/link/test_cut_off.py",
    "config/test_installed.py",
    "gui/bad_input/test_unplugged.py",
    "firmware/test_controls.py",
    "gui/operate/test_setup_boards.py",
    "encoder/test_processors.py",
    "gui/link/test_joining.py",
    "engine/setup/test_wirings.py",
    "gui/shell/test_never_blocked.py",
    "attack/test_wrong_wires.py",
    "finger/test_bench.py",
    "gui/shell/test_settings_garbage.py",
    "gui/firmware_flows/test_stop.py",
    "gui/shell/test_day_by_keyboard.py",
    "gui/shell/test_real_engine.py",
    "finger/test_troubles.py",
    "gui/shell/test_day_on_the_virtual_rig.py",
    "firmware/drum/test_drum_native.py",
    "gui/operate/test_real_calibration.py",
    "bench/test_identify_bench.py",
    "gui/protocol/test_learning_page.py",
    "fuzz/test_fuzz.py",
    "cli/test_run_command.py",
    "gui/live/test_replay.py",
    "gui/protocol/test_queue_without_a_window.py",
    "gui/analysis/test_long_trial.py",
    "gui/finger/test_real_finger.py",
    "contract/test_parts.py",
    "gui/bad_input/test_broken_engine.py",
    "engine/protocol/test_early_end.py",
    "gui/link/test_attach.py",
    "gui/shell/test_typed_numbers.py",
    "gui/shell/test_start_up.py",
    "gui/shell/test_shell_memory.py",
    "cli/test_working_folder.py",
    "finger/test_run.py",
    "gui/firmware_flows/test_protocol.py",
    "analysis/test_sensitivity.py",
    "gui/firmware_flows/test_hand_work.py",
    "gui/shell/test_shell.py",
    "gui/firmware_flows/test_two_windows.py",
    "finger/test_failures.py",
    "finger/cli/test_realtime.py",
    "synth/test_synth.py",
    "engine/rpc/test_client.py",
    "boards/test_boot_silence.py",
)
"""Files that take long: begun last, they would end alone. Each that computes stands beside one that
waits for a rig in real time, so that the workers do not all wait at once, and then all compute."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the files: the workers of ``make test`` take one after the other."""
    folder = Path(__file__).parent
    place = {folder / name: number for number, name in enumerate(BEGUN_FIRST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine: in the time of its engine, its rig or its loop, if any."""
    test = pyfuncitem.obj
    if not inspect.iscoroutinefunction(test):
        return None
    given = {name: pyfuncitem.funcargs[name] for name in inspect.signature(test).parameters}
    if "harness" in given:
        given["harness"].run(lambda _: test(**given))
    elif "operator" in given:
        given["operator"].run(test(**given))
    elif "loop" in given:
        given["loop"].run_until_complete(test(**given))
    else:
        asyncio.run(test(**given))
    return True


@pytest.fixture(autouse=True)
def no_leaked_threads() -> Iterator[None]:
    """Fail a test that leaves a thread running."""
    before = set(threading.enumerate())
    yield
    left = [t for t in threading.enumerate() if t not in before and t.is_alive()]
    for thread in left:
        thread.join(timeout=60.0)
    alive = [t.name for t in left if t.is_alive()]
    assert not alive, f"threads left behind: {alive}"


@pytest.fixture(autouse=True, scope="session")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Separate the tests from the user's cache, data and state of messages shown once."""
    with pytest.MonkeyPatch.context() as patch:
        for kind in ("cache", "data", "state"):
            patch.setenv(f"XDG_{kind.upper()}_HOME", str(tmp_path_factory.mktemp(kind)))
        yield


@pytest.fixture(scope="session")
def made_once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str, Callable[[Path], object]], Path]:
    """Return what fills a folder once for all workers of ``make test``; nobody changes it then."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def make(name: str, fill: Callable[[Path], object]) -> Path:
        folder = base / name
        with (base / f"{name}.made").open("a") as made:
            fcntl.flock(made, fcntl.LOCK_EX)
            if made.tell() == 0:
                folder.mkdir()
                fill(folder)
                made.write("made")
        return folder

    return make


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the properties ``shown`` of tests, such as seeds and figures, also if they pass."""
    for outcome in ("passed", "failed"):
        for report in terminalreporter.getreports(outcome):
            for name, value in report.user_properties:
                if name == "shown":
                    terminalreporter.write_line(str(value))
