"""The faults that are injected: what begins each, what ends it, and how long it lasts.

Times are those of the simulated world, so a fault is the same on a fast computer and a busy one.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn

from rigctl.bench.simulated_rig import DRUM, TAXELS
from rigctl.session import recorder
from rigctl.session.writer import PartWriter
from tests.engine.engine_harness import EngineHarness

Action = Callable[[EngineHarness], None]
LONG_S = 90.0
"""Longer than a run waits for a board that is lost."""
BOOTLOADER_S = 1.0
"""How long a Mega's bootloader listens on a line without bytes."""


@dataclass(frozen=True, slots=True)
class Fault:
    """``name``: what somebody at the rig would say; ``where``: its kind in the list of faults.

    ``end`` cures it ``lasts_s`` after ``begin``.
    """

    where: str
    name: str
    begin: Action
    end: Action = lambda harness: None
    lasts_s: float = 0.0


def _of_rig(name: str, *arguments: Any) -> Action:
    """Return the call of a fault of the rig's own fault injection."""
    return lambda harness: getattr(harness.rig.faults, name)(*arguments)


def _switched(where: str, name: str, fault: str, lasts_s: float, *before: Any) -> Fault:
    """Return a fault that the rig switches on and off by a last argument."""
    on, off = (_of_rig(fault, *before, value) for value in (True, False))
    return Fault(where, name, on, off, lasts_s)


def _bootloader(board: str) -> Fault:
    def begin(harness: EngineHarness) -> None:
        harness.rig.faults.reset(board)
        harness.rig.faults.stall(board)

    end = _of_rig("stall", board, False)
    return Fault("bootloader", f"the {board} board's bootloader listens first", begin, end, 1.0)


def _sleep(seconds: float) -> Action:
    """Let the computer sleep: what the boards send meanwhile is lost."""

    def begin(harness: EngineHarness) -> None:
        faults = harness.rig.faults
        for board in (DRUM, TAXELS):
            faults.stall(board)
        faults.stall_computer(seconds)
        for board in (DRUM, TAXELS):
            faults.stall(board, False)

    return begin


# mypy refuses what these faults are: a method of the real object that fails from now on.
_WRITE, _SYNC, _PROBE = PartWriter.write, PartWriter.sync, recorder.probe_disk


def _disk(name: str, number: int) -> Fault:
    def refuse(*_: object) -> NoReturn:
        raise OSError(number, "injected")

    def begin(harness: EngineHarness) -> None:
        PartWriter.write = PartWriter.sync = refuse  # type: ignore[method-assign]
        recorder.probe_disk = refuse

    return Fault("disk", f"the disk {name}", begin, heal_disk, 30.0)


def heal_disk(harness: EngineHarness | None = None) -> None:
    """Let the disk take files again."""
    PartWriter.write, PartWriter.sync = _WRITE, _SYNC  # type: ignore[method-assign]
    recorder.probe_disk = _PROBE


def _fail(*_: object, **__: object) -> NoReturn:
    raise ValueError("injected")


def _poll_consumer(harness: EngineHarness) -> None:
    harness.engine.boards.drum_poller.subscribe(_fail)


def _sample_consumer(harness: EngineHarness) -> None:
    harness.engine.boards.pipeline.subscribe(_fail)


def _event_consumer(harness: EngineHarness) -> None:
    harness.engine.event_bus.subscribe(_fail)


def _encoder(harness: EngineHarness) -> None:
    harness.engine.boards.encoder.encode = _fail  # type: ignore[method-assign]


def _live_data(harness: EngineHarness) -> None:
    harness.engine.boards.pipeline._live_writer.add_taxels = _fail  # type: ignore[method-assign]


def _recorder(harness: EngineHarness) -> None:
    if harness.engine.run is not None:
        harness.engine.run._recorder._writer.add_rows = _fail  # type: ignore[method-assign]


_wire = partial(_switched, "wires")
_exception = partial(Fault, "exception")

FAULTS = (
    Fault("board", "the drum board restarts", _of_rig("reset", DRUM)),
    Fault("board", "the taxel board restarts", _of_rig("reset", TAXELS)),
    _bootloader(DRUM),
    _bootloader(TAXELS),
    *(
        Fault(
            "link",
            f"the {board} board's cable is pulled for {seconds:g} s",
            _of_rig("unplug", board),
            _of_rig("replug", board),
            seconds,
        )
        for board, seconds in ((DRUM, 3.0), (TAXELS, 3.0), (DRUM, LONG_S), (TAXELS, LONG_S))
    ),
    _switched("link", "the drum board's cable is silent for 0.1 s", "stall", 0.1, DRUM),
    _switched("link", "the drum board's cable is silent for 2 s", "stall", 2.0, DRUM),
    _switched("link", "the taxel board's cable is silent for 2 s", "stall", 2.0, TAXELS),
    *(
        Fault(
            "link",
            f"{100 * rate:g} % of the bytes from the {board} board are damaged",
            _of_rig("corrupt_bytes", board, "to_host", rate),
            _of_rig("corrupt_bytes", board, "to_host", 0.0),
            20.0,
        )
        for board, rate in ((DRUM, 0.001), (TAXELS, 0.001), (TAXELS, 0.0001))
    ),
    _switched("load cell", "the load cell sends nothing", "loadcell_silent", 5.0),
    _switched("load cell", "the load cell repeats one value", "loadcell_frozen", 5.0),
    _switched("load cell", "the load cell is at its end", "loadcell_saturated", 5.0),
    Fault(
        "load cell",
        "a hand presses on the load cell",
        _of_rig("push", 1500.0),
        _of_rig("push", 0.0),
        1.0,
    ),
    Fault(
        "wires",
        "the emergency stop is pressed",
        _of_rig("press_estop"),
        _of_rig("release_estop"),
        2.0,
    ),
    _wire("the potentiometer's wiper breaks", "wire", 5.0, "potentiometer wiper open"),
    _wire("the load cell is unplugged", "wire", 5.0, "cell unplugged"),
    _wire("the actuator is unplugged", "wire", 5.0, "actuator unplugged"),
    _wire("the upper end switch is unplugged", "wire", 5.0, "upper end switch unplugged"),
    _wire("the index sensor is unplugged", "wire", 5.0, "index missing"),
    _wire("the sync wire breaks", "wire", 5.0, "sync wire missing"),
    _wire("a line of the sensor breaks", "wire", 5.0, "taxel line open"),
    _switched("motor", "the drum is held", "jam_motor", 3.0),
    _switched("motor", "the motor is unplugged", "wire", 5.0, "stepper unplugged"),
    _switched("motor", "the motor has no supply", "wire", 5.0, "motor supply missing"),
    _disk("is full", errno.ENOSPC),
    _disk("reports an error", errno.EIO),
    _disk("is read-only", errno.EROFS),
    *(
        Fault(
            "computer",
            f"the computer stalls for {seconds:g} s",
            _of_rig("stall_computer", seconds),
        )
        for seconds in (0.12, 0.4, 2.0)
    ),
    Fault("computer", "the computer sleeps for 100 s", _sleep(100.0)),
    _exception("what reads the polls raises", _poll_consumer),
    _exception("what reads the samples raises", _sample_consumer),
    _exception("what reads the events raises", _event_consumer),
    _exception("the encoder raises", _encoder),
    _exception("the live data raise", _live_data),
    _exception("the recorder's thread raises", _recorder),
)
