"""The tables of the drum's keys in docs/reference/protocols.md.

``python -m tests.protocol.reference`` prints them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_reader import TomlField
from rigctl.finger.plan import ORDER_GROUP, SCANS_GROUP
from rigctl.protocol.fields import STEP_KINDS, field_groups, step_fields

HEADER = "| key | default | unit | range | meaning |\n|---|---|---|---|---|"


def tables() -> Iterator[str]:
    """Yield the table of each group, name and trials together, and that of the steps."""
    name, trials, *others = field_groups(RigConfig())
    yield _table("", (*name.fields, *trials.fields))
    for group in others:
        yield _table(f"{group.table}.", group.fields)
    yield _steps()
    yield _table("", SCANS_GROUP.fields)
    yield _table("order.", ORDER_GROUP.fields)


def _table(prefix: str, fields: Iterable[TomlField]) -> str:
    return "\n".join([HEADER, *(_row(prefix, item) for item in fields)])


def _row(prefix: str, item: TomlField) -> str:
    cells = (f"`{prefix}{item.key}`", _default(item), item.unit or "–", _reach(item), item.doc)
    return f"| {' | '.join(cells)} |"


def _default(item: TomlField) -> str:
    if item.default is None or item.default == ():
        return "–"
    if item.key == "name":
        return "the file's name"
    if isinstance(item.default, tuple):
        return "all"
    if isinstance(item.default, bool):
        return str(item.default).lower()
    if isinstance(item.default, str):
        return f"`{item.default}`" if item.default else "empty"
    return f"{item.default:g}"


def _reach(item: TomlField) -> str:
    if not item.high:
        return "–"
    return "0 to 2⁶³ − 1" if item.key == "seed" else f"{item.low:g} to {item.high:g}"


def _steps() -> str:
    lines = ["| `kind` | keys | does |", "|---|---|---|"]
    for kind, items in step_fields(RigConfig()).items():
        keys = ", ".join(_step_key(item) for item in items) or "–"
        lines.append(f"| `{kind}` | {keys} | {STEP_KINDS[kind]} |")
    return "\n".join(lines)


def _step_key(item: TomlField) -> str:
    if item.default is not None:
        return f"`{item.key}` ({_default(item)})"
    return (
        f"`{item.key}` ({_reach(item)} {item.unit}".rstrip() + ")" if item.high else f"`{item.key}`"
    )


if __name__ == "__main__":
    print("\n\n".join(tables()))
