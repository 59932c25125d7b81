"""``rigctl calibrate wiring``: which reading is which taxel, by unplugging and pressing."""

from __future__ import annotations

import argparse
import asyncio
import json
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.acquisition.taxels.wiring_identification import (
    PER_LAYER,
    Means,
    WiringIdentification,
    place_words,
)
from rigctl.cli.options.prompt import ask
from rigctl.config.rig_config import RigConfig, TaxelArray, load_config, parse_config
from rigctl.config.toml_edit import Value, replace_file, set_keys
from rigctl.devices.taxels import Taxels
from rigctl.errors import RigFault, WrongUse
from rigctl.rig import open_rig
from rigctl.values import DRAWN_WIRING, N_TAXELS, Block

STALE_S = 0.5
"""What came while somebody was asked is of before; it is through after so long."""
SAMPLES = 1000
LOOK_S = 0.05

UNPLUG = (
    "Unplug the three read lines of the bottom layer (A3, A4, A5 where the drawing was followed). "
    "Touch nothing."
)
FLAT = "Press the whole sensor flat, and hold it."
PLUG = "Plug them in again. Touch nothing."
PRESS = "Press {place}, with a blunt tip of about 3 mm, and hold it."


def run(args: argparse.Namespace) -> int:
    """Guide through it; the last lines say the order and where it is kept."""
    path, config = _bench(args)
    taxels = replace(config.taxels, wiring=tuple(range(N_TAXELS)), pressure_raises=True)
    with closing(open_rig(args.rig, config=replace(config, taxels=taxels))) as rig:
        sitting = _WiringSession(rig.taxels, print if not args.json else lambda text: None)
        wiring = rig.loop.run_until_complete(sitting.find())
    words = [f"wiring = {list(wiring)}{', as drawn' if wiring == DRAWN_WIRING else ''}"]
    if args.dry:
        words.append("nothing was kept (--dry)")
    else:
        words += _keep(path, config.taxels, wiring)
    if args.json:
        said = {"part": "wiring", "rig": args.rig, "wiring": wiring}
        print(json.dumps(said if args.dry else said | {"kept_in": [str(path)]}))
    else:
        print("\n".join(words))
    return 0


def _bench(args: argparse.Namespace) -> tuple[Path, RigConfig]:
    """The description of a sensor that somebody can unplug and press. Raises WrongUse."""
    path = Path(args.rig)
    config = load_config(path) if path.is_file() else None
    if config is None or config.ports.simulate:
        raise WrongUse("nobody can unplug a simulated sensor: name the rig.toml of a bench")
    if args.yes:
        raise WrongUse("somebody has to unplug wires and press taxels: leave --yes out")
    if (config.taxels.rows, config.taxels.columns, config.taxels.count) != (3, 3, N_TAXELS):
        raise WrongUse(f"{path}: this finds the order of 3 × 3 taxels in two layers, write yours")
    return path, config


class _WiringSession:
    """Asks for each step until it is clear, and takes the mean of a second of it."""

    def __init__(self, taxels: Taxels, tell: Callable[[str], None]) -> None:
        self._taxels = taxels
        self._tell = tell
        self._samples: list[NDArray[np.uint16]] = []
        self._failure: RigFault | None = None

    async def find(self) -> tuple[int, ...]:
        """The reading at each place. Raises WrongUse for presses that contradict each other."""
        self._taxels.on_block(self._take)
        self._taxels.on_fault(self._fail)
        await self._taxels.connect()
        order = WiringIdentification()
        while not order.lower:
            rest = await self._mean(UNPLUG)
            self._note(order.unplugged, rest, await self._mean(FLAT))
        rest = await self._mean(PLUG)
        while order.place < PER_LAYER:
            asked = PRESS.format(place=place_words(order.place))
            self._note(order.pressed, rest, await self._mean(asked))
        return order.wiring()

    def _note(self, take: Callable[[Means, Means], str], rest: Means, pressed: Means) -> None:
        """Say what was seen; what was not clear is asked for again."""
        try:
            self._tell(take(rest, pressed))
        except WrongUse as unclear:
            self._tell(f"not clear: {unclear}")

    async def _mean(self, asked: str) -> Means:
        """Mean of a second of samples, float64 (18,). Raises RigFault where the board is lost."""
        ask(asked, "run it at a terminal")
        await self._pass_until(asyncio.get_running_loop().time() + STALE_S)
        self._samples.clear()
        while sum(map(len, self._samples)) < SAMPLES:
            await self._pass_until(asyncio.get_running_loop().time() + LOOK_S)
        mean: Means = np.concatenate(self._samples).mean(axis=0)
        return mean

    async def _pass_until(self, end_s: float) -> None:
        await asyncio.sleep(end_s - asyncio.get_running_loop().time())
        if self._failure is not None:
            raise self._failure

    def _take(self, block: Block) -> None:
        self._samples.append(block.samples)

    def _fail(self, fault: RigFault) -> None:
        self._failure = fault


def _keep(path: Path, before: TaxelArray, wiring: tuple[int, ...]) -> list[str]:
    """Write the order into the description; sentences on what became of its ranges."""
    values: dict[str, Value] = {"wiring": list(wiring)}
    words = [f"kept in {path}"]
    if before.low and before.wiring:
        places = [before.wiring.index(reading) for reading in wiring]
        values["low"] = [before.low[place] for place in places]
        values["high"] = [before.high[place] for place in places]
    elif before.low:
        values |= {"low": [], "high": []}
        words.append("low and high were taken in an order that was not written: take them again")
    text = set_keys(path.read_text(encoding="utf-8"), "taxels", values)
    parse_config(text, str(path))
    replace_file(path, text)
    return words
