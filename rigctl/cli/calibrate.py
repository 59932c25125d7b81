"""Calibrate load cell, force loop, imbalance, wiring or sensor.

Calibrate a rig and save the result on the drum's board and in rig.toml; of the sensor, write a
report, and name its passport in rig.toml. Exit code 0: done; 2: the measurement is implausible;
3: rig fault.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.cli import calibrate_wiring
from rigctl.cli.arguments import a_path, add_option, add_seed, number, path_or_name
from rigctl.cli.progress import ProgressLine, ask
from rigctl.cli.run import EXIT_CODES, watch_run
from rigctl.cli.world import add_world, chosen_world
from rigctl.config.rig_config import load_config
from rigctl.config.toml_edit import replace_file, set_keys
from rigctl.encoder.reading import Reading
from rigctl.engine.calibration_values import (
    MassReading,
    gains_words,
    imbalance_words,
    scale_words,
)
from rigctl.engine.calibrator import (
    BOARD,
    CalibratedValues,
    Calibrator,
    calibrate_alone,
    force_values,
    loadcell_values,
)
from rigctl.engine.load_cell_scale import fit_scale, validate_masses
from rigctl.engine.rig import Rig
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.setup.progress import note_calibration
from rigctl.errors import WrongUse
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from rigctl.session.sensor_passport import read_passport

MAX_LOAD_G = 1e6
SENSOR_PROTOCOL = "sensor"
IMPLAUSIBLE = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser, "--rig", path_or_name, help_text="virtual, firmware, or a rig.toml", required=True
    )
    add_world(parser)
    add_seed(parser, "seed of a simulated rig", default=0)
    parser.add_argument("--yes", action="store_true", help="do not ask for confirmation")
    parser.add_argument(
        "--dry", action="store_true", help="save nothing, neither on the board nor in files"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    cell = parts.add_parser("loadcell", help="find the scale of the load cell from known masses")
    add_option(cell, "--mass", number(-MAX_LOAD_G, MAX_LOAD_G), "G", action="append", required=True)
    force = parts.add_parser(
        "force", help="find the gains of the force loop from a step at a held force"
    )
    add_option(force, "--force", number(0, MAX_LOAD_G), "G", default=500.0)
    parts.add_parser("imbalance", help="measure the load-cell error over the drum's angle")
    tare = parts.add_parser("tare", help="set the reading of the lifted drum to 0 g")
    tare.add_argument(
        "--anyway",
        action="store_true",
        help="accept a zero far from the last one, such as after a change of the drum",
    )
    parts.add_parser("wiring", help="find which reading is which taxel by unplugging and pressing")
    sensor = parts.add_parser("sensor", help="measure how each taxel answers to the force")
    add_option(sensor, "--session", a_path, "DIR", f"a session of the protocol {SENSOR_PROTOCOL}")
    add_option(sensor, "--out", a_path, "DIR", "new folder of the report (default: SESSION-report)")
    sensor.add_argument(
        "--reading",
        type=Reading,
        choices=list(Reading),
        default=Reading.CONDUCTANCE,
        help="what a taxel's curve is of (conductance)",
    )


def run(args: argparse.Namespace) -> int:
    """Calibrate one part; the last line gives the result and where it is saved."""
    if args.part == "wiring":
        return calibrate_wiring.run(args)
    if args.part == "sensor":
        return _measure_sensor(args)
    if args.part == "loadcell":
        validate_masses(args.mass)
    world = chosen_world(args.world)
    with closing(open_rig(args.rig, seed=args.seed, paced=False, world=world)) as rig:
        session = _CalibrationSession(args, rig)
        rig.loop.run_until_complete(calibrate_alone(rig, session.run))
    session.report()
    return 0


def _measure_sensor(args: argparse.Namespace) -> int:
    """Record the protocol unless a session is given; print the result and write the report."""
    from rigctl.analysis.sensor_response import (
        RESULT,
        as_dict,
        measure,
        summary_lines,
        write_report,
    )

    if args.rig not in (VIRTUAL, FIRMWARE):
        load_config(Path(args.rig))

    if args.out is not None and args.out.exists():
        raise WrongUse(f"{args.out} already exists: name another folder")
    session = args.session
    if session is None:
        state, session = _record_sensor(args)
        if state != "done":
            return EXIT_CODES[state]
    found = measure(session, args.reading)
    page = write_report(found, args.out or session.with_name(f"{session.name}-report"))
    values = as_dict(found) | {"report": str(page)}
    kept = _save_passport(args, page.with_name(RESULT), values)
    if args.json:
        print(json.dumps(values | {"passport": kept}, ensure_ascii=False))
    else:
        files = [f"session: {session}", f"report: {page}"]
        print("\n".join([*summary_lines(found), *files, f"passport: {kept}"]))
    return IMPLAUSIBLE if found.findings else 0


def _save_passport(args: argparse.Namespace, file: Path, values: dict[str, Any]) -> str:
    """Name the passport in the rig's ``rig.toml``; return what became of it, in words."""
    path = Path(args.rig)
    if values["findings"]:
        return "not kept, because of the findings"
    try:
        read_passport(values)
    except ValueError as error:
        return f"not kept: {error}"
    if args.dry or args.rig in (VIRTUAL, FIRMWARE):
        return f"not kept in a rig.toml; --passport {file} names it"
    named = os.path.relpath(file.resolve(), path.resolve().parent)
    replace_file(path, set_keys(path.read_text("utf-8"), "taxels", {"passport": named}))
    return f"{file}, named in {path}: every later session carries it"


def _record_sensor(args: argparse.Namespace) -> tuple[str, Path]:
    """Run the protocol on the rig; return how the run ended, and the session."""
    arguments = [f"--protocol={SENSOR_PROTOCOL}", *(["--yes"] if args.yes else [])]
    if args.world is not None:
        arguments.append(f"--world={args.world}")
    client = EngineClient.start(args.rig, paced=False, seed=args.seed, run=arguments)
    ended = watch_run(client, ProgressLine(sys.stderr, quiet=args.json))
    return ended.state, Path(str(ended.session))


class _CalibrationSession:
    """A calibration with a method for each part: ask the user, measure, save the result."""

    def __init__(self, args: argparse.Namespace, rig: Rig) -> None:
        self._args = args
        self._rig = rig
        self.result: dict[str, Any] = {"part": args.part, "rig": args.rig}
        self._lines: list[str] = []

    async def run(self, calibrator: Calibrator) -> None:
        """Calibrate the part that the arguments name."""
        await getattr(self, self._args.part)(calibrator)

    async def loadcell(self, calibrator: Calibrator) -> None:
        """Measure without a mass and with each mass; save the scale."""
        await calibrator.lift()
        masses_g = (0.0, *sorted(self._args.mass))
        points = [await self._point(calibrator, mass_g) for mass_g in masses_g]
        self._rig.lay_mass(0.0)
        scale = fit_scale(points)
        self.result |= {
            "scale_ug_per_count": scale.ug_per_count,
            "curve_share": scale.nonlinearity_share,
        }
        self._lines.append(scale_words(scale.ug_per_count, scale.nonlinearity_share))
        today = datetime.now(UTC).strftime("%Y-%m-%d")
        await self._save(calibrator, loadcell_values(scale, self._args.mass, today))

    async def tare(self, calibrator: Calibrator) -> None:
        """Set the zero; the board keeps it until it is switched off."""
        self._ask("Take everything off the drum and let it come to rest.")
        counts = await calibrator.tare(self._args.anyway)
        self.result["tare_counts"] = counts
        self._lines.append(f"{counts} counts are 0 g")

    async def force(self, calibrator: Calibrator) -> None:
        """Press, make a small step, and save the gains."""
        self._ask("Mount a plate and keep clear of the drum.")
        found = await calibrator.tune_gains(self._args.force)
        self.result |= found._asdict()
        self._lines.append(gains_words(found))
        await self._save(calibrator, force_values(found))

    async def imbalance(self, calibrator: Calibrator) -> None:
        """Turn the lifted drum once; the board keeps the table."""
        self._ask("Take the plate off, or leave it on as in use, and keep clear of the drum.")
        table_g = await calibrator.measure_imbalance()
        self.result["table_g"] = [round(value, 3) for value in table_g]
        self._lines.append(imbalance_words(table_g))
        await self._save(calibrator, CalibratedValues())

    def report(self) -> None:
        """Print the result."""
        text = "\n".join(self._lines)
        print(json.dumps(self.result, ensure_ascii=False) if self._args.json else text)

    async def _point(self, calibrator: Calibrator, mass_g: float) -> MassReading:
        if not self._rig.lay_mass(mass_g):
            what = f"Lay {mass_g:g} g on the drum" if mass_g else "Take everything off the drum"
            self._ask(f"{what} and let it come to rest.")
        point = await calibrator.read_mass(mass_g)
        if not self._args.json:
            print(f"{mass_g:g} g: {point.mean_counts:.0f} counts ± {point.sd_counts:.0f}")
        return point

    async def _save(self, calibrator: Calibrator, values: CalibratedValues) -> None:
        if self._args.dry:
            self._lines.append("nothing was saved (--dry)")
            return
        path = self._rig.path if values.keys else None
        text = values.edited(path) if path else ""
        remark = await calibrator.save_settings(**values.settings)
        places = [BOARD]
        if path:
            replace_file(path, text)
            places.append(str(path))
            if values.table != "loadcell" or await calibrator.motion.is_commissioned():
                note_calibration(path, values.table, values.keys)
        self.result["kept_in"] = places
        self._lines.append(f"saved in {' and '.join(places)}")
        if remark:
            self.result["remark"] = remark
            self._lines.append(remark)

    def _ask(self, text: str) -> None:
        if not self._args.yes:
            ask(text, "--yes confirms that everything is in place")
