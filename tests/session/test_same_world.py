"""A session resumes only in the simulated world that it was recorded in."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import SessionError
from rigctl.session.recorder import check_same_world

BEGUN = {"seed": 3, "world": {"start_mm": 251.0, "dead_taxels": [2]}, "world_file": "lab.toml"}


def test_the_same_world_from_another_file_is_the_same() -> None:
    again = {"world": {"start_mm": 251, "dead_taxels": (2,)}, "world_file": "copy.toml"}
    check_same_world(Path("s"), BEGUN, again)
    check_same_world(Path("s"), {}, {})


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ({"start_mm": 100.0, "dead_taxels": []}, "start_mm is 251.0 there and 100.0 here"),
        ({"start_mm": 251.0, "dead_taxels": []}, r"dead_taxels is \[2\] there and \[\] here"),
        ({"start_mm": 251.0}, r"dead_taxels is \[2\] there and absent here"),
        ({**BEGUN["world"], "warp": 9}, "warp is absent there and 9 here"),
    ],
)
def test_the_first_parameter_that_differs_is_named(world: dict[str, object], words: str) -> None:
    with pytest.raises(SessionError, match=f"s was recorded in another world, {words}: "):
        check_same_world(Path("s"), BEGUN, {"world": world})


def test_a_session_without_a_world_is_not_resumed() -> None:
    with pytest.raises(SessionError, match="s does not say in which simulated world"):
        check_same_world(Path("s"), {"seed": 3}, BEGUN)
