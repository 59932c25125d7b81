"""Pages name only existing files, and the life of a trial passes few rooms."""

from __future__ import annotations

import re

import pytest

from tests.architecture.imports import CHECKOUT

PAGES = ("docs/explanation/life-of-a-trial.md", "docs/explanation/architecture.md")
NAMED = re.compile(r"`((?:rigctl/|gui/|arduino/|tests/)?[a-z_]+(?:/[a-z_]+)*\.(?:py|cpp|toml))`")
MOST_ROOMS = 8


def named_files(page: str) -> list[str]:
    return NAMED.findall((CHECKOUT / page).read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_only_files_that_exist(page: str) -> None:
    missing = [
        name
        for name in named_files(page)
        if not (CHECKOUT / name).is_file()
        and not (CHECKOUT / "rigctl" / name).is_file()
        and name != "rig.toml"
    ]
    assert len(named_files(page)) > 10
    assert missing == []


def test_the_life_of_a_trial_passes_at_most_eight_rooms() -> None:
    rooms = {name.removeprefix("rigctl/").partition("/")[0] for name in named_files(PAGES[0])}
    assert len({room for room in rooms if not room.endswith(".py")}) <= MOST_ROOMS
