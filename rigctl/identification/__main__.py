"""``python -m rigctl.identification``: search for the bench's unknowns, print the best of them."""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import replace
from typing import Any

from rigctl.errors import RigctlError
from rigctl.identification.measures import measure
from rigctl.identification.search import START, Candidate, ParameterSearch, candidate
from rigctl.identification.sliding import slide
from rigctl.simulation.bench.parameters import WorldParameters, table

SHOWN_REPEATS = 8


def main(arguments: list[str] | None = None) -> int:
    """Search, or with ``--steps 0`` only judge the nominal world."""
    asked = _parser().parse_args(arguments)
    try:
        given: dict[str, Any] = (START if asked.steps else {}) | dict(asked.set)
        start = replace(WorldParameters(), **given)
        best = _searched(start, asked.steps, asked.seed)
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(best.toml())
    print("\n".join(f"# {line}" for line in best.lines()))
    (shown,) = slide(best.parameters, SHOWN_REPEATS, [asked.seed])
    print("\n".join(f"# {line}" for line in measure(shown).lines()))
    return 0


def _searched(start: WorldParameters, steps: int, seed: int) -> Candidate:
    began_s = time.monotonic()
    search = ParameterSearch(candidate(start), seed)
    for step in range(1, steps + 1):
        search.step()
        passed_s = time.monotonic() - began_s
        left_min = passed_s / step * (steps - step) / 60.0
        print(
            f"\r{step} of {steps} steps · best {search.best.error:.2f} points off · "
            f"{math.ceil(left_min)} min left ",
            end="",
            file=sys.stderr,
        )
    print(file=sys.stderr)
    return search.best


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m rigctl.identification", description=__doc__)
    parser.add_argument("--steps", type=int, default=100, help="sets of parameters to try (100)")
    parser.add_argument("--seed", type=int, default=1, help="of the search (1)")
    parser.add_argument(
        "--set",
        type=_assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="begin at another value of a parameter",
    )
    return parser


def _assignment(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    if name not in {row.name for row in table()}:
        raise argparse.ArgumentTypeError(f"no parameter {name!r}: docs/reference/world.md has them")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write {name}=NUMBER") from None


if __name__ == "__main__":
    sys.exit(main())
