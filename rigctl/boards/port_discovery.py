"""Serial ports and the boards on them: create links, identify boards, list ports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from serial.tools import list_ports

from rigctl.boards import drum_registers, taxel_frames
from rigctl.boards.drum import Drum
from rigctl.boards.links import SCHEME, ByteLink, SerialLink, TcpLink
from rigctl.boards.taxel_frames import CYCLES_PER_US
from rigctl.boards.taxels import Taxels
from rigctl.errors import LinkLost, RigFault
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT
from rigctl.values import DRUM, FINGER, TAXELS, BoardIdentity

COUNTERS = (
    "late_ticks",
    "longest_isr_us",
    "free_stack_bytes",
    "idle_permille",
    "loadcell_dropped",
    "settings_from",
)
"""Registers of the drum with what it counted since its boot."""
TAXELS_BATCH_S = 0.01
"""The taxel stream is read in batches of 10 ms: its thread wakes 100 times a second."""
FINGER_BATCH_S = 0.002
"""The finger's windows are awaited: its thread wakes 500 times a second."""
FINGER_BAUD = 115_200
"""Over USB the board sends as fast as it can, whatever the baud rate."""


_DRIVERS: dict[str, Callable[[ByteLink, asyncio.AbstractEventLoop], Any]] = {
    TAXELS: Taxels,
    FINGER: lambda *opened: EXPERIMENTS[FINGER_EXPERIMENT].load("driver")(*opened),
    DRUM: Drum,
}
"""The drum comes last: while the others are asked, a bootloader that its board may have is gone."""
_SETTINGS = {
    DRUM: (drum_registers.BAUD, 0.0),
    TAXELS: (taxel_frames.BAUD, TAXELS_BATCH_S),
    FINGER: (FINGER_BAUD, FINGER_BATCH_S),
}
"""Baud rate and batches of each board's port."""


@dataclass(frozen=True, slots=True)
class PortReport:
    """A port, and the identity of its board or an ``error`` sentence why there is none.

    Only a taxel board reports ``supply_v`` and ``self_test``, the findings. ``counters`` are
    those of :data:`COUNTERS` of a drum board, of a taxel board the ones that its status holds.
    """

    port: str
    description: str
    identity: BoardIdentity | None = None
    error: str = ""
    supply_v: float | None = None
    self_test: tuple[str, ...] | None = None
    counters: Mapping[str, int] = field(default_factory=dict)


def create_link(
    port: str, board: str, loop: asyncio.AbstractEventLoop, baud: int | None = None
) -> ByteLink:
    """Return a closed link with the settings of ``board``.

    ``port`` is a serial port, or ``tcp://HOST:PORT`` of ``rigctl serve``. ``baud``: of somebody
    else's board in its place, which opening the port is not known to reset.
    """
    if port.startswith(SCHEME):
        return TcpLink(port, loop)
    # The USB of a Teensy is its own: opening its port resets nothing.
    usual, batch_s = _SETTINGS[board]
    return SerialLink(port, baud or usual, loop, batch_s, board != FINGER and baud is None)


async def read_identity(port: str, board: str, loop: asyncio.AbstractEventLoop) -> BoardIdentity:
    """Return the identity of the ``board`` on ``port``. Raises as the drivers' connect."""
    link = create_link(port, board, loop)
    try:
        identity = (await _report(PortReport(port, ""), link, board, loop)).identity
        assert identity is not None
        return identity
    finally:
        link.close()


async def identify_board(
    link: ByteLink, board: str, loop: asyncio.AbstractEventLoop
) -> BoardIdentity | None:
    """Return the identity of the ``board`` at an open link, None where it does not answer."""
    try:
        return (await _report(PortReport(link.name, ""), link, board, loop)).identity
    except RigFault:
        return None


async def _report(
    report: PortReport, link: ByteLink, board: str, loop: asyncio.AbstractEventLoop
) -> PortReport:
    """Connect ``board`` over ``link`` and return the report with what it reports.

    Where another board is there, the link stays open: opening it again would reset that board.
    """
    if isinstance(link, SerialLink):
        link.retune(*_SETTINGS[board])
    device = _DRIVERS[board](link, loop)
    report = replace(report, identity=await device.connect())
    try:
        if isinstance(device, Taxels):
            return _add_taxel_status(report, device)
        if isinstance(device, Drum):
            counts = await device.get(*COUNTERS)
            return replace(report, counters={name: round(counts[name]) for name in COUNTERS})
        return report
    finally:
        device.close()


def _add_taxel_status(report: PortReport, taxels: Taxels) -> PortReport:
    self_test = tuple(taxels.findings) if taxels.self_test else None
    status = taxels.status
    if status is None:
        return replace(report, self_test=self_test)
    counters = {
        "late_ticks": status.late_slots,
        "longest_isr_us": round(status.longest_isr_cycles / CYCLES_PER_US),
        "free_stack_bytes": status.free_stack_bytes,
        "idle_permille": status.idle_permille,
    }
    supply_v = status.supply_mv / 1000 if status.supply_mv else None
    return replace(report, supply_v=supply_v, self_test=self_test, counters=counters)


async def probe_port(port: str, description: str, loop: asyncio.AbstractEventLoop) -> PortReport:
    """Return a report of one port, which is opened once and asked for each board."""
    link = create_link(port, TAXELS, loop)
    return replace(await probe_link(link, loop), description=description)


async def probe_link(link: ByteLink, loop: asyncio.AbstractEventLoop) -> PortReport:
    """Return a report of a link, which is opened once, asked for each board, and closed."""
    errors = []
    try:
        for board in _DRIVERS:
            try:
                return await _report(PortReport(link.name, ""), link, board, loop)
            except LinkLost as lost:
                errors.append(str(lost))
                if "answered" not in errors[-1]:
                    break
            except RigFault as refusal:
                errors.append(str(refusal))
    finally:
        link.close()
    # The driver whose board it is knows most; the others heard nothing or foreign bytes.
    error = min(errors, key=_vagueness).removeprefix(f"{link.name}: ")
    if "answered" in error:
        error = "no rigctl board answered"
    return PortReport(link.name, "", error=error)


def _vagueness(error: str) -> int:
    return 2 * ("answered" in error) + ("no complete reply" in error)


async def probe_ports(
    loop: asyncio.AbstractEventLoop, ports: Sequence[str] = ()
) -> list[PortReport]:
    """Return reports of ``ports``, by default of all serial ports; probes them concurrently."""
    found = [(port, "") for port in ports] or [
        (info.device, info.description or "") for info in sorted(list_ports.comports())
    ]
    return list(await asyncio.gather(*(probe_port(port, text, loop) for port, text in found)))


async def find_boards(loop: asyncio.AbstractEventLoop) -> dict[str, str]:
    """Return the port of each board that answers, by the board's name."""
    reports = await probe_ports(loop)
    return {r.identity.board: r.port for r in reports if r.identity is not None}
