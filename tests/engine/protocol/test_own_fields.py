"""A lab's own fields are asked at the start of a session and kept in it."""

from __future__ import annotations

import io
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

import pynwb
import pytest

from rigctl.cli import main
from rigctl.cli.arguments import about_of, about_options, add_about, ask_own_fields
from rigctl.config.rig_config import About, parse_config
from rigctl.engine.rpc.commands import read_arguments
from rigctl.engine.run_request import RunRequest
from rigctl.errors import ConfigError, WrongUse
from rigctl.exchange.export.selection import Selection
from tests.engine.engine_harness import TINY, open_harness, open_session, until_ended
from tests.exchange.export.conftest import export

OWN = {"skin temperature": "31 °C", "cleaned with": "ethanol"}


def test_they_are_in_the_session_its_summary_and_its_exports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "protocol.toml").write_text(TINY)
    said = {"protocol": str(tmp_path / "protocol.toml"), "out": str(tmp_path / "session")}
    args = {**said, "yes": True, "operator": "Kim", "own": {**OWN, "left empty": " "}}
    with open_harness(tmp_path) as harness:
        harness.run(until_ended, read_arguments("command start", RunRequest, args))
    with open_session(tmp_path / "session") as session:
        assert session.header.own == OWN and session.header.operator == "Kim"
    assert main(["info", str(tmp_path / "session")]) == 0
    assert "skin temperature 31 °C, cleaned with ethanol" in capsys.readouterr().out
    export(tmp_path / "session", "nwb", tmp_path / "a.nwb", Selection())
    with pynwb.NWBHDF5IO(tmp_path / "a.nwb", "r") as file:
        nwb = file.read()
        assert tuple(nwb.experimenter) == ("Kim",)
        assert "skin temperature: 31 °C" in nwb.notes


def parsed(*words: str) -> Namespace:
    parser = ArgumentParser()
    add_about(parser)
    return parser.parse_args(words)


def test_options_say_them_and_a_terminal_is_asked_for_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    args = parsed("--operator=Kim", "--about", "skin temperature=31 °C")
    terminal = io.StringIO("ethanol\n")
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdin", terminal)
    ask_own_fields(args, OWN)
    assert about_of(args) == {"operator": "Kim", "own": OWN}
    assert about_of(parsed(*about_options(args))) == about_of(args), "the engine gets the same"
    ask_own_fields(args, ["asked when the terminal has ended"])
    assert about_of(args)["own"] == OWN


@pytest.mark.parametrize("words", ["temperature", "=31", "a\nb=1", "x" * 41 + "=1"])
def test_a_field_without_a_name_is_refused(words: str) -> None:
    with pytest.raises(WrongUse, match="names no field"):
        parsed("--about", words)


def test_the_rig_file_names_them() -> None:
    asked = parse_config('[about]\nask = ["skin temperature", "cleaned with"]\n').about
    assert asked == About(ask=("skin temperature", "cleaned with"))
    with pytest.raises(ConfigError, match=r"about\.ask"):
        parse_config('[about]\nask = ["a=b"]\n')
