"""The reference page has the current layout."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from rigctl.session import layout
from rigctl.session.header import SessionHeader
from tests.session.reference import LAYOUTS, arrays, table

TABLES = [*dict.fromkeys(each for of in LAYOUTS for each in of.tables), layout.DIGESTS]
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "session.md"


@pytest.mark.parametrize("of", TABLES, ids=lambda of: of.path)
def test_each_table_is_on_the_page(of: layout.TableLayout) -> None:
    assert table(of) in PAGE.read_text(encoding="utf-8"), table(of)


def test_the_samples_and_the_attributes_are_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for of in LAYOUTS:
        assert arrays(of) in page, arrays(of)
    for item in fields(SessionHeader):
        assert f"| `{item.name}` |" in page
