"""The reference page lists every command with the declared types of its arguments."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.engine.rpc.reference import tables

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "engine.md"


@pytest.mark.parametrize("title", tables())
def test_each_table_is_on_the_page(title: str) -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert f"## {title}\n" in text
    assert tables()[title] in text, "python -m tests.engine.rpc.reference prints it"
