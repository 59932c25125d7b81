"""``rigctl calibrate``: load cell, force loop, imbalance or wiring of a rig, step by step."""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.acquisition.drum.calibration import Calibrator, Point, check_masses, scale_of
from rigctl.acquisition.health.notices import wiring_notice
from rigctl.cli.data.world import add_world, chosen_world
from rigctl.cli.options.prompt import ask
from rigctl.cli.rig import calibrate_wiring
from rigctl.config.rig_config import parse_config
from rigctl.config.toml_edit import Value, replace_file, set_keys
from rigctl.errors import WrongUse
from rigctl.rig import BENCH, Rig, open_rig


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "calibrate",
        help="calibrate load cell, force loop, imbalance or wiring",
        description="Calibrate a rig, keep the result on the drum's board and in the rig's "
        "description. Exit code 0: done; 2: the answer cannot be right; 3: rig fault.",
    )
    parser.add_argument("--rig", required=True, help="virtual, firmware, or a rig.toml")
    add_world(parser)
    parser.add_argument("--seed", type=int, default=0, help="of a simulated rig")
    parser.add_argument("--yes", action="store_true", help="ask nothing: everything is in place")
    parser.add_argument("--dry", action="store_true", help="keep nothing, on the board or in files")
    parser.add_argument("--json", action="store_true", help="one JSON object at the end")
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    cell = parts.add_parser("loadcell", help="scale of the load cell, with known masses")
    cell.add_argument("--mass", type=float, action="append", required=True, metavar="G")
    force = parts.add_parser("force", help="gains of the force loop, from a step at a held force")
    force.add_argument("--force", type=float, default=500.0, metavar="G")
    parts.add_parser("imbalance", help="what the drum's angle adds to the load cell")
    tare = parts.add_parser("tare", help="the load cell's reading of the lifted drum as 0 g")
    tare.add_argument(
        "--anyway", action="store_true", help="also far from the zero before: another drum"
    )
    parts.add_parser("wiring", help="which reading is which taxel, by unplugging and pressing")


def run(args: argparse.Namespace) -> int:
    """Calibrate one part; the last line says what was found and where it is kept."""
    if args.part == "wiring":
        return calibrate_wiring.run(args)
    if args.part == "loadcell":
        check_masses(args.mass)
    world = chosen_world(args.world)
    if notice := wiring_notice(args.rig):
        print(f"rigctl: {notice}", file=sys.stderr, flush=True)
    with closing(open_rig(args.rig, seed=args.seed, paced=False, world=world)) as rig:
        session = _CalibrationSession(args, rig)
        part = {
            "loadcell": session.loadcell,
            "force": session.force,
            "imbalance": session.turn,
            "tare": session.tare,
        }
        rig.loop.run_until_complete(session.calibrator.during(part[args.part]))
    session.report()
    return 0


class _CalibrationSession:
    """One calibration: asks, measures, keeps. ``said`` is what was found."""

    def __init__(self, args: argparse.Namespace, rig: Rig) -> None:
        self._args = args
        self._rig = rig
        self.calibrator = Calibrator(rig)
        self.said: dict[str, Any] = {"part": args.part, "rig": args.rig}
        self._words: list[str] = []

    async def loadcell(self) -> None:
        """Nothing, then each mass; the scale goes to the board and into the description."""
        await self.calibrator.lift()
        points = [await self._point(mass_g) for mass_g in (0.0, *sorted(self._args.mass))]
        self._rig.lay_mass(0.0)
        scale = scale_of(points)
        self.said |= {"scale_ug_per_count": scale.ug_per_count, "curve_share": scale.curve_share}
        self._words.append(
            f"{scale.ug_per_count} µg a count, {100 * scale.curve_share:.2f} % off a line"
        )
        masses = ", ".join(f"{mass:g} g" for mass in sorted(self._args.mass))
        today = datetime.now(UTC).strftime("%Y-%m-%d")
        await self._keep(
            "loadcell",
            {"scale_ug_per_count": scale.ug_per_count, "calibrated": f"{today} with {masses}"},
            scale_ug_per_count=scale.ug_per_count,
        )

    async def tare(self) -> None:
        """The reading of the lifted drum; it is kept until the board is switched off."""
        self._ask("Take everything off the drum, let it come to rest.")
        counts = await self.calibrator.tare(self._args.anyway)
        self.said["tare_counts"] = counts
        self._words.append(f"{counts} counts are 0 g")

    async def force(self) -> None:
        """A press and a small step; the gains go to the board and into the description."""
        self._ask("Mount a plate and clear the drum.")
        limits = self._rig.config.limits
        if not limits.force_min_g <= self._args.force <= limits.force_max_g:
            raise WrongUse(
                f"--force {self._args.force:g} g: this rig presses with "
                f"{limits.force_min_g:g} to {limits.force_max_g:g} g"
            )
        found = await self.calibrator.gains(self._args.force)
        self.said |= {name: getattr(found, name) for name in found.__slots__}
        self._words.append(
            f"gain_p {found.gain_p_per_s:g} /s, gain_i {found.gain_i_per_s:g} /s, stiffness "
            f"{found.stiffness_g_per_mm:g} g/mm, delay {found.delay_ms:g} ms"
        )
        values: dict[str, Value] = {
            "gain_p_per_s": found.gain_p_per_s,
            "gain_i_per_s": found.gain_i_per_s,
        }
        await self._keep("actuator", values, gain_p=found.gain_p_per_s, gain_i=found.gain_i_per_s)

    async def turn(self) -> None:
        """A turn of the lifted drum; the table stays on the board."""
        self._ask("Take the plate off, or leave it on as it is used; clear the drum.")
        table_g = await self.calibrator.imbalance()
        self.said["table_g"] = [round(value, 3) for value in table_g]
        self._words.append(f"imbalance {(max(table_g) - min(table_g)) / 2:.2f} g")
        await self._keep("", {})

    def report(self) -> None:
        """The last lines."""
        if self._args.json:
            print(json.dumps(self.said, ensure_ascii=False))
            return
        print("\n".join(self._words))

    async def _point(self, mass_g: float) -> Point:
        if not self._rig.lay_mass(mass_g):
            what = f"Lay {mass_g:g} g on the drum" if mass_g else "Take everything off the drum"
            self._ask(f"{what}, let it come to rest.")
        point = await self.calibrator.point(mass_g)
        self._tell(f"{mass_g:g} g: {point.mean_counts:.0f} counts ± {point.sd_counts:.0f}")
        return point

    async def _keep(self, table: str, values: dict[str, Value], **settings: float) -> None:
        if self._args.dry:
            self._words.append("nothing was kept (--dry)")
            return
        path = Path(self._args.rig) if values and self._rig.kind == BENCH else None
        text = _edited(path, table, values) if path else ""
        await self.calibrator.save(**settings)
        places = ["the board's EEPROM"]
        if path:
            replace_file(path, text)
            places.append(str(path))
        self.said["kept_in"] = places
        self._words.append(f"kept in {' and '.join(places)}")

    def _ask(self, text: str) -> None:
        if not self._args.yes:
            ask(text, "--yes says that all is in place")

    def _tell(self, text: str) -> None:
        if not self._args.json:
            print(text)


def _edited(path: Path, table: str, values: dict[str, Value]) -> str:
    """Return the description's text with new values. Raises ConfigError where it is not valid."""
    source = path.read_text(encoding="utf-8")
    parse_config(source, str(path))
    text = set_keys(source, table, values)
    parse_config(text, str(path))
    return text
