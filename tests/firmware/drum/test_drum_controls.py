"""Each safety check passes on the drum's image and fails on an image with the checked defect."""

from __future__ import annotations

import pytest

from tests.firmware.drum.support.cell_checks import CELL_CHECKS, CELL_CONTROLS
from tests.firmware.drum.support.checks import CHECKS, CONTROLS, Check


def _name(value: object) -> str:
    return getattr(value, "__name__", str(value))


@pytest.mark.parametrize(("check", "image"), CHECKS + CELL_CHECKS, ids=_name)
def test_the_image_passes(check: Check, image: str) -> None:
    check(image)


@pytest.mark.parametrize(("broken", "_what", "check"), CONTROLS + CELL_CONTROLS, ids=_name)
def test_the_broken_image_fails(broken: str, _what: str, check: Check) -> None:
    with pytest.raises(AssertionError):
        check(f"firmware/drum-{broken}.elf")


def test_every_check_has_a_control() -> None:
    assert {check for check, _ in CHECKS + CELL_CHECKS} == {
        check for *_, check in CONTROLS + CELL_CONTROLS
    }
