"""Which ports there are, what opens them, and who answers where."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from serial.tools import list_ports

from rigctl.devices.drum import Drum
from rigctl.devices.links.byte_link import ByteLink
from rigctl.devices.links.serial import SerialLink
from rigctl.devices.links.tcp import SCHEME, TcpLink
from rigctl.devices.taxels import Taxels
from rigctl.errors import LinkLost, RigFault
from rigctl.values import BoardIdentity
from rigctl.wire.drum import register_table
from rigctl.wire.taxels import frames as taxels
from rigctl.wire.taxels.frames import CYCLES_PER_US, TaxelStatus

DRUM, TAXELS = "drum", "taxels"
COUNTERS = (
    "late_ticks",
    "longest_isr_us",
    "free_stack_bytes",
    "idle_permille",
    "loadcell_dropped",
    "settings_from",
)
"""What the drum board counted since its boot, as its register table names it."""
TAXELS_GATHER_S = 0.01
"""The stream of the taxels is read in pieces of 10 ms; one thread wakes 100 times a second."""


@dataclass(frozen=True, slots=True)
class PortReport:
    """A port, and who answered on it: an identity, or a sentence why nobody did.

    ``supply_v`` and ``self_test``, what it found, are known of a taxel board only. ``counters``:
    of a drum board by the names of :data:`COUNTERS`, of a taxel board by those of them that
    its status tells too.
    """

    port: str
    description: str
    identity: BoardIdentity | None
    text: str
    supply_v: float | None = None
    self_test: tuple[str, ...] | None = None
    counters: Mapping[str, int] = field(default_factory=dict)


def open_link(port: str, board: str, loop: asyncio.AbstractEventLoop) -> ByteLink:
    """A link, not opened yet, with the settings of ``board``.

    ``port`` is a serial port, or ``tcp://HOST:PORT`` of ``rigctl serve``.
    """
    if port.startswith(SCHEME):
        return TcpLink(port, loop)
    if board == DRUM:
        return SerialLink(port, register_table.BAUD, loop)
    return SerialLink(port, taxels.BAUD, loop, TAXELS_GATHER_S)


async def ask(port: str, board: str, loop: asyncio.AbstractEventLoop) -> BoardIdentity:
    """Ask ``port`` in the language of ``board``; the port is closed again. Raises RigFault."""
    report = await _ask(port, "", board, loop)
    assert report.identity is not None
    return report.identity


async def _ask(
    port: str, description: str, board: str, loop: asyncio.AbstractEventLoop
) -> PortReport:
    link = open_link(port, board, loop)
    device = Drum(link, loop) if board == DRUM else Taxels(link, loop)
    try:
        identity = await device.connect()
        report = PortReport(port, description, identity, "")
        if isinstance(device, Taxels):
            return _with_health(report, device)
        found = await device.get(*COUNTERS)
        return replace(report, counters={name: round(found[name]) for name in COUNTERS})
    finally:
        device.close()


def _with_health(report: PortReport, taxels: Taxels) -> PortReport:
    status = taxels.status
    millivolts = status.supply_mv if status else 0
    return replace(
        report,
        supply_v=millivolts / 1000 if millivolts else None,
        self_test=tuple(taxels.findings) if taxels.self_test else None,
        counters=_counted(status) if status else {},
    )


def _counted(status: TaxelStatus) -> dict[str, int]:
    return {
        "late_ticks": status.late_slots,
        "longest_isr_us": round(status.longest_isr_cycles / CYCLES_PER_US),
        "free_stack_bytes": status.free_stack_bytes,
        "idle_permille": status.idle_permille,
    }


async def look(port: str, description: str, loop: asyncio.AbstractEventLoop) -> PortReport:
    """Ask one port in both languages."""
    reason = ""
    for board in (DRUM, TAXELS):
        try:
            return await _ask(port, description, board, loop)
        except LinkLost as lost:
            reason = str(lost)
            if "answered" not in reason:
                break
        except RigFault as refusal:
            reason = str(refusal)
    return PortReport(port, description, None, _nobody(port, reason))


async def look_at_all(
    loop: asyncio.AbstractEventLoop, ports: Sequence[str] = ()
) -> list[PortReport]:
    """Ask every serial port there is, or those named, all at once."""
    found = [(port, "") for port in ports] or [
        (info.device, info.description or "") for info in sorted(list_ports.comports())
    ]
    return list(await asyncio.gather(*(look(port, text, loop) for port, text in found)))


async def find_boards(loop: asyncio.AbstractEventLoop) -> dict[str, str]:
    """The port of each board that answers, by the board's name."""
    reports = await look_at_all(loop)
    return {r.identity.board: r.port for r in reports if r.identity is not None}


def _nobody(port: str, reason: str) -> str:
    if "answered" in reason:
        return "no rigctl board answered"
    return reason.removeprefix(f"{port}: ")
