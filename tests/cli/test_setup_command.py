"""``rigctl setup`` at a terminal: through a simulated rig, left at a wrong part, in JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.host_build import image_hash

YES = ("setup", "--rig", "virtual", "--yes")


def answer_with(monkeypatch: pytest.MonkeyPatch, answers: Iterator[str]) -> list[str]:
    """Answer the questions of a terminal; return the list that takes what was asked."""
    asked: list[str] = []

    def answer(text: str) -> str:
        asked.append(text)
        return next(answers)

    monkeypatch.setattr("builtins.input", answer)
    return asked


def test_a_simulated_rig_is_set_up_to_its_first_trial(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(YES) == 0
    printed = capsys.readouterr().out
    assert "17/17 First trial" in printed and "expected: 1 window at the taxel board" in printed
    assert printed.endswith(
        "the rig is set up: run a protocol, or protocols/acceptance.toml for rigctl accept\n"
    )


def test_a_wrong_wiring_is_one_sentence_and_the_next_command(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main((*YES, "--wire", "end switches swapped")) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "  WRONG: the two end switches are swapped: swap their wires" in lines
    assert lines[-1] == (
        "left at End switches: a simulated rig is not remembered, so the next setup begins anew"
    )


def test_boards_at_exchanged_ports_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main((*YES, "--wire", "boards swapped")) == 1
    assert "WRONG: the two boards are exchanged" in capsys.readouterr().out


def test_json_says_what_each_part_found(capsys: pytest.CaptureFixture[str]) -> None:
    assert main((*YES, "--json", "--wire", "cell reversed")) == 1
    result = json.loads(capsys.readouterr().out)
    parts = {step["part"]: step for step in result["steps"]}
    assert result["next"] == "finger" and parts["cell"]["passed"]
    assert parts["finger"]["causes"] == ["cell reversed"]


def test_one_command_commissions_and_says_what_it_skips(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main((*YES, "--commission")) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2] == "the board is commissioned"
    assert lines[-1].startswith(
        "nobody has checked: Boards and ports, Firmware, Drum and microsteps, "
    )


def test_a_person_answers_mends_keeps_and_leaves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = answer_with(monkeypatch, iter(["", "ok", "", "what", "again", "", "", "", "keep"]))
    words = ("setup", "--rig", "virtual", "--part", "ends", "--wire", "end switches normally open")
    monkeypatch.setattr("rigctl.cli.setup.open_rig", _as_fast_as_possible())
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert (
        "answer again, keep or leave" in printed
        and "rig.toml says [inverted] end_switches" in printed
    )
    assert sum("Hold the upper end switch" in text for text in asked) == 2


@pytest.mark.parametrize("way", ["leave", "Ctrl-C", "Ctrl-D"])
def test_whoever_leaves_at_a_question_hears_where(
    way: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def answer(_: str) -> str:
        if way == "Ctrl-C":
            raise KeyboardInterrupt
        if way == "Ctrl-D":
            raise EOFError
        return way

    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("rigctl.cli.setup.open_rig", _as_fast_as_possible())
    assert main(("setup", "--rig", "virtual")) == 130
    assert "left at Drum and microsteps: a simulated rig" in capsys.readouterr().out


def test_where_nobody_can_answer_the_command_says_it_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def answer(_: str) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("rigctl.cli.setup.open_rig", _as_fast_as_possible())
    assert main(("setup", "--rig", "virtual")) == 2
    printed = capsys.readouterr()
    assert "WRONG" not in printed.out
    assert printed.err.count("there is no terminal to answer at") == 1


def test_a_part_that_moves_too_early_is_refused_with_the_way_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main((*YES, "--part", "actuator")) == 2
    assert capsys.readouterr().err == (
        "rigctl: Actuator and potentiometer moves the drum: first check Boards and ports; "
        "without --part, the setup goes on there\n"
    )


def _as_fast_as_possible() -> Callable[..., object]:
    from rigctl.rig import open_rig

    return lambda *args, **named: open_rig(*args, **{**named, "paced": False})


def test_boards_with_another_build_are_flashed_and_the_setup_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flashed: list[tuple[str, str]] = []

    async def flash(board: str, port: str) -> None:
        flashed.append((board, port))
        monkeypatch.setattr("rigctl.engine.setup.boards.image_hash", image_hash)

    monkeypatch.setattr("rigctl.engine.setup.boards.image_hash", lambda board: "0badc0de")
    monkeypatch.setattr("rigctl.cli.setup._flash", flash)
    monkeypatch.setattr("rigctl.cli.setup.open_rig", _as_fast_as_possible())
    asked = answer_with(monkeypatch, iter(["flash"]))
    assert main(("setup", "--rig", "virtual", "--part", "firmware")) == 0
    assert flashed == [("drum", "drum"), ("taxels", "taxels")] and len(asked) == 1
    assert "runs another build than this installation brings" in capsys.readouterr().out


def test_a_rig_toml_with_every_key_is_written_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def no_ports(_: object) -> list[object]:
        return []

    monkeypatch.setattr("rigctl.cli.setup.probe_ports", no_ports)
    path = tmp_path / "rig.toml"
    assert main(("setup", "--rig", str(path))) == 1
    printed = capsys.readouterr().out
    assert printed.startswith(f"{path} is new: it has every key and its meaning\n")
    assert "there is no serial port: plug both boards in" in printed
    assert load_config(path) == RigConfig()
    assert path.read_text().startswith("# Written by rigctl setup")
    assert main(("setup", "--rig", str(path), "--json")) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["next"] == "ports" and "plug both boards in" in result["steps"][0]["problem"]


def test_at_a_bench_somebody_must_answer(capsys: pytest.CaptureFixture[str]) -> None:
    assert main((*YES[:3], "--wire", "no such wiring")) == 2
    assert "there is no wiring" in capsys.readouterr().err
