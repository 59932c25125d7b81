"""Names that become part of a path: those of people's plates pass, those of attackers do not."""

from __future__ import annotations

import pytest

from rigctl.config.text_file import name_problem
from rigctl.errors import ProtocolError
from rigctl.finger.plan import parse_finger_protocol
from rigctl.protocol.loader import parse_protocol

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
