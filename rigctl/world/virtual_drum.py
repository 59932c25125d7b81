"""The virtual drum board: Modbus RTU on its cable, the controller behind it, resets and clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from rigctl.wire.drum_map import (
    BAUD,
    BOARD_DRUM,
    LOADCELL_RECENT,
    MAGIC,
    MAP_VERSION,
    RING_DEPTH,
    Command,
    ResetCause,
    SettingsFrom,
    Signal,
    Status,
)
from rigctl.wire.drum_states import State
from rigctl.world.bench import Bench
from rigctl.world.drum_controller import Controller
from rigctl.world.drum_motion import DrumMotion
from rigctl.world.drum_registers import RegisterBank, Values
from rigctl.world.modbus_slave import ModbusSlave
from rigctl.world.plant import Motion
from rigctl.world.simulation import SimulatedLink

FIRMWARE_VERSION = 1
BUILD_HASH = 0x56495254
BYTE_US = 10e6 / BAUD
REPLY_DELAY_US = 500
FREE_STACK_BYTES = 4096
_U16, _U32 = 0xFFFF, 0xFFFFFFFF


class VirtualDrum:
    """The drum board from power-up on. Times are world microseconds.

    The simulation calls :meth:`pass_time` at every ``next_us`` and tells what happens on the
    bench; the board's hands are ``duty``, ``limits_mm`` and ``motion``.
    """

    def __init__(self, bench: Bench, link: SimulatedLink) -> None:
        self.bench = bench
        self._link = link
        self._clock = 1.0 + bench.parameters.drum_clock_ppm * 1e-6
        self._motion = DrumMotion()
        self._boots = 0
        self._saved: dict[str, int] = {}
        self._inbox: deque[tuple[int, int, bytes]] = deque()
        self._outbox: deque[tuple[int, bytes]] = deque()
        self.now_us = 0
        self._boot(0, ResetCause.POWER_ON)
        link.attach(self._receive)

    def _boot(self, at_us: int, cause: ResetCause) -> None:
        self._boots += 1
        self._cause = 1 << cause
        self._motion.halt(at_us)
        self._inbox.clear()
        self._outbox.clear()
        self._bank = RegisterBank(self)
        self._bank.restore(self._saved)
        self._settings_from = SettingsFrom.SAVED if self._saved else SettingsFrom.DEFAULTS
        self._slave = ModbusSlave(self._bank)
        self.controller = Controller(self.bench, self._motion, self._bank, self._clock, at_us)
        self.controller.saved = self._saved

    @property
    def registers(self) -> RegisterBank:
        """Its registers, behind the wire."""
        return self._bank

    @property
    def duty(self) -> float:
        """Drive of the actuator now."""
        return self.controller.actuator.duty

    @property
    def limits_mm(self) -> tuple[float, float]:
        """Actuator travels at which the board wants to know."""
        return self.controller.actuator.limits_mm

    @property
    def motion(self) -> Motion:
        """What the steps do now."""
        return self._motion.motion

    @property
    def next_us(self) -> float:
        """When :meth:`pass_time` must be called next."""
        return min(self.controller.next_us, self.next_wire_us)

    @property
    def next_but_silence_us(self) -> float:
        """As :attr:`next_us` while the load cell speaks in time."""
        brain = self.controller
        waits_us = min(brain.waits.next_but_silence_us, brain.turner.motion.next_us)
        return min(waits_us, self.next_wire_us)

    @property
    def next_wire_us(self) -> float:
        """When a request is complete or an answer arrives, if one is on the wire."""
        inbox, outbox = self._inbox, self._outbox
        if not inbox:
            return outbox[0][0] if outbox else math.inf
        return min(inbox[0][1], outbox[0][0]) if outbox else inbox[0][1]

    def pass_time(self, now_us: int) -> None:
        """Do what is due by now, in the order in which it is due."""
        self.now_us = now_us
        self.controller.pass_time(now_us)
        while self._inbox and self._inbox[0][1] <= now_us:
            first_us, last_us, data = self._inbox.popleft()
            if self.controller.state is not State.BOOT:
                self._answer(self._slave.take(data, first_us, last_us))
        while self._outbox and self._outbox[0][0] <= now_us:
            at_us, data = self._outbox.popleft()
            self._link.deliver(data, at_us * 1e-6)

    def reset(self, now_us: int) -> None:
        """The reset button: outputs fall off, everything unsaved is forgotten."""
        self.controller.turner.halt(now_us)
        self._saved = self.controller.saved
        self._boot(now_us, ResetCause.EXTERNAL)

    def _receive(self, data: bytes) -> None:
        free_us = self._inbox[-1][1] if self._inbox else self.now_us
        first_us = max(free_us, self.now_us)
        self._inbox.append((first_us, first_us + math.ceil(len(data) * BYTE_US), data))

    def _answer(self, data: bytes) -> None:
        if data:
            free_us = self._outbox[-1][0] if self._outbox else self.now_us
            start_us = max(free_us, self.now_us + REPLY_DELAY_US)
            self._outbox.append((start_us + math.ceil(len(data) * BYTE_US), data))

    # The registers' owner

    def command(self, command: int, sequence: int) -> bool:
        """Execute a command; False refuses it."""
        return self.controller.command(self.now_us, Command(command), sequence)

    def beat(self) -> None:
        """The computer is alive."""
        self.controller.beat(self.now_us)

    def written(self, names: set[str]) -> None:
        """The computer wrote these settings."""
        if "tare_counts" in names:
            self.controller.tares.tared = True
        if names & {"optional_signals", "signal_polarity"}:
            self.controller.rewired(self.now_us)
            self.controller.estop_changed(self.now_us)

    def ring(self) -> tuple[Sequence[int], Sequence[int]]:
        """Load-cell ring: raw counts, wrapped board times."""
        cell = self.controller.cell
        return cell.raw, [t & _U32 for t in cell.time_us]

    def report(self, block: str) -> Values:
        """Raw integers of one block of registers."""
        if block == "identity":
            return self._report_identity()
        if block == "counters":
            return self._report_counters()
        return self._report_state() | self._report_motion() | self._report_loadcell()

    def _report_identity(self) -> Values:
        p = self.bench.parameters
        return {
            "magic": (MAGIC,),
            "map_version": (MAP_VERSION,),
            "board_id": (BOARD_DRUM,),
            "firmware_version": (FIRMWARE_VERSION,),
            "build_hash": (BUILD_HASH,),
            "boot_count": (self._boots & _U16,),
            "reset_cause": (self._cause,),
            "ring_depth": (RING_DEPTH,),
            "steps_per_turn": (round(p.steps_per_turn),),
            "nm_per_step": (round(p.mm_per_step * 1e6),),
        }

    def _report_state(self) -> Values:
        c = self.controller
        contact_um = round(1e3 * (c.presser.contact_mm or 0.0))
        return {
            "state": (c.state,),
            "fault": (c.fault,),
            "fault_at_ms": (c.fault_at_us // 1000,),
            "fault_bits": (sum(1 << cause for cause in set(c.causes)),),
            "board_time_us": (c.board_us(self.now_us) & _U32,),
            "command_acknowledged": (c.acknowledged,),
            "command_result": (c.result,),
            "heartbeat_seen": (self._bank.settings["heartbeat"],),
            "crc_errors": (self._slave.crc_errors & _U16,),
            "late_ticks": (0,),
            "status_bits": (self.status_bits,),
            "last_contact_um": (contact_um,),
        }

    def _report_motion(self) -> Values:
        turner, actuator = self.controller.turner, self.controller.actuator
        speed = turner.speed_set_mm_s(self.now_us, self._bank.settings)
        turn = self.bench.parameters.steps_per_turn
        return {
            "steps": (turner.steps(self.now_us),),
            "angle": (int(36000 * turner.angle_steps(self.now_us) / turn),),
            "speed": (round(100 * speed),),
            "actuator_position_um": (round(1e3 * actuator.position_mm),),
            "actuator_drive": (round(1e3 * actuator.duty),),
            "sync_count": (turner.sync_count & _U16,),
            "sync_rise_us": (self.controller.board_us(turner.sync_rise_us) & _U32,),
            "sync_fall_us": (self.controller.board_us(turner.sync_fall_us) & _U32,),
            "index_count": (turner.index_count & _U16,),
        }

    def _report_loadcell(self) -> Values:
        cell = self.controller.cell
        return {
            "force": (max(-32768, min(32767, round(10 * cell.force_g))),),
            "loadcell_sequence": (cell.sequence & _U16,),
            "loadcell_time_us": (cell.newest_us & _U32,),
            "loadcell_recent": cell.recent(LOADCELL_RECENT),
        }

    def _report_counters(self) -> Values:
        error_steps = self.controller.turner.index_error_steps
        return {
            "frames_seen": (self._slave.frames_seen & _U16,),
            "exceptions_sent": (self._slave.exceptions_sent & _U16,),
            "longest_isr_us": (0,),
            "free_stack_bytes": (FREE_STACK_BYTES,),
            "idle_permille": (1000,),
            "loadcell_dropped": (0,),
            "index_error_steps": (error_steps,),
            "settings_from": (self._settings_from,),
        } | self._report_proposal()

    def _report_proposal(self) -> Values:
        found = self.controller.proposal
        if found is None:
            return {}
        return {
            "proposed_gain_p": (round(100 * found.gain_p),),
            "proposed_gain_i": (round(100 * found.gain_i),),
            "tuned_stiffness_g_per_mm": (round(found.stiffness_g_per_mm),),
            "tuned_delay": (round(1e4 * found.delay_s),),
        }

    @property
    def status_bits(self) -> int:
        """What :class:`Status` names, as bits."""
        c = self.controller
        switches = c.health.fitted(Signal.END_SWITCHES)
        return (
            c.turner.sync_high << Status.SYNC_HIGH
            | self.bench.plant.index_high << Status.INDEX_HIGH
            | c.presser.settled << Status.FORCE_SETTLED
            | c.presser.in_contact << Status.IN_CONTACT
            | self._motion.constant << Status.SPEED_CONSTANT
            | (not c.health.estop_wire_open) << Status.ESTOP_CLOSED
            | (switches and c.actuator.at_upper_end) << Status.END_UP
            | (switches and c.actuator.at_lower_end) << Status.END_DOWN
            | c.turner.homed << Status.HOMED
            | c.tares.tared << Status.TARED
        )
