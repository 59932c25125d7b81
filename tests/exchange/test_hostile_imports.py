"""Tables and maps of strangers are refused in a sentence; no line takes long."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.errors import ConfigError, WrongUse
from rigctl.exchange.column_map import load_map
from rigctl.exchange.importer import import_files
from rigctl.exchange.labels import parse_label
from rigctl.exchange.recording_tables import find_columns
from rigctl.exchange.text_table import MAX_FILE_BYTES, TextFormat, read_text_table

MAP = """\
[files]
pattern = '{pattern}'
{more}[labels]
speed_mm_s = 40
[taxels]
columns = [{columns}]
[time]
{time}
"""


def write_map(
    folder: Path,
    pattern: str = "(?P<texture>.+)_",
    more: str = "",
    columns: str = "'a'",
    time: str = "rate_hz = 1000",
) -> Path:
    path = folder / "map.toml"
    text = MAP.format(pattern=pattern, more=more, columns=columns, time=time)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pattern": "(?P<texture>(?&texture))"}, "line 2: files.pattern: is not a regular expr"),
        ({"pattern": "(" * 900}, "is not a regular expression"),
        ({"pattern": "x" * 1001}, "has 1,001 letters"),
        ({"more": "delimiter = ';;'\n"}, "line 3: files.delimiter: must be one letter"),
        ({"more": 'delimiter = "\\n"\n'}, "must be one letter"),
        ({"more": "decimal = ';'\n"}, "line 3: files.decimal: must be one of ., ,"),
        ({"more": "skip_lines = -1\n"}, "line 3: files.skip_lines: -1 is outside 0 to 10000"),
        ({"columns": f"'{'x' * 2000}'"}, "a text of more than 1,000 letters"),
        ({"columns": "'a']\nlow = 0\nhigh = 5e-324\n#"}, "taxels.high: is above low by less than"),
        ({"time": "rate_hz = 1e-320"}, "line 8: time.rate_hz: is below 0.001 Hz"),
    ],
)
def test_a_map_beyond_the_limits_is_refused(
    tmp_path: Path, changed: dict[str, str], words: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        load_map(write_map(tmp_path, **changed))
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a\x1b[2J_1.csv", "contains '\\x1b'"),
        ("..__1.csv", "begins or ends with a dot"),
        ("CON_.csv", "is reserved by Windows"),
        ("絹絹絹絹絹絹_.csv", "is longer than 16 bytes"),
    ],
)
def test_a_texture_from_a_file_name_is_a_safe_name(tmp_path: Path, name: str, words: str) -> None:
    mapping = load_map(write_map(tmp_path, "^(?P<texture>[^_]+)"))
    with pytest.raises(WrongUse) as refused:
        parse_label(Path(name), mapping.labels, {}, "a.csv")
    assert words in str(refused.value)


@pytest.mark.parametrize("speed", ["nan", "inf", "-inf", "1e300"])
def test_a_speed_from_a_file_name_is_a_possible_number(tmp_path: Path, speed: str) -> None:
    mapping = load_map(write_map(tmp_path, "(?P<texture>[A-Z])_(?P<speed>[^_]+)_"))
    with pytest.raises(WrongUse, match="and none huge"):
        parse_label(Path(f"A_{speed}_1.csv"), mapping.labels, {}, "a.csv")


def refusal(path: Path) -> str:
    tracemalloc.start()
    try:
        with pytest.raises(WrongUse) as refused:
            read_text_table(path, TextFormat(","))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64e6
    return str(refused.value)


def test_a_line_without_an_end_is_refused_before_it_is_read(tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    with table.open("wb") as file:
        file.write(b"1,2\n1")
        file.truncate(2**30)
    assert "a.csv, row 2: has more than 1,000,000 letters" in refusal(table)
    with table.open("r+b") as file:
        file.truncate(2 * MAX_FILE_BYTES)
    assert "more than 4,294,967,296 bytes" in refusal(table)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"1," * 20_000 + b"1\n", "row 1: has 20,001 columns; 10,000 at most"),
        (b'1,"' + b"x" * 200_000, "field larger than field limit"),
        (b"1,2\n3," + b"x" * 1000 + b"\n", "row 2, column 2: 'xxx"),
        (b"1,2\n\xff\n", "not a text table in UTF-8"),
        (b"1,2\n1\n1,2\n", "row 2: has 1 cells, the first has 2"),
        (b"\n" * 100_000, "is empty"),
        (b"a,b\n1\n", "has no rows of values"),
    ],
)
def test_a_broken_table_names_its_row(tmp_path: Path, content: bytes, words: str) -> None:
    table = tmp_path / "a.csv"
    table.write_bytes(content)
    message = refusal(table)
    assert words in message
    assert len(message) < 400


def test_a_pipe_is_no_table(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    assert "it is a pipe, not a file" in refusal(tmp_path / "a.csv")


RAMP = np.arange(50)[:, None] % np.array([7, 5, 3])


def import_arrays(folder: Path, arrays: dict[str, Any], **changed: str) -> tuple[str, ...]:
    np.savez(folder / "x_1.npz", **arrays)
    mapping = load_map(write_map(folder, **{"more": "", "columns": '"a1..a3"', **changed}))
    out = folder / "session"
    return import_files([folder / "x_1.npz"], mapping, out, "2026-11-23T12:00:00Z")[0].remarks


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (np.arange(50) * 5e-324, "4.9e-324 s apart"),
        (np.arange(50) * 1e-300, "1e-300 s apart, which is more than 100,000 a second: check"),
        (np.arange(50) * 1e98, "its times span 4.9e+99 s: check unit"),
        (np.arange(50) * 1e306, "fewer than two rows have different times"),
        (
            np.where(np.arange(50) > 0, 1.7e308, -1.7e308),
            "fewer than two rows have different times",
        ),
        (np.zeros(0), "fewer than two rows have different times"),
    ],
)
def test_times_of_no_trial_are_refused(tmp_path: Path, times: Any, words: str) -> None:
    path = write_map(tmp_path, columns='"a1..a3"', time="column = 't'")
    np.savez(tmp_path / "x_1.npz", t=times, a=RAMP[: len(times)])
    with pytest.raises(WrongUse) as refused:
        import_files([tmp_path / "x_1.npz"], load_map(path), tmp_path / "s", "2026-11-23T12:00:00Z")
    assert words in str(refused.value)


def test_values_beyond_all_readings_count_as_missing(tmp_path: Path) -> None:
    values = RAMP.astype(float)
    values[7] = 1e308, -1e308, 1e308
    remarks = import_arrays(tmp_path, {"a": values})
    assert any("1 rows lack a value, the first is row 8: left out" in line for line in remarks)


def test_values_that_differ_by_next_to_nothing_are_imported(tmp_path: Path) -> None:
    remarks = import_arrays(tmp_path, {"a": RAMP * 5e-324})
    assert "a1 never changes" not in remarks


def test_a_file_of_empty_elements_has_no_trial(tmp_path: Path) -> None:
    arrays = {"c.1": np.zeros(0), "c.2": np.zeros(0)}
    with pytest.raises(WrongUse, match="has no trial with this map: every element is empty"):
        import_arrays(tmp_path, arrays, more="[trials]\nelements = 'c'\n")


def test_a_name_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x\udcff_1.npy"
    np.save(path, RAMP)
    with pytest.raises(WrongUse, match=r"x\?_1\.npy: its name is not in UTF-8: rename it"):
        import_files([path], load_map(write_map(tmp_path)), tmp_path / "s", "2026-11-23T12:00:00Z")


def test_names_of_columns_are_shortened_and_compared_in_a_moment() -> None:
    names = ["x" * 100_000 + str(k) for k in range(20)]
    with pytest.raises(WrongUse) as refused:
        find_columns("a.csv", names, ["\U0010ffff" * 1000])
    assert "it has xxx" in str(refused.value) and len(str(refused.value)) < 1500
    with pytest.raises(WrongUse, match="did you mean 'taxel_1'"):
        find_columns("a.csv", ["taxel_1", *names], ["taxel1"])
