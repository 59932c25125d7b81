"""Calibrate load cell, force loop, imbalance or wiring.

Calibrate a rig and save the result on the drum's board and in rig.toml. Exit code 0: done; 2:
the measurement is implausible; 3: rig fault.
"""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.acquisition.drum.calibration import Calibrator, MassReading, fit_scale, validate_masses
from rigctl.acquisition.health.notices import wiring_notice
from rigctl.acquisition.rig import Rig
from rigctl.cli.data.world import add_world, chosen_world
from rigctl.cli.options.arguments import add_seed, number, path_or_name
from rigctl.cli.options.terminal import ask
from rigctl.cli.rig import calibrate_wiring
from rigctl.config.rig_config import parse_config
from rigctl.config.text_file import read_text
from rigctl.config.toml_bounds import MAX_BYTES
from rigctl.config.toml_edit import Value, replace_file, set_keys
from rigctl.errors import WrongUse
from rigctl.rig import BENCH, open_rig

MAX_LOAD_G = 1e6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "--rig",
        type=path_or_name("--rig"),
        required=True,
        help="virtual, firmware, or a rig.toml",
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
    cell.add_argument(
        "--mass",
        type=number("--mass", -MAX_LOAD_G, MAX_LOAD_G),
        action="append",
        required=True,
        metavar="G",
    )
    force = parts.add_parser(
        "force", help="find the gains of the force loop from a step at a held force"
    )
    force.add_argument("--force", type=number("--force", 0, MAX_LOAD_G), default=500.0, metavar="G")
    parts.add_parser("imbalance", help="measure the load-cell error over the drum's angle")
    tare = parts.add_parser("tare", help="set the reading of the lifted drum to 0 g")
    tare.add_argument(
        "--anyway",
        action="store_true",
        help="accept a zero far from the last one, such as after a change of the drum",
    )
    parts.add_parser("wiring", help="find which reading is which taxel by unplugging and pressing")


def run(args: argparse.Namespace) -> int:
    """Calibrate one part; the last line gives the result and where it is saved."""
    if args.part == "wiring":
        return calibrate_wiring.run(args)
    if args.part == "loadcell":
        validate_masses(args.mass)
    world = chosen_world(args.world)
    if notice := wiring_notice(args.rig):
        print(f"rigctl: {notice}", file=sys.stderr, flush=True)
    with closing(open_rig(args.rig, seed=args.seed, paced=False, world=world)) as rig:
        session = _CalibrationSession(args, rig)
        part = getattr(session, args.part)
        rig.loop.run_until_complete(session.calibrator.run(part))
    session.report()
    return 0


class _CalibrationSession:
    """A calibration with a method for each part: ask the user, measure, save the result."""

    def __init__(self, args: argparse.Namespace, rig: Rig) -> None:
        self._args = args
        self._rig = rig
        self.calibrator = Calibrator(rig)
        self.result: dict[str, Any] = {"part": args.part, "rig": args.rig}
        self._lines: list[str] = []

    async def loadcell(self) -> None:
        """Measure without a mass and with each mass; save the scale."""
        await self.calibrator.lift()
        points = [await self._point(mass_g) for mass_g in (0.0, *sorted(self._args.mass))]
        self._rig.lay_mass(0.0)
        scale = fit_scale(points)
        self.result |= {
            "scale_ug_per_count": scale.ug_per_count,
            "curve_share": scale.nonlinearity_share,
        }
        self._lines.append(
            f"{scale.ug_per_count} µg a count, nonlinearity {100 * scale.nonlinearity_share:.2f} %"
        )
        masses = ", ".join(f"{mass:g} g" for mass in sorted(self._args.mass))
        today = datetime.now(UTC).strftime("%Y-%m-%d")
        await self._save(
            "loadcell",
            {"scale_ug_per_count": scale.ug_per_count, "calibrated": f"{today} with {masses}"},
            scale_ug_per_count=scale.ug_per_count,
        )

    async def tare(self) -> None:
        """Set the zero; the board keeps it until it is switched off."""
        self._ask("Take everything off the drum and let it come to rest.")
        counts = await self.calibrator.tare(self._args.anyway)
        self.result["tare_counts"] = counts
        self._lines.append(f"{counts} counts are 0 g")

    async def force(self) -> None:
        """Press, make a small step, and save the gains."""
        self._ask("Mount a plate and keep clear of the drum.")
        limits = self._rig.config.limits
        if not limits.force_min_g <= self._args.force <= limits.force_max_g:
            raise WrongUse(
                f"--force {self._args.force:g} g: this rig presses with "
                f"{limits.force_min_g:g} to {limits.force_max_g:g} g"
            )
        found = await self.calibrator.tune_gains(self._args.force)
        self.result |= found._asdict()
        self._lines.append(
            f"gain_p {found.gain_p_per_s:g} /s, gain_i {found.gain_i_per_s:g} /s, stiffness "
            f"{found.stiffness_g_per_mm:g} g/mm, delay {found.delay_ms:g} ms"
        )
        gain_p, gain_i = found.gain_p_per_s, found.gain_i_per_s
        values: dict[str, Value] = {"gain_p_per_s": gain_p, "gain_i_per_s": gain_i}
        await self._save("actuator", values, gain_p=gain_p, gain_i=gain_i)

    async def imbalance(self) -> None:
        """Turn the lifted drum once; the board keeps the table."""
        self._ask("Take the plate off, or leave it on as in use, and keep clear of the drum.")
        table_g = await self.calibrator.measure_imbalance()
        self.result["table_g"] = [round(value, 3) for value in table_g]
        self._lines.append(f"imbalance {(max(table_g) - min(table_g)) / 2:.2f} g")
        await self._save("", {})

    def report(self) -> None:
        """Print the result."""
        text = "\n".join(self._lines)
        print(json.dumps(self.result, ensure_ascii=False) if self._args.json else text)

    async def _point(self, mass_g: float) -> MassReading:
        if not self._rig.lay_mass(mass_g):
            what = f"Lay {mass_g:g} g on the drum" if mass_g else "Take everything off the drum"
            self._ask(f"{what} and let it come to rest.")
        point = await self.calibrator.read_mass(mass_g)
        if not self._args.json:
            print(f"{mass_g:g} g: {point.mean_counts:.0f} counts ± {point.sd_counts:.0f}")
        return point

    async def _save(self, table: str, values: dict[str, Value], **settings: float) -> None:
        if self._args.dry:
            self._lines.append("nothing was saved (--dry)")
            return
        path = Path(self._args.rig) if values and self._rig.kind == BENCH else None
        text = _edited(path, table, values) if path else ""
        await self.calibrator.save_settings(**settings)
        places = ["the board's EEPROM"]
        if path:
            replace_file(path, text)
            places.append(str(path))
        self.result["kept_in"] = places
        self._lines.append(f"saved in {' and '.join(places)}")

    def _ask(self, text: str) -> None:
        if not self._args.yes:
            ask(text, "--yes confirms that everything is in place")


def _edited(path: Path, table: str, values: dict[str, Value]) -> str:
    """Return the text of rig.toml with new values. Raises ConfigError if it is invalid."""
    source = read_text(path, MAX_BYTES)
    parse_config(source, str(path))
    text = set_keys(source, table, values)
    parse_config(text, str(path))
    return text
