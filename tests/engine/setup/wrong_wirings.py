"""A setup through every wrong wiring of the catalogue, on virtual boards and on chips.

``python -m tests.engine.setup.wrong_wirings`` prints ``docs/reference/wrong-wirings.md``.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from rigctl.bench.wirings import WIRINGS, Wiring
from rigctl.engine.setup.setup import STEPS
from rigctl.rig import FIRMWARE, VIRTUAL
from tests.engine.setup.simulated_setup import simulated_setup

MOST_FORCE_G = 300
"""Of the actuator before the setup has passed."""
FILTERED = "nothing is wrong: the board looks three times, so that a spike does nothing"
CONNECTING = "the connection"
HEAD = f"""\
# Wrong wirings

`rigctl serve --wire NAME` wires the simulated bench in one of these ways, and so does the fault
panel of the window. `python -m tests.engine.setup.wrong_wirings` prints this page: it lets
[`rigctl setup`](../how-to/set-up.md) run through each of them, with a person who does and sees
what the simulated bench shows, and the test suite holds each row. The setup stops at the first
part that is wrong and says the sentence of the row. Wirings that no sensor of the rig can tell
apart share a sentence, which lists them with the check that decides. Before the setup has passed,
the drum never presses with more than {MOST_FORCE_G} g, nor does it with any two wirings that
firmware can answer ([decision 40](../decisions/0040-force-and-motion-explain-each-other.md)); the
largest true force of each run stands in the last column.

| wiring | what is connected how | found by | what the setup says | force |
|---|---|---|---|---|"""


class Row(NamedTuple):
    """What a setup says of one wiring; ``causes``: the wirings that its sentence is about."""

    wiring: Wiring
    part: str
    sentence: str
    causes: tuple[str, ...]
    peak_g: float

    @property
    def line(self) -> str:
        """The row of the page."""
        w = self.wiring
        sentence = self.sentence[0].upper() + self.sentence[1:]
        return f"| `{w.name}` | {w.text} | {self.part} | {sentence} | {self.peak_g:.0f} g |"


@cache
def set_up(name: str) -> Row:
    """Set up a rig that is wired like this, on chips where it needs them, until a part is wrong."""
    wiring = WIRINGS[name]
    kind = FIRMWARE if wiring.reaches == "chips" else VIRTUAL
    with simulated_setup(wiring.name, kind) as setup:
        setup.run_through()
    if setup.wrong is None:
        return Row(wiring, "–", FILTERED, (), setup.peak_g)
    part = CONNECTING if setup.step is None else setup.step.title
    return Row(wiring, part, setup.wrong.problem, setup.wrong.causes, setup.peak_g)


def page() -> str:
    """Return the page."""
    rows = [set_up(name) for name in WIRINGS]
    parts = [CONNECTING, *(step.title for step in STEPS)]
    order = {part: place for place, part in enumerate(parts)}
    rows.sort(key=lambda row: order.get(row.part, len(order)))
    return "\n".join([HEAD, *(row.line for row in rows)])


if __name__ == "__main__":
    print(page())
