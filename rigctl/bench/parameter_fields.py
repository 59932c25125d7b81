"""Parameters as fields of a dataclass, each with unit, plausible range, meaning and source."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_Parameters = TypeVar("_Parameters", bound="DataclassInstance")

PLAUSIBLE = "plausible"


class ParameterInfo(NamedTuple):
    """One parameter with the range that tests sweep."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    doc: str
    source: str


def parameter(
    value: float, unit: str, low: float, high: float, doc: str, source: str = PLAUSIBLE
) -> Any:
    """Return the field of a parameter with this nominal value."""
    return dataclasses.field(
        default=value,
        metadata={"unit": unit, "low": low, "high": high, "doc": doc, "source": source},
    )


def describe(parameters: DataclassInstance) -> list[ParameterInfo]:
    """Return every numeric parameter with its unit, range and meaning, in declaration order."""
    return [
        ParameterInfo(field.name, float(getattr(parameters, field.name)), **field.metadata)
        for field in dataclasses.fields(parameters)
        if field.metadata
    ]


def checked(parameters: _Parameters, kind: str) -> _Parameters:
    """Return the parameters. Raises WrongUse that names one outside its plausible range."""
    for row in describe(parameters):
        if not row.low <= row.value <= row.high:
            raise WrongUse(
                f"{kind} parameter {row.name} is {row.value:g} {row.unit}: "
                f"choose {row.low:g} to {row.high:g}"
            )
    return parameters
