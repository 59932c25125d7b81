"""A guessed map for unknown recordings, with ten rows and what each column seems to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.config.names import shorten
from rigctl.config.toml_reader import TomlText
from rigctl.errors import ConfigError, WrongUse
from rigctl.exchange.column_map import parse_map
from rigctl.exchange.column_names import RANGE
from rigctl.exchange.file_readers import read_trials
from rigctl.exchange.guess.file_names import NamePattern, guess_pattern
from rigctl.exchange.guess.map_text import MapParts, write_map
from rigctl.exchange.guess.roles import ColumnRoles, describe_values, guess_roles
from rigctl.exchange.guess.sample import RecordingSample, read_sample
from rigctl.exchange.inspection import extract_series
from rigctl.exchange.labels import LABELS, parse_label
from rigctl.exchange.recording_files import common_folder, refuse_unreadable_names

ROWS_SHOWN = 10


@dataclass(frozen=True, slots=True)
class GuessedMap:
    """A map's text, ``rows`` of the first file under ``header``, and what each column seems to be.

    ``columns``: pairs of names and words; ``labels``: pairs of a label and its values. ``n_trials``
    of the first file, 0 if the map cannot read it. ``problem``: why the map does not work yet, in
    a sentence; empty if it does.
    """

    text: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    columns: tuple[tuple[str, str], ...]
    labels: tuple[tuple[str, str], ...]
    n_trials: int
    problem: str


def guess_map(paths: Sequence[Path]) -> GuessedMap:
    """Return a map for these files, which must have one layout.

    Raises WrongUse for files of two layouts, and for what cannot be read.
    """
    if not paths:
        raise WrongUse("there is no file to guess from: name at least one")
    refuse_unreadable_names(paths)
    sample = read_sample(paths)
    roles = guess_roles(sample)
    pattern = _guess_labels(paths, sample, roles)
    labels = _values(sample, roles, pattern)
    folder = common_folder(paths)
    parts = MapParts(
        name=folder.name or "recordings",
        n_files=len(paths),
        example=paths[0].absolute().relative_to(folder).as_posix(),
        sample=sample,
        roles=roles,
        pattern=pattern,
        textures=labels.get("texture", ()),
    )
    text = write_map(parts)
    _refuse_broken_letters(text, paths[0])
    return GuessedMap(
        text,
        sample.names,
        tuple(_rows(sample)),
        tuple(_describe_columns(sample, roles)),
        tuple((k, describe_values(v)) for k, v in labels.items()),
        *_try_map(text, paths),
    )


def _refuse_broken_letters(text: str, path: Path) -> None:
    """Raise WrongUse for a map that no file can hold: its names or labels have half letters."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        line = text.count("\n", 0, error.start) + 1
        near = shorten(ascii(text.splitlines()[line - 1]))
        raise WrongUse(f"{path}: names or labels that are no Unicode text: {near}") from error


def _guess_labels(
    paths: Sequence[Path], sample: RecordingSample, roles: ColumnRoles
) -> NamePattern:
    """Return the pattern for labels that no column has; without repeat where it would collide."""
    wanted = [label for label in LABELS if label not in {*roles.labels, *roles.fields}]
    if len(paths) == 1 and {"texture", "speed"}.isdisjoint(wanted):
        return NamePattern()
    if (sample.elements or roles.trial is not None) and "repeat" in wanted:
        wanted.remove("repeat")
    pattern = guess_pattern(paths, wanted)
    conditions = set(zip(*pattern.labels.values(), strict=True))
    if "repeat" in pattern.labels and len(conditions) < len(paths):
        wanted.remove("repeat")
        pattern = guess_pattern(paths, wanted)
    return pattern


def _values(
    sample: RecordingSample, roles: ColumnRoles, pattern: NamePattern
) -> dict[str, tuple[str, ...]]:
    """Return the different values of each label, from names, fields and columns."""
    found = {label: tuple(dict.fromkeys(values)) for label, values in pattern.labels.items()}
    found |= {label: tuple(dict.fromkeys(sample.fields[n])) for label, n in roles.fields.items()}
    for label, column in roles.labels.items():
        found[label] = sample.different(column)
    return {label: found[label] for label in LABELS if label in found}


def _rows(sample: RecordingSample) -> list[tuple[str, ...]]:
    every = range(len(sample.names))
    shown = min(ROWS_SHOWN, len(sample.values))
    return [tuple(sample.cell(row, column) for column in every) for row in range(shown)]


def _describe_columns(sample: RecordingSample, roles: ColumnRoles) -> list[tuple[str, str]]:
    """Return names and words; neighbours of one role are a range."""
    described: list[tuple[str, str, str]] = []
    for column, name in enumerate(sample.names):
        role, _, values = roles.why.get(column, "not used").partition(": ")
        if described and described[-1][1] == role and role in ("taxel", "another channel"):
            first = described[-1][0].partition(RANGE)[0]
            described[-1] = (f"{first}{RANGE}{name}", role, _join(described[-1][2], values))
        else:
            described.append((name, role, values))
    return [(name, f"{role}: {values}" if values else role) for name, role, values in described]


def _join(one: str, other: str) -> str:
    """Return the span of two spans."""
    ends = [float(end) for span in (one, other) for end in span.split(" … ")]
    return f"{min(ends):.6g} … {max(ends):.6g}"


def _try_map(text: str, paths: Sequence[Path]) -> tuple[int, str]:
    """Return the trials of the first file, and why the map fails there or at a name, if it does."""
    count = 0
    try:
        mapping = parse_map(TomlText("the map", text, ConfigError), "")
        trials = read_trials(paths[0], mapping).trials
        count = len(trials)
        if not trials:
            return 0, f"{paths[0]} has no trials with this map: every element is empty"
        for trial in trials:
            parse_label(trial.path, mapping.labels, trial.labels, trial.place)
        for path in paths:
            parse_label(path, mapping.labels, trials[0].labels, str(path))
        extract_series(trials[0], mapping)
    except WrongUse as problem:
        return count, str(problem)
    return count, ""
