"""Noise on the drum's cable that damages one byte in a hundred."""

from __future__ import annotations

from rigctl.bench.simulated_rig import DRUM
from rigctl.boards.drum_states import Fault, State
from tests.contract.operator import Operator


async def bear_noise(operator: Operator) -> None:
    """Check that two seconds of noise change only the error counters."""
    await operator.reach(State.ARMED)
    before = await operator.drum.get("crc_errors")
    operator.faults.corrupt_bytes(DRUM, "to_board", 0.01)
    operator.faults.corrupt_bytes(DRUM, "to_host", 0.002)
    await operator.watch(2.0)
    for direction in ("to_board", "to_host"):
        operator.faults.corrupt_bytes(DRUM, direction, 0.0)
    after = await operator.drum.get("crc_errors")
    assert (operator.state, operator.fault) == (State.ARMED, Fault.NONE)
    assert after["crc_errors"] > before["crc_errors"]
    assert operator.drum.modbus.timeouts > 0
