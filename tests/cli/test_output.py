"""Any terminal, pipe and disk can take a command's output, and no text acts on the terminal."""

from __future__ import annotations

import io
import json
import os
import pty
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import TextIO, cast

import pytest

from rigctl.cli import OUTPUT_CLOSED, main
from rigctl.cli.output import VisibleOutput
from rigctl.cli.progress import PACE_S, Pace, ProgressLine

RIGCTL = f"{sys.executable} -m rigctl"


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a shell; ``$R`` is rigctl."""
    return subprocess.run(
        ["bash", "-c", line],
        env={**os.environ, "R": RIGCTL, **environment},
        capture_output=True,
        encoding="utf-8",
        errors="surrogateescape",
        check=False,
    )


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2Jx\x07", "\\x1b[2Jx\\x07"),
        ("a\rb\x00", "a\\x0db\\x00"),
        ("\x9b31m\x7f", "\\u009b31m\\u007f"),
        ("\u202egnp.exe\u2066", "\\u202egnp.exe\\u2066"),
        ("\udcff", "\\udcff"),
        ("tab\tand µ – 絹\n", "tab\tand µ – 絹\n"),
    ],
)
def test_what_acts_on_a_terminal_becomes_visible(text: str, shown: str) -> None:
    target = io.StringIO()
    print(text, end="", file=VisibleOutput(target))
    assert target.getvalue() == shown


def test_the_name_of_a_protocol_does_not_act_on_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "evil.toml"
    file.write_text(
        'description = "\\u001b]0;owned\\u0007\\u202e"\n[[steps]]\nat="end"\nkind="tare"\n'
    )
    assert main(["check", str(file)]) == 0
    out = capsys.readouterr().out
    assert "\\x1b]0;owned\\x07\\u202e" in out
    assert main(["check", str(file), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["description"] == "\x1b]0;owned\x07\u202e"
    assert main(["check", "a\x1b[2Jb"]) == 2
    assert "there is no protocol a\\x1b[2Jb" in capsys.readouterr().err


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_unicode_shows_escapes(encoding: str) -> None:
    done = shell("$R check paper && $R check paper --json", PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, "")
    assert "paper \\u2013 The paper's data set" in done.stdout
    assert json.loads(done.stdout.splitlines()[-1])["trials"] == 24_000


def test_the_c_locale_is_enough() -> None:
    done = shell("$R check no–such", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert done.returncode == 2
    assert "there is no protocol no" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("words", ["check paper", "--help", "world --help", "--version"])
def test_a_full_disk_is_named(words: str) -> None:
    done = shell(f"$R {words} > /dev/full")
    assert done.returncode == 3
    assert done.stderr == "rigctl: the output cannot be written (No space left on device)\n"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("$R check paper >&- 2>&- <&-", 0),
        ("$R check nosuch 2>/dev/full", 2),
        ("$R nosuch 2>/dev/full", 2),
        ("$R check nosuch >&-", 2),
        ("set -o pipefail; $R check paper | (exec <&-; sleep 0)", OUTPUT_CLOSED),
    ],
)
def test_without_a_reader_the_command_still_answers(line: str, code: int) -> None:
    done = shell(line)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


def test_a_real_terminal_gets_no_escape_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "evil.toml"
    file.write_text('description = "\\u001b[2J\\u009b5n"\n[[steps]]\nat="end"\nkind="tare"\n')
    shown = at_terminal("check", str(file))
    assert b"\\x1b[2J\\u009b5n" in shown
    assert b"\x1b" not in shown


def test_a_command_that_compiles_shows_no_escape_at_its_end() -> None:
    """The compiler's colours, where colorama is there, ended each command with ``\\x1b[0m``."""
    shown = at_terminal("setup", "--rig", "virtual", "--part", "ports", "--yes")
    assert shown.rstrip().endswith(b"right") and b"x1b" not in shown


def at_terminal(*words: str) -> bytes:
    """Return what a command that succeeds shows at a terminal."""
    reader, terminal = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", *words], stdout=terminal, stderr=terminal
    ) as process:
        os.close(terminal)
        shown = b"".join(iter(partial(_read_terminal, reader), b""))
        os.close(reader)
    assert process.returncode == 0
    return shown


def _read_terminal(reader: int) -> bytes:
    """Return what the terminal got, nothing at its end, which Linux reports as an error."""
    try:
        return os.read(reader, 65_536)
    except OSError:
        return b""


@pytest.mark.parametrize("command", [["check", "paper"], ["world"]])
def test_a_closed_pipe_ends_the_command_without_a_traceback(command: list[str]) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "rigctl", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    with process.stderr:
        assert process.stderr.read() == b""
    assert process.wait() == OUTPUT_CLOSED


def test_a_slow_begin_does_not_count() -> None:
    pace = Pace()
    assert pace.add(8.0, 1.0) == 0.0, "eight seconds until the first trial say nothing"
    assert pace.add(8.5, 101.0) == pytest.approx(200.0)


def test_the_pace_is_that_of_the_last_half_minute() -> None:
    pace = Pace()
    for second in range(100):
        pace.add(float(second), 10.0 * second)
    for second in range(100, 100 + round(PACE_S) + 1):
        found = pace.add(float(second), 990.0 + 2.0 * (second - 99))
    assert found == pytest.approx(2.0)


def test_nothing_done_is_no_pace() -> None:
    pace = Pace()
    assert [pace.add(1.0, 5.0), pace.add(1.0, 5.0), pace.add(2.0, 5.0)] == [0.0, 0.0, 0.0]


class Terminal(io.StringIO):
    """A terminal of 20 columns."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


def test_a_line_of_progress_is_drawn_over_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its return to the beginning was shown as text, and a long line could not be drawn over."""
    monkeypatch.setenv("COLUMNS", "20")
    terminal = Terminal()
    line = ProgressLine(cast(TextIO, VisibleOutput(terminal)))
    line.show("twenty-five letters, more")
    line.say("said")
    assert terminal.getvalue() == "\rtwenty-five letters\rsaid" + " " * 15 + "\n"
