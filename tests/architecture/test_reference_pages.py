"""The reference pages say what the code declares: keys, protocols, commands and recorded tables."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from rigctl.config.rig_config import RigConfig
from rigctl.protocol.fields import STEP_KINDS, step_fields
from rigctl.protocol.loader import KINDS
from rigctl.session import layout
from rigctl.session.header import SessionHeader
from tests.config.reference import finger_sections, sections
from tests.engine.rpc import reference as commands
from tests.protocol import reference as protocols
from tests.session.reference import LAYOUTS, arrays, table

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
TABLES = [*dict.fromkeys(each for of in LAYOUTS for each in of.tables), layout.DIGESTS]


@pytest.mark.parametrize(
    ("page", "tables"),
    [
        ("rig-toml.md", sections()),
        ("finger-toml.md", finger_sections()),
        ("protocols.md", protocols.tables()),
        ("engine.md", [f"## {title}\n" for title in commands.tables()]),
        ("engine.md", commands.tables().values()),
        ("session.md", map(table, TABLES)),
        ("session.md", map(arrays, LAYOUTS)),
        ("session.md", [f"| `{item.name}` |" for item in fields(SessionHeader)]),
    ],
    ids=["rig", "finger", "protocols", "titles", "commands", "tables", "arrays", "attributes"],
)
def test_each_table_is_on_its_page(page: str, tables: list[str]) -> None:
    """The modules ``reference`` of the rooms print them."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    assert [table for table in tables if table not in text] == []


def test_each_kind_of_step_is_declared_once() -> None:
    assert set(KINDS) == set(STEP_KINDS) == set(step_fields(RigConfig()))
