"""Keys of a TOML file are edited, and everything else stays as its owner wrote it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from rigctl.config.rig_config import parse_config
from rigctl.config.toml_edit import Value, replace_file, set_keys

MINE = """\
# My rig, since March.
[about]
name = "drum 2"  # in the corner

[loadcell]
scale_ug_per_count = 2000  # µg/count: old
"""
UNUSUAL = {
    "inline table": 'loadcell = { scale_ug_per_count = 2000, calibrated = "x" }\n',
    "dotted keys": 'loadcell.scale_ug_per_count = 2000 # old\nabout.name = "x"\n',
    "quoted key, header in a text": '[loadcell]\n"scale_ug_per_count" = 2000\n'
    'calibrated = """\n[loadcell]\nb"""\n',
    "brackets in comments": "[ loadcell ] # [x\n[taxels]\nlow = [ # ]\n 0, # [\n]\n",
    "Windows line ends": "[about]\r\nname = 'a'\r\n[loadcell]\r\nscale_ug_per_count = 1\r\n",
    "sub-table alone": "[loadcell.more]\n[about]\n",
    "empty": "",
}


def test_edit_of_a_key_changes_nothing_else(tmp_path: Path) -> None:
    text = set_keys(MINE, "loadcell", {"scale_ug_per_count": 2400, "calibrated": "with # 500 g"})
    assert text == MINE.replace(
        "scale_ug_per_count = 2000  # µg/count: old\n",
        'scale_ug_per_count = 2400  # µg/count: old\ncalibrated = "with # 500 g"\n',
    )
    again = set_keys(text, "loadcell", {"calibrated": "again"})
    assert parse_config(again).loadcell.calibrated == "again"
    added = parse_config(set_keys(MINE, "actuator", {"gain_p_per_s": 5.5}))
    assert (added.actuator.gain_p_per_s, added.about.name) == (5.5, "drum 2")
    path = tmp_path / "rig.toml"
    replace_file(path, text)
    assert path.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [path]
    path.chmod(0o664)
    link = tmp_path / "link.toml"
    link.symlink_to(path)
    replace_file(link, MINE)
    assert link.is_symlink() and path.read_text(encoding="utf-8") == MINE
    assert path.stat().st_mode & 0o777 == 0o664


@pytest.mark.parametrize("source", UNUSUAL.values(), ids=list(UNUSUAL))
@pytest.mark.parametrize(
    ("table", "values"),
    [
        ("loadcell", {"scale_ug_per_count": 2400, "calibrated": 'with # "500" g'}),
        ("taxels", {"wiring": [2, 1, 0], "low": [1]}),
    ],
)
def test_unusual_valid_toml_is_edited(source: str, table: str, values: dict[str, Value]) -> None:
    before = tomllib.loads(source)
    edited = tomllib.loads(set_keys(source, table, values))
    assert edited == before | {table: before.get(table, {}) | values}
