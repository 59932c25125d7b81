"""Pieces that every HTML page of the analysis is made of."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1f24; margin: 2rem auto; max-width: 68rem;
  padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } h2 { font-size: 1.2rem; margin-top: 2.4rem; }
.lead { color: #59636e; margin-top: 0; }
.simulated { background: #fff4d6; border-left: 4px solid #d9a400; padding: .6rem 1rem; }
.seen { background: #fdecec; border-left: 4px solid #c8102e; padding: .6rem 1rem; }
table { border-collapse: collapse; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem; border-bottom: 1px solid #e6e9ed; text-align: right; }
td { white-space: nowrap; vertical-align: top; } td:first-child { white-space: normal; }
th:first-child, td:first-child, .words { text-align: left; } td.words { white-space: normal; }
.dense table { font-size: .86em; } .dense th, .dense td { padding: .2rem .45rem; }
table.named td:nth-child(2), table.named th:nth-child(2) { text-align: left; }
th { font-weight: 600; vertical-align: bottom; }
.paper { color: #59636e; font-size: .87em; }
img { max-width: 100%; height: auto; } figure { margin: 1rem 0; }
figcaption, small { color: #59636e; } .wide { overflow-x: auto; }
@media print { body { max-width: none; } h2 { break-after: avoid; }
  figure { break-inside: avoid; } }
"""
ABSENT = "–"


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False, named: bool = False
) -> str:
    """``words``: every cell is a sentence. ``named``: the second column holds names."""
    kind = " class=words" if words else ""
    whole = "<table class=named>" if named else "<table>"
    top = "".join(f"<th{kind}>{cell}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td{kind}>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<div class=wide>{whole}<tr>{top}</tr>{body}</table></div>"


def sentences(said: Sequence[str], otherwise: str) -> str:
    if not said:
        return f"<p>{otherwise}</p>" if otherwise else ""
    return f"<ul>{''.join(f'<li>{escape(s)}</li>' for s in said)}</ul>"


def task_name(task: Mapping[str, Any], below: str) -> str:
    figure = f" ({task['figure']})".replace(". ", ".\u00a0") if task["figure"] else ""
    under = f"<br><span class=paper>{escape(below)}</span>" if below else ""
    return f"{escape(task['title'])}{escape(figure)}{under}"


def inline(png: Path, words: str) -> str:
    """The SVG inside the page, so that it stays sharp and the page stays whole."""
    data = base64.b64encode(png.with_suffix(".svg").read_bytes()).decode()
    source = f"data:image/svg+xml;base64,{data}"
    return f'<figure><img alt="{escape(words)}" src="{source}"></figure>'
