"""The virtual finger: operator, skin, tracker, and the board's firmware behind its cable.

Time passes only inside :meth:`VirtualFinger.advance`, in the caller's thread. Everything is the
same for the same seed and the same calls. The draws of a slide depend on seed, session and the
slide's number alone, so a later run can continue with the next slide.

Timing of the link: the board takes sample *n* at *n* + 1 ms after power-up. USB carries bytes to
either side within :data:`USB_US`. Samples reach the host every :data:`FLUSH_US`; what the board
sends in answer to a request comes at once, with the samples before it.
"""

from __future__ import annotations

from collections import deque
from functools import cache
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from rigctl.bench.parameter_fields import checked
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import Direction, Rate, SimulatedLink
from rigctl.bench.textures import CATALOGUE, find_texture
from rigctl.errors import WrongUse
from rigctl.finger.bench import hand
from rigctl.finger.bench.boards import ConverterBoard, FingerBoard, TaxelLineBoard
from rigctl.finger.bench.hand import Change, Hand
from rigctl.finger.bench.operator import (
    ALONG,
    FORCE,
    WRIST_ALONG,
    Slide,
    draw_habits,
    draw_slide,
)
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.bench.skin import FingerSkin
from rigctl.finger.bench.tracker import SimulatedTracker
from rigctl.finger.values import PLATE_CORNERS_MM, VelocityProfile

FaultSeconds = Annotated[float, Meta(ge=0, le=60)]
PlateName = Annotated[str, Meta(max_length=16)]


class DisturbedFinger(Protocol):
    """What the faults act on."""

    time_us: int
    finger: SimulatedLink
    tracker: SimulatedTracker

    def change_slide(self, change: hand.Change) -> None:
        """Change the slide from now on, or in the middle of the next one if there is none."""

    def swap_plate(self, texture: str) -> None:
        """Lay this plate out for the next slide, whatever is announced."""

    def reset(self) -> None:
        """Boot the board."""


class FingerFaults:
    """Injects faults. Those of the person act on the slide that is under way, from now on; without
    one, they act in the middle of the next slide.
    """

    def __init__(self, disturbed: DisturbedFinger) -> None:
        self._disturbed = disturbed

    def unplug(self) -> None:
        """Unplug the board's cable, which also powers the board."""
        self._disturbed.finger.unplug()

    def replug(self) -> None:
        """Plug the cable in; the board boots."""
        self._disturbed.finger.replug()
        self._disturbed.reset()

    def reset(self) -> None:
        """Press the board's reset button."""
        self._disturbed.reset()

    def stall(self, on: bool = True) -> None:
        """Silence the cable in both directions without closing the port."""
        self._disturbed.finger.stalled = on

    def drop_bytes(self, direction: Direction, rate: Rate) -> None:
        """Drop this share of bytes; ``direction`` is ``"to_host"`` or ``"to_board"``."""
        self._disturbed.finger.noise[direction].drop_rate = rate

    def corrupt_bytes(self, direction: Direction, rate: Rate) -> None:
        """Flip one bit in this share of bytes."""
        self._disturbed.finger.noise[direction].corrupt_rate = rate

    def unplug_tracker(self) -> None:
        """Switch the tracker off."""
        self._disturbed.tracker.unplug()

    def replug_tracker(self) -> None:
        """Switch the tracker on."""
        self._disturbed.tracker.replug()

    def lose_tracker(self, seconds: FaultSeconds) -> None:
        """Hide the tracker from its base stations: it says that its positions are not valid."""
        self._disturbed.tracker.lose(self._disturbed.time_us, seconds)

    def lift(self, seconds: FaultSeconds) -> None:
        """Lift the finger for a time while the hand moves on."""
        self._disturbed.change_slide(hand.lift_for(seconds))

    def reverse(self) -> None:
        """Run back for about half a second, then go on."""
        self._disturbed.change_slide(hand.reverse)

    def stand_still(self, seconds: FaultSeconds) -> None:
        """Stop for a time with the finger on the plate, then go on."""
        self._disturbed.change_slide(hand.stand_still(seconds))

    def too_fast(self) -> None:
        """Make the rest of the slide at 600 mm/s."""
        self._disturbed.change_slide(hand.too_fast)

    def short_scan(self) -> None:
        """Stop and lift the finger before the end."""
        self._disturbed.change_slide(hand.stop_early)

    def wrong_plate(self, texture: PlateName) -> None:
        """Lay another plate out for the next slide. Raises WrongUse for an unknown one."""
        if texture not in CATALOGUE:
            raise WrongUse(f"no plate {texture!r}: the catalogue has A to P")
        self._disturbed.swap_plate(texture)


KEPT_MS = 600_000
"""What nobody takes is kept for ten minutes."""


class FingerTruthArrays(NamedTuple):
    """True values, one row a millisecond; row ``i`` holds at ``first_ms + i + 1`` ms world time.

    ``along_mm``, ``across_mm``, ``height_mm``: float32 (n,), the fingertip on the plate, the middle
    across being 0. ``force_g``: float32 (n,). ``plate``: S1 (n,), the plate under the finger, and
    ``slide``: int32 (n,), the slide's number; before the first slide they are "-" and -1.
    """

    first_ms: int
    along_mm: NDArray[np.float32]
    across_mm: NDArray[np.float32]
    height_mm: NDArray[np.float32]
    force_g: NDArray[np.float32]
    plate: NDArray[np.bytes_]
    slide: NDArray[np.int32]


class FingerTruth:
    """Log of the truth. ``plate`` and ``slide`` are those of the next rows."""

    def __init__(self) -> None:
        self.plate = "-"
        self.slide = -1
        self._first_ms = 0
        self.n_rows = 0
        """Milliseconds that are kept and not yet taken."""
        self._parts: deque[tuple[NDArray[np.float32], str, int]] = deque()

    def append(self, rows: NDArray[np.float64]) -> None:
        """Append milliseconds: along, across, height, force, float64 (n, 4)."""
        self._parts.append((rows.astype(np.float32), self.plate, self.slide))
        self.n_rows += len(rows)
        while self.n_rows > KEPT_MS:
            self._drop(len(self._parts.popleft()[0]))

    def arrays(self) -> FingerTruthArrays:
        """Return everything that is kept and not yet taken."""
        parts = [rows for rows, _, _ in self._parts]
        rows = np.concatenate([np.empty((0, 4), np.float32), *parts])
        sizes = [len(part) for part in parts]
        plates = np.repeat(np.array([plate for _, plate, _ in self._parts], "S1"), sizes)
        slides = np.repeat(np.array([slide for _, _, slide in self._parts], np.int32), sizes)
        along, across, height, force = rows.T.copy()
        return FingerTruthArrays(self._first_ms, along, across, height, force, plates, slides)

    def take(self) -> FingerTruthArrays:
        """Return and discard everything that is kept."""
        taken = self.arrays()
        self._parts.clear()
        self._drop(self.n_rows)
        return taken

    def _drop(self, count: int) -> None:
        self._first_ms += count
        self.n_rows -= count


FINGER = "finger"
FLUSH_US = 10_000
"""Period in which samples reach the host, as on the bench's virtual taxel board."""

USB_US = 500
"""Time of bytes on the cable, each way; USB 2.0 polls every 125 µs, and a host needs some more."""

WARM_UP_US = 1_500_000
"""By then a first slide is on the plate."""

_HABITS, _SLIDE, _TRACKER, _TRACKED_SLIDE, _CORNERS = range(5)
"""Purposes of the random draws."""
_SLIDING = "the operator is sliding: wait until the finger is lifted"


def open_virtual_finger(
    parameters: WorldParameters | None = None,
    operator: OperatorParameters | None = None,
    seed: int = 0,
    session: int = 0,
    *,
    tracker: TrackerParameters | None = None,
    taxel_board: bool = False,
    first_slide: int = 0,
) -> VirtualFinger:
    """Return a virtual finger at power-up, reproducible for seed and session.

    Sessions of a seed differ in the person's habits, the attachment of the sensor, its drift and
    the tracker's frame. ``taxel_board``: the samples come as the taxel board's frames on a second
    line, instead of from the finger board's own converter. ``first_slide`` continues an earlier
    run. Raises WrongUse for a parameter outside its plausible range, RigFault if a board's library
    cannot be used.
    """
    return VirtualFinger(
        TaxelLineBoard() if taxel_board else ConverterBoard(),
        parameters or WorldParameters(),
        operator or OperatorParameters(),
        tracker or TrackerParameters(),
        (seed, session),
        first_slide,
    )


@cache
def compile_finger_kernels() -> None:
    """Compile or load every kernel of a virtual finger.

    Compiling takes seconds after an update; during a run it would stall a paced simulation.
    """
    finger = open_virtual_finger()
    finger.slide("A", VelocityProfile.FAST)
    finger.advance(WARM_UP_US)
    finger.close()


class VirtualFinger:
    """A person with the sensor on a finger, one slide after the other over flat plates.

    ``time_us`` is simulated time. ``finger`` is the board's cable, ``tracker`` the tracker on the
    wrist, ``faults`` injects faults, ``truth`` logs what nobody measures. ``next_slide`` is the
    number of the next slide.
    """

    def __init__(
        self,
        board: FingerBoard,
        parameters: WorldParameters,
        operator: OperatorParameters,
        tracker: TrackerParameters,
        seed: tuple[int, int],
        first_slide: int,
    ) -> None:
        self.time_us = 0
        self.next_slide = first_slide
        self.truth = FingerTruth()
        self._seed = seed
        self._operator = checked(operator, "operator")
        self._habits = draw_habits(operator, self._random(_HABITS))
        skin_seed = int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])
        self._parameters = parameters
        self._skin = FingerSkin(parameters, skin_seed, self._habits.rest)
        self._hand = Hand(operator)
        self.finger = SimulatedLink(FINGER, skin_seed)
        self.tracker = SimulatedTracker(
            checked(tracker, "tracker"), operator, self._hand.at, self._random(_TRACKER)
        )
        self.faults = FingerFaults(self)
        self._change: Change | None = None
        self._swapped: str | None = None
        self._planned: deque[tuple[int, int, str, Slide]] = deque()
        self._requests: deque[tuple[int, bytes]] = deque()
        self._deliveries: deque[tuple[int, bytes]] = deque()
        self._flush_us = FLUSH_US
        self._done_ms = 0
        self._closed = False
        self._board = board
        self.finger.attach(lambda data: self._requests.append((self.time_us + USB_US, data)))
        self.reset()

    @property
    def sliding(self) -> bool:
        """True from the call of :meth:`slide` until the finger is in the air again."""
        return self._hand.sliding(self.time_us // 1000)

    @property
    def slice_us(self) -> int:
        """Time to the next event that the host can notice, microseconds, at least 1."""
        return max(1, self._next_us() - self.time_us)

    def slide(self, texture: str, profile: VelocityProfile) -> None:
        """Ask the operator to make one slide over a plate, beginning as soon as the hand is back.

        Raises WrongUse during a slide and for an unknown plate.
        """
        if self.sliding:
            raise WrongUse(_SLIDING)
        self.check_plate(texture)
        plate, self._swapped = self._swapped or texture, None
        change, self._change = self._change, None
        number = self.next_slide
        self.next_slide += 1
        slide = draw_slide(self._operator, self._habits, profile, self._random(_SLIDE, number))
        begin_ms = self._hand.plan(slide, self.time_us // 1000, change)
        self._planned.append((begin_ms, number, plate, slide))

    def check_plate(self, texture: str) -> None:
        """Raise WrongUse for an unknown plate."""
        find_texture(texture, self._parameters)

    def touch_corners(self) -> list[tuple[str, tuple[float, float, float]]]:
        """Return the tracker's position while the finger touches each corner, mm in its frame."""
        return self.tracker.touch_corners(self._random(_CORNERS))

    def touch_corner(self, name: str) -> None:
        """Let the tracker report a finger that rests on a corner, until the next slide begins.

        Raises WrongUse during a slide and for an unknown corner.
        """
        if self.sliding:
            raise WrongUse(_SLIDING)
        if name not in PLATE_CORNERS_MM:
            raise WrongUse(f"there is no corner {name!r}: touch {', '.join(PLATE_CORNERS_MM)}")
        number = list(PLATE_CORNERS_MM).index(name)
        self.tracker.touch_corner(name, self._random(_CORNERS, number))

    def change_slide(self, change: Change) -> None:
        """Change the slide from now on, or in the middle of the next one if there is none."""
        if not self._hand.change(self.time_us // 1000, change):
            self._change = change

    def swap_plate(self, texture: str) -> None:
        """Lay this plate out for the next slide, whatever is announced."""
        self._swapped = texture

    def reset(self) -> None:
        """Boot the board; what it had not sent is lost."""
        self._requests.clear()
        self._deliveries.clear()
        self._board.boot()

    def advance(self, until_us: int) -> None:
        """Simulate up to a time.

        A closed finger only advances its time: an event loop may still have timers.
        """
        while not self._closed and (at_us := self._next_us()) <= until_us:
            self.time_us = max(self.time_us, at_us)
            self._handle_events()
        self.time_us = until_us

    def close(self) -> None:
        """Free the board and close link and tracker."""
        self._closed = True
        self.finger.close()
        self.tracker.close()
        self._board.close()

    def _random(self, *purpose: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=purpose))

    def _next_us(self) -> int:
        times = [self._flush_us, int(np.ceil(self.tracker.next_us))]
        times += [queue[0][0] for queue in (self._requests, self._deliveries) if queue]
        return min(times)

    def _handle_events(self) -> None:
        now_us = self.time_us
        while self._requests and self._requests[0][0] <= now_us:
            self._run_to(now_us // 1000)
            self._answer(self._requests.popleft()[1])
        while self._deliveries and self._deliveries[0][0] <= now_us:
            at_us, data = self._deliveries.popleft()
            self.finger.deliver(data, at_us * 1e-6)
        if self._flush_us <= now_us:
            self._flush()
        if self.tracker.next_us <= now_us:
            self.tracker.advance()

    def _answer(self, request: bytes) -> None:
        if self.finger.plugged:
            self._board.receive(request)
            self._send(self.time_us + USB_US)

    def _flush(self) -> None:
        """Deliver the samples whose bytes have crossed the cable."""
        self._run_to((self._flush_us - USB_US) // 1000)
        self._send(self._flush_us)
        self._flush_us += FLUSH_US

    def _send(self, at_us: int) -> None:
        sent = self._board.take_sent()
        if self._deliveries:
            at_us = max(at_us, self._deliveries[-1][0])
        if sent and at_us <= self.time_us:
            self.finger.deliver(sent, at_us * 1e-6)
        elif sent:
            self._deliveries.append((at_us, sent))

    def _run_to(self, until_ms: int) -> None:
        """Pass time on hand, skin and board, which has no power while it is unplugged."""
        while self._done_ms < until_ms:
            if self._planned and self._planned[0][0] <= self._done_ms + 1:
                self._begin_slide(*self._planned.popleft()[1:])
            end_ms = min(until_ms, self._planned[0][0] - 1) if self._planned else until_ms
            rows = self._hand.rows(self._done_ms + 1, end_ms + 1)
            self.truth.append(rows[:, :WRIST_ALONG])
            readings = self._skin.advance(rows[:, ALONG], rows[:, FORCE])
            if self.finger.plugged:
                self._board.run(readings)
            self._done_ms = end_ms

    def _begin_slide(self, number: int, plate: str, slide: Slide) -> None:
        self.truth.plate, self.truth.slide = plate, number
        self._skin.begin_slide(number, plate, slide.mounting)
        self.tracker.begin_slide(self._random(_TRACKED_SLIDE, number))
