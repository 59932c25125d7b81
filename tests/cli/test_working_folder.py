"""Scripts in the working folder that have the names of libraries are not imported.

The folder has one for each module of Python and each library that rigctl uses, and an old checkout
of rigctl. Each leaves a mark where anything imports it, and ends its program.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, running_engines, runtime_folder
from tests.waiting import until

SCRIPT = """
open(__file__ + ".ran", "w").close()
raise SystemExit("this is my own script, not a library")
"""
PROTOCOL = """
name = "tiny"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 2

[trial]
travel_mm = 60
"""
BIN = Path(sys.executable).parent
RIGCTL = str(BIN / "rigctl")
LABS_OWN = {"csv", "queue", "random", "serial", "signal", "statistics"}
"""What labs have; ``python -m`` itself imports other names before a line of rigctl runs."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working folder with a script of every name; engines are announced beside it."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    place = tmp_path / "data"
    place.mkdir()
    names = {*sys.stdlib_module_names, *packages_distributions(), "gui"} - {"rigctl"}
    for name in names:
        if name.isidentifier():
            (place / f"{name}.py").write_text(SCRIPT)
    old = place / "rigctl"
    old.mkdir()
    (old / "__init__.py").write_text(SCRIPT)
    return place


def environment() -> dict[str, str]:
    """Return an environment in which Python may import from the working folder."""
    own = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    return {**own, "QT_QPA_PLATFORM": "offscreen"}


def imported(folder: Path) -> list[str]:
    """Return the names that something has imported from the folder."""
    return sorted(path.name for path in folder.rglob("*.ran"))


def call(folder: Path, command: Sequence[str], *words: str) -> str:
    """Run a command in the folder to its good end."""
    done = subprocess.run(
        [*command, *words],
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert imported(folder) == []
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_no_command_and_none_of_its_processes_imports_a_script(folder: Path) -> None:
    (folder / "tiny.toml").write_text(PROTOCOL)
    call(folder, [RIGCTL], "--help")
    run = ["run", "--rig", "virtual", "tiny.toml", "--out", "recorded", "--yes"]
    assert "2 of 2 trials committed" in call(folder, [RIGCTL], *run)
    call(folder, [RIGCTL], "verify", "recorded")
    synth = ["synth", "--plan", "tiny.toml", "--seed", "1", "--sessions", "2", "--workers", "2"]
    call(folder, [RIGCTL], *synth, "--out", "set")
    encode = ["encode", "recorded", "--workers", "2", "--no-cache", "--out", "spikes"]
    call(folder, [RIGCTL], *encode)


def test_python_m_does_not_leave_the_folder_on_the_path(folder: Path) -> None:
    (folder / "rigctl/__init__.py").unlink()
    for script in folder.glob("*.py"):
        if script.stem not in LABS_OWN:
            script.unlink()
    (folder / "tiny.toml").write_text(PROTOCOL)
    by_module = [sys.executable, "-m", "rigctl"]
    run = ["run", "--rig", "virtual", "tiny.toml", "--out", "recorded", "--yes"]
    assert "2 of 2 trials committed" in call(folder, by_module, *run)


@pytest.mark.parametrize("program", [[RIGCTL, "gui"], [str(BIN / "rigctl-gui")]])
def test_the_window_its_reader_and_its_engine_import_no_script(
    program: list[str], folder: Path
) -> None:
    words = [*program, "--rig", "virtual"]
    with subprocess.Popen(words, cwd=folder, env=environment()) as window:
        until(lambda: running_engines(runtime_folder()) or window.poll() is not None)
        window.send_signal(signal.SIGTERM)
        assert window.wait(120) == 0
    assert imported(folder) == []
