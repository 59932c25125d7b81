"""One key or one repeated table is changed, and everything else stays as it is."""

from __future__ import annotations

import tomllib

import pytest

from rigctl.config.resources import protocols
from rigctl.config.toml_edit import Value, insert_table, remove_table, set_key, swap_tables
from rigctl.config.toml_reader import KeyPath
from rigctl.errors import WrongUse

MINE = """\
# Mine, since May.
textures = [
    "A",  # smooth
    "D",  # ridges
]
speeds_mm_s = [40, 80]  # as in the paper

# How it presses.
[trial]
travel_mm = 120  # half

# first
[[steps]]
at = "start"
kind = "tare"

# second
[[steps]]
at = "end"
kind = "rest"
seconds = 3

# About everything.
"""
SHOWCASE = (protocols() / "showcase.toml").read_text(encoding="utf-8")


def test_a_key_changes_in_its_line_and_comments_stay() -> None:
    text = set_key(MINE, ("speeds_mm_s",), [40, 60, 80])
    assert text == MINE.replace("[40, 80]", "[40, 60, 80]")
    assert set_key(MINE, ("trial", "travel_mm"), 90.5) == MINE.replace("120", "90.5")
    assert set_key(MINE, ("steps", 1, "seconds"), 4) == MINE.replace("= 3", "= 4")
    assert set_key(MINE, ("trial", "travel_mm"), None) == MINE.replace(
        "travel_mm = 120  # half\n", ""
    )


def test_the_comments_in_a_list_stay() -> None:
    text = set_key(MINE, ("textures",), ["A", "B", "D"])
    assert "# smooth" in text and "# ridges" in text
    assert tomllib.loads(text)["textures"] == ["A", "B", "D"]
    text = set_key(MINE, ("textures",), ["A"])
    assert "# smooth" in text and tomllib.loads(text)["textures"] == ["A"]


def test_a_missing_key_or_table_gets_its_place() -> None:
    text = set_key(MINE, ("repeats",), 3)
    assert "# as in the paper\nrepeats = 3\n\n# How it presses." in text
    text = set_key(MINE, ("order", "seed"), 7)
    assert "# half\n\n[order]\nseed = 7\n\n# first\n[[steps]]" in text
    assert set_key("", ("name",), "x") == 'name = "x"\n'
    assert set_key(MINE, ("order", "seed"), None) == MINE


def test_repeated_tables_come_go_and_move_with_their_comments() -> None:
    moved = swap_tables(MINE, "steps", 0)
    assert moved.index("# second") < moved.index("# first") < moved.index('kind = "tare"')
    removed = remove_table(MINE, "steps", 1)
    assert "# About everything." in removed and "# second" not in removed
    assert "steps" not in tomllib.loads(remove_table(removed, "steps", 0))
    added = insert_table(MINE, "steps", 1, {"at": "start", "kind": "tare"})
    assert [step["at"] for step in tomllib.loads(added)["steps"]] == ["start", "start", "end"]
    alone = insert_table('name = "x"\n', "steps", 0, {"at": "start", "kind": "tare"})
    assert alone == 'name = "x"\n\n[[steps]]\nat = "start"\nkind = "tare"\n'


@pytest.mark.parametrize(
    "source",
    [
        "trial = { travel_mm = 100, direction = 'forward' }\n",
        "trial.travel_mm = 100 # old\nname = 'x'\n",
        "name = '''\n[trial]\n'''\n[trial]\r\n\"travel_mm\" = 1\r\n",
        "textures = [ # ]\n[1], # [x\n]\n[ trial ] # [[steps]]\n",
        "",
        MINE,
        SHOWCASE,
        SHOWCASE.replace("\n", "\r\n"),
    ],
)
@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("trial", "travel_mm"), 90),
        (("trial", "direction"), 'with # "marks"'),
        (("trial", "travel_mm"), None),
        (("name",), "[trial]"),
    ],
)
def test_any_text_holds_the_change_and_nothing_else(
    source: str, path: KeyPath, value: Value | None
) -> None:
    expected = tomllib.loads(source)
    inner = expected.setdefault("trial", {}) if len(path) == 2 else expected
    inner.pop(path[-1], None)
    if value is not None:
        inner[path[-1]] = value
    found = tomllib.loads(set_key(source, path, value))
    assert {k: v for k, v in found.items() if v} == {k: v for k, v in expected.items() if v}


@pytest.mark.parametrize("place", range(8))
def test_steps_of_the_showcase_move_and_leave(place: int) -> None:
    steps = tomllib.loads(SHOWCASE)["steps"]
    left = tomllib.loads(remove_table(SHOWCASE, "steps", place))["steps"]
    assert left == steps[:place] + steps[place + 1 :]
    if place < 7:
        moved = tomllib.loads(swap_tables(SHOWCASE, "steps", place))["steps"]
        assert moved[place : place + 2] == [steps[place + 1], steps[place]]


def test_what_cannot_be_changed_safely_is_refused() -> None:
    inline = 'steps = [{ at = "start", kind = "tare" }]\n'
    with pytest.raises(WrongUse, match="change it as text"):
        set_key(inline, ("steps", 0, "at"), "end")
    with pytest.raises(WrongUse, match="change it as text"):
        insert_table(inline, "steps", 1, {"at": "end", "kind": "tare"})
    with pytest.raises(WrongUse, match="change it as text"):
        swap_tables(inline, "steps", 0)
