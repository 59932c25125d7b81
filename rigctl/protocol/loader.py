"""Parse ``protocols/*.toml`` into a :class:`Protocol`; each error names file, line and key."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_reader import TomlTable, TomlText, read_section
from rigctl.errors import ProtocolError
from rigctl.experiments import protocol_key
from rigctl.protocol.fields import (
    FORCE_MODE,
    KIND,
    MAX_TRIALS,
    OF_PLACE,
    ORDER_GROUP,
    PLACE,
    PLATES_GROUP,
    TRIAL_GROUP,
    name_group,
    step_fields,
    trials_group,
)
from rigctl.protocol.plan import (
    EACH_CONDITION,
    EarlyEnd,
    FreeStep,
    Protocol,
    Quality,
    Settle,
)
from rigctl.protocol.steps import (
    ApproachOnly,
    Baseline,
    Message,
    Rest,
    Step,
    Tare,
    Turn,
    ramp_mm,
    run_in_range_mm,
    way_to_repeat_mm,
)

MAX_STEPS = 200_000
"""Steps of a plan, trials and changes of plates included."""
MAX_FREE_STEPS = 100
KINDS: dict[str, Callable[..., Step]] = {
    "tare": Tare,
    "rest": Rest,
    "approach_only": ApproachOnly,
    "baseline": Baseline,
    "turn": Turn,
    "message": Message,
}
"""The class of each kind of free step, whose attributes are the keys of the step."""


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
    _refuse_other_experiment(root)
    order, trial, plates = root.table("order"), root.table("trial"), root.table("plates")
    _refuse_other_presses(root, FORCE_MODE.read(trial))
    conditions = name_group(stem).read(root) | trials_group(config).read(root)
    ordered = ORDER_GROUP.read(order)
    protocol = Protocol(
        text=text.source,
        config=config,
        **conditions,
        **TRIAL_GROUP.read(trial),
        order=ordered["kind"],
        order_seed=ordered["seed"],
        across_plates=ordered["across_plates"],
        plate_prompt=PLATES_GROUP.read(plates)["prompt"],
        settle=_settle(root.table("settle")),
        quality=read_section(root.table("quality"), Quality),
        steps=_free_steps(root, config),
        early_end=_early_end(root),
    )
    for table in (order, trial, plates, root):
        table.finish()
    _validate_order(protocol, order)
    _validate_trials(protocol, root)
    _validate_early_end(protocol, root)
    _validate_steps(protocol, root)
    _validate_travel(protocol, root, trial)
    _validate_lift(protocol, trial)
    return protocol


def _refuse_other_experiment(root: TomlTable) -> None:
    its, key = protocol_key(root)
    if key:
        root.fail(key, f"belongs to a protocol of {its.title}: record it with `{its.recorded_by}`")


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


def _early_end(root: TomlTable) -> EarlyEnd | None:
    if "early_end" not in root:
        return None
    table = root.table("early_end")
    if "half_width_hz" not in table:
        table.fail("half_width_hz", "is missing: say how narrowly the mean rate has to be known")
    return read_section(table, EarlyEnd)


def _free_steps(root: TomlTable, config: RigConfig) -> tuple[FreeStep, ...]:
    tables = root.tables("steps")
    if len(tables) > MAX_FREE_STEPS:
        root.fail("steps", f"has {len(tables):,} entries; {MAX_FREE_STEPS} are the most")
    return tuple(_free_step(table, config) for table in tables)


def _free_step(table: TomlTable, config: RigConfig) -> FreeStep:
    place = PLACE.read(table)
    of_place = OF_PLACE[place].read(table) if place in OF_PLACE else 0
    kind = KIND.read(table)
    if place == "drift" and kind != "tare":
        table.fail("kind", 'is not what a drift asks for: at = "drift" goes with kind = "tare"')
    values = {item.key: item.read(table) for item in step_fields(config)[kind]}
    table.finish()
    step = KINDS[kind](**values)
    if place == "drift":
        return FreeStep(place, step, limit_g=of_place)
    return FreeStep(place, step, of_place)


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


def _validate_early_end(protocol: Protocol, root: TomlTable) -> None:
    """Raise where no condition could end before its repeats."""
    rule = protocol.early_end
    if rule is None:
        return
    if not protocol.n_trials:
        root.fail("early_end", "needs trials: give textures, speeds_mm_s and forces_g")
    if protocol.mounts > 1:
        root.fail("early_end", "goes with one mounting: trials of another one are no repeats")
    if rule.least_trials >= protocol.repeats:
        root.fail(
            "early_end",
            f"least_trials is {rule.least_trials} and repeats {protocol.repeats}: no condition "
            "could end early, so give more repeats",
        )


def _validate_steps(protocol: Protocol, root: TomlTable) -> None:
    """Raise for a plan of too many steps, counted before it is made."""
    trials = protocol.n_trials
    blocks = trials if protocol.across_plates else len(protocol.textures) * protocol.mounts
    at_place = {"start": 1, "end": 1, "drift": 0}
    steps = (
        trials
        + blocks
        + sum(
            trials // free.every_trials if free.every_trials else at_place.get(free.at, blocks)
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


def _validate_lift(protocol: Protocol, trial: TomlTable) -> None:
    """Raise unless repeats follow each other and the drum can turn from one to the next."""
    if protocol.lift != EACH_CONDITION:
        return
    if protocol.force_mode != "hold":
        trial.fail("lift", 'by condition needs force_mode = "hold": the force loop keeps the force')
    if protocol.order != "blocked":
        trial.fail("lift", 'by condition needs order.kind = "blocked": repeats follow each other')
    is_alternate = protocol.direction == "alternate"
    if not (protocol.config.drum.level_joint or is_alternate):
        trial.fail(
            "lift",
            "by condition turns the drum over the plate's joint in contact: see that it carries "
            "the sensor as the plate does and set drum.level_joint in rig.toml, or let direction "
            'be "alternate", which turns back before it',
        )
    for speed in protocol.speeds_mm_s:
        way_mm = way_to_repeat_mm(protocol.travel_mm, speed, protocol.config, back=is_alternate)
        least_mm, most_mm = run_in_range_mm(speed, protocol.config)
        if not least_mm <= way_mm <= most_mm:
            trial.fail(
                "lift",
                f"by condition leaves {way_mm:.0f} mm from a trial at {speed:g} mm/s to the next "
                f"window, and {least_mm:.0f} to {most_mm:.0f} mm are possible: choose another "
                "travel_mm, or lift after each trial",
            )
