"""A trial of any length takes the window what its screen shows, and its process a block."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gui.analysis.open_sessions import OpenSessions, write_trial
from gui.analysis.task_values import TrialData
from gui.analysis.trial_sections import BLOCK_SAMPLES, SECTION_S, read_trial, replay_trial
from rigctl.cli import main
from rigctl.encoder.encoder import encode_trial, membrane_mv
from rigctl.encoder.features import FeatureLayout, trial_features
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.session import Session
from tests.gui.steps import SharedWindow, click, wait_until

N = 800_000
MAP = """
time = { rate_hz = 1000 }
taxels = { columns = ["1..2"], low = 0, high = 1000 }
labels = { texture = "felt", speed_mm_s = 40, force_g = 200 }
loadcell = { column = "3" }
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session with a trial of 13 minutes, imported."""
    folder = tmp_path_factory.mktemp("imported")
    time_s = np.arange(N) / 1000
    readings = (
        500 + 400 * np.sin(2 * np.pi * np.outer(time_s, (7, 9))) * np.sin(time_s / 40)[:, None]
    )
    force_g = np.full(N, np.nan)
    force_g[::50] = 200.0
    force_g[600_000] = 900.0
    np.save(folder / "long.npy", np.column_stack([np.rint(readings), force_g]))
    (folder / "map.toml").write_text(MAP)
    files = [str(folder / "map.toml"), str(folder / "long.npy"), "--out", str(folder / "session")]
    assert main(["import", "--map", *files]) == 0
    return folder / "session"


@pytest.fixture
def sessions(session: Path) -> Iterator[OpenSessions]:
    """Yield what a worker process holds open."""
    sessions = OpenSessions()
    sessions.open(str(session))
    yield sessions
    sessions.drum_session(str(session)).close()


def test_a_process_reads_blocks_and_sends_what_a_screen_shows(
    sessions: OpenSessions, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One trial of an hour took 4.5 GB in three processes, and half a second of the window."""
    read: list[int] = []
    samples_of = Session.samples

    def samples(self: Session, index: int, first: int = 0, end: int | None = None) -> object:
        found = samples_of(self, index, first, end)
        read.append(len(found))
        return found

    monkeypatch.setattr(Session, "samples", samples)
    trial = sessions.encoded(str(session), 0)
    data = read_trial(trial, str(session))
    assert max(read) == BLOCK_SAMPLES and sum(read) <= 2 * N
    assert data.is_long and len(pickle.dumps(data)) < 2_000_000
    read.clear()
    section = trial.section(700_000, 701_000, 1)
    assert len(section.low) == 1000 and sum(read) < 1000 + BLOCK_SAMPLES
    replay = replay_trial(trial, N - 1)
    assert len(replay.history) == SECTION_S * 1000 and replay.history.newest == N - 1


def test_sections_have_the_samples_spikes_voltages_and_features_of_the_whole(
    sessions: OpenSessions, session: Path
) -> None:
    trial = sessions.encoded(str(session), 0)
    whole = np.ascontiguousarray(sessions.drum_session(str(session)).samples(0))
    ranges = sessions.taxel_range(str(session))
    spikes = encode_trial(whole, ranges)
    data = read_trial(trial, str(session))
    layout = FeatureLayout.covering([N], [40.0], scaled=True)
    assert data.features is not None
    assert np.array_equal(data.features.values.ravel(), trial_features(spikes, 40.0, layout))
    assert (data.overview.low.min(axis=0) == whole.min(axis=0)).all()
    assert (data.overview.high.max(axis=0) == whole.max(axis=0)).all()
    section = trial.section(699_000, 701_000, 1)
    assert np.array_equal(section.low, whole[699_000:701_000])
    for row in range(4):
        train = spikes.train(row)
        at = train[(train >= 699_000) & (train < 701_000)]
        assert np.array_equal(np.flatnonzero(section.spikes[:, row]) + 699_000, at)
        assert np.array_equal(trial.train(row), train)
    one = Normalisation(ranges.low[[1]], ranges.high[[1]], ranges.source)
    voltage = membrane_mv(whole[:2000, [1]], one)
    assert np.array_equal(trial.voltage_mv(1, 1500, 2000), voltage[1500:])
    course = trial.section(590_000, 610_000, 1024).course
    assert course is not None and course.force_g.max() == 900.0
    assert course.force_s[np.argmax(course.force_g)] == pytest.approx(600.0)


def test_the_numbers_of_a_long_trial_are_written_to_the_last_sample(
    session: Path, tmp_path: Path
) -> None:
    for of_course, n_rows, name in ((False, N, "T2 (counts)"), (True, N // 50, "force (g)")):
        out = tmp_path / f"{name}.csv"
        write_trial(str(session), 0, of_course, out)
        names, first, *_, last = lines = out.read_text().splitlines()
        assert name in names and first.startswith("0.0,") and first.endswith(",no")
        assert len(lines) == 1 + n_rows
        assert float(last.partition(",")[0]) == pytest.approx(N / 1000, abs=0.051)


def test_the_window_reads_what_it_looks_at(disconnected: SharedWindow, session: Path) -> None:
    window = disconnected.window
    tab, view = window.analysis_tab, window.analysis_tab.trial_view.readings
    with Session.open(session) as recorded:
        whole = recorded.samples(0)
    window.show_panel("analysis")
    tab.panel.folder.setText(str(session))
    click(tab.panel.open_button)
    wait_until(lambda: isinstance(view.data, TrialData) and view.data.is_long)
    view.samples_plot.setXRange(650.1, 650.4, padding=0)
    wait_until(lambda: len(view.samples_plot.items[0].getData()[0]) == 2 * 303)
    x, y = view.samples_plot.items[0].getData()
    shown = whole[round(x[0] * 1000) : round(x[302] * 1000) + 1, 0]
    assert np.corrcoef(y[:303], shown)[0, 1] == pytest.approx(1.0)

    page = window.replay.page
    window.replay.show()
    page.open(str(session))
    wait_until(lambda: page.player.length == N and not page.worker.is_busy)
    page.place.setValue(780_000)
    wait_until(lambda: page.plots.data.reading_at(780_000, 1) == whole[780_000, 1])
    wait_until(lambda: page.voltage.has(page.pointer.taxel, 770_000, 780_001))
    assert page.voltage.curves[0].getData()[0][-1] == pytest.approx(780.0)
    page.place.setValue(100)
    wait_until(lambda: page.plots.data.history.oldest == 0 and not page.worker.is_busy)
    page.place.setValue(719_000)
    wait_until(lambda: page.plots.data.history.newest >= 749_000 and not page.worker.is_busy)
    assert page.plots.data.reading_at(719_999, 0) == whole[719_999, 0]
    assert page.plots.data.reading_at(720_000, 0) == whole[720_000, 0]
    window.replay.hide()
