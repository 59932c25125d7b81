"""Every state × event of the drum's table, commissioning and nudges, on the compiled image."""

from __future__ import annotations

import pytest

from rigctl.bench.chips.simavr import Input, Output, ResetBy
from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_states import OUTPUTS, State, StateEvent, next_state
from tests.firmware.drum.support.attacks import has_status
from tests.firmware.drum.support.cells import (
    ATTENDED,
    COMMANDS,
    COMPLETIONS,
    FAULTS,
    SILENT,
    cause,
    enter,
    unreachable,
)
from tests.firmware.drum.support.chip import DrumChip

PASSED = {State.RETRACT: State.ARMED}
"""A lift without travel ends in the next tick."""


def check_cell(drum: DrumChip, state: State, event: StateEvent) -> None:
    """Cause the event, and check the new state and its drivers against the table."""
    wanted = next_state(state, event)
    assert wanted is not None
    cause(drum, event)
    seen = drum.state
    assert seen in (wanted, PASSED.get(wanted)), event.name
    if seen is State.FAULT_OFF:
        assert drum.x.drive == 0


@pytest.mark.parametrize("state", ATTENDED, ids=lambda s: s.name)
def test_commands_and_faults_follow_the_table(state: State) -> None:
    with DrumChip() as drum:
        enter(drum, state)
        for event in (e for e in COMMANDS if next_state(state, e) is None):
            assert drum.command(COMMANDS[event]) == 4, event.name
            assert drum.state is state, event.name
        for event in (*COMMANDS, *FAULTS):
            if next_state(state, event) is None:
                continue
            if drum.state is not state:
                enter(drum, state)
            check_cell(drum, state, event)


@pytest.mark.parametrize(
    ("state", "limit_ms"),
    [
        (State.RETRACT, 6000),
        (State.POSITION, 8000),
        (State.APPROACH, 12_000),
        (State.RUN, 6000),
        (State.FAULT_LIFT, 800),
        (State.NUDGE, 1300),
    ],
    ids=str,
)
def test_completions_follow_the_table(state: State, limit_ms: int) -> None:
    with DrumChip() as drum:
        enter(drum, state)
        for _ in range(limit_ms // 20):
            if drum.state is not state:
                break
            drum.poll_for(20)
        (event,) = COMPLETIONS[state]
        assert drum.state is next_state(state, event)


def test_selftest_refuses_every_command_and_passes() -> None:
    with DrumChip() as drum:
        for event in COMMANDS:
            drum.chip.reset(ResetBy.PIN)
            drum.run(5)
            assert drum.state is State.SELFTEST
            assert drum.command(COMMANDS[event]) == 4, event.name
        drum.run(250)
        assert drum.state is next_state(State.SELFTEST, StateEvent.SELFTEST_PASSED)


def test_selftest_fails_without_a_load_cell_and_on_an_open_emergency_stop() -> None:
    with DrumChip() as drum:
        drum.x.loadcell_mode = SILENT
        drum.chip.reset(ResetBy.PIN)
        drum.run(600)
        assert drum.state is next_state(State.SELFTEST, StateEvent.SELFTEST_FAILED)
        drum.x.loadcell_mode = 0
        drum.pin(Input.ESTOP, 1)
        drum.chip.reset(ResetBy.PIN)
        drum.run(20)
        assert drum.state is next_state(State.SELFTEST, StateEvent.OFF_FAULT)


def test_an_unarmed_drum_drives_nothing() -> None:
    with DrumChip() as drum:
        drum.clear_edges()
        drum.chip.reset(ResetBy.PIN)
        drum.run(300)
        assert drum.state is State.IDLE
        for signal, off in ((Output.ENABLE, 1), (Output.BRIDGE, 0)):
            assert all(drum.edges(signal)[:, 1] == off)
        assert drum.steps().size == 0


def test_every_cell_is_reached_or_has_a_reason() -> None:
    reached = {(s, e) for s in ATTENDED for e in (*COMMANDS, *FAULTS)}
    reached |= {(s, e) for s, events in COMPLETIONS.items() for e in events}
    reached |= {(State.SELFTEST, e) for e in (*COMMANDS, StateEvent.OFF_FAULT)}
    for state in OUTPUTS:
        for event in StateEvent:
            assert ((state, event) in reached) == (not unreachable(state, event))


def test_a_commission_outlives_a_reset_and_ends_with_its_settings() -> None:
    with DrumChip() as drum:
        assert not has_status(drum, Status.COMMISSIONED)
        assert drum.command(Command.COMMISSION, 500) == 0
        hash_before = drum.get("settings_hash")
        drum.chip.reset(ResetBy.PIN)
        drum.run(150)
        assert has_status(drum, Status.COMMISSIONED)
        assert drum.set("scale_ug_per_count", 2500) == 0
        assert drum.get("settings_hash") != hash_before
        assert not has_status(drum, Status.COMMISSIONED)


def test_a_nudge_moves_a_little_and_reports_its_way() -> None:
    with DrumChip() as drum:
        for direction, sign in ((1, 1), (0, -1)):
            begun_mm = drum.rod_mm
            assert drum.set("nudge_direction", direction) == 0
            assert drum.command(Command.NUDGE, 3000) == 0
            assert 80 <= sign * drum.get("nudge_travel_um") <= 150
            assert abs(drum.rod_mm - begun_mm) < 0.3
            assert has_status(drum, Status.DIRECTION_KNOWN)
