"""Short forms of the soak: faults and kills, and every trial is committed exactly once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.endurance.campaign import Campaign, State
from tests.endurance.faults import FAULTS
from tests.endurance.page import describe
from tests.firmware.building import all_built

SHORT_TRIAL = """
name = "short-trials"
textures = ["A", "L"]
speeds_mm_s = [120]
forces_g = [500]
repeats = {repeats}

[trial]
travel_mm = {travel}
"""
SLOW_ON_CHIPS = ("exception", "disk")
"""Tried on the virtual rig: they are no matter of the boards."""


def protocol(folder: Path, repeats: int, travel_mm: float) -> Path:
    """Write a protocol of two plates with so many trials on each."""
    path = folder / "protocol.toml"
    path.write_text(SHORT_TRIAL.format(repeats=repeats, travel=travel_mm))
    return path


def check(campaign: Campaign, kills: int, record_property: Callable[[str, object], None]) -> State:
    """Run a campaign and check what it left; return what was seen."""
    state = campaign.run()
    found = describe(campaign)
    record_property("shown", f"{campaign.kind}:\n{found.text}")
    assert found.holds, found.text
    assert state.kills >= kills
    return state


def test_300_trials_with_faults_and_kills(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    campaign = Campaign(
        tmp_path,
        protocol(tmp_path, 150, 30),
        mean_trials=12,
        kill_every=11,
        kill_until=300,
        start="forkserver",
        most_sittings=150,
    )
    check(campaign, 20, record_property)


def test_40_trials_with_the_firmware_in_the_loop(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    all_built()
    faults = tuple(fault.name for fault in FAULTS if fault.where not in SLOW_ON_CHIPS)
    campaign = Campaign(
        tmp_path,
        protocol(tmp_path, 20, 30),
        "firmware",
        mean_trials=8,
        kill_every=4,
        kill_until=40,
        start="forkserver",
        most_sittings=60,
        faults=faults,
    )
    check(campaign, 5, record_property)
