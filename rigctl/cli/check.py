"""Show the trials, plate changes, time and disk space of a protocol.

Show the trials, plate changes, time and disk space of a protocol, of the drum or of the moving
finger (finger/paper, finger/quick, or a file).
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rigctl.bench.world_file import NOMINAL_WORLD
from rigctl.cli.arguments import a_path, add_option, add_seed, path_or_name
from rigctl.config.resources import find_any_protocol
from rigctl.config.rig_config import load_config
from rigctl.config.toml_reader import TomlText
from rigctl.errors import CheckFailed, ProtocolError
from rigctl.experiments import protocol_key
from rigctl.protocol.loader import load_protocol
from rigctl.protocol.plan import EACH_TRIAL, ORDER_WORDS, QUANTITY_NAMES, Plan
from rigctl.protocol.steps import PLATE_CHANGE_S

SIMULATED = ("virtual", "firmware")
"""Rigs without a rig.toml: they have the nominal description."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser, "protocol", path_or_name, help_text="a file, or the name of a built-in protocol"
    )
    add_seed(parser, "seed of the trial order, instead of the protocol's")
    add_option(
        parser,
        "--rig",
        path_or_name,
        "RIG",
        "virtual, firmware, a rig.toml or a finger.toml: whose limits hold (virtual)",
        default=SIMULATED[0],
    )
    add_option(parser, "--out", a_path, "DIR", "exit with 1 if the disk of DIR is too small")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the summary. Raises ProtocolError for a protocol that cannot be run."""
    protocol = find_any_protocol(args.protocol)
    its, key = protocol_key(TomlText.read(protocol, ProtocolError).root)
    check = its.load("check") if key else _check_drum
    summary, rows = check(protocol, args)
    print(json.dumps(summary, ensure_ascii=False) if args.json else rows)
    if args.out:
        _check_disk_space(args.out, summary["bytes"])
    return 0


def _check_drum(path: Path, args: argparse.Namespace) -> tuple[dict[str, Any], str]:
    simulated = args.rig in SIMULATED
    config = NOMINAL_WORLD.rig_config() if simulated else load_config(Path(args.rig))
    summary = describe(load_protocol(path, config).plan(args.seed))
    return summary, table(summary)


def describe(plan: Plan) -> dict[str, Any]:
    """Return the summary of a plan as plain values."""
    protocol = plan.protocol
    lists = ("textures", "speeds_mm_s", "forces_g", "depths_mm")
    values = ("repeats", "mounts", "travel_mm", "force_mode", "lift", "order")
    return {
        "protocol": protocol.name,
        "description": protocol.description,
        **{name: list(getattr(protocol, name)) for name in lists},
        **{name: getattr(protocol, name) for name in values},
        "seed": plan.seed,
        "trials": len(plan.trials),
        **_early_end(plan),
        "steps": len(plan.steps),
        "plate_changes": plan.plate_changes,
        "trial_seconds": round(sum(t.duration_s for t in plan.trials), 3),
        "rig_seconds": round(plan.duration_s, 1),
        "people_seconds": plan.plate_changes * PLATE_CHANGE_S,
        "bytes": plan.bytes_estimate,
        "hash": plan.hash,
    }


def _early_end(plan: Plan) -> dict[str, Any]:
    """Return the rule, and the fewest trials with it; empty without one."""
    rule = plan.protocol.early_end
    return {} if rule is None else {"fewest_trials": plan.fewest_trials, "early_end": asdict(rule)}


def table(summary: dict[str, Any]) -> str:
    """Return the summary as a table of two columns."""
    presses, unit = ("forces", "g") if summary["forces_g"] else ("depths", "mm")
    order = order_text(summary, ORDER_WORDS[summary["order"]])
    rows = (
        ("protocol", title_text(summary)),
        ("plates", " ".join(summary["textures"]) or "none"),
        ("speeds", _numbers(summary["speeds_mm_s"], "mm/s")),
        (presses, _numbers(summary[f"{presses}_{unit}"], unit)),
        ("order", f"{order}, {summary['repeats']} of each"),
        ("trials", f"{summary['trials']:,} of {summary['travel_mm']:g} mm"),
        *_lift_rows(summary),
        *_early_end_rows(summary),
        ("steps", f"{summary['steps']:,}"),
        ("plate changes", _changes(summary)),
        ("samples", f"{time_text(summary['trial_seconds'])} of trials"),
        ("duration", time_text(summary["rig_seconds"])),
        ("with plate changes", time_text(summary["rig_seconds"] + summary["people_seconds"])),
        ("disk space", size_text(summary["bytes"])),
        ("plan", summary["hash"]),
    )
    return in_columns(rows)


def _lift_rows(summary: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the row of a drum that does not lift after each trial."""
    return () if summary["lift"] == EACH_TRIAL else (("lifts", "after each condition"),)


def _early_end_rows(summary: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the row of the rule; all other rows are those of a run that it leaves as planned."""
    if "early_end" not in summary:
        return ()
    rule, name = summary["early_end"], QUANTITY_NAMES[summary["early_end"]["of"]]
    text = (
        f"at ± {rule['half_width_hz']:g} Hz of the {name}, from {rule['least_trials']} trials of a "
        f"condition on: {summary['fewest_trials']:,} trials at least"
    )
    return (("early end", text),)


def title_text(summary: dict[str, Any]) -> str:
    """Return name and description of a protocol."""
    return f"{summary['protocol']} – {summary['description']}".rstrip(" –")


def order_text(summary: dict[str, Any], words: str) -> str:
    """Return the order of the trials in words, a shuffled one with its seed."""
    return f"shuffled by seed {summary['seed']}" if summary["order"] == "shuffled" else words


def _changes(summary: dict[str, Any]) -> str:
    changes, mounts = str(summary["plate_changes"]), summary["mounts"]
    return f"{changes}, each plate mounted {mounts} times" if mounts > 1 else changes


def in_columns(rows: Sequence[tuple[str, str]]) -> str:
    """Return rows as a table of two columns."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def _check_disk_space(folder: Path, needed_bytes: int) -> None:
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free_bytes = shutil.disk_usage(existing).free
    if needed_bytes > free_bytes:
        raise CheckFailed(
            f"the disk of {folder} has {size_text(free_bytes)} free, but the protocol needs "
            f"{size_text(needed_bytes)}: make room or choose another disk"
        )


def _numbers(values: list[float], unit: str) -> str:
    return f"{', '.join(f'{value:g}' for value in values)} {unit}" if values else "none"


def time_text(seconds: float) -> str:
    """Return a duration in words."""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole // 60 % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {whole % 60:02d} s" if minutes else f"{whole} s"


def size_text(count: float) -> str:
    """Return a number of bytes with its unit."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"
