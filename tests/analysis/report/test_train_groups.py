"""The groups of spike trains in a figure follow the layers of the sensor."""

from __future__ import annotations

from rigctl.analysis.report.figures import train_groups
from rigctl.session.sensor_layout import SensorLayout


def test_the_papers_sensor_has_four_groups() -> None:
    groups = train_groups(SensorLayout.default(18))
    assert [group.name for group in groups] == ["SAI", "RAI", "SAII", "RAII"]
    assert [group.rows.start for group in groups] == [0, 18, 9, 27]
    assert groups[2].description == "slow, bottom layer"
    assert len({group.colour for group in groups}) == 4


def test_one_layer_has_a_group_for_each_channel() -> None:
    groups = train_groups(SensorLayout.default(16))
    assert [(group.name, group.description) for group in groups] == [("SA", "slow"), ("RA", "fast")]
    assert [len(group.rows) for group in groups] == [16, 16]


def test_every_layer_has_its_own_colours() -> None:
    groups = train_groups(SensorLayout(2, 2, ("I", "II", "III")))
    assert groups[-1].name == "RAIII" and groups[-1].description == "fast, layer 3 from the top"
    assert len({group.colour for group in groups}) == 6
    assert sorted(row for group in groups for row in group.rows) == list(range(24))
