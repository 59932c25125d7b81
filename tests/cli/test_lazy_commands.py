"""The command line loads one command, the one that is called; the help loads none."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

from rigctl.cli import HIDDEN, MODULES, create_parser, main

LISTING = """
import sys
from importlib.util import resolve_name
from rigctl.cli import MODULES, PACKAGE, main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
loaded = {m.removeprefix(".") for m in MODULES.values() if resolve_name(m, PACKAGE) in sys.modules}
print("loaded:", *sorted(loaded))
print("numpy:", "numpy" in sys.modules)
"""


def loaded_by(*words: str) -> list[str]:
    command = [sys.executable, "-c", LISTING, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-2:]


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["no-such-command"], []])
def test_the_help_and_a_mistake_load_no_command(words: list[str]) -> None:
    assert loaded_by(*words) == ["loaded:", "numpy: False"]


def test_a_command_loads_no_other() -> None:
    assert loaded_by("stop", "--help")[0] == "loaded: stop"
    assert loaded_by("--odd", "stop", "x", "y")[0] == "loaded: stop"


def test_the_help_lists_each_command_with_its_first_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = " ".join(capsys.readouterr().out.split())
    for command in MODULES.keys() - set(HIDDEN):
        doc = import_module(MODULES[command], "rigctl.cli").__doc__ or ""
        summary = doc.partition("\n\n")[0].rstrip(".")
        assert f"{command} {summary[0].lower()}{summary[1:]}" in shown
    assert not any(f" {command} " in shown for command in HIDDEN)


def test_a_commands_help_is_complete(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["import", "--help"])
    shown = capsys.readouterr().out
    assert "--guess" in shown and "usage: rigctl import [-h]" in shown
    with pytest.raises(SystemExit):
        main(["realtime", "run", "--help"])
    assert "usage: rigctl realtime run" in capsys.readouterr().out


def test_a_word_that_is_no_command_is_answered_with_the_nearest(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["anlyse", "x"]) == 2
    assert capsys.readouterr().err == (
        "rigctl: there is no command anlyse: did you mean analyse? "
        "`rigctl --help` lists all commands\n"
    )
    assert main(["engin"]) == 2
    assert "engine" not in capsys.readouterr().err.replace("engin:", "")


@pytest.mark.parametrize("command", sorted(MODULES.keys() - set(HIDDEN)))
def test_the_help_of_every_command_says_what_it_does(command: str) -> None:
    doc = import_module(MODULES[command], "rigctl.cli").__doc__ or ""
    assert len(doc.partition("\n\n")[2].strip()) > 40


def test_options_may_stand_before_the_text_of_a_note() -> None:
    """``rigctl note DIR --trial 3 --bad TEXT`` once had an unrecognized argument: the text."""
    parser = create_parser(["note"], loaded=False)
    for words in (["--trial", "3", "--bad", "d", "t"], ["d", "--trial", "3", "--bad", "t"]):
        args = parser.parse_args(["note", *words])
        assert (str(args.session), args.text, args.trial, args.bad) == ("d", "t", 3, True)
    assert parser.parse_args(["note", "d"]).text is None
    with pytest.raises(SystemExit):
        parser.parse_args(["note"])
