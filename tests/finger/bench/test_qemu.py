"""The virtual finger with the image under QEMU gives what the host build gives."""

from __future__ import annotations

import pytest

from rigctl.errors import RigFault
from rigctl.finger import board_messages
from rigctl.finger.bench.qemu import ImageBoard, open_qemu_finger
from rigctl.finger.bench.virtual import VirtualFinger, open_virtual_finger
from rigctl.finger.values import VelocityProfile
from tests.finger.bench.host import FingerHost
from tests.firmware.building import built


def _scan(rig: VirtualFinger) -> list[tuple[bytes, float]]:
    """Begin a slide and a scan of three batches, and return what reaches the host, and when."""
    host = FingerHost(rig)
    rig.finger.write(board_messages.set_ranges((20,) * 9, (250,) * 9))
    rig.slide("B", VelocityProfile.FAST)
    host.wait(500_000)
    rig.finger.write(board_messages.start(1))
    for batch in range(3):
        host.wait(103_000)
        rig.finger.write(board_messages.velocity(1, batch, 150_000))
    rig.finger.write(board_messages.stop(1))
    host.wait(50_000)
    rig.close()
    return host.pieces


def test_the_image_sends_the_same_bytes_at_the_same_times() -> None:
    built("firmware/finger.elf")
    host_build = _scan(open_virtual_finger(seed=8, taxel_board=True))
    assert _scan(open_qemu_finger(seed=8)) == host_build
    assert len(host_build) > 80


def test_the_image_boots_again_after_the_cable() -> None:
    built("firmware/finger.elf")
    rig = open_qemu_finger(seed=8)
    host = FingerHost(rig)
    host.wait(20_000)
    rig.faults.unplug()
    rig.faults.replug()
    host.open_cable()
    host.wait(50_000)
    rig.close()
    assert host.decode()[0].counters[0] == 0


def test_a_board_that_is_not_booted_says_so() -> None:
    board = ImageBoard()
    with pytest.raises(RigFault, match="boot the board"):
        board.receive(board_messages.identify())
    board.close()
