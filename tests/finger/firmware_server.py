"""Boards behind a TCP port, in a thread: what a wrong ``finger.toml`` meets."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress

import numpy as np

from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.boards.drum_registers import MAGIC
from rigctl.boards.taxel_frames import frame
from rigctl.finger.board_messages import BATCH_SAMPLES, BOARD_FINGER, WIRE_VERSION
from rigctl.finger.board_messages import N_TAXELS as FINGER_TAXELS

TICK_S = 0.01
IDENTITY_TYPE = 0x30
Answer = Callable[[bytes], bytes]
"""Returns what a board sends in the next 10 ms, given the bytes that came."""


@contextmanager
def serve_taxel_board() -> Iterator[str]:
    """Serve the taxel board's own firmware; yield its port."""
    board = TaxelFirmware()
    board.boot(1)

    def answer(received: bytes) -> bytes:
        if received:
            board.receive(received)
        board.run(np.full((round(TICK_S * 1000), board.lines * board.inputs), 100, np.uint16))
        return board.take_sent()

    with closing(board), _served(answer) as port:
        yield port


@contextmanager
def serve_finger_identity(wire_version: int = WIRE_VERSION) -> Iterator[str]:
    """Serve a board that answers each request with its identity; yield its port."""
    body = struct.pack(
        "<BHBBHIBHB",
        IDENTITY_TYPE,
        MAGIC,
        wire_version,
        BOARD_FINGER,
        0x0102,
        0,
        FINGER_TAXELS,
        1000,
        BATCH_SAMPLES,
    )
    with _served(lambda received: frame(body) if received else b"") as port:
        yield port


@contextmanager
def _served(answer: Answer) -> Iterator[str]:
    stop = threading.Event()
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        listener.settimeout(TICK_S)
        thread = threading.Thread(target=_serve, args=(listener, stop, answer))
        thread.start()
        try:
            yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            stop.set()
            thread.join()


def _serve(listener: socket.socket, stop: threading.Event, answer: Answer) -> None:
    """Serve one client after the other."""
    while not stop.is_set():
        with suppress(TimeoutError, ConnectionError), closing(listener.accept()[0]) as client:
            client.settimeout(TICK_S)
            while not stop.is_set() and (sent := _exchange(client, answer)) is not None:
                client.sendall(sent)


def _exchange(client: socket.socket, answer: Answer) -> bytes | None:
    """Return what the board sends next; None where the client has gone."""
    try:
        received = client.recv(4096)
    except TimeoutError:
        return answer(b"")
    return answer(received) if received else None
