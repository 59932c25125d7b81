"""What rooms load of an experiment by name is there, and its package is no import of theirs."""

from __future__ import annotations

import subprocess
import sys

import pytest

from rigctl.experiments import DRUM_EXPERIMENT, EXPERIMENTS
from rigctl.session.part import layout_of
from rigctl.session.session_reader import SessionReader
from tests.architecture.imports import CHECKOUT


@pytest.mark.parametrize(
    ("name", "part"), [(name, part) for name, one in EXPERIMENTS.items() for part in one.parts]
)
def test_every_part_of_an_experiment_is_there(name: str, part: str) -> None:
    assert callable(EXPERIMENTS[name].load(part)) or part in ("layout", "trackers")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiments_sessions_have_its_layout(name: str) -> None:
    layout = layout_of({"experiment": name}, CHECKOUT)
    reader: type[SessionReader] = EXPERIMENTS[name].load("reader")
    assert layout.experiment == name and reader.layout is layout


def test_an_experiment_can_be_left_out_where_it_is_not_met() -> None:
    others = [name for name in EXPERIMENTS if name != DRUM_EXPERIMENT]
    code = (
        "import sys, rigctl.session.verify, rigctl.engine.engine, rigctl.protocol.form_content\n"
        f"assert not [m for m in sys.modules for e in {others} if m.startswith('rigctl.' + e)]"
    )
    subprocess.run([sys.executable, "-c", code], cwd=CHECKOUT, check=True)
