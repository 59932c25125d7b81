"""What the steps of the setup work with: the boards, a person, and rig.toml."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_states import FAULT_TEXT, Fault, State
from rigctl.config.toml_edit import Value, replace_file
from rigctl.engine.calibrator import Calibrator, edited_rig_file
from rigctl.engine.contact import has_status
from rigctl.engine.motion import DrumMotion
from rigctl.engine.rig import Rig
from rigctl.engine.setup.check_result import Question
from rigctl.engine.setup.progress import Progress, load_progress
from rigctl.errors import BoardFault, CommandRefused, LinkLost
from rigctl.values import DrumState

Ask = Callable[[Question], Awaitable[str]]
"""Asks a person and returns the answer, which fits the question."""
LIFT_S = 40.0


class SetupContext:
    """One rig that is set up. ``kept``: what the present step has written into ``rig.toml``.

    ``today`` returns the date.
    """

    def __init__(
        self, rig: Rig, calibrator: Calibrator, ask: Ask, today: Callable[[], str]
    ) -> None:
        self.rig, self.calibrator, self.today = rig, calibrator, today
        self.kept: dict[str, dict[str, Value]] = {}
        self._ask = ask

    @property
    def motion(self) -> DrumMotion:
        """The moves of the drum."""
        return self.calibrator.motion

    async def ask(self, question: Question) -> str:
        """Return a person's answer; a simulated bench does by itself what is asked."""
        return await self._ask(question)

    async def number(self, question: Question) -> float:
        """Return the number that a person answers."""
        return float(await self._ask(question))

    async def watch(self, seconds: float) -> list[DrumState]:
        """Return the polls of this time, faults or not. Raises LinkLost."""
        poller, polls = self.motion.poller, list[DrumState]()
        end_s = poller.loop.time() + seconds
        unsubscribe = poller.subscribe(polls.append)
        try:
            await poller.wait_cycle()  # a poll under way is older than what was done
            polls.clear()
            while poller.loop.time() < end_s or not polls:
                await poller.wait_cycle()
                if poller.link_error:
                    raise LinkLost(poller.link_error)
        finally:
            unsubscribe()
        return polls

    async def look(self) -> DrumState:
        """Return a state that is newer than what was done."""
        return (await self.watch(0.2))[-1]

    async def registers(self, *names: str) -> dict[str, float]:
        """Read registers in engineering units."""
        return await self.motion.poller.drum.get(*names)

    async def clear(self) -> None:
        """Clear a latched fault. Raises BoardFault, which names it, while its cause is present."""
        state = await self.look()
        if not self.motion.poller.fault_latched:
            return
        end_s = self.rig.loop.time() + LIFT_S
        while state.state == State.FAULT_LIFT and self.rig.loop.time() < end_s:
            state = await self.look()
        try:
            await self.motion.poller.drum.command(Command.CLEAR)
        except CommandRefused:
            raise BoardFault(FAULT_TEXT[Fault(state.fault)]) from None
        await self.look()
        await self.motion.wait_started()
        await self.motion.configure()

    async def configure(self) -> None:
        """Write what ``rig.toml`` says of the wires to the board. Raises CommandRefused."""
        if refusal := await self.motion.configure():
            raise CommandRefused(refusal)

    def progress(self) -> Progress:
        """Return how far the setup of this board has come. Raises WrongUse for another board's."""
        rig, state = self.rig, self.motion.poller.state
        is_commissioned = state is not None and has_status(state, Status.COMMISSIONED)
        return load_progress(rig.path, rig.drum.identity, rig.config, is_commissioned)

    def require_taxels(self) -> None:
        """Raise LinkLost where the taxel board is away."""
        if not self.rig.taxels.connected:
            raise LinkLost("the taxel board is lost: check its cable")

    async def taxel_samples(self, seconds: float) -> NDArray[np.uint16]:
        """Return what the taxel board sends in this time, uint16 (n, 18), in the sensor's order."""
        blocks: list[NDArray[np.uint16]] = []
        unsubscribe = self.rig.taxels.on_block(lambda block: blocks.append(block.samples))
        try:
            await self.watch(seconds)
        finally:
            unsubscribe()
        self.require_taxels()
        if not blocks:
            raise LinkLost("the taxel board sends no samples: check its cable")
        return np.concatenate(blocks)

    def keep(self, table: str, keys: Mapping[str, Value]) -> None:
        """Write keys into ``rig.toml``, if the rig has one, and use them from now on.

        Raises ConfigError where the file then contradicts itself, DiskFault.
        """
        if self.rig.path is not None:
            replace_file(self.rig.path, edited_rig_file(self.rig.path, table, keys))
        self.kept.setdefault(table, {}).update(keys)
        config = self.rig.config
        frozen = {key: tuple(v) if isinstance(v, list) else v for key, v in keys.items()}
        changed: Any = {table: replace(getattr(config, table), **frozen)}
        self.rig.config = self.motion.config = replace(config, **changed)
