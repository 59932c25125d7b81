"""What a form shows of a protocol's text: its keys, their values, and what is wrong with each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_reader import KeyPath, TomlField, TomlTable, TomlText
from rigctl.errors import ProtocolError
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT, protocol_key
from rigctl.protocol.fields import KIND, OF_PLACE, PLACE, FieldGroup, field_groups, step_fields

NAME = "protocol.toml"
"""What messages call a text that has no file."""


@dataclass(frozen=True, slots=True)
class FormContent:
    """The values as they are written and the mistakes, by the path of their key.

    ``problem`` says why a form cannot show the text, and ``line`` where; else it is empty.
    ``steps`` counts the free steps.
    """

    is_finger: bool = False
    values: dict[KeyPath, Any] = field(default_factory=dict)
    mistakes: dict[KeyPath, str] = field(default_factory=dict)
    steps: int = 0
    problem: str = ""
    line: int = 0


def groups_of(config: RigConfig, *, is_finger: bool) -> tuple[FieldGroup, ...]:
    """Return the keys of a protocol of the drum or of the moving finger."""
    if not is_finger:
        return field_groups(config)
    groups: tuple[FieldGroup, ...] = EXPERIMENTS[FINGER_EXPERIMENT].load("field_groups")()
    return groups


def read_content(source: str, config: RigConfig, name: str = NAME) -> FormContent:
    """Return what a form shows of a text; ``name``: its file, for messages."""
    try:
        root = TomlText(name, source, ProtocolError).root
        is_finger = protocol_key(root)[0] is EXPERIMENTS[FINGER_EXPERIMENT]
        content = FormContent(is_finger)
        for group in groups_of(config, is_finger=is_finger):
            table = root.table(group.table) if group.table else root
            prefix = (group.table,) if group.table else ()
            _read_fields(content, table, prefix, group.fields)
        steps = [] if is_finger else root.tables("steps")
    except ProtocolError as error:
        return FormContent(problem=str(error), line=error.line)
    for place, step in enumerate(steps):
        _read_step(content, step, ("steps", place), config)
    return FormContent(is_finger, content.values, content.mistakes, len(steps))


def step_rows(place: Any, kind: Any, config: RigConfig) -> Iterator[TomlField]:
    """Yield the keys of a free step besides its place and its kind."""
    if isinstance(place, str) and place in OF_PLACE:
        yield OF_PLACE[place]
    if isinstance(kind, str):
        yield from step_fields(config).get(kind, ())


def _read_step(content: FormContent, step: TomlTable, path: KeyPath, config: RigConfig) -> None:
    at, kind = step.as_written("at"), step.as_written("kind")
    fields = (PLACE, KIND, *step_rows(at, kind, config))
    _read_fields(content, step, path, fields)


def _read_fields(
    content: FormContent, table: TomlTable, prefix: KeyPath, fields: tuple[TomlField, ...]
) -> None:
    for item in fields:
        path = (*prefix, item.key)
        content.values[path] = table.as_written(item.key)
        try:
            if item.key in table or item.default is None:
                item.read(table)
        except ProtocolError as error:
            content.mistakes[path] = error.reason
