"""The identity that a board reports, as a value, or the reason why it is the wrong board."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable

from rigctl.boards.boot_silence import ASK_S, BootSilence
from rigctl.boards.drum_registers import BOARD_DRUM, BOARD_TAXELS, MAGIC, MAP_VERSION
from rigctl.boards.links import ByteLink
from rigctl.boards.taxel_frames import WIRE_VERSION, TaxelIdentity
from rigctl.config.rig_config import TaxelArray
from rigctl.errors import LinkLost, RigFault, WrongBoard
from rigctl.values import BoardIdentity

CONNECT_TIMEOUT_S = 4.0
"""A board that no bootloader holds up answers within this time after a reset."""
WHICH_PORT = "rigctl ports shows which board is on which port"
GIVE_IT = "to give it this installation's firmware,"
_OFFERED = re.compile(rf"(\S+): the \w+ board's .* {GIVE_IT} `rigctl flash (\w+)`")

PortDiagnosis = Callable[[ByteLink], Awaitable[str]]
"""Returns a sentence about the other board at an open link; empty where no board answers."""


async def raise_diagnosis(
    failure: BaseException, link: ByteLink, diagnose_port: PortDiagnosis | None
) -> None:
    """Raise WrongBoard with the sentence of ``diagnose_port``, where it has one."""
    if diagnose_port is None or not link.is_open or not isinstance(failure, LinkLost | WrongBoard):
        return
    sentence = await diagnose_port(link)
    if sentence:
        raise WrongBoard(sentence) from failure


def no_answer(silence: BootSilence, link: ByteLink, board: str, bytes_came: bool) -> RigFault:
    """Return the error of a connect to ``board`` that was not answered in time.

    After a board that talked, a silence begins.
    """
    port = link.name
    if silence.lose():
        return LinkLost(f"{silence.text}; then it is asked again: check cable and supply")
    seconds = f"within {ASK_S if link.resets_board else CONNECT_TIMEOUT_S:g} s"
    if not bytes_came:
        text = f"{port}: no {board} board answered {seconds}: check cable and supply; {WHICH_PORT}"
        return LinkLost(text)
    return WrongBoard(
        f"{port}: bytes came, but no complete reply from a {board} board {seconds}: "
        f"another board or baud rate? {WHICH_PORT}"
    )


def offered_flash(refusal: str) -> tuple[str, str] | None:
    """Return board and port of a refusal that flashing cures, None for any other."""
    offered = _OFFERED.search(refusal)
    return (offered[2], offered[1]) if offered else None


def drum_identity(name: str, raw: dict[str, tuple[int, ...]]) -> BoardIdentity:
    """Return the drum's identity from its identity block; raises WrongBoard for another board."""
    if raw["magic"][0] != MAGIC or raw["board_id"][0] != BOARD_DRUM:
        raise WrongBoard(f"{name}: the Modbus device there is not a drum board: {WHICH_PORT}")
    version, map_version = version_text(raw["firmware_version"][0]), raw["map_version"][0]
    if map_version != MAP_VERSION:
        raise WrongBoard(
            f"{name}: the drum board's firmware {version} speaks register map {map_version}, "
            f"this program map {MAP_VERSION}: "
            f"{GIVE_IT} `rigctl flash drum`"
        )
    return BoardIdentity(
        board="drum",
        firmware_version=version,
        build_hash=f"{raw['build_hash'][0]:08x}",
        wire_version=map_version,
        boot_count=raw["boot_count"][0],
        reset_cause=raw["reset_cause"][0],
        details={n: raw[n][0] for n in ("ring_depth", "steps_per_turn", "nm_per_step")},
    )


def taxel_identity(
    name: str, reported: TaxelIdentity, sensor: TaxelArray | None = None
) -> BoardIdentity:
    """Return the taxel board's identity.

    Raises WrongBoard for another board or wire version, and for the board of another sensor than
    ``sensor``; None takes any.
    """
    version = version_text(reported.firmware_version)
    if reported.magic != MAGIC or reported.board_id != BOARD_TAXELS:
        raise WrongBoard(f"{name}: the board there is not a taxel board: {WHICH_PORT}")
    if reported.wire_version != WIRE_VERSION:
        raise WrongBoard(
            f"{name}: the taxel board's firmware {version} speaks wire version "
            f"{reported.wire_version}, this program version {WIRE_VERSION}: "
            f"{GIVE_IT} `rigctl flash taxels`"
        )
    if sensor is not None and reported.n_taxels != sensor.count:
        raise WrongBoard(
            f"{name}: the taxel board's firmware {version} sends {reported.n_taxels} taxels, "
            f"rig.toml describes {sensor.count}: correct [taxels] count there or, "
            f"{GIVE_IT} `rigctl flash taxels`"
        )
    return BoardIdentity(
        board="taxels",
        firmware_version=version,
        build_hash=f"{reported.build_hash:08x}",
        wire_version=reported.wire_version,
        boot_count=reported.boot_count,
        reset_cause=reported.reset_cause,
        details={n: getattr(reported, n) for n in ("rate_hz", "slots", "slot_cycles")},
    )


def version_text(number: int) -> str:
    """Return a firmware's version from its number on the wire."""
    return f"{number >> 8}.{number & 255}"
