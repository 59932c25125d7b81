"""The page on reading a session: its Python and its h5dump read a recorded one."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from rigctl.session.session import Session

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "read-a-session.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(autouse=True)
def place(drum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my-session").symlink_to(drum)
    monkeypatch.chdir(tmp_path)


def test_python_reads_the_same_with_and_without_rigctl(
    drum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for block in blocks("python"):
        exec(block, {})
    said = capsys.readouterr().out
    with Session.open(drum) as session:
        of_part = [i for i in session.committed() if session.trials["part"][i] == 1]
        means = [
            f"{session.trials['texture'][i]} {session.samples(i).mean(axis=0)}" for i in of_part
        ]
    assert means and said == "".join(f"{line}\n" for line in means)


def test_h5dump_shows_names_columns_rows_and_samples() -> None:
    (block,) = blocks("sh")
    shown = [
        subprocess.run(line, shell=True, check=True, capture_output=True, text=True).stdout
        for line in block.splitlines()
    ]
    assert "/taxels/samples" in shown[0] and "2026-" in shown[1]
    assert '"first_sample"' in shown[2] and re.search(r'"[AB]\\000', shown[3])
    assert "(104,0)" in shown[4]
