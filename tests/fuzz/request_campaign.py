"""Many mutated requests to engines of both experiments, each engine in a process that may die."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from tests.fuzz.guard import Finding
from tests.fuzz.outcome import Outcome, keep_findings
from tests.fuzz.requests import PLAYERS, Requests

ENGINE_REQUESTS = 5000
"""Requests to one engine before another one takes its place."""
_FORK = multiprocessing.get_context("fork")


def fuzz_requests(workplace: Path, results: Path, seed: int, count: int) -> Outcome:
    """Send ``count`` requests to engines of each experiment, one engine at a time for each."""
    answered = refused = 0
    findings: list[Finding] = []
    for first in range(0, count, ENGINE_REQUESTS):
        part = min(ENGINE_REQUESTS, count - first)
        for result in _play_side_by_side(workplace / str(first), seed + first, part):
            answered, refused = answered + result[0], refused + result[1]
            findings += result[2]
    first_line = (
        f"{count * len(PLAYERS):,} requests: {answered:,} answered, {refused:,} refused, "
        f"{len(findings):,} findings"
    )
    return keep_findings(first_line, findings, results)


def _play_side_by_side(
    workplace: Path, seed: int, count: int
) -> list[tuple[int, int, list[Finding]]]:
    started = []
    for name, play in PLAYERS.items():
        folder = workplace / name / "in" / "here"
        folder.mkdir(parents=True)
        ours, theirs = _FORK.Pipe(duplex=False)
        process = _FORK.Process(target=_play, args=(play, folder, seed, count, theirs))
        process.start()
        theirs.close()
        started.append((name, process, ours))
    results = []
    for name, process, pipe in started:
        try:
            results.append(pipe.recv())
        except EOFError:
            process.join()
            code = process.exitcode or 0
            what = signal.Signals(-code).name if code < 0 else f"exit {code}"
            finding = Finding("death", f"{what} {name}", f"{name}, seed {seed}: {what}")
            results.append((0, 0, [finding]))
        process.join()
    return results


def _play(
    play: Callable[[Path, int, int], Requests],
    folder: Path,
    seed: int,
    count: int,
    pipe: Connection,
) -> None:
    os.chdir(folder)  # what a request names is made in here
    requests = play(folder, seed, count)
    pipe.send((requests.answered, requests.refused, requests.findings))
    pipe.close()
