"""What cannot be exported is refused in a sentence; nothing is replaced, nothing half written."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pyarrow.csv
import pytest

from rigctl.cli import main
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.exchange.export.formats import EXPORTERS, choose_targets
from rigctl.exchange.export.selection import Selection, parse_numbers
from tests.exchange.export.conftest import INSTALLED, export
from tests.gui.full_disk import full_disk
from tests.session.test_crash import acknowledged, endless_writer

SUFFIXES = {name: exporter.suffix for name, exporter in EXPORTERS.items()}


def fingerprint(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("to", EXPORTERS)
def test_nothing_takes_the_place_of_what_is_there(
    to: str, drum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / f"mine{SUFFIXES[to]}"
    target.write_text("years of work")
    assert main(["export", str(drum), "--to", to, "--out", str(target)]) == 2
    assert capsys.readouterr().err.strip().endswith("name another with --out, or remove it")
    assert target.read_text() == "years of work" and names_in(tmp_path) == [target.name]


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_a_full_disk_leaves_nothing(to: str, drum: Path, tmp_path: Path) -> None:
    before = fingerprint(drum)
    with full_disk(8192), pytest.raises(DiskFault, match="cannot be written"):
        export(drum, to, tmp_path / f"full{SUFFIXES[to]}")
    assert names_in(tmp_path) == [] and fingerprint(drum) == before


@pytest.mark.parametrize("to", INSTALLED)
def test_what_may_not_fit_is_not_begun(
    to: str, drum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Mock(free=1_000_000))
    with pytest.raises(DiskFault, match=r"has 1 MB free, and .* may need [0-9]+ MB"):
        export(drum, to, tmp_path / f"large{SUFFIXES[to]}")
    assert names_in(tmp_path) == []


def test_a_place_that_cannot_be_written_is_named(drum: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DiskFault, match=r"file/here cannot be created \(Not a directory\)"):
        export(drum, "csv", tmp_path / "file" / "here")


def test_a_killed_export_leaves_no_target_and_is_named_by_the_next(
    drum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target, before = tmp_path / "killed", fingerprint(drum)
    words = [str(drum), "--to", "csv", "--out", str(target)]
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", "export", *words], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        next(line for line in process.stderr if line.startswith("reading samples"))
        process.send_signal(signal.SIGKILL)
    assert not target.exists() and fingerprint(drum) == before
    assert main(["export", *words]) == 2
    assert "was killed; then remove it" in capsys.readouterr().err
    shutil.rmtree(tmp_path / "killed.partial")
    assert main(["export", *words]) == 0


def test_an_interrupted_export_removes_what_it_wrote(drum: Path, tmp_path: Path) -> None:
    target = tmp_path / "interrupted.nwb"
    words = ["export", str(drum), "--to", "nwb", "--out", str(target)]
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", *words], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        next(line for line in process.stderr if line.startswith("encoding trials"))
        process.send_signal(signal.SIGTERM)
        said = process.stderr.read()
    assert process.returncode == 130 and "was not made" in said
    assert names_in(tmp_path) == []


def test_a_session_that_grows_is_exported_as_far_as_it_is(tmp_path: Path) -> None:
    with endless_writer(tmp_path / "s") as writer:
        acknowledged(writer, 10)
        exported = export(tmp_path / "s", "csv", tmp_path / "tables")
        writer.kill()
    assert any("still being recorded" in remark for remark in exported.remarks)
    assert pyarrow.csv.read_csv(exported.target / "trials.csv").num_rows > 0


def test_blanks_umlauts_and_a_german_locale_change_nothing(drum: Path, tmp_path: Path) -> None:
    session = Path(shutil.copytree(drum, tmp_path / "Prüf stand" / "Sitzung Ä 1"))
    environment = os.environ | {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"}
    for to in INSTALLED:
        command = [sys.executable, "-m", "rigctl", "export", str(session), "--to", to]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        end = SUFFIXES[to] or f"-{to}"
        assert (session.parent / f"Sitzung Ä 1{end}").exists()
    trials = pyarrow.csv.read_csv(session.parent / "Sitzung Ä 1-csv" / "trials.csv")
    assert trials["speed_mm_s"].to_pylist()[0] in (40.0, 120.0)


def test_a_missing_package_is_named_with_its_cure(
    drum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pynwb", None)
    with pytest.raises(WrongUse, match=r"NWB 2 needs the package pynwb: pip install .*\[export\]"):
        export(drum, "nwb", tmp_path / "x.nwb")
    assert names_in(tmp_path) == []


@pytest.mark.parametrize(
    ("target", "said"),
    [("x.h5", "call it x.h5.nwb"), ("s/inside.nwb", "a recording keeps to itself")],
)
def test_a_target_of_another_kind_is_refused(
    target: str, said: str, drum: Path, tmp_path: Path
) -> None:
    session = Path(shutil.copytree(drum, tmp_path / "s"))
    with pytest.raises(WrongUse, match=said):
        choose_targets([session], "nwb", tmp_path / target)


def test_two_sessions_of_one_name_are_refused(drum: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(drum, tmp_path / drum.name))
    with pytest.raises(WrongUse, match=f"two sessions are called {drum.name}: export them one"):
        choose_targets([drum, other], "csv", tmp_path / "out")
    with pytest.raises(WrongUse, match="is named twice"):
        choose_targets([drum, drum], "csv", tmp_path / "out")
    with pytest.raises(SessionError, match="is not a session"):
        choose_targets([tmp_path], "csv", None)


def test_what_a_session_does_not_have_is_named(drum: Path, tmp_path: Path) -> None:
    for selection, said in (
        (Selection(trials=frozenset({99})), "has no trial 99"),
        (Selection(taxels=frozenset({19})), "there is no taxel 19"),
    ):
        with pytest.raises(WrongUse, match=said):
            export(drum, "csv", tmp_path / "none", selection)
    for text in ("0", "3-1", "x", "1-", "", "٣", "1-9999999"):
        with pytest.raises(WrongUse, match="--trials"):
            parse_numbers("--trials", text)
    assert parse_numbers("--trials", "1-3, 7") == {1, 2, 3, 7}
