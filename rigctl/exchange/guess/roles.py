"""What each column of unknown recordings seems to be: time, trial, label, taxel or another."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rigctl.exchange.column_map import MAX_RATE_HZ
from rigctl.exchange.column_names import RANGE
from rigctl.exchange.guess.sample import RecordingSample
from rigctl.exchange.guess.words import find_unit, has_word, role_of_unit
from rigctl.exchange.labels import LABELS
from rigctl.exchange.trial_tables import Floats
from rigctl.exchange.units import SECONDS

RATES_HZ = (5.0, 20_000.0)
REGULAR_SHARE, ASCENDING_SHARE = 0.8, 0.9
ROWS_A_LABEL = 20
LAYER_TAXELS = 4
SHORTEST_STEP = 1e-9


@dataclass(slots=True)
class ColumnRoles:
    """The guessed role of each column, by its index.

    ``labels``: column of each label. ``fields``: field of each label. ``taxels`` are columns of
    equal layers in order, ``layers`` their names. ``why``: what each column seems to be, in words.
    """

    time: int | None = None
    time_unit: str = "s"
    unit_named: bool = False
    rate_hz: float = 0.0
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
            step = _step(self._sample.values[:, column])
            unit = find_unit("time", self._sample.names[column])
            self.roles.time, self.roles.unit_named = column, bool(unit)
            self.roles.time_unit = unit or _plausible_unit(step)
            rate_hz = 1 / (step * SECONDS[self.roles.time_unit])
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
        for column in list(self._left):
            name, values = self._sample.names[column], self._sample.values[:, column]
            if column in self._sample.texts or not np.isfinite(values).any():
                self._take(column, "not used: no numbers")
            elif has_word("index", name) or (not self._sample.named and np.ptp(values) == 0):
                self._take(column, f"not used: {self._span(column)}")
            elif self._sample.named and self.roles.loadcell is None and has_word("loadcell", name):
                self.roles.loadcell = column
                self._take(column, f"load cell: {self._span(column)}")
            else:
                self.roles.extra.append(column)
                self._take(column, f"another channel: {self._span(column)}")

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

    Steps below 10⁻⁹ are no time in any unit.
    """
    steps = np.diff(values)
    if len(steps) < 2 or not np.isfinite(values).all():
        return False
    ahead = steps[steps > 0]
    if len(ahead) < ASCENDING_SHARE * len(steps):
        return False
    step = float(np.median(ahead))
    if step < SHORTEST_STEP:
        return False
    return bool(np.mean((ahead > 0.4 * step) & (ahead < 2.1 * step)) >= REGULAR_SHARE)


def _step(values: Floats) -> float:
    steps = np.diff(values)
    return float(np.median(steps[steps > 0]))


def _plausible_unit(step: float) -> str:
    """Return the unit in which rows come at 5 Hz to 20 kHz."""
    low, high = RATES_HZ
    return next((u for u, s in SECONDS.items() if low <= 1 / (step * s) <= high), "s")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
