"""Guess the map of recordings of others from names, columns and values, as text to correct."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from math import isqrt
from pathlib import Path
from unicodedata import normalize

from rigctl.config.text_file import name_problem, shorten
from rigctl.config.toml_reader import TomlText
from rigctl.errors import ConfigError, WrongUse
from rigctl.exchange.column_map import parse_map
from rigctl.exchange.file_readers import DELIMITERS, read_trials
from rigctl.exchange.guess_roles import (
    ANY_UNIT,
    ColumnRoles,
    RecordingSample,
    describe_values,
    find_unit,
    first_role,
    guess_roles,
    read_sample,
    reference,
    references,
    words_of,
)
from rigctl.exchange.inspection import extract_series
from rigctl.exchange.labels import DEPTH, LABELS, parse_label
from rigctl.exchange.recording_files import common_folder, refuse_unreadable_names
from rigctl.exchange.recording_tables import RANGE
from rigctl.protocol.fields import TEXTURE_BYTES

SLASH = "/"
_DATE_DIGITS, _WORD_LETTERS, _FIRST_REPEAT = 6, 3, 3
_WITH_UNITS = ("speed", "force")
_NUMERIC = (*_WITH_UNITS, "mount", "repeat")
_SIGNED, _UNSIGNED = "-?", ""
_TOKEN = (
    r"(?P<prefix>[^\W\d_]*)(?P<number>{sign}\d+(?:[.,]\d+)?)"
    rf"(?P<suffix>[ _]?(?i:{ANY_UNIT})(?![^\W\d_])|[^\W\d_]*)"
    r"|(?P<words>[^\W\d_]+(?:[ _-][^\W\d_]+(?![^\W_]))*)|(?P<mark>.)"
)


@dataclass(slots=True)
class NamePart:
    """One part of all names: a number between letters, words, or a mark; a value for each file."""

    kind: str
    values: tuple[str, ...]
    prefix: str = ""
    suffix: str = ""
    role: str = ""

    @property
    def varies(self) -> bool:
        """Whether the files differ in it."""
        return len(set(self.values)) > 1

    def unit(self, role: str) -> str:
        """Return the unit of that role behind the number, empty if there is none."""
        return find_unit(role, f"_{self.suffix}") if self.suffix else ""


@dataclass(frozen=True, slots=True)
class NamePattern:
    """The pattern, the values of each label over all files, units, and what was assumed."""

    pattern: str = ""
    labels: dict[str, tuple[str, ...]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


def guess_pattern(paths: Sequence[Path], wanted: Iterable[str]) -> NamePattern:
    """Return a pattern for the ``wanted`` labels in names and folders; none for equal labels.

    Raises WrongUse for files at different depths of a tree, and for names of two forms.
    """
    names = _relative_names(paths)
    parts = _parts(names, paths)
    assumed = _assign(parts, wanted)
    found = {part.role: part.values for part in parts if part.role}
    if not found:
        return NamePattern()
    units = {
        part.role: unit
        for part in parts
        if part.role in _WITH_UNITS and (unit := part.unit(part.role))
    }
    by_path = any(SLASH in name for name in names)
    return NamePattern(_write(parts, by_path), found, units, tuple(assumed))


def _relative_names(paths: Sequence[Path]) -> list[str]:
    """Return each path below the common folder, without its suffix."""
    folder = common_folder(paths)
    names = [path.absolute().relative_to(folder).with_suffix("").as_posix() for path in paths]
    depths = {name.count(SLASH): path for name, path in zip(names, paths, strict=True)}
    if len(depths) > 1:
        first, second, *_ = depths.values()
        raise WrongUse(
            f"{first} and {second} are not at the same depth of folders: guess a map for each"
        )
    return [normalize("NFC", name) for name in names]


def _parts(names: Sequence[str], paths: Sequence[Path]) -> list[NamePart]:
    """Return the parts that all names have. Raises WrongUse for names of two forms."""
    for sign in (_UNSIGNED, _SIGNED):
        expression = re.compile(_TOKEN.format(sign=sign))
        split = [list(expression.finditer(name)) for name in names]
        if len({_form_of(tokens) for tokens in split}) == 1:
            return [part for column in zip(*split, strict=True) for part in _split_token(column)]
    forms = {_form_of(tokens): path for tokens, path in zip(split, paths, strict=True)}
    first, second, *_ = forms.values()
    raise WrongUse(
        f"{first.name} and {second.name} are names of two forms: guess a map for each, or write "
        "[files] pattern yourself"
    )


def _form_of(tokens: Sequence[re.Match[str]]) -> tuple[str, ...]:
    """Return what must be equal in the names of one form: kinds of parts, marks and suffixes."""
    return tuple(
        token["mark"] or ("words" if token["words"] else token["suffix"]) for token in tokens
    )


def _split_token(column: Sequence[re.Match[str]]) -> list[NamePart]:
    """Return the parts of one token of all names: letters that differ before a number are words."""
    first = column[0]
    whole = tuple(token[0] for token in column)
    if first["number"] is None:
        return [NamePart("words" if first["words"] else "mark", whole)]
    prefixes = tuple(token["prefix"] for token in column)
    numbers = tuple(token["number"] for token in column)
    if len(set(prefixes)) == 1:
        return [NamePart("number", numbers, prefixes[0], first["suffix"])]
    if min(map(len, prefixes)) < _WORD_LETTERS:
        return [NamePart("words", whole)]
    return [NamePart("words", prefixes), NamePart("number", numbers, "", first["suffix"])]


def _assign(parts: Sequence[NamePart], wanted: Iterable[str]) -> list[str]:
    """Give the wanted roles to parts by units and words, then by order; return the latter."""
    left = list(wanted)
    numbers = [part for part in parts if part.kind == "number"]
    for part in numbers:
        if role := next((r for r in _WITH_UNITS if r in left and part.unit(r)), ""):
            _take(part, role, left)
    for index, part in enumerate(parts):
        if part in numbers and not part.role and (role := _word_role(parts, index, left)):
            _take(part, role, left)
    _assign_texture(parts, left)
    plain = [p for p in numbers if not p.role and not p.prefix and _is_short(p.values)]
    assumed = []
    if "repeat" in left and plain and _counts(plain[-1].values):
        assumed.append(_take(plain.pop(), "repeat", left))
    by_order = [role for role in _WITH_UNITS if role in left]
    return assumed + [_take(p, role, left) for p, role in zip(plain, by_order, strict=False)]


def _assign_texture(parts: Sequence[NamePart], left: list[str]) -> None:
    """Take the first words that differ, else numbers after a letter.

    Words that are the same in all names are a texture only if these also have speed or force.
    """
    if "texture" not in left:
        return
    words = [part for part in parts if part.kind == "words"]
    coded = [p for p in parts if p.kind == "number" and p.prefix and p.varies and not p.role]
    labelled = any(part.role in _WITH_UNITS for part in parts)
    same = [
        part
        for part in words
        if labelled and not first_role(part.values[0], (*_WITH_UNITS, "mount", "repeat"))
    ]
    for part in [*(w for w in words if w.varies), *coded, *same][:1]:
        if part.kind == "number":
            part.values = tuple(f"{part.prefix}{value}{part.suffix}" for value in part.values)
            part.kind = "words"
        _take(part, "texture", left)


def _take(part: NamePart, role: str, left: list[str]) -> str:
    part.role = role
    left.remove(role)
    return role


def _word_role(parts: Sequence[NamePart], index: int, left: Sequence[str]) -> str:
    """Return the role that the letters of a number, or the words before it, say."""
    part, before = parts[index], ""
    if index >= 2 and parts[index - 1].kind == "mark" and parts[index - 2].kind == "words":
        before = "" if parts[index - 2].varies else parts[index - 2].values[0]
    if (
        part.prefix.lower() == "t"
        and "texture" in left
        and not any(part.kind == "words" and part.varies for part in parts)
    ):
        return ""
    numeric = [role for role in (*_WITH_UNITS, "mount", "repeat") if role in left]
    return first_role(part.prefix or re.split(r"[\W_]", before)[-1], numeric)


def _is_short(values: Sequence[str]) -> bool:
    return all(len(value) < _DATE_DIGITS for value in values)


def _counts(values: Sequence[str]) -> bool:
    """Return whether the values are whole numbers from about 1, few of them missing."""
    if not all(value.isdecimal() for value in values):
        return False
    numbers = {int(value) for value in values}
    return min(numbers) <= _FIRST_REPEAT and max(numbers) - min(numbers) < 2 * len(numbers)


def _write(parts: Sequence[NamePart], by_path: bool) -> str:
    anything = "[^/]+?" if by_path else ".+?"  # a slash anywhere makes it a pattern of paths
    body = "".join(_expression(part, anything) for part in parts)
    return f"/{body}[.][^./]+$" if by_path else f"^{body}[.][^.]+$"


def _expression(part: NamePart, anything: str) -> str:
    if part.kind == "number":
        number = _number_expression(part.values)
        group = f"(?P<{part.role}>{number})" if part.role else number
        return f"{_literal(part.prefix)}{group}{_literal(part.suffix)}"
    if part.role:
        return f"(?P<{part.role}>{anything})"
    return _literal(part.values[0]) if not part.varies else anything


def _number_expression(values: Sequence[str]) -> str:
    sign = "-?" if any(value.startswith("-") for value in values) else ""
    decimals = "(?:[.,]\\d+)?" if any(re.search("[.,]", value) for value in values) else ""
    return rf"{sign}\d+{decimals}"


def _literal(text: str) -> str:
    """Return the text as an expression that people read; marks that act stand in []."""
    return re.sub(r"[^\w\s/\-=,#@%&~<>:;!'\"]", lambda mark: _quote_mark(mark[0]), text)


def _quote_mark(mark: str) -> str:
    return rf"\{mark}" if mark in "[]^\\" else f"[{mark}]"


ASSUMED_RATE_HZ = 1000.0
_NEEDS = {"rpm": ("radius_mm", "from the axis to the sensor"), "kPa": ("area_mm2", "that presses")}
_DEFAULT_UNITS = {"speed": "mm/s", "force": "level"}


@dataclass(frozen=True, slots=True)
class MapParts:
    """All that a map is written from; ``textures``: every label of a texture that was seen."""

    name: str
    n_files: int
    example: str
    sample: RecordingSample
    roles: ColumnRoles
    pattern: NamePattern
    textures: Sequence[str]


def write_map(parts: MapParts) -> str:
    """Return the TOML text of a map."""
    files = "1 file" if parts.n_files == 1 else f"{parts.n_files} files"
    head = [
        f"# Guessed by rigctl import --guess from {files}: read it, correct it, then",
        "# rigctl import --map THIS_FILE FILES… --out DIR",
        f"name = {_quote(parts.name)}",
    ]
    sections = (_files, _trials, _time, _taxels, _sensor, _labels, _textures, _loadcell, _extra)
    blocks = ["\n".join(head), *(section(parts) for section in sections)]
    return "\n\n".join(block for block in blocks if block) + "\n"


def short_textures(texts: Iterable[str]) -> dict[str, str]:
    """Return a name for each label that is too long or unsafe as the name of a texture."""
    texts = list(dict.fromkeys(texts))
    used = {text for text in texts if not name_problem(text, TEXTURE_BYTES)}
    tries: Counter[str] = Counter()
    renamed: dict[str, str] = {}
    for text in texts:
        if name_problem(text, TEXTURE_BYTES):
            renamed[text] = _new_name(text, used, tries)
            used.add(renamed[text])
    return renamed


def _new_name(text: str, used: Container[str], tries: Counter[str]) -> str:
    """Return the letters and digits of a text, with a number behind them if these are used.

    ``tries``: how many numbers were tried behind the same letters; counted on.
    """
    letters = "".join(letter for letter in text if letter.isalnum()) or "texture"
    name = _cut(letters, TEXTURE_BYTES - 3)
    base = name
    while name in used or name_problem(name, TEXTURE_BYTES):
        tries[base] += 1
        number = f" {tries[base] + 1}"
        name = _cut(base, TEXTURE_BYTES - len(number)) + number
    return name


def _cut(text: str, n_bytes: int) -> str:
    return text.encode()[:n_bytes].decode("utf-8", "ignore")


def _files(parts: MapParts) -> str:
    lines = []
    if parts.pattern.pattern:
        values = ", ".join(f"{k} {v[0]}" for k, v in sorted(parts.pattern.labels.items()))
        lines.append(f"# {_comment(f'{parts.example}: {values}')}")
        if parts.pattern.assumed:
            lines.append(f"# Assumed from the order of numbers: {', '.join(parts.pattern.assumed)}")
        lines.append(f"pattern = {_quote(parts.pattern.pattern)}")
    lines += _form(parts.sample)
    if parts.sample.transpose:
        lines.append("transpose = true  # fewer rows than columns: samples stand along columns")
    return _section("files", lines)


def _form(sample: RecordingSample) -> list[str]:
    """Return the lines of a text table's format that are not those of its kind of file."""
    form, lines = sample.form, []
    if form is None:
        return []
    if form.delimiter != DELIMITERS[sample.path.suffix.lower()]:
        lines.append(f"delimiter = {_quote(form.delimiter)}")
    if form.decimal != ".":
        lines.append(f"decimal = {_quote(form.decimal)}")
    if form.header is not None:
        lines.append("header = true  # the first row counts the columns; false: it has values")
    if form.skip_lines:
        lines.append(f"skip_lines = {form.skip_lines}  # they have other numbers of cells")
    return lines


def _trials(parts: MapParts) -> str:
    if parts.sample.elements:
        elements = f"elements = {_quote(parts.sample.elements)}  # each element is a trial"
        return _section("trials", [elements])
    if parts.roles.trial is None:
        return ""
    return _section("trials", [f"column = {_quote(reference(parts.sample, parts.roles.trial))}"])


def _time(parts: MapParts) -> str:
    roles = parts.roles
    if roles.no_rate:
        return _section("time", [f"rate_hz = 0  # {_comment(roles.no_rate)}; fill in"])
    if roles.time is None:
        rate_hz = roles.rate_hz or ASSUMED_RATE_HZ
        found = roles.rate_why if roles.rate_hz else "assumed: no column ascends like a time"
        return _section("time", [f"rate_hz = {rate_hz:.12g}  # {found}"])
    unit = f"unit = {_quote(roles.time_unit)}"
    if not roles.unit_named:
        unit += f"  # assumed: {roles.why[roles.time].partition(': ')[2]} are plausible"
    return _section("time", [f"column = {_quote(reference(parts.sample, roles.time))}", unit])


def _taxels(parts: MapParts) -> str:
    columns = references(parts.sample, parts.roles.taxels)
    if not columns:
        return _section("taxels", ["# No column was found: name them", "columns = []"])
    listed = ", ".join(map(_quote, columns))
    count = f"# {len(parts.roles.taxels)} taxels"
    return _section("taxels", [count, f"columns = [{listed}]", 'unit = ""  # of their readings'])


def _sensor(parts: MapParts) -> str:
    layers = parts.roles.layers
    if not layers or any(name_problem(name, TEXTURE_BYTES) for name in layers):
        return ""
    per_layer = len(parts.roles.taxels) // len(layers)
    side = isqrt(per_layer)
    rows = side if side * side == per_layer else 1
    return _section(
        "sensor",
        [
            "# Layers from the names of the columns, in their order; rows and columns are assumed",
            f"rows = {rows}",
            f"columns = {per_layer // rows}",
            f"layers = [{', '.join(map(_quote, layers))}]",
        ],
    )


def _labels(parts: MapParts) -> str:
    lines = [f"{label}_column = {_quote(name)}" for label, name in _label_names(parts).items()]
    known = {*_label_names(parts), *parts.pattern.labels}
    if "texture" not in known:
        lines.append('texture = ""  # not found: name it here, or in the pattern, or in a column')
    if "speed" not in known:
        lines.append("speed_mm_s = 0  # not found: give it here, in the pattern or in a column")
    if "force" not in known:
        lines.append("# No force was found: 0 g, unknown")
    for role in ("speed", "force"):
        if role in known:
            lines += _unit_lines(role, _unit_of(role, parts), f"{role}_unit")
    return _section("labels", lines)


def _label_names(parts: MapParts) -> dict[str, str]:
    """Return column or field of each label that one gives."""
    columns = {k: reference(parts.sample, column) for k, column in parts.roles.labels.items()}
    found = {**columns, **parts.roles.fields}
    return {label: found[label] for label in LABELS if label in found}


def _unit_of(role: str, parts: MapParts) -> str:
    if role in parts.pattern.units:
        return parts.pattern.units[role]
    name = _label_names(parts).get(role, "")
    says_depth = role == "force" and bool({"depth", "indentation"} & {*words_of(name)})
    return find_unit(role, name) or (DEPTH if says_depth else "")


def _unit_lines(role: str, unit: str, key: str) -> list[str]:
    """Return the line of a unit, and of the length or area that it needs."""
    if not unit:
        default = _DEFAULT_UNITS[role]
        reason = "assumed" if role == "speed" else 'no unit was found: "g", "N", … if you know it'
        return [f"{key} = {_quote(default)}  # {reason}"]
    lines = [f"{key} = {_quote(unit)}"]
    if unit in _NEEDS:
        needed, what = _NEEDS[unit]
        lines.append(f"{needed} = 0  # {what}: fill in")
    return lines


def _textures(parts: MapParts) -> str:
    renamed = short_textures(parts.textures)
    lines = [f"{_key(text)} = {_quote(name)}" for text, name in renamed.items()]
    return _section("textures", ["# At most 16 bytes", *lines] if lines else [])


def _loadcell(parts: MapParts) -> str:
    column = parts.roles.loadcell
    if column is None:
        return ""
    name = reference(parts.sample, column)
    unit = find_unit("force", parts.sample.names[column])
    known = unit not in ("", DEPTH)
    lines = _unit_lines("force", unit, "unit") if known else ['unit = "g"  # assumed']
    return _section("loadcell", [f"column = {_quote(name)}", *lines])


def _extra(parts: MapParts) -> str:
    columns = references(parts.sample, parts.roles.extra)
    if not columns:
        return ""
    return _section("extra", [f"columns = [{', '.join(map(_quote, columns))}]"])


def _section(name: str, lines: Sequence[str]) -> str:
    return "\n".join([f"[{name}]", *lines]) if lines else ""


def _quote(text: str) -> str:
    """Return a TOML string, a literal one where it has a backslash."""
    literal = "\\" in text and "'" not in text and text.isprintable()
    return f"'{text}'" if literal else _key(text)


def _key(text: str) -> str:
    """Return a TOML string with escapes; JSON writes the same ones, but leaves DEL as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _comment(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


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
