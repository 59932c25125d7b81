"""Write ``docs/reference/firmware.md`` from the figures in ``build/bench.jsonl``.

GROUPS='firmware firmware_drift firmware_force firmware_map taxels taxels_million'
python -m tests.benchmarks $GROUPS && python -m tests.firmware.page

Arguments name other files of figures instead.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from itertools import groupby
from math import isinf
from pathlib import Path
from typing import Any

from rigctl.boards.drum_states import State, StateEvent
from rigctl.config.resources import checkout
from tests.benchmarks.firmware._force_map import (
    FORCES_G,
    GRID,
    MARKS,
    PLACES_MM,
    PLANTS,
    SPEEDS_MM_S,
)
from tests.firmware.drum.support.attacks import ATTACK_CONTROLS
from tests.firmware.drum.support.cell_checks import CELL_CONTROLS
from tests.firmware.drum.support.cells import COMMANDS, unreachable
from tests.firmware.drum.support.checks import CONTROLS
from tests.firmware.taxels.checks import CONTROLS as TAXEL_CONTROLS

Row = dict[str, Any]
DRUM, TAXELS = "firmware.drum.", "firmware.taxels."
MAP = "firmware.drum.force_map."
LIMITS = {
    "step_jitter_cycles": "± 5",
    "rate_error_ppm": "< 5",
    "step_count_error": "0",
    "acceleration_error": "< 1 %",
    "max_steps_per_s": "≥ 10,000",
    "idle_share": "≥ 50 %",
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
    "force_map": "all, else see the map",
}
"""Limit of each figure of the drum."""
TAXEL_LIMITS = {
    "frame_cycles_error": "0",
    "jitter_cycles": "± 1",
    "lost_frames": "0",
    "idle_share": "≥ 40 %",
    "isr_load": "≤ 35 %",
    "longest_isr_us": "≤ 25",
    "interrupts_off_us": "≤ 10",
}
"""Limit of each figure of the taxel board."""
SHARES = {"acceleration_error", "idle_share", "isr_load"}
SHARE_FAMILIES = ("force_", "approach_excess", "variant_")

HEAD = """# The firmware in numbers

<!-- Written by `python -m tests.firmware.page` from build/bench.jsonl; do not edit. -->

Both images run on simulated chips (simavr), and all figures count cycles of these chips.
{run} To measure again, run
`make bench BENCH_ARGS="firmware firmware_drift firmware_force firmware_map taxels taxels_million"`
and then `python -m tests.firmware.page` (an hour at most); the figures are the same on any machine.
The simulator resolves an edge to ± 5 cycles; a real chip has no such limit. Figures of peers are
those that they publish, with their source; we ran none of their programs. Forces are the true
contact force of the [nominal simulated bench](world.md), not the reading of the load cell. A
*plant* is a simulated bench with one set of parameters.

[drum-wire.md](drum-wire.md#states) describes the firmware's states.
"""


def page(rows: list[Row]) -> str:
    """Return the page. Raises ValueError if the rows hold no figure of the drum."""
    drum = [r for r in rows if r["name"].startswith(DRUM) and "cells" not in r]
    if not drum:
        raise ValueError(
            "no firmware.drum figures: run `python -m tests.benchmarks firmware` first"
        )
    taxels = [r for r in rows if r["name"].startswith(TAXELS)]
    parts = [HEAD.format(run=build_sentence(drum)), "\n## Drum controller\n\n", table(drum, DRUM)]
    parts += ["\n## Force over the plant's ranges\n\n", MAP_HEAD, force_map(rows)]
    if taxels:
        parts += ["\n## Taxel board\n\n", table(taxels, TAXELS)]
    return "".join([*parts, "\n## Negative controls\n\n", controls(), CELLS_HEAD, cells()])


MAP_HEAD = """\
Each plant is the nominal one with one parameter at the end of its range. The *hard* plants
combine them: lag 50 ms, dead band 20 %, run-out and backlash 0.1 mm, a frame with half of the
deflection, ridges 1.5 mm high and 8 mm apart, and plate D, whose ridges are too wide for the
sensor to average out. The board has its boot settings. Each plant gets
{trials} trials: one sequence from each of three starting points, {places} mm after the index mark,
because the height below the sensor at rest on a ridge differs from the mean height once the drum
turns. A sequence runs the forces from the lowest, and at each force the speeds from the slowest,
{speeds} mm/s. There is one mark for each speed: `·` if all limits hold from every starting point,
otherwise {marks}.

*Approach* is the highest single millisecond of the true force while the drum is still, over the
set force. *Swing* is the largest deviation of a 200 ms mean inside the sync window. *Peak in
motion* is the highest single millisecond there: a ridge that passes below the sensor faster than
such an actuator can follow.

""".format(
    trials=len(GRID) * len(PLACES_MM),
    speeds=", ".join(str(v) for v in SPEEDS_MM_S),
    places=", ".join(f"{mm:g}" for mm in PLACES_MM),
    marks=", ".join(f"`{letter}` {what}" for letter, what in MARKS.items()),
)
MAP_TABLE = (
    "| plant | settles in, s |{forces} worst figures, and missed limits |\n|---|---|{rules}---|\n"
)


def build_sentence(drum: Iterable[Row]) -> str:
    """Return a sentence with the build of the image."""
    notes = [r["note"] for r in drum if "build " in r["note"]]
    build = notes[0].split("build ")[1].split(";")[0] if notes else "unknown"
    return f"The drum's image is build `{build}`."


def table(rows: Iterable[Row], prefix: str) -> str:
    """Return a table: one row for each figure, with value, limit, scene and peer."""
    lines = ["| figure | value | limit | scene | published by a peer |\n|---|---|---|---|---|\n"]
    for r in rows:
        name = r["name"].removeprefix(prefix)
        peer = f"{amount(r['peer_value'], name, r['unit'])}, {r['peer']}" if r["peer"] else ""
        scene = r["note"].rsplit("; build/", 1)[0]
        value = amount(r["value"], name, r["unit"])
        limit = (LIMITS if prefix == DRUM else TAXEL_LIMITS).get(name, "")
        lines.append(f"| `{name}` | {value} | {limit} | {scene} | {peer} |\n")
    return "".join(lines)


def amount(value: float, name: str, unit: str) -> str:
    """Format a value with its unit, and a share as percent."""
    if name in SHARES or (name.startswith(SHARE_FAMILIES) and unit == ""):
        return f"{value:.2%}".replace("%", " %")
    if isinf(value):
        return "never"
    number = f"{value:,.4g}" if isinstance(value, float) and abs(value) < 1000 else f"{value:,.0f}"
    return f"{number} {unit}".rstrip()


def force_map(rows: Iterable[Row]) -> str:
    """Return a table: one row for each plant, with a mark for each trial."""
    forces = [f"{force} g" for force in FORCES_G]
    head = MAP_TABLE.format(forces="".join(f" {f} |" for f in forces), rules="---|" * len(forces))
    found = {r["name"].removeprefix(MAP): r for r in rows if r["name"].startswith(MAP)}
    lines = []
    for name, r in ((name, found[name]) for name in PLANTS if name in found):
        worst = r["note"].rsplit("; build/", 1)[0]
        grid = " | ".join(" ".join(r["cells"][force]) for force in forces)
        settles_in = "never" if isinf(r["value"]) else f"{r['value']:.2f}"
        lines.append(f"| {name} | {settles_in} | {grid} | {worst} |\n")
    return head + "".join(lines)


ATTACK = """
`tests/attack` tries everything that a computer can write in every state: every writable register
and word with 0, 1, 0x7FFF, 0x8000 and 0xFFFF, and random writes, commands, resets, lost
heartbeats and presses of the emergency stop from a seed. It attacks virtual boards, and repeats
the worst attacks on the chip. The ground truth of the simulated bench decides. `make attack` runs
longer, with another seed each time. As a control, the tests compile a firmware without a rule for
this computer, and the attacks must find it.

The attacks also switch each wrong wiring of the simulated bench on and off at random times in every
state, several in a row, between the same writes, resets, silences and stops, on virtual boards with
a contact of 900 g/mm, and the worst of them again on chips; half of them with a load cell whose
reading under the drum is that of a broken one. With a wrong wire the true force stays below the
limit plus the travel of
[decision 40](../decisions/0040-force-and-motion-explain-each-other.md): where the settings
lift at *F* (2,000 g at most, and as much more as a weak cell counts less), that is
*F* + *k* · (1 mm + 6 mm/s · 18.5 ms + `overrun_um`). A board that is not commissioned stays below
300 g, whatever wire breaks and whenever; with any two wirings of the catalogue that are wrong from
power-up, once the drum is lifted, or from one moment while the set-up presses, too. An emergency
stop switches everything off. No firmware can answer these, so the attacks leave them out, and a
current limit or a mechanical stop has to bound the force
([how to build the rig](../how-to/build-the-rig.md)):

- *The bridge's enable is stuck high, or the bridge is shorted:* the board no longer switches it.
- *Neither contact of the emergency stop works*, such as a bridged first contact and a second one
  that is not in the supply: nothing tells the board or cuts the supply.
- *The load cell feels nothing before the first contact of a board that knows no place of one, or no
  more from its first touch on, which may have been a shock:*
  commissioned by hand without the set-up's press, or with a potentiometer that shows a wrong place.
- *A loose contact of the load cell that comes and goes as a finger would*, or a cell that breaks
  between the finger and the first contact and then reads within 30 g of what it read before.
- *Load cell, potentiometer and actuator are wrong together*, or no potentiometer is fitted and the
  others are: nothing shows that a lift presses. A reversed cell is noticed, one that feels nothing
  is not.
"""


def controls() -> str:
    """Return the table of broken images and the checks that fail on them."""
    head = (
        "Each check of `checks.py`, `attacks.py` and `cell_checks.py` in `drum/support`, and of\n"
        "`taxels/checks.py` in `tests/firmware` passes on the image, and must fail on an image\n"
        "that is broken in this one point; `BROKEN` in `tests/firmware/broken.py` says how.\n\n"
        "| broken image | defect | check that fails on it |\n|---|---|---|\n"
    )
    drum = (*CONTROLS, *ATTACK_CONTROLS, *CELL_CONTROLS)
    found = [(f"drum-{name}", what, check.__name__) for name, what, check in drum]
    found += [(f"taxels-{name}", what, check.__name__) for name, what, check in TAXEL_CONTROLS]
    rows = "".join(f"| `{n}` | {w} | {c.replace('_', ' ')} |\n" for n, w, c in found)
    return head + rows + ATTACK


CELLS_HEAD = """
## States × events on the chip

The tests try every cell of the state table natively, and on the compiled image if a bench can reach
it. `·` is a cell that the image passed through, accepted or refused as the table says; the other
cells are unreachable, for the reason given.

"""


def cells() -> str:
    """Return the table of cells, and the reasons."""
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
    """Return the rows of a file of figures, the last of each name."""
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [list(same)[-1] for _, same in groupby(rows, key=lambda r: r["name"])]


def main(files: list[str]) -> int:
    """Write the page; return 2 if there are no figures."""
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
