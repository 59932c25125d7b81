"""``python -m rigctl.identification``: identify the bench's unknown parameters and print them."""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import replace
from typing import Any

from rigctl.errors import RigctlError
from rigctl.identification.measures import measure_skin
from rigctl.identification.search import START, Candidate, ParameterSearch, evaluate
from rigctl.identification.sliding import simulate_slides
from rigctl.simulation.bench.world.parameters import WorldParameters, parameter_infos

SHOWN_REPEATS = 8


def main(arguments: list[str] | None = None) -> int:
    """Search, or with ``--steps 0`` only evaluate the nominal world."""
    options = _parser().parse_args(arguments)
    try:
        values: dict[str, Any] = (START if options.steps else {}) | dict(options.set)
        best = _search(replace(WorldParameters(), **values), options.steps, options.seed)
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(best.toml())
    print("\n".join(f"# {line}" for line in best.lines()))
    (session,) = simulate_slides(best.parameters, SHOWN_REPEATS, [options.seed])
    print("\n".join(f"# {line}" for line in measure_skin(session).lines()))
    return 0


def _search(start: WorldParameters, steps: int, seed: int) -> Candidate:
    began_s = time.monotonic()
    search = ParameterSearch(evaluate(start), seed)
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
    if name not in {row.name for row in parameter_infos()}:
        raise argparse.ArgumentTypeError(f"no parameter {name!r}: docs/reference/world.md has them")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write {name}=NUMBER") from None


if __name__ == "__main__":
    sys.exit(main())
