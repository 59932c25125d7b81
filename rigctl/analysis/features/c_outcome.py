"""How the search for C ended: statuses, both shares of the entries, and those not converged."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rigctl.analysis.paper import published
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.root_bracket import LIMIT_C, SearchStatus

NOT_CONVERGED = (SearchStatus.CAPPED, SearchStatus.DISCONTINUITY)
SEARCHED = (SearchStatus.CONVERGED, *NOT_CONVERGED)
DECIMALS = 4


class UnconvergedEntry(NamedTuple):
    """An entry of C whose search did not converge; taxels count from 1.

    ``rate_hz``: mean SA rate with that C; ``target_hz``: that at the reference force; both are None
    for a C from a file of an older version. ``difference_hz``: rate less target.
    """

    texture: str
    taxel: int
    speed_mm_s: float
    force_g: float
    status: str
    c: float
    rate_hz: float | None
    target_hz: float | None
    difference_hz: float

    def as_dict(self) -> dict[str, Any]:
        """Return the values by name, for JSON and CSV."""
        plain = self._asdict()
        return {k: round(v, DECIMALS) if isinstance(v, float) else v for k, v in plain.items()}


def count_search_statuses(force: ForceMatrix) -> dict[str, int]:
    """Return the number of searches by outcome, at forces other than the reference."""
    return {status.name.lower(): int((force.status == status).sum()) for status in SEARCHED}


def unconverged_entries(force: ForceMatrix) -> list[UnconvergedEntry]:
    """Return the entries that did not converge, those that miss the target most first."""
    places = np.argwhere(np.isin(force.status, NOT_CONVERGED))
    found = [_entry(force, *place) for place in places.tolist()]
    return sorted(found, key=lambda entry: -abs(entry.difference_hz))


def _entry(
    force: ForceMatrix, texture: int, taxel: int, speed: int, level: int
) -> UnconvergedEntry:
    at = (texture, taxel, speed, level)
    miss_hz = float(force.residual_hz[at])
    rate_hz = None if force.rate_hz is None else float(force.rate_hz[at])
    return UnconvergedEntry(
        force.textures[texture],
        taxel + 1,
        force.speeds_mm_s[speed],
        force.forces_g[level],
        SearchStatus(int(force.status[at])).name.lower(),
        float(force.c[at]),
        rate_hz,
        None if rate_hz is None else rate_hz - miss_hz,
        miss_hz,
    )


def unconverged_shares(force: ForceMatrix) -> dict[str, Any]:
    """Return entries not converged, searched and in all, for ``results.json``, and the paper's."""
    searched = sum(count_search_statuses(force).values())
    reference = int((force.status == SearchStatus.REFERENCE).sum())
    paper_unconverged, paper_entries = published.UNCONVERGED_C
    return {
        "unconverged": force.unconverged,
        "searched": searched,
        "entries": searched + reference,
        "above_limit": int(np.sum(force.c > LIMIT_C)),
        "paper": {
            "unconverged": paper_unconverged,
            "of": paper_entries,
            "searched": paper_entries - published.REFERENCE_C,
            "unconverged_rate_hz": published.UNCONVERGED_RATE_HZ,
        },
    }


def force_sentence(force: ForceMatrix) -> str:
    """Return sentences on the outcome of the search for C, with the paper's figures."""
    counts, shares = count_search_statuses(force), unconverged_shares(force)
    searched, entries, n = shares["searched"], shares["entries"], shares["unconverged"]
    paper = shares["paper"]
    of_searched = _share(paper["unconverged"], paper["searched"])
    of_all = _share(paper["unconverged"], paper["of"])
    return (
        f"C has {entries:,} entries, {entries - searched:,} of them 1 by definition at "
        f"{force.reference_g:g} g; {searched:,} were searched: {counts['converged']:,} converged "
        f"within 0.1 Hz ({shares['above_limit']:,} of them above {LIMIT_C:g}), "
        f"{counts['capped']:,} did not and are limited to {LIMIT_C:g}, "
        f"{counts['discontinuity']:,} lie at a jump of the rate. Not converged: "
        f"{_share(n, searched)} searched (the paper: {of_searched}), and "
        f"{_share(n, entries)} with the reference entries (the paper: {of_all})"
        f"{_difference_sentence(force)}"
    )


def _share(part: int, whole: int) -> str:
    return f"{100 * part / max(1, whole):.1f} %, {part:,} of {whole:,}"


def _difference_sentence(force: ForceMatrix) -> str:
    """Return a sentence on the entry that misses its target most, "" where all converged."""
    found = unconverged_entries(force)
    if not found:
        return ""
    worst = found[0]
    targets_hz = [entry.target_hz for entry in found if entry.target_hz is not None]
    of = "" if worst.target_hz is None else f" of {worst.target_hz:.1f}"
    highest = f", and the highest target is {max(targets_hz):.1f} Hz" if targets_hz else ""
    return (
        f". The SA rates of those entries miss their targets by at most "
        f"{abs(worst.difference_hz):.1f}{of} Hz (texture {worst.texture}, taxel {worst.taxel}, "
        f"{worst.speed_mm_s:g} mm/s, {worst.force_g:g} g){highest} (the paper: trains of at most "
        f"{published.UNCONVERGED_RATE_HZ:g} spikes/s)"
    )
