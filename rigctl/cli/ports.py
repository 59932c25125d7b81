"""List serial ports and the board on each.

Query the board on every serial port. Opening a port resets its board, whose bootloader is left in
peace for two seconds first.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from collections.abc import Mapping

from rigctl.boards.boot_silence import AFTER_OPEN_S
from rigctl.boards.drum_codes import SettingsFrom, reset_cause_text
from rigctl.boards.port_discovery import PortReport, probe_ports
from rigctl.values import BoardIdentity

SILENT_FIRST = (
    f"a board's bootloader may be listening, so each port stays silent for {AFTER_OPEN_S:g} s first"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("port", nargs="*", help="query only these ports")
    parser.add_argument("--json", action="store_true", help="print one JSON list")


def run(args: argparse.Namespace) -> int:
    """Query the ports and print one report for each."""
    print(f"asking every port; {SILENT_FIRST}", file=sys.stderr)
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        reports = runner.run(probe_ports(runner.get_loop(), args.port))
    if args.json:
        print(json.dumps([_as_json(report) for report in reports]))
    elif not reports:
        print("no serial port found: plug a board in")
    for report in reports if not args.json else ():
        print("\n  ".join([_as_line(report), *_findings(report)]))
    return 0


def _as_line(report: PortReport) -> str:
    board = report.identity
    if board is None:
        return f"{report.port}: {report.error}"
    supply = "" if report.supply_v is None else f", supply {report.supply_v:.2f} V"
    boot = f", boot {board.boot_count} by {_reset(board)}" if board.boot_count else ""
    return (
        f"{report.port}: {board.board} board, firmware {board.firmware_version}, "
        f"build {board.build_hash}{boot}{supply}"
    )


def _reset(board: BoardIdentity) -> str | None:
    """Return what reset the board, None for one that does not report it."""
    return reset_cause_text(board.reset_cause) if board.boot_count else None


def _findings(report: PortReport) -> tuple[str, ...]:
    counted = (_counted(report.counters),) if report.counters else ()
    if report.self_test is None:
        return counted
    return (*counted, *(report.self_test or ("self-test: nothing found",)))


def _counted(counters: Mapping[str, int]) -> str:
    stored = counters.get("settings_from")
    settings = "" if stored is None else f", settings {SettingsFrom(stored).name.lower()}"
    return (
        f"{counters['late_ticks']} late ticks, longest interrupt {counters['longest_isr_us']} µs, "
        f"{counters['free_stack_bytes']} bytes of stack never used, idle "
        f"{counters['idle_permille'] / 10:g} %{settings}"
    )


def _as_json(report: PortReport) -> dict[str, object]:
    board = report.identity
    return {
        "port": report.port,
        "description": report.description,
        "board": board and board.board,
        "firmware": board and board.firmware_version,
        "build": board and board.build_hash,
        "boot_count": board and board.boot_count,
        "reset": board and _reset(board),
        "supply_v": report.supply_v,
        "self_test": report.self_test,
        "counters": dict(report.counters),
        "text": report.error,
    }
