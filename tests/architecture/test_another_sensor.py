"""Worked example: a sensor of 4 × 4 taxels in one layer is two files, and none of the program.

``FILES`` are all that a lab edits; ``docs/explanation/architecture.md`` shows the same edits.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from gui.live.live_page import LivePage
from gui.widgets.theme import LIGHT
from rigctl import host_build
from rigctl.analysis.report.demo import analyse_sessions
from rigctl.bench.boards import firmware_library
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.engine.live_file import LiveReader
from rigctl.errors import ConfigError, WrongBoard
from rigctl.rig import open_rig
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.architecture.imports import CHECKOUT
from tests.engine.engine_harness import EngineHarness, engine_on

PAGE = CHECKOUT / "docs" / "explanation" / "architecture.md"
BOARD = {
    "LINES = 3": "LINES = 4",
    "INPUTS = 6": "INPUTS = 4",
    "LINE_BIT[LINES] = {4, 5, 6}": "LINE_BIT[LINES] = {4, 5, 6, 7}",
    "INPUT_CHANNEL[INPUTS] = {0, 1, 2, 3, 4, 5}": "INPUT_CHANNEL[INPUTS] = {0, 1, 2, 3}",
}
RIG = """\
[ports]
simulate = "virtual"

[taxels]
count = 16
inputs = 4
rows = 4
columns = 4
"""
FILES = ("arduino/taxels/board.h", "rig.toml")
PROTOCOL = """
name = "sixteen"
textures = ["A", "L"]
speeds_mm_s = [100]
forces_g = [500]
repeats = 4
"""

LEVEL = SimulatedWorld(
    WorldParameters(frame_share=0.5, sensor_tilt_mm=0.0, plate_tilt_mm=0.0, plate_give_mm=0.0)
)
"""A soft, level sensor: the outer taxels of a wider one touch nothing with the nominal skin."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the virtual taxel board of the edited header."""
    folder = tmp_path_factory.mktemp("another")
    arduino = shutil.copytree(CHECKOUT / "arduino", folder / "arduino")
    header = arduino / "taxels" / "board.h"
    text = header.read_text(encoding="utf-8")
    for before, after in BOARD.items():
        assert text.count(before) == 1
        text = text.replace(before, after)
    header.write_text(text, encoding="utf-8")
    return host_build.build("taxels", folder / "virtual-taxels.so", arduino=arduino)


@pytest.fixture
def config(tmp_path: Path) -> RigConfig:
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return load_config(path)


@pytest.fixture
def harness(
    library: Path, config: RigConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[EngineHarness]:
    """Yield an engine on the virtual rig of that sensor."""
    usual = firmware_library.dynamic_library_path
    monkeypatch.setattr(
        firmware_library,
        "dynamic_library_path",
        lambda board: library if board == "taxels" else usual(board),
    )
    rig = open_rig("virtual", seed=3, paced=False, config=config, world=LEVEL)
    with engine_on(rig, tmp_path) as harness:
        yield harness


def test_it_is_recorded_shown_and_analysed(
    harness: EngineHarness, qapp: QApplication, tmp_path: Path
) -> None:
    harness.record(PROTOCOL)
    _check_window(harness)
    assert verify(harness.session).whole
    with Session.open(harness.session) as session:
        assert session.sensor_layout.describe() == "4 × 4 taxels in one layer"
        samples = session.samples(0)
        assert samples.shape[1] == 16 and len(session.inputs) == 16
        assert samples.mean(axis=0).min() > 40, "a taxel feels nothing: at rest it reads 20"
    held_out = analyse_sessions([harness.session], tmp_path / "figures").held_out
    assert held_out.n == 8 and max(held_out.correct_counts()) == 8


def _check_window(harness: EngineHarness) -> None:
    """The window of a sensor that it first hears of in the status shows all of its taxels."""
    page = LivePage(LIGHT)
    page.resize(900, 600)
    page.show()
    live = LiveReader(harness.folder / "live.ring")
    page.refresh(live)
    page.show_status(harness.engine.status())
    page.refresh(live)
    assert page.plots.heat_map.sensor_layout.names == tuple(str(n + 1) for n in range(16))
    assert page.plots.time_plots.traces.sensor_layout.n_taxels == 16
    rows = page.plots.time_plots.raster.rows
    assert (len(rows), rows.label(31)) == (32, "T_RA-16")
    spikes = page.plots.data.spikes_before(page.plots.data.history.newest, 5000)
    assert spikes.shape[1] == 32 and spikes.sum() > 100
    page.hide()
    live.close()


def test_a_board_of_another_sensor_is_refused(harness: EngineHarness, config: RigConfig) -> None:
    taxels = harness.rig.taxels
    taxels._wanted = RigConfig().taxels
    with pytest.raises(WrongBoard, match=r"sends 16 taxels, rig.toml describes 18: correct"):
        harness.rig.loop.run_until_complete(taxels.connect())
    with pytest.raises(ConfigError, match=r"compiled for 4 lines × 4 inputs, but .* count = 18"):
        open_rig("virtual")


def test_the_page_lists_the_files() -> None:
    text = (
        PAGE.read_text(encoding="utf-8").partition("\n## Another sensor\n")[2].partition("\n## ")[0]
    )
    for part in (*FILES, *BOARD.values(), *RIG.split("[taxels]\n")[1].splitlines()):
        assert part in text, part
    assert len(FILES) <= 4 and not any(name.startswith("gui") for name in FILES)


def test_no_module_counts_taxels() -> None:
    """The paper's number stands in the default of rig.toml and in the board's header alone."""
    sources = [*(CHECKOUT / "gui").rglob("*.py"), *(CHECKOUT / "rigctl").rglob("*.py")]
    texts = {path: path.read_text(encoding="utf-8") for path in sources}
    # The finger board is another board, with a wire of its own.
    del texts[CHECKOUT / "rigctl/finger/board_messages.py"]
    named = {path for path, text in texts.items() if "N_TAXELS" in text}
    assert {path for path in named if "finger.board_messages" not in texts[path]} == set()
