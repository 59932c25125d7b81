"""The parameters of person and tracker: complete, plausible, validated, shown on their page."""

from __future__ import annotations

import dataclasses

import pytest

from rigctl.bench.parameter_fields import describe
from rigctl.bench.parameters import WorldParameters
from rigctl.errors import WrongUse
from rigctl.finger.bench import operator_parameters
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.bench.virtual import open_virtual_finger
from rigctl.finger.values import VelocityProfile
from tests.finger.bench.host import FingerHost


@pytest.mark.parametrize("parameters", [OperatorParameters(), TrackerParameters()])
def test_every_field_has_a_range_a_meaning_and_a_source(
    parameters: OperatorParameters | TrackerParameters,
) -> None:
    rows = describe(parameters)
    assert len(rows) == len(dataclasses.fields(parameters))
    for row in rows:
        assert row.low <= row.value <= row.high, row.name
        assert row.doc
        assert row.source.split(":")[0] in ("published", "plausible"), row.name


def test_values_out_of_range_are_refused_by_name() -> None:
    with pytest.raises(WrongUse, match="operator parameter force_g is 5000 g: choose 150 to 800"):
        open_virtual_finger(operator=OperatorParameters(force_g=5000.0))
    with pytest.raises(WrongUse, match="tracker parameter rate_hz is 20 Hz: choose 90 to 120"):
        open_virtual_finger(tracker=TrackerParameters(rate_hz=20.0))
    with pytest.raises(WrongUse, match="world parameter viscous_lag_ms"):
        open_virtual_finger(WorldParameters(viscous_lag_ms=500.0))


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_finger_at_either_end_of_every_range_slides_over_both_marks(end: str) -> None:
    operator = OperatorParameters(
        **{r.name: getattr(r, end) for r in describe(OperatorParameters())}
    )
    tracker = TrackerParameters(**{r.name: getattr(r, end) for r in describe(TrackerParameters())})
    rig = open_virtual_finger(operator=operator, tracker=tracker, seed=1)
    host = FingerHost(rig)
    for profile in VelocityProfile:
        truth = host.slide("D", profile)
        host.wait(5_000_000)
        assert truth.along_mm[0] < 50.0
        assert truth.along_mm[-1] > 250.0
    block, _ = host.decode()
    assert block.missing == 0
    rig.close()


def test_the_page_shows_the_tables() -> None:
    assert operator_parameters.main(["--check"]) == 0, (
        "run python -m rigctl.finger.bench.operator_parameters"
    )
