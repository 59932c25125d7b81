"""A drum's cable that damages a byte in a hundred, and what may come of it."""

from __future__ import annotations

from rigctl.simulation.simulated_rig import DRUM
from rigctl.wire.drum.states import Fault, State
from tests.contract.operator import Operator


async def bear_noise(at_rig: Operator) -> None:
    """Two seconds of noise change nothing but the counters."""
    await at_rig.reach(State.ARMED)
    before = await at_rig.drum.get("crc_errors")
    at_rig.faults.corrupt_bytes(DRUM, "to_board", 0.01)
    at_rig.faults.corrupt_bytes(DRUM, "to_host", 0.002)
    await at_rig.watch(2.0)
    for direction in ("to_board", "to_host"):
        at_rig.faults.corrupt_bytes(DRUM, direction, 0.0)
    after = await at_rig.drum.get("crc_errors")
    assert (at_rig.state, at_rig.fault) == (State.ARMED, Fault.NONE)
    assert after["crc_errors"] > before["crc_errors"]
    assert at_rig.drum.modbus.timeouts > 0
