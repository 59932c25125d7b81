"""Every argument of every command refuses what is no file and no number, in one sentence.

``@`` is the argument under test. Commands that start an engine get a rig that does not exist, so
that nothing runs where a hostile argument passes.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from rigctl.cli import MODULES, create_parser, main
from rigctl.cli.arguments import number
from rigctl.errors import WrongUse

PATHS = """
check @
check quick --rig @
check quick --out @
info @
verify @
accept @
accept folder --out @
world @
orders @ --out new
orders folder --out @
encode @ --out new
encode folder --out @
encode folder --out new --cache @
encode folder --out new --ranges @
analyse @ --out new
analyse folder --out @
analyse folder --out new --c @
analyse folder --out new --save-model @
analyse @ --experiment realtime --out new
classify @ folder
classify model @
classify model folder --out @
import @ --map map.toml --out new
import A.csv --map @ --out new
import A.csv --map map.toml --out @
synth --plan @ --seed 1 --out new
synth --plan none --seed 1 --out @
synth --plan none --seed 1 --out new --world @
run @ --rig none
run quick --rig @
run quick --rig none --world @
run quick --rig none --out @
run --resume @
demo --out @
demo --world @
calibrate --rig @ tare
calibrate --rig none --world @ tare
calibrate --rig @ wiring
serve --world @
realtime train --rig @
realtime train --rig none --protocol @
realtime train --rig none --out @
realtime train --resume @
realtime train --rig none --world @
realtime calibrate --rig none --model @
realtime run --rig none --model @
realtime demo --rig none --protocol @
realtime demo --rig none --out @
realtime frame --rig @
realtime frame --rig none --out @
realtime board @ --out new.h
realtime board model --out @
realtime movie @ --out new.gif
realtime movie folder --out @
doctor --out @
doctor --write-udev-rule @
engine --rig @
engine --rig none --out @
engine --rig none --resume @
engine --rig none --protocol @
finger-engine --rig @
finger-engine --rig none --model @
""".strip().splitlines()
NUMBERS = """
check quick --seed
synth --plan none --out new --seed
synth --plan none --out new --seed 1 --repeats
synth --plan none --out new --seed 1 --sessions
synth --plan none --out new --seed 1 --workers
run quick --rig none --seed
demo --seed
calibrate --rig none --seed
calibrate --rig none loadcell --mass
calibrate --rig none force --force
encode folder --out new --workers
encode folder --out new --reference-force
encode folder --out new --trial
encode folder --out new --taxel
analyse folder --out new --workers
analyse folder --out new --seed
analyse folder --out new --iterations
analyse folder --out new --k-max
analyse folder --out new --trial
analyse folder --out new --taxel
analyse folder --out new --components
analyse folder --out new --reference-force
classify model folder --workers
serve --seed
serve --finger --udp
serve --finger --session
realtime train --rig none --seed
realtime train --rig none --session
realtime train --rig none --components
realtime run --rig none --model model --error-rate
realtime run --rig none --model model --coverage
realtime demo --rig none --seed
realtime movie folder --out new.gif --trial
engine --rig none --seed
engine --rig none --order-seed
finger-engine --rig none --seed
finger-engine --rig none --session
finger-engine --rig none --first-slide
finger-engine --rig none --order-seed
finger-engine --rig none --error-rate
finger-engine --rig none --coverage
""".strip().splitlines()
NO_PATHS = {
    "a pipe": "pipe",
    "a device": "/dev/zero",
    "a full disk": "/dev/full",
    "300 letters": "x" * 300,
    "too deep": "y/" * 3000,
    "a zero byte": "a\0b",
    "nothing": "",
}
NO_NUMBERS = ["-1", f"1{'0' * 400}", "9" * 5000, "nan", "inf", "1e999", "", "x", "0x10", "1;2"]
MAP = (
    "[files]\npattern = '(?P<texture>[A-Z])'\n[labels]\nspeed_mm_s = 40\n"
    "[taxels]\ncolumns = ['1']\n[time]\nrate_hz = 1000\n"
)


@pytest.fixture(autouse=True, scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Work in a folder with a pipe, an empty folder, a map and a table."""
    folder = tmp_path_factory.mktemp("workplace")
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "map.toml").write_text(MAP)
    (folder / "A.csv").write_text("1\n2\n3\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield
        left = {path.name for path in folder.iterdir()}
    assert left == {"pipe", "folder", "map.toml", "A.csv"}, "a refused command left something"


def refusal(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Return the one sentence with which the command refuses."""
    assert main(words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("rigctl: ")
    assert len(lines[0]) < 400
    assert lines[0].isprintable()
    return lines[0]


@pytest.mark.parametrize("line", PATHS)
def test_what_is_no_file_is_refused(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    for bad in NO_PATHS.values():
        words = [bad if word == "@" else word for word in line.split(" ")]
        refusal(words, capsys)


@pytest.mark.parametrize("line", NUMBERS)
def test_what_is_no_number_within_limits_is_refused(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    *words, option = line.split(" ")
    for bad in NO_NUMBERS:
        if (option, bad) != ("--mass", "-1"):  # refused later, with the masses that are possible
            assert f"{option} {bad[:30]}" in refusal([*words, f"{option}={bad}"], capsys)


def test_both_decimal_marks_are_understood_and_marks_between_groups_refused() -> None:
    parse = partial(number(-5000, 5000), "--mass")
    assert (parse("0,5"), parse("200.5"), parse("−3"), parse("1e3")) == (0.5, 200.5, -3.0, 1000.0)
    for wrong, reason in {"1,000": "may mean 1000 or 1", "1.000,5": "between groups"}.items():
        with pytest.raises(WrongUse, match=f"--mass {wrong} .*{reason}"):
            parse(wrong)


@pytest.mark.parametrize(
    "line",
    ["synth --plan none --out new --seed 1", "encode folder --out new", "classify model folder"],
)
def test_more_workers_than_cores_are_asked_for_twice(
    line: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    words = [*line.split(" "), "--workers"]
    assert "--workers 99999999999: give a whole number" in refusal([*words, "99999999999"], capsys)
    if "synth" in line:  # the others read their files first
        assert "this computer has 4 cores; add --more" in refusal([*words, "5"], capsys)
        sure = [*words, "5", "--more-workers-than-cores"]
        assert "there is no protocol none" in refusal(sure, capsys)
        assert "there is no protocol none" in refusal([*words, "4"], capsys)


def test_every_argument_of_every_command_has_a_declared_type() -> None:
    """A new option is checked, or it would read pipes and take 10⁴⁰⁰."""
    free = {
        "set", "preset", "dask", "name", "task", "also", "representation", "plate", "port", "stage",
        "creator", "license", "stream", "start_utc",
    }  # fmt: skip
    for command in set(MODULES) - {"gui"}:
        for action in _actions(create_parser([command])):
            takes_text = action.nargs != 0 and action.choices is None and action.type is None
            assert not takes_text or action.dest in free, f"{command} {action.dest}"
            assert action.type not in (int, float, Path), f"{command} {action.dest}"


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for part in action.choices.values():
                yield from _actions(part)
        else:
            yield action
