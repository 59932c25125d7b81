"""Any tracker from one line of text."""

from __future__ import annotations

import asyncio
from pathlib import Path
from urllib.parse import parse_qsl

from rigctl.devices.links.byte_link import ByteLink
from rigctl.devices.links.serial import SerialLink
from rigctl.devices.links.tcp import SCHEME, TcpLink
from rigctl.devices.trackers.imu_tracker import ImuTracker
from rigctl.devices.trackers.openvr_tracker import OpenVrTracker
from rigctl.devices.trackers.recorded_track import RecordedTrack, read_track
from rigctl.devices.trackers.serial_tracker import SerialTracker
from rigctl.devices.trackers.tracker import Tracker
from rigctl.devices.trackers.udp_tracker import UdpTracker
from rigctl.errors import WrongUse

SPECS = "serial:PORT, udp:PORT, file:PATH, imu:PORT, vive or vive:SERIAL"
DEFAULT_BAUD = 115_200
LONGEST_LATENCY_MS = 90.0
"""A velocity is due within the batch after its own."""


def open_tracker(spec: str, loop: asyncio.AbstractEventLoop) -> Tracker:
    """Return the tracker, not yet open, that ``spec`` names: ``serial:/dev/ttyACM1``.

    Sources with a port take options: ``serial:/dev/ttyACM1?baud=921600&latency_ms=8``. Raises
    WrongUse for a text that names none.
    """
    kind, _, rest = spec.partition(":")
    if kind == "file":
        path = Path(rest)
        return RecordedTrack(read_track(path), loop, f"track {path.name}")
    if kind == "vive":
        return OpenVrTracker(loop, rest)
    place, _, query = rest.partition("?")
    options = _Options(spec, query)
    baud, latency_s = options.baud, options.latency_s
    if kind == "serial" and place:
        return SerialTracker(_link(place, baud, loop), loop, latency_s)
    if kind == "imu" and place:
        return ImuTracker(_link(place, baud, loop), loop, latency_s)
    if kind == "udp" and place.isdecimal() and 0 < int(place) < 65536:
        return UdpTracker(int(place), loop, latency_s)
    raise WrongUse(f"{spec!r} names no tracker: write {SPECS}")


class _Options:
    """Options behind the question mark of a tracker's text."""

    def __init__(self, spec: str, query: str) -> None:
        self._spec = spec
        self._given = dict(parse_qsl(query, keep_blank_values=True))
        unknown = self._given.keys() - {"baud", "latency_ms"}
        if unknown or (query and not self._given):
            raise WrongUse(f"{spec!r}: options are baud and latency_ms")
        self.baud = round(self._number("baud", DEFAULT_BAUD, 300, 12e6))
        self.latency_s = self._number("latency_ms", 0.0, 0.0, LONGEST_LATENCY_MS) / 1000.0

    def _number(self, name: str, default: float, low: float, high: float) -> float:
        try:
            value = float(self._given.get(name, default))
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise WrongUse(f"{self._spec!r}: {name} must be a number from {low:g} to {high:g}")
        return value


def _link(port: str, baud: int, loop: asyncio.AbstractEventLoop) -> ByteLink:
    return TcpLink(port, loop) if port.startswith(SCHEME) else SerialLink(port, baud, loop)
