"""The serial ports and the board on each, as ``rigctl ports`` lists them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gui.tools.command_page import CommandPage


class PortsPage(CommandPage):
    """All ports of this computer; ``refusal`` returns why a board may not be reset now."""

    def __init__(self, refusal: Callable[[], str]) -> None:
        explanation = (
            "Asks the board on every serial port for its name, firmware and self-test, as "
            "rigctl ports does. Opening a port resets its board, whose bootloader is left in peace "
            "for two seconds first."
        )
        super().__init__(
            "Serial ports",
            explanation,
            "List the ports",
            words=lambda: ("ports",),
            refusal=refusal,
            success=_count_ports,
        )


def _count_ports(lines: Sequence[str]) -> str:
    """Return how many ports there are."""
    ports = [line for line in lines if not line.startswith(" ") and ": " in line]
    if lines[0].startswith("no serial port"):
        return lines[0]
    return f"{len(ports)} port{'' if len(ports) == 1 else 's'}"
