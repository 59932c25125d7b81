"""``rigctl realtime movie``: its file, its last line, and its errors in one sentence each."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from rigctl.cli import main


def test_a_still_of_the_last_scan(
    finger: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "scan.png"
    assert main(["realtime", "movie", str(finger), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{out}: 0.") and said.out.endswith(" MB\n")
    assert "drawing frames" in said.err
    with Image.open(out) as image:
        assert image.size == (1120, 650)


def test_wrong_use_is_one_sentence(
    finger: Path, drum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / "there.gif"
    there.touch()
    new = tmp_path / "new.gif"
    for words, said in (
        ([finger, "--trial", "77", "--out", new], "has no trial 77"),
        ([finger, "--out", there], "already exists"),
        ([finger, "--out", tmp_path / "scan.webp"], "none of .gif, .mp4, .png"),
        ([drum, "--out", new], "is a session of the drum, not of the moving finger"),
        ([tmp_path, "--out", new], "is not a session"),
    ):
        assert main(["realtime", "movie", *map(str, words)]) == 2
        error = capsys.readouterr().err
        assert said in error and error.startswith("rigctl: ") and error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there.gif"]
