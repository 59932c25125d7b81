"""``rigctl calibrate wiring``: find which reading is which taxel by unplugging and pressing."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from rigctl.cli.progress import ask
from rigctl.config.rig_config import RigConfig, TaxelArray, load_config
from rigctl.config.toml_edit import replace_file
from rigctl.engine.calibration_values import wiring_words
from rigctl.engine.calibrator import wiring_values
from rigctl.engine.rig import Rig
from rigctl.engine.setup.progress import note_calibration
from rigctl.engine.wiring_identification import ContradictoryPresses, MeanReadings
from rigctl.engine.wiring_steps import (
    WiringStep,
    WiringSteps,
    mean_readings,
    require_identifiable,
)
from rigctl.errors import RigFault, WrongUse
from rigctl.rig import open_rig


def run(args: argparse.Namespace) -> int:
    """Guide the user; the last lines give the order and where it is saved."""
    path, config = _read_rig(args)
    taxels = replace(config.taxels, wiring=tuple(range(config.taxels.count)), pressure_raises=True)
    with closing(open_rig(args.rig, config=replace(config, taxels=taxels))) as rig:
        session = _WiringSession(rig, print if not args.json else lambda text: None)
        wiring = rig.loop.run_until_complete(session.find())
    lines = [wiring_words(wiring)]
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
        raise WrongUse(
            "a simulated sensor is soldered as drawn: name the rig.toml of a bench, or rehearse "
            "the steps in the window"
        )
    if args.yes:
        raise WrongUse(
            "this calibration needs a person who unplugs wires and presses taxels: leave out --yes"
        )
    require_identifiable(config.taxels, str(path))
    return path, config


class _WiringSession:
    """Guides the user through the steps; repeats each until its result is clear."""

    def __init__(self, rig: Rig, print_line: Callable[[str], None]) -> None:
        self._rig = rig
        self._print = print_line
        self._steps = WiringSteps(rig, self._mean)
        self._failure: RigFault | None = None

    async def find(self) -> tuple[int, ...]:
        """Return the reading at each place. Raises WrongUse for contradictory presses."""
        self._rig.taxels.on_fault(self._fail)
        await self._rig.taxels.connect()
        while self._steps.step is not WiringStep.DONE:
            await self._take_step()
        return self._steps.wiring

    async def _take_step(self) -> None:
        """Ask for a step and print its result, or why it was not clear."""
        ask(self._steps.question, "run this command at a terminal")
        try:
            self._print(await self._steps.take())
        except ContradictoryPresses:
            raise
        except WrongUse as unclear:
            self._print(f"not clear: {unclear}")

    async def _mean(self) -> MeanReadings:
        return await mean_readings(self._rig, self._check)

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _fail(self, fault: RigFault) -> None:
        self._failure = fault


def _save(path: Path, before: TaxelArray, wiring: tuple[int, ...]) -> list[str]:
    """Write the order into rig.toml; return sentences about its taxel ranges."""
    values = wiring_values(before, wiring)
    replace_file(path, values.edited(path))
    note_calibration(path, values.table, values.keys)
    return [f"saved in {path}", *filter(None, (values.remark,))]
