"""The public names of ``rigctl``: as the notebook and the page of the docs use them."""

from __future__ import annotations

import json
import re
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import rigctl
from rigctl.api import ConnectedRig
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.client import EngineRefusal
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, running_engines, runtime_folder

DOCS = Path(__file__).parents[2] / "docs" / "how-to"
PAGE, NOTEBOOK = DOCS / "script.md", DOCS / "notebook.ipynb"


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def rig() -> Iterator[ConnectedRig]:
    with rigctl.connect("virtual", paced=False) as rig:
        yield rig


def test_the_notebook_runs(place: Path) -> None:
    names: dict[str, object] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert names["pressed_g"] == pytest.approx(300, rel=0.03)
    assert getattr(names["run"], "state", "") == "done"
    assert getattr(names["spikes"], "trials", 0) == 32
    assert (place / "report" / "report.html").is_file()
    with rigctl.open_session("by-hand") as session:
        assert len(session.trials) == 0
    assert running_engines(runtime_folder()) == []


def test_the_page_names_everything_public() -> None:
    page = PAGE.read_text()
    assert [name for name in rigctl.__all__ if name not in page] == []
    methods = [name for name in vars(ConnectedRig) if not name.startswith("_")]
    assert [name for name in methods if f".{name}" not in page and name != "close"] == []
    stub = (Path(rigctl.__file__).with_suffix(".pyi")).read_text()
    assert sorted(re.findall(r" as (\w+)", stub)) == sorted(rigctl.__all__)


def test_blocks_have_every_sample_once(rig: ConnectedRig) -> None:
    blocks = list(rig.blocks(seconds=3.0))
    firsts = [block.first for block in blocks]
    assert firsts[1:] == [block.first + len(block) for block in blocks[:-1]]
    assert np.all(np.diff(np.concatenate([block.counters for block in blocks])) == 1)
    assert all(block.spikes.shape == (len(block), 36) for block in blocks)


def test_the_subscriber_of_the_page_gets_spikes_as_they_come(rig: ConnectedRig) -> None:
    (snippet,) = re.findall(r"in ten lines:\n\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(snippet.strip().splitlines()) <= 10
    command = [sys.executable, "-u", "-c", snippet]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as subscriber:
        assert subscriber.stdout is not None
        rig.mount("B")
        rig.set(force_g=300)
        rig.arm()
        rig.tare()
        while not select.select([subscriber.stdout], [], [], 0)[0]:  # it may have joined late
            rig.approach()
            rig.lift()
        first = subscriber.stdout.readline()
        subscriber.kill()
    assert re.fullmatch(r"\d+\.\d{3} s \[[ \d]+\]\n", first)


def test_a_refused_move_says_why_and_leaves_the_rig_as_it_was(rig: ConnectedRig) -> None:
    with pytest.raises(EngineRefusal, match="outside this rig's limits, 50 to 1200"):
        rig.set(force_g=5000)
    with pytest.raises(rigctl.RigctlError):
        rig.jog(10)  # the drum is off
    assert rig.status.state == State.IDLE


def test_questions_go_to_the_script_which_may_end_the_run(rig: ConnectedRig) -> None:
    asked: list[str] = []

    def refuse(question: str) -> bool:
        asked.append(question)
        return False

    run = rig.run("quick", "session", answer=refuse)
    assert run.state == "aborted" and len(asked) == 1 and "plate A" in asked[0]


def test_another_script_joins_the_engine_and_leaves_it_running(rig: ConnectedRig) -> None:
    with rigctl.connect(None) as second:
        assert second.status.state == State.IDLE
    assert len(running_engines(runtime_folder())) == 1


def test_without_an_engine_nothing_is_guessed() -> None:
    with pytest.raises(rigctl.RigctlError, match="no engine is running: name the rig"):
        rigctl.connect(None)
