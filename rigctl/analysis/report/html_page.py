"""HTML pages from Jinja2 templates, on the base of this package's; each is one whole file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from rigctl.analysis.comparisons import NAME_OF
from rigctl.analysis.notes import summarise_notes
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.report.vega import scripts, specify, still

PACKAGE = "rigctl.analysis.report"
TEMPLATES = Path(__file__).with_name("templates")
ABSENT = "–"
SMALLEST_P = 1e-300


def render_page(template: str, package: str = PACKAGE, **context: Any) -> str:
    """Return the page of a template in ``templates/`` of a package; every value is escaped."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader(PACKAGE)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "absent": ABSENT,
        "names": NAME_OF,
        "scripts": lambda: Markup(scripts()),
        "source": lambda name: Markup((TEMPLATES / name).read_text(encoding="utf-8")),
    }
    environment.filters |= {
        "describe": _describe,
        "drawn": _drawn,
        "drawn_apart": _drawn_apart,
        "name_of": NAME_OF.get,
        "notes": summarise_notes,
        "number": _number,
        "numbers": _numbers,
        "p_value": describe_p,
        "specified": partial(specify, pointer=True),
        "still": lambda spec: Markup(still(spec)),
        "svg_uri": _svg_uri,
    }
    return environment.get_template(template).render(context)


def _drawn(figure: Figure) -> Markup:
    return Markup(still(specify(figure)))


def _drawn_apart(figure: Figure) -> list[Markup]:
    """Return a drawing of each panel, for the page to place."""
    return [_drawn(replace(figure, panels=[panel])) for panel in figure.panels]


def _svg_uri(png: Path) -> str:
    """Return the figure's SVG as a data URI: it stays sharp, and the page stays one file."""
    data = base64.b64encode(png.with_suffix(".svg").read_bytes()).decode()
    return f"data:image/svg+xml;base64,{data}"


def _describe(value: Any) -> str:
    if isinstance(value, Mapping):
        return "; ".join(f"{k} {v}" for k, v in value.items()) or ABSENT
    if isinstance(value, list):
        return ", ".join(map(_describe, value)) or ABSENT
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    return ABSENT if value in (None, "") else str(value)


def _number(value: float | None) -> str:
    if value is None:
        return ABSENT
    return f"{value:.2g}" if abs(value) < 0.01 else f"{value:.2f}"


def describe_p(p: float | None) -> str:
    """Return p with two digits; 0 is a p that is too small for a number."""
    return f"< {SMALLEST_P:g}" if p == 0 else _number(p)


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
