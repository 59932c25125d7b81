"""``rigctl calibrate wiring``: find which reading is which taxel by unplugging and pressing."""

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
    MeanReadings,
    WiringIdentification,
    place_name,
)
from rigctl.cli.options.terminal import ask
from rigctl.config.rig_config import RigConfig, TaxelArray, load_config, parse_config
from rigctl.config.text_file import read_text
from rigctl.config.toml_bounds import MAX_BYTES
from rigctl.config.toml_edit import Value, replace_file, set_keys
from rigctl.devices.taxels import Taxels
from rigctl.errors import RigFault, WrongUse
from rigctl.rig import open_rig
from rigctl.values import DRAWN_WIRING, N_TAXELS

STALE_S = 0.5
"""Samples that arrive this soon after an answer may be older than it, so they are dropped."""
SAMPLES = 1000
POLL_S = 0.05

UNPLUG = (
    "Unplug the three read lines of the bottom layer (A3, A4, A5 if wired as drawn). "
    "Do not touch the sensor."
)
FLAT = "Press the whole sensor flat and hold it."
PLUG = "Plug the lines in again. Do not touch the sensor."
PRESS = "Press {place} with a blunt tip of about 3 mm and hold it."


def run(args: argparse.Namespace) -> int:
    """Guide the user; the last lines give the order and where it is saved."""
    path, config = _read_rig(args)
    taxels = replace(config.taxels, wiring=tuple(range(N_TAXELS)), pressure_raises=True)
    with closing(open_rig(args.rig, config=replace(config, taxels=taxels))) as rig:
        session = _WiringSession(rig.taxels, print if not args.json else lambda text: None)
        wiring = rig.loop.run_until_complete(session.find())
    lines = [f"wiring = {list(wiring)}{', as drawn' if wiring == DRAWN_WIRING else ''}"]
    if args.dry:
        lines.append("nothing was saved (--dry)")
    else:
        lines += _save(path, config.taxels, wiring)
    if args.json:
        result = {"part": "wiring", "rig": args.rig, "wiring": wiring}
        print(json.dumps(result if args.dry else result | {"kept_in": [str(path)]}))
    else:
        print("\n".join(lines))
    return 0


def _read_rig(args: argparse.Namespace) -> tuple[Path, RigConfig]:
    """Return path and description of a real sensor. Raises WrongUse for any other."""
    path = Path(args.rig)
    config = load_config(path) if path.is_file() else None
    if config is None or config.ports.simulate:
        raise WrongUse("a simulated sensor cannot be unplugged: name the rig.toml of a bench")
    if args.yes:
        raise WrongUse(
            "this calibration needs a person who unplugs wires and presses taxels: leave out --yes"
        )
    if (config.taxels.rows, config.taxels.columns, config.taxels.count) != (3, 3, N_TAXELS):
        raise WrongUse(
            f"{path}: only 3 × 3 taxels in two layers can be identified; write wiring by hand"
        )
    return path, config


class _WiringSession:
    """Guides the user through the steps; repeats each until its result is clear."""

    def __init__(self, taxels: Taxels, print_line: Callable[[str], None]) -> None:
        self._taxels = taxels
        self._print = print_line
        self._samples: list[NDArray[np.uint16]] = []
        self._failure: RigFault | None = None

    async def find(self) -> tuple[int, ...]:
        """Return the reading at each place. Raises WrongUse for contradictory presses."""
        self._taxels.on_block(lambda block: self._samples.append(block.samples))
        self._taxels.on_fault(self._fail)
        await self._taxels.connect()
        found = WiringIdentification()
        while not found.lower:
            rest = await self._mean(UNPLUG)
            self._print_step(found.add_unplugged_press, rest, await self._mean(FLAT))
        rest = await self._mean(PLUG)
        while found.place < PER_LAYER:
            question = PRESS.format(place=place_name(found.place))
            self._print_step(found.add_press, rest, await self._mean(question))
        return found.wiring()

    def _print_step(
        self,
        add: Callable[[MeanReadings, MeanReadings], str],
        rest: MeanReadings,
        pressed: MeanReadings,
    ) -> None:
        """Add a press to the identification; print its result, or why it was not clear."""
        try:
            self._print(add(rest, pressed))
        except WrongUse as unclear:
            self._print(f"not clear: {unclear}")

    async def _mean(self, question: str) -> MeanReadings:
        """Return the mean of one second, float64 (18,). Raises RigFault if the board is lost."""
        ask(question, "run this command at a terminal")
        await self._sleep_until(asyncio.get_running_loop().time() + STALE_S)
        self._samples.clear()
        while sum(map(len, self._samples)) < SAMPLES:
            await self._sleep_until(asyncio.get_running_loop().time() + POLL_S)
        mean: MeanReadings = np.concatenate(self._samples).mean(axis=0)
        return mean

    async def _sleep_until(self, end_s: float) -> None:
        await asyncio.sleep(end_s - asyncio.get_running_loop().time())
        if self._failure is not None:
            raise self._failure

    def _fail(self, fault: RigFault) -> None:
        self._failure = fault


def _save(path: Path, before: TaxelArray, wiring: tuple[int, ...]) -> list[str]:
    """Write the order into rig.toml; return sentences about its taxel ranges."""
    values: dict[str, Value] = {"wiring": list(wiring)}
    lines = [f"saved in {path}"]
    if before.low and before.wiring:
        places = [before.wiring.index(reading) for reading in wiring]
        values["low"] = [before.low[place] for place in places]
        values["high"] = [before.high[place] for place in places]
    elif before.low:
        values |= {"low": [], "high": []}
        lines.append(
            "low and high belong to an unknown order and were removed: calibrate them again"
        )
    text = set_keys(read_text(path, MAX_BYTES), "taxels", values)
    parse_config(text, str(path))
    replace_file(path, text)
    return lines
