"""Analysis files: TOML with the constants that differ from the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import tomlkit

from rigctl.analysis.settings.analysis_settings import (
    AnalysisSettings,
    AsteriskThresholds,
    ConditionSettings,
    DrawCounts,
    ExtrapolationSettings,
    FingerAnalysisSettings,
    FoldSettings,
    TextureGroups,
    WindowSettings,
)
from rigctl.config.toml_lines import lines_of_paths
from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.config.toml_section import read_section
from rigctl.errors import ConfigError, WrongUse

GROUPS = "groups"


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
        finger=read_section(root.table("finger"), FingerAnalysisSettings),
        file=text.name,
        given=_given(text),
    )
    root.finish()
    _refuse_overlap(text, "conditions", "speeds_mm_s", settings.conditions)
    _refuse_overlap(text, "conditions", "forces_g", settings.conditions)
    _refuse_overlap(text, "finger", "profiles", settings.finger)
    _refuse_easier_stars(text, settings.statistics)
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


def _given(text: TomlText) -> tuple[tuple[str, int], ...]:
    lines = lines_of_paths(text.source)
    return tuple((".".join(map(str, path)), line) for path, line in lines.items() if len(path) == 2)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_shown, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)
