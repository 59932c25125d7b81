"""The reference pages list every key of rig.toml and finger.toml."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.config.reference import finger_sections, sections

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"


@pytest.mark.parametrize(
    ("page", "tables"), [("rig-toml.md", sections()), ("finger-toml.md", finger_sections())]
)
def test_each_table_is_on_its_page(page: str, tables: list[str]) -> None:
    text = (REFERENCE / page).read_text(encoding="utf-8")
    for table in tables:
        assert table in text, table
