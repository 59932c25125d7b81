"""The reference page has every key with the default, unit and range that the loader uses."""

from __future__ import annotations

from pathlib import Path

from rigctl.config.rig_config import RigConfig
from rigctl.protocol.fields import STEP_KINDS, step_fields
from rigctl.protocol.loader import KINDS
from tests.protocol.reference import tables

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "protocols.md"


def test_the_page_has_each_table_as_declared() -> None:
    page = PAGE.read_text(encoding="utf-8")
    missing = [table for table in tables() if table not in page]
    assert missing == []


def test_each_kind_of_step_is_declared_once() -> None:
    assert set(KINDS) == set(STEP_KINDS) == set(step_fields(RigConfig()))
