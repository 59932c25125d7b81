"""What a board says it is, as a value, or why it is not the board that was asked for."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from rigctl.errors import LinkLost, WrongBoard
from rigctl.values import N_TAXELS, BoardIdentity
from rigctl.wire.drum import register_table
from rigctl.wire.drum.register_table import BOARD_TAXELS, MAGIC
from rigctl.wire.taxels.frames import WIRE_VERSION, TaxelIdentity

WhosThere = Callable[[], Awaitable[str]]
"""Asks a port that did not answer as expected; a sentence, or nothing where nobody answers."""


async def explain(failure: BaseException, whos_there: WhosThere | None) -> None:
    """Raise WrongBoard with the sentence of ``whos_there``, where it has a better one."""
    if whos_there is not None and isinstance(failure, LinkLost | WrongBoard):
        sentence = await whos_there()
        if sentence:
            raise WrongBoard(sentence) from failure


def drum_identity(name: str, raw: dict[str, tuple[int, ...]]) -> BoardIdentity:
    """What the identity block says. Raises WrongBoard where it is not our drum."""
    if raw["magic"][0] != MAGIC or raw["board_id"][0] != register_table.BOARD_DRUM:
        raise WrongBoard(
            f"{name}: a Modbus device answered that is no drum board: "
            "rigctl ports shows what hangs where"
        )
    version = raw["firmware_version"][0]
    if raw["map_version"][0] != register_table.MAP_VERSION:
        raise WrongBoard(
            f"{name}: the drum board's firmware {version >> 8}.{version & 255} speaks register "
            f"map {raw['map_version'][0]}, this program map {register_table.MAP_VERSION}: "
            "make firmware, then flash it"
        )
    return BoardIdentity(
        board="drum",
        firmware_version=f"{version >> 8}.{version & 255}",
        build_hash=f"{raw['build_hash'][0]:08x}",
        wire_version=raw["map_version"][0],
        boot_count=raw["boot_count"][0],
        reset_cause=raw["reset_cause"][0],
        details={n: raw[n][0] for n in ("ring_depth", "steps_per_turn", "nm_per_step")},
    )


def taxel_identity(name: str, told: TaxelIdentity) -> BoardIdentity:
    """The board's identity as a value. Raises WrongBoard where it is not our taxel board."""
    version = f"{told.firmware_version >> 8}.{told.firmware_version & 255}"
    if told.magic != MAGIC or told.board_id != BOARD_TAXELS:
        raise WrongBoard(
            f"{name}: the board there is no taxel board: rigctl ports shows what hangs where"
        )
    if told.wire_version != WIRE_VERSION or told.n_taxels != N_TAXELS:
        raise WrongBoard(
            f"{name}: the taxel board's firmware {version} speaks wire version "
            f"{told.wire_version} with {told.n_taxels} taxels, this program version "
            f"{WIRE_VERSION} with {N_TAXELS}: make firmware, then flash it"
        )
    return BoardIdentity(
        board="taxels",
        firmware_version=version,
        build_hash=f"{told.build_hash:08x}",
        wire_version=told.wire_version,
        boot_count=told.boot_count,
        reset_cause=told.reset_cause,
        details={"rate_hz": told.rate_hz, "slots": told.slots, "slot_cycles": told.slot_cycles},
    )
