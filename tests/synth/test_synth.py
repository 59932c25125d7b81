"""A virtual data set: complete, marked as simulated, and like a recording of the virtual rig."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import NOMINAL_WORLD, SimulatedWorld, load_world
from rigctl.cli import main
from rigctl.config.resources import protocols, source_commit
from rigctl.errors import BoardFault, SessionError
from rigctl.session import layout
from rigctl.session.ground_truth import open_truth, trial_truths
from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.synth import step_runner
from rigctl.synth.dataset import DatasetProgress, DatasetRequest, generate, load_plan
from tests.engine.engine_harness import open_harness

TEXT = """
name = "tiny"
textures = ["L", "D"]
speeds_mm_s = [100, 120]
forces_g = [500]
repeats = 7
"""
SEED = 3
BASE_SPACE_MM = WorldParameters().base_space_mm
SPACES_MM = {"L": BASE_SPACE_MM, "D": 2.0 * BASE_SPACE_MM}
TOP_LAYER = slice(0, 9)
"""The ripple of the bottom layer is about a count, as its noise."""


@pytest.fixture(scope="module")
def protocol(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("protocol") / "tiny.toml"
    path.write_text(TEXT)
    return path


def make(
    protocol: Path,
    folder: Path,
    seed: int = SEED,
    stop_at: int = 1000,
    workers: int = 1,
    resume: bool = False,
    world: SimulatedWorld = NOMINAL_WORLD,
) -> list[DatasetProgress]:
    progress: list[DatasetProgress] = []
    request = DatasetRequest(
        load_plan(protocol, 1, seed), seed, folder, "2026-01-02T03:04:05+00:00", resume, world
    )
    generate(request, progress.append, lambda: len(progress) >= stop_at, workers)
    return progress


def tables(folder: Path) -> dict[str, NDArray[Any]]:
    """Return all recorded data over all parts; loop time rounded to a nanosecond."""
    with Session.open(folder) as session:
        found = {
            name: np.concatenate([p.read(f"/taxels/{name}", 0, p.n_samples) for p in session.parts])
            for name in ("samples", "counter", "flags", "edges")
        }
        for table in (layout.DRUM, layout.LOADCELL):
            rows = np.concatenate([part.rows(table) for part in session.parts])
            found |= {f"{table.path}.{column.name}": rows[column.name] for column in table.columns}
    found["/drum.at_s"] = np.round(found["/drum.at_s"], 9)
    with open_truth(folder / "world.h5") as truth:
        for name in ("speed_mm_s", "force_g", "sync"):
            found[name] = truth.window(name, 0, truth.n_rows)
    return found


def assert_equal(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> None:
    """Compare bit for bit."""
    assert one.keys() == other.keys()
    assert [name for name in one if not np.array_equal(one[name], other[name])] == []


@pytest.fixture(scope="module")
def session_folder(protocol: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synth") / "session"
    make(protocol, folder)
    return folder


def test_the_session_is_complete_and_marked_as_simulated(session_folder: Path) -> None:
    report = verify(session_folder)
    assert report.problems == []
    assert report.trials_committed == 4
    with Session.open(session_folder) as session:
        header = session.header
        assert (header.rig, header.simulated, header.trials_planned) == ("synth", True, 4)
        assert (header.software_version, header.software_commit) == (__version__, source_commit())
        assert header.simulation["seed"] == SEED
        assert header.simulation["method"] == "direct"
        assert "repeats = 1" in session.protocol_text
        assert [part.attributes["texture"] for part in session.parts] == ["L", "D"]


def test_each_trial_has_its_load_cell_polls_and_truth(session_folder: Path) -> None:
    with Session.open(session_folder) as session:
        truths = trial_truths(session)
        assert [truth.trial_id for truth in truths] == [1, 2, 3, 4]
        assert max(abs(truth.speed_error) for truth in truths) < 1e-3
        assert max(abs(truth.force_error) for truth in truths) < 0.02
        for index in session.committed():
            row = session.trials[index]
            window_s = row["count"] / 1000
            drum = session.drum(int(index))
            inside = (drum.loadcell_s >= 0) & (drum.loadcell_s <= window_s)
            assert abs(inside.sum() - 80 * window_s) < 5
            assert len(drum.polls) > 9 * window_s
            polls = drum.polls[drum.polls_s >= 0]
            assert set(polls["force_set_g"]) == {row["force_g"]}
            assert set(polls["speed_set_mm_s"]) == {row["speed_mm_s"]}
            assert drum.loadcell["force_g"][inside].mean() == pytest.approx(500, rel=0.02)
            window = session.window(int(index))
            assert window.complete
            assert np.all(window.flags & 1)


def test_in_the_papers_world_the_loop_holds_the_reading_and_drag_moves_the_contact_force(
    tmp_path: Path,
) -> None:
    world = load_world(protocols() / "worlds" / "paper.toml")
    path = tmp_path / "forces.toml"
    path.write_text('textures = ["L"]\nspeeds_mm_s = [40, 120]\nforces_g = [500, 1000]\n')
    make(path, tmp_path / "set", world=world)
    with Session.open(tmp_path / "set") as session:
        for truth, index in zip(trial_truths(session), session.committed(), strict=True):
            row, drum = session.trials[index], session.drum(int(index))
            inside = (drum.loadcell_s >= 0) & (drum.loadcell_s <= row["count"] / 1000)
            set_g = float(row["force_g"])
            assert drum.loadcell["force_g"][inside].mean() == pytest.approx(set_g, rel=0.02)
            contact_g = set_g * (1.0 + truth.force_error)
            drag = {40.0: -0.2, 120.0: 0.6}[row["speed_mm_s"]] * world.parameters.loadcell_drag
            read_g = contact_g * (1.0 + drag * contact_g / 500.0)
            assert read_g == pytest.approx(set_g, rel=0.02)


def test_a_world_that_the_rig_does_not_allow_is_told_with_the_trial(tmp_path: Path) -> None:
    world, protocol = tmp_path / "world.toml", tmp_path / "forces.toml"
    world.write_text("loadcell_drag = 0.5\n")  # the cell reads more than the board's limit
    protocol.write_text('textures = ["L"]\nspeeds_mm_s = [120]\nforces_g = [1000]\n')
    told = "trial 1, plate L at 120 mm/s: .* stopped with OVER_FORCE: change .* the world"
    with pytest.raises(BoardFault, match=told):
        make(protocol, tmp_path / "set", world=load_world(world))
    assert verify(tmp_path / "set").problems == []


def test_a_seed_gives_the_same_samples_however_they_are_batched(
    session_folder: Path, protocol: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(step_runner, "QUEUE_SAMPLES", 0)
    monkeypatch.setattr(step_runner, "TRUTH_ROWS", 0)
    make(protocol, tmp_path / "again", stop_at=2, workers=2)
    make(protocol, tmp_path / "other", seed=SEED + 1, stop_at=1)
    with (
        Session.open(session_folder) as one,
        Session.open(tmp_path / "again") as two,
        Session.open(tmp_path / "other") as other,
    ):
        for index in range(2):
            assert np.array_equal(one.samples(index), two.samples(index))
        assert not np.array_equal(one.samples(0), other.samples(0))


@pytest.mark.parametrize("mode", ["lock", "position"])
def test_every_force_mode_is_recorded(tmp_path: Path, mode: str) -> None:
    path = tmp_path / "deep.toml"
    text = TEXT.replace("forces_g = [500]", "depths_mm = [0.5]") if mode == "position" else TEXT
    path.write_text(f"{text}\n[trial]\nforce_mode = '{mode}'\n")
    make(path, tmp_path / "session_folder", stop_at=1)
    with Session.open(tmp_path / "session_folder") as session:
        (index,) = session.committed()
        assert len(session.drum(int(index)).polls) > 9 * session.trials[index]["count"] / 1000


def test_a_resumed_data_set_equals_an_uninterrupted_one(
    session_folder: Path, protocol: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "torn"
    make(protocol, folder, stop_at=1)
    (folder / "world.h5").write_bytes(b"what a kill left")
    progress = make(protocol, folder, resume=True)
    assert progress[-1].committed == 4
    assert verify(folder).problems == []
    with Session.open(folder) as session:
        assert sorted(session.trials["trial_id"]) == [1, 2, 3, 4]
    assert_equal(tables(folder), tables(session_folder))
    before = sorted(folder.iterdir())
    assert make(protocol, folder, resume=True)[-1].committed == 4
    assert sorted(folder.iterdir()) == before
    with pytest.raises(SessionError):
        make(protocol, folder, seed=SEED + 1, resume=True)


@pytest.mark.parametrize("number", [1, 2])
def test_the_trials_of_a_damaged_part_are_made_again(
    session_folder: Path, protocol: Path, tmp_path: Path, number: int
) -> None:
    folder = Path(shutil.copytree(session_folder, tmp_path / "damaged"))
    part = folder / f"part-000{number}.h5"
    part.write_bytes(bytes(100))
    assert make(protocol, folder, resume=True)[-1].committed == 4
    with Session.open(folder) as again, Session.open(session_folder) as whole:
        assert [missing.name for missing in again.missing_parts] == [part.name]
        assert 3 in [part.number for part in again.parts]
        pairs = list(zip(again.committed().tolist(), whole.committed().tolist(), strict=True))
        assert [int(again.trials["trial_id"][i]) for i, _ in pairs] == [1, 2, 3, 4]
        for one, other in pairs:
            assert np.array_equal(again.samples(one), whole.samples(other))
    (problem,) = verify(folder).problems
    assert problem.startswith(f"{part.name} is damaged")


def test_several_sessions_have_their_own_gains(
    protocol: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = ["synth", "--plan", str(protocol), "--seed", str(SEED), "--out", str(tmp_path / "all")]
    assert main([*plan, "--repeats", "3", "--sessions", "2", "--workers", "2"]) == 0
    assert "12 of 12 trials committed" in capsys.readouterr().err
    one, two = tmp_path / "all" / "session-01", tmp_path / "all" / "session-02"
    assert [verify(folder).trials_committed for folder in (one, two)] == [8, 4]
    make(protocol, tmp_path / "alone", seed=1000 * SEED + 2)
    assert_equal(tables(two), tables(tmp_path / "alone"))
    assert main([*plan, "--repeats", "1", "--sessions", "2"]) == 2


def test_an_interrupted_data_set_is_a_valid_session(protocol: Path, tmp_path: Path) -> None:
    make(protocol, tmp_path / "part", stop_at=1)
    report = verify(tmp_path / "part")
    assert report.whole
    assert report.trials_committed == 1
    make(protocol, tmp_path / "none", stop_at=0)
    with Session.open(tmp_path / "none") as session:
        assert session.finished


def test_trials_match_those_of_the_virtual_rig(session_folder: Path, tmp_path: Path) -> None:
    """Tolerances are those of docs/reference/synth.md."""
    with open_harness(tmp_path, SEED) as harness:
        harness.record(TEXT.replace("repeats = 7", "repeats = 1"))
        real_folder = harness.session
    with Session.open(session_folder) as synth, Session.open(real_folder) as real:
        for one, other in zip(synth.committed(), real.committed(), strict=True):
            row = synth.trials[one]
            assert row["trial_id"] == real.trials[other]["trial_id"]
            a, b = synth.samples(int(one)), real.samples(int(other))
            assert a.shape == b.shape
            np.testing.assert_allclose(a.mean(axis=0), b.mean(axis=0), rtol=0.005)
            texture_hz = row["speed_mm_s"] / SPACES_MM[row["texture"]]
            bin_hz, depth = spectrum(a)
            other_depth = spectrum(b)[1]
            bins, other_bins = (
                np.argmax(d[1:, TOP_LAYER], axis=0) + 1 for d in (depth, other_depth)
            )
            assert np.array_equal(bins, other_bins)
            assert abs(np.median(bins) * bin_hz - texture_hz) <= bin_hz
            place = round(texture_hz / bin_hz)
            np.testing.assert_allclose(depth[place], other_depth[place], rtol=0.02, atol=0.1)


def spectrum(samples: NDArray[np.uint16]) -> tuple[float, NDArray[np.float64]]:
    """Return the width of a bin in Hz and the amplitude (bins, taxels) in counts."""
    level = samples - samples.mean(axis=0)
    return 1000 / len(samples), 2 * np.abs(np.fft.rfft(level, axis=0)) / len(samples)


def test_the_command_makes_a_session_and_reports_errors(
    protocol: Path, session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, out = ["synth", "--plan", str(protocol)], ["--out", str(tmp_path / "session")]
    assert main([*plan, "--repeats", "1", "--seed", "5", *out]) == 0
    assert "4 of 4 trials committed" in capsys.readouterr().err
    assert verify(tmp_path / "session").whole
    assert main([*plan, "--repeats", "0", "--seed", "5", "--out", str(tmp_path / "no")]) == 2
    assert "repeats" in capsys.readouterr().err
    copy = tmp_path / "taken"
    shutil.copytree(session_folder, copy)
    with pytest.raises(SessionError):
        make(protocol, copy)


@pytest.mark.parametrize("line", ['"repeats" = 7', "repeats = 7 # for a week", ""])
def test_repeats_in_any_notation_are_replaced(tmp_path: Path, line: str) -> None:
    path = tmp_path / "odd.toml"
    path.write_text(TEXT.replace("repeats = 7", line))
    protocol = load_plan(path, 2, 1).protocol
    assert protocol.repeats == tomllib.loads(protocol.text)["repeats"] == 2
