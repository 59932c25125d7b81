"""Show the trials, plate changes, time and disk space of a protocol."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

from rigctl.config.resources import find_protocol
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.errors import CheckFailed
from rigctl.protocol.loader import load_protocol
from rigctl.protocol.plan import Plan
from rigctl.protocol.steps import PLATE_CHANGE_S

SIMULATED = ("virtual", "firmware")
"""Rigs without a rig.toml: they have the nominal description."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("protocol", help="a file, or the name of a built-in protocol")
    parser.add_argument(
        "--seed", type=int, help="seed of the trial order, instead of the protocol's"
    )
    parser.add_argument(
        "--rig", default=SIMULATED[0], metavar="RIG", help="virtual, firmware, or a rig.toml"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="exit with 1 if the disk of DIR is too small"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the summary. Raises ProtocolError for a protocol that cannot be run."""
    config = RigConfig() if args.rig in SIMULATED else load_config(Path(args.rig))
    plan = load_protocol(find_protocol(args.protocol), config).plan(args.seed)
    summary = describe(plan)
    if args.json:
        print(json.dumps(summary, ensure_ascii=False))
    else:
        print(table(summary))
    if args.out:
        _check_disk_space(args.out, plan.bytes_estimate)
    return 0


def describe(plan: Plan) -> dict[str, Any]:
    """Return the summary of a plan as plain values."""
    protocol = plan.protocol
    lists = ("textures", "speeds_mm_s", "forces_g", "depths_mm")
    values = ("repeats", "travel_mm", "force_mode", "order")
    return {
        "protocol": protocol.name,
        "description": protocol.description,
        **{name: list(getattr(protocol, name)) for name in lists},
        **{name: getattr(protocol, name) for name in values},
        "seed": plan.seed,
        "trials": len(plan.trials),
        "steps": len(plan.steps),
        "plate_changes": plan.plate_changes,
        "trial_seconds": round(sum(t.duration_s for t in plan.trials), 3),
        "rig_seconds": round(plan.duration_s, 1),
        "people_seconds": plan.plate_changes * PLATE_CHANGE_S,
        "bytes": plan.bytes_estimate,
        "hash": plan.hash,
    }


def table(summary: dict[str, Any]) -> str:
    """Return the summary as a table of two columns."""
    presses, unit = ("forces", "g") if summary["forces_g"] else ("depths", "mm")
    is_shuffled = summary["order"] == "shuffled"
    order = f"shuffled by seed {summary['seed']}" if is_shuffled else "blocked"
    rows = (
        ("protocol", f"{summary['protocol']} – {summary['description']}".rstrip(" –")),
        ("textures", " ".join(summary["textures"]) or "none"),
        ("speeds", _numbers(summary["speeds_mm_s"], "mm/s")),
        (presses, _numbers(summary[f"{presses}_{unit}"], unit)),
        ("order", order),
        ("trials", f"{summary['trials']:,} of {summary['travel_mm']:g} mm"),
        ("steps", f"{summary['steps']:,}"),
        ("plate changes", str(summary["plate_changes"])),
        ("samples", f"{_time(summary['trial_seconds'])} of trials"),
        ("rig time", _time(summary["rig_seconds"])),
        ("with plate changes", _time(summary["rig_seconds"] + summary["people_seconds"])),
        ("disk", _size(summary["bytes"])),
        ("plan", summary["hash"]),
    )
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def _check_disk_space(folder: Path, needed_bytes: int) -> None:
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free_bytes = shutil.disk_usage(existing).free
    if needed_bytes > free_bytes:
        raise CheckFailed(
            f"the disk of {folder} has {_size(free_bytes)} free, but the protocol needs "
            f"{_size(needed_bytes)}: make room or choose another disk"
        )


def _numbers(values: list[float], unit: str) -> str:
    return f"{', '.join(f'{value:g}' for value in values)} {unit}" if values else "none"


def _time(seconds: float) -> str:
    whole = round(seconds)
    hours, minutes = whole // 3600, whole // 60 % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {whole % 60:02d} s" if minutes else f"{whole} s"


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"
