"""The text of a guessed map, with a comment on what each key was guessed from."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from math import isqrt

from rigctl.config.names import name_problem
from rigctl.exchange.file_readers import DELIMITERS
from rigctl.exchange.guess.file_names import NamePattern
from rigctl.exchange.guess.roles import ColumnRoles, reference, references
from rigctl.exchange.guess.sample import RecordingSample
from rigctl.exchange.guess.words import find_unit, words_of
from rigctl.exchange.labels import LABELS
from rigctl.exchange.units import DEPTH
from rigctl.protocol.fields import TEXTURE_BYTES

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
    if roles.time is None:
        rate_hz = roles.rate_hz or ASSUMED_RATE_HZ
        found = "as a field says" if roles.rate_hz else "assumed: no column ascends like a time"
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
