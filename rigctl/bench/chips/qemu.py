"""The finger board's real image on a simulated Cortex-M7 (QEMU's MPS2 board, Arm AN500).

QEMU counts instructions, not cycles. The board's clock is its samples, so its output depends on the
order of the bytes it receives alone.
"""

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

from rigctl.config.resources import firmware_image
from rigctl.errors import RigFault

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
