"""The taxel board's side of its wire: encode what :class:`FrameDecoder` decodes."""

from __future__ import annotations

import struct
import zlib
from dataclasses import astuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rigctl.boards import taxel_decoder, taxel_frames
from rigctl.boards.taxel_frames import SelfTest, TaxelIdentity, TaxelStatus, frame

_STATUS = struct.Struct("<BBIIHHHBHHHHB")
_IDENTITY = struct.Struct("<BHBBHIBHHBHB")
_SELF_TEST = struct.Struct("<BB9B3s3sx")


def unframe(chunk: bytes) -> bytes | None:
    """Return the body of the bytes between two zeros, None where they are damaged or empty."""
    try:
        data = cobs_decode(chunk)
    except ValueError:
        return None
    body, crc = data[:-4], data[-4:]
    return body if body and zlib.crc32(body).to_bytes(4, "little") == crc else None


def cobs_decode(data: bytes) -> bytes:
    """Return the bytes of stuffed ``data``, which has no closing zero.

    Raises ValueError where ``data`` holds a zero or ends inside a run, which has at most 253 bytes.
    """
    out = bytearray()
    at = 0
    while at < len(data):
        code = data[at]
        run = data[at + 1 : at + code]
        if code == 0 or 0 in run or len(run) != code - 1:
            raise ValueError(f"byte {at} of {len(data)} does not continue a COBS frame")
        out += run
        at += code
        if at < len(data):
            out.append(0)
    return bytes(out)


def encode_data(
    counters: NDArray[np.int64],
    samples: NDArray[np.uint16],
    flags: NDArray[np.uint8],
    edges: NDArray[np.uint8],
) -> bytes:
    """Return the frames of n samples; the arrays are those of :class:`rigctl.values.Block`."""
    n_taxels = samples.shape[1]
    wire = np.empty((counters.shape[0], taxel_frames.frame_bytes(n_taxels)), np.uint8)
    _encode_rows(counters, samples, flags, edges, wire, taxel_frames.data_body(n_taxels))
    return wire.tobytes()


def encode_status(status: TaxelStatus) -> bytes:
    """Return a status frame; its counters wrap."""
    counter, dropped, *values, rises, bits = astuple(status)
    counter, dropped, rises = counter & 0xFFFFFFFF, dropped & 0xFFFFFFFF, rises & 0xFFFF
    head = (taxel_frames.STATUS, taxel_frames.WIRE_VERSION, counter, dropped)
    return frame(_STATUS.pack(*head, *values, rises, bits))


def encode_identity(identity: TaxelIdentity) -> bytes:
    """Return an identity frame."""
    return frame(_IDENTITY.pack(taxel_frames.IDENTITY, *astuple(identity)))


def encode_self_test(test: SelfTest) -> bytes:
    """Return a frame with the outcome of a self-test."""
    *small, silent, full = astuple(test)
    wide = (silent.to_bytes(3, "little"), full.to_bytes(3, "little"))
    return frame(
        _SELF_TEST.pack(taxel_frames.SELF_TEST_OUTCOME, taxel_frames.WIRE_VERSION, *small, *wide)
    )


@njit(cache=True)
def _encode_rows(
    counters: NDArray[np.int64],
    samples: NDArray[np.uint16],
    flags: NDArray[np.uint8],
    edges: NDArray[np.uint8],
    wire: NDArray[np.uint8],
    size: int,
) -> None:
    """Encode data frames with bodies of ``size`` bytes into the rows of ``wire``."""
    body = np.empty(size + 4, np.uint8)
    edges_at = 10 * samples.shape[1]
    for row in range(counters.shape[0]):
        body[:] = 0
        body[0] = taxel_frames.DATA
        body[1] = counters[row] & 0xFF
        body[2] = counters[row] >> 8 & 0xFF
        body[3] = flags[row]
        for i in range(samples.shape[1]):
            value = np.uint32(samples[row, i] & 0x3FF) << np.uint32(10 * i & 7)
            body[4 + (10 * i >> 3)] |= value & 0xFF
            body[5 + (10 * i >> 3)] |= value >> 8 & 0xFF
        value = np.uint32(edges[row] & 0xF) << np.uint32(edges_at & 7)
        body[4 + (edges_at >> 3)] |= value & 0xFF
        body[5 + (edges_at >> 3)] |= value >> 8 & 0xFF
        crc = np.int64(taxel_decoder.crc32(body, size))
        for i in range(4):
            body[size + i] = crc >> (8 * i) & 0xFF
        _stuff(body, wire, row)


@njit(cache=True)
def _stuff(body: NDArray[np.uint8], wire: NDArray[np.uint8], row: int) -> None:
    """COBS-encode ``body``, at most 253 bytes, and its closing zero into one row of ``wire``."""
    code_at = 0
    for i in range(body.shape[0]):
        if body[i] == 0:
            wire[row, code_at] = i + 1 - code_at
            code_at = i + 1
        else:
            wire[row, i + 1] = body[i]
    wire[row, code_at] = body.shape[0] + 1 - code_at
    wire[row, body.shape[0] + 1] = 0
