"""Guess what the columns of recordings are: time, taxels, force, labels, and what is left over.

A sample of the files is read, and its names and values are judged; what remains unclear becomes a
question in the map.
"""

from __future__ import annotations

import csv
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.config.text_file import shorten
from rigctl.errors import WrongUse
from rigctl.exchange.column_map import MAX_RATE_HZ
from rigctl.exchange.file_readers import (
    DELIMITERS,
    label_text,
    no_numbers,
    read_variables,
    split_columns,
    split_elements,
)
from rigctl.exchange.labels import LABELS, SECONDS
from rigctl.exchange.recording_files import SUFFIXES
from rigctl.exchange.recording_tables import RANGE, Floats, bounded, format_names, refuse_too_many
from rigctl.exchange.resampling import burst_rate
from rigctl.exchange.text_table import (
    CLOCK,
    HEAD_ROWS,
    TextFormat,
    column_names,
    count_header_rows,
    first_rows,
    is_grouped,
    is_number,
    read_first_lines,
    read_text_table,
)

WORDS = {
    "time": {
        *("t", "time", "timestamp", "zeit", "uhrzeit", "clock", "millis", "micros", "ms", "us"),
        *("sec", "seconds", "datetime", "datenum", "elapsed"),
    },
    "trial": {
        *("trial", "run", "recording", "take", "sweep", "trialno", "trialid", "versuch", "messung"),
    },
    "texture": {
        *("texture", "tex", "material", "mat", "fabric", "surface", "cloth", "textile", "stimulus"),
        *("class", "label", "stoff"),
    },
    "speed": {"speed", "velocity", "vel", "v", "feed", "feedrate"},
    "force": {"force", "load", "weight", "pressure", "depth", "indentation", "level", "f", "fz"},
    "repeat": {"repeat", "rep", "repetition", "r", "no", "nr", "n"},
    "mount": {"mount", "mounting"},
    "loadcell": {"loadcell", "cell", "fn", "fz", "force", "load", "normal", "weight", "pressure"},
    "rate": {"fs", "rate", "hz", "samplerate", "frequency"},
    "index": {"index", "idx", "sample", "samples", "row", "frame", "counter", "seq", "id", "no"},
    "extra": {
        *("temp", "temperature", "humidity", "proximity", "prox", "acc", "gyro", "imu", "mag"),
        *("x", "y", "z", "pos", "position", "angle", "encoder", "current", "ft", "torque"),
    },
}
"""Words of each role, in lower case."""
FILE_WORDS = {
    **WORDS,
    "repeat": WORDS["repeat"] | WORDS["trial"] | {"i", "k"},
    "force": WORDS["force"] | {"w", "p"},
    "mount": WORDS["mount"] | {"m"},
}
"""Words beside a number in the name of a file."""
_SPEED_UNITS = {
    "mm/min": r"mm[ _]?(?:/|p|per|[ _])[ _]?min|mmmin|mmpm",
    "m/min": r"m[ _]?(?:/|p|per|[ _])[ _]?min|mpm",
    "inch/min": r"(?:inch|in)[ _]?(?:/|p|per|[ _])[ _]?min|ipm",
    "mm/s": r"mm[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|mms|mmps",
    "cm/s": r"cm[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|cms|cmps",
    "inch/s": r"(?:inch|in)[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|ips",
    "m/s": r"m[ _]?(?:/|p|per|[ _])[ _]?s(?:ec)?|mps",
    "rpm": "rpm",
}
_FORCE_UNITS = {
    "kPa": "kpa",
    "mN": "mn|millinewton",
    "N": "n|newtons?",
    "kg": "kg|kgf",
    "g": "g|gf|grams?",
}
_TIME_UNITS = {
    "ms": "ms|msec|millis",
    "us": "us|[\u00b5\u03bc]s|usec|micros",
    "ns": "ns",
    "s": "s|sec|seconds",
    "d": "days?|datenum",
}
UNITS = {"speed": _SPEED_UNITS, "force": {**_FORCE_UNITS, "mm": "mm"}, "time": _TIME_UNITS}
"""Expressions of the units of each role."""
ANY_UNIT = "|".join([*_SPEED_UNITS.values(), *_FORCE_UNITS.values(), "mm"])


def words_of(name: str) -> list[str]:
    """Return the words of a name in lower case: ``normalForce_N`` has normal, force and n."""
    parts = re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+(?![^\W\d_A-Z])|[A-Z]", name)
    return [part.lower() for part in parts]


def has_word(role: str, name: str) -> bool:
    """Return whether one of a name's words says that role, or all of them joined."""
    words = words_of(name)
    return any(word in WORDS[role] for word in (*words, "".join(words)))


def role_of_unit(name: str) -> str:
    """Return speed or force if the unit behind a name's words is one of theirs, else nothing.

    A length is neither: it may be a depth, a position or a distance.
    """
    if len(words_of(name)) < 2:
        return ""
    roles = (role for role in ("speed", "force") if find_unit(role, name) not in ("", "mm"))
    return next(roles, "")


def find_unit(role: str, text: str) -> str:
    """Return the unit at the end of a name or after a number, empty if there is none."""
    text = text.strip().strip("()[]{}_ ").lower()
    for unit, expression in UNITS[role].items():
        if re.search(rf"(?:^|[\W_])(?:{expression})$", text):
            return unit
    return ""


def first_role(word: str, roles: Iterable[str]) -> str:
    """Return the first of the roles that a word beside a number says, empty if none does."""
    return next((role for role in roles if word.lower() in FILE_WORDS[role]), "")


FIRST_LINES = 100
_LETTERS = (",", ";", "\t", "|", " ")
_DECIMAL_COMMA = re.compile(r"-?\d+,\d+$")
_ELEMENT = re.compile(r"^(?P<array>.+?)\.(?P<number>\d+)(?:\.(?P<field>.*))?$")
MOST_TRANSPOSED = 64
MOST_LAYOUTS = 4
MOST_COMMENTS = 0.2
"""Share of the first lines that may be comments amid the table."""


@dataclass(frozen=True, slots=True)
class RecordingSample:
    """The first file of unknown recordings: ``values`` float64 (n, m), NaN for texts.

    ``texts``: the different texts of each text column by its index, whose values are their places.
    ``fields``: texts and scalars of every element by name. ``named``: whether columns have names
    of their own. ``form``: that of a text table. ``elements``: the array whose elements are
    trials; values are those of the first. ``clocks``: the columns with times of day, in seconds.
    """

    path: Path
    names: tuple[str, ...]
    values: Floats
    named: bool
    texts: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    fields: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    form: TextFormat | None = None
    elements: str = ""
    transpose: bool = False
    clocks: frozenset[int] = frozenset()

    def cell(self, row: int, column: int) -> str:
        """Return one cell as text."""
        value = self.values[row, column]
        if not np.isfinite(value):
            return ""
        return self.texts[column][int(value)] if column in self.texts else f"{value:.10g}"

    def different(self, column: int) -> tuple[str, ...]:
        """Return the different texts of a column's cells, in the order of the rows."""
        if column in self.texts:
            return self.texts[column]
        values = self.values[:, column]
        _, rows = np.unique(values, return_index=True)
        return tuple(filter(None, (self.cell(row, column) for row in sorted(rows))))


def read_sample(paths: Sequence[Path]) -> RecordingSample:
    """Return the first file's columns. Raises WrongUse where another has a different layout."""
    first = paths[0]
    other = next((path for path in paths if path.suffix.lower() != first.suffix.lower()), None)
    if other is not None:
        raise WrongUse(
            f"{first.name} and {other.name} are of two kinds: guess a map for each kind of file"
        )
    if first.suffix.lower() in DELIMITERS:
        return _read_text(paths)
    if first.suffix.lower() not in SUFFIXES:
        raise WrongUse(f"{first}: files that can be imported end in {', '.join(SUFFIXES)}")
    return _read_arrays(paths)


def _read_text(paths: Sequence[Path]) -> RecordingSample:
    form = _find_format(paths[0])
    head = _head(paths[0], form)
    _refuse_layouts(paths, form)
    rows = [row for _, row in first_rows(paths[0], form, FIRST_LINES)]
    n_header = count_header_rows(rows[:HEAD_ROWS], form)
    rows = [row for row in rows[n_header:] if len(row) >= head[1]]
    columns = [[row[k] for row in rows] for k in range(head[1])]
    clocks = [str(k + 1) for k, cells in enumerate(columns) if _are_clocks(cells)]
    labels = [str(k + 1) for k, cells in enumerate(columns) if _are_labels(cells, form.decimal)]
    labels = [label for label in labels if label not in clocks]
    _refuse_grouped(paths[0], columns, form)
    table = read_text_table(paths[0], form, (), labels, clocks)
    if n_header and not head[0]:
        form = form._replace(header=True)
    return RecordingSample(
        paths[0],
        table.names,
        bounded(table.values),
        bool(head[0]),
        table.texts,
        form=form,
        clocks=table.clocks,
    )


def _refuse_grouped(path: Path, columns: Sequence[Sequence[str]], form: TextFormat) -> None:
    """Raise WrongUse for a column whose cells are all numbers, some with groups of thousands."""
    for cells in columns:
        grouped = [cell for cell in cells if is_grouped(cell, form.decimal)]
        if grouped and all(is_number(c.replace(form.decimal, ".")) for c in {*cells} - {*grouped}):
            raise WrongUse(
                f"{path}: {grouped[0]!r} has separators of thousands beside decimals with "
                f"{form.decimal!r}: save the table without them"
            )


def _refuse_layouts(paths: Sequence[Path], form: TextFormat) -> None:
    """Raise WrongUse for files of several layouts; it says which files have which."""
    layouts: dict[tuple[tuple[str, ...], int], list[Path]] = defaultdict(list)
    for path in paths:
        layouts[_head(path, form)].append(path)
    if len(layouts) == 1:
        return
    told = [
        f"{len(files)} with {_describe(head)}, such as {files[0].name}"
        for head, files in layouts.items()
    ]
    raise WrongUse(
        f"the files have {len(layouts)} layouts: {'; '.join(told[:MOST_LAYOUTS])}. Guess a map for "
        "the files of each: rigctl import --guess FILES --map NAME.toml"
    )


def _are_clocks(cells: Sequence[str]) -> bool:
    """Return whether a column has times of day."""
    return bool(cells) and all(CLOCK.fullmatch(cell) for cell in cells)


def _find_format(path: Path) -> TextFormat:
    """Return the letter between cells, that of decimals, and the lines before the header.

    The letter divides the last of the first lines into the most cells, all into the same number;
    lines before them are skipped.
    """
    lines = read_first_lines(path, FIRST_LINES)
    best = TextFormat(DELIMITERS[path.suffix.lower()])
    most = (False, 1)
    for letter in _LETTERS:
        widths = [len(_cells(line, letter)) for _, line in lines]
        width = Counter(widths).most_common(1)[0][0] if widths else 0
        start = _first_of_table(widths, width)
        if start > 0 and _are_names(lines[start - 1][1], lines[start][1], letter):
            start -= 1
        # A decimal comma divides every row, but not the names above them.
        if width > 1 and 0 <= start <= len(lines) / 2 and (start == 0, width) > most:
            skipped = lines[start - 1][0] if start else 0
            best, most = TextFormat(letter, skip_lines=skipped), (start == 0, width)
    cells = [cell.strip() for _, line in lines for cell in _cells(line, best.delimiter)]
    has_commas = any(_DECIMAL_COMMA.match(cell) for cell in cells)
    return best._replace(decimal=",") if has_commas else best


def _first_of_table(widths: Sequence[int], width: int) -> int:
    """Return the first of the lines that all have that many cells, the last line left out; or -1.

    Single lines of another number of cells, which a comment has, may stand between them.
    """
    lines = range(len(widths))
    right = [k for k in lines if widths[k] == width]
    start = next((k for k in right if k + 1 in right or k + 1 == len(widths)), -1)
    wrong = sum(widths[k] != width for k in lines[start:-1])
    return start if wrong <= MOST_COMMENTS * len(widths) else -1


def _are_names(line: str, below: str, letter: str) -> bool:
    """Return whether a line has the names of the rows below, with one cell more or less."""
    names, cells = _cells(line, letter), _cells(below, letter)
    few, most = sorted((len(names), len(cells)))
    return most == few + 1 > 2 and not any(is_number(name) for name in names if name)


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, the whole line where this letter leaves too long a cell."""
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return [line]


def _head(path: Path, form: TextFormat) -> tuple[tuple[str, ...], int]:
    """Return the names in a table's header, none without one, and its number of columns."""
    rows = [row for _, row in first_rows(path, form, HEAD_ROWS)]
    if not rows:
        raise WrongUse(f"{path} is empty")
    refuse_too_many(path, len(rows[0]))
    n_header = count_header_rows(rows, form)
    names = column_names(rows, n_header)
    are_numbers = names[1:] == tuple(str(k) for k in range(2, len(names) + 1))
    return () if are_numbers or not n_header else names, len(names)


def _describe(head: tuple[tuple[str, ...], int]) -> str:
    names, count = head
    shown = format_names(names[:6]) + (", …" if len(names) > 6 else "")
    return f"the columns {shown} ({count})" if names else f"{count} columns without names"


def _are_labels(cells: Sequence[str], decimal: str) -> bool:
    """Return whether a column has texts that repeat, so that they may be labels."""
    is_text = any(not is_number(cell.replace(decimal, ".")) for cell in cells)
    return is_text and (len(cells) < 4 or len(set(cells)) <= len(cells) / 2)


def _read_arrays(paths: Sequence[Path]) -> RecordingSample:
    variables = read_variables(paths[0])
    if len(paths) > 1:
        _refuse_other_variables(paths, variables)
    elements = _find_elements(paths[0], variables)
    trials = split_elements(paths[0], variables, elements) if elements else {"": dict(variables)}
    full = [trial for trial in trials.values() if any(np.size(value) for value in trial.values())]
    fields: dict[str, list[str]] = defaultdict(list)
    for trial in full:
        for name, value in trial.items():
            if np.size(value) == 1 and np.asarray(value).dtype.kind in "biufUS":
                fields[name].append(label_text(value))
    names, values, transpose = _table(paths[0], full[0] if full else {}, fields)
    texts = {name: tuple(found) for name, found in fields.items()}
    named = not all(name.isdigit() for name in names)
    return RecordingSample(
        paths[0],
        names,
        bounded(values),
        named,
        fields=texts,
        elements=elements,
        transpose=transpose,
    )


def _refuse_other_variables(paths: Sequence[Path], variables: Mapping[str, Any]) -> None:
    """Raise WrongUse where the last file has other names than the first."""
    last = read_variables(paths[-1])
    ours, theirs = (
        {re.sub(r"\.\d+\b", ".n", name) for name in found} for found in (variables, last)
    )
    if ours != theirs:
        other = shorten(min(theirs ^ ours))
        raise WrongUse(
            f"{paths[0].name} and {paths[-1].name} have different variables, such as {other}: "
            "guess a map for each layout"
        )


def _find_elements(path: Path, variables: Mapping[str, Any]) -> str:
    """Return the array of structures or cells whose elements look alike, the largest of these."""
    arrays: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, value in variables.items():
        if match := _ELEMENT.match(name):
            arrays[match["array"]][name] = value
    for array in sorted(arrays, key=lambda array: _size(arrays[array]), reverse=True):
        elements = [e for e in split_elements(path, arrays[array], array).values() if _size(e)]
        if len(elements) > 1 and len({_signature(element) for element in elements}) == 1:
            return array
    return ""


def _size(element: Mapping[str, Any]) -> int:
    return sum(int(np.size(value)) for value in element.values())


def _signature(element: Mapping[str, Any]) -> frozenset[tuple[str, int]]:
    """Return the names of the fields with the smaller size of each: the number of columns."""
    return frozenset(
        (name, min(np.shape(value)) if np.ndim(value) == 2 else 0)
        for name, value in element.items()
    )


def _table(
    path: Path, trial: Mapping[str, Any], fields: Mapping[str, Sequence[str]]
) -> tuple[tuple[str, ...], Floats, bool]:
    """Return names and values of the columns of the most common length, and whether transposed."""
    arrays = {
        name: np.asarray(value)
        for name, value in trial.items()
        if name not in fields
        and np.ndim(value) in (1, 2)
        and np.asarray(value).dtype.kind in "biufVmM"
    }
    transpose = any(
        array.ndim == 2 and 1 < array.shape[0] <= MOST_TRANSPOSED < array.shape[1]
        for array in arrays.values()
    )
    columns = [
        pair
        for name, array in arrays.items()
        for pair in split_columns(str(path), name, array, transpose)
    ]
    if not columns:
        for name, value in trial.items():
            if np.asarray(value).dtype == object:
                raise WrongUse(f"{path}: {name or 'the array'} {no_numbers(np.asarray(value))}")
        raise WrongUse(f"{path}: no variable is a table of numbers, with samples along rows")
    refuse_too_many(path, len(columns))
    length = Counter(len(column) for _, column in columns).most_common(1)[0][0]
    chosen = [(name, column) for name, column in columns if len(column) == length]
    return tuple(name for name, _ in chosen), np.stack([c for _, c in chosen], axis=1), transpose


RATES_HZ = (5.0, 20_000.0)
REGULAR_SHARE, ASCENDING_SHARE = 0.8, 0.9
ROWS_A_LABEL = 20
MOSTLY = 0.5
LAYER_TAXELS = 4
SHORTEST_STEP = 1e-9
FEWEST_STAMPS = 2
CALENDAR_DAYS = ((693_962.0, 767_011.0), (36_526.0, 73_050.0))
"""Days of the years 1900 to 2099 by MATLAB's datenum, of 2000 to 2099 by a spreadsheet."""


@dataclass(slots=True)
class ColumnRoles:
    """The guessed role of each column, by its index.

    ``labels``: column of each label. ``fields``: field of each label. ``taxels`` are columns of
    equal layers in order, ``layers`` their names. ``no_rate``: why a column that is named as a time
    gives none. ``why``: what each column seems to be, in words.
    """

    time: int | None = None
    time_unit: str = "s"
    unit_named: bool = False
    rate_hz: float = 0.0
    rate_why: str = ""
    no_rate: str = ""
    trial: int | None = None
    labels: dict[str, int] = field(default_factory=dict)
    fields: dict[str, str] = field(default_factory=dict)
    loadcell: int | None = None
    taxels: list[int] = field(default_factory=list)
    layers: tuple[str, ...] = ()
    extra: list[int] = field(default_factory=list)
    why: dict[int, str] = field(default_factory=dict)


def guess_roles(sample: RecordingSample) -> ColumnRoles:
    """Return the role of each column, from its name and its values."""
    guess = _RoleGuess(sample)
    guess.find_fields()
    guess.find_time()
    guess.find_labels()
    guess.find_taxels()
    guess.find_others()
    return guess.roles


class _RoleGuess:
    """Takes columns for one role after another; ``_left`` are those without one."""

    def __init__(self, sample: RecordingSample) -> None:
        self.roles = ColumnRoles()
        self._sample = sample
        self._left = list(range(len(sample.names)))

    def find_fields(self) -> None:
        """Take texts and scalars beside the columns for labels and the rate."""
        for name in self._sample.fields:
            role = _role_of(name, LABELS)
            if role and role not in self.roles.fields:
                self.roles.fields[role] = name
            elif has_word("rate", name):
                rate_hz = _number(self._sample.fields[name][0])
                self.roles.rate_hz = rate_hz if 0 < rate_hz <= MAX_RATE_HZ else 0.0
                self.roles.rate_why = "as a field says"
        texts = {name for name, found in self._sample.fields.items() if len(set(found)) > 1}
        if "texture" not in self.roles.fields and len(texts - {*self.roles.fields.values()}) == 1:
            (name,) = texts - {*self.roles.fields.values()}
            if not _number(self._sample.fields[name][0]):
                self.roles.fields["texture"] = name

    def find_time(self) -> None:
        """Take the first column that its name and values, or its values alone, say is time."""
        numbers = [k for k in self._left if k not in self._sample.texts]
        ascending = [k for k in numbers if _is_clock(self._sample.values[:, k])]
        named = [k for k in ascending if has_word("time", self._sample.names[k])]
        unnamed = [k for k in ascending if not has_word("index", self._sample.names[k])]
        for column in (named or unnamed)[:1]:
            self._take_time(column)
        if self.roles.time is None and not self.roles.rate_hz:
            broken = (k for k in numbers if has_word("time", self._sample.names[k]))
            for column in islice(broken, 1):
                n_times = len(np.unique(self._sample.values[:, column]))
                rows = len(self._sample.values)
                name = reference(self._sample, column)
                self.roles.no_rate = f"{name} is no clock: {n_times} times in {rows} rows"
                self._take(column, f"not used: {self.roles.no_rate}")

    def _take_time(self, column: int) -> None:
        """Take a clock for time, or its mean rate where rows come in bursts or share a stamp."""
        values = self._sample.values[:, column]
        unit = find_unit("time", self._sample.names[column])
        if column in self._sample.clocks:
            unit = "s"
        step = _step(values)
        self.roles.time_unit = unit or _plausible_unit(values, step)
        seconds = SECONDS[self.roles.time_unit]
        if rate := burst_rate(values):
            self.roles.rate_hz = float(f"{rate / seconds:.4g}")
            name = reference(self._sample, column)
            self.roles.rate_why = f"the mean of {name}, whose rows come in bursts or share a stamp"
            self._take(column, f"not used: {self.roles.rate_why}")
            return
        self.roles.time, self.roles.unit_named = column, bool(unit)
        rate_hz = 1 / (step * seconds)
        self._take(column, f"time in {self.roles.time_unit}: {rate_hz:.4g} rows a second")

    def find_labels(self) -> None:
        """Take the columns that stay the same over many rows and have a label's name."""
        for column in list(self._left):
            name = self._sample.names[column]
            if not self._is_label(column):
                continue
            role = _role_of(name, ("trial", *LABELS)) or self._unnamed_label(column)
            if role == "trial" and self.roles.trial is None:
                self.roles.trial = column
            elif role in LABELS and role not in {*self.roles.labels, *self.roles.fields}:
                self.roles.labels[role] = column
            else:
                continue
            self._take(column, f"{role}: {self._describe_texts(column)}")

    def find_taxels(self) -> None:
        """Take the largest group of columns whose names differ in a number alone."""
        numbers = [k for k in self._left if k not in self._sample.texts]
        numbers = [k for k in numbers if np.isfinite(self._sample.values[:, k]).any()]
        groups: dict[str, list[int]] = defaultdict(list)
        for column in numbers:
            groups[_stem(self._sample.names[column])].append(column)
        likely = {stem: found for stem, found in groups.items() if not has_word("extra", stem)}
        most = max(map(len, (likely or groups).values()), default=0)
        chosen = [s for s, found in (likely or groups).items() if len(found) == most]
        if most < 2 or not self._sample.named:
            self.roles.taxels = self._unnamed_taxels(numbers)
        elif most < LAYER_TAXELS:
            self.roles.taxels = groups[chosen[0]]
        else:
            self.roles.taxels = [column for stem in chosen for column in groups[stem]]
            self.roles.layers = tuple(chosen) if len(chosen) > 1 else ()
        for column in self.roles.taxels:
            self._take(column, f"taxel: {self._span(column)}")

    def find_others(self) -> None:
        """Take a column for the load cell; other numbers are other channels, texts nothing."""
        loadcell = self._loadcell()
        for column in list(self._left):
            name, values = self._sample.names[column], self._sample.values[:, column]
            if column in self._sample.texts or not np.isfinite(values).any():
                self._take(column, "not used: no numbers")
            elif has_word("index", name) or (not self._sample.named and np.ptp(values) == 0):
                self._take(column, f"not used: {self._span(column)}")
            elif column == loadcell:
                self.roles.loadcell = column
                self._take(column, f"load cell: {self._span(column)}")
            elif np.isfinite(values).mean() < MOSTLY:
                self._take(column, "not used: most rows have no number")
            else:
                self.roles.extra.append(column)
                self._take(column, f"another channel: {self._span(column)}")

    def _loadcell(self) -> int | None:
        """Return the first column of a load cell by its name, one with a unit of force before."""
        names = self._sample.names
        found = [k for k in self._left if self._sample.named and has_word("loadcell", names[k])]
        found = [k for k in found if np.isfinite(self._sample.values[:, k]).any()]
        with_unit = [k for k in found if find_unit("force", names[k])]
        return next(iter([*with_unit, *found]), None)

    def _take(self, column: int, why: str) -> None:
        self._left.remove(column)
        self.roles.why[column] = why

    def _is_label(self, column: int) -> bool:
        values = self._sample.values[:, column]
        known = values[np.isfinite(values)]
        if not len(known):
            return False
        changes = np.count_nonzero(np.diff(known))
        return bool(changes <= len(known) / ROWS_A_LABEL and (known >= -1e6).all())

    def _unnamed_label(self, column: int) -> str:
        """Return the role of a column without a telling name, from its values."""
        values = self._sample.values[:, column]
        if column in self._sample.texts:
            return "texture"
        steps = np.diff(values)
        steps = steps[steps != 0]
        counts_up = len(steps) and bool((steps == 1).all()) and values[0] in (0, 1)
        return "trial" if counts_up and not self._sample.named else ""

    def _unnamed_taxels(self, numbers: Sequence[int]) -> list[int]:
        """Return the numbers that are no load cell or other channel by name; all without names."""
        if self._sample.named:
            known = ("extra", "index", "loadcell")
            return [
                k for k in numbers if not any(has_word(r, self._sample.names[k]) for r in known)
            ]
        moving = [
            k
            for k in numbers
            if np.nanmax(self._sample.values[:, k]) > np.nanmin(self._sample.values[:, k])
        ]
        moving = [k for k in moving if not has_word("index", self._sample.names[k])]
        return [k for k in numbers if moving and moving[0] <= k <= moving[-1]]

    def _span(self, column: int) -> str:
        values = self._sample.values[:, column]
        low, high = f"{np.nanmin(values):.6g}", f"{np.nanmax(values):.6g}"
        return low if low == high else f"{low} … {high}"

    def _describe_texts(self, column: int) -> str:
        texts = self._sample.texts.get(column)
        if texts is None:
            values = self._sample.values[:, column]
            texts = tuple(f"{v:.6g}" for v in np.unique(values[np.isfinite(values)]))
        return describe_values(texts)


def describe_values(texts: Sequence[str]) -> str:
    """Return how many different values there are, and the first of them."""
    shown = ", ".join(texts[:4]) + (", …" if len(texts) > 4 else "")
    return f"{len(texts)} values: {shown}" if len(texts) > 1 else f"always {shown}"


def _role_of(name: str, roles: Sequence[str]) -> str:
    """Return what a name's unit says, else its words: the N of ``Kraft (N)`` is a unit."""
    return role_of_unit(name) or next((role for role in roles if has_word(role, name)), "")


def references(sample: RecordingSample, columns: Sequence[int]) -> list[str]:
    """Return the names of columns for a map, neighbours as ranges; numbers where names fail."""
    runs: list[list[int]] = []
    for column in columns:
        if runs and column == runs[-1][-1] + 1:
            runs[-1].append(column)
        else:
            runs.append([column])
    counts = Counter(sample.names)
    names = [
        (_reference(sample.names, run[0], counts), _reference(sample.names, run[-1], counts))
        for run in runs
    ]
    return [first if first == last else f"{first}{RANGE}{last}" for first, last in names]


def reference(sample: RecordingSample, column: int) -> str:
    """Return a column's name for a map; its number where the name is empty, double or a range."""
    return _reference(sample.names, column, Counter(sample.names))


def _reference(names: Sequence[str], column: int, counts: Mapping[str, int]) -> str:
    name = names[column]
    clear = name and counts[name] == 1 and RANGE not in name
    return name if clear else str(column + 1)


def _stem(name: str) -> str:
    """Return a name up to its last letter, in a time that its length bounds."""
    letters = re.match(r"(?s:.*)[^\W\d_]", name)
    return letters[0] if letters else ""


def _is_clock(values: Floats) -> bool:
    """Return whether values ascend by regular steps, trials that begin anew left out.

    Rows may share a value, as those of a coarse clock do, or of a bus that sends many at once.
    Steps below 10⁻⁹ are no time in any unit.
    """
    steps = np.diff(values)
    if len(steps) < 2 or not np.isfinite(values).all():
        return False
    ahead = steps[steps > 0]
    repeated = np.count_nonzero(steps == 0)
    if len(ahead) < FEWEST_STAMPS or len(ahead) + repeated < ASCENDING_SHARE * len(steps):
        return False
    step = float(np.median(ahead))
    if step < SHORTEST_STEP:
        return False
    return bool(np.mean((ahead > 0.4 * step) & (ahead < 2.1 * step)) >= REGULAR_SHARE)


def _step(values: Floats) -> float:
    steps = np.diff(values)
    return float(np.median(steps[steps > 0]))


def _plausible_unit(values: Floats, step: float) -> str:
    """Return the unit in which rows come at 5 Hz to 20 kHz; days only for those of a calendar."""
    low, high = RATES_HZ
    first = float(values[0])
    units = dict(SECONDS)
    if not any(since <= first <= until for since, until in CALENDAR_DAYS):
        del units["d"]
    return next((u for u, s in units.items() if low <= 1 / (step * s) <= high), "s")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
