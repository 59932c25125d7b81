"""Requests to the finger board, the messages that answer them, and refusals as sentences."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

from rigctl.devices.links.byte_link import ByteLink
from rigctl.errors import CommandRefused, LinkLost, RigFault, WrongUse
from rigctl.wire.finger import messages
from rigctl.wire.finger.messages import (
    N_TAXELS,
    Answer,
    FingerSettings,
    Message,
    RequestType,
    Result,
)

ANSWER_TIMEOUT_S = 0.5
"""The board answers before its next sample; the answer may queue behind samples."""
SETTINGS_ATTEMPTS = 3
"""Setting twice does no harm. Starting or stopping twice would: the board is asked once."""
MAX_READING = 1023
SLOWEST_REFERENCE_UM_PER_S, FASTEST_REFERENCE_UM_PER_S = 1_000, 10_000_000

_REFUSALS = {
    Result.WRONG_VALUE: "a value is outside its limits: see docs/reference/finger-wire.md",
    Result.SCANNING: "a scan is under way: stop it first",
    Result.NOT_WAITING: "no batch waits for it",
    Result.NO_MODEL: "its image has no classifier: build one with FINGER_MODEL",
}
_Kind = TypeVar("_Kind", bound=Message)


class _Expected(NamedTuple):
    fits: Callable[[Message], bool]
    answer: asyncio.Future[Message]


class FingerRequests:
    """Sends requests and returns the messages that fit them."""

    def __init__(self, link: ByteLink, loop: asyncio.AbstractEventLoop) -> None:
        self._link = link
        self._loop = loop
        self._expected: list[_Expected] = []

    def take(self, message: Message) -> None:
        """Pass a message of the board to those who wait for it."""
        for expected in self._expected:
            if not expected.answer.done() and expected.fits(message):
                expected.answer.set_result(message)

    def fail(self, fault: RigFault) -> None:
        """Raise ``fault`` where somebody waits: the board is gone or began anew."""
        for expected in self._expected:
            if not expected.answer.done():
                expected.answer.set_exception(fault)

    async def change(self, request: bytes, kind: RequestType, attempts: int, scan: int = 0) -> None:
        """Send a request that changes something and wait for the board's answer to it.

        Raises CommandRefused with the board's reason, LinkLost where no answer comes.
        """

        def fits(answer: Answer) -> bool:
            return answer.request is kind and answer.scan == scan

        answer = await self._ask_in_time(request, Answer, fits, attempts)
        if answer.result is not Result.OK:
            what = kind.name.lower().replace("_", " ")
            raise CommandRefused(
                f"{self._link.name}: the finger board refused to {what}: {_REFUSALS[answer.result]}"
            )

    async def read_settings(self) -> FingerSettings:
        """Return the settings. The board replies in order: older replies have come then, too."""
        return await self._ask_in_time(
            messages.read_settings(), FingerSettings, lambda _: True, SETTINGS_ATTEMPTS
        )

    async def wait(self, kind: type[_Kind], fits: Callable[[_Kind], bool]) -> None:
        """Wait for a message that the board sends unasked. Raises LinkLost where none comes."""
        await self._ask_in_time(b"", kind, fits, 1)

    async def ask(
        self,
        request: bytes,
        kind: type[_Kind],
        fits: Callable[[_Kind], bool] = lambda _: True,
        *,
        attempts: int,
        each_s: float,
    ) -> _Kind:
        """Send a request until a message of ``kind`` comes that fits; raises TimeoutError."""
        answer: asyncio.Future[Message] = self._loop.create_future()
        expected = _Expected(lambda message: isinstance(message, kind) and fits(message), answer)
        self._expected.append(expected)
        try:
            for _ in range(attempts):
                if request:
                    self._link.write(request)
                await asyncio.wait([answer], timeout=each_s)
                if answer.done():
                    message = answer.result()
                    assert isinstance(message, kind)
                    return message
            raise TimeoutError
        finally:
            self._expected.remove(expected)

    async def _ask_in_time(
        self, request: bytes, kind: type[_Kind], fits: Callable[[_Kind], bool], attempts: int
    ) -> _Kind:
        try:
            return await self.ask(request, kind, fits, attempts=attempts, each_s=ANSWER_TIMEOUT_S)
        except TimeoutError:
            raise LinkLost(
                f"{self._link.name}: the finger board sent no {kind.__name__} within "
                f"{attempts * ANSWER_TIMEOUT_S:g} s: check the cable, then connect it again"
            ) from None


def require_settings(
    low: Sequence[int], high: Sequence[int], reference_um_per_s: int
) -> FingerSettings:
    """Return the settings; raises WrongUse for values that the board would refuse or clip."""
    if len(low) != N_TAXELS or len(high) != N_TAXELS:
        raise WrongUse(f"the finger has {N_TAXELS} taxels: give a range for each")
    for taxel, (lowest, highest) in enumerate(zip(low, high, strict=True), start=1):
        if not 0 <= lowest < highest <= MAX_READING:
            raise WrongUse(
                f"taxel {taxel}: the range {lowest} to {highest} is empty or outside 0 to "
                f"{MAX_READING}: repeat the normalisation"
            )
    if not SLOWEST_REFERENCE_UM_PER_S <= reference_um_per_s <= FASTEST_REFERENCE_UM_PER_S:
        raise WrongUse(
            f"the reference speed {reference_um_per_s} µm/s is outside "
            f"{SLOWEST_REFERENCE_UM_PER_S} to {FASTEST_REFERENCE_UM_PER_S}"
        )
    return FingerSettings(tuple(map(int, low)), tuple(map(int, high)), int(reference_um_per_s))
