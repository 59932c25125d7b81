"""Print the longest run of each interrupt handler on the simulated chips.

``python -m tests.firmware.interrupts`` takes a minute. The limit is 25 µs for each. ``IsrMeter`` of
the drum and the status of the taxel board measure the same on a real chip, without naming a vector.
"""

from __future__ import annotations

from rigctl.bench.chips.simavr import Input
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State
from rigctl.boards.taxel_frames import IDENTIFY, SELF_TEST, encode_request
from tests.firmware.drum.support.checks import enter_from_idle, spike_switch_wires
from tests.firmware.drum.support.chip import ENTRY_CYCLES as DRUM_ENTRY
from tests.firmware.drum.support.chip import DrumChip
from tests.firmware.taxels.chip import ENTRY_CYCLES as TAXEL_ENTRY
from tests.firmware.taxels.chip import FRAME_CYCLES, TaxelChip

DRUM_VECTORS = {
    "INT2": 3,
    "INT4": 5,
    "INT5": 6,
    "TIMER1_COMPA": 17,
    "USART0_RX": 25,
    "USART0_UDRE": 26,
    "TIMER3_COMPA": 32,
    "TIMER3_COMPB": 33,
}
"""Numbers of the ATmega2560's vectors that the drum uses."""
TAXEL_VECTORS = {"PCINT0": 3, "USART_RX": 18, "USART_UDRE": 19, "ADC": 21}
"""The same of the ATmega328P and the taxel board."""


STOPS = (2000, 6000, 10_000, 14_000)
"""Cycles from the start of a millisecond to an opening of the emergency stop."""


def drum_cycles() -> dict[str, int]:
    """Return the longest run of each handler of the drum, cycles with entry.

    The scenes: a run in contact, a move at 10,000 steps a second, spikes on all switch wires, and
    emergency stops that the interrupt sees or, where it is off, the look of each millisecond.
    """
    longest = [0] * (1 + max(DRUM_VECTORS.values()))
    for image in ("firmware/drum.elf", "firmware/drum-no-estop.elf"):
        with DrumChip(image) as drum:
            _work(drum)
            for phase in STOPS:
                _stop(drum, phase)
            longest = [max(pair) for pair in zip(longest, drum.x.longest_isr, strict=False)]
    return {name: longest[number] + DRUM_ENTRY for name, number in DRUM_VECTORS.items()}


def _work(drum: DrumChip) -> None:
    enter_from_idle(drum, State.RUN)
    drum.poll_for(1000)
    spike_switch_wires(drum, 100)
    assert drum.command(Command.RETRACT, 5000) == 0
    drum.set("move_speed_set", 32_000)
    drum.set("move_target", drum.get("steps") + 25_600)
    assert drum.command(Command.MOVE, 20_000) == 0


def _stop(drum: DrumChip, phase: int) -> None:
    drum.pin(Input.ESTOP, 1, phase)
    drum.run(3)
    drum.pin(Input.ESTOP, 0)
    drum.run(3)
    assert drum.command(Command.CLEAR) == 0
    assert drum.command(Command.ARM, 5000) == 0


def taxel_cycles() -> dict[str, int]:
    """Return the longest run of each handler of the taxel board, cycles with entry.

    Requests, self-tests, and edges of sync and index around the boundaries of the frames.
    """
    with TaxelChip() as board:
        for number in range(400):
            if number % 50 == 0:
                board.chip.send(encode_request(IDENTIFY) + encode_request(SELF_TEST))
            begun = int(board.x.cycle) + 97 * number % FRAME_CYCLES
            for signal in (Input.INDEX, Input.SYNC):
                board.edge(signal, number % 2, begun)
            board.run(1)
        longest = list(board.x.longest_isr)
    return {name: longest[number] + TAXEL_ENTRY for name, number in TAXEL_VECTORS.items()}


def main() -> None:
    """Print a line for each handler."""
    for board, longest in (("drum", drum_cycles()), ("taxels", taxel_cycles())):
        for name, cycles in longest.items():
            print(f"{board} {name}_vect: {cycles} cycles, {cycles / 16:.1f} µs")


if __name__ == "__main__":
    main()
