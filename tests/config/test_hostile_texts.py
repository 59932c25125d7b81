"""A TOML text of a stranger is refused at once, in a sentence with its file and its place."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rigctl.config.text_file import name_problem, read_bytes
from rigctl.config.toml_reader import MAX_BYTES, TomlText
from rigctl.errors import ConfigError, ProtocolError
from rigctl.finger.plan import parse_finger_protocol
from rigctl.protocol.loader import parse_protocol


def reason(text: str) -> str:
    with pytest.raises(ConfigError) as refused:
        TomlText("some.toml", text, ConfigError)
    message = str(refused.value)
    assert message.startswith("some.toml")
    assert len(message) < 400
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        pytest.param("a" + ".a" * 130_000 + " = 1", "more than 16 parts", id="dotted key"),
        pytest.param("x = 1\n[" + "'a' . " * 40_000 + "a]", "(about line 2)", id="header"),
        pytest.param("a = {" + "b." * 50 + "c = 1}", "more than 16 parts", id="inline key"),
        pytest.param("k" * 300_000 + " = 1", f"larger than {MAX_BYTES:,} bytes", id="300 kB key"),
        pytest.param("k" * 200_000 + " = 1", "a key of more than 100 letters", id="200 kB key"),
        pytest.param("a = " + "[" * 100_000, "in each other", id="nested lists"),
        pytest.param("a = " + "[" * 50 + "]" * 50, "in each other", id="50 lists"),
        pytest.param("a = " + "{b = " * 30 + "1" + "}" * 30, "in each other", id="30 tables"),
        pytest.param("\na = 1" + "0" * 400, "line 2: a: is a whole number of more", id="10^400"),
        pytest.param("a = [1, 0x" + "f" * 200_000 + "]", "more than 64 bits", id="hexadecimal"),
        pytest.param("a = " + "9" * 200_000, "is not TOML", id="decimal"),
        pytest.param('a = "' + "x" * 1000 + "\n", "is not TOML", id="open text"),
        pytest.param('"""\\' * 60_000, "is not TOML", id="open texts"),
        pytest.param("a" + " " * 200_000 + "b", "is not TOML", id="spaces"),
        pytest.param("\x00", "is not TOML", id="zero byte"),
    ],
)
def test_a_text_beyond_the_limits_is_refused(text: str, words: str) -> None:
    assert words in reason(text)


def test_dots_in_texts_and_comments_are_no_key() -> None:
    dots = "1.2.3.4.5.6.7.8.9.10.11.12.13.14.15.16.17.18.19"
    text = f'a = "{dots} \\" {dots}"\n# {dots}\nb = \'{dots}\'\nc = """\n{dots}\n"{dots}"""\n'
    numbers = ", ".join(["0.5"] * 40)
    root = TomlText("some.toml", f"{text}d = [{numbers}]\n", ConfigError).root
    assert list(root) == ["a", "b", "c", "d"]


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999", "'1'", "true", "[]"])
def test_only_numbers_within_the_range_are_numbers(value: str) -> None:
    root = TomlText("some.toml", f"a = {value}", ConfigError).root
    with pytest.raises(ConfigError, match=r"^some\.toml, line 1: a: "):
        root.number("a", low=-1e300, high=1e300)


def test_a_key_with_control_characters_is_visible() -> None:
    root = TomlText("some.toml", r'"a\u001b[2J\nb\u202e" = 1', ConfigError).root
    with pytest.raises(ConfigError) as refused:
        root.finish()
    assert r": a\x1b[2J\nb\u202e: unknown key" in str(refused.value)
    assert str(refused.value).isprintable()


def test_a_wrong_value_of_any_length_is_shortened() -> None:
    root = TomlText("some.toml", f'a = "{"x" * 200_000}"', ConfigError).root
    with pytest.raises(ConfigError) as refused:
        root.number("a", low=0, high=1)
    assert len(str(refused.value)) < 200
    with pytest.raises(ConfigError, match="has 200,000 letters; 1,000 are the most"):
        root.text("a")


def test_the_line_of_a_key_is_found_at_once_in_a_long_line() -> None:
    assert "line 4: y" in reason(f"x = '''\n{'a' + ' ' * 200_000}\n'''\ny = {2**70}")


def test_what_is_no_file_is_not_read(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    cases = {
        pipe: "it is a pipe, not a file",
        Path("/dev/zero"): "it is a device, not a file",
        tmp_path: "it is a folder, not a file",
        tmp_path / ("x" * 300): "File name too long",
        tmp_path / "a\0b": "no zero byte",
        tmp_path / "missing": "No such file",
    }
    for path, words in cases.items():
        with pytest.raises(ConfigError, match=words):
            TomlText.read(path, ConfigError)


def test_a_file_larger_than_its_limit_is_refused_before_it_is_read(tmp_path: Path) -> None:
    sparse = tmp_path / "rig.toml"
    with sparse.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(ConfigError, match=r"rig.toml is larger than 262,144 bytes"):
        TomlText.read(sparse, ConfigError)
    sparse.write_bytes(b"x" * 10)
    assert read_bytes(sparse, 10) == b"x" * 10


TRIALS = "speeds_mm_s = [40]\nforces_g = [250]\n"


@pytest.mark.parametrize(
    "name",
    ["A", "P80", "by hand", "two-plates", "0.5 mm", "Größe 3", "絹", "رمل", "a_b(2)+c", "-1"],
)
def test_names_of_any_language_pass(name: str) -> None:
    assert name_problem(name) == ""


@pytest.mark.parametrize(
    "name",
    ["", "..", ".hidden", "../../x", "a/b", "a\\b", "C:x", "a\0b", "a\x1b[31m", "a\nb", " a", "a.",
     "\u202ea", "CON", "nul.txt", "com1", "a*", "\ud800", "x" * 300],
)  # fmt: skip
def test_what_could_leave_its_folder_or_act_on_a_terminal_is_refused(name: str) -> None:
    problem = name_problem(name)
    assert problem
    assert len(problem) < 200
    assert problem.isprintable()


@pytest.mark.parametrize("texture", ["../../x", "a\\u0000b", "a\\u001b[2J", "NUL", "x" * 17])
def test_a_texture_with_such_a_name_is_refused_with_its_line(texture: str) -> None:
    text = f'name = "x"\ntextures = ["A", "{texture}"]\n'
    with pytest.raises(ProtocolError, match=r"^some.toml, line 2: textures: "):
        parse_protocol(text + TRIALS, "some.toml")
    with pytest.raises(ProtocolError, match=r"^some.toml, line 2: textures: "):
        parse_finger_protocol(text + "profiles = ['slow']\n", "some.toml")


def test_a_protocol_is_no_path_below_the_folder_of_sessions() -> None:
    text = f'name = "../../x"\ntextures = ["A"]\n{TRIALS}'
    with pytest.raises(ProtocolError, match=r"^some.toml, line 1: name: '../../x' contains '/'"):
        parse_protocol(text, "some.toml")
