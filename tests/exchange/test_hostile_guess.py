"""Guesses from strangers' files: refused or guessed in a sentence, in a time that sizes bound."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.config.toml_reader import TomlText
from rigctl.errors import ConfigError, WrongUse
from rigctl.exchange.column_map import parse_map
from rigctl.exchange.guess import GuessedMap, guess_map, short_textures
from rigctl.protocol.fields import TEXTURE_BYTES

NAME = "felt_12mms_1"
WIDE = 4_000


def write_csv(folder: Path, header: str, rows: Any, name: str = NAME) -> Path:
    path = folder / f"{name}.csv"
    lines = [header, *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_npy(folder: Path, array: Any) -> Path:
    np.save(folder / f"{NAME}.npy", array)
    return folder / f"{NAME}.npy"


def write_npz(folder: Path, arrays: dict[str, Any]) -> Path:
    path = folder / f"{NAME}.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            content = BytesIO()
            np.save(content, np.asarray(array))
            archive.writestr(f"{name}.npy", content.getvalue())
    return path


def steps(step: float) -> Any:
    return np.stack([np.arange(50) * step, np.arange(50) % 3, np.arange(50) % 5], axis=1)


def guessed(path: Path) -> GuessedMap:
    guess = guess_map([path])
    guess.text.encode()
    return guess


def test_a_cell_of_a_hundred_thousand_letters_is_refused(tmp_path: Path) -> None:
    path = write_csv(tmp_path, "t,a,b", [[1, 2, "x" * 140_000]])
    with pytest.raises(WrongUse, match="field larger than field limit"):
        guess_map([path])


def test_a_wide_table_is_divided_by_its_own_letter(tmp_path: Path) -> None:
    header = ",".join(f"a_taxel_with_a_long_name_{k}" for k in range(WIDE))
    path = write_csv(tmp_path, header, np.arange(3 * WIDE).reshape(3, WIDE) % 7)
    assert len(guessed(path).header) == WIDE


@pytest.mark.parametrize("step", [5e-324, 1e-310, 1e-100, 1e98, np.inf, np.nan])
def test_steps_of_no_clock_are_no_time(tmp_path: Path, step: float) -> None:
    with np.errstate(invalid="ignore"):
        assert "[time]\n" in guessed(write_npy(tmp_path, steps(step))).text


@pytest.mark.parametrize("unit", ["ns", "s", "us"])
def test_a_named_time_without_steps_is_no_time(tmp_path: Path, unit: str) -> None:
    text = guessed(write_csv(tmp_path, f"t_{unit},a,b", steps(5e-324))).text
    assert f"rate_hz = 0  # t_{unit} is no clock" in text


@pytest.mark.parametrize("rate_hz", [np.nan, np.inf, -1e300, 0.0, 1e8])
def test_an_impossible_rate_is_not_believed(tmp_path: Path, rate_hz: float) -> None:
    arrays = {"fs": rate_hz, "a": np.arange(9) % 3, "b": np.arange(9) % 2}
    guess = guessed(write_npz(tmp_path, arrays))
    assert "rate_hz = 1000  # assumed" in guess.text
    assert guess.problem == ""


def test_a_rate_keeps_its_digits(tmp_path: Path) -> None:
    arrays = {"fs": 1234.5678901, "a": np.arange(9) % 3, "b": np.arange(9) % 2}
    assert "rate_hz = 1234.5678901  #" in guessed(write_npz(tmp_path, arrays)).text


def test_a_name_of_digits_and_a_letter_takes_no_quadratic_time(tmp_path: Path) -> None:
    path = write_csv(tmp_path, f"t,{'1' * 125_000}a,b", steps(1.0))
    assert "more than 1,000 letters" in guessed(path).problem


def test_texts_that_differ_in_each_row_are_no_time(tmp_path: Path) -> None:
    rows = [[f"text {k}", k % 2, k % 2] for k in range(3)]
    assert "rate_hz" in guessed(write_csv(tmp_path, "Zeit,a1,a2", rows)).text


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: write_npy(folder, np.ones((65, 10_001), np.uint8)),
        lambda folder: write_csv(folder, "1" + ",1" * 10_000, [["1" + ",1" * 10_000]]),
    ],
)
def test_more_than_ten_thousand_columns_are_refused(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    with pytest.raises(WrongUse, match="has 10,001 columns; 10,000 at most"):
        guess_map([write(tmp_path)])


def test_thousands_of_arrays_of_elements_are_looked_through_once(tmp_path: Path) -> None:
    arrays = {f"a{k}.{n}": np.zeros(2) for k in range(1000) for n in (1, 2)}
    assert 'elements = "a0"' in guessed(write_npz(tmp_path, arrays)).text


def test_an_array_beside_its_elements_is_refused(tmp_path: Path) -> None:
    arrays = {"a": np.zeros(0), "a.1": np.zeros((9, 3)), "a.2": np.zeros((9, 3))}
    with pytest.raises(WrongUse, match="no variable is a table of numbers"):
        guess_map([write_npz(tmp_path, arrays)])


def test_long_names_of_two_layouts_are_shortened(tmp_path: Path) -> None:
    paths = [
        write_csv(tmp_path, f"t,{letter * 100_000}", [[1, 2]], f"felt_12mms_{n}")
        for n, letter in enumerate("xy")
    ]
    with pytest.raises(WrongUse, match="with the columns t, yyy") as refused:
        guess_map(paths)
    assert len(str(refused.value)) < 1500


def test_strange_letters_of_labels_and_columns_stand_in_the_map(tmp_path: Path) -> None:
    label = "\x7f\x1b'\\\u2028"
    rows = [[f"{label}{k // 40}", 10, k % 3, k % 5] for k in range(120)]
    guess = guessed(write_csv(tmp_path, "texture,speed,a\x7f1,a\x7f2", rows))
    assert guess.problem == ""
    mapping = parse_map(TomlText("the map", guess.text, ConfigError), "")
    assert mapping.labels.renamed[f"{label}1"] == "1"
    assert mapping.taxels == ("a\x7f1..a\x7f2",)


def test_a_line_feed_in_a_name_adds_no_line_to_the_map(tmp_path: Path) -> None:
    path = write_csv(tmp_path, "t,a1,a2", steps(1.0), "felt\nname = 3 #_12mms_1")
    assert guessed(path).text.count("\nname = ") == 1


def test_half_letters_are_refused(tmp_path: Path) -> None:
    arrays = {"texture": np.array("\ud800"), "b": np.arange(9) % 2, "c": np.arange(9) % 3}
    with pytest.raises(WrongUse, match="no Unicode text"):
        guess_map([write_npz(tmp_path, arrays)])
    path = write_csv(tmp_path, "t,a1,a2", steps(1.0), "felt\udcff_12mms_1")
    with pytest.raises(WrongUse, match=r"felt\?_12mms_1\.csv: its name is not in UTF-8: rename it"):
        guess_map([path])


def test_many_long_labels_get_different_short_names() -> None:
    labels = [f"a texture with a long name {k}" for k in range(12_000)]
    short = short_textures(labels)
    assert len(set(short.values())) == len(labels)
    assert max(len(name.encode()) for name in short.values()) <= TEXTURE_BYTES
