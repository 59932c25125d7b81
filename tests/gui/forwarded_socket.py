"""A socket that is forwarded to another one, byte by byte, as ``ssh -L`` does."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def forwarded(here: Path, there: str) -> Iterator[None]:
    """Forward one connection to ``here`` to the socket ``there``."""
    with socket.socket(socket.AF_UNIX) as listener, socket.socket(socket.AF_UNIX) as far:
        listener.bind(str(here))
        listener.listen(1)
        near: list[socket.socket] = []
        threads = [threading.Thread(target=_serve, args=(listener, near, far, there))]
        threads[0].start()
        yield
        for end in (listener, *near, far):
            with suppress(OSError):  # it was closed from the other side
                end.shutdown(socket.SHUT_RDWR)
        threads[0].join()


def _serve(
    listener: socket.socket, accepted: list[socket.socket], far: socket.socket, there: str
) -> None:
    try:
        near, _ = listener.accept()
    except OSError:  # nobody came
        return
    accepted.append(near)
    far.connect(there)
    with near:
        back = threading.Thread(target=_pump, args=(far, near))
        back.start()
        _pump(near, far)
        back.join()


def _pump(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            sink.sendall(data)
    with suppress(OSError):
        sink.shutdown(socket.SHUT_WR)
