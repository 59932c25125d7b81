"""The short form of ``make fuzz``: a few mutated files of every kind, always the same ones."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz.campaign import Campaign
from tests.fuzz.kinds.every_kind import KINDS

FILES = 6
SEED = 18


def test_no_mutated_file_does_more_than_be_refused(tmp_path: Path) -> None:
    campaign = Campaign(tmp_path / "work", tmp_path / "findings", SEED, quiet=True)
    campaign.run(FILES, list(KINDS), processes=2)
    assert not campaign.causes, campaign.report()
    assert campaign.done == dict.fromkeys(KINDS, FILES)
