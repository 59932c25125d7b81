"""The constants of the analysis as values, and the TOML files that set them; the defaults are the
paper's.

Each part is a table of an analysis file, each field one of its keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit

from rigctl.analysis import published
from rigctl.config.toml_reader import (
    TomlTable,
    TomlText,
    lines_of_paths,
    names,
    number,
    read_section,
    text,
)
from rigctl.encoder.features import REFERENCE_SPEED_MM_S, WINDOW_MS
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.errors import ConfigError, WrongUse
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT

MAX_SPEED_MM_S, MAX_FORCE_G = 100_000.0, 100_000.0
MAX_WINDOWS, MAX_WINDOW_MS = 100_000, 60_000
MAX_DRAWS, MAX_COMPONENTS = 10_000, 100_000
LEAST_SHARE = 0.001
MAX_CHOICES, MAX_CHOICE_BYTES = 100, 200
MAX_DISTANCE_TRIALS = 2000
GROUPS = "groups"


@dataclass(frozen=True, slots=True)
class ConditionSettings:
    """Speeds and forces of the extrapolation, and the force to which C scales the others.

    Empty untrained levels stand for all others of the sessions. Paper: Materials and Methods,
    Force Invariance and Classification.
    """

    trained_speeds_mm_s: tuple[float, ...] = number(
        published.TRAINED_SPEEDS_MM_S, "mm/s", 0.001, MAX_SPEED_MM_S, "speeds to train on"
    )
    trained_forces_g: tuple[float, ...] = number(
        published.TRAINED_FORCES_G, "g", 0.001, MAX_FORCE_G, "forces to train on"
    )
    untrained_speeds_mm_s: tuple[float, ...] = number(
        (), "mm/s", 0.001, MAX_SPEED_MM_S, "speeds to test without training; none: all others"
    )
    untrained_forces_g: tuple[float, ...] = number(
        (), "g", 0.001, MAX_FORCE_G, "forces to test without training; none: all others"
    )
    reference_force_g: float = number(
        REFERENCE_FORCE_G, "g", 0.001, MAX_FORCE_G, "force whose SA rates C aims at"
    )

    def trains_speed(self, speed_mm_s: float) -> bool:
        """Return whether the extrapolation trains at a speed."""
        return speed_mm_s in self.trained_speeds_mm_s

    def trains_force(self, force_g: float) -> bool:
        """Return whether the extrapolation trains at a force."""
        return force_g in self.trained_forces_g

    def takes(self, speed_mm_s: float, force_g: float) -> bool:
        """Return whether the extrapolation trains or tests a condition."""
        speeds, forces = self.untrained_speeds_mm_s, self.untrained_forces_g
        speed = self.trains_speed(speed_mm_s) or not speeds or speed_mm_s in speeds
        return speed and (self.trains_force(force_g) or not forces or force_g in forces)

    @property
    def training_text(self) -> str:
        """The trained levels in words."""
        speeds = ", ".join(f"{v:g}" for v in self.trained_speeds_mm_s)
        return f"{speeds} mm/s and {', '.join(f'{f:g}' for f in self.trained_forces_g)} g"


@dataclass(frozen=True, slots=True)
class TextureGroups:
    """Texture groups: name and textures of each. The paper's plates are A to P (Figure 1)."""

    members: tuple[tuple[str, tuple[str, ...]], ...]

    @classmethod
    def of_paper(cls) -> TextureGroups:
        """Return the paper's four groups."""
        names = dict.fromkeys(published.GROUPS.values())
        return cls(
            tuple(
                (name, tuple(k for k, v in published.GROUPS.items() if v == name)) for name in names
            )
        )

    @property
    def group_of(self) -> dict[str, str]:
        """The group of each texture."""
        return {texture: name for name, textures in self.members for texture in textures}

    def present(self, textures: Iterable[str]) -> tuple[str, ...]:
        """Return the groups of some textures, in their order."""
        group_of = self.group_of
        return tuple(dict.fromkeys(group_of[name] for name in textures if name in group_of))


@dataclass(frozen=True, slots=True)
class FoldSettings:
    """Folds of Figures 3A and 3B: a share of each texture's trials (500 of 1500), in folds."""

    count: int = number(published.N_FOLDS, "", 2, 100, "folds of a draw")
    drawn_share: float = number(
        published.DRAWN_SHARE, "", LEAST_SHARE, 1, "share of a texture's trials in a draw"
    )


@dataclass(frozen=True, slots=True)
class ExtrapolationSettings:
    """Shares of each condition's trials in Figures 3C to 3F, and where a level is left out."""

    trained_share: float = number(
        published.TRAINED_SHARE, "", LEAST_SHARE, 1, "share of a trained condition to train on"
    )
    tested_share: float = number(
        published.TESTED_SHARE, "", LEAST_SHARE, 1, "share of an untrained condition to test"
    )


@dataclass(frozen=True, slots=True)
class WindowSettings:
    """Windows of the features; 0 windows stand for as many as the longest trial fills.

    The paper's trials of 240 mm fill 60 unscaled and 20 speed-scaled ones.
    """

    length_ms: int = number(WINDOW_MS, "ms", 1, MAX_WINDOW_MS, "length, at the reference speed")
    reference_speed_mm_s: float = number(
        REFERENCE_SPEED_MM_S, "mm/s", 0.001, MAX_SPEED_MM_S, "speed to which time is scaled"
    )
    unscaled: int = number(0, "", 0, MAX_WINDOWS, "windows of time; 0: as the longest trial fills")
    speed_scaled: int = number(
        0, "", 0, MAX_WINDOWS, "windows of texture travelled; 0: as the longest trial fills"
    )


@dataclass(frozen=True, slots=True)
class DrawCounts:
    """Random draws, and principal components at most (Figure 3)."""

    count: int = number(published.ITERATIONS, "", 1, MAX_DRAWS, "random draws")
    components: int = number(published.K_MAX, "", 1, MAX_COMPONENTS, "components at most")


@dataclass(frozen=True, slots=True)
class AsteriskThresholds:
    """Bounds of the asterisks: largest p, and least Cohen's d (Figure 4) or h (Figure S5)."""

    one_star_p: float = number(0.05, "", 0, 1, "* for p below")
    one_star_d: float = number(0.5, "", 0, 100, "* for |d| above")
    one_star_h: float = number(0.2, "", 0, 4, "* for |h| above")
    two_star_p: float = number(0.01, "", 0, 1, "** for p below")
    two_star_d: float = number(1.0, "", 0, 100, "** for |d| above")
    two_star_h: float = number(0.5, "", 0, 4, "** for |h| above")

    @property
    def asterisks(self) -> tuple[tuple[str, float, float], ...]:
        """The rule with Cohen's d: asterisks, largest p, least effect."""
        return (
            ("**", self.two_star_p, self.two_star_d),
            ("*", self.one_star_p, self.one_star_d),
        )

    @property
    def proportion_asterisks(self) -> tuple[tuple[str, float, float], ...]:
        """The rule with Cohen's h: asterisks, largest p, least effect."""
        return (
            ("**", self.two_star_p, self.two_star_h),
            ("*", self.one_star_p, self.one_star_h),
        )


@dataclass(frozen=True, slots=True)
class FurtherSettings:
    """Further analyses (``--also``), which the paper does not have.

    ``trains``: choices of trains beside the usual ones, such as ``SA layer I row 2`` or
    ``taxels 1-3, 7``.
    """

    draws: int = number(5, "", 1, MAX_DRAWS, "draws of the report that are used, the first ones")
    trains: tuple[str, ...] = names("further choices of trains", MAX_CHOICES, MAX_CHOICE_BYTES)
    texture: str = text("", "texture whose trains are shown; empty: L, or the first one")
    taxel: int = number(0, "", 0, 1024, "taxel whose trains are shown; 0: the most active one")
    noise_counts: tuple[float, ...] = number(
        (1.0, 2.0, 5.0, 10.0, 20.0), "counts", 0.01, 1023, "deviation of the noise added"
    )
    neighbours: int = number(5, "", 1, 1000, "neighbours that vote")
    distance_trials: int = number(
        200, "", 4, MAX_DISTANCE_TRIALS, "trials drawn for distances of spike trains"
    )
    shift_cost_per_s: float = number(
        100.0, "1/s", 0.1, 1e6, "Victor-Purpura: cost of moving a spike, adding one costs 1"
    )
    time_constant_ms: float = number(10.0, "ms", 0.1, 1e5, "van Rossum: of the exponential")


@dataclass(frozen=True, slots=True)
class StimulationSettings:
    """Pulses of ``rigctl encode --stimulation``, which the paper does not have.

    ``channels``: choices of trains, a channel each; none: one for each train.
    """

    channels: tuple[str, ...] = names("trains of each channel", MAX_CHOICES, MAX_CHOICE_BYTES)
    amplitude_low_ua: float = number(20.0, "µA", 0, 1e5, "of a spike where the reading is 0")
    amplitude_high_ua: float = number(80.0, "µA", 0, 1e5, "of a spike where the reading is 1")
    phase_us: int = number(200, "µs", 1, 10_000, "length of each of the two phases")
    interphase_us: int = number(50, "µs", 0, 10_000, "between the phases")
    refractory_ms: float = number(5.0, "ms", 0.1, 10_000, "least time from pulse to pulse")
    max_rate_hz: float = number(150.0, "Hz", 0.1, 10_000, "most pulses a second")
    rate_window_ms: float = number(200.0, "ms", 1, 10_000, "time in which the rate is counted")
    max_phase_charge_nc: float = number(16.0, "nC", 0, 1e6, "most charge of a phase")
    max_charge_nc_per_s: float = number(1000.0, "nC", 0, 1e9, "most charge of the phases of 1 s")

    @property
    def most_pulses(self) -> int:
        """The most pulses in the window of the rate."""
        return int(self.max_rate_hz * self.rate_window_ms / 1000)

    @property
    def largest_ua(self) -> float:
        """The amplitude that the charge of a phase allows."""
        return 1000 * self.max_phase_charge_nc / self.phase_us

    def amplitude_at(self, reading: float) -> float:
        """Return the amplitude in µA of a spike at a reading of 0 to 1."""
        return self.amplitude_low_ua + (self.amplitude_high_ua - self.amplitude_low_ua) * reading


@dataclass(frozen=True, slots=True)
class AnalysisSettings:
    """All constants of both experiments' analysis; ``file``: where they are from, or empty.

    ``finger``: the moving finger's, as its package defines them. ``further``,
    ``stimulation``: not the paper's.

    ``given``: keys that the file sets, with their lines.
    """

    conditions: ConditionSettings = field(default_factory=ConditionSettings)
    groups: TextureGroups = field(default_factory=TextureGroups.of_paper)
    folds: FoldSettings = field(default_factory=FoldSettings)
    extrapolation: ExtrapolationSettings = field(default_factory=ExtrapolationSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)
    draws: DrawCounts = field(default_factory=DrawCounts)
    statistics: AsteriskThresholds = field(default_factory=AsteriskThresholds)
    finger: Any = field(default_factory=lambda: _finger_settings()())
    further: FurtherSettings = field(default_factory=FurtherSettings)
    stimulation: StimulationSettings = field(default_factory=StimulationSettings)
    file: str = field(default="", compare=False)
    given: tuple[tuple[str, int], ...] = field(default=(), compare=False)

    def with_reference_force(self, force_g: float) -> AnalysisSettings:
        """Return the same settings with another reference force, as an option of a command."""
        given = tuple(one for one in self.given if one[0] != "conditions.reference_force_g")
        conditions = replace(self.conditions, reference_force_g=force_g)
        return replace(self, conditions=conditions, given=given)

    def place_of(self, key: str) -> str:
        """Return file and line of a dotted key, empty where the file does not set it."""
        line = dict(self.given).get(key)
        return "" if line is None else f"{self.file}, line {line}: {key}"


def _finger_settings() -> type[Any]:
    kind: type[Any] = EXPERIMENTS[FINGER_EXPERIMENT].load("settings")
    return kind


def load_settings(path: Path) -> AnalysisSettings:
    """Return the settings of an analysis file; a missing key has the paper's value.

    Raises ConfigError with file, line and key for a file that cannot be used.
    """
    return read_settings(TomlText.read(path, ConfigError))


def read_settings(text: TomlText) -> AnalysisSettings:
    """Return the settings of a TOML text; see :func:`load_settings`."""
    root = text.root
    settings = AnalysisSettings(
        conditions=read_section(root.table("conditions"), ConditionSettings),
        groups=_read_groups(root),
        folds=read_section(root.table("folds"), FoldSettings),
        extrapolation=read_section(root.table("extrapolation"), ExtrapolationSettings),
        windows=read_section(root.table("windows"), WindowSettings),
        draws=read_section(root.table("draws"), DrawCounts),
        statistics=read_section(root.table("statistics"), AsteriskThresholds),
        finger=read_section(root.table("finger"), _finger_settings()),
        further=read_section(root.table("further"), FurtherSettings),
        stimulation=read_section(root.table("stimulation"), StimulationSettings),
        file=text.name,
        given=_given(text),
    )
    root.finish()
    _refuse_overlap(text, "conditions", "speeds_mm_s", settings.conditions)
    _refuse_overlap(text, "conditions", "forces_g", settings.conditions)
    _refuse_overlap(text, "finger", "profiles", settings.finger)
    _refuse_easier_stars(text, settings.statistics)
    _refuse_overlapping_pulses(text, settings.stimulation)
    return settings


def as_plain(settings: AnalysisSettings) -> dict[str, Any]:
    """Return the settings as tables of plain values, for JSON and TOML."""
    plain: dict[str, Any] = {}
    for part in fields(settings):
        value = getattr(settings, part.name)
        if part.name == GROUPS:
            plain[GROUPS] = {name: list(members) for name, members in settings.groups.members}
        elif is_dataclass(value):
            plain[part.name] = {key.name: _plain(getattr(value, key.name)) for key in fields(value)}
    return plain


def to_toml(settings: AnalysisSettings) -> str:
    """Return an analysis file with every constant and its meaning; an empty list has no key."""
    document = tomlkit.document()
    for name, values in as_plain(settings).items():
        table = tomlkit.table()
        part = getattr(settings, name)
        docs = {} if name == GROUPS else {one.name: one.metadata for one in fields(part)}
        for key, value in values.items():
            if value == []:
                continue
            table.add(key, value)
            if key in docs:
                unit = docs[key]["unit"]
                table[key].comment(f"{unit}: {docs[key]['doc']}" if unit else docs[key]["doc"])
        document.add(name, table)
    return tomlkit.dumps(document)


def differences_from_paper(settings: AnalysisSettings) -> tuple[str, ...]:
    """Return a sentence with each constant that is not the paper's; none where all are."""
    ours, paper = as_plain(settings), as_plain(AnalysisSettings())
    del ours["further"], ours["stimulation"]
    found = []
    for name, values in ours.items():
        for key in dict.fromkeys((*paper[name], *values)):
            mine, theirs = (_shown(one[name].get(key, [])) for one in (ours, paper))
            if mine != theirs:
                found.append(f"{name}.{key} {mine} (paper: {theirs})")
    return (f"settings other than the paper's: {'; '.join(found)}",) if found else ()


def check_reference_force(settings: AnalysisSettings, forces_g: Sequence[float]) -> None:
    """Raise WrongUse with the line where a file's reference force is none of the sessions'."""
    place = settings.place_of("conditions.reference_force_g")
    reference_g = settings.conditions.reference_force_g
    if place and reference_g not in forces_g:
        present = ", ".join(f"{force:g}" for force in forces_g)
        raise WrongUse(
            f"{place}: no trial was made at {reference_g:g} g: name a force of the sessions "
            f"({present} g)"
        )


def _read_groups(root: TomlTable) -> TextureGroups:
    table = root.table(GROUPS)
    if GROUPS not in root:
        return TextureGroups.of_paper()
    members: dict[str, tuple[str, ...]] = {}
    for name in table:
        members[name] = table.texts(name)
        for other, textures in list(members.items())[:-1]:
            if both := sorted(set(textures) & set(members[name])):
                table.fail(name, f"texture {both[0]!r} is in the group {other!r} too")
    if len(members) < 2:
        root.fail(GROUPS, 'needs two groups or more, such as smooth = ["A"]')
    return TextureGroups(tuple(members.items()))


def _refuse_overlap(text: TomlText, table: str, what: str, values: Any) -> None:
    """Raise the text's error where a level is both trained and untrained."""
    trained = getattr(values, f"trained_{what}")
    for level in getattr(values, f"untrained_{what}"):
        if level in trained:
            shown = f"{level:g}" if isinstance(level, float) else level
            text.fail((table, f"untrained_{what}"), f"{shown} is trained too: name it once")


def _refuse_easier_stars(text: TomlText, bounds: AsteriskThresholds) -> None:
    """Raise the text's error where two asterisks are easier to reach than one."""
    wrong = {
        "two_star_p": bounds.two_star_p > bounds.one_star_p,
        "two_star_d": bounds.two_star_d < bounds.one_star_d,
        "two_star_h": bounds.two_star_h < bounds.one_star_h,
    }
    for key in (key for key, is_wrong in wrong.items() if is_wrong):
        other = key.replace("two", "one")
        given = key if ("statistics", key) in lines_of_paths(text.source) else other
        text.fail(("statistics", given), f"** is easier to reach than *: change {key} or {other}")


def _refuse_overlapping_pulses(text: TomlText, pulses: StimulationSettings) -> None:
    """Raise the text's error where a pulse is longer than the time to the next one."""
    length_ms = (2 * pulses.phase_us + pulses.interphase_us) / 1000
    if length_ms > pulses.refractory_ms:
        given = [key for table, key in _paths_of(text) if table == "stimulation"]
        names_of = ("refractory_ms", "phase_us", "interphase_us")
        key = next(name for name in names_of if name in given)
        text.fail(
            ("stimulation", key),
            f"a pulse of {length_ms:g} ms is longer than refractory_ms {pulses.refractory_ms:g}",
        )


def _paths_of(text: TomlText) -> list[tuple[Any, ...]]:
    return [path for path in lines_of_paths(text.source) if len(path) == 2]


def _given(text: TomlText) -> tuple[tuple[str, int], ...]:
    lines = lines_of_paths(text.source)
    return tuple((".".join(map(str, path)), line) for path, line in lines.items() if len(path) == 2)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_shown, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)
