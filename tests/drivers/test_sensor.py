"""Worked example: 16 capacitive taxels on a Teensy are one file, and none of ours.

The package is ``tests/drivers/teensy16``. Its sensor is recorded on the virtual rig, shown in the
window, judged, analysed and exported.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pyarrow import csv, parquet
from PySide6.QtWidgets import QApplication

from gui.live.live_page import LivePage
from gui.widgets.theme import LIGHT
from rigctl.analysis.report.demo import analyse_sessions
from rigctl.analysis.session_quality import judge_session
from rigctl.config.rig_config import RigConfig, parse_config
from rigctl.engine.live_file import LiveReader
from rigctl.rig import open_rig
from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.values import PluginUse
from tests.architecture.test_another_sensor import LEVEL, PROTOCOL
from tests.engine.engine_harness import EngineHarness, engine_on
from tests.exchange.export.conftest import export

RIG = """\
[ports]
simulate = "virtual"

[taxels]
driver = "teensy16"
count = 16
inputs = 4
rows = 4
columns = 4
full_scale = 65535
"""


@pytest.fixture
def config(examples: Path) -> RigConfig:
    return parse_config(RIG)


@pytest.fixture
def harness(config: RigConfig, tmp_path: Path) -> Iterator[EngineHarness]:
    """Yield an engine on the virtual rig with that sensor."""
    rig = open_rig("virtual", seed=3, paced=False, config=config, world=LEVEL)
    with engine_on(rig, tmp_path) as harness:
        yield harness


def test_it_is_recorded_shown_judged_analysed_and_exported(
    harness: EngineHarness, qapp: QApplication, tmp_path: Path
) -> None:
    harness.record(PROTOCOL)
    assert verify(harness.session).whole
    with Session.open(harness.session) as session:
        header, samples = session.header, session.samples(0)
    assert header.plugins == (PluginUse("sensor", "teensy16", "rigctl-teensy16", "1.2.0"),)
    assert header.highest_reading == 65_535 and samples.shape[1] == 16
    assert samples.mean(axis=0).min() > 64 * 40, "a taxel feels nothing: at rest it reads 64 · 20"
    _check_window(harness)
    assert judge_session(harness.session).counts()["pass"] == 8
    held_out = analyse_sessions([harness.session], tmp_path / "figures").held_out
    assert held_out.n == 8 and max(held_out.correct_counts()) == 8
    _check_exports(harness.session, samples, tmp_path)


def _check_window(harness: EngineHarness) -> None:
    """All 16 taxels are shown, in their own range, with spikes."""
    page = LivePage(LIGHT)
    page.resize(900, 600)
    page.show()
    live = LiveReader(harness.folder / "live.ring")
    page.refresh(live)
    page.show_status(harness.engine.status())
    page.refresh(live)
    assert page.plots.time_plots.traces.sensor_layout.n_taxels == 16
    low, high = page.plots.time_plots.traces.range_of(5)
    assert high - low >= 8192
    spikes = page.plots.data.spikes_before(page.plots.data.history.newest, 5000)
    assert spikes.shape[1] == 32 and spikes.sum() > 100
    page.hide()
    live.close()


def _check_exports(session: Path, samples: NDArray[np.uint16], folder: Path) -> None:
    """Every reading of the first trial is in the exported tables, as it was recorded."""
    for to in ("parquet", "csv"):
        export(session, to, folder / to)
    tables = (
        parquet.read_table(folder / "parquet" / "samples.parquet"),
        csv.read_csv(folder / "csv" / "samples.csv"),
    )
    for table in tables:
        readings = np.stack([table[str(n + 1)].to_numpy() for n in range(16)], axis=1)
        (first,) = np.flatnonzero((readings == samples[0]).all(axis=1))[:1]
        assert np.array_equal(readings[first : first + len(samples)], samples)
    about = json.loads((folder / "csv" / "about.json").read_text(encoding="utf-8"))
    assert about["plugins"] == "sensor teensy16 of rigctl-teensy16 1.2.0"
