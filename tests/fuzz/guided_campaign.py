"""Guided mutations of each kind that is text, in processes of their own, if atheris is there."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.fuzz.guard import Finding
from tests.fuzz.kinds.every_kind import KINDS
from tests.fuzz.outcome import Outcome, keep_findings

STARTING_S = 120


def fuzz_guided(
    workplace: Path, results: Path, seed: int, seconds: int, kinds: Sequence[str]
) -> Outcome:
    """Fuzz each kind for some seconds."""
    names = [name for name in kinds if KINDS[name].guided]
    if importlib.util.find_spec("atheris") is None:
        return Outcome("guided mutations: atheris is not installed, nothing tried", False)
    if not seconds or not names:
        return Outcome("guided mutations: none asked for", False)
    findings: list[Finding] = []
    tried = 0
    for name in names:
        print(f"guided mutations of {name}, {seconds} s", file=sys.stderr, flush=True)
        found, runs = _fuzz_kind(workplace / name, seed, seconds, name)
        findings += found
        tried += runs
    first_line = f"{tried:,} guided mutations of {', '.join(names)}: {len(findings)} findings"
    return keep_findings(first_line, findings, results)


def _fuzz_kind(place: Path, seed: int, seconds: int, name: str) -> tuple[list[Finding], int]:
    place.mkdir(parents=True)
    found = place / "found.jsonl"
    numbers = (str(seconds), str(seed % 2**31))
    command = [sys.executable, "-m", "tests.fuzz.guided", name, *numbers, str(place), str(found)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=seconds + STARTING_S, check=False
    )
    findings = []
    for line in found.read_text(encoding="utf-8").splitlines() if found.exists() else []:
        kept = json.loads(line)
        details = f"{name}: {kept['details']}\nbytes in hexadecimal: {kept['data']}"
        findings.append(Finding(kept["failure"], kept["where"], details))
    if done.returncode:
        text = f"{name} ended with {done.returncode}\n{done.stderr[-5000:]}"
        findings.append(Finding("death", f"guided {name}", text))
    count = place / "count.txt"
    return findings, int(count.read_text()) if count.exists() else 0
