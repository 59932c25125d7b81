"""Guessed maps: they import recordings of foreign layouts unchanged, and say what is missing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.errors import WrongUse
from rigctl.exchange.guess import guess_map
from rigctl.exchange.recording_files import find_recordings
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.exchange import layouts
from tests.exchange.layouts import TRIALS, write_rows


@pytest.mark.parametrize("write", layouts.LAYOUTS, ids=lambda write: write.__name__)
def test_a_guessed_map_imports_unchanged(
    tmp_path: Path, write: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "theirs").mkdir()
    write(tmp_path / "theirs")
    theirs, map_file, out = (str(tmp_path / name) for name in ("theirs", "map.toml", "session"))
    assert main(["import", "--guess", theirs, "--map", map_file]) == 0, capsys.readouterr().err
    shown = capsys.readouterr().out
    assert "taxel: " in shown
    assert "(texture) 2 values: felt, silk" in " ".join(shown.split())
    assert main(["import", theirs, "--map", map_file, "--out", out]) == 0
    assert verify(Path(out)).problems == []
    with Session.open(Path(out)) as session:
        rows = [session.trial_row(index).trial for index in range(len(session.trials))]
        found = [(row.texture, row.speed_mm_s, row.repeat) for row in rows]
        assert found == [(t.texture, t.speed_mm_s, t.repeat) for t in TRIALS]
        for index, trial in enumerate(TRIALS):
            np.testing.assert_array_equal(session.samples(index), trial.counts)


def guessed(folder: Path) -> str:
    return guess_map(find_recordings([folder]).files).text


def test_units_and_other_channels_are_found(tmp_path: Path) -> None:
    layouts.labels_in_names(tmp_path)
    assert 'delimiter = ";"' in guessed(tmp_path)
    assert 'columns = ["temperature"]' in guessed(tmp_path)
    tree = tmp_path / "tree"
    layouts.folder_tree(tree)
    text = guessed(tree)
    assert '[loadcell]\ncolumn = "force_N"\nunit = "N"' in text
    assert 'column = "Time (s)"\nunit = "s"\n' in text


def test_units_tell_labels_whose_words_are_unknown(tmp_path: Path) -> None:
    header = "Versuch,Textur,Geschwindigkeit (cm/s),Zeit (s),S1,S2,S3,S4,Kraft (N)"
    rows = [
        [n, t, v, k / 1000, *(500 + (k * s + n) % 7 for s in range(1, 5)), 1.96]
        for n, (t, v) in enumerate((("felt", 2), ("felt", 4), ("silk", 2), ("silk", 4)))
        for k in range(100)
    ]
    write_rows(tmp_path / "all.csv", header, rows)
    guess = guess_map(find_recordings([tmp_path]).files)
    assert guess.problem == ""
    assert '[trials]\ncolumn = "Versuch"' in guess.text
    assert 'speed_column = "Geschwindigkeit (cm/s)"\nforce_column = "Kraft (N)"\n' in guess.text
    assert 'speed_unit = "cm/s"\nforce_unit = "N"' in guess.text


def test_mm_a_minute_have_a_short_form(tmp_path: Path) -> None:
    for speed in (1200, 2400):
        for texture in ("felt", "silk"):
            name = f"{texture}_{speed}mmpm_run01.csv"
            write_rows(tmp_path / name, "t,a1,a2", [[0, 1, 2], [1, 3, 1], [2, 1, 2]])
    assert 'speed_unit = "mm/min"\n' in guessed(tmp_path)


def test_what_a_guess_cannot_know_is_left_to_fill_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, texture in (("Rather Long Name Of Cotton_30rpm_5kPa_1", 0), ("felt_60rpm_5kPa_1", 1)):
        write_rows(tmp_path / f"{name}.csv", "a,b,c", np.arange(30).reshape(10, 3) % 7 + texture)
    text = guessed(tmp_path)
    assert "radius_mm = 0  # from the axis to the sensor: fill in" in text
    assert "area_mm2 = 0  # that presses: fill in" in text
    assert '"Rather Long Name Of Cotton" = "RatherLongNam"' in text
    assert "rate_hz = 1000  # assumed" in text
    map_file = tmp_path / "map.toml"
    assert main(["import", "--guess", str(tmp_path), "--map", str(map_file)]) == 1
    captured = capsys.readouterr()
    assert "does not work yet: the map, line" in captured.err
    assert "rate_hz = 1000  # assumed: no column ascends like a time" in captured.out
    filled = map_file.read_text().replace("_mm = 0", "_mm = 60").replace("mm2 = 0", "mm2 = 100")
    map_file.write_text(filled)
    words = ["import", str(tmp_path), "--map", str(map_file), "--out", str(tmp_path / "out")]
    assert main(words) == 0


def test_equal_groups_of_columns_are_layers(tmp_path: Path) -> None:
    names = [f"{layer}{k}" for layer in ("upper", "lower") for k in range(1, 10)]
    rows = np.random.Generator(np.random.Philox(1)).integers(0, 1023, (50, 18))
    write_rows(tmp_path / "silk_20mms_1.csv", ",".join(names), rows)
    text = guessed(tmp_path)
    assert 'rows = 3\ncolumns = 3\nlayers = ["upper", "lower"]' in text
    assert 'columns = ["upper1..lower9"]' in text


@pytest.mark.parametrize("name", ["depth", "Depth", "pressIndentation", "depth_mm"])
def test_a_column_of_depths_is_in_mm(tmp_path: Path, name: str) -> None:
    rows = [[k, "felt", 20, 2, k % 3, k % 5] for k in range(40)]
    write_rows(tmp_path / "all.csv", f"time_ms,material,speed_mm_s,{name},a1,a2", rows)
    assert f'force_column = "{name}"' in guessed(tmp_path)
    assert 'force_unit = "mm"' in guessed(tmp_path)


def test_a_guess_says_what_the_names_do_not(tmp_path: Path) -> None:
    for number in range(3):
        write_rows(tmp_path / f"rec_00{number}.csv", "t,a1,a2", [[0, 1, 2], [1, 3, 1], [2, 1, 2]])
    guess = guess_map(find_recordings([tmp_path]).files)
    assert 'texture = ""  # not found' in guess.text
    assert "has no group texture" in guess.problem


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("a,b\n", "has no rows of values"),
        ("t,a\n" + "0,inf\n1,1e308\n2,-1e308\n3,nan\n", "has no group texture"),
        ("t,a,a,b..c\n" + "0,1,2,3\n1,1,2,4\n2,0,1,2\n", "has no group texture"),
        ("felt,x\nfelt,y\nfelt,x\n", "has no group speed"),
    ],
)
def test_a_strange_table_is_refused_or_its_map_says_what_is_missing(
    tmp_path: Path, content: str, words: str
) -> None:
    (tmp_path / "a.csv").write_text(content)
    try:
        problem = guess_map([tmp_path / "a.csv"]).problem
    except WrongUse as refused:
        problem = str(refused)
    assert words in problem


def two_kinds(folder: Path) -> list[Path]:
    np.save(folder / "b.npy", np.zeros((9, 3)))
    return [write_rows(folder / "a.csv", "", [[1, 2], [3, 4]]), folder / "b.npy"]


def two_headers(folder: Path) -> list[Path]:
    first = write_rows(folder / "silk_1.csv", "t,a", [[1, 2], [3, 4]])
    return [first, write_rows(folder / "silk_2.csv", "t,b", [[1, 2], [3, 4]])]


def two_depths(folder: Path) -> list[Path]:
    first = write_rows(folder / "silk_1.csv", "t,a", [[1, 2], [3, 4]])
    return [first, write_rows(folder / "more" / "silk_2.csv", "t,a", [[1, 2], [3, 4]])]


def two_forms(folder: Path) -> list[Path]:
    first = write_rows(folder / "silk_1.csv", "t,a", [[1, 2], [3, 4]])
    return [first, write_rows(folder / "silk_20mms_2.csv", "t,a", [[1, 2], [3, 4]])]


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (two_kinds, "a.csv and b.npy are of two kinds: guess a map for each kind"),
        (
            two_headers,
            "2 layouts: 1 with the columns t, a (2), such as silk_1.csv; 1 with",
        ),
        (two_depths, "are not at the same depth of folders: guess a map for each"),
        (two_forms, "silk_1.csv and silk_20mms_2.csv are names of two forms: guess a map for each"),
    ],
)
def test_two_layouts_are_refused_and_nothing_is_written(
    tmp_path: Path,
    write: Callable[[Path], list[Path]],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = [str(path) for path in write(tmp_path)]
    assert main(["import", "--guess", *files, "--map", str(tmp_path / "map.toml")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "map.toml").exists()


def test_a_guess_replaces_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    layouts.without_header(tmp_path)
    (tmp_path / "map.toml").write_text("mine")
    assert main(["import", "--guess", str(tmp_path), "--map", str(tmp_path / "map.toml")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "map.toml").read_text() == "mine"
    assert main(["import", str(tmp_path)]) == 2
    assert "an import needs --map and --out" in capsys.readouterr().err
    assert main(["import", "--guess", str(tmp_path), "--out", str(tmp_path / "x")]) == 2
    assert "--guess imports nothing" in capsys.readouterr().err


def test_a_guess_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    layouts.without_header(tmp_path)
    (tmp_path / "notes.txt").write_text("by hand")
    words = ["import", "--guess", str(tmp_path), "--map", str(tmp_path / "map.toml"), "--json"]
    assert main(words) == 0
    captured = capsys.readouterr()
    answer = json.loads(captured.out)
    assert answer["problem"] == ""
    assert answer["columns"][0]["role"] == "time in us: 1000 rows a second"
    assert answer["labels"]["texture"] == "2 values: felt, silk"
    assert "left out (notes.txt)" in captured.err


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WrongUse, match="has no recordings: their names end in"):
        find_recordings([tmp_path])
