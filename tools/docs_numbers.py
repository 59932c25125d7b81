"""Measure the results that pages of ``docs/`` tell, and write them there.

``make docs-numbers`` measures all of them (half an hour), ``NUMBERS="ra-rates distances"`` some.
``docs/numbers.json`` keeps the values, with the commit and what a trial of the bench was like. The
pages have what :data:`NUMBERS` makes of the values, between marks; a test compares both, and the
bench with the one of today.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rigctl.bench.parameters import WorldParameters
from rigctl.cli import main as rigctl
from rigctl.encoder.encoder import encode_trial
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import RigctlError, WrongUse
from rigctl.finger.bench.operator_parameters import OperatorParameters
from rigctl.finger.values import Stage, VelocityProfile
from tools.finger_spreads import PERSONS, SlidingFinger, spread_rows
from tools.slides import Slider

CHECKOUT = Path(__file__).parents[1]
DOCS, BUILD = CHECKOUT / "docs", CHECKOUT / "build"
STORE = DOCS / "numbers.json"
PROTOCOLS = CHECKOUT / "protocols"
KINDS = ("Original", "Speed Scaled")
MOUNTINGS = {"nominal": "0.015 mm (nominal bench)", "tilted": "0.05 mm"}
TILT_MM = 0.05
SOME_MM = (10, 100, 200)
SEEDS = (1, 2, 3)
RANGE_TASKS = ("Untrained force", "Untrained speed")
RANGE_ROWS = (*KINDS, "Speed and Force Scaled, texture-blind")
EQUAL = {
    "readings": " counts",
    "trains": "",
    "C": "",
    "features": " Hz or spikes",
    "accuracies": " points",
}
"""What two processors have in common, and the unit of a difference."""
Values = dict[str, Any]


class Numbers(NamedTuple):
    """Results of one command: the page below ``docs/`` and how its ``blocks`` are written."""

    page: str
    command: str
    measure: Callable[[Path], Values]
    blocks: Mapping[str, Callable[[Values], str]]


def bench() -> list[float]:
    """Return what a trial of the drum and a scan of the finger are like on the nominal bench.

    Mean reading in counts, SA and RA rate in Hz, of each. Numbers of pages hold as long as these.
    """
    drum = Slider(WorldParameters(), 1)
    drum.mount("L")
    finger = SlidingFinger(WorldParameters(), OperatorParameters(), 1, 0)
    scan = finger.scan("L", VelocityProfile.MEDIUM, Stage.RUN)
    found = []
    for readings in (drum.trial(120.0, 500.0), scan.readings):
        spikes = encode_trial(readings, Normalisation.from_samples([readings], "itself"))
        counts = [len(spikes.train(row)) for row in range(spikes.n_trains)]
        halves = np.reshape(counts, (2, -1)).mean(axis=1) * 1000 / len(readings)
        found += [float(readings.mean()), *halves.tolist()]
    return [round(value, 3) for value in found]


def _made(out: Path, *words: str | Path) -> Path:
    """Return a folder that a command makes, which is used again where it is there already."""
    if not out.exists() and rigctl([*map(str, words), "--out", str(out)]):
        raise WrongUse(f"{out} could not be made, as said above")
    return out


def _results(folder: Path, session: Path, *words: str) -> Values:
    report = _made(folder, "analyse", session, "--iterations", *words)
    return dict(json.loads((report / "results.json").read_text(encoding="utf-8")))


def _measure_ra_rates(folder: Path) -> Values:
    session = _made(folder / "quick", "synth", "--plan", PROTOCOLS / "quick.toml", "--seed", "1")
    rows = _results(folder / "presets", session, "1", "--sensitivity")["sensitivity"]["rows"]
    return {row["preset"]: row["ra_hz"] for row in rows}


def _set(folder: Path, seed: int = 1) -> Path:
    plan = ("--plan", PROTOCOLS / "paper.toml", "--repeats", "4")
    return _made(folder / f"set-{seed}", "synth", *plan, "--seed", str(seed))


def _further(folder: Path) -> Values:
    words = ("1", "--task", "textures", "--also", "invariance", "--also", "distances")
    return dict(_results(folder / "further", _set(folder), *words)["further"])


def _measure_ranges(folder: Path) -> Values:
    words = ("5", "--task", "extrapolation", "--also", "ranges")
    values: Values = {}
    for seed in SEEDS:
        found = _results(folder / f"ranges-{seed}", _set(folder, seed), *words)
        for row in found["further"]["ranges"]["rows"]:
            both = row["all_percent"], row["training_percent"]
            name = f"{row['task']}: {row['representation']}"
            if row["task"] in RANGE_TASKS and row["representation"] in RANGE_ROWS:
                values.setdefault(name, []).append(both)
    return values


def _measure_invariance(folder: Path) -> Values:
    found = _further(folder)["invariance"]
    means: Values = {"about": found["sentences"][0]}
    for row in found["rows"]:
        if row["receptor"] == "SA":
            pair = row["correlation"], row["difference_percent"]
            means.setdefault(row["representation"], []).append(pair)
    return {k: v if k == "about" else np.mean(v, axis=0).tolist() for k, v in means.items()}


def _measure_distances(folder: Path) -> Values:
    rows = _further(folder)["distances"]["rows"]
    return {
        row["representation"]: [row["contrast"], row["neighbours_other_speed_percent"]]
        for row in rows
        if row["distance"] == "Victor-Purpura"
    }


def _measure_mountings(folder: Path) -> Values:
    folder.mkdir(parents=True, exist_ok=True)
    paper = (PROTOCOLS / "paper.toml").read_text(encoding="utf-8")
    plan, world = folder / "twice.toml", folder / "tilted.toml"
    plan.write_text(paper.replace("repeats = 100", "repeats = 4\nmounts = 2"), encoding="utf-8")
    world.write_text(f"plate_tilt_mm = {TILT_MM}\n", encoding="utf-8")
    values: Values = {}
    for name in MOUNTINGS:
        words = ("--world", world) if name == "tilted" else ()
        session = _made(folder / name, "synth", "--plan", plan, "--seed", "1", *words)
        report = _results(folder / f"{name}-report", session, "5", "--task", "leave-mount-out")
        values[name] = [
            [gap[key] for key in ("representation", "untrained_speed", *_GAPS)]
            for gap in report["mountings"]
        ]
    return values


_GAPS = ("same_mounting_percent", "other_mounting_percent")


def _measure_finger(folder: Path) -> Values:
    """Take what the pages say from the report of ``make realtime``, which takes longer."""
    path = BUILD / "finger" / "report" / "results.json"
    if not path.exists():
        raise WrongUse(f"{path} is not there: run `make realtime` before, with its three seeds")
    found = json.loads(path.read_text(encoding="utf-8"))
    shown = found["settings"]["analysis"]["finger"]["components"]
    lines = found["sentences"]
    sentences = [line.removeprefix("Simulated: ").removeprefix("note: ") for line in lines]
    by_mm = {
        one["kind"]: dict(zip(one["at_mm"], one["by_mm"], strict=True)) for one in found["evidence"]
    }
    tasks = [
        {
            "name": f"{task['figure'].removeprefix('Fig. ')}, {task['title'].lower()}",
            "kinds": [
                [task["curves"][kind]["mean"][shown - 1], task["curves"][kind]["peak"],
                 task["curves"][kind]["peak_components"]]
                for kind in KINDS
            ],
            "above": task["above_originals_peak"],
            "double": task["scaled_better_double"],
            "paper": [task["paper"]["accuracy"][kind] for kind in KINDS],
            "claims": task["paper"]["claims"],
        }
        for task in found["tasks"].values()
    ]  # fmt: skip
    return {
        "components": shown,
        "tasks": tasks,
        "evidence": [by_mm[KINDS[1]][mm] for mm in SOME_MM],
        "profiles": [
            [one["spread"], one["profile_share"]]
            for one in found["profiles"]
            if one["kind"] in KINDS
        ],
        "latency": found["latencies"]["features"],
        "sentences": [line for line in sentences if not line.startswith("Fig.")],
    }


def _measure_spreads(folder: Path) -> Values:
    return dict(spread_rows(WorldParameters()))


def _measure_textbook(folder: Path) -> Values:
    from tests.encoder.textbook_order import sentences

    return {str(seed): sentences([str(_set(folder, seed))]) for seed in SEEDS}


def _measure_processors(folder: Path) -> Values:
    from tests.benchmarks.encoder import processors

    rows = {row["name"].removeprefix("processors."): row for row in processors.measure()}
    if not rows:
        raise WrongUse("this processor has no AVX2 to compare with")
    return {name: [row["value"], row.get("largest")] for name, row in rows.items()}


def _table(head: str, rows: Iterator[Sequence[str]] | Sequence[Sequence[str]]) -> str:
    rule = "|".join(["---"] * (head.count("|") + 1))
    lines = [f"| {head} |", f"|{rule}|", *(f"| {' | '.join(row)} |" for row in rows)]
    return "\n".join(lines)


def _ra_rates(values: Values) -> str:
    rates = [
        f"`{name}` {values[name]:.1f}" for name in values if name.startswith(("default", "ra-"))
    ]
    return f"{', '.join(rates)} Hz."


def _textbook(values: Values) -> str:
    return "\n".join(f"- Set {seed}: {'; '.join(said)}." for seed, said in values.items())


def _processors(values: Values) -> str:
    rows = []
    for what, unit in EQUAL.items():
        cells = []
        for which in ("same", "own"):
            share, largest = values[f"{which}_readings.{what.lower()}_differing"]
            apart = f", by at most {largest:g}{unit}" if share and largest is not None else ""
            cells.append(f"{share:.3g} %{apart}" if share else "none")
        rows.append([what, *cells])
    return _table("differing | with the same readings | each with its own, of the same seed", rows)


def _ranges(values: Values) -> str:
    rows = []
    for name, sets in values.items():
        tested, representation = name.split(": ")
        rows.append([tested.lower(), representation, *(f"{a:.1f} → {b:.1f}" for a, b in sets)])
    return _table(f"tested | representation | {' | '.join(f'set {seed}' for seed in SEEDS)}", rows)


def _invariance(values: Values) -> str:
    rows = [
        [name, f"{found[0]:.2f}", f"{found[1]:.0f}"]
        for name, found in values.items()
        if name != "about"
    ]
    head = " | correlation | difference, % of the mean rate"
    return f"{values['about']} Of SA, mean over the pairs:\n\n{_table(head, rows)}"


def _distances(values: Values) -> str:
    rows = [[name, f"{one:.2f}", f"{other:.0f} %"] for name, (one, other) in values.items()]
    return _table(" | contrast | nearest neighbours at another speed with the right texture", rows)


def _mountings(values: Values) -> str:
    rows = []
    for name, tilt in MOUNTINGS.items():
        for untrained, tested in ((False, "all conditions"), (True, "untrained speeds")):
            by = {gap[0]: gap[2:] for gap in values[name] if gap[1] is untrained}
            shares = [f"{share:.1f}" for key in ("original", "speed") for share in by[key]]
            rows.append(["" if untrained else tilt, tested, *shares])
    columns = [f"{kind}, {which} mounting" for kind in KINDS for which in ("same", "other")]
    return _table(
        f"tilt of a mounted plate, rms a taxel pitch | tested | {' | '.join(columns)}", rows
    )


def _finger(values: Values) -> str:
    rows = []
    for task in values["tasks"]:
        ours = [f"{a:.1%} ({peak:.1%} at {k})".replace("%", " %") for a, peak, k in task["kinds"]]
        paper = ", ".join(
            f"about {one['percent']:g} % (saturates)"
            if one["components"] is None
            else f"{one['percent']:g} % at {one['components']}"
            for one in task["paper"]
        )
        rows.append([task["name"], *ours, paper, task["above"], task["double"]])
    head = (
        f"task, {values['components']} components | Original (peak) | Speed Scaled (peak) | the "
        "paper: Original, Speed Scaled | Speed Scaled above Original's peak at | better with ** at"
    )
    return _table(head, rows)


def _beyond(values: Values) -> str:
    shares = zip(values["evidence"], SOME_MM, strict=True)
    (spread, share), (scaled_spread, scaled_share) = values["profiles"]
    latency = values["latency"]
    lines = [
        "Speed Scaled is right in "
        f"{', '.join(f'{right:.1%} of scans after {mm} mm' for right, mm in shares)}",
        *values["sentences"],
        f"mean rates of two velocity profiles differ by up to {scaled_spread:.0%} with Speed "
        f"Scaled, {spread:.0%} with Original; within a texture the profile explains "
        f"{scaled_share:.0%} and {share:.0%} of the variance of the features",
        f"from the sending of a velocity to its windows at the host: {latency['p50']:.1f} ms "
        f"(median; the slowest of {latency['n']:,} batches {latency['max']:.1f} ms), in the loop's "
        "time on the virtual finger's cable (0.5 ms each way)",
    ]
    return "\n".join(f"- {line}" for line in lines)


def _spreads(values: Values) -> str:
    names = ("4B same session", "4B new session", "S5")
    head = " | ".join(["person", *(f"{name}: {kind}" for name in names for kind in KINDS)])
    return _table(head, [[name, *(f"{a:.1f}" for a in values[name])] for name in PERSONS])


FINGER_PAGE, ANALYSIS_PAGE = "explanation/moving-finger.md", "reference/analysis.md"
NUMBERS: Mapping[str, Numbers] = {
    "ra-rates": Numbers(
        "reference/encoding.md", "make docs-numbers", _measure_ra_rates, {"ra-rates": _ra_rates}
    ),
    "textbook": Numbers(
        "reference/encoding.md", "make docs-numbers", _measure_textbook, {"textbook": _textbook}
    ),
    "processors": Numbers(
        "reference/encoding.md", "make docs-numbers", _measure_processors,
        {"processors": _processors},
    ),
    "ranges": Numbers(
        "how-to/study-design.md", "make docs-numbers", _measure_ranges, {"ranges": _ranges}
    ),
    "invariance": Numbers(
        ANALYSIS_PAGE, "make docs-numbers", _measure_invariance, {"invariance": _invariance}
    ),
    "distances": Numbers(
        ANALYSIS_PAGE, "make docs-numbers", _measure_distances, {"distances": _distances}
    ),
    "mountings": Numbers(
        ANALYSIS_PAGE, "make docs-numbers", _measure_mountings, {"mountings": _mountings}
    ),
    "finger": Numbers(
        FINGER_PAGE, "make realtime docs-numbers", _measure_finger,
        {"finger": _finger, "finger-beyond": _beyond},
    ),
    "spreads": Numbers(
        FINGER_PAGE, "make docs-numbers", _measure_spreads, {"spreads": _spreads}
    ),
}  # fmt: skip


def stored() -> dict[str, Values]:
    """Return the values of every entry, with its commit, day and bench."""
    return dict(json.loads(STORE.read_text(encoding="utf-8"))) if STORE.exists() else {}


def written(page: str, name: str, kept: Mapping[str, Values]) -> str:
    """Return the text of a page with the blocks of an entry as its stored values have them.

    Raises WrongUse for a page without the marks of a block.
    """
    numbers, entry = NUMBERS[name], kept[name]
    for block, render in numbers.blocks.items():
        begin, end = f"<!-- numbers: {block} -->\n", "<!-- end of numbers -->"
        made = f"`{numbers.command} NUMBERS={name}`, {entry['day']}, commit {entry['commit']}"
        text = f"{begin}{render(entry['values'])}\n\n<small>{made}</small>\n{end}"
        before, mark, rest = page.partition(begin)
        _, last, behind = rest.partition(end)
        if not (mark and last):
            raise WrongUse(f"docs/{numbers.page} has no marks of {block}")
        page = f"{before}{text}{behind}"
    return page


def main(arguments: list[str] | None = None) -> int:
    """Measure the named entries, or all, and write store and pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NUMBERS))
    parser.add_argument("--write", action="store_true", help="write the pages from stored values")
    options = parser.parse_args(arguments)
    try:
        for name in () if options.write else options.names or NUMBERS:
            _measure(name)
        for name in stored():
            page = DOCS / NUMBERS[name].page
            page.write_text(written(page.read_text("utf-8"), name, stored()), encoding="utf-8")
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    return 0


def _measure(name: str) -> None:
    if name not in NUMBERS:
        raise WrongUse(f"there are no numbers {name}: choose from {', '.join(NUMBERS)}")
    print(f"==> {name}", flush=True)
    git = ("git", "-C", str(CHECKOUT), "rev-parse", "--short=8", "HEAD")
    commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    values = NUMBERS[name].measure(BUILD / "numbers")
    day = datetime.now(UTC).date().isoformat()
    kept = {**stored(), name: {"commit": commit, "day": day, "bench": bench(), "values": values}}
    text = json.dumps(kept, indent=1, ensure_ascii=False, allow_nan=False)
    STORE.write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
