"""Several trials in one file: a trial column, arrays of structures or cells, folders as labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from rigctl.analysis.trial_set import join_sessions
from rigctl.errors import ConfigError, WrongUse
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.exchange.test_import import run_import, write_csv
from tests.exchange.test_matlab import write_73

N = 60
RATE = "[time]\nrate_hz = 1000\n"
TABLE = RATE + (
    '[taxels]\ncolumns = ["a", "b"]\n[trials]\ncolumn = "run"\n'
    '[labels]\ntexture_column = "cloth"\nspeed_column = "v"\n'
)
ROWS = [("silk", 20, 1), ("silk", -20, 1), ("felt", 20, 1), ("felt", 20, 2)]


def readings(seed: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.random.Generator(np.random.Philox(seed)).integers(0, 1024, (N, 2))


def write_table(path: Path, rows: Sequence[tuple[Any, ...]], header: str = "cloth,v,run") -> Path:
    """Write a table whose rows belong to trials; readings of trial k have the seed k."""
    lines = [f"{header},a,b,note"] if header else []
    for seed, labels in enumerate(rows):
        lines += [",".join(map(str, (*labels, *reading, "by hand"))) for reading in readings(seed)]
    path.write_text("\n".join(lines) + "\n")
    return path


def trials_of(folder: Path) -> list[tuple[Any, ...]]:
    """Return texture, speed, direction, repeat and seed of every trial."""
    assert verify(folder).problems == []
    with Session.open(folder) as session:
        found = []
        for index in range(len(session.trials)):
            trial = session.trial_row(index).trial
            seed = next(k for k in range(9) if np.array_equal(session.samples(index), readings(k)))
            found.append((trial.texture, trial.speed_mm_s, trial.direction, trial.repeat, seed))
    return found


EXPECTED = [
    ("felt", 20.0, "forward", 1, 2),
    ("felt", 20.0, "forward", 2, 3),
    ("silk", 20.0, "backward", 1, 1),
    ("silk", 20.0, "forward", 1, 0),
]


def test_a_trial_column_and_label_columns_divide_a_table(tmp_path: Path) -> None:
    folder, inspection = run_import(tmp_path, TABLE, [write_table(tmp_path / "all.csv", ROWS)])
    assert trials_of(folder) == EXPECTED
    assert inspection.remarks == ()
    with Session.open(folder) as session:
        texts = [event.text for event in session.events if event.kind == "trial"]
    assert texts[0] == "trial 1 is all.csv, trial 1 from row 122"


def test_a_table_without_header_may_have_textures(tmp_path: Path) -> None:
    text = TABLE.replace('"a", "b"', '"4", "5"').replace('"run"', '"3"')
    text = text.replace('"cloth"', '"1"').replace('"v"', '"2"')
    folder, _ = run_import(tmp_path, text, [write_table(tmp_path / "all.csv", ROWS, "")])
    assert trials_of(folder) == EXPECTED


def test_a_single_column_divides_a_table_in_the_order_of_its_rows(tmp_path: Path) -> None:
    text = (
        '[labels]\ntexture = "felt"\nspeed_mm_s = 20\n[trials]\ncolumn = "run"\n'
        '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["a", "b"]\n'
    )
    rows = [("felt", 20, 7), ("felt", 20, 2), ("felt", 20, 5)]
    folder, _ = run_import(tmp_path, text, [write_table(tmp_path / "all.csv", rows)])
    assert trials_of(folder) == [("felt", 20.0, "forward", k + 1, k) for k in range(3)]


def test_rows_without_a_trial_are_left_out(tmp_path: Path) -> None:
    rows = [ROWS[0], ("", "", ""), ROWS[2]]
    folder, inspection = run_import(tmp_path, TABLE, [write_table(tmp_path / "all.csv", rows)])
    assert [row[-1] for row in trials_of(folder)] == [2, 0]
    assert inspection.remarks[0] == (
        f"all.csv: {N} rows without a label belong to no trial: left out"
    )


def test_textures_may_have_other_names_in_the_session(tmp_path: Path) -> None:
    rows = [("a name that is far too long", 20, 1), ("7", 20, 1)]
    file = write_table(tmp_path / "all.csv", rows)
    with pytest.raises(WrongUse, match=r"longer than 16 bytes; .* name it in \[textures\]"):
        run_import(tmp_path, TABLE, [file], "refused")
    names = '[textures]\n"a name that is far too long" = "long"\n7 = "felt"\n'
    folder, _ = run_import(tmp_path, TABLE + names, [file])
    assert [row[0] for row in trials_of(folder)] == ["felt", "long"]


STRUCTURES = RATE + (
    '[taxels]\ncolumns = ["skin1..skin2"]\n[trials]\nelements = "data.trials"\n'
    '[labels]\ntexture_column = "cloth"\nspeed_column = "set.v"\n'
)


def write_structures(folder: Path) -> list[Path]:
    """Write an array of structures as MATLAB 5 and 7.3."""
    trials = [
        {"cloth": cloth, "set": {"v": float(v)}, "skin": readings(k).astype(float)}
        for k, (cloth, v, _) in enumerate(ROWS)
    ]
    array = np.empty(len(trials), object)
    array[:] = trials
    savemat(folder / "five.mat", {"data": {"trials": array, "who": "Jörg"}})
    return [folder / "five.mat", write_73(folder / "seven.mat", {"data": {"trials": trials}})]


def test_elements_of_an_array_of_structures_are_trials(tmp_path: Path) -> None:
    for path in write_structures(tmp_path):
        folder, inspection = run_import(tmp_path, STRUCTURES, [path], path.stem)
        assert trials_of(folder) == EXPECTED
        assert inspection.trials[0].name == f"{path.name}, data.trials.3"


def test_elements_of_a_cell_array_are_trials(tmp_path: Path) -> None:
    cells = np.empty(3, object)
    cells[:] = [readings(0).astype(float), np.empty((0, 2)), readings(1).astype(float)]
    savemat(tmp_path / "silk.mat", {"cells": cells})
    text = RATE + (
        '[files]\npattern = "(?P<texture>.+).mat"\n[labels]\nspeed_mm_s = 20\n'
        '[taxels]\ncolumns = ["1", "2"]\n[trials]\nelements = "cells"\n'
    )
    folder, inspection = run_import(tmp_path, text, [tmp_path / "silk.mat"])
    assert [row[3:] for row in trials_of(folder)] == [(1, 0), (2, 1)]
    assert inspection.remarks[0] == "silk.mat: cells.2 is empty: left out"


def test_a_pattern_with_a_slash_reads_folders(tmp_path: Path) -> None:
    text = RATE + (
        "[files]\npattern = '/(?P<texture>[a-z]+)/(?P<speed>-?\\d+)/run(?P<repeat>\\d)[.]'\n"
        '[taxels]\ncolumns = ["a", "b"]\n'
    )
    files = []
    for seed, (cloth, speed, repeat) in enumerate(ROWS):
        files.append(tmp_path / cloth / str(speed) / f"run{repeat}.csv")
        files[-1].parent.mkdir(parents=True, exist_ok=True)
        lines = [f"{a},{b}" for a, b in readings(seed)]
        files[-1].write_text("\n".join(["a,b", *lines]) + "\n")
    folder, inspection = run_import(tmp_path, text, files)
    assert trials_of(folder) == EXPECTED
    assert inspection.trials[0].name == "felt/20/run1.csv"


def colliding(folder: Path) -> tuple[str, list[Path]]:
    text = TABLE.replace("speed_column", 'repeat_column = "run"\nspeed_column')
    files = [write_table(folder / f"{name}.csv", ROWS[:1]) for name in "xy"]
    return text, files


def mixed(folder: Path) -> tuple[str, list[Path]]:
    text = TABLE.replace('"a", "b"', '"4", "5"')
    files = [write_table(folder / "x.csv", ROWS[:2])]
    return text, [*files, write_table(folder / "y.csv", ROWS[2:], "run,v,cloth")]


def headless(folder: Path) -> tuple[str, list[Path]]:
    text = '[files]\npattern = "(?P<texture>[xy])"\n[labels]\nspeed_mm_s = 20\n'
    text += RATE + '[taxels]\ncolumns = ["1..3"]\n'
    first = write_csv(folder / "x.csv", np.arange(9.0), np.ones((9, 3)))
    second = folder / "y.csv"
    second.write_text(first.read_text().partition("\n")[2])
    return text, [first, second]


def two_roles(folder: Path) -> tuple[str, list[Path]]:
    text = TABLE.replace('"a", "b"', '"v..b"')
    return text, [write_table(folder / "x.csv", ROWS)]


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            colliding,
            "x.csv and y.csv are both silk at 20 mm/s, 0 g, repeat 1, mount 1: correct the map's",
        ),
        (mixed, "has the columns run, v, cloth, a, b, note, but x.csv has cloth, v, run, a, b"),
        (headless, "y.csv has the columns 1, 2, 3, 4, but x.csv has t, a, b, c: import each"),
        (two_roles, "x.csv: column v is mapped as a label and as numbers: leave out one"),
    ],
)
def test_colliding_labels_and_mixed_layouts_are_refused(
    tmp_path: Path, build: Callable[[Path], tuple[str, list[Path]]], words: str
) -> None:
    text, files = build(tmp_path)
    with pytest.raises(WrongUse) as refused:
        run_import(tmp_path, text, files)
    assert words in str(refused.value)
    assert not (tmp_path / "session").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "[labels]",
            "[files]\npattern = '(?P<texture>.)'\n[labels]",
            "labels.texture_column: 'cloth' and the pattern's group texture both give the texture",
        ),
        ('speed_column = "v"', "", "has no group speed, and [labels] has no speed_mm_s"),
        ('column = "run"', 'elements = "x"\n[files]\nvariable = "y"', "leave out variable"),
        ('column = "run"', 'elements = "x"', "all.csv is a text table, which has no elements"),
        ("[labels]", '[textures]\nx = "\\u001b"\n[labels]', "textures.x: "),
        ('"cloth"', '"clot"', "has no column 'clot': did you mean 'cloth'?"),
        ('"v"', '"cloth"', "its speed is 'silk', which is not a number"),
        ('"run"', '"note"\n[labels.x]', "unknown key"),
        ("speed_column", 'mount_column = "v"\nspeed_column', "its mount is -20: give a whole"),
    ],
)
def test_a_wrong_map_of_trials_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    file = write_table(tmp_path / "all.csv", ROWS)
    with pytest.raises((WrongUse, ConfigError)) as refused:
        run_import(tmp_path, TABLE.replace(old, new), [file])
    assert words in str(refused.value)
    assert not (tmp_path / "session").exists()


def test_trials_of_several_files_are_read_once_for_each_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigctl.exchange import file_readers

    calls: list[Path] = []
    read = file_readers.read_trials
    monkeypatch.setattr(
        file_readers, "read_trials", lambda path, mapping: calls.append(path) or read(path, mapping)
    )
    files = [write_table(tmp_path / f"{k}.csv", ROWS) for k in range(2)]
    run_import(tmp_path, TABLE, files)
    assert len(calls) == 4  # an inspection and a writing


def test_repeats_that_begin_at_0_are_counted_from_1(tmp_path: Path) -> None:
    text = TABLE.replace("speed_column", 'repeat_column = "run"\nspeed_column')
    rows = [("silk", 20, 0), ("silk", 20, 1), ("felt", 20, 1)]
    folder, _ = run_import(tmp_path, text, [write_table(tmp_path / "all.csv", rows)])
    assert [(row[0], row[3], row[4]) for row in trials_of(folder)] == [
        ("felt", 2, 2),
        ("silk", 1, 0),
        ("silk", 2, 1),
    ]
    negative = write_table(tmp_path / "b.csv", [("silk", 20, -1)])
    with pytest.raises(WrongUse, match=r"repeat -1: .* a whole number"):
        run_import(tmp_path, text, [negative], "refused")


def test_a_label_says_the_mounting(tmp_path: Path) -> None:
    text = TABLE.replace('column = "run"\n', "").replace(
        "speed_column", 'mount_column = "run"\nspeed_column'
    )
    rows = [("silk", 20, 2), ("silk", 20, 1), ("felt", 20, 1)]
    folder, _ = run_import(tmp_path, text, [write_table(tmp_path / "all.csv", rows)])
    with Session.open(folder) as session:
        trials = [session.trial_row(index).trial for index in range(3)]
    assert [(t.texture, t.mount, t.repeat) for t in trials] == [
        ("felt", 1, 1),
        ("silk", 1, 1),
        ("silk", 2, 1),
    ]
    plain, _ = run_import(
        tmp_path, TABLE + "mount = 3\n", [write_table(tmp_path / "b.csv", ROWS)], "b"
    )
    with Session.open(plain) as session:
        assert session.trial_row(0).trial.mount == 3
    assert [trial.mount for trial in join_sessions([folder]).trials] == [1, 1, 2]


SENSOR = '[sensor]\nname = "skin"\nrows = 1\ncolumns = 1\nlayers = ["upper", "lower"]\n'


def test_the_map_says_rows_columns_and_layers_of_the_sensor(tmp_path: Path) -> None:
    file = write_table(tmp_path / "all.csv", ROWS[:1])
    folder, _ = run_import(tmp_path, TABLE + SENSOR, [file])
    with Session.open(folder) as session:
        assert session.sensor_layout == SensorLayout(1, 1, ("upper", "lower"))
        assert session.header.sensor == "skin"
        assert SensorLayout.of_rig(session.config.taxels) == session.sensor_layout
    plain, _ = run_import(tmp_path, TABLE, [file], "plain")
    with Session.open(plain) as session:
        assert session.sensor_layout == SensorLayout.default(2)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rows = 1", "rows = 3", r"3 × 1 taxels in 2 layers \(upper, lower\), which are 6, but"),
        ("rows = 1\n", "", r"line 10: sensor: needs rows and columns"),
        ("rows = 1", "rows = 0", "sensor.rows: 0 is outside 1 to 1024"),
        ("rows = 1", "rows = 800", "are more than 1024 taxels"),
        ('"upper"', '"a/b"', "a layer's name 'a/b' contains '/'"),
        ("rows", "row", "unknown key"),
    ],
)
def test_a_sensor_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    file = write_table(tmp_path / "all.csv", ROWS[:1])
    with pytest.raises((WrongUse, ConfigError), match=words):
        run_import(tmp_path, TABLE + SENSOR.replace(old, new), [file])
    assert not (tmp_path / "session").exists()
