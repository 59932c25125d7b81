"""The virtual finger with the board's Cortex-M7 image under QEMU."""

from __future__ import annotations

import shutil
import socket
import struct
import subprocess
import tempfile
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.bench.parameters import WorldParameters
from rigctl.config.resources import firmware_image
from rigctl.errors import RigFault
from rigctl.finger.bench.boards import POWER_ON
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.bench.virtual import VirtualFinger

QEMU = "qemu-system-arm"
SCRIPT_ADDRESS = 0x60000000
SCRIPT_MAGIC = b"FING"
MAX_SCRIPT_BYTES = 16 << 20
ANSWER_TIMEOUT_S = 30.0
_RECORD, _COUNTS = struct.Struct("<II"), struct.Struct("<III")
_OPTIONS = ("-M", "mps2-an500", "-nographic", "-monitor", "none")
_SCRIPT_OPTIONS = ("-serial", "null", "-semihosting", "-icount", "shift=0")


class Line(IntEnum):
    """The lines into the board, as ``arduino/finger/mps2/script.cpp`` numbers them."""

    HOST = 1
    TAXELS = 2
    CONVERTER = 3


@dataclass(frozen=True, slots=True)
class InstructionCount:
    """Instructions of the samples of a script: the longest sample, the mean, the number."""

    longest: int
    mean: float
    samples: int


@dataclass(slots=True)
class Script:
    """Bytes for the board's lines in the order in which it receives them."""

    _parts: list[bytes] = field(default_factory=lambda: [SCRIPT_MAGIC])

    def add(self, line: Line, data: bytes) -> None:
        """Append bytes to a line; samples of the converter are uint16 (n, 9)."""
        padding = bytes(-len(data) % 4)
        self._parts.append(_RECORD.pack(line, len(data)) + data + padding)

    def to_bytes(self) -> bytes:
        """Return the script as the image reads it. Raises RigFault above 16 MiB."""
        content = b"".join([*self._parts, _RECORD.pack(0, 0)])
        if len(content) > MAX_SCRIPT_BYTES:
            raise RigFault("the script does not fit into the board's memory: use shorter scripts")
        return content


def _command(*options: str) -> list[str]:
    if shutil.which(QEMU) is None:
        raise RigFault(f"{QEMU} is missing: install Debian's qemu-system-arm")
    return [QEMU, *_OPTIONS, *options, "-kernel", str(firmware_image("finger"))]


def run_script(script: Script) -> tuple[bytes, InstructionCount]:
    """Run a script on the image; return the bytes that the board sent, and their cost.

    Raises RigFault if QEMU is missing or fails.
    """
    with tempfile.NamedTemporaryFile(suffix=".bin") as file:
        file.write(script.to_bytes())
        file.flush()
        loader = f"loader,file={file.name},addr={SCRIPT_ADDRESS:#x},force-raw=on"
        command = _command(*_SCRIPT_OPTIONS, "-device", loader)
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode or len(done.stdout) < _COUNTS.size:
        raise RigFault(f"{QEMU} failed: {done.stderr.decode(errors='replace').strip()}")
    longest, thousands, samples = _COUNTS.unpack(done.stdout[-_COUNTS.size :])
    count = InstructionCount(longest, thousands * 1000 / samples if samples else 0.0, samples)
    return done.stdout[: -_COUNTS.size], count


class FingerImage:
    """The running image between two serial lines: a context that ends QEMU with it."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        names = [str(Path(self._folder.name) / line) for line in ("host", "taxels")]
        listeners = [_listen(name) for name in names]
        serials = [text for name in names for text in ("-serial", f"unix:{name}")]
        self._process = subprocess.Popen(
            _command(*serials), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        self._host, self._taxels = (_accept(listener) for listener in listeners)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._host.close()
        self._taxels.close()
        self._process.kill()  # it has no disk to save, and would report a request to end
        self._process.wait()
        self._folder.cleanup()

    def receive(self, data: bytes) -> None:
        """Pass bytes from the host."""
        self._host.sendall(data)

    def receive_taxels(self, data: bytes) -> None:
        """Pass bytes from the taxel board."""
        self._taxels.sendall(data)

    def read(self, size: int) -> bytes:
        """Wait for ``size`` bytes to the host. Raises RigFault if the board sends no more."""
        received = b""
        while len(received) < size:
            try:
                data = self._host.recv(size - len(received))
            except TimeoutError:
                data = b""
            if not data:
                raise RigFault(f"the finger's image sent {len(received)} of {size} bytes")
            received += data
        return received


def _listen(path: str) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(path)
    listener.listen(1)
    listener.settimeout(ANSWER_TIMEOUT_S)
    return listener


def _accept(listener: socket.socket) -> socket.socket:
    with listener:
        connection, _ = listener.accept()
    connection.settimeout(ANSWER_TIMEOUT_S)
    return connection


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
