"""Settings in the drum's EEPROM: whole, old or new, whatever happens to the power."""

from __future__ import annotations

import pytest

from rigctl.simulation.chips.simavr import ResetBy
from rigctl.wire.drum.codes import Command, SettingsFrom
from tests.firmware.drum.support.chip import MS, DrumChip

SLOTS, STRIDE, SLOT_BYTES = 64, 128, 2 + 2 * 49 + 2
OLD, NEW = (3000, 30), (4000, 40)
"""Values of ``force_set`` and of the last saved register, a tare place."""


def write(drum: DrumChip, values: tuple[int, int]) -> None:
    assert drum.set("force_set", values[0]) == 0
    assert drum.set("tare_place_15", values[1]) == 0


def read(drum: DrumChip) -> tuple[int, int]:
    return drum.get("force_set"), drum.get("tare_place_15")


def lifted(drum: DrumChip) -> None:
    """At its upper end, where the board takes a tare."""
    drum.rod_mm = 0.0
    drum.run(50)


def power_cycle(drum: DrumChip) -> None:
    drum.chip.reset(ResetBy.POWER)
    drum.run(120)


def saved(drum: DrumChip, values: tuple[int, int]) -> None:
    write(drum, values)
    assert drum.command(Command.SAVE, 1000) == 0


def test_a_save_takes_a_byte_a_tick_at_most() -> None:
    with DrumChip() as drum:
        lifted(drum)
        begun = drum.x.cycle // MS
        saved(drum, OLD)
        assert drum.x.cycle // MS - begun >= SLOT_BYTES
        power_cycle(drum)
        assert read(drum) == OLD
        assert drum.get("settings_from") == SettingsFrom.SAVED


def test_a_power_loss_at_every_byte_leaves_old_or_new_settings_whole() -> None:
    with DrumChip() as drum:
        lifted(drum)
        saved(drum, (1000, 10))
        saved(drum, OLD)
        kept = drum.chip.read_eeprom(SLOTS, 2 * STRIDE)
        found = []
        for milliseconds in range(0, SLOT_BYTES + 12, 2):
            drum.chip.write_eeprom(SLOTS, kept)
            power_cycle(drum)
            write(drum, NEW)
            assert drum.command(Command.SAVE) == 0
            drum.run(milliseconds)
            power_cycle(drum)
            found.append(read(drum))
        assert set(found) == {OLD, NEW}
        assert found == sorted(found)


@pytest.mark.parametrize("byte", [0, 1, 2, 50, SLOT_BYTES - 3, SLOT_BYTES - 2, SLOT_BYTES - 1])
def test_a_damaged_slot_gives_the_other_and_two_the_defaults(byte: int) -> None:
    with DrumChip() as drum:
        lifted(drum)
        saved(drum, OLD)
        saved(drum, NEW)
        for start, expected in ((SLOTS + STRIDE, OLD), (SLOTS, (5000, 0))):
            (old,) = drum.chip.read_eeprom(start + byte, 1)
            drum.chip.write_eeprom(start + byte, bytes([old ^ 0x10]))
            power_cycle(drum)
            assert read(drum) == expected
        assert drum.get("settings_from") == SettingsFrom.DAMAGED
        assert drum.command(Command.SAVE, 1000) == 0
        power_cycle(drum)
        assert drum.get("settings_from") == SettingsFrom.SAVED


def test_a_blank_board_says_that_it_runs_on_defaults() -> None:
    with DrumChip() as drum:
        assert drum.get("settings_from") == SettingsFrom.DEFAULTS
