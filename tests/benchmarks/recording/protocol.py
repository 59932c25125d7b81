"""Benchmark the rig time of the paper's protocol, and where it goes between the trials."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit

from rigctl.bench.world_file import NOMINAL_WORLD
from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_states import State
from rigctl.config.resources import find_protocol
from rigctl.engine.contact import has_status
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import condition_of
from rigctl.values import DrumState
from tests.engine.engine_harness import open_harness, open_session

SEED = 1
PLATES = ["B", "L"]
REPEATS = 3
HOUR_S = 3600.0
HIGH = Status.SYNC_HIGH
PHASES = {
    State.POSITION: "travel to the start",
    State.APPROACH: "approach and settling",
    State.RETRACT: "lift",
    State.HOLD: "wait in contact",
    State.ARMED: "wait lifted, tare",
}


class Measured(NamedTuple):
    """Hours of the whole protocol, and seconds of each phase in the part that was run."""

    hours: float
    phases_s: dict[str, float]
    n_trials: int


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``protocol.hours_*`` of the paper's protocol, and the phases of a trial."""
    for lift in ("trial", "condition"):
        text = paper(lift)
        found, estimate_s = measured(text), parse_protocol(text, "paper", CONFIG).plan().duration_s
        note = f"{found.n_trials} trials of {', '.join(PLATES)} on the virtual rig, the rest equal"
        peer = "the protocol's estimate"
        yield _row(f"hours_lift_{lift}", found.hours, "h", note, peer, estimate_s / HOUR_S)
        for phase, seconds in sorted(found.phases_s.items()):
            words = phase.replace(" ", "_").replace(",", "")
            yield _row(f"{words}_s_lift_{lift}", seconds / found.n_trials, "s", "mean of a trial")


CONFIG = NOMINAL_WORLD.rig_config()


def paper(lift: str) -> str:
    """Return the paper's protocol with another lift; by condition it tares where drift asks."""
    document = tomlkit.parse(find_protocol("paper").read_text())
    if lift == "condition":
        trial: Any = document["trial"]
        steps: Any = document["steps"]
        trial["lift"], steps[1] = lift, {"at": "drift", "limit_g": 1.0, "kind": "tare"}
    return document.as_string()


def part_of(text: str) -> str:
    """Return the protocol with fewer plates and repeats."""
    document = tomlkit.parse(text)
    document["textures"], document["repeats"] = PLATES, REPEATS
    return document.as_string()


def measured(text: str) -> Measured:
    """Run a part of a protocol on the virtual rig, and count the rest by its conditions."""
    phases_s: defaultdict[str, float] = defaultdict(float)
    with tempfile.TemporaryDirectory() as folder, open_harness(Path(folder), SEED) as harness:
        polls: list[DrumState] = []
        harness.engine.boards.drum_poller.subscribe(polls.append)
        harness.record(part_of(text))
        with open_session(harness.session) as session:
            rows = [session.trial_row(index) for index in range(len(session.trials))]
    begun_s, ended_s = rows[0].started_s, rows[-1].ended_s
    has_passed = False
    for state, after in pairwise(polls):
        has_passed = state.state == State.RUN and (has_passed or has_status(state, HIGH))
        if begun_s <= state.at_s < ended_s:
            phases_s[_phase(state, has_passed)] += after.at_s - state.at_s
    ends_s = np.array([begun_s, *(row.ended_s for row in rows)])
    seconds = np.diff(ends_s).reshape(-1, REPEATS)
    assert len({condition_of(row.trial) for row in rows}) == len(seconds)
    whole = parse_protocol(text, "paper", CONFIG)
    more = (whole.repeats - 1) * seconds[:, 1:].mean(axis=1)
    of_part_s = float((seconds[:, 0] + more).sum())
    hours = of_part_s * len(whole.textures) / len(PLATES) / HOUR_S
    return Measured(hours, phases_s, len(rows))


def _phase(state: DrumState, has_passed: bool) -> str:
    """Return the phase that a poll shows; ``has_passed``: its turn has opened the window."""
    if state.state != State.RUN:
        return PHASES.get(State(state.state), "other")
    if has_status(state, HIGH):
        return "window"
    return "stop in contact" if has_passed else "run-in"


def _row(
    name: str, value: float, unit: str, note: str, peer: str | None = None, peer_value: float = 0
) -> dict[str, Any]:
    return {
        "name": f"protocol.{name}",
        "value": round(value, 2),
        "unit": unit,
        "peer": peer,
        "peer_value": round(peer_value, 2) if peer else None,
        "ratio": round(value / peer_value, 3) if peer else None,
        "note": note,
    }
