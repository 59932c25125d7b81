"""A rig that ``finger.toml`` describes, through real ports: frame, experiment and refusals."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.errors import LinkLost, RigctlError, WrongBoard
from rigctl.finger.cli import plate_frame
from rigctl.finger.model_file import load_finger_model
from rigctl.finger.open_rig import open_finger_rig
from rigctl.finger.session import FingerSession
from rigctl.finger.trackers.plate_frame import PlateFrame
from rigctl.session.verify import verify
from tests.finger.firmware_server import serve_finger_identity, serve_taxel_board
from tests.finger.served import DEADLINE_S, ServedFinger, serve_finger

# The limits let a busy machine be late; the run's own tests have the protocol's limits.
PROTOCOL = """
name = "two-plates"
textures = ["D", "L"]
profiles = ["fast"]

[stages]
normalise = 1
train = 2
calibrate = 0
run = 0

[quality]
max_held_velocities = 1000
max_lost_samples = 1000
max_tracker_gap_ms = 10000
attempts = 100
"""
FRAME = PlateFrame().to_toml()


@pytest.fixture(scope="module")
def served() -> Iterator[ServedFinger]:
    if os.name != "posix":
        pytest.skip("the server offers pseudo-terminals, which are of POSIX")
    with serve_finger() as opened:
        yield opened


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder of its own, where engines are announced, too."""
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path / "runtime"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def touch(served: ServedFinger, answers: dict[str, str]) -> Callable[[str], str]:
    """Return a terminal at which a person touches the corner that is asked for, or another."""

    def answer(question: str) -> str:
        match = re.match(r"Touch the corner (.+) of the plate", question)
        assert match is not None
        corner = answers.get(match[1], match[1])
        assert served.tell(f"touch {corner}") == f"touching {corner}"
        return ""

    return answer


def test_touched_corners_and_an_experiment_through_real_ports(
    served: ServedFinger, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plate_frame, "TOUCH_S", 0.2)
    rig = served.write_rig(place, f"serial:{served.terminal}?latency_ms=22")
    monkeypatch.setattr("builtins.input", touch(served, {}))
    assert main(["realtime", "frame", "--rig", str(rig)]) == 0
    frame = PlateFrame.from_toml((place / "plate-frame.toml").read_text())
    assert 0.0 < frame.residual_mm < 2.0

    served.write_rig(place, f"udp:{served.udp_port}?latency_ms=22")
    (place / "two.toml").write_text(PROTOCOL)
    words = ["train", "--rig", "finger.toml", "--protocol", "two.toml", "--out", "session"]
    errors = slide_as_asked(served, [*words, "--components", "2"])
    assert "every scan is committed" not in errors, "only what a person needs is told"
    with FingerSession.open(place / "session") as session:
        assert not session.header.simulated
        assert session.header.rig == "bench"
        assert session.header.tracker["name"] == f"tracker udp:{served.udp_port}"
        assert len(session.committed()) == 6
        assert set(session.trials["texture"][session.committed()]) == {"D", "L"}
    assert not verify(place / "session").problems
    assert load_finger_model(place / "session" / "model-speed-scaled.h5").textures == ("D", "L")


def slide_as_asked(served: ServedFinger, words: list[str]) -> str:
    """Run a part as a person who lays plates and slides; return what was told at the terminal."""
    told = ""
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", "realtime", *words],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None and process.stderr is not None
        for line in process.stderr:
            told += line
            if "then confirm" in line:
                process.stdin.write("\n")
                process.stdin.flush()
            elif match := re.match(r"plate (\w), ([\w-]+): slide over the plate", line):
                assert served.tell(f"slide {match[1]} {match[2]}").startswith("sliding")
        assert process.wait(DEADLINE_S) == 0, told
    return told


def test_a_wrongly_touched_corner_is_named_and_nothing_is_written(
    served: ServedFinger,
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(plate_frame, "TOUCH_S", 0.1)
    rig = served.write_rig(place, f"serial:tcp://{served.tracker}")
    monkeypatch.setattr("builtins.input", touch(served, {"end left": "start left"}))
    assert main(["realtime", "frame", "--rig", str(rig)]) == 3
    assert "'end left' does not fit the others" in capsys.readouterr().err
    assert not (place / "plate-frame.toml").exists()


def test_a_lost_tracker_names_the_corner_that_it_did_not_see(
    served: ServedFinger,
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def hide(question: str) -> str:
        served.tell("lose 5")
        return ""

    monkeypatch.setattr(plate_frame, "TOUCH_S", 0.1)
    monkeypatch.setattr("builtins.input", hide)
    rig = served.write_rig(place, f"serial:tcp://{served.tracker}")
    assert main(["realtime", "frame", "--rig", str(rig)]) == 3
    assert "no position at the corner start left: bring it into view" in capsys.readouterr().err


def test_corners_cannot_be_touched_without_a_terminal(
    served: ServedFinger,
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def end(question: str) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", end)
    rig = served.write_rig(place, f"serial:tcp://{served.tracker}")
    assert main(["realtime", "frame", "--rig", str(rig)]) == 2
    assert "press Enter at each corner" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[tracker]\nsource = "udp:5040"', "tracker.frame is missing: touch the plate's corners"),
        (
            '[tracker]\nsource = "udp:5040"\nframe = "other.toml"',
            "the plate's frame: cannot read other.toml",
        ),
        (
            '[finger]\nport = "tcp://127.0.0.1:9"\n[tracker]\nsource = "sonar:1"\nframe = "f.toml"',
            "finger.toml: tracker.source: 'sonar:1' names no tracker: write serial:PORT",
        ),
        (
            '[finger]\nport = "tcp://127.0.0.1:9"\n[tracker]\nframe = "f.toml"',
            "finger.toml: tracker.source: '' names no tracker",
        ),
        (
            "[finger]\nprot = 1",
            "finger.toml, line 2: finger.prot: unknown key",
        ),
    ],
    ids=["no frame", "no frame file", "unknown tracker", "no tracker", "typo"],
)
def test_a_finger_toml_that_cannot_be_used_is_refused(
    place: Path, text: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / "finger.toml").write_text(text)
    (place / "f.toml").write_text(FRAME)
    assert main(["finger-engine", "--rig", "finger.toml"]) == 2
    assert_one_sentence(capsys.readouterr().err, sentence)


@pytest.mark.parametrize(
    ("frame", "code", "sentence"),
    [
        ("", 2, "finger.toml: tracker.frame is missing"),
        ("f.toml", 3, "tcp://127.0.0.1:9: no server listens there: start rigctl serve"),
    ],
)
def test_the_command_says_why_the_engine_did_not_start(
    place: Path, frame: str, code: int, sentence: str
) -> None:
    (place / "f.toml").write_text(FRAME)
    (place / "finger.toml").write_text(
        f'[finger]\nport = "tcp://127.0.0.1:9"\n[tracker]\nsource = "udp:5040"\nframe = "{frame}"'
    )
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "realtime", "train", "--rig", "finger.toml"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert_one_sentence(done.stderr, sentence)
    assert done.returncode == code
    assert not (place / "sessions").exists()


def assert_one_sentence(errors: str, sentence: str) -> None:
    assert sentence in errors
    assert errors.startswith("rigctl: ") and errors.count("\n") == 1


def refusal(place: Path, port: str) -> RigctlError:
    """Return the error of connecting the rig whose finger board is on this port."""
    (place / "f.toml").write_text(FRAME)
    rig_file = place / "finger.toml"
    rig_file.write_text(
        f'[finger]\nport = "{port}"\n[tracker]\nsource = "udp:5040"\nframe = "f.toml"'
    )
    with pytest.raises(RigctlError) as raised:
        rig = open_finger_rig(str(rig_file))
        try:
            rig.loop.run_until_complete(rig.finger.connect())
        finally:
            rig.close()
    return raised.value


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give boards two seconds to answer."""
    monkeypatch.setattr("rigctl.finger.driver.CONNECT_TIMEOUT_S", 2.0)
    monkeypatch.setattr("rigctl.boards.taxels.CONNECT_TIMEOUT_S", 2.0)
    monkeypatch.setattr("rigctl.boards.boot_silence.AFTER_OPEN_S", 0.3)
    monkeypatch.setattr("rigctl.boards.boot_silence.ASK_S", 2.0)


@pytest.mark.usefixtures("impatient")
def test_a_taxel_board_on_the_port_is_named(place: Path) -> None:
    with serve_taxel_board() as port:
        error = refusal(place, port)
    assert isinstance(error, WrongBoard)
    assert "the taxel board answers there, not the finger board: correct [finger] port" in str(
        error
    )


@pytest.mark.usefixtures("impatient")
def test_firmware_of_another_wire_version_is_refused(place: Path) -> None:
    with serve_finger_identity(wire_version=9) as port:
        error = refusal(place, port)
    assert isinstance(error, WrongBoard)
    assert "speaks wire version 9" in str(error)
    assert "rigctl flash finger" in str(error)


def test_without_any_port_the_board_is_asked_for(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.boards.port_discovery.list_ports.comports", list)
    error = refusal(place, "")
    assert isinstance(error, LinkLost)
    assert "no port answered as the finger board: plug it in; rigctl ports" in str(error)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--udp", "5040"], "belong to the moving finger: add --finger"),
        (["--finger", "--rig", "firmware"], "slower than real time: use --rig virtual"),
        (["--finger", "--plate", "A"], "leave --plate out"),
        (["--finger", "--udp", "0"], "--udp 0: give a whole number from 1 to 65,535"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", *words]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("hello", "error: 'hello' is no command: write slide PLATE PROFILE"),
        ("slide Z fast", "error: no plate 'Z'"),
        ("slide D hasty", "error: there is no profile 'hasty'"),
        ("touch middle", "error: there is no corner 'middle'"),
        ("lose soon", "error: 'soon' is no time"),
    ],
)
def test_the_person_says_what_is_wrong_with_a_command(
    served: ServedFinger, command: str, answer: str
) -> None:
    assert served.tell(command).startswith(answer)
