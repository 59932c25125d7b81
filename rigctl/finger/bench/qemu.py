"""The virtual finger with the board's Cortex-M7 image under QEMU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.bench.chips.qemu import FingerImage
from rigctl.bench.parameters import WorldParameters
from rigctl.errors import RigFault
from rigctl.finger.bench.boards import POWER_ON
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.bench.virtual import VirtualFinger

PIECE_SAMPLES = 20
"""Samples that the taxels' line carries before the image's answer is awaited."""


class ImageBoard:
    """The image between its two serial lines; the taxel board's firmware sends it the samples.

    QEMU has no clock in common with this simulation, and a line does not tell when the image has
    nothing more to say. The host build of the same core runs beside it: it tells how many bytes to
    await, and that they are equal. Raises RigFault if QEMU or the image is missing.
    """

    def __init__(self) -> None:
        self._image: FingerImage | None = None
        self._twin = FingerFirmware()
        self._taxels = TaxelFirmware()
        self._sent = b""

    def boot(self) -> None:
        """Boot image and twin. Raises RigFault if QEMU or the image is missing."""
        self._stop_image()
        self._sent = b""
        self._taxels.boot(POWER_ON)
        self._taxels.take_sent()
        self._twin.boot(POWER_ON)
        self._image = FingerImage()
        self._await_answer(self._image)

    def receive(self, data: bytes) -> None:
        image = self._running()
        self._twin.receive(data)
        image.receive(data)
        self._await_answer(image)

    def run(self, readings: NDArray[np.uint16]) -> None:
        image = self._running()
        for first in range(0, len(readings), PIECE_SAMPLES):
            self._taxels.run(readings[first : first + PIECE_SAMPLES])
            frames = self._taxels.take_sent()
            self._twin.receive_taxels(frames)
            image.receive_taxels(frames)
            self._await_answer(image)

    def take_sent(self) -> bytes:
        sent, self._sent = self._sent, b""
        return sent

    def close(self) -> None:
        self._stop_image()
        self._twin.close()
        self._taxels.close()

    def _running(self) -> FingerImage:
        if self._image is None:
            raise RigFault("the finger's image is not running: boot the board")
        return self._image

    def _await_answer(self, image: FingerImage) -> None:
        expected = self._twin.take_sent()
        answer = image.read(len(expected))
        if answer != expected:
            raise RigFault(
                "the finger's image sent other bytes than the host build of its core: "
                "run make firmware"
            )
        self._sent += answer

    def _stop_image(self) -> None:
        if self._image is not None:
            self._image.__exit__(None, None, None)
        self._image = None


def open_qemu_finger(
    parameters: WorldParameters | None = None,
    operator: OperatorParameters | None = None,
    seed: int = 0,
    session: int = 0,
    *,
    tracker: TrackerParameters | None = None,
    first_slide: int = 0,
) -> VirtualFinger:
    """Return a virtual finger whose board is the image under QEMU, fed by the taxel board.

    It behaves as :func:`~rigctl.finger.bench.virtual.open_virtual_finger`, at less than
    real time. Raises RigFault if QEMU or the image is missing.
    """
    return VirtualFinger(
        ImageBoard(),
        parameters or WorldParameters(),
        operator or OperatorParameters(),
        tracker or TrackerParameters(),
        (seed, session),
        first_slide,
    )
