"""Each check passes on the taxel board's image and fails on an image with the checked defect."""

from __future__ import annotations

import pytest

from tests.firmware.taxels.checks import CONTROLS, GOOD, Check


def _name(value: object) -> str:
    return getattr(value, "__name__", str(value))


@pytest.mark.parametrize(("_broken", "_what", "check"), CONTROLS, ids=_name)
def test_the_image_passes(_broken: str, _what: str, check: Check) -> None:
    check(GOOD)


@pytest.mark.parametrize(("broken", "_what", "check"), CONTROLS, ids=_name)
def test_the_broken_image_fails(broken: str, _what: str, check: Check) -> None:
    with pytest.raises(AssertionError):
        check(f"firmware/taxels-{broken}.elf")
