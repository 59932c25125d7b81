"""Links to boards: the interface, serial ports and TCP sockets, and who gets what arrives."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, ParamSpec, Protocol

import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from rigctl.errors import ConfigError, LinkLost

OnBytes = Callable[[bytes, float], None]
"""Called in the loop's thread with bytes and the loop time of their arrival."""
OnLost = Callable[[str], None]
"""Called in the loop's thread, once, with a sentence: the port vanished."""


class ByteLink(Protocol):
    """A serial port, a socket or a simulated cable. All calls come from the loop's thread."""

    name: str
    resets_board: bool
    """Whether opening it resets the board, as a serial port does most Arduinos."""

    @property
    def is_open(self) -> bool:
        """True from a successful :meth:`open` until the link is closed or lost."""
        ...

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Open the port and start reading; its owner may open it again, which changes nothing.

        Raises LinkLost with one sentence.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send bytes. Raises LinkLost where the link is not open."""
        ...

    def close(self) -> None:
        """Stop reading and free the port; closing twice is harmless."""
        ...


Values = ParamSpec("Values")


class Consumers(Generic[Values]):
    """Callbacks that get each value in order; one that raises is reported and dropped."""

    def __init__(self, on_failure: Callable[[Exception], None]) -> None:
        self._on_failure = on_failure
        self._callbacks: list[Callable[Values, None]] = []

    def add(self, callback: Callable[Values, None]) -> None:
        """Call ``callback`` with every value from now on."""
        self._callbacks.append(callback)

    def remove(self, callback: Callable[Values, None]) -> None:
        """Call it no more; it may have been dropped already."""
        if callback in self._callbacks:
            self._callbacks.remove(callback)

    def publish(self, *args: Values.args, **kwargs: Values.kwargs) -> None:
        """Pass a value to all consumers."""
        for callback in tuple(self._callbacks):
            try:
                callback(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 - becomes a visible fault, reading continues
                self._callbacks.remove(callback)
                self._on_failure(error)


READ_SIZE = 65536
WINDOWS_BUFFER = 65536
"""Windows buffers 4,096 bytes by default: 0.2 s of taxels."""
READ_TIMEOUT_S = 0.05
"""How long a read for a first byte blocks before the thread checks whether to stop."""
WRITE_TIMEOUT_S = 0.2
DTR_PULSE_S = 0.1
"""A capacitor makes a short pulse of the falling line; it charges again in a few milliseconds."""


UsbDevice = tuple[int, int, str]
"""Vendor, product, and serial number; without one, as many clones are, the socket that it is in."""


def _usb_device(info: ListPortInfo) -> UsbDevice | None:
    """Return which device a port is, None for one that is not USB."""
    if info.vid is None:
        return None
    return info.vid, info.pid, info.serial_number or info.location or ""


class SerialLink:
    """One serial port, opened exclusively.

    ``batch_s`` 0 delivers bytes as they come, which suits requests and replies; for a stream,
    batches of 10 ms cost less. A thread reads; all other calls come from the loop's thread.

    Opening the port raises DTR, which resets an Uno, a Nano or a Mega. Where the system allows it
    (not on Windows), DTR stays up after a close, so that the next open resets nothing.

    A USB device that comes back under another name is opened under that one, the new ``name``.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        loop: asyncio.AbstractEventLoop,
        batch_s: float = 0.0,
        resets_board: bool = True,
    ) -> None:
        self.name = port
        self.resets_board = resets_board
        self._baud = baud
        self._loop = loop
        self._batch_s = batch_s
        self._device: UsbDevice | None = None
        self._port: serial.Serial | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._on_bytes: OnBytes | None = None
        self._on_lost: OnLost | None = None

    @property
    def is_open(self) -> bool:
        """True from a successful open until closed or lost."""
        return self._port is not None

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Open the port and start to read; on most Arduinos this resets the board.

        An open port only gets other callbacks.
        """
        self._on_bytes, self._on_lost = on_bytes, on_lost
        if self._port is not None:
            return
        self._port = port = self._open_port()
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=self._read, args=(port, self._stop), name=f"read {self.name}", daemon=True
        )
        self._thread.start()

    def retune(self, baud: int, batch_s: float) -> None:
        """Change baud rate and batches, without a reset where the port is open."""
        self._baud, self._batch_s = baud, batch_s
        if self._port is not None:
            try:
                self._port.baudrate = baud
                self._port.timeout = batch_s or READ_TIMEOUT_S
            except (serial.SerialException, OSError, ValueError) as error:
                raise LinkLost(self._lost_text(error)) from error

    async def reset_board(self) -> None:
        """Reset the board behind the open port by its line DTR, as programmers do."""
        if self._port is not None:
            for level in (False, True):
                # A pseudo-terminal has no such line.
                with suppress(serial.SerialException, OSError):
                    self._port.dtr = self._port.rts = level
                await asyncio.sleep(DTR_PULSE_S)

    def write(self, data: bytes) -> None:
        """Send bytes. Raises LinkLost where the port is closed or accepts no bytes."""
        if self._port is None:
            raise LinkLost(f"{self.name}: the port is closed: connect the board again")
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise LinkLost(self._lost_text(error)) from error

    def close(self) -> None:
        """Stop the reading thread and free the port."""
        port, thread = self._port, self._thread
        self._port = self._thread = self._on_bytes = self._on_lost = None
        self._stop.set()
        if port is not None and thread is not None:
            with suppress(serial.SerialException, OSError, AttributeError):
                port.cancel_read()
            thread.join()
            with suppress(serial.SerialException, OSError):
                port.close()

    def _open_port(self) -> serial.Serial:
        names = {info.device: _usb_device(info) for info in list_ports.comports()}
        present = os.path.realpath(self.name)
        same = [name for name, device in names.items() if device == self._device]
        if self._device is not None and same and present not in same:
            self.name = present = same[0]
        try:
            port = serial.Serial(
                self.name,
                self._baud,
                timeout=self._batch_s or READ_TIMEOUT_S,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True if os.name == "posix" else None,
            )
        except (serial.SerialException, OSError, ValueError) as error:
            raise LinkLost(f"{self.name}: {_open_error_text(error)}") from error
        _reduce_latency(port)
        _keep_dtr(port)
        self._device = self._device or names.get(present)
        return port

    def _read(self, port: serial.Serial, stop: threading.Event) -> None:
        """Deliver bytes to the loop until ``stop`` is set or the port is lost; runs in a thread."""
        try:
            while not stop.is_set():
                data = self._read_batch(port)
                if data:
                    self._loop.call_soon_threadsafe(self._deliver, stop, data, self._loop.time())
        except (serial.SerialException, OSError, TypeError) as error:
            # pyserial raises TypeError where the port was closed under a read.
            if not stop.is_set():
                with suppress(RuntimeError):
                    self._loop.call_soon_threadsafe(self._lose, stop, self._lost_text(error))
        except RuntimeError:
            # The loop is closed.
            stop.set()

    def _read_batch(self, port: serial.Serial) -> bytes:
        if self._batch_s:
            return port.read(READ_SIZE)
        return port.read(1) + port.read(port.in_waiting)

    def _deliver(self, stop: threading.Event, data: bytes, at_s: float) -> None:
        if not stop.is_set() and self._on_bytes is not None:
            self._on_bytes(data, at_s)

    def _lose(self, stop: threading.Event, reason: str) -> None:
        on_lost = self._on_lost
        if not stop.is_set() and on_lost is not None:
            self.close()
            on_lost(reason)

    def _lost_text(self, error: Exception) -> str:
        return f"{self.name}: the port vanished, plug the board in again ({error})"


def _open_error_text(error: Exception) -> str:
    """Return why opening failed and what to do."""
    number = getattr(error, "errno", None)
    if number == errno.ENOENT or "FileNotFoundError" in str(error):
        return "there is no such port: plug the board in; rigctl ports lists what is there"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return "the port is in use: close the program that holds it"
    if number == errno.EACCES or "PermissionError" in str(error):
        return "the port may not be opened: join the group dialout, or close what holds it"
    return f"the port cannot be opened ({error}): plug the board in again"


def _keep_dtr(port: serial.Serial) -> None:
    """Let the system leave DTR up when the port is closed: dropped, the next open would reset."""
    if os.name == "posix":
        import termios

        with suppress(termios.error):
            settings = termios.tcgetattr(port.fileno())
            settings[2] &= ~termios.HUPCL
            termios.tcsetattr(port.fileno(), termios.TCSANOW, settings)


def _reduce_latency(port: serial.Serial) -> None:
    """Set low latency and large buffers where the driver supports them."""
    for setting, value in (("set_low_latency_mode", True), ("set_buffer_size", WINDOWS_BUFFER)):
        apply = getattr(port, setting, None)
        if apply is not None:
            with suppress(serial.SerialException, OSError, ValueError, NotImplementedError):
                apply(value)


SCHEME = "tcp://"
CONNECT_TIMEOUT_S = 2.0
TCP_READ_SIZE = 65536


class TcpLink:
    """One TCP connection; ``address`` is ``tcp://HOST:PORT``. Needs a selector loop."""

    def __init__(self, address: str, loop: asyncio.AbstractEventLoop) -> None:
        self.name = address
        self.resets_board = False
        self._address = _host_and_port(address)
        self._loop = loop
        self._socket: socket.socket | None = None
        self._on_bytes: OnBytes | None = None
        self._on_lost: OnLost | None = None

    @property
    def is_open(self) -> bool:
        """True from a successful open until closed or lost."""
        return self._socket is not None

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Connect, unless connected. Raises LinkLost where no server listens."""
        self._on_bytes, self._on_lost = on_bytes, on_lost
        if self._socket is not None:
            return
        try:
            connection = socket.create_connection(self._address, CONNECT_TIMEOUT_S)
        except OSError as error:
            raise LinkLost(
                f"{self.name}: no server listens there: start rigctl serve ({error})"
            ) from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        self._socket = connection
        self._loop.add_reader(connection, self._receive)

    def write(self, data: bytes) -> None:
        """Send bytes. Raises LinkLost where the connection is closed or broken."""
        if self._socket is None:
            raise LinkLost(f"{self.name}: the connection is closed: connect the board again")
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise LinkLost(f"{self.name}: the connection broke ({error})") from error

    def close(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
        self._socket = self._on_bytes = self._on_lost = None

    def _receive(self) -> None:
        assert self._socket is not None
        try:
            data = self._socket.recv(TCP_READ_SIZE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data and self._on_bytes is not None:
            self._on_bytes(data, self._loop.time())
        elif not data:
            on_lost = self._on_lost
            self.close()
            if on_lost is not None:
                on_lost(f"{self.name}: the other end closed the connection")


def _host_and_port(address: str) -> tuple[str, int]:
    host, colon, port = address.removeprefix(SCHEME).rpartition(":")
    if not address.startswith(SCHEME) or not colon or not port.isdecimal():
        raise ConfigError(f"{address}: write an address as tcp://127.0.0.1:5020")
    return host, int(port)
