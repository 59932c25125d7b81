"""Taxels of two orders are never mixed: in a set, with a model, with C, or with ranges."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.errors import SessionError
from rigctl.session.hdf5_file import write_attributes
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import DRAWN_WIRING
from tests.analysis.recordings import record
from tests.session.forging import rewrite_digests

Refused = Callable[..., str]


def rewired(session: Path, folder: Path, wiring: list[int]) -> Path:
    """Copy a recording as a bench of that wiring would have stored it."""
    shutil.copytree(session, folder)
    for part in folder.glob("part-*.h5"):
        with h5py.File(part, "r+") as file:
            write_attributes(file, {"wiring": json.dumps(wiring)})
    rewrite_digests(folder)
    return folder


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record an older session: it has no wiring, which was the order of the wire then."""
    folder = tmp_path_factory.mktemp("wiring") / "old"
    return record(folder, "AB", repeats=2, travel_mm=12.0, speeds=(40,))


@pytest.fixture(scope="module")
def drawn(old: Path) -> Path:
    return rewired(old, old.with_name("drawn"), list(DRAWN_WIRING))


@pytest.fixture(scope="module")
def trained(drawn: Path) -> dict[str, Path]:
    """Return a file of spikes with C, and a model, of the session that is wired as drawn."""
    folder = drawn.parent
    assert main(["encode", str(drawn), "--no-cache", "--out", str(folder / "spikes")]) == 0
    words = ["analyse", str(drawn), "--no-cache", "--iterations", "1", "--k-max", "2"]
    words += ["--task", "textures", "--out", str(folder / "report")]
    assert main([*words, "--save-model", str(folder / "m.h5"), "--components", "2"]) == 0
    return {"spikes": folder / "spikes" / "spikes.h5", "model": folder / "m.h5"}


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Refused:
    def run(command: str, *words: object) -> str:
        """Return the sentence of a command that failed before it wrote anything."""
        out = [] if command == "classify" else ["--out", str(tmp_path / "out"), "--no-cache"]
        capsys.readouterr()
        assert main([command, *map(str, words), *out]) == 2
        assert not list(tmp_path.glob("out*"))
        output = capsys.readouterr()
        assert output.out == ""
        return output.err.splitlines()[-1]

    return run


@pytest.mark.parametrize("command", ["analyse", "encode"])
def test_sessions_of_two_wirings_are_not_joined(
    command: str, old: Path, drawn: Path, refused: Refused
) -> None:
    sentence = refused(command, drawn, old)
    assert f"{old} has its taxels in another order than {drawn}" in sentence
    assert f"wiring = {list(range(18))}, not {list(DRAWN_WIRING)}" in sentence


def test_a_model_does_not_classify_another_wiring(
    trained: dict[str, Path], old: Path, drawn: Path, refused: Refused
) -> None:
    assert main(["classify", str(trained["model"]), str(drawn)]) == 0
    assert f"{old} has its taxels in another order" in refused("classify", trained["model"], old)


@pytest.mark.parametrize("kind", ["spikes", "model"])
def test_ranges_are_not_taken_from_another_wiring(
    kind: str, trained: dict[str, Path], old: Path, refused: Refused
) -> None:
    sentence = refused("encode", old, "--ranges", trained[kind])
    assert f"than the sessions of {trained[kind]}" in sentence


def test_c_is_not_taken_from_another_wiring(
    trained: dict[str, Path], old: Path, refused: Refused
) -> None:
    sentence = refused("analyse", old, "--c", trained["spikes"])
    assert f"than the sessions of {trained['spikes']}" in sentence


def test_sessions_of_one_wiring_are_joined(drawn: Path, tmp_path: Path) -> None:
    other = rewired(drawn, tmp_path / "other", list(DRAWN_WIRING))
    words = ["encode", str(drawn), str(other), "--no-cache", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    with h5py.File(tmp_path / "out" / "spikes.h5") as file:
        inputs = json.loads(file["inputs"][()])
    assert [source["wiring"] for source in inputs] == [list(DRAWN_WIRING)] * 2


ONE_LAYER = SensorLayout(3, 6, ("skin",))


def session(folder: Path, layout: SensorLayout | None) -> Path:
    return record(folder, "A", travel_mm=12.0, forces=(250,), speeds=(120,), layout=layout)


def test_sessions_of_two_layouts_are_not_joined(tmp_path: Path) -> None:
    older, one = session(tmp_path / "older", None), session(tmp_path / "one", ONE_LAYER)
    two = session(tmp_path / "two", SensorLayout.default(18))
    with pytest.raises(SessionError, match=f"{two} is of a sensor with another layout than {one}"):
        join_sessions([older, one, two])


def test_an_older_session_has_the_layout_of_the_others(tmp_path: Path) -> None:
    older, one = session(tmp_path / "older", None), session(tmp_path / "one", ONE_LAYER)
    assert join_sessions([older, one]).sensor_layout == ONE_LAYER
    assert join_sessions([older]).sensor_layout == SensorLayout.default(18)


def test_names_alone_do_not_keep_sessions_apart(tmp_path: Path) -> None:
    one = session(tmp_path / "one", ONE_LAYER)
    same = session(tmp_path / "same", SensorLayout(3, 6, ("I",)))
    assert len(join_sessions([one, same]).trials) == 2
