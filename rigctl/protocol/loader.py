"""Parse ``protocols/*.toml`` into a :class:`Protocol`; each error names file, line and key."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.config.toml_section import read_section
from rigctl.errors import ProtocolError
from rigctl.protocol.finger import PROTOCOL_KEYS
from rigctl.protocol.plan import (
    MAX_SEED,
    FreeStep,
    Protocol,
    Quality,
    Settle,
    register_range,
)
from rigctl.protocol.steps import ApproachOnly, Baseline, Message, Rest, Step, Tare, Turn, ramp_mm

PLACES = ("start", "plate_start", "between_plates", "plate_end", "end", "every")
DIRECTIONS = ("forward", "backward", "alternate")
FORCE_MODES = ("hold", "lock", "position")
ORDERS = ("blocked", "shuffled")
MAX_TRIALS = 100_000
MAX_STEPS = 200_000
"""Steps of a plan, trials and changes of plates included."""
MAX_FREE_STEPS = 100
MAX_TEXTURES = 1000
MAX_MOUNTS = 100
MAX_PROMPT_LETTERS = 300
MAX_DESCRIPTION_LETTERS = 10_000
MAX_SECONDS = 86_400.0
MAX_TURNS = 100
TEXTURE_BYTES = 16
"""Length of a texture's name in a session's trial row."""


def load_protocol(path: Path, config: RigConfig | None = None) -> Protocol:
    """Load a protocol and validate it against a rig, by default the nominal one.

    Raises ProtocolError.
    """
    return _parse(TomlText.read(path, ProtocolError), path.stem, config or RigConfig())


def parse_protocol(text: str, name: str, config: RigConfig | None = None) -> Protocol:
    """Parse a protocol from ``text``, as :func:`load_protocol`; ``name`` is for messages."""
    return _parse(TomlText(name, text, ProtocolError), Path(name).stem, config or RigConfig())


def _parse(text: TomlText, stem: str, config: RigConfig) -> Protocol:
    root = text.root
    _refuse_finger_protocol(root)
    root.allow("textures")
    order, trial, plates = root.table("order"), root.table("trial"), root.table("plates")
    force_mode = trial.choice("force_mode", FORCE_MODES, "hold")
    _refuse_other_presses(root, force_mode)
    protocol = Protocol(
        name=root.name("name", stem),
        text=text.source,
        config=config,
        description=root.text("description", "", most=MAX_DESCRIPTION_LETTERS),
        textures=read_textures(root) if "textures" in root else (),
        speeds_mm_s=root.numbers("speeds_mm_s", **_speed_range(config)),
        forces_g=root.numbers("forces_g", **_force_range(config)),
        depths_mm=root.numbers("depths_mm", unit="mm", **register_range("depth_set_um", 1e-3)),
        repeats=root.integer("repeats", 1, low=1, high=MAX_TRIALS),
        mounts=root.integer("mounts", 1, low=1, high=MAX_MOUNTS),
        order=order.choice("kind", ORDERS, "blocked"),
        order_seed=order.integer("seed", 0, low=0, high=MAX_SEED),
        across_plates=order.flag("across_plates", False),
        travel_mm=trial.number("travel_mm", 240, unit="mm", **register_range("travel_set")),
        force_mode=force_mode,
        direction=trial.choice("direction", DIRECTIONS, "forward"),
        plate_prompt=plates.text(
            "prompt", "Mount plate {texture}, then confirm.", most=MAX_PROMPT_LETTERS
        ),
        settle=_settle(root.table("settle")),
        quality=read_section(root.table("quality"), Quality),
        steps=_free_steps(root, config),
    )
    for table in (order, trial, plates, root):
        table.finish()
    _validate_order(protocol, order)
    _validate_trials(protocol, root)
    _validate_steps(protocol, root)
    _validate_travel(protocol, root, trial)
    return protocol


def read_textures(root: TomlTable) -> tuple[str, ...]:
    """Return the names of the plates, which fit into a session's trial row."""
    return root.names("textures", most=MAX_TEXTURES, longest_bytes=TEXTURE_BYTES)


def _speed_range(config: RigConfig) -> dict[str, Any]:
    limits = config.limits
    return {"unit": "mm/s", "low": limits.speed_min_mm_s, "high": limits.speed_max_mm_s}


def _force_range(config: RigConfig) -> dict[str, Any]:
    limits = config.limits
    return {"unit": "g", "low": limits.force_min_g, "high": limits.force_max_g}


def _refuse_finger_protocol(root: TomlTable) -> None:
    for key in PROTOCOL_KEYS:
        if key in root:
            root.fail(
                key, "belongs to a protocol of the moving finger: record it with `rigctl realtime`"
            )


def _refuse_other_presses(root: TomlTable, force_mode: str) -> None:
    """Raise for forces in force mode position, and for depths in any other mode."""
    if "forces_g" in root and force_mode == "position":
        root.fail("forces_g", "force mode position presses to a depth: give depths_mm instead")
    if "depths_mm" in root and force_mode != "position":
        root.fail("depths_mm", 'needs trial.force_mode = "position"')


def _settle(table: TomlTable) -> Settle:
    settle = read_section(table, Settle)
    if settle.timeout_s <= settle.time_s:
        table.fail("timeout_s", f"must be longer than time_s, which is {settle.time_s:g} s")
    return settle


def _free_steps(root: TomlTable, config: RigConfig) -> tuple[FreeStep, ...]:
    tables = root.tables("steps")
    if len(tables) > MAX_FREE_STEPS:
        root.fail("steps", f"has {len(tables):,} entries; {MAX_FREE_STEPS} are the most")
    return tuple(_free_step(table, config) for table in tables)


def _free_step(table: TomlTable, config: RigConfig) -> FreeStep:
    place = table.choice("at", PLACES)
    every = table.integer("trials", low=1, high=MAX_TRIALS) if place == "every" else 0
    step = _KINDS[table.choice("kind", _KINDS)](table, config)
    table.finish()
    return FreeStep(place, step, every)


def _seconds(table: TomlTable) -> float:
    return table.number("seconds", unit="s", low=0.01, high=MAX_SECONDS)


def _approach_only(table: TomlTable, config: RigConfig) -> Step:
    return ApproachOnly(table.number("force_g", **_force_range(config)), _seconds(table))


def _turn(table: TomlTable, config: RigConfig) -> Step:
    speed_mm_s = table.number("speed_mm_s", **_speed_range(config))
    return Turn(speed_mm_s, table.integer("turns", low=1, high=MAX_TURNS))


_KINDS: dict[str, Callable[[TomlTable, RigConfig], Step]] = {
    "tare": lambda table, config: Tare(),
    "rest": lambda table, config: Rest(_seconds(table)),
    "approach_only": _approach_only,
    "baseline": lambda table, config: Baseline(_seconds(table)),
    "turn": _turn,
    "message": lambda table, config: Message(table.text("text"), table.flag("wait", False)),
}


def _validate_order(protocol: Protocol, order: TomlTable) -> None:
    """Raise unless a shuffled order has a seed, and only a shuffled one mixes the plates."""
    if protocol.order == "shuffled" and "seed" not in order:
        order.fail("seed", "is missing: a shuffled order needs a written seed, such as seed = 1")
    if protocol.order != "shuffled" and protocol.across_plates:
        order.fail("across_plates", 'needs order.kind = "shuffled"')
    if protocol.mounts > 1 and protocol.across_plates:
        order.fail(
            "across_plates",
            "mounts a plate before nearly every trial: leave it out, or give no mounts",
        )


def _validate_trials(protocol: Protocol, root: TomlTable) -> None:
    """Raise unless the keys of trials are all there or all missing, and fit into a session."""
    presses = "depths_mm" if protocol.force_mode == "position" else "forces_g"
    needed = {"textures", "speeds_mm_s", presses}
    given = {key for key in (*needed, "repeats", "mounts") if key in root}
    if given and not needed <= given:
        missing = sorted(needed - given)[0]
        root.fail(missing, f"is missing: trials need {', '.join(sorted(needed))}")
    if not given and not protocol.steps:
        root.fail("", "there is nothing to do: give textures, speeds_mm_s and forces_g, or steps")
    if (trials := protocol.n_trials) > MAX_TRIALS:
        key = "mounts" if protocol.mounts > 1 else "repeats"
        root.fail(key, f"make {trials:,} trials; a session holds up to {MAX_TRIALS:,}")


def _validate_steps(protocol: Protocol, root: TomlTable) -> None:
    """Raise for a plan of too many steps, counted before it is made."""
    trials = protocol.n_trials
    blocks = trials if protocol.across_plates else len(protocol.textures) * protocol.mounts
    of_place = {"start": 1, "end": 1}
    steps = (
        trials
        + blocks
        + sum(
            trials // free.every_trials if free.every_trials else of_place.get(free.at, blocks)
            for free in protocol.steps
        )
    )
    if steps > MAX_STEPS:
        root.fail("steps", f"make up to {steps:,} steps; a plan has {MAX_STEPS:,} at most")


def _validate_travel(protocol: Protocol, root: TomlTable, trial: TomlTable) -> None:
    """Raise unless the ramp fits into the run-in and the whole trial onto the plate."""
    drum = protocol.config.drum
    if not protocol.speeds_mm_s:
        return
    fastest = max(protocol.speeds_mm_s)
    ramp = ramp_mm(fastest, protocol.config)
    if ramp > drum.run_in_mm:
        root.fail(
            "speeds_mm_s",
            f"the ramp to {fastest:g} mm/s takes {ramp:.0f} mm, the rig's run-in is "
            f"{drum.run_in_mm:g} mm: lower the speed or lengthen drum.run_in_mm in rig.toml",
        )
    room = drum.plate_length_mm - drum.run_in_mm - drum.sync_margin_mm - ramp
    if protocol.travel_mm > room:
        trial.fail(
            "travel_mm",
            f"{protocol.travel_mm:g} mm do not fit on the plate of {drum.plate_length_mm:g} mm: "
            f"with run-in and ramps there is room for {room:.0f} mm at {fastest:g} mm/s",
        )
