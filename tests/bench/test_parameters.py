"""The parameters: complete, plausible, validated, and shown on their page."""

from __future__ import annotations

import dataclasses

import pytest

from rigctl.bench import parameter_tables
from rigctl.bench.parameters import WorldParameters, parameter_infos
from rigctl.bench.virtual_rig import open_virtual_rig
from rigctl.errors import WrongUse

KINDS = ("published", "measured", "identified", "plausible")


def test_every_nominal_value_is_in_its_range_and_has_a_meaning_and_a_source() -> None:
    for row in parameter_infos():
        assert row.low <= row.value <= row.high, row.name
        assert row.doc
        assert row.source.split(":")[0] in KINDS, row.name


def test_a_value_out_of_range_is_refused_by_name() -> None:
    with pytest.raises(WrongUse, match="stiffness_g_mm is 5000 g/mm: choose 300 to 900"):
        open_virtual_rig(WorldParameters(stiffness_g_mm=5000.0))
    with pytest.raises(WrongUse, match="there is no taxel 18: choose 0 to 17"):
        open_virtual_rig(WorldParameters(dead_taxels=(18,)))


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_rig_at_either_end_of_every_range_opens_and_runs(end: str) -> None:
    values = {row.name: getattr(row, end) for row in parameter_infos()}
    rig = open_virtual_rig(dataclasses.replace(WorldParameters(), **values))
    rig.advance(100_000)
    assert rig.truth.arrays().force_g.max() == 0.0 or end == "high"


def test_the_page_shows_the_table() -> None:
    assert parameter_tables.main(["--check"]) == 0, "run python -m rigctl.bench.parameter_tables"
