"""A bundle proves what it holds, and its figures are made again from it alone."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.exchange.bundle import verify_bundle
from tests.analysis.recordings import record
from tests.session.building import record_by_hand
from tests.session.conftest import drum

__all__ = ["drum"]

FAST = ["--iterations", "1", "--k-max", "3", "--no-cache"]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bundle")
    session = record(folder / "Sitzung 1", textures="AB")
    words = ["--title", "Ridges", "--creator", "Nobody, Nora", *FAST]
    assert main(["bundle", str(session), "--out", str(folder / "b"), *words]) == 0
    shutil.rmtree(session)
    return folder / "b"


def copy_of(bundle: Path, place: Path) -> Path:
    return Path(shutil.copytree(bundle, place / "an ünusual place"))


def test_the_description_has_every_file_and_says_simulated(bundle: Path) -> None:
    graph = json.loads((bundle / "ro-crate-metadata.json").read_text())["@graph"]
    by_id = {each["@id"]: each for each in graph}
    root = by_id["./"]
    assert root["name"] == "Ridges" and root["description"].startswith("SIMULATED data")
    assert by_id["ro-crate-metadata.json"]["about"] == {"@id": "./"}
    assert {"sessions/Sitzung%201/part-0001.h5", "report/fig3.svg"} <= by_id.keys()
    assert all(len(each["sha256"]) == 64 for each in graph if each["@type"] == "File")
    referenced = [part["@id"] for part in (*root["hasPart"], *by_id["#analysis"]["result"])]
    assert set(referenced) <= by_id.keys()
    assert by_id["#numpy"]["version"] and by_id["#option-k_max"]["value"] == "3"


def test_every_figure_is_made_again_elsewhere(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = copy_of(bundle, tmp_path)
    words = ["--remake", "--no-cache", "--out", str(tmp_path / "again")]
    assert main(["bundle", str(moved), *words]) == 0
    n = len([path for path in (bundle / "report").iterdir() if path.suffix in (".svg", ".png")])
    assert f"{n} of {n} figures are equal to the bit" in capsys.readouterr().out
    table = (tmp_path / "again" / "table1.csv").read_bytes()
    assert table == (bundle / "report" / "table1.csv").read_bytes()


def test_verify_names_what_was_changed(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = copy_of(bundle, tmp_path)
    assert main(["verify", str(moved)]) == 0
    digest = capsys.readouterr().out.split()[-1]
    assert main(["verify", str(moved), "--digest", digest]) == 0
    (moved / "report" / "table1.csv").write_text("better")
    (moved / "report" / "fig3.svg").unlink()
    (moved / "sessions" / "Sitzung 1" / "extra").touch()
    assert verify_bundle(moved) == [
        "report/fig3.svg: is missing",
        "sessions/Sitzung 1/extra: is not in ro-crate-metadata.json",
        "report/table1.csv: is not what was bundled",
    ]
    assert main(["verify", str(moved)]) == 1


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("ro-crate-metadata.json", "is no description of a bundle"),
        ("parameters.json", "cannot be used"),
    ],
)
def test_a_bundle_that_cannot_be_read_is_refused_in_a_sentence(
    spoil: str, said: str, bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = copy_of(bundle, tmp_path)
    for text in ("", "[]", '{"@graph": [{}], "sessions": ["../x"]}', "{}"):
        (moved / spoil).write_text(text)
        assert main(["verify", str(moved)]) == 2
        assert said in capsys.readouterr().err


def test_what_is_nothing_to_cite_is_refused(
    drum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = Path(shutil.copytree(drum, tmp_path / "s"))
    with (session / "part-0001.h5").open("r+b") as file:
        file.seek(5000)
        file.write(b"altered!" * 64)
    out = tmp_path / "b"
    assert main(["bundle", str(session), "--out", str(out), *FAST]) == 2
    assert main(["bundle", str(drum), "--out", str(out), "--c", "model.h5", *FAST]) == 2
    assert main(["bundle", str(drum), str(drum), "--out", str(out), *FAST]) == 2
    assert main(["bundle", str(drum), "--out", str(out), "--settings", "none.toml", *FAST]) == 2
    assert main(["bundle", str(record_by_hand(tmp_path / "h")), "--out", str(out), *FAST]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[3].startswith("rigctl: cannot read none.toml")
    assert said[4].startswith(f"rigctl: there is no committed trial: {tmp_path}")
    assert "it is nothing to cite" in said[0] and "no bundle has" in said[1]
    assert "the same name" in said[2] and not out.exists()
