"""Renders ``docs/reference/world.md`` from the parameter table, so that it cannot be stale.

``python -m rigctl.world.reference`` writes the page, with ``--check`` it only compares.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rigctl.world.parameters import ParameterInfo, WorldParameters, table
from rigctl.world.textures import CATALOGUE

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "world.md"

_GROUPS = {
    "circumference_mm": "Drum",
    "actuator_speed_mm_s": "Actuator",
    "contact_mm": "Contact",
    "loadcell_rate_hz": "Load cell",
    "drum_clock_ppm": "Clocks of the boards",
    "base_height_mm": "Textures",
    "taxel_pitch_mm": "Skin and taxels",
}

_HEAD = """\
# The simulated bench

This page is written by `python -m rigctl.world.reference` from `rigctl/world/parameters.py`; a
test fails when the two differ.

The world is stepped in world time, a millisecond at a time, and is the same for a seed. Virtual
boards and simulated chips are wired to the same world. Nobody has measured this rig. Each number
below says where it is from: **published** of the rig or its sensor; **measured** on recordings of
other labs; **identified**, which means searched for until the paper's Original column comes out,
and that column alone ([decision 0018](../decisions/0018-the-world-is-identified.md)); or
**plausible**, chosen within the range. The ranges are what tests sweep; a value outside is refused.
A file can give any of them another value: [Rehearse on your own bench](../how-to/rehearse.md).

## How it works

- **Drum.** The place of the surface comes from the steps, times the true travel of a step. While
  the motor is jammed the place stands still and the steps are lost. The plate begins behind the
  index mark; the rest of the turn is a smooth clamp.
- **Actuator.** Duty beyond the dead band is speed, reached with a first-order lag. From rest it
  needs a little more duty. The screw holds by itself. Its play is held on one flank by the drum's
  weight and opens only under a contact force above it. A potentiometer tells the travel.
- **Contact.** The skin touches ridges first and bridges the grooves between them. Its pressure is
  a power of how deep it is pressed, and the force is the sum over the nine patches of the sensor,
  tilted as the plate sits. The frame gives way in proportion. Heights count from a plate's highest
  ridge, so every plate touches at the same travel. The drum's run-out comes once a turn. The clamp
  is as high as carries like the plate at 500 g. Tables reach to 2,500 g; behind them force goes on
  in proportion.
- **Load cell.** It feels contact force, imbalance once a turn, the inertia of the moved mass and
  what pushes on it. A conversion is the mean of the last milliseconds, with noise, drift, creep
  and an offset that carries the drum's weight. It converts by its own clock and settles for four
  conversions after power-up. Inertia looks like a force of several grams while the actuator
  gathers speed: tell it from touch.
- **Skin.** Each taxel feels the pressure around it, weighted by its own width and spread by the
  layers above it, less where the drum's curve or the plate's tilt takes depth from it. Conductance
  is a power of the pressure that bends where the fabric saturates; it lags and relaxes. Of the
  divider's own bend the converter sees little. Gains differ from taxel to taxel for good, and
  from session to session. **Each mounting of a plate** has a tilt, a shift and small gains of its
  own, which stay until the next one. At each contact skin and fabric are a little changed: the
  skin's place, all gains together, each taxel's gain, and how much of the texture gets through.
- **Wiring.** The sensor is soldered as [arduino/README.md](../../arduino/README.md) draws it:
  reading 6 · line + input, a line is a row along the travel, inputs 0–2 read the top layer.
  Readings of one analog input pull at each other a little.
- **Converter.** Reading *i* is taken 50 µs × *i* after the start of its frame by the board's
  clock, with noise, 10 bit.
- **Truth.** Each millisecond the world logs the true speed, the true contact force and the level
  of the sync line.

`rigctl serve` offers both boards to other programs in real time, each as a TCP port on the
loopback and as a pseudo-terminal; `--json` prints the addresses as one line. The
first start after an update compiles for half a minute before it gives addresses.

Chance comes from counters, never from the order of calls: any slicing of time gives the same
samples.

## Parameters
"""


def heading(name: str) -> str:
    """Return the heading of the group that a parameter begins; empty where it begins none."""
    return _GROUPS.get(name, "")


OURS = {"growth": 2.38, "mean_growth": 3.02, "mean_scatter": 0.016, "amplitude_scatter": 0.04}
SHARES = {"mean_shares": (0.01, 0.0, 0.99), "amplitude_shares": (0.64, 0.0, 0.18)}
"""The nominal skin's figures, as ``tests/world/test_skin_statistics.py`` measures them."""


def render() -> str:
    """The whole page."""
    parts = [_HEAD]
    for row in table():
        if row.name in _GROUPS:
            parts.append(
                f"\n### {_GROUPS[row.name]}\n\n| parameter | nominal | range | unit |"
                " meaning | source |\n|---|---|---|---|---|---|\n"
            )
        parts.append(_line(row))
    parts.append(
        "\n`dead_taxels` and `stuck_taxels` name readings that are broken; nominally none.\n"
    )
    return "".join(parts) + _plates() + _recordings()


def _line(row: ParameterInfo) -> str:
    span = f"{row.low:.6g} … {row.high:.6g}"
    return f"| `{row.name}` | {row.value:.6g} | {span} | {row.unit} | {row.doc} | {row.source} |\n"


def _plates() -> str:
    p = WorldParameters()
    head = "\n## Plates\n\n| plate | group | height, mm | spacing, mm |\n|---|---|---|---|\n"
    lines = [
        f"| {plate.name} | {plate.group} | {p.base_height_mm * plate.height:g} | "
        f"{p.base_space_mm * plate.space:g} |\n"
        for plate in CATALOGUE.values()
    ]
    return head + "".join(lines).replace(
        f"| A | smooth | 0 | {p.base_space_mm:g} |", "| A | smooth | 0 | – |"
    )


def _recordings() -> str:
    mean, amplitude = (" / ".join(f"{share:.2f}" for share in some) for some in SHARES.values())
    growth, mean_growth = (f"× {OURS[name]:.1f}" for name in ("growth", "mean_growth"))
    scatter = f"{OURS['mean_scatter']:.1%} / {OURS['amplitude_scatter']:.1%}"
    return f"""
## Beside real skins

Two sets of recordings of other labs: 21 printed textures on 9 piezoresistive taxels, pressed to 4
depths within 1.5 mm, one trial a condition; and fabrics on 16 capacitive taxels at 2 pressures, 3
trials a condition. Amplitude is what a mean over 0.25 s leaves of a reading.

| | printed textures | fabrics | ours |
|---|---|---|---|
| variance of a taxel's mean by texture / speed / force or depth | 0.87 / 0.01 / 0.05 | – | {mean} |
| the same of its amplitude | 0.67 / 0.17 / 0.01 | – | {amplitude} |
| amplitude from least to most pressed | × 1.2–1.3 | × 2 for twice the mean | {growth} |
| mean from least to most pressed | × 1.13–1.2 | × 1.9 | {mean_growth} |
| trial to trial, mean / amplitude | – | 0.8% / 4.5% | {scatter} |

Held to are the growth of the amplitude (× 1.2 to 2.5) and both scatters (0.8 to 3% and 3 to 7%).
The rest differs because theirs are pressed by depth and ours by force, over a range of four. At a
set depth the mean is high where a plate is full and low where it is hollow: texture explains it. At
a set force all plates are pressed alike in the mean, and force explains it. Of the amplitude force
explains more with us for the same reason: a quarter of a kilogram to one is more than 1.5 mm were.
"""


def main(arguments: list[str]) -> int:
    """Write the page, or compare it; returns 1 where it is stale."""
    if "--check" in arguments:
        return 0 if PAGE.read_text(encoding="utf-8") == render() else 1
    PAGE.write_text(render(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
