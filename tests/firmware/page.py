"""Writes ``docs/reference/firmware.md`` from what the bench printed: ``build/bench.jsonl``.

GROUPS='firmware firmware_drift firmware_force firmware_map taxels taxels_million'
python -m tests.benchmarks $GROUPS && python -m tests.firmware.page

Other files that a bench wrote may be named instead.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path
from typing import Any

from rigctl.config.resources import checkout
from rigctl.wire.drum.states import State, StateEvent
from tests.benchmarks.firmware._force_map import (
    FORCES_G,
    GRID,
    MARKS,
    PLACES_MM,
    PLANTS,
    SPEEDS_MM_S,
)
from tests.firmware.drum.support.attacks import ATTACK_CONTROLS
from tests.firmware.drum.support.cells import COMMANDS, unreachable
from tests.firmware.drum.support.checks import CONTROLS
from tests.firmware.taxels.checks import CONTROLS as TAXEL_CONTROLS

Row = dict[str, Any]
DRUM, TAXELS = "firmware.drum.", "firmware.taxels."
MAP = "firmware.drum.force_map."
ASKED = {
    "step_jitter_cycles": "± 5",
    "rate_error_ppm": "< 5",
    "step_count_error": "0",
    "acceleration_error": "< 1 %",
    "max_steps_per_s": "≥ 10,000",
    "idle_share": "≥ 60 %",
    "longest_isr_us": "≤ 25",
    "interrupts_off_us": "≤ 10",
    "loadcell_read_us": "≤ 60",
    "loadcell_latency_us": "≤ 1000",
    "loadcell_unused": "0",
    "free_stack_bytes": "≥ 25 % of the stack's room",
    "estop_us": "≤ 100",
    "overforce_lift_us": "≤ 1000",
    "loadcell_fault_periods": "2.4, seen at the next tick",
    "heartbeat_ramp_ms": "250",
    "heartbeat_lift_ms": "250",
    "heartbeat_off_ms": "≤ 1000",
    "watchdog_ms": "≤ 100",
    "poll_timeouts": "0",
    "reply_start_us": "< 5000",
    "fuzz_changed_registers": "0",
    "force_settle_s": "< 1",
    "force_overshoot": "< 5 %",
    "force_mean_error": "< 1 %",
    "force_drift": "< 0.5 %",
    "force_drift_worst": "< 0.5 %",
    "force_lasting_error": "< 1 %",
    "approach_excess": "≤ 10 %",
    "force_map_settle_s": "< 1",
    "force_map_mean_error": "< 1 %",
    "force_map": "all, or the map of what can",
}
"""What each figure of the drum is held against."""
ASKED_OF_TAXELS = {
    "frame_cycles_error": "0",
    "jitter_cycles": "± 1",
    "lost_frames": "0",
    "idle_share": "≥ 40 %",
    "isr_load": "≤ 35 %",
    "longest_isr_us": "≤ 25",
    "interrupts_off_us": "≤ 10",
}
"""What each figure of the taxel board is held against."""
SHARES = {"acceleration_error", "idle_share", "isr_load"}
SHARE_FAMILIES = ("force_", "approach_excess", "variant_")

HEAD = """# The firmware in numbers

<!-- Written by `python -m tests.firmware.page` from build/bench.jsonl; do not edit. -->

Both images run on simulated chips (simavr), and everything here is counted in their cycles:
{run} Run
`make bench BENCH_ARGS="firmware firmware_drift firmware_force firmware_map taxels taxels_million"`
and then `python -m tests.firmware.page` to have them anew (an hour at most); the figures are the
same on any machine. The simulator's own floor of an edge is ± 5 cycles; silicon has none. Peers'
figures are those that they publish, with the source named in the bench's `peer`; nothing of theirs
was run here. Forces are the world's true contact force on the [nominal plant](world.md), not what
the load cell says.

What the drum does by itself, state by state, stands in [drum-wire.md](drum-wire.md#states).
"""


def page(rows: list[Row]) -> str:
    """The whole page. Raises ValueError where the rows hold no figure of the drum."""
    drum = [r for r in rows if r["name"].startswith(DRUM) and "cells" not in r]
    if not drum:
        raise ValueError(
            "no firmware.drum figures: run `python -m tests.benchmarks firmware` first"
        )
    taxels = [r for r in rows if r["name"].startswith(TAXELS)]
    parts = [HEAD.format(run=said_of_run(drum)), "\n## Drum controller\n\n", table(drum, DRUM)]
    parts += ["\n## Force over the plant's ranges\n\n", MAP_HEAD, force_map(rows)]
    if taxels:
        parts += ["\n## Taxel board\n\n", table(taxels, TAXELS)]
    return "".join([*parts, "\n## Negative controls\n\n", controls(), CELLS_HEAD, cells()])


MAP_HEAD = """Each plant is the nominal one with this one number at the end of its range; the hard
ones have them all: lag 50 ms, dead band 20 %, run-out and backlash 0.1 mm, and plate D, whose wide
ridges no mean over the sensor levels out. The board has the settings that it boots with.
{trials} trials on each plant:
forces from the lowest and at each the speeds from the slowest, {speeds} mm/s, one behind the other
on the same drum; and this anew from {places} mm behind the mark, since a drum that rests on a ridge
has another height below the sensor once it turns. A mark for each speed: `·` kept all that is asked
for from everywhere, else {marks}.

*Approach* is the highest single millisecond of the true force while the drum is still, over the set
force. *Swing* is the farthest mean of 200 ms inside the sync window, *peak in motion* its highest
single millisecond: a ridge that passes below the sensor, faster than any actuator of this kind.

""".format(
    trials=len(GRID) * len(PLACES_MM),
    speeds=", ".join(str(v) for v in SPEEDS_MM_S),
    places=", ".join(f"{mm:g}" for mm in PLACES_MM),
    marks=", ".join(f"`{letter}` {what}" for letter, what in MARKS.items()),
)
MAP_TABLE = "| plant | settles in, s |{forces} worst, and what was missed |\n|---|---|{rules}---|\n"


def said_of_run(drum: Iterable[Row]) -> str:
    """Which image the figures are of."""
    notes = [r["note"] for r in drum if "build " in r["note"]]
    build = notes[0].split("build ")[1].split(";")[0] if notes else "unknown"
    return f"the drum's is build `{build}`."


def table(rows: Iterable[Row], prefix: str) -> str:
    """One line a figure: value, what is asked for, scene, peer."""
    lines = [
        "| figure | value | asked for | scene | published by a peer |\n|---|---|---|---|---|\n"
    ]
    for r in rows:
        name = r["name"].removeprefix(prefix)
        peer = f"{amount(r['peer_value'], name, r['unit'])}, {r['peer']}" if r["peer"] else ""
        scene = r["note"].rsplit("; build/", 1)[0]
        value = amount(r["value"], name, r["unit"])
        asked = (ASKED if prefix == DRUM else ASKED_OF_TAXELS).get(name, "")
        lines.append(f"| `{name}` | {value} | {asked} | {scene} | {peer} |\n")
    return "".join(lines)


def amount(value: float, name: str, unit: str) -> str:
    """A value with its unit; a share as percent."""
    if name in SHARES or (name.startswith(SHARE_FAMILIES) and unit == ""):
        return f"{value:.2%}".replace("%", " %")
    number = f"{value:,.4g}" if isinstance(value, float) and abs(value) < 1000 else f"{value:,.0f}"
    return f"{number} {unit}".rstrip()


def force_map(rows: Iterable[Row]) -> str:
    """One line a plant, in the order of the plants, with a mark for each trial."""
    forces = [f"{force} g" for force in FORCES_G]
    head = MAP_TABLE.format(forces="".join(f" {f} |" for f in forces), rules="---|" * len(forces))
    found = {r["name"].removeprefix(MAP): r for r in rows if r["name"].startswith(MAP)}
    lines = []
    for name, r in ((name, found[name]) for name in PLANTS if name in found):
        said = r["note"].rsplit("; build/", 1)[0]
        grid = " | ".join(" ".join(r["cells"][force]) for force in forces)
        lines.append(f"| {name} | {r['value']:.2f} | {grid} | {said} |\n")
    return head + "".join(lines)


ATTACK = """
Whatever a computer writes, in whatever state, is tried by `tests/attack`: every writable register
and word with 0, 1, 0x7FFF, 0x8000 and 0xFFFF in every state, and writes, commands, resets, lost
heartbeats and presses of the emergency stop drawn from a seed; on virtual boards, and the worst of
them on the chip. The judge is the bench's own log. `make attack` does it for longer, with another
seed each time. A firmware without a rule is compiled for this computer, and must be caught.
"""


def controls() -> str:
    """Which broken image fails which check."""
    head = (
        "Each check of `drum_checks.py`, `drum_attacks.py` and `taxel_checks.py` in\n"
        "`tests/firmware` passes on the image, and must fail on the image that is broken in its\n"
        "point; `arduino/Makefile` builds them.\n\n"
        "| broken image | what is broken | the check that fails on it |\n|---|---|---|\n"
    )
    drum = (*CONTROLS, *ATTACK_CONTROLS)
    found = [(f"drum-{name}", what, check.__name__) for name, what, check in drum]
    found += [(f"taxels-{name}", what, check.__name__) for name, what, check in TAXEL_CONTROLS]
    rows = "".join(f"| `{n}` | {w} | {c.replace('_', ' ')} |\n" for n, w, c in found)
    return head + rows + ATTACK


CELLS_HEAD = """
## States × events on the chip

Every cell of the state table is tried natively, and on the compiled image where a bench can bring
it about. `·` is a cell that the image was driven through, accepted or refused as the table says;
the rest is out of reach, for the reason given.

"""


def cells() -> str:
    """The table of cells, and the reasons."""
    why: dict[str, str] = {}
    head = "".join(f" {s.name} |" for s in State)
    lines = [f"| event |{head}\n|---|{'---|' * len(State)}\n"]
    for event in sorted(StateEvent, key=lambda e: (e not in COMMANDS, e)):
        marks = []
        for state in State:
            reason = unreachable(state, event)
            marks.append(why.setdefault(reason, "abcdef"[len(why)]) if reason else "·")
        lines.append(f"| {event.name} | {' | '.join(marks)} |\n")
    reasons = "".join(f"- {mark}: {reason}\n" for reason, mark in why.items())
    return "".join(lines) + "\n" + reasons


def rows_of(path: Path) -> list[Row]:
    """Rows of a bench's file, the last of each name."""
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [list(same)[-1] for _, same in groupby(rows, key=lambda r: r["name"])]


def main(files: list[str]) -> int:
    """Write the page; 2 where there is nothing to write it from."""
    root = checkout()
    assert root is not None
    paths = [Path(name) for name in files] or [root / "build" / "bench.jsonl"]
    try:
        text = page([row for path in paths for row in rows_of(path)])
    except (OSError, ValueError) as error:
        print(f"docs/reference/firmware.md: {error}", file=sys.stderr)
        return 2
    (root / "docs" / "reference" / "firmware.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
