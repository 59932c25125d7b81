"""The tracker, exporter and task of the how-to, as one package."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.errors import WrongUse
from rigctl.finger.trackers.open_tracker import open_tracker
from rigctl.values import Position
from tests.analysis.recordings import record
from tests.architecture.imports import CHECKOUT
from tests.boards.memory_link import JumpingLoop
from tests.drivers.conftest import searched
from tests.drivers.support import install_package

PAGE = CHECKOUT / "docs" / "how-to" / "drivers.md"
BLOCK = re.compile(r"^```(python|toml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the package that the page shows."""
    folder = tmp_path_factory.mktemp("lab")
    blocks = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    source = folder / "rigctl-lab"
    source.mkdir()
    project = next(text for kind, text in blocks if kind == "toml")
    (source / "pyproject.toml").write_text(project, encoding="utf-8")
    module = "\n".join(text for kind, text in blocks if kind == "python")
    (source / "rigctl_lab.py").write_text(module, encoding="utf-8")
    install_package(source, folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "session"
    return record(folder, ("A", "B"), repeats=4, speeds=(40,), forces=(500,))


def rigctl(lab: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command in an environment that has the package."""
    path = os.pathsep.join(map(str, (lab, CHECKOUT)))
    return subprocess.run(
        [sys.executable, "-m", "rigctl", *words],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_tracker_is_named_by_its_text(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in searched(lab, monkeypatch):
        loop = JumpingLoop()
        positions: list[Position] = []
        tracker = open_tracker("motor:80", loop)
        tracker.open(positions.append, pytest.fail)
        loop.call_later(1.0, loop.stop)
        loop.run_forever()
        tracker.close()
        assert tracker.name == "motor at 80 mm/s" and len(positions) > 90
        assert positions[50].x_mm == pytest.approx(80 * (positions[50].at_s - positions[0].at_s))
        with pytest.raises(WrongUse, match="motor:fast has no speed"):
            open_tracker("motor:fast", loop)
        with pytest.raises(WrongUse, match=r"names no tracker: write .*, motor:…"):
            open_tracker("engine:80", loop)
        loop.close()


def test_an_exporter_writes_for_the_command(lab: Path, session: Path, tmp_path: Path) -> None:
    out = tmp_path / "trials.json"
    words = ("export", str(session), "--to", "trials-json", "--out", str(out))
    done = rigctl(lab, *words, "--representations", "readings")
    assert done.returncode == 0, done.stderr
    assert "written by the exporter trials-json of rigctl-lab 1.0.0" in done.stderr
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["about"]["session"] == "session" and len(written["trials"]) == 8
    again = rigctl(lab, *words)
    assert again.returncode == 2 and "exists already" in again.stderr


def test_a_task_is_run_and_reported(lab: Path, session: Path, tmp_path: Path) -> None:
    report = tmp_path / "report"
    options = ("--task", "early-late", "--iterations", "2", "--k-max", "2", "--no-cache")
    done = rigctl(lab, "analyse", str(session), "--out", str(report), *options)
    assert done.returncode == 0, done.stderr
    results = json.loads((report / "results.json").read_text(encoding="utf-8"))
    assert list(results["tasks"]) == ["early-late"]
    text = (report / "report.html").read_text(encoding="utf-8")
    assert "split by the task early-late of rigctl-lab 1.0.0" in text


def test_the_page_shows_the_contracts_of_the_examples() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name in ("teensy16/rigctl_teensy16.py", "step_axis/rigctl_step_axis.py"):
        source = (CHECKOUT / "tests" / "drivers" / name).read_text(encoding="utf-8")
        heart = next(
            block
            for block in re.findall(r"```py\n(.*?)```", text, re.DOTALL)
            if block.splitlines()[0] in source
        )
        for line in filter(None, (line.removesuffix(" ...") for line in heart.splitlines())):
            assert line in source, line
