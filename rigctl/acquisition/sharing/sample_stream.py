"""Live data over the engine's socket, for a client that cannot share the engine's memory.

The event ``samples`` has in its data the new rows of both rings and the range of the encoder:
``{"taxels": {"rows": n, "bytes": base64}, "other": {…}, "range": base64}``. The bytes of a ring are
its columns one after the other, little-endian, as its layout declares them.
"""

from __future__ import annotations

import base64
import binascii
import sys
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from rigctl.acquisition.live_file import LiveFile, LiveLayout, RingBuffer, RingColumns
from rigctl.acquisition.rpc.messages import encode_message, engine_message
from rigctl.acquisition.rpc.queues.connected_client import ConnectedClient
from rigctl.errors import LinkLost

MAX_ROWS = 2048
"""In one message; a client that is further behind misses the rows between."""

_Text = Annotated[str, Meta(max_length=1 << 20)]


class RingMessage(msgspec.Struct, frozen=True):
    """New rows of one ring."""

    rows: Annotated[int, Meta(ge=0, le=MAX_ROWS)]
    bytes: _Text


class SamplesMessage(msgspec.Struct, frozen=True):
    """The data of an event ``samples``."""

    taxels: RingMessage
    other: RingMessage
    range: _Text


class SampleStream:
    """Sends the rows that are new since the last time to each of its clients."""

    def __init__(self, file: LiveFile) -> None:
        self._file = file
        self._heads: dict[ConnectedClient, tuple[int, int]] = {}

    def add(self, client: ConnectedClient) -> None:
        """Send to a client from now on; it gets the newest rows first."""
        self._heads.setdefault(client, (0, 0))

    def remove(self, client: ConnectedClient) -> None:
        """Send nothing more to a client."""
        self._heads.pop(client, None)

    def send(self) -> None:
        """Send each client what is new, unless it has much unread."""
        for client, (taxels, other) in tuple(self._heads.items()):
            if not client.takes_samples:
                continue
            rings = (self._file.taxels, self._file.other)
            self._heads[client] = (rings[0].head, rings[1].head)
            if taxels:
                client.leave_out_rows(max(0, rings[0].head - taxels - MAX_ROWS))
            data = {
                "taxels": _ring_message(rings[0], taxels),
                "other": _ring_message(rings[1], other),
                "range": _text(self._file.copy_range()),
            }
            client.send(encode_message(engine_message("samples", "", data)))


def append_samples(file: LiveFile, layout: LiveLayout, data: Mapping[str, Any]) -> None:
    """Append the rows of a message to live data of this computer.

    Raises LinkLost where the message is not what an engine sends.
    """
    try:
        message = msgspec.convert(data, SamplesMessage)
        taxels = _columns(message.taxels, layout.taxel_columns)
        other = _columns(message.other, layout.other_columns)
        limits = _array(message.range, np.dtype(np.uint16), (2, layout.n_taxels))
    except (ValueError, binascii.Error) as error:
        raise LinkLost(
            f"the engine's stream of samples is damaged ({error}): connect again; if it happens "
            "again, both computers need the same version of rigctl"
        ) from error
    file.taxels.append(message.taxels.rows, **taxels)
    file.other.append(message.other.rows, **other)
    if not np.array_equal(limits, file.copy_range()):
        file.set_range(limits[0], limits[1])


def _ring_message(ring: RingBuffer, sent: int) -> dict[str, Any]:
    _, columns = ring.newest(min(MAX_ROWS, ring.head - sent))
    rows = len(next(iter(columns.values())))
    return {"rows": rows, "bytes": _text(*columns.values())}


def _text(*arrays: NDArray[Any]) -> str:
    return base64.b64encode(b"".join(_little(array).tobytes() for array in arrays)).decode()


def _little(array: NDArray[Any]) -> NDArray[Any]:
    return array if sys.byteorder == "little" else array.astype(array.dtype.newbyteorder("<"))


def _columns(message: RingMessage, columns: RingColumns) -> dict[str, NDArray[Any]]:
    """Return a ring's columns by name. Raises ValueError for another number of bytes."""
    data = base64.b64decode(message.bytes, validate=True)
    row_bytes = sum(dtype.itemsize for dtype in columns.values())
    if len(data) != message.rows * row_bytes:
        raise ValueError(f"{len(data)} bytes for {message.rows} rows of {row_bytes}")
    found, start = {}, 0
    for name, dtype in columns.items():
        stop = start + message.rows * dtype.itemsize
        little = np.frombuffer(data[start:stop], dtype.base.newbyteorder("<"))
        found[name] = little.reshape(message.rows, *dtype.shape)
        start = stop
    return found


def _array(text: str, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    data = base64.b64decode(text, validate=True)
    return np.frombuffer(data, dtype.newbyteorder("<")).reshape(shape)
