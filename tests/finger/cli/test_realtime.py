"""``rigctl realtime`` from the first scan to the report, and its refusals."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.finger.model_file import load_finger_model
from tests.finger.harness import SMALL, open_finger_session


@pytest.fixture(autouse=True)
def no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())


@pytest.fixture
def protocol(tmp_path: Path) -> str:
    path = tmp_path / "small.toml"
    path.write_text(
        SMALL.replace("train = 3", "train = 2").replace("calibrate = 2", "calibrate = 1")
    )
    return str(path)


def _realtime(*words: object) -> int:
    return main(["realtime", *map(str, words)])


def test_the_experiment_from_the_command_line(
    tmp_path: Path, protocol: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "experiment"
    assert _realtime("demo", "--protocol", protocol, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "named correctly: " in printed
    assert "sets of textures: " in printed
    assert "from a velocity to features: 1.0 ms" in printed
    assert load_finger_model(out / "calibrate" / "model-original.h5").calibration is not None
    folders = [str(out / part) for part in ("train", "calibrate", "run")]
    for folder in folders:
        assert main(["verify", folder]) == 0
    report = tmp_path / "report"
    words = ["analyse", "--experiment", "realtime", *folders, "--out", str(report)]
    assert main([*words, "--iterations", "2"]) == 0
    assert json.loads((report / "results.json").read_text("utf-8"))["simulated"] is True
    assert _realtime("train", "--resume", out / "train") == 0, "a complete session trains anew"
    words = ["--model", str(out / "calibrate"), "--representation", "original", "--yes"]
    original = tmp_path / "original"
    assert _realtime("run", *words, "--protocol", protocol, "--out", original) == 0
    with open_finger_session(original) as session:
        assert all(session.trials["predicted"][i] for i in session.committed())
        (model,) = session.events_of("model")
    assert model.data["representation"] == "Original"
    capsys.readouterr()
    file = str(out / "calibrate" / "model-speed-scaled.h5")
    for words, message in (
        (["run", "--model", file, "--representation", "original"], "is a model of Speed Scaled"),
        (["train", "--resume", out / "calibrate"], "has the stages calibrate"),
        (["train", "--resume", out / "train", "--out", "other"], "--out is that of the session"),
    ):
        assert _realtime(*words) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("train", "--protocol", "nothing"), "there is no protocol nothing"),
        (("train", "--rig", "nothing"), "there is no rig nothing"),
        (("train", "--components", "0"), "--components 0: give a whole number from 1"),
        (("run", "--model", "nothing"), "there is no model nothing"),
        (("demo", "--out", "."), "exists already"),
    ],
)
def test_a_mistake_is_one_sentence(
    words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _realtime(*words) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert "Traceback" not in errors
