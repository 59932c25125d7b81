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
from itertools import pairwise
from pathlib import Path
from typing import Any

from rigctl.cli.arguments import a_path, add_option, add_seed, path_or_name
from rigctl.config.resources import find_any_protocol
from rigctl.config.rig_config import RigConfig, load_config, load_finger_config
from rigctl.errors import CheckFailed
from rigctl.finger.plan import FingerPlan, is_finger_protocol, load_finger_protocol
from rigctl.finger.values import Stage
from rigctl.protocol.loader import load_protocol
from rigctl.protocol.plan import BLOCKED_WORDS, PLATE_BY_PLATE, QUANTITY_NAMES, Plan
from rigctl.protocol.steps import PLATE_CHANGE_S


def describe_finger(plan: FingerPlan) -> dict[str, Any]:
    """Return the summary of a plan of all stages as plain values.

    ``seconds`` are those of the scans and the ways back, without changes of plates.
    """
    protocol = plan.protocol
    return {
        "protocol": protocol.name,
        "description": protocol.description,
        "textures": list(protocol.textures),
        "profiles": [profile.value for profile in protocol.profiles],
        "reference_mm_s": protocol.reference_mm_s,
        "order": protocol.order,
        "seed": plan.seed,
        "stages": {stage.value: _stage(plan, stage) for stage in Stage},
        "trials": len(plan.trials),
        "plate_changes": _plate_changes(plan),
        "seconds": plan.duration_s,
        "bytes": plan.bytes_estimate,
        "hash": plan.hash,
    }


def _stage(plan: FingerPlan, stage: Stage) -> dict[str, Any]:
    part = plan.protocol.plan([stage], plan.seed)
    return {
        "trials": len(part.trials),
        "plate_changes": _plate_changes(part),
        "seconds": part.duration_s,
        "bytes": part.bytes_estimate,
    }


def _plate_changes(plan: FingerPlan) -> int:
    """Return how often a person lays a plate down, the first one included."""
    changes = sum(before.texture != after.texture for before, after in pairwise(plan.trials))
    return changes + bool(plan.trials)


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
    if is_finger_protocol(protocol):
        summary, rows = _check_finger(protocol, args)
    else:
        summary, rows = _check_drum(protocol, args)
    print(json.dumps(summary, ensure_ascii=False) if args.json else rows)
    if args.out:
        _check_disk_space(args.out, summary["bytes"])
    return 0


def _check_drum(path: Path, args: argparse.Namespace) -> tuple[dict[str, Any], str]:
    config = RigConfig() if args.rig in SIMULATED else load_config(Path(args.rig))
    summary = describe(load_protocol(path, config).plan(args.seed))
    return summary, table(summary)


def _check_finger(path: Path, args: argparse.Namespace) -> tuple[dict[str, Any], str]:
    if args.rig not in SIMULATED:
        load_finger_config(Path(args.rig))
    summary = describe_finger(load_finger_protocol(path).plan(list(Stage), args.seed))
    return summary, finger_table(summary)


def describe(plan: Plan) -> dict[str, Any]:
    """Return the summary of a plan as plain values."""
    protocol = plan.protocol
    lists = ("textures", "speeds_mm_s", "forces_g", "depths_mm")
    values = ("repeats", "mounts", "travel_mm", "force_mode", "order")
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
    rows = (
        ("protocol", _title(summary)),
        ("plates", " ".join(summary["textures"]) or "none"),
        ("speeds", _numbers(summary["speeds_mm_s"], "mm/s")),
        (presses, _numbers(summary[f"{presses}_{unit}"], unit)),
        ("order", f"{_order(summary, BLOCKED_WORDS)}, {summary['repeats']} of each"),
        ("trials", f"{summary['trials']:,} of {summary['travel_mm']:g} mm"),
        *_early_end_rows(summary),
        ("steps", f"{summary['steps']:,}"),
        ("plate changes", _changes(summary)),
        ("samples", f"{_time(summary['trial_seconds'])} of trials"),
        ("duration", _time(summary["rig_seconds"])),
        ("with plate changes", _time(summary["rig_seconds"] + summary["people_seconds"])),
        ("disk space", _size(summary["bytes"])),
        ("plan", summary["hash"]),
    )
    return _columns(rows)


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


def finger_table(summary: dict[str, Any]) -> str:
    """Return the summary of a protocol of the moving finger as a table of two columns."""
    stages: list[tuple[str, str]] = [
        (name, f"{stage['trials']} scans, {_needs(stage)}")
        for name, stage in summary["stages"].items()
    ]
    rows: list[tuple[str, str]] = [
        ("protocol", _title(summary)),
        ("plates", " ".join(summary["textures"])),
        ("profiles", " ".join(summary["profiles"])),
        ("reference", f"{summary['reference_mm_s']:g} mm/s"),
        ("order", _order(summary, PLATE_BY_PLATE)),
        *stages,
        ("all", f"{summary['trials']} scans, {_needs(summary)}"),
        ("plan", summary["hash"]),
        ("record it with", "rigctl realtime train, calibrate, run"),
    ]
    return _columns(rows)


def _needs(part: dict[str, Any]) -> str:
    changes = f"{part['plate_changes']} changes of plates"
    return f"{_time(part['seconds'])} and {changes}, {_size(part['bytes'])}"


def _title(summary: dict[str, Any]) -> str:
    return f"{summary['protocol']} – {summary['description']}".rstrip(" –")


def _order(summary: dict[str, Any], blocked: str) -> str:
    return f"shuffled by seed {summary['seed']}" if summary["order"] == "shuffled" else blocked


def _changes(summary: dict[str, Any]) -> str:
    changes, mounts = str(summary["plate_changes"]), summary["mounts"]
    return f"{changes}, each plate mounted {mounts} times" if mounts > 1 else changes


def _columns(rows: Sequence[tuple[str, str]]) -> str:
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
