"""Each check passes on the image of its board and fails on an image with the checked defect."""

from __future__ import annotations

import pytest

from tests.firmware.drum.support import checks, wires
from tests.firmware.drum.support.attacks import ATTACK_CONTROLS
from tests.firmware.drum.support.cell_checks import CELL_CONTROLS
from tests.firmware.drum.support.checks import Check
from tests.firmware.taxels.checks import CONTROLS as TAXEL_CONTROLS

DRUM = (*checks.CONTROLS, *ATTACK_CONTROLS, *CELL_CONTROLS, *wires.WIRE_CONTROLS)
CONTROLS = [("drum", *control) for control in DRUM]
CONTROLS += [("taxels", *control) for control in TAXEL_CONTROLS]
OTHER_IMAGES = {
    checks.a_hung_loop_is_reset_within_100_ms: checks.HANGS,
    wires.a_swapped_actuator_presses_less_than_300_g: wires.SWAPPED,
}
"""What a check passes on that needs a defect to begin with."""


def _name(value: object) -> str:
    return getattr(value, "__name__", str(value))


@pytest.mark.parametrize(
    ("board", "check"), dict.fromkeys((board, check) for board, *_, check in CONTROLS), ids=_name
)
def test_the_image_passes(board: str, check: Check) -> None:
    check(OTHER_IMAGES.get(check, f"firmware/{board}.elf"))


@pytest.mark.parametrize(("board", "broken", "_what", "check"), CONTROLS, ids=_name)
def test_the_broken_image_fails(board: str, broken: str, _what: str, check: Check) -> None:
    with pytest.raises(AssertionError):
        check(f"firmware/{board}-{broken}.elf")
