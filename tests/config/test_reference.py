"""The reference page lists every key of rig.toml."""

from __future__ import annotations

from pathlib import Path

from tests.config.reference import sections

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "rig-toml.md"


def test_each_table_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for section in sections():
        assert section in page, section
